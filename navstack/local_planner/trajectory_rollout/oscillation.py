"""What turned turns on: the left/right flags of base_local_planner's TrajectoryPlanner (rotating_left, stuck_left, ..)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D


class AxisFlags:
    """Positive and negative speeds of one axis: one that was chosen twice is the only one left."""

    def __init__(self) -> None:
        self._chosen = [False, False]
        self._only = [False, False]

    def note(self, speed: float) -> None:
        """`speed`, not 0, was chosen."""
        side = 0 if speed > 0.0 else 1
        self._only[side] = self._only[side] or self._chosen[side]
        self._chosen[side] = True

    def allows(self, speed: float) -> bool:
        """False where the other way is the only one."""
        return not self._only[0 if speed < 0.0 else 1]

    def clear(self) -> None:
        """Both ways are open again."""
        self._chosen, self._only = [False, False], [False, False]


class OscillationFlags:
    """Of turns in place and of strafing: a way chosen twice without moving is the only one until the robot has moved."""

    def __init__(self) -> None:
        self.turn = AxisFlags()
        self.strafe = AxisFlags()
        self.since = Pose2D(0.0, 0.0)
        """Where the last command was given that did not drive forward."""

    def note(self, sample: NDArray[np.float64], pose: Pose2D) -> None:
        """`sample` (3,), which does not drive forward, was chosen at `pose`."""
        if sample[2] != 0.0:
            self.turn.note(float(sample[2]))
        elif sample[1] != 0.0:
            self.strafe.note(float(sample[1]))
        self.since = pose

    def moved(self, pose: Pose2D, distance: float) -> bool:
        """True once the robot is farther than `distance` (m) from where it last chose a way."""
        return math.hypot(pose.x - self.since.x, pose.y - self.since.y) > distance

    def clear(self) -> None:
        """Every way is open again."""
        self.turn.clear()
        self.strafe.clear()

    @property
    def closed(self) -> list[str]:
        """Which turns in place are closed."""
        return [way for way, speed in (("left", 1.0), ("right", -1.0)) if not self.turn.allows(speed)]

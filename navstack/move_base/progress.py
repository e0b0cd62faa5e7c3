"""Progress of the robot; its absence is what move_base calls oscillation."""

from __future__ import annotations

import math
from enum import Enum

from navstack.core import Pose2D, angle_between

PROGRESS_ANGLE = 0.5
"""rad; as Nav2's PoseProgressChecker."""


class Progress(Enum):
    """What the robot did since its last progress."""

    NONE = "none"
    TURNED = "turned"
    MOVED = "moved"


class OscillationChecker:
    """Progress is a motion of `distance` (m) from the place of the last progress, or a turn to a new heading there.

    ROS differs: C++ counts distance only, so that a slow turn in place is "oscillating" (parity 24). Here a turn counts in
    steps of `angle` (rad) as long as it reaches new headings, up to a full turn at one place. A robot that swings back and
    forth, or spins without end, makes no progress.
    """

    def __init__(self, distance: float, angle: float = PROGRESS_ANGLE) -> None:
        self.distance = distance
        self.angle = angle
        self._reference: Pose2D | None = None
        self._yaw = 0.0
        self._heading = 0.0
        self._low = 0.0
        self._high = 0.0

    def reset(self) -> None:
        """Start again at the next pose."""
        self._reference = None

    def update(self, pose: Pose2D) -> Progress:
        """Return the progress of the robot, now at `pose`."""
        reference = self._reference
        if reference is None or pose.distance_to(reference) >= self.distance:
            self._reference = pose
            self._yaw = pose.yaw
            self._heading = self._low = self._high = 0.0
            return Progress.MOVED
        self._heading += angle_between(self._yaw, pose.yaw)
        self._yaw = pose.yaw
        if self._high - self._low >= 2.0 * math.pi:
            return Progress.NONE
        if self._heading >= self._high + self.angle:
            self._high = self._heading
            return Progress.TURNED
        if self._heading <= self._low - self.angle:
            self._low = self._heading
            return Progress.TURNED
        return Progress.NONE

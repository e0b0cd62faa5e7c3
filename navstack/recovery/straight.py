"""Straight motions with collision checks, shared by back_up and drive_on_heading.

Source of behavior and names: nav2_behaviors (drive_on_heading.hpp).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D
from navstack.core.collision import footprint_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import CollisionAheadError, RecoveryError
from navstack.core.overlap import excusing_overlap, leads_away
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep
from navstack.recovery.motion import blocks, describe_obstacle, known_obstacle_after


def clear_distance(costmap: Costmap, footprint: Footprint, pose: Pose2D, distance: float) -> tuple[float, int | None]:
    """Return how far (m, up to `|distance|`) the footprint can move along its heading, backwards if negative.

    The whole footprint is checked every half cell. The second value is the footprint cost that ends the motion (None for the
    edge of the costmap), or the largest cost if nothing does.
    """
    worst = 0
    for at in straight_poses(costmap, pose, distance):
        cost = footprint_cost(costmap, footprint, Pose2D(*at.tolist()))
        if cost is None or blocks(cost):
            return pose.distance_to(Pose2D(*at.tolist())), cost
        worst = max(worst, cost)
    return abs(distance), worst


def straight_poses(costmap: Costmap, pose: Pose2D, distance: float) -> NDArray[np.float64]:
    """Return poses (n, 3) every half cell of a straight motion from `pose`, backwards if negative, its ends included."""
    step = 0.5 * costmap.geometry.resolution
    along = np.minimum(np.arange(math.ceil(abs(distance) / step) + 1) * step, abs(distance))
    return np.array(pose) + np.outer(np.copysign(along, distance), (math.cos(pose.yaw), math.sin(pose.yaw), 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class StraightMotion:
    """A motion of `distance` (m, backwards if negative) at `speed` (m/s, positive), and its errors."""

    distance: float
    speed: float
    timeout: type[RecoveryError]
    collision: type[CollisionAheadError]


class StraightRecovery(RecoveryBehavior):
    """A recovery behavior that is one straight motion. A subclass calls `begin` in its `start`; its `Params` are MotionParams."""

    def __init__(self, name: str, params: Any) -> None:
        super().__init__(name, params)
        self._context: RecoveryContext | None = None
        self._motion: StraightMotion | None = None
        self._started_at = 0.0
        self._start: Pose2D | None = None

    @property
    def frequency(self) -> float:
        """Rate of the commands (Hz)."""
        return self.params.cycle_frequency

    def begin(self, context: RecoveryContext, now: float, motion: StraightMotion) -> None:
        """Begin a motion from the pose of the first step, at most at the local planner's maximum speed."""
        speed = min(motion.speed, context.local_planner.limits.max_vel_trans)
        self._context = context
        self._motion = StraightMotion(motion.distance, speed, motion.timeout, motion.collision)
        self._started_at = now
        self._start = None

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """Return the next command. Raises the errors of the motion."""
        context, motion = self._context, self._motion
        assert context is not None and motion is not None
        first = self._start is None
        if self._start is None:
            self._start = state.pose
        driven = self._start.distance_to(state.pose)
        left = abs(motion.distance) - driven
        data = {"driven_m": driven, "left_m": max(0.0, left)}
        # the command holds for a whole period: stop at the nearest step
        if left <= 0.5 * motion.speed / self.params.cycle_frequency:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name}: drove {driven:.2f} m", data=data)
        if now - self._started_at > self.params.time_allowance:
            raise motion.timeout(
                f"{self.name} drove {driven:.2f} of {abs(motion.distance):.2f} m within its time_allowance of "
                f"{self.params.time_allowance:g} s",
                **data,
            )
        if not self.params.disable_collision_checks:
            self._check_path(context, motion, state.pose, data)
            self._check_known(context, motion, now, data)
        text = f"{self.name}: driving {motion.distance:.2f} m at {motion.speed:g} m/s" if first else ""
        speed = math.copysign(motion.speed, motion.distance)
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(speed, 0.0, 0.0), text, data)

    def _check_path(
        self, context: RecoveryContext, motion: StraightMotion, pose: Pose2D, data: dict[str, float]
    ) -> None:
        look_ahead = motion.speed * self.params.simulate_ahead_time
        left = abs(motion.distance) - data["driven_m"]
        costmap = context.local_costmap
        ahead = math.copysign(min(left, look_ahead), motion.distance)
        master, footprint = costmap.master, costmap.footprint
        master = excusing_overlap(master, footprint, straight_poses(master, pose, ahead))
        clear, cost = clear_distance(master, footprint, pose, ahead)
        if blocks(cost):
            raise motion.collision(
                f"{self.name} stopped after {data['driven_m']:.2f} of {abs(motion.distance):.2f} m: the footprint hits "
                f"{describe_obstacle(cost)} after another {clear:.2f} m",
                cost=cost,
                collision_after_m=clear,
                **data,
            )

    def _check_known(
        self, context: RecoveryContext, motion: StraightMotion, now: float, data: dict[str, float]
    ) -> None:
        """Raise the motion's collision error for obstacles of the global costmap: on the whole way before the first command,
        later within the time ahead.
        """
        left = abs(motion.distance) - data["driven_m"]
        first = data["driven_m"] == 0.0
        ahead = left if first else min(left, motion.speed * self.params.simulate_ahead_time)
        costmap = context.global_costmap
        signed = math.copysign(ahead, motion.distance)
        clear = known_obstacle_after(context, now, signed, 0.0, step=0.5 * costmap.master.geometry.resolution)
        if clear == 0.0:
            way = straight_poses(costmap.master, costmap.robot_pose(now), signed)
            clear = None if leads_away(costmap.master, costmap.footprint, way) else clear
        if clear is not None:
            done = "did not start" if first else f"stopped after {data['driven_m']:.2f} m"
            raise motion.collision(
                f"{self.name} {done}: the footprint hits an "
                f"obstacle of the {costmap.name} after {clear:.2f} of the {left:.2f} m to drive",
                cost=LETHAL,
                collision_after_m=clear,
                costmap=costmap.name,
                **data,
            )

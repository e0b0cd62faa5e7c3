"""Straight ahead or backwards: back_up and drive_on_heading of Nav2, and the motion move."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.behaviors.base import (
    Motion,
    N,
    Nav2Behavior,
    Nav2Params,
    braking_speed,
    describe_obstacle,
    first_obstacle,
    straight,
)
from navstack.behaviors.errors import (
    BackUpCollisionError,
    BackUpTimeoutError,
    DriveOnHeadingCollisionError,
    DriveOnHeadingInputError,
    DriveOnHeadingTimeoutError,
    InvalidMotionError,
)
from navstack.behaviors.follow import steering_to_line
from navstack.core import CollisionAheadError, Pose2D, RobotState, Transform2D, Twist2D
from navstack.parameters import MotionParams
from navstack.plugins import RECOVERY_BEHAVIORS, BehaviorContext, BehaviorStatus, BehaviorStep, param

# --- behaviors of Nav2 (drive_on_heading.hpp) -------------------------------------------------------------------------


class StraightBehavior(Nav2Behavior[N]):
    """One straight motion from the pose of the first step. A subclass says how far and how fast."""

    collision: ClassVar[type[CollisionAheadError]]

    def __init__(self, name: str, params: N) -> None:
        super().__init__(name, params)
        self.distance = self.speed = self._driven = self._left = 0.0
        self._start = Pose2D(0.0, 0.0)

    @abstractmethod
    def wanted(self) -> tuple[float, float]:
        """Return the distance (m, backwards if negative) and the speed (m/s, positive)."""

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step, at most at the local planner's maximum speed."""
        super().start(context, now)
        self.distance, speed = self.wanted()
        self.speed = min(speed, context.local_planner.limits.max_vel_trans)

    def begin(self, pose: Pose2D, state: RobotState, now: float) -> float:
        """Count from `pose`; return the time allowance."""
        self._start = pose
        return super().begin(pose, state, now)

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next command."""
        del state, now
        driven = self._driven = self._start.distance_to(pose)
        left = self._left = abs(self.distance) - driven
        data = {"driven_m": driven, "left_m": max(0.0, left)}
        # the command holds for a whole period: stop at the nearest step
        if left <= 0.5 * self.speed / self.params.cycle_frequency:
            return BehaviorStep(BehaviorStatus.DONE, text=f"{self.name}: drove {driven:.2f} m", data=data)
        text = "" if self.has_begun else f"{self.name}: driving {self.distance:.2f} m at {self.speed:g} m/s"
        speed = math.copysign(self.speed, self.distance)
        return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(speed, 0.0, 0.0), text, data)

    def check_way(self, pose: Pose2D, now: float, data: dict[str, float]) -> None:
        """Raise the behavior's CollisionAheadError for an obstacle ahead."""
        reach = min(self._left, self.speed * self.params.simulate_ahead_time)
        context = self.context
        seen = straight(context.local_costmap, math.copysign(reach, self.distance), even=False)
        obstacle = first_obstacle(context, pose, now, seen, known=False)
        if obstacle is not None:
            clear = float(abs(seen[obstacle.index, 0]))
            raise self.collision(
                f"{self.name} stopped after {self._driven:.2f} of {abs(self.distance):.2f} m: the footprint hits "
                f"{describe_obstacle(obstacle.cost)} after another {clear:.2f} m",
                cost=obstacle.cost,
                collision_after_m=clear,
                **data,
            )
        first = self._driven == 0.0
        reach = self._left if first else reach
        known = straight(context.global_costmap, math.copysign(reach, self.distance), even=False)
        obstacle = first_obstacle(context, pose, now, known, seen=False)
        if obstacle is not None:
            clear = float(abs(known[obstacle.index, 0]))
            done = "did not start" if first else f"stopped after {self._driven:.2f} m"
            raise self.collision(
                f"{self.name} {done}: the footprint hits an "
                f"obstacle of the {obstacle.costmap} after {clear:.2f} of the {self._left:.2f} m to drive",
                cost=obstacle.cost,
                collision_after_m=clear,
                costmap=obstacle.costmap,
                **data,
            )

    def summary(self) -> str:
        """Return the distance driven."""
        return f"{self.name}: drove {self._driven:.2f} of {abs(self.distance):.2f} m"


class BackUpParams(Nav2Params):
    """Namespace: the instance's name. Names and defaults as in Nav2; the signs of distance and speed are ignored."""

    backup_dist: float = param(0.15, "distance to reverse", unit="m")
    backup_speed: float = param(0.025, "speed, limited by the local planner's", unit="m/s")


@RECOVERY_BEHAVIORS.register("back_up", aliases=("nav2_behaviors/BackUp", "nav2_recoveries/BackUp"))
class BackUp(StraightBehavior[BackUpParams]):
    """Reverses `backup_dist`. Before each command the whole footprint is checked along the path on the local costmap.

    Source of behavior and names: Nav2 (nav2_behaviors/BackUp, nav2_behavior_tree's BackUp node). move_base has none.
    """

    Params = BackUpParams
    timeout = BackUpTimeoutError
    collision = BackUpCollisionError

    def wanted(self) -> tuple[float, float]:
        """Return the distance backwards, and the speed."""
        return -abs(self.params.backup_dist), abs(self.params.backup_speed)


class DriveOnHeadingParams(Nav2Params):
    """Namespace: the instance's name. Names and defaults as in Nav2."""

    dist_to_travel: float = param(0.15, "distance to drive, backwards if negative", unit="m")
    speed: float = param(0.025, "speed with the sign of the distance, limited by the local planner's", unit="m/s")


@RECOVERY_BEHAVIORS.register(
    "drive_on_heading", aliases=("nav2_behaviors/DriveOnHeading", "nav2_recoveries/DriveOnHeading")
)
class DriveOnHeading(StraightBehavior[DriveOnHeadingParams]):
    """Drives `dist_to_travel` straight. Before each command the whole footprint is checked along the path.

    Source of behavior and names: Nav2 (nav2_behaviors/DriveOnHeading, nav2_behavior_tree's node). move_base has none.
    """

    Params = DriveOnHeadingParams
    timeout = DriveOnHeadingTimeoutError
    collision = DriveOnHeadingCollisionError

    def check(self, context: BehaviorContext) -> None:
        """Raise DriveOnHeadingInputError if distance and speed have opposite signs."""
        del context
        p = self.params
        if p.dist_to_travel * p.speed < 0.0:
            raise DriveOnHeadingInputError(
                f"{self.name}: dist_to_travel {p.dist_to_travel:g} m and speed {p.speed:g} m/s point in opposite "
                "directions; give both the same sign",
                parameter=f"{self.name}/speed",
            )

    def start(self, context: BehaviorContext, now: float) -> None:
        """Start from the pose of the first step. Raises as `check` does."""
        self.check(context)
        super().start(context, now)

    def wanted(self) -> tuple[float, float]:
        """Return the distance and the speed."""
        return self.params.dist_to_travel, abs(self.params.speed)


# --- move -------------------------------------------------------------------------------------------------------------


class Move(Motion):
    """Drives `distance` (m), backwards if negative, and stops within `tolerance`.

    Source of the names and of the idea: the node LinearMove of the ROS tutorials. ROS differs: that node measures the
    straight-line distance from the start and stops within a window around it, so that a push or a long cycle makes it drive on
    for ever; it has no acceleration limits and no collision checks. Here the distance is measured along the start's heading, and
    the robot is kept on the line.
    """

    def __init__(self, distance: float, params: MotionParams | None = None, name: str = "move") -> None:
        """Raise InvalidMotionError for a distance that is not finite."""
        super().__init__(name, params)
        if not math.isfinite(distance):
            raise InvalidMotionError(f"the distance {distance} of {name} is not finite", distance=distance)
        self.distance = distance
        self._line = Transform2D()
        self._driven = 0.0

    def describe(self) -> dict[str, Any]:
        """Return the distance (m)."""
        return {"move": self.distance}

    def prepare(self, pose: Pose2D, state: RobotState) -> float:
        """Start the line at `pose`."""
        del state
        self._line = Transform2D(*pose)
        self.target = self._line.apply(Pose2D(self.distance, 0.0))
        self.reference = self.line(pose, self.target)
        limits = self.limits
        speed = min(self.params.speed_linear, limits.max_speed)
        return abs(self.distance) / speed + 2.0 * speed / limits.max_acceleration

    def command(self, pose: Pose2D, state: RobotState, now: float) -> BehaviorStep:
        """Return the next step."""
        del now
        on_line = self._line.inverse().apply(pose)
        self._driven = on_line.x
        left = self.distance - on_line.x
        data = {"driven_m": on_line.x, "left_m": abs(left), "across_m": on_line.y}
        limits, p = self.limits, self.params
        slow = abs(self._ramp.last.vx) <= limits.max_acceleration * self.dt
        if abs(left) <= p.tolerance and slow:
            if self.is_standing(state):
                return self.done(data)
            return self.running(0.0, 0.0, data, f"stopping, {left:.3f} m from the target")
        cruise = min(p.speed_linear, limits.max_speed)
        speed = math.copysign(min(cruise, braking_speed(abs(left), limits.max_acceleration, self.dt)), left)
        what = "cruising" if abs(speed) == cruise else "braking for the target"
        return self.running(
            speed,
            steering_to_line(on_line, speed, limits.max_turn_rate, p),
            data,
            f"{what}: moved {on_line.x:.3f} of {self.distance:.3f} m, {abs(on_line.y):.3f} m off the line",
        )

    def ahead(self, pose: Pose2D, now: float, *, whole: bool) -> NDArray[np.float64]:
        """Return the rest of the line, or what `simulate_ahead_time` covers."""
        del now
        left = self.distance - self._line.inverse().apply(pose).x
        reach = abs(left) if whole else min(abs(left), self.params.speed_linear * self.params.simulate_ahead_time)
        return straight(self.context.local_costmap, math.copysign(reach, left))

    def summary(self) -> str:
        """Return the distance driven."""
        return f"{self.name}: drove {self._driven:.3f} of {self.distance:.3f} m"

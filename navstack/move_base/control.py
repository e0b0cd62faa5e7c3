"""What the local planner gets in a control cycle, checked: the robot's state, the transform of the plan, speed limits.

ROS differs: C++ uses every odometry message as it is, and the newest transform of the plan, however old it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from navstack.core import Pose2D, RobotState, Transform2D, angle_between
from navstack.move_base.costmaps import transform_tolerance
from navstack.move_base.errors import OdometryError, StaleOdometryError
from navstack.move_base.plugin_calls import (
    call,
    checked_inflation,
    checked_pose,
    checked_speed_limit,
    checked_state,
    lookup_transform,
)
from navstack.plugins import ControlInput, CostmapServer, LocalPlanner, Plan, Robot, VelocityLimits, limits_of

FACTOR: Final = 3.0
"""A robot may be this many times faster than the local planner's limits: pushed, downhill, or driven by another node."""
LINEAR_MARGIN: Final = 1.0
"""m/s above `FACTOR` times the limit."""
ANGULAR_MARGIN: Final = 3.0
"""rad/s above `FACTOR` times the limit."""
FASTEST: Final = 100.0
"""Largest possible velocity (m/s and rad/s) of a planner without limits."""
JUMP_M: Final = 0.5
"""A pose may move by this (m) beyond the distance at the largest velocity."""
JUMP_RAD: Final = 0.5
"""A heading may turn by this (rad) beyond the angle at the largest angular velocity."""
GAP_S: Final = 1.0
"""Poses farther apart in time are not compared: between two goals a robot may be carried, or its odometry restarted."""
SETTLE_S: Final = 1.0
"""The odometry counts as impossible until this time (s) after its last jump, but at most half of controller_patience."""

_IDENTITY: Final = Transform2D()


class ControlInputs:
    """The robot's state and the transform of the plan at the time of a cycle, each computed once."""

    def __init__(
        self, robot: Robot, global_costmap: CostmapServer, local_costmap: CostmapServer, planner: LocalPlanner
    ) -> None:
        self.planner = planner
        """The local planner, whose limits the odometry must fit."""
        self.settle_s = math.inf
        """Longest time (s) for which a jump of the odometry counts."""
        self._robot = robot
        self._global_costmap = global_costmap
        self._local_costmap = local_costmap
        self._odometry = OdometryCheck()
        self._state: RobotState | None = None
        """The robot's state at `_state_at` (s)."""
        self._state_at = -math.inf
        self._transform: Transform2D | None = None
        self._transform_of: tuple[str, str, float] = "", "", -math.inf
        """Frame of the plan, frame of the local costmap and time (s) of `_transform`."""
        self.read_parameters()

    def read_parameters(self) -> None:
        """Read the parameters of the costmaps again."""
        costmap = self._local_costmap
        self._tolerance_s = transform_tolerance(costmap)
        self._plan_tolerance_s = max(self._tolerance_s, transform_tolerance(self._global_costmap))
        """Largest age of the plan's transform (s)."""
        self._tracks_unknown = bool(getattr(getattr(costmap, "params", None), "track_unknown_space", False))

    def refresh(self) -> None:
        """Forget the state and the transform: the robot may have moved within the same instant."""
        self._state = self._transform = None

    def start_goal(self) -> None:
        """Allow a jump of the odometry: between two goals a robot may be carried."""
        self._odometry.reset()

    def state(self, now: float) -> RobotState:
        """Return the robot's pose in the local costmap's frame at `now` (s), and its velocity.

        Raises NavError if the pose is not known at that time, StaleOdometryError if the odometry is older than
        transform_tolerance, OdometryError if it is impossible.
        """
        if self._state is not None and self._state_at == now:
            return self._state
        self._state = None
        costmap, robot = self._local_costmap, self._robot
        pose = call(costmap, costmap.robot_pose, now, check=checked_pose)
        state = call(robot, robot.state, check=checked_state)
        stamp = state.stamp
        # one without a stamp (0) counts as new
        if not (now - stamp <= self._tolerance_s or stamp == 0.0):
            raise _stale_odometry(state, now, self._tolerance_s)
        checked = RobotState(pose, state.velocity, stamp, costmap.frame)
        # commands rest on the pose of the transform if that is the odometry's; a single jump must not end the goal
        odometry = checked if state.frame == costmap.frame else state
        self._odometry.check(odometry, self.planner, now, self.settle_s)
        self._state, self._state_at = checked, now
        return checked

    def plan_transform(self, plan: Plan, now: float) -> Transform2D:
        """Return the transform from the plan's frame to the local costmap's at `now` (s).

        Raises FrameError if it is older than transform_tolerance (the larger one of the two costmaps).
        """
        source, target = plan.path.frame, self._local_costmap.frame
        if source == target:
            return _IDENTITY
        if self._transform is None or self._transform_of != (source, target, now):
            self._transform = lookup_transform(self._robot, target, source, now, self._plan_tolerance_s)
            self._transform_of = source, target, now
        return self._transform

    def at(self, plan: Plan, now: float) -> ControlInput:
        """Return the local planner's input for `plan` at `now` (s). Raises NavError."""
        costmap, state, transform = self._local_costmap, self._state, self._transform
        if state is None or self._state_at != now:
            state = self.state(now)
        if transform is None or self._transform_of != (plan.path.frame, costmap.frame, now):
            transform = self.plan_transform(plan, now)
        inflation = None
        for layer in costmap.layers:
            inflation = call(layer, getattr, layer, "inflation", check=checked_inflation)
            if inflation is not None:
                break
        return ControlInput(state, costmap.master, costmap.footprint, transform, inflation, self._tracks_unknown)


class OdometryCheck:
    """Compares each odometry with the limits of the local planner and with the previous pose."""

    def __init__(self) -> None:
        self._planner: LocalPlanner | None = None
        self._linear = self._angular = 0.0
        """Largest possible velocities (m/s, rad/s)."""
        self._last: Pose2D | None = None
        self._last_at = -math.inf
        self._frame = ""
        self._jump: OdometryError | None = None
        self._jump_at = -math.inf

    def reset(self) -> None:
        """Reset the previous pose and its jumps: a new goal begins."""
        self._last = self._jump = None

    def check(self, state: RobotState, planner: LocalPlanner, now: float, settle_s: float = math.inf) -> None:
        """Check the odometry of `now` (s): pose in the odometry frame, velocity.

        Raises OdometryError, after a jump for `SETTLE_S`, at most `settle_s` (s).
        """
        velocity = state.velocity
        if planner is not self._planner:
            self._planner, self._linear, self._angular = planner, LINEAR_MARGIN, ANGULAR_MARGIN
        vx, vy, wz = velocity
        speed, turn = math.hypot(vx, vy), abs(wz)
        if speed > self._linear or turn > self._angular:
            self._read_limits(planner)
        pose, last, elapsed = state.pose, self._last, now - self._last_at
        is_same = state.frame == self._frame
        self._last, self._last_at, self._frame = pose, now, state.frame
        if last is not None and is_same and elapsed <= GAP_S:
            x, y, yaw = last
            if not (abs(pose[0] - x) + abs(pose[1] - y) <= JUMP_M and abs(pose[2] - yaw) <= JUMP_RAD):
                self._compare(state, last, elapsed, now)
        if not (speed <= self._linear and turn <= self._angular):
            raise OdometryError(
                f"the odometry reports {speed:.3g} m/s and {turn:.3g} rad/s, far beyond the limits of the local planner "
                f"(possible: {self._linear:.3g} m/s, {self._angular:.3g} rad/s); check the units and the source of the odometry",
                velocity=list(velocity),
                possible=[self._linear, self._angular],
            )
        if self._jump is not None:
            if now == self._jump_at or now - self._jump_at < min(SETTLE_S, settle_s):
                raise self._jump
            self._jump = None

    def _read_limits(self, planner: LocalPlanner) -> None:
        """Raise the largest possible velocities to those of the planner; limits lowered for a while do not lower them."""
        limits = limits_of(planner)
        x = max(abs(limits.max_vel_x), abs(limits.min_vel_x))
        y = max(abs(limits.max_vel_y), abs(limits.min_vel_y))
        linear = max(math.hypot(x, y), abs(limits.max_vel_trans))
        angular = max(abs(limits.max_vel_theta), abs(limits.min_vel_theta))
        self._linear = max(self._linear, _possible(linear, LINEAR_MARGIN))
        self._angular = max(self._angular, _possible(angular, ANGULAR_MARGIN))

    def _compare(self, state: RobotState, last: Pose2D, elapsed: float, now: float) -> None:
        """Compare the pose with the previous one, `elapsed` (s) ago."""
        pose, (_, _, yaw) = state.pose, last
        moved, turned = last.distance_to(pose), abs(angle_between(yaw, pose.yaw))
        if moved <= JUMP_M and turned <= JUMP_RAD:
            return
        if self._planner is not None:
            self._read_limits(self._planner)
        if not (moved <= JUMP_M + self._linear * elapsed and turned <= JUMP_RAD + self._angular * elapsed):
            self._jump_at = now
            self._jump = OdometryError(
                f'the pose of the odometry in "{state.frame}" jumped by {moved:.3g} m and {turned:.3g} rad in {elapsed:.3f} s, '
                f"from ({last.x:.3g}, {last.y:.3g}) to ({pose.x:.3g}, {pose.y:.3g}); check the source of the odometry",
                before=list(last),
                after=list(pose),
                elapsed_s=elapsed,
            )


def _stale_odometry(state: RobotState, now: float, tolerance_s: float) -> StaleOdometryError:
    age = now - state.stamp
    return StaleOdometryError(
        f'the odometry in "{state.frame}" is {age:.3g} s old (stamp {state.stamp:.3f} s), more than transform_tolerance = '
        f"{tolerance_s:g} s; check that its source still publishes, and that its clock is this one",
        age_s=age,
        stamp=state.stamp,
        transform_tolerance=tolerance_s,
    )


def _possible(limit: float, margin: float) -> float:
    # `min` also replaces infinity; a limit that is NaN becomes FASTEST
    return min(FASTEST, FACTOR * limit + margin) if limit == limit else FASTEST


def full_speed(limits: VelocityLimits) -> float:
    """Return the highest speed that the limits of a local planner allow (m/s)."""
    return min(limits.max_vel_trans, math.hypot(limits.max_vel_x, limits.max_vel_y))


class SpeedLimiter:
    """Applies the lowest speed limit of the costmaps. Costmaps without limits are not asked.

    As Nav2's SpeedFilter: percentages refer to the local planner's full speed, and a limit of 0 is ignored.
    """

    def __init__(self, costmaps: Sequence[CostmapServer], planner: LocalPlanner) -> None:
        self.limit: float | None = None
        """The current limit (m/s); None without a limit."""
        self.external: float | None = None
        """A limit (m/s) from outside, as Nav2's topic speed_limit sets it; None without one."""
        self._planner = planner
        self._costmaps = [costmap for costmap in costmaps if costmap.limits_speed]
        self._full_speed = full_speed(limits_of(planner)) if self._costmaps else -1.0
        """Of the planner without a limit (m/s); negative before it is needed."""

    @property
    def is_needed(self) -> bool:
        """True if a costmap may limit the speed, or something else does or did."""
        return bool(self._costmaps) or self.external is not None or self.limit is not None

    def apply(self, now: float, *, slowed: bool) -> bool:
        """Apply the limit at the robot's position at `now` (s); return True if it has changed.

        `slowed`: a recovery behavior may have set limits; a lower limit of it is kept. Raises NavError.
        """
        limit = self._lowest(now)
        present = limits_of(self._planner)
        if limit == self.limit and (limit is None or present.max_vel_trans <= limit):
            return False
        if slowed and (limit is None or present.max_vel_trans <= limit):
            return False  # applied once the recovery behavior has restored the limits
        # a recovery behavior may also have lowered the rotational speed: keep it
        self._set_limits(limit, present.max_vel_theta if slowed else None)
        changed = limit != self.limit
        self.limit = limit
        return changed

    def _set_limits(self, max_vel_trans: float | None, max_vel_theta: float | None) -> None:
        planner = self._planner
        call(planner, lambda: planner.set_limits(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta))

    def _lowest(self, now: float) -> float | None:
        if self._full_speed < 0.0:  # no limit has been set yet
            self._full_speed = full_speed(limits_of(self._planner))
        lowest = math.inf if self.external is None else self.external
        for costmap in self._costmaps:
            pose = call(costmap, costmap.robot_pose, now, check=checked_pose)
            limit = call(costmap, costmap.speed_limit, pose.x, pose.y, self._full_speed, check=checked_speed_limit)
            if limit is not None:
                lowest = min(lowest, limit)
        return lowest if lowest < self._full_speed else None

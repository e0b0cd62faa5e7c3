"""Goal checkers: whether the robot is at its goal.

`LatchingGoalChecker` is that of DWA and trajectory rollout (base_local_planner's goal_functions, with DWA's latch). The
others are plugins for path followers, as in nav2_controller.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from navstack.core import Twist2D, angle_between
from navstack.plugins import GOAL_CHECKERS, Approach, GoalChecker, ParamModel, PluginSection, param


class LatchingGoalChecker(GoalChecker):
    """Compares position, heading and speed with tolerances.

    Stateful with `latch`: once the position was reached, it counts as reached until `reset`.
    """

    def __init__(
        self, xy_tolerance: float, yaw_tolerance: float, trans_stopped: float, theta_stopped: float, *, latch: bool
    ) -> None:
        """Tolerances in m and rad, stopped speeds in m/s and rad/s."""
        self._xy_tolerance = xy_tolerance
        self._yaw_tolerance = yaw_tolerance
        self.trans_stopped = trans_stopped
        self.theta_stopped = theta_stopped
        self._latch = latch
        self._latched = False

    def reset(self) -> None:
        """Release the latch."""
        self._latched = False

    @property
    def xy_tolerance(self) -> float:
        """M."""
        return self._xy_tolerance

    @property
    def yaw_tolerance(self) -> float:
        """Rad."""
        return self._yaw_tolerance

    def at_position(self, approach: Approach) -> bool:
        """Within the position tolerance, or latched there."""
        if self._latched:
            return True
        reached = approach.pose.distance_to(approach.goal) <= self._xy_tolerance
        self._latched = self._latch and reached
        return reached

    def at_heading(self, approach: Approach) -> bool:
        """Within the heading tolerance."""
        return abs(angle_between(approach.pose.yaw, approach.goal.yaw)) <= self._yaw_tolerance

    def stopped(self, velocity: Twist2D) -> bool:
        """At most the stopped speed on each axis."""
        return (
            abs(velocity.wz) <= self.theta_stopped
            and abs(velocity.vx) <= self.trans_stopped
            and abs(velocity.vy) <= self.trans_stopped
        )


class PositionGoalCheckerParams(PluginSection):
    """Tolerance of the position, and its latch."""

    plugin: str = param("nav2_controller::PositionGoalChecker", "type of the goal checker")
    xy_goal_tolerance: float = param(0.25, "distance at which the goal's position is reached", unit="m", ge=0.0)
    xy_goal_tolerance_buffer: float = param(
        0.0, "a latched position is released beyond xy_goal_tolerance plus this distance; 0 = never", unit="m", ge=0.0
    )
    path_length_tolerance: float = param(
        1.0,
        "the goal is not reached while more of the path is left: a path that loops past its goal is followed to its end",
        unit="m",
        ge=0.0,
        ros_differs="the whole path that is left counts; in Nav2 only that in the local costmap and within prune_distance",
    )
    stateful: bool = param(
        True,
        "once reached, the position counts as reached",
        ros_differs="a new plan to the same goal does not release it",
    )


@GOAL_CHECKERS.register("position", aliases=("nav2_controller/PositionGoalChecker",))
class PositionGoalChecker(GoalChecker):
    """The robot's position, at any heading and speed."""

    Params: ClassVar[type[ParamModel]] = PositionGoalCheckerParams

    def __init__(self, params: PositionGoalCheckerParams) -> None:
        self.params: Any = params
        self._latched = False

    def reset(self) -> None:
        """Release the latch."""
        self._latched = False

    @property
    def xy_tolerance(self) -> float:
        """`xy_goal_tolerance`."""
        return self.params.xy_goal_tolerance

    @property
    def yaw_tolerance(self) -> float:
        """Every heading."""
        return math.pi

    def at_position(self, approach: Approach) -> bool:
        """Within the tolerance or latched, and the path followed to its end."""
        p = self.params
        if approach.remaining_m > p.path_length_tolerance:
            return False
        squared = _squared_distance(approach)
        if self._latched:
            buffer = p.xy_goal_tolerance_buffer
            if buffer <= 0.0 or squared <= (p.xy_goal_tolerance + buffer) ** 2:
                return True
            self._latched = False
        reached = squared <= p.xy_goal_tolerance**2
        self._latched = p.stateful and reached
        return reached

    def at_heading(self, approach: Approach) -> bool:
        """Always."""
        del approach
        return True


class SimpleGoalCheckerParams(PositionGoalCheckerParams):
    """Tolerances of position and heading."""

    plugin: str = param("nav2_controller::SimpleGoalChecker", "type of the goal checker")
    yaw_goal_tolerance: float = param(0.25, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    symmetric_yaw_tolerance: bool = param(False, "the opposite of the goal's heading counts, too")


@GOAL_CHECKERS.register("simple", aliases=("nav2_controller/SimpleGoalChecker",))
class SimpleGoalChecker(PositionGoalChecker):
    """Position, then heading; the position is latched."""

    Params: ClassVar[type[ParamModel]] = SimpleGoalCheckerParams

    @property
    def yaw_tolerance(self) -> float:
        """`yaw_goal_tolerance`."""
        return self.params.yaw_goal_tolerance

    def at_heading(self, approach: Approach) -> bool:
        """Within the tolerance of the goal's heading."""
        return at_heading(approach, self.params.yaw_goal_tolerance, symmetric=self.params.symmetric_yaw_tolerance)


def _squared_distance(approach: Approach) -> float:
    """Squared distance (m^2) to the goal, which Nav2 compares: at a tolerance the root may round to the other side."""
    dx, dy = approach.pose.x - approach.goal.x, approach.pose.y - approach.goal.y
    return dx * dx + dy * dy


def at_heading(approach: Approach, tolerance: float, *, symmetric: bool) -> bool:
    """True within `tolerance` (rad) of the goal's heading, with `symmetric` also of its opposite."""
    error = abs(angle_between(approach.pose.yaw, approach.goal.yaw))
    return min(error, math.pi - error) <= tolerance if symmetric else error <= tolerance


class AdaptiveToleranceGoalCheckerParams(PluginSection):
    """Two tolerances of the position, and when the coarse one is enough."""

    plugin: str = param("nav2_controller::AdaptiveToleranceGoalChecker", "type of the goal checker")
    fine_xy_goal_tolerance: float = param(0.10, "distance at which the goal's position is reached", unit="m", ge=0.0)
    coarse_xy_goal_tolerance: float = param(
        0.25, "distance that is enough for a robot that passes its goal or comes no nearer", unit="m", ge=0.0
    )
    yaw_goal_tolerance: float = param(0.25, "angle at which the goal's heading is reached", unit="rad", ge=0.0)
    symmetric_yaw_tolerance: bool = param(False, "the opposite of the goal's heading counts, too")
    path_length_tolerance: float = param(
        1.0,
        "the goal is not reached while more of the path is left",
        unit="m",
        ge=0.0,
        ros_differs="the whole path that is left counts",
    )
    trans_stopped_velocity: float = param(0.10, "speed up to which the robot counts as stopped", unit="m/s", ge=0.0)
    rot_stopped_velocity: float = param(
        0.10, "turning speed up to which the robot counts as stopped", unit="rad/s", ge=0.0
    )
    required_stagnation_cycles: int = param(
        15, "cycles without coming nearer, or stopped, after which the coarse tolerance is enough", ge=1
    )
    xy_goal_tolerance_buffer: float = param(
        0.0,
        "a latched position is released beyond the tolerance that it was within plus this distance; 0 = never",
        unit="m",
        ge=0.0,
    )
    stateful: bool = param(True, "once reached, the position counts as reached")


@GOAL_CHECKERS.register("adaptive", aliases=("nav2_controller/AdaptiveToleranceGoalChecker",))
class AdaptiveToleranceGoalChecker(GoalChecker):
    """Accepts the coarse tolerance from a robot that crosses the line through its goal, stops, or comes no nearer."""

    Params: ClassVar[type[ParamModel]] = AdaptiveToleranceGoalCheckerParams

    def __init__(self, params: AdaptiveToleranceGoalCheckerParams) -> None:
        self.params = params
        self.reset()

    def reset(self) -> None:
        """Release the latch; start counting again."""
        self._latched = False
        self._reset_distance = 0.0
        self._leave()

    def _leave(self) -> None:
        """The robot is outside the coarse tolerance."""
        self._entry: tuple[float, float] | None = None
        self._nearest = 0.0
        self._stopped = self._stagnant = 0

    @property
    def xy_tolerance(self) -> float:
        """The coarse tolerance."""
        return self.params.coarse_xy_goal_tolerance

    @property
    def yaw_tolerance(self) -> float:
        """`yaw_goal_tolerance`."""
        return self.params.yaw_goal_tolerance

    def at_position(self, approach: Approach) -> bool:
        """Within the fine tolerance, or within the coarse one and no longer approaching. Call it once per cycle."""
        p = self.params
        if approach.remaining_m > p.path_length_tolerance:
            return False
        squared = _squared_distance(approach)
        if self._latched:
            if p.xy_goal_tolerance_buffer <= 0.0 or squared <= self._reset_distance**2:
                return True
            self.reset()
            return False
        fine = squared <= p.fine_xy_goal_tolerance**2
        reached = fine or self._coarse(approach, squared)
        self._latched = p.stateful and reached
        within = p.fine_xy_goal_tolerance if fine else p.coarse_xy_goal_tolerance
        self._reset_distance = within + p.xy_goal_tolerance_buffer
        return reached

    def _coarse(self, approach: Approach, squared: float) -> bool:
        p = self.params
        if squared > p.coarse_xy_goal_tolerance**2:
            self._leave()
            return False
        dx, dy = approach.goal.x - approach.pose.x, approach.goal.y - approach.pose.y
        if self._entry is None:
            self._entry, self._nearest = (dx, dy), squared
            return False
        velocity = approach.velocity
        still = velocity.speed <= p.trans_stopped_velocity and abs(velocity.wz) <= p.rot_stopped_velocity
        self._stopped = self._stopped + 1 if still else 0
        self._stagnant = self._stagnant + 1 if squared >= self._nearest else 0
        self._nearest = min(self._nearest, squared)
        passed = self._entry[0] * dx + self._entry[1] * dy <= 0.0
        return passed or max(self._stopped, self._stagnant) >= p.required_stagnation_cycles

    def at_heading(self, approach: Approach) -> bool:
        """Within the tolerance of the goal's heading."""
        return at_heading(approach, self.params.yaw_goal_tolerance, symmetric=self.params.symmetric_yaw_tolerance)


AT_GOAL_M = 1e-6
"""Nearer than this the robot is at the goal for any direction of the path."""


class AxisGoalCheckerParams(PluginSection):
    """Tolerances along and across the end of the path."""

    plugin: str = param("nav2_controller::AxisGoalChecker", "type of the goal checker")
    along_path_tolerance: float = param(0.25, "distance to the goal along the end of the path", unit="m", ge=0.0)
    cross_track_tolerance: float = param(0.25, "distance to the goal across the end of the path", unit="m", ge=0.0)
    direction_estimation_distance: float = param(
        0.15, "the path's direction is that from its last pose at least so far before the goal", unit="m", ge=0.0
    )
    path_length_tolerance: float = param(
        1.0,
        "the goal is not reached while more of the path is left",
        unit="m",
        ge=0.0,
        ros_differs="the whole path that is left counts",
    )
    is_overshoot_valid: bool = param(False, "any distance beyond the goal is within the tolerance along the path")


@GOAL_CHECKERS.register("axis", aliases=("nav2_controller/AxisGoalChecker",))
class AxisGoalChecker(GoalChecker):
    """Position in the axes of the path's end, at any heading and speed."""

    Params: ClassVar[type[ParamModel]] = AxisGoalCheckerParams

    def __init__(self, params: AxisGoalCheckerParams) -> None:
        self.params = params

    @property
    def xy_tolerance(self) -> float:
        """The smaller of the two tolerances."""
        return min(self.params.along_path_tolerance, self.params.cross_track_tolerance)

    @property
    def yaw_tolerance(self) -> float:
        """Every heading."""
        return math.pi

    def at_position(self, approach: Approach) -> bool:
        """Within both tolerances, and the path followed to its end."""
        p = self.params
        if approach.remaining_m > p.path_length_tolerance:
            return False
        goal, pose = approach.goal, approach.pose
        distance = pose.distance_to(goal)
        if distance < AT_GOAL_M:
            return True
        before = approach.path[:-1, :2]
        far = np.flatnonzero(
            np.hypot(before[:, 0] - goal.x, before[:, 1] - goal.y) >= max(p.direction_estimation_distance, AT_GOAL_M)
        )
        if not len(far):  # the path has no direction
            return distance < self.xy_tolerance
        ex, ey = goal.x - float(before[far[-1], 0]), goal.y - float(before[far[-1], 1])
        length = math.hypot(ex, ey)
        dx, dy = goal.x - pose.x, goal.y - pose.y
        along, cross = (ex * dx + ey * dy) / length, (ex * dy - ey * dx) / length
        within = along < p.along_path_tolerance if p.is_overshoot_valid else abs(along) < p.along_path_tolerance
        return within and abs(cross) < p.cross_track_tolerance

    def at_heading(self, approach: Approach) -> bool:
        """Always."""
        del approach
        return True


class StoppedGoalCheckerParams(SimpleGoalCheckerParams):
    """Tolerances of position, heading and speed."""

    plugin: str = param("nav2_controller::StoppedGoalChecker", "type of the goal checker")
    rot_stopped_velocity: float = param(
        0.25, "turning speed up to which the robot counts as stopped", unit="rad/s", ge=0.0
    )
    trans_stopped_velocity: float = param(0.25, "speed up to which the robot counts as stopped", unit="m/s", ge=0.0)


@GOAL_CHECKERS.register("stopped", aliases=("nav2_controller/StoppedGoalChecker",))
class StoppedGoalChecker(SimpleGoalChecker):
    """As the simple one, with the robot stopped."""

    Params: ClassVar[type[ParamModel]] = StoppedGoalCheckerParams

    def stopped(self, velocity: Twist2D) -> bool:
        """At most both stopped speeds."""
        return abs(velocity.wz) <= self.params.rot_stopped_velocity and velocity.speed <= (
            self.params.trans_stopped_velocity
        )

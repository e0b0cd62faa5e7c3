"""nav2_controller::AdaptiveToleranceGoalChecker: a fine tolerance, and a coarse one for robots that come no nearer."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Approach, GoalChecker, PluginSection
from navstack.local_planner.goal_checkers.simple import at_heading
from navstack.plugins import GOAL_CHECKERS


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
        "a latched position is released beyond coarse_xy_goal_tolerance plus this distance; 0 = never",
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
        distance = approach.pose.distance_to(approach.goal)
        if self._latched:
            buffer = p.xy_goal_tolerance_buffer
            if buffer <= 0.0 or distance <= p.coarse_xy_goal_tolerance + buffer:
                return True
            self.reset()
        reached = distance <= p.fine_xy_goal_tolerance or self._coarse(approach, distance)
        self._latched = p.stateful and reached
        return reached

    def _coarse(self, approach: Approach, distance: float) -> bool:
        p = self.params
        if distance > p.coarse_xy_goal_tolerance:
            self._leave()
            return False
        dx, dy = approach.goal.x - approach.pose.x, approach.goal.y - approach.pose.y
        if self._entry is None:
            self._entry, self._nearest = (dx, dy), distance
            return False
        velocity = approach.velocity
        still = velocity.speed <= p.trans_stopped_velocity and abs(velocity.wz) <= p.rot_stopped_velocity
        self._stopped = self._stopped + 1 if still else 0
        self._stagnant = self._stagnant + 1 if distance >= self._nearest else 0
        self._nearest = min(self._nearest, distance)
        passed = self._entry[0] * dx + self._entry[1] * dy <= 0.0
        return passed or max(self._stopped, self._stagnant) >= p.required_stagnation_cycles

    def at_heading(self, approach: Approach) -> bool:
        """Within the tolerance of the goal's heading."""
        return at_heading(approach, self.params.yaw_goal_tolerance, symmetric=self.params.symmetric_yaw_tolerance)

"""The goal checker of DWA and trajectory rollout (base_local_planner's goal_functions, with DWA's latch)."""

from __future__ import annotations

from navstack.core import Twist2D, angle_between
from navstack.interfaces import Approach, GoalChecker


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

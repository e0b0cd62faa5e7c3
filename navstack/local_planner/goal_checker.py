"""The goal checker of DWA and trajectory rollout (base_local_planner's goal_functions, with DWA's latch)."""

from __future__ import annotations

from navstack.core import Pose2D, Twist2D, angle_between
from navstack.interfaces import GoalChecker


class SimpleGoalChecker(GoalChecker):
    """Compares position, heading and speed with tolerances.

    Stateful with `latch`: once the position was reached, it counts as reached until `reset`.
    """

    def __init__(
        self, xy_tolerance: float, yaw_tolerance: float, trans_stopped: float, theta_stopped: float, *, latch: bool
    ) -> None:
        """Tolerances in m and rad, stopped speeds in m/s and rad/s."""
        self.xy_tolerance = xy_tolerance
        self.yaw_tolerance = yaw_tolerance
        self.trans_stopped = trans_stopped
        self.theta_stopped = theta_stopped
        self._latch = latch
        self._latched = False

    def reset(self) -> None:
        """Release the latch."""
        self._latched = False

    def at_position(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Within the position tolerance, or latched there."""
        if self._latched:
            return True
        reached = pose.distance_to(goal) <= self.xy_tolerance
        self._latched = self._latch and reached
        return reached

    def at_heading(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Within the heading tolerance."""
        return abs(angle_between(pose.yaw, goal.yaw)) <= self.yaw_tolerance

    def stopped(self, velocity: Twist2D) -> bool:
        """At most the stopped speed on each axis."""
        return (
            abs(velocity.wz) <= self.theta_stopped
            and abs(velocity.vx) <= self.trans_stopped
            and abs(velocity.vy) <= self.trans_stopped
        )

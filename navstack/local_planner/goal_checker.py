"""When the robot stands at its goal: base_local_planner's goal_functions, with DWA's latch."""

from __future__ import annotations

from dataclasses import dataclass

from navstack.core import Pose2D, Twist2D, angle_between


@dataclass(frozen=True, slots=True)
class GoalChecker:
    """Tolerances in m and rad, stopped speeds in m/s and rad/s."""

    xy_tolerance: float
    yaw_tolerance: float
    trans_stopped: float
    theta_stopped: float

    def at_position(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Within the position tolerance."""
        return pose.distance_to(goal) <= self.xy_tolerance

    def yaw_error(self, pose: Pose2D, goal: Pose2D) -> float:
        """The turn (rad) that is left."""
        return angle_between(pose.yaw, goal.yaw)

    def at_heading(self, pose: Pose2D, goal: Pose2D) -> bool:
        """Within the heading tolerance."""
        return abs(self.yaw_error(pose, goal)) <= self.yaw_tolerance

    def stopped(self, velocity: Twist2D) -> bool:
        """Slow enough on every axis by itself."""
        return (
            abs(velocity.wz) <= self.theta_stopped
            and abs(velocity.vx) <= self.trans_stopped
            and abs(velocity.vy) <= self.trans_stopped
        )

"""A local planner: pure pursuit (Coulter, CMU-RI-TR-92-01), with a collision check."""

from __future__ import annotations

import numpy as np

from navstack.plugin import LETHAL, ControlInput, LocalPlan, LocalPlanner, NoValidControlError, ParamModel, Path, Pose2D
from navstack.plugin import Twist2D, VelocityLimits, footprint_cost, param


class PursuitParams(ParamModel):
    """Namespace `pursuit`."""

    lookahead: float = param(0.5, "distance along the path to the point that is pursued", unit="m", gt=0.0)
    speed: float = param(0.3, "forward speed", unit="m/s", gt=0.0)
    turning_speed: float = param(1.0, "highest turning speed", unit="rad/s", gt=0.0)
    tolerance: float = param(0.15, "distance at which the goal is reached", unit="m", gt=0.0)


class PursuitController(LocalPlanner):
    """Follows the arc to a point of the path; turns in place if the point is behind. Ignores the goal's heading."""

    Params = PursuitParams

    def __init__(self, params: PursuitParams) -> None:
        super().__init__(params)
        self.set_limits()

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Temporary speed limits; None restores the parameters."""
        self.speed = self.params.speed if max_vel_trans is None else min(self.params.speed, max_vel_trans)
        self.turn = self.params.turning_speed if max_vel_theta is None else min(self.params.turning_speed, max_vel_theta)

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        v, w = self.speed, self.turn
        return VelocityLimits(v, 0.0, 0.0, 0.0, v, 0.0, w, 0.0, 2.0, 0.0, 3.0, yaw_goal_tolerance=np.pi)

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow this plan."""
        self.plan, self.goal = plan.poses, goal

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """The command; raises NoValidControlError if the footprint would collide 0.5 s ahead."""
        x, y, yaw = inputs.state.pose
        points = inputs.plan_to_costmap.apply_points(self.plan[:, :2]) - (x, y)
        distance = np.hypot(points[:, 0], points[:, 1])
        ahead = np.flatnonzero(distance[distance.argmin() :] >= self.params.lookahead)
        dx, dy = points[distance.argmin() + ahead[0]] if len(ahead) else points[-1]
        forward, left = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
        curvature = 2.0 * left / max(dx * dx + dy * dy, 1e-6)
        speed = min(self.speed, self.turn / max(abs(curvature), 1e-6)) if forward > 0.0 else 0.0
        command = Twist2D(speed, 0.0, speed * curvature if speed else np.copysign(self.turn, left))
        then = Pose2D(x + 0.5 * speed * np.cos(yaw), y + 0.5 * speed * np.sin(yaw), yaw + 0.5 * command.wz)
        cost = footprint_cost(inputs.costmap, inputs.footprint, then)
        if cost is None or cost >= LETHAL:
            raise NoValidControlError(f"the pursued arc collides 0.5 s ahead at ({then.x:.2f}, {then.y:.2f})")
        return LocalPlan(command)

    def goal_reached(self, inputs: ControlInput) -> bool:
        """True within `tolerance` of the goal."""
        return inputs.state.pose.distance_to(inputs.plan_to_costmap.apply(self.goal)) <= self.params.tolerance

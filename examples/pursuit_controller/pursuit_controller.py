"""A local planner: pure pursuit (Coulter, CMU-RI-TR-92-01), with a collision check."""

import numpy as np

import navstack.plugins as nav


class PursuitParams(nav.ParamModel):
    """Namespace `pursuit`."""

    lookahead: float = nav.param(0.5, "distance to the pursued point of the path", unit="m", gt=0.0)
    speed: float = nav.param(0.3, "forward speed", unit="m/s", gt=0.0)
    turning_speed: float = nav.param(1.0, "highest turning speed", unit="rad/s", gt=0.0)
    tolerance: float = nav.param(0.15, "distance at which the goal is reached", unit="m", gt=0.0)


class PursuitController(nav.LocalPlanner):
    """Follows the arc to a point of the path; turns in place if the point is behind. Ignores the goal's heading."""

    Params = PursuitParams
    plan, goal, lowered = np.empty((0, 3)), nav.Pose2D(np.inf, np.inf), (np.inf, np.inf)

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Temporary speed limits; None restores the parameters."""
        self.lowered = tuple(np.inf if limit is None else limit for limit in (max_vel_trans, max_vel_theta))

    @property
    def limits(self) -> nav.VelocityLimits:
        """The limits in force."""
        v, w = np.minimum((self.params.speed, self.params.turning_speed), self.lowered).tolist()
        return nav.VelocityLimits(v, 0.0, 0.0, 0.0, v, 0.0, w, 0.0, 2.0, 0.0, 3.0, yaw_goal_tolerance=np.pi)

    def set_plan(self, plan: nav.Path, goal: nav.Pose2D) -> None:
        """Follow this plan."""
        if not (len(plan) and np.isfinite([*plan.poses, goal]).all()):
            raise nav.InvalidPathError("the plan is empty or not finite")
        self.plan, self.goal = plan.poses, goal

    def compute_command(self, inputs: nav.ControlInput) -> nav.LocalPlan:
        """The command; raises NoValidControlError if the footprint would collide 0.5 s ahead."""
        (x, y, yaw), limits = inputs.state.pose, self.limits
        if not (len(self.plan) and np.isfinite([x, y, yaw, *inputs.state.velocity]).all()):
            raise nav.InvalidPathError("there is no plan, or the state is not finite")
        points = inputs.plan_to_costmap.apply_points(self.plan[:, :2]) - (x, y)
        rest = points[np.hypot(*points.T).argmin() :]
        dx, dy = rest[np.append((np.hypot(*rest.T) >= self.params.lookahead)[:-1], True).argmax()]
        forward, left = dx * np.cos(yaw) + dy * np.sin(yaw), dy * np.cos(yaw) - dx * np.sin(yaw)
        curvature = 2.0 * left / max(dx * dx + dy * dy, 1e-6)
        speed = min(limits.max_vel_x, limits.max_vel_theta / max(abs(curvature), 1e-6)) * (forward > 0.0)
        wz = speed * curvature if forward > 0.0 else np.copysign(limits.max_vel_theta, left)
        then = nav.Pose2D(x + 0.5 * speed * np.cos(yaw), y + 0.5 * speed * np.sin(yaw), yaw + 0.5 * wz)
        cost = nav.footprint_cost(inputs.costmap, inputs.footprint, then)
        if cost is None or cost >= nav.LETHAL:
            raise nav.NoValidControlError(f"the arc collides 0.5 s ahead at ({then.x:.2f}, {then.y:.2f})")
        return nav.LocalPlan(nav.Twist2D(float(speed), 0.0, float(wz)))

    def goal_reached(self, inputs: nav.ControlInput) -> bool:
        """True within `tolerance` of the goal."""
        pose, goal = inputs.state.pose, inputs.plan_to_costmap.apply(self.goal)
        return pose.distance_to(goal) <= self.params.tolerance

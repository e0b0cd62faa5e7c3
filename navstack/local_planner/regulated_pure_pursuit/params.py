"""Parameters of nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import ClassVar

from navstack.core.parameter_checks import CheckContext, Issue
from navstack.core.parameters import param
from navstack.local_planner.path_follower import PathFollowerParams


class RegulatedPurePursuitParams(PathFollowerParams):
    """Parameters of nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController."""

    RENAMED: ClassVar[Mapping[str, str]] = {"desired_linear_vel": "max_linear_vel"}
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **PathFollowerParams.NO_EFFECT,
        "stateful": "the goal checker latches the position; set goal_checker/stateful",
        "use_interpolation": "the carrot is always interpolated",
    }

    max_linear_vel: float = param(0.5, "highest speed", unit="m/s", gt=0.0)
    lookahead_dist: float = param(0.6, "distance of the carrot along the path", unit="m", gt=0.0)
    use_velocity_scaled_lookahead_dist: bool = param(False, "distance of the carrot: speed times lookahead_time")
    lookahead_time: float = param(1.5, "time to the carrot at the measured speed", unit="s", gt=0.0)
    min_lookahead_dist: float = param(0.3, "lowest distance of a carrot scaled by speed", unit="m", gt=0.0)
    max_lookahead_dist: float = param(0.9, "highest distance of a carrot scaled by speed", unit="m", gt=0.0)
    use_fixed_curvature_lookahead: bool = param(False, "steer to a second carrot at curvature_lookahead_dist")
    curvature_lookahead_dist: float = param(0.6, "distance of the second carrot along the path", unit="m", gt=0.0)
    interpolate_curvature_after_goal: bool = param(
        False, "the second carrot may lie beyond the goal; needs use_fixed_curvature_lookahead"
    )
    use_regulated_linear_velocity_scaling: bool = param(True, "drive slower in curves")
    regulated_linear_scaling_min_radius: float = param(
        0.90, "radius of curves below which the speed falls in proportion", unit="m", gt=0.0
    )
    regulated_linear_scaling_min_speed: float = param(
        0.25, "lowest speed in curves and near obstacles", unit="m/s", ge=0.0
    )
    use_cost_regulated_linear_velocity_scaling: bool = param(True, "drive slower near obstacles")
    cost_scaling_dist: float = param(
        0.6, "distance to obstacles below which the speed falls in proportion", unit="m", gt=0.0
    )
    cost_scaling_gain: float = param(1.0, "factor on the speed near obstacles", gt=0.0, le=1.0)
    inflation_cost_scaling_factor: float = param(
        3.0,
        "cost_scaling_factor of the inflation layer, to get distances from costs; 0 or less: the speed is not regulated by cost",
        unit="1/m",
        ros_differs="that of the inflation layer is used if there is one",
    )
    approach_velocity_scaling_dist: float = param(
        0.6, "length of the rest of the path below which the robot slows down", unit="m", gt=0.0
    )
    min_approach_linear_velocity: float = param(0.05, "lowest speed near the goal", unit="m/s", ge=0.0)
    use_rotate_to_heading: bool = param(True, "turn in place if the path is far off the heading, and at the goal")
    rotate_to_heading_min_angle: float = param(
        0.785, "angle to the carrot above which the robot turns in place", unit="rad", ge=0.0
    )
    rotate_to_heading_angular_vel: float = param(1.8, "turning speed in place", unit="rad/s", gt=0.0)
    max_angular_accel: float = param(3.2, "turning acceleration in place", unit="rad/s²", gt=0.0)
    allow_reversing: bool = param(False, "drive backward to a carrot behind the robot")
    use_cancel_deceleration: bool = param(
        False,
        "a canceled goal is braked with cancel_deceleration; otherwise it commands zero at once",
        ros_differs="from the last command, not from the measured speed; a turn in place is braked, too",
    )
    cancel_deceleration: float = param(3.2, "deceleration of a canceled goal", unit="m/s²", gt=0.0)
    use_collision_detection: bool = param(True, "check the arc of the command for collisions")
    max_allowed_time_to_collision_up_to_carrot: float = param(
        1.0, "duration of the check, which also ends at the carrot", unit="s", ge=0.0
    )
    min_distance_to_obstacle: float = param(-1.0, "check at least this far, with any speed; 0 or less: off", unit="m")
    allow_obstacle_checking_beyond_goal: bool = param(False, "min_distance_to_obstacle holds beyond the goal, too")
    use_dynamic_window: bool = param(
        False, "keep to the accelerations below: the command closest to the carrot's arc within one period"
    )
    min_linear_vel: float = param(-0.5, "lowest speed; with use_dynamic_window", unit="m/s")
    max_angular_vel: float = param(
        2.5,
        "highest turning speed to the left",
        unit="rad/s",
        gt=0.0,
        ros_differs="always in force; in Nav2 only with use_dynamic_window",
    )
    min_angular_vel: float = param(
        -2.5,
        "highest turning speed to the right, negative",
        unit="rad/s",
        lt=0.0,
        ros_differs="always in force; in Nav2 only with use_dynamic_window",
    )
    max_linear_accel: float = param(2.5, "acceleration; with use_dynamic_window", unit="m/s²", gt=0.0)
    max_angular_decel: float = param(
        -3.2,
        "angular deceleration, negative; with use_dynamic_window, and for a turn in place when its goal is canceled",
        unit="rad/s²",
        lt=0.0,
    )
    max_linear_decel: float = param(-2.5, "deceleration, negative; with use_dynamic_window", unit="m/s²", lt=0.0)
    min_turning_r: float = param(
        0.0,
        "turning radius of the base, which a car has; 0: it can turn in place; an addition of navstack",
        unit="m",
        ge=0.0,
    )

    @property
    def turning_radius(self) -> float:
        """Radius (m) of the tightest curve."""
        return 0.0 if self.use_rotate_to_heading else self.min_turning_r

    @property
    def drives_backward(self) -> bool:
        """True if it drives to a carrot behind the robot. ROS differs: in Nav2, `allow_reversing` alone decides."""
        return self.allow_reversing and not self.use_rotate_to_heading and self.lowest_speed < 0.0

    @property
    def lowest_speed(self) -> float:
        """Lowest speed (m/s); negative if backward is within the limits."""
        return max(self.min_linear_vel, -self.max_linear_vel) if self.use_dynamic_window else -self.max_linear_vel

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from driving as the parameters say."""
        yield from super().check(context)
        if self.use_rotate_to_heading and self.allow_reversing:
            message = (
                "use_rotate_to_heading turns the robot to a carrot behind it, so allow_reversing has no effect; "
                "set one of them to false"
            )
            yield Issue("warning", "turn-or-reverse", ("allow_reversing", "use_rotate_to_heading"), message, "false")
        if self.allow_reversing and not self.use_rotate_to_heading and self.lowest_speed >= 0.0:
            message = (
                f"min_linear_vel = {self.min_linear_vel:g} m/s allows no backward speed, so allow_reversing has no effect, and "
                "the robot finds no command to a path behind it; set min_linear_vel to "
                f"{-self.max_linear_vel:g}, or allow_reversing to false"
            )
            names = ("min_linear_vel", "allow_reversing")
            yield Issue("warning", "no-reverse-speed", names, message, f"{-self.max_linear_vel:g}")
        if self.use_rotate_to_heading and self.min_turning_r > 0.0:
            message = (
                f"a base with a turning radius of {self.min_turning_r:g} m cannot turn in place; set use_rotate_to_heading to "
                "false, or min_turning_r to 0"
            )
            yield Issue("error", "turn-in-place", ("use_rotate_to_heading", "min_turning_r"), message, "false")
        if self.interpolate_curvature_after_goal and not self.use_fixed_curvature_lookahead:
            message = (
                "interpolate_curvature_after_goal has no effect without use_fixed_curvature_lookahead; set that to true"
            )
            yield Issue("warning", "no-second-carrot", ("interpolate_curvature_after_goal",), message)
        yield from self._check_speeds()
        yield from self._check_distances(context)

    def _check_speeds(self) -> Iterator[Issue]:
        pairs = (
            ("regulated_linear_scaling_min_speed", "max_linear_vel"),
            ("min_approach_linear_velocity", "max_linear_vel"),
            ("min_linear_vel", "max_linear_vel"),
            ("min_lookahead_dist", "max_lookahead_dist"),
        )
        for low, high in pairs:
            lower, upper = float(getattr(self, low)), float(getattr(self, high))
            if lower > upper:
                message = (
                    f"{low} = {lower:g} is greater than {high} = {upper:g}, which wins; lower {low}, or raise {high}"
                )
                severity = "error" if low == "min_lookahead_dist" else "warning"
                yield Issue(severity, "minimum-over-maximum", (low, high), message, f"{upper:g}")

    def _check_distances(self, context: CheckContext) -> Iterator[Issue]:
        costmap = context.local_costmap
        half = 0.5 * min(costmap.width, costmap.height)
        longest = self.max_lookahead_dist if self.use_velocity_scaled_lookahead_dist else self.lookahead_dist
        longest = max(longest, self.curvature_lookahead_dist if self.use_fixed_curvature_lookahead else 0.0)
        prune = float(getattr(getattr(self.make_path_handler(), "params", None), "prune_distance", longest))
        reach = min(prune, half) if costmap.rolling_window else prune
        if longest > reach:
            name = "prune_distance" if prune <= reach else "half the local costmap"
            message = (
                f"a carrot {longest:g} m ahead is beyond {name} = {reach:g} m, so the robot steers to the end of the local path; "
                f"lower the lookahead to {reach:g} m"
            )
            names = (
                "max_lookahead_dist" if self.use_velocity_scaled_lookahead_dist else "lookahead_dist",
                "prune_distance",
            )
            yield Issue("warning", "carrot-beyond-path", names, message)
        step = self.max_linear_vel / (self.controller_frequency or 20.0)
        if self.min_turning_r > 0.0 and longest < 0.5 * self.min_turning_r:
            message = (
                f"a carrot {longest:g} m ahead asks for curves of a radius under the turning radius of {self.min_turning_r:g} m "
                f"as soon as it is {0.5 * longest * longest / self.min_turning_r:.2g} m to the side; set the lookahead to "
                f"{self.min_turning_r:g} m or more"
            )
            yield Issue("warning", "turning-radius", ("lookahead_dist", "min_turning_r"), message)
        if longest < 2.0 * step:
            message = (
                f"the carrot is {longest:g} m ahead, and the robot drives {step:.3g} m per control period, so it weaves about "
                f"the path; set the lookahead to {4.0 * step:.2g} m or more"
            )
            yield Issue("warning", "short-lookahead", ("lookahead_dist", "max_linear_vel"), message)

"""Rotation shim: nav2_rotation_shim_controller::RotationShimController.

Turns in place toward the path, then lets another controller drive.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, ClassVar

import numpy as np
from pydantic import create_model

from navstack.core import (
    LETHAL,
    UNKNOWN,
    Path,
    Pose2D,
    Twist2D,
    angle_between,
    fastest_corner,
    footprint_cost,
    integrate,
    is_nearly_round,
    normalize_angle,
)
from navstack.local_planner.path_follower import (
    Following,
    PathFollower,
    PathFollowerParams,
    check_speed,
    limited_turning_speed,
    turning_speed,
)
from navstack.parameters import section_model
from navstack.plugins import (
    LOCAL_PLANNERS,
    CheckContext,
    ControlDiagnostics,
    ControlInput,
    Issue,
    LocalPlan,
    LocalPlanner,
    ParamModel,
    Plugin,
    VelocityLimits,
    param,
)

DEFAULT_PRIMARY = "regulated_pure_pursuit"
SHIM = "nav2_rotation_shim_controller/RotationShimController"


@cache
def _with_plugin(model: type[ParamModel]) -> type[ParamModel]:
    """The parameters of a controller in a namespace that names its plugin."""
    if "plugin" in model.model_fields:
        return model
    field: dict[str, Any] = {"plugin": (str, param("", "type of the plugin whose parameters these are"))}
    made: type[ParamModel] = create_model(model.__name__, __base__=model, __doc__=model.__doc__, **field)
    made.NO_EFFECT = {name: reason for name, reason in model.NO_EFFECT.items() if name != "plugin"}
    return made


class RotationShimParams(PathFollowerParams):
    """Parameters of nav2_rotation_shim_controller::RotationShimController; those of the other are in `primary_controller`."""

    angular_dist_threshold: float = param(
        0.785, "angle to the path above which the robot turns in place", unit="rad", ge=0.0
    )
    angular_disengage_threshold: float = param(
        0.3925, "angle to the path at which such a turn ends", unit="rad", ge=0.0
    )
    forward_sampling_distance: float = param(
        0.5,
        "the direction is that of the first pose of the local path at least this far from its start",
        unit="m",
        gt=0.0,
    )
    rotate_to_heading_angular_vel: float = param(1.8, "turning speed in place", unit="rad/s", gt=0.0)
    max_angular_accel: float = param(3.2, "turning acceleration in place", unit="rad/s²", gt=0.0)
    simulate_ahead_time: float = param(1.0, "the turn is checked for collisions for this long", unit="s", ge=0.0)
    max_cost_threshold: float = param(
        254.0, "cost under the footprint from which a turn collides, and the other controller drives", ge=1.0, le=254.0
    )
    rotate_to_goal_heading: bool = param(False, "turn in place at the goal's position, too")
    rotate_to_heading_once: bool = param(False, "turn toward the path for a new goal only")
    closed_loop: bool = param(True, "accelerate from the measured turning speed, not from the last command")
    use_path_orientations: bool = param(False, "turn to the heading of the sampled pose, not to its direction")

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """Models of goal checker, path handler and the other controller, by namespace."""
        found = super().child_models(values)
        found["primary_controller"] = _with_plugin(
            section_model(LOCAL_PLANNERS, values, "primary_controller", DEFAULT_PRIMARY)
        )
        return found

    @property
    def drives_backward(self) -> bool:
        """False: it turns toward a path that goes backward."""
        return False

    @property
    def primary(self) -> tuple[Plugin[LocalPlanner], Any]:
        """The other controller and its parameters."""
        params = self.sections.get("primary_controller")
        for entry in LOCAL_PLANNERS:
            if params is not None and isinstance(params, entry.cls.Params):
                return entry, params
        entry = LOCAL_PLANNERS.get(DEFAULT_PRIMARY)
        return entry, entry.cls.Params()

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the shim from handing over, and what is wrong with the other controller."""
        yield from super().check(context)
        entry, params = self.primary
        if not getattr(self.sections.get("primary_controller"), "plugin", ""):
            message = (
                f"primary_controller is not set, so {entry.name} drives; write "
                '`primary_controller: {plugin: "..", its parameters}`'
            )
            yield Issue("warning", "no-primary-controller", ("primary_controller",), message)
        if issubclass(entry.cls, RotationShim):
            message = "the primary_controller of a rotation shim is a rotation shim; name a controller that drives"
            yield Issue("error", "shim-in-shim", ("primary_controller/plugin",), message)
            return
        if self.angular_disengage_threshold > self.angular_dist_threshold:
            message = (
                f"angular_disengage_threshold = {self.angular_disengage_threshold:g} is greater than angular_dist_threshold = "
                f"{self.angular_dist_threshold:g}, so a turn ends as soon as it begins; set it to "
                f"{0.5 * self.angular_dist_threshold:g}"
            )
            names = ("angular_disengage_threshold", "angular_dist_threshold")
            yield Issue("warning", "minimum-over-maximum", names, message, f"{0.5 * self.angular_dist_threshold:g}")
        radius = max(float(getattr(params, "turning_radius", 0.0)), float(getattr(params, "min_turning_r", 0.0)))
        if radius > 0.0:
            message = (
                f"a base with a turning radius of {radius:g} m cannot turn in place; use {entry.name} without the shim"
            )
            yield Issue("error", "turn-in-place", ("primary_controller/min_turning_r",), message)
        for issue in params.check(context):
            names = tuple(n if n.startswith("/") else f"primary_controller/{n}" for n in issue.parameters)
            yield Issue(issue.severity, issue.rule, names, issue.message, issue.suggestion)


@LOCAL_PLANNERS.register("rotation_shim", aliases=(SHIM,))
class RotationShim(PathFollower):
    """Turns in place toward the path, and at the goal if wanted; otherwise another controller drives.

    State between cycles: that of the other controller, whether it turns, the last turning speed. With `as_nav2`, the deliberate
    differences from Nav2 are off (parity page).
    """

    Params: ClassVar[type[ParamModel]] = RotationShimParams
    params: Any

    def __init__(self, params: RotationShimParams, *, as_nav2: bool = False) -> None:
        super().__init__(params)
        self.as_nav2 = as_nav2
        entry, own = params.primary
        self.primary: LocalPlanner = entry.cls(own)
        """The controller that drives."""
        if isinstance(self.primary, PathFollower):
            self.primary.goal_checker = self.goal_checker
            self.primary.as_nav2 = as_nav2
            self.primary.may_turn = True
            self.primary.set_limits()
        self._inputs: ControlInput | None = None
        self._turning = self._may_turn = False
        self._turned = False
        """True if the last command was a turn of the shim."""
        self._last: Twist2D | None = None
        """The last command; None if the robot was stopped since, or has not been commanded."""
        self._max_vel_theta: float | None = None

    @property
    def carrot(self) -> tuple[float, float] | None:
        """The point the other controller steers to, in the robot's frame (m)."""
        return getattr(self.primary, "carrot", None)

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """Those of the other controller, with the turning speed of the shim."""
        limits = self.primary.limits
        return limits._replace(max_vel_theta=max(limits.max_vel_theta, self._speed))

    @property
    def _speed(self) -> float:
        """Turning speed in force (rad/s). ROS differs: in Nav2, speed limits do not reach the turn."""
        speed = self.params.rotate_to_heading_angular_vel
        return speed if self._max_vel_theta is None else min(speed, self._max_vel_theta)

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        self.primary.set_limits(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        self._max_vel_theta = max_vel_theta

    # --- plan and goal ----------------------------------------------------------------------------------------------

    def set_plan(self, plan: Path, goal: Pose2D) -> None:
        """Follow `plan` to `goal`."""
        super().set_plan(plan, goal)
        self.primary.set_plan(plan, goal)

    def reset(self) -> None:
        """Reset the previous goal."""
        super().reset()
        self.primary.reset()
        self._turning, self._last = False, None

    def goal_reached(self, inputs: ControlInput) -> bool:
        """By the goal checker; by the other controller if that has its own."""
        return (
            super().goal_reached(inputs)
            if isinstance(self.primary, PathFollower)
            else self.primary.goal_reached(inputs)
        )

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self._turning, self._last = False, None
        if isinstance(self.primary, PathFollower):
            self.primary.arrived()

    # --- the command ------------------------------------------------------------------------------------------------

    def compute_command(self, inputs: ControlInput) -> LocalPlan:
        """Turn, or let the other controller drive. Raises what that one raises."""
        self._inputs = inputs
        return super().compute_command(inputs)

    def brake(self, inputs: ControlInput) -> LocalPlan | None:
        """As the other controller brakes; a turn stops at once."""
        return None if self._turned else self.primary.brake(inputs)

    def follow(self, now: Following) -> LocalPlan:
        """Turn, or let the other controller drive."""
        if now.new_goal:
            self._may_turn = True
        error, mode, reason = self._turn(now)
        if error is not None:
            command = self._turning_command(now, error)
            if self._cost_ahead(now, error, command) is None:
                self._turning, self._turned, self._last = mode == "follow", True, command
                what = "turning in place" if command.vx == command.vy == 0.0 else "braking to turn in place"
                return LocalPlan(
                    command,
                    mode,
                    local_plan=Path(now.path.poses, now.costmap.frame),
                    notes=(f"{reason}: {what}",),
                )
        take_over = self._turning if self.as_nav2 else self._turned
        if take_over and self._last is not None and isinstance(self.primary, PathFollower):
            self.primary.take_over(self._last)
        self._turning = self._turned = False
        self._last = None
        plan = self._drive(now)
        self._last = plan.command
        return plan

    def _drive(self, now: Following) -> LocalPlan:
        if isinstance(self.primary, PathFollower):
            return self.primary.follow(now)
        assert self._inputs is not None
        return self.primary.compute_command(self._inputs)

    def _turn(self, now: Following) -> tuple[float | None, str, str]:
        """The angle (rad) to turn by, None to drive; mode and reason."""
        p, yaw = self.params, now.state.pose.yaw
        if p.rotate_to_goal_heading and now.at_position:
            error = angle_between(yaw, now.goal.yaw)
            return error, "rotate_to_goal", f"at the goal's position, {error:+.2f} rad to its heading"
        # ROS differs: in Nav2 rotate_to_heading_once has no effect
        if p.rotate_to_heading_once and not self._may_turn and not self.as_nav2:
            return None, "follow", ""
        if self.as_nav2 and len(now.path.poses) < 2:
            return None, "follow", ""
        error = self._error(now)
        limit = p.angular_disengage_threshold if self._turning else p.angular_dist_threshold
        if abs(error) <= limit:
            self._may_turn = False
            return None, "follow", ""
        return error, "follow", f"the path is {error:+.2f} rad off the heading, more than {limit:g}"

    def _error(self, now: Following) -> float:
        """Angle (rad) from the heading to the sampled pose of the path."""
        p, pose, poses = self.params, now.state.pose, now.path.poses
        far = (poses[:, 0] - poses[0, 0]) ** 2 + (poses[:, 1] - poses[0, 1]) ** 2 >= p.forward_sampling_distance**2
        index = int(far.argmax()) if far.any() else len(poses) - 1
        x, y, yaw = poses[index].tolist()
        if not p.use_path_orientations:
            if math.hypot(y - pose.y, x - pose.x) < now.costmap.geometry.resolution and not self.as_nav2:
                return 0.0  # the direction to a point under the robot says nothing
            yaw = math.atan2(y - pose.y, x - pose.x)
        return angle_between(pose.yaw, yaw)

    def _turning_command(self, now: Following, error: float) -> Twist2D:
        """The turning speed, and what is left of the speed of driving.

        ROS differs: brakes within the accelerations of the other controller, where Nav2 stops at once.
        """
        p, measured = self.params, now.state.velocity
        last = measured if self._last is None else self._last
        before = measured.wz if p.closed_loop else last.wz if self._last is not None or not self.as_nav2 else 0.0
        if self.as_nav2:
            return Twist2D(0.0, 0.0, turning_speed(error, self._speed, p.max_angular_accel, before, self.period))
        speed = limited_turning_speed(error, self._speed, p.max_angular_accel, before, self.period)
        return Twist2D(*self._braked(last), speed)

    def _braked(self, last: Twist2D) -> tuple[float, float]:
        """The velocity (m/s) one period after `last`, braking."""
        limits = self.primary.limits
        return _toward_zero(last.vx, limits.acc_lim_x * self.period), _toward_zero(
            last.vy, limits.acc_lim_y * self.period
        )

    def _cost_ahead(self, now: Following, error: float, command: Twist2D) -> int | None:
        """The cost under the footprint with which the turn collides, 256 outside the costmap; None if it does not."""
        p = self.params
        for at in self._poses_ahead(now, error, command):
            cost = footprint_cost(now.costmap, now.footprint, at, interior=not self.as_nav2)
            if cost is None:
                return LETHAL + 2
            if cost == UNKNOWN and now.track_unknown_space and not self.as_nav2:
                continue
            if cost >= p.max_cost_threshold:
                return cost
        return None

    def _poses_ahead(self, now: Following, error: float, command: Twist2D) -> Iterator[Pose2D]:
        """The poses at which the turn is checked: while the robot brakes, then on the spot."""
        pose, corners = now.state.pose, np.ascontiguousarray(now.footprint.vertices.T)
        while command.vx != 0.0 or command.vy != 0.0:
            turning = 0.0 if is_nearly_round(now.footprint) else command.wz
            way = self.period * fastest_corner(corners, command.vx, command.vy, turning)
            steps = max(1, math.ceil(way / now.costmap.geometry.resolution - 1e-9))
            for _ in range(steps):
                pose = integrate(pose, command, self.period / steps)
                yield pose
            error = normalize_angle(error - command.wz * self.period)
            command = Twist2D(*self._braked(command), command.wz)
        for turned in self._headings(now, error, command.wz):
            yield Pose2D(pose.x, pose.y, pose.yaw + turned)

    def _headings(self, now: Following, error: float, speed: float) -> Iterator[float]:
        """The angles (rad) from the heading at which the turn is checked."""
        p = self.params
        if not self.as_nav2:
            step = now.costmap.geometry.resolution / max(now.footprint.circumscribed_radius, 1e-3)
            size = min(abs(error), self._speed * p.simulate_ahead_time)
            for i in range(1, math.ceil(size / step - 1e-9) + 1):
                yield math.copysign(min(i * step, size), error)
            return
        # ROS differs: Nav2 checks left turns for the whole time, right turns to where they end, short turns not at all
        for i in range(1, math.ceil(p.simulate_ahead_time / self.period - 1e-9) + 1):
            turned = speed * i * self.period
            if normalize_angle(-turned) >= abs(error) - p.angular_dist_threshold:
                return
            yield turned

    def diagnostics(self) -> ControlDiagnostics | None:
        """Those of the other controller if it drove."""
        return None if self._turning else self.primary.diagnostics()


def _toward_zero(velocity: float, change: float) -> float:
    """A velocity that is nearer to zero by at most `change`; at once without an acceleration limit."""
    return math.copysign(max(abs(velocity) - change, 0.0), velocity) if change > 0.0 else 0.0

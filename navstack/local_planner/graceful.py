# pyright: basic
"""Graceful controller: nav2_graceful_controller::GracefulController.

The robot drives to a target on its path by the smooth control law of Park and Kuipers. The farthest target that a simulated
trajectory reaches without a collision is chosen.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import create_model

from navstack.core import (
    LETHAL,
    OUTSIDE,
    UNKNOWN,
    NoValidControlError,
    Path,
    Pose2D,
    Twist2D,
    angle_between,
    edge_cost,
    fastest_corner,
    footprint_cost,
    is_nearly_round,
    kernel,
    leads_away,
    overlapped_cost,
    overlaps_obstacle,
    place_footprint,
    pose_cost,
    without_lethal,
)
from navstack.local_planner.path_follower import Following, PathFollower, PathFollowerParams, check_speed, point_ahead
from navstack.plugins import LOCAL_PLANNERS, CheckContext, Issue, LocalPlan, ParamModel, VelocityLimits, param

# ----------------------------------------------------------------------------------------------------------------------
# Parameters of nav2_graceful_controller::GracefulController.


# a keyword of Python cannot be declared as a field of a class
_FIELDS: dict[str, Any] = {"lambda": (float, param(2.0, "exponent of the curvature in the fall of the speed", gt=0.0))}
_WithLambda: type[PathFollowerParams] = create_model("_WithLambda", __base__=PathFollowerParams, **_FIELDS)


class GracefulParams(_WithLambda):
    """Parameters of nav2_graceful_controller::GracefulController."""

    RENAMED: ClassVar[Mapping[str, str]] = {
        "motion_target_dist": "max_lookahead",
        "initial_rotation_min_angle": "initial_rotation_tolerance",
    }
    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        **PathFollowerParams.NO_EFFECT,
        "min_lookahead": "Nav2 reads it but never uses it",
        "final_rotation": "of Humble; see prefer_final_rotation",
    }

    max_lookahead: float = param(1.0, "distance of the motion target along the path", unit="m", gt=0.0)
    k_phi: float = param(2.0, "how fast the heading turns to the target's, compared with the approach", gt=0.0)
    k_delta: float = param(1.0, "how fast the robot turns onto the curve", gt=0.0)
    beta: float = param(0.4, "how much the speed falls with the curvature", ge=0.0)
    v_linear_min: float = param(0.1, "lowest speed", unit="m/s", gt=0.0)
    v_linear_max: float = param(0.5, "highest speed", unit="m/s", gt=0.0)
    v_angular_max: float = param(1.0, "highest turning speed", unit="rad/s", gt=0.0)
    v_angular_min_in_place: float = param(0.25, "lowest turning speed in place", unit="rad/s", ge=0.0)
    slowdown_radius: float = param(
        1.5,
        "rest of the path below which the speed falls in proportion",
        unit="m",
        gt=0.0,
        ros_differs="the path that is left counts; in Nav2 the distance to the motion target, so that the robot never gets fast",
    )
    deceleration_max: float = param(
        2.5,
        "deceleration with which the robot can stop at the goal, and largest one from command to command",
        unit="m/s²",
        gt=0.0,
    )
    max_linear_accel: float = param(
        2.5, "acceleration from command to command; not a parameter of Nav2", unit="m/s²", gt=0.0
    )
    max_angular_accel: float = param(
        3.2, "turning acceleration from command to command; not a parameter of Nav2", unit="rad/s²", gt=0.0
    )
    initial_rotation: bool = param(True, "turn in place first if the motion target is far off the heading")
    initial_rotation_tolerance: float = param(0.75, "angle to the motion target that needs no turn", unit="rad", ge=0.0)
    prefer_final_rotation: bool = param(True, "ignore the goal's heading on the way, and turn in place at the goal")
    rotation_scaling_factor: float = param(0.5, "turning speed in place per angle, in v_angular_max per rad", gt=0.0)
    allow_backward: bool = param(False, "drive backward to a motion target behind the robot; not with initial_rotation")
    use_collision_detection: bool = param(True, "check the simulated trajectory for collisions")
    in_place_collision_resolution: float = param(0.1, "angle between the checks of a turn in place", unit="rad", gt=0.0)
    footprint_scaling_linear_vel: float = param(0.5, "speed above which the footprint grows", unit="m/s", ge=0.0)
    footprint_scaling_factor: float = param(0.25, "growth of the footprint at v_linear_max", ge=0.0)
    footprint_scaling_step: float = param(
        0.1,
        "the speed is lowered by this much, down to footprint_scaling_linear_vel, until nothing collides",
        unit="m/s",
        gt=0.0,
    )
    obstacle_cost_margin: int = param(
        1, "costs this near to a collision make the controller look for another final heading", ge=0, le=253
    )
    final_rotation_search_step: float = param(0.1, "step of that search", unit="rad", gt=0.01)

    @property
    def drives_backward(self) -> bool:
        """True if it drives to a target behind the robot."""
        return self.allow_backward and not self.initial_rotation

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield what keeps the robot from driving as the parameters say."""
        yield from super().check(context)
        if self.allow_backward and self.initial_rotation:
            message = "initial_rotation turns the robot to a target behind it, so allow_backward has no effect; set one to false"
            yield Issue("warning", "turn-or-reverse", ("allow_backward", "initial_rotation"), message, "false")
        if self.v_linear_min > self.v_linear_max:
            message = (
                f"v_linear_min = {self.v_linear_min:g} is greater than v_linear_max = {self.v_linear_max:g}; swap or correct the "
                "values"
            )
            yield Issue("error", "minimum-over-maximum", ("v_linear_min", "v_linear_max"), message)
        if self.v_angular_min_in_place > self.v_angular_max:
            message = (
                f"v_angular_min_in_place = {self.v_angular_min_in_place:g} is greater than v_angular_max = "
                f"{self.v_angular_max:g}; lower it"
            )
            yield Issue("error", "minimum-over-maximum", ("v_angular_min_in_place", "v_angular_max"), message)
        handler = getattr(self.make_path_handler(), "params", None)
        prune = float(getattr(handler, "prune_distance", self.max_lookahead))
        costmap = context.local_costmap
        half = 0.5 * min(costmap.width, costmap.height)
        reach = min(prune, half) if costmap.rolling_window else prune
        if self.max_lookahead > reach:
            name = "prune_distance" if prune <= reach else "half the local costmap"
            message = (
                f"max_lookahead = {self.max_lookahead:g} m is beyond {name} = {reach:g} m, so the target is the end of the local "
                f"path; lower it to {reach:g}"
            )
            yield Issue("warning", "carrot-beyond-path", ("max_lookahead", "prune_distance"), message, f"{reach:g}")


# ----------------------------------------------------------------------------------------------------------------------
# The smooth control law of Park and Kuipers, and the trajectory that it drives.
#
# J. J. Park, B. Kuipers, "A smooth control law for graceful motion of differential wheeled mobile robots in 2D
# environment", 2011.


# pyright: basic


LAW = np.dtype(
    [
        ("k_phi", "f8"),
        ("k_delta", "f8"),
        ("beta", "f8"),
        ("exponent", "f8"),
        ("slowdown_radius", "f8"),
        ("deceleration", "f8"),
        ("v_min", "f8"),
        ("v_max", "f8"),  # of this attempt
        ("v_full", "f8"),  # without lowering
        ("w_max", "f8"),
        ("w_min", "f8"),  # in place
        ("rotation_gain", "f8"),
        ("turn_tolerance", "f8"),
        ("scaling_speed", "f8"),
        ("scaling_factor", "f8"),
        ("beyond", "f8"),  # length of the path beyond the target, m
        ("period", "f8"),
        ("turn_first", "?"),
        ("backward", "?"),
        ("checked", "?"),
        ("corners_count", "?"),  # no corner of the footprint moves by more than a cell from check to check
        ("unknown_free", "?"),
        ("as_nav2", "?"),
    ],
    align=True,
)
"""Element type of the kernels' settings."""

NEAR_M = 1e-6
"""A target closer than this has no direction (m)."""


@kernel
def wrapped(angle):
    """Return the angle (rad) in [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@kernel
def in_float32(to_x, to_y, target_yaw, yaw, backward):
    """Return r, delta and phi of `law` as Nav2 computes them: offset, line of sight and results in float32."""
    dx, dy = np.float32(to_x), np.float32(to_y)
    sight = np.float64(np.float32(math.atan2(-dy, dx)))
    if backward:
        sight = np.float64(np.float32(sight + math.pi))
    square = np.float64(dx) * np.float64(dx) + np.float64(np.float32(dy * dy))
    r = np.float64(np.float32(math.sqrt(np.float64(np.float32(square)))))
    return r, np.float64(np.float32(wrapped(yaw + sight))), np.float64(np.float32(wrapped(target_yaw + sight)))


@kernel
def law(target_x, target_y, target_yaw, x, y, yaw, backward, p):
    """Return speed and turning speed at (x, y, yaw) on the way to the target. `p`: record of type `LAW`.

    With r the distance to the target, delta and phi the angles of the robot and the target against the line to it:
    curvature = -(k_delta (delta - atan(-k_phi phi)) + (1 + k_phi / (1 + (k_phi phi)²)) sin(delta)) / r,
    v = v_max / (1 + beta |curvature|^lambda), slower near the target.
    """
    if p.as_nav2:
        r, delta, phi = in_float32(target_x - x, target_y - y, target_yaw, yaw, backward)
    else:
        dx, dy = target_x - x, target_y - y
        r = math.sqrt(dx * dx + dy * dy)
        bearing = math.atan2(dy, dx)
        turned = math.pi if backward else 0.0
        delta = wrapped(yaw - bearing + turned)
        phi = wrapped(target_yaw - bearing + turned)
    r = max(r, NEAR_M)
    steep = p.k_phi * phi
    first = p.k_delta * (delta - math.atan(-steep))
    second = (1.0 + p.k_phi / (1.0 + steep * steep)) * math.sin(delta)
    curvature = -(first + second) / r
    if backward:
        curvature = -curvature
    v = p.v_max / (1.0 + p.beta * abs(curvature) ** p.exponent)
    left = r + p.beyond
    v = min(v, p.v_max * left / p.slowdown_radius, math.sqrt(2.0 * left * p.deceleration))
    v = min(max(v, p.v_min), p.v_max)
    if backward:
        v = -v
    w = min(max(curvature * v, -p.w_max), p.w_max)
    if curvature != 0.0:
        v = w / curvature
    return v, w


class SmoothControlLaw:
    """The law on its own, for a behavior that drives to one pose: docking.

    Gains and limits as of `GracefulParams`. The rest of the path is the distance to the target.
    """

    def __init__(
        self,
        *,
        k_phi: float,
        k_delta: float,
        beta: float,
        exponent: float,
        v_min: float,
        v_max: float,
        w_max: float,
        slowdown_radius: float,
        deceleration: float,
    ) -> None:
        self._law = np.zeros(1, LAW)
        for name, value in {
            "k_phi": k_phi,
            "k_delta": k_delta,
            "beta": beta,
            "exponent": exponent,
            "v_min": min(v_min, v_max),
            "v_max": v_max,
            "w_max": w_max,
            "slowdown_radius": slowdown_radius,
            "deceleration": deceleration,
        }.items():
            self._law[name] = value

    def command(self, pose: Pose2D, target: Pose2D, *, backward: bool = False) -> tuple[float, float]:
        """Return speed (m/s, negative if `backward`) and turning speed (rad/s) at `pose`, both poses in one frame."""
        v, w = law(target.x, target.y, target.yaw, pose.x, pose.y, pose.yaw, backward, self._law[0])
        return float(v), float(w)

    def trajectory(
        self, pose: Pose2D, target: Pose2D, *, backward: bool, seconds: float, step: float
    ) -> NDArray[np.float64]:
        """Return the poses (n, 3) every `step` (s) that the robot drives from `pose` within `seconds`, or until it is there."""
        poses = [pose]
        for _ in range(math.ceil(seconds / step)):
            v, w = self.command(pose, target, backward=backward)
            pose = _driven(pose, Twist2D(v, 0.0, w), step)
            poses.append(pose)
            if pose.distance_to(target) <= abs(v) * step:
                break
        return np.array(poses)


@kernel
def turning_in_place(error, p):
    """Return the turning speed (rad/s) of a turn in place by `error` (rad)."""
    w = p.rotation_gain * error * p.w_max
    size = max(abs(w), p.w_min)
    if not p.as_nav2:
        size = min(size, p.w_max, abs(error) / p.period)
    return size if w >= 0.0 else -size


@kernel
def nav2_edge_cost(costs, grid, corners, x, y, yaw):
    """Return what `edge_cost` does, with the edge between the last and the first corner drawn from the first, as Nav2 draws it.

    Lines of cells from one end and from the other differ where they pass between two cells.
    """
    ny, nx = costs.shape
    number = corners.shape[1]
    c, s = math.cos(yaw), math.sin(yaw)
    cells = np.empty((2, number), np.int64)
    for j in range(number):
        fx = ((x + (corners[0, j] * c - corners[1, j] * s)) - grid[0]) / grid[2]
        fy = ((y + (corners[0, j] * s + corners[1, j] * c)) - grid[1]) / grid[2]
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            return np.int64(OUTSIDE)
        cells[0, j], cells[1, j] = np.int64(fx), np.int64(fy)
    highest = np.int64(0)
    for j in range(number):
        a, b = (j, j + 1) if j < number - 1 else (0, number - 1)
        x0, y0 = cells[0, a], cells[1, a]
        dx, dy = cells[0, b] - x0, cells[1, b] - y0
        steps = max(abs(dx), abs(dy))
        for i in range(steps + 1):
            minor_x = (steps // 2 + i * abs(dx)) // steps if steps > 0 else np.int64(0)
            minor_y = (steps // 2 + i * abs(dy)) // steps if steps > 0 else np.int64(0)
            ix = x0 + (minor_x if dx >= 0 else -minor_x)
            iy = y0 + (minor_y if dy >= 0 else -minor_y)
            highest = max(highest, np.int64(costs[iy, ix]))
    return highest


@kernel
def simulate(costs, grid, corners, start, target, settings, out, command):
    """Simulate the way from `start` (3,) to `target` (3,). Returns (points, cost, seconds); points < 0: it fails.

    `grid` (3,): origin x, y and resolution; `corners` (2, n): the footprint (m). `settings` (1,): record of type `LAW`. `out`
    (m, 3) receives the poses after the start, `command` (2,) the first velocities. It fails (-1) where the footprint collides
    and (-2) if the target is not reached in m points. The cost is the highest under the robot's center.
    """
    p = settings[0]
    ny, nx = costs.shape
    resolution = grid[2]
    cells = np.empty(corners.shape, np.int32)
    placed, scaled = np.empty(corners.shape), np.empty(corners.shape)
    x, y, yaw = start[0], start[1], start[2]
    to_x, to_y, to_yaw = target[0], target[1], target[2]
    frame_x, frame_y, frame_yaw, frame_cos, frame_sin = 0.0, 0.0, 0.0, 1.0, 0.0
    if p.as_nav2:  # in the robot's frame: the law rounds to float32 there
        frame_x, frame_y, frame_yaw = x, y, yaw
        frame_cos, frame_sin = math.cos(yaw), math.sin(yaw)
        dx, dy = to_x - x, to_y - y
        to_x, to_y, to_yaw = frame_cos * dx + frame_sin * dy, frame_cos * dy - frame_sin * dx, wrapped(to_yaw - yaw)
        x, y, yaw = 0.0, 0.0, 0.0
    heading = math.atan2(to_y - y, to_x - x)
    if p.backward:
        heading += math.pi
    turning = p.turn_first
    dt = resolution / p.v_full
    most = len(out)
    if p.as_nav2:
        most = min(most, max(1, int(3.0 * math.hypot(to_x - x, to_y - y) / resolution)))
    else:
        # twice the way at the lowest speed, and the initial turn
        far = math.hypot(to_x - x, to_y - y) + resolution
        turn = math.pi / (max(p.w_min, 0.1) * dt) if turning else 0.0
        most = min(most, int(2.0 * far / (max(p.v_min, 0.01) * dt) + turn) + 1)
    highest = np.int64(0)
    v, w, seconds = 0.0, 0.0, 0.0
    for i in range(most):
        was_x, was_y, was_yaw = x, y, yaw
        if turning:
            error = wrapped(heading - yaw)
            if i == 0 or not p.as_nav2:
                v, w = 0.0, turning_in_place(error, p)
            if i == 0:
                command[0], command[1] = v, w
            turning = not abs(error) < p.turn_tolerance
            yaw += w * dt
        else:
            v, w = law(to_x, to_y, to_yaw, x, y, yaw, p.backward, p)
            if i == 0:
                command[0], command[1] = v, w
            x += v * dt * math.cos(yaw)
            y += v * dt * math.sin(yaw)
            yaw += w * dt
            if i > 0:
                seconds += math.hypot(x - was_x, y - was_y) / max(abs(v), 1e-3)
        at_x = frame_x + frame_cos * x - frame_sin * y
        at_y = frame_y + frame_sin * x + frame_cos * y
        at_yaw = yaw + frame_yaw
        out[i, 0], out[i, 1], out[i, 2] = at_x, at_y, at_yaw
        if p.checked:
            growth = 1.0
            fast = command[0] if p.as_nav2 else abs(v)
            if fast > p.scaling_speed and p.v_full > p.scaling_speed:
                growth += p.scaling_factor * ((fast - p.scaling_speed) / (p.v_full - p.scaling_speed))
            for j in range(corners.shape[1]):
                scaled[0, j], scaled[1, j] = growth * corners[0, j], growth * corners[1, j]
            if p.corners_count:
                parts = math.ceil(dt * fastest_corner(scaled, v, 0.0, w) / resolution - 1e-9)
                for k in range(1, parts):
                    share = k / parts
                    between = was_yaw + share * (yaw - was_yaw)
                    px, py = was_x + share * (x - was_x), was_y + share * (y - was_y)
                    cost = pose_cost(costs, grid[0], grid[1], resolution, scaled.T, px, py, between, True)
                    if cost == 254 or cost == OUTSIDE or (cost == 255 and not p.unknown_free):
                        return -1, cost, 0.0
            cx, cy = (at_x - grid[0]) / resolution, (at_y - grid[1]) / resolution
            if cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny:
                if p.as_nav2:
                    cost = nav2_edge_cost(costs, grid, scaled, at_x, at_y, at_yaw)
                else:
                    cost = edge_cost(costs, grid[0], grid[1], resolution, scaled, at_x, at_y, at_yaw, cells)
                if cost != OUTSIDE and not p.as_nav2:
                    place_footprint(costs, grid[0], grid[1], resolution, scaled, at_x, at_y, at_yaw, placed)
                    cost = overlapped_cost(costs, placed, max(cost, np.int64(costs[int(cy), int(cx)])))
                if cost == 254 or cost == OUTSIDE or (cost == 255 and not p.unknown_free):
                    return -1, cost, 0.0
                center = np.int64(costs[int(cy), int(cx)])
                if center != 255 or p.as_nav2:
                    highest = max(highest, center)
            elif not p.as_nav2:
                return -1, np.int64(OUTSIDE), 0.0
        if math.hypot(to_x - x, to_y - y) <= resolution:
            return i + 1, highest, seconds if p.as_nav2 else (i + 1) * dt
    return (most if p.as_nav2 else -2), highest, seconds if p.as_nav2 else most * dt


@kernel
def holds(costs, grid, vertices, start, v, w, period, unknown_free):
    """Return True if the footprint `vertices` (n, 2) does not collide while (v, w) is held: at its begin, middle and end.

    `grid` and `start` as of `simulate`.
    """
    for half in range(3):
        turned, length = 0.5 * half * period * w, 0.5 * half * period * v
        heading = start[2] + 0.5 * turned
        x, y = start[0] + length * math.cos(heading), start[1] + length * math.sin(heading)
        cost = pose_cost(costs, grid[0], grid[1], grid[2], vertices, x, y, start[2] + turned, True)
        if cost == OUTSIDE or cost == 254 or (cost == 255 and not unknown_free):
            return False
    return True


MOST_POINTS = 1500
"""Points of a simulated trajectory at most."""
SEARCH_COST = 253
"""Highest cost under the center of a pose that does not collide."""


class _Attempt(NamedTuple):
    """A trajectory that reaches its target."""

    command: Twist2D
    points: int
    cost: int
    seconds: float
    target: tuple[float, float, float]


@LOCAL_PLANNERS.register("graceful", aliases=("nav2_graceful_controller/GracefulController",))
class GracefulController(PathFollower):
    """Follows a path by a smooth control law.

    State between cycles: the plan, the goal checker, whether the initial turn is due, a final heading that was found. With
    `as_nav2`, the deliberate differences from Nav2 are off (parity page).
    """

    Params: ClassVar[type[ParamModel]] = GracefulParams
    params: Any

    def __init__(self, params: GracefulParams, *, as_nav2: bool = False) -> None:
        super().__init__(params)
        self.as_nav2 = as_nav2
        self.carrot: tuple[float, float] | None = None
        """The motion target, in the robot's frame (m)."""
        self._turn_due = True
        self._final_yaw: float | None = None
        self._last: Twist2D | None = None
        """The last command; None to accelerate from the measured velocity."""
        self._law = np.zeros(1, LAW)
        self._out = np.empty((MOST_POINTS, 3))
        self._point, self._grid, self._start, self._target = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
        self._command = np.empty(2)
        self.set_limits()

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        p = self.params
        return VelocityLimits(
            max_vel_x=self._v_max,
            min_vel_x=-self._v_max if self._backward else 0.0,
            max_vel_y=0.0,
            min_vel_y=0.0,
            max_vel_trans=self._v_max,
            min_vel_trans=0.0,
            max_vel_theta=self._w_max,
            min_vel_theta=0.0,
            acc_lim_x=min(p.max_linear_accel, p.deceleration_max),
            acc_lim_y=0.0,
            acc_lim_theta=p.max_angular_accel,
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
        )

    @property
    def _backward(self) -> bool:
        return self.params.allow_backward and not self.params.initial_rotation

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        p = self.params
        self._v_max = p.v_linear_max if max_vel_trans is None else min(p.v_linear_max, max_vel_trans)
        self._w_max = p.v_angular_max if max_vel_theta is None else min(p.v_angular_max, max_vel_theta)
        for name, value in {
            "k_phi": p.k_phi,
            "k_delta": p.k_delta,
            "beta": p.beta,
            "exponent": getattr(p, "lambda"),
            "slowdown_radius": p.slowdown_radius,
            "deceleration": p.deceleration_max,
            "v_min": min(p.v_linear_min, self._v_max),
            "v_max": self._v_max,
            "v_full": max(self._v_max, 1e-3),
            "w_max": self._w_max,
            "w_min": min(p.v_angular_min_in_place, self._w_max),
            "rotation_gain": p.rotation_scaling_factor,
            "turn_tolerance": p.initial_rotation_tolerance,
            "scaling_speed": p.footprint_scaling_linear_vel,
            "scaling_factor": p.footprint_scaling_factor,
            "period": self.period,
            "checked": p.use_collision_detection,
            "as_nav2": self.as_nav2,
        }.items():
            self._law[name] = value

    # --- the command ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Reset the previous goal and a heading that was found for it."""
        super().reset()
        self._turn_due, self._final_yaw, self._last = True, None, None

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self._last = Twist2D()

    def take_over(self, velocity: Twist2D) -> None:
        """Accelerate from there."""
        self._last = velocity

    def follow(self, now: Following) -> LocalPlan:
        """Drive to the farthest target that can be reached, within the accelerations.

        Raises NoValidControlError if none can, or if the accelerations allow no command that is free: the robot is stopped at
        once then.
        """
        last, self._last = self._last, None
        plan = self._wanted(now)
        # ROS differs: Nav2 commands any velocity at once
        if not self.as_nav2:
            plan = self._within_accelerations(now, plan, now.state.velocity if last is None else last)
        self._last = plan.command
        return plan

    def _within_accelerations(self, now: Following, plan: LocalPlan, last: Twist2D) -> LocalPlan:
        """The plan with the command on its arc that is within one period's accelerations of the `last` one.

        A command that brakes less than the trajectory asks for must be free until the robot stands.
        """
        p, (v, _, w) = self.params, plan.command
        speed = _towards(v, last.vx, p.max_linear_accel * self.period, p.deceleration_max * self.period)
        wanted = w if v == 0.0 else max(-self._w_max, min(self._w_max, speed * w / v))
        turn = _towards(wanted, last.wz, p.max_angular_accel * self.period, p.max_angular_accel * self.period)
        if abs(speed - v) <= 1e-9 and abs(turn - w) <= 1e-9:
            return plan
        command = Twist2D(speed, 0.0, turn)
        if p.use_collision_detection and plan.mode != "escape" and not self._stops_free(now, command):
            raise NoValidControlError(
                f"the accelerations allow {speed:.2f} m/s and {turn:.2f} rad/s instead of {v:.2f} m/s and {w:.2f} rad/s now, "
                "with which the robot would hit an obstacle before it stands: it stops at once",
                plan=plan,
            )
        return replace(plan, command=command, notes=("the accelerations allow no other velocity now", *plan.notes))

    def _stops_free(self, now: Following, command: Twist2D) -> bool:
        """True if the robot is free for one period of a command, and while it brakes on its arc after it."""
        p, pose = self.params, now.state.pose
        seconds = self.period + 0.5 * abs(command.vx) / p.deceleration_max
        way = seconds * (abs(command.vx) + abs(command.wz) * now.footprint.circumscribed_radius)
        count = max(1, math.ceil(way / now.costmap.geometry.resolution))
        for i in range(1, count + 1):
            at = _driven(pose, command, seconds * i / count)
            cost = footprint_cost(now.costmap, now.footprint, at, interior=True)
            if cost is None or cost == LETHAL or (cost == UNKNOWN and not now.track_unknown_space):
                return False
        return True

    def _wanted(self, now: Following) -> LocalPlan:
        """The command without regard to the accelerations. Raises NoValidControlError."""
        # ROS differs: in Nav2 every new plan makes the turn due again
        if now.new_goal or (self.as_nav2 and now.new_plan):
            self._turn_due, self._final_yaw = True, None
        poses = self._oriented(now.path.poses)
        local = Path(now.path.poses, now.costmap.frame)
        if now.at_position:
            error = angle_between(now.state.pose.yaw, float(poses[-1, 2]))
            if self._may_turn(now, error):
                self.carrot = None
                w = float(turning_in_place(error, self._law[0]))
                note = f"at the goal's position, {error:+.2f} rad to its heading: turning in place"
                return LocalPlan(Twist2D(0.0, 0.0, w), "rotate_to_goal", local_plan=local, notes=(note,))
        self._prepare(now)
        tried = 0
        for tried, (target, along) in enumerate(self._targets(now, poses), 1):
            found = self._reach(now, target, along)
            if found is not None:
                return self._plan(now, found, (self._reason(now, found, along, tried),))
        leaving = self._leave(now, poses)
        if leaving is not None:
            return leaving
        self.carrot = None
        raise NoValidControlError(
            f"no trajectory to one of {tried} targets within max_lookahead {self.params.max_lookahead:g} m is free of "
            "collisions; the path is blocked or too close to an obstacle",
            targets=tried,
            plan=LocalPlan(Twist2D(), local_plan=local),
        )

    def _plan(self, now: Following, found: _Attempt, notes: tuple[str, ...]) -> LocalPlan:
        """The result for the trajectory that was simulated last."""
        self.carrot = _in_frame_of(now.state.pose, found.target)
        trajectory = np.concatenate((self._start[np.newaxis], self._out[: found.points]))
        local = Path(now.path.poses, now.costmap.frame)
        return LocalPlan(found.command, trajectory=trajectory, local_plan=local, notes=notes)

    def _leave(self, now: Following, poses: NDArray[np.float64]) -> LocalPlan | None:
        """Drive away from obstacles that the footprint overlaps at rest; None if it overlaps none, or there is no way.

        ROS differs: in Nav2 a robot that overlaps an obstacle never leaves it.
        """
        pose = now.state.pose
        checked = self.params.use_collision_detection and not self.as_nav2
        if not checked or not overlaps_obstacle(now.costmap, now.footprint, pose):
            return None
        free = replace(now, costmap=without_lethal(now.costmap))
        for target, along in self._targets(now, poses):
            if math.hypot(target[0] - pose.x, target[1] - pose.y) <= now.costmap.geometry.resolution:
                continue  # the robot is there: it would turn on the spot
            found = self._reach(free, target, along)
            if found is not None:
                held = [_driven(pose, found.command, share * self.period) for share in (0.0, 0.5, 1.0)]
                way = np.concatenate((np.array(held), self._out[: found.points]))
                if leads_away(now.costmap, now.footprint, way):
                    note = "the footprint overlaps an obstacle; the trajectory leads away from it"
                    return replace(self._plan(now, found, (note,)), mode="escape")
        return None

    def _reason(self, now: Following, found: _Attempt, along: float, tried: int) -> str:
        x, y, _ = found.target
        pose = now.state.pose
        bearing = angle_between(pose.yaw, math.atan2(y - pose.y, x - pose.x))
        text = f"target {along:.2f} m ahead on the path, {bearing:+.2f} rad off the heading"
        if tried > 1:
            text += f", because {tried - 1} farther ones collide"
        v, w = found.command.vx, found.command.wz
        if v == 0.0:
            return f"{text}: turning in place, for it is more than initial_rotation_tolerance"
        left = math.hypot(x - pose.x, y - pose.y) + float(self._law["beyond"][0])
        top = self._v_max
        limits = {
            "v_linear_max": top,
            f"the rest of the path of {left:.2f} m": min(
                top * left / self.params.slowdown_radius, math.sqrt(2.0 * left * self.params.deceleration_max)
            ),
        }
        if abs(w) >= self._w_max - 1e-9:
            limits["v_angular_max"] = abs(v)
        if abs(v) < min(limits.values()) - 1e-9:
            limits[f"the curvature of {w / v:+.2f} 1/m"] = abs(v)
        return f"{text}; {abs(v):.2f} m/s, limited by {min(limits, key=lambda k: limits[k])}"

    def _oriented(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """The path; with the direction of the next pose as heading if all poses between first and last have the same one."""
        if len(poses) < 3:
            return poses
        first = float(poses[1, 2])
        # ROS differs: Nav2 also takes a path that turns left for one without headings
        most = math.inf if self.as_nav2 else 1e-6
        if not all(-1e-6 <= angle_between(first, yaw) <= most for yaw in poses[2:-1, 2].tolist()):
            return poses
        poses = poses.copy()
        steps = np.diff(poses[:, :2], axis=0)
        poses[:-1, 2] = np.arctan2(steps[:, 1], steps[:, 0])
        return poses

    def _may_turn(self, now: Following, error: float) -> bool:
        """True if the robot can turn in place by `error` (rad)."""
        p = self.params
        if not p.use_collision_detection:
            return True
        pose = now.state.pose
        if self.as_nav2 and now.costmap.cost_at(pose.x, pose.y) is None:
            return True
        count = max(1, int(abs(error) / p.in_place_collision_resolution))
        if not (self.as_nav2 or is_nearly_round(now.footprint)):
            # ROS differs: no corner moves by more than a cell from check to check
            way = abs(error) * now.footprint.circumscribed_radius
            count = max(count, math.ceil(way / now.costmap.geometry.resolution))
        for i in range(1, count + 1):
            at = Pose2D(pose.x, pose.y, pose.yaw + error * i / count)
            cost = footprint_cost(now.costmap, now.footprint, at, interior=not self.as_nav2)
            if cost is None or cost == LETHAL or (cost == UNKNOWN and not now.track_unknown_space):
                return False
        return True

    # --- targets ----------------------------------------------------------------------------------------------------

    def _prepare(self, now: Following) -> None:
        geometry = now.costmap.geometry
        self._grid[:] = geometry.origin_x, geometry.origin_y, geometry.resolution
        self._start[:] = now.state.pose
        self._corners = np.ascontiguousarray(now.footprint.vertices.T)
        self._law["unknown_free"] = now.track_unknown_space
        self._law["corners_count"] = not (self.as_nav2 or is_nearly_round(now.footprint))

    def _targets(
        self, now: Following, poses: NDArray[np.float64]
    ) -> Iterator[tuple[tuple[float, float, float], float]]:
        """Targets from the farthest on, with their distance along the path (m)."""
        most = self.params.max_lookahead
        along = float(point_ahead(poses, float(most), False, self._point))
        yield (float(self._point[0]), float(self._point[1]), float(self._point[2])), along
        lengths = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
        to_path = math.hypot(poses[0, 0] - now.state.pose.x, poses[0, 1] - now.state.pose.y)
        for i in range(len(poses) - 2, -1, -1):
            if to_path + lengths[i] <= most:
                x, y, yaw = poses[i].tolist()
                yield (x, y, yaw), float(lengths[i])

    def _reach(self, now: Following, target: tuple[float, float, float], along: float) -> _Attempt | None:
        """The trajectory to a target, None if there is none."""
        p, pose = self.params, now.state.pose
        x, y, yaw = target
        bearing = math.atan2(y - pose.y, x - pose.x)
        near = p.prefer_final_rotation and now.path.length < p.max_lookahead
        if near:
            yaw = bearing if self._final_yaw is None or self.as_nav2 else self._final_yaw
        ahead = math.cos(bearing - pose.yaw) > 0.0
        backward = self._backward and not ahead
        if backward:
            yaw += math.pi
        off = abs(angle_between(pose.yaw, bearing + (math.pi if backward else 0.0)))
        if off < p.initial_rotation_tolerance:
            self._turn_due = False
        self._law["turn_first"] = p.initial_rotation and self._turn_due
        self._law["backward"] = backward
        self._law["beyond"] = 0.0 if self.as_nav2 else max(0.0, now.path.remaining_m - along)
        found = self._lowering(now, (x, y, yaw))
        if self.as_nav2:
            if found is None and near and backward:  # a second attempt, for which Nav2 turns the target again
                return self._lowering(now, (x, y, yaw + math.pi))
            risky = near and found is not None and found.cost >= SEARCH_COST - p.obstacle_cost_margin
            return self._search_as_nav2(now, x, y, found) if risky else found
        # ROS differs: Nav2 does not search if the direct way collides
        risky = found is None or found.cost >= SEARCH_COST - p.obstacle_cost_margin
        if near and p.use_collision_detection and risky:
            found = self._search(now, x, y) or self._lowering(now, (x, y, yaw))
        return found

    def _search(self, now: Following, x: float, y: float) -> _Attempt | None:
        """The quickest trajectory with a safe final heading."""
        p = self.params
        best: _Attempt | None = None
        for i in range(math.ceil(2.0 * math.pi / p.final_rotation_search_step)):
            found = self._lowering(now, (x, y, -math.pi + i * p.final_rotation_search_step))
            safe = found is not None and found.cost < SEARCH_COST - p.obstacle_cost_margin
            # ROS differs: in Nav2 an unsafe heading that is as quick hides a safe one
            if found is not None and safe and (best is None or found.seconds < best.seconds):
                best = found
        if best is not None:
            self._final_yaw = best.target[2]
            best = self._lowering(now, best.target)
        return best

    def _search_as_nav2(self, now: Following, x: float, y: float, best: _Attempt | None) -> _Attempt | None:
        """The search with Nav2's defects: headings in the robot's frame, from the last one found on; hidden safe ones."""
        p, heading = self.params, now.state.pose.yaw
        turned = math.pi if bool(self._law["backward"][0]) else 0.0
        quickest = math.inf
        for i in range(math.ceil(2.0 * math.pi / p.final_rotation_search_step)):
            yaw = i * p.final_rotation_search_step + (self._final_yaw or 0.0)
            found = self._lowering(now, (x, y, heading + yaw + turned))
            if found is None or found.seconds >= quickest:
                continue
            quickest = found.seconds
            if found.cost < SEARCH_COST:
                best = found
                if self._final_yaw == yaw:
                    break
                self._final_yaw = yaw
        return best

    def _lowering(self, now: Following, target: tuple[float, float, float]) -> _Attempt | None:
        """The trajectory to a target at the highest speed at which it does not collide."""
        p = self.params
        speed = self._v_max
        self._target[:] = target
        while True:
            self._law["v_max"] = speed
            count, cost, seconds = simulate(
                now.costmap.data,
                self._grid,
                self._corners,
                self._start,
                self._target,
                self._law,
                self._out,
                self._command,
            )
            v, w = self._command.tolist()
            if count > 0 and self._holds(now, v, w):
                return _Attempt(Twist2D(v, 0.0, w), int(count), int(cost), float(seconds), target)
            speed -= p.footprint_scaling_step
            if speed < p.footprint_scaling_linear_vel or speed <= 0.0:
                return None

    def _holds(self, now: Following, v: float, w: float) -> bool:
        """True if the command does not collide while it is held, for one period.

        ROS differs: Nav2 checks only the simulated poses, of which the first is behind the robot's after a period.
        """
        if self.as_nav2 or not self.params.use_collision_detection:
            return True
        return bool(
            holds(
                now.costmap.data,
                self._grid,
                now.footprint.vertices,
                self._start,
                v,
                w,
                self.period,
                now.track_unknown_space,
            )
        )


def _driven(pose: Pose2D, command: Twist2D, seconds: float) -> Pose2D:
    """The pose after a command has been driven for some time."""
    turned, length = seconds * command.wz, seconds * command.vx
    heading = pose.yaw + 0.5 * turned
    return Pose2D(pose.x + length * math.cos(heading), pose.y + length * math.sin(heading), pose.yaw + turned)


def _towards(wanted: float, last: float, faster: float, slower: float) -> float:
    """The velocity nearest to the wanted one within one period's changes of the last one: away from zero, and towards it."""
    if last < 0.0:
        return -_towards(-wanted, -last, faster, slower)
    # through zero by at most what is left of the larger change
    lowest = last - slower if last >= slower else min(0.0, last - faster)
    return max(lowest, min(last + faster, wanted))


def _in_frame_of(pose: Pose2D, target: tuple[float, float, float]) -> tuple[float, float]:
    dx, dy = target[0] - pose.x, target[1] - pose.y
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return c * dx + s * dy, c * dy - s * dx

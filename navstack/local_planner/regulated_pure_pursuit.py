"""Regulated pure pursuit: nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController.

S. Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", 2023. The robot drives the arc through a point of the path
ahead of it, the carrot: slower in curves, near obstacles and near the goal. It turns in place if the carrot is far off its
heading, and at the goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    NoValidControlError,
    Path,
    Pose2D,
    Twist2D,
    angle_between,
    is_nearly_round,
    leads_away,
    normalize_angle,
    without_lethal,
)
from navstack.local_planner import path_follower as kernels
from navstack.local_planner.path_follower import (
    Following,
    PathFollower,
    PathFollowerParams,
    check_speed,
    limited_turning_speed,
    turning_speed,
)
from navstack.plugins import (
    LOCAL_PLANNERS,
    CheckContext,
    ControlInput,
    Issue,
    LocalPlan,
    ParamModel,
    VelocityLimits,
    param,
)

# ----------------------------------------------------------------------------------------------------------------------
# Parameters of nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController.


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


# ----------------------------------------------------------------------------------------------------------------------
# The formulas of regulated pure pursuit: curvature, speed, and the dynamic window around the last command.
#
# Sources: S. Macenski et al., "Regulated Pure Pursuit for Robot Path Tracking", 2023; for the dynamic window, arXiv 2601.15006.


NEAR_M2 = 0.001
"""Squared distance (m²) of a carrot up to which the robot drives straight."""
STRAIGHT = 1e-3
"""Curvatures below this (1/m) count as straight, speeds below this (m/s, rad/s) as rest."""
ROUNDING = 1e-9
"""Speeds below this (m/s, rad/s) are what rounding leaves of zero."""
EQUAL = 1e-4
"""Distances of two corners of a window to an arc that count as equal."""


def curvature_to(x: float, y: float) -> float:
    """Return the curvature (1/m) of the arc from the robot, along its heading, through the point (x, y) in its frame (m)."""
    squared = x * x + y * y
    return 2.0 * y / squared if squared > NEAR_M2 else 0.0


def speed_in_curve(speed: float, curvature: float, least_radius: float) -> float:
    """Return `speed` times radius / least_radius in curves of a smaller radius (m)."""
    tight = abs(curvature) * least_radius
    return speed / tight if tight > 1.0 else speed


def distance_from_cost(cost: float, inscribed_radius: float, factor: float) -> float:
    """Return the distance (m) to the obstacle that inflation gave a cost (1 .. 254) for, at the decay `factor` (1/m)."""
    return inscribed_radius + math.log(253.0 / cost) / factor


def speed_near_obstacle(speed: float, distance: float, scaling_dist: float, gain: float) -> float:
    """Return `speed` times gain * distance / scaling_dist within `scaling_dist` (m) of an obstacle."""
    return speed * gain * distance / scaling_dist if distance < scaling_dist else speed


def approach_speed(speed: float, left: float, distance: float, scaling_dist: float, least: float) -> float:
    """Return the speed (m/s) with `left` (m) of the path and `distance` (m) to its end left."""
    if left >= scaling_dist:
        return speed
    return min(speed, max(least, speed * distance / scaling_dist))


class Window(NamedTuple):
    """Velocities that can be commanded next (m/s, rad/s)."""

    v_min: float
    v_max: float
    w_min: float
    w_max: float


class WindowLimits(NamedTuple):
    """Limits of a dynamic window: speeds (m/s, rad/s), and changes within one period (positive)."""

    v_min: float
    v_max: float
    w_min: float
    w_max: float
    v_faster: float
    v_slower: float
    w_faster: float
    w_slower: float


def _reachable(last: float, faster: float, slower: float) -> tuple[float, float]:
    if last > STRAIGHT:
        return last - slower, last + faster
    if last < -STRAIGHT:
        return last - faster, last + slower
    return last - faster, last + faster


def dynamic_window(v: float, w: float, regulated: float, limits: WindowLimits, sign: float) -> Window:
    """Return what can be commanded after (v, w), at most as fast as the `regulated` speed in the direction `sign`."""
    v_low, v_high = _reachable(v, limits.v_faster, limits.v_slower)
    w_low, w_high = _reachable(w, limits.w_faster, limits.w_slower)
    v_low, v_high = max(v_low, limits.v_min), min(v_high, limits.v_max)
    w_low, w_high = max(w_low, limits.w_min), min(w_high, limits.w_max)
    low, high = (0.0, regulated) if sign >= 0.0 else (regulated, 0.0)
    # no overlap: the nearest bound of what can be reached
    if v_low > high:
        v_high = v_low
    elif v_high < low:
        v_low = v_high
    else:
        v_low, v_high = max(v_low, low), min(v_high, high)
    return Window(v_low, v_high, w_low, w_high)


def nearest_to_arc(window: Window, curvature: float, sign: float) -> tuple[float, float]:
    """Return the fastest velocity (v, w) of the window on the arc in the direction `sign`; without one, the nearest corner."""
    fastest = window.v_max if sign >= 0.0 else window.v_min
    if abs(curvature) < STRAIGHT:
        return fastest, min(max(0.0, window.w_min), window.w_max)
    by_speed = [(v, curvature * v) for v in (window.v_min, window.v_max)]
    by_turn = [(w / curvature, w) for w in (window.w_min, window.w_max)]
    on_arc = [c for c in by_speed if window.w_min <= c[1] <= window.w_max]
    on_arc += [c for c in by_turn if window.v_min <= c[0] <= window.v_max]
    if on_arc:
        return max(on_arc, key=lambda c: sign * c[0])
    corners = [(v, w) for v in (window.v_min, window.v_max) for w in (window.w_min, window.w_max)]
    scale = math.sqrt(curvature * curvature + 1.0)
    distances = [abs(curvature * v - w) / scale for v, w in corners]
    shortest = min(distances)
    near = [c for c, d in zip(corners, distances) if d <= shortest + EQUAL]
    return max(near, key=lambda c: sign * c[0])


def held_to_radius(v: float, w: float, last_v: float, window: Window, radius: float) -> tuple[float, float]:
    """Return the velocity (v, w), changed as little as possible, on a circle of at least `radius` (m).

    It turns less, and where the angular deceleration does not allow that, it brakes less: from a last velocity that keeps to
    the radius, one of both can always be commanded.
    """
    highest = abs(v) / radius * (1.0 + 1e-12)  # a velocity on the tightest arc may be off by rounding
    if abs(w) <= highest:
        return v, w
    turning = min(max(math.copysign(highest, w), window.w_min), window.w_max)
    if abs(turning) <= highest:
        return v, turning
    return math.copysign(abs(turning) * radius, last_v if last_v != 0.0 else v), turning


def towards_zero(value: float, change: float) -> float:
    """Return `value` nearer to zero by `change`, not beyond it."""
    left = abs(value) - change
    return math.copysign(left, value) if left > ROUNDING else 0.0


# ----------------------------------------------------------------------------------------------------------------------
# The speed that curves, obstacles and the end of the path allow.


def regulated_speed(
    p: RegulatedPurePursuitParams, now: Following, top: float, curvature: float, notes: list[str], *, as_nav2: bool
) -> float:
    """The speed (m/s), up to `top`, that curvature, cost and the rest of the path allow; appends what limits it to `notes`.

    Raises NoValidControlError if the robot is outside the local costmap.
    """
    reasons = {"max_linear_vel": top}
    if p.use_regulated_linear_velocity_scaling:
        slow = speed_in_curve(top, curvature, p.regulated_linear_scaling_min_radius)
        if slow < top:
            reasons[f"the curve's radius of {1.0 / abs(curvature):.2f} m"] = slow
    cost, distance = _obstacle(p, now, as_nav2=as_nav2)
    if p.use_cost_regulated_linear_velocity_scaling and p.inflation_cost_scaling_factor > 0.0:
        slow = speed_near_obstacle(top, distance, p.cost_scaling_dist, p.cost_scaling_gain)
        if slow < top:
            reasons[f"an obstacle at {distance:.2f} m (cost {cost})"] = slow
    reason = min(reasons, key=lambda r: reasons[r])
    speed = reasons[reason]
    if speed < p.regulated_linear_scaling_min_speed:
        speed = p.regulated_linear_scaling_min_speed
        reason += f", raised to regulated_linear_scaling_min_speed {speed:g}"
    left = now.path.length
    if left < p.approach_velocity_scaling_dist:
        end = now.path.poses[-1]
        distance = math.hypot(float(end[0]) - now.state.pose.x, float(end[1]) - now.state.pose.y)
        slow = approach_speed(speed, left, distance, p.approach_velocity_scaling_dist, p.min_approach_linear_velocity)
        if slow < speed:
            speed, reason = slow, f"the end of the path in {distance:.2f} m"
    if speed > top:
        speed, reason = top, "max_linear_vel"
    notes.append(f"{speed:.2f} m/s, limited by {reason}; curvature {curvature:+.2f} 1/m")
    return speed


def _obstacle(p: RegulatedPurePursuitParams, now: Following, *, as_nav2: bool) -> tuple[int, float]:
    """Cost under the robot's center, and the distance (m) to the obstacle behind it."""
    pose = now.state.pose
    cost = now.costmap.cost_at(pose.x, pose.y)
    if cost is None:
        raise NoValidControlError(
            f"the robot at ({pose.x:.2f}, {pose.y:.2f}) is outside the local costmap; check the costmap's frames",
            pose=list(pose),
        )
    if cost in (0, 255) or p.inflation_cost_scaling_factor <= 0.0:
        return cost, math.inf
    # ROS differs: Nav2 takes the parameter even if the layer has another factor
    factor = p.inflation_cost_scaling_factor
    if now.inflation is not None and not as_nav2:
        factor = now.inflation.cost_scaling_factor
    return cost, distance_from_cost(cost, now.footprint.inscribed_radius, factor)


# ----------------------------------------------------------------------------------------------------------------------
# The collision check of the arc that a command drives, and headings from which it is free.


MOST_POSES = 2000
"""Poses of an arc that are checked at most."""
TURN_STEP = math.radians(5.0)
MOST_TURN = 0.5 * math.pi
"""Headings up to this angle away are searched (rad)."""
BEGIN = 4
"""Poses of the begin of an arc."""


class Scene(NamedTuple):
    """What is checked: where the robot is, and what is around it."""

    pose: Pose2D
    costmap: Costmap
    footprint: Footprint
    track_unknown_space: bool

    @classmethod
    def of(cls, now: Following | ControlInput) -> Scene:
        """That of a cycle."""
        return cls(now.state.pose, now.costmap, now.footprint, now.track_unknown_space)


class ArcCheck:
    """Checks arcs, with buffers of its own.

    ROS differs: Nav2 checks edges of the footprint at Euler steps of a cell that end before the duration, so that of a robot
    slower than a cell per duration only the current pose is checked, and corners of a long robot that turns skip cells. Here
    overlapped cells count, on the arc itself, up to its end, and no corner moves by more than a cell per step; the turn of
    a round robot covers nothing else.
    """

    def __init__(self) -> None:
        self._poses = np.empty((MOST_POSES, 3))
        self._grid, self._start = np.empty(3), np.empty(3)
        self._twist, self._reach = np.empty(3), np.empty(3)

    def first_collision(
        self, scene: Scene, command: Twist2D, duration: float, reach: float, *, as_nav2: bool
    ) -> tuple[int, NDArray[np.float64]]:
        """Index of the first pose that collides, -1 without one, and the poses (n, 3) on the way of a command.

        The way ends after a duration (s), or at a distance (m) from the robot.
        """
        geometry = scene.costmap.geometry
        self._grid[:] = geometry.origin_x, geometry.origin_y, geometry.resolution
        self._start[:] = scene.pose
        self._twist[:] = command.vx, command.wz, scene.footprint.circumscribed_radius
        self._reach[:] = duration, reach, 0.0 if as_nav2 else 1.0
        hit, count = kernels.arc_collision(
            scene.costmap.data,
            self._grid,
            scene.footprint.vertices,
            not scene.track_unknown_space,
            not as_nav2,
            not (as_nav2 or is_nearly_round(scene.footprint)),
            self._start,
            self._twist,
            self._reach,
            self._poses,
        )
        return int(hit), self._poses[:count].copy()


def extent_of_check(
    p: RegulatedPurePursuitParams, now: Following, command: Twist2D, carrot: float
) -> tuple[float, float]:
    """Duration (s) and distance (m) of the check of a command to a carrot at some distance (m)."""
    duration, reach = p.max_allowed_time_to_collision_up_to_carrot, carrot
    least = p.min_distance_to_obstacle
    if least > 0.0:
        duration = max(duration, least / max(abs(command.vx), p.min_approach_linear_velocity))
        if p.use_velocity_scaled_lookahead_dist:
            if not p.allow_obstacle_checking_beyond_goal:
                least = min(least, now.path.length)
            reach = min(max(reach, least), p.max_lookahead_dist)
    return duration, reach


def free_arc(
    check: ArcCheck, scene: Scene, carrot: tuple[float, float], reach: float, turned: float = 0.0
) -> NDArray[np.float64] | None:
    """The poses (n, 3) of the arc to a carrot after a turn in place (rad); None if it collides.

    `carrot` is in the robot's frame before the turn (m), `reach` the distance at which the arc ends (m).
    """
    c, s = math.cos(turned), math.sin(turned)
    curvature = curvature_to(c * carrot[0] + s * carrot[1], c * carrot[1] - s * carrot[0])
    x, y, yaw = scene.pose
    at = scene._replace(pose=Pose2D(x, y, yaw + turned))
    hit, way = check.first_collision(at, Twist2D(1.0, 0.0, curvature), math.inf, reach, as_nav2=False)
    return way if hit < 0 else None


def nearest_free_heading(
    check: ArcCheck, scene: Scene, carrot: tuple[float, float], reach: float, most: float
) -> float | None:
    """Angle (rad) to the nearest other heading from which the arc to a carrot is free, None without one.

    The carrot is then at most `most` (rad) off the heading. The begin of the arc comes no nearer to an obstacle: the cost under
    the robot's center does not rise.
    """
    cost_at, bearing = scene.costmap.cost_at, math.atan2(carrot[1], carrot[0])
    here = cost_at(scene.pose.x, scene.pose.y)
    for k in range(1, math.floor(MOST_TURN / TURN_STEP) + 1):
        for turned in (k * TURN_STEP, -k * TURN_STEP):
            way = free_arc(check, scene, carrot, reach, turned) if abs(bearing - turned) <= most else None
            if way is None or here is None:
                continue
            costs = [cost_at(*point) for point in way[1:BEGIN, :2].tolist()]
            if all(cost is not None and cost <= here for cost in costs):
                return turned
    return None


NEARER = (0.75, 0.5, 0.25)
"""Shares of the lookahead that are tried if the arc to the carrot collides."""


class _Carrot(NamedTuple):
    """A point of the path in the robot's frame (m)."""

    x: float
    y: float

    @property
    def distance(self) -> float:
        return math.hypot(self.x, self.y)


class _Aim(NamedTuple):
    """Where to steer to."""

    ahead: _Carrot
    """Its side is the direction of driving; the check for collisions ends there."""
    steer: _Carrot
    """Gives the curvature."""
    sign: float
    """1 forward, -1 backward."""


_Found: TypeAlias = tuple[Twist2D, Any, list[str]]
"""A command, the poses on its way, and what limits it."""


@LOCAL_PLANNERS.register(
    "regulated_pure_pursuit", aliases=("nav2_regulated_pure_pursuit_controller/RegulatedPurePursuitController",)
)
class RegulatedPurePursuit(PathFollower):
    """Follows a path by regulated pure pursuit.

    State between cycles: the plan, the goal checker, the last command. With `as_nav2`, the deliberate differences from Nav2 are
    off (parity page).
    """

    Params: ClassVar[type[ParamModel]] = RegulatedPurePursuitParams
    params: Any

    def __init__(self, params: RegulatedPurePursuitParams, *, as_nav2: bool = False) -> None:
        super().__init__(params)
        self.as_nav2 = as_nav2
        self.carrot: tuple[float, float] | None = None
        """The point last steered to, in the robot's frame (m)."""
        self._last: Twist2D | None = None
        self._away = False
        """True while the robot turns to a heading from which its arc is free."""
        self._check_arc = ArcCheck()
        self._point = np.empty(3)
        self.set_limits()

    # --- limits -----------------------------------------------------------------------------------------------------

    @property
    def limits(self) -> VelocityLimits:
        """The limits in force."""
        p = self.params
        return VelocityLimits(
            max_vel_x=self._v_max,
            min_vel_x=min(max(p.lowest_speed, -self._v_max), 0.0) if self._reverses else 0.0,
            max_vel_y=0.0,
            min_vel_y=0.0,
            max_vel_trans=self._v_max,
            min_vel_trans=0.0,
            max_vel_theta=max(self._w_max, -self._w_min, self._turn_max),
            min_vel_theta=0.0,
            acc_lim_x=min(p.max_linear_accel, -p.max_linear_decel),
            acc_lim_y=0.0,
            acc_lim_theta=min(p.max_angular_accel, -p.max_angular_decel),
            yaw_goal_tolerance=self.goal_checker.yaw_tolerance,
            min_turning_radius=p.min_turning_r,
        )

    @property
    def _reverses(self) -> bool:
        # ROS differs: in Nav2, use_rotate_to_heading does not keep it from reversing
        return self.params.allow_reversing and (self.as_nav2 or not self.params.use_rotate_to_heading)

    def set_limits(self, *, max_vel_trans: float | None = None, max_vel_theta: float | None = None) -> None:
        """Lower the speed limits (m/s, rad/s) until the next call; None restores the parameter's value."""
        check_speed(max_vel_trans=max_vel_trans, max_vel_theta=max_vel_theta)
        p = self.params
        turning = math.inf if max_vel_theta is None else max_vel_theta
        self._v_max = p.max_linear_vel if max_vel_trans is None else min(p.max_linear_vel, max_vel_trans)
        self._w_max, self._w_min = min(p.max_angular_vel, turning), max(p.min_angular_vel, -turning)
        self._turn_max = min(p.rotate_to_heading_angular_vel, turning)

    # --- the command ------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        """Reset the previous goal and the last command."""
        super().reset()
        self._last, self._away = None, False

    def arrived(self) -> None:
        """Start the next goal from rest."""
        self._last = Twist2D()

    def take_over(self, velocity: Twist2D) -> None:
        """Accelerate from there."""
        self._last = velocity

    def follow(self, now: Following) -> LocalPlan:
        """Steer to the carrot, or turn in place. Raises NoValidControlError if the motion collides."""
        if self._last is None:
            self._last = Twist2D() if self.as_nav2 else now.state.velocity
        aim = self._aim(now, 1.0)
        if aim.sign < 0.0 and self.params.lowest_speed >= 0.0 and not self.as_nav2:
            # ROS differs: Nav2 commands zero, and the robot stands still without a reason
            raise NoValidControlError(
                f"the path is behind the robot, and min_linear_vel = {self.params.min_linear_vel:g} m/s allows no backward "
                "speed; set it below 0, or allow_reversing to false",
                carrot=[aim.ahead.x, aim.ahead.y],
            )
        turn, mode, notes = self._turn(now, aim)
        found = self._turn_away(now, aim) if self._away and turn is None else None
        if found is None:
            if turn is not None:
                command = self._turning_command(turn, now.state.velocity.wz)
            else:
                command, notes = self._arc(now, aim)
            try:
                found = command, self._check(now, command, aim.ahead, notes), notes
            except NoValidControlError:
                found = self._turn_away(now, aim) or self._to_nearer_carrot(now)
                if found is None:
                    # ROS differs: the robot is stopped now, and Nav2 goes on from its last command
                    self._last = self._last if self.as_nav2 else None
                    raise
        command, trajectory, notes = found
        self._last = command
        return LocalPlan(
            command,
            mode,
            trajectory=trajectory,
            local_plan=Path(now.path.poses, now.costmap.frame),
            notes=tuple(notes),
        )

    def brake(self, inputs: ControlInput) -> LocalPlan | None:
        """Brake on the arc of the last command, with `use_cancel_deceleration`; None at rest, and before an obstacle.

        ROS differs: Nav2 brakes from the measured speed, and not before a turn in place has ended.
        """
        p, last = self.params, self._last
        if not p.use_cancel_deceleration or last is None:
            return None
        v = towards_zero(last.vx, p.cancel_deceleration * self.period)
        if last.vx != 0.0:
            command = Twist2D(v, 0.0, last.wz * v / last.vx)
        else:
            command = Twist2D(0.0, 0.0, towards_zero(last.wz, -p.max_angular_decel * self.period))
        if command == Twist2D():
            self._last = command
            return None
        hit, poses = self._collision(Scene.of(inputs), command, abs(command.vx) / p.cancel_deceleration, math.inf)
        if hit >= 0:
            return None
        self._last = command
        note = f"the goal is canceled: braking with {p.cancel_deceleration:g} m/s²"
        return LocalPlan(command, "brake", trajectory=poses, notes=(note,))

    def _lookahead(self, now: Following) -> float:
        p = self.params
        if not p.use_velocity_scaled_lookahead_dist:
            return p.lookahead_dist
        return min(max(abs(now.state.velocity.vx) * p.lookahead_time, p.min_lookahead_dist), p.max_lookahead_dist)

    def _aim(self, now: Following, share: float) -> _Aim:
        """Where to steer to, with a share of the lookahead."""
        p = self.params
        ahead = steer = self._carrot(now, share * self._lookahead(now), beyond=False)
        if p.use_fixed_curvature_lookahead:
            beyond = p.interpolate_curvature_after_goal and (len(now.path.poses) > 1 or self.as_nav2)
            steer = self._carrot(now, share * p.curvature_lookahead_dist, beyond=beyond)
        self.carrot = (steer.x, steer.y)
        return _Aim(ahead, steer, -1.0 if self._reverses and ahead.x < 0.0 else 1.0)

    def _carrot(self, now: Following, distance: float, *, beyond: bool) -> _Carrot:
        pose, poses = now.state.pose, now.path.poses
        # ROS differs: Nav2 counts from the first pose of the local path, not from the robot
        passed = 0.0 if self.as_nav2 else kernels.passed_length(poses, float(pose.x), float(pose.y), -distance)
        kernels.point_ahead(poses, float(distance + passed), beyond, self._point)
        dx, dy = float(self._point[0]) - pose.x, float(self._point[1]) - pose.y
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        return _Carrot(c * dx + s * dy, c * dy - s * dx)

    # --- turning in place -------------------------------------------------------------------------------------------

    def _turn(self, now: Following, aim: _Aim) -> tuple[float | None, str, list[str]]:
        """The angle (rad) to turn in place by, None to drive; mode and reason."""
        p = self.params
        if not p.use_rotate_to_heading:
            return None, "follow", []
        if now.at_position:
            error = angle_between(now.state.pose.yaw, float(now.path.poses[-1, 2]))
            return (
                error,
                "rotate_to_goal",
                [f"at the goal's position, {error:+.2f} rad to its heading: turning in place"],
            )
        steer = aim.steer
        error = math.atan2(steer.y, steer.x)
        if aim.sign < 0.0:
            error = normalize_angle(error + math.pi)
        if abs(error) <= p.rotate_to_heading_min_angle:
            return None, "follow", []
        reason = (
            f"the carrot, {steer.distance:.2f} m ahead, is {error:+.2f} rad off the heading, more than "
            f"rotate_to_heading_min_angle {p.rotate_to_heading_min_angle:g}: turning in place"
        )
        return error, "follow", [reason]

    def _turning_command(self, error: float, measured: float) -> Twist2D:
        p = self.params
        assert self._last is not None
        if self.as_nav2:
            return Twist2D(0.0, 0.0, turning_speed(error, self._turn_max, p.max_angular_accel, measured, self.period))
        # ROS differs: from the last command, so that the acceleration holds from command to command
        speed = limited_turning_speed(error, self._turn_max, p.max_angular_accel, self._last.wz, self.period)
        if not p.use_dynamic_window:
            return Twist2D(0.0, 0.0, speed)
        # ROS differs: brakes first, where Nav2 stops at once
        slower = -p.max_linear_decel * self.period
        return Twist2D(math.copysign(max(abs(self._last.vx) - slower, 0.0), self._last.vx), 0.0, speed)

    # --- driving an arc ---------------------------------------------------------------------------------------------

    def _arc(self, now: Following, aim: _Aim, top: float = math.inf) -> tuple[Twist2D, list[str]]:
        """The command on the arc to the carrot, at most with the speed `top` (m/s), and what limits it."""
        p, sign = self.params, aim.sign
        curvature = curvature_to(aim.steer.x, aim.steer.y)
        notes: list[str] = []
        if p.min_turning_r > 0.0 and abs(curvature) * p.min_turning_r > 1.0:
            notes.append(f"the arc to the carrot has a radius of {1.0 / abs(curvature):.2f} m, under min_turning_r")
            curvature = math.copysign(1.0 / p.min_turning_r, curvature)
        speed = sign * min(regulated_speed(p, now, self._v_max, curvature, notes, as_nav2=self.as_nav2), top)
        if p.use_dynamic_window:
            return self._windowed(speed, curvature, sign, notes), notes
        turning = speed * curvature
        if not self.as_nav2 and not self._w_min <= turning <= self._w_max:
            # ROS differs: Nav2 does not limit the turning speed here
            bound = self._w_max if turning > 0.0 else self._w_min
            notes.append(f"slowed to {bound / curvature:.2f} m/s by the turning speed {bound:g} rad/s")
            speed, turning = (bound / curvature, bound) if bound != 0.0 else (0.0, 0.0)
        return Twist2D(speed, 0.0, turning), notes

    def _windowed(self, speed: float, curvature: float, sign: float, notes: list[str]) -> Twist2D:
        """The command within one period's acceleration of the last one that is nearest to the arc."""
        p = self.params
        assert self._last is not None
        period = self.period
        limits = WindowLimits(
            max(p.min_linear_vel, -self._v_max),
            self._v_max,
            self._w_min,
            self._w_max,
            p.max_linear_accel * period,
            -p.max_linear_decel * period,
            p.max_angular_accel * period,
            -p.max_angular_decel * period,
        )
        window = dynamic_window(self._last.vx, self._last.wz, speed, limits, sign)
        v, w = nearest_to_arc(window, curvature, sign)
        if p.min_turning_r > 0.0:
            v, w = held_to_radius(v, w, self._last.vx, window, p.min_turning_r)
        if abs(v - speed) > 1e-9 or abs(w - speed * curvature) > 1e-9:
            notes.append(
                f"the accelerations allow {window.v_min:.2f} .. {window.v_max:.2f} m/s and {window.w_min:.2f} .. "
                f"{window.w_max:.2f} rad/s now"
            )
        return Twist2D(v, 0.0, w)

    def _turn_away(self, now: Following, aim: _Aim) -> _Found | None:
        """A turn in place to the nearest heading from which the arc to the carrot is free; None without one.

        Once begun, it ends where the arc is free up to the carrot. A driving robot stops first. ROS differs: Nav2 stops.
        """
        p, begun = self.params, self._away
        self._away = False
        drives = abs(now.state.velocity.vx) > p.max_linear_accel * self.period + 1e-9
        if self.as_nav2 or drives or not (p.use_rotate_to_heading or self.may_turn):
            return None
        scene, reach = Scene.of(now), aim.ahead.distance
        if begun and free_arc(self._check_arc, scene, aim.steer, reach) is not None:
            return None
        turned = nearest_free_heading(self._check_arc, scene, aim.steer, reach, p.rotate_to_heading_min_angle)
        if turned is None:
            return None
        command = self._turning_command(turned, now.state.velocity.wz)
        notes = [f"the arc to the carrot collides: turning by {turned:+.2f} rad, to where it is free"]
        try:
            trajectory = self._check(now, command, aim.ahead, notes)
        except NoValidControlError:
            return None
        self._away = True
        return command, trajectory, notes

    def _to_nearer_carrot(self, now: Following) -> _Found | None:
        """The command to the farthest nearer carrot whose arc is free; None without one.

        The plan is free along the path, the arc to the carrot cuts its corners. A base with a turning radius cannot turn in
        place to wait for another plan, so it keeps closer to the path, and slower: it reaches the carrot at the end of the check.
        ROS differs: Nav2 stops.
        """
        p = self.params
        duration = p.max_allowed_time_to_collision_up_to_carrot
        if self.as_nav2 or p.turning_radius == 0.0 or duration == 0.0:
            return None
        scene, carrot = Scene.of(now), self.carrot
        for share in NEARER:
            aim = self._aim(now, share)
            command, notes = self._arc(now, aim, aim.steer.distance / duration)
            hit, poses = self._collision(scene, command, duration, math.inf)
            if hit < 0:
                notes.append(f"the arc to the carrot collides: steering to one {aim.steer.distance:.2f} m ahead")
                return command, poses, notes
        self.carrot = carrot
        return None

    # --- collisions -------------------------------------------------------------------------------------------------

    def _check(self, now: Following, command: Twist2D, ahead: _Carrot, notes: list[str]) -> Any:
        """The poses (n, 3) on the way of the command; raises NoValidControlError if one collides."""
        p = self.params
        if not p.use_collision_detection:
            return None
        scene = Scene.of(now)
        pose = scene.pose
        extent = extent_of_check(p, now, command, ahead.distance)
        hit, poses = self._collision(scene, command, *extent)
        if hit < 0:
            return poses
        if hit > 0 and command.vx == 0.0 and is_nearly_round(now.footprint) and not self.as_nav2:
            return poses[
                :hit
            ]  # ROS differs: in Nav2 the corners of its polygon keep a round robot from turning in place
        if hit == 0 and not self.as_nav2:
            # ROS differs: in Nav2 a robot that overlaps an obstacle never leaves it
            free = scene._replace(costmap=without_lethal(scene.costmap))
            blocked, way = self._collision(free, command, *extent)
            if blocked < 0 and leads_away(scene.costmap, scene.footprint, way):
                notes.append("the footprint overlaps an obstacle; the command leads away from it")
                return way
        at = Pose2D(*poses[hit].tolist())
        where = "where it stands" if hit == 0 else f"after {pose.distance_to(at):.2f} m"
        plan = LocalPlan(Twist2D(), local_plan=Path(now.path.poses, now.costmap.frame), notes=tuple(notes))
        raise NoValidControlError(
            f"the robot would collide {where}, at ({at.x:.2f}, {at.y:.2f}), with the command vx {command.vx:.2f}, wz "
            f"{command.wz:.2f}; the path is blocked or too close to an obstacle there",
            at=list(at),
            command=list(command),
            plan=plan,
        )

    def _collision(
        self, scene: Scene, command: Twist2D, duration: float, reach: float
    ) -> tuple[int, NDArray[np.float64]]:
        return self._check_arc.first_collision(scene, command, duration, reach, as_nav2=self.as_nav2)

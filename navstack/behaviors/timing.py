"""Times for paths, and rest at the ends of trajectories, within the limits of a robot; and whether it can follow them."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from navstack.behaviors.errors import InfeasibleTrajectoryError, InvalidTrajectoryError
from navstack.behaviors.trajectory import STANDING_M_S, FloatArray, Trajectory
from navstack.core import Path, WheelDrive

SPACING_M: Final = 0.005
"""Spacing of the points at which the speed limits of a path are evaluated (m)."""
SHARE: Final = 0.9
"""Share of the limits of acceleration and turning that a timed path uses: the rest is for the tracking controller."""
SPEED_SHARE: Final = 0.99
"""Share of the maximum speed: the cubics between samples exceed it in curves by a thousandth."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What a robot can do. inf: no limit; a turning radius of 0: it can turn in place."""

    max_speed: float = math.inf
    """m/s."""
    max_turn_rate: float = math.inf
    """rad/s."""
    max_acceleration: float = math.inf
    """m/s², along the path."""
    max_turn_acceleration: float = math.inf
    """rad/s²."""
    min_turning_radius: float = 0.0
    """m."""
    drive: WheelDrive | None = None
    """The wheels, if their speed is limited."""
    max_wheel_speed: float = math.inf
    """m/s at the rim."""


def from_path(
    path: Path, limits: MotionLimits, *, smoothing_m: float = 0.05, dt: float = 0.1, name: str = "path"
) -> Trajectory:
    """Return a trajectory along a path, as fast as the limits allow, from rest to rest. Poses' headings are not used.

    The path is replaced by a smoothing spline that stays within about `smoothing_m` (m, root mean square) of its points, because
    plans on a grid have corners in every cell. The speed at each point is limited by max_speed, by the turn rate and turn
    acceleration on the curve, and by the acceleration from and to its neighbors (a forward and a backward pass).

    Raises InvalidTrajectoryError for a path without length, InfeasibleTrajectoryError for a curve below the turning radius and
    for limits that are not finite.
    """
    if not (0.0 < limits.max_speed < math.inf and 0.0 < limits.max_acceleration < math.inf):
        raise InfeasibleTrajectoryError(
            "timing a path needs a finite maximum speed and acceleration", limits=str(limits)
        )
    s, at, tangent, curvature = _smooth(path, smoothing_m)
    radius = limits.min_turning_radius
    sharpest = int(np.abs(curvature).argmax())
    if radius > 0.0 and abs(curvature[sharpest]) > 1.0 / radius * (1.0 + 1e-3):
        raise InfeasibleTrajectoryError(
            f"the path has a curve of {1.0 / abs(curvature[sharpest]):.2f} m radius at ({at[sharpest, 0]:.2f}, "
            f"{at[sharpest, 1]:.2f}), below the turning radius of {radius:.2f} m; smooth it more or plan for this robot",
            radius=1.0 / abs(float(curvature[sharpest])),
            at=at[sharpest].tolist(),
        )
    speed = _speeds(s, curvature, limits)
    return _timed(s, at, tangent, curvature, speed, dt, path.frame, name)


def _smooth(path: Path, smoothing_m: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return arc lengths (m,), positions (m, 2), unit tangents (m, 2) and curvatures (m,) every SPACING_M along a spline."""
    from scipy.interpolate import splev, splprep

    points = path.poses[:, :2]
    keep = np.concatenate(([True], np.hypot(*np.diff(points, axis=0).T) > 1e-9))
    points = points[keep]
    length = float(np.hypot(*np.diff(points, axis=0).T).sum()) if len(points) > 1 else 0.0
    if length < SPACING_M:
        raise InvalidTrajectoryError(f"a path of {length:.3f} m is too short to be timed", length_m=length)
    # evenly spaced points: the spline's parameter is then about the arc length, and the smoothing is the same everywhere
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    count = max(8, math.ceil(length / 0.05))
    even = np.linspace(0.0, length, count)
    points = np.column_stack([np.interp(even, along, points[:, i]) for i in (0, 1)])
    weights = np.ones(count)
    weights[[0, -1]] = 100.0  # the ends stay where they are
    spline, _ = splprep(points.T, w=weights, u=even, k=5, s=count * smoothing_m**2 * 0.25)
    u = np.linspace(0.0, length, max(3, math.ceil(length / SPACING_M) + 1))
    (x, y), (dx, dy), (ddx, ddy) = (np.asarray(splev(u, spline, der=k)) for k in (0, 1, 2))
    rate = np.hypot(dx, dy)
    s = np.concatenate(([0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(u))))
    curvature = (dx * ddy - dy * ddx) / rate**3
    return s, np.column_stack((x, y)), np.column_stack((dx, dy)) / rate[:, None], curvature


def _speeds(s: FloatArray, curvature: FloatArray, limits: MotionLimits) -> FloatArray:
    """Return the speed (m/s) at each arc length: the limits of the curve, then those of the acceleration."""
    bend = np.maximum(np.abs(curvature), 1e-9)
    change = np.maximum(np.abs(np.gradient(curvature, s)), 1e-9)
    speed = np.minimum(SPEED_SHARE * limits.max_speed, SHARE * limits.max_turn_rate / bend)
    speed = np.minimum(speed, np.sqrt(0.5 * SHARE * limits.max_turn_acceleration / change))
    # braking changes the turn rate, too: a k below half of the turn acceleration
    acceleration = SHARE * np.minimum(limits.max_acceleration, 0.5 * limits.max_turn_acceleration / bend)
    speed[0] = speed[-1] = 0.0
    for order in (range(1, len(s)), range(len(s) - 2, -1, -1)):
        for k in order:
            j = k - 1 if order.step > 0 else k + 1
            a = min(acceleration[k], acceleration[j])
            speed[k] = min(speed[k], math.sqrt(speed[j] ** 2 + 2.0 * a * abs(s[k] - s[j])))
    return speed


def _timed(
    s: FloatArray,
    at: FloatArray,
    tangent: FloatArray,
    curvature: FloatArray,
    speed: FloatArray,
    dt: float,
    frame: str,
    name: str,
) -> Trajectory:
    """Return samples every `dt` (s), for a constant acceleration between two arc lengths."""
    step = np.diff(s)
    time = np.concatenate(([0.0], np.cumsum(2.0 * step / (speed[1:] + speed[:-1]))))
    end = float(time[-1])
    t = np.minimum(np.arange(math.ceil(end / dt - 1e-9) + 1) * dt, end)
    if len(t) < 2 or t[-1] - t[-2] < 1e-6:
        t = np.array([0.0, end]) if len(t) < 3 else np.concatenate((t[:-2], [end]))
    k = np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(step) - 1)
    a = (speed[k + 1] ** 2 - speed[k] ** 2) / (2.0 * step[k])
    since = t - time[k]
    v = np.maximum(speed[k] + a * since, 0.0)
    arc = s[k] + speed[k] * since + 0.5 * a * since**2
    position, direction = (
        np.column_stack([np.interp(arc, s, values[:, i]) for i in (0, 1)]) for values in (at, tangent)
    )
    heading = direction / np.hypot(*direction.T)[:, None]
    normal = np.column_stack((-heading[:, 1], heading[:, 0]))
    bend = np.interp(arc, s, curvature)
    velocity = heading * v[:, None]
    acceleration = heading * a[:, None] + normal * (bend * v**2)[:, None]
    zero = np.zeros((len(t), 1))
    columns = (np.hstack((values, zero)) for values in (position, velocity, acceleration))
    return Trajectory(t, *columns, frame=frame, name=name)


def with_rest(trajectory: Trajectory, acceleration: float, *, dt: float = 0.05) -> Trajectory:
    """Return the same path from rest to rest: its clock speeds up at the start and slows down at the end.

    The path is warped in time: with the clock u(t), the position is p(u), the velocity p' u', the acceleration p'' u'² + p' u''.
    u' goes linearly from 0 to 1 in T = speed / `acceleration` (m/s²), and back at the end; a trajectory that starts or ends at
    rest keeps that end. Raises InvalidTrajectoryError if the trajectory is too short for that.
    """
    if not (math.isfinite(acceleration) and acceleration > 0.0):
        raise InvalidTrajectoryError(f"the acceleration {acceleration:g} m/s² must be positive", value=acceleration)
    speeds = np.hypot(trajectory.velocity[[0, -1], 0], trajectory.velocity[[0, -1], 1])
    rise, fall = (float(v) / acceleration if v > 1e-3 else 0.0 for v in speeds)
    total = trajectory.duration
    if 0.5 * (rise + fall) > total:
        raise InvalidTrajectoryError(
            f"the trajectory of {total:.1f} s is too short to start and stop with {acceleration:g} m/s²; allow more"
        )
    if rise == fall == 0.0:
        return trajectory
    # u = t² / 2T during the rise: it takes T and covers T / 2 of the clock
    flat = total - 0.5 * (rise + fall)
    end = rise + flat + fall
    t = np.minimum(np.arange(math.ceil(end / dt - 1e-9) + 1) * dt, end)
    rising, falling = t < rise, t > rise + flat
    u = t - 0.5 * rise
    rate, change = np.ones_like(t), np.zeros_like(t)
    if rise > 0.0:
        u[rising], rate[rising], change[rising] = t[rising] ** 2 / (2.0 * rise), t[rising] / rise, 1.0 / rise
    if fall > 0.0:
        left = end - t[falling]
        u[falling], rate[falling], change[falling] = total - left**2 / (2.0 * fall), left / fall, -1.0 / fall
    p, v, a = _evaluated(trajectory, np.clip(u, 0.0, total))
    return replace(
        trajectory,
        t=t,
        position=p,
        velocity=v * rate[:, None],
        acceleration=a * rate[:, None] ** 2 + v * change[:, None],
        yaw=None,  # pyright: ignore[reportArgumentType]
    )


def _evaluated(trajectory: Trajectory, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return position, velocity and acceleration (m, 3) of the trajectory's cubics at `times` (m,) s."""
    from scipy.interpolate import CubicHermiteSpline

    cubic = CubicHermiteSpline(trajectory.t, trajectory.position, trajectory.velocity)
    return tuple(np.asarray(cubic(times, nu)) for nu in (0, 1, 2))  # type: ignore[return-value]


# --- feasibility ------------------------------------------------------------------------------------------------------

CHECK_S: Final = 0.02
"""Time between two checks (s)."""
CYCLE_S: Final = 0.1
"""Accelerations are mean values over this time (s): a jump, as at the corners of a poly_path, is a finite acceleration then."""
SPARE: Final = 0.98
"""Share of the limits that a fitted trajectory uses."""
MOST_ROUNDS: Final = 20
SLACK: Final = 1e-3
"""Relative excess that counts as rounding."""


@dataclass(frozen=True, slots=True)
class Violation:
    """A limit of the robot that a trajectory breaks."""

    quantity: str
    """speed, turn rate, acceleration, turn acceleration, curvature, or the name of a wheel."""
    unit: str
    limit: float
    time: float
    """When it is first broken (s)."""
    value: float
    """Value at that time."""
    worst: float
    """Largest value."""
    worst_time: float
    """s."""

    def __str__(self) -> str:
        return (
            f"{self.quantity} {self.value:.3g} {self.unit} at {self.time:.2f} s, limit {self.limit:.3g} {self.unit}; "
            f"worst {self.worst:.3g} at {self.worst_time:.2f} s"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class Demands:
    """What a trajectory demands of a robot, at m times."""

    t: FloatArray
    """(m,) s."""
    speed: FloatArray
    """(m,) m/s."""
    turn_rate: FloatArray
    """(m,) rad/s."""
    acceleration: FloatArray
    """(m,) m/s², along the path, mean over CYCLE_S."""
    turn_acceleration: FloatArray
    """(m,) rad/s², mean over CYCLE_S."""
    curvature: FloatArray
    """(m,) 1/m; 0 where it stands."""


def demands_of(trajectory: Trajectory) -> Demands:
    """Return what the trajectory demands, every CHECK_S."""
    count = max(2, math.ceil(trajectory.duration / CHECK_S) + 1)
    t = np.linspace(0.0, trajectory.duration, count)
    references = [trajectory.at(time) for time in t.tolist()]
    speed = np.array([r.speed for r in references])
    turn_rate = np.array([r.turn_rate for r in references])
    moving = speed > 10.0 * STANDING_M_S
    curvature = np.zeros(count)
    curvature[moving] = turn_rate[moving] / speed[moving]
    return Demands(t, speed, turn_rate, _rate(t, speed), _rate(t, turn_rate), curvature)


def violations(trajectory: Trajectory, limits: MotionLimits) -> tuple[Violation, ...]:
    """Return every limit that the trajectory breaks, with the time at which it first does; the first one first."""
    d = demands_of(trajectory)
    bend = 1.0 / limits.min_turning_radius if limits.min_turning_radius > 0.0 else math.inf
    checks = [
        ("speed", "m/s", d.speed, limits.max_speed),
        ("turn rate", "rad/s", d.turn_rate, limits.max_turn_rate),
        ("acceleration", "m/s²", d.acceleration, limits.max_acceleration),
        ("turn acceleration", "rad/s²", d.turn_acceleration, limits.max_turn_acceleration),
        ("curvature", "1/m", d.curvature, bend),
    ]
    if limits.drive is not None:
        rims = _rims(limits.drive, d)
        checks += [(f"wheel {name}", "m/s", rim, limits.max_wheel_speed) for name, rim in zip(limits.drive.names, rims)]
    found: list[Violation] = []
    for quantity, unit, values, limit in checks:
        size = np.abs(values)
        broken = np.flatnonzero(size > limit * (1.0 + SLACK))
        if len(broken):
            first, worst = int(broken[0]), int(size.argmax())
            found.append(
                Violation(
                    quantity,
                    unit,
                    limit,
                    float(d.t[first]),
                    float(size[first]),
                    float(size[worst]),
                    float(d.t[worst]),
                )
            )
    return tuple(sorted(found, key=lambda v: v.time))


def require_feasible(trajectory: Trajectory, limits: MotionLimits) -> None:
    """Raise InfeasibleTrajectoryError with every limit that the trajectory breaks."""
    found = violations(trajectory, limits)
    if found:
        factor = slowest_factor(trajectory, limits)
        hint = f"; it is feasible in {factor:.2f} times the time" if factor is not None else ""
        raise InfeasibleTrajectoryError(
            f"the robot cannot follow {trajectory.name or 'the trajectory'}: {'; '.join(map(str, found))}{hint}",
            violations=[v.as_dict() for v in found],
            slower=factor,
        )


def slowest_factor(trajectory: Trajectory, limits: MotionLimits) -> float | None:
    """Return the factor of the duration from which the trajectory is feasible (at least 1); None if slowness does not help.

    Speeds fall with the factor, accelerations with its square; the curvature does not change.
    """
    total = 1.0
    # a jump of the turn rate is a mean over CYCLE_S: it falls with the factor, not with its square, so this takes some rounds
    for _ in range(MOST_ROUNDS):
        factor = _time_factor(trajectory.slower(total), limits)
        if factor is None:
            return None
        if factor <= 1.0:
            break
        total *= factor * (1.0 + SLACK)
    return total


def fitted(trajectory: Trajectory, limits: MotionLimits) -> Trajectory:
    """Return the trajectory as fast as `limits` allow, with SPARE for the tracking controller, from rest to rest.

    Raises InfeasibleTrajectoryError for a curve below the turning radius, InvalidTrajectoryError as `with_rest`.
    """
    factor = _time_factor(trajectory, limits)
    if factor is None:
        require_feasible(trajectory, replace(limits, max_speed=math.inf, max_turn_rate=math.inf))
        raise InfeasibleTrajectoryError("the trajectory cannot be fitted to the limits of the robot")
    moving = with_rest(trajectory.slower(factor / SPARE), 0.5 * limits.max_acceleration)
    return moving.slower(slowest_factor(moving, limits) or 1.0)


def _time_factor(trajectory: Trajectory, limits: MotionLimits) -> float | None:
    """Return the factor of the duration at which the first limit is reached; None for a curve below the turning radius."""
    d = demands_of(trajectory)
    if limits.min_turning_radius > 0.0 and np.abs(d.curvature).max() > (1.0 + SLACK) / limits.min_turning_radius:
        return None
    ratios = [
        np.abs(d.speed).max() / limits.max_speed,
        np.abs(d.turn_rate).max() / limits.max_turn_rate,
        math.sqrt(np.abs(d.acceleration).max() / limits.max_acceleration),
        math.sqrt(np.abs(d.turn_acceleration).max() / limits.max_turn_acceleration),
    ]
    if limits.drive is not None:
        ratios.append(np.abs(_rims(limits.drive, d)).max() / limits.max_wheel_speed)
    return max(1e-6, *(float(r) for r in ratios))


def _rims(drive: WheelDrive, demands: Demands) -> FloatArray:
    """Return the velocities (n, m) of the rims of n wheels (m/s)."""
    return np.outer(drive.matrix[:, 0], demands.speed) + np.outer(drive.matrix[:, 2], demands.turn_rate)


def _rate(t: FloatArray, values: FloatArray) -> FloatArray:
    """Return (m,) the change of `values` over CYCLE_S around each time, per second."""
    half = 0.5 * CYCLE_S
    before, after = np.maximum(t - half, t[0]), np.minimum(t + half, t[-1])
    return (np.interp(after, t, values) - np.interp(before, t, values)) / np.maximum(after - before, 1e-9)

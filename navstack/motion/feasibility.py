"""Whether a robot can follow a trajectory, and when it could not."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import Any, Final

import numpy as np

from navstack.kinematics import WheelDrive
from navstack.motion.errors import InfeasibleTrajectoryError
from navstack.motion.timing import MotionLimits, with_rest
from navstack.motion.trajectory import STANDING_M_S, FloatArray, Trajectory

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

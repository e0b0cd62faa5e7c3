"""Trajectories in closed form: piecewise cubic through points, figure of eight, heart."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from navstack.motion.errors import InvalidTrajectoryError
from navstack.motion.trajectory import FloatArray, Trajectory

SAMPLE_S: Final = 0.1
"""Default time between two samples (s)."""

Curve = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Position, velocity and acceleration (n, 3) at times (n,)."""


def poly_path(
    points: ArrayLike,
    speed: float | Sequence[float],
    *,
    start_velocity: ArrayLike = (0.0, 0.0, 0.0),
    end_velocity: ArrayLike | None = None,
    corner: Literal["edge", "next"] = "edge",
    dt: float = SAMPLE_S,
    frame: str = "map",
) -> Trajectory:
    """Return a piecewise cubic through `points` (n, 2 or 3) m: continuous in position and velocity, with jumps of acceleration.

    `speed` (m/s) is the mean speed on every edge, or one per edge: an edge of length d takes d / speed. An edge ends with the
    velocity `speed` in its own direction (`corner="edge"`, as the ROS tutorial node) or in that of the edge to the next point
    ("next"); the last one with `end_velocity` if it is given. Samples every `dt` (s) from each corner on, corners included, so
    that the trajectory is exact between samples.

    With the start s, end e, start velocity v, end velocity w and duration T of an edge: s + v t + a t² + b t³ with
    a = (3 (e - s) - 2 T v - T w) / T², b = (2 (s - e) + T (v + w)) / T³. Source of the construction: the ROS tutorial node for
    timed trajectories. ROS differs: there corners and the last point have no sample, and equal neighbours divide by zero.

    Raises InvalidTrajectoryError for fewer than two points, equal neighbours, or a speed that is not positive.
    """
    at = _points(points)
    edges = np.diff(at, axis=0)
    lengths = np.linalg.norm(edges, axis=1)
    equal = np.flatnonzero(lengths == 0.0)
    if len(equal):
        k = int(equal[0])
        raise InvalidTrajectoryError(f"points {k + 1} and {k + 2} are equal; remove one of them", points=[k, k + 1])
    speeds = np.broadcast_to(np.asarray(speed, np.float64), lengths.shape)
    if not (np.isfinite(speeds).all() and (speeds > 0.0).all()):
        raise InvalidTrajectoryError("the mean speed of every edge must be positive", speed=speeds.tolist())
    _require_step(dt)
    if corner not in ("edge", "next"):
        raise InvalidTrajectoryError(f'corner="{corner}" is neither "edge" nor "next"', corner=corner)
    directions = edges / lengths[:, None]
    ends = speeds[:, None] * (directions if corner == "edge" else np.concatenate((directions[1:], directions[-1:])))
    if end_velocity is not None:
        ends[-1] = _vector(end_velocity)
    t, p, v, a = [0.0], [at[0]], [_vector(start_velocity)], [np.zeros(3)]
    begin, velocity = 0.0, v[0]
    for k, edge in enumerate(edges):
        duration = float(lengths[k] / speeds[k])
        end = ends[k]
        c2 = (3.0 * edge - duration * (2.0 * velocity + end)) / duration**2
        c3 = (-2.0 * edge + duration * (velocity + end)) / duration**3
        if k == 0:
            a[0] = 2.0 * c2
        inner = [dt * i for i in range(1, math.ceil(duration / dt - 1e-9))]
        for u in (*inner, duration):
            t.append(begin + u)
            p.append(at[k] + u * (velocity + u * (c2 + u * c3)))
            v.append(velocity + u * (2.0 * c2 + 3.0 * u * c3))
            a.append(2.0 * c2 + 6.0 * u * c3)
        p[-1] = at[k + 1]
        begin += duration
        velocity = end
    return Trajectory(np.array(t), np.array(p), np.array(v), np.array(a), frame, "poly_path")


def figure_eight(
    width: float = 3.0,
    height: float = 2.0,
    period: float = 10.0,
    *,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    plane: Literal["xy", "yz"] = "xy",
    loops: int = 1,
    dt: float = SAMPLE_S,
    frame: str = "map",
) -> Trajectory:
    """Return a figure of eight: width / 2 sin 2wt along the first axis, -height / 2 cos wt along the second, w = 2 pi / period.

    `plane` names the two axes; "yz" is that of the ROS tutorial node, which flies it. Lengths in m, `period` and `dt` in s.
    Raises InvalidTrajectoryError.
    """
    _require_positive(width=width, height=height, period=period)
    w = 2.0 * math.pi / period
    first, second = ("xyz".index(axis) for axis in plane)

    def curve(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        p, v, a = (np.zeros((len(t), 3)) for _ in range(3))
        p[:, first], p[:, second] = 0.5 * width * np.sin(2.0 * w * t), -0.5 * height * np.cos(w * t)
        v[:, first], v[:, second] = width * w * np.cos(2.0 * w * t), 0.5 * height * w * np.sin(w * t)
        a[:, first], a[:, second] = -2.0 * width * w * w * np.sin(2.0 * w * t), 0.5 * height * w * w * np.cos(w * t)
        return p + _vector(centre), v, a

    return sampled(curve, loops * period, dt, frame, "figure_eight")


def heart(
    size: float = 1.0,
    period: float = 10.0,
    *,
    centre: ArrayLike = (0.0, 0.0, 0.0),
    dt: float = SAMPLE_S,
    frame: str = "map",
) -> Trajectory:
    """Return a heart in the x-y plane: x = 1.6 cos wt - 1.2 cos 2wt, y = 1.9 sin wt - 0.95 sin 2wt, w = 2 pi / period.

    It begins and ends at rest in its notch, where the direction of motion turns by pi, so it is driven once. `size` scales it:
    size 1 is 3.7 m long and 4.2 m wide. Lengths in m, `period` and `dt` in s. Raises InvalidTrajectoryError.
    """
    _require_positive(size=size, period=period)
    w = 2.0 * math.pi / period

    def curve(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        p, v, a = (np.zeros((len(t), 3)) for _ in range(3))
        c1, s1, c2, s2 = np.cos(w * t), np.sin(w * t), np.cos(2.0 * w * t), np.sin(2.0 * w * t)
        p[:, 0], p[:, 1] = 1.6 * c1 - 1.2 * c2, 1.9 * s1 - 0.95 * s2
        v[:, 0], v[:, 1] = w * (-1.6 * s1 + 2.4 * s2), w * (1.9 * c1 - 1.9 * c2)
        a[:, 0], a[:, 1] = w * w * (-1.6 * c1 + 4.8 * c2), w * w * (-1.9 * s1 + 3.8 * s2)
        return size * p + _vector(centre), size * v, size * a

    return sampled(curve, period, dt, frame, "heart")


def sampled(curve: Curve, duration: float, dt: float, frame: str, name: str) -> Trajectory:
    """Return a trajectory with samples of `curve` every `dt` (s), and one at the end."""
    _require_step(dt)
    steps = max(1, math.ceil(duration / dt - 1e-9))
    t = np.minimum(np.arange(steps + 1) * dt, duration)
    return Trajectory(t, *curve(t), frame=frame, name=name)


def _points(points: ArrayLike) -> FloatArray:
    at = np.asarray(points, np.float64)
    if at.ndim != 2 or at.shape[0] < 2 or at.shape[1] not in (2, 3) or not np.isfinite(at).all():
        raise InvalidTrajectoryError(f"the points must be an array (n, 2) or (n, 3) of at least 2, not {at.shape}")
    return np.column_stack((at, np.zeros(len(at)))) if at.shape[1] == 2 else at


def _vector(value: ArrayLike) -> NDArray[np.float64]:
    """Return a vector (3,); z is 0 if it is missing."""
    vector = np.asarray(value, np.float64)
    if vector.shape not in ((2,), (3,)) or not np.isfinite(vector).all():
        raise InvalidTrajectoryError(f"{value} is not a vector of 2 or 3 numbers")
    return np.array([*vector, 0.0][:3])


def _require_positive(**values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InvalidTrajectoryError(f"{name} = {value:g} must be positive", argument=name, value=value)


def _require_step(dt: float) -> None:
    if not (math.isfinite(dt) and dt >= 1e-3):
        raise InvalidTrajectoryError(f"the time between samples, {dt:g} s, must be at least 0.001 s", dt=dt)

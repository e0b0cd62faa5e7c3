"""Timed trajectories: where a robot should be, and how fast, at each time; in closed form, and in files."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from navstack.behaviors.errors import InvalidTrajectoryError
from navstack.core import Pose2D, Transform2D, atomic_write, normalize_angle, read_bytes, short_repr

STANDING_M_S: Final = 1e-4
"""Below this speed the direction of motion is taken from the neighboring samples (m/s)."""

FloatArray = NDArray[np.float64]


class Reference(NamedTuple):
    """What a trajectory requires of a robot at one time, in the plane."""

    pose: Pose2D
    """Position (m) and direction of motion (rad), in the trajectory's frame."""
    speed: float
    """m/s along the heading."""
    turn_rate: float
    """rad/s."""
    acceleration: float
    """Rate of the speed (m/s²)."""


@dataclass(frozen=True, slots=True, eq=False)
class Trajectory:
    """Positions, velocities and accelerations of n times. The x-y part is followed; z is kept.

    Between samples the position is the cubic with the positions and velocities at both ends (Hermite), so it and the velocity
    are continuous. The heading is the direction of motion; where the trajectory stands, the one before or after.
    """

    t: FloatArray
    """(n,) times from the start (s), increasing, the first one 0."""
    position: FloatArray
    """(n, 3) m."""
    velocity: FloatArray
    """(n, 3) m/s."""
    acceleration: FloatArray
    """(n, 3) m/s². Information for others: between samples the second derivative of the cubic counts."""
    frame: str = "map"
    name: str = ""
    yaw: FloatArray = None  # type: ignore[assignment]
    """(n,) heading at each sample (rad, without jumps of a full turn); computed."""

    def __post_init__(self) -> None:
        n = self.t.shape[0] if self.t.ndim == 1 else 0
        if n < 2:
            raise InvalidTrajectoryError(f"a trajectory needs at least 2 samples, not {n}", samples=n)
        for what, array in (
            ("position", self.position),
            ("velocity", self.velocity),
            ("acceleration", self.acceleration),
        ):
            if array.shape != (n, 3):
                raise InvalidTrajectoryError(f"{what} has the shape {array.shape}, not ({n}, 3), for {n} times")
            bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
            if len(bad):
                raise InvalidTrajectoryError(f"{what} of sample {bad[0]} is not finite", sample=int(bad[0]))
        steps = np.diff(self.t)
        if not np.isfinite(self.t).all() or self.t[0] != 0.0 or not (steps > 0.0).all():
            raise InvalidTrajectoryError(
                "the times of a trajectory must increase from 0; "
                + (
                    f"the first is {self.t[0]:g} s"
                    if self.t[0] != 0.0
                    else f"sample {int(np.argmin(steps)) + 1} does not"
                )
            )
        if self.yaw is None:  # pyright: ignore[reportUnnecessaryComparison]
            object.__setattr__(self, "yaw", _headings(self))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def duration(self) -> float:
        """Time of the last sample (s)."""
        return float(self.t[-1])

    @property
    def length(self) -> float:
        """Length of the path in the plane (m), along chords between samples."""
        return float(np.hypot(*np.diff(self.position[:, :2], axis=0).T).sum())

    @property
    def start(self) -> Pose2D:
        """First pose."""
        return self.at(0.0).pose

    @property
    def end(self) -> Pose2D:
        """Last pose."""
        return self.at(self.duration).pose

    def at(self, time: float) -> Reference:
        """Return the reference at `time` (s). Before the start and after the end the trajectory stands."""
        inside = min(max(time, 0.0), self.duration)
        k = min(max(int(np.searchsorted(self.t, inside, side="right")) - 1, 0), len(self.t) - 2)
        p, v, a = self._cubic(k, inside)
        speed = math.hypot(v[0], v[1])
        share = (inside - float(self.t[k])) / float(self.t[k + 1] - self.t[k])
        if speed > STANDING_M_S:
            yaw = math.atan2(v[1], v[0])
            turn_rate = (v[0] * a[1] - v[1] * a[0]) / (speed * speed)
            acceleration = (v[0] * a[0] + v[1] * a[1]) / speed
        else:
            yaw = float(self.yaw[k] + share * (self.yaw[k + 1] - self.yaw[k]))
            turn_rate = float(self.yaw[k + 1] - self.yaw[k]) / float(self.t[k + 1] - self.t[k])
            acceleration = math.cos(yaw) * a[0] + math.sin(yaw) * a[1]
        pose = Pose2D(p[0], p[1], normalize_angle(yaw))
        if inside != time:
            return Reference(pose, 0.0, 0.0, 0.0)
        return Reference(pose, speed, turn_rate, acceleration)

    def poses(self, times: FloatArray) -> FloatArray:
        """Return (m, 3) poses x, y (m), yaw (rad) at times (m,) s."""
        inside = np.clip(times, 0.0, self.duration)
        k = np.clip(np.searchsorted(self.t, inside, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        u = (inside - self.t[k])[:, None] / h
        p0, p1 = self.position[k, :2], self.position[k + 1, :2]
        m0, m1 = h * self.velocity[k, :2], h * self.velocity[k + 1, :2]
        c2, c3 = 3.0 * (p1 - p0) - 2.0 * m0 - m1, 2.0 * (p0 - p1) + m0 + m1
        v = (m0 + u * (2.0 * c2 + 3.0 * u * c3)) / h
        out = np.empty((len(times), 3))
        out[:, :2] = p0 + u * (m0 + u * (c2 + u * c3))
        standing = self.yaw[k] + u[:, 0] * (self.yaw[k + 1] - self.yaw[k])
        yaw = np.where(np.hypot(v[:, 0], v[:, 1]) > STANDING_M_S, np.arctan2(v[:, 1], v[:, 0]), standing)
        out[:, 2] = -(np.remainder(np.pi - yaw, 2.0 * np.pi) - np.pi)
        return out

    def transformed(self, transform: Transform2D, frame: str) -> Trajectory:
        """Return the trajectory in `frame`; `transform` is the pose of this trajectory's frame in it."""
        c, s = math.cos(transform.yaw), math.sin(transform.yaw)
        rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([transform.x, transform.y, 0.0])
        return replace(
            self,
            position=self.position @ rotation.T + shift,
            velocity=self.velocity @ rotation.T,
            acceleration=self.acceleration @ rotation.T,
            frame=frame,
            yaw=self.yaw + transform.yaw,
        )

    def moved_to(self, pose: Pose2D, frame: str) -> Trajectory:
        """Return the trajectory moved and turned so that it begins at `pose` (m, rad) in `frame`."""
        to_start = Transform2D(*self.start).inverse()
        return self.transformed(Transform2D(*pose) @ to_start, frame)

    def slower(self, factor: float) -> Trajectory:
        """Return the trajectory in `factor` times the time: velocities divided by it, accelerations by its square."""
        if not (math.isfinite(factor) and factor > 0.0):
            raise InvalidTrajectoryError(f"the factor {factor:g} of the duration must be positive", factor=factor)
        return replace(
            self,
            t=self.t * factor,
            velocity=self.velocity / factor,
            acceleration=self.acceleration / (factor * factor),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data: name, frame and the arrays."""
        arrays = {key: getattr(self, key).tolist() for key in ("t", "position", "velocity", "acceleration")}
        return {"name": self.name, "frame": self.frame, **arrays}

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Trajectory:
        """Invert `as_dict`. Raises InvalidTrajectoryError."""
        try:
            arrays = [np.array(values[key], np.float64) for key in ("t", "position", "velocity", "acceleration")]
            return cls(*arrays, frame=str(values["frame"]), name=str(values.get("name", "")))
        except (KeyError, TypeError, ValueError) as exc:
            raise InvalidTrajectoryError(f"the stored trajectory is damaged ({exc})") from None

    def _cubic(self, k: int, time: float) -> tuple[list[float], list[float], list[float]]:
        """Return position, velocity and acceleration (x, y) of the cubic from sample k to k + 1 at `time` (s)."""
        h = float(self.t[k + 1] - self.t[k])
        u = (time - float(self.t[k])) / h
        out: tuple[list[float], list[float], list[float]] = ([], [], [])
        for axis in (0, 1):
            p0, p1 = float(self.position[k, axis]), float(self.position[k + 1, axis])
            m0, m1 = h * float(self.velocity[k, axis]), h * float(self.velocity[k + 1, axis])
            c2 = 3.0 * (p1 - p0) - 2.0 * m0 - m1
            c3 = 2.0 * (p0 - p1) + m0 + m1
            out[0].append(p0 + u * (m0 + u * (c2 + u * c3)))
            out[1].append((m0 + u * (2.0 * c2 + 3.0 * u * c3)) / h)
            out[2].append((2.0 * c2 + 6.0 * u * c3) / (h * h))
        return out


def _headings(trajectory: Trajectory) -> FloatArray:
    """Return the heading at each sample: of the velocity, or where it stands of the motion after or before it."""
    v, a, p = trajectory.velocity, trajectory.acceleration, trajectory.position
    n = len(trajectory)
    moving = np.hypot(v[:, 0], v[:, 1]) > STANDING_M_S
    yaw = np.arctan2(v[:, 1], v[:, 0])
    for k in np.flatnonzero(~moving).tolist():
        after = next((j for j in range(k + 1, n) if moving[j]), None)
        before = next((j for j in range(k - 1, -1, -1) if moving[j]), None)
        # the limit of the direction of motion at a standstill is that of the acceleration, or against it at the end
        if after == k + 1 and np.hypot(a[k, 0], a[k, 1]) > 1e-6 and a[k, :2] @ v[after, :2] > 0.0:
            yaw[k] = math.atan2(a[k, 1], a[k, 0])
        elif before == k - 1 and np.hypot(a[k, 0], a[k, 1]) > 1e-6 and a[k, :2] @ v[before, :2] < 0.0:
            yaw[k] = math.atan2(-a[k, 1], -a[k, 0])
        elif after is not None or before is not None:
            yaw[k] = yaw[after if after is not None else before]  # type: ignore[index]
        else:
            d = p[-1] - p[0]
            yaw[k] = math.atan2(d[1], d[0]) if np.hypot(d[0], d[1]) > 0.0 else 0.0
    return np.unwrap(yaw)


# --- shapes: piecewise cubic through points, figure of eight, heart ---------------------------------------------------

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
    timed trajectories. ROS differs: there corners and the last point have no sample, and equal neighbors divide by zero.

    Raises InvalidTrajectoryError for fewer than two points, equal neighbors, or a speed that is not positive.
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
        ends[-1] = _vector_of(end_velocity)
    t, p, v, a = [0.0], [at[0]], [_vector_of(start_velocity)], [np.zeros(3)]
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
    center: ArrayLike = (0.0, 0.0, 0.0),
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
        return p + _vector_of(center), v, a

    return sampled(curve, loops * period, dt, frame, "figure_eight")


def heart(
    size: float = 1.0,
    period: float = 10.0,
    *,
    center: ArrayLike = (0.0, 0.0, 0.0),
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
        return size * p + _vector_of(center), size * v, size * a

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


def _vector_of(value: ArrayLike) -> NDArray[np.float64]:
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


# --- files: YAML or JSON of the shape of trajectory_msgs/MultiDOFJointTrajectory, and CSV -----------------------------

MAX_BYTES: Final = 20_000_000
"""Largest file that is read."""
MAX_SAMPLES: Final = 200_000
JOINT: Final = "robot_link"
"""Name of the joint, as in the ROS tutorial node."""
COLUMNS: Final = ("t", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az")
"""Columns of a CSV file; t, x and y are required."""


def as_message(trajectory: Trajectory) -> dict[str, Any]:
    """Return a mapping with the fields of a MultiDOFJointTrajectory: one joint, rotations identity, as the ROS tutorial sends."""
    points: list[dict[str, Any]] = []
    for t, p, v, a in zip(trajectory.t, trajectory.position, trajectory.velocity, trajectory.acceleration):
        seconds, nanoseconds = divmod(round(float(t) * 1e9), 1_000_000_000)
        points.append(
            {
                "transforms": [{"translation": _xyz(p), "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}}],
                "velocities": [{"linear": _xyz(v), "angular": _xyz(np.zeros(3))}],
                "accelerations": [{"linear": _xyz(a), "angular": _xyz(np.zeros(3))}],
                "time_from_start": {"secs": seconds, "nsecs": nanoseconds},
            }
        )
    header = {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": trajectory.frame}
    return {"header": header, "joint_names": [JOINT], "points": points}


def from_message(message: Any, name: str = "") -> Trajectory:
    """Return the trajectory of a mapping with the fields of a MultiDOFJointTrajectory; its first joint counts.

    Times are `{secs, nsecs}` (ROS 1), `{sec, nanosec}` (ROS 2) or seconds; the first one becomes 0. Missing velocities are those
    of a cubic spline through the positions. Raises InvalidTrajectoryError.
    """
    if not isinstance(message, Mapping) or not isinstance(message.get("points"), list):
        raise InvalidTrajectoryError("a trajectory is a mapping with a list `points` (MultiDOFJointTrajectory)")
    points: list[Any] = message["points"]
    if not 2 <= len(points) <= MAX_SAMPLES:
        raise InvalidTrajectoryError(f"a trajectory has 2 to {MAX_SAMPLES} points, not {len(points)}")
    header = message.get("header")
    frame = str(header.get("frame_id") or "map") if isinstance(header, Mapping) else "map"
    rows = [_point(point, k) for k, point in enumerate(points)]
    t = np.array([row[0] for row in rows])
    given = [[row[i] for row in rows] for i in (1, 2, 3)]
    velocity, acceleration = (None if None in column else np.array(column) for column in given[1:])
    return from_arrays(t, np.array(given[0]), velocity, acceleration, frame=frame, name=name)


def from_arrays(
    t: FloatArray,
    position: FloatArray,
    velocity: FloatArray | None = None,
    acceleration: FloatArray | None = None,
    *,
    frame: str = "map",
    name: str = "",
) -> Trajectory:
    """Return a trajectory from times (n,) s and positions (n, 2 or 3) m; the first time becomes 0.

    Missing velocities and accelerations are those of a cubic spline through the positions (velocities, if given). Raises
    InvalidTrajectoryError.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    if position.ndim != 2 or len(t) < 2 or len(position) != len(t) or not (np.diff(t) > 0.0).all():
        bad = int(np.argmin(np.diff(t) > 0.0)) + 1 if len(t) > 1 else 0
        raise InvalidTrajectoryError(f"the times of a trajectory must increase; sample {bad + 1} does not", sample=bad)
    if not (np.isfinite(t).all() and np.isfinite(position).all()):
        raise InvalidTrajectoryError("the times and positions of a trajectory must be finite")
    arrays = [None if a is None else _three_columns(a) for a in (position, velocity, acceleration)]
    p, v, a = arrays
    assert p is not None
    t = t - t[0]
    if v is None:
        spline = CubicSpline(t, p, bc_type="natural" if len(t) > 2 else "clamped") if len(t) > 2 else None
        v = np.asarray(spline(t, 1)) if spline is not None else np.repeat((p[1:] - p[:1]) / t[1], 2, axis=0)
    if a is None:
        a = np.asarray(CubicHermiteSpline(t, p, v)(t, 2))
    return Trajectory(t, p, v, a, frame, name)


def load_trajectory(path: str | Path) -> Trajectory:
    """Read a trajectory: .csv with a header (t, x, y; z, vx .. az if known), YAML or JSON of a MultiDOFJointTrajectory.

    Raises InvalidTrajectoryError, whose message begins with the file.
    """
    file = Path(path)
    try:
        text = read_bytes(file, MAX_BYTES).decode("utf-8")
    except OSError as exc:
        raise InvalidTrajectoryError(f"cannot read {file}: {exc.strerror or exc}", path=str(file)) from exc
    except UnicodeDecodeError as exc:
        raise InvalidTrajectoryError(f"{file} is not a text file (UTF-8)", path=str(file)) from exc
    try:
        if file.suffix.lower() == ".csv":
            return _from_csv(text, file.stem)
        return from_message(_parsed(text, file.suffix.lower()), file.stem)
    except InvalidTrajectoryError as exc:
        raise InvalidTrajectoryError(f"{file}: {exc.message}", **exc.data, path=str(file)) from exc


def save_trajectory(trajectory: Trajectory, path: str | Path) -> Path:
    """Write a trajectory to .csv, .json, .yaml or .yml, atomically; return the file.

    Raises OutputError, and InvalidTrajectoryError for another suffix.
    """
    file = Path(path)
    kind = file.suffix.lower()
    if kind == ".csv":
        out = io.StringIO()
        rows = np.column_stack((trajectory.t, trajectory.position, trajectory.velocity, trajectory.acceleration))
        writer = csv.writer(out, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(rows.tolist())
        text = out.getvalue()
    elif kind == ".json":
        text = json.dumps(as_message(trajectory), allow_nan=False) + "\n"
    elif kind in (".yaml", ".yml"):
        text = yaml.dump(as_message(trajectory), Dumper=yaml.SafeDumper, sort_keys=False, default_flow_style=None)
    else:
        raise InvalidTrajectoryError(f'cannot write a trajectory to "{file.name}"; use .yaml, .json or .csv')
    with atomic_write(file) as beside:
        beside.write_text(text, encoding="utf-8")
    return file


def _parsed(text: str, suffix: str) -> Any:
    try:
        if suffix == ".json":
            return json.loads(text)
        loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        return yaml.load(text, Loader=loader)
    except (yaml.YAMLError, ValueError, RecursionError) as exc:
        reason = " ".join(str(exc).split())[:200]
        raise InvalidTrajectoryError(f"neither YAML nor JSON ({reason})") from exc


def _from_csv(text: str, name: str) -> Trajectory:
    rows = [row for row in csv.reader(text.splitlines()) if row and not row[0].lstrip().startswith("#")]
    header = [cell.strip() for cell in rows[0]] if rows else []
    unknown = [cell for cell in header if cell not in COLUMNS]
    if unknown or not {"t", "x", "y"} <= set(header) or len(set(header)) != len(header):
        raise InvalidTrajectoryError(
            f"the first line {short_repr(header)} is not a header of columns {', '.join(COLUMNS)} (t, x, y are required)"
        )
    if len(rows) - 1 > MAX_SAMPLES:
        raise InvalidTrajectoryError(f"more than {MAX_SAMPLES} samples")
    values: list[list[float]] = []
    for number, row in enumerate(rows[1:], 2):
        try:
            values.append([float(cell) for cell in row])
        except ValueError:
            raise InvalidTrajectoryError(f"row {number}: {short_repr(row)} are not numbers", row=number) from None
        if len(row) != len(header):
            raise InvalidTrajectoryError(f"row {number} has {len(row)} numbers instead of {len(header)}", row=number)
    table = np.array(values, np.float64).reshape(-1, len(header))
    columns = dict(zip(header, table.T))

    def triple(first: str, *others: str) -> FloatArray | None:
        if first not in columns:
            return None
        return np.column_stack([columns.get(key, np.zeros(len(table))) for key in (first, *others)])

    position = triple("x", "y", "z")
    assert position is not None
    return from_arrays(
        columns["t"], position, triple("vx", "vy", "vz"), triple("ax", "ay", "az"), frame="map", name=name
    )


# --- fields -----------------------------------------------------------------------------------------------------------


def _xyz(vector: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", (float(v) for v in vector)))


def _point(point: Any, number: int) -> tuple[float, list[float], list[float] | None, list[float] | None]:
    """Return time, position, velocity and acceleration of the first joint of a point; None for what is missing."""
    where = f"points[{number}]"
    if not isinstance(point, Mapping):
        raise InvalidTrajectoryError(f"{where} is {short_repr(point)}, not a mapping", point=number)
    transform = _first(point, "transforms", where)
    if transform is None:
        raise InvalidTrajectoryError(f"{where} has no transforms", point=number)
    position = _vector_in(transform.get("translation"), f"{where}.transforms[0].translation")
    found: list[list[float] | None] = []
    for key in ("velocities", "accelerations"):
        entry = _first(point, key, where)
        found.append(None if entry is None else _vector_in(entry.get("linear"), f"{where}.{key}[0].linear"))
    return _seconds(point.get("time_from_start"), where), position, found[0], found[1]


def _first(point: Mapping[str, Any], key: str, where: str) -> Mapping[str, Any] | None:
    entries = point.get(key)
    if entries is None or entries == []:
        return None
    if not isinstance(entries, list) or not isinstance(entries[0], Mapping):
        raise InvalidTrajectoryError(f"{where}.{key} is {short_repr(entries)}, not a list of mappings")
    return entries[0]


def _vector_in(value: Any, where: str) -> list[float]:
    if not isinstance(value, Mapping):
        raise InvalidTrajectoryError(f"{where} is {short_repr(value)}, not {{x, y, z}}")
    return [_number(value.get(axis, 0.0), f"{where}.{axis}") for axis in "xyz"]


def _seconds(value: Any, where: str) -> float:
    if isinstance(value, Mapping):
        for whole, part in (("secs", "nsecs"), ("sec", "nanosec")):
            if whole in value:
                seconds = _number(value[whole], f"{where}.time_from_start.{whole}")
                return seconds + 1e-9 * _number(value.get(part, 0), f"{where}.time_from_start.{part}")
    return _number(value, f"{where}.time_from_start")


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < 1e12:
        raise InvalidTrajectoryError(f"{where} is {short_repr(value)}, not a finite number")
    return float(value)


def _three_columns(array: FloatArray) -> FloatArray:
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise InvalidTrajectoryError(f"an array of a trajectory has the shape {array.shape}, not (n, 2) or (n, 3)")
    return np.column_stack((array, np.zeros(len(array)))) if array.shape[1] == 2 else array

"""Timed trajectories: where a robot should be, and how fast, at each time."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D, normalize_angle
from navstack.motion.errors import InvalidTrajectoryError

STANDING_M_S: Final = 1e-4
"""Below this speed the direction of motion is taken from the neighbouring samples (m/s)."""

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

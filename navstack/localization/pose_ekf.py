"""The filter of robot_pose_ekf: odometry and an inertial sensor, each by its motion since the last estimate.

For the record of an old robot, and for comparisons: its covariance says how good the last step was, not how far the pose has
drifted (the parity page explains it). `Ekf` is the filter to use.
"""

from __future__ import annotations

import bisect
import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

# ----------------------------------------------------------------------------------------------------------------------
# Rotations in space, for the inertial sensor's roll and pitch: quaternions (x, y, z, w) and angles (roll, pitch, yaw; rad).


Array = NDArray[np.float64]


def quaternion(roll: float, pitch: float, yaw: float) -> Array:
    """Return the quaternion (4,) of the rotation about the fixed axes x, y, z by roll, pitch and yaw."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def angles(q: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a unit quaternion."""
    x, y, z, w = q.tolist()
    sine = max(-1.0, min(1.0, 2.0 * (w * y - z * x)))
    return (
        math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
        math.asin(sine),
        math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
    )


def product(a: Array, b: Array) -> Array:
    """Return the quaternion of the rotation `b` followed by `a`."""
    ax, ay, az, aw = a.tolist()
    bx, by, bz, bw = b.tolist()
    return np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    )


def conjugate(q: Array) -> Array:
    """Return the inverse rotation."""
    return q * (-1.0, -1.0, -1.0, 1.0)


def rotate(q: Array, v: Array) -> Array:
    """Return the vector `v` (3,) rotated by `q`."""
    return product(product(q, np.append(v, 0.0)), conjugate(q))[:3]


def slerp(a: Array, b: Array, share: float) -> Array:
    """Return the rotation at `share` of the shorter way from `a` to `b`."""
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    angle = math.acos(min(cosine, 1.0))
    if angle < 1e-9:
        mixed = (1.0 - share) * a + share * b
        return mixed / math.sqrt(float(mixed @ mixed))
    sine = math.sin(angle)
    return (math.sin((1.0 - share) * angle) * a + math.sin(share * angle) * b) / sine


class Frame(NamedTuple):
    """A frame in space: origin (3,) and rotation (4,)."""

    origin: Array
    rotation: Array

    @classmethod
    def of(cls, state: Array) -> Frame:
        """Return the frame of x, y, z, roll, pitch, yaw."""
        x, y, z, roll, pitch, yaw = state.tolist()
        return cls(np.array([x, y, z]), quaternion(roll, pitch, yaw))

    def __matmul__(self, other: Frame) -> Frame:
        """Compose: `A<-B @ B<-C = A<-C`."""
        return Frame(self.origin + rotate(self.rotation, other.origin), product(self.rotation, other.rotation))

    def inverse(self) -> Frame:
        """Return the opposite transform."""
        back = conjugate(self.rotation)
        return Frame(-rotate(back, self.origin), back)

    def toward(self, other: Frame, share: float) -> Frame:
        """Return the frame at `share` of the way to `other`."""
        origin = self.origin + share * (other.origin - self.origin)
        return Frame(origin, slerp(self.rotation, other.rotation, share))


START_VARIANCE: Final = 0.001**2
SYSTEM_NOISE: Final = 1000.0**2
HISTORY_S: Final = 10.0
LARGEST: Final = 1e7
MAX_YAW_RATE_DIFFERENCE: Final = 0.3
ODOMETRY_ROWS: Final = (0, 1, 5)
IMU_ROWS: Final = (3, 4, 5)


class PoseStep(NamedTuple):
    """An estimate of `RobotPoseEkf`."""

    stamp: float
    state: Array
    """(6,) x, y, z, roll, pitch, yaw; yaw is not wrapped."""
    covariance: Array
    """(6, 6)."""
    odometry: bool
    """The odometry was active."""
    imu: bool
    sensors_agree: bool
    """The turns of odometry and IMU differ by less than 0.3 rad/s."""


class _Sensor:
    """The messages of one sensor and whether it takes part."""

    def __init__(self) -> None:
        self.stamps: list[float] = []
        self.frames: list[Frame] = []
        self.covariance = np.zeros((0, 0))
        self.active = False
        self.first: float | None = None
        self.received = -math.inf
        self.last: Frame | None = None
        """The interpolated frame of the last estimate."""

    def add(self, stamp: float, frame: Frame, covariance: Array, now: float, clock: float) -> None:
        self.stamps.append(stamp)
        self.frames.append(frame)
        self.covariance = covariance
        self.received = now
        while self.stamps[-1] - self.stamps[0] > HISTORY_S:
            del self.stamps[0], self.frames[0]
        if not self.active:
            self.first = stamp if self.first is None else self.first
            if clock >= self.first:
                self.active, self.first = True, None

    def expire(self, now: float, timeout: float) -> None:
        if (self.active or self.first is not None) and now - self.received > timeout:
            self.active, self.first = False, None

    def at(self, stamp: float) -> Frame | None:
        """Return the interpolated frame; None outside of the messages."""
        if not self.stamps or not self.stamps[0] <= stamp <= self.stamps[-1]:
            return None
        after = bisect.bisect_left(self.stamps, stamp)
        if self.stamps[after] == stamp:
            return self.frames[after]
        begin, end = self.stamps[after - 1], self.stamps[after]
        share = (stamp - begin) / (end - begin)
        # the node stores the inverse transforms, so these are interpolated: in a turn the path bends twice as much as its arc
        return self.frames[after - 1].inverse().toward(self.frames[after].inverse(), share).inverse()


class RobotPoseEkf:
    """The filter, called as the node calls it: messages as they arrive, `step` at a fixed rate.

    ros-planning/robot_pose_ekf fd6cef32. Messages that are not finite, are not newer than the last, or have a zero variance are
    rejected with a reason.
    """

    def __init__(self, *, sensor_timeout: float = 1.0) -> None:
        self._timeout = sensor_timeout
        self._odometry, self._imu = _Sensor(), _Sensor()
        self._clock = -math.inf
        self._stamp = -math.inf
        self._state = np.zeros(6)
        self._covariance = np.zeros((6, 6))
        self._started = False
        self._yaws: list[float | None] = [None, None]
        self.rejections: list[tuple[float, str]] = []

    def add_odometry(self, stamp: float, pose: Array, covariance: Array, now: float) -> bool:
        """Take a pose (3,) x, y, yaw with its covariance (3, 3), received at `now` (s). Return False if it is rejected."""
        x, y, yaw = np.asarray(pose, np.float64).tolist()
        values = np.array([x, y, 0.0, 0.0, 0.0, yaw])
        return self._add(self._odometry, "odometry", stamp, values, covariance, now)

    def add_imu(self, stamp: float, orientation: Array, covariance: Array, now: float) -> bool:
        """Take roll, pitch, yaw (3,) with their covariance (3, 3). Return False if they are rejected."""
        values = np.concatenate((np.zeros(3), np.asarray(orientation, np.float64)))
        return self._add(self._imu, "IMU", stamp, values, covariance, now)

    def _add(self, sensor: _Sensor, name: str, stamp: float, values: Array, covariance: Array, now: float) -> bool:
        reason = ""
        matrix = np.asarray(covariance, np.float64)
        if not (math.isfinite(stamp) and math.isfinite(now) and np.isfinite(values).all()):
            reason = f"the {name} at {stamp} s is not finite"
        elif np.abs(values).max() > LARGEST:
            reason = f"the {name} at {stamp} s has the value {np.abs(values).max():.3g}, beyond {LARGEST:.0e}"
        elif not np.isfinite(matrix).all() or (np.diag(matrix) <= 0.0).any():
            reason = f"the {name} at {stamp} s has a variance that is not positive"
        elif sensor.stamps and stamp <= sensor.stamps[-1]:
            reason = f"the {name} at {stamp} s is not newer than the last one, at {sensor.stamps[-1]} s"
        if reason:
            self.rejections.append((stamp, reason))
            return False
        sensor.add(round(stamp, 9), Frame.of(values), matrix, now, self._clock)
        return True

    def step(self, now: float) -> PoseStep | None:
        """Estimate at the newest time that all active sensors have reached; None if there is nothing new."""
        odometry, imu = self._odometry, self._imu
        odometry.expire(now, self._timeout)
        imu.expire(now, self._timeout)
        active = [s for s in (odometry, imu) if s.active]
        # stamps are whole nanoseconds, as in ROS: two that differ by a rounding error are the same
        self._clock = min([round(now, 9), *(s.stamps[-1] for s in active)])
        if not active:
            return None
        if self._started:
            return self._update(self._clock)
        if not odometry.active:
            return None  # an inertial sensor alone has no position to start from
        self._state = np.concatenate((odometry.frames[-1].origin, angles(odometry.frames[-1].rotation)))
        self._covariance = START_VARIANCE * np.eye(6)
        self._stamp = odometry.stamps[-1]
        self._started = True
        return self._result(agree=True)

    def _update(self, stamp: float) -> PoseStep | None:
        dt = stamp - self._stamp
        if dt <= 0.0:
            return None
        odometry, imu = self._odometry, self._imu
        frames = [s.at(stamp) if s.active else None for s in (odometry, imu)]
        if any(s.active and f is None for s, f in zip((odometry, imu), frames, strict=True)):
            return None
        last = Frame.of(self._state)
        planar = Frame.of(self._state * (1.0, 1.0, 1.0, 0.0, 0.0, 1.0))
        before = float(self._state[5])
        self._covariance = self._covariance + SYSTEM_NOISE * np.eye(6)
        for sensor, frame, base, rows in zip(
            (odometry, imu), frames, (planar, last), (ODOMETRY_ROWS, IMU_ROWS), strict=True
        ):
            if frame is None:
                sensor.last = None if not sensor.active else sensor.last
                continue
            if sensor.last is not None:
                moved = base @ sensor.last.inverse() @ frame
                _, _, yaw = angles(moved.rotation)
                yaw = before + math.remainder(yaw - before, 2.0 * math.pi)
                self._yaws[sensor is imu] = yaw
                head = moved.origin[:2].tolist() if sensor is odometry else list(angles(frame.rotation)[:2])
                self._correct(rows, np.array([*head, yaw]), sensor.covariance * dt * dt)
            sensor.last = frame
        self._stamp = stamp
        return self._result(self._agree(dt))

    def _agree(self, dt: float) -> bool:
        """Return False if the last yaws of both sensors differ too much; in a sensor's first cycle its yaw is an old one."""
        if dt <= 0.01 or not (self._odometry.active and self._imu.active) or None in self._yaws:
            return True
        odometry, imu = (yaw or 0.0 for yaw in self._yaws)
        return abs(odometry - imu) / dt <= MAX_YAW_RATE_DIFFERENCE

    def _correct(self, rows: tuple[int, ...], measured: Array, noise: Array) -> None:
        index = np.array(rows)
        p = self._covariance[:, index]
        gain = p @ np.linalg.inv(p[index] + noise)
        self._state = self._state + gain @ (measured - self._state[index])
        # as the node's filter, not Joseph's form: the prior of 1e6 quantizes the result to 1e-10, and the next weights with it
        covariance = self._covariance - gain @ self._covariance[index]
        self._covariance = 0.5 * (covariance + covariance.T)

    def _result(self, agree: bool) -> PoseStep:
        state, covariance = self._state.copy(), self._covariance.copy()
        return PoseStep(self._stamp, state, covariance, self._odometry.active, self._imu.active, agree)

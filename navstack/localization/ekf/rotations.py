"""Rotations in space, for the inertial sensor's roll and pitch: quaternions (x, y, z, w) and angles (roll, pitch, yaw; rad)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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

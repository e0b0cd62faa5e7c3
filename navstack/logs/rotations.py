"""Quaternions of messages and headings of planar frames, without loss where that is possible."""

from __future__ import annotations

import math
from itertools import product
from typing import NamedTuple

from navstack.core import normalize_angle


class Quaternion(NamedTuple):
    """A rotation as in geometry_msgs/Quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0

    @property
    def yaw(self) -> float:
        """Heading (rad) in (-pi, pi], of the rotated x axis in the plane."""
        x, y, z, w = self
        if x == 0.0 and y == 0.0:
            return normalize_angle(2.0 * math.atan2(z, w))
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def is_valid(self) -> bool:
        """True if it is finite and not zero."""
        return 1e-6 < math.hypot(*self) < 1e6

    def normalized(self) -> Quaternion:
        """Return the unit quaternion; one that is a unit quaternion up to rounding is returned as it is."""
        x, y, z, w = self
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if abs(norm - 1.0) < 1e-12:
            return self
        return Quaternion(x / norm, y / norm, z / norm, w / norm)


def quaternion_of_yaw(yaw: float) -> Quaternion:
    """Return a quaternion whose `yaw` is exactly `yaw` (rad, in (-pi, pi], zero or at least 1e-300).

    sin and cos of half the angle lose the last bit, which can decide whether a ray ends in one cell or in the next; a change
    of z and w by a unit or two in the last place restores it.
    """
    z, w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
    first = Quaternion(0.0, 0.0, z, w)
    if first.yaw == yaw:
        return first
    for reach in (1, 2, 4):
        zs, ws = _near(z, reach), _near(w, reach)
        for near_z, near_w in product(zs, ws):
            candidate = Quaternion(0.0, 0.0, near_z, near_w)
            if candidate.yaw == yaw:
                return candidate
    return first


def _near(value: float, reach: int) -> list[float]:
    """Return the value and its neighbors, up to `reach` floats away."""
    found = [value]
    up = down = value
    for _ in range(reach):
        up, down = math.nextafter(up, math.inf), math.nextafter(down, -math.inf)
        found += [up, down]
    return found


class Transform3D(NamedTuple):
    """A pose in space: translation (m) and rotation."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    rotation: Quaternion = Quaternion()

    @property
    def tilt(self) -> float:
        """Angle (rad) between the frame's z axis and the vertical line, in [0, pi]."""
        x, y, _, _ = self.rotation
        return 2.0 * math.asin(min(1.0, math.hypot(x, y)))

    def __matmul__(self, other: Transform3D) -> Transform3D:
        """Compose transforms: `A<-B @ B<-C = A<-C`."""
        x, y, z = rotate(self.rotation, (other.x, other.y, other.z))
        return Transform3D(self.x + x, self.y + y, self.z + z, multiply(self.rotation, other.rotation))


def multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    """Return the rotation `b` followed by `a`."""
    return Quaternion(
        a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
        a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
        a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w,
        a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z,
    )


def rotate(rotation: Quaternion, point: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the rotated point."""
    x, y, z, w = rotation
    px, py, pz = point
    # twice the cross product of the vector part with the point
    tx, ty, tz = 2.0 * (y * pz - z * py), 2.0 * (z * px - x * pz), 2.0 * (x * py - y * px)
    return px + w * tx + y * tz - z * ty, py + w * ty + z * tx - x * tz, pz + w * tz + x * ty - y * tx

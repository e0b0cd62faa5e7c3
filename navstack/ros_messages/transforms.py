"""Poses in space: quaternions of messages, headings without loss where that is possible, and the tf tree of a robot.

The tree is projected to the planar frames of navstack. A sensor's static transforms are composed in space, up to the first frame
that moves: an upside-down lidar or the optical frame of a camera then has the right place, heading and height.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import FrameTree, Transform2D, normalize_angle


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


# --- the tf tree ------------------------------------------------------------------------------------------------------


class StampedTransform(NamedTuple):
    """A transform of /tf: the pose of `child` in `parent`, at `stamp` (s)."""

    parent: str
    child: str
    stamp: float
    transform: Transform3D


LEVEL: Final = 0.02
"""Largest tilt (rad) of a sensor that counts as level."""
SAME_HEIGHT_M: Final = 0.001
"""Changes of the height of a frame on /tf below this are noise."""


class Mounting(NamedTuple):
    """How a static frame is mounted on the frame that moves: `frame` there, and what the plane does not show."""

    parent: str
    planar: Transform2D
    height: float
    level: Quaternion
    """Rotation from the frame to a level frame with the same heading."""
    tilt: float
    """Angle (rad) between the frame's z axis and the vertical line."""

    def leveled(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return points (n, 3) of the frame in a level frame at its place, with z above the ground."""
        if self.tilt == 0.0:
            found = points.copy()
        else:
            axes = [rotate(self.level, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
            found = (points.astype(np.float64) @ np.array(axes)).astype(np.float32)
        found[:, 2] += np.float32(self.height)
        return found


_LEVEL_MOUNTING: Final = Mounting("", Transform2D(), 0.0, Quaternion(), 0.0)


class TransformTree:
    """Collects transforms and keeps a `FrameTree` up to date."""

    def __init__(self, frames: FrameTree) -> None:
        self.frames = frames
        self.parents: dict[str, str] = {}
        """Parent of each frame."""
        self._static: dict[str, tuple[str, Transform3D]] = {}
        self._raised: dict[str, Transform3D] = {}
        """Frames of /tf that are not level on their parents: static_transform_publisher of tf publishes sensors there."""
        self._mountings: dict[str, Mounting] = {}

    def add_static(self, transforms: list[StampedTransform]) -> None:
        """Add transforms of /tf_static. Raises FrameError for a cycle."""
        for item in transforms:
            self._static[item.child] = item.parent, item.transform
            self.parents[item.child] = item.parent
        self._mountings.clear()
        for child in self._static:
            mounting = self.mounting(child)
            self.frames.set_static(mounting.parent, child, mounting.planar)

    def forget_moving(self) -> None:
        """Clear the transforms of /tf."""
        for child in [child for child in self.parents if child not in self._static]:
            del self.parents[child]
            self.frames.remove(child)
        self._raised.clear()
        self._mountings.clear()

    def add(self, transforms: list[StampedTransform]) -> None:
        """Add transforms of /tf. Raises FrameError for a cycle."""
        for item in transforms:
            self.parents[item.child] = item.parent
            at = item.transform
            if at.z != 0.0 or at.rotation.x != 0.0 or at.rotation.y != 0.0 or item.child in self._raised:
                self._raise(item.child, at)
            self.frames.set(item.parent, item.child, Transform2D(at.x, at.y, at.rotation.yaw), item.stamp)

    def _raise(self, child: str, at: Transform3D) -> None:
        """Note the height and the tilt of a frame of /tf, if they are new."""
        if at.tilt < LEVEL:
            at = at._replace(rotation=quaternion_of_yaw(at.rotation.yaw))
        old = self._raised.get(child)
        if old is None or abs(old.z - at.z) > SAME_HEIGHT_M or abs(old.tilt - at.tilt) > LEVEL:
            self._raised[child] = at
            self._mountings.clear()

    def mounting(self, frame: str) -> Mounting:
        """Return how a frame is mounted; level and on the ground if nothing else is known."""
        found = self._mountings.get(frame)
        if found is None:
            found = self._mountings[frame] = self._mounting(frame)
        return found

    def _mounting(self, frame: str) -> Mounting:
        parent, fixed = frame, Transform3D()
        seen = {frame}
        while parent in self._static:
            above, at = self._static[parent]
            fixed = at @ fixed
            parent = above
            if parent in seen:
                break
            seen.add(parent)
        whole = self._above(parent) @ fixed
        if parent == frame and whole == Transform3D():
            return _LEVEL_MOUNTING
        planar = Transform2D(fixed.x, fixed.y, fixed.rotation.yaw)
        if whole.tilt == 0.0:
            return Mounting(parent, planar, whole.z, Quaternion(), 0.0)
        heading = quaternion_of_yaw(-whole.rotation.yaw)
        return Mounting(parent, planar, whole.z, multiply(heading, whole.rotation), whole.tilt)

    def _above(self, frame: str) -> Transform3D:
        """Return the height and the tilt of a frame that moves, above the ground; its place in the plane does not count."""
        found, seen = Transform3D(), {frame}
        while True:
            if frame in self._raised:
                found = self._raised[frame] @ found
            elif frame in self._static:
                found = self._static[frame][1] @ found
            frame = self.parents.get(frame, "")
            if not frame or frame in seen:
                return found
            seen.add(frame)

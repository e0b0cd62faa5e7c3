"""The tf tree of a log, in space, and its projection to the planar frames of navstack.

A sensor's static transforms are composed in space, up to the first frame that moves: an upside-down lidar or the optical frame
of a camera then has the right place, heading and height.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import FrameTree, Transform2D
from navstack.logs.messages import StampedTransform
from navstack.logs.rotations import Quaternion, Transform3D, multiply, quaternion_of_yaw, rotate

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

    def levelled(self, points: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return points (n, 3) of the frame in a level frame at its place, with z above the ground."""
        if self.tilt == 0.0:
            found = points.copy()
        else:
            axes = [rotate(self.level, axis) for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))]
            found = (points.astype(np.float64) @ np.array(axes)).astype(np.float32)
        found[:, 2] += np.float32(self.height)
        return found


_LEVEL_MOUNTING: Final = Mounting("", Transform2D(), 0.0, Quaternion(), 0.0)


class LoggedFrames:
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

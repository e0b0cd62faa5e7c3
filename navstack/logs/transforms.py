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

    def add(self, transforms: list[StampedTransform]) -> None:
        """Add transforms of /tf. Raises FrameError for a cycle."""
        for item in transforms:
            self.parents[item.child] = item.parent
            planar = item.transform
            self.frames.set(item.parent, item.child, Transform2D(planar.x, planar.y, planar.rotation.yaw), item.stamp)

    def mounting(self, frame: str) -> Mounting:
        """Return how a frame is mounted; level and on the ground if it is not static."""
        found = self._mountings.get(frame)
        if found is None:
            found = self._mountings[frame] = self._mounting(frame)
        return found

    def _mounting(self, frame: str) -> Mounting:
        if frame not in self._static:
            return _LEVEL_MOUNTING
        parent, transform = self._static[frame]
        seen = {frame}
        while parent in self._static and parent not in seen:
            seen.add(parent)
            parent, above = self._static[parent]
            transform = above @ transform
        yaw = transform.rotation.yaw
        planar = Transform2D(transform.x, transform.y, yaw)
        tilt = transform.tilt
        if tilt == 0.0:
            return Mounting(parent, planar, transform.z, Quaternion(), 0.0)
        heading = quaternion_of_yaw(-yaw)
        return Mounting(parent, planar, transform.z, multiply(heading, transform.rotation), tilt)

"""Poses, velocities and rigid transforms in the plane. Meters, radians, counter-clockwise."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core.angles import normalize_angle, normalize_angles


class Pose2D(NamedTuple):
    """Position (m) and heading (rad) in a frame."""

    x: float
    y: float
    yaw: float = 0.0

    def distance_to(self, other: Pose2D) -> float:
        """Return the Euclidean distance between the two positions (m)."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def is_finite(self) -> bool:
        """Return False if a coordinate is NaN or infinite."""
        return math.isfinite(self.x) and math.isfinite(self.y) and math.isfinite(self.yaw)


class Twist2D(NamedTuple):
    """Velocity in the robot's own frame: forward and left (m/s), counter-clockwise (rad/s)."""

    vx: float = 0.0
    vy: float = 0.0
    wz: float = 0.0

    @property
    def speed(self) -> float:
        """Translational speed, m/s."""
        return math.hypot(self.vx, self.vy)

    def is_finite(self) -> bool:
        """Return False if a component is NaN or infinite."""
        return math.isfinite(self.vx) and math.isfinite(self.vy) and math.isfinite(self.wz)


class Transform2D(NamedTuple):
    """Pose of a frame B in a frame A; `apply` transforms coordinates in B to coordinates in A."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def apply(self, pose: Pose2D) -> Pose2D:
        """Transform `pose` from B to A."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2D(
            self.x + c * pose.x - s * pose.y, self.y + s * pose.x + c * pose.y, normalize_angle(self.yaw + pose.yaw)
        )

    def apply_points(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform points (n, 2) from B to A; return a new array."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        out = np.empty((len(points), 2))
        out[:, 0] = self.x + c * points[:, 0] - s * points[:, 1]
        out[:, 1] = self.y + s * points[:, 0] + c * points[:, 1]
        return out

    def apply_poses(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform poses (n, 3) = x, y, yaw from B to A; return a new array with yaw in (-pi, pi]."""
        out = np.empty((len(poses), 3))
        out[:, :2] = self.apply_points(poses[:, :2])
        out[:, 2] = normalize_angles(poses[:, 2] + self.yaw)
        return out

    def inverse(self) -> Transform2D:
        """Return the transform from A to B, rounded as in tf2 (`BufferCore::lookupTransform`)."""
        x, y, yaw = self
        w, z = math.cos(0.5 * yaw), -math.sin(0.5 * yaw)
        a, b = z * y - w * x, -(w * y) - z * x
        return Transform2D(a * w - b * z, b * w + a * z, normalize_angle(-yaw))

    def __matmul__(self, other: Transform2D) -> Transform2D:
        """Compose transforms: `A<-B @ B<-C = A<-C`.

        The translation is rotated by a quaternion, with the operations in the order of tf2's `quatRotate`, so that the result
        equals that of `BufferCore::lookupTransform` to the last bit: one unit there can decide whether a ray that is cut at
        the border ends inside the map.
        """
        x, y, yaw = self
        right, up, turn = other
        w, z = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
        a, b = w * right - z * up, w * up + z * right
        return Transform2D((a * w - b * z) + x, (b * w + a * z) + y, normalize_angle(yaw + turn))

    def is_identity(self) -> bool:
        """Return True for the identity."""
        return self.x == 0.0 and self.y == 0.0 and self.yaw == 0.0

"""The robot's footprint: a polygon around its center, and the two radii that costmap_2d derives from it.

Source of the rules: costmap_2d/src/footprint.cpp (16-gon from a radius, padding away from zero per axis, inscribed and
circumscribed radius over vertices and edges).
"""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core.errors import InputError
from navstack.core.geometry import Pose2D

CIRCLE_VERTICES = 16


class Footprint:
    """Polygon with `vertices` (n, 2) float64 (m) in the robot's frame, padding included. Immutable."""

    def __init__(self, vertices: NDArray[np.float64], padding: float = 0.0) -> None:
        """`vertices` (n, 2) without padding; `padding` (m) moves each vertex away from zero along each axis.

        Raises InputError for fewer than three points, points that are not finite, and polygons that have no area or cross
        themselves.
        """
        points = np.array(vertices, np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or len(points) < 3:
            raise InputError(
                f"a footprint needs at least three points [x, y], not {len(points)}; give [[x, y], [x, y], [x, y], ..]",
                points=points.tolist(),
            )
        if not np.isfinite(points).all() or not math.isfinite(padding):
            raise InputError("a footprint's points and padding must be finite numbers", points=points.tolist())
        points = _padded(points, padding)
        polygon = shapely.Polygon(points)
        if not polygon.is_valid or polygon.area <= 0.0:
            raise InputError(
                "the footprint crosses itself or has no area; list its corners in order around the robot",
                points=points.tolist(),
            )
        points.setflags(write=False)
        self.vertices: NDArray[np.float64] = points
        self.padding = padding
        origin = shapely.Point(0.0, 0.0)
        radii = np.hypot(points[:, 0], points[:, 1])
        self.inscribed_radius = float(polygon.exterior.distance(origin))
        self.circumscribed_radius = float(radii.max())
        self.contains_center = bool(polygon.covers(origin))

    @classmethod
    def from_radius(cls, radius: float, padding: float = 0.0) -> Footprint:
        """Return the footprint of a circle of `radius` (m): a regular 16-gon, as in costmap_2d."""
        if not (math.isfinite(radius) and radius > 0.0):
            raise InputError(f"robot_radius must be a positive number of meters, not {radius}", radius=radius)
        return cls(_circle(radius), padding)

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The footprint as a shapely polygon, in the robot's frame."""
        return shapely.Polygon(self.vertices)

    @cached_property
    def is_round(self) -> bool:
        """Whether this is the polygon that stands for a `robot_radius`: that of `from_radius`, with any padding."""
        if len(self.vertices) != CIRCLE_VERTICES:
            return False
        circle = _padded(_circle(float(self.vertices[0, 0]) - self.padding), self.padding)
        return bool(np.allclose(self.vertices, circle, rtol=0.0, atol=1e-9))

    def at(self, pose: Pose2D, scale: float = 1.0) -> NDArray[np.float64]:
        """Return the vertices (n, 2) of the footprint, grown by `scale`, at `pose`, in the frame of the pose (m)."""
        c, s = math.cos(pose.yaw), math.sin(pose.yaw)
        vertices = self.vertices if scale == 1.0 else self.vertices * scale
        out = np.empty_like(vertices)
        out[:, 0] = pose.x + c * vertices[:, 0] - s * vertices[:, 1]
        out[:, 1] = pose.y + s * vertices[:, 0] + c * vertices[:, 1]
        return out

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Footprint) and np.array_equal(self.vertices, other.vertices)

    def __hash__(self) -> int:
        return hash(self.vertices.tobytes())

    def __repr__(self) -> str:
        return (
            f"Footprint({len(self.vertices)} vertices, inscribed {self.inscribed_radius:.4f} m, "
            f"circumscribed {self.circumscribed_radius:.4f} m)"
        )


def _circle(radius: float) -> NDArray[np.float64]:
    """Vertices (n, 2) of the polygon in a circle of `radius` (m)."""
    angles = np.arange(CIRCLE_VERTICES) * (2.0 * np.pi / CIRCLE_VERTICES)
    return np.column_stack((radius * np.cos(angles), radius * np.sin(angles)))


def _padded(points: NDArray[np.float64], padding: float) -> NDArray[np.float64]:
    """Points moved away from zero along each axis by `padding` (m); as sign0 in ROS, a coordinate of exactly zero stays."""
    return points + np.sign(points) * padding

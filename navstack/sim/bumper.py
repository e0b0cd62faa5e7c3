"""Bumpers: a cloud with a point for each zone that is pressed while the robot is in collision."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import DeferredCloud, Footprint, PointCloud, Pose2D
from navstack.parameters import BumperParams
from navstack.sim.solids import Solids
from navstack.sim.world import World

PRESS_DISTANCE: Final = 0.01
"""Obstacles within this distance of the footprint press (m); a robot in collision is up to 5 mm away from the obstacle."""
SPACING: Final = 0.005
"""Maximum distance between the sampled points of the footprint's outline (m)."""

_NOTHING = np.empty((0, 3), np.float32)


class Bumper:
    """Computes clouds from the poses of a robot in collision."""

    def __init__(self, params: BumperParams, footprint: Footprint) -> None:
        self.params = params
        self._outline, self._outward = outline_points(footprint.vertices)
        bearing = np.arctan2(self._outline[:, 1], self._outline[:, 0])
        # (zones, points) which points of the outline belong to each zone
        self._zones = [np.mod(bearing - zone[0], 2.0 * math.pi) < zone[1] - zone[0] for zone in params.zones]
        self._centers = [_nearest_bearing(bearing, 0.5 * (zone[0] + zone[1])) for zone in params.zones]
        self._last: tuple[Pose2D, Solids] | None = None
        self._points = _NOTHING

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> PointCloud:
        """Returns the cloud of a robot at `base` (map frame) at `stamp` (s): a point per pressed zone, in the sensor's frame (m).

        `index`, for other sensors the number of the scan, is 0 if the robot is not in collision: the cloud is then empty.
        `solids`: the obstacles at that time, if known. The points are computed when they are first read: bumpers publish more
        often than a costmap looks.
        """
        p = self.params
        if not index:
            return PointCloud(_NOTHING, stamp, p.frame, p.topic)
        then = world.solids_at(stamp) if solids is None else solids
        return DeferredCloud(lambda: self._points_at(world, base, then), stamp, p.frame, p.topic)

    def _points_at(self, world: World, base: Pose2D, solids: Solids) -> NDArray[np.float32]:
        # a robot that does not move gets the same cloud again
        if self._last is None or self._last[0] != base or self._last[1] is not solids:
            self._last, self._points = (base, solids), self._pressed(world, base, solids)
        return self._points

    def _pressed(self, world: World, base: Pose2D, solids: Solids) -> NDArray[np.float32]:
        c, s = math.cos(base.yaw), math.sin(base.yaw)
        x, y = self._outline[:, 0], self._outline[:, 1]
        pressed = world.near_obstacle(
            np.column_stack((base.x + c * x - s * y, base.y + s * x + c * y)), PRESS_DISTANCE, solids
        )
        points: list[tuple[float, float, float]] = []
        for zone, center_point in zip(self._zones, self._centers, strict=True):
            pressed_points = np.nonzero(zone & pressed)[0]
            if not len(pressed_points):
                continue
            at = center_point
            if self.params.point == "contact":
                center = self._outline[pressed_points].mean(axis=0)
                at = int(pressed_points[np.argmin(((self._outline[pressed_points] - center) ** 2).sum(axis=1))])
            px, py = (self._outline[at] + self.params.distance * self._outward[at]).tolist()
            points.append((px, py, self.params.height))
        return np.array(points, np.float32).reshape(-1, 3)


def outline_points(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns points along an outline (n, 2), at most `SPACING` apart, and the outward unit normals there: both (m, 2).

    The normal at a corner bisects the normals of its two edges.
    """
    vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]  # remove edges of length 0
    edges = np.roll(vertices, -1, axis=0) - vertices
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    turn = 1.0 if float((vertices[:, 0] * edges[:, 1] - vertices[:, 1] * edges[:, 0]).sum()) >= 0.0 else -1.0
    across = turn * np.column_stack((edges[:, 1], -edges[:, 0])) / lengths[:, None]
    at_corner = across + np.roll(across, 1, axis=0)
    points: list[NDArray[np.float64]] = []
    normals: list[NDArray[np.float64]] = []
    for k, corner in enumerate(vertices):
        count = math.ceil(float(lengths[k]) / SPACING)
        points.append(corner + (np.arange(count) / count)[:, None] * edges[k])
        along = np.tile(across[k], (count, 1))
        size = float(np.hypot(*at_corner[k]))
        if size > 1e-9:  # a spike has no defined normal at its tip
            along[0] = at_corner[k] / size
        normals.append(along)
    return np.concatenate(points), np.concatenate(normals)


def _nearest_bearing(bearings: NDArray[np.float64], wanted: float) -> int:
    away = np.abs(np.mod(bearings - wanted + math.pi, 2.0 * math.pi) - math.pi)
    return int(np.argmin(away))

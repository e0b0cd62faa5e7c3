"""Bumpers: which of their zones are pressed while the robot touches something, as a cloud of points."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, PointCloud, Pose2D
from navstack.parameters.models.sim import BumperParams
from navstack.sim.solids import Solids
from navstack.sim.world import World

FEELS: Final = 0.01
"""What is this near to the outline presses (m): a robot in collision stands up to 5 mm off what stopped it."""
SPACING: Final = 0.005
"""Between the points of the outline that feel (m)."""

_NOTHING = np.empty((0, 3), np.float32)


class Bumper:
    """Makes clouds from the poses of a robot that is in collision."""

    def __init__(self, params: BumperParams, footprint: Footprint) -> None:
        self.params = params
        self._skin, self._outward = skin(footprint.vertices)
        bearing = np.arctan2(self._skin[:, 1], self._skin[:, 0])
        # (zones, points) which points of the outline belong to a zone
        self._zones = [np.mod(bearing - zone[0], 2.0 * math.pi) < zone[1] - zone[0] for zone in params.zones]
        self._middles = [_nearest_bearing(bearing, 0.5 * (zone[0] + zone[1])) for zone in params.zones]
        self._last: tuple[Pose2D, Solids] | None = None
        self._points = _NOTHING

    def scan(self, world: World, base: Pose2D, index: int, stamp: float, solids: Solids | None = None) -> PointCloud:
        """The cloud of a robot at `base` (map frame) at `stamp` (s): a point per pressed zone, in the sensor's frame (m).

        `index`, which numbers the scans of other sensors, says of a bumper whether the robot is in collision at all: with 0 the
        cloud is empty. `solids`: the world's obstacles at that time, when the caller knows them already.
        """
        points = _NOTHING
        if index:
            solids = world.solids_at(stamp) if solids is None else solids
            # a robot that is stuck feels the same as before
            if self._last is None or self._last[0] != base or self._last[1] is not solids:
                self._last, self._points = (base, solids), self._pressed(world, base, solids)
            points = self._points
        return PointCloud(points, stamp, self.params.frame, self.params.topic)

    def _pressed(self, world: World, base: Pose2D, solids: Solids) -> NDArray[np.float32]:
        c, s = math.cos(base.yaw), math.sin(base.yaw)
        x, y = self._skin[:, 0], self._skin[:, 1]
        touched = world.touched(np.column_stack((base.x + c * x - s * y, base.y + s * x + c * y)), FEELS, solids)
        points: list[tuple[float, float, float]] = []
        for zone, middle in zip(self._zones, self._middles, strict=True):
            felt = np.nonzero(zone & touched)[0]
            if not len(felt):
                continue
            at = middle
            if self.params.point == "contact":
                centre = self._skin[felt].mean(axis=0)
                at = int(felt[np.argmin(((self._skin[felt] - centre) ** 2).sum(axis=1))])
            px, py = (self._skin[at] + self.params.distance * self._outward[at]).tolist()
            points.append((px, py, self.params.height))
        return np.array(points, np.float32).reshape(-1, 3)


def skin(vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points along an outline (n, 2), no farther apart than `SPACING`, and the unit vectors out of it there: both (m, 2).

    Out of a corner is half way between its two edges' normals.
    """
    vertices = vertices[np.any(vertices != np.roll(vertices, 1, axis=0), axis=1)]  # an edge has a length
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
        if size > 1e-9:  # a spike that turns back has no way out of its own
            along[0] = at_corner[k] / size
        normals.append(along)
    return np.concatenate(points), np.concatenate(normals)


def _nearest_bearing(bearings: NDArray[np.float64], wanted: float) -> int:
    away = np.abs(np.mod(bearings - wanted + math.pi, 2.0 * math.pi) - math.pi)
    return int(np.argmin(away))

"""The map of a session with what a person changed: obstacles that stand still become walls, erased lines become free."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import shapely
import shapely.affinity

from navstack.core import OccupancyGrid
from navstack.live.messages import Stroke
from navstack.sim import Shape


def edited_map(grid: OccupancyGrid, shapes: Iterable[Shape], erased: Iterable[Stroke]) -> OccupancyGrid:
    """Return a copy of the map in which the lines are free, and then the shapes that stand still are occupied."""
    data, geometry = grid.data.copy(), grid.geometry
    resolution = geometry.resolution
    ix, iy = np.meshgrid(np.arange(geometry.nx) + 0.5, np.arange(geometry.ny) + 0.5)
    u, v = ix * resolution, iy * resolution
    cos, sin = np.cos(grid.origin_yaw), np.sin(grid.origin_yaw)
    x, y = geometry.origin_x + cos * u - sin * v, geometry.origin_y + sin * u + cos * v
    for stroke in erased:
        points = stroke.points if len(stroke.points) > 1 else stroke.points * 2
        data[shapely.contains_xy(shapely.LineString(points).buffer(0.5 * stroke.width), x, y)] = 0
    for shape in shapes:
        if shape.motion.kind == "still":
            # a wall thinner than a cell still has cells
            data[shapely.contains_xy(_area(shape).buffer(0.5 * resolution), x, y)] = 100
    return replace(grid, data=data)


def _area(shape: Shape) -> shapely.Polygon:
    x, y, yaw = (*shape.pose, 0.0)[:3]
    if shape.radius is not None:
        return shapely.Point(x, y).buffer(shape.radius)
    turned = shapely.affinity.rotate(shapely.Polygon(shape.outline()), yaw, origin=(0.0, 0.0), use_radians=True)
    return shapely.affinity.translate(turned, x, y)

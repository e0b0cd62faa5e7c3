"""Whether a robot can stand at the start of a scenario: told with the file's line before anything is driven."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely

from navstack.core import Footprint, OccupancyGrid, Pose2D
from navstack.sim import Shape
from navstack.sim.shapes import PedestrianMotion, Still
from navstack.sim.world import OCCUPIED


def touched_at_start(
    footprint: Footprint, start: Pose2D, grid: OccupancyGrid, shapes: Sequence[Shape] = ()
) -> str | None:
    """What the outline touches there, in words; None when nothing. By shapely: no kernel is compiled for it.

    `shapes` that stand, and people; what is on tracks and doors are left to whoever drives.
    """
    outline = shapely.Polygon(footprint.at(start))
    cell = _touched_cell(footprint, start, grid)
    if cell is not None:
        return f"a wall of the map at ({cell[0]:.2f}, {cell[1]:.2f})"
    for number, shape in enumerate(shapes, 1):
        if not isinstance(shape.motion, (Still, PedestrianMotion)):
            continue
        x, y, yaw = shape.pose
        if shape.radius is not None:
            touches = outline.distance(shapely.Point(x, y)) < shape.radius
        else:
            c, s = math.cos(yaw), math.sin(yaw)
            touches = outline.intersects(
                shapely.Polygon([(x + c * u - s * v, y + s * u + c * v) for u, v in shape.outline()])
            )
        if touches:
            return f'shape {number} "{shape.name}"' if shape.name else f"shape {number}"
    return None


def _touched_cell(footprint: Footprint, start: Pose2D, grid: OccupancyGrid) -> tuple[float, float] | None:
    """The centre (m, map) of an occupied cell that the outline touches."""
    geometry = grid.geometry
    c, s = math.cos(grid.origin_yaw), math.sin(grid.origin_yaw)
    dx, dy = start.x - geometry.origin_x, start.y - geometry.origin_y
    # the outline in cells, as the map lay before it was turned
    there = Pose2D(c * dx + s * dy, c * dy - s * dx, start.yaw - grid.origin_yaw)
    outline = footprint.at(there) / geometry.resolution
    last = np.array([geometry.nx - 1, geometry.ny - 1])
    low = np.clip(np.floor(outline.min(axis=0)), 0, last).astype(np.int64)
    high = np.clip(np.floor(outline.max(axis=0)), 0, last).astype(np.int64)
    iy, ix = np.nonzero(grid.data[low[1] : high[1] + 1, low[0] : high[0] + 1] >= OCCUPIED)
    ix, iy = ix + low[0], iy + low[1]
    cells = shapely.box(ix, iy, ix + 1, iy + 1)
    hit = np.nonzero(shapely.intersects(shapely.Polygon(outline), cells))[0]
    if not len(hit):
        return None
    u = (float(ix[hit[0]]) + 0.5) * geometry.resolution
    v = (float(iy[hit[0]]) + 0.5) * geometry.resolution
    return geometry.origin_x + c * u - s * v, geometry.origin_y + s * u + c * v

# pyright: basic
"""Raytracing and marking of the obstacle layer. Points may be NaN, infinite or outside the map."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import clear_line

GRID = np.dtype([("origin_x", "f8"), ("origin_y", "f8"), ("resolution", "f8"), ("max_height", "f8")], align=True)
"""Settings of the kernels below: the grid (m, m per cell), and the height above which points are ignored (m)."""


@kernel
def clear_rays(costs, points, count, grid, sx, sy, reach, reach_cells, bounds):
    """Clear the cells between the sensor at (sx, sy) and each point, up to `reach` (m; `reach_cells` in cells); grow `bounds`.

    Points outside the map are moved along their ray onto its border (costmap_2d/plugins/obstacle_layer.cpp). Returns False if
    the sensor is outside the map. `grid`: a record of `GRID`.
    """
    ny, nx = costs.shape
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    if not (sx >= origin_x and sy >= origin_y):
        return False
    fx, fy = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    if not (fx < nx and fy < ny):
        return False
    x0, y0 = int(fx), int(fy)
    cells = costs.reshape(-1)
    end_x, end_y = origin_x + nx * resolution, origin_y + ny * resolution
    min_x, min_y, max_x, max_y = min(bounds[0], sx), min(bounds[1], sy), max(bounds[2], sx), max(bounds[3], sy)
    reach_squared = reach * reach
    last_x, last_y = -1, -1
    for i in range(count):
        wx, wy = float(points[i, 0]), float(points[i, 1])
        a, b = wx - sx, wy - sy
        if wx < origin_x:
            wy = sy + b * ((origin_x - sx) / a)
            wx = origin_x
        if wy < origin_y:
            wx = sx + a * ((origin_y - sy) / b)
            wy = origin_y
        if wx > end_x:
            wy = sy + b * ((end_x - sx) / a)
            wx = end_x - 0.001
        if wy > end_y:
            wx = sx + a * ((end_y - sy) / b)
            wy = end_y - 0.001
        if not (wx >= origin_x and wy >= origin_y):
            continue
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        if not (fx < nx and fy < ny):
            continue
        x1, y1 = int(fx), int(fy)
        dx, dy = wx - sx, wy - sy
        squared = dx * dx + dy * dy
        if squared > reach_squared:
            cut = reach / math.sqrt(squared)
            dx, dy = dx * cut, dy * cut
        min_x, min_y, max_x, max_y = min(min_x, sx + dx), min(min_y, sy + dy), max(max_x, sx + dx), max(max_y, sy + dy)
        # a ray depends on its two end cells only: adjacent beams often end in the same cell
        if x1 != last_x or y1 != last_y:
            clear_line(cells, nx, x0, y0, x1, y1, reach_cells)
            last_x, last_y = x1, y1
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_points(costs, serials, serial, points, count, grid, sx, sy, sz, reach, bounds):
    """Mark the cells of the points closer than `reach` (m, 3-D) as lethal, with the observation's `serial`; grow `bounds`.

    `grid`: a record of `GRID`.
    """
    ny, nx = costs.shape
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    max_height = grid[0].max_height
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    reach_squared = reach * reach
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + (pz - sz) * (pz - sz)
        if not (squared < reach_squared) or pz > max_height or px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        if not (fx < nx and fy < ny):
            continue
        ix, iy = int(fx), int(fy)
        costs[iy, ix] = 254
        serials[iy, ix] = serial
        min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y

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
def line_ends(points, grid, sensor, reach, size, ends, cells):
    """Compute where the rays from `sensor` (x, y) to the points end: points outside the map are moved along their ray onto its
    border.

    `size`: columns and rows of the map. Writes to `ends` (2, N): x and y at `reach` at the latest (m); to `cells` (3, N): ix,
    iy, and whether the ray is inside the map. Without branches and in contiguous arrays, so that the loop is vectorized.
    """
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    nx, ny = size
    sx, sy = sensor
    end_x, end_y = origin_x + nx * resolution, origin_y + ny * resolution
    number = np.uint64(ends.shape[1])
    for i in range(number):
        ends[0, i], ends[1, i] = points[i, 0], points[i, 1]
    for i in range(number):
        wx, wy = ends[0, i], ends[1, i]
        a, b = wx - sx, wy - sy
        outside = wx < origin_x
        wy = sy + b * ((origin_x - sx) / a) if outside else wy
        wx = origin_x if outside else wx
        outside = wy < origin_y
        wx = sx + a * ((origin_y - sy) / b) if outside else wx
        wy = origin_y if outside else wy
        outside = wx > end_x
        wy = sy + b * ((end_x - sx) / a) if outside else wy
        wx = end_x - 0.001 if outside else wx
        outside = wy > end_y
        wx = sx + a * ((end_y - sy) / b) if outside else wx
        wy = end_y - 0.001 if outside else wy
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        inside = (wx >= origin_x) & (wy >= origin_y) & (fx < nx) & (fy < ny)
        dx, dy = wx - sx, wy - sy
        squared = dx * dx + dy * dy
        cut = reach / math.sqrt(squared)
        far = squared > reach * reach
        ends[0, i], ends[1, i] = sx + (dx * cut if far else dx), sy + (dy * cut if far else dy)
        cells[0, i], cells[1, i] = np.int32(fx if inside else 0.0), np.int32(fy if inside else 0.0)
        cells[2, i] = np.int32(1 if inside else 0)


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
    flat = costs.reshape(-1)
    ends, cells = np.empty((2, count)), np.empty((3, count), np.int32)
    line_ends(points, grid, (sx, sy), reach, (float(nx), float(ny)), ends, cells)
    min_x, min_y, max_x, max_y = min(bounds[0], sx), min(bounds[1], sy), max(bounds[2], sx), max(bounds[3], sy)
    last_x, last_y = -1, -1
    for i in range(count):
        if cells[2, i] == 0:
            continue
        min_x, min_y = min(min_x, ends[0, i]), min(min_y, ends[1, i])
        max_x, max_y = max(max_x, ends[0, i]), max(max_y, ends[1, i])
        x1, y1 = np.int64(cells[0, i]), np.int64(cells[1, i])
        # a ray depends on its two end cells only: adjacent beams often end in the same cell
        if x1 != last_x or y1 != last_y:
            clear_line(flat, nx, x0, y0, x1, y1, reach_cells)
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

# pyright: basic
"""Raytracing and marking of the voxel layer. Points may be NaN, infinite or outside the map.

A column stores its levels as bits: `levels` low bits "seen free", then `levels` bits "marked" (neither: unknown), and in the
remaining high bits the serial number of the observation that marked it last. A word of 0 is unknown at all levels.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import FIXED

VOXEL_GRID = np.dtype(
    [
        *[(name, "f8") for name in ("origin_x", "origin_y", "origin_z", "resolution", "z_resolution", "max_height")],
        *[(name, "i8") for name in ("levels", "mark_threshold", "unknown_threshold")],
    ],
    align=True,
)
"""Settings of the kernels below: the grid (m, m per cell), the height above which points are ignored (m), the thresholds."""


@kernel
def bits_set(n):
    """Return the number of ones in the binary form of `n`."""
    count = 0
    while n:
        n &= n - 1
        count += 1
    return count


@kernel
def clear_level_ray(columns, costs, offset, line, steps, level, levels):
    """Clear the voxels of a ray that stays in one level, from the column `offset` on, and the costs of columns without marks.

    `line`: see `line_start`. As the general loop of `clear_voxel_rays`, for a mark threshold of 0 and columns that are known
    however many voxels are not. Each voxel takes one addition and no branch, as in `clear_line`.
    """
    length, add, major, minor = line
    seen = np.uint32(1 << level)
    kept = ~np.uint32(1 << (level + levels))
    marks = np.uint32(((1 << levels) - 1) << levels)
    slope = at = 0
    if length > 0:
        scale = (1 << FIXED) / length
        slope = int(add * scale) + 1
        at = int((length // 2) * scale) + 1
    for _ in range(steps + 1):
        cell = np.uint64(offset + (at >> FIXED) * minor)
        word = (np.uint32(columns[cell]) | seen) & kept
        columns[cell] = word
        costs[cell] = costs[cell] if word & marks else np.uint8(0)
        offset += major
        at += slope


@kernel
def clear_voxel_rays(costs, columns, points, count, grid, sx, sy, sz, reach, reach_cells, bounds):
    """Clear the voxels between the sensor at (sx, sy, sz) and each point, and set the cost of each column on the way.

    Rays are shortened by two cells, then clipped to the map and the heights (costmap_2d/plugins/voxel_layer.cpp,
    voxel_grid.h); they end at `reach` (m; `reach_cells` in cells). Grows `bounds`. Returns False if the sensor is outside the
    map. `grid`: a record of `VOXEL_GRID`.
    """
    ny, nx = costs.shape
    g = grid[0]
    origin_x, origin_y, origin_z, resolution, z_resolution = (
        g.origin_x,
        g.origin_y,
        g.origin_z,
        g.resolution,
        g.z_resolution,
    )
    top, levels, mark_threshold, unknown_threshold = g.max_height, g.levels, g.mark_threshold, g.unknown_threshold
    if not (sx >= origin_x and sy >= origin_y and sz >= origin_z):
        return False
    x0, y0 = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    z0 = (sz - origin_z) / z_resolution
    if not (x0 < nx and y0 < ny and z0 < levels):
        return False
    ix0, iy0, iz0 = int(x0), int(y0), int(z0)
    flat_columns, flat_costs = columns.reshape(-1), costs.reshape(-1)
    level_mask = (1 << levels) - 1
    end_x, end_y = origin_x + (nx - 0.5) * resolution, origin_y + (ny - 0.5) * resolution
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    last_x, last_y, last_z = -1, -1, -1
    for i in range(count):
        wx, wy, wz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        a, b, c = wx - sx, wy - sy, wz - sz
        distance = math.sqrt(a * a + b * b + c * c)
        if not (distance < math.inf):
            continue
        short = max((distance - 2.0 * resolution) / distance, 0.0) if distance > 0.0 else 0.0
        wx, wy, wz = short * a + sx, short * b + sy, short * c + sz
        a, b, c = wx - sx, wy - sy, wz - sz
        t = 1.0
        if wz > top:
            t = max(0.0, min(t, (top - 0.01 - sz) / c))
        elif wz < origin_z:
            t = min(t, (origin_z - sz) / c)
        if wx < origin_x:
            t = min(t, (origin_x - sx) / a)
        if wy < origin_y:
            t = min(t, (origin_y - sy) / b)
        if wx > end_x:
            t = min(t, (end_x - sx) / a)
        if wy > end_y:
            t = min(t, (end_y - sy) / b)
        # ROS differs: there, rounding puts some clipped rays just below the origin, and they are lost
        wx, wy, wz = max(sx + a * t, origin_x), max(sy + b * t, origin_y), max(sz + c * t, origin_z)
        if not (wx >= origin_x and wy >= origin_y and wz >= origin_z):
            continue
        x1, y1 = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        z1 = (wz - origin_z) / z_resolution
        if not (x1 < nx and y1 < ny and z1 < levels):
            continue
        dx, dy = wx - sx, wy - sy
        full = math.sqrt(dx * dx + dy * dy)
        if full > reach:
            cut = reach / full
            dx, dy = dx * cut, dy * cut
        min_x, min_y, max_x, max_y = min(min_x, sx + dx), min(min_y, sy + dy), max(max_x, sx + dx), max(max_y, sy + dy)

        ix1, iy1, iz1 = int(x1), int(y1), int(z1)
        span_x, span_y, span_z = abs(ix1 - ix0), abs(iy1 - iy0), abs(iz1 - iz0)
        dominant = max(span_x, span_y, span_z)
        length = math.sqrt((x0 - x1) * (x0 - x1) + (y0 - y1) * (y0 - y1) + (z0 - z1) * (z0 - z1))
        steps = dominant
        if length > reach_cells:
            steps = int(reach_cells / length * dominant)
        elif ix1 == last_x and iy1 == last_y and iz1 == last_z:
            continue  # same voxels as the previous beam
        else:
            last_x, last_y, last_z = ix1, iy1, iz1
        step_x, step_y, step_z = 1 if ix1 > ix0 else -1, nx if iy1 > iy0 else -nx, 1 if iz1 > iz0 else -1
        error_x = error_y = error_z = dominant // 2
        offset, level = iy0 * nx + ix0, iz0
        if span_z == 0 and mark_threshold == 0 and unknown_threshold >= levels:
            along_x = span_x >= span_y
            line = dominant, span_y if along_x else span_x, step_x if along_x else step_y, step_y if along_x else step_x
            clear_level_ray(flat_columns, flat_costs, offset, line, steps, level, levels)
            continue
        for _ in range(steps + 1):
            old = int(flat_columns[np.uint64(offset)])
            word = (old | (1 << level)) & ~(1 << (level + levels))
            if word != old:
                flat_columns[np.uint64(offset)] = word
            marked = (word >> levels) & level_mask
            if marked == 0 or bits_set(marked) <= mark_threshold:
                unknown = level_mask & ~(word | marked)
                known = unknown_threshold >= levels or bits_set(unknown) <= unknown_threshold
                flat_costs[np.uint64(offset)] = 0 if known else 255
            # Bresenham in 3-D: the error of the dominant axis reaches the threshold at each step
            error_x += span_x
            error_y += span_y
            error_z += span_z
            if error_x >= dominant:
                error_x -= dominant
                offset += step_x
            if error_y >= dominant:
                error_y -= dominant
                offset += step_y
            if error_z >= dominant:
                error_z -= dominant
                level += step_z
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_voxels(costs, columns, serial, points, count, grid, sx, sy, sz, reach, bounds):
    """Mark the voxels of the points closer than `reach` (m, 3-D), with the observation's `serial`; grow `bounds`.

    Columns with more marked voxels than the threshold become lethal. `grid`: a record of `VOXEL_GRID`.
    """
    ny, nx = costs.shape
    g = grid[0]
    origin_x, origin_y, origin_z, resolution, z_resolution = (
        g.origin_x,
        g.origin_y,
        g.origin_z,
        g.resolution,
        g.z_resolution,
    )
    top, levels, mark_threshold = g.max_height, g.levels, g.mark_threshold
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    reach_squared = reach * reach
    level_mask = (1 << levels) - 1
    bits_mask = (1 << (2 * levels)) - 1
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + (pz - sz) * (pz - sz)
        if not (squared < reach_squared) or pz > top or px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        fz = max(pz - origin_z, 0.0) / z_resolution
        if not (fx < nx and fy < ny and fz < levels):
            continue
        ix, iy, iz = int(fx), int(fy), int(fz)
        word = (int(columns[iy, ix]) | (1 << (iz + levels))) & ~(1 << iz)
        columns[iy, ix] = (word & bits_mask) | (serial << (2 * levels))
        if bits_set((word >> levels) & level_mask) > mark_threshold:
            costs[iy, ix] = 254
            min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y

# pyright: basic
"""Ray casting on a grid and on discs, exact: no step length anywhere.

The grid comes as its chessboard distances (`World.clear`): `clear[iy, ix]` = c says that the square of 2c-1 cells around
the cell is free; 0 is an occupied cell. A ray leaps to the border of that square, which for c = 1 is the step of Amanatides
and Woo (A Fast Voxel Traversal Algorithm for Ray Tracing, Eurographics 1987), so the first occupied cell on the ray and the
point where it enters it are those of a walk through every single cell.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel


@kernel
def cast_ray(clear, x, y, dx, dy, reach):
    """Distance (cells) from (x, y) (cells) along the unit vector (dx, dy) to the first occupied cell; inf beyond `reach`."""
    ny, nx = clear.shape
    # where the ray is inside the map: t in [t, end]
    t = 0.0
    end = reach
    ix = math.floor(x)
    iy = math.floor(y)
    ex = 1.0 / dx if dx != 0.0 else math.inf
    ey = 1.0 / dy if dy != 0.0 else math.inf
    if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
        if (dx == 0.0 and (ix < 0 or ix >= nx)) or (dy == 0.0 and (iy < 0 or iy >= ny)):
            return math.inf
        near_x, far_x = -math.inf, math.inf
        if dx != 0.0:
            near_x, far_x = min(-x * ex, (nx - x) * ex), max(-x * ex, (nx - x) * ex)
        near_y, far_y = -math.inf, math.inf
        if dy != 0.0:
            near_y, far_y = min(-y * ey, (ny - y) * ey), max(-y * ey, (ny - y) * ey)
        t = max(near_x, near_y)
        if t < 0.0 or t > min(far_x, far_y) or t > end:
            return math.inf
        if near_x > near_y:
            ix = 0 if dx > 0.0 else nx - 1
            iy = min(max(math.floor(y + t * dy), 0), ny - 1)
        else:
            iy = 0 if dy > 0.0 else ny - 1
            ix = min(max(math.floor(x + t * dx), 0), nx - 1)
    while True:
        c = int(clear[iy, ix])
        if c == 0:
            return t if t <= end else math.inf
        # the borders of the free square that the ray is heading for
        tx = math.inf if dx == 0.0 else ((ix + c if dx > 0.0 else ix + 1 - c) - x) * ex
        ty = math.inf if dy == 0.0 else ((iy + c if dy > 0.0 else iy + 1 - c) - y) * ey
        if tx < ty:
            t = tx
            if t > end:
                return math.inf
            ix = ix + c if dx > 0.0 else ix - c
            # rounding must not push the ray out of the square sideways
            iy = min(max(math.floor(y + t * dy), iy - c + 1), iy + c - 1)
        else:
            t = ty
            if t > end:
                return math.inf
            iy = iy + c if dy > 0.0 else iy - c
            ix = min(max(math.floor(x + t * dx), ix - c + 1), ix + c - 1)
        if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
            return math.inf


@kernel
def sweep(clear, grid, discs, pose, beams, angle_min, angle_increment, range_min, range_max, noise, kept):
    """One scan (n,) float32 from `pose` [x, y, yaw] of the sensor in the map (m, rad).

    `grid` = [origin x, origin y, origin yaw, resolution]; `discs` (k, 3) = x, y, radius (m); `beams` (n, 2) unit vectors in
    the sensor's frame, evenly turned; `noise` (n or 0,) is added to the ranges (m); where `kept` (n or 0,) is false the beam
    is lost (NaN). Hits nearer than `range_min` give -inf, beams without a hit up to `range_max` +inf (REP 117).
    """
    n = beams.shape[0]
    out = np.empty(n, np.float32)
    ranges = np.empty(n)
    reach = range_max
    for i in range(noise.shape[0]):
        reach = max(reach, range_max - noise[i])  # a hit just beyond may be measured within
    resolution = grid[3]
    c, s = math.cos(grid[2]), math.sin(grid[2])
    px = (c * (pose[0] - grid[0]) + s * (pose[1] - grid[1])) / resolution
    py = (c * (pose[1] - grid[1]) - s * (pose[0] - grid[0])) / resolution
    cy, sy = math.cos(pose[2] - grid[2]), math.sin(pose[2] - grid[2])
    for i in range(n):
        dx = cy * beams[i, 0] - sy * beams[i, 1]
        dy = sy * beams[i, 0] + cy * beams[i, 1]
        ranges[i] = resolution * cast_ray(clear, px, py, dx, dy, reach / resolution)

    # every disc meets the beams between its two tangents only
    cy, sy = math.cos(pose[2]), math.sin(pose[2])
    for k in range(discs.shape[0]):
        wx, wy, r = discs[k, 0] - pose[0], discs[k, 1] - pose[1], discs[k, 2]
        d2 = wx * wx + wy * wy
        if d2 > (reach + r) * (reach + r):
            continue
        if d2 <= r * r:
            for i in range(n):
                ranges[i] = 0.0
            continue
        sx = cy * wx + sy * wy  # centre in the sensor's frame
        sz = cy * wy - sy * wx
        middle = math.atan2(sz, sx)
        half = math.asin(r / math.sqrt(d2))
        for turn in range(-1, 2):
            first = (middle - half + 2.0 * math.pi * turn - angle_min) / angle_increment
            last = (middle + half + 2.0 * math.pi * turn - angle_min) / angle_increment
            if last < 0.0 or first > n - 1:
                continue
            for i in range(max(0, math.floor(first)), min(n - 1, math.ceil(last)) + 1):
                b = sx * beams[i, 0] + sz * beams[i, 1]
                h = r * r - (d2 - b * b)
                if h >= 0.0 and b > 0.0:
                    ranges[i] = min(ranges[i], b - math.sqrt(h))

    for i in range(n):
        measured = ranges[i]
        if noise.shape[0] > 0:
            measured += noise[i]
        if kept.shape[0] > 0 and not kept[i]:
            out[i] = np.float32(np.nan)
        elif measured > range_max:
            out[i] = np.float32(np.inf)
        elif measured < range_min:
            out[i] = np.float32(-np.inf)
        else:
            out[i] = np.float32(measured)
    return out

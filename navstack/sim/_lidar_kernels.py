# pyright: basic
"""Ray casting on a grid, on discs and polygons, exact: no step length anywhere.

The grid comes as two tables. The free squares of its cells: `squares[q, iy, ix]` = c says that the c x c cells which have
(ix, iy) as their corner and extend in the quadrant q are free (q & 1: towards smaller x, q & 2: towards smaller y); 0 is an
occupied cell. And, for rays, one free rectangle for each octant, square or four times as long as wide: `leaps`. A ray leaps
to the far border of its rectangle. With one cell each, that is the step of Amanatides and Woo (A Fast Voxel Traversal
Algorithm for Ray Tracing, Eurographics 1987), so the first occupied cell on the ray and the point where it enters it are
those of a walk through every single cell.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.sim._polygon_kernels import polygon_contains


@kernel
def free_squares(occupied):
    """(4, ny, nx) uint8: see above; at most 255, and within the map."""
    ny, nx = occupied.shape
    squares = np.empty((4, ny, nx), np.uint8)
    for q in range(4):
        sx = -1 if q & 1 else 1
        sy = -1 if q & 2 else 1
        for j in range(ny):
            iy = j if sy < 0 else ny - 1 - j
            for i in range(nx):
                ix = i if sx < 0 else nx - 1 - i
                if occupied[iy, ix]:
                    squares[q, iy, ix] = 0
                    continue
                # one more than the smallest of the three squares behind, towards the quadrant
                side = 0
                if i > 0 and j > 0:
                    side = min(squares[q, iy, ix + sx], squares[q, iy + sy, ix])
                    side = min(min(side, squares[q, iy + sy, ix + sx]), 254)
                squares[q, iy, ix] = side + 1
    return squares


@kernel
def free_rectangles(squares):
    """(8, ny, nx) uint8 from the free squares: the larger of two free rectangles that have the cell as their corner.

    In octant 2 q the ray is in the quadrant q and goes farther in x than in y, in 2 q + 1 farther in y. Bits 0 to 6 are the
    short side in cells; bit 7 says that the other, along the axis in which the ray goes farther, is four times as long. Of
    all directions of the octant a ray covers on average short * (1 + ln(long / short)), which decides between the two.
    """
    quadrants, ny, nx = squares.shape
    leaps = np.empty((2 * quadrants, ny, nx), np.uint8)
    thin = np.empty((ny, nx), np.uint8)
    run = np.empty(nx, np.int64)
    for octant in range(2 * quadrants):
        q = octant >> 1
        along_x = octant & 1 == 0
        ax, ay = (4, 1) if along_x else (1, 4)
        sx = -1 if q & 1 else 1
        sy = -1 if q & 2 else 1
        run[:] = 0
        for j in range(ny):
            iy = j if sy < 0 else ny - 1 - j
            for i in range(nx):
                ix = i if sx < 0 else nx - 1 - i
                # free cells in a row from here on, along the long side
                if squares[q, iy, ix] == 0:
                    run[ix] = 0
                elif along_x:
                    run[ix] = run[ix + sx] + 1 if i > 0 else 1
                else:
                    run[ix] += 1
                side = 0
                if run[ix] >= 4:
                    # what lies behind by a long and a short step is free, and the first strip
                    if i >= ax and j >= ay:
                        side = min(thin[iy, ix + ax * sx], thin[iy + ay * sy, ix])
                        side = min(min(side, thin[iy + ay * sy, ix + ax * sx]), 126)
                    side += 1
                thin[iy, ix] = side
                square = min(squares[q, iy, ix], 127)
                leaps[octant, iy, ix] = 128 + side if side * 2.386 > square else square
    return leaps


@kernel
def enter_map(nx, ny, x, y, dx, dy):
    """Where a ray from outside meets the map: distance (cells), ix, iy of the first cell. The distance is inf if it misses."""
    tx0, tx1 = -math.inf, math.inf
    if dx != 0.0:
        tx0, tx1 = min(-x / dx, (nx - x) / dx), max(-x / dx, (nx - x) / dx)
    elif x < 0.0 or x >= nx:
        return math.inf, 0, 0
    ty0, ty1 = -math.inf, math.inf
    if dy != 0.0:
        ty0, ty1 = min(-y / dy, (ny - y) / dy), max(-y / dy, (ny - y) / dy)
    elif y < 0.0 or y >= ny:
        return math.inf, 0, 0
    t = max(tx0, ty0)
    if t < 0.0 or t > min(tx1, ty1):
        return math.inf, 0, 0
    if tx0 > ty0:
        return t, 0 if dx > 0.0 else nx - 1, min(max(math.floor(y + t * dy), 0), ny - 1)
    return t, min(max(math.floor(x + t * dx), 0), nx - 1), 0 if dy > 0.0 else ny - 1


@kernel
def cast_ray(leaps, ny, nx, x, y, dx, dy, reach):
    """Distance (cells) from (x, y) (cells) along the unit vector (dx, dy) to the first occupied cell; inf beyond `reach`.

    `leaps`: the table flat, for a map of `ny` times `nx` cells.
    """
    t = 0.0
    ix, iy = 0, 0
    if 0.0 <= x < nx and 0.0 <= y < ny:
        ix, iy = int(x), int(y)
    else:
        t, ix, iy = enter_map(nx, ny, x, y, dx, dy)
        if t > reach:
            return math.inf
    right, up = dx >= 0.0, dy >= 0.0
    along_x = abs(dx) >= abs(dy)
    octant = (0 if right else 2) + (0 if up else 4) + (0 if along_x else 1)
    first = octant * ny * nx
    longer_x, longer_y = (2, 0) if along_x else (0, 2)
    per_x = 1.0 / dx if dx != 0.0 else math.inf
    per_y = 1.0 / dy if dy != 0.0 else math.inf
    while True:
        leap = np.int64(leaps[np.uint64(first + iy * nx + ix)])
        if leap == 0:
            return t
        w = (leap & 127) << (longer_x if leap > 127 else 0)
        h = (leap & 127) << (longer_y if leap > 127 else 0)
        tx = ((ix + w if right else ix + 1 - w) - x) * per_x
        ty = ((iy + h if up else iy + 1 - h) - y) * per_y
        # across the nearer border; rounding must not push the ray out of the rectangle along it
        if tx < ty:
            t = tx
            along = int(y + t * dy)
            iy = min(max(along, iy), iy + h - 1) if up else max(min(along, iy), iy - h + 1)
            ix = ix + w if right else ix - w
        else:
            t = ty
            along = int(x + t * dx)
            ix = min(max(along, ix), ix + w - 1) if right else max(min(along, ix), ix - w + 1)
            iy = iy + h if up else iy - h
        if t > reach or ix < 0 or iy < 0 or ix >= nx or iy >= ny:
            return math.inf


@kernel
def see_edge(ranges, beams, ax, ay, bx, by, angle_min, angle_increment):
    """Shortens the `ranges` (n,) of the beams that meet the segment from a to b, both in the sensor's frame (m)."""
    n = beams.shape[0]
    area = ax * by - ay * bx
    if area < 0.0:
        ax, ay, bx, by, area = bx, by, ax, ay, -area
    elif area == 0.0:
        return  # seen end on: its neighbours have its ends
    begin = math.atan2(ay, ax)
    span = math.atan2(area, ax * bx + ay * by)
    for turn in range(-1, 2):
        first = (begin + 2.0 * math.pi * turn - angle_min) / angle_increment
        last = first + span / angle_increment
        if last < -1.0 or first > n:
            continue
        for i in range(max(0, math.floor(first)), min(n - 1, math.ceil(last)) + 1):
            dx, dy = beams[i, 0], beams[i, 1]
            after, before = ax * dy - ay * dx, dx * by - dy * bx
            if after >= 0.0 and before >= 0.0 and after + before > 0.0:
                ranges[i] = min(ranges[i], area / (after + before))


@kernel
def sweep(
    leaps,
    grid,
    discs,
    disc_tops,
    circles,
    corners,
    first,
    polygon_tops,
    x,
    y,
    yaw,
    height,
    beams,
    angle_min,
    angle_increment,
    range_min,
    range_max,
    noise,
    kept,
):
    """One scan (n,) float32 from the sensor's pose in the map (m, rad), `height` (m) above the ground.

    `grid` = [origin x, origin y, origin yaw, resolution]; `discs` .. `polygon_tops` as of `Solids`; `beams` (n, 2) unit
    vectors in the sensor's frame, evenly turned; `noise` (n or 0,) is added to the ranges (m); where `kept` (n or 0,) is
    false the beam is lost (NaN). Hits nearer than `range_min` give -inf, beams without a hit up to `range_max` +inf (REP 117).
    """
    n = beams.shape[0]
    ranges = np.empty(n)
    reach = range_max
    for i in range(noise.shape[0]):
        reach = max(reach, range_max - noise[i])  # a hit just beyond may be measured within
    resolution = grid[3]
    _, ny, nx = leaps.shape
    flat = leaps.ravel()
    c, s = math.cos(grid[2]), math.sin(grid[2])
    px = (c * (x - grid[0]) + s * (y - grid[1])) / resolution
    py = (c * (y - grid[1]) - s * (x - grid[0])) / resolution
    c, s = math.cos(yaw - grid[2]), math.sin(yaw - grid[2])
    for i in range(n):
        dx = c * beams[i, 0] - s * beams[i, 1]
        dy = s * beams[i, 0] + c * beams[i, 1]
        ranges[i] = resolution * cast_ray(flat, ny, nx, px, py, dx, dy, reach / resolution)

    # every disc meets the beams between its two tangents only
    c, s = math.cos(yaw), math.sin(yaw)
    for k in range(discs.shape[0]):
        if disc_tops[k] < height:
            continue
        wx, wy, r = discs[k, 0] - x, discs[k, 1] - y, discs[k, 2]
        d2 = wx * wx + wy * wy
        if d2 > (reach + r) * (reach + r):
            continue
        if d2 <= r * r:
            for i in range(n):
                ranges[i] = 0.0
            continue
        cx, cy = c * wx + s * wy, c * wy - s * wx  # its centre in the sensor's frame
        middle = math.atan2(cy, cx)
        half = math.asin(r / math.sqrt(d2))
        for turn in range(-1, 2):
            begin = (middle - half + 2.0 * math.pi * turn - angle_min) / angle_increment
            end = (middle + half + 2.0 * math.pi * turn - angle_min) / angle_increment
            if end < 0.0 or begin > n - 1:
                continue
            for i in range(max(0, math.floor(begin)), min(n - 1, math.ceil(end)) + 1):
                b = cx * beams[i, 0] + cy * beams[i, 1]
                h = r * r - (d2 - b * b)
                if h >= 0.0 and b > 0.0:
                    ranges[i] = min(ranges[i], b - math.sqrt(h))

    for k in range(circles.shape[0]):
        wx, wy, r = circles[k, 0] - x, circles[k, 1] - y, circles[k, 2]
        d2 = wx * wx + wy * wy
        if polygon_tops[k] < height or d2 > (reach + r) * (reach + r):
            continue
        low, high = first[k], first[k + 1]
        if d2 <= r * r and polygon_contains(corners[low:high], x, y):
            for i in range(n):
                ranges[i] = 0.0
            continue
        wx, wy = corners[high - 1, 0] - x, corners[high - 1, 1] - y
        ax, ay = c * wx + s * wy, c * wy - s * wx
        for j in range(low, high):
            wx, wy = corners[j, 0] - x, corners[j, 1] - y
            bx, by = c * wx + s * wy, c * wy - s * wx
            see_edge(ranges, beams, ax, ay, bx, by, angle_min, angle_increment)
            ax, ay = bx, by

    out = np.empty(n, np.float32)
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

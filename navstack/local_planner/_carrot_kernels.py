# pyright: basic
"""Points ahead on a path, and the collision check of the arc that a command drives."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import OUTSIDE, edge_cost, fastest_corner, overlapped_cost, place_footprint
from navstack.core.jit import kernel

SHORT_M = 1e-9
"""Segments up to this length have no direction (m)."""


@kernel
def passed_length(path, x, y, least):
    """Return how far along `path` (n, 3) the projection of (x, y) onto its first segment is (m).

    Negative before the first pose, at least `least`; at most the length of the segment.
    """
    for i in range(1, len(path)):
        dx, dy = path[i, 0] - path[0, 0], path[i, 1] - path[0, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length > SHORT_M:
            along = ((x - path[0, 0]) * dx + (y - path[0, 1]) * dy) / length
            return min(max(along, least), length)
    return 0.0


@kernel
def point_ahead(path, distance, beyond, out):
    """Write x, y and direction of the point `distance` (m) along `path` (n, 3) to `out` (3,). Returns the length to it (m).

    Interpolated linearly; the direction is that of the segment. A path that is shorter: its last pose, or with `beyond` the
    point on the prolonged last segment.
    """
    last = len(path) - 1
    passed = 0.0
    heading = path[last, 2]
    for i in range(last):
        dx, dy = path[i + 1, 0] - path[i, 0], path[i + 1, 1] - path[i, 1]
        length = math.sqrt(dx * dx + dy * dy)
        if length <= SHORT_M:
            continue
        heading = math.atan2(dy, dx) if beyond else heading
        if passed + length >= distance:
            share = (distance - passed) / length
            out[0] = path[i, 0] + share * dx
            out[1] = path[i, 1] + share * dy
            out[2] = math.atan2(dy, dx)
            return distance
        passed += length
    out[0], out[1], out[2] = path[last, 0], path[last, 1], path[last, 2]
    if beyond and passed > 0.0:
        more = distance - passed
        out[0] += more * math.cos(heading)
        out[1] += more * math.sin(heading)
        out[2] = heading
        return distance
    return passed


@kernel
def arc_collision(costs, grid, vertices, unknown_blocks, interior, turns, start, twist, limits, out):
    """Check the footprint on the arc that a constant velocity drives. Returns (index of the colliding pose or -1, poses).

    `grid` (3,): origin x, y and resolution. `start` (3,): the robot's pose, which is checked, too. `twist` (3,): v, turning
    speed, circumscribed radius. `limits` (3,): duration (s), distance from the start (m), 1 for the arc up to the end of the
    duration, or once around, 0 for Euler steps that end before it (Nav2), of which a slow robot makes none. A step is a cell
    along the path; with `turns`, no corner moves by more than a cell in it.
    `interior`: cells inside the footprint count, and a centre outside the grid collides; otherwise the edges alone, and such a
    pose is free (Nav2). `out` (m, 3) receives the poses; the check ends when it is full.
    """
    ny, nx = costs.shape
    resolution = grid[2]
    v, w = twist[0], twist[1]
    corners = vertices.T.copy()
    cells = np.empty(corners.shape, np.int32)
    placed = np.empty(corners.shape)
    if abs(v) < 0.01 and abs(w) > 0.01:
        dt = 2.0 * math.sin(0.5 * resolution / twist[2]) / abs(w)
    else:
        dt = resolution / abs(v) if v != 0.0 else np.inf
    fastest = fastest_corner(corners, v, 0.0, w) if turns else 0.0
    if fastest > 0.0:
        dt = min(dt, resolution / fastest)
    whole = limits[2] > 0.0
    duration = limits[0]
    if whole:
        duration = min(duration, 2.0 * math.pi / abs(w)) if w != 0.0 else duration
        dt = min(dt, duration)
    x, y, yaw = start[0], start[1], start[2]
    for i in range(len(out)):
        if i > 0:
            if not ((i - 1 if whole else i) * dt < duration):
                return -1, i
            step = min(dt, duration - (i - 1) * dt) if whole else dt
            heading = yaw + 0.5 * w * step if whole else yaw
            x += v * step * math.cos(heading)
            y += v * step * math.sin(heading)
            yaw += w * step
            if math.sqrt((x - start[0]) ** 2 + (y - start[1]) ** 2) > limits[1]:
                return -1, i
        out[i, 0], out[i, 1], out[i, 2] = x, y, yaw
        cx, cy = (x - grid[0]) / resolution, (y - grid[1]) / resolution
        if not (cx >= 0.0 and cy >= 0.0 and cx < nx and cy < ny):
            if interior:
                return i, i + 1
            continue
        cost = edge_cost(costs, grid[0], grid[1], resolution, corners, x, y, yaw, cells)
        if interior and cost != OUTSIDE:
            place_footprint(costs, grid[0], grid[1], resolution, corners, x, y, yaw, placed)
            cost = overlapped_cost(costs, placed, max(cost, np.int64(costs[int(cy), int(cx)])))
        if cost == 254 or cost == OUTSIDE or (cost == 255 and unknown_blocks):
            return i, i + 1
    return -1, len(out)

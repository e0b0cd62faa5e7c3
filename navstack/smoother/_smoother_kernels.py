# pyright: basic
"""Relaxation of paths toward their smooth form."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import overlaps_lethal, place_footprint
from navstack.core.jit import kernel
from navstack.curves.curve_kernels import centred

STEP = 0.1
"""Cells: largest motion of a point of the footprint between two checks of a motion."""
PADDING = 0.5 * STEP
"""Cells: a footprint with this padding that is free at the checks is free between them."""


@kernel
def relax(costs, grid, data, free, points, previous, weights, limits):
    """Move the `points` (n, 2) that are `free` (n,) toward the mean of their neighbors and toward `data` (n, 2), in sweeps.

    The ends stay. `costs` without cells: no point collides. `grid`: x and y of the origin, resolution. `weights`: of the data, of
    smoothness. `limits`: tolerance of a sweep (m), number of sweeps. `previous` is scratch. Returns whether it converged; if not,
    `points` are those of the last sweep without collision.
    """
    ny, nx = costs.shape
    n = len(points)
    previous[:] = points
    change = limits[0]
    sweeps = 0
    while change >= limits[0]:
        change = 0.0
        sweeps += 1
        if sweeps >= limits[1]:
            points[:] = previous
            return False
        for i in range(1, n - 1):
            if not free[i]:
                continue
            for j in range(2):
                old = points[i, j]
                points[i, j] = (
                    old
                    + weights[0] * (data[i, j] - old)
                    + weights[1] * (points[i + 1, j] + points[i - 1, j] - 2.0 * old)
                )
                change += abs(points[i, j] - old)
            if costs.size == 0:
                continue
            fx, fy = (points[i, 0] - grid[0]) / grid[2], (points[i, 1] - grid[1]) / grid[2]
            inside = fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny
            cost = np.int64(costs[np.int64(fy), np.int64(fx)]) if inside else 254
            if cost > 252 and cost != 255:
                points[:] = previous
                return False
        previous[:] = points
    return True


@kernel
def centre_blocked(costs, x, y):
    """Return True if the robot's centre, in cells, is in an inscribed or lethal cell, or outside the grid."""
    ny, nx = costs.shape
    if not (x >= 0.0 and y >= 0.0 and x < nx and y < ny):
        return True
    cost = costs[np.int64(y), np.int64(x)]
    return cost == 253 or cost == 254


@kernel
def pose_collision(costs, grid, corners, placed, padding, pose):
    """Return 2 if the centre at a pose (3,), or a point `padding` cells beside it, is blocked, 1 if the footprint is, else 0.

    `corners` (2, n): of the footprint (m), n = 0 for none. `placed` (2, n) is scratch.
    """
    x, y = (pose[0] - grid[0]) / grid[2], (pose[1] - grid[1]) / grid[2]
    for dx in (-padding, padding):
        for dy in (-padding, padding):
            if centre_blocked(costs, x + dx, y + dy):
                return 2
    if corners.shape[1] == 0:
        return 0
    inside = place_footprint(costs, grid[0], grid[1], grid[2], corners, pose[0], pose[1], pose[2], placed)
    return 1 if not inside or overlaps_lethal(costs, placed) else 0


@kernel
def is_empty(costs, grid, reach, a, b):
    """Return True if no cell within `reach` (m) of the box around two poses is inscribed, lethal or outside the grid."""
    ny, nx = costs.shape
    x0 = math.floor((min(a[0], b[0]) - reach - grid[0]) / grid[2])
    y0 = math.floor((min(a[1], b[1]) - reach - grid[1]) / grid[2])
    x1 = math.floor((max(a[0], b[0]) + reach - grid[0]) / grid[2])
    y1 = math.floor((max(a[1], b[1]) + reach - grid[1]) / grid[2])
    if x0 < 0 or y0 < 0 or x1 >= nx or y1 >= ny:
        return False
    for iy in range(y0, y1 + 1):
        for ix in range(x0, x1 + 1):
            if costs[iy, ix] == 253 or costs[iy, ix] == 254:
                return False
    return True


@kernel
def motion_collision(costs, grid, corners, padding, a, b):
    """Return the greatest `pose_collision` between the poses `a` and `b` (3,): on an arc, on a line where it turns by 0.5 rad."""
    reach = 2.0 * STEP * grid[2]
    for j in range(corners.shape[1]):
        reach = max(reach, math.hypot(corners[0, j], corners[1, j]))
    dx, dy = b[0] - a[0], b[1] - a[1]
    chord, turn = math.hypot(dx, dy), centred(b[2] - a[2])
    bend = math.sin(0.5 * turn) if abs(turn) < 0.5 else 0.0
    # an arc of less than 0.5 rad is at most a tenth longer than its chord and stays within an eighth of it
    if is_empty(costs, grid, reach + 0.13 * chord, a, b):
        return 0
    placed, pose = np.empty(corners.shape), np.empty(3)
    count = max(1, math.ceil((1.1 * chord + reach * abs(turn)) / (STEP * grid[2])))
    worst = 0
    for k in range(count):
        share = (k + 0.5) / count
        along, aside = share, 0.0
        if abs(bend) > 1e-6:
            # the chord of a part of the arc is turned from the whole chord by half of the rest of the turn
            part, angle = math.sin(0.5 * turn * share) / bend, 0.5 * turn * (1.0 - share)
            along, aside = part * math.cos(angle), -part * math.sin(angle)
        pose[0], pose[1] = a[0] + along * dx - aside * dy, a[1] + along * dy + aside * dx
        pose[2] = a[2] + share * turn
        worst = max(worst, pose_collision(costs, grid, corners, placed, padding, pose))
    return worst


@kernel
def collides_worse(costs, grid, exact, padded, before, after, worse):
    """Write which motions between successive poses of `after` (n, 3) collide worse than the same motions of `before` (m, 3).

    With m != n, any collision counts. `exact` and `padded`: corners of the footprint, and of that with PADDING. `worse` (n - 1,),
    or (1,) of a single pose.
    """
    same = len(before) == len(after)
    for i in range(len(worse)):
        j = min(i + 1, len(after) - 1)
        if same and (before[i] == after[i]).all() and (before[j] == after[j]).all():
            continue
        level = motion_collision(costs, grid, padded, PADDING, after[i], after[j])
        worse[i] = level > 0 and (not same or level > motion_collision(costs, grid, exact, 0.0, before[i], before[j]))

# pyright: basic
"""Costs and collisions along the trajectories of a batch."""

from __future__ import annotations

import numpy as np

from navstack.core.footprint_kernels import OUTSIDE, edge_cost, footprint_overlaps_lethal
from navstack.core.jit import kernel
from navstack.local_planner.mppi._sine_kernels import LANES

f32 = np.float32

FREE, COLLISION, CHECK = 0, 1, 2
"""What a cost under the centre means: no collision, a collision, the footprint decides."""


@kernel
def footprint_value(costs, place, corners, exact, x, y, yaw, scratch):
    """Return the highest cost on the edges of the footprint at a pose relative to the anchor; 254 beyond the grid.

    With `exact`, also 254 if the footprint overlaps a lethal cell that its edges miss. See `batch_costs`.
    """
    cells, placed = scratch
    origin_x, origin_y, resolution = place[0].origin_x, place[0].origin_y, place[0].resolution
    px, py, angle = np.float64(x), np.float64(y), np.float64(yaw)
    cost = edge_cost(costs, origin_x, origin_y, resolution, corners, px, py, angle, cells)
    if cost == OUTSIDE:
        return np.int64(254)
    missed = False
    if exact and cost != 254:
        missed = footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, px, py, angle, placed)
    return np.int64(254) if missed else cost


@kernel
def cells_of(costs, place, x, y, out):
    """Write the flat cells of LANES points to `out`; -1 beyond the grid."""
    ny, nx = costs.shape
    scale = f32(1.0 / place[0].resolution)
    shift_x = f32(-place[0].origin_x / place[0].resolution)
    shift_y = f32(-place[0].origin_y / place[0].resolution)
    width, height = f32(nx), f32(ny)
    columns = np.int32(nx)
    for i in range(LANES):
        fx = x[i] * scale + shift_x
        fy = y[i] * scale + shift_y
        inside = (fx >= f32(0.0)) & (fy >= f32(0.0)) & (fx < width) & (fy < height)
        ix = np.int32(fx if inside else f32(0.0))
        iy = np.int32(fy if inside else f32(0.0))
        out[i] = iy * columns + ix if inside else np.int32(-1)


@kernel
def batch_costs(costs, place, corners, points, step, values, meaning, unknown_free, exact, out, collided):
    """Write the sum of `values` of the costs under every `step`-th point to `out` (K,), and which trajectories collide.

    `place` (1,): origin of the grid relative to the points' anchor, and resolution (m). `values` (2, 256): what a cost under the
    centre adds, and a cost of the footprint where `meaning` (256,) says CHECK. A trajectory that collides adds nothing more.
    `unknown_free`: cost 255 under the footprint is no collision.
    """
    flat = costs.ravel()
    steps, number = points.shape[1], points.shape[2]
    scratch = np.empty(corners.shape, np.int32), np.empty(corners.shape)
    cells = np.empty(LANES, np.int32)
    total = np.empty(LANES, np.float32)
    hit = np.empty(LANES, np.bool_)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            total[i] = f32(0.0)
            hit[i] = False
        for t in range(0, steps, step):
            x, y, yaw = points[0, t], points[1, t], points[2, t]
            cells_of(costs, place, x[begin : begin + LANES], y[begin : begin + LANES], cells)
            for i in range(LANES):
                if hit[i]:
                    continue
                cost = flat[cells[i]] if cells[i] >= 0 else np.uint8(255)
                what = meaning[cost]
                if what == FREE:
                    total[i] += values[0, cost]
                else:
                    k = begin + i
                    value = np.int64(254)
                    if what == CHECK:
                        value = footprint_value(costs, place, corners, exact, x[k], y[k], yaw[k], scratch)
                    if value == 254 or (value == 255 and not unknown_free):
                        hit[i] = True
                    else:
                        total[i] += values[1, value] if values[1, 0] >= f32(0.0) else values[0, cost]
        for i in range(LANES):
            out[begin + i] = total[i]
            collided[begin + i] = hit[i]


@kernel
def first_collision(costs, place, corners, points, row, step, meaning, unknown_free, exact):
    """Return the first of every `step`-th point of a trajectory that collides, and its footprint's cost; -1 without one."""
    flat = costs.ravel()
    ny, nx = costs.shape
    scratch = np.empty(corners.shape, np.int32), np.empty(corners.shape)
    for t in range(0, points.shape[1], step):
        fx = (np.float64(points[0, t, row]) - place[0].origin_x) / place[0].resolution
        fy = (np.float64(points[1, t, row]) - place[0].origin_y) / place[0].resolution
        cost = np.uint8(255)
        if 0.0 <= fx < nx and 0.0 <= fy < ny:
            cost = flat[np.int64(fy) * nx + np.int64(fx)]
        if meaning[cost] == COLLISION:
            return t, np.int64(cost)
        if meaning[cost] == CHECK:
            value = footprint_value(
                costs, place, corners, exact, points[0, t, row], points[1, t, row], points[2, t, row], scratch
            )
            if value == 254 or (value == 255 and not unknown_free):
                return t, value
    return -1, np.int64(0)

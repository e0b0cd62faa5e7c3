# pyright: basic
"""What trajectories cost under the robot's outline (base_local_planner's ObstacleCostFunction)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner._footprint_kernels import between, footprint_cost

ILLEGAL = -6.0  # the critic's code


@kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Into `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1: no outline around the cell can cost more.

    The highest cost of all cells that an outline can touch whose points are at most `reach` cells from a centre anywhere in
    the cell: along each axis a point's cell is less than one cell off, and a cell of the walk half a cell more off the edge.
    Cells from which the outline can leave the map get 255. `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    source, across, target = costs.ravel(), rows.ravel(), out.ravel()
    radius = math.ceil(reach)
    low_x, high_x = max(x0, radius), min(x1, nx - radius)
    low_y, high_y = max(y0, radius), min(y1, ny - radius)
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            out[iy, ix] = 0 if low_x <= ix < high_x and low_y <= iy < high_y else 255
    if low_x >= high_x or low_y >= high_y:
        return
    # unsigned indices: nothing to wrap around, so that the loops over a row become vector instructions
    number = np.uint64(high_x - low_x)
    for iy in range(low_y - radius, high_y + radius):
        base = np.uint64(iy * nx + low_x)
        for i in range(number):
            across[base + i] = source[base + i]
    width = 0
    for dy in range(radius, -1, -1):
        squared = reach * reach
        wanted = 0
        if squared >= max(0.0, dy - 1.0) ** 2:
            wanted = int(1.5 + math.sqrt(squared - max(0.0, dy - 1.0) ** 2))
        if squared >= max(0.0, dy - 1.5) ** 2:
            wanted = max(wanted, int(1.0 + math.sqrt(squared - max(0.0, dy - 1.5) ** 2)))
        while width < min(wanted, radius):
            width += 1
            for iy in range(low_y - radius, high_y + radius):
                base = np.uint64(iy * nx + low_x)
                left = np.uint64(iy * nx + low_x - width)
                right = np.uint64(iy * nx + low_x + width)
                for i in range(number):
                    across[base + i] = max(across[base + i], max(source[left + i], source[right + i]))
        for iy in range(low_y, high_y):
            base = np.uint64(iy * nx + low_x)
            above = np.uint64((iy + dy) * nx + low_x)
            below = np.uint64((iy - dy) * nx + low_x)
            for i in range(number):
                target[base + i] = max(target[base + i], max(across[above + i], across[below + i]))


@kernel
def footprint_scale(command, scaling_speed, max_speed, max_scaling):
    """How much the outline has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > scaling_speed:
        return max_scaling * ((speed - scaling_speed) / (max_speed - scaling_speed)) + 1.0
    return 1.0


@kernel
def largest_scale(commands, alive, scaling_speed, max_speed, max_scaling):
    """The scale of the largest outline."""
    largest = 1.0
    for k in range(len(alive)):
        if alive[k]:
            largest = max(largest, footprint_scale(commands[k], scaling_speed, max_speed, max_scaling))
    return largest


@kernel
def obstacle_scores(
    costs,
    origin_x,
    origin_y,
    resolution,
    vertices,
    circumscribed,
    commands,
    poses,
    counts,
    alive,
    scaling_speed,
    max_speed,
    max_scaling,
    sum_scores,
    x0,
    y0,
    x1,
    y1,
    rows,
    bounds,
    cells,
    out,
    where,
):
    """ObstacleCostFunction: per trajectory the highest (or summed) cost of max(outline, centre), -6 where it collides.

    `circumscribed` (m): the outline's radius; it grows from `scaling_speed` to `max_speed` (m/s) by `max_scaling`. All points
    on the map lie in the cells x0 <= ix < x1, y0 <= iy < y1; `cells` (K, T): each point's flat cell, -1 off the map. `where`
    (K,): index of the first point that collides, -1 without. `rows` (ny, nx) and `bounds` (2, ny, nx) are scratch: what no
    outline around a cell can exceed. The outline is walked only where the costs around can change the result.
    """
    # two upper bounds: for the outline as it is, and for the one that has grown most
    if x0 < x1:
        reach = circumscribed / resolution + 1e-6
        farthest = float(costs.shape[0] + costs.shape[1])
        largest = largest_scale(commands, alive, scaling_speed, max_speed, max_scaling)
        highest_around(costs, x0, y0, x1, y1, min(reach, farthest), rows, bounds[0])
        if largest > 1.0:
            highest_around(costs, x0, y0, x1, y1, min(largest * reach, farthest), rows, bounds[1])
    flat = costs.ravel()
    number = len(vertices)
    corners = np.empty((2, number))
    scratch = np.empty((2, number), np.int32)
    middles = np.empty(25, np.int64)
    between(costs.shape[1], middles)
    around = np.empty(poses.shape[1], np.uint8)
    for k in range(len(counts)):
        where[k] = -1
        if not alive[k]:
            continue
        n = counts[k]
        scale = footprint_scale(commands[k], scaling_speed, max_speed, max_scaling)
        for j in range(number):
            corners[0, j] = scale * vertices[j, 0]
            corners[1, j] = scale * vertices[j, 1]
        bound = bounds[0 if scale == 1.0 else 1].ravel()
        # the costliest neighbourhood first: after it most points cannot raise the maximum
        most, first = np.uint8(0), 0
        for i in range(n):
            around[i] = 255 if cells[k, i] < 0 else bound[cells[k, i]]
            if around[i] > most:
                most, first = around[i], i
        if most == 0:
            out[k] = 0.0
            continue
        highest, total = np.int64(0), 0.0
        done = -1
        if not sum_scores and cells[k, first] >= 0:
            x, y, yaw = poses[k, first, 0], poses[k, first, 1], poses[k, first, 2]
            cost = footprint_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, middles, scratch)
            if cost < 254:  # a collision is found again below, in order, unless an earlier point collides
                highest = max(cost, np.int64(flat[cells[k, first]]))
                done = first
        for i in range(n):
            if around[i] == 0 or i == done or (around[i] <= highest and around[i] < 254 and not sum_scores):
                continue
            cost = np.int64(256)
            if cells[k, i] >= 0:
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                cost = footprint_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, middles, scratch)
            if cost >= 254:
                where[k] = i
                break
            cost = max(cost, np.int64(flat[cells[k, i]]))
            highest = max(highest, cost)
            total += cost
        if where[k] >= 0:
            out[k] = ILLEGAL
        else:
            out[k] = total if sum_scores else np.float64(highest)

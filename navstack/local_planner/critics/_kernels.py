# pyright: basic
"""Kernels of the critics obstacle, base_obstacle and oscillation."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.footprint_kernels import edge_cost, footprint_overlaps_lethal
from navstack.core.jit import kernel

# codes of the critics
IN_COLLISION = -6.0
REVERSAL = -5.0
OFF_MAP = -4.0


@kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Write an upper bound of the footprint's cost to `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1.

    The bound of a cell is the highest cost among all cells that a footprint can touch whose points are at most `reach` cells
    from a centre anywhere in that cell: along each axis a point's cell is less than one cell away, and a cell of a rasterized
    edge at most half a cell more. Cells from which the footprint can leave the map get 255. `rows` (ny, nx) is scratch.
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
    # unsigned indices cannot wrap around, so the loops over a row are vectorized
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
def footprint_scale(command, settings):
    """Factor by which the footprint has grown at the speed of `command`."""
    speed = math.hypot(command[0], command[1])
    if speed > settings.scaling_speed:
        return (
            settings.max_scaling * ((speed - settings.scaling_speed) / (settings.max_speed - settings.scaling_speed))
            + 1.0
        )
    return 1.0


@kernel
def bound_footprint_costs(costs, settings, commands, alive, box, bounds):
    """Write the upper bounds for the footprint (`bounds[0]`) and for the largest scaled footprint (`bounds[1]`).

    `box`: x0, y0, x1, y1, see `highest_around`. `bounds` (3, ny, nx): the last one is scratch.
    """
    x0, y0, x1, y1 = np.int64(box[0]), np.int64(box[1]), np.int64(box[2]), np.int64(box[3])
    if x0 >= x1:
        return
    largest = 1.0
    for k in range(len(alive)):
        if alive[k]:
            largest = max(largest, footprint_scale(commands[k], settings))
    reach = settings.circumscribed_radius / settings.resolution + 1e-6
    farthest = float(costs.shape[0] + costs.shape[1])
    highest_around(costs, x0, y0, x1, y1, min(reach, farthest), bounds[2], bounds[0])
    if largest > 1.0:
        highest_around(costs, x0, y0, x1, y1, min(largest * reach, farthest), bounds[2], bounds[1])


@kernel
def obstacle_scores(
    costs, settings_, vertices, commands, poses, counts, alive, cells, boxes, bounds, out, first_collision
):
    """ObstacleCostFunction: per rollout the highest (or summed) cost of max(footprint, centre); IN_COLLISION if it collides.

    It collides if an edge runs through a lethal or unknown cell, or if the footprint overlaps a lethal cell anywhere.
    ROS differs: only the cells of its edges are checked.

    `settings_` (1,): see `OBSTACLE_SETTINGS`. `cells` (K, T): flat cell of each point, -1 off the map; `boxes` (K + 1, 4):
    see `point_cells`. `first_collision` (K,): index of the first point in collision, -1 without. `bounds` (3, ny, nx) is
    scratch: the footprint is rasterized only where the upper bound of its cost can change the result.
    """
    settings = settings_[0]
    origin_x, origin_y, resolution = settings.origin_x, settings.origin_y, settings.resolution
    sum_scores = settings.sum_scores
    bound_footprint_costs(costs, settings, commands, alive, boxes[len(counts)], bounds)
    flat, flat_bounds = costs.ravel(), bounds.reshape(3, costs.size)
    number = len(vertices)
    corners = np.empty((2, number))
    corner_cells, placed = np.empty((2, number), np.int32), np.empty((2, number))
    around = np.empty(poses.shape[1], np.uint8)
    for k in range(len(counts)):
        first_collision[k] = -1
        if not alive[k]:
            continue
        n = counts[k]
        scale = footprint_scale(commands[k], settings)
        for j in range(number):
            corners[0, j] = scale * vertices[j, 0]
            corners[1, j] = scale * vertices[j, 1]
        bound = 0 if scale == 1.0 else 1
        # start at the point with the highest bound: after it most other points cannot raise the maximum
        most, first = np.uint8(0), 0
        for i in range(n):
            around[i] = 255 if cells[k, i] < 0 else flat_bounds[bound, cells[k, i]]
            if around[i] > most:
                most, first = around[i], i
        if most == 0:
            out[k] = 0.0
            continue
        highest, total = np.int64(0), 0.0
        done = -1
        if not sum_scores and cells[k, first] >= 0:
            x, y, yaw = poses[k, first, 0], poses[k, first, 1], poses[k, first, 2]
            cost = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, corner_cells)
            if most >= 254 and cost < 254:
                if footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed):
                    cost = np.int64(254)
            if cost < 254:  # the loop below finds a collision in order: an earlier point may collide, too
                highest = max(cost, np.int64(flat[cells[k, first]]))
                done = first
        for i in range(n):
            if around[i] == 0 or i == done or (around[i] <= highest and around[i] < 254 and not sum_scores):
                continue
            cost = np.int64(256)
            if cells[k, i] >= 0:
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                cost = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, corner_cells)
                if around[i] >= 254 and cost < 254:
                    if footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed):
                        cost = np.int64(254)
            if cost >= 254:
                first_collision[k] = i
                break
            cost = max(cost, np.int64(flat[cells[k, i]]))
            highest = max(highest, cost)
            total += cost
        if first_collision[k] >= 0:
            out[k] = IN_COLLISION
        else:
            out[k] = total if sum_scores else np.float64(highest)


@kernel
def centre_costs(costs, cells, counts, alive, sum_scores, out):
    """BaseObstacleCritic of Nav2: cost at each rollout's last cell, or the sum over all its points.

    IN_COLLISION or OFF_MAP, whichever comes first.

    `cells` (K, T): flat, -1 off the map.
    """
    flat = costs.ravel()
    for k in range(len(counts)):
        if not alive[k]:
            continue
        score = 0.0
        for i in range(counts[k]):
            if cells[k, i] < 0:
                score = OFF_MAP
                break
            cost = flat[cells[k, i]]
            if cost >= 253:
                score = IN_COLLISION
                break
            score = score + cost if sum_scores else float(cost)
        out[k] = score


@kernel
def oscillation_scores(commands, sign_x, sign_y, sign_theta, out):
    """OscillationCostFunction: REVERSAL for each command against the only allowed sign of an axis, else 0; `out` (K,).

    Signs: 1, -1, or 0 to allow both.
    """
    for k in range(len(commands)):
        reversal = commands[k, 0] * sign_x < 0.0 or commands[k, 1] * sign_y < 0.0 or commands[k, 2] * sign_theta < 0.0
        out[k] = REVERSAL if reversal else 0.0

# pyright: basic
"""Kernels of the critics obstacle, base_obstacle and oscillation."""

from __future__ import annotations

import numpy as np

from navstack.core.footprint_kernels import edge_cost, footprint_overlaps_lethal
from navstack.core.jit import kernel
from navstack.local_planner.critics._bound_kernels import BOUND_GRIDS, bound_footprint_costs, footprint_scale
from navstack.local_planner.critics._footprint_table_kernels import split_table_scratch
from navstack.local_planner.critics._table_score_kernels import IN_COLLISION, table_scores

# codes of the critics
REVERSAL = -5.0
OFF_MAP = -4.0


@kernel
def obstacle_scores(
    costs, settings_, vertices, commands, poses, counts, alive, cells, boxes, scratch, out, first_collision
):
    """ObstacleCostFunction: per rollout the highest (or summed) cost of max(footprint, centre); IN_COLLISION if it collides.

    It collides if an edge runs through a lethal or unknown cell, or if the footprint overlaps a lethal cell anywhere.
    ROS differs: only the cells of its edges are checked.

    `settings_` (1,): see `OBSTACLE_SETTINGS`. `cells` (K, T): flat cell of each point, -1 off the map; `boxes` (K + 1, 4):
    see `point_cells`. `first_collision` (K,): index of the first point in collision, -1 without. `scratch`: see
    `ObstacleScratch`; its size decides whether tables of the edges are used.
    """
    bounds = costs.size * BOUND_GRIDS
    tables = (bounds + 7) // 8 * 8
    if len(scratch) > tables:
        grid = scratch[: costs.size].reshape(costs.shape)
        parts = (*split_table_scratch(scratch[tables:], cells.size, len(vertices)), grid)
        box = boxes[len(counts)]
        if table_scores(
            costs, settings_, vertices, commands, poses, counts, alive, cells, box, parts, out, first_collision
        ):
            return
    grids = scratch[:bounds].reshape(BOUND_GRIDS, costs.size)
    walked_scores(costs, settings_, vertices, commands, poses, counts, alive, cells, boxes, grids, out, first_collision)


@kernel
def walked_scores(
    costs, settings_, vertices, commands, poses, counts, alive, cells, boxes, bounds, out, first_collision
):
    """`obstacle_scores` by walking the edges of footprints, where an upper bound of their cost can change the result.

    `bounds` (BOUND_GRIDS, ny * nx) is scratch.
    """
    settings = settings_[0]
    origin_x, origin_y, resolution = settings.origin_x, settings.origin_y, settings.resolution
    sum_scores = settings.sum_scores
    ny, nx = costs.shape
    bound_footprint_costs(costs, settings, commands, alive, boxes[len(counts)], bounds.reshape(BOUND_GRIDS, ny, nx))
    flat = costs.ravel()
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
            around[i] = 255 if cells[k, i] < 0 else bounds[bound, cells[k, i]]
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
                overlap = footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
                cost = np.int64(254) if overlap else cost
            # in collision: the loop below searches for the first point that is
            highest = max(cost, np.int64(flat[cells[k, first]])) if cost < 254 else np.int64(253)
            done = first if cost < 254 else -1
        for i in range(n):
            if around[i] == 0 or i == done or (around[i] <= highest and around[i] < 254 and not sum_scores):
                continue
            cost = np.int64(256)
            if cells[k, i] >= 0:
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                cost = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, corner_cells)
                if around[i] >= 254 and cost < 254:
                    overlap = footprint_overlaps_lethal(
                        costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed
                    )
                    cost = np.int64(254) if overlap else cost
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

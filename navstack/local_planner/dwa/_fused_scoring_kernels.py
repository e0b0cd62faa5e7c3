# pyright: basic
"""The seven default critics in two calls per cycle: the same kernels in the same order as one by one."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner._map_grid_kernels import centre_scores, extend_plan, nose_scores, start_wavefront
from navstack.local_planner._rollout_kernels import point_cells
from navstack.local_planner._scoring_kernels import add_scores, begin_table, lowest_total
from navstack.local_planner.critics._kernels import obstacle_scores, oscillation_scores

OSCILLATION, OBSTACLE, GOAL_FRONT, ALIGNMENT, PATH, GOAL, TWIRLING = range(7)
CRITICS = 7
FRONT_GRID, PATH_GRID, GOAL_GRID = range(3)


@kernel
def split_cells(cells, number, longest):
    """Views of `cells` (2 * K * T + 4 * (K + 1),) int32: flat and padded (K, T), boxes (K + 1, 4); see `point_cells`."""
    size = number * longest
    flat = cells[:size].reshape(number, longest)
    padded = cells[size : 2 * size].reshape(number, longest)
    return flat, padded, cells[2 * size : 2 * size + 4 * (number + 1)].reshape(number + 1, 4)


@kernel
def split_scores(scores, number):
    """Views of `scores` (9 * K,): table (K, 7), totals (K,), scores of one critic (K,)."""
    table = scores[: CRITICS * number].reshape(number, CRITICS)
    return table, scores[CRITICS * number : (CRITICS + 1) * number], scores[(CRITICS + 1) * number :]


@kernel
def score_motion_and_obstacles(
    costs, cycle, vertices, commands, poses, counts, alive, cells, scratch, scores, rejected_by, first_collision
):
    """Begin the table and score the critics oscillation and obstacle.

    `cycle` (1,): see `CYCLE`. `cells`: see `split_cells`; `scores`: see `split_scores`; others: see `obstacle_scores`.
    """
    weights = cycle[0].weights
    table, totals, raw = split_scores(scores, len(counts))
    flat, padded, boxes = split_cells(cells, len(counts), poses.shape[1])
    begin_table(counts, alive, table, totals, rejected_by)
    point_cells(poses, counts, cycle, flat, padded, boxes)
    if weights[OSCILLATION] != 0.0:
        oscillation_scores(commands, cycle[0].sign_x, cycle[0].sign_y, cycle[0].sign_theta, raw)
        add_scores(raw, weights[OSCILLATION], OSCILLATION, alive, table, totals, rejected_by)
    if weights[OBSTACLE] != 0.0:
        obstacle_scores(
            costs, cycle, vertices, commands, poses, counts, alive, flat, boxes, scratch, raw, first_collision
        )
        add_scores(raw, weights[OBSTACLE], OBSTACLE, alive, table, totals, rejected_by)


@kernel
def score_grids_and_rotation(costs, cycle, plan, commands, poses, counts, alive, cells, grids, scores, rejected_by):
    """Score the critics goal_front, alignment, path, goal and twirling. Returns the index of the lowest total, or -1.

    `grids` (3, n): storage of the grids FRONT_GRID, PATH_GRID and GOAL_GRID, see `start_wavefront`.
    """
    now = cycle[0]
    weights = now.weights
    table, totals, raw = split_scores(scores, len(counts))
    _, padded, boxes = split_cells(cells, len(counts), poses.shape[1])
    x, y, yaw = now.pose_x, now.pose_y, now.pose_yaw

    ahead = now.goal_front_ahead
    nose_x, nose_y = x + ahead * math.cos(yaw), y + ahead * math.sin(yaw)
    extended = extend_plan(plan, x, y, ahead)
    start_wavefront(costs, cycle, extended, True, False, nose_x, nose_y, grids[FRONT_GRID])
    start_wavefront(costs, cycle, plan, False, False, x, y, grids[PATH_GRID])
    start_wavefront(costs, cycle, plan, True, True, x, y, grids[GOAL_GRID])

    if weights[GOAL_FRONT] != 0.0:
        nose_scores(cycle, grids[FRONT_GRID], poses, counts, boxes, alive, ahead, raw)
        add_scores(raw, weights[GOAL_FRONT], GOAL_FRONT, alive, table, totals, rejected_by)
    if weights[ALIGNMENT] != 0.0:
        nose_scores(cycle, grids[PATH_GRID], poses, counts, boxes, alive, now.alignment_ahead, raw)
        add_scores(raw, weights[ALIGNMENT], ALIGNMENT, alive, table, totals, rejected_by)
    if weights[PATH] != 0.0:
        centre_scores(cycle, grids[PATH_GRID], padded, counts, alive, raw)
        add_scores(raw, weights[PATH], PATH, alive, table, totals, rejected_by)
    if weights[GOAL] != 0.0:
        centre_scores(cycle, grids[GOAL_GRID], padded, counts, alive, raw)
        add_scores(raw, weights[GOAL], GOAL, alive, table, totals, rejected_by)
    if weights[TWIRLING] != 0.0:
        for k in range(len(counts)):
            raw[k] = np.abs(commands[k, 2])
        add_scores(raw, weights[TWIRLING], TWIRLING, alive, table, totals, rejected_by)
    return lowest_total(totals, alive)

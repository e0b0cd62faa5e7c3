# pyright: basic
"""One cycle of move_base's seven critics in one call: what `scoring.score` does with them one by one, by the same kernels."""

from __future__ import annotations

import math

from navstack.core.jit import kernel
from navstack.local_planner._map_grid_kernels import center_scores, nose_scores, start_wave
from navstack.local_planner._rollout_kernels import point_cells
from navstack.local_planner._scoring_kernels import begin, fold, lowest
from navstack.local_planner.critics._obstacle_kernels import obstacle_scores

OSCILLATION, OBSTACLE, GOAL_FRONT, ALIGNMENT, PATH, GOAL, TWIRLING = range(7)
TURNS_BACK = -5.0  # the code of the oscillation critic


@kernel
def oscillation_scores(samples, only_x, only_y, only_theta, out):
    """Of each sample: TURNS_BACK where it goes against a sign that alone is allowed (1, -1; 0 allows both), else 0."""
    for k in range(len(samples)):
        against = samples[k, 0] * only_x < 0.0 or samples[k, 1] * only_y < 0.0 or samples[k, 2] * only_theta < 0.0
        out[k] = TURNS_BACK if against else 0.0


@kernel
def pushed_on(plan, x, y, ahead):
    """The plan with its last pose moved by `ahead` (m) away from (x, y)."""
    pushed = plan.copy()
    last = len(plan) - 1
    bearing = math.atan2(plan[last, 1] - y, plan[last, 0] - x)
    pushed[last, 0] += ahead * math.cos(bearing)
    pushed[last, 1] += ahead * math.sin(bearing)
    return pushed


@kernel
def score_default(
    costs,
    origin_x,
    origin_y,
    resolution,
    vertices,
    circumscribed,
    scaling_speed,
    max_speed,
    max_scaling,
    sum_scores,
    plan,
    pose_x,
    pose_y,
    pose_yaw,
    front_ahead,
    alignment_ahead,
    only_x,
    only_y,
    only_theta,
    scales,
    samples,
    poses,
    counts,
    distances,
    queues,
    waves,
    seeds,
    rows,
    bounds,
    cells,
    boxes,
    raw,
    first_collision,
    alive,
    table,
    totals,
    rejected_by,
    never,
):
    """Index of the best trajectory, -1 when all are rejected.

    Three grids, in the order goal front, path, goal: `distances`, `queues` and `waves`, a row each: see `start_wave`,
    `seeds` (3, 2) what `start_wave` returned. `rows`, `bounds`: see `obstacle_scores`; `cells` (2, K * T) flat, then ringed;
    `boxes` (K, 4): see `point_cells`. `scales` (7,); `table` (K, 7), `totals`, `rejected_by`, `alive` (K,): see `fold`.
    `raw` (K,) is scratch, `first_collision` (K,): see `obstacle_scores`.
    """
    ny, nx = costs.shape
    number, longest = len(counts), poses.shape[1]
    begin(counts, never, alive, table, totals, rejected_by)
    flat = cells[0, : number * longest].reshape(number, longest)
    ringed = cells[1, : number * longest].reshape(number, longest)
    x0, y0, x1, y1 = point_cells(poses, counts, nx, ny, origin_x, origin_y, resolution, flat, ringed, boxes)

    if scales[OSCILLATION] != 0.0:
        oscillation_scores(samples, only_x, only_y, only_theta, raw)
        fold(raw, scales[OSCILLATION], OSCILLATION, alive, table, totals, rejected_by)

    if scales[OBSTACLE] != 0.0:
        obstacle_scores(
            costs,
            origin_x,
            origin_y,
            resolution,
            vertices,
            circumscribed,
            samples,
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
            flat,
            raw,
            first_collision,
        )
        fold(raw, scales[OBSTACLE], OBSTACLE, alive, table, totals, rejected_by)

    front = pushed_on(plan, pose_x, pose_y, front_ahead)
    for grid in range(3):
        distance, queue, wave = distances[grid], queues[grid], waves[grid]
        # as the critics ask for them: goal front and goal look at the plan's last cell, alignment and path at all of it
        towards = front if grid == 0 else plan
        # trajectories end around the robot, their noses around its nose
        ahead = front_ahead if grid == 0 else 0.0
        to_x, to_y = pose_x + ahead * math.cos(pose_yaw), pose_y + ahead * math.sin(pose_yaw)
        begun = start_wave(
            costs, origin_x, origin_y, resolution, towards, grid != 1, grid == 2, to_x, to_y, distance, queue, wave
        )
        seeds[grid, 0], seeds[grid, 1] = begun
        if grid < 2:
            critic = GOAL_FRONT if grid == 0 else ALIGNMENT
            ahead = front_ahead if grid == 0 else alignment_ahead
            if scales[critic] != 0.0:
                nose_scores(
                    distance,
                    queue,
                    wave,
                    nx,
                    ny,
                    origin_x,
                    origin_y,
                    resolution,
                    poses,
                    counts,
                    boxes,
                    alive,
                    ahead,
                    raw,
                )
                fold(raw, scales[critic], critic, alive, table, totals, rejected_by)
        if grid > 0:
            critic = PATH if grid == 1 else GOAL
            if scales[critic] != 0.0:
                center_scores(distance, queue, wave, nx, ny, ringed, counts, alive, raw)
                fold(raw, scales[critic], critic, alive, table, totals, rejected_by)

    if scales[TWIRLING] != 0.0:
        for k in range(number):
            raw[k] = abs(samples[k, 2])
        fold(raw, scales[TWIRLING], TWIRLING, alive, table, totals, rejected_by)
    return lowest(totals, alive)

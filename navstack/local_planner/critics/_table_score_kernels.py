# pyright: basic
"""Scores of the critic obstacle by tables of the edges' costs and a list of lethal cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.local_planner.critics._bound_kernels import footprint_scale, largest_scale
from navstack.local_planner.critics._edge_table_kernels import COS, SCALE, SIN, YAW, X, Y
from navstack.local_planner.critics._footprint_table_kernels import edge_costs
from navstack.local_planner.critics._lethal_cell_kernels import (
    NEAR,
    SECTORS,
    SECTORS_PER_RADIAN,
    SLACK,
    UNKNOWN,
    cells_within,
    outer_planes,
    outline_cells,
    overlaps_outline,
    reach_of_class,
)
from navstack.local_planner.critics._patch_kernels import (
    ROW,
    copy_patch,
    highest_in_octagons,
    octagon_reach,
    patch_size,
    write_bounds,
)

IN_COLLISION = -6.0
LARGEST_RADIUS = 1e4
"""Cells."""
SAMPLE = 8
"""The first check of a rollout is tried with one of this many rollouts."""
WORTH_CHECKING = 0.6
"""If more of the points remain to be examined after the first check, it is not worth while."""


@kernel
def choose_highest(cells, bounds, counts, alive, around, first, chosen, out):
    """Choose the point with the highest bound of each rollout that is alive; rollouts without a bound above 0 get the score 0.

    Writes the bounds of all points to `around`, row after row from `first[k]` on, and rows and points to `chosen` (2, N); returns
    their number.
    """
    number = 0
    at = 0
    for k in range(len(counts)):
        first[k] = at
        if not alive[k]:
            continue
        most, point = np.uint8(0), 0
        for i in range(counts[k]):
            cell = cells[k, i]
            bound = np.uint8(255) if cell < 0 else bounds[np.uint64(cell)]
            around[np.uint64(at + i)] = bound
            if bound > most:
                most, point = bound, i
        at += counts[k]
        out[k] = 0.0
        if most > 0:
            chosen[0, number], chosen[1, number] = k, point
            number += 1
    return number


@kernel
def choose_others(cells, costs, counts, alive, around, found, keep_all, chosen, near, selected, out):
    """Choose the points that can raise a rollout's score, or collide; write the score of the first choice to `out` (K,).

    `chosen` (2, n), `found`: the choice of `choose_highest`, and the costs of the footprint there; `chosen` is overwritten.
    With `keep_all`, all points with a bound above 0 are chosen. `near` (N,): whether a footprint can overlap a lethal cell.
    `selected` (K,): points per row.
    """
    rows, points = chosen[0, : len(found)].copy(), chosen[1, : len(found)].copy()
    number, n, at = 0, 0, 0
    for k in range(len(counts)):
        if not alive[k]:
            continue
        begin = at
        at += counts[k]
        selected[k] = 0
        if n == len(rows) or rows[n] != k:
            continue  # all bounds are 0
        least, done = 0, -1
        if not keep_all:
            point = points[n]
            cell = cells[k, point]
            # near a collision: other collisions matter, too
            least = 253 if cell < 0 else min(np.int64(max(found[n], costs[np.uint64(cell)])), 253)
            if around[begin + point] < 254:
                out[k] = least
                done = point
        n += 1
        before = number
        for i in range(counts[k]):
            bound = np.int64(around[np.uint64(begin + i)])
            chosen[0, number], chosen[1, number], near[number] = k, i, bound >= 254
            number += ((bound > least) | (bound >= 254)) & (i != done)
        selected[k] = number - before


@kernel
def share_to_check(cells, costs, counts, first, around, chosen, found):
    """Estimate the share of points that `choose_others` chooses, from the rollouts of `chosen` (2, n) with the costs `found`
    (n,).

    `first` (K,): where the bounds of a row begin in `around`.
    """
    checked, total = 0, 1
    for n in range(chosen.shape[1]):
        k = chosen[0, n]
        cell = cells[k, chosen[1, n]]
        least = np.uint8(255) if cell < 0 else max(found[n], costs[np.uint64(cell)])
        for i in range(first[k], first[k] + counts[k]):
            checked += around[i] > least
        total += counts[k]
    return checked / total


@kernel
def table_scores(costs, settings_, vertices, commands, poses, counts, alive, cells, box, parts, out, first_collision):
    """`obstacle_scores` for footprints with long edges. Returns False, without a result, if `parts` are too small.

    `parts`: see `split_table_scratch`; others: see `obstacle_scores`.
    """
    settings = settings_[0]
    packed, codes, chosen, by_point, grids, memory, classes, outline, bounds = parts
    found, around, doubtful, near = by_point[0], by_point[1], by_point[2], by_point[3]
    ny, nx = costs.shape
    x0, y0, x1, y1 = np.int64(box[0]), np.int64(box[1]), np.int64(box[2]), np.int64(box[3])
    radius = largest_scale(commands, alive, settings) * settings.circumscribed_radius / settings.resolution
    if x0 >= x1 or not radius < LARGEST_RADIUS:
        return False
    square, diamond = octagon_reach(radius)
    reach = square + diamond
    area = max(x0 - reach, 0), max(y0 - reach, 0), min(x1 + reach, nx), min(y1 + reach, ny)
    along_y = y1 - y0 > x1 - x0
    rows, pitch = patch_size(area, along_y)
    size = rows * pitch + ROW
    class_number = (x1 - x0 + 2) * (y1 - y0 + 2) * SECTORS
    if size > grids.shape[1] or class_number > len(classes):
        return False
    patch = grids[0, :size]
    copy_patch(costs, area, along_y, pitch, patch)
    highest, shift = highest_in_octagons(patch, pitch, radius, grids[1, :size], grids[2, :size])
    write_bounds(highest, shift, area, along_y, pitch, reach, costs, (x0, y0, x1, y1), bounds)
    flat, flat_bounds = costs.ravel(), bounds.ravel()
    scales = np.empty(len(counts))
    for k in range(len(counts)):
        scales[k] = footprint_scale(commands[k], settings)
        first_collision[k] = -1
    extent = abs(settings.origin_x) + abs(settings.origin_y) + (nx + ny) * settings.resolution
    frame = area, along_y, pitch, nx, ny, 1e-7 + 1e-9 * reach + 1e-15 * extent / settings.resolution
    first, selected = np.empty(len(counts), np.int64), np.zeros(len(counts), np.int64)
    number = choose_highest(cells, flat_bounds, counts, alive, around, first, chosen, out)
    nothing = memory[0][:0], memory[1], memory[2]
    # some of these points show whether the others are worth while
    keep_all = settings.sum_scores
    if not keep_all and number > 0:
        some = chosen[:, :number:SAMPLE].copy()
        edge_costs(vertices, settings, poses, some, scales, frame, patch, packed, codes, doubtful, found, nothing)
        keep_all = share_to_check(cells, flat, counts, first, around, some, found) > WORTH_CHECKING
    points = chosen[:, :number]
    if not keep_all:
        edge_costs(vertices, settings, poses, points, scales, frame, patch, packed, codes, doubtful, found, nothing)
    choose_others(cells, flat, counts, alive, around, found[:number], keep_all, chosen, near, selected, out)
    number = selected.sum()
    points = chosen[:, :number]
    edge_costs(vertices, settings, poses, points, scales, frame, patch, packed, codes, doubtful, found, memory)
    lethal = 0
    for n in range(np.uint64(number)):
        lethal += near[n]
    if lethal > 0:
        lethal = outline_cells(costs, area, outline[0], outline[1])
        classes[:class_number] = UNKNOWN
    if lethal < 0:
        return False
    nearby = outline[0, :lethal], outline[1, :lethal], outline[2, :lethal]
    where = area, (x0, y0, x1 - x0 + 2), radius
    checks = found, near, selected
    combine(
        costs, settings_, vertices, poses, cells, points, checks, packed, nearby, (where, classes), out, first_collision
    )
    return True


@kernel
def combine(costs, settings_, vertices, poses, cells, chosen, checks, packed, outline, where_, out, first_collision):
    """Write the scores of the rollouts with chosen points to `out` and `first_collision`.

    `checks`: costs of the edges at these points, where to look for lethal cells, `outline`, under the footprint, and points
    per row.
    """
    settings = settings_[0]
    found, near, selected = checks
    (area, (x0, y0, columns), radius), classes = where_
    flat = costs.ravel()
    planes = np.empty((len(vertices), 3))
    planes = planes[: outer_planes(vertices, settings.resolution, planes)]
    largest = radius * settings.resolution / settings.circumscribed_radius
    corners, placed = np.empty((2, len(vertices))), np.empty((2, len(vertices)))
    end = 0
    for k in range(len(selected)):
        begin, end = end, end + selected[k]
        highest, total = np.int64(out[k]), np.int64(0)
        for n in range(begin, end):
            i = np.uint64(chosen[1, n])
            cell, cost = cells[k, i], np.int64(found[n])
            collides = cell < 0 or cost >= 254
            if near[n] and not collides:
                x, y, yaw = packed[X, n], packed[Y, n], packed[YAW, n]
                sector = math.floor(yaw * SECTORS_PER_RADIAN) & (SECTORS - 1)
                at = ((int(y) + 1 - y0) * columns + int(x) + 1 - x0) * SECTORS + sector
                x, y = x - area[0], y - area[1]
                if classes[at] == UNKNOWN:
                    classes[at] = reach_of_class(outline, planes, (x, y, yaw, largest), radius)
                if classes[at] == NEAR:
                    scale = packed[SCALE, n]
                    pose = x, y, packed[COS, n], packed[SIN, n], scale
                    if cells_within(outline, planes, pose, SLACK) > 0:
                        for j in range(len(vertices)):
                            corners[0, j], corners[1, j] = scale * vertices[j, 0], scale * vertices[j, 1]
                        collides = overlaps_outline(costs, settings, corners, poses[k, i], outline, area, placed)
            if collides:
                first_collision[k] = i
                break
            cost = max(cost, np.int64(flat[np.uint64(cell)]))
            highest = max(highest, cost)
            total += cost
        if first_collision[k] >= 0:
            out[k] = IN_COLLISION
        elif end > begin:
            out[k] = np.float64(total if settings.sum_scores else highest)

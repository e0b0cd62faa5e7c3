# pyright: basic
"""The two heuristics of the search over poses.

Obstacles: cheapest path over the cells to the goal, for a robot without heading (Dijkstra, expanded as far as it is needed, with
buckets as wide as the least step, so the order within one does not matter). Distance: length of the shortest curve to the goal
without obstacles, with the cost of its cusps, in a table that is filled where it is read.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import plain_kernel
from navstack.curves.curve_kernels import dubins, reeds_shepp
from navstack.curves.cusp_kernels import cheapest_curve

RING = 1024
"""Buckets of the obstacle heuristic: more than the greatest growth of g + focus in a step, in buckets, plus two."""
WIDTH = 0.5
"""Cells: width of these buckets."""
SQRT2 = math.sqrt(2.0)
UNREACHED = np.float32(np.inf)


@plain_kernel
def field_weight(costs, p, cx, cy):
    """Return the cost of a step into a cell of the obstacle heuristic, -1 if it is blocked: the least of the cells in it."""
    ny, nx = costs.shape
    f = p.factor
    least = np.int64(1000)
    for iy in range(cy * f, min((cy + 1) * f, ny)):
        for ix in range(cx * f, min((cx + 1) * f, nx)):
            cost = np.int64(costs[iy, ix])
            if cost == 255:
                cost = 1000 if p.unknown_blocked != 0 else 255
            elif cost >= 253:
                cost = 1000
            least = min(least, cost)
    if least == 1000:
        return -1.0
    share = least / 252.0
    if p.quadratic != 0:
        share *= share
    return 1.0 + p.cost_penalty * share


@plain_kernel
def unlink(field, heads, cell, bucket):
    """Take a cell out of the list of its bucket."""
    after, before = field[cell].next, field[cell].previous
    if before >= 0:
        field[before].next = after
    else:
        heads[bucket] = after
    if after >= 0:
        field[after].previous = before


@plain_kernel
def link(field, heads, cell, bucket):
    """Put a cell at the front of the list of a bucket."""
    first = heads[bucket]
    field[cell].next, field[cell].previous = first, -1
    if first >= 0:
        field[first].previous = cell
    heads[bucket] = cell


@plain_kernel
def focus(p, cx, cy):
    """Return the octile distance to the focus: cells on the way there are closed before those behind the goal."""
    dx, dy = abs(cx - p.focus_x), abs(cy - p.focus_y)
    return max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy)


@plain_kernel
def expand_field(costs, field, heads, p, width, target):
    """Expand the obstacle heuristic until `target` is closed, or nothing is left; `heads`: RING entries.

    A cell that is closed too early, by less than the width of a bucket, is opened again.
    """
    height = len(field) // width
    while p.open_cells > 0 and field[target].cost <= 0.0:
        cell = heads[p.level % RING]
        if cell < 0:
            p.level += 1
            continue
        unlink(field, heads, cell, p.level % RING)
        p.open_cells -= 1
        p.closed_cells += 1
        g = -field[cell].cost
        field[cell].cost = g
        cx, cy = cell % width, cell // width
        p.low_x, p.high_x = min(p.low_x, cx), max(p.high_x, cx)
        p.low_y, p.high_y = min(p.low_y, cy), max(p.high_y, cy)
        for dy in range(-1, 2):
            iy = cy + dy
            if iy < 0 or iy >= height:
                continue
            for dx in range(-1, 2):
                ix = cx + dx
                if (dx == 0 and dy == 0) or ix < 0 or ix >= width:
                    continue
                other = iy * width + ix
                row = field[other]
                if row.weight == 0.0:
                    row.weight = field_weight(costs, p, ix, iy)
                    if row.weight < 0.0:
                        row.cost = UNREACHED
                if row.weight < 0.0:
                    continue
                known = row.cost
                new = np.float32(g + (SQRT2 if dx != 0 and dy != 0 else 1.0) * row.weight)
                if known != 0.0 and new >= abs(known):
                    continue
                ahead = focus(p, ix, iy)
                if known < 0.0:
                    unlink(field, heads, other, np.int64((ahead - known) / WIDTH) % RING)
                    p.open_cells -= 1
                row.cost = -new
                bucket = np.int64((ahead + new) / WIDTH)
                link(field, heads, other, bucket % RING)
                p.level = min(p.level, bucket)
                p.open_cells += 1


@plain_kernel
def obstacle_cost(costs, field, heads, p, ix, iy):
    """Return the cost from a cell to the goal, in cells; infinite where the goal cannot be reached."""
    width = (costs.shape[1] + p.factor - 1) // p.factor
    cell = (iy // p.factor) * width + ix // p.factor
    if field[cell].cost <= 0.0:
        expand_field(costs, field, heads, p, width, cell)
        if field[cell].cost <= 0.0:
            field[cell].cost = UNREACHED
    return field[cell].cost * p.factor


@plain_kernel
def start_field(costs, field, heads, p, goal_x, goal_y, start_x, start_y):
    """Open the cell of the goal; the heuristic will be expanded toward the start first."""
    for i in range(RING):
        heads[i] = -1
    width = (costs.shape[1] + p.factor - 1) // p.factor
    p.focus_x, p.focus_y = np.int64(start_x) // p.factor, np.int64(start_y) // p.factor
    cx, cy = np.int64(goal_x) // p.factor, np.int64(goal_y) // p.factor
    cell = cy * width + cx
    field[cell].cost, field[cell].weight = np.float32(-1e-5), np.float32(1.0)
    bucket = np.int64((focus(p, cx, cy) + np.float32(1e-5)) / WIDTH)
    link(field, heads, cell, bucket % RING)
    p.level, p.open_cells, p.closed_cells = bucket, 1, 0
    p.low_x, p.high_x, p.low_y, p.high_y = cx, cx, cy, cy


@plain_kernel
def turn_drive_turn(p, dx, dy, yaw, goal_yaw):
    """Return the cost of a turn in place, a straight line, and a turn in place from a pose that is (dx, dy) from the goal."""
    first, last = 0.0, abs(angle(goal_yaw - yaw))
    if abs(dx) + abs(dy) > 1.0:
        direction = math.atan2(-dy, -dx)
        first, last = abs(angle(direction - yaw)), abs(angle(goal_yaw - direction))
    turns = np.int64(first / p.turn_step) + np.int64(last / p.turn_step)
    return math.hypot(dx, dy) + turns * p.rotation


@plain_kernel
def angle(a):
    """Return an angle in [-pi, pi)."""
    return a - 2.0 * math.pi * math.floor(a / (2.0 * math.pi) + 0.5)


@plain_kernel
def apart(p, x, y, yaw, goal):
    """Return the distance from a pose to a goal (3,); turning counts by the turning radius."""
    return math.hypot(x - goal[0], y - goal[1]) + p.radius * abs(angle(yaw - goal[2]))


@plain_kernel
def curve_distance(table, p, x, y, yaw, goal_x, goal_y, goal_yaw):
    """Return the length of the shortest curve from a pose to a goal, with its cusps, from the table: rounded to cells and bins.

    Outside the table it is the straight distance. For a robot that turns in place it is at most the cost of turning to the goal,
    driving there, and turning to its heading.
    """
    c, s = math.cos(goal_yaw), math.sin(goal_yaw)
    dx, dy = x - goal_x, y - goal_y
    along, aside = c * dx + s * dy, c * dy - s * dx
    turn = yaw - goal_yaw
    if p.holonomic != 0:
        return math.hypot(dx, dy)
    if aside < 0.0:
        aside, turn = -aside, -turn
    ix, iy = np.int64(math.floor(along + 0.5)), np.int64(aside + 0.5)
    if abs(ix) > p.half or iy > p.half:
        return math.hypot(dx, dy)
    width = 2.0 * math.pi / p.bins
    bin_ = np.int64(math.floor(turn / width + 0.5)) % p.bins
    at = ((ix + p.half) * (p.half + 1) + iy) * p.bins + bin_
    known = table[at]
    if known == 0.0:
        # the goal in the frame of the pose (ix, iy, bin)
        heading = bin_ * width
        ca, sa = math.cos(heading), math.sin(heading)
        gx, gy = (-ix * ca - iy * sa) / p.radius, (ix * sa - iy * ca) / p.radius
        if p.reeds_shepp == 0:
            length = dubins(gx, gy, -heading, np.inf)[0]
        elif p.cusp > 0.0:
            length = cheapest_curve(gx, gy, -heading, p.cusp / p.radius, 1.0, (0, 0), np.inf)[3]
        else:
            length = reeds_shepp(gx, gy, -heading, np.inf)[0]
        known = np.float32(max(length * p.radius, 1e-6))
        table[at] = known
    if p.turn_step > 0.0:
        return min(np.float64(known), turn_drive_turn(p, dx, dy, yaw, goal_yaw))
    return np.float64(known)

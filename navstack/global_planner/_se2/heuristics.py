"""The two heuristics of the search over poses.

Obstacles: cheapest path over the cells to the goal, for a robot without heading (Dijkstra, expanded as far as it is needed, with
buckets as wide as the least step, so the order within one does not matter). Distance: length of the shortest curve to the goal
without obstacles, with the cost of its cusps, in a table that is filled where it is read.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core import plain_kernel
from navstack.global_planner._curves import cheapest_curve, dubins, reeds_shepp

# pyright: basic


RING = 1024
"""Buckets of the obstacle heuristic: more than the greatest growth of g + focus in a step, in buckets, plus two."""
WIDTH = 0.5
"""Cells: width of these buckets."""
SQRT2 = math.sqrt(2.0)
UNREACHED = np.float32(np.inf)
BLOCKED = 255
"""Code of a cell of this heuristic that is blocked."""


@plain_kernel
def step_code(costs, p, cx, cy):
    """Return the code of a cell of the obstacle heuristic, from the least cost of the cells in it.

    1 to 253: that cost, plus 1; 254: unknown; 255: blocked.
    """
    ny, nx = costs.shape
    f = p.factor
    least = np.int64(254)
    for iy in range(cy * f, min((cy + 1) * f, ny)):
        for ix in range(cx * f, min((cx + 1) * f, nx)):
            cost = np.int64(costs[iy, ix])
            if cost == 255 and p.unknown_blocked == 0:
                cost = 253
            elif cost >= 253:
                cost = 254
            least = min(least, cost)
    return np.uint8(least + 1)


@plain_kernel
def step_weight(p, code):
    """Return the cost of a step into a cell of this code, which is not blocked."""
    share = (255 if code == 254 else np.int64(code) - 1) / 252.0
    if p.quadratic != 0:
        share *= share
    return np.float32(1.0 + p.cost_penalty * share)


@plain_kernel
def focus(p, cx, cy):
    """Return the octile distance to the focus: cells on the way there are closed before those behind the goal."""
    dx, dy = abs(cx - p.focus_x), abs(cy - p.focus_y)
    return max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy)


@plain_kernel
def bucket_of(field, p, width, cell):
    """Return the bucket of a cell by its cost and its distance to the focus."""
    return np.int64((focus(p, cell % width, cell // width) + abs(field[cell].cost)) / WIDTH)


@plain_kernel
def sweep(field, front, p, width):
    """Take all entries out of the lists that do not count: those of closed cells, and of cells that a lower bucket holds."""
    for head in range(RING):
        last, entry = head, front[head].next_entry
        while entry >= 0:
            after, cell = front[entry].next_entry, front[entry].node
            if field[cell].cost < 0.0 and bucket_of(field, p, width, cell) % RING == head:
                last = entry
            else:
                front[last].next_entry = after
                front[entry].next_entry = p.front_free
                p.front_free = entry
            entry = after


@plain_kernel
def enqueue(field, front, p, width, cell, bucket):
    """Put a cell at the front of the list of a bucket, where it has no entry; one in a higher bucket counts no more."""
    if p.front_free < 0 and p.front_used == len(front):
        sweep(field, front, p, width)
    entry = p.front_free
    if entry >= 0:
        p.front_free = front[entry].next_entry
    else:
        entry = p.front_used
        p.front_used += 1
    head = bucket % RING
    front[entry].node, front[entry].next_entry = cell, front[head].next_entry
    front[head].next_entry = entry


@plain_kernel
def expand_field(costs, field, front, p, width, target):
    """Expand the obstacle heuristic until `target` is closed, or nothing is left.

    `front` (ENTRY): the first entries of RING lists, then room for an entry per cell. A cell that is closed too early, by less
    than the width of a bucket, is opened again.
    """
    height, weights = len(field) // width, p.step_weights
    while p.open_cells > 0 and field[target].cost <= 0.0:
        head = p.level % RING
        entry = front[head].next_entry
        if entry < 0:
            p.level += 1
            continue
        cell = np.int64(front[entry].node)
        front[head].next_entry = front[entry].next_entry
        front[entry].next_entry = p.front_free
        p.front_free = entry
        g = -field[cell].cost
        cx, cy = cell % width, cell // width
        if g <= 0.0 or np.int64((focus(p, cx, cy) + g) / WIDTH) != p.level:
            continue
        p.open_cells -= 1
        p.closed_cells += 1
        field[cell].cost = g
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
                known = row.cost
                if known != 0.0 and abs(known) <= g:
                    continue
                if row.code == 0:
                    row.code = step_code(costs, p, ix, iy)
                    if row.code == BLOCKED:
                        row.cost = UNREACHED
                if row.code == BLOCKED:
                    continue
                new = np.float32(g + (SQRT2 if dx != 0 and dy != 0 else 1.0) * weights[row.code])
                if known != 0.0 and new >= abs(known):
                    continue
                ahead = focus(p, ix, iy)
                bucket = np.int64((ahead + new) / WIDTH)
                row.cost = -new
                if known >= 0.0:
                    p.open_cells += 1
                elif np.int64((ahead - known) / WIDTH) == bucket:
                    continue
                enqueue(field, front, p, width, other, bucket)
                p.level = min(p.level, bucket)


@plain_kernel
def obstacle_cost(costs, field, front, p, ix, iy):
    """Return the cost from a cell to the goal, in cells; infinite where the goal cannot be reached."""
    width = (costs.shape[1] + p.factor - 1) // p.factor
    cell = (iy // p.factor) * width + ix // p.factor
    if field[cell].cost <= 0.0:
        expand_field(costs, field, front, p, width, cell)
        if field[cell].cost <= 0.0:
            field[cell].cost = UNREACHED
    return field[cell].cost * p.factor


@plain_kernel
def start_field(costs, field, front, p, goal_x, goal_y, start_x, start_y):
    """Open the cell of the goal; the heuristic will be expanded toward the start first."""
    for i in range(RING):
        front[i].next_entry = -1
    for code in range(1, BLOCKED):
        p.step_weights[code] = step_weight(p, code)
    width = (costs.shape[1] + p.factor - 1) // p.factor
    p.focus_x, p.focus_y = np.int64(start_x) // p.factor, np.int64(start_y) // p.factor
    cx, cy = np.int64(goal_x) // p.factor, np.int64(goal_y) // p.factor
    cell = cy * width + cx
    field[cell].cost, field[cell].code = np.float32(-1e-5), np.uint8(1)
    bucket = bucket_of(field, p, width, cell)
    p.front_used, p.front_free = RING, -1
    enqueue(field, front, p, width, cell, bucket)
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

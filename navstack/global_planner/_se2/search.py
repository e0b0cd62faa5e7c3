"""A* over poses: motion primitives, curves to the goal, buckets instead of a heap. Coordinates are in cells.

Arguments of all kernels: `costs` (ny, nx); `bits`, packed obstacles; `shapes`: the footprint, the samples of the primitives, the
goals (n, 4 or more: x, y, yaw, heading bin, signed lengths of straight ways into the goal, tried where a curve is blocked);
`primitives`, `headings`, `nodes`, `entries`, `field`: records; `lists`: slots of the hash table, heads of the buckets, queue of
the obstacle heuristic; `table`: lengths of curves; `p`: SETTINGS[0].
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import plain_kernel
from navstack.global_planner._curves import LEFT, RIGHT, STRAIGHT
from navstack.global_planner._se2 import paths
from navstack.global_planner._se2.curve_checks import (
    curve_cost,
    line_cost,
    mean_weight,
    pivot_cost,
    segment_cost,
    sweep_free,
)
from navstack.global_planner._se2.heuristics import angle, apart, curve_distance, obstacle_cost
from navstack.global_planner._se2.shape import cell_weight, center_cost

# pyright: basic


FOUND, EXHAUSTED, LIMIT, GROW, APPROACHED, PAUSED = 1, 2, 3, 4, 5, 6
CURVE, PIVOT = 1, 2
"""How a goal is reached: by a curve (or line), or by turns in place and a line."""
STATES_BACK, END_RADII = 16, 4
"""A state in the goal's cell: how many states before it are joined with the goal, by how many radii each 1.5 times the last."""
BUCKET = 0.5
"""Cells: width of a bucket of the queue."""
PATIENCE = 100_000
"""Expansions after which the weight of the heuristic grows, and again after twice as many, and so on."""
GROWTH, GREATEST = 1.5, 5.0
"""Factor by which the weight grows, and how far."""
MIX = np.uint64(0x9E3779B97F4A7C15)


@plain_kernel
def slot_of(slots, nodes, key):
    """Return the slot of a key in the hash table, or the empty slot where it belongs."""
    mask = np.uint64(len(slots) - 1)
    at = (np.uint64(key) * MIX) >> np.uint64(20) & mask
    while slots[at] != 0 and nodes[slots[at] - 1].key != key:
        at = (at + np.uint64(1)) & mask
    return np.int64(at)


@plain_kernel
def rehash(slots, nodes, count):
    """Fill an empty hash table with the first `count` nodes."""
    for i in range(count):
        slots[slot_of(slots, nodes, nodes[i].key)] = i + 1


@plain_kernel
def push(heads, entries, p, node, f):
    """Put a node into the bucket of its f."""
    bucket = min(max(np.int64(f / BUCKET), 0), len(heads) - 1)
    entry = p.free_entry
    if entry >= 0:
        p.free_entry = entries[entry].next_entry
    else:
        entry = p.entries
        p.entries += 1
    entries[entry].node = node
    entries[entry].next_entry = heads[bucket]
    heads[bucket] = entry
    p.queued += 1
    p.bucket = min(p.bucket, bucket)


@plain_kernel
def pop(heads, entries, p):
    """Take a node from the lowest bucket; the queue must not be empty."""
    while heads[p.bucket] < 0:
        p.bucket += 1
    entry = heads[p.bucket]
    heads[p.bucket] = entries[entry].next_entry
    entries[entry].next_entry = p.free_entry
    p.free_entry = entry
    p.queued -= 1
    return entries[entry].node


@plain_kernel
def heuristic(costs, field, front, table, goals, p, x, y, yaw):
    """Return the estimated cost from a pose to the nearest goal; infinite where none can be reached."""
    h = obstacle_cost(costs, field, front, p, np.int64(x), np.int64(y))
    if h == np.inf or len(goals) > 4:
        return h
    least = np.inf
    for i in range(len(goals)):
        least = min(least, curve_distance(table, p, x, y, yaw, goals[i, 0], goals[i, 1], goals[i, 2]))
    return max(h, least)


@plain_kernel
def curve_and_tail_cost(costs, bits, shape, p, start, goal, tail, before, limit):
    """Return the cost of a curve to a pose from which `tail` (signed) straight on is the goal; the tail is free.

    `before`: direction of travel at the start.
    """
    c, s = math.cos(goal[2]), math.sin(goal[2])
    stage = (goal[0] - tail * c, goal[1] - tail * s, goal[2])
    last, _, _ = segment_cost(costs, p, STRAIGHT, stage[0], stage[1], stage[2], tail, p.radius, limit)
    if last == np.inf:
        return np.inf
    ends = (before, 1 if tail > 0.0 else -1)
    return last + curve_cost(costs, bits, shape, p, start, stage, p.radius, ends, limit - last, False)


@plain_kernel
def try_curves(costs, bits, shapes, p, nodes, i, yaw):
    """Try to reach the goals by curves from node `i`; keep the cheapest path."""
    shape, goals, node = shapes[0], shapes[2], nodes[i]
    start, before = (node.x, node.y, yaw), np.int64(node.direction)
    # goal headings that are not multiples of `coarse` are tried if one of the multiples was reached
    for fine in range(2 if p.coarse > 1 else 1):
        reached = False
        for k in range(len(goals)):
            if p.coarse > 1 and (k % p.coarse == 0) != (fine == 0):
                continue
            limit = p.best_cost - node.g
            if limit <= 0.0:
                return
            goal = (goals[k, 0], goals[k, 1], goals[k, 2])
            near = math.hypot(goal[0] - node.x, goal[1] - node.y) <= p.expansion_length
            cost, kind, tail = np.inf, CURVE, 0.0
            if p.holonomic != 0:
                if near:
                    cost = line_cost(costs, bits, shape, p, start, goal, limit)
            else:
                cost = curve_cost(costs, bits, shape, p, start, goal, p.radius, (before, 0), limit, False)
                for column in range(4, goals.shape[1]):
                    if cost == np.inf and goals[k, column] != 0.0:
                        tail = goals[k, column]
                        cost = curve_and_tail_cost(costs, bits, shape, p, start, goal, tail, before, limit)
            if near and p.turn_step > 0.0 and p.holonomic == 0:
                pivot = pivot_cost(costs, bits, shape, p, start, goal, (before, 0), min(cost, limit))
                if pivot < cost:
                    cost, kind, tail = pivot, PIVOT, 0.0
            if cost < limit:
                reached = True
                p.best_cost, p.best_goal, p.best_is_curve, p.best_tail = node.g + cost, k, kind, tail
                p.best_node, p.best_radius = i, p.radius
        if not reached:
            return


@plain_kernel
def end_at_goals(costs, bits, shapes, p, headings, nodes, i):
    """Try to end exactly at a goal from state `i` near it, and from the states before: by lines or curves of several radii."""
    shape, goals = shapes[0], shapes[2]
    for _ in range(STATES_BACK):
        node = nodes[i]
        start, before = (node.x, node.y, headings[node.heading].yaw), np.int64(node.direction)
        for k in range(len(goals)):
            goal, radius = (goals[k, 0], goals[k, 1], goals[k, 2]), p.radius
            for _ in range(1 if p.holonomic != 0 else END_RADII):
                limit = p.best_cost - node.g
                if p.holonomic != 0:
                    cost = line_cost(costs, bits, shape, p, start, goal, limit)
                else:
                    cost = curve_cost(costs, bits, shape, p, start, goal, radius, (before, 0), limit, True)
                if cost < limit:
                    p.best_cost, p.best_goal, p.best_is_curve, p.best_tail = node.g + cost, k, CURVE, 0.0
                    p.best_node, p.best_radius = i, radius
                radius *= 1.5
        if node.parent < 0:
            return
        i = np.int64(node.parent)


@plain_kernel
def is_at(node, goals, bins):
    """Return the number of the goal in whose cell a state is, within a heading bin; -1 if there is none."""
    for k in range(len(goals)):
        if np.int64(node.x) == np.int64(goals[k, 0]) and np.int64(node.y) == np.int64(goals[k, 1]):
            apart = abs(node.heading - np.int64(goals[k, 3]))
            if min(apart, bins - apart) <= 1:
                return k
    return -1


@plain_kernel
def approach(p, goals, x, y, yaw, j):
    """Remember node `j` if its pose is the nearest to a goal: distance plus turning radius times difference in heading."""
    distance = math.hypot(x - p.goal_x, y - p.goal_y)
    if distance < p.approach_distance:
        least = np.inf
        for k in range(len(goals)):
            least = min(least, abs(angle(yaw - goals[k, 2])))
        distance += p.radius * least
        if distance < p.approach_distance:
            p.approach_distance, p.approach_node, p.approach_since = distance, j, p.expanded


@plain_kernel
def primitive_cost(p, primitives, node, row, weight):
    """Return the cost of driving primitive `row` from a node into a cell of this weight."""
    primitive = primitives[row]
    if primitive.in_place != 0:
        return p.rotation * (weight + 1.0 - p.base_cost)
    cost = abs(primitive.length) * weight
    if node.parent >= 0 and primitive.turn != 0:
        before = primitives[node.primitive]
        same = before.turn == primitive.turn and before.reverse == primitive.reverse
        cost *= p.non_straight if same else p.non_straight + p.change
    if primitive.reverse != 0:
        return cost * p.reverse + (p.cusp if node.direction > 0 else 0.0)
    return cost + (p.cusp if node.direction < 0 else 0.0)


@plain_kernel
def expand(costs, bits, shapes, primitives, headings, nodes, lists, entries, field, table, p, i):
    """Drive every primitive from node `i`."""
    # taken out of the tuples here: each time it counts a reference, which waits for all stores before it
    slots, heads, front = lists
    shape, samples, goals = shapes
    nx = costs.shape[1]
    node = nodes[i]
    heading = headings[node.heading]
    c, s = heading.cos, heading.sin
    for row in range(heading.first, heading.first + heading.count):
        primitive = primitives[row]
        x, y = node.x + c * primitive.dx - s * primitive.dy, node.y + s * primitive.dx + c * primitive.dy
        if p.rotates == 0:
            # whole cells: no rounding error accumulates
            x, y = node.x + math.floor(x - node.x + 0.5), node.y + math.floor(y - node.y + 0.5)
        cost = center_cost(costs, p, x, y)
        if cost < 0:
            continue
        if p.rotates != 0:
            end, weight = (node.heading + primitive.end) % p.bins, cell_weight(p, cost)
        else:
            end, weight = primitive.end, mean_weight(costs, samples, p, primitive, node.x, node.y, c, s)
            if weight == np.inf:
                continue
        g = np.float32(node.g + primitive_cost(p, primitives, node, row, weight))
        direction = np.int64(node.direction)
        if primitive.in_place == 0:
            direction = -1 if primitive.reverse != 0 else 1
        key = (np.int64(y) * nx + np.int64(x)) * p.bins + end
        if p.cusp > 0.0:
            key = 2 * key + (direction < 0)
        slot = slot_of(slots, nodes, key)
        j = np.int64(slots[slot]) - 1
        if j >= 0 and (nodes[j].closed != 0 or g >= nodes[j].g):
            continue
        if not sweep_free(costs, bits, shape, samples, p, primitive, node.x, node.y, c, s):
            continue
        h = heuristic(costs, field, front, table, goals, p, x, y, headings[end].yaw)
        if h == np.inf:
            continue
        if j < 0:
            j = p.nodes
            p.nodes += 1
            slots[slot] = j + 1
            nodes[j].key, nodes[j].closed, nodes[j].heading = key, 0, end
        nodes[j].x, nodes[j].y, nodes[j].g = x, y, g
        nodes[j].parent, nodes[j].primitive, nodes[j].direction = i, row, direction
        push(heads, entries, p, j, g + p.weight * h)
        approach(p, goals, x, y, headings[end].yaw, j)


@plain_kernel
def raise_weight(costs, headings, nodes, lists, entries, field, table, goals, p):
    """Raise the weight of the heuristic, and queue all open nodes by it.

    Where the heuristic leads into a dead end, the search fills it state by state; with a greater weight, only near its end.
    """
    _, heads, front = lists
    p.weight, p.patience = max(p.weight, min(GREATEST, GROWTH * p.weight)), 2 * p.patience
    for bucket in range(len(heads)):
        heads[bucket] = -1
    p.entries, p.free_entry, p.queued, p.bucket = 0, -1, 0, len(heads) - 1
    for i in range(p.nodes):
        node = nodes[i]
        if node.closed == 0:
            h = heuristic(costs, field, front, table, goals, p, node.x, node.y, headings[node.heading].yaw)
            push(heads, entries, p, i, node.g + p.weight * h)


@plain_kernel
def search(costs, bits, shapes, primitives, headings, nodes, lists, entries, field, table, settings):
    """Search until a goal is reached; returns FOUND, EXHAUSTED, LIMIT, APPROACHED, GROW or PAUSED.

    GROW: call again with larger arrays; PAUSED: call again.
    """
    p = settings[0]
    slots, heads, front = lists
    goals = shapes[2]
    most = headings[0].count
    for b in range(len(headings)):
        most = max(most, headings[b].count)
    while p.queued > 0:
        if p.nodes + most > len(nodes) or p.entries + most > len(entries) or 2 * (p.nodes + most) > len(slots):
            return GROW
        if p.expanded >= p.pause_at:
            return PAUSED
        if p.expanded >= p.patience:
            raise_weight(costs, headings, nodes, lists, entries, field, table, goals, p)
        i = pop(heads, entries, p)
        node = nodes[i]
        if node.closed != 0:
            continue
        if p.best_cost <= p.slack * p.bucket * BUCKET:
            return FOUND
        if p.expanded >= p.max_expansions:
            return FOUND if p.best_cost < np.inf else LIMIT
        node.closed = 1
        p.expanded += 1
        yaw = headings[node.heading].yaw
        k = is_at(node, goals, p.bins)
        if k >= 0 and i > 0 and node.g < p.best_cost:
            goal = (goals[k, 0], goals[k, 1], goals[k, 2])
            if p.expansion_length > 0.0 or apart(p, node.x, node.y, yaw, goal) > p.tolerance:
                end_at_goals(costs, bits, shapes, p, headings, nodes, i)
            elif node.heading == np.int64(goals[k, 3]):
                p.best_cost, p.best_node, p.best_goal, p.best_is_curve = node.g, i, k, 0
        h = heuristic(costs, field, front, table, goals, p, node.x, node.y, yaw)
        p.nearest_h = min(p.nearest_h, np.float64(np.int64(h)))
        period = max(np.float64(np.int64(p.nearest_h / p.expansion_ratio)), math.ceil(p.expansion_ratio))
        p.countdown = min(p.countdown, period) - 1.0
        if p.countdown < 0.0 or p.expanded == 1:
            p.countdown = period
            if p.expansion_length > 0.0:
                try_curves(costs, bits, shapes, p, nodes, i, yaw)
        waited = p.approach_limit > 0 and p.expanded - p.approach_since > p.approach_limit
        if waited and p.tolerance > 0.0 and p.approach_distance <= p.tolerance and p.best_cost == np.inf:
            return APPROACHED
        expand(costs, bits, shapes, primitives, headings, nodes, lists, entries, field, table, p, i)
    return FOUND if p.best_cost < np.inf else EXHAUSTED


# ----------------------------------------------------------------------------------------------------------------------
# What a search over poses found.


Pose = tuple[float, float, float]
"""x, y (cells) and yaw."""


@dataclass(frozen=True)
class Outcome:
    """What a search found: a path, or why there is none."""

    status: int
    """Of the kernels: FOUND, EXHAUSTED, LIMIT, APPROACHED."""
    segments: NDArray[np.void]
    """Pieces of the path (SEGMENT), empty without one."""
    end: Pose
    """Where the path ends (cells, rad)."""
    cost: float
    expanded: int
    visited: int
    nearest: tuple[float, float]
    """The visited position nearest to the goal (cells)."""
    timed_out: bool
    enclosed: float | None = None
    """How far from the goal all poses are from which it can be reached (cells); None if that is not known."""
    impossible: bool = False
    """Whether the footprint itself does not fit through to the goal, whatever the turning radius."""

    @property
    def reached(self) -> bool:
        """Whether the path ends at a goal itself."""
        return self.status == FOUND

    @property
    def found(self) -> bool:
        """Whether there is a path."""
        return self.status in (FOUND, APPROACHED)


def poses_of(outcome: Outcome, spacing: float) -> NDArray[np.float64]:
    """Poses (n, 3) of a path, at most `spacing` cells apart (cells, rad)."""
    goal = outcome.end
    none = np.zeros((0, 3))
    turn = math.radians(10.0)
    out = np.zeros((int(paths.poses_of(outcome.segments, goal, spacing, turn, none)), 3))
    paths.poses_of(outcome.segments, goal, spacing, turn, out)
    return out


def turned_around(segments: NDArray[np.void], end: Pose) -> NDArray[np.void]:
    """Return the pieces of a path to `end` as those of the path back, of a robot that looks the other way.

    Where the one drives forward, so does the other; its arcs to the left are arcs to the right.
    """
    back = segments[::-1].copy()
    for name, last in zip(("x", "y", "yaw"), end, strict=True):
        back[name][0] = last
        back[name][1:] = segments[name][:0:-1]
    back["yaw"] -= math.pi
    kind = segments["kind_"][::-1]
    back["kind_"] = np.select([kind == LEFT, kind == RIGHT], [RIGHT, LEFT], kind)
    back["size"] = np.where(kind == paths.IN_PLACE, -back["size"], back["size"])
    back["turn"] = -back["turn"]
    course = (segments["yaw"] + segments["sideways"])[::-1]
    back["sideways"] = np.where(kind == paths.SIDEWAYS, course + math.pi - back["yaw"], 0.0)
    return back

"""Cost and collision check of a curve of arcs and straight lines over the costmap. Coordinates are in cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import plain_kernel
from navstack.global_planner._curves import SEGMENTS, STRAIGHT, advance, changes_of_direction, cheapest_curve, curve
from navstack.global_planner._se2.heuristics import angle
from navstack.global_planner._se2.shape import (
    PADDINGS,
    cell_weight,
    center_cost,
    motion_blocked,
    near_obstacles,
    outline_blocked,
    shape_blocked,
)

# pyright: basic


FORWARD, SHORTEST, CHEAPEST = 0, 1, 2
"""Curves: Dubins; of Reeds and Shepp; of the words of both, forward and backward, the one that costs least on free cells."""
SPACING = 1.0
"""Cells between the samples of the costs along a curve."""
LEVELS = 1 + len(PADDINGS)
ROUNDED = 1.0 + 1e-6
"""Factor on limits that lower bounds of costs are compared with: the sums along a curve are rounded."""
RETRY = 2
"""Checks with a padding after which the next larger one is tried again."""


@plain_kernel
def segment_cost(costs, p, kind, x, y, yaw, length, radius, limit):
    """Return the cost of driving along a segment, infinite if the center may not pass or the cost exceeds `limit`.

    Also returns the number of samples at its end that cost at least `expansion_cost`, and whether others do.
    """
    count = max(1, math.ceil(abs(length) / SPACING))
    factor = abs(length) / count
    if kind != STRAIGHT:
        factor *= p.non_straight
    if length < 0.0:
        factor *= p.reverse
    total = 0.0
    run, earlier = 0, False
    for k in range(count):
        px, py, _ = advance(kind, x, y, yaw, length * (k + 1) / count, radius)
        cost = center_cost(costs, p, px, py)
        if cost < 0:
            return np.inf, 0, False
        if cost > p.expansion_cost:
            run += 1
        elif run > 0:
            earlier = True
            run = 0
        total += factor * cell_weight(p, cost)
        if total > limit:
            return np.inf, 0, False
    return total, run, earlier


@plain_kernel
def stretch_free(costs, bits, shape, p, arc, first, length, motion):
    """Return True if the footprint is free along a stretch of an arc; the tiles near it are packed.

    `arc`: kind, start and radius of the arc; `first`, `length`: where the stretch begins and how long it is (signed); `motion`:
    how far a point of the footprint moves at most.
    """
    kind, x, y, yaw, radius = arc
    done, level, tries = 0.0, LEVELS - 1, 0
    while done < 1.0:
        cover = 2.0 * shape[1, level] if level > 0 else p.fine_step
        share = min(1.0 - done, cover / motion)
        px, py, pyaw = advance(kind, x, y, yaw, first + length * (done + 0.5 * share), radius)
        tries += 1
        if outline_blocked(costs, bits, shape, level, p, px, py, math.cos(pyaw), math.sin(pyaw)):
            if level == 0:
                return False
            level, tries = level - 1, 0
        else:
            done += share
            if tries > RETRY and level < LEVELS - 1:
                level, tries = level + 1, 0
    return True


@plain_kernel
def segment_free(costs, bits, shape, p, kind, x, y, yaw, length, radius):
    """Return True if the footprint is free along a segment, wherever it is between the samples."""
    turn = 0.0 if kind == STRAIGHT else abs(length) / radius
    if p.corners == 0:
        count = max(1, math.ceil(2.0 * abs(length)))
        for k in range(count):
            px, py, _ = advance(kind, x, y, yaw, length * (k + 1) / count, radius)
            if center_cost(costs, p, px, py) < 0:
                return False
        return True
    pieces = max(1, math.ceil(abs(length) / 8.0))
    x0, y0 = x, y
    for piece in range(pieces):
        x1, y1, _ = advance(kind, x, y, yaw, length * (piece + 1) / pieces, radius)
        # an arc bulges from its chord by at most its length squared over 8 radii
        bulge = 0.0 if kind == STRAIGHT else (length / pieces) ** 2 / (8.0 * radius)
        left, right = min(x0, x1) - bulge, max(x0, x1) + bulge
        low, high = min(y0, y1) - bulge, max(y0, y1) + bulge
        if near_obstacles(costs, bits, p, left, low, right, high):
            motion = (abs(length) + p.reach * turn) / pieces
            first, share = length * piece / pieces, length / pieces
            if not stretch_free(costs, bits, shape, p, (kind, x, y, yaw, radius), first, share, motion):
                return False
        x0, y0 = x1, y1
    return True


@plain_kernel
def least_cost(p, kinds, lengths, radius):
    """Return the cost of a curve over free cells: no curve costs less."""
    total = 0.0
    for i in range(SEGMENTS):
        length = lengths[i] * radius
        if abs(length) >= 1e-9:
            factor = abs(length) if kinds[i] == STRAIGHT else abs(length) * p.non_straight
            total += factor * p.reverse if length < 0.0 else factor
    return total * p.base_cost


@plain_kernel
def choose_curve(p, start, goal, radius, ends, bound):
    """Return (count, kinds, lengths, size) of the curve that is tried between two poses (3,), in units of `radius`.

    `ends`: direction of travel before and after it (1, -1, or 0). If `size` is at least `bound` (in radii, times base_cost), the
    rest has no meaning.
    """
    dx, dy = (goal[0] - start[0]) / radius, (goal[1] - start[1]) / radius
    c, s = math.cos(start[2]), math.sin(start[2])
    x, y, turn = c * dx + s * dy, c * dy - s * dx, goal[2] - start[2]
    if p.reeds_shepp == CHEAPEST:
        return cheapest_curve(x, y, turn, p.cusp / (radius * p.base_cost), p.reverse, ends, bound)
    return curve(x, y, turn, p.reeds_shepp != FORWARD, bound)


@plain_kernel
def curve_cost(costs, bits, shape, p, start, goal, radius, ends, limit, from_start):
    """Return the cost of `choose_curve`'s curve between two poses (3,), infinite if it is blocked or exceeds `limit`.

    With `from_start` False, costs above `expansion_cost` are allowed in one run that ends at the goal only.
    """
    bound = limit * ROUNDED / (p.base_cost * radius)
    if math.hypot(goal[0] - start[0], goal[1] - start[1]) >= bound * radius:
        return np.inf
    count, kinds, lengths, size = choose_curve(p, start, goal, radius, ends, bound)
    if size >= bound:
        return np.inf
    size = radius * (abs(lengths[0]) + abs(lengths[1]) + abs(lengths[2]) + abs(lengths[3]) + abs(lengths[4]))
    if size * p.base_cost > limit or (not from_start and size > p.expansion_length):
        return np.inf
    total, run, costly = p.cusp * changes_of_direction(lengths, ends), 0, False
    if total + least_cost(p, kinds, lengths, radius) > limit * ROUNDED:
        return np.inf
    x, y, yaw = start[0], start[1], start[2]
    for i in range(count):
        length = lengths[i] * radius
        if abs(length) < 1e-9:
            continue
        cost, last, earlier = segment_cost(costs, p, kinds[i], x, y, yaw, length, radius, limit - total)
        if cost == np.inf:
            return np.inf
        total += cost
        x, y, yaw = advance(kinds[i], x, y, yaw, length, radius)
        samples = max(1, math.ceil(abs(length) / SPACING))
        if earlier or (run > 0 and last < samples):
            costly = True
        run = run + last if last == samples else last
    if not from_start and costly and not (p.expansion_override != 0 and size < 2.0 * math.pi * p.radius):
        return np.inf
    x, y, yaw = start[0], start[1], start[2]
    for i in range(count):
        length = lengths[i] * radius
        if abs(length) < 1e-9:
            continue
        if not segment_free(costs, bits, shape, p, kinds[i], x, y, yaw, length, radius):
            return np.inf
        x, y, yaw = advance(kinds[i], x, y, yaw, length, radius)
    return total


@plain_kernel
def open_curve(costs, bits, shape, p, start, goals):
    """Return (cost, goal) of the best of `choose_curve`'s curves to the goals if it leads over cells of cost 0 only.

    The cost is infinite otherwise.
    """
    nearest, bound = 0, np.inf
    for i in range(len(goals)):
        size = choose_curve(p, start, (goals[i, 0], goals[i, 1], goals[i, 2]), p.radius, (0, 0), bound)[3]
        if size < bound:
            nearest, bound = i, size
    goal = (goals[nearest, 0], goals[nearest, 1], goals[nearest, 2])
    _, kinds, lengths, _ = choose_curve(p, start, goal, p.radius, (0, 0), np.inf)
    limit = (least_cost(p, kinds, lengths, p.radius) + p.cusp * changes_of_direction(lengths, (0, 0))) * ROUNDED
    return curve_cost(costs, bits, shape, p, start, goal, p.radius, (0, 0), limit, True), nearest


@plain_kernel
def line_cost(costs, bits, shape, p, start, goal, limit):
    """As `curve_cost`, for a robot that drives in any direction: a straight line, on which the heading turns evenly."""
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    turn = goal[2] - start[2]
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    length = math.hypot(dx, dy)
    if length * p.base_cost > limit:
        return np.inf
    count = max(1, math.ceil(length / SPACING), math.ceil((length + p.reach * abs(turn)) / p.sample_step))
    total, tight = 0.0, False
    before = start
    for k in range(count + 1):
        share = k / count
        px, py, yaw = start[0] + share * dx, start[1] + share * dy, start[2] + share * turn
        if k > 0:
            cost = center_cost(costs, p, px, py)
            if cost < 0:
                return np.inf
            total += length / count * cell_weight(p, cost)
            if total > limit:
                return np.inf
        blocked = False
        if p.corners > 0 and near_obstacles(costs, bits, p, px, py, px, py):
            blocked = shape_blocked(costs, bits, shape, p, px, py, math.cos(yaw), math.sin(yaw))
        after = (px, py, yaw)
        # between two checks this is close enough to an arc
        if k > 0 and (blocked or tight) and motion_blocked(costs, bits, shape, p, before, after):
            return np.inf
        tight = blocked
        before = after
    return total


@plain_kernel
def sample_blocked(costs, bits, shape, samples, p, primitive, k, x, y, c, s):
    """Return True if the finely padded footprint is blocked on the way from the sample before `k` to sample `k`."""
    from_x, from_y, from_yaw = x, y, 0.0
    if k > primitive.first:
        sx, sy = samples[k - 1, 0], samples[k - 1, 1]
        from_x, from_y = x + c * sx - s * sy, y + s * sx + c * sy
        from_yaw = math.atan2(samples[k - 1, 3], samples[k - 1, 2])
    sx, sy = samples[k, 0], samples[k, 1]
    to_x, to_y = x + c * sx - s * sy, y + s * sx + c * sy
    turn = math.atan2(samples[k, 3], samples[k, 2]) - from_yaw
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    from_yaw += math.atan2(s, c)
    return motion_blocked(costs, bits, shape, p, (from_x, from_y, from_yaw), (to_x, to_y, from_yaw + turn))


@plain_kernel
def turn_cost(costs, p, x, y, turn):
    """Return the cost of a turn in place by an angle (rad), infinite where the robot must not be."""
    cost = center_cost(costs, p, x, y)
    if cost < 0:
        return np.inf
    return p.rotation * (cell_weight(p, cost) + 1.0 - p.base_cost) * abs(turn) / p.turn_step


@plain_kernel
def turn_free(costs, bits, shape, p, x, y, yaw, turn):
    """Return True if the footprint is free all along a turn in place."""
    if center_cost(costs, p, x, y) < 0:
        return False
    if p.corners == 0 or not near_obstacles(costs, bits, p, x, y, x, y):
        return True
    count = max(1, math.ceil(p.reach * abs(turn) / p.sample_step))
    before = (x, y, yaw)
    tight = False
    for k in range(count + 1):
        after = (x, y, yaw + turn * k / count)
        blocked = shape_blocked(costs, bits, shape, p, x, y, math.cos(after[2]), math.sin(after[2]))
        if k > 0 and (blocked or tight) and motion_blocked(costs, bits, shape, p, before, after):
            return False
        tight = blocked
        before = after
    return True


@plain_kernel
def pivot_parts(start, goal):
    """Return the turns in place at both ends, and the length, of a straight line between two poses (3,)."""
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    length = math.hypot(dx, dy)
    if length < 1e-9:
        return 0.0, 0.0, angle(goal[2] - start[2])
    direction = math.atan2(dy, dx)
    return angle(direction - start[2]), length, angle(goal[2] - direction)


@plain_kernel
def pivot_cost(costs, bits, shape, p, start, goal, ends, limit):
    """As `curve_cost`, for a robot that turns in place: a turn to the goal, a straight line, a turn to the goal's heading."""
    first, length, last = pivot_parts(start, goal)
    if length * p.base_cost > limit:
        return np.inf
    total = turn_cost(costs, p, start[0], start[1], first) + turn_cost(costs, p, goal[0], goal[1], last)
    total += p.cusp * ((ends[0] < 0) + (ends[1] < 0))
    direction = start[2] + first
    if length > 0.0:
        total += segment_cost(costs, p, STRAIGHT, start[0], start[1], direction, length, p.radius, limit)[0]
    if not total < limit:
        return np.inf
    if not turn_free(costs, bits, shape, p, start[0], start[1], start[2], first):
        return np.inf
    if not segment_free(costs, bits, shape, p, STRAIGHT, start[0], start[1], direction, length, p.radius):
        return np.inf
    return total if turn_free(costs, bits, shape, p, goal[0], goal[1], direction, last) else np.inf


@plain_kernel
def samples_free(costs, bits, shape, samples, p, primitive, x, y, c, s):
    """Return True if the footprint is free along a primitive; the tiles near it are packed.

    A check at a sample covers as many half steps before and after it as its padding allows.
    """
    last = primitive.first + primitive.count - 1
    px, py = x + c * samples[last, 0] - s * samples[last, 1], y + s * samples[last, 0] + c * samples[last, 1]
    hc, hs = c * samples[last, 2] - s * samples[last, 3], s * samples[last, 2] + c * samples[last, 3]
    if outline_blocked(costs, bits, shape, 0, p, px, py, hc, hs):
        return False
    done, level, tries = 0, LEVELS - 1, 0
    while done < 2 * primitive.count:
        half_steps = np.int64(2.0 * shape[1, level] / p.sample_step + 1e-9)
        at = min((done + half_steps) // 2, primitive.count) if level > 0 else done // 2 + 1
        k = primitive.first + at - 1
        tries += 1
        if level == 0:
            blocked = sample_blocked(costs, bits, shape, samples, p, primitive, k, x, y, c, s)
            covered = 2 * at
        elif at == 0:
            blocked = outline_blocked(costs, bits, shape, level, p, x, y, c, s)
            covered = half_steps
        else:
            px, py = x + c * samples[k, 0] - s * samples[k, 1], y + s * samples[k, 0] + c * samples[k, 1]
            hc, hs = c * samples[k, 2] - s * samples[k, 3], s * samples[k, 2] + c * samples[k, 3]
            blocked = outline_blocked(costs, bits, shape, level, p, px, py, hc, hs)
            covered = 2 * at + half_steps
        if not blocked:
            done = covered
            if tries > RETRY and level < LEVELS - 1:
                level, tries = level + 1, 0
        elif level == 0:
            return False
        else:
            level, tries = level - 1, 0
    return True


@plain_kernel
def mean_weight(costs, samples, p, primitive, x, y, c, s):
    """Return the mean cost per cell along a primitive from (x, y), rotated by (c, s); infinite where it is blocked."""
    count = primitive.count
    stride = max(1, np.int64(count / max(1.0, abs(primitive.length))))
    total, n = 0.0, 0
    k = primitive.first + count - 1
    while k >= primitive.first:
        sx, sy = samples[k, 0], samples[k, 1]
        cost = center_cost(costs, p, x + c * sx - s * sy, y + s * sx + c * sy)
        if cost < 0:
            return np.inf
        total += cell_weight(p, cost)
        n += 1
        k -= stride
    return total / n


@plain_kernel
def sweep_free(costs, bits, shape, samples, p, primitive, x, y, c, s):
    """Return True if the robot may drive a primitive from (x, y), rotated by (c, s)."""
    ex, ey = x + c * primitive.dx - s * primitive.dy, y + s * primitive.dx + c * primitive.dy
    # the center of a polygon is looked at once per cell, where it is not checked itself
    step = 1 if p.corners == 0 else 3
    for k in range(primitive.first + primitive.count - 1, primitive.first - 1, -step):
        sx, sy = samples[k, 0], samples[k, 1]
        if center_cost(costs, p, x + c * sx - s * sy, y + s * sx + c * sy) < 0:
            return False
    if p.corners == 0:
        return True
    bulge = 0.5 * abs(primitive.length) if abs(primitive.length) >= 4.0 else 0.5
    left, right, low, high = min(x, ex) - bulge, max(x, ex) + bulge, min(y, ey) - bulge, max(y, ey) + bulge
    if not near_obstacles(costs, bits, p, left, low, right, high):
        return True
    return samples_free(costs, bits, shape, samples, p, primitive, x, y, c, s)

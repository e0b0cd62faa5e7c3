"""Paths as pieces (SEGMENT records): read out of a search, shortened by curves, turned into poses. Coordinates are in cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import plain_kernel
from navstack.global_planner._curves import STRAIGHT, advance
from navstack.global_planner._se2.curve_checks import (
    FORWARD,
    ROUNDED,
    choose_curve,
    curve_cost,
    line_cost,
    pivot_cost,
    pivot_parts,
    segment_cost,
    turn_cost,
)
from navstack.global_planner._se2.heuristics import angle, apart
from navstack.global_planner._se2.shape import cell_weight

# pyright: basic


IN_PLACE, SIDEWAYS = 0, -1
INSCRIBED = 253
PIECE = 4.0
"""Cells: longest piece of a curve between two poses at which a path may be shortened."""
OFFSET, TURN = 0.35, 0.02
"""How far poses are moved sideways (cells) and turned (rad), per piece on either side that is replaced."""
ASIDE = (1.0, 3.0)
"""Cells: how far points of holonomic paths are moved aside."""
RADII = 3
"""Numbers of radii that are tried: 1, 2 and 4 times the turning radius."""
PIVOT, LINE = -1.0, -2.0
"""Instead of a radius: turns in place and a line between them; a holonomic line."""


@plain_kernel
def write_segment(segments, at, kind, x, y, yaw, size, radius):
    """Write row `at` of a path."""
    row = segments[at]
    row.x, row.y, row.yaw = x, y, yaw
    row.kind_, row.size, row.radius, row.sideways, row.turn = kind, size, radius, 0.0, 0.0


@plain_kernel
def write_curve(segments, at, p, start, goal, radius, ends):
    """Write `choose_curve`'s curve between two poses (3,) from row `at` on, in pieces of at most PIECE; return the next row."""
    count, kinds, lengths, _ = choose_curve(p, start, goal, radius, ends, np.inf)
    x, y, yaw = start[0], start[1], start[2]
    for i in range(count):
        length = lengths[i] * radius
        if abs(length) < 1e-9:
            continue
        pieces = max(1, math.ceil(abs(length) / PIECE))
        for _ in range(pieces):
            if at >= len(segments):
                return at
            write_segment(segments, at, kinds[i], x, y, yaw, length / pieces, radius)
            x, y, yaw = advance(kinds[i], x, y, yaw, length / pieces, radius)
            at += 1
    return at


@plain_kernel
def direction_of(row):
    """Return the direction of travel on a piece of a path: 1, -1, or 0 for turns in place and holonomic lines."""
    if row.kind_ <= 0:
        return 0
    return 1 if row.size > 0.0 else -1


@plain_kernel
def directions_around(segments, first, last, count):
    """Return the directions of travel before piece `first` and from piece `last` on, and the changes between these two."""
    before, after = 0, 0
    i = first - 1
    while i >= 0 and before == 0:
        before = direction_of(segments[i])
        i -= 1
    i = last
    while i < count and after == 0:
        after = direction_of(segments[i])
        i += 1
    changes, direction = 0, before
    for i in range(first, last):
        sign = direction_of(segments[i])
        changes += direction * sign < 0
        direction = direction if sign == 0 else sign
    return before, after, changes + (direction * after < 0)


@plain_kernel
def segment_end(row):
    """Return the pose at the end of a piece of a path."""
    if row.kind_ == IN_PLACE:
        return row.x, row.y, row.yaw + row.size
    if row.kind_ == SIDEWAYS:
        direction = row.yaw + row.sideways
        return row.x + row.size * math.cos(direction), row.y + row.size * math.sin(direction), row.yaw + row.turn
    return advance(row.kind_, row.x, row.y, row.yaw, row.size, row.radius)


@plain_kernel
def write_pivot(segments, at, start, goal):
    """Write a turn in place, a straight line and a turn in place from row `at` on; return the next row."""
    first, length, last = pivot_parts(start, goal)
    if abs(first) > 1e-9 and at < len(segments):
        write_segment(segments, at, IN_PLACE, start[0], start[1], start[2], first, 1.0)
        at += 1
    direction = start[2] + first
    pieces = math.ceil(length / PIECE)
    for k in range(pieces):
        if at < len(segments):
            share = length * k / pieces
            x, y = start[0] + share * math.cos(direction), start[1] + share * math.sin(direction)
            write_segment(segments, at, STRAIGHT, x, y, direction, length / pieces, 1.0)
        at += 1
    if abs(last) > 1e-9 and at < len(segments):
        write_segment(segments, at, IN_PLACE, goal[0], goal[1], direction, last, 1.0)
        at += 1
    return at


@plain_kernel
def write_line(segments, at, start, goal):
    """Write the line between two poses (3,) from row `at` on, on which the heading turns evenly; return the next row.

    Without a distance it is a turn in place.
    """
    dx, dy, turn = goal[0] - start[0], goal[1] - start[1], angle(goal[2] - start[2])
    length = math.hypot(dx, dy)
    if length < 1e-9:
        if at < len(segments):
            write_segment(segments, at, IN_PLACE, start[0], start[1], start[2], turn, 1.0)
        return at + 1
    count = max(1, math.ceil(length / PIECE))
    direction = math.atan2(dy, dx)
    for k in range(count):
        if at < len(segments):
            share = k / count
            yaw = start[2] + share * turn
            write_segment(
                segments, at, SIDEWAYS, start[0] + share * dx, start[1] + share * dy, yaw, length / count, 1.0
            )
            segments[at].sideways, segments[at].turn = direction - yaw, turn / count
        at += 1
    return at


@plain_kernel
def trace(nodes, primitives, headings, pieces, last, segments):
    """Write the path to node `last` and return the number of its pieces; only count them if `segments` has fewer rows."""
    count = 0
    i = last
    while nodes[i].parent >= 0:
        count += primitives[nodes[i].primitive].pieces
        i = nodes[i].parent
    if count > len(segments):
        return count
    at = count
    i = last
    while nodes[i].parent >= 0:
        parent = nodes[nodes[i].parent]
        primitive = primitives[nodes[i].primitive]
        at -= primitive.pieces
        x, y, yaw = parent.x, parent.y, headings[parent.heading].yaw
        for k in range(primitive.pieces):
            piece = pieces[primitive.piece + k]
            row = segments[at + k]
            write_segment(segments, at + k, piece.kind_, x, y, yaw, piece.size, piece.radius)
            row.sideways, row.turn = piece.sideways, piece.turn
            x, y, yaw = segment_end(row)
        i = nodes[i].parent
    return count


@plain_kernel
def touching_cost(p, row):
    """Return the cost of a piece of a path if all of its cells were inscribed."""
    weight = cell_weight(p, INSCRIBED)
    if row.kind_ == IN_PLACE:
        return p.rotation * (weight + 1.0 - p.base_cost) * abs(row.size) / p.turn_step
    turns = row.kind_ != STRAIGHT and row.kind_ != SIDEWAYS
    return abs(row.size) * weight * (p.non_straight if turns else 1.0) * (p.reverse if row.size < 0.0 else 1.0)


@plain_kernel
def pieces_cost(costs, p, segments, out):
    """Write the cost of each piece of a path that is free.

    Checks at intervals may step over the corner of an inscribed cell in which a sample of a piece lies: such a piece costs as if
    all of its cells were inscribed.
    """
    for i in range(len(segments)):
        row = segments[i]
        if row.kind_ == IN_PLACE:
            out[i] = turn_cost(costs, p, row.x, row.y, row.size)
        else:
            kind = STRAIGHT if row.kind_ == SIDEWAYS else row.kind_
            out[i] = segment_cost(costs, p, kind, row.x, row.y, row.yaw + row.sideways, row.size, row.radius, np.inf)[0]
        if out[i] == np.inf:
            out[i] = touching_cost(p, row)


@plain_kernel
def stretch_cost(segments, values, first, last):
    """Return the sum of the costs of pieces first .. last - 1, and whether one of them is driven backward."""
    total, backward = 0.0, False
    for k in range(first, last):
        total += values[k]
        backward = backward or direction_of(segments[k]) < 0
    return total, backward


@plain_kernel
def replace_pieces(costs, p, segments, values, count, first, last, added, fresh):
    """Replace pieces first .. last - 1 by the first `fresh` rows of `added`; return the new number of pieces.

    Without room, nothing is replaced and -1 is returned.
    """
    moved, tail = fresh - (last - first), count - last
    if fresh >= len(added) or count + moved >= len(segments):
        return -1
    for n in range(tail):
        k = last + (n if moved < 0 else tail - 1 - n)  # in the order in which nothing is overwritten before it is moved
        segments[k + moved] = segments[k]
        values[k + moved] = values[k]
    for k in range(fresh):
        segments[first + k] = added[k]
    pieces_cost(costs, p, segments[first : first + fresh], values[first : first + fresh])
    return count + moved


@plain_kernel
def pose_at(segments, k, count, goal):
    """Return the pose where piece `k` of a path begins; the goal after the last of `count` pieces."""
    if k < count:
        return segments[k].x, segments[k].y, segments[k].yaw
    return goal


@plain_kernel
def best_curve(costs, bits, shape, p, start, end, ends, limit, radii):
    """Return the lowest cost below `limit` of a curve between two poses, and its radius; 0 if none is lower.

    The turning radius is tried first, then twice that, and so on: `radii` of them. For a robot that turns in place, PIVOT is
    tried, too; for one that drives in any direction, only LINE.
    """
    if p.holonomic != 0:
        if math.hypot(end[0] - start[0], end[1] - start[1]) > 1e-9:
            cost = line_cost(costs, bits, shape, p, start, end, limit)
            if cost < limit:
                return cost, LINE
        return limit, 0.0
    best, best_radius = limit, 0.0
    radius = p.radius
    for _ in range(radii):
        cost = curve_cost(costs, bits, shape, p, start, end, radius, ends, best, True)
        if cost < best:
            best, best_radius = cost, radius
        radius *= 2.0
    if p.turn_step > 0.0:
        cost = pivot_cost(costs, bits, shape, p, start, end, ends, best)
        if cost < best:
            best, best_radius = cost, PIVOT
    return best, best_radius


@plain_kernel
def write_best(segments, at, p, start, goal, radius, ends):
    """Write what `best_curve` found from row `at` on; return the next row."""
    if radius == LINE:
        return write_line(segments, at, start, goal)
    if radius == PIVOT:
        return write_pivot(segments, at, start, goal)
    return write_curve(segments, at, p, start, goal, radius, ends)


@plain_kernel
def shorten(costs, bits, shape, p, segments, added, values, count, goal):
    """Replace stretches of a path by curves that cost less and are free; return the number of pieces.

    `segments` has room for more pieces than `count`, `added` for those of one curve; without room the path stays as it is.
    Stretches from the whole path down to two pieces are tried, from its start to its end.
    """
    pieces_cost(costs, p, segments[:count], values)
    both = p.reeds_shepp
    span = count
    while span >= 2:
        i = 0
        while i + span <= count:
            j = i + span
            old, backward = stretch_cost(segments, values, i, j)
            start, end = pose_at(segments, i, count, goal), pose_at(segments, j, count, goal)
            p.reeds_shepp = both if backward else FORWARD
            before, after, changes = directions_around(segments, i, j, count)
            old, ends = old + p.cusp * changes, (before, after)
            _, best_radius = best_curve(costs, bits, shape, p, start, end, ends, old * 0.999 - 1e-6, RADII)
            if best_radius != 0.0:
                fresh = write_best(added, 0, p, start, end, best_radius, ends)
                replaced = replace_pieces(costs, p, segments, values, count, i, j, added, fresh)
                if replaced >= 0:
                    count = replaced
                    i += max(1, fresh // 2)
                    continue
            i += max(1, span // 4)
        span = span * 2 // 3 if span > 3 else span - 1
    p.reeds_shepp = both
    return count


@plain_kernel
def moved(p, row, option, reach):
    """Return the pose where a piece begins, moved aside or turned; `option`: 0 to 3, `reach`: as for `relax`."""
    sign = 1.0 if option % 2 == 0 else -1.0
    course, offset, turn = row.yaw, 0.0, 0.0
    if p.holonomic != 0:
        course, offset = row.yaw + row.sideways, sign * ASIDE[option // 2]
    elif option < 2:
        offset = sign * OFFSET * reach
    else:
        turn = sign * TURN * reach
    return row.x - offset * math.sin(course), row.y + offset * math.cos(course), row.yaw + turn


@plain_kernel
def relax(costs, bits, shape, p, segments, added, values, count, goal, reach):
    """Move the poses between pieces sideways and turn them where curves through them cost less; return the number of pieces.

    `reach`: pieces before and after a pose that are replaced. As `shorten` otherwise.
    """
    both = p.reeds_shepp
    j = 1
    while j < count:
        first, last = max(0, j - reach), min(count, j + reach)
        old, backward = stretch_cost(segments, values, first, last)
        p.reeds_shepp = both if backward else FORWARD
        start, end = pose_at(segments, first, count, goal), pose_at(segments, last, count, goal)
        row = segments[j]
        before, after, changes = directions_around(segments, first, last, count)
        # both curves pay for a change to this direction between them: once too often at most
        ends_a, ends_b = (before, direction_of(row)), (direction_of(row), after)
        old += p.cusp * changes
        best, best_option, radius_a, radius_b = old * 0.9995 - 1e-6, 0, 0.0, 0.0
        for option in range(4):
            middle = moved(p, row, option, reach)
            # no curve costs less than the straight line over free cells
            least_a = math.hypot(middle[0] - start[0], middle[1] - start[1]) * p.base_cost
            least_b = math.hypot(end[0] - middle[0], end[1] - middle[1]) * p.base_cost
            if least_a + least_b > best * ROUNDED:
                continue
            cost_a, a = best_curve(costs, bits, shape, p, start, middle, ends_a, best * ROUNDED - least_b, 1)
            if a == 0.0:
                continue
            cost_b, b = best_curve(costs, bits, shape, p, middle, end, ends_b, best - cost_a, 1)
            if b != 0.0:
                best, best_option, radius_a, radius_b = cost_a + cost_b, option, a, b
        if radius_a != 0.0:
            middle = moved(p, row, best_option, reach)
            fresh = write_best(added, 0, p, start, middle, radius_a, ends_a)
            fresh = write_best(added, fresh, p, middle, end, radius_b, ends_b)
            replaced = replace_pieces(costs, p, segments, values, count, first, last, added, fresh)
            if replaced >= 0:
                count, j = replaced, max(j, first + fresh // 2)
        j += 1
    p.reeds_shepp = both
    return count


@plain_kernel
def poses_of(segments, goal, spacing, turn_step, out):
    """Write poses at most `spacing` apart to `out` (n, 3) and return their number; counts only if `out` is too short."""
    at = 0
    for i in range(len(segments)):
        row = segments[i]
        if row.kind_ == IN_PLACE:
            count = max(1, math.ceil(abs(row.size) / turn_step - 1e-9))
        else:
            count = max(1, math.ceil(abs(row.size) / spacing - 1e-9))
        for k in range(count):
            if at < len(out):
                share = row.size * k / count
                x, y, yaw = row.x, row.y, row.yaw
                if row.kind_ == IN_PLACE:
                    yaw += share
                elif row.kind_ == SIDEWAYS:
                    x += share * math.cos(row.yaw + row.sideways)
                    y += share * math.sin(row.yaw + row.sideways)
                    yaw += row.turn * k / count
                else:
                    x, y, yaw = advance(row.kind_, x, y, yaw, share, row.radius)
                out[at, 0], out[at, 1], out[at, 2] = x, y, yaw
            at += 1
    if at < len(out):
        out[at, 0], out[at, 1], out[at, 2] = goal[0], goal[1], goal[2]
    return at + 1


# ----------------------------------------------------------------------------------------------------------------------
# The way from a pose next to a path back onto it. Coordinates are in cells.


# pyright: basic


NEAR = 4.5
"""Cells: a pose is next to a path if it is this near to the start of a piece."""
SAME = 1.5
"""Cells: a piece is as near as another one if it is farther away by at most this."""
AHEAD = 4
"""Pieces after the nearest one onto which a way is tried."""
DEARER = 1.02
"""Factor by which the way may cost more than the stretch that it replaces."""


@plain_kernel
def stretch_at(p, segments, start):
    """Return (first, nearest): the pieces before and after a pose next to a path; (0, -1) if it is too far away.

    Of a path that comes by more than once, as at a change of direction, it is the last time.
    """
    nearest, least = -1, np.inf
    for i in range(len(segments)):
        distance = apart(p, segments[i].x, segments[i].y, segments[i].yaw, start)
        if distance <= NEAR and distance <= least + SAME:
            nearest, least = i, min(least, distance)
    first, before = nearest, 0.0
    while first > 0 and before <= NEAR:
        first -= 1
        before += abs(segments[first].size)
    return max(0, first), nearest


@plain_kernel
def rejoin(costs, bits, shape, p, segments, values, goal, start, added):
    """Find a way from a pose onto a path near it; return (pieces of it in `added`, first piece of the rest of the path).

    `values`: costs of the pieces. Without a free way that costs hardly more than the stretch it replaces, there are no pieces.
    """
    count = len(segments)
    first, nearest = stretch_at(p, segments, start)
    if nearest < 0:
        return 0, 0
    both, backward, replaced, fresh, k = p.reeds_shepp, False, 0.0, 0, first
    while fresh == 0 and k < min(count, nearest + AHEAD):
        replaced += values[k]
        backward = backward or (segments[k].kind_ > 0 and segments[k].size < 0.0)
        k += 1
        if k <= nearest:
            continue
        end = pose_at(segments, k, count, goal)
        _, after, changes = directions_around(segments, first, k, count)
        ends, limit = (0, after), DEARER * (replaced + p.cusp * changes)
        p.reeds_shepp = both if backward else FORWARD
        _, radius = best_curve(costs, bits, shape, p, start, end, ends, limit, RADII)
        if radius != 0.0:
            fresh = write_best(added, 0, p, start, end, radius, ends)
    p.reeds_shepp = both
    return (fresh, k) if fresh < len(added) else (0, 0)

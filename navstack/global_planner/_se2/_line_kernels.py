# pyright: basic
"""Straight stretches of paths: of robots that drive in any direction. Coordinates are in cells."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import plain_kernel
from navstack.global_planner._se2._curve_check_kernels import line_cost
from navstack.global_planner._se2._heuristic_kernels import angle
from navstack.global_planner._se2._path_kernels import (
    IN_PLACE,
    SIDEWAYS,
    pieces_cost,
    pose_at,
    replace_pieces,
    write_segment,
)

LONGEST = 4.0
"""Cells: longest piece of a line."""
OFFSETS = (1.0, -1.0, 3.0, -3.0)
"""Cells: how far points are moved aside where that lowers the cost."""


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
    count = max(1, math.ceil(length / LONGEST))
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
def straighten(costs, bits, shapes, p, segments, added, values, count, goal):
    """Replace stretches of a path by straight lines that cost less and are free; return the number of pieces.

    As `shorten`, for a robot that drives in any direction.
    """
    shape = shapes[0]
    pieces_cost(costs, p, segments[:count], values)
    span = count
    while span >= 2:
        i = 0
        while i + span <= count:
            j = i + span
            old = 0.0
            for k in range(i, j):
                old += values[k]
            start, end = pose_at(segments, i, count, goal), pose_at(segments, j, count, goal)
            far = math.hypot(end[0] - start[0], end[1] - start[1]) > 1e-9
            if far and line_cost(costs, bits, shape, p, start, end, old * 0.999 - 1e-6) < np.inf:
                fresh = write_line(added, 0, start, end)
                if fresh <= len(added) and count - span + fresh < len(segments):
                    count = replace_pieces(segments, values, count, i, j, added, fresh)
                    pieces_cost(costs, p, segments[i : i + fresh], values[i : i + fresh])
                    i += max(1, fresh // 2)
                    continue
            i += max(1, span // 4)
        span = span * 2 // 3 if span > 3 else span - 1
    return count


@plain_kernel
def bend(costs, bits, shapes, p, segments, added, values, count, goal, reach):
    """Move the points between pieces aside where lines through them cost less; return the number of pieces.

    `reach`: pieces before and after a point that are replaced. As `relax`, for a robot that drives in any direction.
    """
    shape = shapes[0]
    j = 1
    while j < count:
        first, last = max(0, j - reach), min(count, j + reach)
        old = 0.0
        for k in range(first, last):
            old += values[k]
        start, end = pose_at(segments, first, count, goal), pose_at(segments, last, count, goal)
        row = segments[j]
        course = row.yaw + row.sideways
        best, best_offset = old * 0.9995 - 1e-6, 0.0
        for option in range(4):
            offset = OFFSETS[option]
            middle = (row.x - offset * math.sin(course), row.y + offset * math.cos(course), row.yaw)
            cost = line_cost(costs, bits, shape, p, start, middle, best)
            if cost < best:
                cost += line_cost(costs, bits, shape, p, middle, end, best - cost)
            if cost < best:
                best, best_offset = cost, offset
        if best_offset != 0.0:
            x, y = row.x - best_offset * math.sin(course), row.y + best_offset * math.cos(course)
            middle = (x, y, row.yaw)
            fresh = write_line(added, write_line(added, 0, start, middle), middle, end)
            if fresh <= len(added) and count - (last - first) + fresh < len(segments):
                count = replace_pieces(segments, values, count, first, last, added, fresh)
                pieces_cost(costs, p, segments[first : first + fresh], values[first : first + fresh])
                j = max(j, first + fresh // 2)
        j += 1
    return count

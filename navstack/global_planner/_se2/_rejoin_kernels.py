# pyright: basic
"""The way from a pose beside a path back onto it. Coordinates are in cells."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import plain_kernel
from navstack.global_planner._se2._curve_check_kernels import FORWARD
from navstack.global_planner._se2._heuristic_kernels import apart
from navstack.global_planner._se2._path_kernels import RADII, best_curve, directions_around, pose_at, write_best

NEAR = 4.5
"""Cells: a pose is beside a path if it is this near to the start of a piece."""
SAME = 1.5
"""Cells: a piece is as near as another one if it is farther away by at most this."""
AHEAD = 4
"""Pieces after the nearest one onto which a way is tried."""
DEARER = 1.02
"""Factor by which the way may cost more than the stretch that it replaces."""


@plain_kernel
def stretch_at(p, segments, start):
    """Return (first, nearest): the pieces before and after a pose beside a path; (0, -1) if it is too far away.

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

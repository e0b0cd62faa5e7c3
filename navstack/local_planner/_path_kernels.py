# pyright: basic
"""The part of a plan near the robot."""

from __future__ import annotations

import math

from navstack.core.jit import kernel


@kernel
def transform_nearby_plan(plan, begin, x, y, reach, tx, ty, tyaw, out):
    """Write the poses of `plan` near (x, y), transformed by (tx, ty, tyaw), to `out`. Returns (first index, count).

    From the first pose within `reach` (m) up to and including the first one beyond it (transformGlobalPlan of
    base_local_planner). The search starts at index `begin`; x and y are in the plan's frame.
    """
    limit = reach * reach
    first = begin
    while first < len(plan):
        dx, dy = x - plan[first, 0], y - plan[first, 1]
        if dx * dx + dy * dy <= limit:
            break
        first += 1
    c, s = math.cos(tyaw), math.sin(tyaw)
    count = 0
    while first + count < len(plan):
        px, py, yaw = plan[first + count, 0], plan[first + count, 1], plan[first + count, 2]
        out[count, 0] = tx + c * px - s * py
        out[count, 1] = ty + s * px + c * py
        yaw += tyaw
        if not (-math.pi < yaw <= math.pi):
            yaw = yaw - 2.0 * math.pi * math.ceil((yaw - math.pi) / (2.0 * math.pi))
        out[count, 2] = yaw
        count += 1
        dx, dy = x - px, y - py
        if dx * dx + dy * dy > limit:
            break
    return first, count

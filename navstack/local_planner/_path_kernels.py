# pyright: basic
"""The part of a plan near the robot."""

from __future__ import annotations

import math

from navstack.core.jit import kernel


@kernel
def transform_nearby_plan(plan, begin, x, y, reach, tx, ty, tyaw, out):
    """Transforms the plan's poses near (x, y) by (tx, ty, tyaw) into `out`; (index of the first, how many).

    From the first pose within `reach` (m) up to and including the first one beyond (transformGlobalPlan). `begin` is where
    to start looking, x and y are in the plan's frame.
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

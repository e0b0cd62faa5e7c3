# pyright: basic
"""The part of a plan near the robot."""

from __future__ import annotations

import math

import numpy as np

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


@kernel
def closest_pose(plan, begin, x, y, search):
    """Return the index of the pose of `plan` (n, 4) closest to (x, y), from `begin` on; the later one of equals.

    Poses up to the first one more than `search` (m) along the plan are considered, the last pose of the plan never: two are
    needed for a direction (nav2_controller's FeasiblePathHandler). Column 3: length of the plan up to the pose (m).
    """
    limit = plan[begin, 3] + search
    best, nearest = begin, np.inf
    for i in range(begin, max(begin + 1, len(plan) - 1)):
        if plan[i, 3] > limit and i > begin:
            break
        dx, dy = plan[i, 0] - x, plan[i, 1] - y
        distance = dx * dx + dy * dy
        if distance <= nearest:
            best, nearest = i, distance
    return best


@kernel
def cut_path(plan, first, length, tx, ty, tyaw, window, out):
    """Write the poses of `plan` (n, 4) from `first` on, transformed by (tx, ty, tyaw), to `out` (m, 3). Returns how many.

    At most m poses, up to the last one before `length` (m from the plan's start) is exceeded, or before the first one outside
    of `window` (4,): lowest x and y, highest x and y. Yaws are in (-pi, pi].
    """
    c, s = math.cos(tyaw), math.sin(tyaw)
    for count in range(len(out)):
        i = first + count
        if plan[i, 3] > length:
            return count
        x = tx + c * plan[i, 0] - s * plan[i, 1]
        y = ty + s * plan[i, 0] + c * plan[i, 1]
        if not (window[0] <= x < window[2] and window[1] <= y < window[3]):
            return count
        yaw = plan[i, 2] + tyaw
        if not (-math.pi < yaw <= math.pi):
            yaw = yaw - 2.0 * math.pi * math.ceil((yaw - math.pi) / (2.0 * math.pi))
        out[count, 0] = x
        out[count, 1] = y
        out[count, 2] = yaw
    return len(out)


@kernel
def path_cuts(plan, at_cusps, rotation, out):
    """Write the indices of the poses at which `plan` (n, 4) reverses or turns in place to `out`. Returns how many.

    A cusp is a pose between two segments, each longer than 0.1 mm, of opposite directions. With `at_cusps` False, cusps are
    ignored. A turn in place is a sequence of poses within 0.1 mm that turns by at least `rotation` (rad); its last pose counts.
    """
    count = 0
    turned = 0.0
    before_x, before_y = 0.0, 0.0
    has_direction = False
    for i in range(1, len(plan)):
        dx, dy = plan[i, 0] - plan[i - 1, 0], plan[i, 1] - plan[i - 1, 1]
        if math.sqrt(dx * dx + dy * dy) > 1e-4:
            cut = abs(turned) >= rotation
            if at_cusps and has_direction and dx * before_x + dy * before_y < 0.0:
                cut = True
            if cut:
                out[count] = i - 1
                count += 1
            before_x, before_y, has_direction, turned = dx, dy, True, 0.0
        else:
            turn = plan[i, 2] - plan[i - 1, 2]
            turned += turn - 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
    return count

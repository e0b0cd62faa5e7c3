# pyright: basic
"""Kernels of the search for a way through an opening: all poses in which the robot is in the opening, from its line outward.

Lengths and positions are in cells of the costmap.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core import kernel, overlaps_lethal, place_footprint

# pyright: basic


NODE = np.dtype([("x", "f8"), ("y", "f8"), ("yaw", "f8"), ("parent", "i4"), ("direction", "i4")])
"""A pose, the node before it (-1: none), and the direction of the motion to it: 1 forward, -1 backward, 0 for the first one."""
SETTINGS = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("cell", "f8"),
        ("step", "f8"),
        ("checks", "i8"),
        ("curvature", "f8"),
        ("changes", "i8"),
        ("full", "i8"),
    ]
)
"""Low corner of the searched square, side of its cells, length of a motion, checks along it, greatest curvature, most changes
of direction; written by `search`: 1 if it ended because `nodes` was full."""
NEW, SEEN = 0, 2
"""What `enter` finds of a pose in the opening, and of one that was there before."""


@kernel
def slot(seen, settings, x, y, yaw):
    """Return row, column and bin of heading of a pose in `seen` (2, headings, ny, nx); row -1 outside it."""
    headings, ny, nx = seen.shape[1:]
    cell = settings["cell"][0]
    fx, fy = (x - settings["x"][0]) / cell, (y - settings["y"][0]) / cell
    if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
        return -1, 0, 0
    return np.int64(fy), np.int64(fx), np.int64(math.floor(yaw / (2.0 * math.pi) * headings + 0.5)) % headings


@kernel
def in_opening(hull, x, y, yaw, bar):
    """Return True if the convex polygon `hull` (2, n), counterclockwise, at a pose has a part of the line `bar` (x, y, x, y)."""
    c, s = math.cos(yaw), math.sin(yaw)
    px, py = c * (bar[0] - x) + s * (bar[1] - y), c * (bar[1] - y) - s * (bar[0] - x)
    dx = c * (bar[2] - bar[0]) + s * (bar[3] - bar[1])
    dy = c * (bar[3] - bar[1]) - s * (bar[2] - bar[0])
    begin, end = 0.0, 1.0
    n = hull.shape[1]
    for i in range(n):
        ax, ay = hull[0, i], hull[1, i]
        ex, ey = hull[0, (i + 1) % n] - ax, hull[1, (i + 1) % n] - ay
        # inside of an edge: depth + t * change >= 0
        depth, change = ex * (py - ay) - ey * (px - ax), ex * dy - ey * dx
        if change == 0.0:
            if depth < 0.0:
                return False
        elif change > 0.0:
            begin = max(begin, -depth / change)
        else:
            end = min(end, -depth / change)
    return begin <= end


@kernel
def add_seeds(costs, corners, settings, points, yaws, seen, nodes):
    """Write the free poses at `points` (n, 2) with `yaws` (k,) to `nodes`, one per cell of `seen`; return their number."""
    placed = np.empty(corners.shape)
    count = 0
    for k in range(len(yaws)):
        for i in range(len(points)):
            x, y = points[i]
            iy, ix, heading = slot(seen, settings, x, y, yaws[k])
            if iy < 0 or seen[0, heading, iy, ix] or count == len(nodes):
                continue
            if place_footprint(costs, 0.0, 0.0, 1.0, corners, x, y, yaws[k], placed) and not overlaps_lethal(
                costs, placed
            ):
                seen[0, heading, iy, ix] = True
                node = nodes[count]
                node["x"], node["y"], node["yaw"], node["parent"], node["direction"] = x, y, yaws[k], -1, 0
                count += 1
    return count


@kernel
def moved(x, y, yaw, length, curvature):
    """Return the pose at the end of an arc; a negative length leads backward."""
    turn = length * curvature
    chord = length * (math.sin(0.5 * turn) / (0.5 * turn) if turn != 0.0 else 1.0)
    return x + chord * math.cos(yaw + 0.5 * turn), y + chord * math.sin(yaw + 0.5 * turn), yaw + turn


@kernel
def sweep_is_free(costs, corners, node, length, curvature, checks, placed):
    """Return True if the footprint is free along an arc, at `checks` poses in equal steps up to its end."""
    for k in range(1, checks + 1):
        x, y, yaw = moved(node["x"], node["y"], node["yaw"], length * k / checks, curvature)
        if not place_footprint(costs, 0.0, 0.0, 1.0, corners, x, y, yaw, placed) or overlaps_lethal(costs, placed):
            return False
    return True


@kernel
def way_is_free(costs, corners, settings, nodes, last, checks):
    """Return True if the footprint is free along the motions to the node `last`, at `checks` poses of each."""
    placed = np.empty(corners.shape)
    step, child, parent = settings[0]["step"], last, nodes[last]["parent"]
    while parent >= 0:
        length = nodes[child]["direction"] * step
        curvature = (nodes[child]["yaw"] - nodes[parent]["yaw"]) / length
        if not sweep_is_free(costs, corners, nodes[parent], length, curvature, checks, placed):
            return False
        child, parent = parent, nodes[parent]["parent"]
    return True


@kernel
def passes_beside(bar, x, y, to_x, to_y):
    """Return True if a motion crosses the line through `bar` beyond one of its ends."""
    dx, dy = bar[2] - bar[0], bar[3] - bar[1]
    before, after = dx * (y - bar[1]) - dy * (x - bar[0]), dx * (to_y - bar[1]) - dy * (to_x - bar[0])
    if (before > 0.0) == (after > 0.0):
        return False
    weight = before / (before - after)
    share = ((x + weight * (to_x - x) - bar[0]) * dx + (y + weight * (to_y - y) - bar[1]) * dy) / (dx * dx + dy * dy)
    return share < 0.0 or share > 1.0


@kernel
def enter(hull, bar, settings, seen, node):
    """Mark the cell of a node in `seen`; return NEW, SEEN if it was marked, or the side of `bar`, 1 or -1, if it is out."""
    iy, ix, heading = slot(seen, settings, node["x"], node["y"], node["yaw"])
    backward = np.int64(node["direction"] < 0)
    if seen[backward, heading, iy, ix]:
        return SEEN
    seen[backward, heading, iy, ix] = True
    if in_opening(hull, node["x"], node["y"], node["yaw"], bar):
        return NEW
    across = (bar[2] - bar[0]) * (node["y"] - bar[1]) - (bar[3] - bar[1]) * (node["x"] - bar[0])
    return 1 if across > 0.0 else -1


@kernel
def search(costs, corners, hull, bar, settings, seen, nodes, count, side, ends):
    """Search from the first `count` nodes until the robot is out of the opening; return the number of `ends`.

    Poses with fewer changes of direction come first. With `side` 1 or -1, the search ends at the first pose out of the opening on
    that side of `bar`, its only end; with 0, `ends` (n, 2) gets all of them: node, side. It ends where `nodes` is full, too.
    """
    placed, queue = np.empty(corners.shape), np.empty((2, len(nodes)), np.int32)
    step, steepest, checks = settings[0]["step"], settings[0]["curvature"], settings[0]["checks"]
    found, waiting, changes, most = 0, count, -1, settings[0]["changes"]
    queue[1, :count] = np.arange(count)
    while waiting > 0:
        number = 0
        changes += 1
        for k in range(waiting):  # of the layer with one more change of direction
            i = queue[1, k]
            state = enter(hull, bar, settings, seen, nodes[i]) if nodes[i]["direction"] != 0 else NEW
            if state == NEW:
                queue[0, number] = i
                number += 1
            elif state != SEEN and (side == 0 or state == side):
                ends[found, 0], ends[found, 1] = i, state
                found += 1
                if side != 0:
                    return found
        head, waiting = 0, 0
        while head < number:
            here = nodes[queue[0, head]]
            for move in range(6):
                sign = 1 if move < 3 else -1
                changed = sign * here["direction"] < 0
                if changed and changes == most:
                    continue
                length, curvature = sign * step, (move % 3 - 1) * steepest
                x, y, yaw = moved(here["x"], here["y"], here["yaw"], length, curvature)
                iy, ix, heading = slot(seen, settings, x, y, yaw)
                if iy < 0 or seen[np.int64(sign < 0), heading, iy, ix]:
                    continue
                if passes_beside(bar, here["x"], here["y"], x, y):
                    continue
                if not sweep_is_free(costs, corners, here, length, curvature, checks, placed):
                    continue
                if count == len(nodes):
                    settings[0]["full"] = 1
                    return found
                node = nodes[count]
                node["x"], node["y"], node["yaw"], node["direction"] = x, y, yaw, sign
                node["parent"] = queue[0, head]
                count += 1
                if changed:
                    queue[1, waiting] = count - 1
                    waiting += 1
                    continue
                state = enter(hull, bar, settings, seen, node)
                if state == NEW:
                    queue[0, number] = count - 1
                    number += 1
                elif side == 0 or state == side:
                    ends[found, 0], ends[found, 1] = count - 1, state
                    found += 1
                    if side != 0:
                        return found
            head += 1
    return found


# --- headings ---------------------------------------------------------------------------------------------------------


# pyright: basic


@kernel
def first_free(costs, origin_x, origin_y, resolution, corners, points, yaws, first):
    """Write to `first` (k,), for each of `yaws`, the index of the first of `points` (n, 2) where a footprint is free, or -1.

    `corners` (2, m): of the footprint in the robot's frame (m). Free is a pose inside the grid with no lethal cell under it.
    """
    placed = np.empty(corners.shape)
    for k in range(len(yaws)):
        first[k] = -1
        for i in range(len(points)):
            x, y = points[i]
            if place_footprint(
                costs, origin_x, origin_y, resolution, corners, x, y, yaws[k], placed
            ) and not overlaps_lethal(costs, placed):
                first[k] = i
                break

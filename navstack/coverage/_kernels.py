# pyright: basic
"""Kernels of coverage: lines between free positions, distances around obstacles, and what a tool sweeps."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import kernel, plain_kernel

STRAIGHT, DIAGONAL = 5, 7
"""Lengths of a step to a neighbor in fifths of a cell: their ratio is within 1 % of the square root of 2."""
FAR = 2**30
"""Distance of what cannot be reached."""
ON_NODE = 0.02
"""Cells: a coordinate this near to a center counts as that of the center."""


@plain_kernel
def is_free_at(free, row, column):
    """Return True if the centers around a coordinate on a grid line are free; one of both numbers is whole.

    `row` and `column` are in cells, whole at centers of cells.
    """
    ny, nx = free.shape
    y0, x0 = math.floor(row + ON_NODE), math.floor(column + ON_NODE)
    y1, x1 = math.ceil(row - ON_NODE), math.ceil(column - ON_NODE)
    if y0 < 0 or x0 < 0 or y1 >= ny or x1 >= nx:
        return False
    return free[y0, x0] and free[y1, x1] and free[y0, x1] and free[y1, x0]


@plain_kernel
def is_clear(free, x0, y0, x1, y1):
    """Return True if a line runs between free centers only; coordinates in cells, whole at centers.

    Where the line crosses a column (or a row, if it is steep), both centers next to it must be free. Between two such crossings
    it is in a triangle of free centers, so an obstacle is no nearer to it than the reach of the footprint, see `reach_of`.
    """
    if not (is_free_at(free, y0, x0) and is_free_at(free, y1, x1)):
        return False
    dx, dy = x1 - x0, y1 - y0
    steep = abs(dy) > abs(dx)
    a, b = (y0, y1) if steep else (x0, x1)
    if abs(b - a) < 1e-12:
        return True
    low, high = min(a, b), max(a, b)
    for k in range(math.ceil(low - ON_NODE), math.floor(high + ON_NODE) + 1):
        t = min(max((k - a) / (b - a), 0.0), 1.0)
        if steep:
            if not is_free_at(free, float(k), x0 + t * dx):
                return False
        elif not is_free_at(free, y0 + t * dy, float(k)):
            return False
    return True


@kernel
def shortened(free, points, deviation):
    """Return the indices of the points (n, 2), in cells, that a line keeps if clear stretches become straight.

    No point left out is farther than `deviation` (cells) from the line.
    """
    n = len(points)
    kept = np.empty(n, np.int64)
    count, at = 1, 0
    kept[0] = 0
    while at < n - 1:
        best = at + 1
        ahead = at + 2
        while ahead < n:
            px, py = points[at, 0], points[at, 1]
            dx, dy = points[ahead, 0] - px, points[ahead, 1] - py
            length = math.hypot(dx, dy)
            near = True
            for k in range(at + 1, ahead):
                ox, oy = points[k, 0] - px, points[k, 1] - py
                away = abs(ox * dy - oy * dx) / length if length > 0.0 else math.hypot(ox, oy)
                along = ox * dx + oy * dy
                if away > deviation or along < -1e-9 or along > length * length + 1e-9:
                    near = False
                    break
            if not near:
                break
            if is_clear(free, px, py, points[ahead, 0], points[ahead, 1]):
                best = ahead
            elif ahead - best > 8:
                break
            ahead += 1
        kept[count] = best
        count += 1
        at = best
    return kept[:count]


@plain_kernel
def flood(free, source, target, distance, after, before):
    """Write the distances around obstacles from the cell `source` (flat index), in fifths of a cell; FAR where unreachable.

    Steps lead to the eight neighbors. The search ends at the cell `target` (flat), or covers everything if that is negative.
    `after` and `before` (ny * nx + 8,) are scratch: cells of equal distance are a list (R. Dial, Algorithm 360, 1969), whose
    head is one of the last eight items.
    """
    ny, nx = free.shape
    size = ny * nx
    distance[:] = FAR
    for k in range(8):
        after[size + k] = -1
    distance[source] = 0
    after[size], after[source], before[source] = source, -1, size
    waiting, level = 1, 0
    while waiting > 0:
        cell = after[size + (level & 7)]
        if cell < 0:
            level += 1
            continue
        head, rest = size + (level & 7), after[cell]
        after[head] = rest
        if rest >= 0:
            before[rest] = head
        before[cell] = -1
        waiting -= 1
        if cell == target:
            return
        y, x = cell // nx, cell % nx
        for oy in range(-1, 2):
            for ox in range(-1, 2):
                v, u = y + oy, x + ox
                if (oy == 0 and ox == 0) or v < 0 or u < 0 or v >= ny or u >= nx or not free[v, u]:
                    continue
                further = level + (STRAIGHT if oy == 0 or ox == 0 else DIAGONAL)
                cell_there = v * nx + u
                if further >= distance[cell_there]:
                    continue
                if distance[cell_there] < FAR:  # it waits in the list of a larger distance
                    one, other = before[cell_there], after[cell_there]
                    after[one] = other
                    if other >= 0:
                        before[other] = one
                else:
                    waiting += 1
                distance[cell_there] = further
                head = size + (further & 7)
                first = after[head]
                after[cell_there], before[cell_there], after[head] = first, head, cell_there
                if first >= 0:
                    before[first] = cell_there


@kernel
def way_back(free, distance, target):
    """Return the cells (n, 2) ix, iy from the source of a `flood` to the cell `target` (flat), which it has reached."""
    ny, nx = free.shape
    cells = np.empty((distance[target] // STRAIGHT + 2, 2), np.int64)
    count, at = 0, target
    while True:
        y, x = at // nx, at % nx
        cells[count, 0], cells[count, 1] = x, y
        count += 1
        if distance[at] == 0:
            return cells[:count][::-1].copy()
        best = at
        for oy in range(-1, 2):
            for ox in range(-1, 2):
                v, u = y + oy, x + ox
                if (oy == 0 and ox == 0) or v < 0 or u < 0 or v >= ny or u >= nx or not free[v, u]:
                    continue
                step = STRAIGHT if oy == 0 or ox == 0 else DIAGONAL
                if distance[v * nx + u] + step == distance[at]:
                    best = v * nx + u
        at = best


@plain_kernel
def sweep(points, works, radius, step, visits, last, travelled):
    """Sweep a round tool along the polyline `points` (n, 2), in cells; return the distance traveled so far (cells).

    `works` (n,) is True where the tool works on the way to the next point. A covered cell (its center is in the disc) counts a
    visit in `visits` (ny, nx) if it was not under the tool within the last `2 * radius` of the way: a tool that turns in place
    or goes on covers it once. `last` (ny, nx) is the distance (cells) at which it was last under the tool, before `travelled`
    far in the negative. Positions are at most `step` (cells) apart.
    """
    ny, nx = visits.shape
    for k in range(len(points) - 1):
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        length = math.hypot(dx, dy)
        count = max(1, math.ceil(length / step))
        if works[k]:
            for i in range(count + 1):
                cx, cy = points[k, 0] + dx * i / count, points[k, 1] + dy * i / count
                now = travelled + length * i / count
                for y in range(max(0, math.ceil(cy - radius)), min(ny - 1, math.floor(cy + radius)) + 1):
                    half = math.sqrt(max(0.0, radius * radius - (y - cy) * (y - cy)))
                    for x in range(max(0, math.ceil(cx - half)), min(nx - 1, math.floor(cx + half)) + 1):
                        if now - last[y, x] > 2.0 * radius:
                            visits[y, x] += 1
                        last[y, x] = now
        travelled += length
    return travelled


@plain_kernel
def stamp(points, radius, step, area, passes, mark, number, change):
    """Add `change` to `passes` (ny, nx) under a round tool along the polyline `points` (n, 2), once per cell, as in `sweep`.

    Only cells of `area` (ny, nx) count. `mark` (ny, nx) int32 is scratch: `number`, another one in each call, marks what this
    polyline has met. Returns how many cells the polyline covers, and how many of them no other one does.
    """
    ny, nx = passes.shape
    covered, alone = 0, 0
    for k in range(max(1, len(points) - 1)):
        j = min(k + 1, len(points) - 1)
        dx, dy = points[j, 0] - points[k, 0], points[j, 1] - points[k, 1]
        count = max(1, math.ceil(math.hypot(dx, dy) / step))
        for i in range(count + 1):
            cx, cy = points[k, 0] + dx * i / count, points[k, 1] + dy * i / count
            for y in range(max(0, math.ceil(cy - radius)), min(ny - 1, math.floor(cy + radius)) + 1):
                half = math.sqrt(max(0.0, radius * radius - (y - cy) * (y - cy)))
                for x in range(max(0, math.ceil(cx - half)), min(nx - 1, math.floor(cx + half)) + 1):
                    if area[y, x] and mark[y, x] != number:
                        mark[y, x] = number
                        covered += 1
                        # without this polyline: what the others do; with it, before it is added, the same
                        alone += passes[y, x] == (0 if change > 0 else 1)
                        passes[y, x] += change
    return covered, alone


@plain_kernel
def rows_across(area, angle, spacing):
    """Return how many stretches of `area` (ny, nx) lines at `angle` (rad) cross that are `spacing` (cells) apart."""
    ny, nx = area.shape
    c, s = math.cos(angle), math.sin(angle)
    reach = 0.5 * math.hypot(nx, ny)
    number = 0
    v = -reach + 0.5 * spacing
    while v < reach:
        inside = False
        u = -reach
        while u < reach:
            x = math.floor(0.5 * nx + u * c - v * s)
            y = math.floor(0.5 * ny + u * s + v * c)
            here = x >= 0 and y >= 0 and x < nx and y < ny and area[y, x]
            number += here and not inside
            inside = here
            u += 1.0
        v += spacing
    return number

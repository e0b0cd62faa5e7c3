# pyright: basic
"""Kernels: exact distances from cells and lines to obstacles, and the skeleton of the free space. Lengths are in cells.

An obstacle is the square of a cell, [ix, ix + 1] x [iy, iy + 1]; what is outside the grid is one, too.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core import kernel


@kernel
def square_distances(occupied, distances):
    """Write the distance from the center of each cell (ny, nx) to the nearest obstacle, 0 in one.

    Columns first, then rows: a cell looks aside only as far as something nearer can be.
    """
    ny, nx = occupied.shape
    gaps = np.empty((ny, nx), np.float64)
    for ix in range(nx):
        gap = 0.5
        for iy in range(ny):
            gap = 0.0 if occupied[iy, ix] else gap
            gaps[iy, ix] = gap
            gap = gap + 1.0 if gap > 0.0 else 0.5
        gap = 0.5
        for iy in range(ny - 1, -1, -1):
            gap = 0.0 if occupied[iy, ix] else gap
            gaps[iy, ix] = min(gaps[iy, ix], gap)
            gap = gap + 1.0 if gap > 0.0 else 0.5
    for iy in range(ny):
        for ix in range(nx):
            best = gaps[iy, ix] ** 2
            for aside in range(1, nx + 1):
                across = (aside - 0.5) ** 2
                if across >= best:
                    break
                left = gaps[iy, ix - aside] if ix >= aside else 0.0
                right = gaps[iy, ix + aside] if ix + aside < nx else 0.0
                nearer = min(left, right)
                best = min(best, across + nearer * nearer)
            distances[iy, ix] = math.sqrt(best)


@kernel
def _to_square(x0, y0, x1, y1, ix, iy):
    """Return the distance between a segment and the square of a cell."""
    low, high = 0.0, 1.0
    dx, dy = x1 - x0, y1 - y0
    for start, step, near in ((x0, dx, float(ix)), (y0, dy, float(iy))):
        if step == 0.0:
            if start < near or start > near + 1.0:
                low = 2.0
        else:
            a, b = (near - start) / step, (near + 1.0 - start) / step
            low, high = max(low, min(a, b)), min(high, max(a, b))
    if low <= high:
        return 0.0
    best = math.inf
    for x, y in ((x0, y0), (x1, y1)):
        best = min(best, math.hypot(max(ix - x, x - ix - 1.0, 0.0), max(iy - y, y - iy - 1.0, 0.0)))
    squared = dx * dx + dy * dy
    if squared > 0.0:
        left, low_y = float(ix), float(iy)
        for x, y in ((left, low_y), (left + 1.0, low_y), (left, low_y + 1.0), (left + 1.0, low_y + 1.0)):
            t = min(max(((x - x0) * dx + (y - y0) * dy) / squared, 0.0), 1.0)
            best = min(best, math.hypot(x0 + t * dx - x, y0 + t * dy - y))
    return best


@kernel
def segment_clearances(occupied, distances, segments, clearances):
    """Write the distance to the nearest obstacle of segments (k, 4) = x0, y0, x1, y1; `distances` are those of the cells.

    Exact: pieces of half a cell are compared with all squares that can be nearer than what was found.
    """
    ny, nx = occupied.shape
    for i in range(len(segments)):
        x0, y0, x1, y1 = segments[i, 0], segments[i, 1], segments[i, 2], segments[i, 3]
        count = max(1, math.ceil(2.0 * math.hypot(x1 - x0, y1 - y0)))
        best = min(x0, y0, nx - x0, ny - y0, x1, y1, nx - x1, ny - y1)
        if best <= 0.0:
            clearances[i] = 0.0
            continue
        for k in range(count + 1):
            x, y = x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count
            cx, cy = int(x), int(y)
            best = min(best, distances[cy, cx] + math.hypot(x - cx - 0.5, y - cy - 0.5))
        for k in range(count):
            ax, ay = x0 + (x1 - x0) * k / count, y0 + (y1 - y0) * k / count
            bx, by = x0 + (x1 - x0) * (k + 1) / count, y0 + (y1 - y0) * (k + 1) / count
            cx, cy = int(ax), int(ay)
            if distances[cy, cx] - math.hypot(ax - cx - 0.5, ay - cy - 0.5) - math.hypot(bx - ax, by - ay) >= best:
                continue
            reach = int(best) + 2
            for iy in range(max(cy - reach, 0), min(cy + reach + 1, ny)):
                for ix in range(max(cx - reach, 0), min(cx + reach + 1, nx)):
                    if occupied[iy, ix]:
                        best = min(best, _to_square(ax, ay, bx, by, ix, iy))
            if best == 0.0:
                break
        clearances[i] = best


@kernel
def ridge(distances, lowest, anchors):
    """Mark the cells whose distance is at least `lowest`, and at least that of the cells around them, up to half of it away."""
    ny, nx = distances.shape
    for iy in range(ny):
        for ix in range(nx):
            here = distances[iy, ix]
            if here < lowest:
                continue
            reach = max(1, int(0.5 * here))
            highest = True
            for size in (1, reach):  # the neighbors first: most cells are no maximum
                for jy in range(max(iy - size, 0), min(iy + size + 1, ny)):
                    for jx in range(max(ix - size, 0), min(ix + size + 1, nx)):
                        highest &= distances[jy, jx] <= here
                    if not highest:
                        break
                if not highest:
                    break
            anchors[iy, ix] = highest


@kernel
def thin(cells, anchors, order, keep_ends):
    """Remove cells of the free space (ny, nx) bool, in `order`, as long as no part of it splits, vanishes or gains a hole.

    `anchors` stay, with `keep_ends` also cells with one neighbor, or two beside each other. `cells` must be False along the
    border; `order` (k,) are flat indices.
    """
    nx = cells.shape[1]
    flat, stay = cells.reshape(-1), anchors.reshape(-1)
    around = np.array([1, 1 - nx, -nx, -1 - nx, -1, nx - 1, nx, nx + 1])
    left = len(order)
    alive = order.copy()
    changed = True
    while changed:
        changed = False
        kept = 0
        for k in range(left):
            cell = alive[k]
            # the number of parts of the 8 neighbors (Yokoi's, for 8-connected cells)
            parts = count = 0
            beside = 0
            for j in range(8):
                count += flat[cell + around[j]]
                beside += flat[cell + around[j]] and flat[cell + around[(j + 1) % 8]]
            if not (stay[cell] or (keep_ends and count - beside <= 1 and count <= 2)):
                for j in (0, 2, 4, 6):
                    a = not flat[cell + around[j]]
                    b = not flat[cell + around[j + 1]]
                    c = not flat[cell + around[(j + 2) % 8]]
                    parts += a - (a and b and c)
            if parts == 1:
                flat[cell] = False
                changed = True
            else:
                alive[kept] = cell
                kept += 1
        left = kept

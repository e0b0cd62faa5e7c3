# pyright: basic
"""Branch and bound over all poses of a map: scores of a scan, and their upper bounds for blocks of poses.

Idea: Olson (Real-Time Correlative Scan Matching, ICRA 2009) and Hess et al. (Real-Time Loop Closure in 2D LIDAR SLAM, ICRA
2016). The score of a pose is the sum of the field (uint8) at the cells where the beams end. The bound of a block of
`STRIDE` x `STRIDE` poses sums, for each beam, the largest value in the block of cells where it can end. The blocks' maxima are
stored by phase: all blocks of one heading then see a beam at a constant distance in memory, and a heading is a sum of shifted
arrays, which the processor adds 16 or 32 at a time.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

STRIDE = 4
"""Cells per side of a block."""


@kernel
def block_maxima(padded):
    """Return (STRIDE, STRIDE, rows, columns) uint8: the largest value of each block of cells, by the phase of its corner.

    `padded` (rows * STRIDE, columns * STRIDE) uint8. Element [a, b, y, x] covers the cells from (STRIDE y + a, STRIDE x + b) on.
    """
    ny, nx = padded.shape
    along = padded.copy()
    for iy in range(ny):
        for ix in range(nx):
            best = padded[iy, ix]
            for k in range(1, min(STRIDE, nx - ix)):
                if padded[iy, ix + k] > best:
                    best = padded[iy, ix + k]
            along[iy, ix] = best
    phases = np.empty((STRIDE, STRIDE, ny // STRIDE, nx // STRIDE), np.uint8)
    for iy in range(ny):
        for ix in range(nx):
            best = along[iy, ix]
            for k in range(1, min(STRIDE, ny - iy)):
                if along[iy + k, ix] > best:
                    best = along[iy + k, ix]
            phases[iy % STRIDE, ix % STRIDE, iy // STRIDE, ix // STRIDE] = best
    return phases


@kernel
def beam_cells(points, yaw, resolution, pad, out):
    """Write the cells (n, 2) = y, x where the beams end, relative to the pose's cell and shifted by `pad`, at a heading."""
    c, s = math.cos(yaw) / resolution, math.sin(yaw) / resolution
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = math.floor(s * x + c * y + 0.5) + pad
        out[i, 1] = math.floor(c * x - s * y + 0.5) + pad


@kernel
def add_four(total, a, b, c, d):
    """Add four arrays (n,) uint8 to `total` (n,) uint16."""
    for k in range(total.shape[0]):
        total[k] += np.uint16(a[k]) + np.uint16(b[k]) + np.uint16(c[k]) + np.uint16(d[k])


@kernel
def add_one(total, a):
    """Add an array (n,) uint8 to `total` (n,) uint16."""
    for k in range(total.shape[0]):
        total[k] += np.uint16(a[k])


@kernel
def block_bounds(phases, has_free, points, headings, resolution, pad):
    """Return (headings, rows * columns) uint16: upper bounds of the scores in each block of poses, 0 for blocks without any.

    `phases`: of `block_maxima`, for a field with `pad` empty cells (a multiple of STRIDE) around it; `points` (n, 2): ends of
    the beams in the base frame (m), n <= 255, each nearer than pad - STRIDE cells; `has_free` (rows, ..) uint8: 1 for the blocks
    that contain free cells.
    """
    columns = phases.shape[3]
    rows = has_free.shape[0]
    mask = np.zeros(rows * columns, np.uint16)
    for j in range(rows):
        for i in range(has_free.shape[1]):
            mask[j * columns + i] = has_free[j, i]
    size = phases.shape[2] * columns
    flat = phases.ravel()
    n = points.shape[0]
    count = rows * columns - 2 * (pad // STRIDE)  # the blocks from the last pose on are beyond the map
    bounds = np.zeros((headings.shape[0], rows * columns), np.uint16)
    cells = np.empty((n, 2), np.int64)
    first = np.empty(n, np.int64)
    for h in range(headings.shape[0]):
        beam_cells(points, headings[h], resolution, pad, cells)
        for i in range(n):
            y, x = cells[i, 0], cells[i, 1]
            phase = (y % STRIDE) * STRIDE + x % STRIDE
            first[i] = phase * size + (y // STRIDE) * columns + x // STRIDE
        total = bounds[h, :count]
        i = 0
        while i + 4 <= n:
            a, b, c, d = first[i], first[i + 1], first[i + 2], first[i + 3]
            add_four(total, flat[a : a + count], flat[b : b + count], flat[c : c + count], flat[d : d + count])
            i += 4
        while i < n:
            add_one(total, flat[first[i] : first[i] + count])
            i += 1
        for k in range(count):
            total[k] *= mask[k]
    return bounds


@kernel
def best_in_block(padded, free, cells, row, column, sums):
    """Return (score, iy, ix) of the best pose in free space in a block; score -1 if it has none.

    `sums` (STRIDE * STRIDE,) uint16 is scratch space.
    """
    sums[:] = 0
    y0, x0 = row * STRIDE, column * STRIDE
    for i in range(cells.shape[0]):
        y, x = y0 + cells[i, 0], x0 + cells[i, 1]
        for a in range(STRIDE):
            line = padded[y + a, x : x + STRIDE]
            into = sums[a * STRIDE : (a + 1) * STRIDE]
            for b in range(STRIDE):
                into[b] += np.uint16(line[b])
    best, by, bx = np.int64(-1), 0, 0
    ny, nx = free.shape
    for a in range(min(STRIDE, ny - y0)):
        for b in range(min(STRIDE, nx - x0)):
            if free[y0 + a, x0 + b] != 0 and np.int64(sums[a * STRIDE + b]) > best:
                best, by, bx = np.int64(sums[a * STRIDE + b]), y0 + a, x0 + b
    return best, by, bx


@kernel
def order_by_bound(bounds, lowest, budget):
    """Return (order, floor): the flat indices of all bounds of at least `floor`, in descending order of the bounds.

    `floor` >= `lowest` is chosen from a sample such that there are about `budget` of them.
    """
    width = bounds.shape[1]
    counts = np.zeros(65537, np.int64)
    step = 7
    for h in range(bounds.shape[0]):
        for k in range(h % step, width, step):
            counts[bounds[h, k]] += step
    floor, above = np.int64(65535), np.int64(0)
    while floor > lowest and above + counts[floor] <= budget:
        above += counts[floor]
        floor -= 1
    floor = max(floor, lowest)
    counts[:] = 0
    n = 0
    for h in range(bounds.shape[0]):
        row = bounds[h]
        for k in range(width):
            if row[k] >= floor:
                n += 1
    chosen = np.empty(n, np.int64)
    n = 0
    for h in range(bounds.shape[0]):
        row = bounds[h]
        for k in range(width):
            if row[k] >= floor:
                chosen[n] = h * width + k
                n += 1
                counts[65536 - np.int64(row[k])] += 1
    for v in range(1, 65537):
        counts[v] += counts[v - 1]
    order = np.empty(n, np.int64)
    for i in range(n):
        at = 65535 - np.int64(bounds[chosen[i] // width, chosen[i] % width])
        order[counts[at]] = chosen[i]
        counts[at] += 1
    return order, floor


@kernel
def search_blocks(padded, free, has_free, bounds, points, headings, settings):
    """Return (found (m, 4), expanded, complete): the best pose in each of the `keep` best bins, rows score, iy, ix, heading.

    A bin is a block of positions and `sector` neighbouring headings. Blocks are searched in the order of their bounds until no
    bound exceeds the score of the last bin that is kept, or until about `budget` blocks were searched (`complete` False).
    `settings` = [resolution, pad, keep, sector, budget, lowest].
    """
    resolution, pad = settings[0], np.int64(settings[1])
    keep, sector, budget = np.int64(settings[2]), np.int64(settings[3]), np.int64(settings[4])
    width = bounds.shape[1]
    rows, columns = has_free.shape
    stride = width // rows
    order, floor = order_by_bound(bounds, np.int64(settings[5]), budget)
    n_headings, n = headings.shape[0], points.shape[0]
    cells = np.empty((n_headings, n, 2), np.int64)
    for h in range(n_headings):
        beam_cells(points, headings[h], resolution, pad, cells[h])
    sectors = (n_headings + sector - 1) // sector
    best = np.zeros((sectors, rows * columns, 4), np.int64)
    at_least = np.zeros(65536, np.int64)  # number of bins by score
    threshold, above = np.int64(settings[5]), 0
    sums = np.empty(STRIDE * STRIDE, np.uint16)
    expanded = 0
    for i in range(order.shape[0]):
        h, k = order[i] // width, order[i] % width
        if np.int64(bounds[h, k]) < threshold:
            break
        expanded += 1
        row, column = k // stride, k % stride
        score, iy, ix = best_in_block(padded, free, cells[h], row, column, sums)
        entry = best[h // sector, row * columns + column]
        if score < threshold or score <= entry[0]:
            continue
        if entry[0] >= threshold and entry[0] > 0:
            at_least[entry[0]] -= 1
            above -= 1
        entry[0], entry[1], entry[2], entry[3] = score, iy, ix, h
        at_least[score] += 1
        above += 1
        while above - at_least[threshold] >= keep:
            above -= at_least[threshold]
            threshold += 1
    found = np.empty((max(above, 1), 4), np.int64)
    m = 0
    for a in range(sectors):
        for k in range(rows * columns):
            if best[a, k, 0] >= threshold and best[a, k, 0] > 0 and m < above:
                found[m] = best[a, k]
                m += 1
    return found[:m], expanded, threshold >= floor

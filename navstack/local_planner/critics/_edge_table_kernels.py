# pyright: basic
"""Costs on the edges of many footprints at once.

The cells of an edge (Bresenham), relative to its first cell, depend only on the difference between its last and its first cell.
The footprints of a cycle's rollouts have thousands of edges, but fewer than a hundred such differences per edge of the polygon.
For each of them the highest cost is computed for 32 first cells at once; each edge is then a look-up.

Costs are copied to a patch around the rollouts. Its cells are numbered `v * pitch + u`: u is x or y, whichever the rollouts
extend farther along, because rows along it fill whole vectors.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel
from navstack.core.line_kernels import FIXED

BLOCK = 32
"""Cells that are added to a table together."""
HEADER = 3
"""Elements before the offsets of an edge: lowest u and start of its table, number of offsets."""
MISSING = 255
"""In a table: not computed yet. Unknown cells count as lethal."""
LARGEST_YAW = 1000.0
"""rad: `headings` is not accurate beyond."""
TWO_OVER_PI = 2.0 / math.pi
HALF_PI_HIGH, HALF_PI_LOW = 1.5707963267341256, 6.077100506506192e-11
"""pi / 2 in two parts: multiples of the first one are exact."""
CHUNK = 256
"""Poses whose corners are placed together: their coordinates stay in the fastest cache."""
X, Y, YAW, COS, SIN, SCALE = range(6)
"""Rows of `poses` below: position in cells of the costmap, heading (rad), scale of the footprint."""


@kernel
def headings(poses, first, last):
    """Write cosines and sines of the headings of `poses` (6, N) from `first` to `last`, with an error below 2e-10; vectorized.

    Taylor polynomials of degree 10 and 11 after a reduction to at most pi / 4.
    """
    for i in range(np.uint64(first), np.uint64(last)):
        yaw = poses[YAW, i]
        quarter = np.int32(yaw * TWO_OVER_PI + 4096.5) - np.int32(4096)
        r = (yaw - quarter * HALF_PI_HIGH) - quarter * HALF_PI_LOW
        q = r * r
        s = r * (1.0 + q * (-1 / 6 + q * (1 / 120 + q * (-1 / 5040 + q * (1 / 362880 - q * (1 / 39916800))))))
        c = 1.0 + q * (-1 / 2 + q * (1 / 24 + q * (-1 / 720 + q * (1 / 40320 - q * (1 / 3628800)))))
        odd = (quarter & np.int32(1)) != 0
        a, b = s if odd else c, c if odd else s
        poses[COS, i] = -a if ((quarter + np.int32(1)) & np.int32(2)) != 0 else a
        poses[SIN, i] = -b if (quarter & np.int32(2)) != 0 else b


@kernel
def place_corner(poses, first, last, corner, patch, j, codes, doubtful, boxes):
    """Write the cells of the corner j of footprints to `codes[j]`, and grow `boxes[j]`: lowest x and y, highest x and y.

    `poses` (6, N), from `first` to `last`. `corner`: x and y (cells). `patch`: x and y of its first cell, strides along x and
    y, size of the costmap, margin. A corner nearer than the margin to the border of a cell, or outside the costmap, is
    `doubtful`; it gets the first cell of the patch.
    """
    a, b = corner
    x0, y0, stride_x, stride_y, nx, ny, margin = patch
    half = 0.5 - margin
    low_x, low_y, high_x, high_y = boxes[j, 0], boxes[j, 1], boxes[j, 2], boxes[j, 3]
    for i in range(np.uint64(first), np.uint64(last)):
        vx, vy = poses[SCALE, i] * a, poses[SCALE, i] * b
        fx = poses[X, i] + (vx * poses[COS, i] - vy * poses[SIN, i])
        fy = poses[Y, i] + (vx * poses[SIN, i] + vy * poses[COS, i])
        inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
        ix, iy = np.int32(fx if inside else 0.0), np.int32(fy if inside else 0.0)
        sure = inside & (abs(fx - ix - 0.5) < half) & (abs(fy - iy - 0.5) < half)
        ix, iy = ix if sure else x0, iy if sure else y0
        doubtful[i] |= np.uint8(0 if sure else 1)
        codes[np.uint64(j), i] = (ix - x0) * stride_x + (iy - y0) * stride_y
        low_x, low_y = min(low_x, ix), min(low_y, iy)
        high_x, high_y = max(high_x, ix), max(high_y, iy)
    boxes[j, 0], boxes[j, 1], boxes[j, 2], boxes[j, 3] = low_x, low_y, high_x, high_y


@kernel
def place_exactly(vertices, scale, pose, settings, patch, codes, boxes):
    """Write the cells of all corners of one footprint to `codes` (n,), as `edge_cost` computes them, and grow `boxes` (n, 4).

    Returns False if a corner is outside the costmap; all then get the first cell of the patch. Other arguments: `place_corner`.
    """
    x0, y0, stride_x, stride_y, nx, ny, _ = patch
    c, s = math.cos(pose[2]), math.sin(pose[2])
    outside = 0
    for attempt in range(2):
        for j in range(len(vertices)):
            vx, vy = scale * vertices[j, 0], scale * vertices[j, 1]
            fx = ((pose[0] + (vx * c - vy * s)) - settings.origin_x) / settings.resolution
            fy = ((pose[1] + (vx * s + vy * c)) - settings.origin_y) / settings.resolution
            inside = (fx >= 0.0) & (fy >= 0.0) & (fx < nx) & (fy < ny)
            if attempt == 0:
                outside += not inside
                continue
            ix = np.int32(fx if outside == 0 else x0)
            iy = np.int32(fy if outside == 0 else y0)
            codes[j] = (ix - x0) * stride_x + (iy - y0) * stride_y
            boxes[j, 0], boxes[j, 1] = min(boxes[j, 0], ix), min(boxes[j, 1], iy)
            boxes[j, 2], boxes[j, 3] = max(boxes[j, 2], ix), max(boxes[j, 3], iy)
    return outside == 0


@kernel
def edge_offsets(du, dv, pitch, offsets, first):
    """Write the cells of an edge by (du, dv) relative to its first cell, the last one excepted; return how many.

    They are written to `offsets`, from `first` on. The number is a multiple of four: the first cell is repeated. As in
    `edge_cost`, the last cell belongs to the next edge.
    """
    long_u, long_v = abs(du), abs(dv)
    along_u = long_u >= long_v
    steps = long_u if along_u else long_v
    add = long_v if along_u else long_u
    step_u, step_v = 1 if du > 0 else -1, pitch if dv > 0 else -pitch
    major, minor = (step_u, step_v) if along_u else (step_v, step_u)
    # (steps // 2 + i * add) // steps cells along the minor axis, in fixed point: see `clear_line`
    scale = (1 << FIXED) / max(steps, 1)
    slope, at = np.int64(add * scale) + 1, np.int64((steps // 2) * scale) + 1
    number = (max(steps, 1) + 3) // 4 * 4
    for i in range(np.uint64(number)):
        m = np.int64(i) if np.int64(i) < steps else 0
        offsets[np.uint64(first) + i] = m * major + ((at + m * slope) >> FIXED) * minor
    return number


@kernel
def walked_cost(patch, pitch, inverse, begin, end):
    """Return the highest cost on the edge from the cell `begin` to the cell `end`, the last cell excepted; `inverse`: of
    `pitch`.
    """
    v, end_v = np.int64((begin + 0.5) * inverse), np.int64((end + 0.5) * inverse)
    dv = end_v - v
    du = end - begin - dv * pitch
    long_u, long_v = abs(du), abs(dv)
    along_u = long_u >= long_v
    steps = long_u if along_u else long_v
    step_u, step_v = 1 if du > 0 else -1, pitch if dv > 0 else -pitch
    major, minor = (step_u, step_v) if along_u else (step_v, step_u)
    scale = (1 << FIXED) / max(steps, 1)
    slope, at = np.int64((long_v if along_u else long_u) * scale) + 1, np.int64((steps // 2) * scale) + 1
    highest = np.uint8(0)
    for _ in range(np.uint64(max(steps, 1))):
        highest = max(highest, patch[np.uint64(begin + (at >> FIXED) * minor)])
        begin += major
        at += slope
    return highest


@kernel
def walk_edges(patch, pitch, begins, ends, costs):
    """As `raise_to_edges`, without tables."""
    inverse = 1.0 / pitch
    for i in range(np.uint64(len(costs))):
        costs[i] = max(costs[i], walked_cost(patch, pitch, inverse, np.int64(begins[i]), np.int64(ends[i])))


@kernel
def new_table(pitch, difference, boxes, tables, start, edges, at):
    """Append an empty table for edges with a difference of (u, v) cells to `tables`, from `start` on, and describe it in `edges`.

    `boxes`: see `raise_to_edges`. Writes the lowest u, the number of offsets, the start of the table for the cell 0, and the
    offsets to
    `edges`, from `at` on. Returns the end of the table; 0 if there is no space.
    """
    du, dv = difference
    low_u, high_u = max(boxes[0, 0], boxes[1, 0] - du), min(boxes[0, 2], boxes[1, 2] - du)
    low_v, high_v = max(boxes[0, 1], boxes[1, 1] - dv), min(boxes[0, 3], boxes[1, 3] - dv)
    row = (high_u - low_u) // BLOCK * BLOCK + BLOCK
    end = start + (high_v - low_v) * pitch + row + BLOCK
    if at + HEADER + max(abs(du), abs(dv)) + 4 > len(edges) or end > len(tables):
        return 0
    edges[at] = low_u
    edges[at + 1] = edge_offsets(du, dv, pitch, edges, at + HEADER)
    edges[at + 2] = start - low_v * pitch - low_u
    for v in range(high_v - low_v + 1):
        base = np.uint64(start + v * pitch)
        for i in range(np.uint64(row)):
            tables[base + i] = MISSING
    return end


@kernel
def raise_to_edges(patch, pitch, begins, ends, boxes, tables, slots, edges, costs):
    """Raise each of `costs` (N,) to the highest cost on the edge from the cell `begins[i]` to the cell `ends[i]`.

    `patch`: no cost is MISSING. `boxes` (2, 4): lowest u and v, highest u and v of both. `tables`, `slots` (int32), `edges`
    (int32): scratch. Blocks of a table are computed when they are needed. Where they do not fit, or take longer, edges are
    walked.
    """
    lowest = (boxes[1, 1] - boxes[0, 3]) * pitch + boxes[1, 0] - boxes[0, 2]
    differences = (boxes[1, 3] - boxes[0, 1]) * pitch + boxes[1, 2] - boxes[0, 0] - lowest + 1
    end_of_tables, end_of_edges, blocks = (boxes[0, 3] + 1) * pitch, 1, len(costs) // 2
    if 2 * differences > len(slots) or end_of_tables > len(tables):
        walk_edges(patch, pitch, begins, ends, costs)
        return
    # slots: start of the table per difference, then where its edge is described. Without a table: an empty one, and 0
    for i in range(np.uint64(2 * differences)):
        slots[i] = 0
    for i in range(np.uint64(end_of_tables)):
        tables[i] = MISSING
    inverse = 1.0 / pitch
    for n in range(np.uint64(len(costs))):
        begin, end = np.int64(begins[n]), np.int64(ends[n])
        slot = np.uint64(end - begin - lowest)
        cost = tables[np.uint64(slots[slot] + begin)]
        if cost == MISSING:
            v = np.int64((begin + 0.5) * inverse)
            u = begin - v * pitch
            at = np.int64(slots[slot + np.uint64(differences)])
            blocks -= 1
            if at == 0 and blocks >= 0:
                end_v = np.int64((end + 0.5) * inverse)
                difference = end - end_v * pitch - u, end_v - v
                added = new_table(pitch, difference, boxes, tables, end_of_tables, edges, end_of_edges)
                if added > 0:
                    at, end_of_tables = end_of_edges, added
                    end_of_edges += HEADER + edges[at + 1]
                    slots[slot], slots[slot + np.uint64(differences)] = edges[at + 2], at
            if at == 0 or blocks < 0:
                cost = walked_cost(patch, pitch, inverse, begin, end)
            else:
                first = begin + max(np.int64(edges[at]), u - BLOCK // 2) - u
                to = np.uint64(first + edges[at + 2])
                for i in range(np.uint64(BLOCK)):
                    tables[to + i] = 0
                for m in range(at + HEADER, at + HEADER + edges[at + 1], 4):
                    a, b = np.uint64(first + edges[m]), np.uint64(first + edges[m + 1])
                    c, d = np.uint64(first + edges[m + 2]), np.uint64(first + edges[m + 3])
                    for i in range(np.uint64(BLOCK)):
                        highest = max(max(patch[a + i], patch[b + i]), max(patch[c + i], patch[d + i]))
                        tables[to + i] = max(tables[to + i], highest)
                cost = tables[np.uint64(edges[at + 2] + begin)]
        costs[n] = max(costs[n], cost)

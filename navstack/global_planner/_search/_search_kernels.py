# pyright: basic
"""Best-first search over the 8 neighbours of the cells of a costmap (astar), and the parts it shares with any-angle searches.

Cells are numbered k = iy * nx + ix. The open list is a ring of buckets of width `delta` in f. A bucket is a stack (last in,
first out) whose entries come from one pool. An entry is skipped if its cell has been expanded since. A cell that becomes
cheaper is queued again, so the order within a bucket can cost expansions, but not quality. Once the goal has a cost, cells
that cannot improve it are pruned.

The array `link` marks the cells that have a value; the caller keeps it at 0, and the settings return the window that was
written. No other cells are read: a short query on a huge map costs only what it needs.
"""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

SQRT2 = np.sqrt(2.0)
OPEN = 16  # bit of `link` in an 8-connected search
DX = np.array([1, -1, 0, 0, 1, -1, 1, -1], np.int64)
DY = np.array([0, 0, 1, -1, 1, 1, -1, -1], np.int64)
BESIDE = np.array([0, 0, 0, 0, 5, 6, 9, 10], np.int64)  # bits of the two orthogonal steps on either side of a diagonal
BELOW = 1.0 - 1e-12  # what is not cheaper by more than rounding does not count as cheaper

SETTINGS = np.dtype(
    [
        ("nx", np.int64),
        ("ny", np.int64),
        ("start", np.int64),
        ("goal", np.int64),
        ("cut_corners", np.int64),  # 0: a diagonal step needs both orthogonal neighbours free, 1: one of them
        ("max_expanded", np.int64),
        ("start_weight", np.float64),  # weight of the start cell, which may be blocked
        ("least", np.float64),  # the least weight
        ("scale", np.float64),  # factor on the distance to the goal, in the heuristic
        ("delta", np.float64),  # width of a bucket
        ("upper_bound", np.float64),  # paths that do not cost less are pruned
        ("total", np.float64),  # cost of the 8-connected path, 0 if unknown (any angle)
        ("window", np.int64, 4),  # result: x0, y0, x1, y1 of the cells that were read, half open
        ("expanded", np.int64),  # result: number of expanded cells
        ("exhausted", np.int64),  # result: 1 if the search ended because of max_expanded
    ],
    align=True,
)
"""Settings and results of a search, an array of shape (1,)."""


@kernel
def grown(pool):
    """`pool` (2, n) int64 with twice the capacity."""
    n = pool.shape[1]
    larger = np.empty((2, 2 * n), np.int64)
    for i in range(n):
        larger[0, i] = pool[0, i]
        larger[1, i] = pool[1, i]
    return larger


@kernel
def push(pool, heads, bucket, cell, used, spare):
    """Push a cell on the stack of a bucket; return the two counters of the pool, which must have a free entry."""
    if spare >= 0:
        node = spare
        spare = pool[1, node]
    else:
        node = used
        used += 1
    pool[0, node], pool[1, node] = cell, heads[bucket]
    heads[bucket] = node
    return used, spare


@kernel
def octile_distance(dx, dy):
    """Length of the shortest 8-connected path over (dx, dy) free cells."""
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy)


@kernel
def step_to(cost, weights, nx, ny, x, y, d, weight, passable, cut_corners):
    """The step in direction d from cell (x, y) of this weight: cell number (-1 if not allowed), cost, and `passable`.

    `passable` has a bit for each of the first four directions that is allowed.
    """
    ix, iy = x + DX[d], y + DY[d]
    if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
        return np.int64(-1), 0.0, passable
    n = iy * nx + ix
    w = weights[cost[n]]
    if w == np.inf:
        return np.int64(-1), 0.0, passable
    if d < 4:
        return n, 0.5 * (weight + w), passable | 1 << d
    free = passable & BESIDE[d]
    if free != BESIDE[d] and (cut_corners == 0 or free == 0):
        return np.int64(-1), 0.0, passable
    return n, 0.5 * SQRT2 * (weight + w), passable


@kernel
def search(cost, weights, heads, g, link, settings):
    """Fill `g` and `link` until `goal` has its least cost.

    `weights` (256,): cost of a unit of length in a cell, by its byte, inf where blocked. A step costs its length times the
    mean weight of its two cells. f = g + scale * distance to the goal. `heads` (n,) int64: scratch memory, one per bucket.

    `g` float64; `link` uint8, 1 + the direction by which a cell was entered, OPEN while it is queued.
    """
    s = settings[0]
    nx, ny, start, goal, cut_corners = s.nx, s.ny, s.start, s.goal, s.cut_corners
    max_expanded, start_weight, scale, delta = s.max_expanded, s.start_weight, s.scale, s.delta
    ring = heads.size
    for i in range(ring):
        heads[i] = -1
    pool = np.empty((2, 4096), np.int64)  # cell, next
    gx, gy = goal % nx, goal // nx
    x0, y0 = start % nx, start // nx
    x1, y1 = x0, y0
    level = np.int64(scale * octile_distance(x0 - gx, y0 - gy) / delta)
    used, spare = push(pool, heads, level % ring, start, 0, -1)
    waiting = 1
    g[start] = 0.0
    link[start] = np.int64(OPEN | 9)
    best = s.upper_bound
    expanded = 0
    while waiting > 0:
        node = heads[level % ring]
        if node < 0:
            level += 1
            if level * delta >= best:
                break
            continue
        k = pool[0, node]
        heads[level % ring] = pool[1, node]
        pool[1, node] = spare
        spare = node
        waiting -= 1
        if not link[k] & OPEN:
            continue
        link[k] ^= OPEN
        here = g[k]
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        if here + scale * octile_distance(x - gx, y - gy) >= best * BELOW:
            continue
        if expanded >= max_expanded:
            s.exhausted = 1
            break
        expanded += 1
        if used + 8 > pool.shape[1]:
            pool = grown(pool)
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        weight = start_weight if k == start else weights[cost[k]]
        passable = 0
        for d in range(8):
            n, step, passable = step_to(cost, weights, nx, ny, x, y, d, weight, passable, cut_corners)
            if n < 0:
                continue
            c = here + step
            known = g[n] if link[n] != 0 else np.inf
            if c >= known:
                continue
            ix, iy = x + DX[d], y + DY[d]
            f = c + scale * octile_distance(ix - gx, iy - gy)
            if f >= best * BELOW:
                continue
            g[n] = c
            link[n] = np.int64(OPEN | (d + 1))
            if n == goal:
                best = c
                continue
            used, spare = push(pool, heads, max(level, np.int64(f / delta)) % ring, n, used, spare)
            waiting += 1
    s.window[0], s.window[1] = max(0, x0 - 1), max(0, y0 - 1)  # the neighbours were read too
    s.window[2], s.window[3] = min(nx, x1 + 2), min(ny, y1 + 2)
    s.expanded = expanded


@kernel
def octile_path(link, nx, start, goal):
    """Cells (n,) from start to goal, by the `link` of an 8-connected search."""
    n = 1
    k = goal
    while k != start:
        d = (link[k] & 15) - 1
        k -= DY[d] * nx + DX[d]
        n += 1
    cells = np.empty(n, np.int64)
    k = goal
    for i in range(n - 1, -1, -1):
        cells[i] = k
        if i > 0:
            d = (link[k] & 15) - 1
            k -= DY[d] * nx + DX[d]
    return cells

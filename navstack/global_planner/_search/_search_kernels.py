# pyright: basic
"""Best-first searches over the cells of a costmap: 8-connected (astar) and any-angle (theta_star).

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
_BELOW = 1.0 - 1e-12  # what is not cheaper by more than rounding does not count as cheaper

SETTINGS = np.dtype(
    [
        ("nx", np.int64),
        ("ny", np.int64),
        ("start", np.int64),
        ("goal", np.int64),
        ("any_angle", np.int64),
        ("cut_corners", np.int64),  # 0: a diagonal step needs both orthogonal neighbours free, 1: one of them
        ("max_expanded", np.int64),
        ("start_weight", np.float64),  # weight of the start cell, which may be blocked
        ("scale", np.float64),  # factor on the distance to the goal, in the heuristic
        ("delta", np.float64),  # width of a bucket
        ("upper_bound", np.float64),  # paths that do not cost less are pruned
        ("window", np.int64, 4),  # result: x0, y0, x1, y1 of the cells that were read, half open
        ("expanded", np.int64),  # result: number of expanded cells
        ("exhausted", np.int64),  # result: 1 if the search ended because of max_expanded
    ],
    align=True,
)
"""Settings and results of a search, an array of shape (1,)."""


@kernel
def _grown(pool):
    """`pool` (2, n) int64 with twice the capacity."""
    n = pool.shape[1]
    larger = np.empty((2, 2 * n), np.int64)
    for i in range(n):
        larger[0, i] = pool[0, i]
        larger[1, i] = pool[1, i]
    return larger


@kernel
def _push(pool, heads, bucket, cell, used, spare):
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
def _distance(dx, dy, any_angle):
    """Length of the shortest path over (dx, dy) free cells: a straight line, or 8-connected steps."""
    if any_angle:
        return np.hypot(np.float64(dx), np.float64(dy))
    dx, dy = abs(dx), abs(dy)
    return max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy)


@kernel
def _step(cost, weights, nx, ny, x, y, d, weight, passable, cut_corners):
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
def line_cost(cost, weights, start_weight, start, nx, a, b, cut_corners, limit):
    """Cost of the straight line between the centres of cells a and b: per cell, the length of the line in it times its weight.

    Every cell the line touches counts (supercover). The cost is inf when one of them is blocked, when the line passes exactly
    through a corner and more than `cut_corners` of the two cells beside it are blocked, or as soon as it exceeds `limit`.
    `start_weight` is the weight of the cell `start`.
    """
    ax, ay = a % nx, a // nx
    bx, by = b % nx, b // nx
    dx, dy = abs(bx - ax), abs(by - ay)
    step_x = 1 if bx > ax else -1
    step_y = nx if by > ay else -nx
    length = np.sqrt(np.float64(dx * dx + dy * dy))
    k = a
    w = start_weight if k == start else weights[cost[k]]
    if w == np.inf:
        return np.inf
    total = 0.0
    t = 0.0
    i, j = 0, 0
    while k != b:
        # the line leaves the cell at (2i + 1) / (2 dx) or at (2j + 1) / (2 dy) of its length, whichever comes first
        ex, ey = (2 * i + 1) * dy, (2 * j + 1) * dx
        if ex < ey:
            leave = (2 * i + 1) / (2.0 * dx)
            k += step_x
            i += 1
        elif ey < ex:
            leave = (2 * j + 1) / (2.0 * dy)
            k += step_y
            j += 1
        else:
            leave = (2 * i + 1) / (2.0 * dx)
            walls = 0
            if weights[cost[k + step_x]] == np.inf and k + step_x != start:
                walls += 1
            if weights[cost[k + step_y]] == np.inf and k + step_y != start:
                walls += 1
            if walls > cut_corners:
                return np.inf
            k += step_x + step_y
            i += 1
            j += 1
        total += (leave - t) * length * w
        t = leave
        w = start_weight if k == start else weights[cost[k]]
        if w == np.inf or total > limit:
            return np.inf
    return total + (1.0 - t) * length * w


@kernel
def search(cost, weights, heads, g, link, settings):
    """Fill `g` and `link` until `goal` has its least cost.

    `weights` (256,): cost of a unit of length in a cell, by its byte, inf where blocked. A step costs its length times the
    mean weight of its two cells. f = g + scale * distance to the goal. `heads` (n,) int64: scratch memory, one per bucket.

    8-connected: `g` float64; `link` uint8, 1 + the direction by which a cell was entered, OPEN while it is queued.

    `any_angle`: a cell may also be entered in a straight line from the parent of its neighbour, if that is cheaper (Theta*);
    `g` float32; `link` int32, 1 + the number of the parent cell, negative while the cell is queued.
    """
    s = settings[0]
    nx, ny, start, goal, cut_corners = s.nx, s.ny, s.start, s.goal, s.cut_corners
    max_expanded, start_weight, scale, delta = s.max_expanded, s.start_weight, s.scale, s.delta
    any_angle = s.any_angle != 0
    ring = heads.size
    for i in range(ring):
        heads[i] = -1
    pool = np.empty((2, 4096), np.int64)  # cell, next
    gx, gy = goal % nx, goal // nx
    x0, y0 = start % nx, start // nx
    x1, y1 = x0, y0
    level = np.int64(scale * _distance(x0 - gx, y0 - gy, any_angle) / delta)
    used, spare = _push(pool, heads, level % ring, start, 0, -1)
    waiting = 1
    g[start] = 0.0
    link[start] = -(start + 1) if any_angle else np.int64(OPEN | 9)
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
        origin = k
        if any_angle:
            if link[k] >= 0:
                continue
            link[k] = -link[k]
            origin = np.int64(link[k]) - 1
        else:
            if not link[k] & OPEN:
                continue
            link[k] ^= OPEN
        here = np.float64(g[k])
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        if here + scale * _distance(x - gx, y - gy, any_angle) >= best * _BELOW:
            continue
        if expanded >= max_expanded:
            s.exhausted = 1
            break
        expanded += 1
        if used + 8 > pool.shape[1]:
            pool = _grown(pool)
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        weight = start_weight if k == start else weights[cost[k]]
        passable = 0
        for d in range(8):
            n, step, passable = _step(cost, weights, nx, ny, x, y, d, weight, passable, cut_corners)
            if n < 0:
                continue
            c = here + step
            known = np.float64(g[n]) if link[n] != 0 else np.inf
            via = k
            ix, iy = x + DX[d], y + DY[d]
            if any_angle:
                if origin != k:
                    # the least weight is at least `scale`, so no line is cheaper than this bound
                    base = np.float64(g[origin])
                    bound = base + scale * _distance(ix - origin % nx, iy - origin // nx, True)
                    if bound < min(c, known):
                        limit = min(c, known) - base
                        line = base + line_cost(cost, weights, start_weight, start, nx, origin, n, cut_corners, limit)
                        if line < c:
                            c = line
                            via = origin
                c = np.float64(np.float32(c))
            if c >= known:
                continue
            f = c + scale * _distance(ix - gx, iy - gy, any_angle)
            if f >= best * _BELOW:
                continue
            g[n] = c
            link[n] = -(via + 1) if any_angle else np.int64(OPEN | (d + 1))
            if n == goal:
                best = c
                continue
            used, spare = _push(pool, heads, max(level, np.int64(f / delta)) % ring, n, used, spare)
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


@kernel
def pull_tight(cost, weights, start_weight, start, nx, cells, cut_corners):
    """Remove the corners of a path (n,) of cells between which a straight line is not more expensive.

    Lines between successive cells must be legal. Each stretch is replaced by the longest line that is allowed. Returns the
    remaining cells and the cost of the path.
    """
    n = cells.size
    sums = np.zeros(n)
    for i in range(1, n):
        sums[i] = sums[i - 1] + line_cost(
            cost, weights, start_weight, start, nx, cells[i - 1], cells[i], cut_corners, np.inf
        )
    kept = np.empty(n, np.int64)
    kept[0] = cells[0]
    m = 1
    anchor = 0
    total = 0.0
    while anchor < n - 1:
        following = anchor + 1
        piece = sums[following] - sums[anchor]
        misses = 0
        for i in range(anchor + 2, n):
            if misses > 64:  # a longer line may still be cheaper, but trying all takes quadratic time
                break
            along = (sums[i] - sums[anchor]) * (1.0 + 1e-12)
            c = line_cost(cost, weights, start_weight, start, nx, cells[anchor], cells[i], cut_corners, along)
            if c <= along:
                following = i
                piece = c
                misses = 0
            else:
                misses += 1
        total += piece
        anchor = following
        kept[m] = cells[anchor]
        m += 1
    return kept[:m], total

# pyright: basic
"""Best-first searches over a costmap's cells: astar's 8-connected one and theta_star's any-angle one.

Cells are numbered k = iy * nx + ix. The open list is a ring of buckets of width `delta` in f, stacks within (last in, first
out), whose entries come from one pool. An entry whose cell was expanded since is passed over; a cell that becomes cheaper
is queued again, so that the order within a bucket costs expansions at worst, never quality. Once the goal has a cost, what
cannot better it is passed over.

Which cells have a value is known from one array (`state`, `parent`), which the caller keeps at 0; `record` tells where it was
written. Nothing else is touched: a short query on a huge map costs what it needs.
"""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

SQRT2 = np.sqrt(2.0)
OPEN = np.uint8(16)
DX = np.array([1, -1, 0, 0, 1, -1, 1, -1], np.int64)
DY = np.array([0, 0, 1, -1, 1, 1, -1, -1], np.int64)
NEEDS = np.array([0, 0, 0, 0, 5, 6, 9, 10], np.int64)  # which of the first four a diagonal passes between
_SAME = 1.0 - 1e-12

# a record (int64): the rectangle x0, y0, x1, y1 of the cells that were written to, and 1 when the search gave up
GAVE_UP = 4
RECORD_SIZE = 5


@kernel
def _grown(pool):
    """`pool` (2, n) int64 with room for twice as much."""
    n = pool.shape[1]
    larger = np.empty((2, 2 * n), np.int64)
    for i in range(n):
        larger[0, i] = pool[0, i]
        larger[1, i] = pool[1, i]
    return larger


@kernel
def octile_search(cost, weights, own, nx, ny, start, goal, scale, delta, heads, cut, most, g, state, record):
    """Fills `g` (float64) and `state` (uint8, 1 + the step by which a cell was entered) until `goal` has its least cost.

    `weights` (256,): what a unit of length costs in a cell of that byte, inf where blocked; `own`: in the start's cell. A step
    costs its length times the mean of its two cells. f = g + scale * octile distance. `cut` 0: a diagonal needs both
    orthogonal neighbours, 1: one of them. Gives up after `most` expansions; returns how many there were.
    """
    ring = heads.size
    for i in range(ring):
        heads[i] = -1
    pool = np.empty((2, 4096), np.int64)  # cell, next
    used = 1
    spare = -1
    waiting = 1
    gx, gy = goal % nx, goal // nx
    sx, sy = start % nx, start // nx
    dx, dy = abs(sx - gx), abs(sy - gy)
    f = scale * (max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy))
    level = np.int64(f / delta)
    heads[level % ring] = 0
    pool[0, 0], pool[1, 0] = start, -1
    g[start] = 0.0
    state[start] = OPEN | np.uint8(9)
    x0, y0, x1, y1 = sx, sy, sx, sy
    best = np.inf
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
        if not state[k] & OPEN:
            continue
        state[k] ^= OPEN
        here = g[k]
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        if best < np.inf:
            dx, dy = abs(x - gx), abs(y - gy)
            if here + scale * (max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy)) >= best * _SAME:
                continue
        if expanded >= most:
            record[GAVE_UP] = 1
            break
        expanded += 1
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        mine = own if k == start else weights[cost[k]]
        passable = 0
        for d in range(8):
            ix, iy = x + DX[d], y + DY[d]
            if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
                continue
            n = iy * nx + ix
            w = weights[cost[n]]
            if w == np.inf:
                continue
            if d < 4:
                passable |= 1 << d
                c = here + 0.5 * (mine + w)
            else:
                between = passable & NEEDS[d]
                if between != NEEDS[d] and (cut == 0 or between == 0):
                    continue
                c = here + 0.5 * SQRT2 * (mine + w)
            if state[n] and c >= g[n]:
                continue
            dx, dy = abs(ix - gx), abs(iy - gy)
            f = c + scale * (max(dx, dy) + (SQRT2 - 1.0) * min(dx, dy))
            if f >= best * _SAME and best < np.inf:
                continue
            g[n] = c
            state[n] = OPEN | np.uint8(d + 1)
            if n == goal:
                best = c
                continue
            if spare >= 0:
                node = spare
                spare = pool[1, node]
            else:
                if used == pool.shape[1]:
                    pool = _grown(pool)
                node = used
                used += 1
            b = max(level, np.int64(f / delta)) % ring
            pool[0, node], pool[1, node] = n, heads[b]
            heads[b] = node
            waiting += 1
    record[0], record[1], record[2], record[3] = max(0, x0 - 1), max(0, y0 - 1), min(nx, x1 + 2), min(ny, y1 + 2)
    return expanded


@kernel
def octile_path(state, nx, start, goal):
    """Cells (n,) from start to goal by the steps in `state`."""
    n = 1
    k = goal
    while k != start:
        d = (state[k] & 15) - 1
        k -= DY[d] * nx + DX[d]
        n += 1
    cells = np.empty(n, np.int64)
    k = goal
    for i in range(n - 1, -1, -1):
        cells[i] = k
        if i > 0:
            d = (state[k] & 15) - 1
            k -= DY[d] * nx + DX[d]
    return cells


@kernel
def line_cost(cost, weights, own, start, nx, a, b, cut, limit):
    """What the straight line between the centres of cells a and b costs: in each cell its length there times the weight.

    Every cell the line touches counts (supercover): inf when one is blocked, and when it passes exactly through a corner one of
    whose two side cells is (`cut` 1: both are). Inf as soon as it exceeds `limit`. `start`'s weight is `own`.
    """
    ax, ay = a % nx, a // nx
    bx, by = b % nx, b // nx
    dx, dy = abs(bx - ax), abs(by - ay)
    step_x = 1 if bx > ax else -1
    step_y = nx if by > ay else -nx
    length = np.sqrt(np.float64(dx * dx + dy * dy))
    k = a
    w = own if k == start else weights[cost[k]]
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
            if walls > cut:
                return np.inf
            k += step_x + step_y
            i += 1
            j += 1
        total += (leave - t) * length * w
        t = leave
        w = own if k == start else weights[cost[k]]
        if w == np.inf or total > limit:
            return np.inf
    return total + (1.0 - t) * length * w


@kernel
def any_angle_search(cost, weights, own, nx, ny, start, goal, scale, delta, heads, cut, most, below, g, parent, record):
    """As octile_search, but a cell may be entered straight from its neighbour's parent when that is cheaper (Theta*).

    `g` float32; `parent` (int32): 0 = no value, otherwise 1 + the number of the cell it is entered from, negative while queued.
    f = g + scale * straight distance. What cannot cost less than `below` is passed over.
    """
    ring = heads.size
    for i in range(ring):
        heads[i] = -1
    pool = np.empty((2, 4096), np.int64)
    used = 1
    spare = -1
    waiting = 1
    gx, gy = goal % nx, goal // nx
    sx, sy = start % nx, start // nx
    f = scale * np.hypot(np.float64(sx - gx), np.float64(sy - gy))
    level = np.int64(f / delta)
    heads[level % ring] = 0
    pool[0, 0], pool[1, 0] = start, -1
    g[start] = 0.0
    parent[start] = -(start + 1)
    x0, y0, x1, y1 = sx, sy, sx, sy
    best = below
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
        if parent[k] >= 0:
            continue
        parent[k] = -parent[k]
        from_ = np.int64(parent[k]) - 1
        here = np.float64(g[k])
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        if here + scale * np.hypot(np.float64(x - gx), np.float64(y - gy)) >= best * _SAME:
            continue
        if expanded >= most:
            record[GAVE_UP] = 1
            break
        expanded += 1
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        px, py = from_ % nx, from_ // nx
        mine = own if k == start else weights[cost[k]]
        passable = 0
        for d in range(8):
            ix, iy = x + DX[d], y + DY[d]
            if ix < 0 or iy < 0 or ix >= nx or iy >= ny:
                continue
            n = iy * nx + ix
            w = weights[cost[n]]
            if w == np.inf:
                continue
            if d < 4:
                passable |= 1 << d
                c = here + 0.5 * (mine + w)
            else:
                between = passable & NEEDS[d]
                if between != NEEDS[d] and (cut == 0 or between == 0):
                    continue
                c = here + 0.5 * SQRT2 * (mine + w)
            by = k
            known = np.float64(g[n]) if parent[n] != 0 else np.inf
            if from_ != k:
                # least weight = scale at most: no line is cheaper than that
                base = np.float64(g[from_])
                reach = base + scale * np.hypot(np.float64(ix - px), np.float64(iy - py))
                if reach < min(c, known):
                    line = base + line_cost(cost, weights, own, start, nx, from_, n, cut, min(c, known) - base)
                    if line < c:
                        c = line
                        by = from_
            c = np.float64(np.float32(c))
            if c >= known:
                continue
            f = c + scale * np.hypot(np.float64(ix - gx), np.float64(iy - gy))
            if f >= best * _SAME:
                continue
            g[n] = c
            parent[n] = -(by + 1)
            if n == goal:
                best = c
                continue
            if spare >= 0:
                node = spare
                spare = pool[1, node]
            else:
                if used == pool.shape[1]:
                    pool = _grown(pool)
                node = used
                used += 1
            b = max(level, np.int64(f / delta)) % ring
            pool[0, node], pool[1, node] = n, heads[b]
            heads[b] = node
            waiting += 1
    record[0], record[1], record[2], record[3] = max(0, x0 - 1), max(0, y0 - 1), min(nx, x1 + 2), min(ny, y1 + 2)
    return expanded


@kernel
def pull_tight(cost, weights, own, start, nx, cells, cut):
    """Leaves out the corners of a path (n,) of cells between which a straight line costs no more.

    Lines between successive cells must be legal. Each stretch is replaced by the longest that holds. Returns the cells and
    what the path costs.
    """
    n = cells.size
    sums = np.zeros(n)
    for i in range(1, n):
        sums[i] = sums[i - 1] + line_cost(cost, weights, own, start, nx, cells[i - 1], cells[i], cut, np.inf)
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
            if misses > 64:  # a longer line may still hold, but looking for it would cost the square of the path
                break
            along = (sums[i] - sums[anchor]) * (1.0 + 1e-12)
            c = line_cost(cost, weights, own, start, nx, cells[anchor], cells[i], cut, along)
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

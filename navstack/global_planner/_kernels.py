# pyright: basic
"""The wavefront that fills a potential over a costmap (navfn, global_planner).

A label-correcting sweep by buckets, in navfn's order (algorithms.md 3): three lists of cells (current, next, overflow) and
a threshold that rises by a fixed step whenever current and next are both empty. Cells are numbered k = iy * nx + ix.

Per cell two float32: `pot`, the potential, HIGH where there is none; and `weight` = cost / sqrt(2), what a neighbour must
undercut to queue the cell, or inf while the cell is queued, blocked, or on the outermost ring. With that, "is it worth
queueing" is one comparison, and pushing needs no branch: the cell is stored at the end of the list and the end moves by 0 or 1.

Only an open rectangle of both arrays holds values; everything outside is whatever the memory held before. The
unreached cells of the rectangle's rim carry the potential EDGE, so that the one comparison when a cell is taken off the list
tells that the rectangle must grow first. Growing it costs what the new cells cost: a short query on a huge map touches
what it needs.
"""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel

HIGH = np.float32(1e10)
EDGE = np.float32(4e10)
BEYOND = np.float32(2e10)
INF = np.float32(np.inf)

# indices into the state array (int64)
NCURRENT, NOVER, X0, Y0, X1, Y1, EXPANDED, NPARKED = range(8)
STATE_SIZE = 8
# indices into the level array (float32)
THRESHOLD, LIMIT, LOWEST_PARKED = range(3)
LEVEL_SIZE = 3


@kernel
def open_rectangle(cost, pot, weight, weights, nx, ny, state, x0, y0, x1, y1):
    """Grows the open rectangle to hold `[x0, x1) x [y0, y1)`, clipped to the grid; an empty one (X1 = 0) is opened anew."""
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, nx), min(y1, ny)
    ox0, oy0, ox1, oy1 = state[X0], state[Y0], state[X1], state[Y1]
    if ox1 == 0:
        ox0, oy0, ox1, oy1 = x0, y0, x0, y0
    else:
        x0, y0, x1, y1 = min(x0, ox0), min(y0, oy0), max(x1, ox1), max(y1, oy1)
        for x in range(ox0, ox1):  # what was the rim
            for y in (oy0, oy1 - 1):
                if pot[y * nx + x] > BEYOND:
                    pot[y * nx + x] = HIGH
        for y in range(oy0, oy1):
            for x in (ox0, ox1 - 1):
                if pot[y * nx + x] > BEYOND:
                    pot[y * nx + x] = HIGH
    for y in range(y0, y1):
        row = y * nx
        if y < oy0 or y >= oy1:
            for k in range(row + x0, row + x1):
                pot[k] = HIGH
                weight[k] = weights[cost[k]]
        else:
            for k in range(row + x0, row + ox0):
                pot[k] = HIGH
                weight[k] = weights[cost[k]]
            for k in range(row + ox1, row + x1):
                pot[k] = HIGH
                weight[k] = weights[cost[k]]
    for x in range(x0, x1):
        for y in (y0, y1 - 1):
            k = y * nx + x
            if pot[k] == HIGH:
                pot[k] = EDGE
            if y == 0 or y == ny - 1:
                weight[k] = INF
    for y in range(y0, y1):
        for x in (x0, x1 - 1):
            k = y * nx + x
            if pot[k] == HIGH:
                pot[k] = EDGE
            if x == 0 or x == nx - 1:
                weight[k] = INF
    state[X0], state[Y0], state[X1], state[Y1] = x0, y0, x1, y1


@kernel
def _grown(cells, count, least):
    """`cells` with its first `count` entries in an array of at least `least` entries."""
    if cells.size >= least:
        return cells
    larger = np.empty(2 * least, np.uint32)
    larger[:count] = cells[:count]
    return larger


@kernel
def seed(pot, weight, state, current, cells, values, fronts):
    """Sets `cells` to `values` and queues those of `fronts` that are free, in this order. All lie in the open rectangle."""
    for i in range(cells.size):
        pot[cells[i]] = values[i]
    n = 0
    for i in range(fronts.size):
        k = fronts[i]
        if weight[k] < INF:
            weight[k] = INF
            current[n] = k
            n += 1
    state[NCURRENT] = n
    state[NOVER] = 0


@kernel
def _arrival(left, right, up, down, h, quadratic):
    """The potential at which the wave enters a cell of cost h: along one axis, or as a plane wave over two (navfn)."""
    a = min(left, right)
    b = min(up, down)
    low = min(a, b)
    difference = abs(a - b)
    if quadratic and difference < h:
        q = np.float64(difference / h)
        return low + h * np.float32((-0.2301 * q + 0.5307) * q + 0.7040)
    return low + h


@kernel
def complete(cost, pot, steps, weights, nx, ny, state, x, y, reach, quadratic):
    """Gives the free cells up to `reach` around (x, y) that have no potential one from their neighbours (clearEndpoint)."""
    x0, x1 = max(1, state[X0] + 1, x - reach), min(nx - 1, state[X1] - 1, x + reach + 1)
    y0, y1 = max(1, state[Y0] + 1, y - reach), min(ny - 1, state[Y1] - 1, y + reach + 1)
    for cy in range(y0, y1):
        for cx in range(x0, x1):
            k = cy * nx + cx
            if pot[k] >= HIGH and weights[cost[k]] < INF:
                p = _arrival(pot[k - 1], pot[k + 1], pot[k - nx], pot[k + nx], steps[cost[k]], quadratic)
                if p < HIGH:
                    pot[k] = p


@kernel
def wave(
    cost,
    pot,
    weight,
    steps,
    weights,
    nx,
    ny,
    current,
    following,
    over,
    parked,
    state,
    level,
    rise,
    quadratic,
    stop,
    ahead,
    widen,
):
    """Runs the wavefront until its lists are empty or cell `stop` has a potential; it can be taken up again where it stopped.

    `cost` (ny*nx,) uint8; `steps` (256,) float32: the cost of entering a cell by its byte; `weights` (256,) float32: that
    over sqrt(2), inf where blocked. `level`: the threshold, raised by `rise`. `stop` < 0: no stop.

    `ahead` > 0: A*. A cell whose potential plus `ahead` per cell of Euclidean distance to `stop` exceeds the limit in
    `level` is parked; when nothing else is left the limit is raised by the factor `widen` and the parked cells go on. The
    order within the limit is Dijkstra's: in A*'s own order the front is a finger one cell wide, along which the quadratic
    update sees one neighbour only and overestimates.

    Returns the four lists, larger ones where they had to grow.
    """
    ncur = state[NCURRENT]
    nover = state[NOVER]
    nparked = state[NPARKED]
    expanded = state[EXPANDED]
    threshold = level[THRESHOLD]
    limit = level[LIMIT]
    lowest_parked = level[LOWEST_PARKED]
    one = np.uint64(1)
    stride = np.uint64(nx)
    astar = stop >= 0 and ahead > 0.0
    sx = stop % nx
    sy = stop // nx
    while ncur > 0:
        following = _grown(following, 0, 4 * ncur)
        over = _grown(over, nover, nover + 4 * ncur)
        if astar:
            parked = _grown(parked, nparked, nparked + ncur)
        for i in range(ncur):
            k = np.uint64(current[i])
            weight[k] = weights[cost[k]]
        nnext = 0
        for i in range(ncur):
            k = np.uint64(current[i])
            old = pot[k]
            if old > BEYOND:
                x, y = int(k) % nx, int(k) // nx
                reach = max(64, (state[X1] - state[X0] + state[Y1] - state[Y0]) // 4)
                gx0 = x - reach if x == state[X0] else state[X0]
                gx1 = x + 1 + reach if x + 1 == state[X1] else state[X1]
                gy0 = y - reach if y == state[Y0] else state[Y0]
                gy1 = y + 1 + reach if y + 1 == state[Y1] else state[Y1]
                open_rectangle(cost, pot, weight, weights, nx, ny, state, gx0, gy0, gx1, gy1)
                old = HIGH
            left, right = pot[k - one], pot[k + one]
            up, down = pot[k - stride], pot[k + stride]
            h = steps[cost[k]]
            p = _arrival(left, right, up, down, h, quadratic)
            if p < old:
                if astar:
                    dx = np.float32(int(k) % nx - sx)
                    dy = np.float32(int(k) // nx - sy)
                    if p + ahead * np.sqrt(dx * dx + dy * dy) > limit:
                        parked[nparked] = k
                        nparked += 1
                        weight[k] = INF
                        lowest_parked = min(lowest_parked, p)
                        continue
                expanded += 1
                pot[k] = p
                wl, wr = weight[k - one], weight[k + one]
                wu, wd = weight[k - stride], weight[k + stride]
                if p < threshold:
                    c = left > p + wl
                    following[nnext] = k - one
                    weight[k - one] = INF if c else wl
                    nnext += c
                    c = right > p + wr
                    following[nnext] = k + one
                    weight[k + one] = INF if c else wr
                    nnext += c
                    c = up > p + wu
                    following[nnext] = k - stride
                    weight[k - stride] = INF if c else wu
                    nnext += c
                    c = down > p + wd
                    following[nnext] = k + stride
                    weight[k + stride] = INF if c else wd
                    nnext += c
                else:
                    c = left > p + wl
                    over[nover] = k - one
                    weight[k - one] = INF if c else wl
                    nover += c
                    c = right > p + wr
                    over[nover] = k + one
                    weight[k + one] = INF if c else wr
                    nover += c
                    c = up > p + wu
                    over[nover] = k - stride
                    weight[k - stride] = INF if c else wu
                    nover += c
                    c = down > p + wd
                    over[nover] = k + stride
                    weight[k + stride] = INF if c else wd
                    nover += c
        current, following = following, current
        ncur = nnext
        if ncur == 0:
            threshold += rise
            current, over = over, current
            ncur = nover
            nover = 0
        if stop >= 0 and pot[stop] < HIGH and (not astar or threshold > pot[stop]):
            break
        if ncur == 0 and nparked > 0:
            current, parked = parked, current
            ncur = nparked
            nparked = 0
            limit *= widen
            threshold = lowest_parked + rise
            lowest_parked = HIGH
    state[NCURRENT] = ncur
    state[NOVER] = nover
    state[NPARKED] = nparked
    state[EXPANDED] = expanded
    level[THRESHOLD] = threshold
    level[LIMIT] = limit
    level[LOWEST_PARKED] = lowest_parked
    return current, following, over, parked

# pyright: basic
"""The wavefront that fills a potential over a costmap (navfn, global_planner).

A label-correcting sweep by buckets, in navfn's order (algorithms.md 3): three lists of cells (current, next, overflow) and
a threshold that rises by a fixed step whenever current and next are both empty. Cells are numbered k = iy * nx + ix.

Per cell two float32: `pot`, the potential, HIGH where there is none; and `weight` = cost / sqrt(2), what a neighbour must
undercut to queue the cell, or inf while the cell is queued, blocked, or on the outermost ring. With that, "is it worth
queueing" is one comparison. A weight is written only when that changes it: writing it back in any case saves the branch, but
then the next cell waits for the store, and it is slower by a third.

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
NCURRENT, NOVER, X0, Y0, X1, Y1, EXPANDED, MOST = range(8)
STATE_SIZE = 8


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
    for i in range(count):  # a slice would take the compiler a second
        larger[i] = cells[i]
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
    """The potential at which the wave enters a cell of cost h: along one axis, or as a plane wave over two (navfn).

    To the bit what C++ computes: a last digit can decide whether a neighbour is queued, and then the potentials behind it
    differ by far more.
    """
    a = left if left < right else right
    b = up if up < down else down
    if a < b:
        low = a
        d = b - a
    else:
        low = b
        d = a - b
    if quadratic and d < h:
        q = np.float64(d / h)
        return low + h * np.float32(-0.2301 * (q * q) + (0.5307 * q + 0.7040))
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
    state,
    level,
    last,
    stop,
    guide,
    shift,
    limit,
    how,
):
    """Runs the wavefront; it can be taken up again where it stopped.

    `cost` (ny*nx,) uint8; `steps` (256,) float32: the cost of entering a cell by its byte; `weights` (256,) float32: that
    over sqrt(2), inf where blocked. `level` (2,) float32: the threshold and
    its rise. `how` 1: quadratic. It ends when the lists are empty, when the threshold exceeds `last`, after the
    round in which `state[MOST]` cells have been lowered, or, unless `stop` < 0, when
    cell `stop` has a potential.

    `guide`, unless of size 0: potentials from the other end, one per square of 2**shift cells with a ring around, and cells
    where both together exceed `limit` are left out (their own cost, which both count, once).

    Returns the three lists, larger ones where they had to grow.
    """
    ncur = state[NCURRENT]
    nover = np.uint64(state[NOVER])
    expanded = state[EXPANDED]
    most = state[MOST]
    threshold = level[0]
    rise = level[1]
    zero = np.uint64(0)
    one = np.uint64(1)
    stride = np.uint64(nx)
    quadratic = how == 1
    guided = guide.size > 0
    coarse = shift > 0
    gnx = ((nx - 1) >> shift) + 3
    while ncur > 0 and threshold <= last and expanded < most:
        following = _grown(following, zero, np.int64(4 * ncur))
        over = _grown(over, nover, np.int64(nover) + np.int64(4 * ncur))
        for i in range(ncur):
            k = np.uint64(current[i])
            weight[k] = weights[cost[k]]
        nnext = zero
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
                if guided:
                    if coarse:
                        rest = guide[(((int(k) // nx) >> shift) + 1) * gnx + ((int(k) % nx) >> shift) + 1]
                    else:
                        rest = guide[k]
                    if p + rest - h > limit:
                        continue
                expanded += 1
                pot[k] = p
                wl, wr = weight[k - one], weight[k + one]
                wu, wd = weight[k - stride], weight[k + stride]
                near = p < threshold
                if left > p + wl:
                    weight[k - one] = INF
                    if near:
                        following[nnext] = k - one
                        nnext += one
                    else:
                        over[nover] = k - one
                        nover += one
                if right > p + wr:
                    weight[k + one] = INF
                    if near:
                        following[nnext] = k + one
                        nnext += one
                    else:
                        over[nover] = k + one
                        nover += one
                if up > p + wu:
                    weight[k - stride] = INF
                    if near:
                        following[nnext] = k - stride
                        nnext += one
                    else:
                        over[nover] = k - stride
                        nover += one
                if down > p + wd:
                    weight[k + stride] = INF
                    if near:
                        following[nnext] = k + stride
                        nnext += one
                    else:
                        over[nover] = k + stride
                        nover += one
        current, following = following, current
        ncur = np.int64(nnext)
        if ncur == 0:
            threshold += rise
            current, over = over, current
            ncur = np.int64(nover)
            nover = zero
        if stop >= 0 and pot[stop] < HIGH:
            break
    state[NCURRENT] = ncur
    state[NOVER] = np.int64(nover)
    state[EXPANDED] = expanded
    level[0] = threshold
    return current, following, over


@kernel
def coarsen(cost, steps, weights, nx, ny, shift, out):
    """The least whole cost of a free cell in every square of 2**shift cells into `out` uint8 (with a ring); 0 = none is free."""
    gnx = ((nx - 1) >> shift) + 3
    for i in range(out.size):
        out[i] = 0
    least = np.empty(256, np.uint8)  # by byte: its cost less one, 255 where blocked
    for b in range(256):
        least[b] = np.uint8(steps[b]) - 1 if weights[b] < INF else 255
    for y in range(ny):
        row = ((y >> shift) + 1) * gnx + 1
        for x in range(nx):
            v = least[cost[y * nx + x]]
            i = row + (x >> shift)
            if np.uint8(out[i] - 1) > v:  # 0 - 1 = 255: nothing yet
                out[i] = v + 1

# pyright: basic
"""The wavefront that fills a potential over a costmap (navfn, global_planner).

A label-correcting sweep by buckets, in navfn's order (algorithms.md 3): three lists of cells (current, next, overflow) and
a threshold that rises by a fixed step whenever current and next are both empty. Cells are numbered k = iy * nx + ix.

Five bytes a cell: `pot`, the potential (float32), HIGH where there is none; and `pending` (uint8), 1 while the cell waits in a
list, and for good on the outermost ring, which is blocked.

Of a list, all cells are first taken in their order and given their potential, and what each would queue is noted in four
bits; then the notes become lists. The outcome is that of doing one cell after the other, to the bit: what a cell queues
depends on potentials alone, and whether it is queued already on those before it alone. But no load waits for
a store just made, nothing is guessed by a branch, and a cell takes two thirds of the time.

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
WAITS = np.uint8(1)
FAR = np.uint32(1 << 31)  # in a noted cell: it is for the overflow list
MOST_CELLS = 1 << 31

# indices into the state array (int64)
NCURRENT, NOVER, X0, Y0, X1, Y1, EXPANDED, MOST = range(8)
STATE_SIZE = 8


@kernel
def _clear(pot, pending, first, end):
    """Cells `first` to `end` (uint64, so that the compiler need not fear negative ones) have no potential and do not wait."""
    for k in range(first, end):
        pot[k] = HIGH
    for k in range(first, end):
        pending[k] = 0


@kernel
def open_rectangle(pot, pending, nx, ny, state, x0, y0, x1, y1):
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
            _clear(pot, pending, np.uint64(row + x0), np.uint64(row + x1))
        else:
            _clear(pot, pending, np.uint64(row + x0), np.uint64(row + ox0))
            _clear(pot, pending, np.uint64(row + ox1), np.uint64(row + x1))
    for x in range(x0, x1):
        for y in (y0, y1 - 1):
            k = y * nx + x
            if pot[k] == HIGH:
                pot[k] = EDGE
            if y == 0 or y == ny - 1:
                pending[k] = WAITS
    for y in range(y0, y1):
        for x in (x0, x1 - 1):
            k = y * nx + x
            if pot[k] == HIGH:
                pot[k] = EDGE
            if x == 0 or x == nx - 1:
                pending[k] = WAITS
    state[X0], state[Y0], state[X1], state[Y1] = x0, y0, x1, y1


@kernel
def _grow_at(pot, pending, nx, ny, state, k):
    """Grows the open rectangle on the side where cell k lies on its rim."""
    x, y = k % nx, k // nx
    x0, y0, x1, y1 = state[X0], state[Y0], state[X1], state[Y1]
    reach = max(64, (x1 - x0 + y1 - y0) // 4)
    open_rectangle(
        pot,
        pending,
        nx,
        ny,
        state,
        x - reach if x == x0 else x0,
        y - reach if y == y0 else y0,
        x + 1 + reach if x + 1 == x1 else x1,
        y + 1 + reach if y + 1 == y1 else y1,
    )


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
def seed(cost, pot, pending, weights, state, current, cells, values, fronts):
    """Sets `cells` to `values` and queues those of `fronts` that are free, in this order. All lie in the open rectangle."""
    for i in range(cells.size):
        pot[cells[i]] = values[i]
    n = 0
    for i in range(fronts.size):
        k = fronts[i]
        if weights[cost[k]] < INF and not pending[k]:
            pending[k] = WAITS
            current[n] = k
            n += 1
    state[NCURRENT] = n
    state[NOVER] = 0


@kernel
def _arrival(left, right, up, down, h, per_h, plane):
    """The potential at which the wave enters a cell of cost h: along one axis, or as a plane wave over two (navfn).

    To the bit what C++ computes: a last digit can decide whether a neighbour is queued, and then the potentials behind it
    differ by far more. `plane`: the difference below which it is a plane wave, h, or 0 for never. `per_h` = 1 / h in
    float64: the product, rounded to float32, is the quotient of the two float32 correctly rounded (one is never nearer
    than 2**-49 of itself to where rounding turns; the product is off by 2**-52).
    """
    a = left if left < right else right
    b = up if up < down else down
    low = a if a < b else b
    d = np.float32(abs(a - b))
    q = np.float64(np.float32(np.float64(d) * per_h))
    part = np.float32(-0.2301 * (q * q) + (0.5307 * q + 0.7040))
    return low + h * (part if d < plane else np.float32(1.0))


@kernel
def complete(cost, pot, steps, weights, nx, ny, state, x, y, reach, quadratic):
    """Gives the free cells up to `reach` around (x, y) that have no potential one from their neighbours (clearEndpoint)."""
    x0, x1 = max(1, state[X0] + 1, x - reach), min(nx - 1, state[X1] - 1, x + reach + 1)
    y0, y1 = max(1, state[Y0] + 1, y - reach), min(ny - 1, state[Y1] - 1, y + reach + 1)
    for cy in range(y0, y1):
        for cx in range(x0, x1):
            k = cy * nx + cx
            if pot[k] >= HIGH and weights[cost[k]] < INF:
                h = steps[cost[k]]
                per_h = 1.0 / np.float64(h)
                p = _arrival(
                    pot[k - 1], pot[k + 1], pot[k - nx], pot[k + nx], h, per_h, h if quadratic else np.float32(0.0)
                )
                if p < HIGH:
                    pot[k] = p


@kernel
def wave(
    cost,
    pot,
    pending,
    steps,
    weights,
    nx,
    ny,
    current,
    following,
    over,
    notes,
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
    over sqrt(2), what a neighbour must undercut to queue the cell, inf where blocked. `level` (2,) float32: the threshold and
    its rise. `how` 1: quadratic. It ends when the lists are empty, when the threshold exceeds `last`, after the
    round in which `state[MOST]` cells have been lowered, or, unless `stop` < 0, when
    cell `stop` has a potential.

    `guide`, unless of size 0: potentials from the other end, one per square of 2**shift cells with a ring around, and cells
    where both together exceed `limit` are left out (their own cost, which both count, once).

    Returns the three lists and the notes (uint8), larger ones where they had to grow.
    """
    ncur = state[NCURRENT]
    nover = np.uint64(state[NOVER])
    expanded = state[EXPANDED]
    most = state[MOST]
    threshold = level[0]
    rise = level[1]
    zero = np.uint64(0)
    one = np.uint64(1)
    two = np.uint64(2)
    three = np.uint64(3)
    stride = np.uint64(nx)
    guided = guide.size > 0
    coarse = shift > 0
    shifts = np.uint64(shift)
    guide_stride = np.uint64(((nx - 1) >> shift) + 3)
    per_step = np.empty(256, np.float64)
    planes = np.empty(256, np.float32)
    for b in range(256):
        per_step[b] = 1.0 / np.float64(steps[b])
        planes[b] = steps[b] if how == 1 else 0.0
    # by note: which neighbours it names, left, right, up, down, and how many; bit 4 set: below the threshold
    offsets = np.zeros((64, 4), np.uint32)
    counts = np.zeros(64, np.uint8)
    for noted in range(64):
        n = 0
        for b in range(4):
            if noted >> b & 1:
                to = -1 if b == 0 else 1 if b == 1 else -nx if b == 2 else nx
                offsets[noted, n] = np.uint32(to) + (zero if noted & 16 else np.uint64(FAR))
                n += 1
        counts[noted] = n
    while ncur > 0 and threshold <= last and expanded < most:
        length = np.uint64(ncur)
        following = _grown(following, 0, 4 * ncur + 4)
        if notes.size < ncur:
            notes = np.empty(2 * ncur, np.uint8)
        lowered = zero
        first = zero
        while first < length:
            beyond = length
            for i in range(first, length):
                k = np.uint64(current[i])
                byte = cost[k]
                pending[k] = 0
                old = pot[k]
                if old > BEYOND:
                    beyond = i
                    break
                left, right = pot[k - one], pot[k + one]
                up, down = pot[k - stride], pot[k + stride]
                h = steps[byte]
                p = _arrival(left, right, up, down, h, per_step[byte], planes[byte])
                if guided:
                    if coarse:
                        y = np.uint32(k) // np.uint32(nx)
                        x = np.uint32(k) - y * np.uint32(nx)
                        rest = guide[((np.uint64(y) >> shifts) + one) * guide_stride + (np.uint64(x) >> shifts) + one]
                    else:
                        rest = guide[k]
                    p = INF if p + rest - h > limit else p
                pot[k] = p if p < old else old
                e = p if p < old else INF
                notes[i] = (
                    np.uint8(left > e + weights[cost[k - one]])
                    | (np.uint8(right > e + weights[cost[k + one]]) << 1)
                    | (np.uint8(up > e + weights[cost[k - stride]]) << 2)
                    | (np.uint8(down > e + weights[cost[k + stride]]) << 3)
                    | (np.uint8(p < threshold) << 4)
                    | (np.uint8(e < INF) << 5)
                )
            if beyond < length:
                _grow_at(pot, pending, nx, ny, state, np.int64(current[beyond]))
            first = beyond
        named = zero
        for i in range(length):
            note = notes[i]
            k = current[i]
            lowered += np.uint64(note >> 5)
            # four are written, the next ones over those that are too many
            n0, n1 = np.uint32(k + offsets[note, 0]), np.uint32(k + offsets[note, 1])
            n2, n3 = np.uint32(k + offsets[note, 2]), np.uint32(k + offsets[note, 3])
            following[named] = n0
            following[named + one] = n1
            following[named + two] = n2
            following[named + three] = n3
            named += np.uint64(counts[note])
        expanded += np.int64(lowered)
        over = _grown(over, nover, np.int64(nover + named) + 1)
        nnext = zero
        for i in range(named):
            name = following[i]
            k = np.uint64(name & ~FAR)
            new = np.uint64(pending[k] ^ WAITS)
            pending[k] = WAITS
            if name >= FAR:
                over[nover] = k
                nover += new
            else:
                following[nnext] = k
                nnext += new
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
    return current, following, over, notes


@kernel
def _least_of_row(cost, least, first, count, out, to):
    """Lowers `out[to:]` to the least of every four of the `count` cells from `first` on (uint64, all)."""
    four = np.uint64(4)
    whole = count // four
    for i in range(whole):
        k = first + four * i
        a, b = least[cost[k]], least[cost[k + np.uint64(1)]]
        c, d = least[cost[k + np.uint64(2)]], least[cost[k + np.uint64(3)]]
        a = a if a < b else b
        c = c if c < d else d
        a = a if a < c else c
        b = out[to + i]
        out[to + i] = a if a < b else b
    for k in range(first + four * whole, first + count):
        a, b = least[cost[k]], out[to + whole]
        out[to + whole] = a if a < b else b


@kernel
def coarsen(cost, steps, weights, nx, ny, out):
    """The least whole cost of a free cell in every square of 4 x 4 cells into `out` uint8 (with a ring); 0 = none is free."""
    gnx = ((nx - 1) >> 2) + 3
    for i in range(np.uint64(out.size)):
        out[i] = 255
    least = np.empty(256, np.uint8)  # by byte: its cost less one, 255 where blocked
    for b in range(256):
        least[b] = np.uint8(steps[b]) - 1 if weights[b] < INF else 255
    for y in range(ny):
        _least_of_row(cost, least, np.uint64(y * nx), np.uint64(nx), out, np.uint64(((y >> 2) + 1) * gnx + 1))
    for i in range(np.uint64(out.size)):
        out[i] = np.uint8(out[i] + 1)  # 255 + 1 = 0

"""A wavefront potential over a costmap, and its arrays, which are reused from plan to plan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, InputError, Window, kernel
from navstack.global_planner._search.cells import Cell, WaveCosts, start_fronts

# ----------------------------------------------------------------------------------------------------------------------
# The wavefront that fills a potential over a costmap (navfn, global_planner).
#
# A label-correcting propagation by buckets, in navfn's order (algorithms.md 3): three lists of cells (current, next, overflow)
# and a threshold that rises by a fixed step whenever current and next are both empty. Cells are numbered k = iy * nx + ix.
#
# Memory per cell is 5 bytes: `pot`, the potential (float32, HIGH where unreached), and `pending` (uint8), which is 1 while the
# cell is in a list, and always on the outermost ring, which is blocked.
#
# A list is processed in two passes. The first updates the potential of each cell in order and stores in `flags` which
# neighbors to queue; the second turns the flags into lists. The result equals that of processing one cell after the other,
# to the bit: which neighbors a cell queues depends on potentials only, and whether a neighbor is queued already depends only
# on the cells before it. Two passes need two thirds of the time, because no load waits for a preceding store and no
# branch is unpredictable.
#
# Only an open window of both arrays holds values; the memory outside is undefined. Unreached cells on the border of the window
# have the potential EDGE, so one comparison per processed cell detects that the window must grow first. A short query on a
# huge map therefore touches only the cells it needs.


# pyright: basic


HIGH = np.float32(1e10)
EDGE = np.float32(4e10)
BEYOND = np.float32(2e10)
INF = np.float32(np.inf)
PENDING = np.uint8(1)
OVERFLOW = np.uint32(1 << 31)  # bit of a collected cell: it goes to the overflow list
MAX_CELLS = 1 << 31

STATE = np.dtype(
    [
        ("nx", np.int64),
        ("ny", np.int64),
        ("window", np.int64, 4),  # the open window x0, y0, x1, y1, half open
        ("lists", np.int64, 3),  # the rows of the lists: current, next, overflow
        ("n_current", np.int64),  # lengths of the lists
        ("n_overflow", np.int64),
        ("expanded", np.int64),  # how often a potential was lowered
        ("max_expanded", np.int64),
        ("stop", np.int64),  # cell that ends the propagation once it has a potential; -1: none
        ("guide_shift", np.int64),  # the guide has one value per square of 2**guide_shift cells
        ("quadratic", np.int64),  # 1: plane wave over two neighbors, 0: from the lowest neighbor
        ("threshold", np.float32),
        ("rise", np.float32),  # increment of the threshold
        ("last", np.float32),  # the propagation ends when the threshold exceeds it
        ("limit", np.float32),  # largest sum of potential and guide
        ("aim_x", np.int64),  # cell to which straight distances count, see `aim_cost`
        ("aim_y", np.int64),
        ("aim_cost", np.float32),  # cost of a cell of straight distance; 0: distances do not count
    ],
    align=True,
)
"""State and settings of a wavefront, an array of shape (1,)."""


@kernel
def _clear(pot, pending, first, end):
    """Reset the cells `first` to `end`, which are uint64 so that the compiler can rule out negative indices."""
    for k in range(first, end):
        pot[k] = HIGH
    for k in range(first, end):
        pending[k] = 0


@kernel
def open_window(pot, pending, state, x0, y0, x1, y1):
    """Grow the open window to contain `[x0, x1) x [y0, y1)`, clipped to the grid; open it there if it is empty (x1 = 0)."""
    s = state[0]
    nx, ny = s.nx, s.ny
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(x1, nx), min(y1, ny)
    ox0, oy0, ox1, oy1 = s.window[0], s.window[1], s.window[2], s.window[3]
    if ox1 == 0:
        ox0, oy0, ox1, oy1 = x0, y0, x0, y0
    else:
        x0, y0, x1, y1 = min(x0, ox0), min(y0, oy0), max(x1, ox1), max(y1, oy1)
        for x in range(ox0, ox1):  # the previous border
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
                pending[k] = PENDING
    for y in range(y0, y1):
        for x in (x0, x1 - 1):
            k = y * nx + x
            if pot[k] == HIGH:
                pot[k] = EDGE
            if x == 0 or x == nx - 1:
                pending[k] = PENDING
    s.window[0], s.window[1], s.window[2], s.window[3] = x0, y0, x1, y1


@kernel
def _grow_at(pot, pending, state, k):
    """Grow the open window on the side where cell k is on its border."""
    s = state[0]
    x, y = k % s.nx, k // s.nx
    x0, y0, x1, y1 = s.window[0], s.window[1], s.window[2], s.window[3]
    margin = max(64, (x1 - x0 + y1 - y0) // 4)
    open_window(
        pot,
        pending,
        state,
        x - margin if x == x0 else x0,
        y - margin if y == y0 else y0,
        x + 1 + margin if x + 1 == x1 else x1,
        y + 1 + margin if y + 1 == y1 else y1,
    )


@kernel
def seed(cost, pot, pending, weights, state, current, cells, values, fronts):
    """Set the potential of `cells` to `values` and queue the free cells of `fronts`, in order. All are in the open window."""
    for i in range(cells.size):
        pot[cells[i]] = values[i]
    n = 0
    for i in range(fronts.size):
        k = fronts[i]
        if weights[cost[k]] < INF and not pending[k]:
            pending[k] = PENDING
            current[n] = k
            n += 1
    s = state[0]
    s.n_current = n
    s.n_overflow = 0


@kernel
def _arrival(left, right, up, down, h, per_h, plane):
    """The potential at which the wave enters a cell of cost h: along one axis, or as a plane wave over two (navfn).

    Equal to C++ to the bit: the last digit can decide whether a neighbor is queued, and then the potentials behind it
    differ by far more. `plane`: the difference below which it is a plane wave: h, or 0 for never. `per_h` = 1 / h in
    float64: the product, rounded to float32, is the correctly rounded quotient of the two float32 (a quotient is never
    closer than 2**-49 of itself to a rounding boundary; the product is off by 2**-52).
    """
    a = left if left < right else right
    b = up if up < down else down
    low = a if a < b else b
    d = np.float32(abs(a - b))
    q = np.float64(np.float32(np.float64(d) * per_h))
    part = np.float32(-0.2301 * (q * q) + (0.5307 * q + 0.7040))
    return low + h * (part if d < plane else np.float32(1.0))


@kernel
def complete(cost, pot, steps, weights, state, x, y, reach):
    """Compute the potential of unreached free cells within `reach` of (x, y) from their neighbors (clearEndpoint)."""
    s = state[0]
    nx = s.nx
    x0, x1 = max(1, s.window[0] + 1, x - reach), min(nx - 1, s.window[2] - 1, x + reach + 1)
    y0, y1 = max(1, s.window[1] + 1, y - reach), min(s.ny - 1, s.window[3] - 1, y + reach + 1)
    for cy in range(y0, y1):
        for cx in range(x0, x1):
            k = cy * nx + cx
            if pot[k] >= HIGH and weights[cost[k]] < INF:
                h = steps[cost[k]]
                plane = h if s.quadratic else np.float32(0.0)
                p = _arrival(pot[k - 1], pot[k + 1], pot[k - nx], pot[k + nx], h, 1.0 / np.float64(h), plane)
                if p < HIGH:
                    pot[k] = p


@kernel
def _neighbor_table(nx):
    """By the lower 5 bits of a flag: the offsets (64, 4) of the neighbors to queue, and how many there are (64,).

    Bits 0 to 3: left, right, up, down. Bit 4: the cell is below the threshold; without it, offsets include OVERFLOW.
    """
    offsets = np.zeros((64, 4), np.uint32)
    counts = np.zeros(64, np.uint8)
    for flag in range(64):
        n = 0
        for b in range(4):
            if flag >> b & 1:
                to = -1 if b == 0 else 1 if b == 1 else -nx if b == 2 else nx
                offsets[flag, n] = np.uint32(to) + (np.uint64(0) if flag & 16 else np.uint64(OVERFLOW))
                n += 1
        counts[flag] = n
    return offsets, counts


@kernel
def propagate(cost, pot, pending, steps, weights, lists, flags, guide, state):
    """Run the wavefront, and return True; False if a row of `lists` is too short: call it again with longer ones.

    A later call resumes where it stopped.

    `lists` (3, n) uint32; `flags` (n,) uint8: scratch.
    `cost` (ny*nx,) uint8; `steps` (256,) float32: cost of entering a cell, by its byte; `weights` (256,) float32: `steps`
    over sqrt(2), the gain below which a neighbor is not queued, inf where blocked; `state` (1,): see STATE. It ends when
    the lists are empty, when the threshold exceeds `last`, after the list in which `max_expanded` potentials have been
    lowered, or when the cell `stop` has a potential.

    `guide`, unless of size 0: potentials from the target, one per square of 2**guide_shift cells with a border of one square
    (no border with shift 0). Cells where the sum of both potentials, less their own cost, which both include, exceeds
    `limit` are pruned.

    With `aim_cost` above 0, the straight distance to the cell (aim_x, aim_y) in cells times `aim_cost` is added to a potential
    before it decides which neighbors are queued, and in which list: A* of Nav2's navfn.
    """
    s = state[0]
    nx = s.nx
    n_current = s.n_current
    n_overflow = np.uint64(s.n_overflow)
    expanded = s.expanded
    max_expanded = s.max_expanded
    threshold = s.threshold
    rise = s.rise
    last = s.last
    limit = s.limit
    stop = s.stop
    aimed = s.aim_cost > np.float32(0.0)
    aim_x, aim_y, aim_cost = s.aim_x, s.aim_y, np.float64(s.aim_cost)
    zero = np.uint64(0)
    one = np.uint64(1)
    two = np.uint64(2)
    three = np.uint64(3)
    stride = np.uint64(nx)
    guided = guide.size > 0
    coarse = s.guide_shift > 0
    shift = np.uint64(s.guide_shift)
    guide_stride = np.uint64(((nx - 1) >> s.guide_shift) + 3)
    per_step = np.empty(256, np.float64)
    planes = np.empty(256, np.float32)
    for b in range(256):
        per_step[b] = 1.0 / np.float64(steps[b])
        planes[b] = steps[b] if s.quadratic else 0.0
    offsets, counts = _neighbor_table(nx)
    capacity = np.uint64(len(flags))
    at_current, at_following, at_overflow = s.lists[0], s.lists[1], s.lists[2]
    current, following, overflow = lists[at_current], lists[at_following], lists[at_overflow]
    complete = True
    while n_current > 0 and threshold <= last and expanded < max_expanded:
        length = np.uint64(n_current)
        if n_overflow + np.uint64(4) * length + np.uint64(4) > capacity:
            complete = False
            break
        first = zero
        while first < length:
            outside = length
            for i in range(first, length):
                k = np.uint64(current[i])
                byte = cost[k]
                pending[k] = 0
                old = pot[k]
                if old > BEYOND:
                    outside = i
                    break
                left, right = pot[k - one], pot[k + one]
                up, down = pot[k - stride], pot[k + stride]
                h = steps[byte]
                p = _arrival(left, right, up, down, h, per_step[byte], planes[byte])
                if guided:
                    if coarse:
                        y = np.uint32(k) // np.uint32(nx)
                        x = np.uint32(k) - y * np.uint32(nx)
                        rest = guide[((np.uint64(y) >> shift) + one) * guide_stride + (np.uint64(x) >> shift) + one]
                    else:
                        rest = guide[k]
                    p = INF if p + rest - h > limit else p
                pot[k] = p if p < old else old
                rank = p
                if aimed:
                    y = np.uint32(k) // np.uint32(nx)
                    x = np.uint32(k) - y * np.uint32(nx)
                    rank += np.float32(math.hypot(np.int64(x) - aim_x, np.int64(y) - aim_y) * aim_cost)
                e = rank if p < old else INF
                flags[i] = (
                    np.uint8(left > e + weights[cost[k - one]])
                    | (np.uint8(right > e + weights[cost[k + one]]) << 1)
                    | (np.uint8(up > e + weights[cost[k - stride]]) << 2)
                    | (np.uint8(down > e + weights[cost[k + stride]]) << 3)
                    | (np.uint8(rank < threshold) << 4)
                    | (np.uint8(e < INF) << 5)
                )
            if outside < length:
                _grow_at(pot, pending, state, np.int64(current[outside]))
            first = outside
        collected = zero
        lowered = zero
        for i in range(length):
            flag = flags[i]
            k = current[i]
            lowered += np.uint64(flag >> 5)
            # always four are written; the next cell overwrites the excess
            n0, n1 = np.uint32(k + offsets[flag, 0]), np.uint32(k + offsets[flag, 1])
            n2, n3 = np.uint32(k + offsets[flag, 2]), np.uint32(k + offsets[flag, 3])
            following[collected] = n0
            following[collected + one] = n1
            following[collected + two] = n2
            following[collected + three] = n3
            collected += np.uint64(counts[flag])
        expanded += np.int64(lowered)
        n_following = zero
        for i in range(collected):
            entry = following[i]
            k = np.uint64(entry & ~OVERFLOW)
            new = np.uint64(pending[k] ^ PENDING)
            pending[k] = PENDING
            if entry >= OVERFLOW:
                overflow[n_overflow] = k
                n_overflow += new
            else:
                following[n_following] = k
                n_following += new
        current, following = following, current
        at_current, at_following = at_following, at_current
        n_current = np.int64(n_following)
        if n_current == 0:
            threshold += rise
            current, overflow = overflow, current
            at_current, at_overflow = at_overflow, at_current
            n_current = np.int64(n_overflow)
            n_overflow = zero
        if stop >= 0 and pot[stop] < HIGH:
            break
    s.lists[0], s.lists[1], s.lists[2] = at_current, at_following, at_overflow
    s.n_current = n_current
    s.n_overflow = np.int64(n_overflow)
    s.expanded = expanded
    s.threshold = threshold
    return complete


@kernel
def _minimum_of_row(cost, least, first, count, out, to):
    """Lower `out[to:]` to the minimum over every four of the `count` cells from `first` (all uint64)."""
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
    """Write the least cost (integer) of a free cell in each square of 4 x 4 cells to `out` uint8 (bordered); 0 = none is free."""
    coarse_nx = ((nx - 1) >> 2) + 3
    for i in range(np.uint64(out.size)):
        out[i] = 255
    least = np.empty(256, np.uint8)  # by byte: its cost less one, 255 where blocked
    for b in range(256):
        least[b] = np.uint8(steps[b]) - 1 if weights[b] < INF else 255
    for y in range(ny):
        _minimum_of_row(cost, least, np.uint64(y * nx), np.uint64(nx), out, np.uint64(((y >> 2) + 1) * coarse_nx + 1))
    for i in range(np.uint64(out.size)):
        out[i] = np.uint8(out[i] + 1)  # 255 + 1 = 0


UNREACHED: Final = float(HIGH)
_MARGIN: Final = 32
_INITIAL_CAPACITY: Final = 4096
_NO_GUIDE: Final = np.empty(0, np.float32)


@kernel
def apply_changes(old, new, steps, weights, pot, pending, nx, most, queue):
    """Write the bytes of `new` (n,) into `old` (n,), and the free cells that got cheaper next to reached ones to `queue`.

    `steps` and `weights`: see `propagate`. Cells that are `pending` are left to the wave that queued them; the others become
    pending. Returns how many bytes differ, -1 for more than `most`; how many cells are in `queue` (`most`,); and the lowest
    potential next to one of them.
    """
    size = len(old)
    words = size // 8
    first, second = old[: 8 * words].view(np.uint64), new[: 8 * words].view(np.uint64)
    count, queued, lowest = 0, 0, HIGH
    # a costmap changes in few places between two plans: blocks of 32 words are compared without a branch
    for begin in range(0, size, 256):
        end = min(begin + 256, size)
        if end - begin == 256:
            difference = np.uint64(0)
            base = np.uint64(begin // 8)
            for i in range(np.uint64(32)):
                difference |= first[base + i] ^ second[base + i]
            if difference == 0:
                continue
        for k in range(begin, end):
            before, after = old[k], new[k]
            if before == after:
                continue
            count += 1
            if count > most:
                return -1, queued, lowest
            old[k] = after
            x = k % nx
            inner = x > 0 and x < nx - 1 and k >= nx and k < size - nx
            cheaper = weights[after] < INF and (weights[before] == INF or steps[after] < steps[before])
            if not inner or pending[k] or not cheaper:
                continue
            near = min(min(pot[k - 1], pot[k + 1]), min(pot[k - nx], pot[k + nx]))
            if near < HIGH:
                pending[k] = PENDING
                queue[queued] = k
                queued += 1
                lowest = min(lowest, near)
    return count, queued, lowest


class Guide(NamedTuple):
    """Potentials from the target, by which a wave is restricted to the cells that can be on a good path."""

    values: NDArray[np.float32]
    """One per square of 2**shift cells, with a border of one square; one per cell, without a border, if shift is 0."""
    shift: int
    limit: float
    """Largest sum of the potentials from both ends; cells with a larger sum are pruned."""
    order_independent: bool = False
    """Whether the wave uses `cost_interpreter.order_independent` costs."""


class Wavefront:
    """A wavefront over one costmap at a time. Cells are numbered k = iy * nx + ix.

    Two arrays, 5 bytes per cell together, are allocated once per size of costmap and accessed only where the wave goes. The
    lists of cells grow with the front. The costmap is never written to and must not change between `begin` and the last `run`.
    """

    def __init__(self) -> None:
        self.nx = 0
        self.ny = 0
        self._pot = np.empty(0, np.float32)
        self._pending = np.empty(0, np.uint8)
        self._lists = np.empty((3, _INITIAL_CAPACITY), np.uint32)
        self._flags = np.empty(_INITIAL_CAPACITY, np.uint8)
        self._state = np.zeros(1, STATE)
        # views of single fields: access to a field of a record takes longer
        fields: dict[str, NDArray[Any]] = {name: self._state[name] for name in STATE.names or ()}
        self._window = fields["window"][0]
        self._fields = fields
        self._cost = np.empty(0, np.uint8)
        self._costs: WaveCosts | None = None
        self.max_expanded = 1 << 62
        """Limit on how often a potential is lowered; takes effect at `begin`."""

    @property
    def pot(self) -> NDArray[np.float32]:
        """(ny*nx,) the potential; defined only inside `window`, >= UNREACHED where the wave did not arrive."""
        return self._pot

    @property
    def cost(self) -> NDArray[np.uint8]:
        """(ny*nx,) the bytes of the costmap."""
        return self._cost

    @property
    def costs(self) -> WaveCosts:
        """The cost interpreter of the wave; requires `begin`."""
        assert self._costs is not None, "begin() first"
        return self._costs

    @property
    def window(self) -> Window:
        """The cells whose potential is defined."""
        return Window(*self._window.tolist())

    @property
    def expanded(self) -> int:
        """How often a potential was lowered."""
        return int(self._fields["expanded"][0])

    @property
    def is_exhausted(self) -> bool:
        """Whether the wave ended because of `max_expanded`."""
        f = self._fields
        return bool(f["expanded"][0] >= f["max_expanded"][0] and f["n_current"][0] > 0)

    def begin(
        self,
        costmap: Costmap,
        costs: WaveCosts,
        seeds: Sequence[tuple[Cell, float]],
        fronts: Sequence[Cell],
        target: Cell,
        *,
        threshold: float,
        rise: float,
        whole: bool = False,
    ) -> None:
        """Set up a wave that starts from `seeds` (cell, potential) and discard the last one.

        `fronts` are the cells queued first, in this order; cells that are blocked, on the outermost ring or outside are
        skipped. `target` is the cell to reach; `threshold` is navfn's initial threshold and `rise` its increment. `whole`
        opens the whole grid at once, for a potential that is used as a guide and must be defined everywhere.
        """
        ny, nx = costmap.data.shape
        self._allocate(nx, ny)
        self._cost = np.ascontiguousarray(costmap.data).reshape(-1)
        self._costs = costs
        self._state[0] = (
            nx,
            ny,
            (0, 0, 0, 0),
            (0, 1, 2),
            0,
            0,
            0,
            self.max_expanded,
            -1,
            0,
            costs.quadratic,
            threshold,
            rise,
            0.0,
            0.0,
            0,
            0,
            0.0,
        )
        margin = max(nx, ny) if whole else _MARGIN
        xs = [target[0], *(x for (x, _), _ in seeds)]
        ys = [target[1], *(y for (_, y), _ in seeds)]
        open_window(
            self._pot,
            self._pending,
            self._state,
            min(xs) - margin,
            min(ys) - margin,
            max(xs) + margin + 1,
            max(ys) + margin + 1,
        )
        inside = [y * nx + x for x, y in fronts if 0 < x < nx - 1 and 0 < y < ny - 1]
        seed(
            self._cost,
            self._pot,
            self._pending,
            costs.weights,
            self._state,
            self._lists[0],
            np.array([y * nx + x for (x, y), _ in seeds], np.int64),
            np.array([p for _, p in seeds], np.float32),
            np.array(inside, np.int64),
        )

    def begin_at(
        self,
        costmap: Costmap,
        costs: WaveCosts,
        root: Cell,
        target: Cell,
        *,
        threshold: float,
        rise: float,
        whole: bool = False,
    ) -> None:
        """As `begin`, from potential 0 at the cell `root`."""
        self.begin(
            costmap,
            costs,
            [(root, 0.0)],
            start_fronts(root),
            target,
            threshold=threshold,
            rise=rise,
            whole=whole,
        )

    def aim_at(self, cell: Cell, cost: float) -> None:
        """Sort cells by potential plus `cost` times the straight distance (cells) to `cell`; call it after `begin`."""
        self._fields["aim_x"][0], self._fields["aim_y"][0] = cell
        self._fields["aim_cost"][0] = cost

    def _allocate(self, nx: int, ny: int) -> None:
        if (nx, ny) == (self.nx, self.ny):
            return
        if nx * ny > MAX_CELLS:
            raise InputError(f"a costmap of {nx} x {ny} cells is too large to plan on; the limit is 2**31 cells")
        self.nx, self.ny = nx, ny
        self._pot = np.empty(nx * ny, np.float32)
        self._pending = np.empty(nx * ny, np.uint8)

    def run(self, target: Cell | None = None, *, last: float = math.inf, guide: Guide | None = None) -> None:
        """Propagate until the lists are empty, `target` has a potential, or the threshold exceeds `last`.

        A later call resumes the wave. With a `guide`, cells are pruned where the sum of the potentials exceeds its limit.
        """
        f, costs = self._fields, self.costs
        if target is None:
            f["stop"][0] = -1
        else:
            self._open(*target)
            f["stop"][0] = target[1] * self.nx + target[0]
        f["last"][0] = last
        if guide is not None:
            f["limit"][0] = guide.limit
            f["guide_shift"][0] = guide.shift
        values = _NO_GUIDE if guide is None else guide.values
        fixed = self._cost, self._pot, self._pending, costs.steps, costs.weights
        while not propagate(*fixed, self._lists, self._flags, values, self._state):
            self._reserve(2 * self._flags.size)

    def _reserve(self, capacity: int) -> None:
        """Make room for lists of `capacity` cells, and keep what is queued."""
        lists = np.empty((3, capacity), np.uint32)
        lists[:, : self._flags.size] = self._lists
        self._lists, self._flags = lists, np.empty(capacity, np.uint8)

    def run_to(self, target: Cell, *, guide: Guide | None = None) -> None:
        """Propagate until `target` has a potential, if it has none yet."""
        if self.potential_of(*target) == math.inf:
            self.run(target, guide=guide)

    def _open(self, ix: int, iy: int) -> None:
        """Grow the open window to contain the cell, so that its potential can be read."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            open_window(
                self._pot,
                self._pending,
                self._state,
                ix - _MARGIN,
                iy - _MARGIN,
                ix + _MARGIN + 1,
                iy + _MARGIN + 1,
            )

    def settle(self, cell: Cell, guide: Guide | None) -> None:
        """Propagate until no queued cell can lower the potential of `cell` any more.

        A wave that stops at the first arrival, as in C++, may have taken a path that the next list would improve by 1 %.
        """
        reached = self.potential_of(*cell)
        if reached < math.inf:
            # queued cells were queued by cells whose potential is at least the previous threshold
            self.run(last=reached + float(self._fields["rise"][0]), guide=guide)

    def revise(self, data: NDArray[np.uint8], *, most: int, rise: float) -> bool:
        """Take over the costs `data` (ny*nx,) and lower the potential where they became cheaper; False if over `most` changed.

        Cells that became more expensive keep their potential, which is then a lower bound; the method is for guides only.
        The current wave is suspended and resumed. The costmap of `begin` is changed.
        """
        costs, threshold_field = self.costs, self._fields["threshold"]
        cells = np.empty(most, np.uint32)
        changed, count, lowest = apply_changes(
            self._cost, data, costs.steps, costs.weights, self._pot, self._pending, self.nx, most, cells
        )
        if count > 0 and changed >= 0:
            suspended, threshold = self._queued(), float(threshold_field[0])
            self._queue(cells[:count])
            threshold_field[0] = min(threshold, lowest + rise)
            self.run(last=threshold)
            self._queue(np.concatenate([suspended, self._queued()]))
            threshold_field[0] = threshold
        return changed >= 0

    def _queued(self) -> NDArray[np.uint32]:
        (current, _, overflow), n, m = (self._fields[name][0] for name in ("lists", "n_current", "n_overflow"))
        return np.concatenate([self._lists[current, :n], self._lists[overflow, :m]])

    def _queue(self, cells: NDArray[np.uint32]) -> None:
        if cells.size > self._flags.size:
            self._reserve(2 * cells.size)
        self._lists[self._fields["lists"][0, 0], : cells.size] = cells
        self._fields["n_current"][0], self._fields["n_overflow"][0] = cells.size, 0

    def complete(self, cell: Cell, reach: int) -> None:
        """Compute the potential of unreached free cells within `reach` cells of `cell` from their neighbors."""
        costs = self.costs
        complete(self._cost, self._pot, costs.steps, costs.weights, self._state, *cell, reach)

    def potential_of(self, ix: int, iy: int) -> float:
        """Potential of a cell, inf if unreached."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= ix < x1 and y0 <= iy < y1):
            return math.inf
        p = float(self._pot[iy * self.nx + ix])
        return p if p < UNREACHED else math.inf

    def full_potential(self) -> NDArray[np.float32]:
        """(ny, nx) a copy, inf where unreached."""
        out = np.full((self.ny, self.nx), np.inf, np.float32)
        window = self.window.slices
        part = self._pot.reshape(self.ny, self.nx)[window]
        out[window] = np.where(part < UNREACHED, part, np.float32(np.inf))
        return out

    def nearest_reached(self, ix: int, iy: int) -> Cell:
        """The reached cell whose center is nearest to that of (ix, iy); ties go to the first in row order."""
        window = self.window
        ys, xs = np.nonzero(self._pot.reshape(self.ny, self.nx)[window.slices] < UNREACHED)
        best = int(np.argmin((xs + (window.x0 - ix)) ** 2 + (ys + (window.y0 - iy)) ** 2))
        return int(xs[best]) + window.x0, int(ys[best]) + window.y0

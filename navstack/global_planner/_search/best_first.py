"""Best-first searches over a costmap, and their arrays, which are reused from query to query."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Window, kernel
from navstack.global_planner._search.cells import Cell, CellCosts, union

# ----------------------------------------------------------------------------------------------------------------------
# Best-first search over the 8 neighbors of the cells of a costmap (astar), and the parts it shares with any-angle searches.
#
# Cells are numbered k = iy * nx + ix. The open list is a ring of buckets of width `delta` in f. A bucket is a stack (last in,
# first out) whose entries come from one pool. An entry is skipped if its cell has been expanded since. A cell that becomes
# cheaper is queued again, so the order within a bucket can cost expansions, but not quality. Once the goal has a cost, cells
# that cannot improve it are pruned.
#
# The array `link` marks the cells that have a value; the caller keeps it at 0, and the settings return the window that was
# written. No other cells are read: a short query on a huge map costs only what it needs.


# pyright: basic


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
        ("cut_corners", np.int64),  # 0: a diagonal step needs both orthogonal neighbors free, 1: one of them
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
    s.window[0], s.window[1] = max(0, x0 - 1), max(0, y0 - 1)  # the neighbors were read too
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


# ----------------------------------------------------------------------------------------------------------------------
# Any-angle search over the cells of a costmap (Theta*), the cost of straight lines, and the pulling tight of a path.
#
# Many lines run through cells of the least weight. `clear` (n,) uint8 contains, for each cell, the distance to the nearest cell
# of another weight or outside the window of `measure_clearance` (the larger of the two coordinates, at most 255); 0 means that
# the cell itself is one of those, or that nothing is known about it. A line advances over that many cells at once.


# pyright: basic


_BITS = 40
_ONE = 1 << _BITS  # fixed point numbers of `_free_part`
_WORTH_A_JUMP = 3  # with less clearance a step from cell to cell is faster
SHORTER = np.cos(np.pi / 8)  # a straight line over free cells is at least this fraction of the 8-connected path
_LONGEST = 1 << 16  # lines of more columns would exceed their precision


@kernel
def measure_clearance(cost, weights, least, nx, window, clear):
    """Fill `clear` inside `window` (x0, y0, x1, y1, half open), whose outermost cells keep the 0 that they must contain."""
    x0, y0, x1, y1 = window[0], window[1], window[2], window[3]
    is_least = np.zeros(256, np.uint8)
    for i in range(256):
        is_least[i] = 255 if weights[i] == least else 0
    for y in range(y0 + 1, y1 - 1):
        left = np.uint8(0)
        for k in range(y * nx + x0 + 1, y * nx + x1 - 1):
            near = min(min(clear[k - nx - 1], clear[k - nx]), min(clear[k - nx + 1], left))
            left = np.uint8((min(near, np.uint8(254)) + 1) & is_least[cost[k]])
            clear[k] = left
    for y in range(y1 - 2, y0, -1):
        right = np.uint8(0)
        for k in range(y * nx + x1 - 2, y * nx + x0, -1):
            near = min(min(clear[k + nx - 1], clear[k + nx]), min(clear[k + nx + 1], right))
            right = min(clear[k], np.uint8(min(near, np.uint8(254)) + 1))
            clear[k] = right


@kernel
def remaining_costs(g, link, nx, window, remaining):
    """Fill `remaining` inside `window` with the least costs to the goal, by a `search` from there."""
    for y in range(window[1], window[3]):
        for k in range(y * nx + window[0], y * nx + window[2]):
            remaining[k] = max(SHORTER * g[k], 1e-30) if 0 < link[k] < OPEN else 0.0


@kernel
def _free_part(clear, a, i, j, steps, others, along, across):
    """How far the line from cell a, from its column i and row j on, runs through cells of the least weight: column and row.

    The line has `steps` columns, which are `along` apart, and `others` rows, `across` apart. It enters column i in the row
    floor((i - 1/2) others / steps + 1/2). The fixed point number of this, `position`, is too small by less than i / _ONE and
    too large by `margin`, half of the least difference between two different values: its integer part is exact, and its
    fraction is below 2 margin where the line enters through a corner.
    """
    margin = np.int64(_ONE // (4 * steps))
    slope = np.int64(np.float64(others) / np.float64(steps) * _ONE)
    first = np.int64(np.float64(steps - others) / np.float64(2 * steps) * _ONE) + margin
    k = a + i * along + j * across
    while i < steps:
        m = np.int64(clear[k]) - 1  # all cells within m have the least weight
        if i + m >= steps:
            return steps, others
        column = i + max(m, 1)
        position = first + column * slope
        row = position >> _BITS
        k = a + column * along + row * across
        corner = across if position & (_ONE - 1) < 2 * margin and row > j else 0
        if (clear[k] == 0) | (clear[k - along] == 0) | (clear[k - corner] == 0):
            break
        i, j = column, row
    return i, j


@kernel
def line_cost(cost, weights, clear, s, ax, ay, bx, by, limit):
    """Cost of the straight line between the centers of cells a and b: per cell, the length of the line in it times its weight.

    Every cell the line touches counts (supercover). The cost is inf when one of them is blocked, when the line passes exactly
    through a corner and more than `cut_corners` of the two cells next to it are blocked, or as soon as it must exceed `limit`.
    `s` is a record of SETTINGS. The weight of its cell `start` is `start_weight`.
    """
    nx, start = s.nx, s.start
    steps, others = abs(bx - ax), abs(by - ay)
    along = 1 if bx > ax else -1
    across = nx if by > ay else -nx
    if others > steps:
        steps, others, along, across = others, steps, across, along
    a = ay * nx + ax
    k = a
    end = by * nx + bx
    w = s.start_weight if k == start else weights[cost[k]]
    if w == np.inf:
        return np.inf
    length = np.sqrt(np.float64(steps * steps + others * others))
    total = 0.0
    t = 0.0  # part of the line whose cost is in `total`
    i, j = 0, 0  # steps along the line and across it
    e = others - steps  # (2i + 1) others - (2j + 1) steps
    while k != end:
        if clear[k] >= (_WORTH_A_JUMP if i > 0 else 1) and steps < _LONGEST:
            column, j = _free_part(clear, a, i, j, steps, others, along, across)
            if column > i:
                i = column
                k = a + i * along + j * across
                e = (2 * i + 1) * others - (2 * j + 1) * steps
                continue
        if e < 0:
            k += along
            i += 1
            e += 2 * others
            steps_along = True
        elif e > 0:
            k += across
            j += 1
            e -= 2 * steps
            steps_along = False
        else:
            walls = 0
            if weights[cost[k + along]] == np.inf and k + along != start:
                walls += 1
            if weights[cost[k + across]] == np.inf and k + across != start:
                walls += 1
            if walls > s.cut_corners:
                return np.inf
            k += along + across
            i += 1
            j += 1
            e += 2 * (others - steps)
            steps_along = True
        entered = s.start_weight if k == start else weights[cost[k]]
        if entered == w:
            continue
        if entered == np.inf:
            return np.inf
        left = (2 * i - 1) / (2.0 * steps) if steps_along else (2 * j - 1) / (2.0 * others)
        total += (left - t) * length * w
        t = left
        w = entered
        if total + (1.0 - t) * length * s.least > limit:
            return np.inf
    return total + (1.0 - t) * length * w


@kernel
def _straight(dx, dy):
    """Length of a straight line."""
    return np.sqrt(np.float64(dx * dx + dy * dy))


@kernel
def search_any_angle(cost, weights, clear, remaining, heads, g, link, settings):
    """Fill `g` and `link` until `goal` has its cost. The arguments are those of `search`, and `clear` and `remaining`.

    A cell may also be entered in a straight line from the parent of its neighbor, if that is cheaper (Theta*). `g` float32;
    `link` int32, 1 + the number of the parent cell, negative while the cell is queued.

    `remaining` (n,) float32: least costs to the goal, 0 where unknown: in the cells that an 8-connected search from the goal
    to the start did not close, because a path through them costs at least as much as the path it found, the `total`. Cells
    from which the goal cannot be reached for less than `best` are pruned.
    """
    s = settings[0]
    nx, ny, start, goal, cut_corners = s.nx, s.ny, s.start, s.goal, s.cut_corners
    max_expanded, scale, delta, least = s.max_expanded, s.scale, s.delta, s.least
    ring = heads.size
    for i in range(ring):
        heads[i] = -1
    pool = np.empty((2, 4096), np.int64)  # cell, next
    gx, gy = goal % nx, goal // nx
    start_x, start_y = start % nx, start // nx
    x0, y0, x1, y1 = start_x, start_y, start_x, start_y
    level = np.int64(scale * _straight(x0 - gx, y0 - gy) / delta)
    used, spare = push(pool, heads, level % ring, start, 0, -1)
    waiting = 1
    g[start] = 0.0
    link[start] = -(start + 1)
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
        if link[k] >= 0:
            continue
        link[k] = -link[k]
        origin = np.int64(link[k]) - 1
        here = np.float64(g[k])
        y = np.int64(np.uint32(k) // np.uint32(nx))
        x = k - y * nx
        if here + scale * _straight(x - gx, y - gy) >= best * BELOW:
            continue
        if expanded >= max_expanded:
            s.exhausted = 1
            break
        expanded += 1
        if used + 8 > pool.shape[1]:
            pool = grown(pool)
        x0, y0, x1, y1 = min(x0, x), min(y0, y), max(x1, x), max(y1, y)
        weight = s.start_weight if k == start else weights[cost[k]]
        oy = np.int64(np.uint32(origin) // np.uint32(nx))
        ox = origin - oy * nx
        base = np.float64(g[origin])
        passable = 0
        for d in range(8):
            n, step, passable = step_to(cost, weights, nx, ny, x, y, d, weight, passable, cut_corners)
            if n < 0:
                continue
            c = here + step
            known = np.float64(g[n]) if link[n] != 0 else np.inf
            via = k
            ix, iy = x + DX[d], y + DY[d]
            if origin != k:
                # no line is cheaper than this bound; it is compared as rounded as the costs are stored
                bound = base + least * _straight(ix - ox, iy - oy)
                if bound < c and np.float32(bound) < known:
                    line = base + line_cost(cost, weights, clear, s, ox, oy, ix, iy, min(c, known) - base)
                    if line < c:
                        c = line
                        via = origin
            c = np.float64(np.float32(c))
            if c >= known:
                continue
            f = c + scale * _straight(ix - gx, iy - gy)
            rest = np.float64(remaining[n])
            if rest == 0.0:
                rest = SHORTER * (s.total - least * octile_distance(ix - start_x, iy - start_y))
            if max(f, c + rest) >= best * BELOW:
                continue
            g[n] = c
            link[n] = -(via + 1)
            if n == goal:
                best = c
                continue
            used, spare = push(pool, heads, max(level, np.int64(f / delta)) % ring, n, used, spare)
            waiting += 1
    s.window[0], s.window[1] = max(0, x0 - 1), max(0, y0 - 1)  # the neighbors were read too
    s.window[2], s.window[3] = min(nx, x1 + 2), min(ny, y1 + 2)
    s.expanded = expanded


@kernel
def pull_tight(cost, weights, clear, cells, settings):
    """Remove the corners of a path (n,) of cells between which a straight line is not more expensive.

    Lines between successive cells must be legal. Each stretch is replaced by the longest line that is allowed. Returns the
    remaining cells and the cost of the path.
    """
    s = settings[0]
    nx = s.nx
    n = cells.size
    sums = np.zeros(n)
    for i in range(1, n):
        a, b = cells[i - 1], cells[i]
        sums[i] = sums[i - 1] + line_cost(cost, weights, clear, s, a % nx, a // nx, b % nx, b // nx, np.inf)
    kept = np.empty(n, np.int64)
    kept[0] = cells[0]
    m = 1
    anchor = 0
    total = 0.0
    while anchor < n - 1:
        following = anchor + 1
        piece = sums[following] - sums[anchor]
        misses = 0
        ax, ay = cells[anchor] % nx, cells[anchor] // nx
        for i in range(anchor + 2, n):
            if misses > 64:  # a longer line may still be cheaper, but trying all takes quadratic time
                break
            along = (sums[i] - sums[anchor]) * (1.0 + 1e-12)
            c = line_cost(cost, weights, clear, s, ax, ay, cells[i] % nx, cells[i] // nx, along)
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


UNLIMITED: Final = 1 << 62
_MAX_STEP: Final = math.sqrt(2.0)
_BUCKET: Final = 0.5  # width of a bucket of `octile`, in least weights
_LINE_BUCKET: Final = (
    0.2  # of `any_angle`, whose cells are expanded again less often if the order is closer to the costs
)
_EMPTY: Final = Window(0, 0, 0, 0)


class BestFirst:
    """Searches over one costmap at a time, which are never written to.

    Memory: 9 bytes per cell, allocated once per size of costmap and accessed only where a search expands. 8 are for costs
    (`octile`: a float64; `any_angle`: a float32 and the number of the parent cell, in the same memory, whose second half is
    therefore 0 between searches). 1 marks the cells for which the costs of `octile` are valid, and after `prepare_lines`
    contains the clearance instead. Straight lines take another 4 bytes per cell, for the costs that remain to the goal.
    """

    def __init__(self, costs: CellCosts, *, heuristic_weight: float = 1.0, cut_corners: bool = False) -> None:
        self._costs = costs
        self._cut_corners = int(cut_corners)
        self._scale = heuristic_weight * costs.least
        self._is_exact = heuristic_weight <= 1.0
        self._heads = np.empty(self._buckets(_BUCKET), np.int64)
        self._line_heads = np.empty(0, np.int64)
        self._shape = (0, 0)
        self._g64 = np.zeros(0)
        self._steps = np.zeros(0, np.uint8)
        self._settings = np.zeros(1, SETTINGS)
        self._window: NDArray[np.int64] = self._settings["window"][0]
        self._remaining = np.zeros(0, np.float32)
        self._total = 0.0  # cost of the path of `octile`, if `_remaining` is valid
        self._is_any_angle = False
        self._bounded = _EMPTY  # where `_remaining` is not 0
        self._written = _EMPTY  # where octile searches left costs
        self._marked = _EMPTY  # where `_steps` is not 0

    @property
    def window(self) -> Window:
        """Contains all cells that the last search read."""
        return Window(*self._window.tolist())

    @property
    def expanded(self) -> int:
        """Number of cells that the last search expanded."""
        return int(self._settings["expanded"][0])

    @property
    def is_exhausted(self) -> bool:
        """Whether the last search ended because of `max_expanded`."""
        return bool(self._settings["exhausted"][0])

    def octile(self, costmap: Costmap, start: Cell, goal: Cell, *, max_expanded: int = UNLIMITED) -> bool:
        """Search over the 8 neighbors of each cell; return whether the goal was reached."""
        self._prepare(costmap)
        self._is_any_angle = False
        reached = self._search(costmap, start, goal, max_expanded, math.inf)
        self._written = union(self._written, self.window)
        self._marked = self.window
        return reached

    def prepare_lines(self, costmap: Costmap, *, from_goal: bool) -> None:
        """Prepare `pull_tight` and `any_angle`, after `octile`, whose path is no longer available afterwards.

        Measures how far the cells that `octile` read are from more expensive ones: straight lines take less time. If `octile`
        searched from the goal to the start (`from_goal`), its costs bound what remains from a cell: `any_angle` expands fewer.
        """
        nx = self._shape[1]
        if self._remaining.size != self._steps.size:
            self._remaining, self._bounded = np.zeros(self._steps.size, np.float32), _EMPTY
        self._remaining.reshape(self._shape)[self._bounded.slices] = 0.0
        window = np.array(self._marked, np.int64)
        self._bounded, self._total = _EMPTY, 0.0
        if from_goal and self._is_exact:
            remaining_costs(self._g64, self._steps, nx, window, self._remaining)
            self._bounded, self._total = self._marked, float(self._g64[self._settings["goal"][0]])
        self._steps.reshape(self._shape)[self._marked.slices] = 0
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        measure_clearance(cost, self._costs.weights, self._costs.least, nx, window, self._steps)

    def any_angle(
        self,
        costmap: Costmap,
        start: Cell,
        goal: Cell,
        *,
        max_expanded: int = UNLIMITED,
        upper_bound: float = math.inf,
    ) -> bool:
        """Search over straight lines; return whether the goal was reached for a cost below `upper_bound`.

        Requires `octile` and `prepare_lines` on the same costmap.
        """
        self._is_any_angle = True
        if self._line_heads.size == 0:
            self._line_heads = np.empty(self._buckets(_LINE_BUCKET), np.int64)
        self._g64.reshape(self._shape)[self._written.slices] = 0.0
        self._written = _EMPTY
        return self._search(costmap, start, goal, max_expanded, upper_bound)

    def path(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells (ix, iy) from start to a goal that `octile` reached."""
        nx = self._shape[1]
        return self._cells(octile_path(self._steps, nx, self._number(start), self._number(goal)))

    def corners(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells (ix, iy) of the corners of the path to a goal that `any_angle` reached."""
        parent = self._parent
        k, first = self._number(goal), self._number(start)
        found = [k]
        while k != first:
            k = abs(int(parent[k])) - 1
            found.append(k)
        return self._cells(np.array(found[::-1], np.int64))

    def pull_tight(self, costmap: Costmap, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
        """Replace the detours of a path of cells (n, 2) by straight lines that cost no more: the corners (m, 2) and the cost.

        The path must start where the last search started. Requires `prepare_lines`.
        """
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        numbers = np.ascontiguousarray(cells[:, 1] * self._shape[1] + cells[:, 0])
        kept, total = pull_tight(cost, self._costs.weights, self._steps, numbers, self._settings)
        return self._cells(kept), float(total)

    def cost_of(self, cell: Cell) -> float:
        """Least cost from the start to a cell, inf if the search did not reach it."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= cell[0] < x1 and y0 <= cell[1] < y1):
            return math.inf
        k = self._number(cell)
        return float(self._g[k]) if self._reached[k] else math.inf

    def potential(self) -> NDArray[np.float32]:
        """(ny, nx) the costs, inf where not reached."""
        out = np.full(self._shape, np.inf, np.float32)
        part = self.window.slices
        out[part] = np.where(self._reached.reshape(self._shape)[part] != 0, self._g.reshape(self._shape)[part], np.inf)
        return out

    def nearest_reached(self, cell: Cell) -> Cell:
        """The reached cell whose center is nearest to that of `cell`; ties go to the first in row order."""
        window = self.window
        ys, xs = np.nonzero(self._reached.reshape(self._shape)[window.slices])
        best = int(np.argmin((xs + (window.x0 - cell[0])) ** 2 + (ys + (window.y0 - cell[1])) ** 2))
        return int(xs[best]) + window.x0, int(ys[best]) + window.y0

    @property
    def _g32(self) -> NDArray[np.float32]:
        return self._g64.view(np.float32)[: self._g64.size]

    @property
    def _parent(self) -> NDArray[np.int32]:
        return self._g64.view(np.int32)[self._g64.size :]

    @property
    def _g(self) -> NDArray[np.float64] | NDArray[np.float32]:
        return self._g32 if self._is_any_angle else self._g64

    @property
    def _reached(self) -> NDArray[np.uint8] | NDArray[np.int32]:
        return self._parent if self._is_any_angle else self._steps

    def _number(self, cell: Cell) -> int:
        return cell[1] * self._shape[1] + cell[0]

    def _cells(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        nx = self._shape[1]
        return np.column_stack([numbers % nx, numbers // nx])

    def _start_weight(self, cost: NDArray[np.uint8], start: int) -> float:
        """The weight of the start cell, which counts as free if it is blocked."""
        weight = float(self._costs.weights[cost[start]])
        return weight if weight < math.inf else self._costs.least

    def _buckets(self, width: float) -> int:
        """As many buckets of this width, in least weights, as one step can span."""
        highest = float(self._costs.weights[np.isfinite(self._costs.weights)].max(initial=self._costs.least))
        return math.ceil(_MAX_STEP * (highest + self._scale) / (width * self._costs.least)) + 4

    def _prepare(self, costmap: Costmap) -> None:
        """Clear what the last searches wrote, or allocate the arrays."""
        if costmap.data.shape == self._shape:
            self._steps.reshape(self._shape)[self._marked.slices] = 0
            if self._is_any_angle:
                self._parent.reshape(self._shape)[self.window.slices] = 0
            return
        ny, nx = costmap.data.shape
        self._shape = ny, nx
        self._g64 = np.zeros(ny * nx)
        self._steps = np.zeros(ny * nx, np.uint8)
        self._written = self._marked = _EMPTY

    def _search(self, costmap: Costmap, start: Cell, goal: Cell, max_expanded: int, upper_bound: float) -> bool:
        """Run the search that `_is_any_angle` selects."""
        ny, nx = self._shape
        first, last = self._number(start), self._number(goal)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        weights, least = self._costs.weights, self._costs.least
        delta = least * (_LINE_BUCKET if self._is_any_angle else _BUCKET)
        limits = first, last, self._cut_corners, max_expanded
        scales = self._start_weight(cost, first), least, self._scale, delta, upper_bound, self._total
        self._settings[0] = (nx, ny, *limits, *scales, (0, 0, 0, 0), 0, 0)
        if self._is_any_angle:
            g, parent = self._g32, self._parent
            search_any_angle(cost, weights, self._steps, self._remaining, self._line_heads, g, parent, self._settings)
        else:
            search(cost, weights, self._heads, self._g64, self._steps, self._settings)
        return bool(self._reached[last] != 0)

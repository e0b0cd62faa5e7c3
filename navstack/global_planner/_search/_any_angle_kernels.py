# pyright: basic
"""Any-angle search over the cells of a costmap (Theta*), the cost of straight lines, and the pulling tight of a path.

Many lines run through cells of the least weight. `clear` (n,) uint8 contains, for each cell, the distance to the nearest cell
of another weight or outside the window of `measure_clearance` (the larger of the two coordinates, at most 255); 0 means that
the cell itself is one of those, or that nothing is known about it. A line advances over that many cells at once.
"""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel
from navstack.global_planner._search._search_kernels import BELOW, DX, DY, OPEN, grown, octile_distance, push, step_to

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
    """Cost of the straight line between the centres of cells a and b: per cell, the length of the line in it times its weight.

    Every cell the line touches counts (supercover). The cost is inf when one of them is blocked, when the line passes exactly
    through a corner and more than `cut_corners` of the two cells beside it are blocked, or as soon as it must exceed `limit`.
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

    A cell may also be entered in a straight line from the parent of its neighbour, if that is cheaper (Theta*). `g` float32;
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
    s.window[0], s.window[1] = max(0, x0 - 1), max(0, y0 - 1)  # the neighbours were read too
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

# pyright: basic
"""Inflation: costs by the exact distance to the nearest lethal cell."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def count_up(lethal_row, counts, radius, out):
    """Advance one row: update the cells to the last lethal cell of each column, at most radius + 1; copy them to `out`."""
    for x in range(counts.size):
        further = np.uint8(min(counts[x], radius) + np.uint8(1))
        further = np.uint8(0) if lethal_row[x] == np.uint8(254) else further
        counts[x] = further
        out[x] = further


@kernel
def keep_nearer(distances, others):
    """Write the smaller of both into `distances`, cell by cell."""
    for x in range(others.size):
        distances[x] = min(distances[x], others[x])


@kernel
def keep_larger(costs, others):
    """Write the larger of both into `costs`, cell by cell."""
    for x in range(others.size):
        costs[x] = max(costs[x], others[x])


@kernel
def set_bytes(row, value):
    """Set all cells of a row."""
    for x in range(row.size):
        row[x] = value


@kernel
def raise_costs(row, costs, unknown_from):
    """Write the larger of both into `row`; overwrite unknown cells with costs of at least `unknown_from`."""
    for x in range(row.size):
        old, cost = row[x], costs[x]
        kept = np.uint8(cost if cost >= unknown_from else np.uint8(255))
        row[x] = kept if old == np.uint8(255) else max(old, cost)


@kernel
def inflate(master, x0, y0, x1, y1, ahead, behind, below, rows, near, near_words, unknown_from):
    """Raise the costs of the window to the inflation cost of the nearest lethal cell, by its exact Euclidean distance.

    `ahead` (radius + 1, n): cost at `row` cells across and 1 + `column` cells along, 0 beyond the radius; column n - 1: the
    cost at 0 cells along. `behind`: `ahead` mirrored. Unknown cells are overwritten with costs of at least `unknown_from`.
    Scratch: `below` (>= y1 - y0, >= nx), `rows` (2, >= nx + 2 n + 16), `near` (a multiple of 8, >= nx + 24), of
    which `near_words` is the view as uint64.

    The rows of the window are processed from the top down. `below` is the distance down to the nearest lethal cell of each
    column, `counts` the distance up, `near` the smaller of the two. A column affects the cells to its right only if its right
    neighbour is farther from an obstacle (left likewise). So few columns are propagated along the row, and in most of the row
    nothing is near. The loops over whole rows are functions of their own because they vectorize there.
    """
    radius = ahead.shape[0] - 1
    ny, nx = master.shape
    left, right = max(0, x0 - radius), min(nx, x1 + radius)
    bottom, top = max(0, y0 - radius), min(ny, y1 + radius)
    width = right - left
    reach = ahead.shape[1] - 1
    largest = np.uint8(radius)
    far = np.uint8(radius + 1)
    counts = rows[0, 0:width]
    set_bytes(counts, far)
    for y in range(bottom, y1):
        count_up(master[y, left:right], counts, largest, below[max(y - y0, 0), 0:width])
    # eight cells at a time: one word of `near` shows whether anything is near; one word of margin on both sides
    words = (width + 7) // 8 + 2
    set_bytes(near[0 : 8 * words], far)
    nothing = near_words[0]
    near_row = near[8 : 8 + width]
    margin = reach + 8
    costs = rows[1, 0 : width + 2 * margin]
    set_bytes(costs, np.uint8(0))
    set_bytes(counts, far)
    for y in range(top - 1, y0 - 1, -1):
        row = master[y, left:right]
        count_up(row, counts, largest, near_row)
        if y >= y1:
            continue
        keep_nearer(near_row, below[y - y0, 0:width])
        first, last = width, -1
        for word in range(1, words - 1):
            if near_words[word] == nothing:
                continue
            for at in range(8 * word, 8 * word + 8):
                d = near[at]
                if d == far:
                    continue
                first, last = min(first, at - 8), at - 8
                here = at - 8 + margin
                costs[here] = max(costs[here], ahead[d, reach])
                if near[at + 1] > d:
                    keep_larger(costs[here + 1 : here + 1 + reach], ahead[d, 0:reach])
                if near[at - 1] > d:
                    keep_larger(costs[here - reach : here], behind[d, 1 : reach + 1])
        if last >= 0:
            first, last = max(x0 - left, first - radius), min(x1 - left, last + radius + 1)
            if first < last:
                raise_costs(row[first:last], costs[margin + first : margin + last], unknown_from)
            set_bytes(costs, np.uint8(0))

# pyright: basic
"""Difference between two states of a grid."""

from __future__ import annotations

from navstack.core.jit import kernel


@kernel
def copy_changes(new, last, x0, y0, x1, y1):
    """Copies the window x0 <= ix < x1, y0 <= iy < y1 of `new` into `last` (both uint8); returns the box of changed cells.

    The box is half open; all 0 if no cell changed.
    """
    left, bottom, right, top = x1, y1, x0, y0
    for iy in range(y0, y1):
        row, before = new[iy, x0:x1], last[iy, x0:x1]
        differs = False
        for i in range(len(row)):
            differs |= row[i] != before[i]
        if not differs:
            continue
        bottom, top = min(bottom, iy), iy + 1
        first, end = 0, len(row)
        while row[first] == before[first]:
            first += 1
        while row[end - 1] == before[end - 1]:
            end -= 1
        left, right = min(left, x0 + first), max(right, x0 + end)
        for i in range(first, end):
            before[i] = row[i]
    if right <= left:
        return 0, 0, 0, 0
    return left, bottom, right, top

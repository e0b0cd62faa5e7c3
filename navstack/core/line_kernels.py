# pyright: basic
"""Lines of cells (Bresenham), as base_local_planner's LineIterator and costmap_2d's raytraceLine walk them.

`line_start` and `line_next` visit the cells in order; `clear_line` writes them, faster. Cells are flat indices `iy * nx + ix`.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

FIXED = 40
"""Fractional bits of a line's slope in fixed point: exact for lines of up to 700,000 cells."""


@kernel
def line_start(x0, y0, x1, y1, nx):
    """Return the line from cell (x0, y0) to (x1, y1) as (steps, add, major, minor), for `line_next`.

    `steps` is the number of cells after the first one, `add` the distance along the minor axis (cells), `major` and `minor`
    the flat offsets of one step along each axis. Walk it with

        cell, error = y0 * nx + x0, line[0] // 2
        for _ in range(line[0] + 1):
            ...
            cell, error = line_next(cell, error, line)
    """
    dx, dy = x1 - x0, y1 - y0
    step_x = 1 if dx > 0 else -1
    step_y = nx if dy > 0 else -nx
    dx, dy = abs(dx), abs(dy)
    along_x = dx >= dy
    steps = dx if along_x else dy
    add = dy if along_x else dx
    return steps, add, step_x if along_x else step_y, step_y if along_x else step_x


@kernel
def line_next(cell, error, line):
    """Return the next cell of a line and its error term. After the last cell, the result may be outside the grid."""
    steps, add, major, minor = line
    error += add
    aside = error >= steps
    return cell + major + (minor if aside else 0), error - (steps if aside else 0)


@kernel
def clear_line(cells, nx, x0, y0, x1, y1, nearest, max_length):
    """Set the cells of a line to 0, both ends included; stop after `max_length` (cells, Euclidean).

    With `nearest` (cells), the line begins in the cell that far from the first one, if the last one is not nearer, and the
    share of it that is left out is that of the whole line (Nav2).

    The cell after i steps along the major axis is `(steps // 2 + i * add) // steps` cells along the minor one. With the slope
    in fixed point, each cell takes one addition and no branch.
    """
    dx, dy = x1 - x0, y1 - y0
    squared = float(dx * dx + dy * dy)
    if nearest > 0.0:
        # the square root is exact where a rounding could change a cell: for the sides of a right triangle of integers
        whole = math.sqrt(squared)
        if whole < nearest:
            return
        x0, y0 = int(x0 + dx / whole * nearest), int(y0 + dy / whole * nearest)
    length, add, major, minor = line_start(x0, y0, x1, y1, nx)
    offset = y0 * nx + x0
    if length == 0:
        cells[np.uint64(offset)] = 0
        return
    steps = length
    if squared > max_length * max_length:
        steps = int(max_length / math.sqrt(squared) * length)
    scale = (1 << FIXED) / length
    slope = int(add * scale) + 1
    at = int((length // 2) * scale) + 1
    for _ in range(steps + 1):
        cells[np.uint64(offset + (at >> FIXED) * minor)] = 0
        offset += major
        at += slope

# pyright: basic
"""A patch of the costmap around rollouts, and upper bounds of the cost of footprints in it.

The cells of a patch are numbered `v * pitch + u`: u is x or y, whichever the rollouts extend farther along, because rows along it
fill whole vectors. The second half of each row is 0.
"""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel

LETHAL = np.uint8(254)
ROW = 32
"""The length of rows is a multiple of it."""


@kernel
def patch_size(area, along_y):
    """Return the rows of a patch of the box x0, y0, x1, y1 (half-open), and their length."""
    columns, rows = area[2] - area[0], area[3] - area[1]
    if along_y:
        columns, rows = rows, columns
    # the difference of two cells is unique if a row is twice as long as the box
    return rows, (2 * columns + ROW - 1) // ROW * ROW


@kernel
def copy_patch(costs, area, along_y, pitch, patch):
    """Copy the costs in the box x0, y0, x1, y1 (half-open), at most 254, to the rows of `patch`; with `along_y`, to its
    columns.
    """
    x0, y0, x1, y1 = area
    for i in range(np.uint64(len(patch))):
        patch[i] = 0
    for iy in range(y0, y1):
        row = costs[iy, x0:x1]
        if along_y:
            for i in range(np.uint64(x1 - x0)):
                patch[i * np.uint64(pitch) + np.uint64(iy - y0)] = min(row[i], LETHAL)
        else:
            base = np.uint64((iy - y0) * pitch)
            for i in range(np.uint64(x1 - x0)):
                patch[base + i] = min(row[i], LETHAL)


@kernel
def raise_to_shifted(cells, shift, out):
    """Write the larger of each cell and the one `shift` behind it to `out`."""
    for i in range(np.uint64(len(cells) - shift)):
        out[i] = max(cells[i], cells[i + np.uint64(shift)])
    for i in range(len(cells) - shift, len(cells)):
        out[i] = cells[i]


@kernel
def highest_in_octagons(patch, pitch, radius, one, two):
    """Compute an upper bound of the cost of a footprint for each cell of its centre; return its grid, and the shift of a cell
    in it.

    `radius`: circumscribed radius of the footprint (cells). The cells on its edges and under it are, from that of the centre,
    in a disc of this radius, 1.5 cells larger along both axes (see `highest_around`). The octagon around it is a square, found
    by doubling, and a diamond, found step by step. Cells nearer to the border of the patch than `octagon_reach` have no bound.
    `one`, `two`: scratch.
    """
    square, diamond = octagon_reach(radius)
    for axis in range(2):
        step = 1 if axis == 0 else pitch
        width = 1
        source = patch if axis == 0 else one
        while width < 2 * square + 1:
            more = min(width, 2 * square + 1 - width)
            raise_to_shifted(source, more * step, two)
            one, two = two, one
            source = one
            width += more
    size = len(patch)
    for _ in range(diamond):
        for i in range(np.uint64(pitch), np.uint64(size - pitch)):
            across = max(one[i - np.uint64(1)], one[i + np.uint64(1)])
            along = max(one[i - np.uint64(pitch)], one[i + np.uint64(pitch)])
            two[i] = max(one[i], max(across, along))
        one, two = two, one
    return one, square * (pitch + 1)


@kernel
def octagon_reach(radius):
    """Return half the side of the square and half the diagonal of the diamond of `highest_in_octagons` (cells)."""
    square = math.ceil((math.sqrt(2.0) - 1.0) * radius + 1.5)
    return square, max(math.ceil(radius + 1.5) - square, 0)


@kernel
def write_bounds(grid, shift, area, along_y, pitch, reach, costs, box, out):
    """Copy bounds to `out` (ny, nx) for the cells of `box` x0, y0, x1, y1 (half-open); 255 within `reach` of the costmap's
    border.
    """
    ny, nx = costs.shape
    stride_x, stride_y = (pitch, 1) if along_y else (1, pitch)
    for iy in range(box[1], box[3]):
        for ix in range(box[0], box[2]):
            inside = ix >= reach and iy >= reach and ix < nx - reach and iy < ny - reach
            cell = (ix - area[0]) * stride_x + (iy - area[1]) * stride_y - shift
            out[iy, ix] = grid[np.uint64(cell)] if inside else np.uint8(255)

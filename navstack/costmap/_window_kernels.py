# pyright: basic
"""Combination of a layer with the master grid inside a window of cells `x0 <= x < x1`, `y0 <= y < y1`."""

from __future__ import annotations

import numpy as np

from navstack.core.jit import kernel


@kernel
def fill_window(cells, x0, y0, x1, y1, value):
    """Set the cells of the window to one value."""
    cells[y0:y1, x0:x1] = value


@kernel
def combine_max(master, layer, x0, y0, x1, y1):
    """Write the larger cost into the window of the master; skip unknown cells of the layer, overwrite those of the master."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            ours, theirs = layer[y, x], master[y, x]
            # adding 1 in a byte maps unknown (255) to 0 and keeps the order of the other costs
            if np.uint8(ours + np.uint8(1)) > np.uint8(theirs + np.uint8(1)):
                master[y, x] = ours


@kernel
def combine_overwrite(master, layer, x0, y0, x1, y1):
    """Write the known cells of the layer into the window of the master."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            ours = layer[y, x]
            master[y, x] = master[y, x] if ours == 255 else ours


@kernel
def look_up_map(master, costs, x0, y0, x1, y1, affine, maximum):
    """Write the costs of another grid at each cell centre into the window; leave cells outside that grid unchanged.

    `affine` (6,): real-valued column = a0 + a1 * ix + a2 * iy and row = a3 + a4 * ix + a5 * iy of the other grid. With
    `maximum`, write the larger cost only.
    """
    ny, nx = costs.shape
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            fx = affine[0] + affine[1] * ix + affine[2] * iy
            fy = affine[3] + affine[4] * ix + affine[5] * iy
            if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
                cost = costs[int(fy), int(fx)]
                if not maximum or np.uint8(cost + np.uint8(1)) > np.uint8(master[iy, ix] + np.uint8(1)):
                    master[iy, ix] = cost

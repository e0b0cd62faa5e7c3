# pyright: basic
"""Combination of a layer with the master grid inside a window of cells `x0 <= x < x1`, `y0 <= y < y1`."""

from __future__ import annotations

import math

import numpy as np

from navstack.core.jit import kernel


@kernel
def fill_window(cells, x0, y0, x1, y1, value):
    """Set the cells of the window to one value."""
    cells[y0:y1, x0:x1] = value


@kernel
def raise_row(master, layer):
    """Write the larger cost into a row of the master; a function of its own because its loop vectorizes there."""
    for x in range(master.size):
        ours, theirs = layer[x], master[x]
        # adding 1 in a byte maps unknown (255) to 0 and keeps the order of the other costs
        larger = np.uint8(ours + np.uint8(1)) > np.uint8(theirs + np.uint8(1))
        master[x] = ours if larger else theirs


@kernel
def overwrite_row(master, layer):
    """Write the known cells of a row of the layer into the master."""
    for x in range(master.size):
        ours, theirs = layer[x], master[x]
        master[x] = theirs if ours == np.uint8(255) else ours


@kernel
def combine_max(master, layer, x0, y0, x1, y1):
    """Write the larger cost into the window of the master; skip unknown cells of the layer, overwrite those of the master."""
    for y in range(y0, y1):
        raise_row(master[y, x0:x1], layer[y, x0:x1])


@kernel
def combine_overwrite(master, layer, x0, y0, x1, y1):
    """Write the known cells of the layer into the window of the master."""
    for y in range(y0, y1):
        overwrite_row(master[y, x0:x1], layer[y, x0:x1])


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


@kernel
def look_up_rotated_map(master, costs, x0, y0, x1, y1, affine, maximum, beyond):
    """As `look_up_map`, but a cell is lethal if it overlaps any lethal cell of the other grid.

    Cells whose centre is outside that grid get `beyond`, unless it is negative or `maximum` is set.
    """
    ny, nx = costs.shape
    size = math.hypot(affine[1], affine[4])
    c, s = affine[1] / size, affine[4] / size
    # half extents: of the rotated cell along the axes of the other grid, and of both along the axes of the cell
    reach = 0.5 * size * (abs(c) + abs(s))
    upright = 0.5 + reach - 1e-9
    turned = 0.5 * size + 0.5 * (abs(c) + abs(s)) - 1e-9
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            fx = affine[0] + affine[1] * ix + affine[2] * iy
            fy = affine[3] + affine[4] * ix + affine[5] * iy
            cost = np.int64(-1)
            if fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny:
                cost = np.int64(costs[int(fy), int(fx)])
            elif not maximum:
                cost = np.int64(beyond)
            for jy in range(max(0, math.floor(fy - reach)), min(ny - 1, math.floor(fy + reach)) + 1):
                for jx in range(max(0, math.floor(fx - reach)), min(nx - 1, math.floor(fx + reach)) + 1):
                    if costs[jy, jx] != 254:
                        continue
                    dx, dy = jx + 0.5 - fx, jy + 0.5 - fy
                    if max(abs(dx), abs(dy)) < upright and max(abs(c * dx + s * dy), abs(c * dy - s * dx)) < turned:
                        cost = np.int64(254)
            if cost < 0:
                continue
            new = np.uint8(cost)
            if not maximum or np.uint8(new + np.uint8(1)) > np.uint8(master[iy, ix] + np.uint8(1)):
                master[iy, ix] = new

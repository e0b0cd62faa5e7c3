"""Regions of a grid and shifts of a rolling window."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Bounds, GridGeometry, kernel

EVERYWHERE = Bounds(-np.inf, -np.inf, np.inf, np.inf)


def window_shift(old: GridGeometry, new: GridGeometry) -> tuple[int, int]:
    """Return the shift (dx, dy) from the old to the new corner in whole cells, at most the size of the grid."""
    dx = round((new.origin_x - old.origin_x) / old.resolution)
    dy = round((new.origin_y - old.origin_y) / old.resolution)
    return max(-old.nx, min(old.nx, dx)), max(-old.ny, min(old.ny, dy))


def shift_cells(cells: NDArray[Any], dx: int, dy: int, fill: int) -> None:
    """Shift a contiguous grid in place: cell (x, y) gets the value of (x + dx, y + dy), or `fill` from outside the grid."""
    ny, nx = cells.shape
    if abs(dx) >= nx or abs(dy) >= ny:
        cells.fill(fill)
        return
    # shift the flat array: the cells that wrap around the ends of the rows are overwritten below
    flat = cells.reshape(-1).data  # a view of the memory: numpy shifts overlapping arrays backwards element by element
    by = dy * nx + dx
    if by > 0:
        flat[:-by] = flat[by:]
    elif by < 0:
        flat[-by:] = flat[:by]
    if dy > 0:
        cells[ny - dy :] = fill
    elif dy < 0:
        cells[:-dy] = fill
    if dx > 0:
        cells[:, nx - dx :] = fill
    elif dx < 0:
        cells[:, :-dx] = fill


def clear_region(
    cells: NDArray[Any], geometry: GridGeometry, region: Bounds | None, invert: bool, value: int
) -> tuple[int, Bounds]:
    """Set the cells in `region` (m) to `value`; outside it with `invert`; all cells if it is None.

    Returns the number of lethal cells among them and the bounds (m) of the cells that were set.
    """
    if region is None:
        if invert:
            return 0, Bounds()
        lethal = int(np.count_nonzero(cells == LETHAL))
        cells.fill(value)
        return lethal, EVERYWHERE
    inside = _cells_of(region, geometry)
    if not invert:
        part = cells[inside]
        lethal = int(np.count_nonzero(part == LETHAL))
        part[...] = value
        return lethal, region
    kept = cells[inside].copy()
    lethal = int(np.count_nonzero(cells == LETHAL)) - int(np.count_nonzero(kept == LETHAL))
    cells.fill(value)
    cells[inside] = kept
    return lethal, EVERYWHERE


def _cells_of(region: Bounds, geometry: GridGeometry) -> tuple[slice, slice]:
    """Return the cells that overlap a region; none if it is outside the grid (`window_of` would clip it onto the border)."""
    left, right, bottom, top = geometry.extent
    outside = region.max_x < left or region.min_x >= right or region.max_y < bottom or region.min_y >= top
    if region.is_empty or outside:
        return slice(0, 0), slice(0, 0)
    return geometry.window_of(region).slices


# ----------------------------------------------------------------------------------------------------------------------
# Combination of a layer with the master grid inside a window of cells `x0 <= x < x1`, `y0 <= y < y1`.


# pyright: basic


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
def raise_known_row(master, layer):
    """Write the larger cost into the known cells of a row of the master."""
    for x in range(master.size):
        ours, theirs = layer[x], master[x]
        keep = (ours == np.uint8(255)) | (theirs >= ours)
        master[x] = theirs if keep else ours


@kernel
def combine_known_max(master, layer, x0, y0, x1, y1):
    """Write the larger cost into the window of the master; skip unknown cells of the layer and of the master."""
    for y in range(y0, y1):
        raise_known_row(master[y, x0:x1], layer[y, x0:x1])


@kernel
def look_up_map(master, costs, x0, y0, x1, y1, affine, maximum):
    """Write the costs of another grid at each cell center into the window; leave cells outside that grid unchanged.

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

    Cells whose center is outside that grid get `beyond`, unless it is negative or `maximum` is set.
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

"""Regions of a grid and shifts of a rolling window."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Bounds, GridGeometry

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
    flat = cells.reshape(-1)
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

"""Parts of a grid: what lies in a region or outside it, how far a rolling window moved."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Bounds, GridGeometry

EVERYWHERE = Bounds(-np.inf, -np.inf, np.inf, np.inf)


def window_shift(old: GridGeometry, new: GridGeometry) -> tuple[int, int]:
    """Whole cells (dx, dy) from the old to the new corner, at most the grid's own size in each direction."""
    dx = round((new.origin_x - old.origin_x) / old.resolution)
    dy = round((new.origin_y - old.origin_y) / old.resolution)
    return max(-old.nx, min(old.nx, dx)), max(-old.ny, min(old.ny, dy))


def shift_cells(cells: NDArray[Any], dx: int, dy: int, fill: int) -> None:
    """Moves a contiguous grid by whole cells, in place: cell (x, y) takes the value of (x + dx, y + dy), `fill` from outside."""
    ny, nx = cells.shape
    if abs(dx) >= nx or abs(dy) >= ny:
        cells.fill(fill)
        return
    # all rows as one, by so many cells: what comes round the ends of the rows is then overwritten
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


def forget_region(
    cells: NDArray[Any], geometry: GridGeometry, region: Bounds | None, invert: bool, value: int
) -> tuple[int, Bounds]:
    """Sets the cells in `region` (m), outside it with `invert`, everywhere when None.

    Returns how many of them were lethal and the box (m) that holds all cells that were set.
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
    """The cells that a region touches; none when it lies off the grid (`window_of` would clip it onto the border)."""
    left, right, bottom, top = geometry.extent
    off = region.max_x < left or region.min_x >= right or region.max_y < bottom or region.min_y >= top
    if region.is_empty or off:
        return slice(0, 0), slice(0, 0)
    return geometry.window_of(region).slices

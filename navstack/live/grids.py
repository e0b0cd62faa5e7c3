"""The part of a costmap that has changed since a page saw it last."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Window
from navstack.live.frame import Frame
from navstack.record.changes import copy_changed_window


class GridView:
    """A costmap as one page knows it."""

    def __init__(self) -> None:
        self._geometry: GridGeometry | None = None
        self._cells: NDArray[np.uint8] | None = None

    def clear(self) -> None:
        """Lets the next update contain the whole grid."""
        self._geometry = self._cells = None

    def update(self, costmap: Costmap, frame: Frame) -> dict[str, Any] | None:
        """Returns the entry of the header for what has changed, with its blob; None if nothing has.

        `shift` are the cells (x, y) by which the page moves what it has, before it writes the window `box` (x0, y0, x1, y1).
        """
        geometry, data = costmap.geometry, costmap.data
        shift = self._shift_to(geometry)
        if shift is None or self._cells is None:
            self._cells = data.copy()
            box = geometry.window
        else:
            if shift != (0, 0):
                self._cells = shifted(self._cells, *shift)
            box = copy_changed_window(data, self._cells)
        moved = shift is None or shift != (0, 0)
        self._geometry = geometry
        if box.is_empty and not moved:
            return None
        entry: dict[str, Any] = {
            "nx": geometry.nx,
            "ny": geometry.ny,
            "resolution": geometry.resolution,
            "origin": [geometry.origin_x, geometry.origin_y],
            "box": [int(v) for v in box],
        }
        if shift is not None and shift != (0, 0):
            entry["shift"] = list(shift)
        if not box.is_empty:
            entry["blob"] = frame.blob(data[box.slices])
        return entry

    def _shift_to(self, geometry: GridGeometry) -> tuple[int, int] | None:
        """Returns the whole cells by which the window has moved; None if the grid is another one."""
        old = self._geometry
        if old is None or (old.nx, old.ny, old.resolution) != (geometry.nx, geometry.ny, geometry.resolution):
            return None
        dx = (geometry.origin_x - old.origin_x) / geometry.resolution
        dy = (geometry.origin_y - old.origin_y) / geometry.resolution
        if abs(dx - round(dx)) > 1e-3 or abs(dy - round(dy)) > 1e-3:
            return None
        return round(dx), round(dy)


def shifted(cells: NDArray[np.uint8], dx: int, dy: int) -> NDArray[np.uint8]:
    """Returns the cells (ny, nx) of a window that has moved by (dx, dy) cells; new ones are 0."""
    ny, nx = cells.shape
    out = np.zeros_like(cells)
    if abs(dx) >= nx or abs(dy) >= ny:
        return out
    source = Window(max(dx, 0), max(dy, 0), min(nx, nx + dx), min(ny, ny + dy))
    target = Window(max(-dx, 0), max(-dy, 0), min(nx, nx - dx), min(ny, ny - dy))
    out[target.slices] = cells[source.slices]
    return out

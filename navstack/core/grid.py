"""Grid geometry (world <-> cell) and costmaps.

Arrays are `[iy, ix]`, row 0 = smallest y. `ix = floor((x - origin_x) / resolution)`; the center of cell i is at
`origin + (i + 0.5) * resolution` (costmap_2d/src/costmap_2d.cpp).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core.costs import LETHAL
from navstack.core.errors import InputError

GRID = np.dtype([("origin_x", "f8"), ("origin_y", "f8"), ("resolution", "f8"), ("nx", "i8"), ("ny", "i8")])
"""Geometry of a grid for kernels: m, m, m, cells, cells. An array of one record is passed in 0.1 µs, as one argument."""


class Bounds(NamedTuple):
    """A box in world coordinates (m); empty if `min > max`."""

    min_x: float = math.inf
    min_y: float = math.inf
    max_x: float = -math.inf
    max_y: float = -math.inf

    @property
    def is_empty(self) -> bool:
        """True for an empty box."""
        return self.min_x > self.max_x or self.min_y > self.max_y

    def including(self, x: float, y: float) -> Bounds:
        """Return the bounds grown to contain the point (m)."""
        return Bounds(min(self.min_x, x), min(self.min_y, y), max(self.max_x, x), max(self.max_y, y))

    def union(self, other: Bounds) -> Bounds:
        """Return the bounds grown to contain `other`."""
        left, low, right, high = self
        min_x, min_y, max_x, max_y = other
        return Bounds(min(left, min_x), min(low, min_y), max(right, max_x), max(high, max_y))

    def grown(self, margin: float) -> Bounds:
        """Return the bounds grown by `margin` (m) on each side."""
        return Bounds(self.min_x - margin, self.min_y - margin, self.max_x + margin, self.max_y + margin)


class Window(NamedTuple):
    """A half-open rectangle of cells: `x0 <= ix < x1`, `y0 <= iy < y1`."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def is_empty(self) -> bool:
        """True without cells."""
        return self.x0 >= self.x1 or self.y0 >= self.y1

    def union(self, other: Window) -> Window:
        """Return the smallest window that contains both."""
        return Window(min(self.x0, other.x0), min(self.y0, other.y0), max(self.x1, other.x1), max(self.y1, other.y1))

    @property
    def slices(self) -> tuple[slice, slice]:
        """Index of the window in an `[iy, ix]` array."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)


@dataclass(frozen=True, slots=True)
class GridGeometry:
    """Size of a grid in cells, its resolution (m per cell) and the world position of its lower left corner (m)."""

    nx: int
    ny: int
    resolution: float
    origin_x: float = 0.0
    origin_y: float = 0.0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise InputError(f"resolution must be a positive number of meters per cell, not {self.resolution}")
        if not (math.isfinite(self.origin_x) and math.isfinite(self.origin_y)):
            raise InputError(f"the origin of a grid must be finite, not ({self.origin_x}, {self.origin_y})")
        if self.nx < 1 or self.ny < 1:
            raise InputError(f"a grid must have at least one cell in each direction, not {self.nx} x {self.ny}")

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx), the shape of the arrays."""
        return self.ny, self.nx

    @property
    def width_m(self) -> float:
        """Extent along x (m)."""
        return self.nx * self.resolution

    @property
    def height_m(self) -> float:
        """Extent along y (m)."""
        return self.ny * self.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(left, right, bottom, top) in meters, as for matplotlib's imshow."""
        return self.origin_x, self.origin_x + self.width_m, self.origin_y, self.origin_y + self.height_m

    @property
    def window(self) -> Window:
        """The window of all cells."""
        return Window(0, 0, self.nx, self.ny)

    def world_to_cell(self, x: float, y: float) -> tuple[int, int] | None:
        """Return (ix, iy) of the cell that contains the point (m); None if it is outside or not finite."""
        if not (math.isfinite(x) and math.isfinite(y)) or x < self.origin_x or y < self.origin_y:
            return None
        fx = (x - self.origin_x) / self.resolution
        fy = (y - self.origin_y) / self.resolution
        if fx >= self.nx or fy >= self.ny:
            return None
        return int(fx), int(fy)

    def world_to_cell_unbounded(self, x: float, y: float) -> tuple[int, int]:
        """Return (ix, iy) of the cell that contains the point (m) in an unbounded grid."""
        return math.floor((x - self.origin_x) / self.resolution), math.floor((y - self.origin_y) / self.resolution)

    def cell_to_world(self, ix: int, iy: int) -> tuple[float, float]:
        """Return the world coordinates (m) of the center of a cell."""
        return self.origin_x + (ix + 0.5) * self.resolution, self.origin_y + (iy + 0.5) * self.resolution

    def contains_cell(self, ix: int, iy: int) -> bool:
        """Return True for a cell of this grid."""
        return 0 <= ix < self.nx and 0 <= iy < self.ny

    def window_of(self, bounds: Bounds) -> Window:
        """Return the window from the cell of the minimum to that of the maximum of `bounds` (m), clipped to the grid."""
        min_x, min_y, max_x, max_y = bounds
        if min_x > max_x or min_y > max_y:
            return Window(0, 0, 0, 0)
        x0, y0 = self._clipped(min_x, min_y)
        x1, y1 = self._clipped(max_x, max_y)
        return Window(x0, y0, min(x1 + 1, self.nx), min(y1 + 1, self.ny))

    def _clipped(self, x: float, y: float) -> tuple[int, int]:
        fx = (x - self.origin_x) / self.resolution
        fy = (y - self.origin_y) / self.resolution
        ix = 0 if fx < 0.0 else self.nx - 1 if fx >= self.nx else int(fx)
        iy = 0 if fy < 0.0 else self.ny - 1 if fy >= self.ny else int(fy)
        return ix, iy

    def moved_to(self, origin_x: float, origin_y: float) -> GridGeometry:
        """Return the same grid with another origin."""
        return GridGeometry(self.nx, self.ny, self.resolution, origin_x, origin_y)


def grid_record(geometry: GridGeometry) -> NDArray[Any]:
    """(1,) of GRID, for kernels."""
    record = np.empty(1, GRID)
    record[0] = (geometry.origin_x, geometry.origin_y, geometry.resolution, geometry.nx, geometry.ny)
    return record


class Costmap:
    """Costs `data` (ny, nx) uint8 with `geometry` in `frame`. The array is writable; the geometry may be replaced."""

    __slots__ = ("data", "frame", "geometry")

    def __init__(self, geometry: GridGeometry, data: NDArray[np.uint8] | None = None, frame: str = "map") -> None:
        given: Any = geometry  # callers without a type checker pass anything
        if not isinstance(given, GridGeometry):
            raise InputError(
                f"the geometry of a costmap must be a GridGeometry, not {given!r}; pass GridGeometry(nx, ny, resolution)"
            )
        if data is None:
            data = np.zeros(geometry.shape, np.uint8)
        given = data
        if getattr(given, "shape", None) != geometry.shape or given.dtype != np.uint8:
            raise InputError(
                f"costs must be uint8 of shape {geometry.shape} (ny, nx), not {getattr(given, 'dtype', type(given).__name__)} "
                f"of shape {np.shape(given)}"
            )
        self.geometry = geometry
        self.data = data
        self.frame = frame

    def cost_at(self, x: float, y: float) -> int | None:
        """Return the cost at a world point (m); None outside the grid."""
        cell = self.geometry.world_to_cell(x, y)
        return None if cell is None else int(self.data[cell[1], cell[0]])

    def copy(self) -> Costmap:
        """Return an independent copy."""
        return Costmap(self.geometry, self.data.copy(), self.frame)

    def __repr__(self) -> str:
        nx, ny, size = self.geometry.nx, self.geometry.ny, self.geometry.resolution
        return (
            f"Costmap({nx} x {ny} cells of {size:g} m, {int((self.data == LETHAL).sum())} lethal, frame {self.frame!r})"
        )

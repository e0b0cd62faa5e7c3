"""Grids: where a cell lies in the world, an occupancy grid, a costmap.

Arrays are `[iy, ix]`, row 0 = smallest y. `ix = floor((x - origin_x) / resolution)`; the centre of cell i lies at
`origin + (i + 0.5) * resolution` (costmap_2d/src/costmap_2d.cpp).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Bounds(NamedTuple):
    """A box in world coordinates (m) that only grows; empty while `min > max`."""

    min_x: float = math.inf
    min_y: float = math.inf
    max_x: float = -math.inf
    max_y: float = -math.inf

    @property
    def is_empty(self) -> bool:
        """True while nothing has been put in."""
        return self.min_x > self.max_x or self.min_y > self.max_y

    def including(self, x: float, y: float) -> Bounds:
        """Grown to hold the point (m)."""
        return Bounds(min(self.min_x, x), min(self.min_y, y), max(self.max_x, x), max(self.max_y, y))

    def union(self, other: Bounds) -> Bounds:
        """Grown to hold `other`."""
        return Bounds(
            min(self.min_x, other.min_x),
            min(self.min_y, other.min_y),
            max(self.max_x, other.max_x),
            max(self.max_y, other.max_y),
        )

    def grown(self, margin: float) -> Bounds:
        """Grown by `margin` (m) to every side."""
        return Bounds(self.min_x - margin, self.min_y - margin, self.max_x + margin, self.max_y + margin)


class Window(NamedTuple):
    """A rectangle of cells, half open: `x0 <= ix < x1`, `y0 <= iy < y1`."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def is_empty(self) -> bool:
        """True when no cell is inside."""
        return self.x0 >= self.x1 or self.y0 >= self.y1

    @property
    def slices(self) -> tuple[slice, slice]:
        """To index an `[iy, ix]` array."""
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
            raise ValueError(f"resolution must be a positive number of metres per cell, not {self.resolution}")
        if self.nx < 1 or self.ny < 1:
            raise ValueError(f"a grid has at least one cell in each direction, not {self.nx} x {self.ny}")

    @property
    def shape(self) -> tuple[int, int]:
        """(ny, nx), the shape of its arrays."""
        return self.ny, self.nx

    @property
    def width_m(self) -> float:
        """Extent along x, metres."""
        return self.nx * self.resolution

    @property
    def height_m(self) -> float:
        """Extent along y, metres."""
        return self.ny * self.resolution

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """(left, right, bottom, top) in metres, as matplotlib's imshow takes it."""
        return self.origin_x, self.origin_x + self.width_m, self.origin_y, self.origin_y + self.height_m

    @property
    def window(self) -> Window:
        """All cells."""
        return Window(0, 0, self.nx, self.ny)

    def world_to_cell(self, x: float, y: float) -> tuple[int, int] | None:
        """(ix, iy) of the cell that holds the point (m), None when it lies outside or is not finite."""
        if not (math.isfinite(x) and math.isfinite(y)) or x < self.origin_x or y < self.origin_y:
            return None
        fx = (x - self.origin_x) / self.resolution
        fy = (y - self.origin_y) / self.resolution
        if fx >= self.nx or fy >= self.ny:
            return None
        return int(fx), int(fy)

    def world_to_cell_unbounded(self, x: float, y: float) -> tuple[int, int]:
        """(ix, iy) of the cell that would hold the point (m) if the grid went on for ever."""
        return math.floor((x - self.origin_x) / self.resolution), math.floor((y - self.origin_y) / self.resolution)

    def cell_to_world(self, ix: int, iy: int) -> tuple[float, float]:
        """World coordinates (m) of the centre of a cell."""
        return self.origin_x + (ix + 0.5) * self.resolution, self.origin_y + (iy + 0.5) * self.resolution

    def contains_cell(self, ix: int, iy: int) -> bool:
        """True for a cell of this grid."""
        return 0 <= ix < self.nx and 0 <= iy < self.ny

    def window_of(self, bounds: Bounds) -> Window:
        """The cells that `bounds` (m) touches, clipped to the grid; from the cell of the minimum to that of the maximum."""
        if bounds.is_empty:
            return Window(0, 0, 0, 0)
        x0, y0 = self._clipped(bounds.min_x, bounds.min_y)
        x1, y1 = self._clipped(bounds.max_x, bounds.max_y)
        return Window(x0, y0, min(x1 + 1, self.nx), min(y1 + 1, self.ny))

    def _clipped(self, x: float, y: float) -> tuple[int, int]:
        fx = (x - self.origin_x) / self.resolution
        fy = (y - self.origin_y) / self.resolution
        ix = 0 if fx < 0.0 else self.nx - 1 if fx >= self.nx else int(fx)
        iy = 0 if fy < 0.0 else self.ny - 1 if fy >= self.ny else int(fy)
        return ix, iy

    def moved_to(self, origin_x: float, origin_y: float) -> GridGeometry:
        """The same grid with its corner elsewhere."""
        return GridGeometry(self.nx, self.ny, self.resolution, origin_x, origin_y)


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """What map_server publishes: `data` (ny, nx) int8, 0 free .. 100 occupied, -1 unknown, in `frame`.

    `origin_yaw` (rad) turns the grid about its lower left corner; costmap_2d ignores it, the static layer of navstack
    looks cells up through it.
    """

    data: NDArray[np.int8]
    geometry: GridGeometry
    origin_yaw: float = 0.0
    frame: str = "map"


class Costmap:
    """Costs `data` (ny, nx) uint8 at `geometry` in `frame`. The array may be written to; the geometry may be replaced."""

    __slots__ = ("data", "frame", "geometry")

    def __init__(self, geometry: GridGeometry, data: NDArray[np.uint8] | None = None, frame: str = "map") -> None:
        if data is None:
            data = np.zeros(geometry.shape, np.uint8)
        if data.shape != geometry.shape or data.dtype != np.uint8:
            raise ValueError(
                f"costs must be uint8 of shape {geometry.shape} (ny, nx), not {data.dtype} of shape {data.shape}"
            )
        self.geometry = geometry
        self.data = data
        self.frame = frame

    def cost_at(self, x: float, y: float) -> int | None:
        """Cost of the cell at a world point (m), None outside."""
        cell = self.geometry.world_to_cell(x, y)
        return None if cell is None else int(self.data[cell[1], cell[0]])

    def copy(self) -> Costmap:
        """An independent copy."""
        return Costmap(self.geometry, self.data.copy(), self.frame)

"""A map prepared for matching scans: distance field, free cells, bounds of the global search."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid, Transform2D
from navstack.core.errors import MapError
from navstack.localization._search_kernels import STRIDE, block_maxima

OCCUPIED: Final = 65
"""From this occupancy on, a cell is an obstacle (map_server's occupied_thresh)."""

MAX_DISTANCE: Final = 2.0
"""The distance field ends here (m)."""


class MatchMap:
    """A map for matching. Poses and points are in the grid frame: x along the columns, origin in the corner of cell (0, 0)."""

    def __init__(self, grid: OccupancyGrid, *, search_resolution: float = 0.1, reach: float = 30.0) -> None:
        """`search_resolution`: cells of the global search, at least those of the map (m); `reach`: of its beams (m).

        Raises MapError for a map without obstacles or without free cells.
        """
        from scipy.ndimage import distance_transform_edt  # slow import

        g = grid.geometry
        occupied = np.asarray(grid.data >= OCCUPIED)
        self.free: NDArray[np.bool_] = np.asarray(grid.data == 0)
        for cells, name in ((occupied, "obstacle"), (self.free, "free cell")):
            if not cells.any():
                raise MapError(
                    f"the map has no {name}, so no scan can be matched with it; check negate and the thresholds of its YAML file"
                )
        self.grid = grid
        self.resolution = g.resolution
        self.frame = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
        """Pose of the grid frame in the map frame."""
        distance: Any = distance_transform_edt(~occupied)
        self.field: NDArray[np.float32] = np.minimum(distance * g.resolution, MAX_DISTANCE).astype(np.float32)
        """(ny, nx) distance of each cell to the nearest obstacle, centre to centre (m), at most MAX_DISTANCE."""
        self.reach = reach
        self._occupied = occupied
        self._factor = max(1, math.floor(search_resolution / g.resolution + 1e-6))

    def to_grid(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses (n, 3) of the map frame in the grid frame."""
        return self.frame.inverse().apply_poses(poses)

    def to_map(self, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return poses (n, 3) of the grid frame in the map frame."""
        return self.frame.apply_poses(poses)

    @cached_property
    def likely(self) -> NDArray[np.float32]:
        """(ny, nx) likelihood of a beam's end in each cell, 1 at an obstacle."""
        sigma = max(SIGMA_M, self.resolution)
        return np.exp(-0.5 * (self.field / np.float32(sigma)) ** 2)

    @cached_property
    def pyramid(self) -> SearchField:
        """The field of the global search."""
        n = self._factor
        return SearchField(_any(self._occupied, n), _any(self.free, n), n * self.resolution, self.reach)


class SearchField:
    """Likelihoods (uint8) at the resolution of the search, with empty cells around them, and their maxima by blocks."""

    def __init__(self, occupied: NDArray[np.bool_], free: NDArray[np.bool_], resolution: float, reach: float) -> None:
        """`occupied`, `free` (ny, nx): cells of `resolution` (m); `reach`: greatest length of a beam (m)."""
        from scipy.ndimage import distance_transform_edt  # slow import

        self.resolution = resolution
        sigma = max(SIGMA_M, self.resolution)
        distance: Any = distance_transform_edt(~occupied)
        field = np.round(255.0 * np.exp(-0.5 * (distance * self.resolution / sigma) ** 2)).astype(np.uint8)
        ny, nx = field.shape
        rows, columns = -(-ny // STRIDE), -(-nx // STRIDE)
        diagonal = math.hypot(*field.shape) * self.resolution
        self.reach = min(reach, diagonal)
        self.pad = (math.ceil(self.reach / self.resolution) // STRIDE + 3) * STRIDE
        self.padded: NDArray[np.uint8] = np.zeros(
            (rows * STRIDE + 2 * self.pad, columns * STRIDE + 2 * self.pad), np.uint8
        )
        self.padded[self.pad : self.pad + ny, self.pad : self.pad + nx] = field
        self.phases = block_maxima(self.padded)
        self.free = (free & ~occupied).astype(np.uint8)
        blocks = np.zeros((rows * STRIDE, columns * STRIDE), np.uint8)
        blocks[:ny, :nx] = self.free
        self.has_free: NDArray[np.uint8] = np.ascontiguousarray(
            blocks.reshape(rows, STRIDE, columns, STRIDE).max(axis=(1, 3))
        )


SIGMA_M: Final = 0.2
"""Width of the likelihood in the search (m): twice the cells of 0.1 m, so that a pose between two cells keeps its score."""


def _any(cells: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Return the cells at a resolution coarser by `factor`: true where one of them is."""
    if factor == 1:
        return cells
    ny, nx = (-(-n // factor) for n in cells.shape)
    padded = np.zeros((ny * factor, nx * factor), np.bool_)
    padded[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(np.any(padded.reshape(ny, factor, nx, factor), axis=(1, 3)))

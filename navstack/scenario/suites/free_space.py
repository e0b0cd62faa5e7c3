"""The free space of a map: where a robot fits, by connected region."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid, Pose2D
from navstack.sim.world import OCCUPIED


class FreeSpace:
    """The free cells of a map at least `clearance_m` from every occupied cell, by 8-connected region."""

    def __init__(self, grid: OccupancyGrid, clearance_m: float) -> None:
        from scipy import ndimage

        self._geometry = grid.geometry
        resolution = grid.geometry.resolution
        # distances are between centres: half a cell's diagonal is subtracted to be safe
        cells: Any = ndimage.distance_transform_edt(grid.data < OCCUPIED)
        distance = cells * resolution - 0.71 * resolution
        free = (distance >= clearance_m) & (grid.data == 0)
        labelled: Any = ndimage.label(free, np.ones((3, 3)))
        labels, count = labelled
        sizes = np.bincount(labels.ravel(), minlength=count + 1)[1:]
        self._regions: list[NDArray[np.int64]] = []
        """Cells (n, 2) ix, iy of each region, the largest region first."""
        for label in np.argsort(-sizes, kind="stable").tolist():
            iy, ix = np.nonzero(labels == label + 1)
            self._regions.append(np.column_stack((ix, iy)))

    @property
    def is_empty(self) -> bool:
        """True if the robot fits nowhere."""
        return not self._regions

    def draw(self, rng: np.random.Generator, region: int = 0) -> Pose2D:
        """Draws a pose with any yaw in a region; 0 is the largest."""
        cells = self._regions[region]
        ix, iy = cells[int(rng.integers(len(cells)))].tolist()
        x, y = self._geometry.cell_to_world(ix, iy)
        return Pose2D(round(x, 3), round(y, 3), round(rng.uniform(-math.pi, math.pi), 4))

    def draw_pair(
        self, rng: np.random.Generator, min_distance_m: float, max_distance_m: float, *, across: bool = False
    ) -> tuple[Pose2D, Pose2D]:
        """Draws two poses within a range of Euclidean distance; after 100 failed attempts, the last two drawn.

        Both are in the largest region; with `across`, in two different regions if there are several.
        """
        sizes = np.array([len(cells) for cells in self._regions])
        shares = sizes / sizes.sum()
        start = goal = self.draw(rng)
        for _ in range(100):
            first = second = 0
            if across and len(self._regions) > 1:
                first, second = rng.choice(len(sizes), 2, replace=False, p=shares).tolist()
            start, goal = self.draw(rng, first), self.draw(rng, second)
            if min_distance_m <= start.distance_to(goal) <= max_distance_m:
                break
        return start, goal

"""Distance grids over the local costmap (base_local_planner's MapGrid)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D
from navstack.core.grid import grid_record
from navstack.interfaces import DistanceGrid, RolloutCells, Rollouts, ScoringContext
from navstack.local_planner._map_grid_kernels import (
    SEEDS,
    STEPPED_BACK,
    centre_scores,
    nose_scores,
    start_wavefront,
    storage_size,
    whole_grid,
)


@dataclass(slots=True, eq=False)
class MapGrid(DistanceGrid):
    """Breadth-first distances (cells) to a plan, or to its last cell inside the window."""

    storage: NDArray[np.int32]
    """State, distances and queue of the wavefront: see `_map_grid_kernels`."""
    grid: NDArray[Any]
    """(1,) geometry: see `grid_record`."""

    @property
    def seeds(self) -> int:
        """Cells the wavefront started from; 0 if no part of the plan is inside the window."""
        return int(self.storage[SEEDS])

    @property
    def stepped_back(self) -> int:
        """Blocked cells of the plan that the target was moved back over."""
        return int(self.storage[STEPPED_BACK])

    def values(self) -> NDArray[np.float64]:
        """(ny, nx) as in C++: distance, nx*ny in obstacles next to reached cells, nx*ny + 1 where unreachable."""
        out = np.empty((int(self.grid[0]["ny"]), int(self.grid[0]["nx"])))
        whole_grid(self.grid, self.storage, out)
        return out

    def at_centre(self, rollouts: Rollouts, cells: RolloutCells, out: NDArray[np.float64]) -> NDArray[np.float64]:
        """(K,) value at each rollout's last point; -4 if a point is off the map, -3 in an obstacle, -2 unreachable.

        `out` (K,) is written where the rollout is alive, and returned.
        """
        centre_scores(self.grid, self.storage, cells.padded, rollouts.counts, rollouts.alive, out)
        return out

    def at_nose(
        self, rollouts: Rollouts, cells: RolloutCells, ahead: float, out: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(K,) value `ahead` metres in front of each rollout's last point; -4 if this point is ever off the map."""
        nose_scores(self.grid, self.storage, rollouts.poses, rollouts.counts, cells.boxes, rollouts.alive, ahead, out)
        return out


class MapGridBuilder:
    """Builds one grid per cycle in memory that it reuses."""

    def __init__(self) -> None:
        self._storage = np.empty(0, np.int32)

    def build(
        self,
        costmap: Costmap,
        plan: NDArray[np.float64],
        near: Pose2D,
        *,
        last_only: bool,
        step_back: bool = False,
    ) -> MapGrid:
        """Grid of distances to `plan` (n, 3), or with `last_only` to its last cell inside the window.

        `near`: where the grid will be read; it is computed from the target towards there. With `step_back` a blocked last
        cell is replaced by the last free one before it.
        """
        g = costmap.geometry
        size = storage_size(g.nx, g.ny)
        if len(self._storage) != size:
            self._storage = np.empty(size, np.int32)
        grid = grid_record(g)
        start_wavefront(costmap.data, grid, plan, last_only, step_back, float(near.x), float(near.y), self._storage)
        return MapGrid(self._storage, grid)


def shared_path_grid(context: ScoringContext, builder: MapGridBuilder) -> DistanceGrid:
    """Grid of distances to the plan: built for the first critic that needs it, then shared."""
    if context.path_grid is None:
        context.path_grid = builder.build(context.costmap, context.plan, context.state.pose, last_only=False)
    return context.path_grid

"""Distance grids over the local costmap, shared by the critics of one cycle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D
from navstack.interfaces import Rollouts, ScoringContext
from navstack.local_planner._map_grid_kernels import (
    BLOCKED,
    WAVE_SIZE,
    center_scores,
    nose_scores,
    queue_length,
    run_wave,
    start_wave,
)
from navstack.local_planner.rollouts import RolloutCells


@dataclass(slots=True, eq=False)
class MapGrid:
    """Breadth-first distances (cells) to a plan, or to its last cell in the window."""

    distances: NDArray[np.int32]
    """Flat, with a ring of one cell around the costmap's (see `_grid_kernels`); as far as the wave has come."""
    queue: NDArray[np.int32]
    wave: NDArray[np.int64]
    costmap: Costmap
    start: NDArray[np.int64]
    """(2,) `seeds` and `stepped_back`."""

    @property
    def seeds(self) -> int:
        """Cells the wave started from; 0: nothing of the plan lies in the window."""
        return int(self.start[0])

    @property
    def stepped_back(self) -> int:
        """Blocked cells of the plan that the goal was moved back over (parity 27)."""
        return int(self.start[1])

    def values(self) -> NDArray[np.float64]:
        """(ny, nx) as C++ holds them: distance, nx*ny in an obstacle that was touched, nx*ny + 1 not reached."""
        g = self.costmap.geometry
        end = (g.nx + 2) * (g.ny + 2)
        run_wave(self.distances, self.queue, self.wave, end, g.nx + 2)
        d = self.distances[:end].reshape(g.ny + 2, g.nx + 2)
        reached = d >= 0
        beside = np.zeros_like(reached)
        beside[1:-1] = reached[:-2] | reached[2:]
        beside[:, 1:-1] |= reached[:, :-2] | reached[:, 2:]
        out = np.where(reached, d, np.where((d == BLOCKED) & beside, g.nx * g.ny, g.nx * g.ny + 1))
        return out[1:-1, 1:-1].astype(np.float64)

    def at_center(
        self, rollouts: Rollouts, cells: RolloutCells, alive: NDArray[np.bool_], out: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """(K,) value at each trajectory's last point; -4, -3, -2 where one is off the map, in an obstacle, not reached.

        `cells`: those of the rollouts on this costmap. `out` (K,) is written where `alive`, and returned.
        """
        g = self.costmap.geometry
        center_scores(self.distances, self.queue, self.wave, g.nx, g.ny, cells.ringed, rollouts.counts, alive, out)
        return out

    def at_nose(
        self,
        rollouts: Rollouts,
        cells: RolloutCells,
        alive: NDArray[np.bool_],
        ahead: float,
        out: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """(K,) value `ahead` metres before each trajectory's last point; -4 for a nose that leaves the map on the way."""
        g = self.costmap.geometry
        nose_scores(
            self.distances,
            self.queue,
            self.wave,
            g.nx,
            g.ny,
            g.origin_x,
            g.origin_y,
            g.resolution,
            rollouts.poses,
            rollouts.counts,
            cells.boxes,
            alive,
            ahead,
            out,
        )
        return out


class MapGridBuilder:
    """Memory for one grid, kept from cycle to cycle."""

    def __init__(self) -> None:
        self._distances = np.empty(0, np.int32)
        self._queue = np.empty(0, np.int32)

    def build(
        self,
        costmap: Costmap,
        plan: NDArray[np.float64],
        near: Pose2D,
        *,
        last_only: bool,
        step_back: bool = False,
    ) -> MapGrid:
        """The grid of distances to `plan` (n, 3), or to its last cell inside the window.

        `near`: about where it will be looked up, which is where it is computed first.
        """
        g = costmap.geometry
        size = (g.nx + 2) * (g.ny + 2)
        if len(self._distances) != size + 1:
            self._distances = np.empty(size + 1, np.int32)
            self._queue = np.empty(queue_length(size), np.int32)
        wave = np.empty(WAVE_SIZE, np.int64)
        start = start_wave(
            costmap.data,
            g.origin_x,
            g.origin_y,
            g.resolution,
            plan,
            last_only,
            step_back,
            near.x,
            near.y,
            self._distances,
            self._queue,
            wave,
        )
        return MapGrid(self._distances, self._queue, wave, costmap, np.array(start))


def shared_path_grid(context: ScoringContext, buffer: MapGridBuilder) -> MapGrid:
    """The grid of distances to the plan: built by the first critic that asks, used by the others."""
    grid = context.shared.get("path_grid")
    if grid is None:
        grid = context.shared["path_grid"] = buffer.build(
            context.costmap, context.plan, context.state.pose, last_only=False
        )
    return grid

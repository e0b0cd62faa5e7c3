"""Base of the four critics that read distances from a grid."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Critic, DistanceGrid, Rollouts, ScoringContext
from navstack.local_planner.map_grid import MapGridBuilder
from navstack.local_planner.rollouts import shared_cells

CENTRE_CODES = {
    -2: "passes a cell from which its target cannot be reached",
    -3: "passes an obstacle cell",
    -4: "leaves the map",
}
NOSE_CODES = {-4: "its nose leaves the map"}


class MapGridCritic(Critic):
    """Distance (cells, around obstacles) to a target from a rollout's last point, or from the nose at that point."""

    def __init__(self, name: str, params: object, *, ahead: float | None = None) -> None:
        """`ahead`: distance of the nose from the centre (m); None uses the centre, which must stay off obstacles."""
        super().__init__(name, params)
        self._ahead = ahead
        self._scale = 0.0
        self._builder = MapGridBuilder()
        self._out = np.empty(0)
        self.context: ScoringContext | None = None
        self.grid: DistanceGrid | None = None

    @property
    def scale(self) -> float:
        """Weight of a cell in the last prepared cycle."""
        return self._scale

    @abstractmethod
    def weight(self, context: ScoringContext) -> float:
        """Weight of a cell in this cycle."""

    @abstractmethod
    def build(self, context: ScoringContext) -> DistanceGrid:
        """Build the grid of distances to the target."""

    def prepare(self, context: ScoringContext) -> None:
        """Build the grid."""
        self.set_grid(context, self.weight(context), self.build(context))

    def set_grid(self, context: ScoringContext, scale: float, grid: DistanceGrid) -> None:
        """Set weight and grid of this cycle."""
        self.context, self._scale, self.grid = context, scale, grid

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) cells; -4 off the map. At the centre also -2 and -3; at the nose nx*ny and more if unreachable."""
        if self.grid is None or self.context is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        cells = shared_cells(self.context, rollouts)
        if self._ahead is None:
            return self.grid.at_centre(rollouts, cells, self._out)
        return self.grid.at_nose(rollouts, cells, self._ahead, self._out)

    def grid_values(self) -> NDArray[np.float64] | None:
        """(ny, nx) distances to the target."""
        return None if self.grid is None else self.grid.values()

"""What the four critics that look a distance up in a grid have in common."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.map_grid import MapGrid, MapGridBuilder
from navstack.local_planner.rollouts import shared_cells

CENTER_CODES = {
    -2: "passes a cell from which its target cannot be reached",
    -3: "passes an obstacle cell",
    -4: "leaves the map",
}
NOSE_CODES = {-4: "its nose leaves the map"}


class MapGridCritic(Critic):
    """Distance (cells, around obstacles) from a trajectory's last point, or the nose there, to a target."""

    def __init__(self, name: str, params: object, *, ahead: float | None = None) -> None:
        """`ahead`: where the nose is (m before the centre); None looks from the centre, and keeps it off obstacles."""
        super().__init__(name, params)
        self._ahead = ahead
        self._scale = 0.0
        self._buffer = MapGridBuilder()
        self._out = np.empty(0)
        self._context: ScoringContext | None = None
        self.grid: MapGrid | None = None

    @property
    def scale(self) -> float:
        """Weight of a cell in the last cycle that was prepared."""
        return self._scale

    @abstractmethod
    def weight(self, context: ScoringContext) -> float:
        """Weight of a cell in this cycle."""

    @abstractmethod
    def build(self, context: ScoringContext) -> MapGrid:
        """The grid of distances to the target."""

    def prepare(self, context: ScoringContext) -> None:
        """Builds the grid."""
        self.take(context, self.weight(context), self.build(context))

    def take(self, context: ScoringContext, scale: float, grid: MapGrid) -> None:
        """This cycle's weight and grid."""
        self._context, self._scale, self.grid = context, scale, grid

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) cells; -4 off the map. From the centre also -2 and -3; at the nose nx*ny and more where no way leads."""
        if self.grid is None or self._context is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        cells = shared_cells(self._context, rollouts)
        if self._ahead is None:
            return self.grid.at_center(rollouts, cells, alive, self._out)
        return self.grid.at_nose(rollouts, cells, alive, self._ahead, self._out)

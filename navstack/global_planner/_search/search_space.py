"""The cells that a search may enter."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from navstack.core import Costmap
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.cost_interpreter import CostInterpreter


class SearchSpace(NamedTuple):
    """A costmap and which of its cells are blocked."""

    costmap: Costmap
    costs: CostInterpreter
    border_blocked: bool
    """Whether the outermost cells are blocked."""

    def is_blocked(self, cell: Cell) -> bool:
        """Whether paths may not enter the cell."""
        ix, iy = cell
        if self.border_blocked:
            ny, nx = self.costmap.data.shape
            if ix in (0, nx - 1) or iy in (0, ny - 1):
                return True
        return bool(self.costs.blocked[self.costmap.data[iy, ix]])

    def is_obstacle(self, cell: Cell) -> bool:
        """Whether the cell is blocked because of its cost."""
        return bool(self.costs.blocked[self.costmap.data[cell[1], cell[0]]])

    def nearest_free(self, cell: Cell) -> tuple[Cell, float] | None:
        """The free cell whose centre is nearest to that of `cell`, and the distance (m); None if no cell is free."""
        ix, iy = cell
        border = 1 if self.border_blocked else 0
        nx, ny = self.costmap.geometry.nx, self.costmap.geometry.ny
        reach = 8
        while True:
            x0, x1 = max(border, ix - reach), min(nx - border, ix + reach + 1)
            y0, y1 = max(border, iy - reach), min(ny - border, iy + reach + 1)
            if x0 < x1 and y0 < y1:
                ys, xs = np.nonzero(~self.costs.blocked[self.costmap.data[y0:y1, x0:x1]])
                if len(xs):
                    squared = (xs + (x0 - ix)) ** 2 + (ys + (y0 - iy)) ** 2
                    best = int(np.argmin(squared))
                    # a cell outside the square may be nearer than a cell in its corner
                    if squared[best] <= reach * reach or reach >= max(nx, ny):
                        found = int(xs[best]) + x0, int(ys[best]) + y0
                        return found, math.sqrt(int(squared[best])) * self.costmap.geometry.resolution
            if reach >= max(nx, ny):
                return None
            reach *= 2

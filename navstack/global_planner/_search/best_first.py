"""Best-first searches over a costmap, and their arrays, which are reused from query to query."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Window
from navstack.global_planner._search import _search_kernels as kernels
from navstack.global_planner._search.cells import Cell, union
from navstack.global_planner._search.cost_interpreter import CellCosts

UNLIMITED: Final = 1 << 62
_MAX_STEP: Final = math.sqrt(2.0)
_EMPTY: Final = Window(0, 0, 0, 0)


class BestFirst:
    """Searches over one costmap at a time, which are never written to.

    Memory: 9 bytes per cell, allocated once per size of costmap and accessed only where a search expands. 8 are for costs
    (`octile`: a float64; `any_angle`: a float32 and the number of the parent cell, in the same memory, whose second half is
    therefore 0 between searches), and 1 marks the cells for which the costs of `octile` are valid.
    """

    def __init__(self, costs: CellCosts, *, heuristic_weight: float = 1.0, cut_corners: bool = False) -> None:
        self._costs = costs
        self._cut_corners = int(cut_corners)
        self._scale = heuristic_weight * costs.least
        self._delta = 0.5 * costs.least
        highest = float(costs.weights[np.isfinite(costs.weights)].max(initial=costs.least))
        # as many buckets as one step can span
        self._heads = np.empty(math.ceil(_MAX_STEP * (highest + self._scale) / self._delta) + 4, np.int64)
        self._shape = (0, 0)
        self._g64 = np.zeros(0)
        self._steps = np.zeros(0, np.uint8)
        self._settings = np.zeros(1, kernels.SETTINGS)
        self._window: NDArray[np.int64] = self._settings["window"][0]
        self._is_any_angle = False
        self._written = _EMPTY  # where octile searches left costs

    @property
    def window(self) -> Window:
        """Contains all cells that the last search read."""
        return Window(*self._window.tolist())

    @property
    def expanded(self) -> int:
        """Number of cells that the last search expanded."""
        return int(self._settings["expanded"][0])

    @property
    def is_exhausted(self) -> bool:
        """Whether the last search ended because of `max_expanded`."""
        return bool(self._settings["exhausted"][0])

    def octile(self, costmap: Costmap, start: Cell, goal: Cell, *, max_expanded: int = UNLIMITED) -> bool:
        """Search over the 8 neighbours of each cell; return whether the goal was reached."""
        self._prepare(costmap)
        self._is_any_angle = False
        reached = self._search(costmap, start, goal, max_expanded, math.inf)
        self._written = union(self._written, self.window)
        return reached

    def any_angle(
        self,
        costmap: Costmap,
        start: Cell,
        goal: Cell,
        *,
        max_expanded: int = UNLIMITED,
        upper_bound: float = math.inf,
    ) -> bool:
        """Search over straight lines; return whether the goal was reached for a cost below `upper_bound`."""
        self._prepare(costmap)
        self._is_any_angle = True
        self._g64.reshape(self._shape)[self._written.slices] = 0.0
        self._written = _EMPTY
        return self._search(costmap, start, goal, max_expanded, upper_bound)

    def path(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells (ix, iy) from start to a goal that `octile` reached."""
        nx = self._shape[1]
        return self._cells(kernels.octile_path(self._steps, nx, self._number(start), self._number(goal)))

    def corners(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells (ix, iy) of the corners of the path to a goal that `any_angle` reached."""
        parent = self._parent
        k, first = self._number(goal), self._number(start)
        found = [k]
        while k != first:
            k = abs(int(parent[k])) - 1
            found.append(k)
        return self._cells(np.array(found[::-1], np.int64))

    def pull_tight(self, costmap: Costmap, cells: NDArray[np.int64]) -> tuple[NDArray[np.int64], float]:
        """Replace the detours of a path of cells (n, 2) by straight lines that cost no more: the corners (m, 2) and the cost."""
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        nx = costmap.data.shape[1]
        numbers = np.ascontiguousarray(cells[:, 1] * nx + cells[:, 0])
        first = int(numbers[0])
        kept, total = kernels.pull_tight(
            cost, self._costs.weights, self._start_weight(cost, first), first, nx, numbers, self._cut_corners
        )
        return self._cells(kept), float(total)

    def cost_of(self, cell: Cell) -> float:
        """Least cost from the start to a cell, inf if the search did not reach it."""
        x0, y0, x1, y1 = self._window.tolist()
        if not (x0 <= cell[0] < x1 and y0 <= cell[1] < y1):
            return math.inf
        k = self._number(cell)
        return float(self._g[k]) if self._reached[k] else math.inf

    def potential(self) -> NDArray[np.float32]:
        """(ny, nx) the costs, inf where not reached."""
        out = np.full(self._shape, np.inf, np.float32)
        part = self.window.slices
        out[part] = np.where(self._reached.reshape(self._shape)[part] != 0, self._g.reshape(self._shape)[part], np.inf)
        return out

    def nearest_reached(self, cell: Cell) -> Cell:
        """The reached cell whose centre is nearest to that of `cell`; ties go to the first in row order."""
        window = self.window
        ys, xs = np.nonzero(self._reached.reshape(self._shape)[window.slices])
        best = int(np.argmin((xs + (window.x0 - cell[0])) ** 2 + (ys + (window.y0 - cell[1])) ** 2))
        return int(xs[best]) + window.x0, int(ys[best]) + window.y0

    @property
    def _g32(self) -> NDArray[np.float32]:
        return self._g64.view(np.float32)[: self._g64.size]

    @property
    def _parent(self) -> NDArray[np.int32]:
        return self._g64.view(np.int32)[self._g64.size :]

    @property
    def _g(self) -> NDArray[np.float64] | NDArray[np.float32]:
        return self._g32 if self._is_any_angle else self._g64

    @property
    def _reached(self) -> NDArray[np.uint8] | NDArray[np.int32]:
        return self._parent if self._is_any_angle else self._steps

    def _number(self, cell: Cell) -> int:
        return cell[1] * self._shape[1] + cell[0]

    def _cells(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        nx = self._shape[1]
        return np.column_stack([numbers % nx, numbers // nx])

    def _start_weight(self, cost: NDArray[np.uint8], start: int) -> float:
        """The weight of the start cell, which counts as free if it is blocked."""
        weight = float(self._costs.weights[cost[start]])
        return weight if weight < math.inf else self._costs.least

    def _prepare(self, costmap: Costmap) -> None:
        """Clear what the last search wrote, or allocate the arrays."""
        if costmap.data.shape == self._shape:
            self._reached.reshape(self._shape)[self.window.slices] = 0
            return
        ny, nx = costmap.data.shape
        self._shape = ny, nx
        self._g64 = np.zeros(ny * nx)
        self._steps = np.zeros(ny * nx, np.uint8)
        self._written = _EMPTY

    def _search(self, costmap: Costmap, start: Cell, goal: Cell, max_expanded: int, upper_bound: float) -> bool:
        """Run the search that `_is_any_angle` selects."""
        ny, nx = self._shape
        first, last = self._number(start), self._number(goal)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        limits = first, last, self._is_any_angle, self._cut_corners, max_expanded
        scales = self._start_weight(cost, first), self._scale, self._delta, upper_bound
        self._settings[0] = (nx, ny, *limits, *scales, (0, 0, 0, 0), 0, 0)
        kernels.search(cost, self._costs.weights, self._heads, self._g, self._reached, self._settings)
        return bool(self._reached[last] != 0)

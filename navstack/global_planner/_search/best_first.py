"""Best-first searches over a costmap, and their arrays, which are reused from query to query."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Window
from navstack.global_planner._search import _any_angle_kernels as line_kernels
from navstack.global_planner._search import _search_kernels as kernels
from navstack.global_planner._search.cells import Cell, union
from navstack.global_planner._search.cost_interpreter import CellCosts

UNLIMITED: Final = 1 << 62
_MAX_STEP: Final = math.sqrt(2.0)
_BUCKET: Final = 0.5  # width of a bucket of `octile`, in least weights
_LINE_BUCKET: Final = (
    0.2  # of `any_angle`, whose cells are expanded again less often if the order is closer to the costs
)
_EMPTY: Final = Window(0, 0, 0, 0)


class BestFirst:
    """Searches over one costmap at a time, which are never written to.

    Memory: 9 bytes per cell, allocated once per size of costmap and accessed only where a search expands. 8 are for costs
    (`octile`: a float64; `any_angle`: a float32 and the number of the parent cell, in the same memory, whose second half is
    therefore 0 between searches). 1 marks the cells for which the costs of `octile` are valid, and after `prepare_lines`
    contains the clearance instead. Straight lines take another 4 bytes per cell, for the costs that remain to the goal.
    """

    def __init__(self, costs: CellCosts, *, heuristic_weight: float = 1.0, cut_corners: bool = False) -> None:
        self._costs = costs
        self._cut_corners = int(cut_corners)
        self._scale = heuristic_weight * costs.least
        self._is_exact = heuristic_weight <= 1.0
        self._heads = np.empty(self._buckets(_BUCKET), np.int64)
        self._line_heads = np.empty(0, np.int64)
        self._shape = (0, 0)
        self._g64 = np.zeros(0)
        self._steps = np.zeros(0, np.uint8)
        self._settings = np.zeros(1, kernels.SETTINGS)
        self._window: NDArray[np.int64] = self._settings["window"][0]
        self._remaining = np.zeros(0, np.float32)
        self._total = 0.0  # cost of the path of `octile`, if `_remaining` is valid
        self._is_any_angle = False
        self._bounded = _EMPTY  # where `_remaining` is not 0
        self._written = _EMPTY  # where octile searches left costs
        self._marked = _EMPTY  # where `_steps` is not 0

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
        self._marked = self.window
        return reached

    def prepare_lines(self, costmap: Costmap, *, from_goal: bool) -> None:
        """Prepare `pull_tight` and `any_angle`, after `octile`, whose path is no longer available afterwards.

        Measures how far the cells that `octile` read are from more expensive ones: straight lines take less time. If `octile`
        searched from the goal to the start (`from_goal`), its costs bound what remains from a cell: `any_angle` expands fewer.
        """
        nx = self._shape[1]
        if self._remaining.size != self._steps.size:
            self._remaining, self._bounded = np.zeros(self._steps.size, np.float32), _EMPTY
        self._remaining.reshape(self._shape)[self._bounded.slices] = 0.0
        window = np.array(self._marked, np.int64)
        self._bounded, self._total = _EMPTY, 0.0
        if from_goal and self._is_exact:
            line_kernels.remaining_costs(self._g64, self._steps, nx, window, self._remaining)
            self._bounded, self._total = self._marked, float(self._g64[self._settings["goal"][0]])
        self._steps.reshape(self._shape)[self._marked.slices] = 0
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        line_kernels.measure_clearance(cost, self._costs.weights, self._costs.least, nx, window, self._steps)

    def any_angle(
        self,
        costmap: Costmap,
        start: Cell,
        goal: Cell,
        *,
        max_expanded: int = UNLIMITED,
        upper_bound: float = math.inf,
    ) -> bool:
        """Search over straight lines; return whether the goal was reached for a cost below `upper_bound`.

        Requires `octile` and `prepare_lines` on the same costmap.
        """
        self._is_any_angle = True
        if self._line_heads.size == 0:
            self._line_heads = np.empty(self._buckets(_LINE_BUCKET), np.int64)
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
        """Replace the detours of a path of cells (n, 2) by straight lines that cost no more: the corners (m, 2) and the cost.

        The path must start where the last search started. Requires `prepare_lines`.
        """
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        numbers = np.ascontiguousarray(cells[:, 1] * self._shape[1] + cells[:, 0])
        kept, total = line_kernels.pull_tight(cost, self._costs.weights, self._steps, numbers, self._settings)
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

    def _buckets(self, width: float) -> int:
        """As many buckets of this width, in least weights, as one step can span."""
        highest = float(self._costs.weights[np.isfinite(self._costs.weights)].max(initial=self._costs.least))
        return math.ceil(_MAX_STEP * (highest + self._scale) / (width * self._costs.least)) + 4

    def _prepare(self, costmap: Costmap) -> None:
        """Clear what the last searches wrote, or allocate the arrays."""
        if costmap.data.shape == self._shape:
            self._steps.reshape(self._shape)[self._marked.slices] = 0
            if self._is_any_angle:
                self._parent.reshape(self._shape)[self.window.slices] = 0
            return
        ny, nx = costmap.data.shape
        self._shape = ny, nx
        self._g64 = np.zeros(ny * nx)
        self._steps = np.zeros(ny * nx, np.uint8)
        self._written = self._marked = _EMPTY

    def _search(self, costmap: Costmap, start: Cell, goal: Cell, max_expanded: int, upper_bound: float) -> bool:
        """Run the search that `_is_any_angle` selects."""
        ny, nx = self._shape
        first, last = self._number(start), self._number(goal)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        weights, least = self._costs.weights, self._costs.least
        delta = least * (_LINE_BUCKET if self._is_any_angle else _BUCKET)
        limits = first, last, self._cut_corners, max_expanded
        scales = self._start_weight(cost, first), least, self._scale, delta, upper_bound, self._total
        self._settings[0] = (nx, ny, *limits, *scales, (0, 0, 0, 0), 0, 0)
        if self._is_any_angle:
            g, parent = self._g32, self._parent
            line_kernels.search_any_angle(
                cost, weights, self._steps, self._remaining, self._line_heads, g, parent, self._settings
            )
        else:
            kernels.search(cost, weights, self._heads, self._g64, self._steps, self._settings)
        return bool(self._reached[last] != 0)

"""The searches of astar and theta_star, and the arrays they live in, kept from query to query."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap
from navstack.global_planner import _search_kernels as kernels

Cell = tuple[int, int]
Rectangle = tuple[int, int, int, int]
EVERYTHING: Final = 1 << 62
_SPREAD: Final = math.sqrt(2.0)


class Weights(NamedTuple):
    """What a unit of length costs in a cell."""

    table: NDArray[np.float64]
    """(256,) by the cell's byte, inf where blocked."""
    least: float
    """The least of them; also what the start's cell costs when it is blocked."""


class CellSearch:
    """Searches over one costmap at a time; costmaps are read, never written to.

    9 bytes a cell, allocated once per size of costmap and touched only where a search comes: 8 for costs (`octile`: a float64;
    `any_angle`: a float32 and the number of the cell it is entered from, in the same memory, whose second half is therefore 0
    whenever no search has anything there), and 1 that tells which of `octile`'s mean something.
    """

    def __init__(self) -> None:
        self._shape = (0, 0)
        self._g = np.zeros(0)
        self._state = np.zeros(0, np.uint8)
        self._record = np.zeros(kernels.RECORD_SIZE, np.int64)
        self._is_any_angle = False
        self._unclean = (0, 0, 0, 0)  # where octile searches left costs
        self.expanded = 0

    @property
    def rectangle(self) -> Rectangle:
        """(x0, y0, x1, y1): all cells that the last search looked at lie inside."""
        x0, y0, x1, y1 = self._record[:4].tolist()
        return x0, y0, x1, y1

    @property
    def is_exhausted(self) -> bool:
        """True when the last search ended because it had expanded as many cells as it may."""
        return bool(self._record[kernels.GAVE_UP])

    def octile(
        self,
        costmap: Costmap,
        weights: Weights,
        start: Cell,
        goal: Cell,
        *,
        heuristic: float = 1.0,
        cut_corners: bool = False,
        most: int = EVERYTHING,
    ) -> bool:
        """The 8-connected search, which expands at most `most` cells; True when the goal was reached."""
        cost, nx, ny = self._begin(costmap)
        self._is_any_angle = False
        scale, delta, heads = _buckets(weights, heuristic)
        s, t = start[1] * nx + start[0], goal[1] * nx + goal[0]
        own = _own(cost, weights, s)
        self.expanded = kernels.octile_search(
            cost,
            weights.table,
            own,
            nx,
            ny,
            s,
            t,
            scale,
            delta,
            heads,
            int(cut_corners),
            most,
            self._g,
            self._state,
            self._record,
        )
        self._unclean = union(self._unclean, self.rectangle)
        return bool(self._state[t] != 0)

    def path(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells ix, iy from start to a goal that `octile` reached."""
        nx = self._shape[1]
        cells = kernels.octile_path(self._state, nx, start[1] * nx + start[0], goal[1] * nx + goal[0])
        return np.column_stack([cells % nx, cells // nx])

    def any_angle(
        self,
        costmap: Costmap,
        weights: Weights,
        start: Cell,
        goal: Cell,
        *,
        heuristic: float = 1.0,
        cut_corners: bool = False,
        most: int = EVERYTHING,
        below: float = math.inf,
    ) -> bool:
        """The any-angle search, which expands at most `most` cells; True when it reached the goal for less than `below`."""
        cost, nx, ny = self._begin(costmap)
        self._is_any_angle = True
        x0, y0, x1, y1 = self._unclean
        self._g.reshape(ny, nx)[y0:y1, x0:x1] = 0.0
        self._unclean = (0, 0, 0, 0)
        scale, delta, heads = _buckets(weights, heuristic)
        s, t = start[1] * nx + start[0], goal[1] * nx + goal[0]
        g, parent = self._g32, self._parent
        own = _own(cost, weights, s)
        self.expanded = kernels.any_angle_search(
            cost,
            weights.table,
            own,
            nx,
            ny,
            s,
            t,
            scale,
            delta,
            heads,
            int(cut_corners),
            most,
            below,
            g,
            parent,
            self._record,
        )
        return bool(parent[t] != 0)

    def corners(self, start: Cell, goal: Cell) -> NDArray[np.int64]:
        """(n, 2) the cells ix, iy between which the path to a goal that `any_angle` reached runs straight."""
        nx = self._shape[1]
        parent = self._parent
        k, s = goal[1] * nx + goal[0], start[1] * nx + start[0]
        cells = [k]
        while k != s:
            k = abs(int(parent[k])) - 1
            cells.append(k)
        found = np.array(cells[::-1], np.int64)
        return np.column_stack([found % nx, found // nx])

    def pulled_tight(
        self, costmap: Costmap, weights: Weights, cells: NDArray[np.int64], *, cut_corners: bool = False
    ) -> tuple[NDArray[np.int64], float]:
        """The corners (n, 2) that are left of a path of cells (n, 2) when straight lines that cost no more replace its detours.

        And what that costs.
        """
        nx = costmap.data.shape[1]
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        numbers = cells[:, 1] * nx + cells[:, 0]
        s = int(numbers[0])
        kept, total = kernels.pull_tight(
            cost, weights.table, _own(cost, weights, s), s, nx, np.ascontiguousarray(numbers), int(cut_corners)
        )
        return np.column_stack([kept % nx, kept // nx]), float(total)

    def cost_of(self, cell: Cell) -> float:
        """Least cost from the start to a cell, inf where the search did not come."""
        x0, y0, x1, y1 = self.rectangle
        if not (x0 <= cell[0] < x1 and y0 <= cell[1] < y1):
            return math.inf
        k = cell[1] * self._shape[1] + cell[0]
        return float(self._costs[k]) if self._reached[k] else math.inf

    def potential(self) -> NDArray[np.float32]:
        """(ny, nx) the costs, inf where the search did not come."""
        ny, nx = self._shape
        out = np.full((ny, nx), np.inf, np.float32)
        x0, y0, x1, y1 = self.rectangle
        g, known = self._costs.reshape(ny, nx)[y0:y1, x0:x1], self._reached.reshape(ny, nx)[y0:y1, x0:x1] != 0
        out[y0:y1, x0:x1] = np.where(known, g, np.inf)
        return out

    def nearest_reached(self, cell: Cell) -> Cell:
        """The cell with a cost whose centre is nearest to that of `cell`; the first in reading order on a tie."""
        ny, nx = self._shape
        x0, y0, x1, y1 = self.rectangle
        ys, xs = np.nonzero(self._reached.reshape(ny, nx)[y0:y1, x0:x1])
        best = int(np.argmin((xs + (x0 - cell[0])) ** 2 + (ys + (y0 - cell[1])) ** 2))
        return int(xs[best]) + x0, int(ys[best]) + y0

    @property
    def _g32(self) -> NDArray[np.float32]:
        return self._g.view(np.float32)[: self._g.size]

    @property
    def _parent(self) -> NDArray[np.int32]:
        return self._g.view(np.int32)[self._g.size :]

    @property
    def _costs(self) -> NDArray[np.float64] | NDArray[np.float32]:
        return self._g32 if self._is_any_angle else self._g

    @property
    def _reached(self) -> NDArray[np.uint8] | NDArray[np.int32]:
        return self._parent if self._is_any_angle else self._state

    def _begin(self, costmap: Costmap) -> tuple[NDArray[np.uint8], int, int]:
        """Forgets the last search: clears what it wrote to."""
        ny, nx = costmap.data.shape
        if (ny, nx) != self._shape:
            self._shape = ny, nx
            self._g = np.zeros(ny * nx)
            self._state = np.zeros(ny * nx, np.uint8)
            self._unclean = (0, 0, 0, 0)
        else:
            x0, y0, x1, y1 = self.rectangle
            self._reached.reshape(ny, nx)[y0:y1, x0:x1] = 0
        self._record[:] = 0
        return np.ascontiguousarray(costmap.data).reshape(-1), nx, ny


def union(a: Rectangle, b: Rectangle) -> Rectangle:
    """The least rectangle (x0, y0, x1, y1) around two."""
    if a[0] == a[2]:
        return b
    if b[0] == b[2]:
        return a
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _own(cost: NDArray[np.uint8], weights: Weights, start: int) -> float:
    """The weight of the start's cell: it counts as free when it is blocked."""
    own = float(weights.table[cost[start]])
    return own if own < math.inf else weights.least


def _buckets(weights: Weights, heuristic: float) -> tuple[float, float, NDArray[np.int64]]:
    """The heuristic's scale, the width of a bucket, and as many buckets as one step can span."""
    scale = heuristic * weights.least
    delta = 0.5 * weights.least
    dearest = float(weights.table[np.isfinite(weights.table)].max(initial=weights.least))
    return scale, delta, np.empty(math.ceil(_SPREAD * (dearest + scale) / delta) + 4, np.int64)

"""Propagations: where a wave starts, what it must reach, and the runs of one query."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Pose2D
from navstack.global_planner._search.cells import (
    NAVFN_NEUTRAL,
    Cell,
    WaveCosts,
    order_independent,
    position_in_cells,
    start_fronts,
)
from navstack.global_planner._search.wavefront import Guide, Wavefront

NAVFN_RISE: Final = 2.0 * NAVFN_NEUTRAL  # navfn.cpp, priInc
_NAVFN_THRESHOLD: Final = 254.0  # navfn.h, COST_OBS
_EPSILON: Final = 1e-9
_GOAL_REACH: Final = 2  # planner_core.cpp, clearEndpoint


class WaveQuery(NamedTuple):
    """The query of one wave."""

    grid: Costmap
    costs: WaveCosts
    start: Pose2D
    start_cell: Cell
    goal: Pose2D
    """The preferred goal."""
    goal_cell: Cell

    def costs_for(self, guide: Guide | None) -> WaveCosts:
        """The costs as in C++, or the order-independent ones if the guide requires it."""
        return order_independent(self.costs) if guide is not None and guide.order_independent else self.costs


class Propagation(ABC):
    """How a wave is started and when it has reached the goal."""

    rise: float
    """Increment of the threshold; two free cells."""

    @abstractmethod
    def propagate(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Run the wave from the start until it reaches the goal. A plan's potential is copied after this."""

    @abstractmethod
    def complete(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Continue until the potential suffices for the traceback."""


def propagate_navfn(
    wave: Wavefront,
    costmap: Costmap,
    costs: WaveCosts,
    *,
    root: Cell,
    target: Cell,
    stop: bool = True,
    guide: Guide | None = None,
) -> None:
    """Run the wave from the cell `root` until it reaches `target`, or with `stop` false over all cells (calcNavFnDijkstra)."""
    wave.begin_at(costmap, costs, root, target, threshold=_NAVFN_THRESHOLD, rise=NAVFN_RISE)
    wave.run(target if stop else None, guide=guide)


class NavfnPropagation(Propagation):
    """navfn: from the start cell."""

    rise = NAVFN_RISE

    def propagate(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Run the wave; with a guide, until the goal has its final potential."""
        costs, root, target = query.costs_for(guide), query.start_cell, query.goal_cell
        propagate_navfn(wave, query.grid, costs, root=root, target=target, guide=guide)
        if guide is not None:
            wave.settle(target, guide)

    def complete(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Do nothing: the traceback needs no other cells."""


class StraightAStarPropagation(NavfnPropagation):
    """A* of Nav2's navfn: as navfn, but the straight distance to the goal is added before cells are sorted into the lists.

    It stops at the first arrival, with potentials that no later list lowers: paths may cost more than those of Dijkstra.
    """

    def propagate(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Run the wave to the goal; it takes no guide."""
        assert guide is None
        root, (x, y) = query.start_cell, query.goal_cell
        first = np.float32(
            np.float32(math.hypot(root[0] - x, root[1] - y) * NAVFN_NEUTRAL) + np.float32(_NAVFN_THRESHOLD)
        )
        wave.begin_at(query.grid, query.costs, root, (x, y), threshold=float(first), rise=NAVFN_RISE)
        wave.aim_at((x, y), NAVFN_NEUTRAL)
        wave.run((x, y))


class SubcellPropagation(Propagation):
    """global_planner: from the four cells around the start, seeded by their distance to it.

    `at_cells`: from the start cell, as with `old_navfn_behavior`. `complete_goal`: compute the potential around the goal,
    which the gradient of a path that ends between cells needs.
    """

    def __init__(self, *, threshold: float, neutral: float, at_cells: bool, complete_goal: bool) -> None:
        self.rise = 2.0 * neutral
        self._threshold = threshold
        self._at_cells = at_cells
        self._complete_goal = complete_goal

    def propagate(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Run the wave to the cell where C++ stops (DijkstraExpansion::calculatePotentials)."""
        seeds, fronts = self._seeds(query)
        stop = self._stop_cell(query)
        wave.begin(query.grid, query.costs_for(guide), seeds, fronts, stop, threshold=self._threshold, rise=self.rise)
        wave.run_to(stop, guide=guide)

    def complete(self, wave: Wavefront, query: WaveQuery, guide: Guide | None) -> None:
        """Continue to the cell of the goal, which is at most one cell further."""
        if wave.potential_of(*self._stop_cell(query)) == math.inf:
            return
        # without a guide in the order of C++; with one, completed cells come last, because they are not queued and would
        # hide the cells behind them from a wave that continues
        if guide is None and self._complete_goal:
            wave.complete(query.goal_cell, _GOAL_REACH)
        wave.run_to(query.goal_cell, guide=guide)
        if guide is not None:
            wave.settle(query.goal_cell, guide)
            if self._complete_goal:
                wave.complete(query.goal_cell, _GOAL_REACH)

    def _stop_cell(self, query: WaveQuery) -> Cell:
        """The cell at which C++ stops (parity 12), or the goal cell if that one is blocked."""
        if self._at_cells:
            return query.goal_cell
        gx, gy = position_in_cells(query.grid.geometry, query.goal)
        stop = math.floor(gx + _EPSILON), math.floor(gy + _EPSILON)
        return stop if _is_free(query, stop) else query.goal_cell

    def _seeds(self, query: WaveQuery) -> tuple[list[tuple[Cell, float]], list[Cell]]:
        """The seeds and the cells to queue first.

        # ROS differs: next to an obstacle the start cell is the only seed; C++ seeds through the obstacle.
        """
        if not self._at_cells:
            square = _cells_around(*position_in_cells(query.grid.geometry, query.start))
            if all(cell == query.start_cell or _is_free(query, cell) for cell, _ in square):
                return [(cell, self.rise * share) for cell, share in square], _fronts_around(*square[0][0])
        return [(query.start_cell, 0.0)], start_fronts(query.start_cell)


def _is_free(query: WaveQuery, cell: Cell) -> bool:
    """Whether a wave may enter the cell; it may not enter the outermost ring."""
    ix, iy = cell
    g = query.grid.geometry
    inner = 0 < ix < g.nx - 1 and 0 < iy < g.ny - 1
    return inner and not query.costs.blocked[query.grid.data[iy, ix]]


def _cells_around(fx: float, fy: float) -> list[tuple[Cell, float]]:
    """The four cells around a position in cells, and the share of each."""
    # rounded to hundredths of a cell, as in C++, before taking the cell, so that a rounding error does not change the cell
    hx, hy = math.floor(fx * 100.0 + 0.5), math.floor(fy * 100.0 + 0.5)
    ix, iy = hx // 100, hy // 100
    dx, dy = (hx % 100) / 100.0, (hy % 100) / 100.0
    return [
        ((ix, iy), dx * dy),
        ((ix + 1, iy), (1.0 - dx) * dy),
        ((ix, iy + 1), dx * (1.0 - dy)),
        ((ix + 1, iy + 1), (1.0 - dx) * (1.0 - dy)),
    ]


def _fronts_around(ix: int, iy: int) -> list[Cell]:
    """The eight cells next to the 2 x 2 cells from (ix, iy), in the order of C++."""
    return [
        (ix + 2, iy),
        (ix - 1, iy),
        (ix - 1, iy + 1),
        (ix + 2, iy + 1),
        (ix, iy - 1),
        (ix + 1, iy - 1),
        (ix, iy + 2),
        (ix + 1, iy + 2),
    ]


class SearchExhausted(Exception):
    """The wave lowered as many potentials as it may without reaching any acceptable goal."""


class WaveRun:
    """The runs of a wave for one query: without a guide, or with several guides one after the other."""

    def __init__(
        self,
        wave: Wavefront,
        propagation: Propagation,
        query: WaveQuery,
        *,
        goals: Sequence[tuple[Pose2D, Cell]] = (),
        keep_potential: bool = False,
    ) -> None:
        self.wave = wave
        self.propagation = propagation
        self.query = query
        self.potential: NDArray[np.float32] | None = None
        """(ny, nx) potential of the last run, if it was requested."""
        self.is_guided = False
        """Whether the last run had a guide."""
        self._goals = goals or [(query.goal, query.goal_cell)]
        self._keep_potential = keep_potential

    def run(self, guide: Guide | None = None) -> float:
        """Run the wave from scratch and return the potential of the goal, inf if unreached.

        Raises SearchExhausted when it ended because of `Wavefront.max_expanded` and reached none of the goals.
        """
        wave, query = self.wave, self.query
        self.is_guided = guide is not None
        self.propagation.propagate(wave, query, guide)
        self.potential = wave.full_potential() if self._keep_potential else None
        self.propagation.complete(wave, query, guide)
        found = wave.potential_of(*query.goal_cell)
        if found == math.inf and wave.is_exhausted:
            found = min(wave.potential_of(*cell) for _, cell in self._goals)
            if found == math.inf:
                raise SearchExhausted
        return found

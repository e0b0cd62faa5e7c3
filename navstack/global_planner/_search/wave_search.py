"""Searches that propagate a potential from the start and descend it from the goal (navfn, global_planner)."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, GridGeometry
from navstack.global_planner._search import wavefront as kernels
from navstack.global_planner._search.base import Query, Route, Search, Unreachable
from navstack.global_planner._search.best_first import UNLIMITED
from navstack.global_planner._search.cells import Cell, WaveCosts, wave_costs
from navstack.global_planner._search.propagation import Propagation, SearchExhausted, WaveQuery, WaveRun
from navstack.global_planner._search.traceback import Traceback
from navstack.global_planner._search.wavefront import Guide, Wavefront

# ----------------------------------------------------------------------------------------------------------------------
# Replanning to the same goal, guided by a potential from the goal that is kept between plans.
#
# A robot replans to the same goal about once per second, from a slightly different pose. `GoalPotential` restricts the planner's
# own wave, which comes from the start, to the cells through which a path can be nearly as good as the best. The result is the
# same as without a guide, so it does not depend on the history of the potential; that only affects how many cells are expanded:
#
# - cells that became more expensive leave the potential too low, which is still a bound: more cells are expanded;
# - cells that became cheaper are updated at once, by a wave from them (it can only lower potentials);
# - a guide that was misleading several times in a row (too many cells expanded), or with which no path was found, is rebuilt.


WORTHWHILE_CELLS: Final = 30_000
"""Potentials lowered by the last wave above which a guide pays (about 1 ms). Below, every plan is computed as in C++, to the
bit: a guided wave may differ from it by a rounding error, which can decide on which side a robot passes an obstacle."""
NEAR_RISES: Final = 50.0
"""Estimate, in rises of the threshold (two free cells each), below which a plan is computed from scratch: it is fast too."""
_FACTORS: Final = (1.005, 1.1)
"""Factors on the estimate that limit the wave in the first and second attempt; a slack is added, see `_slack`."""
_MARGIN_FACTOR: Final = 2.0
_MARGIN_STEPS: Final = 2.5
"""How far the limit must be above the result: this multiple of the error of the estimate, but at most so many steps into the most
expensive cell. Where costs are rough the two potentials disagree, and a cell that is not on the path may still lower a cell that
is: then the wave runs again, with that margin and with order-independent costs."""
_GOAL_EXTENT_RISES: Final = 8.0
_MAX_MISLEADING: Final = 3
"""Plans in a row with a potential far too low, after which it is rebuilt."""
_MAX_CHANGES: Final = 0.05
"""Share of the cells that may change before the potential is rebuilt."""


class GoalPotential:
    """The potential from a goal, updated as the costmap changes."""

    def __init__(self) -> None:
        self._key: tuple[Cell, GridGeometry, WaveCosts] | None = None
        self._effort = 0
        self._is_built = False
        self._misleading = 0
        self._wave = Wavefront()
        self._costmap: Costmap | None = None
        self._is_current = False

    @property
    def costs(self) -> NDArray[np.uint8] | None:
        """(ny, nx) the copy of the costs of the last search that the potential needs anyway; None if it made no copy."""
        return self._costmap.data if self._costmap is not None and self._is_current else None

    def search(self, run: WaveRun) -> bool:
        """Run the wave with the potential as a guide; return False if there is no potential, or no path was found with it.

        The caller then runs the wave another way and calls `record_effort`.
        """
        query, rise = run.query, run.propagation.rise
        self._is_current = False
        self._select(query)
        is_blocked = query.costs.blocked[query.grid.data[query.start_cell[1], query.start_cell[0]]]
        if self._effort <= WORTHWHILE_CELLS or is_blocked:
            return False
        estimate = self._estimate(query, rise)
        if not NEAR_RISES * rise <= estimate < math.inf:
            return False
        for factor in _FACTORS:
            limit = factor * estimate + _slack(estimate, rise)
            found = run.run(Guide(self._wave.pot, 0, limit))
            if found < math.inf:
                was_good = factor == _FACTORS[0] and run.wave.expanded <= max(WORTHWHILE_CELLS, self._effort // 2)
                sufficient = found + min(_MARGIN_FACTOR * (found - estimate), _MARGIN_STEPS * query.costs.largest)
                if limit < sufficient:
                    run.run(Guide(self._wave.pot, 0, sufficient, order_independent=True))
                self._misleading = 0 if was_good else self._misleading + 1
                self._is_built = self._misleading < _MAX_MISLEADING
                return True
        self._is_built = False
        return False

    def record_effort(self, expanded: int) -> None:
        """Store how many potentials a wave without this guide lowered: replanning is guided if that is worthwhile."""
        self._effort = max(self._effort, expanded)

    def _select(self, query: WaveQuery) -> None:
        """Discard the potential if the goal, the grid or the costs are new."""
        key = query.goal_cell, query.grid.geometry, query.costs
        if self._key is None or self._key[:2] != key[:2] or self._key[2] is not key[2]:
            self._key, self._effort, self._is_built = key, 0, False

    def _estimate(self, query: WaveQuery, rise: float) -> float:
        """Update the potential as far as the start and a margin beyond; return the potential there, inf if unreached."""
        wave, start = self._wave, query.start_cell
        if self._is_built:
            data = np.ascontiguousarray(query.grid.data).reshape(-1)
            self._is_built = wave.revise(data, most=int(_MAX_CHANGES * data.size), rise=rise)
        if not self._is_built:
            self._costmap = query.grid.copy()
            wave.begin_at(
                self._costmap, query.costs, query.goal_cell, start, threshold=2.0 * rise, rise=rise, whole=True
            )
            self._is_built, self._misleading = True, 0
        self._is_current = True
        wave.run_to(start)
        estimate = wave.potential_of(*start)
        if estimate < math.inf:
            wave.run(last=estimate + _GOAL_EXTENT_RISES * rise)
        return estimate


def _slack(estimate: float, rise: float) -> float:
    """By how much, in potential, the wave may exceed the estimate times its factor.

    The two potentials disagree by up to a few cells around their roots, where a wave is not plane yet. That matters for a
    short path, for which a wide limit costs little; for a long path the factor covers it.
    """
    return rise * max(2.0, 6.0 - estimate / (50.0 * rise))


# ----------------------------------------------------------------------------------------------------------------------
# A* for waves: the heuristic is a potential over a coarse costmap.


_SHIFT: Final = 2  # squares of 4 x 4 cells, as in coarsen()
_SIDE: Final = 1 << _SHIFT
_SLACK_RISES: Final = 6.0
_WIDENING: Final = (1.06, 1.2)
_EXTENT: Final = 1.15
_EXTENT_RISES: Final = 16.0


def _coarse_costs(quadratic: bool) -> WaveCosts:
    bytes_ = np.arange(256)
    return wave_costs((bytes_ * float(_SIDE)).astype(np.float32), bytes_ == 0, quadratic=quadratic)


_COARSE_COSTS: Final = {q: _coarse_costs(q) for q in (True, False)}


class CoarseHeuristic:
    """The potential from the target over squares of 4 x 4 cells, where each square costs as much as its cheapest cell.

    It underestimates the remaining cost by up to the size of a square at either end, which the slack covers. The guided wave
    is therefore an A* whose heuristic takes walls into account. A wall thinner than a square may be missed, which costs time
    only.
    """

    def __init__(self) -> None:
        self._wave = Wavefront()
        self._cells = np.empty(0, np.uint8)

    def search(self, run: WaveRun) -> None:
        """Run the wave within a limit, raise the limit if it did not reach the goal, and at last run it without a limit.

        A result found within a limit is the best, because every cheaper path is within the limit too.
        """
        query = run.query
        rise = run.propagation.rise
        estimate = self.build(query.grid, query.costs, query.goal_cell, query.start_cell, rise)
        if estimate < math.inf:
            for factor in _WIDENING:
                if run.run(Guide(self._wave.pot, _SHIFT, factor * estimate + _SLACK_RISES * rise)) < math.inf:
                    return
        run.run()

    def build(self, costmap: Costmap, costs: WaveCosts, target: Cell, start: Cell, rise: float) -> float:
        """Compute the potential from `target` as far as a wave from `start` needs it; return the estimate, inf without a path."""
        ny, nx = costmap.data.shape
        coarse_nx, coarse_ny = ((nx - 1) >> _SHIFT) + 3, ((ny - 1) >> _SHIFT) + 3
        if self._cells.size != coarse_nx * coarse_ny:
            self._cells = np.empty(coarse_nx * coarse_ny, np.uint8)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        kernels.coarsen(cost, costs.steps, costs.weights, nx, ny, self._cells)
        cells = self._cells.reshape(coarse_ny, coarse_nx)
        (tx, ty), (sx, sy) = (((x >> _SHIFT) + 1, (y >> _SHIFT) + 1) for x, y in (target, start))
        cells[sy, sx] = cells[sy, sx] or 1  # the start cell counts as free
        wave = self._wave
        wave.begin_at(
            Costmap(GridGeometry(coarse_nx, coarse_ny, 1.0), cells),
            _COARSE_COSTS[costs.quadratic],
            (tx, ty),
            (sx, sy),
            threshold=2.0 * rise * _SIDE,
            rise=rise * _SIDE,
            whole=True,
        )
        wave.run((sx, sy))
        estimate = wave.potential_of(sx, sy)
        if estimate < math.inf:
            # continue until it covers all cells that a wave may need that takes a tenth more
            wave.run(last=_EXTENT * estimate + _EXTENT_RISES * rise)
        return estimate


class WaveSearch(Search):
    """A wave of these costs, started by a propagation, and the path that a traceback finds in its potential.

    `use_astar`: guide the wave by a coarse heuristic. `keep_potential`: return the potential with every plan. `guided`: guide
    replanning to the same goal by a potential that is kept.
    """

    def __init__(
        self,
        costs: WaveCosts,
        propagation: Propagation,
        traceback: Traceback,
        *,
        use_astar: bool = False,
        border_blocked: bool = True,
        max_expanded: int = UNLIMITED,
        keep_potential: bool = False,
        guided: bool = True,
    ) -> None:
        super().__init__(costs, border_blocked=border_blocked)
        self._wave_costs = costs
        self._propagation = propagation
        self._traceback = traceback
        self._keep_potential = keep_potential
        self._heuristic = CoarseHeuristic() if use_astar else None
        self._goal_potential = GoalPotential()
        self._guided = guided
        self.wave = Wavefront()
        self.wave.max_expanded = max_expanded

    def reset(self) -> None:
        """Discard the potential that guides replanning."""
        self._goal_potential = GoalPotential()

    def find(self, query: Query, goal_cell: Cell) -> Route | Unreachable:
        """The path to the first reachable goal."""
        # a wave does not enter the outermost cells: if they are not blocked, it runs on a larger grid
        pad = 0 if self.border_blocked else 1
        grid = _padded(query.space.costmap) if pad else query.space.costmap
        goals = [(pose, (ix + 1, iy + 1)) for pose, (ix, iy) in query.goals] if pad else query.goals
        start_cell = query.start_cell[0] + pad, query.start_cell[1] + pad
        run = WaveRun(
            self.wave,
            self._propagation,
            WaveQuery(grid, self._wave_costs, query.start, start_cell, *goals[0]),
            goals=goals,
            keep_potential=query.keep_potential or self._keep_potential,
        )
        try:
            self._run(run)
        except SearchExhausted:
            return self._unreachable(goal_cell, pad, is_exhausted=True)
        reached = next((g for g in goals if self.wave.potential_of(*g[1]) < math.inf), None)
        if reached is None:
            return self._unreachable(goal_cell, pad, is_exhausted=False)
        goal, cell = reached
        cost = self.wave.potential_of(*cell)
        potential = run.potential
        if potential is not None:
            potential[cell[1], cell[0]] = cost
            if pad:
                potential = np.ascontiguousarray(potential[1:-1, 1:-1])
        return Route(
            goal=goal,
            cost=cost,
            # without a guide potential and path are those of C++, including its loops
            points=self._traceback.points(self.wave, run.query, goal, cell, keep_loops=not run.is_guided),
            expanded=self.wave.expanded,
            potential=potential,
            # without a guide a wave reads every cell that can affect it; with one, other cells may become relevant
            window=None if run.is_guided or pad else self.wave.window,
            snapshot=None if pad else self._goal_potential.costs,
        )

    def _run(self, run: WaveRun) -> None:
        """Run the wave: guided by the potential of earlier plans, as A*, or as Dijkstra."""
        if self._guided and self._goal_potential.search(run):
            return
        if self._heuristic is None:
            run.run()
        else:
            self._heuristic.search(run)
        self._goal_potential.record_effort(self.wave.expanded)

    def _unreachable(self, goal_cell: Cell, pad: int, *, is_exhausted: bool) -> Unreachable:
        ix, iy = self.wave.nearest_reached(goal_cell[0] + pad, goal_cell[1] + pad)
        return Unreachable((ix - pad, iy - pad), self.wave.expanded, is_exhausted, self.wave.expanded > 0)


def _padded(costmap: Costmap) -> Costmap:
    """A copy with an additional border of lethal cells."""
    g = costmap.geometry
    larger = GridGeometry(g.nx + 2, g.ny + 2, g.resolution, g.origin_x - g.resolution, g.origin_y - g.resolution)
    return Costmap(larger, np.pad(costmap.data, 1, constant_values=LETHAL), costmap.frame)

"""Searches that propagate a potential from the start and descend it from the goal (navfn, global_planner)."""

from __future__ import annotations

import math

import numpy as np

from navstack.core import LETHAL, Costmap, GridGeometry
from navstack.global_planner._search.base import Query, Route, Search, Unreachable
from navstack.global_planner._search.best_first import UNLIMITED
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.coarse_heuristic import CoarseHeuristic
from navstack.global_planner._search.cost_interpreter import WaveCosts
from navstack.global_planner._search.goal_potential import GoalPotential
from navstack.global_planner._search.propagation import Propagation, SearchExhausted, WaveQuery, WaveRun
from navstack.global_planner._search.traceback import Traceback
from navstack.global_planner._search.wavefront import Wavefront


class WaveSearch(Search):
    """A wave of these costs, started by a propagation, and the path that a traceback finds in its potential.

    `use_astar`: guide the wave by a coarse heuristic. `keep_potential`: return the potential with every plan.
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
    ) -> None:
        super().__init__(costs, border_blocked=border_blocked)
        self._wave_costs = costs
        self._propagation = propagation
        self._traceback = traceback
        self._keep_potential = keep_potential
        self._heuristic = CoarseHeuristic() if use_astar else None
        self._goal_potential = GoalPotential()
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
        goals = [(pose, (ix + pad, iy + pad)) for pose, (ix, iy) in query.goals]
        start_cell = query.start_cell[0] + pad, query.start_cell[1] + pad
        run = WaveRun(
            self.wave,
            self._propagation,
            WaveQuery(grid, self._wave_costs, query.start, start_cell, *goals[0]),
            goal_cells=[cell for _, cell in goals],
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
        if self._goal_potential.search(run):
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

"""A* for waves: the heuristic is a potential over a coarse costmap."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from navstack.core import Costmap, GridGeometry
from navstack.global_planner._search import _wavefront_kernels as kernels
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.cost_interpreter import WaveCosts, wave_costs
from navstack.global_planner._search.propagation import WaveRun
from navstack.global_planner._search.wavefront import Guide, Wavefront

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

"""What is known of the way before it is searched: a coarse look at the map, or the potential of the last plan."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from navstack.core import Costmap, GridGeometry
from navstack.global_planner import _kernels as kernels
from navstack.global_planner.cost_rule import CostRule, rule_of
from navstack.global_planner.wavefront import Guide, Wavefront

Cell = tuple[int, int]
_SHIFT: Final = 2  # squares of 4 x 4 cells, as coarsen() makes them
_SLACK_RISES: Final = 6.0
_WIDEN: Final = (1.06, 1.2)


def _coarse_rule(quadratic: bool) -> CostRule:
    bytes_ = np.arange(256)
    return rule_of((bytes_ * 2.0**_SHIFT).astype(np.float32), bytes_ == 0, 1.0, quadratic, True)


_COARSE_RULES: Final = {q: _coarse_rule(q) for q in (True, False)}


class CoarseGuide:
    """The potential from the target over squares of 4 x 4 cells, each as cheap as its cheapest cell.

    It underestimates what is left, up to the size of a square at either end, which `slack` covers: so what it guides
    is an A*, with a heuristic that sees walls. (A wall thinner than a square it may see through, which costs time only.)
    """

    def __init__(self) -> None:
        self._wave = Wavefront()
        self._cells = np.empty(0, np.uint8)

    def build(
        self, costmap: Costmap, rule: CostRule, target: Cell, other: Cell, rise: float
    ) -> tuple[Guide, float] | None:
        """The guide toward `target`, far enough for a wave from `other`; and its estimate of the whole. None: no way."""
        ny, nx = costmap.data.shape
        gnx, gny = ((nx - 1) >> _SHIFT) + 3, ((ny - 1) >> _SHIFT) + 3
        if self._cells.size != gnx * gny:
            self._cells = np.empty(gnx * gny, np.uint8)
        cost = np.ascontiguousarray(costmap.data).reshape(-1)
        kernels.coarsen(cost, rule.steps, rule.weights, nx, ny, self._cells)
        coarse = Costmap(GridGeometry(gnx, gny, 1.0), self._cells.reshape(gny, gnx))
        tx, ty = (target[0] >> _SHIFT) + 1, (target[1] >> _SHIFT) + 1
        ox, oy = (other[0] >> _SHIFT) + 1, (other[1] >> _SHIFT) + 1
        self._cells[oy * gnx + ox] = self._cells[oy * gnx + ox] or 1  # the start's own cell counts as free
        wave = self._wave
        wide = float(1 << _SHIFT)
        wave.begin(
            coarse,
            _COARSE_RULES[rule.quadratic],
            seeds=[(ty * gnx + tx, 0.0)],
            fronts=[(tx + 1, ty), (tx - 1, ty), (tx, ty - 1), (tx, ty + 1)],
            target=(ox, oy),
            threshold=2.0 * rise * wide,
            rise=rise * wide,
            whole=True,
        )
        wave.run(oy * gnx + ox)
        estimate = wave.potential_of(ox, oy)
        if estimate == math.inf:
            return None
        # and on until it covers what a wave may want that takes a tenth more
        wave.run(last=estimate * 1.15 + 16.0 * rise)
        return Guide(wave.pot, _SHIFT), estimate


def astar(
    coarse: CoarseGuide,
    costmap: Costmap,
    rule: CostRule,
    root: Cell,
    target: Cell,
    rise: float,
    attempt: Callable[[Guide | None, float], float],
) -> int:
    """A* by a guide: `attempt(guide, limit)` runs a wave from `root` and returns the potential of `target`.

    What it found within a limit is the best there is, since every cheaper path lies within that limit too; if it found
    nothing the limit is raised, and at last there is none. Returns the number of attempts.
    """
    found = coarse.build(costmap, rule, target, root, rise)
    attempts = 0
    if found is not None:
        guide, estimate = found
        slack = _SLACK_RISES * rise
        for widen in _WIDEN:
            attempts += 1
            if attempt(guide, widen * estimate + slack) < math.inf:
                return attempts
    attempt(None, math.inf)
    return attempts + 1

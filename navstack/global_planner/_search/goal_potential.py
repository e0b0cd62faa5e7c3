"""Replanning to the same goal, guided by a potential from the goal that is kept between plans.

A robot replans to the same goal about once per second, from a slightly different pose. `GoalPotential` restricts the planner's
own wave, which comes from the start, to the cells through which a path can be nearly as good as the best. The result is the
same as without a guide, so it does not depend on the history of the potential; that only affects how many cells are expanded:

- cells that became more expensive leave the potential too low, which is still a bound: more cells are expanded;
- cells that became cheaper are updated at once, by a wave from them (it can only lower potentials);
- a guide that was misleading several times in a row (too many cells expanded), or with which no path was found, is rebuilt.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.cost_interpreter import WaveCosts
from navstack.global_planner._search.plan_cache import CHUNK
from navstack.global_planner._search.propagation import WaveQuery, WaveRun
from navstack.global_planner._search.wavefront import Guide, Wavefront

WORTHWHILE_CELLS: Final = 30_000
"""Potentials lowered by the last wave above which a guide pays (about 1 ms). Below, every plan is computed as in C++, to the
bit: a guided wave may differ from it by a rounding error, which can decide on which side a robot passes an obstacle."""
NEAR_RISES: Final = 50.0
"""Estimate, in rises of the threshold (two free cells each), below which a plan is computed from scratch: it is fast too."""
_FACTORS: Final = (1.005, 1.1)
"""Factors on the estimate that limit the wave in the first and second attempt; a slack is added, see `_slack`."""
_MARGIN_FACTOR: Final = 2.0
_MARGIN_RISES: Final = 6.0
"""How far the limit must be above the result: this multiple of the error of the estimate, but at most so many rises. Where
costs are rough the two potentials disagree, and a cell that is not on the path may still lower a cell that is: then the wave
runs again, with that margin and with order-independent costs."""
_EXTENT_RISES: Final = 8.0
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
                sufficient = found + min(_MARGIN_FACTOR * (found - estimate), _MARGIN_RISES * rise)
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
            self._is_built = self._update(query.grid.data, query.costs, rise)
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
            wave.run(last=estimate + _EXTENT_RISES * rise)
        return estimate

    def _update(self, data: NDArray[np.uint8], costs: WaveCosts, rise: float) -> bool:
        """Apply the changes of the costmap; return False if so much changed that rebuilding is faster."""
        assert self._costmap is not None
        old, new = self._costmap.data.reshape(-1), data.reshape(-1)
        changed = _differing(old, new)
        if changed.size == 0:
            return True
        if changed.size > _MAX_CHANGES * old.size:
            return False
        before, after = old[changed], new[changed]
        old[changed] = after
        steps = np.where(costs.blocked, np.float32(np.inf), costs.steps)
        self._wave.revise(changed, cheaper=steps[after] < steps[before], rise=rise)
        return True


def _differing(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Indices where two arrays (n,) differ."""
    parts = [np.flatnonzero(a[i : i + CHUNK] != b[i : i + CHUNK]) + i for i in range(0, a.size, CHUNK)]
    return np.concatenate(parts)


def _slack(estimate: float, rise: float) -> float:
    """By how much, in potential, the wave may exceed the estimate times its factor.

    The two potentials disagree by up to a few cells around their roots, where a wave is not plane yet. That matters for a
    short path, for which a wide limit costs little; for a long path the factor covers it.
    """
    return rise * max(2.0, 6.0 - estimate / (50.0 * rise))

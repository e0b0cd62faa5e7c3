"""Planning to the same goal again: once a second a robot asks the same question from a little further on.

`Memory` hands out the last plan when nothing changed. `GoalField` keeps a potential from the goal between plans and lets it
guide the planner's own wave, which comes from the start: the wave then visits only cells through which a path can
come within a hair of the best. What it finds is what it would find without a guide, so nothing depends on how the
field came about; the field decides only how many cells are looked at:

- cells that became dearer leave the field too low, which is still a bound: more cells are looked at;
- cells that became cheaper are repaired at once, by a wave from them (it can only lower what it touches);
- a guide that misled a few times in a row (too many cells looked at) or altogether (no path) is built anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.global_planner.cost_rule import CostRule
from navstack.global_planner.wavefront import Guide, Wavefront
from navstack.interfaces import Plan

Cell = tuple[int, int]
_WORTHWHILE: Final = 30_000
"""Cells lowered by the last wave from which on a field pays (about 1 ms). Below, every plan is made as C++ makes it, to the bit:
what a guided wave finds may differ from it by a rounding, and a rounding decides which way round an obstacle a robot goes."""
_NEAR_RISES: Final = 50.0
"""Estimate, in rises of the threshold (two free cells each), under which a plan is made from scratch: it takes no time either."""
_FACTORS: Final = (1.005, 1.1)
"""Factor on the estimate within which the wave is kept, at first and then; with a slack on top, see `_slack`."""
_MARGIN_PART: Final = 2.0
_MARGIN_RISES: Final = 6.0
"""How far the limit must lie above what was found: so much of what the field was wrong by, so many rises at most. Where costs are
rough the two potentials disagree, and a cell that takes no part in the path may still lower one that does: then the wave runs
again, with that much room and with care (`cost_rule.careful`)."""
_BEYOND_RISES: Final = 8.0
_MISLED: Final = 3
"""Plans in a row for which the field was far too low, after which it is built anew."""
_MANY_CHANGES: Final = 0.05
"""Part of the cells that may change before the field is built anew."""
_AT_A_TIME: Final = 1 << 20
"""Cells compared at once: on a map of millions the array of their differences would count."""


class Request(NamedTuple):
    """What was asked for."""

    start: Pose2D
    goal: Pose2D
    geometry: GridGeometry
    frame: str
    keep_potential: bool
    footprint: Footprint | None


class Memory:
    """The last plan, handed out again as long as the request and every cell its wave looked at are the same."""

    def __init__(self) -> None:
        self._request: Request | None = None
        self._plan: Plan | None = None
        self._rectangle = (0, 0, 0, 0)
        self._seen = np.empty((0, 0), np.uint8)

    def recall(self, costmap: Costmap, request: Request) -> Plan | None:
        """The plan for this request; None when it must be made, and then what was remembered is forgotten."""
        if request == self._request:
            x0, y0, x1, y1 = self._rectangle
            if _are_equal(costmap.data[y0:y1, x0:x1], self._seen):
                return self._plan
        self._request, self._plan, self._seen = None, None, np.empty((0, 0), np.uint8)
        return None

    def remember(
        self,
        costmap: Costmap,
        request: Request,
        plan: Plan,
        rectangle: tuple[int, int, int, int],
        kept: NDArray[np.uint8] | None = None,
    ) -> None:
        """Keeps a plan, and the cells of `rectangle` = (x0, y0, x1, y1), all that its wave looked at.

        `kept`, unless None, is a copy of all costs that will not change before the next `recall`.
        """
        x0, y0, x1, y1 = rectangle
        plan.path.poses.setflags(write=False)  # it may be handed out twice
        self._request, self._plan, self._rectangle = request, plan, rectangle
        self._seen = costmap.data[y0:y1, x0:x1].copy() if kept is None else kept[y0:y1, x0:x1]


class GoalField:
    """The potential from a goal, kept up to date while the costmap changes."""

    def __init__(self) -> None:
        self._key: tuple[Cell, GridGeometry, CostRule] | None = None
        self._asked = 0
        self._built = False
        self._misled = 0
        self._wave = Wavefront()
        self._kept: Costmap | None = None
        self._is_current = False

    @property
    def kept(self) -> NDArray[np.uint8] | None:
        """(ny, nx) the copy of the costs of the last search that the field keeps anyway; None when it keeps none."""
        return self._kept.data if self._kept is not None and self._is_current else None

    def search(
        self,
        costmap: Costmap,
        rule: CostRule,
        start: Cell,
        goal: Cell,
        rise: float,
        attempt: Callable[[Guide | None, float], float],
        effort: Callable[[], int],
        otherwise: Callable[[], object],
    ) -> None:
        """Runs `attempt(guide, limit)`, which returns the goal's potential, until it succeeds; for first plans `otherwise()`.

        `effort()` tells how many cells the last attempt lowered.
        """
        self._is_current = False
        key = (goal, costmap.geometry, rule)
        if self._key is None or self._key[:2] != key[:2] or self._key[2] is not rule:
            self._key, self._asked, self._built = key, 0, False
        again = self._asked > _WORTHWHILE and not rule.blocked[costmap.data[start[1], start[0]]]
        estimate = self._estimate(costmap, rule, start, goal, rise) if again else math.inf
        if _NEAR_RISES * rise <= estimate < math.inf:
            guide = Guide(self._wave.pot, 0)
            for factor in _FACTORS:
                limit = factor * estimate + _slack(estimate, rise)
                found = attempt(guide, limit)
                if found < math.inf:
                    right = factor == _FACTORS[0] and effort() <= max(_WORTHWHILE, self._asked // 2)
                    enough = found + min(_MARGIN_PART * (found - estimate), _MARGIN_RISES * rise)
                    if limit < enough:
                        attempt(Guide(self._wave.pot, 0, careful=True), enough)
                    self._misled = 0 if right else self._misled + 1
                    self._built = self._misled < _MISLED
                    return
            self._built = False
        otherwise()
        self._asked = max(self._asked, effort())

    def _estimate(self, costmap: Costmap, rule: CostRule, start: Cell, goal: Cell, rise: float) -> float:
        """Brings the field up to date, as far as the start and a little beyond; the potential there, inf when unreached."""
        wave = self._wave
        if self._built:
            self._built = self._update(costmap.data, rule, rise)
        if not self._built:
            self._kept = costmap.copy()
            x, y = goal
            wave.begin(
                self._kept,
                rule,
                seeds=[(y * costmap.geometry.nx + x, 0.0)],
                fronts=[(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)],
                target=start,
                threshold=2.0 * rise,
                rise=rise,
                whole=True,
            )
            self._built, self._misled = True, 0
        self._is_current = True
        if wave.potential_of(*start) == math.inf:
            wave.run(start[1] * wave.nx + start[0])
        estimate = wave.potential_of(*start)
        if estimate < math.inf:
            wave.run(last=estimate + _BEYOND_RISES * rise)
        return estimate

    def _update(self, data: NDArray[np.uint8], rule: CostRule, rise: float) -> bool:
        """Takes over what changed since; False when the field is better built anew."""
        assert self._kept is not None
        kept, new = self._kept.data.reshape(-1), data.reshape(-1)
        changed = _differing(kept, new)
        if changed.size == 0:
            return True
        if changed.size > _MANY_CHANGES * kept.size:
            return False
        before, after = kept[changed], new[changed]
        kept[changed] = after
        price = np.where(rule.blocked, np.float32(np.inf), rule.steps)
        self._wave.revise(changed, cheaper=price[after] < price[before], rise=rise)
        return True


def _are_equal(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> bool:
    rows = max(1, _AT_A_TIME // max(1, a.shape[1]))
    return a.shape == b.shape and all(
        np.array_equal(a[y : y + rows], b[y : y + rows]) for y in range(0, a.shape[0], rows)
    )


def _differing(a: NDArray[np.uint8], b: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Where two arrays (n,) differ."""
    parts = [np.flatnonzero(a[i : i + _AT_A_TIME] != b[i : i + _AT_A_TIME]) + i for i in range(0, a.size, _AT_A_TIME)]
    return np.concatenate(parts)


def _slack(estimate: float, rise: float) -> float:
    """What the wave may exceed the estimate by, in potential.

    The two potentials disagree by up to a few cells around their roots, where a wave is no plane yet: that counts on a
    short way, where a wide berth costs little, and is within the factor on a long one.
    """
    return rise * max(2.0, 6.0 - estimate / (50.0 * rise))

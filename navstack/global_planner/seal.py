"""What stands between a start and a goal that no path connects."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap
from navstack.global_planner.cell_search import CellSearch, Weights
from navstack.global_planner.cost_rule import CostRule

_FREE_STEP: Final = 1.0
_PRICES: Final = {INSCRIBED: 30.0, UNKNOWN: 100.0, LETHAL: 300.0}
"""What a blocked cell costs, in free ones: a gap that is merely too narrow is looked for before a wall is."""
_MOST: Final = 4_000_000
"""Cells expanded at most (some 0.3 s): an explanation is not worth more."""
_NAMES: Final = {INSCRIBED: "too narrow", UNKNOWN: "unknown", LETHAL: "obstacle"}


@dataclass(frozen=True, slots=True)
class BlockedStretch:
    """A stretch of the least blocked way that the rule forbids."""

    x: float
    """Its middle (m)."""
    y: float
    length_m: float
    """How much of the way it blocks."""
    kind: str
    """`too narrow` (inscribed cells only: the gap is there, the robot does not fit), `unknown`, or `obstacle`."""
    gap_m: float | None
    """Where it is too narrow: how far apart the obstacles beside it are, at its narrowest."""

    @property
    def text(self) -> str:
        """In words."""
        at = f"({self.x:.2f}, {self.y:.2f})"
        if self.kind == "too narrow":
            width = "" if self.gap_m is None else f" of about {self.gap_m:.2f} m"
            return f"a gap{width} at {at}, too narrow for the robot over {self.length_m:.2f} m"
        if self.kind == "unknown":
            return f"{self.length_m:.2f} m of unknown cells at {at}, and allow_unknown is false"
        return f"an obstacle at {at}, {self.length_m:.2f} m thick on the way"

    def as_dict(self) -> dict[str, Any]:
        """For the error's data."""
        return {"x": self.x, "y": self.y, "length_m": self.length_m, "kind": self.kind, "gap_m": self.gap_m}


def blocked_stretches(
    costmap: Costmap, rule: CostRule, start: tuple[int, int], goal: tuple[int, int]
) -> list[BlockedStretch]:
    """The stretches of blocked cells on the way from start to goal that crosses the least of them, in order of the way.

    Inscribed cells are crossed rather than unknown ones, those rather than lethal ones. Empty when the search would take
    too long.
    """
    prices = np.full(256, _FREE_STEP)
    for byte in np.flatnonzero(rule.blocked):
        prices[byte] = _PRICES.get(int(byte), _PRICES[INSCRIBED])
    search = CellSearch()
    if not search.octile(costmap, Weights(prices, _FREE_STEP), start, goal, most=_MOST):
        return []
    way = search.path(start, goal)
    costs = costmap.data[way[:, 1], way[:, 0]]
    found: list[BlockedStretch] = []
    for is_blocked, group in groupby(
        range(len(way)), key=lambda i: 0 < i < len(way) - 1 and bool(rule.blocked[costs[i]])
    ):
        if is_blocked:
            found.append(_stretch(costmap, way, costs, list(group)))
    return found


def _stretch(
    costmap: Costmap, way: np.ndarray[Any, Any], costs: np.ndarray[Any, Any], which: list[int]
) -> BlockedStretch:
    g = costmap.geometry
    inside = {int(c) for c in costs[which]}
    worst = LETHAL if LETHAL in inside else UNKNOWN if UNKNOWN in inside else INSCRIBED
    cells = way[which[0] : which[-1] + 2]  # with the step out of it
    steps = np.hypot(*np.diff(cells, axis=0).T) if len(cells) > 1 else np.ones(1)
    x, y = g.cell_to_world(*(int(v) for v in way[which[len(which) // 2]]))
    gap: float | None = None
    if worst == INSCRIBED:
        half = math.inf
        for ix, iy in way[which]:
            half = min(half, _nearest_lethal(costmap, int(ix), int(iy), half))
        # the way runs in the middle of the gap; the obstacles' cells reach half a cell toward it
        gap = None if half == math.inf else max(0.0, 2.0 * half - 1.0) * g.resolution
    return BlockedStretch(x, y, float(steps.sum()) * g.resolution, _NAMES[worst], gap)


def _nearest_lethal(costmap: Costmap, ix: int, iy: int, known: float) -> float:
    """Distance in cells to the nearest lethal cell's centre within 64 cells (or `known`), inf when there is none."""
    reach = min(64, int(known) + 1 if known < math.inf else 64)
    x0, y0 = max(0, ix - reach), max(0, iy - reach)
    ys, xs = np.nonzero(costmap.data[y0 : iy + reach + 1, x0 : ix + reach + 1] == LETHAL)
    return float(np.sqrt(((xs + x0 - ix) ** 2 + (ys + y0 - iy) ** 2).min())) if len(xs) else math.inf

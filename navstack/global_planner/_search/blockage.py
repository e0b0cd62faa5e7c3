"""The obstacles between a start and a goal that no path connects."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap
from navstack.global_planner._search.best_first import BestFirst
from navstack.global_planner._search.cells import Cell
from navstack.global_planner._search.cost_interpreter import CellCosts, CostInterpreter
from navstack.global_planner._search.gaps import gaps, narrowest

_FREE_WEIGHT: Final = 1.0
_BLOCKED_WEIGHTS: Final = {INSCRIBED: 30.0, UNKNOWN: 100.0, LETHAL: 300.0}
"""Weight of a blocked cell, in free cells: a gap that is merely too narrow is preferred to a wall."""
_MAX_EXPANDED: Final = 4_000_000
"""Limit of the search for an explanation (about 0.3 s)."""
_KINDS: Final = {INSCRIBED: "too narrow", UNKNOWN: "unknown", LETHAL: "obstacle"}


@dataclass(frozen=True, slots=True)
class BlockedStretch:
    """A blocked stretch of the least blocked route."""

    x: float
    """Its centre, or that of the gap (m)."""
    y: float
    length_m: float
    """Length of the route that it blocks."""
    kind: str
    """`too narrow` (inscribed cells only: a gap in which the robot does not fit), `unknown`, or `obstacle`."""
    gap_m: float | None
    """Where it is too narrow: the smallest distance between the obstacles on either side."""

    @property
    def text(self) -> str:
        """A phrase for messages."""
        at = f"({self.x:.2f}, {self.y:.2f})"
        if self.kind == "too narrow":
            width = "" if self.gap_m is None else f" of about {self.gap_m:.2f} m"
            return f"a gap{width} at {at}, too narrow for the robot over {self.length_m:.2f} m"
        if self.kind == "unknown":
            return f"{self.length_m:.2f} m of unknown cells at {at} (allow_unknown is false)"
        return f"an obstacle at {at}, {self.length_m:.2f} m thick along the route"

    def as_dict(self) -> dict[str, Any]:
        """For the data of an error."""
        return {"x": self.x, "y": self.y, "length_m": self.length_m, "kind": self.kind, "gap_m": self.gap_m}


def blocked_stretches(costmap: Costmap, costs: CostInterpreter, start: Cell, goal: Cell) -> list[BlockedStretch]:
    """The blocked stretches on the route from start to goal that crosses the fewest blocked cells, in order.

    Inscribed cells are preferred to unknown cells, and those to lethal cells. Empty when the search would take too long.
    """
    search = BestFirst(_weights_of(costs))
    if not search.octile(costmap, start, goal, max_expanded=_MAX_EXPANDED):
        return []
    route = search.path(start, goal)
    blocked = costs.blocked[costmap.data[route[:, 1], route[:, 0]]]
    if not blocked[1:-1].any():
        blocked = _between_corners(costmap, costs, route)
    found: list[BlockedStretch] = []
    for is_blocked, group in groupby(range(1, len(route) - 1), key=lambda i: bool(blocked[i])):
        if is_blocked:
            found.append(_stretch(costmap, route, list(group)))
    return found


def _between_corners(costmap: Costmap, costs: CostInterpreter, route: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) whether the step of a route (n, 2) to the next cell is diagonal, between two blocked cells."""
    (x, y), (u, v) = route[:-1].T, route[1:].T
    beside = costs.blocked[costmap.data[y, u]] & costs.blocked[costmap.data[v, x]]
    return np.append((x != u) & (y != v) & beside, False)


def _weights_of(costs: CostInterpreter) -> CellCosts:
    weights = np.full(256, _FREE_WEIGHT)
    for byte in np.flatnonzero(costs.blocked):
        weights[byte] = _BLOCKED_WEIGHTS.get(int(byte), _BLOCKED_WEIGHTS[INSCRIBED])
    return CellCosts(np.zeros(256, np.bool_), True, weights, _FREE_WEIGHT)


def _stretch(costmap: Costmap, route: NDArray[np.int64], which: list[int]) -> BlockedStretch:
    """The stretch of the cells `which` of a route (n, 2)."""
    g = costmap.geometry
    bytes_ = {int(costmap.data[iy, ix]) for ix, iy in route[which]}
    kind = LETHAL if LETHAL in bytes_ else UNKNOWN if UNKNOWN in bytes_ else INSCRIBED
    cells = route[which[0] : which[-1] + 2]  # including the step out of it
    steps = np.hypot(*np.diff(cells, axis=0).T) if len(cells) > 1 else np.ones(1)
    gap = narrowest(gaps(costmap, route[which])) if kind == INSCRIBED else None
    x, y = (gap.x, gap.y) if gap is not None else g.cell_to_world(*(int(v) for v in route[which[len(which) // 2]]))
    length = float(steps.sum()) * g.resolution
    return BlockedStretch(x, y, length, _KINDS[kind], None if gap is None else gap.width_m)

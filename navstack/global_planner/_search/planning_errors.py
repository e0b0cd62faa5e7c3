"""The errors of a planner that found no path, with the data that explains them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Costmap,
    GoalOccupiedError,
    NoValidPathError,
    PlanningTimeoutError,
    Pose2D,
    StartOccupiedError,
    describe_cost,
)
from navstack.global_planner._search.best_first import BestFirst
from navstack.global_planner._search.cells import Cell, CellCosts, CostInterpreter, SearchSpace

# ----------------------------------------------------------------------------------------------------------------------
# Gaps between the obstacles on either side of a route.


_MAX_GAP_CELLS: Final = 64
_OPPOSITE: Final = math.cos(math.radians(120.0))
"""Two obstacles are on opposite sides of a point if they are seen from it at least 120 degrees apart."""

_EQUAL: Final = 0.7
"""Cells: lines whose lengths differ by less differ by the raster only."""


@dataclass(frozen=True, slots=True)
class Gap:
    """The line between two obstacles on opposite sides of a route."""

    x: float
    """Its middle (m)."""
    y: float
    width_m: float
    """Accurate to one cell."""
    heading: float
    """Direction through the gap along the route (rad)."""


def gaps(costmap: Costmap, cells: NDArray[np.int64]) -> list[Gap | None]:
    """For each cell (n, 2) of a route the gap there; None without obstacles on both sides within 64 cells."""
    along = np.zeros((len(cells), 2))
    if len(cells) > 1:
        along[:] = np.gradient(cells.astype(np.float64), axis=0)
    return [_gap(costmap, int(ix), int(iy), step) for (ix, iy), step in zip(cells, along, strict=True)]


def narrowest(found: Iterable[Gap | None]) -> Gap | None:
    """The narrowest gap, the middle one of equal ones; None without gaps."""
    real = [gap for gap in found if gap is not None]
    least = min((gap.width_m for gap in real), default=0.0) + 1e-9
    equal = [gap for gap in real if gap.width_m <= least]
    return equal[len(equal) // 2] if equal else None


def _gap(costmap: Costmap, ix: int, iy: int, along: NDArray[np.float64]) -> Gap | None:
    """The shortest lines from the nearest obstacle to one on the opposite side of a cell, their mean."""
    g = costmap.geometry
    x0, y0 = max(0, ix - _MAX_GAP_CELLS), max(0, iy - _MAX_GAP_CELLS)
    rows, columns = np.nonzero(
        costmap.data[y0 : iy + _MAX_GAP_CELLS + 1, x0 : ix + _MAX_GAP_CELLS + 1] == LETHAL,
    )
    if not len(rows):
        return None
    seen = np.column_stack((columns + x0 - ix, rows + y0 - iy)).astype(np.float64)
    away = np.hypot(seen[:, 0], seen[:, 1])
    nearest = seen[int(away.argmin())]
    cosine = seen @ nearest / np.maximum(away * away.min(), 1e-9)
    if not (cosine <= _OPPOSITE).any():
        return None
    one, other = seen[(cosine >= -_OPPOSITE) & (away <= away.min() + _EQUAL)], seen[cosine <= _OPPOSITE]
    span = np.hypot(*(other - nearest).T)
    other = other[span <= span.min() + 2.0 * _EQUAL]
    across = other[None] - one[:, None]
    length = np.hypot(across[..., 0], across[..., 1])
    alike = length <= length.min() + _EQUAL
    far = across[alike].mean(axis=0)
    center = 0.5 * (other[None] + one[:, None])[alike].mean(axis=0)
    if (np.hypot(*(seen - center).T) < 0.5 * length.min() - _EQUAL).any():
        return None  # two bumps of one wall
    heading = math.atan2(-far[0], far[1])
    if math.cos(heading) * along[0] + math.sin(heading) * along[1] < 0.0:
        heading = math.remainder(heading + math.pi, 2.0 * math.pi)
    middle = (center + 0.5 + np.array([ix, iy])) * g.resolution
    width = max(0.0, float(length.min()) - 1.0) * g.resolution
    return Gap(float(middle[0]) + g.origin_x, float(middle[1]) + g.origin_y, width, heading)


# ----------------------------------------------------------------------------------------------------------------------
# The obstacles between a start and a goal that no path connects.


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
    """Its center, or that of the gap (m)."""
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


def occupied_data(space: SearchSpace, cell: Cell) -> dict[str, Any]:
    """The data of an error about an occupied cell: the cell, its cost, and the nearest free cell."""
    costmap = space.costmap
    x, y = costmap.geometry.cell_to_world(*cell)
    data: dict[str, Any] = {"cell": list(cell), "cost": int(costmap.data[cell[1], cell[0]]), "x": x, "y": y}
    free = space.nearest_free(cell)
    if free is not None:
        data["nearest_free"] = list(costmap.geometry.cell_to_world(*free[0]))
        data["nearest_free_distance_m"] = free[1]
    return data


def _location(space: SearchSpace, cell: Cell) -> str:
    if not space.is_obstacle(cell):
        return "on the border of the map, which this planner treats as blocked"
    cost = int(space.costmap.data[cell[1], cell[0]])
    unknown = ", and allow_unknown is false" if cost == 255 and not space.costs.allow_unknown else ""
    return f"in a cell of cost {describe_cost(cost)}{unknown}"


def _nearest_free(data: dict[str, Any]) -> str:
    if "nearest_free" not in data:
        return "the map has no free cell"
    x, y = data["nearest_free"]
    return f"the nearest free cell is {data['nearest_free_distance_m']:.2f} m away at ({x:.2f}, {y:.2f})"


def goal_occupied(space: SearchSpace, goal: Pose2D, cell: Cell, tolerance: float) -> GoalOccupiedError:
    """The error for a goal that is blocked, as are all cells within the tolerance (m)."""
    data = occupied_data(space, cell)
    within = f", as is every cell within default_tolerance {tolerance} m" if tolerance > 0.0 else ""
    return GoalOccupiedError(
        f"the goal ({goal.x:.3f}, {goal.y:.3f}) is {_location(space, cell)}{within}; {_nearest_free(data)}",
        **{**data, "x": goal.x, "y": goal.y},
    )


def start_occupied(
    space: SearchSpace, start: Pose2D, cell: Cell, *, because: str = "with no free cell next to it"
) -> StartOccupiedError:
    """The error for a start in a blocked cell that no path can leave."""
    data = occupied_data(space, cell)
    return StartOccupiedError(
        f"the start ({start.x:.3f}, {start.y:.3f}) is {_location(space, cell)}, {because}; {_nearest_free(data)}",
        **{**data, "x": start.x, "y": start.y},
    )


def timeout(
    costmap: Costmap,
    start: Pose2D,
    goal: Pose2D,
    nearest: Cell,
    *,
    expanded: int,
    max_expansions: int,
    name: str = "max_expansions",
) -> PlanningTimeoutError:
    """The error for a search that ended because of its limit, the parameter `name`; `nearest`: the reached cell nearest to the
    goal.
    """
    x, y = costmap.geometry.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    return PlanningTimeoutError(
        f"no path from ({start.x:.3f}, {start.y:.3f}) to ({goal.x:.3f}, {goal.y:.3f}) found within {name} = "
        f"{max_expansions} cells; the nearest point reached is ({x:.2f}, {y:.2f}), {distance:.2f} m from the goal; increase "
        f"{name}, or set it to 0 for no limit",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        max_expansions=max_expansions,
    )


def no_path(
    space: SearchSpace, start: Pose2D, goal: Pose2D, cells: tuple[Cell, Cell], nearest: Cell, *, expanded: int
) -> NoValidPathError:
    """The error for a goal that cannot be reached; `nearest`: the reachable cell nearest to it.

    `cells`: those of start and goal. `data["blocked_by"]` lists the blocked stretches of the least blocked route from start
    to goal, in order (see `blockage.blocked_stretches`).
    """
    x, y = space.costmap.geometry.cell_to_world(*nearest)
    distance = math.hypot(x - goal.x, y - goal.y)
    stretches = blocked_stretches(space.costmap, space.costs, *cells)
    blockage = f"; the route is blocked by {', then by '.join(s.text for s in stretches[:3])}" if stretches else ""
    return NoValidPathError(
        f"no path connects the start ({start.x:.3f}, {start.y:.3f}) and the goal ({goal.x:.3f}, {goal.y:.3f}); "
        f"the reachable point nearest to the goal is ({x:.2f}, {y:.2f}), {distance:.2f} m from it{blockage}",
        nearest_reachable=[x, y],
        nearest_reachable_distance_m=distance,
        cells_expanded=expanded,
        blocked_by=[s.as_dict() for s in stretches],
    )

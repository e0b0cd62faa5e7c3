# pyright: basic
"""The critics of DWB that measure distances in cells: PathDist, GoalDist, PathAlign, GoalAlign (dwb_critics' MapGridCritic).

The value of a cell is its Manhattan distance to the nearest source cell, through obstacles: other critics keep the robot off
them. Nav2 floods the grid with a priority queue; the same values come from two sweeps (A. Rosenfeld, J. Pfaltz, "Sequential
Operations in Digital Picture Processing", 1966). The sources are cells of the plan (PathDist), or its last cell in the costmap
(GoalDist).
"""

from __future__ import annotations

import math
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from navstack.core import plain_kernel
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS, Critic, ParamModel, RejectionDetail, Rollouts, ScoringContext, param

UNREACHABLE, OFF_GRID = -2.0, -4.0
AGGREGATIONS = ("last", "sum", "product")
LAST, SUM, PRODUCT = 0, 1, 2
LARGEST = 1e300
"""Products of many distances end here: a cost is finite."""


class MapGridParams(ParamModel):
    """Weight, and how the distances along a trajectory are combined."""

    scale: float = param(1.0, "weight of this critic, times half the resolution of the costmap", ge=0.0)
    aggregation_type: str = param(
        "last", "what counts of the distances along the trajectory: last, sum or product (which leaves out zeros)"
    )

    @field_validator("aggregation_type")
    @classmethod
    def _check_aggregation(cls, value: str) -> str:
        if value.lower() not in AGGREGATIONS:
            raise ValueError(f'aggregation_type = "{value}" is unknown; use one of: {", ".join(AGGREGATIONS)}')
        return value


class AlignParams(MapGridParams):
    """Weight, and the point whose distance counts."""

    forward_point_distance: float = param(0.325, "distance of the point ahead of the robot's center", unit="m")


P = TypeVar("P", bound=MapGridParams)


class DistanceCritic(Critic[P]):
    """Distance (cells) from the points of a trajectory to the nearest source cell."""

    Params: ClassVar[type[ParamModel]] = MapGridParams
    CODES: ClassVar[dict[int, str]] = {
        int(UNREACHABLE): "Trajectory Hits Unreachable Area.",
        int(OFF_GRID): "Trajectory Goes Off Grid.",
    }
    to_last: ClassVar[bool] = False
    """True: the distance to the last cell of the plan in the costmap; False: to the plan."""

    def __init__(self, name: str, params: P) -> None:
        super().__init__(name, params)
        self._context: ScoringContext | None = None
        self._field: NDArray[np.int32] | None = None
        self._storage = np.empty(0, np.int32)
        self._scale = 0.0
        self._out = np.empty(0)
        self._aggregation = AGGREGATIONS.index(params.aggregation_type.lower())

    @property
    def scale(self) -> float:
        """Weight of a cell in the last prepared cycle."""
        return self._scale

    @property
    def ahead(self) -> float | None:
        """Distance (m) of the point ahead of the center that counts; None: the center, which must stay on the map."""
        return None

    def target(self, context: ScoringContext) -> NDArray[np.float64]:
        """(n, 3) the plan to which the distances lead."""
        return context.plan

    def prepare(self, context: ScoringContext) -> None:
        """Compute the distances of all cells; critics with the same target share them."""
        self._context = context
        self._scale = context.costmap.geometry.resolution * 0.5 * self.params.scale
        plan = self.target(context)
        key = "dwb path distances"
        shared = plan is context.plan and not self.to_last
        field = context.shared.get(key) if shared else None
        if field is None:
            if len(self._storage) != context.costmap.data.size:
                self._storage = np.empty(context.costmap.data.size, np.int32)
            field = self._storage
            cell_distances(context.costmap.data, context.grid, plan, self.to_last, field)
            if shared:
                context.shared[key] = field
        self._field = field

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) cells; -4 off the map, -2 if no cell of the plan is in the costmap."""
        context, field, k = self._context, self._field, len(rollouts.counts)
        if context is None or field is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != k:
            self._out = np.empty(k)
        cells = shared_cells(context, rollouts)
        flat, checks, aggregation = cells.flat, self.ahead is None, self._aggregation
        if self.ahead is not None:
            flat = np.empty_like(flat)
            whole = aggregation != LAST
            cells_ahead(rollouts.poses, rollouts.counts, context.grid, float(self.ahead), whole, flat)
        distance_scores(field, flat, rollouts.counts, cells.boxes, checks, aggregation, self._out)
        return self._out

    def grid_values(self) -> NDArray[np.float64] | None:
        """(ny, nx) distances; the number of cells plus one if no cell of the plan is in the costmap."""
        if self._context is None or self._field is None:
            return None
        return self._field.reshape(self._context.costmap.data.shape).astype(np.float64)

    def explain(self, row: int) -> RejectionDetail:
        """Why the row was rejected: the plan is outside the costmap, or the trajectory leaves it."""
        context, field = self._context, self._field
        if context is None or field is None or not self._out[row] < 0.0:
            return RejectionDetail()
        if self._out[row] == UNREACHABLE:
            return RejectionDetail("no cell of the plan is known and inside the local costmap")
        return RejectionDetail("trajectory leaves the local costmap")


@CRITICS.register("PathDist", aliases=("dwb_critics/PathDistCritic",))
class PathDistCritic(DistanceCritic[MapGridParams]):
    """Distance (cells) of the trajectory's end from the plan."""


@CRITICS.register("GoalDist", aliases=("dwb_critics/GoalDistCritic",))
class GoalDistCritic(DistanceCritic[MapGridParams]):
    """Distance (cells) of the trajectory's end from the last cell of the plan in the local costmap."""

    to_last: ClassVar[bool] = True


@CRITICS.register("PathAlign", aliases=("dwb_critics/PathAlignCritic",))
class PathAlignCritic(DistanceCritic[AlignParams]):
    """Distance (cells) from the plan of a point ahead of the robot, at the trajectory's end; off near the goal."""

    Params: ClassVar[type[ParamModel]] = AlignParams

    @property
    def ahead(self) -> float:
        """`forward_point_distance`."""
        return self.params.forward_point_distance

    def prepare(self, context: ScoringContext) -> None:
        """As for PathDist; within `forward_point_distance` of the goal the weight is 0."""
        dx, dy = context.state.pose.x - context.goal.x, context.state.pose.y - context.goal.y
        if dx * dx + dy * dy > self.ahead * self.ahead:
            super().prepare(context)
            return
        self._context, self._field, self._scale = context, None, 0.0

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) cells, or -4; 0 near the goal."""
        return np.zeros(len(rollouts.counts)) if self._field is None else super().score(rollouts)


@CRITICS.register("GoalAlign", aliases=("dwb_critics/GoalAlignCritic",))
class GoalAlignCritic(DistanceCritic[AlignParams]):
    """Distance (cells) of a point ahead of the robot, at the trajectory's end, from a point beyond the end of the plan."""

    Params: ClassVar[type[ParamModel]] = AlignParams
    to_last: ClassVar[bool] = True

    @property
    def ahead(self) -> float:
        """`forward_point_distance`."""
        return self.params.forward_point_distance

    def target(self, context: ScoringContext) -> NDArray[np.float64]:
        """(n, 3) the plan with its last pose moved by `forward_point_distance`, in the direction from the robot to the goal."""
        pose, goal = context.state.pose, context.goal
        direction = math.atan2(goal.y - pose.y, goal.x - pose.x)
        plan = context.plan.copy()
        if len(plan):
            plan[-1, 0] += self.ahead * math.cos(direction)
            plan[-1, 1] += self.ahead * math.sin(direction)
        return plan


# --- kernels --------------------------------------------------------------------------------------------------------


@plain_kernel
def cell_distances(costs, grid, plan, to_last, distances):
    """Write the Manhattan distance (cells) to the nearest source to `distances` (ny * nx,). Returns how many points are sources.

    The cells of `plan` (n, 3), from the first known one inside the costmap until the plan leaves it or becomes unknown; with
    `to_last` the last of them. Gaps of more than two cells are filled with points first. Without a source, all cells get the
    number of cells plus one.
    """
    ny, nx = costs.shape
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    size = nx * ny
    if not to_last:
        distances[:] = nx + ny
    gap = 2.0 * resolution
    last, found = 0, 0
    left = False
    for i in range(len(plan)):
        steps = 1
        x0, y0, dx, dy = plan[i, 0], plan[i, 1], 0.0, 0.0
        if i > 0:
            x0, y0 = plan[i - 1, 0], plan[i - 1, 1]
            dx, dy = plan[i, 0] - x0, plan[i, 1] - y0
            squared = dx * dx + dy * dy
            if squared > gap * gap:
                steps = max(1, int(min((math.sqrt(squared) - gap) / resolution, 1e6)) - 1)
                dx /= steps
                dy /= steps
        for j in range(1, steps + 1):
            px, py = plan[i, 0], plan[i, 1]
            if j < steps:
                px, py = x0 + j * dx, y0 + j * dy
            inside = False
            fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
            if px >= origin_x and py >= origin_y and fx < nx and fy < ny:
                ix, iy = int(fx), int(fy)
                if costs[iy, ix] != 255:
                    inside = True
                    found += 1
                    last = iy * nx + ix
                    if not to_last:
                        distances[last] = 0
            if found > 0 and not inside:
                left = True
                break
        if left:
            break
    if found == 0:
        distances[:] = size + 1
    elif to_last:
        row, column = last // nx, last % nx
        for iy in range(ny):
            base, away = iy * nx, abs(iy - row)
            for ix in range(nx):
                distances[base + ix] = abs(ix - column) + away
    else:
        sweep(distances, nx, ny)
    return found


@plain_kernel
def sweep(distances, nx, ny):
    """Lower each of the `distances` (ny * nx,) to one more than that of a neighbor, until none changes: rows, then columns."""
    for iy in range(ny):
        row = distances[iy * nx : (iy + 1) * nx]
        value = np.int32(nx + ny)
        for ix in range(nx):
            value = min(value + np.int32(1), row[ix])
            row[ix] = value
        for i in range(nx):
            ix = nx - 1 - i
            value = min(value + np.int32(1), row[ix])
            row[ix] = value
    for iy in range(1, ny):
        above, row = distances[(iy - 1) * nx : iy * nx], distances[iy * nx : (iy + 1) * nx]
        for ix in range(nx):
            row[ix] = min(row[ix], above[ix] + np.int32(1))
    for i in range(1, ny):
        iy = ny - 1 - i
        below, row = distances[(iy + 1) * nx : (iy + 2) * nx], distances[iy * nx : (iy + 1) * nx]
        for ix in range(nx):
            row[ix] = min(row[ix], below[ix] + np.int32(1))


@plain_kernel
def cells_ahead(poses, counts, grid, ahead, whole, cells):
    """Write the flat cell of the point `ahead` meters in front of each pose to `cells` (K, T); -1 off the map.

    Without `whole`, of the last pose of each row only.
    """
    nx, ny = grid[0].nx, grid[0].ny
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    for k in range(len(counts)):
        for i in range(0 if whole else max(0, counts[k] - 1), counts[k]):
            x = poses[k, i, 0] + ahead * math.cos(poses[k, i, 2])
            y = poses[k, i, 1] + ahead * math.sin(poses[k, i, 2])
            fx, fy = (x - origin_x) / resolution, (y - origin_y) / resolution
            inside = fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny
            cells[k, i] = int(fy) * nx + int(fx) if inside else -1


@plain_kernel
def distance_scores(distances, cells, counts, boxes, checks, aggregation, out):
    """Write the combined distances of each row's `cells` (K, T) to `out` (K,); OFF_GRID or UNREACHABLE, whichever comes first.

    With `checks` every point counts, and a cell without a distance is UNREACHABLE; otherwise with LAST only the last one.
    `boxes` (K + 1, 4) of `point_cells` belong to `cells` if `checks`.
    """
    reachable = len(distances) > 0 and distances[0] <= len(distances)
    for k in range(len(counts)):
        n = counts[k]
        score = 1.0 if aggregation == PRODUCT else 0.0
        if n == 0:
            out[k] = score
            continue
        first = 0
        if aggregation == LAST and (not checks or (reachable and boxes[k, 0] >= 0)):
            first = n - 1
        for i in range(first, n):
            cell = cells[k, i]
            if cell < 0:
                score = OFF_GRID
                break
            if checks and not reachable:
                score = UNREACHABLE
                break
            value = np.float64(distances[cell])
            if aggregation == LAST:
                score = value
            elif aggregation == SUM:
                score += value
            elif score > 0.0:
                score = min(score * value, LARGEST)
        out[k] = score

# pyright: basic
"""Leaving lethal cells under the footprint: what a robot may do that touches, or nearly touches, an obstacle.

ROS differs: there, every sample is rejected as long as a lethal cell is on the edges of the footprint, so the robot cannot leave
an obstacle that it has touched. A mark can overlap a robot at rest: its cell is coarse, the footprint is padded, and a bumper
marks what the robot has hit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    MAX_CELLS,
    PASSABLE,
    Costmap,
    comes_nearer,
    free_scale,
    grid_record,
    is_nearly_round,
    kernel,
    lethal_cells_under,
    overlaps_any,
    place_scaled,
)
from navstack.local_planner.critics.obstacle import IN_COLLISION
from navstack.local_planner.scoring import ScoreTable
from navstack.plugins import Rollouts, ScoringContext

TURN_STEP = math.radians(5.0)


@dataclass(frozen=True, slots=True, eq=False)
class Overlap:
    """The lethal cells under the footprint at the current pose."""

    context: ScoringContext
    cells: NDArray[np.int64]
    """(m, 2) ix, iy."""

    @classmethod
    def at(cls, context: ScoringContext) -> Overlap | None:
        """The overlap at the pose of `context`.

        None if the footprint is free, or if there is no direction away: the robot's center is in a lethal cell, or outside its
        footprint.
        """
        costs = context.costmap.data
        if context.costmap.cost_at(*context.state.pose[:2]) == LETHAL or not context.footprint.contains_center:
            return None
        corners = context.footprint.vertices.T.copy()
        placed = np.empty_like(corners)
        place_scaled(corners, 1.0, np.array(context.state.pose), grid_record(context.costmap.geometry), placed)
        cells = np.empty((MAX_CELLS, 2), np.int64)
        number = lethal_cells_under(costs, placed, cells)
        return cls(context, cells[:number].copy()) if 0 < number <= MAX_CELLS else None

    def relaxed(self) -> ScoringContext:
        """A context in which these cells are passable. All other lethal cells remain."""
        costmap = self.context.costmap
        data = costmap.data.copy()
        data[data == 253] = PASSABLE  # the robot's center may be in one, and the distance grids must lead out of it
        data[self.cells[:, 1], self.cells[:, 0]] = PASSABLE
        return replace(
            self.context,
            costmap=Costmap(costmap.geometry, data, costmap.frame),
            notes=[],
            cells=None,
            path_grid=None,
            _grid=None,
        )

    def select(
        self, rollouts: Rollouts, table: ScoreTable, obstacle: int, first_collision: NDArray[np.int64]
    ) -> ScoreTable:
        """Reject the rollouts that come nearer to one of the cells; select among the others.

        `rollouts` and `table` belong to the context `relaxed`; `obstacle` is the column of the obstacle critic. The lowest total
        of the rollouts that end free of the cells is selected; without one, the rollout that turns farthest towards the nearest
        heading from which the robot can leave; all are rejected if there is none. `first_collision` (K,) is changed for the rows
        rejected here.
        """
        simulated = np.flatnonzero(rollouts.counts > 0)
        if not len(simulated):
            return table
        footprint = self.context.footprint
        corners = footprint.vertices.T.copy()
        grid = grid_record(self.context.costmap.geometry)
        start = rollouts.poses[simulated[0], 0].copy()
        scale = 0.0 if is_nearly_round(footprint) else free_scale(corners, start, grid, self.cells)
        k = len(rollouts.counts)
        nearer, ends_free = np.empty(k, np.int64), np.empty(k, np.bool_)
        alive = table.rejected_by == -1
        leave_cells(corners, scale, grid, self.cells, rollouts.poses, rollouts.counts, alive, nearer, ends_free)
        alive &= nearer < 0
        rank = np.where(ends_free, table.totals, np.inf)
        if alive.any() and not ends_free.any():
            reach, reverses = 2.0 * footprint.circumscribed_radius, self.context.limits.min_vel_x < 0.0
            costs = self.relaxed().costmap.data
            heading = exit_heading(costs, corners, scale, grid, self.cells, start, reach, reverses)
            if np.isnan(heading):
                nearer[alive] = 0
                alive[:] = False
            else:
                # of the legal rollouts only: poses that are not simulated are not initialized
                legal = np.flatnonzero(alive)
                rank[legal] = -np.cos(rollouts.poses[legal, rollouts.counts[legal] - 1, 2] - heading)
        rows = np.flatnonzero(nearer >= 0)
        table.rejected_by[rows] = obstacle
        table.costs[rows, obstacle:] = np.nan
        table.costs[rows, obstacle] = table.totals[rows] = IN_COLLISION
        first_collision[rows] = nearer[rows]
        best = min(np.flatnonzero(alive).tolist(), key=lambda row: (rank[row], table.totals[row]), default=-1)
        return replace(table, best=best)

    @property
    def note(self) -> str:
        """What happens, for `LocalPlan.notes`."""
        ix, iy = self.cells[0].tolist()
        x, y = self.context.costmap.geometry.cell_to_world(ix, iy)
        number = len(self.cells)
        what = "an obstacle cell" if number == 1 else f"{number} obstacle cells"
        return f"the footprint overlaps {what} at ({x:.2f}, {y:.2f}): only samples that come no nearer are legal"


# --- kernels --------------------------------------------------------------------------------------------------------


@kernel
def leave_cells(corners, scale, grid, cells, poses, counts, alive, first_nearer, ends_free):
    """Examine the rollouts that are alive: do they keep their distance from the `cells` (m, 2) under the footprint?

    Per row: `first_nearer` (K,) is the first point that comes nearer to a cell, -1 without; `ends_free` (K,) says whether
    the footprint overlaps none of the cells at the last point. `scale`: see `comes_nearer`.
    """
    placed = np.empty(corners.shape)
    for k in range(len(counts)):
        first_nearer[k] = -1
        ends_free[k] = False
        if not alive[k]:
            continue
        for i in range(counts[k]):
            if comes_nearer(corners, scale, poses[k, i], poses[k, 0], grid, cells, placed):
                first_nearer[k] = i
                break
        if first_nearer[k] < 0:
            place_scaled(corners, 1.0, poses[k, counts[k] - 1], grid, placed)
            ends_free[k] = not overlaps_any(placed, cells)


@kernel
def exit_heading(costs, corners, scale, grid, cells, start, reach, reverses):
    """Return the heading (rad) nearest to that of `start` from which a straight motion of up to `reach` (m) leaves the `cells`.

    The turn in place to it and the motion come nearer to none of them and overlap no lethal cell of `costs`, in which the `cells`
    are passable. `reverses`: the motion may be backwards. NaN without such a heading.
    """
    placed = np.empty(corners.shape)
    at = start.copy()
    found = np.empty((1, 2), np.int64)
    step = 0.5 * grid[0].resolution
    open_left, open_right = True, True
    for m in range(math.ceil(math.pi / TURN_STEP) + 1):
        for side in range(2):
            if not (open_left if side == 0 else open_right):
                continue
            at[0], at[1] = start[0], start[1]
            at[2] = start[2] + (m if side == 0 else -m) * TURN_STEP
            place_scaled(corners, 1.0, at, grid, placed)
            free = lethal_cells_under(costs, placed, found) == 0
            if not free or comes_nearer(corners, scale, at, start, grid, cells, placed):
                open_left, open_right = open_left and side == 1, open_right and side == 0
                continue
            for direction in range(2 if reverses else 1):
                sign = 1.0 - 2.0 * direction
                for i in range(1, math.ceil(reach / step) + 1):
                    at[0] = start[0] + sign * i * step * math.cos(at[2])
                    at[1] = start[1] + sign * i * step * math.sin(at[2])
                    if comes_nearer(corners, scale, at, start, grid, cells, placed):
                        break
                    place_scaled(corners, 1.0, at, grid, placed)
                    if lethal_cells_under(costs, placed, found) > 0:
                        break
                    if not overlaps_any(placed, cells):
                        return at[2]
    return np.nan

"""Leaving lethal cells under the footprint: what a robot may do that touches, or nearly touches, an obstacle.

ROS differs: there, every sample is rejected as long as a lethal cell is on the edges of the footprint, so the robot cannot leave
an obstacle that it has touched. A mark can overlap a robot at rest: its cell is coarse, the footprint is padded, and a bumper
marks what the robot has hit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap
from navstack.core.grid import grid_record
from navstack.core.overlap import MAX_CELLS, PASSABLE, is_nearly_round
from navstack.core.overlap_kernels import free_scale, lethal_cells_under, place_scaled
from navstack.interfaces import Rollouts, ScoringContext
from navstack.local_planner._overlap_kernels import exit_heading, leave_cells
from navstack.local_planner.critics._kernels import IN_COLLISION
from navstack.local_planner.scoring import ScoreTable


@dataclass(frozen=True, slots=True, eq=False)
class Overlap:
    """The lethal cells under the footprint at the current pose."""

    context: ScoringContext
    cells: NDArray[np.int64]
    """(m, 2) ix, iy."""

    @classmethod
    def at(cls, context: ScoringContext) -> Overlap | None:
        """The overlap at the pose of `context`.

        None if the footprint is free, or if there is no direction away: the robot's centre is in a lethal cell, or outside its
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
        data[data == 253] = PASSABLE  # the robot's centre may be in one, and the distance grids must lead out of it
        data[self.cells[:, 1], self.cells[:, 0]] = PASSABLE
        return replace(
            self.context, costmap=Costmap(costmap.geometry, data, costmap.frame), notes=[], cells=None, path_grid=None
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

"""What a cost means for the robot's centre and its footprint, as tables for the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Inflation, RejectionDetail
from navstack.local_planner.mppi._collision_kernels import (
    CHECK,
    COLLISION,
    FREE,
    batch_costs,
    cells_near,
    first_collision,
)
from navstack.local_planner.mppi.batch import PLACE, Batch, Floats, TrajectoryContext

INSCRIBED, LETHAL, UNKNOWN = 253, 254, 255
EVERYWHERE = np.empty((0, 0), np.bool_)
"""Of `CollisionTest.near`: the footprint is checked wherever the centre's cost says CHECK."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionTest:
    """Checks the trajectories of a batch against the costmap of a context."""

    context: TrajectoryContext
    meaning: NDArray[np.uint8]
    """(256,) FREE, COLLISION or CHECK for a cost under the robot's centre."""
    corners: NDArray[np.float64]
    """(2, n) of the footprint (m)."""
    near: NDArray[np.bool_]
    """(ny, nx), or (0, 0) for everywhere: cells in which the footprint may touch an obstacle."""

    @classmethod
    def of(cls, context: TrajectoryContext, *, consider_footprint: bool) -> CollisionTest:
        """By the centre's cost, or by the footprint wherever the centre's cost does not exclude a collision.

        ROS differs: without inflation the cost of the centre says nothing, and the footprint is checked wherever it may touch
        an obstacle.
        """
        near = EVERYWHERE
        meaning = np.full(256, FREE, np.uint8)
        if context.exact and context.inflation is None:
            meaning[:] = CHECK
            near = _near(context, LETHAL)
        elif consider_footprint:
            meaning[max(1, circumscribed_cost(context)) :] = CHECK
        else:
            meaning[INSCRIBED : LETHAL + 1] = COLLISION
            meaning[UNKNOWN] = FREE if context.track_unknown_space else COLLISION
        return cls(context, meaning, np.ascontiguousarray(context.footprint.vertices.T), near)

    def scores(self, batch: Batch, step: int, values: Floats, out: Floats) -> NDArray[np.bool_]:
        """Write the sums of `values` (2, 256) of the costs of every `step`-th point to `out` (K,); return who collides.

        See `batch_costs`.
        """
        context, near = self.context, self.near
        if near.size and values[1, 0] >= 0.0:
            near = _near(context, 1)  # every cost under the footprint counts
        collided = np.empty(len(out), np.bool_)
        batch_costs(
            context.costmap.data,
            near,
            batch.place(context.costmap),
            self.corners,
            batch.points,
            step,
            values,
            self.meaning,
            context.track_unknown_space,
            context.exact,
            out,
            collided,
        )
        batch.collided |= collided
        return collided

    def first(self, batch: Batch, row: int, step: int = 1) -> tuple[int, int]:
        """The first of every `step`-th point of a trajectory that collides, -1 without one, and the cost found there."""
        context = self.context
        found, cost = first_collision(
            context.costmap.data,
            self.near,
            batch.place(context.costmap),
            self.corners,
            batch.points,
            row,
            step,
            self.meaning,
            context.track_unknown_space,
            context.exact,
        )
        return int(found), int(cost)

    def is_free(self, points: Floats) -> bool:
        """True if no point of a trajectory (3, T, 1), relative to the robot, collides; unknown cells do not count."""
        context = self.context
        pose, g = context.state.pose, context.costmap.geometry
        place = np.zeros(1, PLACE)
        place[0] = (g.origin_x - pose.x, g.origin_y - pose.y, g.resolution, 0.0)
        found, _ = first_collision(
            context.costmap.data, self.near, place, self.corners, points, 0, 1, self.meaning, True, context.exact
        )
        return int(found) < 0

    def detail(self, batch: Batch, row: int, step: int) -> RejectionDetail:
        """Where a trajectory collides."""
        point, cost = self.first(batch, row, step)
        if point < 0:
            return RejectionDetail("collides with an obstacle")
        pose = batch.pose(row, point)
        x, y = batch.points[0, : point + 1, row], batch.points[1, : point + 1, row]
        ahead = float(np.hypot(np.diff(x), np.diff(y)).sum()) + math.hypot(float(x[0]), float(y[0]))
        cell = self.context.costmap.geometry.world_to_cell(pose.x, pose.y)
        if cell is None:
            reason = "leaves the local costmap"
        elif cost == UNKNOWN:
            reason = "enters unknown space (cost 255)"
        elif cost == INSCRIBED:
            reason = "comes closer to an obstacle than the inscribed radius (cost 253)"
        else:
            reason = "hits an obstacle: lethal cost 254"
        return RejectionDetail(reason, point, pose, ahead, cell, cost)


def _near(context: TrajectoryContext, lowest: int) -> NDArray[np.bool_]:
    """The cells (ny, nx) in which the footprint may touch a cell of at least the cost `lowest`, or leave the costmap."""
    costs = context.costmap.data
    out = np.empty(costs.shape, np.bool_)
    reach = math.ceil(context.footprint.circumscribed_radius / context.costmap.geometry.resolution) + 1
    # where every cost counts, unknown cells do
    cells_near(costs, lowest, context.track_unknown_space and lowest == LETHAL, reach, out)
    return out


def circumscribed_cost(context: TrajectoryContext) -> int:
    """Cost at the circumscribed radius, above which the footprint may touch an obstacle; 0 beyond the inflation, or without."""
    inflation = context.inflation
    radius = context.footprint.circumscribed_radius
    if inflation is None or inflation.inflation_radius < radius:
        return 0
    return decayed_cost(inflation, radius)


def decayed_cost(inflation: Inflation, distance: float) -> int:
    """The inflated cost at a distance (m) from an obstacle."""
    if distance <= inflation.inscribed_radius:
        return INSCRIBED
    decay = math.exp(-inflation.cost_scaling_factor * (distance - inflation.inscribed_radius))
    return math.floor(252.0 * decay)


def table(values: NDArray[Any] | None = None, footprint: NDArray[Any] | None = None) -> Floats:
    """(2, 256) for `CollisionTest.scores`: what the centre's cost adds; what the footprint's adds, or -1: the centre's."""
    out = np.full((2, 256), -1.0, np.float32)
    out[0] = 0.0 if values is None else values
    if footprint is not None:
        out[1] = footprint
    return out

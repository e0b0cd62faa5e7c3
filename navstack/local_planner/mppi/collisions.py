# pyright: basic
"""What a cost means for the robot's center and its footprint, as tables for the kernels."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import OUTSIDE, edge_cost, footprint_overlaps_lethal, kernel
from navstack.local_planner.mppi.batch import LANES, PLACE, Batch, Floats, TrajectoryContext
from navstack.plugins import Inflation, RejectionDetail

# ----------------------------------------------------------------------------------------------------------------------
# Costs and collisions along the trajectories of a batch.


# pyright: basic


f32 = np.float32

FREE, COLLISION, CHECK = 0, 1, 2
"""What a cost under the center means: no collision, a collision, the footprint decides."""


@kernel
def footprint_value(costs, place, corners, exact, x, y, yaw, scratch):
    """Return the highest cost on the edges of the footprint at a pose relative to the anchor; 254 beyond the grid.

    With `exact`, also 254 if the footprint overlaps a lethal cell that its edges miss. See `batch_costs`.
    """
    cells, placed = scratch
    origin_x, origin_y, resolution = place[0].origin_x, place[0].origin_y, place[0].resolution
    px, py, angle = np.float64(x), np.float64(y), np.float64(yaw)
    cost = edge_cost(costs, origin_x, origin_y, resolution, corners, px, py, angle, cells)
    if cost == OUTSIDE:
        return np.int64(254)
    missed = False
    if exact and cost != 254:
        missed = footprint_overlaps_lethal(costs, origin_x, origin_y, resolution, corners, px, py, angle, placed)
    return np.int64(254) if missed else cost


@kernel
def cells_of(costs, place, x, y, out):
    """Write the flat cells of LANES points to `out`; -1 beyond the grid."""
    ny, nx = costs.shape
    scale = f32(1.0 / place[0].resolution)
    shift_x = f32(-place[0].origin_x / place[0].resolution)
    shift_y = f32(-place[0].origin_y / place[0].resolution)
    width, height = f32(nx), f32(ny)
    columns = np.int32(nx)
    for i in range(LANES):
        fx = x[i] * scale + shift_x
        fy = y[i] * scale + shift_y
        inside = (fx >= f32(0.0)) & (fy >= f32(0.0)) & (fx < width) & (fy < height)
        ix = np.int32(fx if inside else f32(0.0))
        iy = np.int32(fy if inside else f32(0.0))
        out[i] = iy * columns + ix if inside else np.int32(-1)


@kernel
def cells_near(costs, lowest, unknown_free, reach, out):
    """Write to `out` (ny, nx) where a footprint may touch a cell of at least the cost `lowest`, or leave the grid.

    `reach`: cells between the center and the farthest corner. A square around each such cell is marked: a superset.
    `unknown_free`: cost 255 does not count.
    """
    ny, nx = costs.shape
    rows = np.zeros((ny, nx), np.bool_)
    for iy in range(ny):
        last = -reach - 1  # column of the last such cell; the border is one
        for ix in range(nx):
            cost = costs[iy, ix]
            if cost >= lowest and not (unknown_free and cost == 255):
                last = ix
            rows[iy, ix] = ix - last <= reach or ix < reach
        last = nx + reach
        for ix in range(nx - 1, -1, -1):
            cost = costs[iy, ix]
            if cost >= lowest and not (unknown_free and cost == 255):
                last = ix
            if last - ix <= reach or nx - 1 - ix < reach:
                rows[iy, ix] = True
    above = np.full(nx, -reach - 1)
    for iy in range(ny):
        for ix in range(nx):
            if rows[iy, ix]:
                above[ix] = iy
            out[iy, ix] = iy - above[ix] <= reach or iy < reach
    below = np.full(nx, ny + reach)
    for iy in range(ny - 1, -1, -1):
        for ix in range(nx):
            if rows[iy, ix]:
                below[ix] = iy
            if below[ix] - iy <= reach or ny - 1 - iy < reach:
                out[iy, ix] = True


@kernel
def batch_costs(costs, near, place, corners, points, step, values, meaning, unknown_free, exact, out, collided):
    """Write the sum of `values` of the costs under every `step`-th point to `out` (K,), and which trajectories collide.

    `place` (1,): origin of the grid relative to the points' anchor, and resolution (m). `values` (2, 256): what a cost under the
    center adds, and a cost of the footprint where `meaning` (256,) says CHECK. A trajectory that collides adds nothing more.
    `unknown_free`: cost 255 under the footprint is no collision. `near` (ny, nx), or (0, 0) for everywhere: cells in which the
    footprint is checked; in the others its cost counts as 0.
    """
    flat = costs.ravel()
    close = near.ravel()
    everywhere = close.size == 0
    steps, number = points.shape[1], points.shape[2]
    scratch = np.empty(corners.shape, np.int32), np.empty(corners.shape)
    cells = np.empty(LANES, np.int32)
    total = np.empty(LANES, np.float32)
    hit = np.empty(LANES, np.bool_)
    for begin in range(0, number, LANES):
        for i in range(LANES):
            total[i] = f32(0.0)
            hit[i] = False
        for t in range(0, steps, step):
            x, y, yaw = points[0, t], points[1, t], points[2, t]
            cells_of(costs, place, x[begin : begin + LANES], y[begin : begin + LANES], cells)
            for i in range(LANES):
                if hit[i]:
                    continue
                cost = flat[cells[i]] if cells[i] >= 0 else np.uint8(255)
                what = meaning[cost]
                if what == FREE:
                    total[i] += values[0, cost]
                else:
                    k = begin + i
                    value = np.int64(254)
                    if what == CHECK and cells[i] >= 0 and not everywhere and not close[cells[i]]:
                        value = np.int64(0)
                    elif what == CHECK:
                        value = footprint_value(costs, place, corners, exact, x[k], y[k], yaw[k], scratch)
                    if value == 254 or (value == 255 and not unknown_free):
                        hit[i] = True
                    else:
                        total[i] += values[1, value] if values[1, 0] >= f32(0.0) else values[0, cost]
        for i in range(LANES):
            out[begin + i] = total[i]
            collided[begin + i] = hit[i]


@kernel
def first_collision(costs, near, place, corners, points, row, step, meaning, unknown_free, exact):
    """Return the first of every `step`-th point of a trajectory that collides, and its footprint's cost; -1 without one."""
    flat = costs.ravel()
    close = near.ravel()
    ny, nx = costs.shape
    scratch = np.empty(corners.shape, np.int32), np.empty(corners.shape)
    for t in range(0, points.shape[1], step):
        fx = (np.float64(points[0, t, row]) - place[0].origin_x) / place[0].resolution
        fy = (np.float64(points[1, t, row]) - place[0].origin_y) / place[0].resolution
        cost, may_touch = np.uint8(255), True
        if 0.0 <= fx < nx and 0.0 <= fy < ny:
            cell = np.int64(fy) * nx + np.int64(fx)
            cost = flat[cell]
            may_touch = close.size == 0 or close[cell]
        if meaning[cost] == COLLISION:
            return t, np.int64(cost)
        if meaning[cost] == CHECK and may_touch:
            value = footprint_value(
                costs, place, corners, exact, points[0, t, row], points[1, t, row], points[2, t, row], scratch
            )
            if value == 254 or (value == 255 and not unknown_free):
                return t, value
    return -1, np.int64(0)


INSCRIBED, LETHAL, UNKNOWN = 253, 254, 255
EVERYWHERE = np.empty((0, 0), np.bool_)
"""Of `CollisionTest.near`: the footprint is checked wherever the center's cost says CHECK."""


@dataclass(frozen=True, slots=True, eq=False)
class CollisionTest:
    """Checks the trajectories of a batch against the costmap of a context."""

    context: TrajectoryContext
    meaning: NDArray[np.uint8]
    """(256,) FREE, COLLISION or CHECK for a cost under the robot's center."""
    corners: NDArray[np.float64]
    """(2, n) of the footprint (m)."""
    near: NDArray[np.bool_]
    """(ny, nx), or (0, 0) for everywhere: cells in which the footprint may touch an obstacle."""

    @classmethod
    def of(cls, context: TrajectoryContext, *, consider_footprint: bool) -> CollisionTest:
        """By the center's cost, or by the footprint wherever the center's cost does not exclude a collision.

        ROS differs: without inflation the cost of the center says nothing, and the footprint is checked wherever it may touch
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
    """(2, 256) for `CollisionTest.scores`: what the center's cost adds; what the footprint's adds, or -1: the center's."""
    out = np.full((2, 256), -1.0, np.float32)
    out[0] = 0.0 if values is None else values
    if footprint is not None:
        out[1] = footprint
    return out

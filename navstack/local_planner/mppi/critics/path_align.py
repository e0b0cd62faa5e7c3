# pyright: basic
"""Keeps the trajectory on the path: points are compared with the path at the same length."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams, wrapped
from navstack.plugins import CRITICS, ParamModel, param


class PathAlignCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(10.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(0.5, "used while more than this is left of the path", unit="m", ge=0.0)
    offset_from_furthest: int = param(20, "used when the trajectories reach at least this pose of the path", ge=0)
    trajectory_point_step: int = param(4, "every n-th point of a trajectory is compared", ge=1)
    max_path_occupancy_ratio: float = param(
        0.07, "not used if more than this share of the path's poses, and more than two, are blocked", ge=0.0
    )
    use_path_orientations: bool = param(False, "the difference of the headings counts, too")


@CRITICS.register("PathAlignCritic", aliases=("mppi/critics/PathAlignCritic",))
class PathAlignCritic(TrajectoryCritic):
    """Mean distance of the points to the path at the length driven so far (m)."""

    Params: ClassVar[type[ParamModel]] = PathAlignCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write one distance (m) per trajectory to `out`, shape (n,)."""
        context, p = self.context, self.params
        furthest = interested(self, batch)
        if furthest < 2:
            return False
        align_scores(
            batch.points,
            context.path,
            context.valid_poses(),
            furthest,
            p.trajectory_point_step,
            p.use_path_orientations,
            batch.number,
            out,
        )
        return True


def interested(critic: TrajectoryCritic, batch: Batch) -> int:
    """The furthest pose reached; 0 if the path is too short, not followed far enough, or blocked."""
    context, p = critic.context, critic.params
    if context.length < p.threshold_to_consider:
        return 0
    furthest = context.furthest_reached(batch)
    blocked = int((~context.valid_poses()[:furthest]).sum())
    if furthest < p.offset_from_furthest or (blocked > 2 and blocked > p.max_path_occupancy_ratio * furthest):
        return 0
    return furthest


@CRITICS.register("PathAlignLegacyCritic", aliases=("mppi/critics/PathAlignLegacyCritic",))
class PathAlignLegacyCritic(TrajectoryCritic):
    """Mean distance of the points to the nearest pose of the path (m)."""

    Params: ClassVar[type[ParamModel]] = PathAlignCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write one distance (m) per trajectory to `out`, shape (n,)."""
        context, p = self.context, self.params
        if interested(self, batch) == 0 or batch.points.shape[1] < p.trajectory_point_step:
            return False
        valid = context.valid_poses()
        legacy_align_scores(batch.points, context.path, valid, p.trajectory_point_step, p.use_path_orientations, out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def align_scores(points, path, valid, count, step, use_yaw, number, out):
    """Mean distance of every `step`-th point to the pose of `path` (4, n) at the arc length driven so far.

    Among the first `count` poses; points whose pose is not `valid` (n,) do not count. The trajectory's length is that of the
    polyline of these points; the search for its pose only moves forward.
    """
    lanes = len(out)
    driven = np.zeros(lanes, np.float32)
    total = np.zeros(lanes, np.float32)
    counted = np.zeros(lanes, np.float32)
    at = np.zeros(lanes, np.int32)
    arc = path[3]
    for t in range(step, points.shape[1], step):
        x, y, yaw = points[0, t], points[1, t], points[2, t]
        before_x, before_y = points[0, t - step], points[1, t - step]
        for k in range(lanes):
            dx, dy = x[k] - before_x[k], y[k] - before_y[k]
            driven[k] += np.sqrt(dx * dx + dy * dy)
        for k in range(number):
            i, distance = at[k], driven[k]
            while i + 1 < count and arc[i + 1] <= distance:
                i += np.int32(1)
            at[k] = i
            if i + 1 < count and not distance - arc[i] < arc[i + 1] - distance:
                i += np.int32(1)
            if valid[i]:
                dx, dy = path[0, i] - x[k], path[1, i] - y[k]
                squared = dx * dx + dy * dy
                if use_yaw:
                    turn = wrapped(path[2, i] - yaw[k])
                    squared += turn * turn
                total[k] += np.sqrt(squared)
                counted[k] += f32(1.0)
    for k in range(lanes):
        out[k] = total[k] / counted[k] if counted[k] > f32(0.0) else f32(0.0)


@kernel
def legacy_align_scores(points, path, valid, step, use_yaw, out):
    """Sum of the distances of every `step`-th point to the nearest pose of `path` (4, n), divided by their number.

    A point counts if that pose is `valid` and not the first one.
    """
    lanes = len(out)
    out[:] = f32(0.0)
    for t in range(step, points.shape[1], step):
        x, y, yaw = points[0, t], points[1, t], points[2, t]
        for k in range(lanes):
            best, nearest = f32(np.inf), 0
            for i in range(path.shape[1]):
                dx, dy = path[0, i] - x[k], path[1, i] - y[k]
                squared = dx * dx + dy * dy
                if use_yaw:
                    turn = wrapped(path[2, i] - yaw[k])
                    squared += turn * turn
                if squared < best:
                    best, nearest = squared, i
            if nearest > 0 and valid[nearest]:
                out[k] += np.sqrt(best)
    count = f32(points.shape[1] // step)
    for k in range(lanes):
        out[k] /= count

# pyright: basic
"""Draws the end of the trajectory along the path."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from navstack.core import kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS, ParamModel, param


class PathFollowCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(5.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(1.4, "used while more than this is left of the path", unit="m", ge=0.0)
    offset_from_furthest: int = param(6, "poses of the path beyond the furthest one that a trajectory reaches", ge=0)


@CRITICS.register("PathFollowCritic", aliases=("mppi/critics/PathFollowCritic",))
class PathFollowCritic(TrajectoryCritic):
    """Distance of the last point to a free pose of the path, a little ahead of what the trajectories reach (m)."""

    Params: ClassVar[type[ParamModel]] = PathFollowCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Write one distance (m) per trajectory to `out`, shape (n,)."""
        context, p = self.context, self.params
        last = context.path.shape[1] - 1
        if context.length < p.threshold_to_consider or last < 1:
            return False
        at = min(context.furthest_reached(batch) + p.offset_from_furthest, last)
        valid = context.valid_poses()
        while at < last and not valid[at]:
            at += 1
        endpoint_scores(batch.points, context.path[0, at], context.path[1, at], out)
        return True


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def endpoint_scores(points, x, y, out):
    """Distance of the last point to (x, y)."""
    px, py = points[0, points.shape[1] - 1], points[1, points.shape[1] - 1]
    for k in range(len(out)):
        dx, dy = px[k] - x, py[k] - y
        out[k] = np.sqrt(dx * dx + dy * dy)

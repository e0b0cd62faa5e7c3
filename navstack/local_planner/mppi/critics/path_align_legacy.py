"""PathAlign of Nav2 Humble and Iron: points are compared with the nearest pose of the path."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel
from navstack.local_planner.mppi._critic_kernels import legacy_align_scores
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.critics.path_align import PathAlignCriticParams, interested
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic
from navstack.plugins import CRITICS


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

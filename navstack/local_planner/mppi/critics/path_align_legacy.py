"""PathAlign of Nav2 Humble and Iron: points are compared with the nearest pose of the path."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.local_planner.mppi._critic_kernels import legacy_align_scores
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.critics.path_align import interested
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS


class PathAlignLegacyCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(10.0, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(0.5, "used while more than this is left of the path", unit="m", ge=0.0)
    offset_from_furthest: int = param(20, "used when the trajectories reach at least this pose of the path", ge=0)
    trajectory_point_step: int = param(4, "every n-th point of a trajectory is compared", ge=1)
    max_path_occupancy_ratio: float = param(
        0.07, "not used if more than this share of the path's poses, and more than two, are blocked", ge=0.0
    )
    use_path_orientations: bool = param(False, "the difference of the headings counts, too")


@CRITICS.register("PathAlignLegacyCritic", aliases=("mppi/critics/PathAlignLegacyCritic",))
class PathAlignLegacyCritic(TrajectoryCritic):
    """Mean distance of the points to the nearest pose of the path (m)."""

    Params: ClassVar[type[ParamModel]] = PathAlignLegacyCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Metres."""
        context, p = self.context, self.params
        if interested(self, batch) == 0 or batch.points.shape[1] < p.trajectory_point_step:
            return False
        valid = context.valid_poses()
        legacy_align_scores(batch.points, context.path, valid, p.trajectory_point_step, p.use_path_orientations, out)
        return True

"""Keeps the trajectory on the path: points are compared with the path at the same length."""

from __future__ import annotations

from typing import ClassVar

from navstack.core.parameters import ParamModel, param
from navstack.local_planner.mppi._critic_kernels import align_scores
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams
from navstack.plugins import CRITICS


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

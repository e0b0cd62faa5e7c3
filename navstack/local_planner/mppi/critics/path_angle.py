# pyright: basic
"""Turns the robot to the path."""

from __future__ import annotations

import math
from typing import ClassVar, Literal

import numpy as np

from navstack.core import Pose2D, angle_between, kernel
from navstack.local_planner.mppi.batch import Batch, Floats
from navstack.local_planner.mppi.trajectory_critic import TrajectoryCritic, TrajectoryCriticParams, wrapped
from navstack.plugins import CRITICS, ParamModel, param


class PathAngleCriticParams(TrajectoryCriticParams):
    """Weight, and where the critic is used."""

    cost_weight: float = param(2.2, "weight of the score", ge=0.0)
    threshold_to_consider: float = param(0.5, "used while more than this is left of the path", unit="m", ge=0.0)
    offset_from_furthest: int = param(4, "poses of the path beyond the furthest one that a trajectory reaches", ge=0)
    max_angle_to_furthest: float = param(
        0.785398, "used while the bearing of that pose is off the robot's heading by more than this", unit="rad", ge=0.0
    )
    mode: Literal[0, 1, 2] = param(
        0, "0: drive forward; 1: forward or backward; 2: in the direction of the path's orientations"
    )


@CRITICS.register("PathAngleCritic", aliases=("mppi/critics/PathAngleCritic",))
class PathAngleCritic(TrajectoryCritic):
    """Angle between the last heading and the bearing of a pose of the path from the last point (rad)."""

    Params: ClassVar[type[ParamModel]] = PathAngleCriticParams

    def score_batch(self, batch: Batch, out: Floats) -> bool:
        """Radians."""
        context, p = self.context, self.params
        if context.length < p.threshold_to_consider:
            return False
        mode = 0 if p.mode == 1 and context.motion.vx_min >= 0.0 else p.mode
        at = min(context.furthest_reached(batch) + p.offset_from_furthest, context.path.shape[1] - 1)
        x, y, yaw = context.plan[at].tolist()
        if _angle(context.state.pose, x, y, yaw, mode) < p.max_angle_to_furthest:
            return False
        px, py, path_yaw = context.path[:3, at]
        bearing_scores(batch.points, px, py, path_yaw, mode, out)
        return True


def _angle(pose: Pose2D, x: float, y: float, yaw: float, mode: int) -> float:
    """The angle between the robot's heading and the bearing of (x, y), by the critic's mode."""
    bearing = math.atan2(y - pose.y, x - pose.x)
    error = abs(angle_between(pose.yaw, bearing))
    if mode == 1:
        return min(error, math.pi - error)
    backward = mode == 2 and abs(angle_between(bearing, yaw)) > 0.5 * math.pi
    return math.pi - error if backward else error


# --- kernels --------------------------------------------------------------------------------------------------------

f32 = np.float32


@kernel
def bearing_scores(points, x, y, path_yaw, mode, out):
    """Angle between the last heading and the bearing of (x, y) from the last point.

    `mode` 0: forward; 1: the bearing or its opposite, whichever is nearer to the heading; 2: the one nearer to `path_yaw`.
    """
    last = points.shape[1] - 1
    px, py, yaws = points[0, last], points[1, last], points[2, last]
    for k in range(len(out)):
        bearing = np.arctan2(y - py[k], x - px[k])
        error = wrapped(yaws[k] - bearing)
        opposite = f32(math.pi) - error
        if mode == 1:
            error = min(error, opposite)
        elif mode == 2 and wrapped(bearing - path_yaw) > f32(0.5 * math.pi):
            error = opposite
        out[k] = error

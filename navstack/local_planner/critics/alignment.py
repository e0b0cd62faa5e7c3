"""Keeps the robot's nose on the plan (DWAPlanner's alignment_costs_)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._scale import RosDistro, distance_scale
from navstack.local_planner.map_grid import GridBuffer, MapGrid, shared_path_grid
from navstack.plugins import CRITICS


class AlignmentParams(ParamModel):
    """Weight, where the nose is, and how near the goal it stops counting."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    path_distance_bias: float = param(0.6, "weight of the distance to the plan, per metre", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose point from the robot's centre", unit="m")
    cheat_factor: float = param(1.0, "factor on the squared distance within which alignment is switched off", ge=0.0)
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("alignment")
class AlignmentCritic(Critic):
    """Distance from the nose at the trajectory's last point to the plan.

    Skipped within `forward_point_distance` of the end of the plan in sight.
    """

    Params: ClassVar[type[ParamModel]] = AlignmentParams
    CODES: ClassVar[dict[int, str]] = {-4: "its nose leaves the map"}

    def __init__(self, name: str, params: AlignmentParams) -> None:
        super().__init__(name, params)
        self._scale = params.path_distance_bias
        self._buffer = GridBuffer()
        self._out = np.empty(0)
        self.grid: MapGrid | None = None

    @property
    def scale(self) -> float:
        """`path_distance_bias` times the resolution (half of that before 2018), 0 near the goal."""
        return self._scale

    def prepare(self, context: ScoringContext) -> None:
        """Takes the grid of distances to the plan, unless the goal is near."""
        p = self.params
        pose = context.state.pose
        dx, dy = context.plan[-1, 0] - pose.x, context.plan[-1, 1] - pose.y
        if dx * dx + dy * dy > p.forward_point_distance * p.forward_point_distance * p.cheat_factor:
            self._scale = distance_scale(p.path_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
            self.grid = shared_path_grid(context, self._buffer)
        else:
            self._scale = 0.0

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) cells, nx*ny and more where no way leads; -4 for a nose off the map."""
        if self.grid is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        return self.grid.score(rollouts, alive, self._out, ahead=self.params.forward_point_distance)

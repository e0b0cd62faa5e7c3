"""Stays near the plan (MapGridCostFunction over the path grid)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._scale import RosDistro, distance_scale
from navstack.local_planner.map_grid import GridBuffer, MapGrid, shared_path_grid
from navstack.plugins import CRITICS

GRID_CODES = {
    -2: "passes a cell from which its target cannot be reached",
    -3: "passes an obstacle cell",
    -4: "leaves the map",
}


class PathParams(ParamModel):
    """Weight of the distance to the plan."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    path_distance_bias: float = param(0.6, "weight of the distance to the plan, per metre", ge=0.0)
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("path")
class PathCritic(Critic):
    """Distance (cells, around obstacles) from the trajectory's last point to the plan."""

    Params: ClassVar[type[ParamModel]] = PathParams
    CODES: ClassVar[dict[int, str]] = GRID_CODES

    def __init__(self, name: str, params: PathParams) -> None:
        super().__init__(name, params)
        self._scale = params.path_distance_bias
        self._buffer = GridBuffer()
        self._out = np.empty(0)
        self.grid: MapGrid | None = None

    @property
    def scale(self) -> float:
        """`path_distance_bias` times the resolution; half of that before 2018."""
        return self._scale

    def prepare(self, context: ScoringContext) -> None:
        """Builds the grid of distances to the plan."""
        p = self.params
        self._scale = distance_scale(p.path_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
        self.grid = shared_path_grid(context, self._buffer)

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) cells, or -2, -3, -4 for a trajectory with such a point."""
        if self.grid is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        return self.grid.score(rollouts, alive, self._out, stop_on_failure=True)

"""Makes progress along the plan (MapGridCostFunction over the goal grid)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._scale import RosDistro, distance_scale
from navstack.local_planner.critics.path import GRID_CODES
from navstack.local_planner.map_grid import GridBuffer, MapGrid
from navstack.plugins import CRITICS


class GoalParams(ParamModel):
    """Weight of the distance to the local goal."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal, per metre", ge=0.0)
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal")
class GoalCritic(Critic):
    """Distance (cells, around obstacles) from the trajectory's last point to the plan's last cell in the window."""

    Params: ClassVar[type[ParamModel]] = GoalParams
    CODES: ClassVar[dict[int, str]] = GRID_CODES

    def __init__(self, name: str, params: GoalParams) -> None:
        super().__init__(name, params)
        self._scale = params.goal_distance_bias
        self._buffer = GridBuffer()
        self._out = np.empty(0)
        self.grid: MapGrid | None = None

    @property
    def scale(self) -> float:
        """`goal_distance_bias` times the resolution; half of that before 2018."""
        return self._scale

    def prepare(self, context: ScoringContext) -> None:
        """Builds the grid of distances to the local goal."""
        p = self.params
        self._scale = distance_scale(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
        # ROS differs: a local goal in an obstacle cell would leave every other cell unreachable, every sample rejected
        # (parity 27); the last free cell of the plan before it takes its place
        self.grid = self._buffer.build(context.costmap, context.plan, last_only=True, step_back=True)
        if self.grid.stepped_back:
            notes: list[str] = context.shared.setdefault("notes", [])
            notes.append(
                f"the plan's last cell in the local costmap is an obstacle: the local goal was moved back over "
                f"{self.grid.stepped_back} cells of the plan"
            )

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) cells, or -2, -3, -4 for a trajectory with such a point."""
        if self.grid is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        return self.grid.score(rollouts, alive, self._out, stop_on_failure=True)

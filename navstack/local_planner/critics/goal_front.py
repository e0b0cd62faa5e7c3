"""Points the robot's nose at the goal (DWAPlanner's goal_front_costs_)."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._scale import RosDistro, distance_scale
from navstack.local_planner.map_grid import GridBuffer, MapGrid
from navstack.plugins import CRITICS


class GoalFrontParams(ParamModel):
    """Weight, and where the nose is."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    goal_distance_bias: float = param(0.8, "weight of the distance to the local goal, per metre", ge=0.0)
    forward_point_distance: float = param(0.325, "distance of the nose point from the robot's centre", unit="m")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("goal_front")
class GoalFrontCritic(Critic):
    """Distance from the nose at the trajectory's last point to the end of a plan that is pushed on past the goal.

    The plan's last pose is moved by `forward_point_distance` away from the robot.
    """

    Params: ClassVar[type[ParamModel]] = GoalFrontParams
    CODES: ClassVar[dict[int, str]] = {-4: "its nose leaves the map"}

    def __init__(self, name: str, params: GoalFrontParams) -> None:
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
        """Builds the grid of distances to the pushed goal."""
        p = self.params
        self._scale = distance_scale(p.goal_distance_bias, context.costmap.geometry.resolution, p.ros_distro)
        plan = context.plan.copy()
        pose = context.state.pose
        bearing = math.atan2(plan[-1, 1] - pose.y, plan[-1, 0] - pose.x)
        plan[-1, 0] += p.forward_point_distance * math.cos(bearing)
        plan[-1, 1] += p.forward_point_distance * math.sin(bearing)
        self.grid = self._buffer.build(context.costmap, plan, last_only=True)

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) cells, nx*ny and more where no way leads; -4 for a nose off the map."""
        if self.grid is None:
            raise RuntimeError("prepare was not called")
        if len(self._out) != len(rollouts.counts):
            self._out = np.empty(len(rollouts.counts))
        return self.grid.score(rollouts, alive, self._out, ahead=self.params.forward_point_distance)

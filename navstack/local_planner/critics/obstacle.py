"""Keeps the robot's outline off obstacles (base_local_planner/src/obstacle_cost_function.cpp, costmap_model.cpp)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._obstacle_kernels import obstacle_scores
from navstack.local_planner.critics._weights import RosDistro, obstacle_scale
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS


class ObstacleParams(ParamModel):
    """Weight, and how the outline grows with speed."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0)
    scaling_speed: float = param(0.25, "speed from which on the footprint grows", unit="m/s", ge=0.0)
    max_scaling_factor: float = param(0.2, "how much the footprint has grown at max_vel_trans", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of their maximum")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("obstacle", aliases=("base_local_planner/ObstacleCostFunction",))
class ObstacleCritic(Critic):
    """The highest cost under the outline and the centre at any point; rejects an outline that touches a lethal cell."""

    Params: ClassVar[type[ParamModel]] = ObstacleParams
    CODES: ClassVar[dict[int, str]] = {-6: "footprint on a lethal or unknown cell, or off the map"}

    def __init__(self, name: str, params: ObstacleParams) -> None:
        super().__init__(name, params)
        self.params: ObstacleParams = params
        self._scale = params.occdist_scale
        self._context: ScoringContext | None = None
        self._rows = np.empty((0, 0), np.uint8)
        self._bounds = np.empty((2, 0, 0), np.uint8)
        self._out = np.empty(0)
        self.first_collision: NDArray[np.int64] = np.empty(0, np.int64)
        """(K,) index of the first point that collides, -1 without; of the last call of `score`."""

    @property
    def scale(self) -> float:
        """`occdist_scale`, times the resolution before 2018."""
        return self._scale

    def weight(self, context: ScoringContext) -> float:
        """`occdist_scale`, times the resolution before 2018."""
        p = self.params
        return obstacle_scale(p.occdist_scale, context.costmap.geometry.resolution, p.ros_distro)

    def take(self, context: ScoringContext, scale: float, first_collision: NDArray[np.int64]) -> None:
        """What this cycle's scoring found, where it was not done by `score`."""
        self._context, self._scale, self.first_collision = context, scale, first_collision

    def prepare(self, context: ScoringContext) -> None:
        """Takes the costmap and the outline of this cycle."""
        self._context = context
        self._scale = self.weight(context)
        if self._rows.shape != context.costmap.data.shape:
            self._rows = np.empty_like(context.costmap.data)
            self._bounds = np.empty((2, *context.costmap.data.shape), np.uint8)

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) costs in 0..253, or -6."""
        context = self._context
        if context is None:
            raise RuntimeError("prepare was not called")
        k = len(rollouts.counts)
        if len(self._out) != k:
            self._out = np.empty(k)
        if len(self.first_collision) != k:
            self.first_collision = np.empty(k, np.int64)
        g = context.costmap.geometry
        p = self.params
        outline = context.footprint
        cells = shared_cells(context, rollouts)
        obstacle_scores(
            context.costmap.data,
            g.origin_x,
            g.origin_y,
            g.resolution,
            outline.vertices,
            outline.circumscribed_radius,
            rollouts.samples,
            rollouts.poses,
            rollouts.counts,
            alive,
            p.scaling_speed,
            context.limits.max_vel_trans,
            p.max_scaling_factor,
            p.sum_scores,
            *cells.box,
            self._rows,
            self._bounds,
            cells.flat,
            self._out,
            self.first_collision,
        )
        return self._out

    def footprint_scale(self, speed: float, max_speed: float) -> float:
        """How much the outline has grown at `speed` (m/s)."""
        p = self.params
        if speed <= p.scaling_speed or max_speed <= p.scaling_speed:
            return 1.0
        return p.max_scaling_factor * ((speed - p.scaling_speed) / (max_speed - p.scaling_speed)) + 1.0

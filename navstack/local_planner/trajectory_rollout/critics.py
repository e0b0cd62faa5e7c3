"""What trajectory rollout scores: TrajectoryPlanner::generateTrajectory of base_local_planner, as critics."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner.critics._map_grid_critic import CENTER_CODES, MapGridCritic
from navstack.local_planner.critics.goal import GoalCritic, GoalParams
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.trajectory_rollout._kernels import clear_footprint, heading_errors

HEADING_SCALE = 0.3
"""Weight of the heading difference with heading_scoring: a constant in C++."""


class PathDistanceCritic(MapGridCritic):
    """Distance to the plan, in cells or metres; the cells under the robot count as free."""

    CODES: ClassVar[dict[int, str]] = CENTER_CODES

    def __init__(self, bias: float, per_metre: bool) -> None:
        super().__init__("path", None)
        self._bias = bias
        self._per_metre = per_metre
        self._scratch = np.empty((2, 0), np.int64)

    def weight(self, context: ScoringContext) -> float:
        """The bias, per cell or per metre."""
        return self._bias * (context.costmap.geometry.resolution if self._per_metre else 1.0)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the plan."""
        costmap = context.costmap.copy()
        g = costmap.geometry
        if self._scratch.shape[1] != g.nx:
            self._scratch = np.empty((2, g.nx), np.int64)
        clear_footprint(
            costmap.data,
            g.origin_x,
            g.origin_y,
            g.resolution,
            context.footprint.vertices,
            np.array(context.state.pose),
            self._scratch[0],
            self._scratch[1],
        )
        return self._buffer.build(costmap, context.plan, context.state.pose, last_only=False)


class GoalDistanceCritic(GoalCritic):
    """Distance to the local goal, in cells or metres."""

    def __init__(self, bias: float, per_metre: bool) -> None:
        super().__init__("goal", GoalParams())
        self._bias = bias
        self._per_metre = per_metre

    def weight(self, context: ScoringContext) -> float:
        """The bias, per cell or per metre."""
        return self._bias * (context.costmap.geometry.resolution if self._per_metre else 1.0)


class SimpleAttractorCritic(Critic):
    """simple_attractor: squared distance (m²) from the last point to the end of the plan in sight."""

    def __init__(self, weight: float) -> None:
        super().__init__("goal", None)
        self._weight = weight
        self._end = np.zeros(2)

    @property
    def scale(self) -> float:
        """The bias of the goal."""
        return self._weight

    def prepare(self, context: ScoringContext) -> None:
        """Takes the plan's end."""
        self._end = context.plan[-1, :2]

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) m²."""
        last = rollouts.poses[np.arange(len(alive)), np.maximum(rollouts.counts - 1, 0), :2]
        return np.where(alive, ((last - self._end) ** 2).sum(axis=1), 0.0)


class UnscaledObstacleCritic(ObstacleCritic):
    """The highest cost under the outline, which does not grow with speed here."""

    def __init__(self, weight: float, per_metre: bool) -> None:
        super().__init__("obstacle", ObstacleParams(occdist_scale=weight, scaling_speed=1e9))
        self._per_metre = per_metre

    def prepare(self, context: ScoringContext) -> None:
        """Takes the costmap and the outline of this cycle."""
        super().prepare(context)
        if self._per_metre:
            self._scale = self.params.occdist_scale * context.costmap.geometry.resolution


class HeadingCritic(Critic):
    """heading_scoring: the turn (rad) to the farthest pose of the plan in free sight."""

    def __init__(self) -> None:
        super().__init__("heading", None)
        self._context: ScoringContext | None = None

    @property
    def scale(self) -> float:
        """C++'s constant."""
        return HEADING_SCALE

    def prepare(self, context: ScoringContext) -> None:
        """Takes the costmap and the plan of this cycle."""
        self._context = context

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) rad from the first point; huge where no pose of the plan is in sight."""
        assert self._context is not None
        costmap = self._context.costmap
        g = costmap.geometry
        out = np.zeros(len(alive))
        if rollouts.poses.shape[1]:
            at = np.ascontiguousarray(rollouts.poses[:, 0])
            heading_errors(costmap.data, g.origin_x, g.origin_y, g.resolution, self._context.plan, at, alive, out)
            # C++ adds the largest double there is
            out[np.isinf(out)] = 1e300
        return out


class SinglePointCritic(Critic):
    """heading_scoring: another critic, shown one point only, `seconds` along trajectories of `sim_time` (s)."""

    def __init__(self, inner: Critic, seconds: float, sim_time: float) -> None:
        super().__init__(inner.name, inner.params)
        self._inner = inner
        self._seconds = seconds
        self._sim_time = sim_time

    @property
    def scale(self) -> float:
        """The other's."""
        return self._inner.scale

    def prepare(self, context: ScoringContext) -> None:
        """Prepares the other."""
        self._inner.prepare(context)

    def score(self, rollouts: Rollouts, alive: NDArray[np.bool_]) -> NDArray[np.float64]:
        """(K,) the other's; 0 where no trajectory lasts so long."""
        steps = int(rollouts.counts.max(initial=0))
        if steps == 0:
            return np.zeros(len(alive))
        point = math.ceil(self._seconds / (self._sim_time / steps) - 1e-9)
        if point >= steps:
            return np.zeros(len(alive))
        return self._inner.score(one_point(rollouts, point), alive)


def one_point(rollouts: Rollouts, point: int | NDArray[np.int64]) -> Rollouts:
    """The same rollouts reduced to one point each."""
    rows = np.arange(len(rollouts.counts))
    poses = np.ascontiguousarray(rollouts.poses[rows, point][:, None, :])
    return Rollouts(rollouts.samples, poses, np.minimum(rollouts.counts, 1))

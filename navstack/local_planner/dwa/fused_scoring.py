"""move_base's seven critics scored in one call: the same numbers as one by one (`scoring.score`), in half the time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner._map_grid_kernels import WAVE_SIZE, queue_length
from navstack.local_planner.critics import (
    AlignmentCritic,
    GoalCritic,
    GoalFrontCritic,
    ObstacleCritic,
    OscillationCritic,
    PathCritic,
    TwirlingCritic,
)
from navstack.local_planner.dwa._fused_scoring_kernels import score_default
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.scoring import NEVER, ScoreTable, score


class Scorer:
    """Scores the trajectories of one planner's critics; the seven of move_base, in its order, all at once."""

    def __init__(self, critics: Sequence[Critic]) -> None:
        self._critics = critics
        self._default = DefaultCritics.of(critics)

    def score(self, context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
        """As `scoring.score`."""
        if self._default is not None:
            return self._default.score(context, rollouts)
        return score(self._critics, context, rollouts)

    def tell(self) -> None:
        """Leaves with each critic what it saw in the last cycle, where nobody has asked for it yet."""
        if self._default is not None:
            self._default.tell()


class DefaultCritics:
    """The seven, with memory that is kept from cycle to cycle."""

    def __init__(
        self,
        oscillation: OscillationCritic,
        obstacle: ObstacleCritic,
        goal_front: GoalFrontCritic,
        alignment: AlignmentCritic,
        path: PathCritic,
        goal: GoalCritic,
        twirling: TwirlingCritic,
    ) -> None:
        self._oscillation = oscillation
        self._obstacle = obstacle
        self._goal_front = goal_front
        self._alignment = alignment
        self._path = path
        self._goal = goal
        self._twirling = twirling
        self._cells = np.empty((2, 0), np.int32)
        self._resolution = 0.0
        self._scales = np.zeros(7)
        self._untold: tuple[ScoringContext, NDArray[np.float64]] | None = None
        self._fit_map(0, 0)
        self._fit_samples(0)

    @classmethod
    def of(cls, critics: Sequence[Critic]) -> DefaultCritics | None:
        """Of `critics`, when they are move_base's seven in its order, and none of them somebody's own."""
        seven = (
            OscillationCritic,
            ObstacleCritic,
            GoalFrontCritic,
            AlignmentCritic,
            PathCritic,
            GoalCritic,
            TwirlingCritic,
        )
        if tuple(type(critic) for critic in critics) != seven:
            return None
        return cls(*critics)  # pyright: ignore[reportArgumentType]

    def score(self, context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
        """As `scoring.score` of the seven; each critic can tell afterwards what it saw."""
        costmap, footprint, plan = context.costmap, context.footprint, context.plan
        pose = context.state.pose
        k, t = rollouts.poses.shape[:2]
        g = costmap.geometry
        if self._shape != (g.ny, g.nx):
            self._fit_map(g.ny, g.nx)
        if self._samples != k:
            self._fit_samples(k)
        if self._cells.shape[1] < k * t:
            self._cells = np.empty((2, k * t), np.int32)
        obstacle, front, alignment = self._obstacle, self._goal_front, self._alignment
        if self._resolution != g.resolution:
            self._fit_resolution(context)
        scales = self._scales.copy()
        scales[3] = alignment.weight(context)
        costs = np.empty((k, 7))
        totals = np.empty(k)
        rejected_by = np.empty(k, np.int8)
        only_x, only_y, only_theta = self._oscillation.only
        p = obstacle.params
        best = score_default(
            costmap.data,
            g.origin_x,
            g.origin_y,
            g.resolution,
            footprint.vertices,
            footprint.circumscribed_radius,
            p.scaling_speed,
            context.limits.max_vel_trans,
            p.max_scaling_factor,
            p.sum_scores,
            plan,
            float(pose.x),  # whole numbers would have the kernel compiled once more
            float(pose.y),
            float(pose.yaw),
            front.params.forward_point_distance,
            alignment.params.forward_point_distance,
            only_x,
            only_y,
            only_theta,
            scales,
            rollouts.samples,
            rollouts.poses,
            rollouts.counts,
            self._distances,
            self._queues,
            self._waves,
            self._starts,
            self._rows,
            self._bounds,
            self._cells,
            self._boxes,
            self._raw,
            self._first_contact,
            self._alive,
            costs,
            totals,
            rejected_by,
            NEVER,
        )
        self._untold = context, scales
        if self._starts[2, 1]:  # the local goal was moved back, which the critic notes
            self.tell()
        return ScoreTable(costs, scales, totals, rejected_by, best)

    def tell(self) -> None:
        """As of `Scorer`."""
        if self._untold is None:
            return
        (context, scales), self._untold = self._untold, None
        front, path, goal = (
            MapGrid(self._distances[i], self._queues[i], self._waves[i], context.costmap, self._starts[i])
            for i in range(3)
        )
        context.shared["path_grid"] = path
        self._obstacle.take(context, float(scales[1]), self._first_contact)
        for critic, scale, grid in (
            (self._goal_front, scales[2], front),
            (self._alignment, scales[3], path),
            (self._path, scales[4], path),
            (self._goal, scales[5], goal),
        ):
            critic.take(context, float(scale), grid)

    def _fit_resolution(self, context: ScoringContext) -> None:
        """All weights; that of alignment alone changes from cycle to cycle."""
        self._resolution = context.costmap.geometry.resolution
        self._scales = np.array(
            (
                self._oscillation.scale,
                self._obstacle.weight(context),
                self._goal_front.weight(context),
                self._alignment.weight(context),
                self._path.weight(context),
                self._goal.weight(context),
                self._twirling.scale,
            )
        )

    def _fit_map(self, ny: int, nx: int) -> None:
        size = (ny + 2) * (nx + 2)
        self._distances = np.empty((3, size + 1), np.int32)
        self._queues = np.empty((3, queue_length(size)), np.int32)
        self._waves = np.empty((3, WAVE_SIZE), np.int64)
        self._starts = np.empty((3, 2), np.int64)
        self._rows = np.empty((ny, nx), np.uint8)
        self._bounds = np.empty((2, ny, nx), np.uint8)
        self._shape = ny, nx

    def _fit_samples(self, k: int) -> None:
        self._boxes = np.empty((k, 4), np.int32)
        self._raw = np.empty(k)
        self._first_contact = np.empty(k, np.int64)
        self._alive = np.empty(k, np.bool_)
        self._samples = k

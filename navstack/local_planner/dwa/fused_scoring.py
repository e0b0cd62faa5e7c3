"""The seven default critics of DWA, scored in two kernel calls: the same table as `scoring.score`.

Kept beside `scoring.score` because whole runs take 4 % longer without it (scenarios noise and maze_lanes).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core.grid import grid_record
from navstack.interfaces import Critic, Rollouts, ScoringContext
from navstack.local_planner._map_grid_kernels import STEPPED_BACK, storage_size
from navstack.local_planner.critics import (
    AlignmentCritic,
    GoalCritic,
    GoalFrontCritic,
    ObstacleCritic,
    OscillationCritic,
    PathCritic,
    TwirlingCritic,
)
from navstack.local_planner.critics.obstacle import OBSTACLE_SETTINGS, ObstacleScratch
from navstack.local_planner.dwa._fused_scoring_kernels import (
    CRITICS,
    GOAL_GRID,
    score_grids_and_rotation,
    score_motion_and_obstacles,
)
from navstack.local_planner.map_grid import MapGrid
from navstack.local_planner.scoring import ScoreTable

CYCLE = np.dtype(
    [
        ("weights", "f8", (CRITICS,)),  # first: numba takes a record that begins as another one for that one
        *((name, OBSTACLE_SETTINGS[name]) for name in OBSTACLE_SETTINGS.names or ()),
        ("nx", "i8"),
        ("ny", "i8"),
        ("pose_x", "f8"),
        ("pose_y", "f8"),
        ("pose_yaw", "f8"),
        ("goal_front_ahead", "f8"),
        ("alignment_ahead", "f8"),
        ("sign_x", "i8"),
        ("sign_y", "i8"),
        ("sign_theta", "i8"),
    ]
)
"""Settings of one cycle, a superset of GRID and OBSTACLE_SETTINGS."""
TYPES = (
    OscillationCritic,
    ObstacleCritic,
    GoalFrontCritic,
    AlignmentCritic,
    PathCritic,
    GoalCritic,
    TwirlingCritic,
)


class FusedScorer:
    """Scores the seven default critics; keeps its buffers between cycles.

    `publish` hands the results of the last cycle to the critics, which need them only for diagnostics.
    """

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
        self._cycle = np.zeros(1, CYCLE)
        self._cells = np.empty(0, np.int32)
        self._grids = np.empty((3, 0), np.int32)
        self._obstacle_scratch = ObstacleScratch()
        self._first_collision = np.empty(0, np.int64)
        self._unpublished: tuple[ScoringContext, Rollouts, NDArray[np.float64]] | None = None

    @classmethod
    def of(cls, critics: Sequence[Critic]) -> FusedScorer | None:
        """A scorer of `critics` if they are exactly the seven default critics in their order, else None."""
        if tuple(type(critic) for critic in critics) != TYPES:
            return None
        return cls(*critics)  # pyright: ignore[reportArgumentType]

    def score(self, context: ScoringContext, rollouts: Rollouts) -> ScoreTable:
        """As `scoring.score` of the seven critics."""
        k, t = rollouts.poses.shape[:2]
        self._fit(context, k, t)
        self._oscillation.prepare(context)
        cycle, weights = self._settings(context)
        scores = np.empty((CRITICS + 2) * k)
        rejected_by = np.empty(k, np.int8)
        costs = context.costmap.data
        score_motion_and_obstacles(
            costs,
            cycle,
            context.footprint.vertices,
            rollouts.commands,
            rollouts.poses,
            rollouts.counts,
            rollouts.alive,
            self._cells,
            self._obstacle_scratch.fit(context, k * t),
            scores,
            rejected_by,
            self._first_collision,
        )
        best = score_grids_and_rotation(
            costs,
            cycle,
            context.plan,
            rollouts.commands,
            rollouts.poses,
            rollouts.counts,
            rollouts.alive,
            self._cells,
            self._grids,
            scores,
            rejected_by,
        )
        self._unpublished = context, rollouts, weights
        if self._grids[GOAL_GRID, STEPPED_BACK]:  # the goal critic adds a note
            self.publish()
        table = scores[: CRITICS * k].reshape(k, CRITICS)
        return ScoreTable(table, weights, scores[CRITICS * k : (CRITICS + 1) * k], rejected_by, best)

    def publish(self) -> None:
        """Hand weights, grids and collisions of the last cycle to the critics, once."""
        if self._unpublished is None:
            return
        (context, rollouts, weights), self._unpublished = self._unpublished, None
        grid = grid_record(context.costmap.geometry)
        front, path, goal = (MapGrid(storage, grid) for storage in self._grids)
        context.path_grid = path
        self._obstacle.set_result(context, rollouts, float(weights[1]), self._first_collision)
        self._goal_front.set_grid(context, float(weights[2]), front)
        self._alignment.set_grid(context, float(weights[3]), path)
        self._path.set_grid(context, float(weights[4]), path)
        self._goal.set_grid(context, float(weights[5]), goal)

    def _settings(self, context: ScoringContext) -> tuple[NDArray[Any], NDArray[np.float64]]:
        """(1,) of CYCLE, and the weights of the critics."""
        g, p = context.costmap.geometry, self._obstacle.params
        weights = (
            self._oscillation.scale,
            self._obstacle.weight(context),
            self._goal_front.weight(context),
            self._alignment.weight(context),
            self._path.weight(context),
            self._goal.weight(context),
            self._twirling.scale,
        )
        self._cycle[0] = (
            weights,
            g.origin_x,
            g.origin_y,
            g.resolution,
            context.footprint.circumscribed_radius,
            p.scaling_speed,
            context.limits.max_vel_trans,
            p.max_scaling_factor,
            p.sum_scores,
            g.nx,
            g.ny,
            *context.state.pose,
            self._goal_front.params.forward_point_distance,
            self._alignment.params.forward_point_distance,
            *self._oscillation.allowed_signs,
        )
        return self._cycle, np.array(weights)

    def _fit(self, context: ScoringContext, k: int, t: int) -> None:
        """Enlarge the buffers to the map and the rollouts of this cycle."""
        ny, nx = context.costmap.data.shape
        size = storage_size(nx, ny)
        if self._grids.shape[1] != size:
            self._grids = np.empty((3, size), np.int32)
        if len(self._cells) < 2 * k * t + 4 * (k + 1):
            self._cells = np.empty(2 * k * t + 4 * (k + 1), np.int32)
        if len(self._first_collision) != k:
            self._first_collision = np.empty(k, np.int64)

# pyright: basic
"""Critics of trajectory rollout (TrajectoryPlanner::generateTrajectory of base_local_planner)."""

from __future__ import annotations

import math
import sys
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import kernel, line_next, line_start
from navstack.local_planner.critics.goal import GoalCritic, GoalParams
from navstack.local_planner.critics.obstacle import ObstacleCritic, ObstacleParams
from navstack.local_planner.map_grid import BLOCKED, CENTER_CODES, FREE_UNREACHED, STATE_SIZE, MapGrid, MapGridCritic
from navstack.local_planner.rollouts import single_points
from navstack.plugins import Critic, RejectionDetail, Rollouts, ScoringContext

HEADING_SCALE = 0.3
"""Weight of the heading error with heading_scoring: a constant in C++."""
NOT_VISIBLE = sys.float_info.max
"""Heading error if no pose of the plan is visible, as in C++."""


class PathDistanceCritic(MapGridCritic[None]):
    """Distance to the plan, in cells or meters; cells under the robot count as free."""

    CODES: ClassVar[dict[int, str]] = CENTER_CODES

    def __init__(self, bias: float, per_meter: bool) -> None:
        super().__init__("path", None)
        self._bias = bias
        self._per_meter = per_meter
        self._scratch = np.empty((2, 0), np.int64)

    def weight(self, context: ScoringContext) -> float:
        """The bias, per cell or per meter."""
        return self._bias * (context.costmap.geometry.resolution if self._per_meter else 1.0)

    def build(self, context: ScoringContext) -> MapGrid:
        """Distances to the plan."""
        nx = context.costmap.geometry.nx
        if self._scratch.shape[1] != nx:
            self._scratch = np.empty((2, nx), np.int64)
        built = self._builder.build(context, context.plan, context.state.pose[:2], last_only=False)
        pose = np.array(context.state.pose)
        open_footprint(built.grid, built.storage, context.footprint.vertices, pose, self._scratch[0], self._scratch[1])
        return built


class GoalDistanceCritic(GoalCritic):
    """Distance to the local goal, in cells or meters."""

    def __init__(self, bias: float, per_meter: bool) -> None:
        super().__init__("goal", GoalParams())
        self._bias = bias
        self._per_meter = per_meter

    def weight(self, context: ScoringContext) -> float:
        """The bias, per cell or per meter."""
        return self._bias * (context.costmap.geometry.resolution if self._per_meter else 1.0)


class SimpleAttractorCritic(Critic[None]):
    """simple_attractor: squared distance (m²) from the last point to the end of the local plan."""

    def __init__(self, weight: float) -> None:
        super().__init__("goal", None)
        self._weight = weight
        self._end = np.zeros(2)

    @property
    def scale(self) -> float:
        """The goal's bias."""
        return self._weight

    def prepare(self, context: ScoringContext) -> None:
        """Store the end of the plan."""
        self._end = context.plan[-1, :2]

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) m²."""
        rows = np.arange(len(rollouts.counts))
        last = rollouts.poses[rows, np.maximum(rollouts.counts - 1, 0), :2]
        return np.where(rollouts.alive, ((last - self._end) ** 2).sum(axis=1), 0.0)


class UnscaledObstacleCritic(ObstacleCritic):
    """Highest cost under a footprint that does not grow with speed."""

    def __init__(self, weight: float, per_meter: bool) -> None:
        super().__init__("obstacle", ObstacleParams(occdist_scale=weight, scaling_speed=1e9))
        self._per_meter = per_meter

    def weight(self, context: ScoringContext) -> float:
        """The weight, times the resolution before 2018 with meter_scoring."""
        return self.params.occdist_scale * (context.costmap.geometry.resolution if self._per_meter else 1.0)


class HeadingCritic(Critic[None]):
    """heading_scoring: angle (rad) between the heading and the direction of the farthest visible pose of the plan."""

    def __init__(self) -> None:
        super().__init__("heading", None)
        self._context: ScoringContext | None = None

    @property
    def scale(self) -> float:
        """The constant of C++."""
        return HEADING_SCALE

    def prepare(self, context: ScoringContext) -> None:
        """Store the costmap and the plan of this cycle."""
        self._context = context

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) rad at the first point; NOT_VISIBLE if no pose of the plan is visible from there."""
        if self._context is None:
            raise RuntimeError("prepare was not called")
        costmap = self._context.costmap
        g = costmap.geometry
        out = np.zeros(len(rollouts.counts))
        if rollouts.poses.shape[1]:
            poses = np.ascontiguousarray(rollouts.poses[:, 0])
            plan = self._context.plan
            heading_errors(costmap.data, g.origin_x, g.origin_y, g.resolution, plan, poses, rollouts.alive, out)
            out[np.isinf(out)] = NOT_VISIBLE
        return out


class SinglePointCritic(Critic):
    """heading_scoring: applies another critic to one point only, `seconds` along rollouts of `sim_time` (s)."""

    def __init__(self, inner: Critic, seconds: float, sim_time: float) -> None:
        super().__init__(inner.name, inner.params)
        self._inner = inner
        self._seconds = seconds
        self._sim_time = sim_time

    @property
    def scale(self) -> float:
        """Weight of the inner critic."""
        return self._inner.scale

    def prepare(self, context: ScoringContext) -> None:
        """Prepare the inner critic."""
        self._inner.prepare(context)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) scores of the inner critic; 0 if the rollouts are too short."""
        steps = int(rollouts.counts.max(initial=0))
        if steps == 0:
            return np.zeros(len(rollouts.counts))
        point = self.point(steps)
        if point < 0:
            return np.zeros(len(rollouts.counts))
        return self._inner.score(single_points(rollouts, point))

    def point(self, steps: int) -> int:
        """The last of `steps` points whose time is in the period from `seconds` on, -1 if none is; rounded as in C++."""
        period, time, point = self._sim_time / steps, 0.0, -1
        for i in range(steps):
            if time >= self._seconds + period:
                break
            if time >= self._seconds:
                point = i
            time += period
        return point

    def explain(self, row: int) -> RejectionDetail:
        """Rejection by the inner critic."""
        detail = self._inner.explain(row)
        return detail if detail.reason else RejectionDetail()


# --- kernels --------------------------------------------------------------------------------------------------------


@kernel
def heading_errors(costs, origin_x, origin_y, resolution, plan, poses, alive, out):
    """Write the angle (rad) from each pose's heading to the farthest visible cell of the plan to `out` (K,).

    `poses` (K, 3). A cell is visible if no cell on the line to it costs 253 or more; inf if no cell is visible.
    """
    ny, nx = costs.shape
    flat = costs.ravel()
    for k in range(len(poses)):
        if not alive[k]:
            continue
        out[k] = np.inf
        x, y = poses[k, 0], poses[k, 1]
        fx, fy = (x - origin_x) / resolution, (y - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            continue
        x0, y0 = int(fx), int(fy)
        for j in range(len(plan) - 1, -1, -1):
            gx, gy = (plan[j, 0] - origin_x) / resolution, (plan[j, 1] - origin_y) / resolution
            if not (gx >= 0.0 and gy >= 0.0 and gx < nx and gy < ny):
                continue
            x1, y1 = int(gx), int(gy)
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            free = True
            for _ in range(line[0] + 1):
                if flat[cell] >= 253:
                    free = False
                    break
                cell, error = line_next(cell, error, line)
            if free:
                to_x = origin_x + (x1 + 0.5) * resolution - x
                to_y = origin_y + (y1 + 0.5) * resolution - y
                turn = math.atan2(to_y, to_x) - poses[k, 2]
                out[k] = abs(turn - 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi)))
                break


@kernel
def open_footprint(grid, storage, vertices, pose, lows, highs):
    """Make blocked cells under the footprint at `pose` passable in a started wavefront: the robot already covers them.

    As FootprintHelper::getFootprintCells: the cells on the edges and between them; if a vertex is off the map, only the edges
    before it. `grid`, `storage`: see `start_wavefront`. `lows`, `highs` (nx,) int64 are scratch.
    """
    nx, ny = grid[0].nx, grid[0].ny
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    width = nx + 2
    distances = storage[STATE_SIZE : STATE_SIZE + (ny + 2) * width]
    c, s = math.cos(pose[2]), math.sin(pose[2])
    lows[:] = ny
    highs[:] = -1
    number = len(vertices)
    x0, y0 = 0, 0
    filled = True
    for i in range(number + 1):
        j = 0 if i == number else i
        fx = ((pose[0] + (vertices[j, 0] * c - vertices[j, 1] * s)) - origin_x) / resolution
        fy = ((pose[1] + (vertices[j, 0] * s + vertices[j, 1] * c)) - origin_y) / resolution
        if not (fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny):
            filled = False
            break
        x1, y1 = int(fx), int(fy)
        if i > 0:
            line = line_start(x0, y0, x1, y1, nx)
            cell, error = y0 * nx + x0, line[0] // 2
            for _ in range(line[0] + 1):
                iy = cell // nx
                ix = cell - iy * nx
                lows[ix] = min(lows[ix], iy)
                highs[ix] = max(highs[ix], iy)
                open_cell(distances, (iy + 1) * width + ix + 1)
                cell, error = line_next(cell, error, line)
        x0, y0 = x1, y1
    if filled:
        for ix in range(nx):
            for iy in range(lows[ix], highs[ix] + 1):
                open_cell(distances, (iy + 1) * width + ix + 1)


@kernel
def open_cell(distances, cell):
    """Make a blocked cell passable."""
    if distances[cell] == BLOCKED:
        distances[cell] = FREE_UNREACHED

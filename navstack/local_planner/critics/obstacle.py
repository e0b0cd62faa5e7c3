"""Keeps the robot's footprint off obstacles (base_local_planner/src/obstacle_cost_function.cpp, costmap_model.cpp)."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Costmap, Footprint, Pose2D, describe_cost
from navstack.core.footprint_kernels import overlaps_cell
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import Critic, RejectionDetail, Rollouts, ScoringContext
from navstack.local_planner.critics._bound_kernels import BOUND_GRIDS
from navstack.local_planner.critics._footprint_table_kernels import table_scratch_size
from navstack.local_planner.critics._kernels import obstacle_scores
from navstack.local_planner.critics._weights import RosDistro, obstacle_weight
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS

OBSTACLE_SETTINGS = np.dtype(
    [
        ("origin_x", "f8"),
        ("origin_y", "f8"),
        ("resolution", "f8"),
        ("circumscribed_radius", "f8"),
        ("scaling_speed", "f8"),
        ("max_speed", "f8"),
        ("max_scaling", "f8"),
        ("sum_scores", "?"),
    ]
)
"""Settings of the obstacle kernels: m, m, m, m, m/s, m/s, -, -."""


LONG_EDGE = 9.0
"""Cells: footprints whose edges are as long on average are scored by tables; shorter ones are walked faster."""


FEW_POINTS = 100
"""Fewer points are walked, too: tables are not worth while."""


class ObstacleScratch:
    """Memory of the obstacle kernels, kept between cycles.

    It contains the bounds of footprints that are walked and, for footprints with long edges, the tables of their edges.
    """

    def __init__(self) -> None:
        self._array = np.empty(0, np.uint8)
        self._for: tuple[Footprint | None, float] = None, 0.0
        self._vertices = 0

    def fit(self, context: ScoringContext, points: int) -> NDArray[np.uint8]:
        """Memory for this cycle's costmap and footprint, and for rollouts of `points` points."""
        g, footprint = context.costmap.geometry, context.footprint
        if self._for[0] is not footprint or self._for[1] != g.resolution:
            self._for = footprint, g.resolution
            edges = footprint.vertices - np.roll(footprint.vertices, 1, axis=0)
            long = float(np.hypot(*edges.T).mean()) >= LONG_EDGE * g.resolution
            self._vertices = len(edges) if long else 0
        size = (g.nx * g.ny * BOUND_GRIDS + 7) // 8 * 8
        tables = self._vertices > 0 and points >= FEW_POINTS
        if tables:
            size += table_scratch_size(points, self._vertices)
        if len(self._array) < size:
            self._array = np.empty(size, np.uint8)
        return self._array if tables else self._array[:size]


class ObstacleParams(ParamModel):
    """Weight, and how the footprint grows with speed."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0)
    scaling_speed: float = param(0.25, "speed above which the footprint grows", unit="m/s", ge=0.0)
    max_scaling_factor: float = param(0.2, "growth of the footprint at max_vel_trans", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of their maximum")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("obstacle", aliases=("base_local_planner/ObstacleCostFunction",))
class ObstacleCritic(Critic):
    """Highest cost along the footprint's edges and under its centre; rejects footprints that overlap lethal cells."""

    Params: ClassVar[type[ParamModel]] = ObstacleParams
    CODES: ClassVar[dict[int, str]] = {-6: "footprint on a lethal or unknown cell, or off the map"}

    def __init__(self, name: str, params: ObstacleParams) -> None:
        super().__init__(name, params)
        self.params: ObstacleParams = params
        self._scale = params.occdist_scale
        self._context: ScoringContext | None = None
        self._rollouts: Rollouts | None = None
        self._scratch = ObstacleScratch()
        self._out = np.empty(0)
        self.first_collision: NDArray[np.int64] = np.empty(0, np.int64)
        """(K,) index of the first point in collision, -1 without; of the last scored cycle."""

    @property
    def scale(self) -> float:
        """`occdist_scale`; times the resolution before 2018."""
        return self._scale

    def weight(self, context: ScoringContext) -> float:
        """`occdist_scale`; times the resolution before 2018."""
        p = self.params
        return obstacle_weight(p.occdist_scale, context.costmap.geometry.resolution, p.ros_distro)

    def prepare(self, context: ScoringContext) -> None:
        """Store the costmap and the footprint of this cycle."""
        self._context = context
        self._scale = self.weight(context)

    def settings(self, context: ScoringContext) -> NDArray[Any]:
        """(1,) of OBSTACLE_SETTINGS."""
        g, p = context.costmap.geometry, self.params
        record = np.empty(1, OBSTACLE_SETTINGS)
        record[0] = (
            g.origin_x,
            g.origin_y,
            g.resolution,
            context.footprint.circumscribed_radius,
            p.scaling_speed,
            context.limits.max_vel_trans,
            p.max_scaling_factor,
            p.sum_scores,
        )
        return record

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) costs in 0..253 (their sum with `sum_scores`), or -6."""
        context = self._context
        if context is None:
            raise RuntimeError("prepare was not called")
        k = len(rollouts.counts)
        if len(self._out) != k:
            self._out = np.empty(k)
        if len(self.first_collision) != k:
            self.first_collision = np.empty(k, np.int64)
        cells = shared_cells(context, rollouts)
        self._rollouts = rollouts
        obstacle_scores(
            context.costmap.data,
            self.settings(context),
            context.footprint.vertices,
            rollouts.commands,
            rollouts.poses,
            rollouts.counts,
            rollouts.alive,
            cells.flat,
            cells.boxes,
            self._scratch.fit(context, rollouts.poses.shape[0] * rollouts.poses.shape[1]),
            self._out,
            self.first_collision,
        )
        return self._out

    def set_result(
        self, context: ScoringContext, rollouts: Rollouts, scale: float, first_collision: NDArray[np.int64]
    ) -> None:
        """Store the result of a cycle that was not scored by `score`."""
        self._context, self._rollouts, self._scale = context, rollouts, scale
        self.first_collision = first_collision

    # --- diagnostics ------------------------------------------------------------------------------------------------

    def explain(self, row: int) -> RejectionDetail:
        """Point, pose and cell of the row's first collision."""
        context, rollouts = self._context, self._rollouts
        if context is None or rollouts is None or self.first_collision[row] < 0:
            return RejectionDetail()
        step = int(self.first_collision[row])
        pose = Pose2D(*(float(v) for v in rollouts.poses[row, step]))
        speed = float(np.hypot(rollouts.commands[row, 0], rollouts.commands[row, 1]))
        scale = self.footprint_scale(speed, context.limits.max_vel_trans)
        found = first_lethal_cell(context.costmap, context.footprint, pose, scale)
        return RejectionDetail(
            reason=f"footprint on {describe_cost(found[2])}" if found else "footprint off the map",
            step=step,
            pose=pose,
            ahead_m=self._travelled(row),
            cell=found[:2] if found else None,
            cost=found[2] if found else None,
        )

    def nearest_rejection(self, rows: NDArray[np.intp]) -> int:
        """The row that travels the shortest distance before its collision."""
        return min(rows.tolist(), key=lambda row: (self.first_collision[row] < 0, self._travelled(row)))

    def _travelled(self, row: int) -> float:
        """Distance (m) that a row travels before its collision."""
        assert self._rollouts is not None
        step = int(self.first_collision[row])
        along = self._rollouts.poses[row, : step + 1, :2]
        return float(np.hypot(*np.diff(along, axis=0).T).sum()) if step > 0 else 0.0

    def footprint_scale(self, speed: float, max_speed: float) -> float:
        """Factor by which the footprint has grown at `speed` (m/s)."""
        p = self.params
        if speed <= p.scaling_speed or max_speed <= p.scaling_speed:
            return 1.0
        return p.max_scaling_factor * ((speed - p.scaling_speed) / (max_speed - p.scaling_speed)) + 1.0


def first_lethal_cell(
    costmap: Costmap, footprint: Footprint, pose: Pose2D, scale: float
) -> tuple[int, int, int] | None:
    """(ix, iy, cost) of the first cell of at least 254 along the footprint's edges, else of the first lethal cell that it
    overlaps; None if it only leaves the map.

    The edges are rasterized as in the obstacle kernel: from vertex to vertex (Bresenham), the longer axis leading.
    """
    g = costmap.geometry
    corners = Footprint(footprint.vertices * scale).at(pose)
    cells = np.floor((corners - (g.origin_x, g.origin_y)) / g.resolution).astype(np.int64).tolist()
    for (x0, y0), (x1, y1) in pairwise([*cells, cells[0]]):
        dx, dy = x1 - x0, y1 - y0
        steps, add = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
        step_x, step_y = (1 if dx >= 0 else -1), (1 if dy >= 0 else -1)
        for m in range(steps + 1):
            side = (steps // 2 + m * add) // max(steps, 1)
            along_x = abs(dx) >= abs(dy)
            ix = x0 + (m if along_x else side) * step_x
            iy = y0 + (side if along_x else m) * step_y
            if 0 <= ix < g.nx and 0 <= iy < g.ny and costmap.data[iy, ix] >= 254:
                return ix, iy, int(costmap.data[iy, ix])
    placed = ((corners - (g.origin_x, g.origin_y)) / g.resolution).T.copy()
    low, high = np.maximum(placed.min(axis=1), 0).astype(int), placed.max(axis=1).astype(int)
    for iy, ix in (
        np.argwhere(costmap.data[low[1] : high[1] + 1, low[0] : high[0] + 1] == LETHAL) + low[::-1]
    ).tolist():
        if overlaps_cell(placed, ix, iy):
            return ix, iy, LETHAL
    return None

# pyright: basic
"""Critics of DWB that DWA does not have in this form: ObstacleFootprint, Oscillation, Twirling (dwb_critics).

BaseObstacle, PreferForward and RotateToGoal are in `navstack.local_planner.critics`: planners of ROS 1 can list them, too. Those
that measure distances to the plan are in `map_grid`.
"""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, Pose2D, Twist2D, angle_between, edge_cost, kernel, plain_kernel
from navstack.local_planner.critics.obstacle import collision_detail, highest_around, nearest_collision
from navstack.local_planner.critics.twirling import TwirlingCritic
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS, Critic, ParamModel, RejectionDetail, Rollouts, ScoringContext, param

# ----------------------------------------------------------------------------------------------------------------------
# ObstacleFootprint.


OFF_GRID, CORNER_OFF_GRID, ON_OBSTACLE, ON_UNKNOWN = -4.0, -5.0, -6.0, -7.0


class ObstacleFootprintParams(ParamModel):
    """Weight, and how the costs along a trajectory are combined."""

    scale: float = param(1.0, "weight of this critic, times the resolution of the costmap", ge=0.0)
    sum_scores: bool = param(False, "sum of the costs along the trajectory instead of the cost of its last point")


@CRITICS.register("ObstacleFootprint", aliases=("dwb_critics/ObstacleFootprintCritic",))
class ObstacleFootprintCritic(Critic[ObstacleFootprintParams]):
    """Highest cost along the footprint's outline; rejects outlines on lethal or unknown cells, or off the map.

    Only the outline counts: an obstacle that is entirely inside of the footprint is not seen, as in Nav2.
    """

    Params: ClassVar[type[ParamModel]] = ObstacleFootprintParams
    CODES: ClassVar[dict[int, str]] = {
        int(OFF_GRID): "Trajectory Goes Off Grid.",
        int(CORNER_OFF_GRID): "Footprint Goes Off Grid.",
        int(ON_OBSTACLE): "Trajectory Hits Obstacle.",
        int(ON_UNKNOWN): "Trajectory Hits Unknown Region.",
    }

    def __init__(self, name: str, params: ObstacleFootprintParams) -> None:
        super().__init__(name, params)
        self._context: ScoringContext | None = None
        self._rollouts: Rollouts | None = None
        self._footprint: Footprint | None = None
        self._scale = params.scale
        self._corners, self._cells = np.empty((2, 0)), np.empty((2, 0), np.int32)
        self._bounds = np.empty((2, 0, 0), np.uint8)
        self._out = np.empty(0)
        self._first_collision = np.empty(0, np.int64)

    @property
    def scale(self) -> float:
        """`scale` times the resolution, of the last prepared cycle."""
        return self._scale

    def prepare(self, context: ScoringContext) -> None:
        """Store the costmap and the footprint of this cycle."""
        self._context = context
        self._scale = context.costmap.geometry.resolution * self.params.scale
        if self._footprint is not context.footprint:
            self._footprint = context.footprint
            self._corners = np.ascontiguousarray(context.footprint.vertices.T)
            self._cells = np.empty(self._corners.shape, np.int32)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) costs in 0..253 (their sum with `sum_scores`), or a negative code."""
        context, k = self._context, len(rollouts.counts)
        if context is None:
            raise RuntimeError("prepare was not called")
        self._rollouts = rollouts
        if len(self._out) != k:
            self._out, self._first_collision = np.empty(k), np.empty(k, np.int64)
        costs = context.costmap.data
        if self._bounds.shape[1:] != costs.shape:
            self._bounds = np.empty((2, *costs.shape), np.uint8)
        cells = shared_cells(context, rollouts)
        outline_scores(
            costs,
            context.grid,
            self._corners,
            rollouts.poses,
            rollouts.counts,
            cells.flat,
            cells.boxes,
            bool(self.params.sum_scores),
            self._bounds,
            self._cells,
            self._out,
            self._first_collision,
        )
        return self._out

    def explain(self, row: int) -> RejectionDetail:
        """Point, pose and cell of the row's first collision."""
        if self._context is None or self._rollouts is None or self._first_collision[row] < 0:
            return RejectionDetail()
        return collision_detail(self._context, self._rollouts, row, int(self._first_collision[row]))

    def nearest_rejection(self, rows: NDArray[np.intp]) -> int:
        """The row that travels the shortest distance before its collision."""
        assert self._rollouts is not None
        return nearest_collision(self._rollouts, rows, self._first_collision[rows])


@kernel
def outline_scores(costs, grid, corners, poses, counts, cells, boxes, sums, bounds, scratch, out, first_collision):
    """Write per rollout the cost of the footprint's outline at the last point, or with `sums` at all points, to `out` (K,).

    A negative code if the outline is on a lethal or unknown cell or off the map at any point. `corners` (2, n) of the footprint,
    `cells` (K, T) and `boxes` (K + 1, 4) of `point_cells`; `bounds` (2, ny, nx) and `scratch`
    (2, n) are scratch. `first_collision` (K,): index of that point, -1 without.
    """
    ny, nx = costs.shape
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    last = len(counts)
    x0, y0, x1, y1 = (
        np.int64(boxes[last, 0]),
        np.int64(boxes[last, 1]),
        np.int64(boxes[last, 2]),
        np.int64(boxes[last, 3]),
    )
    radius = 0.0
    for j in range(corners.shape[1]):
        radius = max(radius, math.hypot(corners[0, j], corners[1, j]))
    reach = min(radius / resolution + 1e-6, float(nx + ny))
    highest_around(costs, x0, y0, x1, y1, reach, bounds[1], bounds[0])
    around = bounds[0].reshape(ny * nx)
    # all rollouts begin at the robot's pose, and most end with the same pose twice
    before_x, before_y, before_yaw, before = np.nan, 0.0, 0.0, np.int64(0)
    start_x, start_y, start_yaw, start = np.nan, 0.0, 0.0, np.int64(0)
    for k in range(len(counts)):
        first_collision[k] = -1
        score = 0.0
        n = counts[k]
        for i in range(n):
            if cells[k, i] < 0:
                score = OFF_GRID
                first_collision[k] = i
                break
            bound = around[cells[k, i]]
            cost = np.int64(0)
            if bound >= 254 or (bound > 0 and (sums or i + 1 == n)):
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                if i == 0 and x == start_x and y == start_y and yaw == start_yaw:
                    cost = start
                elif x == before_x and y == before_y and yaw == before_yaw:
                    cost = before
                else:
                    cost = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, scratch)
                before_x, before_y, before_yaw, before = x, y, yaw, cost
                if i == 0:
                    start_x, start_y, start_yaw, start = x, y, yaw, cost
                if cost >= 254:
                    first_collision[k] = i
                    score = ON_OBSTACLE
                    if cost != 254:
                        score = outline_fault(costs, origin_x, origin_y, resolution, corners, x, y, yaw, scratch)
                    break
            score = score + cost if sums else np.float64(cost)
        out[k] = score


@plain_kernel
def outline_fault(costs, origin_x, origin_y, resolution, corners, x, y, yaw, cells):
    """Return the code of the first cell of an outline in collision, in the order of its edges (from corner 0 on).

    An edge of which a corner is off the map counts as CORNER_OFF_GRID, whatever is on it. `cells` (2, n) is scratch.
    """
    ny, nx = costs.shape
    number = corners.shape[1]
    c, s = math.cos(yaw), math.sin(yaw)
    for j in range(number):
        fx = ((x + (corners[0, j] * c - corners[1, j] * s)) - origin_x) / resolution
        fy = ((y + (corners[0, j] * s + corners[1, j] * c)) - origin_y) / resolution
        inside = fx >= 0.0 and fy >= 0.0 and fx < nx and fy < ny
        cells[0, j] = np.int32(fx) if inside else -1
        cells[1, j] = np.int32(fy) if inside else -1
    for j in range(number):
        end = j + 1 if j + 1 < number else 0
        if cells[0, j] < 0 or cells[0, end] < 0:
            return CORNER_OFF_GRID
        cell_x, cell_y = np.int64(cells[0, j]), np.int64(cells[1, j])
        dx, dy = np.int64(cells[0, end]) - cell_x, np.int64(cells[1, end]) - cell_y
        along_x = abs(dx) >= abs(dy)
        steps, add = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
        sign_x, sign_y = 1 if dx >= 0 else -1, 1 if dy >= 0 else -1
        for i in range(steps + 1):
            side = (steps // 2 + i * add) // max(steps, 1)
            ix = cell_x + (i if along_x else side) * sign_x
            iy = cell_y + (side if along_x else i) * sign_y
            if costs[iy, ix] == 254:
                return ON_OBSTACLE
            if costs[iy, ix] == 255:
                return ON_UNKNOWN
    return CORNER_OFF_GRID


# ----------------------------------------------------------------------------------------------------------------------
# Oscillation.


REVERSAL = -5.0
AXES = ("x", "y", "theta")


class OscillationParams(ParamModel):
    """Weight, and the motion after which a forbidden direction is allowed again."""

    scale: float = param(1.0, "0 switches this critic off; its score is 0", ge=0.0)
    oscillation_reset_dist: float = param(
        0.05, "motion that allows every direction again; negative: no motion does", unit="m"
    )
    oscillation_reset_angle: float = param(
        0.2, "turn that allows every direction again; negative: no turn does", unit="rad"
    )
    oscillation_reset_time: float = param(
        -1.0, "time after which every direction is allowed again; negative: never", unit="s"
    )
    x_only_threshold: float = param(
        0.05, "sideways motion and turns count only up to this forward speed; negative: always", unit="m/s"
    )


@CRITICS.register("Oscillation", aliases=("dwb_critics/OscillationCritic",))
class OscillationCritic(Critic[OscillationParams]):
    """Rejects trajectories in a direction that the robot has just left.

    The rule of DWA's critic, in double precision, and per axis two flags: an axis that has changed its sign twice is forbidden
    in both directions.
    """

    Params: ClassVar[type[ParamModel]] = OscillationParams
    CODES: ClassVar[dict[int, str]] = {int(REVERSAL): "Trajectory is oscillating."}

    def __init__(self, name: str, params: OscillationParams) -> None:
        super().__init__(name, params)
        self.signs = [0, 0, 0]
        """Sign of the last command that moved each axis."""
        self.only = [[False, False], [False, False], [False, False]]
        """Per axis: only positive, only negative speeds are allowed."""
        self._since = Pose2D(0.0, 0.0)
        self._since_s = self._now_s = 0.0

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

    def reset(self) -> None:
        """Allow every direction."""
        self.signs = [0, 0, 0]
        self.only = [[False, False], [False, False], [False, False]]

    def prepare(self, context: ScoringContext) -> None:
        """Store the time of this cycle."""
        self._now_s = context.state.stamp

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) 0, or -5 for a forbidden direction."""
        scores = np.zeros(len(rollouts.counts))
        for axis, (positive, negative) in enumerate(self.only):
            if positive:
                scores[rollouts.commands[:, axis] < 0.0] = REVERSAL
            if negative:
                scores[rollouts.commands[:, axis] > 0.0] = REVERSAL
        return scores

    def debrief(self, command: Twist2D, pose: Pose2D) -> None:
        """Update the flags with the selected command."""
        p, changed = self.params, False
        for axis in (0, 1, 2) if p.x_only_threshold < 0.0 or abs(command.vx) <= p.x_only_threshold else (0,):
            sign = (command[axis] > 0.0) - (command[axis] < 0.0)
            if sign:
                if self.signs[axis] == -sign:
                    self.only[axis][0 if sign > 0 else 1] = True
                    changed = True
                self.signs[axis] = sign
        if changed:
            self._since, self._since_s = pose, self._now_s
        if any(positive or negative for positive, negative in self.only) and self._is_over(pose):
            self.reset()

    def _is_over(self, pose: Pose2D) -> bool:
        """True if the robot has moved, turned or waited enough since the last change of direction."""
        p, since = self.params, self._since
        dx, dy = pose.x - since.x, pose.y - since.y
        if p.oscillation_reset_dist >= 0.0 and dx * dx + dy * dy > p.oscillation_reset_dist * p.oscillation_reset_dist:
            return True
        # Nav2 differs: there a heading that passes pi has turned by almost a full turn
        turned = abs(angle_between(since.yaw, pose.yaw))
        if 0.0 <= p.oscillation_reset_angle < turned:
            return True
        # in nanoseconds, as the clocks of ROS count: a time that is exactly reached is not over
        waited, longest = round((self._now_s - self._since_s) * 1e9), round(p.oscillation_reset_time * 1e9)
        return p.oscillation_reset_time >= 0.0 and waited > longest

    def state(self) -> dict[str, Any]:
        """Which axes are limited to one direction."""
        flags: dict[str, Any] = {}
        for axis, (positive, negative) in zip(AXES, self.only, strict=True):
            flags[f"{axis}_positive_only"] = positive
            flags[f"{axis}_negative_only"] = negative
        return flags


# ----------------------------------------------------------------------------------------------------------------------
# Twirling.


class ScaledTwirlingParams(ParamModel):
    """Weight."""

    scale: float = param(1.0, "weight of the turning speed: prevents holonomic robots from spinning", ge=0.0)


@CRITICS.register("Twirling", aliases=("dwb_critics/TwirlingCritic",))
class ScaledTwirlingCritic(TwirlingCritic):
    """|wz| of the command, as the critic of DWA; its weight is `scale`."""

    Params: ClassVar[type[ParamModel]] = ScaledTwirlingParams
    params: Any

    @property
    def scale(self) -> float:
        """`scale`."""
        return self.params.scale

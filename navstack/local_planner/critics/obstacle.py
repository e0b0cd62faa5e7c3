# pyright: basic
"""Keeps the robot's footprint off obstacles (base_local_planner/src/obstacle_cost_function.cpp, costmap_model.cpp).

The cost of a point is exact: the edges of the footprint are walked cell by cell (`edge_cost`), and where a lethal cell may be
under it, so are the cells that it overlaps. That takes 0.1 to 0.3 us a point. Two upper bounds decide where it can be left out
without changing a score: per cell of the map the highest cost that a footprint with its center there can touch
(`highest_around`, 5 us a cycle), and the highest cost that it can touch with its heading (`footprint_rows`, 15 ns a point).
In an office, the first leaves two fifths of the points to the exact check, in an open hall a twentieth; the second, among
obstacles on all sides, a third of those.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    Costmap,
    Footprint,
    Pose2D,
    describe_cost,
    edge_cost,
    overlaps_cell,
    place_footprint,
    plain_kernel,
)
from navstack.local_planner.map_grid import RosDistro
from navstack.local_planner.rollouts import shared_cells
from navstack.plugins import CRITICS, Critic, ParamModel, RejectionDetail, Rollouts, ScoringContext, param

IN_COLLISION = -6.0
OBSTACLE_SETTINGS = np.dtype(
    [
        ("circumscribed_radius", "f8"),
        ("scaling_speed", "f8"),
        ("max_speed", "f8"),
        ("max_scaling", "f8"),
        ("sum_scores", "?"),
    ]
)
"""Settings of the obstacle kernels: m, m/s, m/s, -, -."""
BOUND_GRIDS = 3
"""Upper bounds of the footprint, of the largest scaled footprint, and scratch."""
REACH_MARGIN = 1e-6
"""Cells, for rounding."""
ROUND = 0.8
"""Ratio of the inscribed to the circumscribed radius from which on a footprint is nearly round."""
HEADINGS = 64
"""Sectors of headings for which the cells under a footprint are known in advance; a power of two."""
PARTS = 2
"""Parts of a cell, along each axis, for which they are known."""
SIZES = 4
"""Ranges of scales of a footprint that grows with speed, for which they are known."""


class ObstacleParams(ParamModel):
    """Weight, and how the footprint grows with speed."""

    FROM_NAVSTACK = frozenset({"ros_distro"})

    occdist_scale: float = param(0.01, "weight of the obstacle cost", ge=0.0)
    scaling_speed: float = param(0.25, "speed above which the footprint grows", unit="m/s", ge=0.0)
    max_scaling_factor: float = param(0.2, "growth of the footprint at max_vel_trans", ge=0.0)
    sum_scores: bool = param(False, "sum of the obstacle costs along a trajectory instead of their maximum")
    ros_distro: RosDistro = param("noetic", "scoring scale of noetic, or of the releases before 2018")


@CRITICS.register("obstacle", aliases=("base_local_planner/ObstacleCostFunction",))
class ObstacleCritic(Critic[ObstacleParams]):
    """Highest cost along the footprint's edges and under its center; rejects footprints that overlap lethal cells."""

    Params: ClassVar[type[ParamModel]] = ObstacleParams
    CODES: ClassVar[dict[int, str]] = {int(IN_COLLISION): "footprint on a lethal or unknown cell, or off the map"}

    def __init__(self, name: str, params: ObstacleParams) -> None:
        super().__init__(name, params)
        self._scale = params.occdist_scale
        self._context: ScoringContext | None = None
        self._rollouts: Rollouts | None = None
        self._settings = np.empty(1, OBSTACLE_SETTINGS)
        self._settings_for: tuple[Footprint | None, float] = None, 0.0
        self._rows_for: tuple[Any, ...] = ()
        self._bounds = np.empty((BOUND_GRIDS, 0, 0), np.uint8)
        self._rows = np.empty((1, HEADINGS * PARTS**2, 0), np.int32)
        self._scratch = np.empty((5, 0))
        self._out = np.empty(0)
        self.first_collision: NDArray[np.int64] = np.empty(0, np.int64)
        """(K,) index of the first point in collision, -1 without; of the last scored cycle."""

    @property
    def scale(self) -> float:
        """Weight of a cost in the last prepared cycle."""
        return self._scale

    def weight(self, context: ScoringContext) -> float:
        """`occdist_scale`; times the resolution before 2018 (parity 31)."""
        p = self.params
        return p.occdist_scale * (context.costmap.geometry.resolution if p.ros_distro == "indigo" else 1.0)

    def prepare(self, context: ScoringContext) -> None:
        """Store the costmap and the footprint of this cycle."""
        self._context = context
        self._scale = self.weight(context)

    def score(self, rollouts: Rollouts) -> NDArray[np.float64]:
        """(K,) costs in 0..253 (their sum with `sum_scores`), or -6."""
        context = self._context
        if context is None:
            raise RuntimeError("prepare was not called")
        self._rollouts = rollouts
        k = len(rollouts.counts)
        if len(self._out) != k:
            self._out, self.first_collision = np.empty(k), np.empty(k, np.int64)
        costs, footprint = context.costmap.data, context.footprint
        max_speed = context.limits.max_vel_trans
        if self._settings_for[0] is not footprint or self._settings_for[1] != max_speed:
            p = self.params
            radius = footprint.circumscribed_radius
            self._settings[0] = (radius, p.scaling_speed, max_speed, p.max_scaling_factor, p.sum_scores)
            self._settings_for = footprint, max_speed
            self._scratch = np.empty((5, len(footprint.vertices)))
        growth = self.params.max_scaling_factor if max_speed > self.params.scaling_speed else 0.0
        rows_for = footprint, context.costmap.geometry.resolution, costs.shape, growth
        if self._rows_for != rows_for:
            self._rows, self._rows_for = touched_rows(*rows_for), rows_for
            self._bounds = np.empty((BOUND_GRIDS + (self._rows.shape[2] // 2).bit_length(), *costs.shape), np.uint8)
        cells = shared_cells(context, rollouts)
        obstacle_scores(
            costs,
            context.grid,
            self._settings,
            footprint.vertices,
            rollouts.commands,
            rollouts.poses,
            rollouts.counts,
            rollouts.alive,
            cells.flat,
            cells.boxes,
            self._rows,
            self._bounds,
            self._scratch,
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
        speed = float(np.hypot(rollouts.commands[row, 0], rollouts.commands[row, 1]))
        scale = self.footprint_scale(speed, context.limits.max_vel_trans)
        return collision_detail(context, rollouts, row, step, scale)

    def nearest_rejection(self, rows: NDArray[np.intp]) -> int:
        """The row that travels the shortest distance before its collision."""
        assert self._rollouts is not None
        return nearest_collision(self._rollouts, rows, self.first_collision[rows])

    def footprint_scale(self, speed: float, max_speed: float) -> float:
        """Factor by which the footprint has grown at `speed` (m/s)."""
        p = self.params
        return float(footprint_scale(float(speed), p.scaling_speed, float(max_speed), p.max_scaling_factor))


@lru_cache(maxsize=8)
def touched_rows(footprint: Footprint, resolution: float, shape: tuple[int, int], growth: float) -> NDArray[np.int32]:
    """(1 + SIZES, ..) `footprint_rows` of a footprint and of those that have grown by up to `growth`; (1, ..) without growth.

    For a costmap of this resolution (m) and `shape`. Of size 0 for a footprint that is nearly round, because it touches the same
    cells with every heading, and for one that has no place in the costmap.
    """
    reach = footprint.circumscribed_radius * (1.0 + growth) / resolution + REACH_MARGIN
    columns = 2 * math.ceil(reach) + 1
    if footprint.inscribed_radius > ROUND * footprint.circumscribed_radius or columns > min(shape):
        columns = 0
    scales = [1.0, *(1.0 + growth * (np.arange(SIZES + 1) / SIZES) if growth > 0.0 else ())]
    rows = np.empty((max(len(scales) - 1, 1), HEADINGS * PARTS**2, 2 * columns), np.int32)
    vertices = footprint.vertices / resolution
    for low, high, out in zip(scales, [*scales[1:], 1.0], rows, strict=False):
        if columns:
            footprint_rows(vertices, low, high, *shape, out)
    return rows


def collision_detail(
    context: ScoringContext, rollouts: Rollouts, row: int, step: int, scale: float = 1.0
) -> RejectionDetail:
    """Describe the collision of the footprint, grown by `scale`, at point `step` of a rollout."""
    pose = Pose2D(*rollouts.poses[row, step].tolist())
    found = first_lethal_cell(context.costmap, context.footprint, pose, scale)
    return RejectionDetail(
        reason=f"footprint on {describe_cost(found[2])}" if found else "footprint off the map",
        step=step,
        pose=pose,
        ahead_m=travelled(rollouts, row, step),
        cell=found[:2] if found else None,
        cost=found[2] if found else None,
    )


def nearest_collision(rollouts: Rollouts, rows: NDArray[np.intp], steps: NDArray[np.int64]) -> int:
    """Return the row that travels the shortest distance up to its point `steps` (n,), -1: to none; the first of equal ones."""
    colliding = np.flatnonzero(steps >= 0)
    if not len(colliding):
        return int(rows[0])
    rows, steps = rows[colliding], steps[colliding]
    lengths = np.zeros((len(rows), int(steps.max()) + 1))
    with np.errstate(all="ignore"):  # what is behind a row's last point is arbitrary
        steps_m = np.hypot(*np.diff(rollouts.poses[rows, : lengths.shape[1], :2], axis=1).T).T
        np.cumsum(steps_m, axis=1, out=lengths[:, 1:])
    return int(rows[np.argmin(lengths[np.arange(len(rows)), steps])])


def travelled(rollouts: Rollouts, row: int, step: int) -> float:
    """Distance (m) that a rollout travels up to point `step`."""
    along = rollouts.poses[row, : step + 1, :2]
    return float(np.hypot(*np.diff(along, axis=0).T).sum()) if step > 0 else 0.0


def first_lethal_cell(
    costmap: Costmap, footprint: Footprint, pose: Pose2D, scale: float
) -> tuple[int, int, int] | None:
    """(ix, iy, cost) of the first cell of at least 254 along the footprint's edges, else of the first lethal cell that it
    overlaps; None if it only leaves the map.

    The edges are rasterized as in `edge_cost`: from vertex to vertex (Bresenham), the longer axis leading.
    """
    g = costmap.geometry
    corners = footprint.at(pose, scale)
    cells = np.floor((corners - (g.origin_x, g.origin_y)) / g.resolution).astype(np.int64).tolist()
    for (x0, y0), (x1, y1) in pairwise([*cells, cells[0]]):
        dx, dy = x1 - x0, y1 - y0
        steps, add = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
        step_x, step_y = (1 if dx >= 0 else -1), (1 if dy >= 0 else -1)
        along_x = abs(dx) >= abs(dy)
        for m in range(steps + 1):
            side = (steps // 2 + m * add) // max(steps, 1)
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


# --- kernels --------------------------------------------------------------------------------------------------------


@plain_kernel
def footprint_scale(speed, scaling_speed, max_speed, max_scaling):
    """Return the factor by which the footprint has grown at `speed` (m/s)."""
    if speed <= scaling_speed or max_speed <= scaling_speed:
        return 1.0
    return max_scaling * ((speed - scaling_speed) / (max_speed - scaling_speed)) + 1.0


@plain_kernel
def highest_around(costs, x0, y0, x1, y1, reach, rows, out):
    """Write an upper bound of the footprint's cost to `out` (ny, nx), for the cells x0 <= ix < x1, y0 <= iy < y1.

    The bound of a cell is the highest cost among all cells that a footprint can touch whose points are at most `reach` cells
    from a center anywhere in that cell: along each axis a point's cell is less than one cell away, and a cell of a rasterized
    edge at most half a cell more. Cells from which the footprint can leave the map get 255. `rows` (ny, nx) is scratch.
    """
    ny, nx = costs.shape
    source, across, target = costs.reshape(ny * nx), rows.reshape(ny * nx), out.reshape(ny * nx)
    radius = math.ceil(reach)
    low_x, high_x = max(x0, radius), min(x1, nx - radius)
    low_y, high_y = max(y0, radius), min(y1, ny - radius)
    for iy in range(y0, y1):
        for ix in range(x0, x1):
            out[iy, ix] = 0 if low_x <= ix < high_x and low_y <= iy < high_y else 255
    if low_x >= high_x or low_y >= high_y:
        return
    # unsigned indices cannot wrap around, so the loops over a row are vectorized
    number = np.uint64(high_x - low_x)
    for iy in range(low_y - radius, high_y + radius):
        base = np.uint64(iy * nx + low_x)
        for i in range(number):
            across[base + i] = source[base + i]
    width = 0
    for dy in range(radius, -1, -1):
        squared = reach * reach
        wanted = 0
        if squared >= max(0.0, dy - 1.0) ** 2:
            wanted = int(1.5 + math.sqrt(squared - max(0.0, dy - 1.0) ** 2))
        if squared >= max(0.0, dy - 1.5) ** 2:
            wanted = max(wanted, int(1.0 + math.sqrt(squared - max(0.0, dy - 1.5) ** 2)))
        while width < min(wanted, radius):
            width += 1
            for iy in range(low_y - radius, high_y + radius):
                base = np.uint64(iy * nx + low_x)
                left = np.uint64(iy * nx + low_x - width)
                right = np.uint64(iy * nx + low_x + width)
                for i in range(number):
                    across[base + i] = max(across[base + i], max(source[left + i], source[right + i]))
        for iy in range(low_y, high_y):
            base = np.uint64(iy * nx + low_x)
            above = np.uint64((iy + dy) * nx + low_x)
            below = np.uint64((iy - dy) * nx + low_x)
            for i in range(number):
                target[base + i] = max(target[base + i], max(across[above + i], across[below + i]))


@plain_kernel
def footprint_rows(vertices, smallest, largest, ny, nx, out):
    """Write which cells a footprint can touch with its heading in a sector and its center in a part of a cell.

    `vertices` (n, 2): corners in cells, times a factor from `smallest` to `largest`. `out` (HEADINGS * PARTS * PARTS, rows * 2)
    int32: by sector, part and row of cells two windows that cover the touched cells of the row, as differences of flat
    indices in the grids of `write_windows` (.., ny, nx). They contain all that `edge_cost` and `overlaps_cell` look at.
    """
    radius, number = out.shape[1] // 4, len(vertices)
    for k in range(len(out)):
        sector, part_y, part_x = k // PARTS**2, k // PARTS % PARTS, k % PARTS
        row = out[k]
        for i in range(0, len(row), 2):
            row[i], row[i + 1] = 2 * radius, -2 * radius
        row[2 * radius], row[2 * radius + 1] = 0, 0  # the center
        ax0, ay0, ax1, ay1 = corner_box(vertices[number - 1], smallest, largest, sector, part_x, part_y)
        for j in range(number):
            bx0, by0, bx1, by1 = corner_box(vertices[j], smallest, largest, sector, part_x, part_y)
            # the edge itself: it stays inside the boxes of its ends and the segments between their corners
            for side in range(4):
                x0, x1 = (ax0, bx0) if side % 2 else (ax1, bx1)
                y0, y1 = (ay0, by0) if side < 2 else (ay1, by1)
                add_segment(x0, y0, x1, y1, radius, row)
            add_segment(bx0, by0, bx0, by1, radius, row)
            add_segment(bx1, by0, bx1, by1, radius, row)
            # the lines of cells between the cells of its ends
            for x0 in range(math.floor(ax0), math.floor(ax1) + 1):
                for y0 in range(math.floor(ay0), math.floor(ay1) + 1):
                    for x1 in range(math.floor(bx0), math.floor(bx1) + 1):
                        for y1 in range(math.floor(by0), math.floor(by1) + 1):
                            add_line(x0, y0, x1, y1, radius, row)
            ax0, ay0, ax1, ay1 = bx0, by0, bx1, by1
        for i in range(0, len(row), 2):
            first, last = max(row[i], -radius), min(row[i + 1], radius)
            row[i], row[i + 1] = 0, 0  # the center, where the footprint cannot touch the row
            if first <= last:
                level = 0
                while 2 << level <= last - first + 1:
                    level += 1
                base = (level * ny + i // 2 - radius) * nx
                row[i], row[i + 1] = base + first, base + last + 1 - (1 << level)


@plain_kernel
def corner_box(vertex, smallest, largest, sector, part_x, part_y):
    """Return the box x0, y0, x1, y1 (cells) in which a corner can be, from the lower left corner of the center's cell on."""
    # the arc between both headings exceeds the box of its ends by its height at most
    height = largest * math.hypot(vertex[0], vertex[1]) * (1.0 - math.cos(math.pi / HEADINGS)) + 1e-6
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for end in range(2):
        angle = (sector + end) * (2.0 * math.pi / HEADINGS)
        x = vertex[0] * math.cos(angle) - vertex[1] * math.sin(angle)
        y = vertex[0] * math.sin(angle) + vertex[1] * math.cos(angle)
        low_x, high_x = min(low_x, min(smallest * x, largest * x)), max(high_x, max(smallest * x, largest * x))
        low_y, high_y = min(low_y, min(smallest * y, largest * y)), max(high_y, max(smallest * y, largest * y))
    left, low = part_x / PARTS - height, part_y / PARTS - height
    right, high = (part_x + 1) / PARTS + height, (part_y + 1) / PARTS + height
    return low_x + left, low_y + low, high_x + right, high_y + high


@plain_kernel
def add_segment(x0, y0, x1, y1, radius, row):
    """Extend the first and the last cell of each row of cells, `row` (rows * 2), to those that the segment (cells) touches."""
    low, high = min(y0, y1), max(y0, y1)
    slope = (x1 - x0) / (y1 - y0) if high - low > 1e-9 else 0.0
    for iy in range(max(math.floor(low), -radius), min(math.floor(high), radius) + 1):
        a, b = x0, x1
        if slope != 0.0:
            a, b = x0 + (max(iy, low) - y0) * slope, x0 + (min(iy + 1, high) - y0) * slope
        i = 2 * (iy + radius)
        row[i] = min(row[i], math.floor(min(a, b) - 1e-6))
        row[i + 1] = max(row[i + 1], math.floor(max(a, b) + 1e-6))


@plain_kernel
def add_line(x0, y0, x1, y1, radius, row):
    """Extend the first and the last cell of each row of cells, `row` (rows * 2), to those of a line of cells (Bresenham)."""
    dx, dy = x1 - x0, y1 - y0
    steps, add = max(abs(dx), abs(dy)), min(abs(dx), abs(dy))
    step_x, step_y = 1 if dx > 0 else -1, 1 if dy > 0 else -1
    for m in range(steps + 1):
        side = (steps // 2 + m * add) // max(steps, 1)
        ix = x0 + (m if abs(dx) >= abs(dy) else side) * step_x
        iy = y0 + (side if abs(dx) >= abs(dy) else m) * step_y
        if -radius <= iy <= radius:
            i = 2 * (iy + radius)
            row[i], row[i + 1] = min(row[i], ix), max(row[i + 1], ix)


@plain_kernel
def write_windows(costs, x0, y0, x1, y1, out):
    """Write the highest cost of 1, 2, 4, .. cells from each cell on along x to `out` (levels, ny, nx).

    For the windows inside x0 <= ix < x1, y0 <= iy < y1.
    """
    ny, nx = costs.shape
    for iy in range(max(y0, 0), min(y1, ny)):
        begin, end = np.uint64(max(x0, 0)), np.uint64(min(x1, nx))
        row = out[0, iy]
        for ix in range(begin, end):
            row[ix] = costs[iy, ix]
        for level in range(1, len(out)):
            before, row, width = out[level - 1, iy], out[level, iy], np.uint64(1 << (level - 1))
            for ix in range(begin, end - min(end - begin, np.uint64(2) * width - np.uint64(1))):
                row[ix] = max(before[ix], before[ix + width])


@plain_kernel
def write_lethal_ahead(costs, x0, y0, x1, y1, margin, out):
    """Write to `out` (ny, nx) how many cells there are to the next lethal one with a larger x; 255: at least so many.

    For the cells x0 <= ix < x1, y0 <= iy < y1 and `margin` cells around them; lethal cells beyond do not count.
    """
    ny, nx = costs.shape
    for iy in range(max(y0 - margin, 0), min(y1 + margin, ny)):
        ahead = 255
        for ix in range(min(x1 + margin, nx) - 1, max(x0 - margin, 0) - 1, -1):
            ahead = 0 if costs[iy, ix] == 254 else min(ahead + 1, 255)
            out[iy, ix] = ahead


@plain_kernel
def overlaps_lethal_ahead(lethal, placed):
    """Return True if a polygon overlaps a lethal cell. `lethal`: see `write_lethal_ahead`; `placed` (2, n): corners in cells.

    The cells of the rectangle around the polygon, but only lethal ones are visited: most rows have none.
    """
    left, right, low, high = placed[0, 0], placed[0, 0], placed[1, 0], placed[1, 0]
    for j in range(1, placed.shape[1]):
        left, right = min(left, placed[0, j]), max(right, placed[0, j])
        low, high = min(low, placed[1, j]), max(high, placed[1, j])
    last = np.int64(right)
    for iy in range(np.uint64(low), np.uint64(high) + np.uint64(1)):
        ix = np.int64(left)
        while ix <= last:
            ahead = np.int64(lethal[iy, np.uint64(ix)])
            if ahead == 0 and overlaps_cell(placed, ix, np.int64(iy)):
                return True
            ix += max(ahead, 1)
    return False


@plain_kernel
def obstacle_scores(
    costs,
    grid,
    settings_,
    vertices,
    commands,
    poses,
    counts,
    alive,
    cells,
    boxes,
    rows,
    bounds,
    scratch,
    out,
    first_collision,
):
    """Write per rollout the highest (or summed) cost of max(footprint, center) to `out` (K,); IN_COLLISION if it collides.

    It collides if an edge runs through a lethal or unknown cell, or if the footprint overlaps a lethal cell anywhere.
    ROS differs: only the cells of its edges are checked (ObstacleCostFunction).

    `grid`: see `grid_record`; `settings_` (1,): see `OBSTACLE_SETTINGS`. `cells` (K, T): flat cell of each point, -1 off the
    map; `boxes` (K + 1, 4): see `point_cells`. `first_collision` (K,): index of the first point in collision, -1 without.
    `rows` (sizes, ..): see `touched_rows`. `bounds` (BOUND_GRIDS + levels, ny, nx) and
    `scratch` (5, n) for a footprint of n corners are scratch.
    """
    settings, origin_x, origin_y, resolution = settings_[0], grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    sum_scores = settings.sum_scores
    ny, nx = costs.shape
    growth = settings.scaling_speed, settings.max_speed, settings.max_scaling
    largest = 1.0
    for k in range(len(counts)):
        if alive[k]:
            out[k] = footprint_scale(math.hypot(commands[k, 0], commands[k, 1]), *growth)  # until the row is scored
            largest = max(largest, out[k])
    last = len(counts)
    x0, y0, x1, y1 = (
        np.int64(boxes[last, 0]),
        np.int64(boxes[last, 1]),
        np.int64(boxes[last, 2]),
        np.int64(boxes[last, 3]),
    )
    reach = settings.circumscribed_radius / resolution + REACH_MARGIN
    for grown in range(2 if largest > 1.0 else 1):
        radius = min(reach * (largest if grown else 1.0), float(nx + ny))
        highest_around(costs, x0, y0, x1, y1, radius, bounds[2], bounds[grown])
    flat, flat_bounds = costs.reshape(ny * nx), bounds.reshape(len(bounds), ny * nx)
    windows = bounds[BOUND_GRIDS:]
    flat_windows = windows.reshape(len(windows) * ny * nx)
    margin = rows.shape[2] // 4
    has_rows = rows.size > 0 and margin <= min(x0, y0) and x1 <= nx - margin and y1 <= ny - margin
    if has_rows:
        write_windows(costs, x0 - margin, y0 - margin, x1 + margin, y1 + margin, windows)
    number = len(vertices)
    has_lethal = False  # whether bounds[2] tells where the lethal cells are: not needed in the open
    corners, placed = scratch[0:2], scratch[2:4]
    corner_cells = scratch[4].view(np.int32).reshape(2, number)
    # all rollouts begin at the robot's pose: its cost is kept for the next row of the same scale
    start_x, start_y, start_yaw, start_scale, start_cost = 0.0, 0.0, 0.0, 0.0, np.int64(-1)
    for k in range(len(counts)):
        first_collision[k] = -1
        if not alive[k]:
            continue
        n, scale = counts[k], out[k]
        for j in range(number):
            corners[0, j] = scale * vertices[j, 0]
            corners[1, j] = scale * vertices[j, 1]
        around = flat_bounds[0 if scale == 1.0 else 1]
        size = 0 if scale == 1.0 else 1 + math.floor((scale - 1.0) / settings.max_scaling * SIZES)
        if size == 1 + SIZES and scale <= 1.0 + settings.max_scaling:
            size = SIZES
        most, highest_point = np.uint8(0), 0
        for i in range(n):
            bound = np.uint8(255) if cells[k, i] < 0 else around[cells[k, i]]
            if bound > most:
                most, highest_point = bound, i
        out[k] = 0.0
        if most == 0:
            continue
        highest, total, done = np.int64(0), 0.0, -1
        # step -1: the point with the highest bound first, because after it most others cannot raise the maximum
        for step in range(0 if sum_scores or cells[k, highest_point] < 0 else -1, n):
            i = highest_point if step < 0 else step
            bound = np.uint8(255) if cells[k, i] < 0 else around[cells[k, i]]
            if bound == 0 or i == done or (bound <= highest and bound < 254 and not sum_scores):
                continue
            if has_rows and size < len(rows) and cells[k, i] >= 0:
                cell = np.int64(cells[k, i])
                part_x = np.int64((poses[k, i, 0] - origin_x) / resolution * PARTS) % PARTS
                part_y = np.int64((poses[k, i, 1] - origin_y) / resolution * PARTS) % PARTS
                sector = np.int64(math.floor(poses[k, i, 2] * (HEADINGS / (2.0 * math.pi)))) & (HEADINGS - 1)
                row = rows[size, (sector * PARTS + part_y) * PARTS + part_x]
                bound = np.uint8(0)
                for j in range(np.uint64(len(row))):
                    bound = max(bound, flat_windows[np.uint64(cell + row[j])])
                if bound <= highest and bound < 254 and not sum_scores:
                    continue
            cost = np.int64(256)
            if cells[k, i] >= 0:
                x, y, yaw = poses[k, i, 0], poses[k, i, 1], poses[k, i, 2]
                known = i == 0 and start_cost >= 0 and scale == start_scale
                if known and x == start_x and y == start_y and yaw == start_yaw:
                    cost = start_cost
                else:
                    cost = edge_cost(costs, origin_x, origin_y, resolution, corners, x, y, yaw, corner_cells)
                    if bound >= 254 and cost < 254:
                        if not has_lethal:
                            write_lethal_ahead(costs, x0, y0, x1, y1, math.ceil(reach * largest) + 1, bounds[2])
                            has_lethal = True
                        place_footprint(costs, origin_x, origin_y, resolution, corners, x, y, yaw, placed)
                        cost = np.int64(254) if overlaps_lethal_ahead(bounds[2], placed) else cost
                    if i == 0:
                        start_x, start_y, start_yaw, start_scale, start_cost = x, y, yaw, scale, cost
            if cost >= 254 and step < 0:
                highest = np.int64(253)  # a collision: only the first one along the rollout is left to be found
                continue
            if cost >= 254:
                first_collision[k] = i
                break
            cost = max(cost, np.int64(flat[cells[k, i]]))
            highest = max(highest, cost)
            total += cost
            done = i if step < 0 else done
        if first_collision[k] >= 0:
            out[k] = IN_COLLISION
        else:
            out[k] = total if sum_scores else np.float64(highest)

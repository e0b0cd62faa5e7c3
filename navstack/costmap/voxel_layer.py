"""costmap_2d::VoxelLayer: an obstacle layer with up to 16 height levels per column (plugins/voxel_layer.cpp)."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import FIXED, GridGeometry, kernel
from navstack.costmap.observation_buffer import Observation
from navstack.costmap.obstacle_layer import (
    NAV2_LIVE,
    Nav2ObstacleLayerParams,
    ObstacleLayer,
    ObstacleLayerParams,
)
from navstack.plugins import LAYERS, LayerContext, ParamModel, param

# ----------------------------------------------------------------------------------------------------------------------
# Raytracing and marking of the voxel layer. Points may be NaN, infinite or outside the map.
#
# A column stores its levels as bits: `levels` low bits "seen free", then `levels` bits "marked" (neither: unknown), and in the
# remaining high bits the serial number of the observation that marked it last. A word of 0 is unknown at all levels.


# pyright: basic


VOXEL_GRID = np.dtype(
    [
        *[(name, "f8") for name in ("origin_x", "origin_y", "origin_z", "resolution", "z_resolution", "max_height")],
        *[(name, "f8") for name in ("min_height", "ray_top", "border", "shortened")],
        *[(name, "i8") for name in ("levels", "mark_threshold", "unknown_threshold")],
    ],
    align=True,
)
"""Settings of the kernels below: the grid (m, m per cell), the heights between which points count (m), the thresholds.

Rays end at the height `ray_top` (m) and `border` cells inside the upper borders of the map; the share `shortened` of a ray that
is clipped is cut off.
"""


@kernel
def bits_set(n):
    """Return the number of ones in the binary form of `n`."""
    count = 0
    while n:
        n &= n - 1
        count += 1
    return count


@kernel
def clear_level_ray(columns, costs, offset, line, steps, level, levels):
    """Clear the voxels of a ray that stays in one level, from the column `offset` on, and the costs of columns without marks.

    `line`: see `line_start`. As the general loop of `clear_voxel_rays`, for a mark threshold of 0 and columns that are known
    however many voxels are not. Each voxel takes one addition and no branch, as in `clear_line`.
    """
    length, add, major, minor = line
    seen = np.uint32(1 << level)
    kept = ~np.uint32(1 << (level + levels))
    marks = np.uint32(((1 << levels) - 1) << levels)
    slope = at = 0
    if length > 0:
        scale = (1 << FIXED) / length
        slope = int(add * scale) + 1
        at = int((length // 2) * scale) + 1
    for _ in range(steps + 1):
        cell = np.uint64(offset + (at >> FIXED) * minor)
        word = (np.uint32(columns[cell]) | seen) & kept
        columns[cell] = word
        costs[cell] = costs[cell] if word & marks else np.uint8(0)
        offset += major
        at += slope


@kernel
def ray_ends(points, grid, sensor, reach, size, ends, cells):
    """Compute where the rays from `sensor` (x, y, z) to the points end: shortened by two cells, clipped to the map and the
    heights.

    `size`: columns and rows of the map. Writes to `ends` (6, N): x and y at `reach` at the latest (m),
    length (cells), then the end in cells along each axis; to `cells` (4, N): ix, iy, iz, and whether the ray is inside the map.
    Without branches, so that the loop is vectorized.
    """
    g = grid[0]
    origin_x, origin_y, origin_z, resolution, z_resolution = (
        g.origin_x,
        g.origin_y,
        g.origin_z,
        g.resolution,
        g.z_resolution,
    )
    top, levels = g.ray_top, np.float64(g.levels)
    border, shortened = g.border, g.shortened
    nx, ny = size
    sx, sy, sz = sensor
    x0, y0, z0 = (sx - origin_x) / resolution, (sy - origin_y) / resolution, (sz - origin_z) / z_resolution
    end_x, end_y = origin_x + (nx - border) * resolution, origin_y + (ny - border) * resolution
    number = np.uint64(ends.shape[1])
    for i in range(number):
        ends[0, i], ends[1, i], ends[2, i] = points[i, 0], points[i, 1], points[i, 2]
    for i in range(number):
        a, b, c = ends[0, i] - sx, ends[1, i] - sy, ends[2, i] - sz
        distance = math.sqrt(a * a + b * b + c * c)
        finite = distance < np.inf
        rest = (distance - 2.0 * resolution) / distance
        short = rest if (distance > 0.0) & (rest > 0.0) else 0.0
        wx, wy, wz = short * a + sx, short * b + sy, short * c + sz
        a, b, c = wx - sx, wy - sy, wz - sz
        above, below = (top - 0.01 - sz) / c, (origin_z - sz) / c
        above = above if above < 1.0 else 1.0
        t = 1.0
        t = (above if above > 0.0 else 0.0) if wz > top else (below if (wz < origin_z) & (below < t) else t)
        left, right = (origin_x - sx) / a, (end_x - sx) / a
        low, high = (origin_y - sy) / b, (end_y - sy) / b
        t = left if (wx < origin_x) & (left < t) else t
        t = low if (wy < origin_y) & (low < t) else t
        t = right if (wx > end_x) & (right < t) else t
        t = high if (wy > end_y) & (high < t) else t
        outside = (wz > top) | (wz < origin_z) | (wx < origin_x) | (wy < origin_y) | (wx > end_x) | (wy > end_y)
        cut = shortened if t > 0.0 else -shortened
        t = t - cut if outside & (t != 0.0) else t
        wx, wy, wz = sx + a * t, sy + b * t, sz + c * t
        # ROS differs: there, rounding puts some clipped rays just below the origin, and they are lost
        wx, wy, wz = (
            wx if wx > origin_x else origin_x,
            wy if wy > origin_y else origin_y,
            wz if wz > origin_z else origin_z,
        )
        x1, y1, z1 = (wx - origin_x) / resolution, (wy - origin_y) / resolution, (wz - origin_z) / z_resolution
        inside = finite & (x1 < nx) & (y1 < ny) & (z1 < levels)
        dx, dy = wx - sx, wy - sy
        full = math.sqrt(dx * dx + dy * dy)
        cut = reach / full
        dx, dy = dx * cut if full > reach else dx, dy * cut if full > reach else dy
        ends[0, i], ends[1, i] = sx + dx, sy + dy
        ends[2, i] = math.sqrt((x0 - x1) * (x0 - x1) + (y0 - y1) * (y0 - y1) + (z0 - z1) * (z0 - z1))
        cells[0, i], cells[1, i] = np.int32(x1 if inside else 0.0), np.int32(y1 if inside else 0.0)
        cells[2, i], cells[3, i] = np.int32(z1 if inside else 0.0), np.int32(1 if inside else 0)
        ends[3, i], ends[4, i], ends[5, i] = x1, y1, z1


@kernel
def clear_voxel_rays(costs, columns, points, count, grid, sx, sy, sz, nearest, reach, bounds):
    """Clear the voxels between the sensor at (sx, sy, sz) and each point, and set the cost of each column on the way.

    Rays are shortened by two cells, then clipped to the map and the heights (costmap_2d/plugins/voxel_layer.cpp,
    voxel_grid.h); they begin at `nearest` (m; Nav2) and end at `reach` (m). Grows `bounds`. Returns False if the sensor is
    outside the map. `grid`: a record of `VOXEL_GRID`.
    """
    ny, nx = costs.shape
    g = grid[0]
    origin_x, origin_y, origin_z, resolution, z_resolution = (
        g.origin_x,
        g.origin_y,
        g.origin_z,
        g.resolution,
        g.z_resolution,
    )
    levels, mark_threshold, unknown_threshold = g.levels, g.mark_threshold, g.unknown_threshold
    if not (sx >= origin_x and sy >= origin_y and sz >= origin_z):
        return False
    x0, y0 = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    z0 = (sz - origin_z) / z_resolution
    if not (x0 < nx and y0 < ny and z0 < levels):
        return False
    ix0, iy0, iz0 = int(x0), int(y0), int(z0)
    nearest_cells, reach_cells = np.ceil(nearest / resolution), np.ceil(reach / resolution)
    flat_columns, flat_costs = columns.reshape(-1), costs.reshape(-1)
    level_mask = (1 << levels) - 1
    ends, cells = np.empty((6, count)), np.empty((4, count), np.int32)
    ray_ends(points, grid, (sx, sy, sz), reach, (float(nx), float(ny)), ends, cells)
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    last_x, last_y, last_z = -1, -1, -1
    for i in range(count):
        if cells[3, i] == 0:
            continue
        if nearest == 0.0 or math.hypot(ends[0, i] - sx, ends[1, i] - sy) >= nearest:
            min_x, min_y = min(min_x, ends[0, i]), min(min_y, ends[1, i])
            max_x, max_y = max(max_x, ends[0, i]), max(max_y, ends[1, i])
        length = ends[2, i]
        if nearest > 0.0:
            # the line begins in the voxel that far along the ray
            if int(length) < nearest_cells:
                continue
            ix0 = int(x0 + (ends[3, i] - x0) / length * nearest_cells)
            iy0 = int(y0 + (ends[4, i] - y0) / length * nearest_cells)
            iz0 = int(z0 + (ends[5, i] - z0) / length * nearest_cells)
        ix1, iy1, iz1 = np.int64(cells[0, i]), np.int64(cells[1, i]), np.int64(cells[2, i])
        span_x, span_y, span_z = abs(ix1 - ix0), abs(iy1 - iy0), abs(iz1 - iz0)
        dominant = max(span_x, span_y, span_z)
        steps = dominant
        if length > reach_cells:
            steps = int(reach_cells / length * dominant)
        elif nearest == 0.0 and ix1 == last_x and iy1 == last_y and iz1 == last_z:
            continue  # same voxels as the previous beam
        else:
            last_x, last_y, last_z = ix1, iy1, iz1
        step_x, step_y, step_z = 1 if ix1 > ix0 else -1, nx if iy1 > iy0 else -nx, 1 if iz1 > iz0 else -1
        error_x = error_y = error_z = dominant // 2
        offset, level = iy0 * nx + ix0, iz0
        if span_z == 0 and mark_threshold == 0 and unknown_threshold >= levels:
            along_x = span_x >= span_y
            line = dominant, span_y if along_x else span_x, step_x if along_x else step_y, step_y if along_x else step_x
            clear_level_ray(flat_columns, flat_costs, offset, line, steps, level, levels)
            continue
        for _ in range(steps + 1):
            old = int(flat_columns[np.uint64(offset)])
            word = (old | (1 << level)) & ~(1 << (level + levels))
            if word != old:
                flat_columns[np.uint64(offset)] = word
            marked = (word >> levels) & level_mask
            if marked == 0 or bits_set(marked) <= mark_threshold:
                unknown = level_mask & ~(word | marked)
                known = unknown_threshold >= levels or bits_set(unknown) <= unknown_threshold
                flat_costs[np.uint64(offset)] = 0 if known else 255
            # Bresenham in 3-D: the error of the dominant axis reaches the threshold at each step
            error_x += span_x
            error_y += span_y
            error_z += span_z
            if error_x >= dominant:
                error_x -= dominant
                offset += step_x
            if error_y >= dominant:
                error_y -= dominant
                offset += step_y
            if error_z >= dominant:
                error_z -= dominant
                level += step_z
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_voxels(costs, columns, serial, points, count, grid, sx, sy, sz, nearest, reach, bounds):
    """Mark the voxels of the points closer than `reach` (m, 3-D) and not closer than `nearest`; grow `bounds`.

    `serial`: that of the observation.

    Columns with more marked voxels than the threshold become lethal. `grid`: a record of `VOXEL_GRID`.
    """
    ny, nx = costs.shape
    g = grid[0]
    origin_x, origin_y, origin_z, resolution, z_resolution = (
        g.origin_x,
        g.origin_y,
        g.origin_z,
        g.resolution,
        g.z_resolution,
    )
    bottom, top, levels, mark_threshold = g.min_height, g.max_height, g.levels, g.mark_threshold
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    reach_squared = reach * reach
    level_mask = (1 << levels) - 1
    bits_mask = (1 << (2 * levels)) - 1
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + (pz - sz) * (pz - sz)
        if not (squared < reach_squared) or squared < nearest * nearest or pz > top or pz < bottom:
            continue
        if px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        fz = max(pz - origin_z, 0.0) / z_resolution
        if not (fx < nx and fy < ny and fz < levels):
            continue
        ix, iy, iz = int(fx), int(fy), int(fz)
        word = (int(columns[iy, ix]) | (1 << (iz + levels))) & ~(1 << iz)
        columns[iy, ix] = (word & bits_mask) | (serial << (2 * levels))
        if bits_set((word >> levels) & level_mask) > mark_threshold:
            costs[iy, ix] = 254
            min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y


LEVELS = 16


class _ColumnParams(ParamModel):
    """What the voxel layers of ROS 1 and Nav2 have in common."""

    origin_z: float = param(0.0, "bottom of the lowest voxel", unit="m")
    z_resolution: float = param(0.2, "height of a voxel", unit="m", gt=0.0)
    z_voxels: int = param(10, "voxels per column", ge=0, le=LEVELS)
    unknown_threshold: int = param(
        15, "most unknown voxels of a known column, counted as if it had 16 voxels", ge=0, le=LEVELS
    )
    mark_threshold: int = param(0, "most marked voxels of a free column", ge=0, le=LEVELS)
    publish_voxel_map: bool = param(False, "publish the voxels")


class VoxelLayerParams(_ColumnParams, ObstacleLayerParams):
    """`<costmap>/obstacle_layer:` of type costmap_2d::VoxelLayer."""

    combination_method: int = param(
        1,
        "0 overwrites the layers below, 1 takes the larger cost, 2 and 99 write nothing",
        ge=0,
        le=99,
        ros_differs="ROS clamps 99 to 2, which writes nothing either",
    )
    origin_z: float = param(0.0, "bottom of the lowest voxel", unit="m", ge=0.0)
    z_resolution: float = param(0.2, "height of a voxel", unit="m", gt=0.0, le=50.0, ros_differs="ROS accepts 0 too")

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {"max_obstacle_height", "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold"}
    )
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(_ColumnParams.model_fields)


@LAYERS.register("voxel", aliases=("costmap_2d/VoxelLayer",))
class VoxelLayer(ObstacleLayer):
    """Obstacles in columns of voxels: rays above or below an obstacle do not clear it.

    `marks` (ny, nx) contains one word of bits per column: "seen free" and "marked" per level, and above them the serial number
    of the observation that marked it last. 3 bytes per cell for up to 8 levels, 5 bytes for more.
    """

    Params: ClassVar[type[ParamModel]] = VoxelLayerParams

    def __init__(self, params: Any, context: LayerContext) -> None:
        self.levels = int(params.z_voxels)
        self._word = np.dtype(np.uint16 if self.levels <= LEVELS // 2 else np.uint32)
        super().__init__(params, context)
        # the parameter refers to a column of 16 voxels
        self.unknown_threshold = int(params.unknown_threshold) + LEVELS - self.levels
        self._settings = np.zeros(1, VOXEL_GRID)

    @classmethod
    def _top(cls, params: Any) -> float:
        """Return the height above which the layer marks no point (m): a point at the top of the voxels is outside of them."""
        top = float(params.origin_z) + int(params.z_voxels) * float(params.z_resolution)
        return min(float(params.max_obstacle_height), math.nextafter(top, -math.inf))

    def serial_at(self, ix: int, iy: int) -> int:
        """Return the serial number of the observation that marked a column last, 0 if unknown."""
        return int(self.marks[iy, ix]) >> (2 * self.levels)

    def column_at(self, ix: int, iy: int) -> str:
        """Return a column from bottom to top: `#` marked, `.` free, `?` unknown."""
        word = int(self.marks[iy, ix])
        signs: list[str] = []
        for level in range(self.levels):
            marked, free = word >> (level + self.levels) & 1, word >> level & 1
            signs.append("#" if marked else "." if free else "?")
        return "".join(signs)

    def voxel_words(self) -> NDArray[np.uint32]:
        """Return the columns (ny, nx) as costmap_2d's voxel grid stores them.

        Bits z and z + 16 are set for a marked voxel, bit z only for an unknown one, none for a free one. Levels above the
        column are unknown.
        """
        levels, columns = (1 << self.levels) - 1, self.marks.astype(np.int64)
        free, marked = columns & levels, columns >> self.levels & levels
        return ((~free & 0xFFFF) | marked | marked << LEVELS).astype(np.uint32)

    def clearing_ends(self) -> NDArray[np.float64]:
        """Return where the rays of the last clearing observations end, (n, 3): centers of voxels."""
        ends: list[NDArray[np.float64]] = [np.empty((0, 3))]
        g, params = self.geometry, self.params
        for seen in (observation for buffer in self._clearing for observation in buffer.observations):
            source: Any = seen.source.params
            count, reach = seen.count, source.raytrace_range
            places, cells = np.empty((6, count)), np.empty((4, count), np.int32)
            size = float(g.nx), float(g.ny)
            ray_ends(seen.points[:count], self._kernel_settings(), (seen.x, seen.y, seen.z), reach, size, places, cells)
            ix, iy, iz, _ = cells[:, cells[3] == 1]
            x, y, z = (axis.astype(np.float64) + 0.5 for axis in (ix, iy, iz))
            corner, sizes = (g.origin_x, g.origin_y, params.origin_z), (g.resolution, g.resolution, params.z_resolution)
            ends.append(np.array(corner) + np.column_stack((x, y, z)) * np.array(sizes))
        return np.concatenate(ends)

    def _serial_bits(self) -> int:
        return min(8 * self._word.itemsize - 2 * self.levels, 16)

    def _allocate_marks(self, geometry: GridGeometry) -> None:
        self.marks = np.zeros(geometry.shape, self._word)
        self._clear_rays, self._mark_points = clear_voxel_rays.compiled(), mark_voxels.compiled()

    def _remove_serials(self, first: int, last: int) -> None:
        serials = self.marks >> (2 * self.levels)
        self.marks[(serials >= first) & (serials <= last)] &= (1 << (2 * self.levels)) - 1

    def _details(self, ix: int, iy: int) -> dict[str, Any]:
        return {"column": self.column_at(ix, iy)}

    def _passes(self, observation: Observation, ix: int, iy: int) -> bool:
        marks, self.marks = self.marks, np.zeros_like(self.marks)
        try:
            return super()._passes(observation, ix, iy)
        finally:
            self.marks = marks

    def _setting_values(self, g: GridGeometry, params: Any) -> tuple[Any, ...]:
        top = params.origin_z + self.levels * params.z_resolution
        return (
            *(g.origin_x, g.origin_y, params.origin_z, g.resolution, params.z_resolution, params.max_obstacle_height),
            *(
                (params.lowest, top, 0.0, SHORTENED)
                if self.AS_NAV2
                else (-math.inf, params.max_obstacle_height, 0.5, 0.0)
            ),
            *(self.levels, params.mark_threshold, self.unknown_threshold),
        )

    def _clear(self, seen: Observation, box: NDArray[np.float64]) -> bool:
        if seen.count == 0:
            return True
        source: Any = seen.source.params
        return self._clear_rays(
            self.costs,
            self.marks,
            seen.points,
            seen.count,
            self._kernel_settings(),
            seen.x,
            seen.y,
            seen.z,
            source.raytrace_min_range,
            source.raytrace_range,
            box,
        )


SHORTENED = 1e-5
"""Share of a clipped ray that Nav2 cuts off, so that rounding does not put its end outside the map."""


class Nav2VoxelLayerParams(_ColumnParams, Nav2ObstacleLayerParams):
    """Parameters of Nav2's voxel layer."""


@LAYERS.register("nav2_voxel", aliases=("nav2_costmap_2d/VoxelLayer",))
class Nav2VoxelLayer(VoxelLayer):
    """Obstacles in columns of voxels, by Nav2's rules.

    As `voxel`, but rays end at the top of the voxels, ranges have minima, points below `min_obstacle_height` are dropped, and
    combination method 2 keeps unknown cells.
    """

    Params: ClassVar[type[ParamModel]] = Nav2VoxelLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = NAV2_LIVE

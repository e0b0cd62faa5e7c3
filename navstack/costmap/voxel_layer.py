"""costmap_2d::VoxelLayer: an obstacle layer with up to 16 height levels per column (plugins/voxel_layer.cpp)."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import GridGeometry
from navstack.core.parameters import ParamModel, param
from navstack.costmap._voxel_kernels import VOXEL_GRID, clear_voxel_rays, mark_voxels, ray_ends
from navstack.costmap.observation_buffer import Observation
from navstack.costmap.obstacle_layer import ObstacleLayer, ObstacleLayerParams, cells_in
from navstack.interfaces import LayerContext
from navstack.plugins import LAYERS

LEVELS = 16


class VoxelLayerParams(ObstacleLayerParams):
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
    z_voxels: int = param(10, "voxels per column", ge=0, le=LEVELS)
    unknown_threshold: int = param(
        15, "most unknown voxels of a known column, counted as if it had 16 voxels", ge=0, le=LEVELS
    )
    mark_threshold: int = param(0, "most marked voxels of a free column", ge=0, le=LEVELS)
    publish_voxel_map: bool = param(False, "publish the voxels")

    CLAMPED: ClassVar[frozenset[str]] = frozenset(
        {"max_obstacle_height", "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold"}
    )
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"origin_z", "z_resolution", "z_voxels", "mark_threshold", "unknown_threshold", "publish_voxel_map"}
    )


@LAYERS.register("voxel", aliases=("costmap_2d/VoxelLayer", "nav2_costmap_2d/VoxelLayer"))
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
        """Return where the rays of the last clearing observations end, (n, 3): centres of voxels."""
        ends: list[NDArray[np.float64]] = [np.empty((0, 3))]
        g, params = self.geometry, self.params
        for seen in (observation for buffer in self._clearing for observation in buffer.observations):
            count, reach = seen.count, seen.source.params.raytrace_range
            places, cells = np.empty((3, count)), np.empty((4, count), np.int32)
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
        return (
            *(g.origin_x, g.origin_y, params.origin_z, g.resolution, params.z_resolution, params.max_obstacle_height),
            *(self.levels, params.mark_threshold, self.unknown_threshold),
        )

    def _clear(self, seen: Observation, box: NDArray[np.float64]) -> bool:
        if seen.count == 0:
            return True
        reach = seen.source.params.raytrace_range
        return self._clear_rays(
            self.costs,
            self.marks,
            seen.points,
            seen.count,
            self._kernel_settings(),
            seen.x,
            seen.y,
            seen.z,
            reach,
            cells_in(reach, self.geometry.resolution),
            box,
        )

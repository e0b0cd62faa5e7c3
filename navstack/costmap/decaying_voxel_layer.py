"""spatio_temporal_voxel_layer: obstacles in voxels that decay with time, faster where a sensor looks and sees nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, Bounds, Costmap, GridGeometry, Pose2D, Window
from navstack.costmap.observation_buffer import CommonSourceParams, Observation
from navstack.costmap.obstacle_layer import MAXIMUM, OVERWRITE, ObstacleLayer
from navstack.costmap.windows import combine_max, combine_overwrite
from navstack.plugins import LAYERS, CheckContext, Issue, LayerContext, ParamModel, param

LINEAR, EXPONENTIAL = 0, 1
CAMERA, LIDAR = 0, 1
FULL_CIRCLE_RAD: Final = 6.27
"""A wider horizontal field of view is all around."""
NEAREST_M: Final = 0.01
"""Points nearer to the sensor are its own."""
HALF_SPAN: Final = 1 << 20
"""Voxels per axis on each side of the origin that a number can name."""


class DecayingSourceParams(CommonSourceParams):
    """One source of a decaying voxel layer: `<layer>/<source>:`."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {"transport_type": "messages are received as they are"}

    data_type: Literal["PointCloud2", "LaserScan"] = param(  # pyright: ignore[reportIncompatibleVariableOverride]
        "PointCloud2", "type of the messages"
    )
    max_obstacle_height: float = param(3.0, "points above are ignored", unit="m")
    enabled: bool = param(True, "use this source")
    obstacle_range: float = param(2.5, "points farther away, in space, are not marked", unit="m", ge=0.0)
    filter: Literal["passthrough", "voxel", "none"] = param(
        "passthrough", "voxel: mark voxels with at least voxel_min_points points; otherwise every point marks its voxel"
    )
    voxel_min_points: int = param(0, "least number of points of a voxel, with the filter voxel", ge=0)
    clear_after_reading: bool = param(False, "use each message in one update only")
    min_z: float = param(0.0, "beginning of the field of view", unit="m", ge=0.0)
    max_z: float = param(10.0, "end of the field of view", unit="m", ge=0.0)
    vertical_fov_angle: float = param(0.7, "vertical field of view", unit="rad", ge=0.0, lt=math.pi)
    vertical_fov_offset: float = param(0.0, "lidar: inclination of the middle of the field of view", unit="rad")
    vertical_fov_padding: float = param(0.0, "lidar: the field of view is lower by this at both sides", unit="m")
    horizontal_fov_angle: float = param(1.04, "horizontal field of view; beyond 6.27 all around", unit="rad", ge=0.0)
    decay_acceleration: float = param(
        0.0, "voxels in the field of view decay faster by a t³ / 6 after the time t", unit="1/s²", ge=0.0
    )
    model_type: int = param(CAMERA, "field of view of a depth camera (0) or of a lidar (1)", ge=0, le=1)

    @property
    def raytrace_range(self) -> float:
        """`max_z`: how far the source clears."""
        return self.max_z


class DecayingVoxelLayerParams(ParamModel):
    """Parameters of a decaying voxel layer."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "publish_voxel_map": "voxels are not published",
        "mapping_mode": "voxels are not saved",
        "map_save_duration": "voxels are not saved",
        "unknown_threshold": "columns are occupied or free",
        "max_obstacle_height": "the heights of the sources count",
        "origin_z": "voxels are stored at any height",
    }

    enabled: bool = param(True, "apply this layer")
    voxel_size: float = param(0.05, "edge of a voxel", unit="m", gt=0.0, le=10.0)
    voxel_decay: float = param(-1.0, "lifetime of a voxel that is not seen again; see decay_model", unit="s")
    decay_model: int = param(
        LINEAR,
        "rest of the lifetime at the age t: 0 linear, voxel_decay - t; 1 exponential, voxel_decay exp(-t), which only "
        "decay_acceleration ends; another value: voxel_decay, voxels persist",
    )
    mark_threshold: int = param(0, "least number of voxels of an occupied column", ge=0)
    track_unknown_space: bool | None = param(
        None, "unobserved cells are unknown instead of free; the costmap's own setting if absent"
    )
    update_footprint_enabled: bool = param(True, "clear the cells under the robot's footprint")
    combination_method: int = param(
        1, "0 overwrites the layers below, 1 takes the larger cost, another value writes nothing"
    )
    transform_tolerance: float = param(0.2, "time tolerance of a message's transform", unit="s", ge=0.0)
    observation_sources: str = param("", "names of the sources, separated by spaces")
    sources: dict[str, DecayingSourceParams] = param({}, "parameters of the sources, by name")

    CHILD_FIELD: ClassVar[str | None] = "sources"

    @property
    def footprint_clearing_enabled(self) -> bool:
        """`update_footprint_enabled`, as the obstacle layers call it."""
        return self.update_footprint_enabled

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """One namespace for each name in `observation_sources`."""
        return dict.fromkeys(str(values.get("observation_sources", "")).split(), DecayingSourceParams)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield voxels that vanish at once, or never."""
        del context
        if self.decay_model == LINEAR and self.voxel_decay <= 0.0:
            message = (
                f"voxel_decay = {self.voxel_decay:g} s with decay_model 0 removes voxels in the update after the one that marks "
                "them; set voxel_decay to the time for which an obstacle that is not seen again stays"
            )
            yield Issue("warning", "voxels-vanish", ("voxel_decay", "decay_model"), message)
        accelerated = any(s.clearing and s.enabled and s.decay_acceleration > 0.0 for s in self.sources.values())
        if self.decay_model != LINEAR and self.voxel_decay >= 0.0 and not accelerated:
            message = (
                f"voxels never decay: decay_model = {self.decay_model} ends them only in the field of view of a source with "
                "clearing and a decay_acceleration above 0; set both for a source, or set decay_model to 0"
            )
            yield Issue("warning", "voxels-never-decay", ("decay_model",), message)


@LAYERS.register("decaying_voxel", aliases=("spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer",))
class DecayingVoxelLayer(ObstacleLayer):
    """Obstacles in voxels that decay with time.

    A point marks its voxel with the time of the update. Each update ends the voxels whose lifetime is over; in the field of view
    of a clearing source it is over sooner, so that what has gone vanishes. A column with enough voxels is lethal. 16 bytes per
    marked voxel and 3 per cell. Source of the rules and names: spatio_temporal_voxel_layer.

    # STVL differs: fields of view stand upright and look along the x axis of the sensor's frame, because frames are planar; the
    # sensor of a cloud counts as at the height 0. Voxels outside a rolling window are forgotten.
    """

    Params: ClassVar[type[ParamModel]] = DecayingVoxelLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = frozenset(
        {"enabled", "voxel_decay", "decay_model", "mark_threshold", "update_footprint_enabled", "combination_method"}
    )

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.voxels: NDArray[np.int64] = np.empty(0, np.int64)
        """(n,) numbers of the marked voxels, increasing; see `places`."""
        self.times: NDArray[np.float64] = np.empty(0)
        """(n,) when each voxel was marked last (s), less the accelerated part of its decay."""
        used = {name for name, source in params.sources.items() if source.enabled}
        self._clearing = [b for b in self._clearing if b.name in used]
        self._marking = [b for b in self._marking if b.name in used]

    @classmethod
    def _top(cls, params: Any) -> float:
        """Return infinity: the heights of the sources count."""
        del params
        return math.inf

    def places(self) -> NDArray[np.float64]:
        """Return the centers (n, 3) of the marked voxels (m)."""
        parts = (self.voxels >> 42, self.voxels >> 21 & 0x1FFFFF, self.voxels & 0x1FFFFF)
        return (np.column_stack(parts) - HALF_SPAN + 0.5) * self.params.voxel_size

    # --- update -------------------------------------------------------------------------------------------------------

    def shift_to(self, geometry: GridGeometry) -> None:
        """Move the cells; forget the voxels outside the new window."""
        super().shift_to(geometry)
        x, y, _ = self.places().T
        g = self.geometry
        self._keep(
            (x >= g.origin_x)
            & (y >= g.origin_y)
            & (x < g.origin_x + g.nx * g.resolution)
            & (y < g.origin_y + g.ny * g.resolution)
        )

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Let voxels decay, mark the new ones; grow the bounds to contain every change and the footprint."""
        if not self.params.enabled:
            return bounds
        bounds, self._extra = bounds.union(self._extra), Bounds()
        for buffer in self.buffers:
            if buffer.has_pending:
                self._assign_serials(buffer)
        self._decay(now)
        for buffer in self._marking:
            for seen in buffer.observations:
                self._mark_voxels(seen, now)
        for buffer in self.buffers:
            source: Any = buffer.params
            if source.clear_after_reading:
                buffer.observations = []
        bounds = bounds.union(self._flatten())
        if self.params.footprint_clearing_enabled:
            box = np.array(bounds, np.float64)
            self._place_footprint(self._corners, robot.x, robot.y, robot.yaw, self._placed, box)
            bounds = Bounds(*box.tolist())
        return bounds

    def _decay(self, now: float) -> None:
        """Remove the voxels whose lifetime is over; age those in a field of view."""
        p = self.params
        age = now - self.times
        left = np.full(age.shape, p.voxel_decay)
        if p.decay_model == LINEAR:
            left -= age
        elif p.decay_model == EXPONENTIAL:
            left *= np.exp(-age)
        sooner = np.zeros_like(age)
        places, unseen = self.places(), np.ones(age.shape, np.bool_)
        for buffer in self._clearing:
            source: Any = buffer.params
            for seen in buffer.observations:
                # as in STVL, the first field of view that contains a voxel counts
                inside = unseen & in_view(places, seen)
                sooner[inside] = source.decay_acceleration * age[inside] ** 3 / 6.0
                unseen &= ~inside
        self.times = self.times - sooner
        self._keep(left - sooner >= 0.0)

    def _keep(self, kept: NDArray[np.bool_]) -> None:
        if not kept.all():
            self.voxels, self.times = self.voxels[kept], self.times[kept]

    def _mark_voxels(self, seen: Observation, now: float) -> None:
        """Mark the voxels of the points in range with the time `now` (s)."""
        source: Any = seen.source.params
        points = seen.points[: seen.count].astype(np.float64)
        distance = np.linalg.norm(points - (seen.x, seen.y, seen.z), axis=1)
        cells = np.floor(points / self.params.voxel_size)
        near = (distance <= source.obstacle_range) & (distance >= NEAREST_M) & (np.abs(cells) < HALF_SPAN).all(axis=1)
        if not near.any():
            return
        ix, iy, iz = (cells[near].astype(np.int64) + HALF_SPAN).T
        numbers, counts = np.unique(ix << 42 | iy << 21 | iz, return_counts=True)
        if source.filter == "voxel":
            numbers = numbers[counts >= source.voxel_min_points]
        old = ~np.isin(self.voxels, numbers, assume_unique=True)
        voxels = np.concatenate((self.voxels[old], numbers))
        times = np.concatenate((self.times[old], np.full(len(numbers), now)))
        order = np.argsort(voxels)
        self.voxels, self.times = voxels[order], times[order]
        columns = self._cells_at(points[near, :2])
        self.marks[columns[:, 1], columns[:, 0]] = seen.serial

    def _flatten(self) -> Bounds:
        """Write the columns with enough voxels as lethal cells; return the bounds (m) of the cells that changed."""
        before = self.costs
        self.costs = np.full_like(before, self.default_cost)
        columns, counts = np.unique(self.voxels >> 21, return_counts=True)
        columns = columns[counts >= self.params.mark_threshold]
        parts = np.column_stack((columns >> 21, columns & 0x1FFFFF))
        cells = self._cells_at((parts - HALF_SPAN + 0.5) * self.params.voxel_size)
        self.costs[cells[:, 1], cells[:, 0]] = LETHAL
        rows, cols = np.nonzero(self.costs != before)
        if not len(rows):
            return Bounds()
        g = self.geometry
        return Bounds(
            g.origin_x + float(cols.min()) * g.resolution,
            g.origin_y + float(rows.min()) * g.resolution,
            g.origin_x + (float(cols.max()) + 0.5) * g.resolution,
            g.origin_y + (float(rows.max()) + 0.5) * g.resolution,
        )

    def _cells_at(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the cells (k, 2) of those of the points (n, 2) (m) that are inside the grid."""
        g = self.geometry
        cells = np.floor((points - (g.origin_x, g.origin_y)) / g.resolution)
        return cells[((cells >= 0.0) & (cells < (g.nx, g.ny))).all(axis=1)].astype(np.int64)

    def _combine(self, master: Costmap, window: Window) -> None:
        if self.params.combination_method == MAXIMUM:
            combine_max(master.data, self.costs, *window)
        elif self.params.combination_method == OVERWRITE:
            combine_overwrite(master.data, self.costs, *window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Remove the voxels of a region and restart the timeouts of the sensors; return the number of obstacle cells cleared."""
        if region is None:
            self._keep(np.full(self.voxels.shape, invert, np.bool_))
        else:
            x, y, _ = self.places().T
            inside = (x >= region.min_x) & (x <= region.max_x) & (y >= region.min_y) & (y <= region.max_y)
            self._keep(inside if invert else ~inside)
        return super().reset(region, invert=invert)

    # --- what the obstacle layer asks ---------------------------------------------------------------------------------

    def _allocate_marks(self, geometry: GridGeometry) -> None:
        self.marks = np.zeros(geometry.shape, np.uint16)
        self._keep(np.zeros(self.voxels.shape, np.bool_))

    def _passes(self, observation: Observation, ix: int, iy: int) -> bool:
        """Return True if the cell, at the height of the sensor, is in the field of view of the observation."""
        x, y = self.geometry.cell_to_world(ix, iy)
        return bool(in_view(np.array([[x, y, observation.z]]), observation)[0])


def in_view(places: NDArray[np.float64], seen: Observation) -> NDArray[np.bool_]:
    """Return which of the points (n, 3) (m) are in the field of view of an observation's source.

    A depth camera's is a pyramid along the sensor's x axis from `min_z` to `max_z`; a lidar's a ring sector between these
    distances in the plane.
    """
    p: Any = seen.source.params
    dx, dy, up = places[:, 0] - seen.x, places[:, 1] - seen.y, places[:, 2] - seen.z
    c, s = math.cos(seen.yaw), math.sin(seen.yaw)
    ahead, left = c * dx + s * dy, c * dy - s * dx
    slope = math.tan(0.5 * p.vertical_fov_angle)
    if p.model_type == CAMERA:
        wide = np.abs(np.arctan2(left, ahead)) <= 0.5 * p.horizontal_fov_angle
        return (ahead >= p.min_z) & (ahead <= p.max_z) & wide & (np.abs(up) <= ahead * slope)
    away = np.hypot(ahead, left)
    all_around = p.horizontal_fov_angle > FULL_CIRCLE_RAD
    wide = all_around | (np.abs(np.arctan2(left, ahead)) <= 0.5 * p.horizontal_fov_angle)
    above = np.abs(up - away * math.tan(p.vertical_fov_offset)) + p.vertical_fov_padding
    return (away >= p.min_z) & (away <= p.max_z) & wide & (above <= away * slope)

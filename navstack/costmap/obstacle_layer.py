"""costmap_2d::ObstacleLayer: marks the points that sensors see and clears the space in front (plugins/obstacle_layer.cpp)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Bounds, Costmap, Footprint, GridGeometry, Pose2D, SensorData, Window
from navstack.core.errors import NavError
from navstack.core.parameter_checks import CheckContext, Issue, LayerTraits, SensorSource
from navstack.core.parameters import ParamModel, param
from navstack.costmap._polygon_kernels import fill_convex, place_footprint
from navstack.costmap._ray_kernels import GRID, clear_rays, mark_points
from navstack.costmap._window_kernels import combine_max, combine_overwrite
from navstack.costmap.convex_parts import convex_parts
from navstack.costmap.mark_log import MarkLog
from navstack.costmap.observation_buffer import Observation, ObservationBuffer, ObservationSourceParams
from navstack.costmap.regions import clear_region, shift_cells, window_shift
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS

OVERWRITE, MAXIMUM = 0, 1


class ObstacleLayerParams(ParamModel):
    """`<costmap>/obstacle_layer:` of type costmap_2d::ObstacleLayer."""

    enabled: bool = param(True, "apply this layer")
    footprint_clearing_enabled: bool = param(True, "clear the cells under the robot's footprint")
    max_obstacle_height: float = param(2.0, "points above are ignored", unit="m", ge=0.0, le=50.0)
    combination_method: int = param(
        1, "0 overwrites the layers below, 1 takes the larger cost, 99 writes nothing", ge=0, le=99
    )
    track_unknown_space: bool | None = param(
        None, "unobserved cells are unknown instead of free; the costmap's own setting if absent"
    )
    transform_tolerance: float = param(0.2, "time tolerance of a message's transform", unit="s", ge=0.0)
    observation_sources: str = param("", "names of the sources, separated by spaces")
    obstacle_range: float = param(2.5, "default of the sources: points farther away are not marked", unit="m")
    raytrace_range: float = param(3.0, "default of the sources: space farther away is not cleared", unit="m")
    sources: dict[str, ObservationSourceParams] = param({}, "parameters of the sources, by name")

    CHILD_FIELD: ClassVar[str | None] = "sources"
    CLAMPED: ClassVar[frozenset[str]] = frozenset({"max_obstacle_height"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space"}
    )

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """One namespace for each name in `observation_sources`."""
        return dict.fromkeys(str(values.get("observation_sources", "")).split(), ObservationSourceParams)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield sources whose marks are never cleared or whose points are all dropped."""
        del context
        for name, source in self.sources.items():
            if source.marking and source.obstacle_range > source.raytrace_range:
                message = (
                    f"obstacle_range = {source.obstacle_range:g} m of the source {name} exceeds its raytrace_range = "
                    f"{source.raytrace_range:g} m, so obstacles marked between the two are never cleared; set raytrace_range "
                    "to the larger value"
                )
                yield Issue(
                    "warning", "marks-beyond-clearing", (f"{name}/obstacle_range", f"{name}/raytrace_range"), message
                )
            top = min(source.max_obstacle_height, self.max_obstacle_height)
            if source.min_obstacle_height > top:
                message = (
                    f"the source {name} drops every point: min_obstacle_height {source.min_obstacle_height:g} m is above "
                    f"max_obstacle_height {top:g} m (the lower one of source and layer); correct one of the heights"
                )
                yield Issue("warning", "drops-every-point", (f"{name}/min_obstacle_height",), message)


@LAYERS.register("obstacle", aliases=("costmap_2d/ObstacleLayer", "nav2_costmap_2d/ObstacleLayer"))
class ObstacleLayer(Layer):
    """Obstacles seen by sensors.

    Each update clears the cells on the rays of all clearing observations, then marks the points of all marking ones as
    lethal, then clears the robot's footprint. Each cell stores the serial number of the observation that marked it last, to
    explain its source and time. 3 bytes per cell.
    """

    Params: ClassVar[type[ParamModel]] = ObstacleLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset(
        {
            *("enabled", "footprint_clearing_enabled", "max_obstacle_height", "combination_method"),
            *("obstacle_range", "raytrace_range"),  # the values of the sources count
        }
    )

    @classmethod
    def traits(cls, params: ObstacleLayerParams) -> LayerTraits:
        """Sensors if the layer is enabled and has sources; unknown space as set."""
        return LayerTraits(
            enabled=params.enabled,
            fed_by_sensors=params.enabled and bool(params.sources),
            tracks_unknown_space=bool(params.track_unknown_space),
            sources={
                name: SensorSource(
                    s.topic or name,
                    s.data_type,
                    s.min_obstacle_height,
                    s.max_obstacle_height,
                    s.marking,
                    s.sensor_frame,
                )
                for name, s in params.sources.items()
            },
        )

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        track = params.track_unknown_space
        self.default_cost = UNKNOWN if (context.track_unknown_space if track is None else track) else 0
        self.buffers = [
            ObservationBuffer(
                name, source, frame=context.frame, frames=context.frames, tolerance_s=params.transform_tolerance
            )
            for name, source in params.sources.items()
        ]
        self._clearing = [b for b in self.buffers if b.params.clearing]
        self._marking = [b for b in self.buffers if b.params.marking]
        self.costs: NDArray[np.uint8] = np.zeros((1, 1), np.uint8)
        """(ny, nx) costs of this layer: 0, 254, or 255 (unknown)."""
        self.marks: NDArray[Any] = np.zeros((1, 1), np.uint16)
        """(ny, nx) serial number of the observation that marked each cell last, 0 if unknown."""
        self.geometry = GridGeometry(1, 1, 1.0)
        self.log = MarkLog(self._serial_bits())
        self._listening: dict[str, list[ObservationBuffer]] = {}
        self.outside: list[str] = []
        """Sources whose sensor was outside the map in the last update."""
        self._settings: NDArray[Any] = np.zeros(1, GRID)
        self._settings_of: tuple[Any, Any] = None, None
        self._box = np.zeros(4)
        self._extra = Bounds()
        self.set_footprint(context.footprint)

    # --- geometry -----------------------------------------------------------------------------------------------------

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocate; set all cells to the default."""
        self.geometry = geometry
        self.costs = np.full(geometry.shape, self.default_cost, np.uint8)
        # called several times per update: without the wrapper of deferred compilation
        self._place_footprint, self._fill_convex = place_footprint.compiled(), fill_convex.compiled()
        self._combine_max = combine_max.compiled()
        self._spans = np.zeros((2, geometry.nx), np.int64)
        self._allocate_marks(geometry)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Move the cells; keep the overlap of the old and the new window."""
        dx, dy = window_shift(self.geometry, geometry)
        shift_cells(self.costs, dx, dy, self.default_cost)
        shift_cells(self.marks, dx, dy, 0)
        self.geometry = geometry

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the footprint whose cells are cleared."""
        self._parts = convex_parts(footprint.vertices)
        self._corners = np.concatenate(self._parts)
        self._placed = np.zeros_like(self._corners)

    def live_parts(self, params: Any) -> frozenset[str]:
        """Return `sources` if the sources are the same sensors, received in the same way."""
        old, new = self.params.sources, params.sources
        same = list(old) == list(new) and all(buffer.may_become(new[buffer.name]) for buffer in self.buffers)
        return frozenset({"sources"}) if same else frozenset()

    def set_params(self, params: Any) -> None:
        """Replace the parameters of the layer and of its sources."""
        self.params = params
        for buffer in self.buffers:
            buffer.set_params(params.sources[buffer.name])

    # --- update -------------------------------------------------------------------------------------------------------

    def observe(self, data: SensorData) -> bool:
        """Receive a sensor message; return True if a source of this layer accepts it."""
        topic = data.topic
        listening = self._listening.get(topic)
        if listening is None:
            listening = self._listening[topic] = [buffer for buffer in self.buffers if buffer.listens_to(topic)]
        accepted = False
        for buffer in listening:
            accepted = buffer.receive(data) or accepted
        return accepted

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Clear and mark; grow the bounds to contain every ray, every mark and the footprint."""
        if not self.params.enabled:
            return bounds
        if not self._extra.is_empty:
            bounds = bounds.union(self._extra)
            self._extra = Bounds()
        box = self._box
        box[0], box[1], box[2], box[3] = bounds
        for buffer in self.buffers:
            if buffer.has_pending:
                self._assign_serials(buffer)
        if self.outside:
            self.outside.clear()
        # all clearing before any marking
        for buffer in self._clearing:
            for observation in buffer.observations:
                if not self._clear(observation, box):
                    self.outside.append(buffer.name)
        for buffer in self._marking:
            for observation in buffer.observations:
                self._mark(observation, box)
        if self.params.footprint_clearing_enabled:
            self._place_footprint(self._corners, robot.x, robot.y, robot.yaw, self._placed, box)
        return Bounds(*box.tolist())

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Clear the footprint, then combine with the master grid."""
        params = self.params
        if not params.enabled:
            return
        if params.footprint_clearing_enabled:
            g = self.geometry
            first = 0
            for part in self._parts:
                last = first + len(part)
                self._fill_convex(
                    self.costs, self._placed, first, last, self._spans, g.origin_x, g.origin_y, g.resolution, 0
                )
                first = last
        if params.combination_method == MAXIMUM:
            self._combine_max(master.data, self.costs, *window)
        elif params.combination_method == OVERWRITE:
            combine_overwrite(master.data, self.costs, *window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Clear cells and restart the timeouts of the sensors; return the number of obstacle cells cleared.

        Without a region all cells are set to the default, as in costmap_2d's reset; with a region to unknown (255), as in its
        clearArea, so that the layers below show.
        """
        value = self.default_cost if region is None and not invert else UNKNOWN
        cleared, changed = clear_region(self.costs, self.geometry, region, invert, value)
        # ROS differs: clearArea keeps the voxels, so that a ray through a cleared column restores the obstacle
        clear_region(self.marks, self.geometry, region, invert, 0)
        self._extra = self._extra.union(changed)
        for buffer in self.buffers:
            buffer.restart()
        return cleared

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain which source marked or cleared the cell, and when, if still known."""
        del master
        cost = int(self.costs[iy, ix])
        data = self._details(ix, iy)
        if cost == LETHAL:
            found = self.log.look_up(self.serial_at(ix, iy))
            if found is None:
                return CellExplanation(cost, "marked by an observation that is no longer stored", data=data)
            source, stamp = found
            return CellExplanation(cost, f'marked by "{source}" at {stamp:.3f} s', source, stamp, data)
        if cost == UNKNOWN:
            return CellExplanation(None, "not observed, or cleared", data=data)
        for buffer in self._clearing:
            for observation in buffer.observations:
                if self._passes(observation, ix, iy):
                    text = f'cleared by "{buffer.name}" at {observation.stamp:.3f} s'
                    return CellExplanation(cost, text, buffer.name, observation.stamp, data)
        return CellExplanation(
            cost, "free by default, under the robot, or cleared by an earlier observation", data=data
        )

    def is_current(self, now: float) -> bool:
        """Return False if a source has not received a message within its expected_update_rate."""
        return all(buffer.is_current(now) for buffer in self.buffers)

    def problems(self) -> Sequence[NavError]:
        """Return one error per source whose messages cannot be transformed."""
        return [buffer.problem for buffer in self.buffers if buffer.problem is not None]

    @property
    def clearable(self) -> bool:
        """True: the layer holds sensor data."""
        return True

    def _assign_serials(self, buffer: ObservationBuffer) -> None:
        """Assign serial numbers to the new observations of a source."""
        for observation in buffer.refresh():
            observation.serial = self.log.add(buffer.name, observation.stamp)
            if self.log.expired is not None:
                self._remove_serials(*self.log.expired)

    def _passes(self, observation: Observation, ix: int, iy: int) -> bool:
        """Return True if a ray of the observation passes the cell, by clearing a copy of the grid."""
        costs, self.costs = self.costs, np.full(self.costs.shape, LETHAL, np.uint8)
        try:
            self._clear(observation, np.zeros(4))
            return int(self.costs[iy, ix]) != LETHAL
        finally:
            self.costs = costs

    def _mark(self, seen: Observation, box: NDArray[np.float64]) -> None:
        self._mark_points(
            self.costs,
            self.marks,
            seen.serial,
            seen.points,
            seen.count,
            self._kernel_settings(),
            seen.x,
            seen.y,
            seen.z,
            seen.source.params.obstacle_range,
            box,
        )

    def _kernel_settings(self) -> NDArray[Any]:
        """Return the settings of the kernels (1,), refilled after a change of the geometry or the parameters."""
        geometry, params = self._settings_of
        if geometry is not self.geometry or params is not self.params:
            self._settings_of = self.geometry, self.params
            self._settings[0] = self._setting_values(self.geometry, self.params)
        return self._settings

    # --- overridden by the voxel layer --------------------------------------------------------------------------------

    def serial_at(self, ix: int, iy: int) -> int:
        """Return the serial number of the observation that marked a cell last, 0 if unknown."""
        return int(self.marks[iy, ix])

    def _serial_bits(self) -> int:
        return 16

    def _allocate_marks(self, geometry: GridGeometry) -> None:
        self.marks = np.zeros(geometry.shape, np.uint16)
        self._clear_rays, self._mark_points = clear_rays.compiled(), mark_points.compiled()

    def _remove_serials(self, first: int, last: int) -> None:
        self.marks[(self.marks >= first) & (self.marks <= last)] = 0

    def _details(self, ix: int, iy: int) -> dict[str, Any]:
        del ix, iy
        return {}

    def _setting_values(self, g: GridGeometry, params: Any) -> tuple[Any, ...]:
        return g.origin_x, g.origin_y, g.resolution, params.max_obstacle_height

    def _clear(self, seen: Observation, box: NDArray[np.float64]) -> bool:
        reach = seen.source.params.raytrace_range
        cells = cells_in(reach, self.geometry.resolution)
        settings = self._kernel_settings()
        return self._clear_rays(self.costs, seen.points, seen.count, settings, seen.x, seen.y, reach, cells, box)


def cells_in(distance: float, resolution: float) -> float:
    """Return a distance (m) in cells, rounded up (costmap_2d's cellDistance)."""
    return float(max(0, math.ceil(distance / resolution)))

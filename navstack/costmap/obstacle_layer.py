"""costmap_2d::ObstacleLayer: marks what sensors see and frees what they see through (plugins/obstacle_layer.cpp)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Bounds, Costmap, Footprint, GridGeometry, Pose2D, SensorData, Window
from navstack.core.parameters import ParamModel, param
from navstack.costmap import _kernels
from navstack.costmap.convex_parts import convex_parts
from navstack.costmap.mark_log import MarkLog
from navstack.costmap.observation_buffer import Observation, ObservationBuffer, ObservationSourceParams
from navstack.costmap.regions import forget_region, shift_cells, window_shift
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS

OVERWRITE, MAXIMUM = 0, 1


class ObstacleLayerParams(ParamModel):
    """`<costmap>/obstacle_layer:` of type costmap_2d::ObstacleLayer."""

    enabled: bool = param(True, "apply this layer")
    footprint_clearing_enabled: bool = param(True, "the cells under the robot are free")
    max_obstacle_height: float = param(2.0, "points above are ignored", unit="m", ge=0.0, le=50.0)
    combination_method: int = param(
        1, "0 overwrites the layers below, 1 takes the larger cost, 99 writes nothing", ge=0, le=99
    )
    track_unknown_space: bool | None = param(
        None, "cells nobody has looked at are unknown, not free; the costmap's own setting when absent"
    )
    transform_tolerance: float = param(0.2, "how far a message's transform may be off in time", unit="s", ge=0.0)
    observation_sources: str = param("", "names of the sources, separated by spaces")
    obstacle_range: float = param(2.5, "points farther away are no obstacles, unless a source says otherwise", unit="m")
    raytrace_range: float = param(3.0, "space farther away is not freed, unless a source says otherwise", unit="m")
    sources: dict[str, ObservationSourceParams] = param({}, "the sources' own parameters, by name")

    CHILD_FIELD: ClassVar[str | None] = "sources"
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space"}
    )

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """One namespace per name in `observation_sources`."""
        return dict.fromkeys(str(values.get("observation_sources", "")).split(), ObservationSourceParams)


@LAYERS.register("obstacle", aliases=("costmap_2d/ObstacleLayer", "nav2_costmap_2d/ObstacleLayer"))
class ObstacleLayer(Layer):
    """Obstacles seen by sensors.

    Per update: every clearing observation frees the cells on its rays, then every marking one makes its points lethal,
    then the robot's own footprint is freed. Cells carry the serial number of the observation that marked them last, so
    that the layer can say which source it was, and when. 3 bytes a cell.
    """

    Params: ClassVar[type[ParamModel]] = ObstacleLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset(
        {
            *("enabled", "footprint_clearing_enabled", "max_obstacle_height", "combination_method"),
            *("obstacle_range", "raytrace_range"),  # what the sources say counts
        }
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
        """(ny, nx) what this layer says: 0, 254, 255 = says nothing."""
        self.geometry = GridGeometry(1, 1, 1.0)
        self.log = MarkLog(self._serial_bits())
        self._listening: dict[str, list[ObservationBuffer]] = {}
        self.unseen: list[str] = []
        """Sources whose sensor was off the map in the last update."""
        self._box = np.zeros(4)
        self._extra = Bounds()
        self.set_footprint(context.footprint)

    # --- geometry -----------------------------------------------------------------------------------------------------

    def match_size(self, geometry: GridGeometry) -> None:
        """Allocates; all cells take the default."""
        self.geometry = geometry
        self.costs = np.full(geometry.shape, self.default_cost, np.uint8)
        # called several times per update: without the wrapper that defers compiling
        self._clear_rays, self._mark_points = _kernels.clear_rays.compiled(), _kernels.mark_points.compiled()
        self._place_footprint, self._fill_convex = (
            _kernels.place_footprint.compiled(),
            _kernels.fill_convex.compiled(),
        )
        self._combine_max = _kernels.combine_max.compiled()
        self._spans = np.zeros((2, geometry.nx), np.int64)
        self._allocate_marks(geometry)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Keeps the cells that the old and the new window share."""
        dx, dy = window_shift(self.geometry, geometry)
        shift_cells(self.costs, dx, dy, self.default_cost)
        self._shift_marks(dx, dy)
        self.geometry = geometry

    def set_footprint(self, footprint: Footprint) -> None:
        """The outline whose cells are freed."""
        self._parts = convex_parts(footprint.vertices)
        self._outline = np.concatenate(self._parts)
        self._placed = np.zeros_like(self._outline)

    def live_parts(self, params: Any) -> frozenset[str]:
        """The sources, as long as they stay the same sensors, listened to in the same way."""
        old, new = self.params.sources, params.sources
        same = list(old) == list(new) and all(buffer.may_become(new[buffer.name]) for buffer in self.buffers)
        return frozenset({"sources"}) if same else frozenset()

    def set_params(self, params: Any) -> None:
        """Takes them over, and those of the sources."""
        self.params = params
        for buffer in self.buffers:
            buffer.set_params(params.sources[buffer.name])

    # --- update -------------------------------------------------------------------------------------------------------

    def observe(self, data: SensorData) -> bool:
        """True when a source of this layer listens to that topic."""
        topic = data.topic
        listening = self._listening.get(topic)
        if listening is None:
            listening = self._listening[topic] = [buffer for buffer in self.buffers if buffer.listens_to(topic)]
        taken = False
        for buffer in listening:
            taken = buffer.take(data) or taken
        return taken

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Clears and marks; the box grows to hold every ray, every mark and the footprint."""
        if not self.params.enabled:
            return bounds
        if not self._extra.is_empty:
            bounds = bounds.union(self._extra)
            self._extra = Bounds()
        box = self._box
        box[0], box[1], box[2], box[3] = bounds
        for buffer in self.buffers:
            if buffer.has_pending:
                self._sign(buffer)
        if self.unseen:
            self.unseen.clear()
        # all that clears before anything that marks
        for buffer in self._clearing:
            for observation in buffer.observations:
                if not self._clear(observation, box):
                    self.unseen.append(buffer.name)
        for buffer in self._marking:
            for observation in buffer.observations:
                self._mark(observation, box)
        if self.params.footprint_clearing_enabled:
            self._place_footprint(self._outline, robot.x, robot.y, robot.yaw, self._placed, box)
        return Bounds(*box.tolist())

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Frees the footprint, then combines into the master."""
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
            _kernels.combine_overwrite(master.data, self.costs, *window)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Forgets cells; returns how many of them were obstacles. Sensors get their full time again.

        Without a region all cells take the default, as costmap_2d's reset; with one they say nothing (255), as its
        clearArea, which lets the layers below through.
        """
        value = self.default_cost if region is None and not invert else UNKNOWN
        cleared, touched = forget_region(self.costs, self.geometry, region, invert, value)
        self._reset_marks(region, invert)
        self._extra = self._extra.union(touched)
        for buffer in self.buffers:
            buffer.restart()
        return cleared

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Which source marked or freed the cell, and when, as far as it is remembered."""
        del master
        cost = int(self.costs[iy, ix])
        data = self._details(ix, iy)
        if cost == LETHAL:
            known = self.log.look_up(self.serial_at(ix, iy))
            if known is None:
                return CellExplanation(cost, "marked by an observation that is no longer remembered", data=data)
            source, stamp = known
            return CellExplanation(cost, f'marked by "{source}" at {stamp:.3f} s', source, stamp, data)
        if cost == UNKNOWN:
            return CellExplanation(None, "nobody has looked, or it was cleared", data=data)
        for buffer in self._clearing:
            for seen in buffer.observations:
                if self._passes(seen, ix, iy):
                    return CellExplanation(
                        cost, f'freed by "{buffer.name}" at {seen.stamp:.3f} s', buffer.name, seen.stamp, data
                    )
        return CellExplanation(cost, "free by default, under the robot, or freed by an earlier observation", data=data)

    def is_current(self, now: float) -> bool:
        """False when a source with an expected_update_rate is silent for longer."""
        return all(buffer.is_current(now) for buffer in self.buffers)

    @property
    def clearable(self) -> bool:
        """Fed by sensors."""
        return True

    def _sign(self, buffer: ObservationBuffer) -> None:
        """Gives what arrived its serial numbers."""
        for fresh in buffer.refresh():
            fresh.serial = self.log.enter(buffer.name, fresh.stamp)
            if self.log.stale is not None:
                self._forget_serials(*self.log.stale)

    # --- what the voxel layer does otherwise --------------------------------------------------------------------------

    def _serial_bits(self) -> int:
        return 16

    def _allocate_marks(self, geometry: GridGeometry) -> None:
        self.serials = np.zeros(geometry.shape, np.uint16)

    def _shift_marks(self, dx: int, dy: int) -> None:
        shift_cells(self.serials, dx, dy, 0)

    def _reset_marks(self, region: Bounds | None, invert: bool) -> None:
        forget_region(self.serials, self.geometry, region, invert, 0)

    def _forget_serials(self, first: int, last: int) -> None:
        self.serials[(self.serials >= first) & (self.serials <= last)] = 0

    def serial_at(self, ix: int, iy: int) -> int:
        """Serial of the observation that marked a cell last, 0 when not known."""
        return int(self.serials[iy, ix])

    def _details(self, ix: int, iy: int) -> dict[str, Any]:
        del ix, iy
        return {}

    def _passes(self, seen: Observation, ix: int, iy: int) -> bool:
        """True when a ray of that observation passes the cell: cast once more, over an empty grid."""
        held, self.costs = self.costs, np.full(self.costs.shape, LETHAL, np.uint8)
        try:
            self._clear(seen, np.zeros(4))
            return int(self.costs[iy, ix]) != LETHAL
        finally:
            self.costs = held

    def _clear(self, seen: Observation, box: NDArray[np.float64]) -> bool:
        g = self.geometry
        resolution = g.resolution
        reach = seen.source.params.raytrace_range
        cells = cells_in(reach, resolution)
        return self._clear_rays(
            self.costs, seen.points, seen.count, g.origin_x, g.origin_y, resolution, seen.x, seen.y, reach, cells, box
        )

    def _mark(self, seen: Observation, box: NDArray[np.float64]) -> None:
        g = self.geometry
        reach = seen.source.params.obstacle_range
        top = self.params.max_obstacle_height
        x, y, resolution = g.origin_x, g.origin_y, g.resolution
        self._mark_points(
            self.costs, self.serials, seen.serial, seen.points, seen.count, x, y, resolution, seen.x, seen.y, seen.z, top,
            reach, box,
        )  # fmt: skip


def cells_in(distance: float, resolution: float) -> float:
    """costmap_2d's cellDistance: a distance (m) in cells, rounded up."""
    return float(max(0, math.ceil(distance / resolution)))

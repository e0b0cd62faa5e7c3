"""A costmap made of layers: one update asks each what may have changed, clears that window and lets each write into it.

Source of the rules: costmap_2d/src/layered_costmap.cpp and costmap_2d_ros.cpp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

from navstack.core import (
    UNKNOWN,
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    OccupancyGrid,
    Pose2D,
    SensorData,
    Window,
)
from navstack.core.errors import InputError, InternalError
from navstack.core.frames import clean_frame
from navstack.costmap import _kernels
from navstack.costmap.provenance import explain_cell
from navstack.costmap.reconfigure import apply_reconfigure, check_reconfigure
from navstack.costmap.regions import shift_cells, window_shift
from navstack.costmap.static_layer import StaticLayer
from navstack.interfaces import CellProvenance, Layer, LayerContext
from navstack.parameters.models.costmap import CostmapParams

NOTHING: Final = Bounds()
MAX_CELLS: Final = 400_000_000
FARTHEST: Final = 1e9
"""No robot is farther from the origin than this (m): cells beyond cannot be told apart in float64 arithmetic."""


class LayerSpec(NamedTuple):
    """A layer to be made: its instance name, its class and its parameters (of `cls.Params`)."""

    name: str
    cls: type[Layer]
    params: Any


class LayeredCostmap:
    """The master grid and its layers; one of a robot's two costmaps (`navstack.interfaces.CostmapServer`).

    `footprint` is padded already. Without a rolling window the master takes the size of the static layer's map if there is
    such a layer, otherwise that of the parameters. Raises InputError for a size that is no grid.
    """

    def __init__(
        self,
        name: str,
        params: CostmapParams,
        layers: Sequence[LayerSpec],
        *,
        footprint: Footprint,
        frames: FrameTree,
        static_map: OccupancyGrid | None = None,
        read_map: Callable[[str], OccupancyGrid] | None = None,
    ) -> None:
        self.name = name
        self.params = params
        self.frame = clean_frame(params.global_frame)
        self.robot_base_frame = clean_frame(params.robot_base_frame)
        self.frames = frames
        self.footprint = footprint
        self.rolling_window = params.rolling_window
        self.default_cost = UNKNOWN if params.track_unknown_space else 0
        self.window = Window(0, 0, 0, 0)
        """Cells rewritten by the last update."""
        self.bounds = NOTHING
        """What the layers asked for in the last update (m)."""
        self.updated_at: float | None = None
        """Time (s) of the last update."""
        self._layers: list[Layer] = []
        for spec in layers:
            context = LayerContext(
                name=spec.name,
                frame=self.frame,
                frames=frames,
                footprint=footprint,
                rolling_window=params.rolling_window,
                track_unknown_space=params.track_unknown_space,
                static_map=static_map,
                read_map=read_map,
            )
            self._layers.append(spec.cls(spec.params, context))
        self._listeners = [x for x in self._layers if type(x).observe is not Layer.observe]
        self._limiters = [x for x in self._layers if type(x).speed_limit is not Layer.speed_limit]
        geometry = self._initial_geometry()
        self.master = Costmap(geometry, frame=self.frame)
        self.master.data.fill(self.default_cost)
        self._base = geometry
        self._moved = (0, 0)
        self._fill_window = _kernels.fill_window.compiled()
        for layer in self._layers:
            layer.match_size(geometry)

    @property
    def layers(self) -> Sequence[Layer]:
        """In the order in which they write."""
        return self._layers

    def layer(self, name: str) -> Layer:
        """The layer of that instance name; raises InputError with what there is."""
        for layer in self._layers:
            if layer.name == name:
                return layer
        known = ", ".join(x.name for x in self._layers) or "none"
        raise InputError(f'{self.name} has no layer "{name}"; it has: {known}', layer=name)

    # --- updates ------------------------------------------------------------------------------------------------------

    def observe(self, data: SensorData) -> None:
        """Hands a sensor message to every layer that listens to its topic."""
        for layer in self._listeners:
            layer.observe(data)

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """The robot in this costmap's frame, at `now` (s) within transform_tolerance, or the newest; raises FrameError."""
        at = self.frames.lookup(self.frame, self.robot_base_frame, now, self.params.transform_tolerance)
        return Pose2D(at.x, at.y, at.yaw)

    def update(self, now: float) -> Window:
        """One update around the robot's pose at `now` (s); the cells rewritten. Raises FrameError without a pose."""
        return self.update_at(self.robot_pose(now), now)

    def update_at(self, robot: Pose2D, now: float) -> Window:
        """One update with the robot at `robot`, in this costmap's frame."""
        if not (abs(robot.x) < FARTHEST and abs(robot.y) < FARTHEST and abs(robot.yaw) < FARTHEST):  # false for NaN
            raise InputError(f"{self.name} cannot be updated around a robot at {tuple(robot)}", pose=tuple(robot))
        if self.rolling_window:
            self._roll(robot)
        bounds = NOTHING
        for layer in self._layers:
            grown = layer.update_bounds(robot, now, bounds)
            if not (
                grown[0] <= bounds[0] and grown[1] <= bounds[1] and grown[2] >= bounds[2] and grown[3] >= bounds[3]
            ):
                raise InternalError(
                    f'the layer "{layer.name}" of {self.name} shrank the bounds from {tuple(bounds)} to {tuple(grown)}; '
                    "update_bounds may only grow them: return bounds.union(..)",
                    layer=layer.name,
                )
            bounds = grown
        master = self.master
        window = master.geometry.window_of(bounds)
        self.bounds = bounds
        self.window = window
        self.updated_at = now
        if not window.is_empty:
            self._fill_window(master.data, *window, self.default_cost)
            for layer in self._layers:
                layer.update_costs(master, window)
        return window

    def is_current(self, now: float) -> bool:
        """False when a layer's sensor is silent for too long."""
        return all(layer.is_current(now) for layer in self._layers)

    def explain(self, ix: int, iy: int) -> CellProvenance:
        """Explain which layer and observation source set the cost of a cell, and when; see `explain_cell`.

        Computed on request only: the layers write the cell's surroundings once more, into a copy.
        """
        return explain_cell(self, ix, iy)

    def explain_cell(self, x: float, y: float) -> CellProvenance:
        """Explain the cell at a point (m) of the costmap's frame. Raises InputError for a point outside the costmap."""
        cell = self.master.geometry.world_to_cell(x, y)
        if cell is None:
            left, right, bottom, top = self.master.geometry.extent
            raise InputError(
                f"({x:g}, {y:g}) is outside {self.name}, which covers x {left:.2f} .. {right:.2f}, "
                f"y {bottom:.2f} .. {top:.2f} m",
                at=[x, y],
            )
        return explain_cell(self, *cell)

    @property
    def limits_speed(self) -> bool:
        """True if a layer may limit the speed."""
        return bool(self._limiters)

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """Return the lowest speed limit (m/s) of all layers at a point (m); None without a limit.

        `max_speed` (m/s) is the robot's unlimited speed, for limits in percent.
        """
        limits = [layer.speed_limit(x, y, max_speed) for layer in self._limiters]
        return min((limit for limit in limits if limit is not None), default=None)

    # --- changes ------------------------------------------------------------------------------------------------------

    def reset(self) -> int:
        """Forgets everything observed, in every layer, and empties the master: obstacle cells cleared."""
        self.master.data.fill(self.default_cost)
        return sum(layer.reset() for layer in self._layers)

    def set_footprint(self, footprint: Footprint) -> None:
        """The robot's outline changed (padding included)."""
        self.footprint = footprint
        for layer in self._layers:
            layer.set_footprint(footprint)

    def set_static_map(self, grid: OccupancyGrid) -> bool:
        """A new map arrived; a costmap that does not roll takes its size. False when no layer takes it."""
        taken = False
        for layer in self._layers:
            if isinstance(layer, StaticLayer):
                taken = layer.set_map(grid) or taken
        if taken and not self.rolling_window:
            self._resize(self._initial_geometry())
        return taken

    def reconfigure(self, params: CostmapParams, layers: Sequence[LayerSpec], footprint: Footprint) -> bool:
        """Other parameters and another outline (padded) while running; False when nothing differs.

        Raises InputError, and changes nothing, for what only holds from the start (frames, layers, rolling_window ..).
        """
        check_reconfigure(self, params, layers)
        return apply_reconfigure(self, params, layers, footprint)

    def rewrite(self) -> None:
        """Lets every layer write the whole master anew."""
        master = self.master
        master.data.fill(self.default_cost)
        for layer in self._layers:
            layer.update_costs(master, master.geometry.window)

    def take_size(self) -> None:
        """Takes the size that the parameters, or the static map, give; what was observed is forgotten."""
        self._resize(self._initial_geometry())

    def _resize(self, geometry: GridGeometry) -> None:
        # planners hold on to the Costmap, not to its array
        fresh = Costmap(geometry, frame=self.frame)
        self.master.geometry, self.master.data = geometry, fresh.data
        self.master.data.fill(self.default_cost)
        self._base, self._moved = geometry, (0, 0)
        for layer in self._layers:
            layer.match_size(geometry)

    def _initial_geometry(self) -> GridGeometry:
        params = self.params
        if not params.rolling_window:
            for layer in self._layers:
                if isinstance(layer, StaticLayer):
                    return layer.geometry
        # truncated, as costmap_2d_ros.cpp does; the sum spares 0.3 / 0.1 its 2.9999999999999996
        nx, ny = (int(extent / params.resolution + 1e-9) for extent in (params.width, params.height))
        if nx < 1 or ny < 1 or nx * ny > MAX_CELLS:
            raise InputError(
                f"{self.name}: width {params.width:g} m and height {params.height:g} m at a resolution of "
                f"{params.resolution:g} m are {nx} x {ny} cells; give between one and {MAX_CELLS:,} cells in all",
                costmap=self.name,
            )
        return GridGeometry(nx, ny, params.resolution, params.origin_x, params.origin_y)

    def _roll(self, robot: Pose2D) -> None:
        """Moves the window by whole cells so that the robot is in its middle.

        The origin adds up as costmap_2d's does, to the last bit, since a ray that is cut at the border lives or dies by it;
        but it is also counted in cells from where it was at first, so that rounding never adds up to anything.
        """
        old = self.master.geometry
        resolution = old.resolution
        # half of (n - 0.5) cells, not of n: so costmap_2d's getSizeInMeters is, and the golden origins are
        dx = int((robot.x - (old.nx - 0.5) * resolution / 2.0 - old.origin_x) / resolution)
        dy = int((robot.y - (old.ny - 0.5) * resolution / 2.0 - old.origin_y) / resolution)
        if dx == 0 and dy == 0:
            return
        self._moved = (self._moved[0] + dx, self._moved[1] + dy)
        new = old.moved_to(
            _settled(old.origin_x + dx * resolution, self._base.origin_x + self._moved[0] * resolution),
            _settled(old.origin_y + dy * resolution, self._base.origin_y + self._moved[1] * resolution),
        )
        shift_cells(self.master.data, *window_shift(old, new), self.default_cost)
        self.master.geometry = new
        for layer in self._layers:
            layer.shift_to(new)


def _settled(summed: float, counted: float) -> float:
    """The origin added up from shift to shift, or the one counted from the first, once they are a nanometre apart."""
    return summed if abs(summed - counted) < 1e-9 else counted


def footprint_of(params: CostmapParams) -> Footprint:
    """The padded footprint that a costmap's parameters describe; raises InputError (costmap_2d/src/footprint.cpp)."""
    given = params.footprint
    if isinstance(given, str):
        given = parse_footprint(given)
    if not given:
        return Footprint.from_radius(params.robot_radius, params.footprint_padding)
    if any(len(point) != 2 for point in given):
        raise InputError(f"each point of a footprint is [x, y], not {given}", footprint=given)
    import numpy as np

    return Footprint(np.array(given, np.float64), params.footprint_padding)


def parse_footprint(text: str) -> list[list[float]]:
    """`[[x, y], ..]` as text (which is how dynamic_reconfigure hands it on); raises InputError."""
    import json

    if not text.strip():
        return []
    try:
        value = json.loads(text)
        points = [[float(number) for number in point] for point in value]
    except (ValueError, TypeError, RecursionError):
        points = None
    if points is None or not all(len(p) == 2 and all(map(math.isfinite, p)) for p in points):
        raise InputError(
            f'the footprint "{text}" is not a list of points; write [[0.2, 0.2], [0.2, -0.2], [-0.2, 0.0]]',
            footprint=text,
        )
    return points

"""A costmap of layers. An update collects the bounds of the changes, clears that window and lets each layer write into it.

Source of the rules: costmap_2d/src/layered_costmap.cpp and costmap_2d_ros.cpp.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    InputError,
    InternalError,
    NavError,
    OccupancyGrid,
    Pose2D,
    SensorData,
    Window,
    clean_frame,
)
from navstack.costmap.inflation_layer import InflationLayer
from navstack.costmap.plugin_container_layer import PluginContainerLayer
from navstack.costmap.static_layer import StaticLayer
from navstack.costmap.windows import fill_window, shift_cells, window_shift
from navstack.parameters import CostmapParams
from navstack.plugins import (
    CellProvenance,
    Layer,
    LayerContext,
    LayerShare,
    Plugin,
    broken_contract,
    plugin_error,
)

# ----------------------------------------------------------------------------------------------------------------------
# Origin of the cost of a cell: which layer and which observation source set it, and when.


def explain_cell(costmap: LayeredCostmap, ix: int, iy: int, *, follow: bool = True) -> CellProvenance:
    """Explain a cell by writing its surroundings again, layer by layer, into a copy of the master grid.

    With `follow`, the explanation of an inflated cell includes that of its obstacle.
    """
    master = costmap.master
    nx, ny = master.geometry.nx, master.geometry.ny
    # an inflated cost depends on cells up to the inflation radius away
    reach = 1 + max((x.radius_cells for x in flattened(costmap.layers) if isinstance(x, InflationLayer)), default=0)
    window = Window(max(0, ix - reach), max(0, iy - reach), min(nx, ix + reach + 1), min(ny, iy + reach + 1))
    copy = Costmap(master.geometry, master.data.copy(), master.frame)
    copy.data[window.slices] = costmap.default_cost
    shares: list[LayerShare] = []
    set_by: LayerShare | None = None
    for layer in costmap.layers:
        before = int(copy.data[iy, ix])
        layer.update_costs(copy, window)
        after = int(copy.data[iy, ix])
        share = LayerShare(layer.name, type(layer).__name__, before, after, layer.explain(ix, iy, copy))
        shares.append(share)
        if after != before:
            set_by = share
    found = set_by.explanation if set_by else None
    obstacle: CellProvenance | None = None
    if follow and found is not None and "obstacle_cell" in found.data:
        obstacle = explain_cell(costmap, *found.data["obstacle_cell"], follow=False)
    origin = obstacle if obstacle is not None else found
    x, y = master.geometry.cell_to_world(ix, iy)
    cost = int(master.data[iy, ix])
    return CellProvenance(
        costmap.name,
        ix,
        iy,
        x,
        y,
        cost,
        set_by.layer if set_by else None,
        origin.source if origin else None,
        origin.stamp if origin else None,
        costmap.updated_at,
        tuple(shares),
        obstacle,
        stale=cost != int(copy.data[iy, ix]),
    )


def flattened(layers: Sequence[Layer]) -> list[Layer]:
    """Return the layers, each container followed by the layers inside it."""
    found: list[Layer] = []
    for layer in layers:
        found.append(layer)
        if isinstance(layer, PluginContainerLayer):
            found += flattened(layer.layers)
    return found


EMPTY: Final = Bounds()
MAX_CELLS: Final = 50_000_000
"""Largest size of a costmap by its parameters; maps have a limit of their own."""
BYTES_PER_CELL: Final = 35
"""What master grid, layers and planner need, about."""
FARTHEST: Final = 1e9
"""Largest valid coordinate of the robot (m): float64 cannot resolve cells beyond."""


class LayeredCostmap:
    """The master grid and its layers: the global or the local costmap (`navstack.plugins.CostmapServer`).

    `footprint` includes the padding. Without a rolling window, the master grid has the size of the static layer's map; without
    a static layer, the size in the parameters. Raises InputError for an invalid size.
    """

    def __init__(
        self,
        name: str,
        params: CostmapParams,
        layers: Sequence[Plugin[Layer]],
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
        """Cells rewritten in the last update."""
        self.bounds = EMPTY
        """Bounds of the layers in the last update (m)."""
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
        self._reporters = [x for x in self._layers if type(x).problems is not Layer.problems]
        self._cells_short = 0.0 if any(x.AS_NAV2 for x in self._layers) else 0.5
        """How many cells the size of a window is short of when it rolls: costmap_2d's getSizeInMeters returns n - 0.5 cells."""
        self._limiters = [x for x in self._layers if type(x).speed_limit is not Layer.speed_limit]
        geometry = self._initial_geometry()
        self.master = Costmap(geometry, frame=self.frame)
        self.master.data.fill(self.default_cost)
        self._base = geometry
        self._moved = (0, 0)
        self._fill_window = fill_window.compiled()
        for layer in self._layers:
            layer.match_size(geometry)

    @property
    def layers(self) -> Sequence[Layer]:
        """The layers, in the order in which they write."""
        return self._layers

    def layer(self, name: str) -> Layer:
        """Return the layer with this instance name. Raises InputError with the known names."""
        for layer in self._layers:
            if layer.name == name:
                return layer
        known = ", ".join(x.name for x in self._layers) or "none"
        raise InputError(f'{self.name} has no layer "{name}"; its layers are: {known}', layer=name)

    # --- updates ------------------------------------------------------------------------------------------------------

    def observe(self, data: SensorData) -> None:
        """Pass a sensor message to every layer that listens to its topic."""
        for layer in self._listeners:
            layer.observe(data)

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """Return the robot's pose in this costmap's frame at `now` (s, within transform_tolerance), or the newest.

        Raises FrameError.
        """
        at = self.frames.lookup(self.frame, self.robot_base_frame, now, self.params.transform_tolerance)
        return Pose2D(at.x, at.y, at.yaw)

    def update(self, now: float) -> Window:
        """Update around the robot's pose at `now` (s); return the window of rewritten cells. Raises FrameError without a pose."""
        return self.update_at(self.robot_pose(now), now)

    def update_at(self, robot: Pose2D, now: float) -> Window:
        """Update with the robot at `robot`, in this costmap's frame; return the window of rewritten cells."""
        if not (abs(robot.x) < FARTHEST and abs(robot.y) < FARTHEST and abs(robot.yaw) < FARTHEST):  # false for NaN
            raise InputError(
                f"{self.name} cannot be updated at the invalid robot pose {tuple(robot)}",
                pose=tuple(robot),
            )
        if self.rolling_window:
            self._roll(robot)
        bounds = EMPTY
        layer: Layer | None = None
        try:
            for layer in self._layers:
                grown: Any = layer.update_bounds(robot, now, bounds)
                if not isinstance(grown, Bounds):
                    raise broken_contract(layer, f"returned bounds of type {type(grown).__name__}, not Bounds")
                if not (
                    grown[0] <= bounds[0] and grown[1] <= bounds[1] and grown[2] >= bounds[2] and grown[3] >= bounds[3]
                ):
                    raise InternalError(
                        f'the layer "{layer.name}" of {self.name} shrank the bounds from {tuple(bounds)} to {tuple(grown)}; '
                        "update_bounds may only grow them: return bounds.union(..)",
                        layer=layer.name,
                    )
                bounds = grown
        except NavError:
            raise
        except Exception as exc:
            raise plugin_error(layer, exc) from exc
        master = self.master
        window = master.geometry.window_of(bounds)
        self.bounds = bounds
        self.window = window
        self.updated_at = now
        if not window.is_empty:
            self._fill_window(master.data, *window, self.default_cost)
            self._write_layers(window)
        return window

    def is_current(self, now: float) -> bool:
        """Return False if a sensor of a layer has timed out at `now` (s)."""
        return all(layer.is_current(now) for layer in self._layers)

    def problems(self) -> Sequence[NavError]:
        """Return why sensors that send data are not used, one error per sensor; empty without a problem."""
        return [problem for layer in self._reporters for problem in layer.problems()]

    def explain(self, ix: int, iy: int) -> CellProvenance:
        """Explain which layer and observation source set the cost of a cell, and when; see `explain_cell`.

        Computed on request only: the layers write the cell's surroundings again, into a copy.
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
        """Clear the observations of every layer and the master grid; return the number of obstacle cells cleared."""
        self.master.data.fill(self.default_cost)
        return sum(layer.reset() for layer in self._layers)

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the robot's footprint (padding included)."""
        self.footprint = footprint
        for layer in self._layers:
            layer.set_footprint(footprint)

    def set_static_map(self, grid: OccupancyGrid) -> bool:
        """Replace the static map, and the size of a costmap that does not roll. Return False if no layer accepts the map."""
        taken = False
        for layer in flattened(self._layers):
            if isinstance(layer, StaticLayer):
                taken = layer.set_map(grid) or taken
        if taken and not self.rolling_window:
            self._resize(self._initial_geometry())
        return taken

    def rewrite(self) -> None:
        """Rewrite the whole master grid."""
        master = self.master
        master.data.fill(self.default_cost)
        self._write_layers(master.geometry.window)

    def _write_layers(self, window: Window) -> None:
        """Let every layer write into the window. Raises InternalError for one that raises, or that replaces the grid."""
        master = self.master
        data, geometry = master.data, master.geometry
        layer: Layer | None = None
        try:
            for layer in self._layers:
                layer.update_costs(master, window)
                if master.data is not data or master.geometry is not geometry or data.shape != geometry.shape:
                    # unusable: planners and critics must not drive on a grid that may be of any size
                    master.data, master.geometry = np.full(geometry.shape, LETHAL, np.uint8), geometry
                    raise broken_contract(
                        layer, f"replaced the grid of {self.name}; update_costs must write into master.data"
                    )
        except NavError:
            raise
        except Exception as exc:
            raise plugin_error(layer, exc) from exc

    def resize(self) -> None:
        """Resize the grid to the static map or the parameters; observations are cleared."""
        self._resize(self._initial_geometry())

    def _resize(self, geometry: GridGeometry) -> None:
        # planners keep a reference to the Costmap, not to its array
        fresh = Costmap(geometry, frame=self.frame)
        self.master.geometry, self.master.data = geometry, fresh.data
        self.master.data.fill(self.default_cost)
        self._base, self._moved = geometry, (0, 0)
        for layer in self._layers:
            layer.match_size(geometry)

    def _initial_geometry(self) -> GridGeometry:
        params = self.params
        if not params.rolling_window:
            for layer in flattened(self._layers):
                if isinstance(layer, StaticLayer):
                    return layer.geometry
        # truncated as in costmap_2d_ros.cpp; the small term corrects rounding such as 0.3 / 0.1 = 2.9999999999999996
        nx, ny = (
            int(min(extent / params.resolution + 1e-9, MAX_CELLS + 1)) for extent in (params.width, params.height)
        )
        if nx < 1 or ny < 1 or nx * ny > MAX_CELLS:
            raise InputError(
                f"{self.name}: width {params.width:g} m and height {params.height:g} m at a resolution of "
                f"{params.resolution:g} m make {_count(nx)} x {_count(ny)} cells"
                f"{_memory(nx * ny)}; choose between 1 and {MAX_CELLS:,} cells in total: lower width and height, or raise "
                "resolution",
                costmap=self.name,
            )
        return GridGeometry(nx, ny, params.resolution, params.origin_x, params.origin_y)

    def _roll(self, robot: Pose2D) -> None:
        """Move the window by whole cells so that the robot is at its center.

        The origin is summed up as in costmap_2d, to the last bit, because rays clipped at the border depend on it. It is also
        counted in cells from its first value, so that rounding errors do not accumulate.
        """
        old = self.master.geometry
        resolution = old.resolution
        dx = int((robot.x - (old.nx - self._cells_short) * resolution / 2.0 - old.origin_x) / resolution)
        dy = int((robot.y - (old.ny - self._cells_short) * resolution / 2.0 - old.origin_y) / resolution)
        if dx == 0 and dy == 0:
            return
        self._moved = (self._moved[0] + dx, self._moved[1] + dy)
        new = old.moved_to(
            _without_drift(old.origin_x + dx * resolution, self._base.origin_x + self._moved[0] * resolution),
            _without_drift(old.origin_y + dy * resolution, self._base.origin_y + self._moved[1] * resolution),
        )
        shift_cells(self.master.data, *window_shift(old, new), self.default_cost)
        self.master.geometry = new
        for layer in self._layers:
            layer.shift_to(new)


def _without_drift(summed: float, counted: float) -> float:
    """Return the origin summed up over the shifts, or the one counted in cells if they differ by a nanometer."""
    return summed if abs(summed - counted) < 1e-9 else counted


def _memory(cells: int) -> str:
    """Return what that many cells need, as a part of a sentence; empty for few of them."""
    return f", which need about {max(1, round(cells * BYTES_PER_CELL / 1e9)):,} GB" if cells > MAX_CELLS else ""


def _count(cells: int) -> str:
    return str(cells) if cells <= MAX_CELLS else f"more than {MAX_CELLS:,}"


# ----------------------------------------------------------------------------------------------------------------------
# Changes of a costmap's parameters at run time, as by dynamic_reconfigure in costmap_2d.
#
# Source: costmap_2d/cfg/*.cfg, costmap_2d_ros.cpp (reconfigureCB). Observations are kept unless the size of the grid changes; the
# master grid is rewritten immediately. Parameters that define the structure of a costmap are fixed.


FIXED: Final = frozenset({"global_frame", "robot_base_frame", "rolling_window", "track_unknown_space", "plugins"})
"""Parameters that a running costmap cannot change."""
FOOTPRINT: Final = frozenset({"footprint", "robot_radius", "footprint_padding"})
"""Parameters without a change of which a footprint that a topic has set remains, as in ROS."""
SIZE: Final = frozenset({"width", "height", "resolution", "origin_x", "origin_y"})


def changed(old: Any, new: Any) -> frozenset[str]:
    """Return the names of the parameters in which two models of one class differ."""
    if old is new:
        return frozenset()
    return frozenset(name for name in type(old).model_fields if getattr(old, name) != getattr(new, name))


def check_reconfigure(costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[Plugin[Layer]]) -> None:
    """Raise InputError with the names of the parameters that a running costmap cannot change."""
    current = [(layer.name, type(layer)) for layer in costmap.layers]
    if current != [(spec.name, spec.cls) for spec in layers]:
        raise InputError(
            f"the layers of {costmap.name} cannot be changed at run time; restart with the new parameters",
            costmap=costmap.name,
            layers=[name for name, _ in current],
        )
    _refuse(costmap.name, "", changed(costmap.params, params) & FIXED)
    for layer, spec in zip(costmap.layers, layers, strict=True):
        fixed = changed(layer.params, spec.params) - layer.LIVE
        if not fixed <= layer.live_parts(spec.params):
            _refuse(costmap.name, f"{layer.name}/", fixed)


def apply_reconfigure(
    costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[Plugin[Layer]], footprint: Footprint
) -> bool:
    """Apply changes that `check_reconfigure` accepted; return False if nothing differs. `footprint` is padded."""
    differing = changed(costmap.params, params)
    moved = bool(differing & FOOTPRINT) and footprint != costmap.footprint
    others = [
        (layer, spec.params)
        for layer, spec in zip(costmap.layers, layers, strict=True)
        if changed(layer.params, spec.params)
    ]
    costmap.params = params
    for layer, layer_params in others:
        layer.set_params(layer_params)
    if moved:
        costmap.set_footprint(footprint)
    if differing & SIZE:
        costmap.resize()
    elif others or moved:
        costmap.rewrite()
    return bool(differing or others or moved)


def _refuse(costmap: str, layer: str, names: frozenset[str]) -> None:
    if names:
        listed = ", ".join(f"{costmap}/{layer}{name}" for name in sorted(names))
        raise InputError(f"{listed} cannot be changed at run time; restart with the new parameters", parameters=listed)


# ----------------------------------------------------------------------------------------------------------------------
# Costs of an array of occupied cells, without layers.


def costs_of_occupied(lethal: NDArray[np.bool_], radius_cells: float) -> NDArray[np.uint8]:
    """Return (ny, nx) costs: lethal, inscribed where a lethal cell's center is within the radius, and free."""
    costs = np.where(lethal, np.uint8(LETHAL), np.uint8(FREE))
    if radius_cells >= 1.0 and lethal.any():
        from scipy.ndimage import distance_transform_edt  # slow import, not needed for a point

        distance = np.asarray(distance_transform_edt(~lethal))
        costs[(distance <= radius_cells + 1e-9) & ~lethal] = INSCRIBED
    return costs

"""costmap_2d::StaticLayer: costs of the map of map_server (plugins/static_layer.cpp)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

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
    OccupancyGrid,
    Pose2D,
    Transform2D,
    Window,
    describe_cost,
)
from navstack.costmap.obstacle_layer import convex_parts, fill_convex, place_footprint
from navstack.costmap.windows import EVERYWHERE, combine_max, look_up_map, look_up_rotated_map
from navstack.plugins import LAYERS, CellExplanation, Layer, LayerContext, LayerTraits, ParamModel, param


class StaticLayerParams(ParamModel):
    """`<costmap>/static_layer:`."""

    enabled: bool = param(True, "apply this layer")
    map_topic: str = param("map", "topic of the map")
    first_map_only: bool = param(False, "later maps are ignored")
    subscribe_to_updates: bool = param(False, "receive updates of the map")
    track_unknown_space: bool = param(True, "unknown cells of the map are unknown, not free")
    use_maximum: bool = param(False, "take the larger cost instead of overwriting the layers below")
    lethal_cost_threshold: int = param(100, "map values from here on are lethal", ge=0, le=100)
    unknown_cost_value: int = param(-1, "map value of unknown cells, as a byte", ge=-128, le=255)
    trinary_costmap: bool = param(
        True, "free, lethal and unknown costs only; otherwise costs in proportion to the map values"
    )

    CLAMPED: ClassVar[frozenset[str]] = frozenset({"lethal_cost_threshold"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space"}
    )


@LAYERS.register("static", aliases=("costmap_2d/StaticLayer",))
class StaticLayer(Layer):
    """Obstacles of the static map.

    Without a rolling window, the costmap has the size of the map and the layer writes only when the map is new. In a rolling
    window or in another frame, each cell center is looked up in the map. With a rotated map, a cell is also lethal if it overlaps
    any lethal cell of the map, and the area beyond the map is unknown. 1 byte per cell of the map.
    """

    Params: ClassVar[type[ParamModel]] = StaticLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled", "use_maximum"})

    @classmethod
    def traits(cls, params: StaticLayerParams) -> LayerTraits:
        """A static map, which may distinguish unknown from free cells; no sensors."""
        return LayerTraits(
            enabled=params.enabled,
            fed_by_sensors=False,
            has_static_map=True,
            tracks_unknown_space=params.track_unknown_space,
        )

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        if context.static_map is None:
            raise InputError(
                f'the layer "{context.name}" requires a map; pass a map, or remove the layer from the plugins list',
                layer=context.name,
            )
        self.map = context.static_map
        self.costs = interpret(self.map, params)
        """(ny, nx) costs of the map."""
        self.geometry = covering_geometry(self.map)
        """Geometry of a costmap without a rolling window."""
        self._table: NDArray[np.float64] | None = None
        self._stamp: float | None = None
        self._fresh = True

    def set_map(self, grid: OccupancyGrid) -> bool:
        """Replace the map; return False if it is ignored (first_map_only). The costmap must then be resized."""
        if self.params.first_map_only:
            return False
        self.map = grid
        self.costs = interpret(grid, self.params)
        self.geometry = covering_geometry(grid)
        self._fresh = True
        return True

    def update_map(self, x: int, y: int, values: NDArray[np.int8]) -> None:
        """Replace the values (h, w) of the map from its cell (x, y) on.

        ROS differs: an update that is not inside the map raises InputError; C++ writes out of bounds.
        """
        height, width = values.shape
        ny, nx = self.map.geometry.shape
        if not (0 <= x <= nx - width and 0 <= y <= ny - height):
            raise InputError(
                f"an update of {width} x {height} cells at ({x}, {y}) is not inside the map of {nx} x {ny} cells",
                at=[x, y],
                size=[width, height],
            )
        data = self.map.data.copy()
        data[y : y + height, x : x + width] = values
        self.map = replace(self.map, data=data, raw=True)
        self.costs = interpret(self.map, self.params)
        self._fresh = True

    def match_size(self, geometry: GridGeometry) -> None:
        """Write the map again at the next update."""
        self._master = geometry
        self._fresh = True

    def shift_to(self, geometry: GridGeometry) -> None:
        """Do nothing: the map does not move with the window."""
        self._master = geometry

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Grow the bounds by the whole map if it is new or the window rolls."""
        if not self.params.enabled:
            return bounds
        self._now = now
        if self.context.rolling_window:
            self._fresh = False
            return bounds.union(self._extent())
        if self._fresh:
            self._fresh = False
            return bounds.union(EVERYWHERE)
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Copy the cells of the window, or look them up if the geometries differ."""
        if not self.params.enabled:
            return
        to_map = self._to_map()
        if to_map.is_identity() and master.geometry == self.map.geometry:
            if self.params.use_maximum:
                combine_max(master.data, self.costs, *window)
            else:
                master.data[window.slices] = self.costs[window.slices]
            return
        affine = cell_affine(to_map, master.geometry, self.map.geometry)
        if to_map.yaw == 0.0:
            look_up_map(master.data, self.costs, *window, affine, self.params.use_maximum)
            return
        # beyond a map with a yaw: the costmap covers more than the map
        unknown = UNKNOWN if self.params.track_unknown_space else FREE
        beyond = -1 if self.context.rolling_window or self.map.origin_yaw == 0.0 else unknown
        look_up_rotated_map(master.data, self.costs, *window, affine, self.params.use_maximum, beyond)

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the value of the map at the cell."""
        a = cell_affine(self._to_map(), master.geometry, self.map.geometry)
        column, row = math.floor(a[0] + a[1] * ix + a[2] * iy), math.floor(a[3] + a[4] * ix + a[5] * iy)
        if not self.map.geometry.contains_cell(column, row):
            return CellExplanation(None, "outside the map")
        cost = int(self.costs[row, column])
        value = int(self.map.data[row, column])
        return CellExplanation(
            cost,
            f"map value {value} in its cell ({column}, {row}): {describe_cost(cost)}",
            source="map",
            data={"map_cell": [column, row], "map_value": value},
        )

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Write the map again at the next update; there are no observations to clear."""
        self._fresh = True
        return 0

    def _to_map(self) -> Transform2D:
        """Return the transform from the costmap's frame to the map's axes, rotated by the yaw of its origin."""
        return map_from_frame(self.map, self.context.frames, self.context.frame, None)

    def _extent(self) -> Bounds:
        """Return the bounds of the map in the costmap's frame (m)."""
        g = self.map.geometry
        inverse = self._to_map().inverse()
        corners = inverse.apply_points(
            np.array(
                [[x, y] for x in (g.origin_x, g.origin_x + g.width_m) for y in (g.origin_y, g.origin_y + g.height_m)]
            )
        )
        (min_x, min_y), (max_x, max_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return Bounds(min_x, min_y, max_x, max_y)


class Nav2StaticLayerParams(ParamModel):
    """Parameters of Nav2's static layer."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "map_subscribe_transient_local": "the map is passed, not subscribed to",
        "transform_tolerance": "the newest transform is used",
    }

    enabled: bool = param(True, "apply this layer")
    map_topic: str = param("map", "topic of the map")
    subscribe_to_updates: bool = param(False, "receive updates of the map")
    footprint_clearing_enabled: bool = param(False, "clear the cells under the robot's footprint")
    restore_cleared_footprint: bool = param(True, "restore the map behind the robot")
    track_unknown_space: bool = param(False, "unknown cells of the map are unknown, not free")
    use_maximum: bool = param(False, "take the larger cost instead of overwriting the layers below")
    lethal_cost_threshold: int = param(100, "map values from here on are lethal", ge=0, le=100)
    inscribed_obstacle_cost_value: int = param(99, "map value of cost 253", ge=-128, le=255)
    unknown_cost_value: int = param(255, "map value of unknown cells, as a byte", ge=-128, le=255)
    trinary_costmap: bool = param(
        True, "free, lethal, inscribed and unknown costs only; otherwise costs in proportion to the map values"
    )
    nav2_compatible: bool = param(
        False,
        "clear the footprint as Nav2 does without a rolling window: only where the robot was when the map was new",
    )

    CLAMPED: ClassVar[frozenset[str]] = frozenset({"lethal_cost_threshold"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {
            *("track_unknown_space", "use_maximum", "lethal_cost_threshold", "inscribed_obstacle_cost_value"),
            *("unknown_cost_value", "trinary_costmap", "map_topic"),
        }
    )

    @property
    def first_map_only(self) -> bool:
        """False: Nav2 accepts every map."""
        return False


@LAYERS.register("nav2_static", aliases=("nav2_costmap_2d/StaticLayer",))
class Nav2StaticLayer(StaticLayer):
    """Obstacles of the static map, by Nav2's rules: with an inscribed map value, and cleared under the footprint on request.

    # Nav2 differs: without a rolling window it goes on clearing where the robot was when the map was new (`nav2_compatible`
    # restores that). In a rolling window with use_maximum, unknown map cells hide lethal cells below.
    """

    Params: ClassVar[type[ParamModel]] = Nav2StaticLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled", "use_maximum"})

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self._place: Pose2D | None = None
        """Pose at which the footprint is cleared, in the costmap's frame."""
        self._spans = np.zeros((2, 1), np.int64)
        self.set_footprint(context.footprint)

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the footprint whose cells are cleared."""
        self._parts = convex_parts(footprint.vertices)

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Grow the bounds by the whole map if it is new or the window rolls, and by the footprint, here and before."""
        if not self.params.enabled:
            return bounds
        was_fresh = self._fresh
        if self.context.rolling_window:
            self._now, self._fresh = now, False
            grown = bounds.union(EVERYWHERE)
        else:
            grown = super().update_bounds(robot, now, bounds)
        if not self.params.footprint_clearing_enabled:
            return grown
        if self.params.nav2_compatible and not (was_fresh or self.context.rolling_window):
            return grown
        for pose in (self._place, robot):
            if pose is not None:
                grown = grown.union(self._bounds_at(pose))
        self._place = robot
        return grown

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Copy or look up the cells of the window; those under the footprint are free."""
        p = self.params
        if not (p.enabled and p.footprint_clearing_enabled) or self._place is None:
            super().update_costs(master, window)
            return
        g = self.map.geometry
        at = self._to_map().apply(self._place)
        if self._spans.shape[1] != g.nx:
            self._spans = np.zeros((2, g.nx), np.int64)
        before = self.costs.copy() if p.restore_cleared_footprint else self.costs
        for part in self._parts:
            placed, box = np.zeros_like(part), np.zeros(4)
            place_footprint(part, at.x, at.y, at.yaw, placed, box)
            fill_convex(self.costs, placed, 0, len(placed), self._spans, g.origin_x, g.origin_y, g.resolution, FREE)
        super().update_costs(master, window)
        self.costs = before

    def _bounds_at(self, pose: Pose2D) -> Bounds:
        """Return the bounds of the footprint at a pose (m)."""
        box = np.array([np.inf, np.inf, -np.inf, -np.inf])
        for part in self._parts:
            place_footprint(part, pose.x, pose.y, pose.yaw, np.zeros_like(part), box)
        return Bounds(*box.tolist())


def interpret(grid: OccupancyGrid, params: Any) -> NDArray[np.uint8]:
    """Convert map values to costs with a table over the 256 values of a byte."""
    values = np.arange(256)
    threshold = int(params.lethal_cost_threshold)
    table = np.zeros(256, np.uint8)
    if not params.trinary_costmap and threshold:
        table = np.minimum(values / threshold * LETHAL, LETHAL).astype(np.uint8)
    table[values >= threshold] = LETHAL
    inscribed = getattr(params, "inscribed_obstacle_cost_value", None)
    if inscribed is not None and 0 <= inscribed <= 255:
        table[inscribed] = INSCRIBED
    table[params.unknown_cost_value & 255] = UNKNOWN if params.track_unknown_space else FREE
    return table[grid.data.view(np.uint8)]


def covering_geometry(grid: OccupancyGrid) -> GridGeometry:
    """Return the geometry of a map; for a rotated map, that of the axis-aligned grid around it."""
    g = grid.geometry
    if grid.origin_yaw == 0.0:
        return g
    # ROS differs: it ignores the yaw of the origin
    at = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    corners = at.apply_points(np.array([[0.0, 0.0], [g.width_m, 0.0], [0.0, g.height_m], [g.width_m, g.height_m]]))
    (min_x, min_y), (max_x, max_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    nx = max(1, math.ceil((max_x - min_x) / g.resolution - 1e-6))
    ny = max(1, math.ceil((max_y - min_y) / g.resolution - 1e-6))
    return GridGeometry(nx, ny, g.resolution, min_x, min_y)


def map_from_frame(grid: OccupancyGrid, frames: FrameTree, frame: str, stamp: float | None) -> Transform2D:
    """Return the transform from `frame` to the axes of the grid: its frame, rotated about its corner by the yaw of its origin."""
    to_map = frames.lookup(grid.frame, frame, stamp)
    if grid.origin_yaw == 0.0:
        return to_map
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, 0.0)
    turned = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    return corner @ turned.inverse() @ to_map


def cell_affine(transform: Transform2D, source: GridGeometry, target: GridGeometry) -> NDArray[np.float64]:
    """Return (6,) a such that the center of cell (ix, iy) of `source` is at the real-valued column a0 + a1 ix + a2 iy and row
    a3 + a4 ix + a5 iy of `target`; `transform` maps coordinates of the source to those of the target.
    """
    c, s = math.cos(transform.yaw), math.sin(transform.yaw)
    x, y = source.cell_to_world(0, 0)
    ratio = source.resolution / target.resolution
    return np.array(
        [
            (transform.x + c * x - s * y - target.origin_x) / target.resolution,
            c * ratio,
            -s * ratio,
            (transform.y + s * x + c * y - target.origin_y) / target.resolution,
            s * ratio,
            c * ratio,
        ]
    )

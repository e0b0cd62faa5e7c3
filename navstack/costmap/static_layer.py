"""costmap_2d::StaticLayer: the map of map_server as costs (plugins/static_layer.cpp)."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    FREE,
    LETHAL,
    UNKNOWN,
    Bounds,
    Costmap,
    FrameTree,
    GridGeometry,
    OccupancyGrid,
    Pose2D,
    Transform2D,
    Window,
    describe_cost,
)
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.costmap import _kernels
from navstack.costmap.regions import EVERYWHERE
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS


class StaticLayerParams(ParamModel):
    """`<costmap>/static_layer:`."""

    enabled: bool = param(True, "apply this layer")
    map_topic: str = param("map", "topic of the map")
    first_map_only: bool = param(False, "later maps are ignored")
    subscribe_to_updates: bool = param(False, "listen to changes of the map")
    track_unknown_space: bool = param(True, "unknown cells of the map are unknown, not free")
    use_maximum: bool = param(False, "take the larger cost instead of overwriting the layers below")
    lethal_cost_threshold: int = param(100, "map values from here on are obstacles", ge=0, le=100)
    unknown_cost_value: int = param(-1, "the map value that means unknown, read as a byte", ge=-128, le=255)
    trinary_costmap: bool = param(True, "free, lethal and unknown only; otherwise map values become graded costs")

    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"map_topic", "unknown_cost_value", "lethal_cost_threshold", "track_unknown_space"}
    )


@LAYERS.register("static", aliases=("costmap_2d/StaticLayer", "nav2_costmap_2d/StaticLayer"))
class StaticLayer(Layer):
    """The building as it was mapped.

    Without a rolling window the costmap takes the map's size and the layer writes only when the map is new. In a rolling
    window, in another frame, or where the map is turned, each cell centre is looked up in the map through the frames.
    1 byte per cell of the map.
    """

    Params: ClassVar[type[ParamModel]] = StaticLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled", "use_maximum"})

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        if context.static_map is None:
            raise InputError(
                f'the layer "{context.name}" needs a map and there is none; give a map, or take the layer off the plugins'
                f" list",
                layer=context.name,
            )
        self.map = context.static_map
        self.costs = interpret(self.map, params)
        """(ny, nx) of the map, as costs."""
        self.geometry = covering_geometry(self.map)
        """What a costmap takes as its own when it does not roll."""
        self._table: NDArray[np.float64] | None = None
        self._stamp: float | None = None
        self._fresh = True

    def set_map(self, grid: OccupancyGrid) -> bool:
        """A new map arrived; False when it is ignored (first_map_only). The costmap must be given its size."""
        if self.params.first_map_only:
            return False
        self.map = grid
        self.costs = interpret(grid, self.params)
        self.geometry = covering_geometry(grid)
        self._fresh = True
        return True

    def match_size(self, geometry: GridGeometry) -> None:
        """The master's geometry: when it is the map's, cells are copied, otherwise looked up."""
        self._master = geometry
        self._fresh = True

    def shift_to(self, geometry: GridGeometry) -> None:
        """The rolling window moved."""
        self._master = geometry

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """All of the map, when it is new or the window rolls."""
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
        """Copies, or looks up, the window's cells."""
        if not self.params.enabled:
            return
        to_map = self._to_map()
        if to_map.is_identity() and master.geometry == self.map.geometry:
            if self.params.use_maximum:
                _kernels.combine_max(master.data, self.costs, *window)
            else:
                master.data[window.slices] = self.costs[window.slices]
            return
        _kernels.look_up_map(
            master.data,
            self.costs,
            *window,
            cell_affine(to_map, master.geometry, self.map.geometry),
            self.params.use_maximum,
        )

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """The value of the map there."""
        a = cell_affine(self._to_map(), master.geometry, self.map.geometry)
        column, row = math.floor(a[0] + a[1] * ix + a[2] * iy), math.floor(a[3] + a[4] * ix + a[5] * iy)
        if not self.map.geometry.contains_cell(column, row):
            return CellExplanation(None, "off the map")
        cost = int(self.costs[row, column])
        value = int(self.map.data[row, column])
        return CellExplanation(
            cost,
            f"the map says {value} in its cell ({column}, {row}): {describe_cost(cost)}",
            source="map",
            data={"map_cell": [column, row], "map_value": value},
        )

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Writes the map again at the next update; it forgets nothing."""
        self._fresh = True
        return 0

    def _to_map(self) -> Transform2D:
        """The costmap's frame in the map's own: origin at the corner of the map's cell (0, 0), turned by its yaw."""
        return map_from_frame(self.map, self.context.frames, self.context.frame, None)

    def _extent(self) -> Bounds:
        """The map's box in the costmap's frame."""
        g = self.map.geometry
        inverse = self._to_map().inverse()
        corners = inverse.apply_points(
            np.array(
                [[x, y] for x in (g.origin_x, g.origin_x + g.width_m) for y in (g.origin_y, g.origin_y + g.height_m)]
            )
        )
        (min_x, min_y), (max_x, max_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
        return Bounds(min_x, min_y, max_x, max_y)


def interpret(grid: OccupancyGrid, params: Any) -> NDArray[np.uint8]:
    """Map values -> costs, by a table over the 256 values of a byte."""
    values = np.arange(256)
    threshold = int(params.lethal_cost_threshold)
    table = np.zeros(256, np.uint8)
    if not params.trinary_costmap and threshold:
        table = np.minimum(values / threshold * LETHAL, LETHAL).astype(np.uint8)
    table[values >= threshold] = LETHAL
    table[params.unknown_cost_value & 255] = UNKNOWN if params.track_unknown_space else FREE
    return table[grid.data.view(np.uint8)]


def covering_geometry(grid: OccupancyGrid) -> GridGeometry:
    """The grid's own geometry, or, when it is turned, that of the upright grid around it."""
    g = grid.geometry
    if grid.origin_yaw == 0.0:
        return g
    # ROS differs: it ignores the yaw and puts the map upright at its corner
    at = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    corners = at.apply_points(np.array([[0.0, 0.0], [g.width_m, 0.0], [0.0, g.height_m], [g.width_m, g.height_m]]))
    (min_x, min_y), (max_x, max_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    nx = max(1, math.ceil((max_x - min_x) / g.resolution - 1e-6))
    ny = max(1, math.ceil((max_y - min_y) / g.resolution - 1e-6))
    return GridGeometry(nx, ny, g.resolution, min_x, min_y)


def map_from_frame(grid: OccupancyGrid, frames: FrameTree, frame: str, stamp: float | None) -> Transform2D:
    """Takes coordinates in `frame` to those in the grid's frame, turned back about the grid's corner by its yaw."""
    to_map = frames.lookup(grid.frame, frame, stamp)
    if grid.origin_yaw == 0.0:
        return to_map
    g = grid.geometry
    corner = Transform2D(g.origin_x, g.origin_y, 0.0)
    turned = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw)
    return corner @ turned.inverse() @ to_map


def cell_affine(transform: Transform2D, source: GridGeometry, target: GridGeometry) -> NDArray[np.float64]:
    """(6,) a such that the centre of cell (ix, iy) of `source` lies at column a0 + a1 ix + a2 iy, row a3 + a4 ix + a5 iy
    (real numbers) of `target`; `transform` takes coordinates of the source to those of the target.
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

"""costmap_2d::ObstacleLayer: marks the points that sensors see and clears the space in front (plugins/obstacle_layer.cpp)."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    UNKNOWN,
    Bounds,
    Costmap,
    Footprint,
    GridGeometry,
    NavError,
    Pose2D,
    SensorData,
    Window,
    clear_line,
    kernel,
    line_next,
    line_start,
)
from navstack.costmap.observation_buffer import (
    Nav2ObservationSourceParams,
    Observation,
    ObservationBuffer,
    ObservationSourceParams,
    SourceParams,
)
from navstack.costmap.windows import (
    clear_region,
    combine_known_max,
    combine_max,
    combine_overwrite,
    shift_cells,
    window_shift,
)
from navstack.plugins import (
    LAYERS,
    CellExplanation,
    CheckContext,
    Issue,
    Layer,
    LayerContext,
    LayerTraits,
    ParamModel,
    SensorSource,
    param,
)

# ----------------------------------------------------------------------------------------------------------------------
# Raytracing and marking of the obstacle layer. Points may be NaN, infinite or outside the map.


# pyright: basic


GRID = np.dtype(
    [
        *[(name, "f8") for name in ("origin_x", "origin_y", "resolution", "max_height", "min_height")],
        ("in_plane", "i8"),
    ],
    align=True,
)
"""Settings of the kernels below: the grid (m, m per cell), the heights between which points count (m), and whether distances are
those of the plane and include their limits (Nav2)."""


@kernel
def line_ends(points, grid, sensor, reach, size, ends, cells):
    """Compute where the rays from `sensor` (x, y) to the points end: points outside the map are moved along their ray onto its
    border.

    `size`: columns and rows of the map. Writes to `ends` (2, N): x and y at `reach` at the latest (m); to `cells` (3, N): ix,
    iy, and whether the ray is inside the map. Without branches and in contiguous arrays, so that the loop is vectorized.
    """
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    nx, ny = size
    sx, sy = sensor
    end_x, end_y = origin_x + nx * resolution, origin_y + ny * resolution
    number = np.uint64(ends.shape[1])
    for i in range(number):
        ends[0, i], ends[1, i] = points[i, 0], points[i, 1]
    for i in range(number):
        wx, wy = ends[0, i], ends[1, i]
        a, b = wx - sx, wy - sy
        outside = wx < origin_x
        wy = sy + b * ((origin_x - sx) / a) if outside else wy
        wx = origin_x if outside else wx
        outside = wy < origin_y
        wx = sx + a * ((origin_y - sy) / b) if outside else wx
        wy = origin_y if outside else wy
        outside = wx > end_x
        wy = sy + b * ((end_x - sx) / a) if outside else wy
        wx = end_x - 0.001 if outside else wx
        outside = wy > end_y
        wx = sx + a * ((end_y - sy) / b) if outside else wx
        wy = end_y - 0.001 if outside else wy
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        inside = (wx >= origin_x) & (wy >= origin_y) & (fx < nx) & (fy < ny)
        dx, dy = wx - sx, wy - sy
        squared = dx * dx + dy * dy
        cut = reach / math.sqrt(squared)
        far = squared > reach * reach
        ends[0, i], ends[1, i] = sx + (dx * cut if far else dx), sy + (dy * cut if far else dy)
        cells[0, i], cells[1, i] = np.int32(fx if inside else 0.0), np.int32(fy if inside else 0.0)
        cells[2, i] = np.int32(1 if inside else 0)


@kernel
def clear_rays(costs, points, count, grid, sx, sy, nearest, reach, bounds):
    """Clear the cells between the sensor at (sx, sy) and each point, from `nearest` (m) up to `reach` (m); grow `bounds`.

    Points outside the map are moved along their ray onto its border (costmap_2d/plugins/obstacle_layer.cpp). With `nearest`, as
    in Nav2, the line begins at the cell that far along the ray, and is as long as that to `reach` would be. Returns False if
    the sensor is outside the map. `grid`: a record of `GRID`.
    """
    ny, nx = costs.shape
    origin_x, origin_y, resolution = grid[0].origin_x, grid[0].origin_y, grid[0].resolution
    if not (sx >= origin_x and sy >= origin_y):
        return False
    fx, fy = (sx - origin_x) / resolution, (sy - origin_y) / resolution
    if not (fx < nx and fy < ny):
        return False
    x0, y0 = int(fx), int(fy)
    nearest_cells, reach_cells = np.ceil(nearest / resolution), np.ceil(reach / resolution)
    flat = costs.reshape(-1)
    ends, cells = np.empty((2, count)), np.empty((3, count), np.int32)
    line_ends(points, grid, (sx, sy), reach, (float(nx), float(ny)), ends, cells)
    min_x, min_y, max_x, max_y = min(bounds[0], sx), min(bounds[1], sy), max(bounds[2], sx), max(bounds[3], sy)
    last_x, last_y = -1, -1
    for i in range(count):
        if cells[2, i] == 0:
            continue
        if nearest == 0.0 or math.hypot(ends[0, i] - sx, ends[1, i] - sy) >= nearest:
            min_x, min_y = min(min_x, ends[0, i]), min(min_y, ends[1, i])
            max_x, max_y = max(max_x, ends[0, i]), max(max_y, ends[1, i])
        x1, y1 = np.int64(cells[0, i]), np.int64(cells[1, i])
        # a ray depends on its two end cells only: adjacent beams often end in the same cell
        if x1 != last_x or y1 != last_y:
            clear_line(flat, nx, x0, y0, x1, y1, nearest_cells, reach_cells)
            last_x, last_y = x1, y1
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y
    return True


@kernel
def mark_points(costs, serials, serial, points, count, grid, sx, sy, sz, nearest, reach, bounds):
    """Mark the cells of the points between `nearest` and `reach` (m) as lethal, with the observation's `serial`; grow `bounds`.

    `grid`: a record of `GRID`. Distances are those in space, and `reach` is excluded; or, by `in_plane`, those in the plane,
    their limits included, of the points and of the cells, and a sensor outside the map marks nothing.
    """
    ny, nx = costs.shape
    g = grid[0]
    origin_x, origin_y, resolution, bottom, top = g.origin_x, g.origin_y, g.resolution, g.min_height, g.max_height
    in_plane = g.in_plane != 0
    x0 = y0 = 0
    if in_plane:
        fx, fy = (sx - origin_x) / resolution, (sy - origin_y) / resolution
        if not (sx >= origin_x and sy >= origin_y and fx < nx and fy < ny):
            return
        x0, y0 = int(fx), int(fy)
    nearest_cells, reach_cells = np.ceil(nearest / resolution), np.ceil(reach / resolution)
    min_x, min_y, max_x, max_y = bounds[0], bounds[1], bounds[2], bounds[3]
    nearest_squared, reach_squared = nearest * nearest, reach * reach
    for i in range(count):
        px, py, pz = float(points[i, 0]), float(points[i, 1]), float(points[i, 2])
        up = 0.0 if in_plane else pz - sz
        squared = (px - sx) * (px - sx) + (py - sy) * (py - sy) + up * up
        if not (squared <= reach_squared) or squared < nearest_squared or pz > top or pz < bottom:
            continue
        if px < origin_x or py < origin_y:
            continue
        fx, fy = (px - origin_x) / resolution, (py - origin_y) / resolution
        if not (fx < nx and fy < ny):
            continue
        ix, iy = int(fx), int(fy)
        if in_plane:
            away = int(math.hypot(ix - x0, iy - y0))
            if away > reach_cells or away < nearest_cells:
                continue
        elif squared == reach_squared:
            continue
        costs[iy, ix] = 254
        serials[iy, ix] = serial
        min_x, min_y, max_x, max_y = min(min_x, px), min(min_y, py), max(max_x, px), max(max_y, py)
    bounds[0], bounds[1], bounds[2], bounds[3] = min_x, min_y, max_x, max_y


# ----------------------------------------------------------------------------------------------------------------------
# The robot's footprint at a pose, and the cells of convex polygons.


# pyright: basic


@kernel
def place_footprint(vertices, x, y, yaw, out, bounds):
    """Write the footprint `vertices` (n, 2) at a pose into `out`; grow `bounds` to contain it."""
    c, s = math.cos(yaw), math.sin(yaw)
    for i in range(vertices.shape[0]):
        wx = x + (vertices[i, 0] * c - vertices[i, 1] * s)
        wy = y + (vertices[i, 0] * s + vertices[i, 1] * c)
        out[i, 0], out[i, 1] = wx, wy
        bounds[0], bounds[1] = min(bounds[0], wx), min(bounds[1], wy)
        bounds[2], bounds[3] = max(bounds[2], wx), max(bounds[3], wy)


@kernel
def fill_convex(costs, vertices, first, last, spans, origin_x, origin_y, resolution, value):
    """Set the cells of a convex polygon: in each column, from the lowest to the highest cell of its edges.

    `vertices[first:last]` are the corners (m), `spans` (2, >= nx) is scratch. Returns False and sets nothing if a corner is
    outside the map (costmap_2d's setConvexPolygonCost).
    """
    ny, nx = costs.shape
    left, right = nx, -1
    for i in range(first, last):
        wx, wy = vertices[i, 0], vertices[i, 1]
        if not (wx >= origin_x and wy >= origin_y):
            return False
        fx, fy = (wx - origin_x) / resolution, (wy - origin_y) / resolution
        if not (fx < nx and fy < ny):
            return False
        left, right = min(left, int(fx)), max(right, int(fx))
    for x in range(left, right + 1):
        spans[0, x] = ny
        spans[1, x] = -1
    for i in range(first, last):
        j = i + 1 if i + 1 < last else first
        x0 = int((vertices[i, 0] - origin_x) / resolution)
        y0 = int((vertices[i, 1] - origin_y) / resolution)
        x1 = int((vertices[j, 0] - origin_x) / resolution)
        y1 = int((vertices[j, 1] - origin_y) / resolution)
        line = line_start(x0, y0, x1, y1, nx)
        cell, error = y0 * nx + x0, line[0] // 2
        for _ in range(line[0] + 1):
            y = cell // nx
            x = cell - y * nx
            spans[0, x] = min(spans[0, x], y)
            spans[1, x] = max(spans[1, x], y)
            cell, error = line_next(cell, error, line)
    for x in range(left, right + 1):
        for y in range(spans[0, x], spans[1, x] + 1):
            costs[y, x] = value
    return True


# ----------------------------------------------------------------------------------------------------------------------
# Convex parts of a polygon: costmap_2d fills convex polygons only, and fills the notches of others too.


def is_convex(vertices: NDArray[np.float64]) -> bool:
    """Return True if the polygon (n, 2) turns in one direction only."""
    turns = _turns(vertices)
    slack = 1e-12 * max(1.0, float(np.abs(turns).max(initial=0.0)))
    return bool((turns >= -slack).all() or (turns <= slack).all())


def convex_parts(vertices: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Return the polygon itself if it is convex, otherwise a triangulation of it, (3, 2) each, by ear clipping.

    The polygon must not cross itself (`Footprint` checks that).
    """
    polygon = np.array(vertices, np.float64)
    if is_convex(polygon):
        return [polygon]
    if _area(polygon) < 0.0:
        polygon = polygon[::-1].copy()
    left = list(range(len(polygon)))
    parts: list[NDArray[np.float64]] = []
    while len(left) > 3:
        ear = next((i for i in range(len(left)) if _is_ear(polygon, left, i)), None)
        if ear is None:  # the remaining corners are collinear
            break
        parts.append(polygon[[left[ear - 1], left[ear], left[(ear + 1) % len(left)]]])
        del left[ear]
    parts.append(polygon[left])
    return parts


def _turns(vertices: NDArray[np.float64]) -> NDArray[np.float64]:
    edges = np.roll(vertices, -1, axis=0) - vertices
    following = np.roll(edges, -1, axis=0)
    return edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]


def _area(vertices: NDArray[np.float64]) -> float:
    x, y = vertices[:, 0], vertices[:, 1]
    return 0.5 * float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())


def _is_ear(polygon: NDArray[np.float64], left: list[int], i: int) -> bool:
    """Return True if the corner turns left and its triangle with its neighbors contains no other corner."""
    a, b, c = polygon[left[i - 1]], polygon[left[i]], polygon[left[(i + 1) % len(left)]]
    if _side(a, b, c) <= 0.0:
        return False
    for k in left:
        p = polygon[k]
        if any(p is q or (p == q).all() for q in (a, b, c)):
            continue
        if _side(a, b, p) >= 0.0 and _side(b, c, p) >= 0.0 and _side(c, a, p) >= 0.0:
            return False
    return True


def _side(a: NDArray[np.float64], b: NDArray[np.float64], p: NDArray[np.float64]) -> float:
    return float((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]))


# ----------------------------------------------------------------------------------------------------------------------
# Origin of marks: serial numbers of observations that fit into the spare bits of a cell.


CAPACITY: Final = 4096
"""Largest number of stored observations."""


class MarkLog:
    """A ring buffer of observations. Serial number 0 means unknown.

    Before half of the ring is used again, `expired` names the serial numbers that are about to get a new meaning: the owner
    removes them from its cells, so that an old mark never shows a new time.
    """

    def __init__(self, bits: int) -> None:
        self._size = min(CAPACITY, 1 << max(bits, 0))
        self._stamps = array("d", bytes(8 * self._size))
        self._sources = array("B", bytes(self._size))
        self._names: list[str] = []
        self._next = 1
        self._wrapped = False
        self.expired: tuple[int, int] | None = None
        """Serial numbers (first, last) that the last `add` invalidated; None without any."""

    def add(self, source: str, stamp: float) -> int:
        """Store an observation of `source` at `stamp` (s); return its serial number."""
        self.expired = None
        if self._size < 4:  # no spare bits
            return 0
        half = self._size // 2
        serial = self._next
        if serial == half:
            self.expired = (half, self._size - 1) if self._wrapped else None
        elif serial == 1 and self._wrapped:
            self.expired = (1, half - 1)
        if source not in self._names:
            self._names.append(source)
        self._stamps[serial] = stamp
        self._sources[serial] = min(self._names.index(source), 255)
        self._next += 1
        if self._next == self._size:
            self._next, self._wrapped = 1, True
        return serial

    def look_up(self, serial: int) -> tuple[str, float] | None:
        """Return the source and the stamp (s) of a serial number; None if unknown."""
        if serial <= 0 or serial >= self._size:
            return None
        return self._names[self._sources[serial]], self._stamps[serial]


OVERWRITE, MAXIMUM, KNOWN_MAXIMUM = 0, 1, 2


class _SensedLayerParams(ParamModel):
    """What the obstacle layers of ROS 1 and Nav2 have in common."""

    enabled: bool = param(True, "apply this layer")
    footprint_clearing_enabled: bool = param(True, "clear the cells under the robot's footprint")
    max_obstacle_height: float = param(2.0, "points above are ignored", unit="m")
    combination_method: int = param(
        1, "0 overwrites the layers below, 1 takes the larger cost, 99 writes nothing", ge=0, le=99
    )
    track_unknown_space: bool | None = param(
        None, "unobserved cells are unknown instead of free; the costmap's own setting if absent"
    )
    transform_tolerance: float = param(0.2, "time tolerance of a message's transform", unit="s", ge=0.0)
    observation_sources: str = param("", "names of the sources, separated by spaces")
    sources: dict[str, SourceParams] = param({}, "parameters of the sources, by name")

    CHILD_FIELD: ClassVar[str | None] = "sources"
    SOURCE: ClassVar[type[ParamModel]]
    """Model of a source."""

    @property
    def lowest(self) -> float:
        """Height below which the layer marks no point (m)."""
        return -math.inf

    @classmethod
    def child_models(cls, values: Mapping[str, Any]) -> dict[str, type[ParamModel]]:
        """One namespace for each name in `observation_sources`."""
        return dict.fromkeys(str(values.get("observation_sources", "")).split(), cls.SOURCE)

    def check(self, context: CheckContext) -> Iterator[Issue]:
        """Yield sources whose marks are never cleared or whose points are all dropped."""
        del context
        for name, source in self.sources.items():
            marked, cleared = source.RANGES
            if source.marking and source.obstacle_range > source.raytrace_range:
                message = (
                    f"{marked} = {source.obstacle_range:g} m of the source {name} exceeds its {cleared} = "
                    f"{source.raytrace_range:g} m, so obstacles marked between the two are never cleared; set {cleared} "
                    "to the larger value"
                )
                yield Issue("warning", "marks-beyond-clearing", (f"{name}/{marked}", f"{name}/{cleared}"), message)
            bottom = max(source.min_obstacle_height, self.lowest)
            top = min(source.max_obstacle_height, self.max_obstacle_height)
            if bottom > top:
                message = (
                    f"the source {name} drops every point: min_obstacle_height {bottom:g} m is above max_obstacle_height "
                    f"{top:g} m (the stricter ones of source and layer); correct one of the heights"
                )
                yield Issue("warning", "drops-every-point", (f"{name}/min_obstacle_height",), message)


class ObstacleLayerParams(_SensedLayerParams):
    """`<costmap>/obstacle_layer:` of type costmap_2d::ObstacleLayer."""

    max_obstacle_height: float = param(2.0, "points above are ignored", unit="m", ge=0.0, le=50.0)
    obstacle_range: float = param(2.5, "default of the sources: points farther away are not marked", unit="m")
    raytrace_range: float = param(3.0, "default of the sources: space farther away is not cleared", unit="m")
    sources: dict[str, ObservationSourceParams] = param({}, "parameters of the sources, by name")

    SOURCE: ClassVar[type[ParamModel]] = ObservationSourceParams
    CLAMPED: ClassVar[frozenset[str]] = frozenset({"max_obstacle_height"})
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset(
        {"max_obstacle_height", "raytrace_range", "obstacle_range", "track_unknown_space"}
    )


@LAYERS.register("obstacle", aliases=("costmap_2d/ObstacleLayer",))
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
    def _top(cls, params: Any) -> float:
        """Return the height above which the layer marks no point (m)."""
        return float(params.max_obstacle_height)

    @classmethod
    def traits(cls, params: ObstacleLayerParams) -> LayerTraits:
        """Sensors if the layer is enabled and has sources; unknown space as set."""
        top = cls._top(params)
        return LayerTraits(
            enabled=params.enabled,
            fed_by_sensors=params.enabled and bool(params.sources),
            tracks_unknown_space=bool(params.track_unknown_space),
            sources={
                name: SensorSource(
                    s.topic or name,
                    s.data_type,
                    s.min_obstacle_height,
                    min(s.max_obstacle_height, top),
                    s.marking,
                    s.sensor_frame,
                    s.raytrace_range,
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
        self._combine(master, window)

    def _combine(self, master: Costmap, window: Window) -> None:
        """Write the costs into the master grid by the combination method."""
        if self.AS_NAV2:
            combine_as_nav2(self.params.combination_method, master, self.costs, window)
        elif self.params.combination_method == MAXIMUM:
            self._combine_max(master.data, self.costs, *window)
        elif self.params.combination_method == OVERWRITE:
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
        """Return False if a source has not received a valid message within its expected_update_rate."""
        return all(buffer.is_current(now) for buffer in self.buffers)

    def problems(self) -> Sequence[NavError]:
        """Return one error per source whose messages cannot be transformed, or show nothing."""
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
        source: Any = seen.source.params
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
            source.obstacle_min_range,
            source.obstacle_range,
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
        return g.origin_x, g.origin_y, g.resolution, params.max_obstacle_height, params.lowest, self.AS_NAV2

    def _clear(self, seen: Observation, box: NDArray[np.float64]) -> bool:
        source: Any = seen.source.params
        settings = self._kernel_settings()
        nearest, reach = source.raytrace_min_range, source.raytrace_range
        return self._clear_rays(self.costs, seen.points, seen.count, settings, seen.x, seen.y, nearest, reach, box)


class Nav2ObstacleLayerParams(_SensedLayerParams):
    """Parameters of Nav2's obstacle layer."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "tf_filter_tolerance": "a message waits for its transform, at most transform_tolerance late",
    }

    min_obstacle_height: float = param(0.0, "points below are ignored", unit="m")
    combination_method: int = param(
        1,
        "0 overwrites the layers below, 1 takes the larger cost, 2 the larger cost in known cells of the layers below; another "
        "value counts as 1, as in Nav2",
    )
    transform_tolerance: float = param(0.3, "time tolerance of a message's transform", unit="s", ge=0.0)
    sources: dict[str, Nav2ObservationSourceParams] = param({}, "parameters of the sources, by name")

    SOURCE: ClassVar[type[ParamModel]] = Nav2ObservationSourceParams
    FROM_PARENT: ClassVar[frozenset[str]] = frozenset({"track_unknown_space", "transform_tolerance"})

    @property
    def lowest(self) -> float:
        """`min_obstacle_height` (m)."""
        return self.min_obstacle_height


NAV2_LIVE: Final = frozenset(
    {"enabled", "footprint_clearing_enabled", "min_obstacle_height", "max_obstacle_height", "combination_method"}
)
"""Parameters of Nav2's obstacle layers that may change at run time."""


@LAYERS.register("nav2_obstacle", aliases=("nav2_costmap_2d/ObstacleLayer",))
class Nav2ObstacleLayer(ObstacleLayer):
    """Obstacles seen by sensors, by Nav2's rules.

    As `obstacle`, but ranges are those of the plane, include their limits, and have minima; points below `min_obstacle_height`
    are dropped; and combination method 2 keeps unknown cells.
    """

    Params: ClassVar[type[ParamModel]] = Nav2ObstacleLayerParams
    AS_NAV2 = True
    LIVE: ClassVar[frozenset[str]] = NAV2_LIVE


def combine_as_nav2(method: int, master: Costmap, costs: NDArray[np.uint8], window: Window) -> None:
    """Write costs into the window of the master grid by Nav2's combination method: 0 overwrite, 2 known maximum, else maximum."""
    combine = (
        combine_overwrite if method == OVERWRITE else combine_known_max if method == KNOWN_MAXIMUM else combine_max
    )
    combine(master.data, costs, *window)

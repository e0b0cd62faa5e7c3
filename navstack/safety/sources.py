"""Sources of obstacle points: scans, clouds, range sensors, polygons and costmaps, as points in the base frame.

A source keeps its last message as points in the frame of the odometry (base_shift_correction) or of the sensor; they are moved
into the base frame when the monitor asks for them.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    FrameError,
    FrameTree,
    InputError,
    LaserScan,
    PointCloud,
    RangeReading,
    SensorData,
    Transform2D,
    Twist2D,
    kernel,
)
from navstack.parameters import ExclusionZoneParams, MonitorSourceParams
from navstack.safety import zones as kernels
from navstack.safety.zones import TINY, Shape, edge_distance, gets_nearer, in_polygon, in_shape

# ----------------------------------------------------------------------------------------------------------------------
# Beams too near to measure: where their obstacle may be, and whether a command moves the robot towards it.
#
# A shape is a polygon `corners` (n, 2) in the base frame, counter-clockwise, or, with no corners, a circle of `radius` around the
# base.


# pyright: basic


@kernel
def inscribed_radius(corners):
    """Return the radius of the largest circle around the base inside a polygon, 0 if the base is outside (m)."""
    return edge_distance(corners, 0.0, 0.0)[0] if in_polygon(corners, 0.0, 0.0) else 0.0


@kernel
def crossing(corners, radius, x, y, dx, dy):
    """Return the distance (m) from (x, y) to the outline of a shape along the unit vector (dx, dy); inf if it is not met."""
    best = math.inf
    n = corners.shape[0]
    if n == 0:
        b = x * dx + y * dy
        rest = b * b - (x * x + y * y - radius * radius)
        if rest >= 0.0:
            half = math.sqrt(rest)
            best = -b - half if -b - half >= 0.0 else -b + half
        return best if best >= 0.0 else math.inf
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        ex, ey = qx - px, qy - py
        cross = dx * ey - dy * ex
        if abs(cross) > TINY:
            ax, ay = px - x, py - y
            t = (ax * ey - ay * ex) / cross
            s = (ax * dy - ay * dx) / cross
            if t >= 0.0 and s >= -TINY and s <= 1.0 + TINY:
                best = min(best, t)
        px, py = qx, qy
    return best


@kernel
def beam_span(corners, radius, x, y, dx, dy, length):
    """Return where the obstacle of a beam may be, from and to (m along it): outside a shape, up to `length` or its outline."""
    edge = crossing(corners, radius, x, y, dx, dy)
    if in_shape(corners, radius, x, y) and edge < math.inf:
        return edge, max(edge, length)
    return 0.0, min(edge, length)


@kernel
def beam_ahead(sensor, directions, length, corners, radius, command, found):
    """Return the index of the first beam to whose obstacle the command (3,) moves a shape, or -1; write the place to `found`.

    `sensor` (2,), `directions` (k, 2) unit vectors, `found` (1, 2).
    """
    x, y = sensor[0], sensor[1]
    for i in range(directions.shape[0]):
        dx, dy = directions[i, 0], directions[i, 1]
        first, last = beam_span(corners, radius, x, y, dx, dy, length)
        for k in range(3):
            r = first + 0.5 * k * (last - first)
            px, py = x + r * dx, y + r * dy
            if gets_nearer(corners, radius, px, py, command[0], command[1], command[2]):
                found[0, 0], found[0, 1] = px, py
                return i
    return -1


# ----------------------------------------------------------------------------------------------------------------------
# Beams that hit something nearer than a scanner can measure: which commands move the robot towards it.


_ROUND: Final = math.cos(math.pi / 16.0) - 1e-9
"""Inscribed over circumscribed radius from which on an outline is a circle: a regular 16-gon, as Footprint.from_radius."""


@dataclass(frozen=True, slots=True, eq=False)
class NearBeams:
    """The beams of a scan that hit something between the sensor and its lowest range."""

    sensor: NDArray[np.float64]
    """(2,) position of the sensor (m)."""
    directions: NDArray[np.float64]
    """(k, 2) unit vectors."""
    range_min: float
    """Lowest range of the sensor (m)."""
    what: str
    """How many beams of what are too near."""

    @property
    def ends(self) -> NDArray[np.float64]:
        """(k, 2) points of the beams at `range_min` (m)."""
        return self.sensor + self.range_min * self.directions

    def moved(self, transform: Transform2D) -> NearBeams:
        """Return the beams in the frame into which `transform` leads."""
        c, s = math.cos(transform.yaw), math.sin(transform.yaw)
        turned = self.directions @ np.array(((c, s), (-s, c)))
        return NearBeams(transform.apply_points(self.sensor[None])[0], turned, self.range_min, self.what)

    def towards(self, body: Shape, command: Twist2D) -> NDArray[np.float64]:
        """Return places (n, 2) of an obstacle on a beam to which a command moves the robot's outline; (0, 2) if there is none.

        The beams are in the base frame. The obstacle may be anywhere outside the outline up to `range_min`, or on the outline,
        if that is farther; the nearest place, the farthest one and the one between them count.
        """
        found = np.empty((1, 2))
        u = np.array(command, np.float64)
        index = beam_ahead(self.sensor, self.directions, self.range_min, body.corners, body.radius, u, found)
        return found[: 1 if index >= 0 else 0]


def body_shape(outline: NDArray[np.float64]) -> Shape:
    """Return the shape of a robot with an outline (n, 2): a circle if it is round, so that it can turn in place."""
    radii = np.hypot(outline[:, 0], outline[:, 1])
    polygon = Shape(outline)
    radius = float(radii.max())
    inscribed = inscribed_radius(polygon.corners)
    return Shape(radius=radius) if inscribed >= _ROUND * radius else polygon


NO_POINTS: Final = np.empty((0, 2))
_ROUNDING_S: Final = 1e-9
_UNKNOWN: Final = 255


@dataclass(frozen=True, slots=True, eq=False)
class PolygonObservation:
    """An obstacle as a polygon, as nav2_msgs/PolygonInstanceStamped: corners (n, 2) in `frame` (m) at `stamp` (s)."""

    id: str
    corners: NDArray[np.float64]
    stamp: float
    frame: str = "base_link"
    topic: str = "polygons"


@dataclass(frozen=True, slots=True, eq=False)
class CostmapObservation:
    """A costmap at `stamp` (s), as nav2_msgs/Costmap."""

    costmap: Costmap
    stamp: float
    topic: str = "local_costmap/costmap"

    @property
    def frame(self) -> str:
        """Frame of the costmap."""
        return self.costmap.frame


Observation = SensorData | PolygonObservation | CostmapObservation


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames that a monitor works in."""

    tree: FrameTree
    base: str
    odom: str
    tolerance_s: float
    """Largest age of a transform (s)."""
    corrected: bool
    """Points are moved by the robot's own motion since their time."""

    def fix(self, frame: str, stamp: float) -> tuple[Transform2D, str]:
        """Return the transform from a sensor's frame at `stamp` to the frame in which its points are kept, and that frame.

        Raises FrameError.
        """
        if not self.corrected:
            return Transform2D(), frame
        return self.tree.lookup(self.odom, frame, stamp, self.tolerance_s), self.odom

    def to_base(self, kept: str, now: float) -> Transform2D:
        """Return the transform from the frame in which points are kept to the base at `now` (s). Raises FrameError."""
        if self.corrected:
            return self.tree.lookup(self.base, kept, now, self.tolerance_s)
        return self.tree.lookup(self.base, kept)


class ExclusionZone:
    """An area in which the points of a source are ignored."""

    def __init__(self, name: str, params: ExclusionZoneParams) -> None:
        self.name = name
        self.params = params
        self.enabled = params.enabled
        self._polygon = shapely.Polygon(params.corners) if params.type == "polygon" else None
        if self._polygon is not None:
            shapely.prepare(self._polygon)

    def keep(self, points: NDArray[np.float64], frames: Frames, now: float) -> NDArray[np.bool_] | None:
        """Return which points (k, 2), base frame, are outside the area; None if its frame is too old or unknown."""
        frame = self.params.frame_id or frames.base
        try:
            hold = max(self.params.frame_hold_timeout, frames.tolerance_s)
            inverse = frames.tree.lookup(frame, frames.base, now, hold)
        except FrameError:
            return None
        there = inverse.apply_points(points)
        if self._polygon is not None:
            return ~shapely.intersects_xy(self._polygon, there[:, 0], there[:, 1])
        radius = self.params.radius or 0.0
        return there[:, 0] ** 2 + there[:, 1] ** 2 > radius * radius


class Source(ABC):
    """One observation source."""

    def __init__(self, name: str, params: MonitorSourceParams, frames: Frames, timeout_s: float) -> None:
        """`timeout_s`: age from which on its data are stale (s); 0 = never."""
        self.name = name
        self.params = params
        self.enabled = params.enabled
        self.topic = params.topic.strip("/")
        self.timeout_s = timeout_s
        self.exclusions = {n: ExclusionZone(n, zone) for n, zone in params.exclusions.items()}
        self._frames = frames
        self._stamp: float | None = None
        """Time of the last message (s)."""
        self._kept: NDArray[np.float64] = NO_POINTS
        self._kept_frame = ""
        self._problem = ""
        """Why the last message cannot be used."""
        self._fault = ""
        """Set by `read`: what is wrong with its message."""
        self._base: NDArray[np.float64] = np.empty((0, 2))

    def observe(self, data: Observation) -> None:
        """Take a message of this source's topic. A message of a wrong type or with invalid values has no effect."""
        if not math.isfinite(data.stamp) or (self._stamp is not None and data.stamp < self._stamp):
            return
        points = self.read(data)
        if points is None:
            return
        self._stamp = data.stamp
        self._problem = self._fault
        if self._problem:
            self._kept = NO_POINTS
            return
        try:
            transform, self._kept_frame = self._frames.fix(data.frame, data.stamp)
        except FrameError as exc:
            self._problem, self._kept = exc.message, NO_POINTS
            return
        self._keep(points, transform)

    def _keep(self, points: NDArray[np.float64], transform: Transform2D) -> None:
        """Keep the points of a message, moved by `transform`."""
        self._kept = _moved(points, transform)

    @abstractmethod
    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Return the points (k, 2) of a message in its frame, None if it cannot be used."""

    def points(self, now: float) -> tuple[NDArray[np.float64], str]:
        """Return the points (k, 2) in the base frame at `now` (s), and why the source is invalid, empty if it is valid."""
        problem = self.problem(now)
        if problem:
            return NO_POINTS, problem
        if not len(self._kept):
            return NO_POINTS, ""
        try:
            transform = self._frames.to_base(self._kept_frame, now)
        except FrameError as exc:
            return NO_POINTS, exc.message
        out = self._base
        if len(out) != len(self._kept):
            out = self._base = np.empty((len(self._kept), 2))
        kernels.transform_points(self._kept, np.array(transform, np.float64), out)
        return self._without_excluded(out, now), ""

    def near_beams(self, now: float) -> NearBeams | None:
        """Return the beams at `now` (s) that hit something too near to measure, if the source sees hardly anything else."""
        del now
        return None

    def problem(self, now: float) -> str:
        """Return why the source has no valid data at `now` (s), empty if it has."""
        if self._stamp is None:
            return f"no data on {self.topic} yet"
        if self._problem:
            return self._problem
        age = now - self._stamp
        if self.timeout_s > 0.0 and age > self.timeout_s + _ROUNDING_S:
            return f"the data of {self.topic} are {age:.2f} s old (source_timeout {self.timeout_s:g} s)"
        return ""

    def _without_excluded(self, points: NDArray[np.float64], now: float) -> NDArray[np.float64]:
        for zone in self.exclusions.values():
            keep = zone.keep(points, self._frames, now) if zone.enabled and len(points) else None
            if keep is not None and not keep.all():
                points = points[keep]
        return points


class ScanSource(Source):
    """Beams of a laser scan within its ranges.

    A scan with hardly a valid beam looks as if nothing was there. Beams that hit something nearer than `range_min` show the
    direction of an obstacle: the monitor holds the robot in those directions. A scan of NaN contains no data.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._key: tuple[float, float, int] | None = None
        self._directions: NDArray[np.float64] = NO_POINTS
        self._near: NearBeams | None = None
        """Of the last message, in the frame in which its points are kept."""

    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Return the points of the valid beams."""
        if not isinstance(data, LaserScan):
            return None
        ranges = np.asarray(data.ranges, np.float32)
        key = (data.angle_min, data.angle_increment, len(ranges))
        if key != self._key:
            angles = data.angle_min + data.angle_increment * np.arange(len(ranges))
            self._directions = np.column_stack((np.cos(angles), np.sin(angles)))
            self._key = key
        out = np.empty((len(ranges), 2))
        count, valid, near = kernels.scan_points(ranges, self._directions, data.range_min, data.range_max, out)
        self._fault, self._near = "", None
        wanted = max(self.params.min_valid_share * len(ranges), 1.0) if self.params.min_valid_share > 0.0 else 0.0
        if valid + near < wanted:
            self._fault = (
                f"{valid} of {len(ranges)} beams of {self.topic} are valid (min_valid_share "
                f"{self.params.min_valid_share:g}): something covers the sensor, or it is faulty"
            )
        elif valid < wanted:
            what = f"{near} of {len(ranges)} beams of {self.topic} hit something nearer than range_min ({data.range_min:g} m)"
            self._near = NearBeams(np.zeros(2), out[len(out) - near :], data.range_min, what)
        return out[:count]

    def _keep(self, points: NDArray[np.float64], transform: Transform2D) -> None:
        super()._keep(points, transform)
        if self._near is not None:
            self._near = self._near.moved(transform)

    def near_beams(self, now: float) -> NearBeams | None:
        """Return the beams that are too near, base frame, without those whose end is in an exclusion zone."""
        if self._near is None or self.problem(now):
            return None
        try:
            near = self._near.moved(self._frames.to_base(self._kept_frame, now))
        except FrameError:
            return None
        keep = np.ones(len(near.directions), np.bool_)
        for zone in self.exclusions.values():
            outside = zone.keep(near.ends, self._frames, now) if zone.enabled else None
            if outside is not None:
                keep &= outside
        return replace(near, directions=near.directions[keep])


class CloudSource(Source):
    """Points of a cloud within heights."""

    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Return x and y of the points within the heights, beyond `min_range`."""
        if not isinstance(data, PointCloud):
            return None
        points = np.ascontiguousarray(data.points, np.float32)
        out = np.empty((len(points), 2))
        p = self.params
        return out[: kernels.cloud_points(points, p.min_height, p.max_height, p.min_range, out)]


class RangeSource(Source):
    """An arc of points at the distance that a sonar measured.

    ROS differs: a reading beyond the range, or infinite, means that nothing is there (REP 117); one below it is an obstacle
    at the lowest range. Nav2 stops the robot in both cases.
    """

    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Return the arc."""
        if not isinstance(data, RangeReading):
            return None
        fov, r = data.field_of_view, data.range_m
        if math.isnan(r) or not 0.0 < fov <= math.pi or not data.max_range > data.min_range:
            return None
        if r >= data.max_range:
            return NO_POINTS
        r = max(r, data.min_range)
        count = math.ceil(fov / self.params.obstacles_angle - 1e-9) + 1
        angles = np.minimum(-0.5 * fov + self.params.obstacles_angle * np.arange(count), 0.5 * fov)
        return np.column_stack((r * np.cos(angles), r * np.sin(angles)))


class PolygonSource(Source):
    """Polygons by id: points on their edges and inside.

    ROS differs: inside too, so that a zone wholly inside a polygon sees it; without polygons the source is valid; each polygon
    is kept until it is stale.
    """

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._by_id: dict[str, tuple[float, NDArray[np.float64]]] = {}

    def observe(self, data: Observation) -> None:
        """Take a polygon; it replaces the one of the same id."""
        if not isinstance(data, PolygonObservation) or not math.isfinite(data.stamp):
            return
        corners = np.asarray(data.corners, np.float64)
        if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3 or not np.isfinite(corners).all():
            return
        try:
            transform, self._kept_frame = self._frames.fix(data.frame, data.stamp)
        except FrameError:
            return
        self._by_id[data.id] = (
            data.stamp,
            transform.apply_points(sample_polygon(corners, self.params.sampling_distance)),
        )
        self._stamp = data.stamp

    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Polygons are read one by one."""
        del data
        return None

    def problem(self, now: float) -> str:
        """No polygon at all is valid: there is no obstacle."""
        del now
        return ""

    def points(self, now: float) -> tuple[NDArray[np.float64], str]:
        """Return the points of all polygons that are not stale."""
        if self.timeout_s > 0.0:
            self._by_id = {k: v for k, v in self._by_id.items() if now - v[0] <= self.timeout_s + _ROUNDING_S}
        self._kept = np.concatenate([NO_POINTS, *(points for _, points in self._by_id.values())])
        return super().points(now)


class CostmapSource(Source):
    """Centers of the cells of a costmap with at least `cost_threshold`."""

    def read(self, data: Observation) -> NDArray[np.float64] | None:
        """Return the centers of the occupied cells."""
        if not isinstance(data, CostmapObservation):
            return None
        cells, g = data.costmap.data, data.costmap.geometry
        occupied = (cells >= self.params.cost_threshold) & (cells != _UNKNOWN)
        if self.params.treat_unknown_as_obstacle:
            occupied |= cells == _UNKNOWN
        iy, ix = np.nonzero(occupied)
        cells_xy = np.column_stack((ix, iy)).astype(np.float64) + 0.5
        return np.array((g.origin_x, g.origin_y)) + g.resolution * cells_xy


def _moved(points: NDArray[np.float64], transform: Transform2D) -> NDArray[np.float64]:
    if transform.is_identity() or not len(points):
        return points
    out = np.empty_like(points)
    kernels.transform_points(points, np.array(transform, np.float64), out)
    return out


def sample_polygon(corners: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Return points on the edges of a polygon (n, 2) and inside, at most `distance` (m) apart along each axis."""
    parts: list[NDArray[np.float64]] = []
    for k, corner in enumerate(corners):
        edge = corners[(k + 1) % len(corners)] - corner
        count = max(math.ceil(float(np.hypot(*edge)) / distance), 1)
        parts.append(corner + (np.arange(count) / count)[:, None] * edge)
    (left, low), (right, high) = corners.min(axis=0), corners.max(axis=0)
    xs, ys = np.arange(left + distance, right, distance), np.arange(low + distance, high, distance)
    x, y = (axis.ravel() for axis in np.meshgrid(xs, ys))
    inside = shapely.intersects_xy(shapely.make_valid(shapely.Polygon(corners)), x, y)
    return np.concatenate([*parts, np.column_stack((x[inside], y[inside]))])


_KINDS: Final[dict[str, type[Source]]] = {
    "scan": ScanSource,
    "pointcloud": CloudSource,
    "range": RangeSource,
    "polygon": PolygonSource,
    "costmap": CostmapSource,
}


def build_source(name: str, params: MonitorSourceParams, frames: Frames, node_timeout_s: float) -> Source:
    """Build a source; `node_timeout_s` is the default of its `source_timeout` (s)."""
    timeout_s = node_timeout_s if params.source_timeout is None else params.source_timeout
    if timeout_s < 0.0:
        raise InputError(f"source_timeout of {name} is {timeout_s:g}; it must be at least 0", source=name)
    return _KINDS[params.type](name, params, frames, timeout_s)


# ----------------------------------------------------------------------------------------------------------------------
# The points of all sources of a monitor at one time.


class PointField:
    """The sources of a monitor, and their points in the base frame since the last `update`."""

    def __init__(self, params: Mapping[str, MonitorSourceParams], frames: Frames, timeout_s: float) -> None:
        """`timeout_s`: default age (s) from which on data are stale; 0 = never."""
        self.sources: dict[str, Source] = {
            name: build_source(name, source, frames, timeout_s) for name, source in params.items()
        }
        self._by_topic: dict[str, list[Source]] = {}
        for source in self.sources.values():
            self._by_topic.setdefault(source.topic, []).append(source)
        self.near: dict[str, NearBeams] = {}
        """Name -> beams of the sources that see hardly anything but something too near to measure, base frame."""
        self._parts: dict[str, NDArray[np.float64]] = {}
        self._joined: dict[tuple[str, ...], NDArray[np.float64]] = {}

    def observe(self, data: Observation) -> None:
        """Pass a message to the sources of its topic."""
        for source in self._by_topic.get(data.topic.strip("/"), ()):
            if source.enabled:
                source.observe(data)

    def observe_costmap(self, name: str, costmap: Costmap, stamp: float) -> None:
        """Pass a costmap to the sources whose topic is in its namespace (`local_costmap/costmap`)."""
        for topic, sources in self._by_topic.items():
            if topic.partition("/")[0] != name:
                continue
            for source in sources:
                if source.enabled and source.params.type == "costmap":
                    source.observe(CostmapObservation(costmap, stamp, topic))

    def update(self, now: float, used: Collection[str] | None = None) -> dict[str, str]:
        """Move the points to the base frame at `now` (s); return name -> problem of the sources that make the robot stop.

        A source without a `source_timeout` never does. `used` are the sources that count; None for all.
        """
        self.near, self._parts, self._joined = {}, {}, {}
        problems: dict[str, str] = {}
        for name, source in self.sources.items():
            if not source.enabled or (used is not None and name not in used):
                continue
            points, problem = source.points(now)
            if problem and source.timeout_s > 0.0:
                problems[name] = problem
                continue
            near = source.near_beams(now)
            if near is not None:
                self.near[name] = near
            if len(points):
                self._parts[name] = points
        return problems

    def points(self, names: tuple[str, ...]) -> NDArray[np.float64]:
        """Return the points (k, 2) of some of the sources, base frame. Read-only."""
        joined = self._joined.get(names)
        if joined is None:
            parts = [part for name in names if (part := self._parts.get(name)) is not None]
            joined = NO_POINTS if not parts else parts[0] if len(parts) == 1 else np.concatenate(parts)
            self._joined[names] = joined
        return joined

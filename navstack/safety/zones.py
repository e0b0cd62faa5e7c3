"""The zones of a collision monitor: shape, debounce, and which points are inside."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np
import shapely
from numpy.typing import NDArray

from navstack.core import Footprint, InputError, Twist2D, kernel
from navstack.parameters import SubPolygonParams, ZoneParams

# ----------------------------------------------------------------------------------------------------------------------
# Points and zones: which points are inside, how far they are, and whether a command brings them nearer.
#
# A shape is a polygon `corners` (n, 2) in the base frame, counter-clockwise, or, with no corners, a circle of `radius` around the
# base. Points (k, 2) are in the base frame.


# pyright: basic


# a point that gets nearer more slowly than this does not get nearer, m/s
NEARER = 1e-6
TINY = 1e-12
# a point deeper inside the robot must get out: noise and padding do not explain it, m
DEEP = 0.03


@kernel
def in_polygon(corners, x, y):
    """Return True if an odd number of edges cross the ray from the point along +x; edges are half open in y."""
    inside = False
    n = corners.shape[0]
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        if (py < y) != (qy < y) and px + (y - py) * (qx - px) / (qy - py) > x:
            inside = not inside
        px, py = qx, qy
    return inside


@kernel
def in_shape(corners, radius, x, y):
    """Return True if the point is inside the shape."""
    if corners.shape[0] == 0:
        return x * x + y * y < radius * radius
    return in_polygon(corners, x, y)


@kernel
def count_inside(points, corners, radius, reach, found):
    """Return the number of points in a shape; write the indices of the first ones to `found`.

    `reach`: no part of the shape is farther from the base (m).
    """
    count = 0
    limit = reach * reach
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        if x * x + y * y <= limit and in_shape(corners, radius, x, y):
            if count < found.shape[0]:
                found[count] = i
            count += 1
    return count


@kernel
def edge_distance(corners, x, y):
    """Return the distance from a point to the outline of a polygon and the nearest point there: distance, x, y, edge."""
    best, bx, by, edge = math.inf, 0.0, 0.0, 0
    n = corners.shape[0]
    px, py = corners[n - 1, 0], corners[n - 1, 1]
    for i in range(n):
        qx, qy = corners[i, 0], corners[i, 1]
        dx, dy = qx - px, qy - py
        length = dx * dx + dy * dy
        s = 0.0
        if length > 0.0:
            s = min(max(((x - px) * dx + (y - py) * dy) / length, 0.0), 1.0)
        cx, cy = px + s * dx, py + s * dy
        square = (x - cx) * (x - cx) + (y - cy) * (y - cy)
        if square < best:
            best, bx, by, edge = square, cx, cy, i
        px, py = qx, qy
    return math.sqrt(best), bx, by, edge


@kernel
def shape_distance(corners, radius, x, y):
    """Return the distance from a point to a shape, 0 inside (m)."""
    if corners.shape[0] == 0:
        return max(math.hypot(x, y) - radius, 0.0)
    if in_polygon(corners, x, y):
        return 0.0
    return edge_distance(corners, x, y)[0]


@kernel
def gets_nearer(corners, radius, x, y, vx, vy, w):
    """Return True if a command moves a point towards the outline of a shape; inside it, deeper, or if deep, not outwards.

    The rate of the distance is the velocity of the point relative to the robot along the normal of the outline.
    """
    if corners.shape[0] == 0:
        far = math.hypot(x, y)
        rate = -(x * vx + y * vy) / max(far, TINY)
        return rate < (NEARER if far < radius - DEEP else -NEARER)
    _, cx, cy, edge = edge_distance(corners, x, y)
    nx, ny = x - cx, y - cy
    size = math.hypot(nx, ny)
    inside = in_polygon(corners, x, y)
    deep = inside and size > DEEP
    if size < TINY:
        n = corners.shape[0]
        nx = corners[edge, 1] - corners[(edge + n - 1) % n, 1]
        ny = corners[(edge + n - 1) % n, 0] - corners[edge, 0]
        size = math.hypot(nx, ny)
    elif inside:
        nx, ny = -nx, -ny
    rate = (nx * (w * y - vx) - ny * (w * x + vy)) / size
    return rate < (NEARER if deep else -NEARER)


@kernel
def any_nearer(points, found, count, corners, radius, command):
    """Return the index of the first of the points `found[:count]` that the command (3,) brings nearer to a shape, or -1."""
    for k in range(count):
        i = found[k]
        if gets_nearer(corners, radius, points[i, 0], points[i, 1], command[0], command[1], command[2]):
            return i
    return -1


@kernel
def transform_points(points, pose, out):
    """Write points (k, 2) in a frame at `pose` (3,) to `out` (k, 2)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        out[i, 0] = pose[0] + c * x - s * y
        out[i, 1] = pose[1] + s * x + c * y


@kernel
def scan_points(ranges, directions, range_min, range_max, out):
    """Write the points of the beams of a scan that hit something to the start of `out` (n, 2), sensor frame; return their number.

    `directions` (n, 2): cosine and sine of each beam. The second result is the number of valid beams: those, and the ones
    without a hit (REP 117: +inf). The third one is the number of beams that hit something nearer than `range_min` (-inf too);
    their directions fill the end of `out`. NaN says nothing about the beam.
    """
    count, valid, near = 0, 0, 0
    last = ranges.shape[0] - 1
    for i in range(ranges.shape[0]):
        r = ranges[i]
        if r < range_min:
            out[last - near, 0] = directions[i, 0]
            out[last - near, 1] = directions[i, 1]
            near += 1
        elif r >= range_min:
            valid += 1
            if r <= range_max and r < math.inf:
                out[count, 0] = r * directions[i, 0]
                out[count, 1] = r * directions[i, 1]
                count += 1
    return count, valid, near


@kernel
def cloud_points(points, min_height, max_height, min_range, out):
    """Write x and y of the points (n, 3) of a cloud within heights and beyond a range (m) to `out`; return their number."""
    count = 0
    square = min_range * min_range
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if z >= min_height and z <= max_height and x * x + y * y >= square and abs(x) + abs(y) < math.inf:
            out[count, 0] = x
            out[count, 1] = y
            count += 1
    return count


Action = Literal["none", "stop", "slowdown", "limit", "approach"]
MOST_SHOWN: Final = 32
"""Number of triggering points that a decision keeps."""


class Shape:
    """A polygon in the base frame, or a circle around the base."""

    __slots__ = ("corners", "radius", "reach")

    def __init__(self, corners: NDArray[np.float64] | None = None, radius: float = 0.0) -> None:
        """Raises InputError for a polygon that crosses itself or has no area."""
        self.radius = radius
        if corners is None:
            self.corners: NDArray[np.float64] = np.empty((0, 2))
            self.reach = radius
            return
        polygon = shapely.Polygon(corners)
        if not polygon.is_valid or not polygon.area > 0.0:
            raise InputError("the polygon of a zone crosses itself or has no area; list its corners in order")
        # shapely.normalize would also change the first corner
        ring = np.array(corners, np.float64)
        self.corners = ring if polygon.exterior.is_ccw else ring[::-1].copy()
        self.reach = float(np.hypot(ring[:, 0], ring[:, 1]).max())

    @property
    def area(self) -> float:
        """Square meters."""
        return shapely.Polygon(self.corners).area if len(self.corners) else math.pi * self.radius**2

    def outline(self) -> NDArray[np.float64]:
        """Return corners (n, 2) for pictures."""
        if len(self.corners):
            return self.corners
        angles = np.linspace(0.0, 2.0 * math.pi, 49)[:-1]
        return self.radius * np.column_stack((np.cos(angles), np.sin(angles)))


class Zone:
    """A zone and its state from check to check."""

    def __init__(self, name: str, params: ZoneParams, sources: tuple[str, ...], footprint: Footprint | None) -> None:
        """`sources`: all sources of the monitor; `footprint`: the padded footprint, for zones that take it."""
        self.name = name
        self.params = params
        self.enabled = params.enabled
        self.sources = sources if params.sources_names is None else tuple(params.sources_names)
        self.least = params.least_points
        self.shape: Shape | None = None
        """None until a shape is known."""
        self._choices: list[tuple[SubPolygonParams, Shape]] = []
        self._hits = 0
        self._misses = 0
        self._active = False
        self._found = np.empty(MOST_SHOWN, np.int64)
        if params.type == "circle":
            self.shape = None if params.radius is None else Shape(radius=params.radius)
        elif params.type == "velocity_polygon":
            self._choices = [
                (sub, Shape(np.array(sub.corners, np.float64)))
                for name in params.velocity_polygons
                if (sub := params.sub_polygons.get(name)) is not None
            ]
        elif params.corners:
            self.shape = Shape(np.array(params.corners, np.float64))
        elif params.takes_footprint and footprint is not None:
            self.shape = Shape(footprint.vertices)

    @property
    def largest(self) -> Shape | None:
        """The largest polygon of a velocity polygon."""
        return max((shape for _, shape in self._choices), key=lambda shape: shape.area, default=None)

    def choose(self, command: Twist2D, *, largest: bool) -> bool:
        """Choose the polygon of a velocity polygon for a command; return False if none fits, so that the previous one stays.

        With `largest`, the largest polygon is used until one has fitted.
        """
        for sub, shape in self._choices:
            if _fits(sub, command, holonomic=self.params.holonomic):
                self.shape = shape
                return True
        if self.shape is None and largest:
            self.shape = self.largest
        return not self._choices

    def set_shape(self, shape: Shape) -> None:
        """Replace the shape. The debounce starts again."""
        self.shape = shape
        self.reset()

    def reset(self) -> None:
        """Reset the checks so far."""
        self._hits = self._misses = 0
        self._active = False

    def inside(self, points: NDArray[np.float64]) -> tuple[int, NDArray[np.int64]]:
        """Return the number of points (k, 2), base frame, inside, and the indices of the first `MOST_SHOWN` of them."""
        shape = self.shape
        assert shape is not None
        if len(self._found) < min(len(points), MOST_SHOWN):
            self._found = np.empty(MOST_SHOWN, np.int64)
        count = count_inside(points, shape.corners, shape.radius, shape.reach, self._found)
        return count, self._found[: min(count, MOST_SHOWN)].copy()

    def debounce(self, hit: bool) -> bool:
        """Count a check; return True while the zone acts: from the n-th hit in a row to the m-th miss in a row."""
        if hit:
            self._hits, self._misses = self._hits + 1, 0
            self._active = self._active or self._hits >= self.params.trigger_consecutive_points
        else:
            self._hits, self._misses = 0, self._misses + 1
            self._active = self._active and self._misses < self.params.release_consecutive_points
        return self._active


def _fits(sub: SubPolygonParams, command: Twist2D, *, holonomic: bool) -> bool:
    if not sub.theta_min <= command.wz <= sub.theta_max:
        return False
    if not holonomic:
        return sub.linear_min <= command.vx <= sub.linear_max
    if not sub.linear_min <= command.speed <= sub.linear_max:
        return False
    direction = math.atan2(command.vy, command.vx) if command.speed > 0.0 else 0.0
    start, end = sub.direction_start_angle, sub.direction_end_angle
    return start <= direction <= end if start <= end else not end < direction < start

"""Detector of a V-shaped reflector in a lidar scan: two flat walls of known length that meet at a known angle.

The reflector needs no intensity and no camera: the shape itself is the marker. Near the place where it should be, the points of
a scan are split into runs without a gap, each run into straight pieces (Ramer 1972, Douglas and Peucker 1973), and every two
neighboring pieces are tried as the two walls. Each wall is fitted by total least squares; the vertex is where the lines meet, and
the heading is their bisector, so that the errors of the two fits are averaged.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import DockDetection, LaserScan, Pose2D, SensorData, angle_between
from navstack.plugins import DOCK_DETECTORS, DockDetector, PluginSection, param

Points = NDArray[np.float64]
"""(n, 2) m."""

TOPIC: Final = "reflector"
"""Topic of the detections."""


class VReflectorParams(PluginSection):
    """The shape of the reflector, and what counts as one."""

    topic: str = param("", "topic of the lidar; none: every lidar")
    length: float = param(0.2, "length of each wall", unit="m", gt=0.0)
    angle: float = param(
        2.36,
        "angle between the walls on the side of the robot: below pi the vertex is the deepest point, above pi the nearest",
        unit="rad",
        gt=0.5,
        lt=5.8,
    )
    length_tolerance: float = param(0.08, "largest error of the length of a wall", unit="m", gt=0.0)
    angle_tolerance: float = param(0.3, "largest error of the angle between the walls", unit="rad", gt=0.0)
    search_radius: float = param(0.5, "how far from its expected position the vertex is searched", unit="m", gt=0.0)
    max_yaw_error: float = param(0.8, "largest difference from the expected heading", unit="rad", gt=0.0)
    min_points: int = param(5, "points of a wall at least", ge=3)
    max_gap: float = param(0.08, "distance between neighboring points that ends a wall", unit="m", gt=0.0)
    max_residual: float = param(
        0.02,
        "root mean square distance of the points from their wall; set it to about twice the noise of the lidar",
        unit="m",
        gt=0.0,
    )


class Wall(NamedTuple):
    """A fitted line: a point on it, its direction from the vertex outwards, the residual."""

    x: float
    y: float
    dx: float
    dy: float
    residual: float


@DOCK_DETECTORS.register("v_reflector")
class VReflectorDetector(DockDetector[VReflectorParams]):
    """Finds a V-shaped reflector in the scans of a lidar."""

    Params = VReflectorParams

    def detect(self, data: SensorData | DockDetection, expected: Pose2D) -> DockDetection | None:
        """Return the vertex, and the heading into the dock, of the reflector that fits best; None if none fits."""
        p = self.params
        if not isinstance(data, LaserScan) or (p.topic and data.topic.strip("/") != p.topic.strip("/")):
            return None
        runs = runs_of(self._near(data, expected), p.max_gap, 2 * p.min_points)
        pairs = [pair for run in runs for pair in neighbors(run, 2.0 * p.max_residual, p.min_points)]
        found = [vee for pair in pairs if (vee := vee_of(*pair)) is not None]
        fitting = [vee for vee in found if self._fits(vee, expected)]
        if not fitting:
            self.remark = self._nothing(runs, found, expected)
            return None
        best = min(fitting, key=self._misfit)
        number = sum(best.points)
        self.remark = (
            f"a reflector of {number} points at {math.hypot(best.x, best.y):.2f} m, {math.degrees(best.angle):.0f} degrees wide, "
            f"residual {1000.0 * best.residual:.0f} mm"
        )
        return DockDetection.of_heading(best.x, best.y, best.yaw, data.stamp, data.frame, TOPIC)

    def _near(self, scan: LaserScan, expected: Pose2D) -> list[Points]:
        """Return the points near the expected vertex, in parts without a beam in between that measured elsewhere."""
        ranges = np.asarray(scan.ranges, np.float64)
        with np.errstate(invalid="ignore"):
            good = np.isfinite(ranges) & (ranges >= scan.range_min) & (ranges <= scan.range_max)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        r = np.where(good, ranges, 0.0)
        points = np.column_stack((r * np.cos(angles), r * np.sin(angles)))
        reach = self.params.search_radius + self.params.length + self.params.length_tolerance
        near = good & (np.hypot(points[:, 0] - expected.x, points[:, 1] - expected.y) <= reach)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], near.astype(np.int8), [0]))))
        return [points[a:b] for a, b in zip(edges[::2], edges[1::2])]

    def _fits(self, vee: Vee, expected: Pose2D) -> bool:
        p = self.params
        return (
            abs(vee.angle - p.angle) <= p.angle_tolerance
            and max(abs(length - p.length) for length in vee.lengths) <= p.length_tolerance
            and vee.residual <= p.max_residual
            and math.hypot(vee.x - expected.x, vee.y - expected.y) <= p.search_radius
            and abs(angle_between(vee.yaw, expected.yaw)) <= p.max_yaw_error
        )

    def _misfit(self, vee: Vee) -> float:
        """Return how little the shape fits, in tolerances."""
        p = self.params
        return (
            abs(vee.angle - p.angle) / p.angle_tolerance
            + sum(abs(length - p.length) for length in vee.lengths) / p.length_tolerance
            + vee.residual / p.max_residual
        )

    def _nothing(self, runs: list[Points], found: list[Vee], expected: Pose2D) -> str:
        """Return why no reflector was found."""
        if not runs:
            return (
                f"no wall of {2 * self.params.min_points} points near ({expected.x:.2f}, {expected.y:.2f}) of the lidar"
            )
        if not found:
            return "a wall without a corner"
        vee = min(found, key=self._misfit)
        lengths = " and ".join(f"{length:.2f}" for length in vee.lengths)
        return f"a corner of {math.degrees(vee.angle):.0f} degrees with walls of {lengths} m, which is no reflector"


class Vee(NamedTuple):
    """Two walls that meet."""

    x: float
    y: float
    yaw: float
    """Heading into the dock (rad)."""
    angle: float
    """Between the walls, on the side of the sensor (rad)."""
    lengths: tuple[float, float]
    points: tuple[int, int]
    residual: float
    """Of the worse wall (m)."""


def runs_of(parts: list[Points], max_gap: float, least: int) -> list[Points]:
    """Return the runs of at least `least` points whose neighbors are at most `max_gap` (m) apart."""
    runs: list[Points] = []
    for part in parts:
        gaps = np.flatnonzero(np.hypot(*np.diff(part, axis=0).T) > max_gap) + 1
        runs += [run for run in np.split(part, gaps) if len(run) >= least]
    return runs


def neighbors(run: Points, threshold: float, least: int) -> list[tuple[Points, Points]]:
    """Return every two neighboring straight pieces of a run, with at least `least` points each."""
    corners = [0, *_corners(run, 0, len(run) - 1, threshold), len(run) - 1]
    pairs: list[tuple[Points, Points]] = []
    for a, b, c in zip(corners, corners[1:], corners[2:]):
        corner = _best_split(run, a, b, c, least)
        if corner is not None:
            pairs.append((run[a:corner], run[corner : c + 1]))
    return pairs


def _corners(run: Points, first: int, last: int, threshold: float) -> list[int]:
    """Return the indices of the corners between two points: where the run is farther than `threshold` from a straight line."""
    if last - first < 2:
        return []
    a, b = run[first], run[last]
    dx, dy = b - a
    length = math.hypot(dx, dy)
    between = run[first + 1 : last] - a
    away = np.abs(dx * between[:, 1] - dy * between[:, 0]) / length if length > 0.0 else np.hypot(*between.T)
    k = int(away.argmax())
    if away[k] <= threshold:
        return []
    corner = first + 1 + k
    return [*_corners(run, first, corner, threshold), corner, *_corners(run, corner, last, threshold)]


def _best_split(run: Points, first: int, corner: int, last: int, least: int) -> int | None:
    """Return the index between two pieces for which two lines fit best, near the corner; None if a piece is too short."""
    low, high = max(first + least, corner - least), min(last + 1 - least, corner + least)
    if low > high:
        return None
    splits = range(low, high + 1)
    return min(splits, key=lambda k: _scatter(run[first:k]) + _scatter(run[k : last + 1]))


def _scatter(points: Points) -> float:
    """Return the sum of the squared distances from the line that fits best (m²)."""
    centered = points - points.mean(axis=0)
    xx, yy = float(centered[:, 0] @ centered[:, 0]), float(centered[:, 1] @ centered[:, 1])
    xy = float(centered[:, 0] @ centered[:, 1])
    return max(0.0, 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy))


def _fitted(points: Points) -> Wall:
    """Return the line through the points by total least squares, in the direction from the first to the last."""
    x, y = points.mean(axis=0).tolist()
    centered = points - (x, y)
    xx, yy = float(centered[:, 0] @ centered[:, 0]), float(centered[:, 1] @ centered[:, 1])
    angle = 0.5 * math.atan2(2.0 * float(centered[:, 0] @ centered[:, 1]), xx - yy)
    dx, dy = math.cos(angle), math.sin(angle)
    along = points[-1] - points[0]
    if dx * along[0] + dy * along[1] < 0.0:
        dx, dy = -dx, -dy
    return Wall(x, y, dx, dy, math.sqrt(_scatter(points) / len(points)))


def vee_of(first: Points, second: Points) -> Vee | None:
    """Return the V of two walls, whose points lead to the vertex and away from it; None for parallel ones.

    The sensor is at the origin.
    """
    a, b = _fitted(first), _fitted(second)
    a = a._replace(dx=-a.dx, dy=-a.dy)  # outwards
    cross = a.dx * b.dy - a.dy * b.dx
    if abs(cross) < 1e-6:
        return None
    t = ((b.x - a.x) * b.dy - (b.y - a.y) * b.dx) / cross
    x, y = a.x + t * a.dx, a.y + t * a.dy
    between = math.acos(min(1.0, max(-1.0, a.dx * b.dx + a.dy * b.dy)))
    mid_x, mid_y = a.dx + b.dx, a.dy + b.dy
    opens = mid_x * -x + mid_y * -y > 0.0  # towards the sensor: the vertex is the deepest point
    yaw = math.atan2(-mid_y, -mid_x) if opens else math.atan2(mid_y, mid_x)
    lengths = (
        float((first[0, 0] - x) * a.dx + (first[0, 1] - y) * a.dy),
        float((second[-1, 0] - x) * b.dx + (second[-1, 1] - y) * b.dy),
    )
    angle = between if opens else 2.0 * math.pi - between
    return Vee(x, y, yaw, angle, lengths, (len(first), len(second)), max(a.residual, b.residual))

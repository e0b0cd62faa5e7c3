"""Observation sources of a layer: sensor messages as points in the costmap's frame.

Source of the rules: costmap_2d/src/observation_buffer.cpp, plugins/obstacle_layer.cpp (laserScanCallback),
laser_geometry and tf2_sensor_msgs (for the rounding to float32).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    BlindSensorError,
    DeferredCloud,
    DeferredScan,
    FrameError,
    FrameTree,
    InputError,
    LaserScan,
    NavError,
    PointCloud,
    SensorData,
    Transform2D,
    kernel,
)
from navstack.plugins import ParamModel, param

# ----------------------------------------------------------------------------------------------------------------------
# Points of scans and clouds in the costmap's frame. NaN, infinite values and points outside the map are handled here.


# pyright: basic


@kernel
def project_scan(ranges, directions, range_min, range_max, inf_range, x, y, yaw, height, out):
    """Write the points (x, y, z) float32 of a scan's valid beams in the global frame into `out`; return their number.

    `directions` (n, 2): cosine and sine of each beam. `inf_range` (m) replaces +inf unless it is NaN. `x`, `y`, `yaw`: pose
    of the sensor's frame. Rounds to float32 where ROS does: the points in laser_geometry, then the transform of the cloud in
    tf2, which converts a float32 quaternion to a float32 matrix.
    """
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty, z = np.float32(x), np.float32(y), np.float32(height)
    replace = not math.isnan(inf_range)
    for i in range(ranges.size):
        r = float(ranges[i])
        if replace and r == math.inf:
            r = float(inf_range)
        if r >= range_min and r < range_max:  # false for NaN
            px = np.float32(r * directions[i, 0])
            py = np.float32(r * directions[i, 1])
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = z
            count += 1
    return count


@kernel
def project_points(points, x, y, yaw, min_height, max_height, out):
    """Write the points (n, 3) float32 between the two heights (m), in the global frame, into `out`; return their number."""
    count = 0
    qz, qw = np.float32(math.sin(0.5 * yaw)), np.float32(math.cos(0.5 * yaw))
    tz = qz + qz
    c, s = np.float32(1.0) - tz * qz, tz * qw
    tx, ty = np.float32(x), np.float32(y)
    for i in range(points.shape[0]):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        if math.isfinite(px) and math.isfinite(py) and pz >= min_height and pz <= max_height:
            out[count, 0] = (c * px - s * py) + tx
            out[count, 1] = (s * px + c * py) + ty
            out[count, 2] = pz
            count += 1
    return count


# ----------------------------------------------------------------------------------------------------------------------
# Timeout of a sensor.


class SensorTimeout:
    """Time since the newest message, the last restart or the first check, whichever is the latest.

    A stamp from the future counts as the present: a wrong clock must not hide that a sensor has stopped.
    """

    __slots__ = ("_arrival", "_newest", "_restarted", "_since")

    def __init__(self) -> None:
        self._since: float | None = None
        self._newest: float | None = None
        self._arrival: float | None = None
        self._restarted = False

    def received(self, stamp: float) -> None:
        """Record a message with this stamp (s)."""
        self._arrival = stamp

    def restart(self) -> None:
        """Start the full timeout again."""
        self._since, self._restarted = None, True

    def is_within(self, allowed: float, now: float) -> bool:
        """Return True if at most `allowed` seconds have passed without a message; 0 allows any time."""
        if allowed == 0.0:
            return True
        if self._arrival is not None:
            newest, self._arrival = min(self._arrival, now), None
            self._newest = newest if self._newest is None else max(newest, self._newest)
        if self._since is None:
            self._since = now if self._newest is None or self._restarted else self._newest
        newest = self._since if self._newest is None else max(self._newest, self._since)
        return now - newest <= allowed


PENDING: Final = 50
"""Largest number of messages that wait for their transform (queue length of obstacle_layer.cpp)."""
FARTHEST: Final = 1e30
"""Largest valid distance (m); a float32 can store it."""
MAX_POINTS: Final = 10_000_000
"""Largest number of beams or points of a valid message."""


class CommonSourceParams(ParamModel):
    """What the sources of all obstacle layers have in common."""

    topic: str = param("", "topic of the messages; the source's name if empty")
    sensor_frame: str = param("", "frame of the sensor's origin; the message's frame if empty")
    observation_persistence: float = param(0.0, "lifetime of an observation; 0 = only the latest", unit="s", ge=0.0)
    expected_update_rate: float = param(
        0.0, "longest time between two messages (a period, despite its name); 0 = no limit", unit="s", ge=0.0
    )
    min_valid_share: float = param(
        0.1,
        "share of a message's beams or points that must be valid; a message with fewer does not count for "
        "expected_update_rate; 0 = every message counts; not a parameter of ROS",
        ge=0.0,
        le=1.0,
    )
    data_type: Literal["PointCloud", "PointCloud2", "LaserScan"] = param("PointCloud", "type of the messages")
    min_obstacle_height: float = param(0.0, "points below are ignored", unit="m")
    max_obstacle_height: float = param(2.0, "points above are ignored", unit="m")
    inf_is_valid: bool = param(False, "beams without a hit clear the space up to range_max (LaserScan)")
    clearing: bool = param(False, "clear the space between sensor and points")
    marking: bool = param(True, "mark the points as obstacles")


class ObservationSourceParams(CommonSourceParams):
    """One source of an obstacle or voxel layer: `<layer>/<source>:`."""

    obstacle_range: float = param(2.5, "points farther away are not marked", unit="m", ge=0.0)
    raytrace_range: float = param(3.0, "space farther away is not cleared", unit="m", ge=0.0)

    SEARCHED: ClassVar[frozenset[str]] = frozenset({"obstacle_range", "raytrace_range"})
    RANGES: ClassVar[tuple[str, str]] = ("obstacle_range", "raytrace_range")
    """Names of the largest distances of marking and clearing."""

    obstacle_min_range: ClassVar[float] = 0.0
    raytrace_min_range: ClassVar[float] = 0.0


class Nav2ObservationSourceParams(CommonSourceParams):
    """One source of Nav2's obstacle or voxel layer: `<layer>/<source>:`."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "transport_type": "messages are received as they are",
    }
    RANGES: ClassVar[tuple[str, str]] = ("obstacle_max_range", "raytrace_max_range")

    data_type: Literal["PointCloud2", "LaserScan"] = param("LaserScan", "type of the messages")
    max_obstacle_height: float = param(0.0, "points above are ignored: a source must set it", unit="m")
    obstacle_max_range: float = param(2.5, "points farther away are not marked", unit="m", ge=0.0)
    obstacle_min_range: float = param(0.0, "points nearer are not marked", unit="m", ge=0.0)
    raytrace_max_range: float = param(3.0, "space farther away is not cleared", unit="m", ge=0.0)
    raytrace_min_range: float = param(0.0, "space nearer is not cleared", unit="m", ge=0.0)

    @property
    def obstacle_range(self) -> float:
        """`obstacle_max_range`, as ROS 1 calls it."""
        return self.obstacle_max_range

    @property
    def raytrace_range(self) -> float:
        """`raytrace_max_range`, as ROS 1 calls it."""
        return self.raytrace_max_range


SourceParams = ObservationSourceParams | Nav2ObservationSourceParams
"""Parameters of a source of either layer."""


class Observation:
    """Points (n, 3) float32 in the costmap's frame, seen from `x, y, z` (m) with the heading `yaw` (rad) at `stamp` (s)."""

    __slots__ = ("count", "points", "serial", "source", "stamp", "x", "y", "yaw", "z")

    def __init__(
        self, source: ObservationBuffer, points: NDArray[np.float32], count: int, origin: tuple[float, float, float]
    ) -> None:
        self.source = source
        self.points = points
        self.count = count
        self.x, self.y, self.z = origin
        self.yaw = 0.0
        self.stamp = 0.0
        self.serial = 0


class ObservationBuffer:
    """The observations of one source, newest first.

    Messages are converted to points when the costmap updates, not when they arrive: a costmap that updates once per second
    uses one scan in ten.
    """

    def __init__(
        self, name: str, params: CommonSourceParams, *, frame: str, frames: FrameTree, tolerance_s: float
    ) -> None:
        self.name = name
        self.params = params
        self.topic = (params.topic or name).removeprefix("/")
        self.frame = frame
        self.observations: list[Observation] = []
        self.last_stamp: float | None = None
        """Stamp (s) of the newest message received."""
        self.dropped = 0
        """Number of messages dropped because their transform did not arrive in time."""
        self.problem: NavError | None = None
        """Why none of the waiting messages could be used in the last update, or the newest is blind; None without a problem."""
        self._frames = frames
        self._tolerance_s = tolerance_s
        self._is_scan = params.data_type == "LaserScan"
        self._keep_one = params.observation_persistence == 0.0
        self._pending: deque[LaserScan | PointCloud] = deque()
        self._timeout = SensorTimeout()
        self._error: FrameError | None = None
        """Error of the last transform."""
        self._blind: BlindSensorError | None = None
        """Why the last message that was converted shows nothing; None if it shows something."""
        self._directions: NDArray[np.float64] | None = None
        self._directions_key = (0, 0.0, 0.0)
        self._project_scan = project_scan.compiled()
        self._height = math.nan
        self._height_fits = False

    LIVE: ClassVar[frozenset[str]] = frozenset(
        {
            *("expected_update_rate", "min_valid_share", "inf_is_valid", "obstacle_range", "raytrace_range"),
            *("min_obstacle_height", "max_obstacle_height"),
            *("obstacle_max_range", "obstacle_min_range", "raytrace_max_range", "raytrace_min_range"),
        }
    )
    """Parameters that may change at run time."""

    def may_become(self, params: CommonSourceParams) -> bool:
        """Return True if the parameters differ in `LIVE` only."""
        old = self.params
        return all(name in self.LIVE or getattr(old, name) == getattr(params, name) for name in type(old).model_fields)

    def set_params(self, params: CommonSourceParams) -> None:
        """Replace the parameters; they differ in `LIVE` only."""
        self.params = params
        self._height = math.nan

    def listens_to(self, topic: str) -> bool:
        """Return True for this source's topic, with or without a leading slash."""
        return topic == self.topic or topic.removeprefix("/") == self.topic

    def receive(self, data: SensorData) -> bool:
        """Receive a message; return False if its type is not the source's data_type. Raises InputError if it is invalid."""
        if isinstance(data, LaserScan):
            if not self._is_scan:
                return False
            _check_scan(data)
        elif isinstance(data, PointCloud):
            if self._is_scan:
                return False
            _check_cloud(data)
        else:
            return False
        if len(self._pending) >= PENDING:
            self._pending.popleft()
            self.dropped += 1
        self._pending.append(data)
        if self.last_stamp is None or data.stamp > self.last_stamp:
            self.last_stamp = data.stamp
        return True

    @property
    def has_pending(self) -> bool:
        """True if messages wait for their conversion to observations."""
        return bool(self._pending)

    def refresh(self) -> list[Observation]:
        """Convert the messages whose transform is known to observations; return the new ones, oldest first."""
        pending = self._pending
        fresh: list[Observation] = []
        if pending:
            if self._keep_one:
                # the newest message with a transform; older ones would be dropped at once
                for at in range(len(pending) - 1, -1, -1):
                    observation = self._observation(pending[at])
                    if observation is not None:
                        fresh.append(observation)
                        self.observations = [observation]
                        for _ in range(at + 1):
                            older = pending.popleft()
                            if self._blind is not None:  # the newest message does not count, an older one may
                                self._count_if_usable(older)
                        break
            else:
                waiting: deque[LaserScan | PointCloud] = deque()
                for data in pending:
                    observation = self._observation(data)
                    if observation is None:
                        waiting.append(data)
                    else:
                        fresh.append(observation)
                        self.observations.insert(0, observation)
                self._pending = waiting
            self.problem = self._blind if fresh else self._problem() if self._pending else None
        if not self._keep_one and self.last_stamp is not None and self.observations:
            oldest = self.last_stamp - self.params.observation_persistence
            # as in ROS, the age counts from the newest message, not from the present
            self.observations = [o for o in self.observations if o.stamp >= oldest]
        return fresh

    def is_current(self, now: float) -> bool:
        """Return False if no valid message with a known transform was received within expected_update_rate (s).

        As in costmap_2d, a message that cannot be transformed does not count. Messages that wait for the next update do.
        """
        # ROS differs: there, a message without a valid beam counts, and the robot drives blind
        allowed = self.params.expected_update_rate
        if allowed > 0.0:
            for data in reversed(self._pending):
                if self._count_if_usable(data):
                    break
        return self._timeout.is_within(allowed, now)

    def restart(self) -> None:
        """Restart the sensor's timeout (after a reset)."""
        self._timeout.restart()

    def _transforms(self, data: LaserScan | PointCloud) -> tuple[Transform2D, Transform2D] | None:
        """Return the poses of the message's frame and of the sensor's origin; None, and the error in `_error`, if unknown."""
        try:
            at = self._frames.lookup(self.frame, data.frame, data.stamp, self._tolerance_s)
            sensor = self.params.sensor_frame
            origin = self._frames.lookup(self.frame, sensor, data.stamp, self._tolerance_s) if sensor else at
        except FrameError as exc:
            self._error = exc
            return None
        return at, origin

    def _count_if_usable(self, data: LaserScan | PointCloud) -> bool:
        """Restart the sensor's timeout if a message can be transformed and shows something; return True if so."""
        if self._transforms(data) is None or self._blindness(data) is not None:
            return False
        self._timeout.received(data.stamp)
        return True

    def _blindness(self, data: LaserScan | PointCloud) -> BlindSensorError | None:
        """Return why too few beams or points of a message are valid; None if there are enough."""
        params = self.params
        if params.min_valid_share == 0.0:
            return None
        if isinstance(data, LaserScan):
            ranges = _ranges_of(data)
            near = min(max(data.range_min, 0.0), FARTHEST)
            total, valid = len(ranges), int(np.count_nonzero(ranges >= near if near > 0.0 else ranges > 0.0))
            if not data.range_max > max(data.range_min, 0.0):
                valid = 0
        else:
            points = _points_of(data)
            total, valid = len(points), _valid_points(points)
            if total == 0 and not params.clearing:
                return None  # a list of obstacles, and there is none
        if valid >= max(params.min_valid_share * total, 1.0):
            return None
        what, rule, near_cause = "points", "finite, and not the sensor itself", ""
        if isinstance(data, LaserScan):
            what, rule = "beams", f"from range_min = {data.range_min:g} m on, +inf included"
            near_cause = "an obstacle is nearer than that, " if data.range_min > 0.0 else ""
            if not data.range_max > max(data.range_min, 0.0):
                rule = f"range_max = {data.range_max:g} m is not above range_min = {data.range_min:g} m"
        text = (
            f'{valid} of {total} {what} of "{self.topic}" are valid ({rule}), less than min_valid_share = '
            f"{params.min_valid_share:g}: {near_cause}something covers the sensor, or it is faulty. Obstacles that only this "
            "sensor sees are unknown; check the sensor"
        )
        if params.expected_update_rate == 0.0:
            text += ", or set expected_update_rate (s), so that the robot stops when it is blind"
        return BlindSensorError(text, topic=self.topic, source=self.name, valid=valid, total=total)

    def _problem(self) -> FrameError:
        """Return the error of messages none of which can be transformed."""
        return untransformed(self.topic, self._pending[-1].frame, self.frame, self._error, self._frames)

    def _observation(self, data: LaserScan | PointCloud) -> Observation | None:
        transforms = self._transforms(data)
        if transforms is None:
            return None
        at, origin = transforms
        self._blind = self._blindness(data)
        if self._blind is None:
            self._timeout.received(data.stamp)
        if isinstance(data, LaserScan):
            points, count = self._scan_points(data, at)
            height = data.height
        else:
            points, count = self._cloud_points(data, at)
            height = 0.0
        observation = Observation(self, points, count, (origin.x, origin.y, height))
        observation.yaw = origin.yaw
        observation.stamp = data.stamp
        return observation

    def _scan_points(self, scan: LaserScan, at: Transform2D) -> tuple[NDArray[np.float32], int]:
        ranges = _ranges_of(scan)
        n = len(ranges)
        if scan.height != self._height:
            self._height, z = scan.height, float(np.float32(scan.height))
            self._height_fits = self.params.min_obstacle_height <= z <= self.params.max_obstacle_height
        if n == 0 or not self._height_fits:
            return np.empty((0, 3), np.float32), 0
        key = (n, scan.angle_min, scan.angle_increment)
        directions = self._directions
        if directions is None or key != self._directions_key:
            directions = self._directions = beam_directions(scan.angle_min, scan.angle_increment, n)
            self._directions_key = key
        inf_range = math.nan
        if self.params.inf_is_valid:
            # ROS subtracts in float32
            limit = scan.range_max
            valid = abs(limit) <= FARTHEST  # a float32 might overflow
            inf_range = float(np.float32(limit) - np.float32(0.0001)) if valid else math.copysign(math.inf, limit)
        out = np.empty((n, 3), np.float32)
        count = self._project_scan(
            ranges,
            directions,
            float(scan.range_min),
            float(scan.range_max),
            inf_range,
            at.x,
            at.y,
            at.yaw,
            scan.height,
            out,
        )
        return out, count

    def _cloud_points(self, cloud: PointCloud, at: Transform2D) -> tuple[NDArray[np.float32], int]:
        points, params = _points_of(cloud), self.params
        out = np.empty((len(points), 3), np.float32)
        count = project_points(points, at.x, at.y, at.yaw, params.min_obstacle_height, params.max_obstacle_height, out)
        return out, count


def beam_directions(angle_min: float, angle_increment: float, count: int) -> NDArray[np.float64]:
    """Return the unit vectors (count, 2) of the beams of a scan; NaN for an angle that overflows.

    The C library's functions, as in C++: those of numpy differ in the last bit from one processor to the next, which decides
    whether a ray ends in one cell or in another.
    """
    with np.errstate(all="ignore"):
        angles: list[float] = (angle_min + np.arange(count) * angle_increment).tolist()
    finite = [angle if math.isfinite(angle) else math.nan for angle in angles]
    return np.column_stack(([math.cos(angle) for angle in finite], [math.sin(angle) for angle in finite]))


def _valid_points(points: NDArray[np.float32]) -> int:
    """Return the number of finite points away from the origin of their frame, where a faulty camera puts all of them."""
    x, y, z = points.T
    away = np.maximum(np.abs(x), np.abs(y))
    return int(np.count_nonzero((away > 0.0) & (away < np.inf) & np.isfinite(z)))


def untransformed(topic: str, source: str, target: str, cause: FrameError | None, frames: FrameTree) -> FrameError:
    """Return the error of a sensor whose messages in the frame `source` cannot be transformed to the costmap's frame."""
    known = frames.frames()
    reason = cause.message if cause is not None else f'no transform from "{source}" to "{target}"'
    if cause is None or "known frames" not in reason:
        reason += f"; known frames: {', '.join(known) or 'none'}"
    return FrameError(
        f'messages of "{topic}" are ignored, because their frame "{source}" cannot be transformed to "{target}": {reason}. '
        f"Obstacles that only this sensor sees are unknown; publish the transform, or correct the messages' frame or stamps",
        **{**(cause.data if cause is not None else {}), "topic": topic, "source": source, "target": target},
        known_frames=known,
    )


def _ranges_of(scan: LaserScan) -> NDArray[np.float32]:
    """Return the ranges (n,). Raises InputError for those of a `DeferredScan`, which are not checked when it arrives."""
    ranges = scan.ranges
    if isinstance(scan, DeferredScan):
        _check_ranges(ranges, scan.topic)
    return ranges


def _check_ranges(ranges: NDArray[np.float32], topic: str) -> None:
    if ranges.ndim != 1 or ranges.dtype != np.float32 or not ranges.flags.c_contiguous:
        raise InputError(
            f"a scan's ranges must be a one-dimensional, contiguous float32 array, not {ranges.dtype} of shape {ranges.shape}; "
            "use np.ascontiguousarray(ranges, np.float32).ravel()",
            topic=topic,
        )
    if len(ranges) > MAX_POINTS:
        raise InputError(f"a scan has {len(ranges):,} beams; the limit is {MAX_POINTS:,}", topic=topic)


def _check_scan(scan: LaserScan) -> None:
    if not isinstance(scan, DeferredScan):  # checked when its ranges are computed
        _check_ranges(scan.ranges, scan.topic)
    # one sum instead of five tests: it is finite only if each term is
    total = scan.angle_min + scan.angle_increment + scan.range_min + scan.stamp + scan.height
    if total - total != 0.0 or scan.range_max != scan.range_max or abs(scan.height) > FARTHEST:
        numbers = (scan.angle_min, scan.angle_increment, scan.range_min, scan.stamp, scan.height)
        raise InputError(
            "a scan's angle_min, angle_increment, range_min, stamp and height must be finite numbers and range_max a number,"
            f" not {numbers} and {scan.range_max}",
            topic=scan.topic,
        )


def _points_of(cloud: PointCloud) -> NDArray[np.float32]:
    """Return the points (n, 3). Raises InputError for those of a `DeferredCloud`, which are not checked when it arrives."""
    points = cloud.points
    if isinstance(cloud, DeferredCloud):
        _check_points(points, cloud.topic)
    return points


def _check_points(points: NDArray[np.float32], topic: str) -> None:
    if points.ndim != 2 or points.shape[1] != 3 or points.dtype != np.float32 or not points.flags.c_contiguous:
        raise InputError(
            f"a cloud's points must be a contiguous float32 array of shape (n, 3), not {points.dtype} of shape {points.shape}",
            topic=topic,
        )
    if len(points) > MAX_POINTS:
        raise InputError(f"a cloud has {len(points):,} points; the limit is {MAX_POINTS:,}", topic=topic)


def _check_cloud(cloud: PointCloud) -> None:
    if not isinstance(cloud, DeferredCloud):  # checked when its points are computed
        _check_points(cloud.points, cloud.topic)
    if not math.isfinite(cloud.stamp):
        raise InputError(f"a cloud's stamp must be a finite time, not {cloud.stamp}", topic=cloud.topic)

"""State and sensor data of a robot."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core.geometry import Pose2D, Twist2D


class RobotState(NamedTuple):
    """Pose in `frame`, velocity in the robot's own frame, at `stamp` (s)."""

    pose: Pose2D
    velocity: Twist2D = Twist2D()
    stamp: float = 0.0
    frame: str = "odom"


@dataclass(frozen=True, slots=True, eq=False)
class LaserScan:
    """One sweep of a planar range finder, as sensor_msgs/LaserScan.

    `ranges` (n,) float32, meters; beam i has the direction `angle_min + i * angle_increment` (rad) in `frame`. Beams without
    a hit are +inf, invalid ones NaN. `height` is the height of the sensor above the ground (m), because frames are planar.
    """

    ranges: NDArray[np.float32]
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    stamp: float = 0.0
    frame: str = "base_laser_link"
    topic: str = "scan"
    height: float = 0.3

    def __repr__(self) -> str:
        hits = int(np.isfinite(self.ranges).sum())
        return f"LaserScan({len(self.ranges)} beams, {hits} with a hit, at {self.stamp:.3f} s, frame {self.frame!r})"


class DeferredScan(LaserScan):
    """A scan whose ranges are computed at the first access: a costmap with a lower rate than the sensor skips most scans.

    For sensors whose result is a pure function of their input, such as simulated ones.
    """

    __slots__ = ("_measure", "_measured")
    _measure: Any
    _measured: Any

    def __init__(
        self,
        ranges: Callable[[], NDArray[np.float32]] | NDArray[np.float32],
        angle_min: float,
        angle_increment: float,
        range_min: float,
        range_max: float,
        stamp: float = 0.0,
        frame: str = "base_laser_link",
        topic: str = "scan",
        height: float = 0.3,
    ) -> None:
        """`ranges`: a function that returns `LaserScan.ranges`, called at most once; or the array (for `dataclasses.replace`)."""
        put = object.__setattr__
        measured, measure = (None, ranges) if callable(ranges) else (ranges, None)
        put(self, "_measure", measure)
        put(self, "_measured", measured)
        put(self, "angle_min", angle_min)
        put(self, "angle_increment", angle_increment)
        put(self, "range_min", range_min)
        put(self, "range_max", range_max)
        put(self, "stamp", stamp)
        put(self, "frame", frame)
        put(self, "topic", topic)
        put(self, "height", height)

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies: a scan that has not been computed yet is copied with its function."""
        measured: Any = self._measured
        ranges = self._measure if measured is None else measured
        place = (self.angle_min, self.angle_increment, self.range_min, self.range_max)
        return DeferredScan, (ranges, *place, self.stamp, self.frame, self.topic, self.height)

    @property
    def ranges(self) -> NDArray[np.float32]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(n,) float32, meters; computed at the first access."""
        return _measured(self)


@dataclass(frozen=True, slots=True, eq=False)
class PointCloud:
    """Points (n, 3) float32, meters, in `frame` (z above the ground), as sensor_msgs/PointCloud2."""

    points: NDArray[np.float32]
    stamp: float = 0.0
    frame: str = "base_link"
    topic: str = "points"

    def __repr__(self) -> str:
        return f"PointCloud({len(self.points)} points, at {self.stamp:.3f} s, frame {self.frame!r})"


class DeferredCloud(PointCloud):
    """A cloud whose points are computed at the first access, as the ranges of a `DeferredScan`."""

    __slots__ = ("_measure", "_measured")
    _measure: Any
    _measured: Any

    def __init__(
        self,
        points: Callable[[], NDArray[np.float32]] | NDArray[np.float32],
        stamp: float = 0.0,
        frame: str = "base_link",
        topic: str = "points",
    ) -> None:
        """`points`: a function that returns `PointCloud.points`, called at most once; or the array (for `replace`)."""
        put = object.__setattr__
        measured, measure = (None, points) if callable(points) else (points, None)
        put(self, "_measure", measure)
        put(self, "_measured", measured)
        put(self, "stamp", stamp)
        put(self, "frame", frame)
        put(self, "topic", topic)

    def __reduce__(self) -> tuple[Any, ...]:
        """For copies: a cloud that has not been computed yet is copied with its function."""
        measured: Any = self._measured
        points = self._measure if measured is None else measured
        return DeferredCloud, (points, self.stamp, self.frame, self.topic)

    @property
    def points(self) -> NDArray[np.float32]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """(n, 3) float32, meters; computed at the first access."""
        return _measured(self)


def _measured(data: DeferredScan | DeferredCloud) -> NDArray[np.float32]:
    """Return what a deferred message contains, computed at the first call."""
    measured: Any = data._measured  # pyright: ignore[reportPrivateUsage]
    if measured is None:
        measured = data._measure()  # pyright: ignore[reportPrivateUsage]
        object.__setattr__(data, "_measured", measured)
        object.__setattr__(data, "_measure", None)  # releases the references of the function
    return measured


@dataclass(frozen=True, slots=True)
class RangeReading:
    """One reading of a sonar or infrared sensor, as sensor_msgs/Range.

    An obstacle is at the distance `range_m` (m) on an arc of `field_of_view` (rad) about the x axis of `frame`. A reading of
    `max_range` or more means no obstacle.
    """

    range_m: float
    field_of_view: float
    min_range: float
    max_range: float
    stamp: float = 0.0
    frame: str = "sonar_link"
    topic: str = "sonar"


@dataclass(frozen=True, slots=True)
class ImuReading:
    """A reading of an inertial measurement unit, as sensor_msgs/Imu, on a planar robot.

    `orientation` is the quaternion (x, y, z, w) of `frame` in the map; `yaw_rate` (rad/s) counter-clockwise.
    """

    orientation: tuple[float, float, float, float]
    yaw_rate: float
    stamp: float = 0.0
    frame: str = "imu_link"
    topic: str = "imu"

    @property
    def yaw(self) -> float:
        """Yaw of the orientation (rad)."""
        x, y, z, w = self.orientation
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@dataclass(frozen=True, slots=True)
class BatteryState:
    """State of a battery, as sensor_msgs/BatteryState. The current is positive while it is charged."""

    charge: float
    """Share of the capacity, 0 .. 1."""
    current: float
    """A."""
    voltage: float = math.nan
    """V."""
    stamp: float = 0.0


@dataclass(frozen=True, slots=True)
class DockDetection:
    """Where a sensor sees a dock, as the geometry_msgs/PoseStamped of a detector of markers.

    Position (m) and orientation (quaternion x, y, z, w) of the marker in `frame` at `stamp` (s).
    """

    x: float
    y: float
    orientation: tuple[float, float, float, float]
    stamp: float = 0.0
    frame: str = "base_link"
    topic: str = "detected_dock_pose"

    @classmethod
    def of_heading(cls, x: float, y: float, yaw: float, stamp: float, frame: str, topic: str) -> DockDetection:
        """Return the detection of a marker whose x axis has the heading `yaw` (rad) into the dock.

        Its orientation is that of a tag, z out of the tag, y down: Nav2's default rotation of external detections, by
        (roll, pitch) = (-pi/2, pi/2), turns it back.
        """
        c, s = 0.5 * math.cos(0.5 * yaw), 0.5 * math.sin(0.5 * yaw)
        # the rotation by yaw about z, then the inverse of (0.5, 0.5, -0.5, 0.5)
        return cls(x, y, (s - c, -c - s, c + s, c - s), stamp, frame, topic)


SensorData = LaserScan | PointCloud | RangeReading

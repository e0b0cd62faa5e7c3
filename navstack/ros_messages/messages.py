"""ROS messages as navstack's types. Times are exact integers (ns); `Clock` makes seconds of them.

A message is read by the names of its fields, so the types of rosbags, of ROS 1 and of ROS 2 all fit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import wraps
from typing import Any, Final, NamedTuple, ParamSpec, TypeVar

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    GridGeometry,
    LaserScan,
    LogError,
    NavError,
    OccupancyGrid,
    Pose2D,
    RangeReading,
    Twist2D,
    clean_frame,
)
from navstack.ros_messages.transforms import Quaternion, StampedTransform, Transform3D

NS_PER_S: Final = 1_000_000_000

P = ParamSpec("P")
R = TypeVar("R")

SCAN: Final = "sensor_msgs/msg/LaserScan"
CLOUD: Final = "sensor_msgs/msg/PointCloud2"
OLD_CLOUD: Final = "sensor_msgs/msg/PointCloud"
CLOUDS: Final = (CLOUD, OLD_CLOUD)
RANGE: Final = "sensor_msgs/msg/Range"
ODOMETRY: Final = "nav_msgs/msg/Odometry"
MAP: Final = "nav_msgs/msg/OccupancyGrid"
PATH: Final = "nav_msgs/msg/Path"
POSE: Final = "geometry_msgs/msg/PoseStamped"
TWIST: Final = "geometry_msgs/msg/Twist"
TWIST_STAMPED: Final = "geometry_msgs/msg/TwistStamped"
ACTION_GOAL: Final = "move_base_msgs/msg/MoveBaseActionGoal"
ACTION_RESULT: Final = "move_base_msgs/msg/MoveBaseActionResult"
GOAL_ID: Final = "actionlib_msgs/msg/GoalID"
TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
EXPORTED_SENSORS: Final = "/navstack/sensors"
"""Topic of an exported run: `ScanFields` by topic and `RangeFields` by frame, as JSON in a std_msgs/String."""
STRING: Final = "std_msgs/msg/String"
LARGEST_GRID: Final = 100_000_000
"""Largest number of cells of a map."""
_FIELD_TYPES: Final = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    8: "f8",
}
"""Types of sensor_msgs/PointField."""


def checked(convert: Callable[P, R]) -> Callable[P, R]:
    """Raise LogError where a message lacks a field, or has one of another type: its definition is not that of ROS."""

    @wraps(convert)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return convert(*args, **kwargs)
        except (AttributeError, TypeError, ValueError, OverflowError) as exc:
            raise LogError(f"a message is not of the type that it has in ROS: {exc}") from exc

    return call


def seconds(nanoseconds: int, since: int = 0) -> float:
    """Return a time in seconds since `since`, correctly rounded; both in nanoseconds.

    A time that was a multiple of a microsecond before it was written keeps its value to the bit.
    """
    return (nanoseconds - since) / NS_PER_S


class Clock:
    """Seconds of a replay: since the first message of the log.

    The stamps of the messages may belong to another clock than the times of the recording (a recording of a simulation by
    ROS 2): `stamp_shift_ns` is then their difference.
    """

    def __init__(self, start_ns: int, stamp_shift_ns: int = 0) -> None:
        self.start_ns = start_ns
        self.stamp_shift_ns = stamp_shift_ns

    def time(self, time_ns: int) -> float:
        """Return the time (s) of a recording."""
        return seconds(time_ns, self.start_ns)

    def stamp(self, message: Any) -> float:
        """Return the time (s) in the header of a message."""
        return seconds(stamp_ns(message.header) + self.stamp_shift_ns, self.start_ns)


@checked
def frame_of(message: Any) -> str:
    """Return the frame in the header of a message."""
    return clean_frame(message.header.frame_id)


@checked
def header_ns(message: Any) -> int:
    """Return the stamp in the header of a message (ns)."""
    return stamp_ns(message.header)


@checked
def edges_of(message: Any) -> list[tuple[str, str, int]]:
    """Return (parent, child, stamp in ns) of the transforms of a TFMessage."""
    return [
        (clean_frame(item.header.frame_id), clean_frame(item.child_frame_id), stamp_ns(item.header))
        for item in message.transforms
    ]


@checked
def stamp_ns(header: Any) -> int:
    """Return the stamp of a header (ns), of rosbags, of rospy or of rclpy."""
    return time_ns(header.stamp)


def time_ns(time: Any) -> int:
    """Return a time or a duration of a message (ns)."""
    convert = getattr(time, "to_nsec", None)
    if convert is not None:
        return int(convert())
    return int(time.sec) * NS_PER_S + int(time.nanosec)


def short_decimal(value: float) -> float:
    """Return the number with the fewest digits that is the same float32: 0.05 for 0.05000000074505806.

    The resolution of a map is a float32 in its message, but its author wrote 0.05.
    """
    return float(str(np.float32(value)))


@checked
def quaternion_of(message: Any) -> Quaternion:
    """Return a geometry_msgs/Quaternion, normalized. Raises LogError if it is zero or not finite."""
    found = Quaternion(float(message.x), float(message.y), float(message.z), float(message.w))
    if not found.is_valid:
        raise LogError(f"the quaternion {tuple(found)} is not a rotation")
    return found.normalized()


@checked
def pose_of(message: Any) -> Pose2D:
    """Return a geometry_msgs/Pose in the plane. Raises LogError for a quaternion that is not a rotation."""
    return Pose2D(float(message.position.x), float(message.position.y), quaternion_of(message.orientation).yaw)


@checked
def transforms_of(message: Any, clock: Clock) -> list[StampedTransform]:
    """Return the transforms of a tf2_msgs/TFMessage. Raises LogError for one that is not finite."""
    found: list[StampedTransform] = []
    for item in message.transforms:
        parent, child = clean_frame(item.header.frame_id), clean_frame(item.child_frame_id)
        position = item.transform.translation
        x, y, z = float(position.x), float(position.y), float(position.z)
        if not math.isfinite(x + y + z):
            raise LogError(f'the transform from "{child}" to "{parent}" is not finite')
        rotation = quaternion_of(item.transform.rotation)
        found.append(StampedTransform(parent, child, clock.stamp(item), Transform3D(x, y, z, rotation)))
    return found


class Odometry(NamedTuple):
    """A nav_msgs/Odometry in the plane."""

    stamp: float
    frame: str
    child: str
    pose: Pose2D
    velocity: Twist2D


@checked
def odometry_of(message: Any, clock: Clock) -> Odometry:
    """Return an odometry message. Raises LogError for a pose that is not a pose."""
    return Odometry(
        clock.stamp(message),
        clean_frame(message.header.frame_id),
        clean_frame(message.child_frame_id),
        pose_of(message.pose.pose),
        twist_of(message.twist.twist),
    )


@checked
def twist_of(message: Any) -> Twist2D:
    """Return a geometry_msgs/Twist in the plane."""
    return Twist2D(float(message.linear.x), float(message.linear.y), float(message.angular.z))


class ScanFields(NamedTuple):
    """The fields of a scan that do not change, in double precision: a message stores them as float32."""

    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float

    def agrees_with(self, message: Any) -> bool:
        """Return True if a message has the same values, as float32."""
        return all(np.float32(value) == np.float32(getattr(message, name)) for name, value in self._asdict().items())


@checked
def scan_of(
    message: Any, topic: str, stamp: float, *, height: float, upside_down: bool, fields: ScanFields | None = None
) -> LaserScan:
    """Return a scan; `upside_down` reverses the direction of its angles. `fields` replace those of the message if they agree."""
    sign = -1.0 if upside_down else 1.0
    exact = message if fields is None or not fields.agrees_with(message) else fields
    return LaserScan(
        np.require(message.ranges, np.float32, ["C", "W"]),
        sign * float(exact.angle_min),
        sign * float(exact.angle_increment),
        float(exact.range_min),
        float(exact.range_max),
        stamp,
        clean_frame(message.header.frame_id),
        topic,
        height,
    )


class RangeFields(NamedTuple):
    """The fields of a sonar that do not change, in double precision: a message stores them as float32."""

    field_of_view: float
    min_range: float
    max_range: float

    def agrees_with(self, message: Any) -> bool:
        """Return True if a message has the same values, as float32."""
        return all(np.float32(value) == np.float32(getattr(message, name)) for name, value in self._asdict().items())


@checked
def range_of(message: Any, topic: str, stamp: float, fields: RangeFields | None = None) -> RangeReading:
    """Return the reading of a sonar or infrared sensor. `fields` replace those of the message if they agree."""
    exact = message if fields is None or not fields.agrees_with(message) else fields
    distance = float(message.range)
    for limit in (float(exact.min_range), float(exact.max_range)):
        if distance == float(np.float32(limit)):  # a reading at a limit, which means "nothing nearer" or "no obstacle"
            distance = limit
    return RangeReading(
        distance,
        float(exact.field_of_view),
        float(exact.min_range),
        float(exact.max_range),
        stamp,
        clean_frame(message.header.frame_id),
        topic,
    )


@checked
def points_of(message: Any) -> NDArray[np.float32]:
    """Return the points (n, 3) of a sensor_msgs/PointCloud2 or PointCloud, in its frame. Raises LogError."""
    if hasattr(message, "points"):
        return np.array([(point.x, point.y, point.z) for point in message.points], np.float32).reshape(-1, 3)
    fields = {field.name: field for field in message.fields}
    order = ">" if message.is_bigendian else "<"
    try:
        types = [order + _FIELD_TYPES[fields[name].datatype] for name in "xyz"]
        offsets = [int(fields[name].offset) for name in "xyz"]
        layout = np.dtype(
            {"names": ["x", "y", "z"], "formats": types, "offsets": offsets, "itemsize": int(message.point_step)}
        )
        width, height, row = int(message.width), int(message.height), int(message.row_step)
        raw = message.data
        data = np.frombuffer(raw, np.uint8) if isinstance(raw, bytes) else np.ascontiguousarray(raw, np.uint8)
        if width * height == 0:
            return np.empty((0, 3), np.float32)
        if row < width * layout.itemsize or len(data) < row * (height - 1) + width * layout.itemsize:
            raise ValueError(f"{len(data)} bytes are not enough for {width} x {height} points")
        rows = [np.frombuffer(data, layout, width, row * i) for i in range(height)]
        points = rows[0] if height == 1 else np.concatenate(rows)
        return np.column_stack([points[name] for name in "xyz"]).astype(np.float32)
    except (KeyError, ValueError, TypeError) as exc:
        raise LogError(f"a point cloud is not valid: {exc}") from exc


@checked
def map_of(message: Any, name: str = "map", note: Callable[[str], None] | None = None) -> OccupancyGrid:
    """Return a nav_msgs/OccupancyGrid. Raises LogError.

    An orientation of the origin that nobody has set, (0, 0, 0, 0), counts as no rotation: the nodes of ROS 1 do not read it.
    `note` gets a sentence about it that names the map by `name`, its topic.
    """
    info = message.info
    width, height, resolution = int(info.width), int(info.height), short_decimal(info.resolution)
    data = np.asarray(message.data, np.int8)
    if width * height != len(data) or not 0 < width * height <= LARGEST_GRID:
        raise LogError(f"a map of {width} x {height} cells has {len(data)} values")
    at, rotation = info.origin.position, info.origin.orientation
    yaw = 0.0
    if any((rotation.x, rotation.y, rotation.z, rotation.w)):
        yaw = quaternion_of(rotation).yaw
    elif note is not None:
        note(
            f"the map of {width} x {height} cells on {name} has the orientation (0, 0, 0, 0), which is no rotation; it is used "
            "without a rotation, as in ROS: its publisher should set origin.orientation.w to 1"
        )
    try:
        geometry = GridGeometry(width, height, resolution, float(at.x), float(at.y))
        return OccupancyGrid(data.reshape(height, width), geometry, yaw, clean_frame(message.header.frame_id), raw=True)
    except NavError as exc:
        raise LogError(f"a map is not valid: {exc.message}") from exc


def sensor_fields_of(message: Any) -> tuple[dict[str, ScanFields], dict[str, RangeFields]]:
    """Return the fields of an exported run: of scans by topic, of sonars by frame. Raises LogError."""
    try:
        found = json.loads(message.data)
        scans, ranges = found["scans"], found.get("ranges", {})
        return (
            {str(topic): ScanFields(**{k: float(v) for k, v in of.items()}) for topic, of in scans.items()},
            {str(frame): RangeFields(**{k: float(v) for k, v in of.items()}) for frame, of in ranges.items()},
        )
    except (ValueError, TypeError, KeyError, AttributeError) as exc:
        raise LogError(f"{EXPORTED_SENSORS} has no valid description of the sensors: {exc}") from exc


class SentGoal(NamedTuple):
    """A goal that was sent to the robot."""

    pose: Pose2D
    frame: str
    id: str


@checked
def command_of(message: Any, kind: str) -> Twist2D:
    """Return the velocity of a Twist or a TwistStamped; `kind` is the type."""
    return twist_of(message.twist if kind == TWIST_STAMPED else message)


@checked
def goal_id_of(message: Any) -> str:
    """Return the id of an actionlib_msgs/GoalID."""
    return str(message.id)


@checked
def result_of(message: Any) -> tuple[str, str]:
    """Return the id of the goal and the text of a MoveBaseActionResult."""
    return str(message.status.goal_id.id), str(message.status.text)


@checked
def goal_of(message: Any, kind: str) -> SentGoal:
    """Return the goal of a PoseStamped or a MoveBaseActionGoal; `kind` is the type. Raises LogError."""
    goal_id = ""
    if kind == ACTION_GOAL:
        goal_id = str(message.goal_id.id)
        message = message.goal.target_pose
    return SentGoal(pose_of(message.pose), clean_frame(message.header.frame_id), goal_id)


@checked
def path_of(message: Any) -> tuple[str, NDArray[np.float64]]:
    """Return the frame and the poses (n, 3) of a nav_msgs/Path: x, y, yaw. Raises LogError."""
    poses = [pose_of(item.pose) for item in message.poses]
    # navfn leaves the header of an empty path empty
    frame = message.header.frame_id or (message.poses[0].header.frame_id if message.poses else "")
    return clean_frame(frame), np.array(poses, np.float64).reshape(-1, 3)

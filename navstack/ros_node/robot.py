"""The robot of a ROS graph: tf, odometry and sensor data come from topics, commands go to cmd_vel."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from navstack.core import (
    BatteryState,
    DockDetection,
    FrameError,
    FrameTree,
    LogError,
    NavError,
    PointCloud,
    RobotState,
    SensorData,
    Twist2D,
)
from navstack.move_base import StaleOdometryError
from navstack.ros_messages import StampedTransform, Transform3D, TransformTree
from navstack.ros_messages import messages as ros
from navstack.ros_node.clock import NodeClock

FUTURE_S: Final = 5.0
"""Data stamped farther in the future (s) are ignored: localization stamps transforms about a second ahead."""
AFTER_JUMP_S: Final = 0.5
"""The same, for `SETTLE_S` (s) after the clock jumped back."""
SETTLE_S: Final = 2.0
MOST_DETECTIONS: Final = 100
"""Detections of docks that are kept until the next docking."""
MOST_PROBLEMS: Final = 100
"""Reasons that are counted."""


class RosRobot:
    """Implements `navstack.plugins.Robot`. Its methods are called in the thread of the node only."""

    def __init__(
        self, clock: NodeClock, publish: Callable[[Twist2D], None], report: Callable[[NavError], None]
    ) -> None:
        """`publish` sends a velocity; `report` gets the reason of each message that cannot be used."""
        self.clock = clock
        self._report = report
        self._settled_at = -math.inf
        self.frames = FrameTree()
        self._logged = TransformTree(self.frames)
        self._publish = publish
        self._odometry: RobotState | None = None
        self._scans: list[SensorData] = []
        self._detections: deque[DockDetection] = deque(maxlen=MOST_DETECTIONS)
        self._battery: BatteryState | None = None
        self.received: dict[str, float] = {}
        """Stamp (s) of the newest usable sensor data by topic."""
        self.problems: dict[str, int] = {}
        """Messages that could not be used, by reason."""

    # --- messages -----------------------------------------------------------------------------------------------------

    def receive_transforms(self, message: Any, *, static: bool) -> None:
        """Receive a tf2_msgs/TFMessage."""
        found: list[StampedTransform] = []
        for item in message.transforms:
            try:
                found.append(self._transform_of(item, static=static))
            except LogError as exc:
                self._problem(exc)
        try:
            (self._logged.add_static if static else self._logged.add)(found)
        except FrameError as exc:
            self._problem(exc)

    def _transform_of(self, item: Any, *, static: bool) -> StampedTransform:
        """Return a transform. Raises LogError for one that is not finite, no rotation, or of the far future."""
        position = item.transform.translation
        parent, child = ros.clean_frame(item.header.frame_id), ros.clean_frame(item.child_frame_id)
        if not math.isfinite(position.x + position.y + position.z):
            raise LogError(f'the transform from "{child}" to "{parent}" is not finite; it is ignored')
        at = Transform3D(position.x, position.y, position.z, ros.quaternion_of(item.transform.rotation))
        stamp = self.clock.of(item.header.stamp)
        if not static:
            self._check_stamp(stamp, f'a transform from "{child}" to "{parent}"')
        return StampedTransform(parent, child, stamp, at)

    def _check_stamp(self, stamp: float, what: str) -> None:
        """Raise LogError for data of the far future; after a jump of the clock, data from before it are of the future."""
        now = self.clock.now()
        limit = AFTER_JUMP_S if now < self._settled_at else FUTURE_S
        if stamp > now + limit:
            raise LogError(f"{what} is stamped more than {limit:g} s in the future; it is ignored; compare the clocks")

    def receive_odometry(self, message: Any) -> None:
        """Receive a nav_msgs/Odometry."""
        try:
            pose, velocity = ros.pose_of(message.pose.pose), ros.twist_of(message.twist.twist)
        except LogError as exc:
            self._problem(exc)
            return
        stamp = self.clock.of(message.header.stamp)
        self._check_stamp(stamp, "an odometry message")
        self._odometry = RobotState(pose, velocity, stamp, ros.clean_frame(message.header.frame_id))

    def receive_scan(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/LaserScan."""
        mounting = self._logged.mounting(ros.frame_of(message))
        upside_down = mounting.tilt > 0.5 * np.pi
        stamp = self.clock.of(message.header.stamp)
        self._check_stamp(stamp, f"a scan on {topic}")
        scan = ros.scan_of(message, topic, stamp, height=mounting.height, upside_down=upside_down)
        self._add(scan, topic)

    def receive_cloud(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/PointCloud2 or PointCloud."""
        frame = ros.frame_of(message)
        try:
            points = self._logged.mounting(frame).leveled(ros.points_of(message))
        except LogError as exc:
            self._problem(exc)
            return
        stamp = self.clock.of(message.header.stamp)
        self._check_stamp(stamp, f"a cloud on {topic}")
        self._add(PointCloud(np.ascontiguousarray(points), stamp, frame, topic), topic)

    def receive_range(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/Range."""
        self._add(ros.range_of(message, topic, self.clock.of(message.header.stamp)), topic)

    def receive_detection(self, message: Any, topic: str) -> None:
        """Receive the pose of a detected dock (geometry_msgs/PoseStamped)."""
        at, turn = message.pose.position, ros.quaternion_of(message.pose.orientation)
        stamp = self.clock.of(message.header.stamp)
        self._check_stamp(stamp, f"a pose on {topic}")
        found = DockDetection(
            float(at.x), float(at.y), (turn.x, turn.y, turn.z, turn.w), stamp, ros.frame_of(message), topic
        )
        self._detections.append(found)
        self.received[topic] = stamp

    def receive_battery(self, message: Any) -> None:
        """Receive a sensor_msgs/BatteryState."""
        stamp = self.clock.of(message.header.stamp)
        self._battery = BatteryState(float(message.percentage), float(message.current), float(message.voltage), stamp)

    def _add(self, data: SensorData, topic: str) -> None:
        self._scans.append(data)
        self.received[topic] = data.stamp

    def forget(self) -> None:
        """Forget the transforms that move: the clock has jumped."""
        self._logged.forget_moving()
        self._settled_at = self.clock.now() + SETTLE_S
        self._odometry = None
        self._scans.clear()
        self._detections.clear()

    def _problem(self, error: NavError) -> None:
        if len(self.problems) < MOST_PROBLEMS or error.message in self.problems:
            self.problems[error.message] = self.problems.get(error.message, 0) + 1
        self._report(error)

    # --- interface of a robot -----------------------------------------------------------------------------------------

    @property
    def odometry_stamp(self) -> float | None:
        """Stamp (s) of the newest odometry; None before the first one."""
        return None if self._odometry is None else self._odometry.stamp

    def state(self) -> RobotState:
        """Return the newest odometry. Raises StaleOdometryError before the first one."""
        if self._odometry is None:
            raise StaleOdometryError("no odometry has been received; check the topic odom")
        return self._odometry

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data since the last call, oldest first."""
        found, self._scans = self._scans, []
        return found

    def dock_detections(self) -> Sequence[DockDetection]:
        """Return the detections of docks since the last call, oldest first."""
        found = list(self._detections)
        self._detections.clear()
        return found

    @property
    def battery_state(self) -> BatteryState | None:
        """The last state of the battery; None before the first one."""
        return self._battery

    def command(self, twist: Twist2D) -> None:
        """Publish a velocity."""
        self._publish(twist)


RECEIVERS: Mapping[str, tuple[str, str]] = {
    ros.SCAN: ("sensor_msgs/LaserScan", "receive_scan"),
    ros.CLOUD: ("sensor_msgs/PointCloud2", "receive_cloud"),
    ros.OLD_CLOUD: ("sensor_msgs/PointCloud", "receive_cloud"),
    ros.RANGE: ("sensor_msgs/Range", "receive_range"),
}
"""Message and method of `RosRobot` for each type of sensor data."""

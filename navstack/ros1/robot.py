"""The robot of a ROS 1 graph: tf, odometry and sensor data come from topics, commands go to cmd_vel."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from navstack.core import FrameTree, PointCloud, RobotState, SensorData, Twist2D
from navstack.core.errors import FrameError, LogError, NavError
from navstack.logs import messages as ros
from navstack.logs.messages import StampedTransform
from navstack.logs.rotations import Transform3D
from navstack.logs.transforms import LoggedFrames
from navstack.move_base.errors import StaleOdometryError
from navstack.ros1.clock import NodeClock


class RosRobot:
    """Implements `navstack.interfaces.Robot`. Its methods are called in the thread of the node only."""

    def __init__(self, clock: NodeClock, publish: Callable[[Twist2D], None]) -> None:
        self.clock = clock
        self.frames = FrameTree()
        self._logged = LoggedFrames(self.frames)
        self._publish = publish
        self._odometry: RobotState | None = None
        self._scans: list[SensorData] = []
        self.problems: dict[str, int] = {}
        """Messages that could not be used, by reason."""

    # --- messages -----------------------------------------------------------------------------------------------------

    def receive_transforms(self, message: Any, *, static: bool) -> None:
        """Receive a tf2_msgs/TFMessage."""
        found: list[StampedTransform] = []
        for item in message.transforms:
            position = item.transform.translation
            at = Transform3D(position.x, position.y, position.z, ros.quaternion_of(item.transform.rotation))
            stamp = self.clock.of(item.header.stamp)
            parent, child = ros.clean_frame(item.header.frame_id), ros.clean_frame(item.child_frame_id)
            found.append(StampedTransform(parent, child, stamp, at))
        try:
            (self._logged.add_static if static else self._logged.add)(found)
        except FrameError as exc:
            self._problem(exc)

    def receive_odometry(self, message: Any) -> None:
        """Receive a nav_msgs/Odometry."""
        try:
            pose, velocity = ros.pose_of(message.pose.pose), ros.twist_of(message.twist.twist)
        except LogError as exc:
            self._problem(exc)
            return
        stamp = self.clock.of(message.header.stamp)
        self._odometry = RobotState(pose, velocity, stamp, ros.clean_frame(message.header.frame_id))

    def receive_scan(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/LaserScan."""
        mounting = self._logged.mounting(ros.frame_of(message))
        upside_down = mounting.tilt > 0.5 * np.pi
        stamp = self.clock.of(message.header.stamp)
        self._scans.append(ros.scan_of(message, topic, stamp, height=mounting.height, upside_down=upside_down))

    def receive_cloud(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/PointCloud2."""
        frame = ros.frame_of(message)
        try:
            points = self._logged.mounting(frame).levelled(ros.points_of(message))
        except LogError as exc:
            self._problem(exc)
            return
        self._scans.append(PointCloud(np.ascontiguousarray(points), self.clock.of(message.header.stamp), frame, topic))

    def receive_range(self, message: Any, topic: str) -> None:
        """Receive a sensor_msgs/Range."""
        self._scans.append(ros.range_of(message, topic, self.clock.of(message.header.stamp)))

    def forget(self) -> None:
        """Forget the transforms that move: the clock has jumped."""
        self._logged.forget_moving()
        self._odometry = None
        self._scans.clear()

    def _problem(self, error: NavError) -> None:
        self.problems[error.message] = self.problems.get(error.message, 0) + 1

    # --- interface of a robot -----------------------------------------------------------------------------------------

    def state(self) -> RobotState:
        """Return the newest odometry. Raises StaleOdometryError before the first one."""
        if self._odometry is None:
            raise StaleOdometryError("no odometry has been received; check the topic odom")
        return self._odometry

    def scans(self) -> Sequence[SensorData]:
        """Return the sensor data since the last call, oldest first."""
        found, self._scans = self._scans, []
        return found

    def command(self, twist: Twist2D) -> None:
        """Publish a velocity."""
        self._publish(twist)


RECEIVERS: Mapping[str, tuple[str, str]] = {
    ros.SCAN: ("sensor_msgs/LaserScan", "receive_scan"),
    ros.CLOUD: ("sensor_msgs/PointCloud2", "receive_cloud"),
    ros.RANGE: ("sensor_msgs/Range", "receive_range"),
}
"""Message and method of `RosRobot` for each type of sensor data."""

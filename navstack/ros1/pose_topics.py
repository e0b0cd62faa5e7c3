"""What a localization publishes: `amcl_pose` and `particlecloud`, latched, and map -> odom on /tf."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, Transform2D
from navstack.logs.builder import MessageBuilder
from navstack.ros1 import ros


class PoseTopics:
    """Publishes the pose of the base in the map and the particles behind it, as amcl and fake_localization do."""

    def __init__(self, build: MessageBuilder, frame: str) -> None:
        rospy = ros.rospy()
        self._build, self._frame = build, frame
        self._pose_type = ros.message("geometry_msgs/PoseWithCovarianceStamped")
        self._cloud_type = ros.message("geometry_msgs/PoseArray")
        self._pose = rospy.Publisher("amcl_pose", self._pose_type, queue_size=2, latch=True)
        self._cloud = rospy.Publisher("particlecloud", self._cloud_type, queue_size=2, latch=True)

    def publish_pose(self, stamp_ns: int, pose: Pose2D, covariance: NDArray[np.float64] | None = None) -> None:
        """Publish the pose with its (3, 3) covariance of x, y, yaw; zeros without one."""
        full = np.zeros((6, 6))
        if covariance is not None:
            full[np.ix_((0, 1, 5), (0, 1, 5))] = covariance
        message: Any = self._pose_type()
        message.header = self._build.header(stamp_ns, self._frame)
        message.pose.pose = self._build.pose(pose)
        message.pose.covariance = full.ravel().tolist()
        self._pose.publish(message)

    def publish_particles(self, stamp_ns: int, poses: NDArray[np.float64]) -> None:
        """Publish poses (n, 3)."""
        message: Any = self._cloud_type()
        message.header = self._build.header(stamp_ns, self._frame)
        message.poses = [self._build.pose(Pose2D(*row)) for row in poses.tolist()]
        self._cloud.publish(message)


class MapToOdom:
    """Publishes the pose of the odometry frame in the map on /tf, stamped ahead of the data that it rests on."""

    def __init__(self, build: MessageBuilder, map_frame: str, odom_frame: str, ahead_s: float) -> None:
        tf = ros.message("tf2_msgs/TFMessage")
        self._out = ros.rospy().Publisher("/tf", tf, queue_size=50, tcp_nodelay=True)
        self._build, self._map, self._odom = build, map_frame, odom_frame
        self.ahead_s = ahead_s

    def publish(self, stamp_ns: int, at: Transform2D) -> None:
        """Publish for data of this stamp."""
        ahead = stamp_ns + round(self.ahead_s * 1e9)
        self._out.publish(self._build.transforms([(ahead, self._map, self._odom, at, 0.0)]))

"""What the localization of the simulated robot tells: amcl_pose and particlecloud, and map -> odom on /tf."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from navstack.core import Pose2D, Transform2D
from navstack.logs.builder import MessageBuilder
from navstack.ros1 import ros
from navstack.sim import SimulatedRobot

PERIOD_S: Final = 0.1
"""Simulated time between two poses (s)."""


class LocalizationTopics:
    """`amcl_pose` and `particlecloud`, latched, as amcl and fake_localization publish them.

    The covariance is that of the simulated amcl, if the parameters have one; else 0, as of fake_localization. The cloud has one
    particle.
    """

    def __init__(self, robot: SimulatedRobot, build: MessageBuilder, frame: str) -> None:
        rospy = ros.rospy()
        self._robot, self._build, self._frame = robot, build, frame
        self._pose_type = ros.message("geometry_msgs/PoseWithCovarianceStamped")
        self._cloud_type = ros.message("geometry_msgs/PoseArray")
        self._pose = rospy.Publisher("amcl_pose", self._pose_type, queue_size=2, latch=True)
        self._cloud = rospy.Publisher("particlecloud", self._cloud_type, queue_size=2, latch=True)
        self._due = 0.0

    def publish(self, time_s: float, stamp_ns: int, odometry: Pose2D) -> None:
        """Publish the pose, if it is due at the simulated time `time_s`; `odometry` is the pose of the base in the odometry."""
        if time_s < self._due:
            return
        self._due = time_s + PERIOD_S
        robot = self._robot
        offset = robot.frames.lookup(robot.map_frame, robot.odom_frame)
        pose = Pose2D(*(offset @ Transform2D(*odometry)))
        message: Any = self._pose_type()
        message.header = self._build.header(stamp_ns, self._frame)
        message.pose.pose = self._build.pose(pose)
        message.pose.covariance = self._covariance()
        cloud: Any = self._cloud_type()
        cloud.header, cloud.poses = message.header, [message.pose.pose]
        self._pose.publish(message)
        self._cloud.publish(cloud)

    def _covariance(self) -> list[float]:
        """Return the (6, 6) covariance of the estimate, row by row."""
        full = np.zeros((6, 6))
        estimate = self._robot.estimation.estimate
        if estimate is not None:
            full[np.ix_((0, 1, 5), (0, 1, 5))] = estimate.covariance
        found: list[float] = full.ravel().tolist()
        return found

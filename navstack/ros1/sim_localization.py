"""What the localization of the simulated robot publishes: amcl_pose and particlecloud."""

from __future__ import annotations

from typing import Final

import numpy as np

from navstack.core import Pose2D, Transform2D
from navstack.logs.builder import MessageBuilder
from navstack.ros1.pose_topics import PoseTopics
from navstack.sim import SimulatedRobot

PERIOD_S: Final = 0.1
"""Simulated time between two poses (s)."""


class LocalizationTopics:
    """`amcl_pose` and `particlecloud`, as amcl and fake_localization publish them.

    The covariance is that of the simulated amcl, if the parameters have one; else 0, as of fake_localization. The cloud has one
    particle.
    """

    def __init__(self, robot: SimulatedRobot, build: MessageBuilder, frame: str) -> None:
        self._robot = robot
        self._topics = PoseTopics(build, frame)
        self._due = 0.0

    def publish(self, time_s: float, stamp_ns: int, odometry: Pose2D) -> None:
        """Publish the pose, if it is due at the simulated time `time_s`; `odometry` is the pose of the base in the odometry."""
        if time_s < self._due:
            return
        self._due = time_s + PERIOD_S
        robot = self._robot
        offset = robot.frames.lookup(robot.map_frame, robot.odom_frame)
        pose = Pose2D(*(offset @ Transform2D(*odometry)))
        estimate = robot.estimation.estimate
        self._topics.publish_pose(stamp_ns, pose, None if estimate is None else estimate.covariance)
        self._topics.publish_particles(stamp_ns, np.array([tuple(pose)]))

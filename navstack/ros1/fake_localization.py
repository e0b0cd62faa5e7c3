"""fake_localization: map -> odom from the true pose of a simulated robot."""

from __future__ import annotations

from collections import deque
from typing import Any, Final

import numpy as np

from navstack.core import Pose2D, Transform2D
from navstack.core.errors import FrameError, LogError
from navstack.core.frames import clean_frame
from navstack.logs import messages as msg
from navstack.ros1 import private, ros
from navstack.ros1.localization_node import LocalizationNode

WAITING: Final = 100
"""True poses that wait for the transform odom -> base."""


class FakeLocalization(LocalizationNode):
    """The node, with the topics and parameters of fake_localization. Raises InputError for wrong parameters."""

    takes_any_frame = True

    def __init__(self) -> None:
        frames = [
            clean_frame(private.text(f"{name}_frame_id", default))
            for name, default in (("global", "map"), ("odom", "odom"), ("base", "base_link"))
        ]
        dx, dy, dyaw = (private.number(f"delta_{axis}", 0.0) for axis in ("x", "y", "yaw"))
        super().__init__(frames[0], frames[1], frames[2], private.number("transform_tolerance", 0.1, low=0.0))
        self._offset = Transform2D(-dx, -dy, -dyaw)
        """Pose of the frame of the true poses in the map."""
        self._truth: Pose2D | None = None
        self._waiting: deque[tuple[float, Pose2D]] = deque(maxlen=WAITING)
        odometry = ros.message("nav_msgs/Odometry")
        ros.rospy().Subscriber("base_pose_ground_truth", odometry, self.inbox.poster(self._on_truth), queue_size=100)
        self.subscribe()

    def _on_truth(self, message: Any) -> None:
        self._truth = msg.pose_of(message.pose.pose)
        self._waiting.append((self.clock.of(message.header.stamp), self._truth))

    def set_pose(self, message: Any) -> None:
        """Change the offset so that the newest pose in the map becomes the given one."""
        if self._truth is None:
            raise LogError("an initial pose is ignored: there is no true pose on base_pose_ground_truth yet")
        self._offset = Transform2D(*msg.pose_of(message.pose.pose)) @ Transform2D(*self._truth).inverse()

    def process(self, now: float) -> None:
        """Publish for every true pose whose odometry is known."""
        del now
        while self._waiting:
            time, truth = self._waiting[0]
            try:
                odometry = self.odometry_at(time)
            except FrameError:
                self._waiting.popleft()
                continue
            if odometry is None:
                return
            self._waiting.popleft()
            pose, stamp = self._offset.apply(truth), self.clock.ns(time)
            self.tf.publish(stamp, Transform2D(*pose) @ odometry.inverse())
            self.poses.publish_pose(stamp, pose)
            self.poses.publish_particles(stamp, np.array([tuple(pose)]))

"""What the nodes amcl and fake_localization share: transforms of the robot, the loop, the initial pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Final

from navstack.core import Transform2D
from navstack.core.errors import FrameError, NavError
from navstack.core.frames import clean_frame
from navstack.logs import messages as msg
from navstack.logs.builder import MessageBuilder
from navstack.ros1 import ros
from navstack.ros1.clock import NodeClock, wait_for_clock
from navstack.ros1.inbox import Inbox
from navstack.ros1.master import MasterWatch
from navstack.ros1.node_log import NodeLog
from navstack.ros1.pose_topics import MapToOdom, PoseTopics
from navstack.ros1.robot import RosRobot

POLL_S: Final = 0.1
"""Longest wait for messages (s, wall)."""


class LocalizationNode(ABC):
    """A node that publishes map -> odom. Messages are processed in its own thread only."""

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str, ahead_s: float) -> None:
        """Frames without a leading slash; map -> odom is stamped `ahead_s` (s) ahead of the data it rests on."""
        rospy = self._rospy = ros.rospy()
        self.map_frame, self.odom_frame, self.base_frame = map_frame, odom_frame, base_frame
        wait_for_clock()
        self.inbox = Inbox()
        self.clock = NodeClock(rospy)
        self._jumps = 0
        self.build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self.log = NodeLog(rospy, str)
        self.robot = RosRobot(self.clock, lambda twist: None, self.report)
        self.poses = PoseTopics(self.build, map_frame)
        self.tf = MapToOdom(self.build, map_frame, odom_frame, ahead_s)

    def subscribe(self) -> None:
        """Receive transforms and initial poses; a child adds its own topics and calls this when it is ready for messages."""
        rospy, robot, later = self._rospy, self.robot, self.inbox.poster
        tf, pose = ros.message("tf2_msgs/TFMessage"), ros.message("geometry_msgs/PoseWithCovarianceStamped")
        rospy.Subscriber("/tf_static", tf, later(robot.receive_transforms, static=True), queue_size=100)
        rospy.Subscriber("/tf", tf, later(self._on_transforms), queue_size=100)
        rospy.Subscriber("initialpose", pose, later(self._on_initial_pose), queue_size=2)

    def report(self, error: NavError) -> None:
        """Log a message that cannot be used."""
        self.log.problem(error.message)

    def odometry_at(self, time: float) -> Transform2D | None:
        """Return the pose of the base in the odometry frame at a time (s); None if it is not known yet.

        Raises FrameError if it will not be known: the time is older than the history.
        """
        frames, names = self.robot.frames, (self.odom_frame, self.base_frame)
        try:
            return frames.lookup(*names, time)
        except FrameError:
            try:
                is_to_come = frames.latest_stamp(*names) < time
            except FrameError:
                is_to_come = True
            if is_to_come:
                return None
            raise

    def _on_transforms(self, message: Any) -> None:
        # its own transforms are stamped ahead of time, and not needed
        message.transforms = [
            item for item in message.transforms if clean_frame(item.child_frame_id) != self.odom_frame
        ]
        self.robot.receive_transforms(message, static=False)

    def _on_initial_pose(self, message: Any) -> None:
        frame = msg.frame_of(message)
        if not frame:
            self._rospy.logwarn('an initial pose has no frame; it is taken as one in "%s"', self.map_frame)
        elif frame != self.map_frame and not self.takes_any_frame:
            self._rospy.logwarn('an initial pose is in "%s", not in "%s"; it is ignored', frame, self.map_frame)
            return
        elif frame != self.map_frame:
            self._rospy.logwarn('an initial pose is in "%s"; it is taken as one in "%s"', frame, self.map_frame)
        self.set_pose(message)

    takes_any_frame = False
    """Whether an initial pose in another frame than that of the map is used all the same."""

    @abstractmethod
    def set_pose(self, message: Any) -> None:
        """Use an initial pose (PoseWithCovarianceStamped)."""

    @abstractmethod
    def process(self, now: float) -> None:
        """Process the data that wait, at the present time (s)."""

    def end(self) -> None:  # noqa: B027
        """Called at the end of the node, while it can still publish."""

    def spin(self) -> None:
        """Run until the node is shut down."""
        MasterWatch()
        while not ros.is_stopping():
            self.inbox.run(POLL_S, self.report)
            now = self.clock.now()
            if self.clock.jumps != self._jumps:
                self._jumps = self.clock.jumps
                self._rospy.logwarn("the clock jumped back; transforms and sensor data before it are discarded")
                self.robot.forget()
            self.process(now)
            self.log.flush(drives=True)
        self.log.finish()
        ros.shut_down(self.end)

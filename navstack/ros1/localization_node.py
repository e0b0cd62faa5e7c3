"""What the nodes amcl and fake_localization share: transforms of the robot, the loop, the initial pose."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import FrameError, LaserScan, LogError, NavError, Pose2D, Transform2D, clean_frame
from navstack.ros1 import parameters, ros
from navstack.ros1.node import MasterWatch, wait_for_clock
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, NodeClock, NodeLog, RosRobot

# --- what a localization publishes: `amcl_pose` and `particlecloud`, latched, and map -> odom on /tf ------------------


class PoseTopics:
    """Publishes the pose of the base in the map and the particles behind it, as amcl and fake_localization do."""

    def __init__(self, build: MessageBuilder, frame: str, *, below: str = "") -> None:
        """`below`: what comes before the names, `robot_1/`."""
        rospy = ros.rospy()
        self._build, self._frame = build, frame
        self._pose_type = ros.message("geometry_msgs/PoseWithCovarianceStamped")
        self._cloud_type = ros.message("geometry_msgs/PoseArray")
        self._pose = rospy.Publisher(f"{below}amcl_pose", self._pose_type, queue_size=2, latch=True)
        self._cloud = rospy.Publisher(f"{below}particlecloud", self._cloud_type, queue_size=2, latch=True)

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


POLL_S: Final = 0.1
"""Longest wait for messages (s, wall)."""
WAITING: Final = 100
"""Scans, or true poses, that wait for the transform odom -> base."""


class LocalizationNode(ABC):
    """A node that publishes map -> odom. Messages are processed in its own thread only."""

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str, ahead_s: float) -> None:
        """Frames without a leading slash; map -> odom is stamped `ahead_s` (s) ahead of the data it rests on."""
        rospy = self._rospy = ros.rospy()
        self.map_frame, self.odom_frame, self.base_frame = map_frame, odom_frame, base_frame
        wait_for_clock()
        self.inbox = Inbox()
        self.clock = NodeClock(ros.now_ns)
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
        """Process the data that wait, at the current time (s)."""

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


class WaitingScan(NamedTuple):
    """A scan, and its stamp as it arrived."""

    scan: LaserScan
    stamp_ns: int


class ScanNode(LocalizationNode):
    """A localization node of a lidar: each scan of the topic `scan` waits until its odometry is known."""

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str, ahead_s: float) -> None:
        super().__init__(map_frame, odom_frame, base_frame, ahead_s)
        self._waiting: deque[WaitingScan] = deque(maxlen=WAITING)

    def subscribe(self) -> None:
        """Receive scans, transforms and initial poses."""
        scan, receive = ros.array_message("sensor_msgs/LaserScan"), self.inbox.poster(self.on_scan, most=WAITING)
        self._rospy.Subscriber("scan", scan, receive, queue_size=WAITING)
        super().subscribe()

    def on_scan(self, message: Any) -> None:
        """Receive a LaserScan message."""
        self.robot.receive_scan(message, "scan")
        for data in self.robot.scans():
            if isinstance(data, LaserScan):
                self._waiting.append(WaitingScan(data, int(message.header.stamp.to_nsec())))

    def use_waiting_scans(self) -> None:
        """Use all scans whose odometry is known; those whose odometry will never be known are reported."""
        while self._waiting:
            waiting = self._waiting[0]
            try:
                odometry = self.odometry_at(waiting.scan.stamp)
                sensor = self.robot.frames.lookup(self.base_frame, waiting.scan.frame)
            except FrameError as exc:
                self.report(exc)
            else:
                if odometry is None:
                    return
                self.use_scan(waiting, odometry, sensor)
            self._waiting.popleft()

    @abstractmethod
    def use_scan(self, waiting: WaitingScan, odometry: Transform2D, sensor: Transform2D) -> None:
        """Use a scan with the pose of the base in the odometry frame and that of the sensor in the base."""


# --- fake_localization: map -> odom from the true pose of a simulated robot -------------------------------------------


class FakeLocalization(LocalizationNode):
    """The node, with the topics and parameters of fake_localization. Raises InputError for wrong parameters."""

    takes_any_frame = True

    def __init__(self) -> None:
        frames = [
            clean_frame(parameters.text(f"{name}_frame_id", default))
            for name, default in (("global", "map"), ("odom", "odom"), ("base", "base_link"))
        ]
        dx, dy, dyaw = (parameters.number(f"delta_{axis}", 0.0) for axis in ("x", "y", "yaw"))
        super().__init__(frames[0], frames[1], frames[2], parameters.number("transform_tolerance", 0.1, low=0.0))
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

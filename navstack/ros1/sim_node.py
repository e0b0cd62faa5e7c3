"""The simulated robot as a ROS 1 node: scan, odometry, tf, IMU, map, clock, bumpers, cameras and the true pose; cmd_vel in."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, Pose2D
from navstack.ros1 import parameters, ros
from navstack.ros1.camera_topics import CameraTopics
from navstack.ros1.localization_node import PoseTopics
from navstack.ros1.map_nodes import MapTopics
from navstack.ros1.node import MasterWatch, wait_for_clock
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import ALIASES, START_NS, ClockPace, Pace, SimLoop, SimNames, WallPace, with_imus
from navstack.scenario import Scenario

VELOCITY_TOPICS: Final = ("cmd_vel", "mobile_base/mobile_base_controller/cmd_vel")
"""Default of `~cmd_vel_topics`: ROS's usual name, and that of the HandsFree base."""
IMUS: Final = ("imu",)
"""Default of `~imus`."""


def sim_names(map_frame: str, odom_frame: str, base_frame: str) -> SimNames:
    """Return the frames of a simulated robot by its parameters.

    `tf_prefix` is searched from the node's namespace upwards; `~odom_frame_id`, `~base_frame_id`, `~global_frame_id` rename the
    three main frames. Raises InputError for parameters of another type.
    """
    rospy = ros.rospy()
    found = rospy.search_param("tf_prefix")
    prefix = rospy.get_param(found) if found is not None else ""
    if not isinstance(prefix, str):
        raise InputError(f"the parameter {found} is {prefix!r}, not a text", parameter=found)
    own = (map_frame, odom_frame, base_frame)
    roles = ("global", "odom", "base")
    published = [parameters.text(f"{role}_frame_id", frame) for role, frame in zip(roles, own, strict=True)]
    return SimNames(own, published, prefix, parameters.texts("base_aliases", ALIASES))


class SimNode(SimLoop):
    """The node. `rospy.init_node` must have been called, with `/use_sim_time` false: this node makes the time."""

    def __init__(self, scenario: Scenario, *, speed: float, clock: bool) -> None:
        """`speed`: simulated seconds per second. `clock`: publish `/clock`; otherwise ROS's time is kept, and `speed` is 1.

        If /use_sim_time is set and `clock` is not, the node waits for the clock of another one. With `~localization` false
        another node localizes the robot: no map -> odom, amcl_pose and particlecloud, and `initialpose` does not move it.
        Raises InputError for wrong parameters.
        """
        rospy = self._rospy = ros.rospy()
        scenario = with_imus(scenario, parameters.texts("imus", scenario.configuration.navstack.sim.imus or list(IMUS)))
        build = MessageBuilder(ros.MessageTypes(), ros1=True)
        is_localized = parameters.flag("localization", True)
        super().__init__(scenario, build, _pace(speed, clock), rospy, clock=clock, localization=is_localized)
        self.names = sim_names(self.robot.map_frame, self.robot.odom_frame, self.robot.base_frame)
        self._publishers: dict[str, Any] = {}
        for topic, kind in (
            *((("/clock", "rosgraph_msgs/Clock"),) if clock else ()),
            ("/tf", "tf2_msgs/TFMessage"),
            ("odom", "nav_msgs/Odometry"),
            ("base_pose_ground_truth", "nav_msgs/Odometry"),
        ):
            self._publisher(topic, kind)
        self._static = rospy.Publisher("/tf_static", ros.message("tf2_msgs/TFMessage"), queue_size=1, latch=True)
        sim = scenario.configuration.navstack.sim
        self._cameras = [
            CameraTopics(name, sim.camera(name), self.build, self._publisher, self.names.frame) for name in sim.cameras
        ]
        self._map = MapTopics(dataclasses.replace(scenario.map, frame=self.names.map), self.build)
        self._poses = PoseTopics(self.build, self.names.map) if is_localized else None
        twist, pose = ros.message("geometry_msgs/Twist"), ros.message("geometry_msgs/PoseWithCovarianceStamped")
        receive = self.inbox.poster
        for topic in parameters.texts("cmd_vel_topics", VELOCITY_TOPICS):
            rospy.Subscriber(topic, twist, receive(self.receive_command), queue_size=1, tcp_nodelay=True)
        if is_localized:
            rospy.Subscriber("initialpose", pose, receive(self.receive_pose), queue_size=1)
        empty = ros.message("std_srvs/srv/Empty")
        self._reset = rospy.Service("reset_positions", empty, self.inbox.caller(self._on_reset))
        self._static.publish(self.static_transforms())
        if clock:
            self.publish_clock(0.0)
        self._map.publish(self.ns(0.0))

    def _publisher(self, name: str, kind: str, queue: int = 50) -> Any:
        found = self._publishers.get(name)
        if found is None:
            found = self._rospy.Publisher(name, ros.message(kind), queue_size=queue, tcp_nodelay=True)
            self._publishers[name] = found
        return found

    def publish(self, topic: str, kind: str, message: Any) -> None:
        """Publish a message."""
        self._publisher(topic, kind.replace("/msg/", "/")).publish(message)

    def publish_pose(self, stamp_ns: int, pose: Pose2D, covariance: NDArray[np.float64] | None) -> None:
        """Publish `amcl_pose` and `particlecloud`, as amcl and fake_localization do; the cloud has one particle."""
        if self._poses is not None:
            self._poses.publish_pose(stamp_ns, pose, covariance)
            self._poses.publish_particles(stamp_ns, np.array([tuple(pose)]))

    def publish_more(self, stamp_ns: int) -> None:
        """Publish the images of the cameras."""
        for camera in self._cameras:
            camera.publish(self.robot, stamp_ns)

    def extend_static(self, message: Any, stamp_ns: int, taken: set[str]) -> None:
        """Add the frames of the cameras."""
        for camera in self._cameras:
            message.transforms += camera.frames(stamp_ns, self.names.base, taken)

    def _on_reset(self, request: Any) -> Any:
        del request
        self.robot.place(self.scenario.start)
        return ros.message("std_srvs/srv/EmptyResponse")()

    def is_stopping(self) -> bool:
        """Return True if the node must end."""
        return ros.is_stopping()

    def spin(self) -> None:
        """Simulate until the node is shut down."""
        MasterWatch(self._on_new_master)
        self.run()
        ros.shut_down(lambda: None)

    def _on_new_master(self) -> None:
        if "/clock" in self._publishers:
            self._rospy.set_param("/use_sim_time", True)


def _pace(speed: float, clock: bool) -> Pace:
    rospy = ros.rospy()
    if clock:
        return WallPace(speed, START_NS)
    if rospy.get_param("/use_sim_time", False):
        wait_for_clock()
        return ClockPace(ros.now_ns)
    return WallPace(1.0, int(rospy.Time.now().to_nsec()), stamps_wall_time=True)

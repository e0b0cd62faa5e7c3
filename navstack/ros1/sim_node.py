"""The simulated robot as a ROS 1 node: scan, odometry, tf, IMU, map, clock, bumpers, cameras and the true pose; cmd_vel in."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
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
from navstack.ros_node import (
    ALIASES,
    START_NS,
    ClockPace,
    Pace,
    SharedWorld,
    SimLoop,
    SimNames,
    WallPace,
    run_fleet,
    with_imus,
)
from navstack.scenario import Scenario
from navstack.sim import World

VELOCITY_TOPICS: Final = ("cmd_vel", "mobile_base/mobile_base_controller/cmd_vel")
"""Default of `~cmd_vel_topics`: ROS's usual name, and that of the HandsFree base."""
IMUS: Final = ("imu",)
"""Default of `~imus`."""
COMMON: Final = ("/clock", "/tf")
"""Topics that the robots of a fleet share."""


def sim_names(map_frame: str, odom_frame: str, base_frame: str, robot: str = "") -> SimNames:
    """Return the frames of a simulated robot by its parameters.

    `tf_prefix` is searched from the node's namespace upwards; `~odom_frame_id`, `~base_frame_id`, `~global_frame_id` rename the
    three main frames. The frames of a `robot` of several have its name as a further prefix. Raises InputError for parameters of
    another type.
    """
    rospy = ros.rospy()
    found = rospy.search_param("tf_prefix")
    prefix = rospy.get_param(found) if found is not None else ""
    if not isinstance(prefix, str):
        raise InputError(f"the parameter {found} is {prefix!r}, not a text", parameter=found)
    own = (map_frame, odom_frame, base_frame)
    roles = ("global", "odom", "base")
    published = [parameters.text(f"{role}_frame_id", frame) for role, frame in zip(roles, own, strict=True)]
    prefix = "/".join(part for part in (prefix.strip("/"), robot) if part)
    return SimNames(own, published, prefix, parameters.texts("base_aliases", ALIASES))


class SimNode(SimLoop):
    """The node, or the part of one robot of several."""

    def __init__(
        self, scenario: Scenario, *, pace: Pace, clock: bool, robot: str = "", shared: SharedWorld | None = None
    ) -> None:
        """`clock`: publish `/clock`. `shared`: what it has in common with the other robots of a fleet, `robot`: its name there.

        With `~localization` false another node localizes the robot: no map -> odom, amcl_pose and particlecloud, and
        `initialpose` does not move it. The topics and services of a robot of a fleet are those below its name; `/tf` is that of
        all. Raises InputError for wrong parameters.
        """
        rospy = self._rospy = ros.rospy()
        scenario = with_imus(scenario, parameters.texts("imus", scenario.configuration.navstack.sim.imus or list(IMUS)))
        build = MessageBuilder(ros.MessageTypes(), ros1=True)
        is_localized = parameters.flag("localization", True)
        super().__init__(scenario, build, pace, rospy, clock=clock, localization=is_localized, shared=shared)
        self.names = sim_names(self.robot.map_frame, self.robot.odom_frame, self.robot.base_frame, robot)
        self._below = below = f"{robot}/" if robot else ""
        self._publishers: dict[str, Any] = {}
        for topic, kind in (
            *((("/clock", "rosgraph_msgs/Clock"),) if clock else ()),
            ("/tf", "tf2_msgs/TFMessage"),
            ("odom", "nav_msgs/Odometry"),
            ("base_pose_ground_truth", "nav_msgs/Odometry"),
        ):
            self._publisher(topic, kind)
        sim = scenario.configuration.navstack.sim
        self._cameras = [
            CameraTopics(name, sim.camera(name), self.build, self._publisher, self.names.frame) for name in sim.cameras
        ]
        self._map = MapTopics(dataclasses.replace(scenario.map, frame=self.names.map), self.build, below=below)
        self._poses = PoseTopics(self.build, self.names.map, below=below) if is_localized else None
        twist, pose = ros.message("geometry_msgs/Twist"), ros.message("geometry_msgs/PoseWithCovarianceStamped")
        receive = self.inbox.poster
        for topic in parameters.texts("cmd_vel_topics", VELOCITY_TOPICS):
            rospy.Subscriber(self._named(topic), twist, receive(self.receive_command), queue_size=1, tcp_nodelay=True)
        if is_localized:
            rospy.Subscriber(f"{below}initialpose", pose, receive(self.receive_pose), queue_size=1)
        empty = ros.message("std_srvs/srv/Empty")
        self._reset = rospy.Service(f"{below}reset_positions", empty, self.inbox.caller(self._on_reset))
        if clock:
            self.publish_clock(0.0)
        self._map.publish(self.ns(0.0))

    def _named(self, topic: str) -> str:
        return self._below + topic.lstrip("/") if self._below and topic not in COMMON else topic

    def _publisher(self, name: str, kind: str, queue: int = 50) -> Any:
        found = self._publishers.get(name)
        if found is None:
            found = self._rospy.Publisher(self._named(name), ros.message(kind), queue_size=queue, tcp_nodelay=True)
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


def simulate(scenario: Scenario, *, speed: float, clock: bool) -> None:
    """Simulate a robot until the node is shut down. Raises InputError for wrong parameters.

    `speed`: simulated seconds per second. `clock`: publish `/clock`; otherwise ROS's time is kept, and `speed` is 1. If
    /use_sim_time is set and `clock` is not, the node waits for the clock of another one. `rospy.init_node` must have been called,
    with `clock` while /use_sim_time was false: this node makes the time.
    """
    made = SimNode(scenario, pace=_pace(speed, clock), clock=clock)
    _spin([made], made.run, clock=clock)


def simulate_fleet(world: World, robots: Mapping[str, Scenario], *, speed: float, clock: bool) -> None:
    """As `simulate`, for robots by name in one world: each below its name, and its frames with its name as their prefix."""
    shared, pace = SharedWorld(world, robots), _pace(speed, clock)
    made: dict[str, SimNode] = {}
    for name, scenario in robots.items():
        made[name] = SimNode(scenario, pace=pace, clock=clock and not made, robot=name, shared=shared)
    _spin(list(made.values()), lambda: run_fleet(made), clock=clock)


def _spin(nodes: Sequence[SimNode], run: Callable[[], None], *, clock: bool) -> None:
    rospy = ros.rospy()
    # one message for all robots: a topic keeps the last one of a node only
    static = nodes[0].static_transforms()
    for node in nodes[1:]:
        static.transforms += node.static_transforms().transforms
    out = rospy.Publisher("/tf_static", ros.message("tf2_msgs/TFMessage"), queue_size=1, latch=True)
    out.publish(static)

    def on_new_master() -> None:
        if clock:
            rospy.set_param("/use_sim_time", True)

    MasterWatch(on_new_master)
    run()
    ros.shut_down(lambda: None)


def _pace(speed: float, clock: bool) -> Pace:
    rospy = ros.rospy()
    if clock:
        return WallPace(speed, START_NS)
    if rospy.get_param("/use_sim_time", False):
        wait_for_clock()
        return ClockPace(ros.now_ns)
    return WallPace(1.0, int(rospy.Time.now().to_nsec()), stamps_wall_time=True)

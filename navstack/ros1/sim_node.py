"""The simulated robot as a ROS 1 node: scan, odometry, tf, IMU, map, clock, bumpers, cameras and the true pose; cmd_vel in."""

from __future__ import annotations

import dataclasses
import gc
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import simulated_robot
from navstack.core import InputError, LaserScan, NavError, PointCloud, Pose2D, Transform2D, Twist2D, clean_frame
from navstack.parameters import load_configuration
from navstack.ros1 import parameters, ros
from navstack.ros1.camera_topics import CameraTopics
from navstack.ros1.localization_node import PoseTopics
from navstack.ros1.map_nodes import MapTopics
from navstack.ros1.node import Inbox, MasterWatch, wait_for_clock
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.scenario import Scenario
from navstack.sim import SimulatedRobot

# --- what the localization of the simulated robot publishes: amcl_pose and particlecloud ------------------------------


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


# --- names on the ROS graph: frames with a prefix, aliases of the base, topics of velocities --------------------------


ALIASES: Final = ("base_footprint", "base_link")
"""Names of the base that drivers publish; what the parameters do not use is published as well, at the same place."""
VELOCITY_TOPICS: Final = ("cmd_vel", "mobile_base/mobile_base_controller/cmd_vel")
"""Default of `~cmd_vel_topics`: ROS's usual name, and that of the HandsFree base."""


class SimNames:
    """The frames and topics of one simulated robot.

    `tf_prefix`, searched from the node's namespace upwards, is put before the frames of the robot, not before that of the map:
    `robot1/odom`. `~odom_frame_id`, `~base_frame_id` and `~global_frame_id` rename the three main frames.
    """

    def __init__(self, map_frame: str, odom_frame: str, base_frame: str) -> None:
        """The frames by the parameters of the robot. Raises InputError for parameters of another type."""
        rospy = ros.rospy()
        found = rospy.search_param("tf_prefix")
        prefix = rospy.get_param(found) if found is not None else ""
        if not isinstance(prefix, str):
            raise InputError(f"the parameter {found} is {prefix!r}, not a text", parameter=found)
        self.prefix = prefix.strip("/")
        self._known: dict[str, str] = {
            clean_frame(map_frame): clean_frame(parameters.text("global_frame_id", map_frame)),
            clean_frame(odom_frame): self._prefixed(parameters.text("odom_frame_id", odom_frame)),
            clean_frame(base_frame): self._prefixed(parameters.text("base_frame_id", base_frame)),
        }
        self.map, self.odom, self.base = self._known.values()
        self.aliases = [
            name
            for name in map(self._prefixed, parameters.texts("base_aliases", ALIASES))
            if name not in self._known.values()
        ]
        """Further frames at the place of the base."""
        self.velocity_topics = parameters.texts("cmd_vel_topics", VELOCITY_TOPICS)

    def frame(self, name: str) -> str:
        """Return the frame on the graph for a frame of the simulator."""
        found = self._known.get(name)
        if found is None:
            found = self._known[name] = self._prefixed(name)
        return found

    def _prefixed(self, name: str) -> str:
        name = clean_frame(name)
        return f"{self.prefix}/{name}" if self.prefix and not name.startswith(f"{self.prefix}/") else name

    def rename(self, message: Any) -> Any:
        """Return a sensor's message with the frame of the graph in its header."""
        message.header.frame_id = self.frame(message.header.frame_id)
        return message


# --- when the simulated robot takes its next step: by the wall clock, or by the clock of another node -----------------


SLACK_S: Final = 1.0
"""A simulation that is later (s, wall) does not catch up: no burst of steps."""


class Pace(ABC):
    """Tells how long to wait for a simulated time."""

    start_ns: int
    """ROS's time of the simulated time 0 (ns)."""

    @abstractmethod
    def wait_s(self, reached_s: float) -> float:
        """Return how long to wait (s, wall) until the simulated time `reached_s` (s) is due; not positive: it is."""


class WallPace(Pace):
    """The wall clock, `speed` simulated seconds per second."""

    def __init__(self, speed: float, start_ns: int, *, stamps_wall_time: bool = False) -> None:
        """With `stamps_wall_time`, a delay also delays the stamps: otherwise all later data would be old."""
        self._speed, self._stamps_wall_time = speed, stamps_wall_time
        self._begin = time.monotonic()
        self.start_ns = start_ns

    def wait_s(self, reached_s: float) -> float:
        """Return the time to wait; a machine that is too slow delays what follows."""
        ahead = reached_s / self._speed - (time.monotonic() - self._begin)
        if ahead < -SLACK_S:
            self._begin -= ahead
            if self._stamps_wall_time:
                self.start_ns -= round(ahead * 1e9)
        return ahead


class ClockPace(Pace):
    """The clock of another node, such as that of a first simulated robot."""

    def __init__(self) -> None:
        """Wait for the clock, with warnings."""
        self._rospy: Any = ros.rospy()
        wait_for_clock()
        self.start_ns = self._last_ns = int(self._rospy.Time.now().to_nsec())

    def wait_s(self, reached_s: float) -> float:
        """Return 0 if the clock has come that far, else the time to the next look. A jump back of the clock is followed."""
        now_ns = int(self._rospy.Time.now().to_nsec())
        if now_ns < self._last_ns:
            self.start_ns -= self._last_ns - now_ns
        self._last_ns = now_ns
        return 0.0 if now_ns >= self.start_ns + reached_s * 1e9 else 0.002


STEP_S: Final = 0.02
"""Simulated time between two publications (s): odometry and tf at 50 Hz."""
CMD_VEL_TIMEOUT_S: Final = 0.5
"""The robot stops without a command for this time (s), as diff_drive_controller."""
IMUS: Final = ("imu",)
"""Default of `~imus`."""
START_NS: Final = 1_000_000_000
"""Time of the clock at the start (ns): never 0, which means that there is no time yet."""
ODOMETRY_COVARIANCE: Final[list[float]] = np.diag((1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03)).ravel().tolist()
"""Of the pose (m², rad²) and of the velocity (their rates): what the drivers of Clearpath's robots publish."""


def _with_imus(scenario: Scenario) -> Scenario:
    """Return the scenario with the IMUs of `~imus`; without it those of the parameters, or one named imu."""
    configuration = scenario.configuration
    present = configuration.navstack.sim.imus
    wanted = parameters.texts("imus", present or list(IMUS))
    if wanted == present:
        return scenario
    overlay = {"navstack": {"sim": {"imus": wanted}}}
    distro = configuration.navstack.ros_distro
    new = load_configuration([configuration.tree.as_dict(), overlay], distro=distro)
    return dataclasses.replace(scenario, configuration=new)


class SimNode:
    """The node. `rospy.init_node` must have been called, with `/use_sim_time` false: this node makes the time."""

    def __init__(self, scenario: Scenario, *, speed: float, clock: bool) -> None:
        """`speed`: simulated seconds per second. `clock`: publish `/clock`; otherwise ROS's time is kept, and `speed` is 1.

        If /use_sim_time is set and `clock` is not, the node waits for the clock of another one. With `~localization` false
        another node localizes the robot: no map -> odom, amcl_pose and particlecloud, and `initialpose` does not move it.
        Raises InputError for wrong parameters.
        """
        rospy = self._rospy = ros.rospy()
        self.scenario = scenario = _with_imus(scenario)
        self.robot = simulated_robot(scenario.configuration, scenario.world(), scenario.start, seed=scenario.seed)
        # what exists now lives as long as the node: a search for garbage in it would stop the clock
        gc.collect()
        gc.freeze()
        self.inbox = Inbox()
        self.build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self.names = SimNames(self.robot.map_frame, self.robot.odom_frame, self.robot.base_frame)
        self._pace = _pace(speed, clock)
        self._command_at = -1e9
        self._publishers: dict[str, Any] = {}
        self._clock = self._publisher("/clock", "rosgraph_msgs/Clock") if clock else None
        self._tf = self._publisher("/tf", "tf2_msgs/TFMessage")
        self._odom = self._publisher("odom", "nav_msgs/Odometry")
        self._truth = self._publisher("base_pose_ground_truth", "nav_msgs/Odometry")
        self._static = rospy.Publisher("/tf_static", ros.message("tf2_msgs/TFMessage"), queue_size=1, latch=True)
        sim = scenario.configuration.navstack.sim
        self._cameras = [
            CameraTopics(name, sim.camera(name), self.build, self._publisher, self.names.frame) for name in sim.cameras
        ]
        self._map = MapTopics(dataclasses.replace(scenario.map, frame=self.names.map), self.build)
        self._is_localized = parameters.flag("localization", True)
        self._localization = LocalizationTopics(self.robot, self.build, self.names.map) if self._is_localized else None
        twist, pose = ros.message("geometry_msgs/Twist"), ros.message("geometry_msgs/PoseWithCovarianceStamped")
        receive = self.inbox.poster
        for topic in self.names.velocity_topics:
            rospy.Subscriber(topic, twist, receive(self._on_command), queue_size=1, tcp_nodelay=True)
        if self._is_localized:
            rospy.Subscriber("initialpose", pose, receive(self._on_pose), queue_size=1)
        empty = ros.message("std_srvs/srv/Empty")
        self._reset = rospy.Service("reset_positions", empty, self.inbox.caller(self._on_reset))
        self._publish_static()
        if self._clock is not None:
            self._publish_clock(0.0)
        self._map.publish(self._ns(0.0))

    def _publisher(self, name: str, kind: str, queue: int = 50) -> Any:
        found = self._publishers.get(name)
        if found is None:
            found = self._rospy.Publisher(name, ros.message(kind), queue_size=queue, tcp_nodelay=True)
            self._publishers[name] = found
        return found

    def _ns(self, time_s: float) -> int:
        return self._pace.start_ns + round(time_s * 1e9)

    # --- messages -----------------------------------------------------------------------------------------------------

    def _on_command(self, message: Any) -> None:
        self.robot.command(msg.twist_of(message))
        self._command_at = self.robot.time

    def _on_pose(self, message: Any) -> None:
        """Put the robot at a pose of the map, as its localization then believes."""
        frame = msg.frame_of(message)
        if frame not in ("", self.names.map):
            self._rospy.logwarn('initialpose is in "%s", not in "%s"; it is ignored', frame, self.names.map)
            return
        self.robot.place(msg.pose_of(message.pose.pose))

    def _on_reset(self, request: Any) -> Any:
        del request
        self.robot.place(self.scenario.start)
        return ros.message("std_srvs/srv/EmptyResponse")()

    def _report(self, error: NavError) -> None:
        self._rospy.logwarn("%s", error.message)

    # --- run ----------------------------------------------------------------------------------------------------------

    def spin(self) -> None:
        """Simulate until the node is shut down."""
        MasterWatch(self._on_new_master)
        half = 0.5 * STEP_S
        reached = 0.0
        while not ros.is_stopping():
            if self._clock is not None:
                # two steps of the clock for one of the robot: a cycle of 20 Hz has the same period each time
                self._wait_until(reached + half)
                self._publish_clock(max(reached + half, self.robot.time))
            reached += STEP_S
            self._wait_until(reached)
            self._step(reached)
        ros.shut_down(lambda: None)

    def _wait_until(self, reached: float) -> None:
        """Receive messages until a simulated time (s) is due."""
        while True:
            ahead = self._pace.wait_s(reached)
            self.inbox.run(min(max(ahead, 0.0), 0.05), self._report)
            if ahead <= 0.0 or ros.is_stopping():
                return

    def _on_new_master(self) -> None:
        if self._clock is not None:
            self._rospy.set_param("/use_sim_time", True)

    def _step(self, until: float) -> None:
        robot = self.robot
        if robot.time - self._command_at > CMD_VEL_TIMEOUT_S:
            robot.command(Twist2D())
        first = round(robot.time * self.scenario.configuration.navstack.sim.physics_frequency)
        samples = robot.advance_to(until)
        if self._clock is not None:
            self._publish_clock(robot.time)
        # a scan after the transforms that it needs, before what can wait
        self._publish_transforms(samples, first)
        self._publish_scans()
        self._publish_states(samples, first)
        for reading in robot.imu_readings():
            message = self.names.rename(self.build.imu(self._ns(reading.stamp), reading))
            self._publisher(reading.topic, "sensor_msgs/Imu").publish(message)
        for camera in self._cameras:
            camera.publish(robot, self._ns(robot.time))

    def _publish_scans(self) -> None:
        build, rename = self.build, self.names.rename
        for data in self.robot.scans():
            stamp = self._ns(data.stamp)
            if isinstance(data, LaserScan):
                self._publisher(data.topic, "sensor_msgs/LaserScan").publish(rename(build.scan(stamp, data)))
            elif isinstance(data, PointCloud):
                self._publisher(data.topic, "sensor_msgs/PointCloud2").publish(rename(build.cloud(stamp, data)))
            else:
                self._publisher(data.topic, "sensor_msgs/Range").publish(rename(build.range(stamp, data)))

    def _times(self, samples: NDArray[np.float64], first: int) -> Iterator[tuple[float, list[float]]]:
        """Return time (s) and sample of each step of the physics after `first`."""
        frequency = self.scenario.configuration.navstack.sim.physics_frequency
        return ((step / frequency, row) for step, row in enumerate(samples.tolist(), first + 1))

    def _publish_transforms(self, samples: NDArray[np.float64], first: int) -> None:
        """Publish tf of each step of the physics."""
        robot, names = self.robot, self.names
        for at, row in self._times(samples, first):
            stamp = self._ns(at)
            offset = robot.frames.lookup(robot.map_frame, robot.odom_frame, at)
            moving = [(stamp, names.odom, names.base, Transform2D(*row[3:6]), 0.0)]
            if self._is_localized:
                moving.append((stamp, names.map, names.odom, offset, 0.0))
            self._tf.publish(self.build.transforms(moving))

    def _publish_states(self, samples: NDArray[np.float64], first: int) -> None:
        """Publish the odometry, the true pose and that of the localization of each step of the physics."""
        build, names = self.build, self.names
        for at, row in self._times(samples, first):
            stamp = self._ns(at)
            pose, velocity = Pose2D(*row[3:6]), Twist2D(*row[6:9])
            self._odom.publish(_with_covariances(build.odometry(stamp, names.odom, names.base, pose, velocity)))
            self._truth.publish(build.odometry(stamp, names.map, names.base, Pose2D(*row[:3]), velocity))
            if self._localization is not None:
                self._localization.publish(at, stamp, pose)

    def _publish_clock(self, time_s: float) -> None:
        assert self._clock is not None
        self._clock.publish(ros.message("rosgraph_msgs/Clock")(clock=self.build.time(self._ns(time_s))))

    def _publish_static(self) -> None:
        robot = self.robot
        sim = self.scenario.configuration.navstack.sim
        heights = sim.scan_heights
        own = (robot.map_frame, robot.odom_frame, robot.base_frame)
        stamp, names = self._ns(0.0), self.names
        mounted = [frame for frame in robot.frames.frames() if frame not in own]
        static = [
            (
                stamp,
                names.base,
                names.frame(frame),
                robot.frames.lookup(robot.base_frame, frame),
                heights.get(frame, 0.0),
            )
            for frame in mounted
        ]
        taken = {names.frame(frame) for frame in mounted}
        static += [(stamp, names.base, alias, Transform2D(), 0.0) for alias in names.aliases if alias not in taken]
        message = self.build.transforms(static)
        taken = {transform.child_frame_id for transform in message.transforms} | {names.map, names.odom, names.base}
        for camera in self._cameras:
            message.transforms += camera.frames(stamp, names.base, taken)
        self._static.publish(message)


def _pace(speed: float, clock: bool) -> Pace:
    rospy = ros.rospy()
    if clock:
        return WallPace(speed, START_NS)
    if rospy.get_param("/use_sim_time", False):
        return ClockPace()
    return WallPace(1.0, int(rospy.Time.now().to_nsec()), stamps_wall_time=True)


def _with_covariances(odometry: Any) -> Any:
    odometry.pose.covariance = odometry.twist.covariance = ODOMETRY_COVARIANCE
    return odometry

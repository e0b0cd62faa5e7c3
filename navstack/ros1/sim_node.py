"""The simulated robot as a ROS 1 node: scan, odometry, tf, IMU, map, clock, bumpers and the true pose; cmd_vel in."""

from __future__ import annotations

import time
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import simulated_robot
from navstack.core import LaserScan, PointCloud, Pose2D, Transform2D, Twist2D
from navstack.core.errors import NavError
from navstack.logs import messages as msg
from navstack.logs.builder import MessageBuilder
from navstack.ros1 import ros
from navstack.ros1.inbox import Inbox
from navstack.ros1.map_server import MapTopics
from navstack.ros1.master import MasterWatch
from navstack.scenario import Scenario

STEP_S: Final = 0.02
"""Simulated time between two publications (s): odometry and tf at 50 Hz."""
CMD_VEL_TIMEOUT_S: Final = 0.5
"""The robot stops without a command for this time (s), as diff_drive_controller."""
START_NS: Final = 1_000_000_000
"""Time of the clock at the start (ns): never 0, which means that there is no time yet."""


class SimNode:
    """The node. `rospy.init_node` must have been called, with `/use_sim_time` false: this node makes the time."""

    def __init__(self, scenario: Scenario, *, speed: float, clock: bool) -> None:
        """`speed`: simulated seconds per second. `clock`: publish `/clock`; otherwise stamps are wall time, and `speed` is 1."""
        rospy = self._rospy = ros.rospy()
        self.scenario = scenario
        self.robot = simulated_robot(scenario.configuration, scenario.world(), scenario.start, seed=scenario.seed)
        self.inbox = Inbox()
        self.build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self._speed, self._publishes_clock = speed, clock
        self._start_ns = START_NS if clock else int(rospy.Time.now().to_nsec())
        self._command_at = -1e9
        self._publishers: dict[str, Any] = {}
        self._clock = self._publisher("/clock", "rosgraph_msgs/Clock") if clock else None
        self._tf = self._publisher("/tf", "tf2_msgs/TFMessage")
        self._odom = self._publisher("odom", "nav_msgs/Odometry")
        self._truth = self._publisher("base_pose_ground_truth", "nav_msgs/Odometry")
        self._static = rospy.Publisher("/tf_static", ros.message("tf2_msgs/TFMessage"), queue_size=1, latch=True)
        self._map = MapTopics(scenario.map, self.build)
        twist, pose = ros.message("geometry_msgs/Twist"), ros.message("geometry_msgs/PoseWithCovarianceStamped")
        receive = self.inbox.poster
        rospy.Subscriber("cmd_vel", twist, receive(self._on_command), queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("initialpose", pose, receive(self._on_pose), queue_size=1)
        empty = ros.message("std_srvs/srv/Empty")
        self._reset = rospy.Service("reset_positions", empty, self.inbox.caller(self._on_reset))
        self._is_static = self.robot.frames.latest_stamp(self.robot.map_frame, self.robot.odom_frame) == float("inf")
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
        return self._start_ns + round(time_s * 1e9)

    # --- messages -----------------------------------------------------------------------------------------------------

    def _on_command(self, message: Any) -> None:
        self.robot.command(msg.twist_of(message))
        self._command_at = self.robot.time

    def _on_pose(self, message: Any) -> None:
        """Put the robot at a pose of the map, as its localization then believes."""
        frame = msg.frame_of(message)
        if frame not in ("", self.robot.map_frame):
            self._rospy.logwarn('initialpose is in "%s", not in "%s"; it is ignored', frame, self.robot.map_frame)
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
        begin, reached = time.monotonic(), 0.0
        while not ros.is_stopping():
            reached += STEP_S
            while True:
                ahead = reached / self._speed - (time.monotonic() - begin)
                self.inbox.run(min(max(ahead, 0.0), 0.05), self._report)
                if ahead <= 0.0 or ros.is_stopping():
                    break
            if ahead < -1.0:  # the machine is too slow: no burst afterwards
                begin -= ahead
            self._step(reached)
        ros.say_goodbye(lambda: None)

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
        self._publish_states(samples, first)
        for data in robot.scans():
            stamp = self._ns(data.stamp)
            if isinstance(data, LaserScan):
                self._publisher(data.topic, "sensor_msgs/LaserScan").publish(self.build.scan(stamp, data))
            elif isinstance(data, PointCloud):
                self._publisher(data.topic, "sensor_msgs/PointCloud2").publish(self.build.cloud(stamp, data))
            else:
                self._publisher(data.topic, "sensor_msgs/Range").publish(self.build.range(stamp, data))
        for reading in robot.imu_readings():
            self._publisher(reading.topic, "sensor_msgs/Imu").publish(self.build.imu(self._ns(reading.stamp), reading))

    def _publish_states(self, samples: NDArray[np.float64], first: int) -> None:
        """Publish tf, odometry and the true pose of each step of the physics."""
        robot, build = self.robot, self.build
        frequency = self.scenario.configuration.navstack.sim.physics_frequency
        for step, row in enumerate(samples.tolist(), first + 1):
            at = step / frequency
            stamp = self._ns(at)
            pose, velocity = Pose2D(*row[3:6]), Twist2D(*row[6:9])
            moving = [(stamp, robot.odom_frame, robot.base_frame, Transform2D(*pose), 0.0)]
            if not self._is_static:
                offset = robot.frames.lookup(robot.map_frame, robot.odom_frame, at)
                moving.append((stamp, robot.map_frame, robot.odom_frame, offset, 0.0))
            self._tf.publish(build.transforms(moving))
            self._odom.publish(build.odometry(stamp, robot.odom_frame, robot.base_frame, pose, velocity))
            true = build.odometry(stamp, robot.map_frame, robot.base_frame, Pose2D(*row[:3]), velocity)
            self._truth.publish(true)

    def _publish_clock(self, time_s: float) -> None:
        assert self._clock is not None
        self._clock.publish(ros.message("rosgraph_msgs/Clock")(clock=self.build.time(self._ns(time_s))))

    def _publish_static(self) -> None:
        robot = self.robot
        sim = self.scenario.configuration.navstack.sim
        heights = {sim.lidar(name).frame: sim.lidar(name).height for name in sim.lasers}
        own = (robot.map_frame, robot.odom_frame, robot.base_frame)
        stamp = self._ns(0.0)
        static = [
            (stamp, robot.base_frame, frame, robot.frames.lookup(robot.base_frame, frame), heights.get(frame, 0.0))
            for frame in robot.frames.frames()
            if frame not in own
        ]
        if self._is_static:
            offset = robot.frames.lookup(robot.map_frame, robot.odom_frame)
            static.append((stamp, robot.map_frame, robot.odom_frame, offset, 0.0))
        self._static.publish(self.build.transforms(static))

"""A simulated robot as a node of ROS: its loop and its messages, for any ROS client library."""

from __future__ import annotations

import dataclasses
import gc
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import simulated_robot
from navstack.core import InputError, LaserScan, NavError, PointCloud, Pose2D, Transform2D, Twist2D, clean_frame
from navstack.parameters import load_configuration
from navstack.ros_messages import MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.ros_node.inbox import Inbox
from navstack.ros_node.log import Log
from navstack.ros_node.pace import Pace
from navstack.scenario import Scenario
from navstack.sim import Lockstep, World

STEP_S: Final = 0.02
"""Simulated time between two publications (s): odometry and tf at 50 Hz."""
POSE_PERIOD_S: Final = 0.1
"""Simulated time between two poses of the localization (s)."""
CMD_VEL_TIMEOUT_S: Final = 0.5
"""The robot stops without a command for this time (s), as diff_drive_controller."""
START_NS: Final = 1_000_000_000
"""Time of the clock at the start (ns): never 0, which means that there is no time yet."""
ODOMETRY_COVARIANCE: Final[list[float]] = np.diag((1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 0.03)).ravel().tolist()
"""Of the pose (m², rad²) and of the velocity (their rates): what the drivers of Clearpath's robots publish."""
ALIASES: Final = ("base_footprint", "base_link")
"""Names of the base that drivers publish; what the parameters do not use is published as well, at the same place."""


class SimNames:
    """The frames of one simulated robot on the graph.

    The prefix is put before the frames of the robot, not before that of the map: `robot1/odom`.
    """

    def __init__(
        self, own: Sequence[str], published: Sequence[str], prefix: str = "", aliases: Sequence[str] = ALIASES
    ) -> None:
        """`own` are the frames of map, odometry and base in the parameters, `published` their names on the graph."""
        self.prefix = prefix.strip("/")
        names = [clean_frame(published[0]), self._prefixed(published[1]), self._prefixed(published[2])]
        self._known = {clean_frame(name): found for name, found in zip(own, names, strict=True)}
        self.map, self.odom, self.base = names
        self.aliases = [name for name in map(self._prefixed, aliases) if name not in names]
        """Further frames at the place of the base."""

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


def with_imus(scenario: Scenario, wanted: Sequence[str]) -> Scenario:
    """Return the scenario with these IMUs."""
    configuration = scenario.configuration
    if list(wanted) == list(configuration.navstack.sim.imus):
        return scenario
    overlay = {"navstack": {"sim": {"imus": list(wanted)}}}
    distro = configuration.navstack.ros_distro
    new = load_configuration([configuration.tree.as_dict(), overlay], distro=distro)
    return dataclasses.replace(scenario, configuration=new)


class SimLoop(ABC):
    """The node without its subscribers and services, which a subclass adds; it sets `names` before the first step."""

    names: SimNames

    def __init__(
        self,
        scenario: Scenario,
        build: MessageBuilder,
        pace: Pace,
        log: Log,
        *,
        clock: bool,
        localization: bool,
        shared: SharedWorld | None = None,
    ) -> None:
        """With `clock`, `/clock` is published; without `localization` another node publishes map -> odom and the pose.

        `shared`: what it has in common with the other robots of a fleet.
        """
        self.scenario = scenario
        world = scenario.world() if shared is None else shared.world
        self.robot = simulated_robot(scenario.configuration, world, scenario.start, seed=scenario.seed)
        # what exists now lives as long as the node: a search for garbage in it would stop the clock
        gc.collect()
        gc.freeze()
        self.inbox = Inbox() if shared is None else shared.inbox
        self.build = build
        self._pace, self._log = pace, log
        self.has_clock, self._is_localized = clock, localization
        self._command_at = -1e9
        self._pose_due = 0.0

    # --- for subclasses -----------------------------------------------------------------------------------------------

    @abstractmethod
    def publish(self, topic: str, kind: str, message: Any) -> None:
        """Publish a message of the type `kind` (`nav_msgs/msg/Odometry`)."""

    @abstractmethod
    def publish_pose(self, stamp_ns: int, pose: Pose2D, covariance: NDArray[np.float64] | None) -> None:
        """Publish the pose of the localization with its (3, 3) covariance, and its particles."""

    def publish_more(self, stamp_ns: int) -> None:  # noqa: B027
        """Publish what only this node has, after each step."""

    def extend_static(self, message: Any, stamp_ns: int, taken: set[str]) -> None:  # noqa: B027
        """Add transforms to those of the sensors; `taken` are the frames that are known."""

    @abstractmethod
    def is_stopping(self) -> bool:
        """Return True if the node must end."""

    # --- messages -----------------------------------------------------------------------------------------------------

    def ns(self, time_s: float) -> int:
        """Return ROS's time (ns) of a simulated time (s)."""
        return self._pace.start_ns + round(time_s * 1e9)

    def receive_command(self, message: Any) -> None:
        """Receive a Twist or a TwistStamped."""
        self.robot.command(msg.twist_of(getattr(message, "twist", message)))
        self._command_at = self.robot.time

    def receive_pose(self, message: Any) -> None:
        """Put the robot at a pose of the map (PoseWithCovarianceStamped), as its localization then believes."""
        frame = msg.frame_of(message)
        if frame not in ("", self.names.map):
            self._log.logwarn('initialpose is in "%s", not in "%s"; it is ignored', frame, self.names.map)
            return
        self.robot.place(msg.pose_of(message.pose.pose))

    def _report(self, error: NavError) -> None:
        self._log.logwarn("%s", error.message)

    # --- run ----------------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Simulate until the node must end."""
        run_together([self], lambda until: [self.robot.advance_to(until)])

    def wait_until(self, reached: float) -> None:
        """Receive messages until a simulated time (s) is due."""
        while True:
            ahead = self._pace.wait_s(reached)
            self.inbox.run(min(max(ahead, 0.0), 0.05), self._report)
            if ahead <= 0.0 or self.is_stopping():
                return

    def stop_without_command(self) -> None:
        """Stop the robot if it has had no command for `CMD_VEL_TIMEOUT_S`."""
        if self.robot.time - self._command_at > CMD_VEL_TIMEOUT_S:
            self.robot.command(Twist2D())

    def publish_steps(self, samples: NDArray[np.float64]) -> None:
        """Publish what the last physics steps, with these samples (n, 9), have given."""
        robot = self.robot
        first = round(robot.time * self.scenario.configuration.navstack.sim.physics_frequency) - len(samples)
        # a scan after the transforms that it needs, before what can wait
        self._publish_transforms(samples, first)
        self._publish_scans()
        self._publish_states(samples, first)
        for reading in robot.imu_readings():
            message = self.names.rename(self.build.imu(self.ns(reading.stamp), reading))
            self.publish(reading.topic, "sensor_msgs/msg/Imu", message)
        for found in robot.dock_detections():
            message = self.names.rename(self.build.detection(self.ns(found.stamp), found))
            self.publish(found.topic, msg.POSE, message)
        self.publish_more(self.ns(robot.time))

    def _publish_scans(self) -> None:
        build, rename = self.build, self.names.rename
        for data in self.robot.scans():
            stamp = self.ns(data.stamp)
            if isinstance(data, LaserScan):
                self.publish(data.topic, msg.SCAN, rename(build.scan(stamp, data)))
            elif isinstance(data, PointCloud):
                self.publish(data.topic, msg.CLOUD, rename(build.cloud(stamp, data)))
            else:
                self.publish(data.topic, msg.RANGE, rename(build.range(stamp, data)))

    def _times(self, samples: NDArray[np.float64], first: int) -> Iterator[tuple[float, list[float]]]:
        """Return time (s) and sample of each step of the physics after `first`."""
        frequency = self.scenario.configuration.navstack.sim.physics_frequency
        return ((step / frequency, row) for step, row in enumerate(samples.tolist(), first + 1))

    def _publish_transforms(self, samples: NDArray[np.float64], first: int) -> None:
        """Publish tf of each step of the physics."""
        robot, names = self.robot, self.names
        for at, row in self._times(samples, first):
            stamp = self.ns(at)
            offset = robot.frames.lookup(robot.map_frame, robot.odom_frame, at)
            moving = [(stamp, names.odom, names.base, Transform2D(*row[3:6]), 0.0)]
            if self._is_localized:
                moving.append((stamp, names.map, names.odom, offset, 0.0))
            self.publish("/tf", msg.TRANSFORMS[0], self.build.transforms(moving))

    def _publish_states(self, samples: NDArray[np.float64], first: int) -> None:
        """Publish the odometry, the true pose and that of the localization of each step of the physics."""
        build, names = self.build, self.names
        for at, row in self._times(samples, first):
            stamp = self.ns(at)
            pose, velocity = Pose2D(*row[3:6]), Twist2D(*row[6:9])
            odometry = build.odometry(stamp, names.odom, names.base, pose, velocity, ODOMETRY_COVARIANCE)
            self.publish("odom", msg.ODOMETRY, odometry)
            truth = build.odometry(stamp, names.map, names.base, Pose2D(*row[:3]), velocity)
            self.publish("base_pose_ground_truth", msg.ODOMETRY, truth)
            if self._is_localized and at >= self._pose_due:
                self._publish_localization(at, pose)

    def _publish_localization(self, at: float, odometry: Pose2D) -> None:
        """Publish the pose; its covariance is that of the simulated amcl, if the parameters have one."""
        self._pose_due = at + POSE_PERIOD_S
        robot = self.robot
        offset = robot.frames.lookup(robot.map_frame, robot.odom_frame)
        estimate = robot.estimation.estimate
        pose = Pose2D(*(offset @ Transform2D(*odometry)))
        self.publish_pose(self.ns(at), pose, None if estimate is None else estimate.covariance)

    def publish_clock(self, time_s: float) -> None:
        """Publish the clock at a simulated time (s)."""
        clock = self.build.of("rosgraph_msgs/msg/Clock", clock=self.build.time(self.ns(time_s)))
        self.publish("/clock", "rosgraph_msgs/msg/Clock", clock)

    def static_transforms(self) -> Any:
        """Return a TFMessage with the frames of the sensors and the aliases of the base."""
        robot, names, stamp = self.robot, self.names, self.ns(0.0)
        heights = self.scenario.configuration.navstack.sim.scan_heights
        own = (robot.map_frame, robot.odom_frame, robot.base_frame)
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
        self.extend_static(message, stamp, taken)
        return message


# --- several robots ---------------------------------------------------------------------------------------------------

ROS_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class SharedWorld:
    """What the simulated robots of a fleet have in common in one node."""

    def __init__(self, world: World, names: Iterable[str]) -> None:
        """`names` of the robots, which become those of topics. Raises InputError for one that ROS does not allow."""
        self.world, self.inbox = world, Inbox()
        for name in names:
            if not ROS_NAME.fullmatch(name):
                raise InputError(
                    f'the robot "{name}" cannot give its name to topics of ROS; use letters, digits and "_", a letter first',
                    name=name,
                )


def run_fleet(loops: Mapping[str, SimLoop]) -> None:
    """Simulate robots with one `SharedWorld`, by name, until the node must end; the first one keeps time. Raises InputError."""
    lockstep = Lockstep({name: loop.robot for name, loop in loops.items()})

    def advance(until: float) -> Sequence[NDArray[np.float64]]:
        samples = [np.empty((len(loops), 0, 9))]
        for step in range(lockstep.step + 1, lockstep.step_at(until) + 1):
            lockstep.advance_to(step)
            samples.append(lockstep.newest[:, None])
        lockstep.catch_up()
        return list(np.concatenate(samples, axis=1))

    run_together(list(loops.values()), advance)


def run_together(loops: Sequence[SimLoop], advance: Callable[[float], Sequence[NDArray[np.float64]]]) -> None:
    """Simulate until the node must end; the first one keeps time, publishes the clock if it has one, and receives for all.

    `advance` runs all robots up to a simulated time (s), and returns the samples (n, 9) of each.
    """
    first, half, reached = loops[0], 0.5 * STEP_S, 0.0
    while not first.is_stopping():
        if first.has_clock:
            # two steps of the clock for one of the robot: a cycle of 20 Hz has the same period each time
            first.wait_until(reached + half)
            first.publish_clock(max(reached + half, first.robot.time))
        reached += STEP_S
        first.wait_until(reached)
        for loop in loops:
            loop.stop_without_command()
        samples = advance(reached)
        if first.has_clock:
            first.publish_clock(first.robot.time)
        for loop, rows in zip(loops, samples, strict=True):
            loop.publish_steps(rows)

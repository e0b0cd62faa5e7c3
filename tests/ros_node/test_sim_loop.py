"""The simulated robots of a fleet as a node: they advance as in the fleet's own simulation; the first one keeps time."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from navstack.bringup import simulated_robot
from navstack.core import InputError, LaserScan, Pose2D, Twist2D
from navstack.fleet import Fleet, load_fleet
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import Pace, SharedWorld, SimLoop, SimNames, run_fleet
from navstack.sim import Lockstep


class Always(Pace):
    """Every time is due."""

    start_ns = 0

    def wait_s(self, reached_s: float) -> float:
        """Return 0."""
        del reached_s
        return 0.0


class Recorder(SimLoop):
    """A robot whose messages are kept; it ends after a time."""

    def __init__(self, fleet: Fleet, name: str, shared: SharedWorld, *, clock: bool, end_s: float) -> None:
        build, scenario = MessageBuilder(get_typestore(Stores.ROS2_JAZZY), ros1=False), fleet.scenarios[name]
        super().__init__(scenario, build, Always(), None, clock=clock, localization=True, shared=shared)  # pyright: ignore[reportArgumentType]
        own = self.robot.map_frame, self.robot.odom_frame, self.robot.base_frame
        self.names, self._end_s = SimNames(own, own), end_s
        self.published: list[tuple[str, Any]] = []
        self.poses: list[Pose2D] = []

    def publish(self, topic: str, kind: str, message: Any) -> None:
        """Keep a message."""
        del kind
        self.published.append((topic, message))

    def publish_pose(self, stamp_ns: int, pose: Pose2D, covariance: NDArray[np.float64] | None) -> None:
        """Keep a pose."""
        del stamp_ns, covariance
        self.poses.append(pose)

    def is_stopping(self) -> bool:
        """Return True after the end."""
        return self.robot.time >= self._end_s


def of(topic: str, robot: Recorder) -> list[Any]:
    """The messages of a topic."""
    return [message for name, message in robot.published if name == topic]


@pytest.mark.slow
def test_robots_of_a_fleet_advance_together() -> None:
    """Every step of the physics is published, and ends where the fleet's lockstep ends; scans see the other robot."""
    fleet = load_fleet("corridor_two", overrides=["navstack/sim/laser/beams=41"])
    shared = SharedWorld(fleet.world(), fleet.scenarios)
    robots = {name: Recorder(fleet, name, shared, clock=name == "east", end_s=0.4) for name in fleet.scenarios}
    for robot in robots.values():
        robot.receive_command(robot.build.twist(Twist2D(0.4, 0.0, 0.1)))
    run_fleet(robots)

    world = fleet.world()
    alone = {name: simulated_robot(s.configuration, world, s.start, seed=s.seed) for name, s in fleet.scenarios.items()}
    lockstep = Lockstep(alone)
    for robot in alone.values():
        robot.command(Twist2D(0.4, 0.0, 0.1))
    lockstep.advance_to(lockstep.step_at(0.4))
    lockstep.catch_up()
    frequency = fleet.robots[0].scenario.configuration.navstack.sim.physics_frequency
    for name, robot in robots.items():
        assert robot.robot.pose == alone[name].pose != robot.scenario.start
        odometry, truth = of("odom", robot), of("base_pose_ground_truth", robot)
        assert len(odometry) == len(truth) == round(0.4 * frequency)
        stamps = [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in truth]
        assert np.diff([0.0, *stamps]) == pytest.approx(1.0 / frequency, abs=1e-9)
        assert truth[-1].pose.pose.position.x == robot.robot.pose.x
        ranges = [m.ranges for m in of("scan", robot)]
        assert len(ranges) == 5  # 10 Hz
        wanted = [scan.ranges for scan in alone[name].scans() if isinstance(scan, LaserScan)]
        assert all((a == b).all() for a, b in zip(ranges, wanted, strict=True))
    clocks = [len(of("/clock", robot)) for robot in robots.values()]
    assert clocks == [40, 0]


@pytest.mark.parametrize("name", ["robot-1", "1st", "ä", "a b"])
def test_a_name_that_ros_does_not_allow(name: str) -> None:
    fleet = load_fleet("corridor_two")
    with pytest.raises(InputError, match=f'the robot "{name}" cannot give its name to topics of ROS'):
        SharedWorld(fleet.world(), ["robot_1", name])

"""Bumpers: pressed zones, positions and times of their points, and the reaction of the stack."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.bringup import build_move_base, simulated_robot
from navstack.core import Footprint, InputError, LaserScan, PointCloud, Pose2D, Twist2D
from navstack.parameters import load_configuration
from navstack.sim import LOW, BumperParams, LidarParams, SimParams, SimulatedRobot, World
from navstack.sim.bumper import SPACING, outline_points
from tests.sim.test_robot import BOX, CIRCLE, corridor

DISTANCE = BumperParams().distance


def clouds(robot: SimulatedRobot) -> list[PointCloud]:
    return [data for data in robot.scans() if isinstance(data, PointCloud)]


def touching(
    bearing: float, footprint: Footprint = CIRCLE, *, kinematics: Any = "holonomic", **bumper: Any
) -> SimulatedRobot:
    """A robot that has driven 0.5 m into a post in this direction."""
    post = [0.5 * math.cos(bearing), 0.5 * math.sin(bearing), 0.02]
    params = SimParams(kinematics=kinematics, lasers=[], sensors={"bumper": BumperParams(**bumper)})
    robot = SimulatedRobot(params, World(None, [post]), footprint, Pose2D(0.0, 0.0, 0.0))
    robot.command(Twist2D(0.3 * math.cos(bearing), 0.3 * math.sin(bearing)))
    robot.advance_to(2.0)
    assert robot.in_collision
    return robot


@pytest.mark.parametrize("bearing", [0.0, 0.4, -0.4, 0.7, -0.7, 1.5, -1.5])
def test_the_point_is_at_the_contact(bearing: float) -> None:
    robot = touching(bearing)
    cloud = clouds(robot)[-1]
    assert (cloud.topic, cloud.frame) == ("mobile_base/sensors/bumper_pointcloud", "bumper_link")
    assert cloud.points.dtype == np.float32 and cloud.points.flags.c_contiguous
    ((x, y, z),) = cloud.points.tolist()
    assert z == pytest.approx(0.04)
    # a 16-gon lies up to 0.02 r within its circle; what is within 1 cm of the post may lie 1.5 cm to one side of it
    assert math.hypot(x, y) == pytest.approx(0.18 + DISTANCE, abs=0.006)
    assert math.atan2(y, x) == pytest.approx(bearing, abs=0.08)


@pytest.mark.parametrize("bearing", [1.8, math.pi, -1.8])
def test_a_kobuki_has_no_bumper_at_the_back(bearing: float) -> None:
    robot = touching(bearing)
    assert all(len(cloud.points) == 0 for cloud in clouds(robot))


@pytest.mark.parametrize(("bearing", "middle"), [(0.2, 0.0), (0.7, 1.047), (-1.4, -1.047)])
def test_with_point_zone_the_point_is_at_the_zone_center(bearing: float, middle: float) -> None:
    ((x, y, _),) = clouds(touching(bearing, point="zone"))[-1].points.tolist()
    assert math.atan2(y, x) == pytest.approx(middle, abs=0.03)


def test_all_around() -> None:
    ((x, y, _),) = clouds(touching(math.pi, zones=[[-math.pi, math.pi]]))[-1].points.tolist()
    assert abs(math.atan2(y, x)) == pytest.approx(math.pi, abs=0.08)


def test_a_box_against_a_wall_presses_every_zone_of_its_front() -> None:
    """The zones of +-30 degrees, and the corners of the front at +-33.7 degrees beyond them."""
    robot = SimulatedRobot(SimParams(lasers=[]), corridor(10, 0.05), BOX, Pose2D(1.0, 0.0, 0.0))
    robot.command(Twist2D(0.5))
    robot.advance_to(3.0)
    points = clouds(robot)[-1].points
    assert points[:, 0].tolist() == pytest.approx([0.3 + DISTANCE] * 3)
    assert points[1, 1] == pytest.approx(0.0, abs=0.01)
    assert points[0, 1] == pytest.approx(-points[2, 1], abs=SPACING)
    assert 0.17 < points[0, 1] < 0.2


def test_clouds_are_published_while_pressed_and_once_on_release() -> None:
    params = SimParams(lasers=[], sensors={"bumper": BumperParams(frequency=5.0)})
    robot = SimulatedRobot(params, corridor(10, 0.05), CIRCLE, Pose2D(1.0, 0.0, 0.0))
    assert robot.scans() == []
    robot.command(Twist2D(0.5))
    robot.advance_to(1.6)
    assert robot.scans() == []
    robot.advance_to(2.5)
    (collision,) = robot.collisions
    found = clouds(robot)
    assert [cloud.stamp for cloud in found] == pytest.approx([collision.time, 1.8, 2.0, 2.2, 2.4])
    assert all(len(cloud.points) == 1 for cloud in found)
    robot.command(Twist2D(-0.5))
    robot.advance_to(5.0)
    found = clouds(robot)
    assert [len(cloud.points) for cloud in found] == [0]
    assert found[0].stamp == pytest.approx(2.6)


def test_the_division_into_calls_does_not_matter() -> None:
    ends: list[list[tuple[float, bytes]]] = []
    for cuts in (1, 7):
        robot = SimulatedRobot(SimParams(lasers=[]), corridor(10, 0.05), CIRCLE, Pose2D(1.0, 0.0, 0.1))
        for leg, speed in enumerate((0.5, -0.2, 0.4)):
            robot.command(Twist2D(speed, 0.0, 0.1))
            for k in range(cuts):
                robot.advance_to(3.0 * (leg + (k + 1) / cuts))
        ends.append([(cloud.stamp, cloud.points.tobytes()) for cloud in clouds(robot)])
    assert ends[0] == ends[1]
    assert len(ends[0]) > 20


def test_lidar_and_bumper_in_the_order_of_their_times() -> None:
    robot = SimulatedRobot(SimParams(), corridor(10, 0.05), CIRCLE, Pose2D(1.5, 0.0, 0.0))
    robot.command(Twist2D(0.5))
    robot.advance_to(2.0)
    stamps = [data.stamp for data in robot.scans()]
    assert stamps == sorted(stamps)
    assert robot.frames.lookup("base_footprint", "bumper_link").is_identity()


def test_outline_points_are_dense_and_normals_point_outwards() -> None:
    for footprint in (CIRCLE, BOX, Footprint(BOX.vertices[::-1].copy())):
        points, normals = outline_points(footprint.vertices)
        gaps = np.hypot(*(np.roll(points, -1, axis=0) - points).T)
        assert gaps.max() <= SPACING + 1e-12
        assert np.hypot(*normals.T) == pytest.approx(1.0)
        assert ((points * normals).sum(axis=1) > 0.0).all()  # convex around the center


def test_invalid_bumpers_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"write \[from, to\]"):
        BumperParams(zones=[[1.0, 0.5]])
    with pytest.raises(ValueError, match="laser is the name of a lidar and of a bumper"):
        SimParams(bumpers=["laser"])
    with pytest.raises(ValueError, match="the name a is used twice"):
        SimParams(bumpers=["a", "a"])
    shared = SimParams(sensors={"bumper": BumperParams(frame="base_laser_link")})
    with pytest.raises(InputError, match="two sensors have the frame"):
        SimulatedRobot(shared, World(), CIRCLE, Pose2D(0, 0, 0))


def test_bumpers_from_yaml(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(
        "navstack:\n  sim:\n    bumpers: [front, rear]\n    front: {height: 0.1}\n"
        "    rear: {zones: [[2.0, 4.28]], topic: back}\n"
    )
    sim = load_configuration(["turtlebot", str(file)]).navstack.sim
    assert sim.bumper("front").height == 0.1
    assert sim.bumper("rear").zones == [[2.0, 4.28]]
    assert list(sim.lidars) == ["laser"]


# --- a round body -----------------------------------------------------------------------------------------------------


def test_a_round_robot_turns_in_place_in_collision() -> None:
    """The corners of the 16-gon that approximates it do not collide; those of a box do."""
    for footprint, turned in (
        (CIRCLE, 1.0),
        (Footprint(np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])), 0.1),
    ):
        robot = SimulatedRobot(SimParams(), corridor(10, 0.05), footprint, Pose2D(1.5, 0.0, 0.0))
        robot.command(Twist2D(0.5))
        robot.advance_to(2.0)
        robot.command(Twist2D(0.0, 0.0, 1.0))
        robot.advance_to(3.0)
        assert (robot.pose.yaw == pytest.approx(turned)) if turned == 1.0 else (robot.pose.yaw < turned)


# --- low obstacles ----------------------------------------------------------------------------------------------------


def test_lidars_do_not_see_low_obstacles() -> None:
    ahead = SimParams(bumpers=[], sensors={"laser": LidarParams(x=0.0, beams=1, range_min=0.0)})
    world = World(None, [[3.0, 0.0, 0.5]], low_discs=[[1.5, 0.0, 0.2]])
    robot = SimulatedRobot(ahead, world, CIRCLE, Pose2D(0.0, 0.0, 0.0))
    scan = robot.scans()[0]
    assert isinstance(scan, LaserScan)
    assert scan.ranges[0] == pytest.approx(2.5)
    assert world.clearance(Pose2D(0.0, 0.0)) == pytest.approx(1.3)
    robot.command(Twist2D(0.5))
    robot.advance_to(5.0)
    (collision,) = robot.collisions
    assert collision.at == (1.5, 0.0)
    assert robot.pose.x == pytest.approx(1.5 - 0.2 - 0.18, abs=0.006)
    world.put_discs(())
    assert len(world.discs_at(0.0)) == 1
    assert world.solids_at(0.0).disc_tops.tolist() == [LOW]


# --- end to end -------------------------------------------------------------------------------------------------------


def bumped(disc: tuple[float, float, float]) -> tuple[SimulatedRobot, float, Any, list[Any]]:
    """The turtlebot drives to office_2 over a low disc; its longest push (s), and the marks of the disc at each tick."""
    grid = nav.load_map(nav.map_path("office"))
    configuration = load_configuration(["turtlebot"])
    office = nav.load_places("office")
    robot = simulated_robot(configuration, grid, office.start, low_obstacles=[disc])
    move_base = build_move_base(configuration, robot, static_map=grid)
    handle = move_base.send_goal(office.goals[0])
    marks: list[Any] = []
    center = Pose2D(disc[0], disc[1])
    stands_since, longest = 0.0, 0.0
    while not handle.is_done:
        before, at = robot.time, robot.pose
        robot.advance_to(move_base.next_due(robot.time))
        if move_base.command == Twist2D() or robot.pose.distance_to(at) + abs(robot.pose.yaw - at.yaw) > 1e-4:
            stands_since = robot.time
        elif robot.time > before:
            longest = max(longest, robot.time - stands_since)
        move_base.tick(robot.time)
        # never over it: the 16-gon reaches to 0.98 of its radius at least
        assert robot.pose.distance_to(center) > disc[2] + 0.98 * robot.footprint.inscribed_radius
        assert robot.time < 600.0
        for costmap in (move_base.local_costmap, move_base.global_costmap):
            x, y = (disc[0], disc[1])
            if costmap.name == "local_costmap" and robot.pose.distance_to(center) > 1.5:
                continue
            costs = {
                (dx, dy): costmap.master.cost_at(x + dx, y + dy)  # pyright: ignore
                for dx in (-0.1, -0.05, 0.0, 0.05, 0.1)
                for dy in (-0.1, -0.05, 0.0, 0.05, 0.1)
            }
            for (dx, dy), cost in costs.items():
                if cost == 254 and robot.collisions:
                    explained = costmap.explain_cell(x + dx, y + dy)  # pyright: ignore
                    marks.append((costmap.name, explained.source, explained.stamp, explained.set_by))
    return robot, longest, handle, marks


ON_THE_WAY = [((6.795, 7.674, 0.115), True), ((5.668, 7.784, 0.046), True), ((4.44, 7.683, 0.037), False)]


@pytest.mark.slow
@pytest.mark.parametrize(("disc", "arrives"), ON_THE_WAY)
def test_a_turtlebot_marks_obstacles_that_press_its_bumper(disc: tuple[float, float, float], arrives: bool) -> None:
    """It collides with the unseen obstacle once or a few times, marks it, and drives around it if there is space.

    The turtlebot's YAML lets it drive forwards only, and the mark lies some centimeters beyond what it touches: now and
    then it pushes against the thing, stops after stall_timeout, and gives up, with that reason.
    """
    robot, push, handle, marks = bumped(disc)
    assert push <= 3.0 + 0.2  # stall_timeout, up to 1 s to reach the velocity, a control cycle
    assert 1 <= len(robot.collisions) <= 10
    first = robot.collisions[0]
    assert first.kind == "disc"
    assert first.at == (disc[0], disc[1])
    bumps = [mark for mark in marks if mark[1] == "bump" and mark[3] == "obstacle_layer"]
    assert {name for name, *_ in bumps} == {"local_costmap", "global_costmap"}
    assert all(stamp is not None and stamp >= first.time for _, _, stamp, _ in bumps)
    if arrives:
        assert handle.status.name == "SUCCEEDED"
    else:
        assert handle.status.name == "ABORTED"
        assert handle.result.error_name == "FAILED_TO_MAKE_PROGRESS"
        assert handle.result.recoveries > 0

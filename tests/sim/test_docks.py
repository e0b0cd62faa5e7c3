"""Docks of the simulated world: contacts, battery, detections, bodies; deterministic from the seed."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import DockDetection, Footprint, GridGeometry, InputError, OccupancyGrid, Pose2D, Twist2D
from navstack.parameters import SimDockParams, SimParams, load_configuration
from navstack.sim import SimulatedRobot, World, contact_error, dock_shapes

DOCK = Pose2D(1.0, 0.5, 0.3)


def grid() -> OccupancyGrid:
    return OccupancyGrid(np.zeros((100, 100), np.int8), GridGeometry(100, 100, 0.05, -2.5, -2.5))


def params(dock: dict[str, Any] | None = None, **values: Any) -> SimParams:
    made = SimDockParams(**{"pose": list(DOCK), **(dock or {})})
    return SimParams(docks=["home"], sensors={"home": made}, lasers=[], bumpers=[], **values)


def robot_at(pose: Pose2D, sim: SimParams, seed: int = 0) -> SimulatedRobot:
    world = World(grid(), shapes=dock_shapes(sim))
    return SimulatedRobot(sim, world, Footprint.from_radius(0.18), pose, seed=seed)


def beside(x: float, y: float, yaw: float) -> Pose2D:
    """A pose in the frame of the dock, in the map."""
    c, s = math.cos(DOCK.yaw), math.sin(DOCK.yaw)
    return Pose2D(DOCK.x + c * x - s * y, DOCK.y + s * x + c * y, DOCK.yaw + yaw)


@pytest.mark.parametrize(
    ("error", "touches"),
    [
        ((0.0, 0.0, 0.0), True),
        ((-0.004, 0.009, 0.0165), True),
        ((0.01, 0.0, 0.0), True),
        ((-0.006, 0.0, 0.0), False),
        ((0.0, 0.011, 0.0), False),
        ((0.0, 0.0, -0.02), False),
        ((0.0, 0.0, math.pi), False),
        ((0.03, 0.0, 0.0), False),
    ],
)
def test_the_contacts_meet_within_their_tolerances(error: tuple[float, float, float], touches: bool) -> None:
    robot = robot_at(beside(*error), params())
    robot.advance_to(2.0)
    assert robot.docks is not None
    assert (robot.docks.at_contacts == "home") is touches
    assert robot.battery_state is not None
    assert robot.battery_state.current == pytest.approx(3.0 if touches else -1.0)


def test_a_robot_with_contacts_at_its_back_stands_the_other_way_round() -> None:
    sim = params({"contact_side": "back"})
    assert contact_error(sim.dock("home"), beside(0.0, 0.0, math.pi)).yaw == pytest.approx(0.0)
    robot = robot_at(beside(0.0, 0.0, math.pi), sim)
    robot.advance_to(0.1)
    assert robot.docks is not None
    assert robot.docks.at_contacts == "home"


def test_current_flows_after_its_delay_and_only_from_a_dock_with_power() -> None:
    robot = robot_at(DOCK, params({"charging_delay": 1.0}))
    currents = []
    for k in range(1, 31):
        robot.advance_to(0.05 * k)
        assert robot.battery_state is not None
        currents.append(robot.battery_state.current)
    assert currents[18] == -1.0
    assert currents[20] == 3.0
    dead = robot_at(DOCK, params({"powered": False}))
    dead.advance_to(2.0)
    assert dead.battery_state is not None
    assert dead.battery_state.current == -1.0


def test_the_charge_is_the_integral_of_the_current() -> None:
    battery = {"capacity": 0.1, "charge": 0.5, "idle_current": 1.0, "drive_current": 2.0}
    robot = robot_at(Pose2D(-2.0, 0.0, 0.0), params(battery=battery))
    robot.command(Twist2D(0.5, 0.0, 0.0))
    robot.advance_to(4.0)
    assert robot.battery_state is not None
    # 1 A for 4 s and 2 A s/m for 2 m, of 360 A s
    assert robot.battery_state.charge == pytest.approx(0.5 - (4.0 + 4.0) / 360.0, abs=1e-6)
    charged = robot_at(DOCK, params({"charging_delay": 0.0}, battery={**battery, "charge": 0.999}))
    charged.advance_to(30.0)
    charged.advance_to(30.1)
    assert charged.battery_state is not None
    assert charged.battery_state.charge == 1.0
    assert charged.battery_state.current == pytest.approx(0.0)


def test_a_robot_with_an_empty_battery_stands_and_is_told_of() -> None:
    robot = robot_at(Pose2D(-2.0, 0.0, 0.0), params(battery={"capacity": 0.001, "charge": 1.0}))
    for k in range(1, 101):
        robot.command(Twist2D(0.2, 0.0, 0.0))
        robot.advance_to(0.1 * k)
    assert robot.battery_state is not None
    assert robot.battery_state.charge == 0.0
    driven = robot.pose.x
    robot.command(Twist2D(0.2, 0.0, 0.0))
    robot.advance_to(12.0)
    assert robot.pose.x == driven
    assert driven < 1.0


def detections(robot: SimulatedRobot, seconds: float) -> list[DockDetection]:
    found: list[DockDetection] = []
    for k in range(1, round(20 * seconds) + 1):
        robot.advance_to(0.05 * k)
        found += robot.dock_detections()
    return found


def test_detections_come_at_their_rate_with_their_noise() -> None:
    camera = {"noise": 0.02, "yaw_noise": 0.035, "frequency": 10.0}
    found = detections(robot_at(beside(-1.0, 0.0, 0.0), params(dock_camera=camera)), 30.0)
    assert len(found) == 301
    assert found[1].stamp == pytest.approx(0.1)
    x, y = np.array([(one.x, one.y) for one in found]).T
    # 1.25 m to the marker, 0.1 m of it to the camera; 301 samples: 4 sigma of the mean and of the deviation
    assert abs(x.mean() - 1.15) < 4.0 * 0.02 / math.sqrt(301)
    assert abs(y.mean()) < 4.0 * 0.02 / math.sqrt(301)
    assert x.std() == pytest.approx(0.02, rel=0.17)


@pytest.mark.parametrize(
    ("pose", "camera", "dock", "sees"),
    [
        ((-1.0, 0.0, 0.0), {}, {}, True),
        ((-1.0, 0.0, 0.7), {}, {}, False),  # out of the field of view
        ((-1.0, 0.0, 0.7), {"fov": 2.0}, {}, True),
        ((-1.0, 0.0, 0.0), {"range_max": 1.0}, {}, False),
        ((-1.0, 0.0, 0.0), {"range_min": 1.2}, {}, False),
        ((0.2, 1.0, -1.57), {}, {}, False),  # from the side: the marker is edge-on
        ((-1.0, 0.0, 0.0), {"dropout": 1.0}, {}, False),
        ((-1.0, 0.0, 0.0), {}, {"has_marker": False}, False),
    ],
)
def test_the_camera_sees_what_it_can(
    pose: tuple[float, float, float], camera: dict[str, float], dock: dict[str, bool], sees: bool
) -> None:
    robot = robot_at(beside(*pose), params(dock, dock_camera=camera))
    assert bool(detections(robot, 1.0)) is sees


def test_a_delay_shifts_the_arrival_not_the_stamp() -> None:
    robot = robot_at(beside(-1.0, 0.0, 0.0), params(dock_camera={"delay": 0.3, "frequency": 10.0}))
    robot.advance_to(0.28)
    assert robot.dock_detections() == []
    robot.advance_to(0.5)
    assert [one.stamp for one in robot.dock_detections()] == pytest.approx([0.0, 0.1, 0.2])


def test_detections_depend_on_the_seed_and_not_on_how_time_advances() -> None:
    sim = params(dock_camera={"noise": 0.02, "dropout": 0.3})
    one, same, other = (robot_at(beside(-1.0, 0.1, 0.0), sim, seed) for seed in (1, 1, 2))
    first = detections(one, 2.0)
    same.advance_to(2.0)
    assert first == list(same.dock_detections())
    assert first != detections(other, 2.0)


@pytest.mark.parametrize(
    ("body", "angle", "nearest"), [("box", 2.36, 0.25), ("v_reflector", 2.36, 0.17), ("v_reflector", 4.2, 0.25)]
)
def test_the_body_of_a_dock_is_an_obstacle(body: str, angle: float, nearest: float) -> None:
    sim = params({"body": body, "reflector_angle": angle})
    (shape,) = dock_shapes(sim)
    assert shape.name == "home"
    robot = robot_at(beside(-1.0, 0.0, 0.0), sim)
    # a disc of 0.18 m, 1 m before the pose in the dock; the ends of an open V are off the axis
    assert robot.clearance == pytest.approx(1.0 - 0.18 + nearest, abs=0.04)
    assert dock_shapes(params({"body": "none"})) == ()


def test_wrong_docks_are_refused() -> None:
    with pytest.raises(InputError, match=r"pose = .* is not a pose"):
        load_configuration(["turtlebot", {"navstack": {"sim": {"docks": ["a"], "a": {"pose": [1.0, 2.0]}}}}])
    with pytest.raises(InputError, match="laser is the name of a lidar and of a dock"):
        load_configuration(["turtlebot", {"navstack": {"sim": {"docks": ["laser"]}}}])
    found = load_configuration(["turtlebot", {"navstack": {"sim": {"docks": ["a"], "a": {"powerd": True}}}}]).findings
    assert any("powerd" in f.message and f.severity == "warning" for f in found)

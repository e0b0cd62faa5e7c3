"""Contract of every registered local planner that selects a sample, on small maps with an ideal robot.

Controllers that follow a path (`PathFollower`) run through the suite of `navstack.testing` and through tests of their own.

Planners that third parties register by entry points run through the same suite. A planner is created with its defaults and
with the values of WANTED that it has parameters for.
"""

from __future__ import annotations

import json
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from navstack.core import (
    LETHAL,
    ControlError,
    Costmap,
    Footprint,
    GridGeometry,
    InvalidPathError,
    NavError,
    Path,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    angle_between,
    normalize_angle,
)
from navstack.local_planner import PathFollower
from navstack.plugins import LOCAL_PLANNERS, ControlInput, LocalPlan, LocalPlanner

PLANNERS = [entry.name for entry in LOCAL_PLANNERS if not issubclass(entry.cls, PathFollower)]
FOOTPRINT = Footprint.from_radius(0.18)
HEADINGS = [2.0 * math.pi * i / 64 for i in range(64)]
SLACK = 1e-6  # planners may keep velocities in float32

# a turtlebot; the last rows are what trajectory rollout calls the same things
WANTED: dict[str, Any] = {
    "max_vel_trans": 0.5,
    "min_vel_trans": 0.1,
    "max_vel_x": 0.5,
    "min_vel_x": 0.0,
    "max_vel_y": 0.0,
    "min_vel_y": 0.0,
    "max_vel_theta": 1.0,
    "acc_lim_x": 1.0,
    "acc_lim_y": 0.0,
    "acc_lim_theta": 2.0,
    "xy_goal_tolerance": 0.15,
    "yaw_goal_tolerance": 0.2,
    "path_distance_bias": 1.0,
    "goal_distance_bias": 0.8,
    "vx_samples": 6,
    "vy_samples": 1,
    "sim_time": 1.0,
    "dwa": True,
    "holonomic_robot": False,
    "meter_scoring": True,
    "escape_vel": 0.0,
}
# turns in place come without the way to brake for them: the base does what it can, as in C++
BRAKES_AT_ONCE = {"trajectory_rollout"}
# what a planner can do in addition to its defaults; with False where samples are of more than one period
MODES: dict[str, dict[str, tuple[dict[str, Any], bool]]] = {
    "dwa": {
        "holonomic": ({"max_vel_y": 0.2, "min_vel_y": -0.2, "acc_lim_y": 1.0, "vy_samples": 5}, True),
        "use_dwa off": ({"use_dwa": False}, False),
        "sum_scores": ({"sum_scores": True}, True),
        "backward": ({"min_vel_x": -0.2}, True),
        "indigo": ({"ros_distro": "indigo"}, True),
    },
    "trajectory_rollout": {
        "holonomic": ({"holonomic_robot": True, "acc_lim_y": 1.0, "y_vels": "-0.3,-0.1,0.1,0.3"}, True),
        "dwa off": ({"dwa": False}, False),
        "heading_scoring": ({"heading_scoring": True, "heading_scoring_timestep": 0.8}, True),
        "cells": ({"meter_scoring": False}, True),
        "simple_attractor": ({"simple_attractor": True}, True),
        "indigo": ({"ros_distro": "indigo"}, True),
    },
}
# what it takes to start at 50 Hz
OWN: dict[str, dict[str, Any]] = {"trajectory_rollout": {"min_vel_x": 0.1}}


def make(name: str, **more: Any) -> LocalPlanner:
    cls = LOCAL_PLANNERS.get(name).cls
    values = {"controller_frequency": 5.0, **WANTED, **OWN.get(name, {}), **more}
    return cls(cls.Params(**{k: v for k, v in values.items() if k in cls.Params.model_fields}))


def window_around(pose: Pose2D, side_m: float = 4.0, lethal: tuple[tuple[float, float], ...] = ()) -> Costmap:
    """A rolling window in steps of a cell; lethal cells at world points."""
    n = round(side_m / 0.05)
    snapped = [math.floor(v / 0.05) * 0.05 - side_m / 2 for v in pose[:2]]
    costmap = Costmap(GridGeometry(n, n, 0.05, *snapped), frame="odom")
    for x, y in lethal:
        cell = costmap.geometry.world_to_cell(x, y)
        if cell is not None:
            costmap.data[cell[1], cell[0]] = LETHAL
    return costmap


def straight(start: Pose2D, goal: Pose2D) -> Path:
    n = max(2, math.ceil(start.distance_to(goal) / 0.05) + 1)
    yaw = math.atan2(goal.y - start.y, goal.x - start.x)
    poses = np.column_stack((np.linspace(start.x, goal.x, n), np.linspace(start.y, goal.y, n), np.full(n, yaw)))
    poses[-1, 2] = goal.yaw
    return Path(poses, "odom")


def inputs_at(pose: Pose2D, velocity: Twist2D = Twist2D(), **more: Any) -> ControlInput:
    return ControlInput(RobotState(pose, velocity), window_around(pose, **more), FOOTPRINT)


def driven(pose: Pose2D, command: Twist2D, seconds: float) -> Pose2D:
    """Ideal kinematics along the arc of a command."""
    yaw = pose.yaw + 0.5 * command.wz * seconds
    if abs(command.wz) < 1e-9:
        chord = seconds
    else:
        chord = 2.0 * math.sin(0.5 * command.wz * seconds) / command.wz
    x = pose.x + chord * (command.vx * math.cos(yaw) - command.vy * math.sin(yaw))
    y = pose.y + chord * (command.vx * math.sin(yaw) + command.vy * math.cos(yaw))
    return Pose2D(x, y, normalize_angle(pose.yaw + command.wz * seconds))


def check_limits(planner: LocalPlanner, command: Twist2D) -> None:
    limits = planner.limits
    assert command.is_finite()
    assert min(0.0, limits.min_vel_x) - SLACK <= command.vx <= max(0.0, limits.max_vel_x) + SLACK
    assert min(0.0, limits.min_vel_y) - SLACK <= command.vy <= max(0.0, limits.max_vel_y) + SLACK
    assert abs(command.wz) <= limits.max_vel_theta + SLACK
    assert command.speed <= limits.max_vel_trans + 1e-4 + SLACK  # C++'s own tolerance


def check_window(name: str, planner: LocalPlanner, plan: LocalPlan, velocity: Twist2D, period: float) -> None:
    """Within one period's acceleration, or at the lowest speeds that the base can drive."""
    limits, command = planner.limits, plan.command
    if plan.mode == "arrived":
        return
    for now, then, acceleration, lowest in (
        (velocity.vx, command.vx, limits.acc_lim_x, limits.min_vel_trans),
        (velocity.vy, command.vy, limits.acc_lim_y, limits.min_vel_trans),
        (velocity.wz, command.wz, limits.acc_lim_theta, limits.min_vel_theta),
    ):
        change = acceleration * period
        assert abs(then) <= max(abs(now) + change, lowest) + SLACK
        if name not in BRAKES_AT_ONCE and plan.mode == "follow":
            # braking is limited, too, except for a change of direction at the lowest speeds
            assert now - max(change, lowest) - SLACK <= then <= now + max(change, lowest) + SLACK


def drive(
    name: str,
    planner: LocalPlanner,
    start: Pose2D,
    goal: Pose2D,
    frequency: float,
    seconds: float,
    *,
    windowed: bool = True,
) -> tuple[Pose2D, float]:
    """Follows the straight line to `goal` until it is reached: (pose, time)."""
    planner.set_plan(straight(start, goal), goal)
    pose, velocity, period = start, Twist2D(), 1.0 / frequency
    for i in range(math.ceil(seconds * frequency)):
        inputs = inputs_at(pose, velocity)
        if planner.goal_reached(inputs):
            return pose, i * period
        plan = planner.compute_command(inputs)
        check_limits(planner, plan.command)
        if windowed:
            check_window(name, planner, plan, velocity, period)
        velocity = plan.command
        pose = driven(pose, velocity, period)
    raise AssertionError(f"{goal} not reached in {seconds} s: {pose}, {velocity}")


@pytest.fixture(params=PLANNERS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.mark.slow
def test_reaches_a_free_goal_from_64_headings(name: str) -> None:
    goal = Pose2D(1.0, 0.4, 0.5)
    for heading in HEADINGS:
        planner = make(name)
        end, _ = drive(name, planner, Pose2D(0.0, 0.0, normalize_angle(heading)), goal, 5.0, 40.0)
        assert end.distance_to(goal) <= 0.15 + 1e-9, heading
        assert abs(angle_between(end.yaw, goal.yaw)) <= 0.2 + 1e-9, heading


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [1.0, 2.0, 5.0, 10.0, 20.0, 50.0])
def test_reaches_a_free_goal_at_any_frequency(name: str, frequency: float) -> None:
    planner = make(name, controller_frequency=frequency)
    goal = Pose2D(1.2, -0.3, -1.0)
    end, _ = drive(name, planner, Pose2D(0.0, 0.0, 0.3), goal, frequency, 60.0)
    assert end.distance_to(goal) <= 0.15 + 1e-9


@pytest.mark.parametrize(("planner_name", "mode"), [(n, m) for n in PLANNERS for m in MODES.get(n, {})])
def test_reaches_a_free_goal_in_every_mode(planner_name: str, mode: str) -> None:
    more, windowed = MODES[planner_name][mode]
    goal = Pose2D(1.0, -0.3, 0.8)
    for heading in HEADINGS[::16]:
        planner = make(planner_name, **more)
        start = Pose2D(0.0, 0.0, normalize_angle(heading))
        end, _ = drive(planner_name, planner, start, goal, 5.0, 60.0, windowed=windowed)
        assert end.distance_to(goal) <= 0.15 + 1e-9


@pytest.mark.parametrize("planner_name", [n for n in PLANNERS if "holonomic" in MODES.get(n, {})])
def test_a_holonomic_robot_strafes(planner_name: str) -> None:
    """To a goal next to the robot with the same heading: partly sideways if the sampling allows it."""
    planner = make(planner_name, **MODES[planner_name]["holonomic"][0])
    goal = Pose2D(0.7, 0.5, 0.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    plan = planner.compute_command(inputs_at(Pose2D(0.0, 0.0), Twist2D(0.2, 0.0, 0.0)))
    assert plan.samples is not None and plan.rejected_by is not None
    sideways = plan.samples[:, 1] != 0.0
    assert sideways.any() and (plan.rejected_by[sideways] == -1).any()
    assert (plan.samples[sideways, 1] > 0.0).any() and (plan.samples[sideways, 1] < 0.0).any()


def test_stops_at_speed_limits_of_zero(name: str) -> None:
    """Limits of zero, as a speed mask or an operator sets them: the robot brakes and then does not move."""
    planner = make(name)
    goal = Pose2D(1.8, 0.3, 0.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    pose, velocity = Pose2D(0.0, 0.0, 0.2), Twist2D(0.4, 0.0, 0.3)
    planner.set_limits(max_vel_trans=0.0, max_vel_theta=0.0)
    for _ in range(15):
        try:
            command = planner.compute_command(inputs_at(pose, velocity)).command
        except ControlError:
            command = Twist2D()
        assert command.speed <= velocity.speed + SLACK and abs(command.wz) <= abs(velocity.wz) + SLACK
        velocity = command
        pose = driven(pose, velocity, 0.2)
    assert velocity == Twist2D()
    planner.set_limits()
    assert planner.compute_command(inputs_at(pose, velocity)).command != Twist2D()


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 0.25])
def test_a_straight_corridor_gives_a_straight_path(name: str, heading: float) -> None:
    """Between two walls the robot is within a cell of the plan after half a meter and rarely changes its turning direction."""
    walls = tuple((x, y) for y in (-0.525, 0.525) for x in np.arange(-1.0, 4.0, 0.04))
    goal = Pose2D(2.4, 0.0, 0.0)
    planner = make(name, controller_frequency=10.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    pose, velocity, aside, turns = Pose2D(0.0, 0.0, heading), Twist2D(), 0.0, list[float]()
    for _ in range(200):
        if pose.x > 2.0:
            break
        velocity = planner.compute_command(inputs_at(pose, velocity, lethal=walls)).command
        pose = driven(pose, velocity, 0.1)
        if pose.x > 0.8:
            aside = max(aside, abs(pose.y))
            turns += [velocity.wz] if abs(velocity.wz) > 0.15 else []
    assert pose.x > 2.0 and aside <= 0.06
    assert sum(a * b < 0.0 for a, b in pairwise(turns)) <= 2


@pytest.mark.parametrize("heading", HEADINGS[::8])
def test_stops_at_the_goal(name: str, heading: float) -> None:
    """A robot that arrives at speed stops and stays at the goal."""
    goal = Pose2D(0.05, 0.0, normalize_angle(heading))
    planner = make(name)
    planner.set_plan(straight(Pose2D(-1.0, 0.0), goal), goal)
    pose, velocity = Pose2D(0.0, 0.0, 0.0), Twist2D(0.1, 0.0, 0.0)
    for _ in range(100):
        plan = planner.compute_command(inputs_at(pose, velocity))
        check_limits(planner, plan.command)
        velocity = plan.command
        pose = driven(pose, velocity, 0.2)
    assert velocity == Twist2D()
    assert planner.goal_reached(inputs_at(pose, velocity))
    assert planner.compute_command(inputs_at(pose, velocity)).command == Twist2D()


def test_the_command_has_its_table(name: str) -> None:
    """The table of samples shows how the command was selected."""
    planner = make(name)
    goal = Pose2D(1.5, 0.0, 0.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    plan = planner.compute_command(inputs_at(Pose2D(0.0, 0.0, 0.1), Twist2D(0.2, 0.0, 0.0)))
    assert plan.mode == "follow"
    assert plan.samples is not None and plan.costs is not None and plan.scales is not None
    assert plan.totals is not None and plan.rejected_by is not None and plan.trajectory is not None
    k, c = len(plan.samples), len(plan.critics)
    assert plan.samples.shape == (k, 3) and plan.costs.shape == (k, c) and plan.scales.shape == (c,)
    assert plan.totals.shape == (k,) and plan.rejected_by.shape == (k,)
    assert 0 <= plan.best < k and plan.rejected_by[plan.best] == -1
    legal = plan.rejected_by == -1
    summed = np.nansum(plan.costs * plan.scales, axis=1)
    np.testing.assert_allclose(plan.totals[legal], summed[legal], rtol=1e-9, atol=1e-9)
    assert plan.local_plan is not None and len(plan.local_plan) > 1


@pytest.mark.slow
def test_never_drives_into_an_obstacle(name: str) -> None:
    """A wall across the plan: no selected rollout has a footprint corner in a lethal cell, and the robot never collides."""
    wall = tuple((0.8, 0.025 + 0.05 * i) for i in range(-30, 30))
    for heading in HEADINGS[::8]:
        planner = make(name)
        goal = Pose2D(1.6, 0.0, 0.0)
        start = Pose2D(0.0, 0.0, normalize_angle(heading))
        planner.set_plan(straight(start, goal), goal)
        pose, velocity = start, Twist2D()
        for _ in range(60):
            inputs = inputs_at(pose, velocity, lethal=wall)
            try:
                plan = planner.compute_command(inputs)
            except ControlError:
                velocity = Twist2D()
                continue
            assert plan.trajectory is not None
            for row in plan.trajectory:
                for x, y in FOOTPRINT.at(Pose2D(*row)):
                    assert inputs.costmap.cost_at(float(x), float(y)) != LETHAL
            velocity = plan.command
            pose = driven(pose, velocity, 0.2)
            assert pose.x + FOOTPRINT.inscribed_radius < 0.85


def test_no_command_with_the_footprint_on_a_lethal_cell(name: str) -> None:
    """In collision with every command: the error gives the reason."""
    planner = make(name)
    goal = Pose2D(1.5, 0.0, 0.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    ring = tuple((0.18 * math.cos(a), 0.18 * math.sin(a)) for a in np.linspace(0.0, 2.0 * math.pi, 100))
    with pytest.raises(ControlError) as caught:
        planner.compute_command(inputs_at(Pose2D(0.0, 0.0), lethal=ring))
    assert caught.value.code == 106
    assert "obstacle" in caught.value.message and "lethal" in caught.value.message
    document = json.loads(json.dumps(caught.value.as_dict(), allow_nan=False))
    assert document["rejected"]["obstacle"] > 0
    if "plan" in document:  # the table, in numbers
        assert document["plan"]["legal"] == 0 and document["plan"]["best"] is None
        assert sum(document["plan"]["rejected"].values()) == document["plan"]["samples"]


def test_a_plan_that_cannot_be_followed(name: str) -> None:
    planner = make(name)
    with pytest.raises(ControlError) as caught:
        planner.compute_command(inputs_at(Pose2D(0.0, 0.0)))
    assert isinstance(caught.value, InvalidPathError)
    goal = Pose2D(1.0, 0.0)
    with pytest.raises(InvalidPathError, match="empty"):
        planner.set_plan(Path(np.empty((0, 3)), "odom"), goal)
    for value in (math.nan, math.inf):
        poses = straight(Pose2D(0.0, 0.0), goal).poses
        poses[3, 1] = value
        with pytest.raises(InvalidPathError, match="pose 3"):
            planner.set_plan(Path(poses, "odom"), goal)
    with pytest.raises(ControlError, match="finite"):
        planner.set_plan(straight(Pose2D(0.0, 0.0), goal), Pose2D(math.nan, 0.0, 0.0))
    far = Pose2D(30.0, 0.0)
    planner.set_plan(straight(Pose2D(29.0, 0.0), far), far)
    with pytest.raises(InvalidPathError, match="out of reach"):
        planner.compute_command(inputs_at(Pose2D(0.0, 0.0)))


def test_a_plan_of_one_pose(name: str) -> None:
    planner = make(name)
    goal = Pose2D(0.8, 0.0, 0.0)
    planner.set_plan(Path(np.array([goal]), "odom"), goal)
    plan = planner.compute_command(inputs_at(Pose2D(0.0, 0.0)))
    check_limits(planner, plan.command)


def test_a_pose_off_the_map(name: str) -> None:
    planner = make(name)
    goal = Pose2D(1.0, 0.0)
    planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
    elsewhere = ControlInput(RobotState(Pose2D(0.0, 0.0)), window_around(Pose2D(3.0, 0.0)), FOOTPRINT)
    with pytest.raises(ControlError) as caught:
        planner.compute_command(elsewhere)
    assert caught.value.code in (103, 106)


def test_plan_in_another_frame(name: str) -> None:
    """A rotated and translated frame of the plan does not change the command."""
    goal = Pose2D(1.0, 0.4, 0.3)
    start = Pose2D(0.0, 0.0, 0.2)
    odom_from_map = Transform2D(0.7, -1.1, 0.8)
    here, there = make(name), make(name)
    here.set_plan(straight(start, goal), goal)
    back = odom_from_map.inverse()
    there.set_plan(straight(start, goal).transformed(back, "map"), back.apply(goal))
    inputs = inputs_at(start)
    moved = ControlInput(inputs.state, inputs.costmap, FOOTPRINT, odom_from_map)
    a, b = here.compute_command(inputs), there.compute_command(moved)
    assert a.totals is not None and b.totals is not None
    assert a.command == b.command
    at_goal = ControlInput(RobotState(goal), inputs.costmap, FOOTPRINT, odom_from_map)
    there.compute_command(at_goal)
    assert there.goal_reached(at_goal)


def test_cycles_are_reproducible(name: str) -> None:
    """Two planners give identical commands and tables in the same run."""
    tables: list[list[bytes]] = []
    for _ in range(2):
        planner = make(name)
        goal = Pose2D(1.2, 0.6, 1.0)
        planner.set_plan(straight(Pose2D(0.0, 0.0), goal), goal)
        pose, velocity, seen = Pose2D(0.0, 0.0, -0.4), Twist2D(), list[bytes]()
        for _ in range(30):
            plan = planner.compute_command(inputs_at(pose, velocity))
            seen.append(np.array(plan.command).tobytes() + np.asarray(plan.totals).tobytes())
            velocity = plan.command
            pose = driven(pose, velocity, 0.2)
        tables.append(seen)
    assert tables[0] == tables[1]


def test_failures_are_nav_errors_with_a_json_form(name: str) -> None:
    planner = make(name)
    with pytest.raises(NavError) as caught:
        planner.compute_command(inputs_at(Pose2D(0.0, 0.0)))
    document = caught.value.as_dict()
    assert document["code"] == 103 and document["message"]

"""Pure pursuit, rotation shim and graceful controller: closed forms, limits over random cycles, wrong parameters."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from navstack.core import Path, Pose2D, RobotState, Twist2D, normalize_angle
from navstack.core.errors import ControlError
from navstack.interfaces import ControlInput
from navstack.local_planner import (
    GracefulController,
    GracefulParams,
    RegulatedPurePursuit,
    RegulatedPurePursuitParams,
    RotationShim,
)
from navstack.local_planner.goal_checkers.simple import SimpleGoalCheckerParams
from navstack.local_planner.graceful._law_kernels import law
from navstack.local_planner.graceful.planner import LAW
from navstack.local_planner.turning import limited_turning_speed, turning_speed
from navstack.parameters.configuration import check_parameters
from navstack.testing.doubles import FOOTPRINT, control_input, driven, local_costmap

FAR = SimpleGoalCheckerParams(path_length_tolerance=0.0, xy_goal_tolerance=0.0)


def pursuit(**values: Any) -> RegulatedPurePursuit:
    values = {"sections": {"goal_checker": FAR}, "use_collision_detection": False, **values}
    return RegulatedPurePursuit(RegulatedPurePursuitParams(**values))


def command(controller: Any, poses: Any, pose: Pose2D, velocity: Twist2D = Twist2D()) -> Twist2D:
    path = Path(np.asarray(poses, np.float64), "odom")
    controller.set_plan(path, Pose2D(*path.poses[-1].tolist()))
    return controller.compute_command(control_input(pose, velocity)).command


def arc(radius: float, length: float = 1.9, step: float = 0.005) -> list[tuple[float, float, float]]:
    turns = np.arange(0.0, length / radius, step / radius).tolist()
    return [(radius * math.sin(t), radius * (1.0 - math.cos(t)), t) for t in turns]


# --- pure pursuit -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.6, 0.8, 1.5])
@pytest.mark.parametrize("lookahead", [0.3, 0.6])
def test_every_carrot_on_a_circle_gives_its_curvature(radius: float, lookahead: float) -> None:
    got = command(pursuit(lookahead_dist=lookahead, controller_frequency=20.0), arc(radius), Pose2D(0.0, 0.0))
    # chords of 5 mm between the poses: relative error (5 mm / R)² / 8
    assert got.wz / got.vx == pytest.approx(1.0 / radius, rel=1e-4)
    assert got.vx == pytest.approx(0.5 * min(1.0, radius / 0.9), rel=1e-4)


def test_an_offset_decays_as_the_closed_form() -> None:
    """e(s) = e0 exp(-s/L) (cos(s/L) + sin(s/L)): 0.508 e0 after L, overshoot 4.3 % after pi L."""
    controller = pursuit(controller_frequency=100.0)
    path = [(0.05 * i, 0.0, 0.0) for i in range(100)]
    pose, start = Pose2D(0.0, 0.01), 0.01
    offsets: list[float] = []
    controller.set_plan(Path(np.array(path), "odom"), Pose2D(*path[-1]))
    for _ in range(400):
        offsets.append(pose.y / start)
        pose = driven(pose, controller.compute_command(control_input(pose)).command, 0.01)
    steps = [s / (0.5 * 0.01) for s in (0.6, math.pi * 0.6)]
    assert offsets[round(steps[0])] == pytest.approx(0.508, abs=0.01)
    assert offsets[round(steps[1])] == pytest.approx(-0.043, abs=0.003)


def test_the_approach_slows_down_in_proportion() -> None:
    """From D to 0.25 m in (D / v) ln(D / 0.25) = 1.05 s."""
    controller = pursuit(controller_frequency=100.0)
    path = [(0.01 * i, 0.0, 0.0) for i in range(101)]
    controller.set_plan(Path(np.array(path), "odom"), Pose2D(*path[-1]))
    pose, time = Pose2D(0.4, 0.0), 0.0
    while pose.x < 0.75:
        pose = driven(pose, controller.compute_command(control_input(pose)).command, 0.01)
        time += 0.01
    assert time == pytest.approx(1.05, abs=0.03)


def test_a_carrot_at_the_side_is_not_faster_than_the_turning_limit() -> None:
    """Nav2 commands 5 rad/s here (P2)."""
    got = command(pursuit(use_rotate_to_heading=False), [(0.0, 0.1, 1.57), (0.0, 0.12, 1.57)], Pose2D(0.0, 0.0))
    assert abs(got.wz) <= 2.5 and got.vx < 0.25


def test_a_car_keeps_its_turning_radius() -> None:
    controller = pursuit(use_rotate_to_heading=False, min_turning_r=0.8)
    for yaw in np.linspace(-1.5, 1.5, 13).tolist():
        got = command(controller, [(0.1 * i, 0.0, 0.0) for i in range(20)], Pose2D(0.0, 0.3, yaw))
        assert abs(got.wz) <= abs(got.vx) / 0.8 + 1e-12


def test_a_turn_takes_the_time_of_the_closed_form() -> None:
    """By pi from rest, at 1.8 rad/s and 3.2 rad/s²: 2.31 s. Nav2's rule is within 0.25 rad after 1.9 s at 20 Hz."""
    for rate, left, expected in ((turning_speed, 0.25, 1.9), (limited_turning_speed, 1e-3, 2.308)):
        error, speed, time = math.pi, 0.0, 0.0
        while abs(error) > left and time < 5.0:
            last, speed = speed, rate(error, 1.8, 3.2, speed, 0.05)
            error -= 0.05 * speed
            time += 0.05
            assert rate is turning_speed or abs(speed - last) <= 3.2 * 0.05 + 1e-12
        # a command is held for a period: the speed is up to one period ahead of the ramp, and the end up to three behind
        assert expected - 0.1 <= time <= expected + 0.15


# --- limits over random cycles ----------------------------------------------------------------------------------------


def random_cycles(controller: Any, cycles: int, seed: int) -> list[Twist2D]:
    """Commands of a robot that follows random paths; None of them is checked here."""
    rng = np.random.default_rng(seed)
    pose, velocity, out = Pose2D(0.0, 0.0), Twist2D(), list[Twist2D]()
    for cycle in range(cycles):
        if cycle % 25 == 0:
            turns = np.cumsum(rng.normal(0.0, 0.15, 40)) + rng.uniform(-math.pi, math.pi)
            xy = np.cumsum(np.column_stack((np.cos(turns), np.sin(turns))) * 0.05, axis=0)
            poses = np.column_stack(
                (pose.x + xy[:, 0], pose.y + xy[:, 1], [normalize_angle(t) for t in turns.tolist()])
            )
            controller.set_plan(Path(poses, "odom"), Pose2D(*poses[-1].tolist()))
        costmap = local_costmap(pose)
        try:
            velocity = controller.compute_command(ControlInput(RobotState(pose, velocity), costmap, FOOTPRINT)).command
        except ControlError:
            velocity = Twist2D()
        out.append(velocity)
        pose = driven(pose, velocity, 0.05)
    return out


def test_the_dynamic_window_keeps_every_limit() -> None:
    controller = pursuit(use_dynamic_window=True)
    commands = random_cycles(controller, 1500, 3)
    p = controller.params
    for last, now in pairwise(commands):
        assert 0.0 <= now.vx <= p.max_linear_vel + 1e-12
        assert p.min_angular_vel - 1e-12 <= now.wz <= p.max_angular_vel + 1e-12
        assert abs(now.vx - last.vx) <= p.max_linear_accel * 0.05 + 1e-9
        assert abs(now.wz - last.wz) <= p.max_angular_accel * 0.05 + 1e-9


@pytest.mark.parametrize("cls", [GracefulController, RotationShim])
def test_speeds_are_limited(cls: Any) -> None:
    controller = cls(cls.Params(sections={"goal_checker": FAR}))
    limits = controller.limits
    for now in random_cycles(controller, 600, 5):
        assert limits.min_vel_x - 1e-9 <= now.vx <= limits.max_vel_x + 1e-9
        assert abs(now.wz) <= limits.max_vel_theta + 1e-9


# --- graceful ---------------------------------------------------------------------------------------------------------


def settings() -> Any:
    controller: Any = GracefulController(GracefulParams())
    p = controller._law.copy()
    assert p.dtype == LAW
    p["slowdown_radius"] = 1.5
    return p[0]


def test_the_control_law() -> None:
    p = settings()
    v, w = law(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, False, p)
    assert (v, w) == (pytest.approx(1.0 / 3.0), 0.0)
    assert law(0.2, 0.0, 0.0, 0.0, 0.0, 0.0, False, p)[0] == pytest.approx(0.1)
    v, w = law(1.0, 0.0, 0.0, 0.0, 0.0, 0.1, False, p)
    assert w / v == pytest.approx(-0.3995, abs=1e-4)
    v, w = law(1.0, 0.0, 0.5, 0.0, 0.0, 0.0, False, p)
    assert w / v == pytest.approx(-math.pi / 4.0)
    for delta, phi in np.random.default_rng(2).uniform(-3.0, 3.0, (50, 2)).tolist():
        a = law(1.0, 0.0, phi, 0.0, 0.0, delta, False, p)
        b = law(1.0, 0.0, -phi, 0.0, 0.0, -delta, False, p)
        assert a == (pytest.approx(b[0]), pytest.approx(-b[1]))


def test_cruise_is_the_highest_speed() -> None:
    """In Nav2 it is v_linear_max * max_lookahead / slowdown_radius, 0.333 m/s (G1)."""
    controller = GracefulController(GracefulParams(sections={"goal_checker": FAR}))
    assert command(controller, [(0.05 * i, 0.0, 0.0) for i in range(39)], Pose2D(0.0, 0.0)).vx == pytest.approx(0.5)


# --- parameters -------------------------------------------------------------------------------------------------------

PURSUIT = {"base_local_planner": "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"}
SHIM = {"base_local_planner": "nav2_rotation_shim_controller::RotationShimController"}
GRACEFUL = {"base_local_planner": "nav2_graceful_controller::GracefulController"}


@pytest.mark.parametrize(
    ("tree", "rule"),
    [
        ({**PURSUIT, "FollowPath": {"allow_reversing": True}}, "turn-or-reverse"),
        ({**PURSUIT, "FollowPath": {"min_turning_r": 0.5}}, "turn-in-place"),
        ({**PURSUIT, "FollowPath": {"min_turning_r": 2.0, "use_rotate_to_heading": False}}, "turning-radius"),
        ({**PURSUIT, "FollowPath": {"lookahead_dist": 9.0}}, "carrot-beyond-path"),
        ({**PURSUIT, "FollowPath": {"lookahead_dist": 0.03}}, "short-lookahead"),
        ({**PURSUIT, "FollowPath": {"interpolate_curvature_after_goal": True}}, "no-second-carrot"),
        ({**SHIM, "FollowPath": {"angular_dist_threshold": 0.5}}, "no-primary-controller"),
        ({**SHIM, "FollowPath": {"primary_controller": {"plugin": "rotation_shim"}}}, "shim-in-shim"),
        ({**GRACEFUL, "FollowPath": {"allow_backward": True}}, "turn-or-reverse"),
        ({**GRACEFUL, "FollowPath": {"v_linear_min": 0.9}}, "minimum-over-maximum"),
    ],
)
def test_combinations_that_do_not_work_are_named(tree: dict[str, Any], rule: str) -> None:
    found = check_parameters(["turtlebot", tree])
    assert rule in [f.rule for f in found], [f.rule for f in found]

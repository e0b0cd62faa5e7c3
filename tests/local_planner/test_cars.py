"""Regulated pure pursuit on a car: its turning radius with acceleration limits, and braking after a cancel."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from navstack.core import LETHAL, ControlError, Path, Pose2D, RobotState, Twist2D, normalize_angle
from navstack.local_planner.regulated_pure_pursuit import Window, held_to_radius
from navstack.plugins import ControlInput
from navstack.testing.doubles import FOOTPRINT, driven, local_costmap
from tests.local_planner.test_followers import pursuit

CAR = {
    "use_rotate_to_heading": False,
    "allow_reversing": True,
    "use_dynamic_window": True,
    "max_linear_accel": 1.0,
    "max_linear_decel": -1.5,
    "max_angular_accel": 1.2,
    "max_angular_decel": -2.5,
}


def random_cycles(controller: Any, cycles: int, seed: int) -> list[Twist2D]:
    """Commands of a robot that follows random paths."""
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


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.4, 0.85, 2.0])
def test_a_car_keeps_its_turning_radius_and_every_acceleration(radius: float) -> None:
    """Random paths, half of them behind the robot."""
    controller = pursuit(**CAR, min_turning_r=radius)
    p = controller.params
    commands = random_cycles(controller, 2000, 7)
    assert min(c.vx for c in commands) < -0.1 and max(c.vx for c in commands) > 0.1
    for now in commands:
        assert abs(now.wz) * radius <= abs(now.vx) + 1e-9
        assert -p.max_linear_vel - 1e-9 <= now.vx <= p.max_linear_vel + 1e-9
    for last, now in pairwise(commands):
        if now == Twist2D():
            continue  # at the goal it is commanded to stand
        for before, after, up, down in (
            (last.vx, now.vx, 1.0, 1.5),
            (last.wz, now.wz, 1.2, 2.5),
        ):
            faster = abs(after) > abs(before) and before * after >= 0.0
            limit = up if faster else max(up, down)
            assert abs(after - before) <= limit * 0.05 + 1e-9


@pytest.mark.slow
@settings(deadline=None, max_examples=300)
@given(
    radius=st.floats(0.2, 3.0),
    last_v=st.floats(-1.0, 1.0),
    share=st.floats(-1.0, 1.0),
    v_change=st.floats(0.01, 0.3),
    w_change=st.floats(0.01, 0.3),
    at=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
)
@example(radius=2.0, last_v=1.0, share=1.0, v_change=0.25, w_change=0.25, at=(1.0, 1.0))
def test_the_radius_can_be_held_from_every_velocity_that_holds_it(
    radius: float, last_v: float, share: float, v_change: float, w_change: float, at: tuple[float, float]
) -> None:
    """The result holds the radius and is within reach, wherever in the window the wanted velocity is.

    Tolerance of the radius: a share of 1e-12 that `held_to_radius` grants to the rounding of a velocity on the tightest arc.
    """
    last_w = share * abs(last_v) / radius
    window = Window(last_v - v_change, last_v + v_change, last_w - w_change, last_w + w_change)
    v = window.v_min + at[0] * 2.0 * v_change
    w = window.w_min + at[1] * 2.0 * w_change
    held_v, held_w = held_to_radius(v, w, last_v, window, radius)
    assert abs(held_w) * radius <= abs(held_v) * (1.0 + 2e-12) + 1e-12
    assert window.v_min - 1e-9 <= held_v <= window.v_max + 1e-9
    assert window.w_min - 1e-9 <= held_w <= window.w_max + 1e-9


# --- braking after a cancel -------------------------------------------------------------------------------------------


def driving(last: Twist2D, **values: Any) -> tuple[Any, ControlInput]:
    """A controller whose last command is `last`, and what it sees."""
    controller = pursuit(**{"use_cancel_deceleration": True, "cancel_deceleration": 0.5} | values)
    poses = np.column_stack((np.arange(40) * 0.05, np.zeros(40), np.zeros(40)))
    controller.set_plan(Path(poses, "odom"), Pose2D(1.95, 0.0))
    controller.take_over(last)
    pose = Pose2D(0.0, 0.0)
    return controller, ControlInput(RobotState(pose, last), local_costmap(pose), FOOTPRINT)


@pytest.mark.parametrize("speed", [0.4, -0.4])
def test_braking_is_linear_and_stays_on_the_arc(speed: float) -> None:
    """From v with a: v / (a P) commands; the robot drives v² / 2a less v P / 2; the curvature remains."""
    controller, inputs = driving(Twist2D(speed, 0.0, 0.2))
    commands: list[Twist2D] = []
    while (plan := controller.brake(inputs)) is not None:
        assert plan.mode == "brake" and "braking with 0.5 m/s²" in plan.notes[0]
        commands.append(plan.command)
    assert [c.vx for c in commands] == pytest.approx(math.copysign(1.0, speed) * np.arange(0.375, 0.0, -0.025))
    assert [c.wz / c.vx for c in commands] == pytest.approx([0.2 / speed] * len(commands))
    way = sum(c.vx for c in commands) * 0.05
    assert abs(way) == pytest.approx(0.4**2 / (2.0 * 0.5) - 0.4 * 0.05 / 2.0)


def test_a_turn_in_place_is_braked_at_once() -> None:
    controller, inputs = driving(Twist2D(0.0, 0.0, -1.2), max_angular_decel=-4.0)
    turns: list[float] = []
    while (plan := controller.brake(inputs)) is not None:
        turns.append(plan.command.wz)
    assert turns == pytest.approx([-1.0, -0.8, -0.6, -0.4, -0.2])


def test_it_stops_at_once_without_the_parameter_and_before_an_obstacle() -> None:
    controller, inputs = driving(Twist2D(0.4), use_cancel_deceleration=False)
    assert controller.brake(inputs) is None
    controller, inputs = driving(Twist2D(0.4))
    g = inputs.costmap.geometry
    cell = g.world_to_cell(0.3, 0.0)
    assert cell is not None
    inputs.costmap.data[cell[1], cell[0]] = LETHAL
    assert controller.brake(inputs) is None


def test_angular_braking_has_a_limit_of_its_own() -> None:
    """In a dynamic window: speeding up by max_angular_accel, slowing down by max_angular_decel."""
    controller = pursuit(**{**CAR, "max_angular_decel": -0.4, "max_angular_accel": 3.0})
    commands = random_cycles(controller, 600, 3)
    slower = [
        abs(last.wz) - abs(now.wz)
        for last, now in pairwise(commands)
        if now != Twist2D() and last.wz * now.wz > 1e-6 and abs(now.wz) < abs(last.wz)
    ]
    assert max(slower) <= 0.4 * 0.05 + 1e-9
    assert controller.limits.acc_lim_theta == 0.4

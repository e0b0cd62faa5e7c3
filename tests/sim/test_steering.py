"""Steered bodies: a car and a tricycle against closed forms of their circles, clothoids and lags."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from navstack.core import Footprint, Pose2D, Twist2D
from navstack.sim import SimParams, SimulatedRobot, World

BOX = Footprint(((-0.2, -0.2), (0.7, -0.2), (0.7, 0.2), (-0.2, 0.2)))
L = 0.5
DT = 0.01


def body(kinematics: str = "tricycle", **more: Any) -> SimParams:
    values = {"wheelbase": L, "max_steering_angle": 0.6, "physics_frequency": 1.0 / DT, **more}
    return SimParams(kinematics=kinematics, **values)  # pyright: ignore[reportArgumentType]


def robot(params: SimParams) -> SimulatedRobot:
    return SimulatedRobot(params, World(None), BOX, Pose2D(0.0, 0.0))


def clothoid(v: float, rate: float, t: float) -> tuple[float, float, float]:
    """Pose after `t` s at rear speed `v` while the wheel turns at `rate` from 0: yaw = -v ln(cos(rate t)) / (L rate)."""

    def yaw(s: float) -> float:
        return -v * math.log(math.cos(rate * s)) / (L * rate)

    return quad(lambda s: v * math.cos(yaw(s)), 0, t)[0], quad(lambda s: v * math.sin(yaw(s)), 0, t)[0], yaw(t)


# --- circles ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("v", [0.8, -0.8])
@pytest.mark.parametrize("w", [0.5, -0.5])
def test_a_tricycle_follows_the_commanded_turning_rate(v: float, w: float) -> None:
    it = robot(body())
    it.command(Twist2D(v, 0.0, w))
    samples = it.advance_to(4.0)
    assert it.steering_angle == pytest.approx(math.atan(L * w / v))
    assert it.state().velocity == pytest.approx((v, 0.0, w))
    assert np.hypot(samples[:, 0], samples[:, 1] - v / w) == pytest.approx(abs(v / w), abs=1e-5)


@settings(deadline=None, max_examples=30)
@given(
    kinematics=st.sampled_from(("ackermann", "tricycle")),
    limit=st.floats(0.1, 1.2),
    speed=st.floats(0.1, 2.0),
    sign=st.sampled_from((1.0, -1.0)),
    wheelbase=st.floats(0.2, 3.0),
)
def test_the_tightest_circle_has_the_turning_radius(
    kinematics: str, limit: float, speed: float, sign: float, wheelbase: float
) -> None:
    params = body(kinematics, max_steering_angle=limit, wheelbase=wheelbase)
    assert params.turning_radius == pytest.approx(wheelbase / math.tan(limit))
    it = robot(params)
    it.command(Twist2D(sign * speed, 0.0, 100.0))
    it.advance_to(1.0)
    velocity = it.state().velocity
    assert abs(velocity.vx / velocity.wz) == pytest.approx(params.turning_radius, rel=1e-9)
    assert it.steering_angle == pytest.approx(sign * limit)


# --- steering rate and lag --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("v", [0.4, -0.4])
def test_a_wheel_that_turns_at_its_rate_drives_a_clothoid(v: float) -> None:
    """The angle of a step is that at its end: half a step early, 0.8 m/s tan(0.54) / 0.5 m * 5 ms = 2.4 mrad at most."""
    it = robot(body("ackermann", max_steering_rate=0.3))
    it.command(Twist2D(v, 0.0, math.copysign(9.0, v)))
    samples = it.advance_to(1.8)
    for step in (60, 120, 180):
        expected = clothoid(v, 0.3, step * DT)
        assert samples[step - 1, :3] == pytest.approx(expected, abs=2.5e-3)
    assert it.steering_angle == pytest.approx(0.54)


def test_the_clothoid_is_approached_with_the_step() -> None:
    """Half of the step, half of the error."""
    errors: list[float] = []
    for frequency in (50.0, 100.0, 200.0):
        it = robot(body("ackermann", max_steering_rate=0.3, physics_frequency=frequency))
        it.command(Twist2D(0.4, 0.0, 9.0))
        it.advance_to(1.8)
        x, y, _ = clothoid(0.4, 0.3, 1.8)
        errors.append(math.hypot(it.pose.x - x, it.pose.y - y))
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.02)
    assert errors[1] / errors[2] == pytest.approx(2.0, rel=0.02)


def test_the_steering_has_a_lag_of_its_own() -> None:
    it = robot(body("ackermann", steering_lag=0.3, velocity_lag=0.0))
    it.command(Twist2D(0.4, 0.0, 0.2))
    samples = it.advance_to(1.0)
    angle = math.atan(0.25) * (1.0 - np.exp(-np.arange(1, 101) * DT / 0.3))
    assert samples[:, 6] == pytest.approx(0.4)
    assert samples[:, 8] == pytest.approx(0.4 * np.tan(angle) / L)


@settings(deadline=None, max_examples=40)
@given(
    kinematics=st.sampled_from(("ackermann", "tricycle")),
    commands=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-3.0, 3.0)), min_size=1, max_size=6),
    rate=st.floats(0.05, 3.0),
    lag=st.floats(0.0, 0.5),
    limit=st.floats(0.1, 1.2),
)
def test_no_command_exceeds_a_limit_of_the_steering(
    kinematics: str, commands: list[tuple[float, float]], rate: float, lag: float, limit: float
) -> None:
    params = body(kinematics, max_steering_rate=rate, steering_lag=lag, max_steering_angle=limit, acc_lim_x=1.0)
    it = robot(params)
    angles, driven = [0.0], [0.0]
    for k, (v, w) in enumerate(commands):
        it.command(Twist2D(v, 0.0, w))
        for step in range(20):
            it.advance_to(0.2 * k + (step + 1) * DT)
            velocity = it.state().velocity
            assert velocity.vy == 0.0
            assert abs(velocity.vx) >= params.turning_radius * abs(velocity.wz) - 1e-9
            angles.append(it.steering_angle)
            driven.append(velocity.vx if kinematics == "ackermann" else velocity.vx / math.cos(it.steering_angle))
    assert np.abs(angles).max() <= limit + 1e-12
    assert np.abs(np.diff(angles)).max() <= rate * DT + 1e-12
    assert np.abs(np.diff(driven)).max() <= 1.0 * DT + 1e-9


# --- turning in place -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kinematics", ["ackermann", "tricycle"])
def test_a_steered_base_does_not_move_in_place(kinematics: str) -> None:
    it = robot(body(kinematics))
    it.command(Twist2D(0.0, 0.5, 1.0))
    it.advance_to(2.0)
    assert it.pose == Pose2D(0.0, 0.0, 0.0)


def test_a_tricycle_whose_wheel_turns_by_a_quarter_turn_turns_about_its_rear_axle() -> None:
    params = body(max_steering_angle=0.5 * math.pi)
    assert params.turning_radius == 0.0
    it = robot(params)
    it.command(Twist2D(0.0, 0.0, -0.5))
    it.advance_to(2.0)
    assert it.pose == pytest.approx((0.0, 0.0, -1.0), abs=1e-9)


def test_a_tricycle_waits_for_its_wheel() -> None:
    """The front wheel turns at 1 rad/s towards a quarter turn; it drives by the cosine of the angle that is left."""
    it = robot(body(max_steering_angle=0.5 * math.pi, max_steering_rate=1.0))
    it.command(Twist2D(0.0, 0.0, 0.5))
    samples = it.advance_to(2.0)
    steered = np.minimum(np.arange(1, 201) * DT, 0.5 * math.pi)
    rim = 0.5 * L * np.cos(0.5 * math.pi - steered)
    assert samples[:, 6] == pytest.approx(rim * np.cos(steered), abs=1e-12)
    assert samples[:, 8] == pytest.approx(rim * np.sin(steered) / L, abs=1e-12)


def test_a_command_of_the_angle_gives_the_speed_of_the_driven_wheel() -> None:
    it = robot(body(steering_command="angle"))
    it.command(Twist2D(0.4, 0.0, 0.5))
    it.advance_to(0.1)
    assert it.state().velocity == pytest.approx((0.4 * math.cos(0.5), 0.0, 0.4 * math.sin(0.5) / L))


def test_a_car_cannot_be_driven_at_a_quarter_turn() -> None:
    with pytest.raises(ValueError, match=r"less than pi / 2.*use tricycle"):
        body("ackermann", max_steering_angle=0.5 * math.pi)


def test_a_blocked_tricycle_accelerates_again_from_rest() -> None:
    it = SimulatedRobot(body(acc_lim_x=1.0), World(None, [(1.2, 0.0, 0.2)]), BOX, Pose2D(0.0, 0.0))
    it.command(Twist2D(0.5))
    it.advance_to(2.0)
    assert it.in_collision and it.state().velocity.vx == 0.0
    it.command(Twist2D(-0.5))
    it.advance_to(2.1)
    assert it.state().velocity.vx == pytest.approx(-0.1)

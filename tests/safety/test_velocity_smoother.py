"""Closed forms of the velocity smoother."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navstack.core import InputError, RobotState, Twist2D
from navstack.parameters import VelocitySmootherParams
from navstack.safety import VelocitySmoother
from navstack.safety import velocity_smoother as kernels

F = 20.0


def run(params: dict[str, Any], commands: dict[int, Twist2D], steps: int) -> list[Twist2D | None]:
    """The outputs of ticks 0, 1, .. with commands that arrive just before some of them."""
    node = VelocitySmoother(VelocitySmootherParams(**params))
    out: list[Twist2D | None] = []
    for k in range(steps):
        if k in commands:
            node.command(commands[k], k / F)
        step = node.step(k / F)
        out.append(None if step is None else step.twist)
    return out


def test_nothing_is_sent_before_the_first_command() -> None:
    assert run({}, {}, 3) == [None, None, None]
    assert VelocitySmoother(VelocitySmootherParams()).due == math.inf


@pytest.mark.parametrize(
    ("accel", "wanted"), [(2.5, [0.125, 0.25, 0.375, 0.5, 0.5]), (3.0, [0.15, 0.30, 0.45, 0.5, 0.5])]
)
def test_a_step_from_rest(accel: float, wanted: list[float]) -> None:
    out = run({"max_accel": [accel, 0.0, 3.2]}, {0: Twist2D(0.5)}, 5)
    assert [t.vx for t in out if t] == pytest.approx(wanted)


def test_braking_takes_four_ticks_and_375_mm() -> None:
    out = run({}, {0: Twist2D(0.5), 4: Twist2D()}, 9)
    braking = [t.vx for t in out[4:8] if t]
    assert braking == pytest.approx([0.375, 0.25, 0.125, 0.0])
    assert sum(braking) / F == pytest.approx(0.0375)


def test_scaling_keeps_the_direction_of_the_change() -> None:
    params = {"scale_velocities": True, "max_velocity": [0.5, 0.0, 2.5]}
    out = [t for t in run(params, {0: Twist2D(0.5, 0.0, 1.0)}, 7) if t]
    assert out[0].vx == pytest.approx(0.08)
    assert out[0].wz == pytest.approx(0.16)
    assert all(t.vx / t.wz == pytest.approx(0.5) for t in out)
    plain = [t for t in run({}, {0: Twist2D(0.5, 0.0, 1.0)}, 1) if t]
    assert plain[0] == pytest.approx((0.125, 0.0, 0.16))


def test_scaling_keeps_arcs_at_the_velocity_limits() -> None:
    # Nav2 clips each axis by itself before it scales: 0.5 / 1.0 instead of 1.0 / 1.0
    command = {k: Twist2D(1.0, 0.0, 1.0) for k in range(40)}
    out = [t for t in run({"scale_velocities": True}, command, 40) if t]
    assert out[-1] == pytest.approx((0.5, 0.0, 0.5))
    assert all(t.vx == pytest.approx(t.wz) for t in out)
    nav2 = [t for t in run({"scale_velocities": True, "nav2_compatible": True}, command, 40) if t]
    assert nav2[-1] == pytest.approx((0.5, 0.0, 1.0))


def test_a_tick_through_zero_brakes_first_then_accelerates() -> None:
    params = {"max_accel": [1.0, 0.0, 3.2], "max_decel": [-4.0, 0.0, -3.2]}
    commands = {0: Twist2D(0.1), 4: Twist2D(-0.5)}
    out = [t for t in run(params, commands, 6) if t]
    # 0.1 m/s are lost in 25 ms, and the other 25 ms gain 0.025 m/s
    assert out[4].vx == pytest.approx(-0.025)
    nav2 = [t for t in run({**params, "nav2_compatible": True}, commands, 6) if t]
    assert nav2[4].vx == pytest.approx(-0.1)


def test_the_timeout_brakes_sends_one_zero_and_falls_silent() -> None:
    out = run({}, {0: Twist2D(0.5)}, 30)
    speeds = [None if t is None else t.vx for t in out]
    assert speeds[3:21] == pytest.approx([0.5] * 18)  # 20 ticks are 1.0 s: not yet too old
    assert speeds[21:26] == [pytest.approx(0.375), pytest.approx(0.25), pytest.approx(0.125), 0.0, None]
    assert speeds[25:] == [None] * 5


def test_a_new_command_ends_the_silence() -> None:
    node = VelocitySmoother(VelocitySmootherParams())
    node.command(Twist2D(0.5), 0.0)
    for k in range(40):
        node.step(k / F)
    assert node.due == math.inf
    node.command(Twist2D(0.5), 7.0)
    assert node.due == 7.0
    step = node.step(7.0)
    # after a pause, one step changes the velocity by at most two periods' worth
    assert step is not None
    assert step.twist.vx == pytest.approx(0.25)


def test_deadband_in_open_loop_starts() -> None:
    out = [t for t in run({"deadband_velocity": [0.2, 0.0, 0.0]}, {0: Twist2D(0.5)}, 4) if t]
    assert [t.vx for t in out] == pytest.approx([0.0, 0.25, 0.375, 0.5])


@pytest.mark.parametrize(("nav2", "moves"), [(False, True), (True, False)])
def test_deadband_in_closed_loop_starts(nav2: bool, moves: bool) -> None:
    params = VelocitySmootherParams(
        feedback="CLOSED_LOOP", deadband_velocity=[0.2, 0.0, 0.0], odom_duration=0.0, nav2_compatible=nav2
    )
    node, velocity = VelocitySmoother(params), Twist2D()
    for k in range(10):
        node.command(Twist2D(0.5), k / F)
        node.observe(RobotState(pose=_origin(), velocity=velocity, stamp=k / F))
        step = node.step(k / F)
        assert step is not None
        velocity = step.twist
    assert (velocity.vx == pytest.approx(0.5)) == moves


def _origin() -> Any:
    from navstack.core import Pose2D

    return Pose2D(0.0, 0.0)


def test_closed_loop_averages_the_odometry() -> None:
    node = VelocitySmoother(VelocitySmootherParams(feedback="CLOSED_LOOP", odom_duration=0.1))
    for k, v in enumerate((9.0, 0.1, 0.2, 0.3)):  # the first one is older than the window
        node.observe(RobotState(_origin(), Twist2D(v), 0.2 * (k == 0) * 0 + (0.0 if k == 0 else 1.0 + 0.05 * k)))
    node.command(Twist2D(0.2), 1.2)
    step = node.step(1.2)
    assert step is not None
    assert step.twist.vx == pytest.approx(0.2)


@pytest.mark.parametrize("bad", [Twist2D(math.nan), Twist2D(0.0, math.inf), Twist2D(0.0, 0.0, -math.inf)])
def test_a_command_that_is_not_finite_has_no_effect(bad: Twist2D) -> None:
    node = VelocitySmoother(VelocitySmootherParams())
    node.command(Twist2D(0.5), 0.0)
    with pytest.raises(InputError, match="not finite"):
        node.command(bad, 0.1)
    assert node.step(0.0) is not None


def test_six_axes_use_x_y_and_yaw() -> None:
    lists = {
        "max_velocity": [0.5, 0.1, 9.0, 9.0, 9.0, 1.0],
        "min_velocity": [-0.5, -0.1, -9.0, -9.0, -9.0, -1.0],
        "max_accel": [2.5, 2.0, 9.0, 9.0, 9.0, 3.2],
        "max_decel": [-2.5, -2.0, -9.0, -9.0, -9.0, -3.2],
        "deadband_velocity": [0.0] * 6,
    }
    out = [t for t in run(lists, {k: Twist2D(9.0, 9.0, 9.0) for k in range(30)}, 30) if t]
    assert out[-1] == pytest.approx((0.5, 0.1, 1.0))


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        (Twist2D(0.5), "max_accel 2.5 of x"),
        (Twist2D(0.1), ""),
        (Twist2D(0.0, 0.0, -0.5), "max_accel 3.2 of yaw"),
        (Twist2D(0.0, 0.3), "max_velocity 0 of y"),
    ],
)
def test_reasons(command: Twist2D, reason: str) -> None:
    node = VelocitySmoother(VelocitySmootherParams())
    node.command(command, 0.0)
    step = node.step(0.0)
    assert step is not None
    assert step.reason == reason


velocity = st.floats(-2.0, 2.0)
limit = st.just(0.0) | st.floats(0.01, 3.0)


@given(current=velocity, command=velocity, accel=limit, decel=limit, dt=st.floats(0.001, 0.2))
def test_reachable_velocity(current: float, command: float, accel: float, decel: float, dt: float) -> None:
    out = kernels.reachable(current, command, accel, decel, dt)
    assert min(current, command) - 1e-12 <= out <= max(current, command) + 1e-12
    assert abs(out - current) <= max(accel, decel) * dt + 1e-12
    mirrored = kernels.reachable(-current, -command, accel, decel, dt)
    assert mirrored == -out
    # time to get there: braking to zero, then accelerating
    if out != command:
        spent = 0.0
        if current * out < 0.0:
            spent = abs(current) / decel + abs(out) / accel
        elif abs(out) < abs(current):
            spent = (abs(current) - abs(out)) / decel
        elif accel > 0.0:
            spent = (abs(out) - abs(current)) / accel
        if accel > 0.0 and decel > 0.0:
            assert spent == pytest.approx(dt, rel=1e-6, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [False, True])
def test_limits_hold_over_a_million_random_commands(scale: bool) -> None:
    rng = np.random.default_rng(17)
    commands = rng.uniform(-4.0, 4.0, (1_000_000, 3))
    commands[rng.random(len(commands)) < 0.1] = 0.0
    limits = np.array(
        [[0.5, 0.3, 2.0], [-0.3, -0.2, -1.5], [1.0, 0.8, 2.0], [-1.5, -1.2, -3.0], [0.0, 0.0, 0.0]], np.float64
    )
    dt = 1.0 / F
    out = np.zeros_like(commands)
    kernels.smooth_stream(commands, limits, dt, scale, out)
    assert (out <= limits[0]).all()
    assert (out >= limits[1]).all()
    before = np.vstack((np.zeros((1, 3)), out[:-1]))
    # time that the change needs in closed form: brake with decel while the speed falls, accelerate while it rises
    same = before * out >= 0.0
    falls = np.where(same, np.maximum(np.abs(before) - np.abs(out), 0.0), np.abs(before))
    rises = np.where(same, np.maximum(np.abs(out) - np.abs(before), 0.0), np.abs(out))
    needed = falls / -limits[3] + rises / limits[2]
    assert needed.max() <= dt * (1.0 + 1e-9)
    assert needed.max() > dt * (1.0 - 1e-9)


def test_a_constant_command_is_reached_exactly_and_kept() -> None:
    out = [t for t in run({}, {k: Twist2D(0.37, 0.0, -0.9) for k in range(30)}, 30) if t]
    ticks = max(math.ceil(0.37 * F / 2.5), math.ceil(0.9 * F / 3.2))
    assert all(t == Twist2D(0.37, 0.0, -0.9) for t in out[ticks - 1 :])
    assert out[ticks - 2] != out[ticks - 1]

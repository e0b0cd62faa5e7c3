"""The chain of multiplexer, velocity smoother and collision monitor."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError, Twist2D
from navstack.explain.command import chain_sentence
from navstack.parameters import VelocitySmootherParams
from navstack.record import RecordedCommand, recorded_command
from navstack.record.commands import CommandBuffer
from navstack.safety import CommandChain, CommandStep, VelocitySmoother
from tests.safety.rig import ScriptedRobot, monitor, scan_of, square, zone

STOP = zone(action_type="stop", points=square(0.4))


def test_a_chain_without_parts_passes_commands_on() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot)
    assert chain.tick(0.0) is None
    chain.command(Twist2D(0.5))
    assert chain.due == 0.0
    step = chain.tick(0.0)
    assert step is not None
    assert robot.commands == [Twist2D(0.5)]
    assert (step.source, step.changed_by, step.reason) == ("navigation", "", "")
    assert chain.tick(0.1) is None


def test_teleop_overrides_and_then_stops_the_robot() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot)
    assert chain.send("teleop", Twist2D(0.2), 0.0)
    assert not chain.send("navigation", Twist2D(0.5), 0.1)
    chain.tick(0.1)
    assert robot.commands == [Twist2D(0.2)]
    assert chain.due == pytest.approx(0.5)
    chain.tick(0.51)  # teleop is silent, and the navigation drives with its next command
    assert robot.commands[-1] == Twist2D()
    assert chain.send("navigation", Twist2D(0.5), 0.6)
    chain.tick(0.6)
    assert robot.commands[-1] == Twist2D(0.5)
    with pytest.raises(InputError, match='no input "gamepad"'):
        chain.send("gamepad", Twist2D(), 0.0)


def test_the_whole_chain_after_the_controller_was_killed() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot, smoother=VelocitySmoother(VelocitySmootherParams()))
    driven, t = 0.0, 0.0
    for k in range(60):
        t = 0.05 * k
        if k <= 10:
            chain.send("navigation", Twist2D(0.5), t)
        chain.tick(t)
        if k > 10:
            driven += 0.05 * robot.commands[-1].vx
    # 1.0 s at 0.5 m/s, then a ramp of 37.5 mm, and at most one more tick
    assert 0.5 + 0.0375 - 1e-9 <= driven <= 0.5 + 0.0375 + 0.025 + 1e-9
    assert robot.commands[-1] == Twist2D()
    assert len(robot.commands) == 10 + 1 + 20 + 4


def test_steps_say_who_changed_a_command_and_why() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot, smoother=VelocitySmoother(VelocitySmootherParams()), monitor=monitor({"Stop": STOP}))
    robot.data = [scan_of((1.0, 0.0))]
    chain.scans()
    chain.send("navigation", Twist2D(0.5), 0.0)
    step = chain.tick(0.0)
    assert step is not None
    assert step.changed_by == "velocity_smoother"
    assert step.reason == "velocity_smoother: max_accel 2.5 of x"
    robot.data = [scan_of((0.3, 0.0), stamp=0.05)]
    robot.frames.set("odom", "base", robot.frames.lookup("odom", "base"), 0.05)
    chain.scans()
    step = chain.tick(0.05)
    assert step is not None
    assert (step.changed_by, step.action, step.sent) == ("collision_monitor", "stop", Twist2D())
    assert step.as_dict()["zone"] == "Stop"
    assert "1 point in the zone Stop, the nearest at (0.30, 0.00) m from the base" in step.reason
    assert [s.time for s in chain.take_steps()] == [0.0, 0.05]
    assert chain.take_steps() == []


def test_the_last_command_is_checked_again_while_the_robot_drives() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot, monitor=monitor({"Stop": STOP}))
    robot.data = [scan_of((1.0, 0.0))]
    chain.scans()
    chain.send("navigation", Twist2D(0.5), 0.0)
    chain.tick(0.0)
    assert chain.due == pytest.approx(0.05)
    robot.data = [scan_of((0.3, 0.0), stamp=0.0)]
    chain.scans()
    chain.tick(0.05)
    assert robot.commands == [Twist2D(0.5), Twist2D()]


def test_halt_stops_without_a_ramp() -> None:
    robot = ScriptedRobot()
    chain = CommandChain(robot, smoother=VelocitySmoother(VelocitySmootherParams()))
    chain.send("navigation", Twist2D(0.5), 0.0)
    chain.tick(0.0)
    chain.halt(0.01)
    assert robot.commands[-1] == Twist2D()
    assert chain.tick(0.1) is None


# --- the monitor holds the robot: the smoother does not wind up ------------------------------------------------------


def held(action: str, **values: Any) -> CommandChain:
    smoother = VelocitySmoother(VelocitySmootherParams(max_velocity=[1.0, 0.0, 2.5]))  # 2.5 m/s², 20 Hz: 0.125 a step
    circle = zone(type="circle", radius=0.6, action_type=action, **values)
    return CommandChain(ScriptedRobot(), smoother=smoother, monitor=monitor({"z": circle}, base_shift_correction=False))


def drive(chain: CommandChain, steps: range, twist: Twist2D, *points: tuple[float, float]) -> list[CommandStep]:
    """The steps of a chain at 20 Hz with a command and the points of a scan."""
    made: list[CommandStep] = []
    for k in steps:
        now = 0.05 * k
        robot = chain.robot
        assert isinstance(robot, ScriptedRobot)
        robot.data.append(scan_of(*points, stamp=now))
        chain.scans()
        chain.send("navigation", twist, now)
        step = chain.tick(now)
        assert step is not None
        made.append(step)
    return made


@pytest.mark.parametrize(
    ("action", "values", "held_at"),
    [
        ("stop", {}, 0.0),
        ("limit", {"linear_limit": 0.25}, 0.25),
        ("slowdown", {"slowdown_ratio": 0.25}, 0.25),
        ("approach", {"time_before_collision": 1.0}, 0.1),
    ],
)
def test_a_held_robot_speeds_up_within_the_limits_when_it_is_let_go(
    action: str, values: dict[str, Any], held_at: float
) -> None:
    chain = held(action, **values)
    forward = Twist2D(1.0)
    holding = drive(chain, range(40), forward, (0.7, 0.0) if action == "approach" else (0.5, 0.0))
    assert holding[-1].sent.vx == pytest.approx(held_at)
    if action != "slowdown":
        assert holding[-1].smoothed.vx == pytest.approx(held_at + 0.125)  # one step ahead, not the whole command
    free = drive(chain, range(40, 60), forward, (5.0, 0.0))
    speeds = [held_at, *(step.sent.vx for step in free)]
    assert max(b - a for a, b in itertools.pairwise(speeds)) <= 0.125 + 1e-9
    assert speeds[-1] == 1.0
    assert len([v for v in speeds if v < 1.0]) <= math.ceil((1.0 - held_at) / 0.125) + 1
    if action == "slowdown":
        assert free[0].changed_by == "velocity_smoother"
        assert "release: max_accel 2.5 of x after the collision monitor" in free[0].reason
        assert "velocity_smoother: max_accel 2.5 of x after" in chain_sentence(recorded(free[0]))
    # a stop is at once
    stop = drive(chain, range(60, 61), forward, (0.5, 0.0), (0.19, 0.0))
    assert stop[0].sent.vx <= 0.25 + 1e-9


def recorded(step: CommandStep) -> RecordedCommand:
    buffer = CommandBuffer()
    buffer.add(step)
    return recorded_command(buffer.table().array()[0])


def test_nav2_compatible_winds_up() -> None:
    circle = zone(type="circle", radius=0.6, action_type="stop")
    smoother = VelocitySmoother(VelocitySmootherParams())
    as_nav2 = monitor({"z": circle}, nav2_compatible=True, base_shift_correction=False)
    chain = CommandChain(ScriptedRobot(), smoother=smoother, monitor=as_nav2)
    assert drive(chain, range(20), Twist2D(0.5), (0.5, 0.0))[-1].smoothed == Twist2D(0.5)
    assert drive(chain, range(20, 21), Twist2D(0.5), (5.0, 0.0))[0].sent == Twist2D(0.5)


@pytest.mark.slow
def test_speeding_up_stays_within_the_limits_whatever_comes_and_goes() -> None:
    rng = np.random.default_rng(7)
    chain = held("slowdown", slowdown_ratio=0.3)
    before = Twist2D()
    twist, points = Twist2D(), [(5.0, 0.0)]
    for k in range(2000):
        if rng.random() < 0.2:
            twist = Twist2D(float(rng.uniform(-1.0, 1.0)), 0.0, float(rng.uniform(-2.5, 2.5)))
        if rng.random() < 0.2:
            points = [(float(rng.choice([0.5, 5.0])), 0.0)]
        sent = drive(chain, range(k, k + 1), twist, *points)[0].sent
        for axis, limit in ((0, 2.5), (2, 3.2)):
            was = abs(before[axis]) if before[axis] * sent[axis] > 0.0 else 0.0
            assert abs(sent[axis]) <= was + 0.05 * limit + 1e-9, (k, before, sent)
        before = sent

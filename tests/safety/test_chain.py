"""The chain of multiplexer, velocity smoother and collision monitor."""

from __future__ import annotations

import pytest

from navstack.core import Twist2D
from navstack.core.errors import InputError
from navstack.parameters.models.velocity_smoother import VelocitySmootherParams
from navstack.safety import CommandChain, VelocitySmoother
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

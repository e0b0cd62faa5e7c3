"""The wheels of the simulated robot: limits, encoders, odometry, wrong radii, against closed forms."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.core import Footprint, ParameterError, Pose2D, Twist2D
from navstack.core.kinematics import METHODS, WheelOdometry
from navstack.parameters import load_configuration
from navstack.parameters.models.sim import WheelParams
from navstack.sim import SimParams, SimulatedRobot, World
from navstack.sim.body import wheel_drive

SEPARATION, RADIUS = 0.23, 0.035


def robot(
    kinematics: str = "differential", *, world: World | None = None, sim: dict[str, Any] | None = None, **wheels: Any
) -> SimulatedRobot:
    params = SimParams(kinematics=kinematics, wheels=WheelParams(**({"drive": "differential"} | wheels)), **(sim or {}))  # type: ignore[arg-type]
    return SimulatedRobot(params, world or World(), Footprint.from_radius(0.18), Pose2D(0.0, 0.0))


def test_unlimited_wheels_drive_as_a_base_without() -> None:
    """A circle of 1 m at 0.5 m/s: wheels at v -+ wz d / 2; the pose is exact, not that of the midpoint rule."""
    it = robot()
    it.command(Twist2D(0.5, 0.0, 0.5))
    it.advance_to(0.5 * math.pi / 0.5)
    left, right = it.wheel_speeds
    assert left * RADIUS == pytest.approx(0.5 - 0.5 * SEPARATION / 2)
    assert right * RADIUS == pytest.approx(0.5 + 0.5 * SEPARATION / 2)
    angle = 0.5 * it.time
    assert it.pose == pytest.approx((math.sin(angle), 1.0 - math.cos(angle), angle), abs=1e-9)
    assert it.state().pose == pytest.approx(it.pose, abs=1e-12)
    assert it.encoder_ticks == ()


def test_a_wheel_at_its_limit_slows_the_base_down_on_its_arc() -> None:
    it = robot(max_speed=10.0)  # 0.35 m/s at the rim
    it.command(Twist2D(0.5, 0.0, 2.0))
    it.advance_to(0.1)
    v = it.state().velocity
    assert max(map(abs, it.wheel_speeds)) == pytest.approx(10.0)
    assert v.wz / v.vx == pytest.approx(2.0 / 0.5)
    assert v.vx == pytest.approx(0.5 * 0.35 / (0.5 + 2.0 * SEPARATION / 2))


def test_wheels_accelerate_within_their_limit() -> None:
    """20 rad/s² are 0.7 m/s² at the rim: 0.35 m/s after half a second, in either direction."""
    it = robot(max_acceleration=20.0)
    it.command(Twist2D(0.5))
    it.advance_to(0.5)
    assert it.state().velocity.vx == pytest.approx(0.35, abs=1e-9)
    it.advance_to(2.0)
    it.command(Twist2D(0.0, 0.0, 3.0))
    last = np.array(it.wheel_speeds)
    for k in range(1, 70):
        it.advance_to(2.0 + 0.02 * k)
        now = np.array(it.wheel_speeds)
        assert np.abs(now - last).max() <= 20.0 * 0.02 + 1e-9
        last = now
    assert it.state().velocity == pytest.approx((0.0, 0.0, 3.0), abs=1e-9)


@pytest.mark.parametrize(
    ("kinematics", "wheels"),
    [("differential", {}), ("holonomic", {"drive": "omni"}), ("holonomic", {"drive": "mecanum"})],
)
def test_encoders_count_what_wheel_odometry_integrates(kinematics: str, wheels: dict[str, Any]) -> None:
    """The simulator's odometry is that of `WheelOdometry` fed with its counts; both are within a few ticks of the truth."""
    it = robot(kinematics, ticks_per_revolution=2578.33, **wheels)
    drive = wheel_drive(it.params)
    assert drive is not None
    odometry = WheelOdometry(drive, it.params.wheels.meters_per_tick)
    odometry.update(it.encoder_ticks, 0.0)
    for k in range(1, 200):
        side = 0.1 if kinematics == "holonomic" else 0.0
        it.command(Twist2D(0.4 * math.sin(0.02 * k), side, math.cos(0.03 * k)))
        it.advance_to(0.02 * k)
        odometry.update(it.encoder_ticks, it.time)
    assert it.state().pose == pytest.approx(odometry.pose, abs=1e-9)
    tick = it.params.wheels.meters_per_tick
    assert it.state().pose.distance_to(it.pose) < 20.0 * tick
    assert it.state().pose != it.pose


@pytest.mark.parametrize("method", METHODS)
def test_methods_of_integration(method: str) -> None:
    """A quarter circle of 1 m in 157 steps of 0.02 s at 0.5 rad/s: the error of the method, from its closed form."""
    it = robot(integration=method)
    it.command(Twist2D(0.5, 0.0, 0.5))
    it.advance_to(3.14)
    a = 0.5 * 0.02
    bound = {"exact": 0.0, "rk2": math.sqrt(2.0) * a * a / 24.0, "euler": 0.5 * math.sqrt(2.0) * a}[method]
    assert it.state().pose.distance_to(it.pose) == pytest.approx(bound, rel=0.01, abs=1e-9)


def test_unequal_wheels_drive_a_circle_that_the_odometry_does_not_see() -> None:
    """Radii r and 1.01 r: the true curvature is 2 (1.01 - 1) / (d (1.01 + 1)), the odometry drives straight."""
    it = robot(radius_errors=[0.0, 0.01])
    it.command(Twist2D(0.5))
    it.advance_to(2.0)
    assert it.state().pose == pytest.approx((1.0, 0.0, 0.0), abs=1e-9)
    assert it.pose.yaw == pytest.approx(1.0 * 0.01 / SEPARATION, rel=1e-6)
    assert it.distance_travelled == pytest.approx(1.005, rel=1e-4)


def test_blocked_wheels_stop_and_count_no_further() -> None:
    it = robot(world=World(None, [(0.68, 0.0, 0.1)]), ticks_per_revolution=1000.0)
    it.command(Twist2D(0.5))
    it.advance_to(5.0)
    assert it.pose.x == pytest.approx(0.4, abs=0.01)
    tick = it.params.wheels.meters_per_tick
    assert it.encoder_ticks[0] * tick == pytest.approx(it.pose.x, abs=0.011)
    assert it.state().pose.x == pytest.approx(it.pose.x, abs=0.011)


def test_the_yaml_describes_the_wheels() -> None:
    sim = {"kinematics": "holonomic", "wheels": {"drive": "mecanum", "separation": 0.4, "max_speed": 12.0}}
    loaded = load_configuration(["turtlebot", {"navstack": {"sim": sim}}]).navstack.sim
    assert loaded.wheels.count == 4
    assert (loaded.wheels.separation, loaded.wheels.radius) == (0.4, 0.035)
    for wrong, message in (
        ({"wheels": {"drive": "omni"}}, "moves a holonomic base, but kinematics is differential"),
        ({"wheels": {"drive": "differential", "radius_errors": [0.1]}}, "1 errors for 2 wheels"),
        ({"wheels": {"drive": "tracks"}}, "drive"),
        ({"wheels": {"radius": 0.0}}, "radius"),
        ({"kinematics": "holonomic", "wheels": {"drive": "omni", "angles": [0.0, 0.0, 1.0]}}, "different positions"),
    ):
        with pytest.raises(ParameterError, match=message):
            load_configuration(["turtlebot", {"navstack": {"sim": wrong}}])

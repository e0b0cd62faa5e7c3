"""Kinematics against closed forms: round trips, limits, circles, encoders."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from navstack.core import (
    DifferentialDrive,
    InputError,
    MecanumDrive,
    OmniDrive,
    Pose2D,
    Twist2D,
    WheelDrive,
    angle_between,
    integrate,
)
from navstack.core.kinematics import METHODS, AckermannDrive, WheelOdometry

SPEED = st.floats(-3.0, 3.0)
DRIVES: list[WheelDrive] = [
    DifferentialDrive(0.23),
    OmniDrive(0.17),
    OmniDrive(0.2, (0.7, 2.2, -2.4, -0.7)),
    MecanumDrive(0.4, 0.3),
]
drives = pytest.mark.parametrize("drive", DRIVES, ids=lambda d: f"{type(d).__name__}-{len(d.names)}")


def test_differential_drive_is_the_textbook_formula() -> None:
    d = 0.23
    left, right = DifferentialDrive(d).wheel_speeds(Twist2D(0.5, 0.0, 1.2))
    assert left == pytest.approx(0.5 - 1.2 * d / 2, abs=1e-15)
    assert right == pytest.approx(0.5 + 1.2 * d / 2, abs=1e-15)
    twist = DifferentialDrive(d).twist((0.3, 0.4))
    assert twist == pytest.approx(((0.4 + 0.3) / 2, 0.0, (0.4 - 0.3) / d), abs=1e-12)


@pytest.mark.slow
@drives
@given(vx=SPEED, vy=SPEED, wz=SPEED)
def test_velocities_survive_the_round_trip(drive: WheelDrive, vx: float, vy: float, wz: float) -> None:
    twist = Twist2D(vx, vy if drive.sideways else 0.0, wz)
    assert drive.twist(drive.wheel_speeds(twist)) == pytest.approx(twist, abs=1e-12)


@pytest.mark.slow
@drives
@given(vx=SPEED, wz=SPEED, limit=st.floats(0.01, 2.0))
def test_a_limited_velocity_keeps_its_direction(drive: WheelDrive, vx: float, wz: float, limit: float) -> None:
    twist = Twist2D(vx, 0.3 if drive.sideways else 0.0, wz)
    limited = drive.limited(twist, limit)
    assert np.abs(drive.wheel_speeds(limited)).max() <= limit * (1.0 + 1e-12)
    assert twist.vx * limited.wz == pytest.approx(twist.wz * limited.vx, abs=1e-9)


def test_three_omni_wheels_sideways_and_turning() -> None:
    """Wheels at 60, 180 and -60 degrees: pure rotation turns all alike; forward drives the rear wheel not at all."""
    drive = OmniDrive(0.2)
    assert drive.wheel_speeds(Twist2D(0.0, 0.0, 1.5)) == pytest.approx([0.3, 0.3, 0.3])
    s = math.sin(math.pi / 3)
    assert drive.wheel_speeds(Twist2D(1.0)) == pytest.approx([-s, 0.0, s], abs=1e-15)
    assert drive.wheel_speeds(Twist2D(0.0, 1.0)) == pytest.approx([0.5, -1.0, 0.5])


def test_wheels_that_do_not_determine_the_motion_are_refused() -> None:
    with pytest.raises(InputError, match="do not determine"):
        OmniDrive(0.2, (0.0, math.pi))
    with pytest.raises(InputError, match="wheel_separation = 0 must be a positive length"):
        DifferentialDrive(0.0)


@given(speed=st.floats(0.1, 2.0), sign=st.sampled_from((1.0, -1.0)), steering=st.floats(-0.6, 0.6))
def test_a_car_survives_the_round_trip(speed: float, sign: float, steering: float) -> None:
    car = AckermannDrive(0.5, 0.4, 0.6)
    twist = car.twist(sign * speed, steering)
    assert car.steering(twist) == pytest.approx(steering, abs=1e-12)
    rear = car.rear_axle().twist(car.rear_wheel_speeds(twist))
    assert rear == pytest.approx(twist, abs=1e-9)


def test_ackermann_condition_and_turning_radius() -> None:
    car = AckermannDrive(0.5, 0.4, 0.6)
    angles = car.front_wheels(0.4)
    assert 1.0 / math.tan(angles.right) - 1.0 / math.tan(angles.left) == pytest.approx(0.4 / 0.5)
    assert angles.left > angles.center > angles.right
    assert car.front_wheels(0.0) == (0.0, 0.0, 0.0)
    assert car.turning_radius == pytest.approx(0.5 / math.tan(0.6))
    assert car.steering(Twist2D(0.0, 0.0, 1.0)) is None
    assert car.steering(Twist2D(0.1, 0.0, 1.0)) is None
    assert car.steering(Twist2D()) == 0.0


# --- odometry ---------------------------------------------------------------------------------------------------------


def circle(steps: int, method: str) -> Pose2D:
    """A circle of 1 m radius in `steps` steps."""
    pose = Pose2D(0.0, 0.0)
    for _ in range(steps):
        pose = integrate(pose, Twist2D(1.0, 0.0, 1.0), 2.0 * math.pi / steps, method)  # type: ignore[arg-type]
    return pose


def quarter(steps: int, method: str) -> float:
    """Error (m) at the end of a quarter of that circle, which ends at (1, 1)."""
    pose = Pose2D(0.0, 0.0)
    for _ in range(steps):
        pose = integrate(pose, Twist2D(1.0, 0.0, 1.0), 0.5 * math.pi / steps, method)  # type: ignore[arg-type]
    return pose.distance_to(Pose2D(1.0, 1.0))


@pytest.mark.parametrize("steps", [1, 3, 50])
def test_the_exact_integral_closes_a_circle_in_any_number_of_steps(steps: int) -> None:
    assert circle(steps, "exact").distance_to(Pose2D(0.0, 0.0)) < 1e-12
    assert quarter(steps, "exact") < 1e-12


def test_orders_of_the_three_methods() -> None:
    """Halving the step: Euler's error is halved, the midpoint rule's divided by four."""
    assert quarter(100, "euler") / quarter(200, "euler") == pytest.approx(2.0, rel=0.02)
    assert quarter(100, "rk2") / quarter(200, "rk2") == pytest.approx(4.0, rel=0.02)
    # error of the midpoint rule: a² / 24 of the length of each step, here of the distance to the start
    a = 0.5 * math.pi / 100
    assert quarter(100, "rk2") == pytest.approx(math.sqrt(2.0) * a * a / 24.0, rel=1e-3)


@given(wz=st.floats(-2.0, 2.0), vx=SPEED, vy=SPEED, dt=st.floats(0.0, 1.0))
def test_exact_steps_compose(wz: float, vx: float, vy: float, dt: float) -> None:
    start, twist = Pose2D(1.0, -2.0, 0.5), Twist2D(vx, vy, wz)
    half = integrate(integrate(start, twist, 0.5 * dt), twist, 0.5 * dt)
    whole = integrate(start, twist, dt)
    assert half.distance_to(whole) < 1e-12
    assert abs(angle_between(half.yaw, whole.yaw)) < 1e-12


@pytest.mark.parametrize("method", METHODS)
def test_encoder_odometry_has_the_error_of_a_tick_and_of_its_method(method: str) -> None:
    """A quarter circle of 1 m at 20 Hz: with 2578 ticks per meter the ticks cost less than 1 mm."""
    drive, per_tick = DifferentialDrive(0.23), 2.0 * math.pi * 0.035 / 2578.33 * 4.0
    odometry = WheelOdometry(drive, per_tick, method=method)  # type: ignore[arg-type]
    twist, steps = Twist2D(0.5, 0.0, 0.5), 63
    dt = math.pi / steps
    rims = np.cumsum(np.tile(drive.wheel_speeds(twist) * dt, (steps, 1)), axis=0)
    odometry.update([0, 0], 0.0)
    for k, ticks in enumerate(np.floor(rims / per_tick).astype(np.int64), 1):
        odometry.update(ticks, k * dt)
    error = odometry.pose.distance_to(Pose2D(1.0, 1.0, 0.5 * math.pi))
    a = 0.5 * dt
    bound = {"exact": 0.0, "rk2": math.sqrt(2.0) * a * a / 24.0, "euler": 0.5 * math.sqrt(2.0) * a}[method]
    # one tick more on one wheel than on the other turns the base by per_tick / d
    ticks = per_tick + 1.5 * per_tick / drive.wheel_separation
    assert error <= 1.05 * bound + ticks
    if method == "euler":
        assert error > 0.9 * bound - ticks
    assert odometry.velocity.vx == pytest.approx(0.5, abs=per_tick / dt)


def test_wrong_counts_are_refused() -> None:
    odometry = WheelOdometry(DifferentialDrive(0.23), 1e-4)
    with pytest.raises(InputError, match="3 counts for 2 wheels"):
        odometry.update([0, 0, 0], 0.0)
    odometry.update([0, 0], 1.0)
    with pytest.raises(InputError, match="before the last one"):
        odometry.update([1, 1], 0.5)

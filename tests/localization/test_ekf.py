"""The odometry filter: closed forms, defective inputs, rejected outliers, late measurements."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import ImuReading, InputError, Pose2D, Transform2D, Twist2D
from navstack.localization.ekf import Ekf, FilteredOdometry
from navstack.parameters import default_filter
from navstack.parameters.models.ekf import STATES, EkfParams

Array = NDArray[np.float64]
SMALL = np.diag([1e-4, 1e-4, 1e-4])


def config(*names: str) -> list[bool]:
    return [state in names for state in STATES]


def make(**params: Any) -> Ekf:
    return Ekf(EkfParams(**params))


def wheels_and_gyro(**params: Any) -> Ekf:
    return make(odom0_config=config("vx", "vy", "vyaw"), imu0_config=config("vyaw"), **params)


def reasons(ekf: Ekf) -> list[str]:
    return [i.reason for i in ekf.innovations if not i.accepted]


def test_batch_least_squares_gives_the_same_state() -> None:
    """On a straight line the filter is linear: its last state is that of the least squares over all states at once."""
    rng = np.random.default_rng(4)
    ekf = make(odom0_config=config("x", "vx"), process_noise_covariance=[0.1] * 15)
    ekf.set_pose(Pose2D(0.0, 0.0, 0.0), np.diag([0.3, 0.1, 1e-9]), 0.0)
    noise, steps = 0.1, 30
    prior = np.diag(ekf.covariance)[[0, 3, 6]]
    rows: list[Array] = [np.zeros((3, 3 * (steps + 1)))]
    rows[0][:, :3] = np.diag(1.0 / np.sqrt(prior))
    right: list[Array] = [np.zeros(3)]
    last = 0.0
    for k in range(1, steps + 1):
        stamp = last + rng.uniform(0.02, 0.3)
        dt, last = stamp - last, stamp
        x, v = rng.normal(0.5 * stamp, 0.1), rng.normal(0.5, 0.2)
        ekf.add_odometry(
            "odom0", stamp, Pose2D(x, 0.0), np.diag([0.01, 1.0, 1.0]), Twist2D(v), np.diag([0.04, 1.0, 1.0])
        )
        process = np.zeros((3, 3 * (steps + 1)))
        process[:, 3 * k - 3 : 3 * k] = [[1.0, dt, 0.5 * dt * dt], [0.0, 1.0, dt], [0.0, 0.0, 1.0]]
        process[:, 3 * k : 3 * k + 3] = -np.eye(3)
        rows.append(process / math.sqrt(noise * dt))
        right.append(np.zeros(3))
        measured = np.zeros((2, 3 * (steps + 1)))
        measured[0, 3 * k], measured[1, 3 * k + 1] = 1.0 / 0.1, 1.0 / 0.2
        rows.append(measured)
        right.append(np.array([x / 0.1, v / 0.2]))
    matrix, target = np.concatenate(rows), np.concatenate(right)
    solution = np.linalg.lstsq(matrix, target, rcond=None)[0]
    np.testing.assert_allclose(ekf.state[[0, 3, 6]], solution[-3:], rtol=0.0, atol=1e-9)
    covariance = np.linalg.inv(matrix.T @ matrix)[-3:, -3:]
    np.testing.assert_allclose(ekf.covariance[np.ix_((0, 3, 6), (0, 3, 6))], covariance, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("rate", [10.0, 50.0])
def test_circle(rate: float) -> None:
    """A constant twist drives a circle; the prediction is a step of Euler's, so its radius is off by half a step's turn."""
    ekf = wheels_and_gyro()
    v, w, t = 0.5, 0.4, 0.0
    steps = round(2.0 * math.pi / w * rate)
    for k in range(steps + 1):
        t = k / rate
        ekf.add_odometry("odom0", t, Pose2D(0.0, 0.0), SMALL, Twist2D(v, 0.0, w), SMALL)
    turned = w * t
    x, y = v / w * math.sin(turned), v / w * (1.0 - math.cos(turned))
    # a chord along the heading at its begin: off sideways by v w dt² / 2 per step, which closes over a circle to v dt / 2
    assert math.hypot(ekf.pose.x - x, ekf.pose.y - y) < 2.0 * v / rate
    assert math.remainder(ekf.pose.yaw - turned, 2.0 * math.pi) == pytest.approx(0.0, abs=1e-6)


def test_the_gyro_corrects_slipping_wheels() -> None:
    ekf = wheels_and_gyro()
    rough = np.diag([1e-4, 1e-4, 4e-2])
    for k in range(500):
        t = 0.02 * k
        ekf.add_odometry("odom0", t, Pose2D(0.0, 0.0), rough, Twist2D(0.5, 0.0, 0.35), rough)
        ekf.add_imu("imu0", t + 0.004, (0.0, 1.0), (0.2, 1e-5))
    assert ekf.twist.wz == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize("key", ["differential", "relative"])
def test_poses_of_another_start(key: str) -> None:
    """A source that starts elsewhere, used by its motion: by differences, or relative to its first pose."""
    ekf = make(pose0_config=config("x", "y", "yaw"), **{f"pose0_{key}": True})
    for k in range(400):
        t = 0.05 * k
        x, y = 10.0 - 0.5 * t * math.sin(0.3), -4.0 + 0.5 * t * math.cos(0.3)
        ekf.add_pose("pose0", t, Pose2D(x, y, math.pi / 2 + 0.3), SMALL)
    assert ekf.pose.x == pytest.approx(0.5 * 0.05 * 399, abs=0.05)
    assert ekf.pose.y == pytest.approx(0.0, abs=0.05)
    assert ekf.twist.vx == pytest.approx(0.5, abs=0.01)


def test_defective_inputs_leave_the_state_alone() -> None:
    ekf = wheels_and_gyro()
    twist = Twist2D(0.5, 0.0, 0.1)
    for k in range(20):
        ekf.add_odometry("odom0", k / 10, Pose2D(0.0, 0.0), SMALL, twist, SMALL)
    state, covariance, stamp = ekf.state, ekf.covariance, ekf.stamp
    assert stamp == pytest.approx(1.9)

    def send(at: float, vx: float = 0.5, spread: Array = SMALL) -> bool:
        return ekf.add_odometry("odom0", at, Pose2D(0.0, 0.0), SMALL, Twist2D(vx, 0.0, 0.1), spread)

    assert not send(math.nan)
    assert not send(1.9)
    assert not send(1.0)
    assert not send(2e5)
    assert not send(2.0, math.nan)
    assert not send(2.01, 1e30)
    assert not send(2.02, 0.5, np.full((3, 3), np.nan))
    assert not send(2.03, 0.5, np.full((3, 3), np.inf))
    assert not ekf.add_imu("imu0", 1.2, (0.0, 1.0), (0.1, 1e-4))
    assert [reason.split(":")[0] for reason in reasons(ekf)] == [
        "its stamp is nan",
        "a second message of 1.9 s",
        "out of order",
        "its stamp is 2e+05 s from the filter's",
        "a value or a variance is NaN",
        "a value is beyond 1e+07",
        "a value or a variance is NaN",
        "no usable element",
        "stale",
    ]
    np.testing.assert_array_equal(ekf.state, state)
    np.testing.assert_array_equal(ekf.covariance, covariance)
    assert ekf.stamp == stamp
    assert send(2.1)


def test_an_outlier_is_rejected_with_its_distance() -> None:
    ekf = make(odom0_config=config("vx", "vyaw"), odom0_twist_rejection_threshold=4.0)
    for k in range(50):
        ekf.add_odometry("odom0", 0.1 * k, Pose2D(0.0, 0.0), SMALL, Twist2D(0.5), SMALL)
    assert not ekf.add_odometry("odom0", 5.0, Pose2D(0.0, 0.0), SMALL, Twist2D(2.5), SMALL)
    last = ekf.innovations[-1]
    assert last.distance > 4.0
    assert last.reason.startswith("outlier: Mahalanobis distance")
    assert ekf.add_odometry("odom0", 5.1, Pose2D(0.0, 0.0), SMALL, Twist2D(0.5), SMALL)


def test_innovations_are_kept() -> None:
    ekf = make(odom0_config=config("vx"))
    ekf.add_odometry("odom0", 0.0, Pose2D(0.0, 0.0), SMALL, Twist2D(0.5), SMALL)
    ekf.add_odometry("odom0", 0.1, Pose2D(0.0, 0.0), SMALL, Twist2D(0.6), SMALL)
    innovation = ekf.innovations[-1]
    assert innovation.source == "odom0 twist"
    assert innovation.differences[3] == pytest.approx(0.1)
    assert np.count_nonzero(innovation.differences) == 1


def test_a_late_measurement_counts_at_its_own_time() -> None:
    """With a history, late messages give the state of messages in order."""
    on_time = wheels_and_gyro(smooth_lagged_data=True, history_length=2.0)
    late = wheels_and_gyro(smooth_lagged_data=True, history_length=2.0)
    rng = np.random.default_rng(1)
    messages = [(0.05 * k, rng.normal(0.5, 0.1), rng.normal(0.3, 0.05)) for k in range(60)]
    for t, v, w in messages:
        on_time.add_odometry("odom0", t, Pose2D(0.0, 0.0), SMALL, Twist2D(v, 0.0, w), SMALL)
        on_time.add_imu("imu0", t + 0.02, (0.0, 1.0), (w, 1e-4))
    delayed: list[tuple[float, float]] = []
    for t, v, w in messages:
        late.add_odometry("odom0", t, Pose2D(0.0, 0.0), SMALL, Twist2D(v, 0.0, w), SMALL)
        delayed.append((t + 0.02, w))
        if len(delayed) > 4:
            stamp, rate = delayed.pop(0)
            assert late.add_imu("imu0", stamp, (0.0, 1.0), (rate, 1e-4))
    for stamp, rate in delayed:
        late.add_imu("imu0", stamp, (0.0, 1.0), (rate, 1e-4))
    np.testing.assert_allclose(late.state, on_time.state, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(late.covariance, on_time.covariance, rtol=1e-9, atol=1e-15)


def test_prediction_does_not_change_the_filter() -> None:
    ekf = wheels_and_gyro()
    ekf.add_odometry("odom0", 0.0, Pose2D(0.0, 0.0), SMALL, Twist2D(1.0), SMALL)
    state, covariance = ekf.predicted(0.5)
    assert state[0] == pytest.approx(0.5)
    assert covariance[0, 0] > ekf.covariance[0, 0]
    assert ekf.pose.x == 0.0


@pytest.mark.slow
def test_covariances_stay_positive_definite() -> None:
    """Random inputs of every kind and size; `tools/fuzz_ekf.py` runs a million."""
    file = Path(__file__).resolve().parents[2] / "tools" / "fuzz_ekf.py"
    spec = importlib.util.spec_from_file_location("fuzz_ekf", file)
    assert spec is not None and spec.loader is not None
    fuzz = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(fuzz)
    used, least = fuzz.run(3000, seed=3)
    assert used > 1500
    assert least > 0.0


def test_inputs_that_are_not_configured() -> None:
    with pytest.raises(InputError, match="no input: set odom0_config"):
        make()
    with pytest.raises(InputError, match='no input "imu7"; known: odom0, imu0'):
        wheels_and_gyro().add_imu("imu7", 0.0, (0.0, 1.0), (0.0, 1.0))


@pytest.mark.parametrize("shape", ["circle", "square"])
def test_wheels_and_gyroscope_close_circles_and_squares(shape: str) -> None:
    """The filter of `odometry: ekf` follows exact wheels, and by its gyroscope wheels that turn 5 % too far, to where they began.

    Circle: 1 m radius. Square: sides of 1 m, driven at 0.5 m/s, turns in place at 0.5 rad/s. The filter is of the first order in
    the steps of 0.02 s: it lags behind a change of the velocity by at most two of them, 0.02 m and 0.02 rad.
    """
    dt = 0.02
    if shape == "circle":
        twists = [(0.5, 0.5)] * round(4.0 * math.pi / dt)
    else:
        twists = ([(0.5, 0.0)] * round(2.0 / dt) + [(0.0, 0.5)] * round(math.pi / dt)) * 4
    for error in (1.0, 1.05):
        odometry = FilteredOdometry(default_filter())
        odometry.start(0.0, Transform2D())
        wheels = truth = Transform2D()
        off: list[float] = []
        for k, (v, w) in enumerate(twists, 1):
            truth, wheels = (
                pose @ Transform2D(v * dt * math.cos(0.5 * w * dt), v * dt * math.sin(0.5 * w * dt), w * dt * scale)
                for pose, scale in ((truth, 1.0), (wheels, error))
            )
            reading = ImuReading((0.0, 0.0, 0.0, 1.0), w, k * dt - 0.001)
            found = odometry.run([wheels], [k * dt], [reading])[0]
            off.append(math.hypot(found.x - truth.x, found.y - truth.y))
        assert max(off) < 0.02
        assert truth.x == pytest.approx(0.0, abs=0.02)
        if error > 1.0:  # without the gyroscope, the error of the heading is 5 % of a full turn
            assert math.hypot(wheels.x - truth.x, wheels.y - truth.y) > 0.1

"""robot_pose_ekf compared with the C++, step by step over 90 s, with dropouts of either sensor.

Tolerances: states 1e-9, the sum of 2,700 relative motions in double precision (1e-13 where it was recorded); covariances 1e-9:
the prior of 1e6 leaves them quantized to 1e-10.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.localization.pose_ekf import RobotPoseEkf
from tests.conftest import golden_ros1_files

MODES = ("odom_only", "odom_imu", "imu_dropout", "odom_dropout")
CASES = [(file, mode) for file in golden_ros1_files("robot_pose_ekf*.npz") for mode in MODES]
IMU_DELAY_S = 0.004


def messages(data: dict[str, NDArray[Any]], mode: str) -> list[tuple[float, bool, NDArray[Any]]]:
    """Every message with its arrival, in order; the odometry first on a tie."""
    missing = {"imu_dropout": True, "odom_dropout": False}.get(mode)
    found: list[tuple[float, bool, NDArray[Any]]] = []
    for is_imu, rows, delay in ((False, data["odom"], 0.0), (True, data["imu"], IMU_DELAY_S)):
        if is_imu and mode == "odom_only":
            continue
        kept = rows if missing is not is_imu else rows[(rows[:, 0] <= 30.0) | (rows[:, 0] >= 45.0)]
        found += [(round(float(row[0]) + delay, 9), is_imu, row) for row in kept]
    return sorted(found, key=lambda m: (m[0], m[1]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "mode"), CASES or [(Path(), "")], ids=[f"{f.stem}-{m}" for f, m in CASES] or ["no data"]
)
def test_robot_pose_ekf(file: Path, mode: str) -> None:
    if not mode:
        pytest.skip("no golden data of ROS 1: set NAVSTACK_GOLDEN_ROS1 to their folder")
    with np.load(file) as archive:
        data = {key: archive[key] for key in archive.files}
    steps, covariances = data[f"{mode}/steps"], data[f"{mode}/cov"]
    ekf, queue = RobotPoseEkf(), messages(data, mode)
    found: list[list[float]] = []
    variances: list[NDArray[Any]] = []
    position = 0
    for spin in range(round(float(steps[:, 0].max()) * 30.0) + 1):
        now = spin / 30.0
        while position < len(queue) and queue[position][0] <= now + 1e-9:
            arrival, is_imu, row = queue[position]
            add = ekf.add_imu if is_imu else ekf.add_odometry
            assert add(float(row[0]), row[1:4], np.diag(row[4:7]), arrival)
            position += 1
        step = ekf.step(now)
        if step is not None:
            flags = float(step.odometry), float(step.imu), float(step.sensors_agree)
            found.append([now, step.stamp, *flags, *step.state])
            variances.append(step.covariance)
    np.testing.assert_allclose(np.array(found), steps, rtol=0.0, atol=1e-9)
    # the first row is recorded as 0; the height has no measurement and grows by 1e6 per step
    measured = np.ix_((0, 1, 3, 4, 5), (0, 1, 3, 4, 5))
    rows = slice(1, None) if mode != "odom_only" else slice(2, None)
    for own, expected in list(zip(variances, covariances, strict=True))[rows]:
        seen = np.diag(own)[[0, 1, 3, 4, 5]] < 1.0  # without an IMU, roll and pitch are not measured
        both = np.outer(seen, seen)
        np.testing.assert_allclose(own[measured][both], expected[measured][both], rtol=0.0, atol=1e-9)


def test_defective_messages_are_rejected_and_leave_the_state_alone() -> None:
    ekf = RobotPoseEkf()
    variances = np.diag([1e-3, 1e-3, 3e-2])
    before = None
    for k in range(20):
        assert ekf.add_odometry(0.05 * k, np.array([0.02 * k, 0.0, 0.0]), variances, 0.05 * k)
        before = ekf.step(0.05 * k)
    assert before is not None
    assert ekf.step(0.95) is None
    assert not ekf.add_odometry(1.0, np.array([np.nan, 0.0, 0.0]), variances, 1.0)
    assert not ekf.add_odometry(0.95, np.array([5.0, 0.0, 0.0]), variances, 1.0)
    assert not ekf.add_odometry(0.5, np.array([5.0, 0.0, 0.0]), variances, 1.0)
    assert not ekf.add_odometry(1.0, np.array([5.0, 0.0, 0.0]), np.zeros((3, 3)), 1.0)
    assert not ekf.add_imu(1.0, np.array([0.0, 0.0, np.inf]), variances, 1.0)
    assert [reason.split(" at ")[0] for _, reason in ekf.rejections] == ["the odometry"] * 4 + ["the IMU"]
    assert ekf.step(1.0) is None
    assert ekf.add_odometry(1.0, np.array([0.4, 0.0, 0.0]), variances, 1.0)
    step = ekf.step(1.0)
    assert step is not None
    assert step.state[0] == pytest.approx(before.state[0] + 0.02, abs=1e-9)

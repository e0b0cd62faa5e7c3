"""The recorded drives of amcl: errors compared with those of the real node, and drives with a drift that it does not survive.

Drives, runs and maps are found by name in NAVSTACK_GOLDEN_ROS1. The parameters are amcl's of the recording; `learn_odometry` is
navstack's default. A run is held if the last 20 estimates are within 0.5 m and 0.3 rad. Errors count from t = 20 s on, as in
amcl_stats.json.
"""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from navstack.core import GridGeometry, LaserScan, OccupancyGrid, Pose2D, Transform2D
from navstack.localization import Amcl
from navstack.parameters import AmclParams
from tests.conftest import golden_ros1_files

Array = NDArray[Any]
PARAMS: dict[str, Any] = {
    "laser_max_beams": 60,
    "min_particles": 500,
    "max_particles": 3000,
    "kld_err": 0.05,
    "laser_z_hit": 0.5,
    "laser_z_short": 0.05,
    "laser_z_rand": 0.5,
    "update_min_d": 0.25,
    "update_min_a": 0.2,
    "resample_interval": 1,
    "recovery_alpha_slow": 0.0,
    "recovery_alpha_fast": 0.0,
}
START_ERROR = (0.2, -0.15, 0.1)
START_COVARIANCE = np.diag([0.25, 0.25, (math.pi / 12.0) ** 2])
SETTLED_S = 20.0
SEEDS = (1, 2, 3)
NONE = [(Path(), "")]


class Errors(NamedTuple):
    """Position error of a run."""

    rms: float
    p95: float
    held: bool


def drives() -> list[tuple[Path, str]]:
    return [
        (file, key.removeprefix("scan_params_"))
        for file in golden_ros1_files("amcl_drive_*.npz")
        for key in sorted(read(file))
        if key.startswith("scan_params_")
    ]


@lru_cache(maxsize=4)
def read(file: Path) -> dict[str, Array]:
    with np.load(file) as data:
        return {key: data[key] for key in data.files}


@lru_cache(maxsize=2)
def grid_of(name: str) -> OccupancyGrid:
    data = read(golden_ros1_files("amcl_maps.npz")[0])
    resolution, x, y = data[f"{name}_info"].tolist()
    cells = np.ascontiguousarray(data[name])
    return OccupancyGrid(cells, GridGeometry(cells.shape[1], cells.shape[0], resolution, x, y))


def with_drift(odometry: Array, turn: float) -> Array:
    """Return odometry (n, 3) that turns by `turn` (rad/m) more."""
    poses = [Transform2D(*odometry[0].tolist())]
    for before, after in zip(odometry[:-1].tolist(), odometry[1:].tolist(), strict=True):
        step = Transform2D(*before).inverse() @ Transform2D(*after)
        half = Transform2D(0.0, 0.0, 0.5 * turn * math.hypot(step.x, step.y))
        poses.append(poses[-1] @ half @ step @ half)
    return np.array(poses)


def errors_of(times: Array, estimates: Array, truth: Array) -> Errors:
    error = np.hypot(estimates[:, 0] - truth[:, 0], estimates[:, 1] - truth[:, 1])
    yaw = np.abs(np.remainder(estimates[:, 2] - truth[:, 2] + np.pi, 2.0 * np.pi) - np.pi)
    settled = error[times >= SETTLED_S]
    held = bool((error[-20:] < 0.5).all() and (yaw[-20:] < 0.3).all())
    return Errors(math.sqrt(float(np.square(settled).mean())), float(np.quantile(settled, 0.95)), held)


def localize(file: Path, laser: str, seed: int, drift: float = 0.0) -> Errors:
    data = read(file)
    odometry = with_drift(data["odom"], drift) if drift else data["odom"]
    angle_min, increment, nearest, farthest, ahead = data[f"scan_params_{laser}"].tolist()
    amcl = Amcl(AmclParams(**PARAMS), seed=seed)
    amcl.set_map(grid_of(file.stem.split("_")[2]))
    amcl.set_pose(Pose2D(*(data["truth"][0] + START_ERROR).tolist()), START_COVARIANCE, math.inf)
    rows: list[int] = []
    poses: list[Pose2D] = []
    for k, scan in enumerate(data[f"scan_{laser}"]):
        ranges = np.where(scan == 65535, np.inf, scan / 1000.0).astype(np.float32)
        sweep = LaserScan(ranges, angle_min, increment, nearest, farthest, float(data["t"][k]))
        found = amcl.update(Transform2D(*odometry[k].tolist()), sweep, Transform2D(ahead))
        if found is not None:
            rows.append(k)
            poses.append(found.pose)
    return errors_of(data["t"][rows], np.array(poses), data["truth"][rows])


def recorded(file: Path, laser: str) -> list[Errors]:
    """Errors of the real node, one per repeat."""
    data = read(file)
    prefix = f"{file.stem.removeprefix('amcl_drive_')}/{laser}/pose/"
    found: list[Errors] = []
    for archive in golden_ros1_files("amcl_runs.npz"):
        for key, run in read(archive).items():
            if key.startswith(prefix):
                index = np.clip(
                    np.rint(run[:, 0] / 0.2).astype(int) - round(float(data["t"][0]) / 0.2), 0, len(data["t"]) - 1
                )
                found.append(errors_of(run[:, 0], run[:, 1:4], data["truth"][index]))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("file", "laser"), drives() or NONE, ids=lambda v: v.stem if isinstance(v, Path) else v)
def test_errors_are_not_above_those_of_the_real_node(file: Path, laser: str) -> None:
    if not laser:
        pytest.skip("no golden data of ROS 1: set NAVSTACK_GOLDEN_ROS1 to their folder")
    own = [localize(file, laser, seed) for seed in SEEDS]
    assert all(run.held for run in own)
    theirs = [run for run in recorded(file, laser) if run.held]
    if not theirs:
        return  # a drive on which the real node is always lost
    rng = np.random.default_rng(0)
    for name in ("rms", "p95"):
        values = np.array([getattr(run, name) for run in theirs])
        means = rng.choice(values, (2000, len(values))).mean(axis=1)
        assert np.mean([getattr(run, name) for run in own]) <= np.quantile(means, 0.975), (name, own)


@pytest.mark.slow
@pytest.mark.parametrize("drift", [0.1, -0.1])
@pytest.mark.parametrize(("file", "laser"), drives() or NONE, ids=lambda v: v.stem if isinstance(v, Path) else v)
def test_a_drift_of_a_tenth_of_a_radian_per_meter_is_survived(file: Path, laser: str, drift: float) -> None:
    if not laser:
        pytest.skip("no golden data of ROS 1: set NAVSTACK_GOLDEN_ROS1 to their folder")
    assert localize(file, laser, 1, drift).held

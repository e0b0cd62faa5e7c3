"""Trajectory rollout compared with base_local_planner::TrajectoryPlanner: samples, costs, grids, commands, closed loops.

The data are those of NAVSTACK_GOLDEN_ROS1 (default `../shared/golden_ros1`): every configuration and scene is found by name.

The rules that navstack adds (docs/parity/trajectory_rollout.md) are switched off by `Additions.none()`. One difference remains:
where the footprint overlaps a lethal or unknown cell next to C++'s lines from corner to corner, navstack may reject a sample that
C++ accepts (`overlaps`); each such sample must overlap one.

Tolerances: poses are computed in double in both, with the operations in the same order, so they are equal up to the last bit of
sine and cosine, which depends on the C library: 1e-12 m after at most 100 steps. Costs are sums of whole cells times a weight,
so they are equal up to 1e-12 relative, unless a pose falls on the border of a cell within 1e-12 m, which 0.1 % of samples may.
Velocities pass through float32 in both. The heading error uses atan2: 1e-9 rad.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from navstack.core import (
    Costmap,
    Footprint,
    GridGeometry,
    NoValidControlError,
    Pose2D,
    RobotState,
    Twist2D,
    normalize_angle,
)
from navstack.local_planner import TrajectoryPlanner, TrajectoryPlannerParams
from navstack.local_planner.trajectory_rollout.escape import Additions
from navstack.plugins import LocalPlan
from tests.conftest import golden_ros1_files

SAMPLE_ATOL = 1e-12
POSE_ATOL_M = 1e-9
COST_RELATIVE = 1e-9
EQUAL_SAMPLES = 0.999
FLAGS = 9
FILES = golden_ros1_files("trajectory_planner*.npz")


@lru_cache(maxsize=8)
def read(file: FilePath) -> dict[str, Any]:
    with np.load(file) as data:
        return {name: data[name] for name in data.files}


def is_scenes(file: FilePath) -> bool:
    return not any(name.endswith("/config_json") for name in read(file))


def scenes_of(file: FilePath) -> FilePath:
    """The file of inputs that belongs to a file of results."""
    found = [f for f in FILES if is_scenes(f) and f.stem.startswith(file.stem)]
    return found[0] if found else next(f for f in FILES if is_scenes(f))


def configurations() -> list[tuple[FilePath, str]]:
    """(file, configuration) of all results."""
    return [(f, k.split("/")[0]) for f in FILES if not is_scenes(f) for k in read(f) if k.endswith("/config_json")]


CYCLES = [
    (file, config, key.split("/")[1])
    for file, config in configurations()
    for key in read(file)
    if key.startswith(f"{config}/") and key.endswith("/sample_cost")
]
LOOPS = [
    (file, config, key.split("/")[1])
    for file, config in configurations()
    for key in read(file)
    if key.startswith(f"{config}/closedloop") and key.count("/") == 1
]


class Case:
    """Planner, footprint, costmap and plan of a configuration in a scene."""

    def __init__(self, file: FilePath, config: str, scene: str) -> None:
        results, scenes = read(file), read(scenes_of(file))
        values = json.loads(bytes(results[f"{config}/config_json"]).decode())
        self.footprint = Footprint(results[f"footprint_{values.pop('footprint')}"])
        values["controller_frequency"] = 1.0 / values.pop("sim_period")
        fields = TrajectoryPlannerParams.model_fields
        typed = {k: bool(v) if fields[k].annotation is bool else v for k, v in values.items()}
        self.params = TrajectoryPlannerParams(**typed)
        self.planner = TrajectoryPlanner(self.params)
        self.planner.additions = Additions.none()
        ox, oy, resolution = scenes[f"{scene}/info"].tolist()
        costs = scenes[f"{scene}/costmap"]
        geometry = GridGeometry(costs.shape[1], costs.shape[0], resolution, ox, oy)
        self.costmap = Costmap(geometry, costs.copy(), "odom")
        self.plan = scenes[f"{scene}/plan"]
        self.start = scenes.get(f"{scene}/state", scenes.get(f"{scene}/start"))
        self.expected = {k.removeprefix(f"{config}/{scene}/"): v for k, v in results.items()}

    def search(self, state: RobotState) -> LocalPlan:
        """One cycle, with or without a legal sample."""
        try:
            return self.planner.search(state, self.costmap, self.footprint, self.plan, Pose2D(*self.plan[-1]))
        except NoValidControlError as error:
            return error.data["plan"]

    def overlaps(self, poses: NDArray[np.float64]) -> bool:
        """True if the footprint overlaps a lethal or unknown cell, or leaves the map, at one of the poses (n, 3)."""
        g = self.costmap.geometry
        iy, ix = np.nonzero(self.costmap.data >= 254)
        x, y = g.origin_x + ix * g.resolution, g.origin_y + iy * g.resolution
        cells = shapely.box(x, y, x + g.resolution, y + g.resolution)
        for pose in poses:
            body = shapely.Polygon(self.footprint.at(Pose2D(*pose.tolist())))
            if len(cells) and shapely.area(shapely.intersection(body, cells)).max() > 0.0:
                return True
        return False

    def agrees(self, result: LocalPlan, row: NDArray[np.float64]) -> bool:
        """True if C++ selected the same command; `row`: a row of a closed loop."""
        if row[6] < 0.0 or result.best < 0:
            return bool(row[6] < 0.0 and result.best < 0)
        return np.allclose(result.command, row[7:10], rtol=0.0, atol=1e-6)

    def rejects_overlapping(self, result: LocalPlan, command: NDArray[np.float64]) -> bool:
        """True if navstack rejects C++'s command, and its footprint overlaps a lethal or unknown cell."""
        why = self.planner.diagnostics()
        assert why is not None and result.samples is not None and result.rejected_by is not None
        rows = np.flatnonzero(np.isclose(result.samples, command, rtol=0.0, atol=1e-6).all(axis=1))
        return any(
            result.rejected_by[k] == 0 and self.overlaps(why.rollouts.poses[k, : why.rollouts.counts[k]]) for k in rows
        )


def state_of(values: NDArray[np.float64]) -> RobotState:
    x, y, yaw, vx, vy, wz = values.tolist()
    return RobotState(Pose2D(x, y, yaw), Twist2D(vx, vy, wz))


def flags_of(planner: TrajectoryPlanner) -> list[bool]:
    """C++'s flags that decide what may be selected: stuck left, right, stuck left, right strafe, escaping."""
    flags = planner.oscillation_flags
    return [
        not flags.turn.allows(-1.0),
        not flags.turn.allows(1.0),
        not flags.strafe.allows(1.0),
        not flags.strafe.allows(-1.0),
        planner.escaping,
    ]


def cpp_flags(flags: NDArray[np.float64]) -> list[bool]:
    return [bool(flags[i]) for i in (0, 1, 4, 5, 8)]


@pytest.mark.parametrize(("file", "config", "scene"), CYCLES, ids=[f"{f.stem}-{c}-{s}" for f, c, s in CYCLES])
def test_one_cycle(file: FilePath, config: str, scene: str) -> None:
    case = Case(file, config, scene)
    expected = case.expected
    result = case.search(state_of(case.start))
    why = case.planner.diagnostics()
    assert why is not None and result.samples is not None and result.totals is not None
    assert result.rejected_by is not None
    samples, costs = expected["samples"], expected["sample_cost"]
    number = len(samples)

    # the same samples in the same order, with the same rollouts
    ours = result.samples[:number]
    if not case.planner.escaping or len(result.samples) >= number:
        np.testing.assert_allclose(ours, samples, rtol=0.0, atol=SAMPLE_ATOL)
    legal = result.rejected_by[:number] == -1
    counts = why.rollouts.counts[:number]
    np.testing.assert_array_equal(counts[legal], expected["sample_npoints"][legal])
    ends = why.rollouts.poses[np.arange(number), np.maximum(counts - 1, 0)]
    np.testing.assert_allclose(ends[legal], expected["sample_end"][legal], rtol=0.0, atol=POSE_ATOL_M)

    # the same grids
    if "grid_path" in expected and "path" in why.grids:
        np.testing.assert_array_equal(why.grids["path"], expected["grid_path"])
        np.testing.assert_array_equal(why.grids["goal"], expected["grid_goal"])

    # the same legal samples and costs; `overlaps` is the one difference in what is legal
    assert not (legal & (costs < 0.0)).any(), np.flatnonzero(legal & (costs < 0.0))
    overlapping = np.flatnonzero(~legal & (costs >= 0.0))
    for row in overlapping.tolist():
        assert result.rejected_by[row] == 0
        assert case.overlaps(why.rollouts.poses[row, : counts[row]]), row
    close = np.isclose(result.totals[:number][legal], costs[legal], rtol=COST_RELATIVE)
    assert not legal.any() or close.mean() >= EQUAL_SAMPLES, np.flatnonzero(legal)[~close]
    # C++'s code: -1 a collision, -2 no way to the plan or to the goal, whichever comes first
    by_grid = ~legal & (result.rejected_by[:number] > 0)
    assert (costs[by_grid] == -2.0).all()

    # the same command and flags
    xv, yv, thetav, cost = expected["result"][:4].tolist()
    if len(overlapping):
        return  # the selection may differ; the closed loops cover it
    if cost < 0.0:
        assert result.best == -1
    else:
        assert result.best >= 0
        np.testing.assert_allclose(result.command, (xv, yv, thetav), rtol=0.0, atol=SAMPLE_ATOL)
    assert flags_of(case.planner) == cpp_flags(expected["flags"])


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize(("file", "config", "loop"), LOOPS, ids=[f"{f.stem}-{c}-{k}" for f, c, k in LOOPS])
def test_closed_loop(file: FilePath, config: str, loop: str) -> None:
    """Every cycle: the state that the commands so far lead to, command, cost and flags (20 Euler steps a cycle)."""
    case = Case(file, config, loop)
    rows = read(file)[f"{config}/{loop}"]
    step = 0.2 / 20.0
    x, y, yaw, vx, vy, wz = rows[0, :6].tolist()
    same = True  # until C++ selects a sample that overlaps an obstacle: from then on its states are followed
    for i, row in enumerate(rows):
        if not same:
            x, y, yaw, vx, vy, wz = row[:6].tolist()
        assert math.hypot(x - row[0], y - row[1]) < 1e-6 and abs(normalize_angle(yaw - row[2])) < 1e-6, i
        result = case.search(RobotState(Pose2D(x, y, yaw), Twist2D(vx, vy, wz)))
        if not case.agrees(result, row):
            assert case.rejects_overlapping(result, row[7:10]), f"cycle {i}: {result.command}, in C++ {row[6:10]}"
            same = False
        assert not same or flags_of(case.planner) == cpp_flags(row[13:]), i
        x, y, yaw = row[0], row[1], row[2]
        vx, vy, wz = result.command
        for _ in range(20):
            x += (vx * math.cos(yaw) - vy * math.sin(yaw)) * step
            y += (vx * math.sin(yaw) + vy * math.cos(yaw)) * step
            yaw += wz * step

"""`explain command` and the live page of DWB: what each critic costs, and why samples are rejected."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, RobotState, Twist2D
from navstack.core import Path as NavPath
from navstack.explain.command import explain_command
from navstack.live.messages import Frame
from navstack.live.view import trajectories_of
from navstack.local_planner import DWBPlanner
from navstack.parameters import load_configuration
from navstack.plugins import ControlInput, Inflation
from navstack.record import Record
from tests.explain.rooms import record_drive

CRITICS = {"RotateToGoal", "Oscillation", "BaseObstacle", "GoalAlign", "PathAlign", "PathDist", "GoalDist"}


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    configuration = load_configuration(["turtlebot_dwb"])
    return record_drive(tmp_path_factory.mktemp("dwb"), configuration, Pose2D(0.8, 0.8, 2.8), Pose2D(2.2, 1.6, 2.0))


@pytest.mark.slow
def test_samples_have_the_costs_of_the_critics(record: Path) -> None:
    report = explain_command(Record.load(record), 3.0)
    assert report.planner == "DWBPlanner" and set(report.plan.critics) == CRITICS
    best = next(sample for sample in report.samples if sample.index == report.plan.best)
    assert best.rank == 1 and len(report.samples) > 300
    assert report.poses is not None and report.counts is not None


@pytest.mark.slow
def test_at_the_goal_samples_that_drive_are_rejected(record: Path) -> None:
    """RotateToGoal says why, by Nav2's words; driving towards a wall is BaseObstacle's."""
    loaded = Record.load(record)
    last = float(loaded.local_plan_times[-1])
    report = explain_command(loaded, last)
    reasons = {sample.reason for sample in report.samples if sample.rejected_by == "RotateToGoal"}
    assert reasons == {"Nonrotation command near goal."}
    first = explain_command(loaded, float(loaded.local_plan_times[0]))
    assert "BaseObstacle" in first.rejections and "m ahead" in first.rejections


@pytest.mark.slow
def test_the_command_line(record: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "fan.png"
    assert run(["explain", "command", str(record), "--time", "2", "--out", str(picture)]) == 0
    printed = capfd.readouterr().out
    assert "GoalAlign" in printed and "best legal sample" in printed
    assert picture.stat().st_size > 10_000


@pytest.mark.slow
def test_the_live_page_draws_the_trajectories() -> None:
    params = load_configuration(["turtlebot_dwb"]).local_planner.params
    planner = DWBPlanner(params)
    x = np.arange(0.0, 1.5, 0.05)
    planner.set_plan(NavPath(np.column_stack((x, 0.0 * x, 0.0 * x)), "odom"), Pose2D(1.45, 0.0))
    costmap = Costmap(GridGeometry(80, 80, 0.05, -2.0, -2.0), frame="odom")
    costmap.data[:, 52:] = 254
    state = RobotState(Pose2D(0.0, 0.0), Twist2D(0.4, 0.0, 0.0))
    inputs = ControlInput(state, costmap, Footprint.from_radius(0.2), inflation=Inflation(0.2, 0.5, 5.0))
    plan = planner.compute_command(inputs)
    frame = Frame({})
    found = trajectories_of(planner, frame)
    assert found is not None and plan.rejected_by is not None
    scores = np.frombuffer(frame._blobs[found["scores"]], "<f4")
    assert len(scores) == found["rows"] == len(plan.rejected_by)
    np.testing.assert_array_equal(np.isnan(scores), plan.rejected_by >= 0)
    assert 0 < np.isnan(scores).sum() < len(scores) and found["best"] == plan.best

"""`explain command`: summary, table and fan of the requested cycle."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from navstack.cli.app import run
from navstack.core import GridGeometry, InputError, OccupancyGrid, Pose2D, RecordError
from navstack.explain.command import ARRIVED, explain_command
from navstack.parameters import load_configuration
from navstack.plot.fan import Fan, plot_fan
from navstack.record import Record
from navstack.scenario import Scenario, run_scenario

GEOMETRY = GridGeometry(120, 80, 0.05)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A turtlebot through a gap in a wall."""
    cells = np.zeros((80, 120), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    cells[:38, 60] = cells[49:, 60] = 100
    scenario = Scenario(
        OccupancyGrid(cells, GEOMETRY),
        load_configuration(["turtlebot"]),
        Pose2D(1.2, 1.2, 0.4),
        (Pose2D(4.6, 2.2, 0.0),),
    )
    result = run_scenario(scenario)
    assert result.recorder is not None
    where = tmp_path_factory.mktemp("run")
    result.recorder.save(where)
    return where


@pytest.fixture(scope="module")
def record(folder: Path) -> Record:
    return Record.load(folder)


def test_the_weighted_costs_add_up(record: Record) -> None:
    middle = float(record.times[len(record.times) // 2])
    report = explain_command(record, middle)
    recorded = record.local_plan_at(middle)
    assert recorded is not None and report.time == recorded.t <= middle + 1e-9
    assert report.plan.command == recorded.plan.command
    assert len(report.samples) == recorded.tried and len(report.legal) == recorded.tried - recorded.rejected
    assert [s.rank for s in report.legal] == list(range(1, len(report.legal) + 1))
    totals = [s.total for s in report.legal]
    assert totals == sorted(totals, key=lambda total: total or 0.0)
    for sample in report.legal:
        assert sum(sample.weighted.values()) == pytest.approx(sample.total, rel=1e-9, abs=1e-9)
    best = next(s for s in report.samples if s.index == report.plan.best)
    assert best.rank == 1
    assert (
        report.summary.startswith(report.rejections)
        and "best legal sample" in report.summary
        and "because" in report.summary
    )


def test_rejections_have_a_place(record: Record) -> None:
    """In the gap, the footprint of a rejected sample touches a lethal cell of the wall."""
    rows = record.arrays["local_plans"]
    blocked: list[float] = []
    for index in np.flatnonzero(rows["rejected"] > 0):
        plan = record.local_plan(int(index)).plan
        if plan.rejected_by is not None and plan.critics.index("obstacle") in plan.rejected_by.tolist():
            blocked.append(float(rows["t"][index]))
    if not blocked:
        pytest.fail("no sample touches the wall: the gap is too wide for this test")
    report = explain_command(record, blocked[len(blocked) // 2])
    met = [s for s in report.samples if s.rejected_by == "obstacle"]
    assert met
    for sample in met:
        assert sample.rank is None and sample.total is None and sample.reason
        ix, iy = sample.collision["cell"]
        assert report.costmap.data[iy, ix] >= 254
        x, y = report.costmap.geometry.cell_to_world(ix, iy)
        pose = Pose2D(*sample.collision["pose"])
        assert pose.distance_to(Pose2D(x, y)) <= 1.2 * report.footprint.circumscribed_radius + 0.05
    assert f"{len(met)} obstacle (footprint on lethal" in report.rejections


@pytest.mark.slow
def test_the_picture_and_the_document(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "fan.png"
    assert run(["explain", "command", str(folder), "--time", "3.0", "--out", str(picture), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["files"]["picture"] == str(picture) and picture.stat().st_size > 10_000
    assert document["time"] <= 3.0 and document["mode"] == "follow"
    assert len(document["samples"]) == sum(s["rank"] is None for s in document["samples"]) + sum(
        s["rank"] is not None for s in document["samples"]
    )
    assert document["summary"] and set(document["scales"]) >= {"path", "goal", "obstacle"}

    assert run(["explain", "command", str(folder), "--time", "3.0"]) == 0
    shown = capsys.readouterr().out
    assert document["summary"] in shown and "more with --all" in shown
    assert run(["explain", "command", str(folder), "--time", "3.0", "--all"]) == 0
    assert len(capsys.readouterr().out.splitlines()) >= len(document["samples"])


@pytest.mark.slow
def test_the_same_picture_every_time(record: Record, tmp_path: Path) -> None:
    report = explain_command(record, 2.0)
    assert report.poses is not None and report.counts is not None and report.plan.totals is not None
    files = [tmp_path / "a.png", tmp_path / "b.png"]
    rejected_by = [s.rejected_by for s in sorted(report.samples, key=lambda s: s.index)]
    fan = Fan(report.poses, report.counts, report.plan.totals, rejected_by, report.plan.best)
    for file in files:
        plot_fan(fan, report.costmap, file, robot=report.robot, footprint=report.footprint)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_at_the_goal(record: Record) -> None:
    """The end of the run has a single command."""
    report = explain_command(record, float(record.local_plan_times[-2]))
    assert report.plan.mode in ("brake", "rotate_to_goal", "follow")
    assert report.summary


@pytest.mark.parametrize("time", [None, -1])
def test_the_end_of_a_run_that_arrived(
    time: int | None, record: Record, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command without --time asks about the end, where the robot stops at its goal without sampling."""
    report = explain_command(record, None if time is None else float(record.local_plan_times[time]))
    assert report.plan.mode == "arrived" and report.plan.command == (0.0, 0.0, 0.0)
    assert report.summary == ARRIVED and not report.samples
    assert run(["explain", "command", str(folder)]) == 0
    assert ARRIVED in " ".join(capsys.readouterr().out.split())


def test_times_without_a_command(record: Record) -> None:
    with pytest.raises(InputError, match="covers"):
        explain_command(record, 1e6)
    with pytest.raises(RecordError, match="no command"):
        explain_command(record, float(record.times[0]))

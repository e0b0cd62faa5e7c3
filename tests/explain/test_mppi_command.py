"""`explain command` of a controller whose command is an average of its samples."""

from __future__ import annotations

from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.core import Pose2D
from navstack.explain.command import explain_command
from navstack.parameters import load_configuration
from navstack.record import Record
from tests.explain.rooms import record_drive


@pytest.fixture(scope="module")
def record(tmp_path_factory: pytest.TempPathFactory) -> Path:
    configuration = load_configuration(["turtlebot_mppi"], overrides=["MPPIController/batch_size=200"])
    return record_drive(tmp_path_factory.mktemp("mppi"), configuration, Pose2D(0.8, 0.8, 0.3), Pose2D(2.2, 1.6, 0.0))


def test_the_average_and_its_samples(record: Path) -> None:
    report = explain_command(Record.load(record), 2.0)
    assert report.summary.startswith("0 of 200 samples collide; vx ")
    assert "the command is the average of all samples" in report.summary
    assert len(report.samples) == 201 and report.plan.best == 200
    chosen = next(sample for sample in report.samples if sample.index == 200)
    assert chosen.velocity == pytest.approx(tuple(report.plan.command))
    assert any(note.startswith("effective sample size") for note in report.plan.notes)


@pytest.mark.slow
def test_the_command_line(record: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "fan.png"
    assert run(["explain", "command", str(record), "--time", "2", "--out", str(picture)]) == 0
    printed = capfd.readouterr().out
    assert "what each critic changes in the average" in printed and "control cost" in printed
    assert picture.stat().st_size > 10_000

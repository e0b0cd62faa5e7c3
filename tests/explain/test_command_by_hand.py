"""`explain command` for runs and cycles in which a person drives, without a planner."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.cli.app import run
from navstack.explain import explain_command
from navstack.record import Record

SCENARIO = """\
map: office
params: [turtlebot{extra}]
start: [0.8, 7.45, 0.0]
goals: []
interactions:
  - {{time: 0.5, kind: teleop, velocity: [0.3, 0, 0], until: 1.5}}
  - {{time: 1.0, kind: teleop, velocity: [0.2, 0, 0.4], until: 2.0}}
  - {{time: 2.0, kind: wait, duration: 1.0}}
"""


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("by_hand")
    (folder / "run.yaml").write_text(SCENARIO.format(extra=""), encoding="utf-8")
    assert run(["simulate", str(folder / "run.yaml"), "--out", str(folder / "out")]) == 0
    return folder / "out"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("time", "command", "text"),
    [
        (0.7, (0.3, 0.0, 0.0), "vx 0.30, wz 0.00, requested by hand at 0.500 s, is held until 1.500 s"),
        (1.4, (0.2, 0.0, 0.4), "vx 0.20, wz 0.40, requested by hand at 1.000 s, is held until 2.000 s"),
        (2.5, (0.0, 0.0, 0.0), "requested by hand at 1.000 s, ended at 2.000 s; since then the robot stops"),
    ],
)
def test_the_key_in_force(by_hand: Path, time: float, command: Any, text: str) -> None:
    report = explain_command(Record.load(by_hand), time)
    assert tuple(report.plan.command) == command
    assert report.planner == "teleop"
    assert text in report.summary


def test_before_the_first_key(by_hand: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "command", str(by_hand), "--time", "0.3"]) == 2
    assert "no command was computed until 0.300 s" in capsys.readouterr().err


def test_the_printed_text(by_hand: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["explain", "command", str(by_hand), "--time", "0.7"]) == 0
    assert "teleop at 0.660 s (requested 0.700 s), IDLE" in capsys.readouterr().out
    assert run(["explain", "command", str(by_hand), "--time", "0.7", "--out", "command.png"]) == 2
    assert "teleop has no trajectories to draw; omit --out" in capsys.readouterr().err


@pytest.mark.slow
def test_what_the_chain_made_of_it(tmp_path: Path) -> None:
    extra = ", {velocity_smoother: {max_accel: [0.5, 0.0, 1.0]}}"
    (tmp_path / "run.yaml").write_text(SCENARIO.format(extra=extra), encoding="utf-8")
    assert run(["simulate", str(tmp_path / "run.yaml"), "--out", str(tmp_path / "out")]) == 0
    report = explain_command(Record.load(tmp_path / "out"), 0.6)
    assert report.chain is not None
    assert report.chain.source == "teleop"
    assert report.chain.changed_by == "velocity_smoother"

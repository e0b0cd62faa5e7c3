"""Without the name of a run, `explain` and `plot` take the last recorded one."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.cli.last_run import last_run
from navstack.core import InputError


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder in which commands remember the last run."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_without_a_run_there_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="none was recorded yet"):
        last_run()
    assert run(["explain", "goal"]) == 2
    assert capsys.readouterr().err.count("error:") == 1


def test_the_last_of_two_runs_is_explained(state: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("first", "second"):
        assert run(["move", "0.1", "--out", name]) == 0
    capsys.readouterr()
    assert run(["explain", "costmap", "--out", "map.png"]) == 0
    assert f"the last run: {state / 'second'}" in " ".join(capsys.readouterr().err.split())
    assert run(["plot", "--out", "run.png"]) == 0
    shutil.rmtree(state / "second")
    with pytest.raises(InputError, match="does not exist any more"):
        last_run()


@pytest.mark.parametrize("command", [["--help"], ["explain", "goal", "--help"], ["bag", "info", "--help"]])
def test_the_help_prints_no_type_of_flags(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    run(command)
    assert "<bool>" not in capsys.readouterr().out

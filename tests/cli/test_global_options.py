"""Options of every command: verbosity, completion, and what an unexpected exception becomes."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

import pytest

from navstack.cli import check
from navstack.cli.app import run


def fail(*_: object) -> None:
    raise KeyError("a defect")


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """`navstack check` raises a KeyError; reports go to the folder."""
    monkeypatch.setattr(check, "_findings", fail)
    make = tempfile.mkstemp
    monkeypatch.setattr(tempfile, "mkstemp", lambda prefix, suffix: make(suffix, prefix, tmp_path))
    return tmp_path


def test_an_unexpected_exception_is_one_message_and_a_file(broken: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "turtlebot"]) == 70
    shown = capfd.readouterr()
    (file,) = broken.iterdir()
    assert shown.out == ""
    assert len(shown.err.splitlines()) == 1
    assert shown.err.startswith("error: internal error: KeyError: 'a defect'. This is a defect of navstack")
    assert str(file) in shown.err
    assert "Traceback" not in shown.err
    text = file.read_text()
    assert text.startswith("navstack check turtlebot\nnavstack ")
    assert "Traceback (most recent call last)" in text
    assert 'raise KeyError("a defect")' in text


def test_an_unexpected_exception_as_json(broken: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "turtlebot", "--json"]) == 70
    shown = capfd.readouterr()
    error = json.loads(shown.out)["error"]
    assert (error["code"], error["name"]) == (9099, "INTERNAL")
    assert str(next(broken.iterdir())) in error["message"]
    assert shown.err == ""


@pytest.mark.parametrize("flag", ["--debug", "variable"])
def test_the_traceback_on_request(
    flag: str, broken: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    if flag == "variable":
        monkeypatch.setenv("NAVSTACK_DEBUG", "1")
    assert run(["check", "turtlebot", *([flag] if flag == "--debug" else [])]) == 70
    assert "Traceback (most recent call last)" in capfd.readouterr().err
    assert list(broken.iterdir()) == []


def test_a_report_that_cannot_be_written(
    broken: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    assert broken.is_dir()

    def full(**_: str) -> None:
        raise OSError("no space")

    monkeypatch.setattr(tempfile, "mkstemp", full)
    assert run(["check", "turtlebot"]) == 70
    assert "--debug prints the traceback" in capfd.readouterr().err


@pytest.mark.parametrize("place", ["before", "after"])
def test_verbosity(place: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text("planner_frequenzy: 1.0\nDWAPlannerROS: {max_trans_vel: 0.4}\n")
    plan = ["plan", "office", "--params", "turtlebot", "--params", str(file), "--start", "1,7.45", "--goal", "3,7.45"]

    def stderr(*flags: str) -> str:
        arguments = [*flags, *plan] if place == "before" else [*plan, *flags]
        assert run(arguments) == 0
        shown = capfd.readouterr()
        assert "length" in shown.out
        return " ".join(shown.err.split())

    assert stderr("-q") == ""
    normal, verbose = stderr(), stderr("--verbose")
    assert "warning:" in normal
    assert "info:" not in normal
    assert "warning:" in verbose
    assert "max_trans_vel" in verbose
    assert verbose.endswith(" s")


def test_quiet_and_verbose_exclude_each_other(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["-q", "info", "-v"]) == 2
    assert "exclude each other" in capfd.readouterr().err


def test_completion(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("_NAVSTACK_COMPLETE", "complete_bash")
    turtlebots = [f"turtlebot{name}" for name in ("", "_dwb", "_graceful", "_mppi", "_rollout", "_rpp", "_shim")]
    for words, expected in (
        ("navstack pl", ["plan", "plot"]),
        ("navstack plan off", ["office"]),
        ("navstack check turtleb", turtlebots),
        ("navstack plan office --params turtleb", turtlebots),
    ):
        monkeypatch.setenv("COMP_WORDS", words)
        monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
        with pytest.raises(SystemExit):
            run([])
        assert capfd.readouterr().out.split() == expected


def test_h_is_help(capfd: pytest.CaptureFixture[str]) -> None:
    for command in (["-h"], ["move", "-h"], ["ros1", "-h"]):
        assert run(command) == 0
        shown = capfd.readouterr().out
        assert "Usage: navstack" in shown and "<bool>" not in shown

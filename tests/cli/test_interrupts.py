"""Signals end a run with a complete record; two runs do not write into one folder; a full disk is one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.cli.interrupts import interrupt_flag
from navstack.core import OutputError, locked_folder
from navstack.record import Record
from navstack.scenario import run_scenario


@pytest.fixture(autouse=True)
def default_hangup() -> Generator[None]:
    """A hangup is not ignored, as it is when the tests run under nohup."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("command", ["simulate", "tour"])
def test_a_signal_leaves_a_record(
    command: str, number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal arrives before the first cycle after the warm-up."""
    from navstack.scenario import Scenario, warm_up

    def warm_up_and_signal(scenario: Scenario) -> None:
        warm_up(scenario)
        os.kill(os.getpid(), number)

    monkeypatch.setattr(f"navstack.cli.{command}.warm_up", warm_up_and_signal)
    handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    assert run([command, "office", "--out", str(tmp_path)]) == 128 + number
    assert Record.load(tmp_path).results == []
    assert (tmp_path / "summary.json").is_file()
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == handlers


def test_a_stopped_run_is_complete() -> None:
    from navstack.scenario import load_scenario, shipped_scenarios

    calls = iter(range(1000))
    result = run_scenario(load_scenario(shipped_scenarios()["narrow_door"]), stop=lambda: next(calls) >= 20)
    assert [goal.state for goal in result.goals] == ["PREEMPTED"]
    assert result.recorder is not None
    assert len(result.recorder.record().results) == 1


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_leaves_no_part_of_a_film(
    number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The signal arrives while the frames are written."""
    from tests.record import synthetic

    folder = synthetic.record_run(3.0).save(tmp_path)["record"].parent
    (folder / "run.gif").write_bytes(b"an earlier film")

    @contextmanager
    def signalling_bar(what: str, *, quiet: bool) -> Generator[Callable[[int, int], None]]:
        yield lambda done, total: os.kill(os.getpid(), number)

    monkeypatch.setattr("navstack.cli.plot.counting_bar", signalling_bar)
    before = sorted(folder.iterdir())
    handlers = [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)]
    assert run(["plot", str(folder), "--animate", "--out", str(tmp_path / "run.png")]) == 128 + number
    assert sorted(path for path in folder.iterdir() if path.name != "run.png") == before
    assert (folder / "run.gif").read_bytes() == b"an earlier film"
    assert [signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)] == handlers


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_a_plan(number: signal.Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("navstack.cli.plan.plan_on_map", lambda *_, **__: os.kill(os.getpid(), number))
    assert run(["plan", "office", "--start", "1,7.45", "--goal", "3,7.45", "--out", str(tmp_path)]) == 128 + number
    assert list(tmp_path.iterdir()) == []


def test_the_second_signal_ends_the_command() -> None:
    with interrupt_flag() as flag:
        assert not flag()
        os.kill(os.getpid(), signal.SIGINT)
        assert flag()
        assert flag.exit_code == 130
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_the_second_termination_ends_the_command_in_good_order(number: signal.Signals) -> None:
    """The terminal is restored and begun files are removed; a third signal finds the default handler."""
    with interrupt_flag() as flag:
        os.kill(os.getpid(), number)
        assert flag.exit_code == 128 + number
        with pytest.raises(SystemExit) as left:
            os.kill(os.getpid(), number)
        assert left.value.code == 128 + number
        assert signal.getsignal(number) == signal.SIG_DFL


def test_an_ignored_signal_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interrupt_flag() as flag:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not flag()
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.parametrize("command", ["simulate", "tour"])
def test_two_runs_into_one_folder(command: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with locked_folder(tmp_path):
        assert run([command, "office", "--out", str(tmp_path)]) == 2
    assert f"another process is writing to {tmp_path}" in capfd.readouterr().err.replace("\n", " ")
    assert list(tmp_path.iterdir()) == []
    with locked_folder(tmp_path), pytest.raises(OutputError), locked_folder(tmp_path):
        pass
    with locked_folder(tmp_path):
        pass


def test_an_error_leaves_no_empty_folder(tmp_path: Path) -> None:
    new = tmp_path / "a" / "b"
    with pytest.raises(ZeroDivisionError), locked_folder(new):
        raise ZeroDivisionError
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ZeroDivisionError), locked_folder(new):
        (new / "run.log").write_text("")
        raise ZeroDivisionError
    assert (new / "run.log").is_file()  # what was written stays
    with pytest.raises(ZeroDivisionError), locked_folder(new.parent):  # a folder that was there stays
        raise ZeroDivisionError
    assert new.is_dir()


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [["info"], ["info", "--json"], ["check", "turtlebot", "--json"], ["--version"]])
def test_a_full_disk(arguments: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "navstack", *arguments], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert done.returncode == 2
    assert done.stderr.startswith("error: cannot write the output: No space left on device")
    assert "Traceback" not in done.stderr
    assert len(done.stderr.splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "key",
    [
        "local_costmap/width",
        "local_costmap/footprint_padding",
        "DWAPlannerROS/path_distance_bias",
        "DWAPlannerROS/occdist_scale",
        "DWAPlannerROS/twirling_scale",
    ],
)
def test_a_number_that_overflows(key: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for value in ("1e308", "-1e300"):
        assert run(["simulate", "office", "--set", f"{key}={value}", "--out", str(tmp_path)]) == 2
        assert "out of range" in capfd.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("module", ["navstack._lazy", "typer", "navstack.cli.app", "navstack.cli.output"])
def test_an_interrupt_while_the_command_is_imported(module: str, tmp_path: Path) -> None:
    """No traceback, whatever is being imported: the module of this name interrupts the process."""
    hook = (
        "import os, signal, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        f"        if name == {module!r}:\n"
        "            os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Finder())\n"
    )
    (tmp_path / "sitecustomize.py").write_text(hook)
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).resolve().parents[2])]),
    }
    done = subprocess.run(
        [sys.executable, "-m", "navstack", "info"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "interrupted\n")

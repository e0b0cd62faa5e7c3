"""Teleop: keys as listed, the terminal restored in every case (on a pseudo terminal), the run recorded and replayed."""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import subprocess
import sys
import termios
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import navstack as nav
from navstack.behaviors import KeyboardTeleop
from navstack.cli.app import run as command
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.teleop import Session, drive
from navstack.cli.terminal import ARROWS, map_lines, single_keys
from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.explain import replay
from navstack.parameters import load_configuration
from navstack.record import Record
from navstack.scenario import Run, Scenario

# key -> signs of vx, vy, wz: the table of teleop_twist_keyboard
LISTED = {
    "i": (1, 0, 0), "u": (1, 0, 1), "o": (1, 0, -1), "j": (0, 0, 1), "l": (0, 0, -1), ",": (-1, 0, 0),
    ".": (-1, 0, 1), "m": (-1, 0, -1), "t": (0, 0, 0), "b": (0, 0, 0), "I": (1, 0, 0), "U": (1, 1, 0),
    "O": (1, -1, 0), "J": (0, 1, 0), "L": (0, -1, 0), "<": (-1, 0, 0), ">": (-1, -1, 0), "M": (-1, 1, 0),
}  # fmt: skip
FACTORS = {"q": (1.1, 1.1), "z": (0.9, 0.9), "w": (1.1, 1.0), "x": (0.9, 1.0), "e": (1.0, 1.1), "c": (1.0, 0.9)}


@pytest.mark.parametrize("key", LISTED)
def test_every_listed_key_drives(key: str) -> None:
    x, y, yaw = LISTED[key]
    assert KeyboardTeleop().press(key) == pytest.approx((0.3 * x, 0.3 * y, 0.6 * yaw))


@pytest.mark.parametrize("key", FACTORS)
def test_speed_keys_change_the_speeds_by_a_tenth_and_stop(key: str) -> None:
    keyboard = KeyboardTeleop()
    keyboard.press("i")
    assert keyboard.press(key) == (0.0, 0.0, 0.0)
    assert (keyboard.speed, keyboard.turn) == pytest.approx((0.3 * FACTORS[key][0], 0.6 * FACTORS[key][1]))
    assert keyboard.press("u") == pytest.approx((keyboard.speed, 0.0, keyboard.turn))


def test_every_other_key_stops() -> None:
    others = [chr(code) for code in range(1, 300) if chr(code) not in {*LISTED, *FACTORS}]
    assert "k" in others
    for key in others:
        keyboard = KeyboardTeleop()
        keyboard.press("i")
        assert keyboard.press(key) == (0.0, 0.0, 0.0)
        assert (keyboard.speed, keyboard.turn) == (0.3, 0.6)


# --- terminal ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Generator[tuple[int, int]]:
    """A pseudo terminal as stdin: its master and its slave."""
    master, slave = pty.openpty()
    with os.fdopen(slave, "r", closefd=False) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield master, slave
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize("exception", [None, ValueError, KeyboardInterrupt, SystemExit])
def test_the_terminal_is_restored_by_any_exception(
    exception: type[BaseException] | None, terminal: tuple[int, int]
) -> None:
    master, slave = terminal
    before: list[Any] = termios.tcgetattr(slave)
    handler = signal.getsignal(signal.SIGTSTP)

    def use() -> None:
        with single_keys() as read:
            now = termios.tcgetattr(slave)
            assert not now[3] & (termios.ICANON | termios.ECHO)
            assert now[3] & termios.ISIG  # Ctrl-C remains a signal
            os.write(master, b"iq")
            assert read(10.0) == "iq"
            assert read(0.0) == ""
            if exception is not None:
                raise exception

    if exception is None:
        use()
    else:
        with pytest.raises(exception):
            use()
    assert termios.tcgetattr(slave) == before
    assert signal.getsignal(signal.SIGTSTP) is handler


def test_a_terminal_that_is_closed_quits(terminal: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    with single_keys() as read:
        monkeypatch.setattr(os, "read", lambda *_: b"")
        monkeypatch.setattr(select, "select", lambda *_: ([0], [], []))
        assert read(0.0) == "\x03"


def test_without_a_terminal_teleop_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with Path(os.devnull).open() as nowhere:
        monkeypatch.setattr(sys, "stdin", nowhere)
        assert command(["teleop"]) == 2
    assert "stdin is not one; run it in a terminal" in " ".join(capsys.readouterr().err.split())


class Shell:
    """`navstack teleop` on a pseudo terminal of its own, as from a shell."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.master, slave = pty.openpty()
        self.before: list[Any] = termios.tcgetattr(slave)
        # the slave stays open: otherwise its settings are lost with the process
        self.slave = slave
        # as a login shell does: this terminal is the one whose Ctrl-C reaches the process
        code = "import fcntl, sys, termios; fcntl.ioctl(0, termios.TIOCSCTTY, 0); from navstack.cli import main; sys.exit(main())"
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-c", code, "teleop", *arguments],
            cwd=folder,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
        )
        self.text = ""

    def wait_for(self, pattern: str) -> None:
        """Read the terminal until its text matches."""
        while not re.search(pattern, self.text):
            ready, _, _ = select.select([self.master], [], [], 300.0)
            assert ready, f"no {pattern!r} in {self.text!r}"
            self.text += os.read(self.master, 65536).decode("utf-8", "replace")

    def type(self, keys: bytes) -> None:
        os.write(self.master, keys)

    def end(self) -> int:
        """Read what is left and return the exit code."""
        patience = 3000
        while self.process.poll() is None:
            assert patience, f"the process does not end; it wrote {self.text!r}"
            ready, _, _ = select.select([self.master], [], [], 0.1)
            patience -= not ready
            if ready:
                self.text += os.read(self.master, 65536).decode("utf-8", "replace")
        return self.process.returncode

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def shell(tmp_path: Path) -> Generator[Callable[..., Shell]]:
    made: list[Shell] = []

    def make(*arguments: str) -> Shell:
        made.append(Shell(tmp_path, *arguments))
        return made[-1]

    yield make
    for it in made:
        it.close()


@pytest.mark.slow
def test_drive_and_quit_by_ctrl_c(shell: Callable[..., Shell], tmp_path: Path) -> None:
    it = shell("--no-map", "--rate", "2")
    it.wait_for("ready: speed 0.300 m/s, turn 0.600 rad/s")
    assert termios.tcgetattr(it.slave) != it.before
    for key, shown in (
        (b"i", r"key i: vx 0\.300, vy 0\.000, wz 0\.000"),
        (b"q", r"key q: vx 0\.000, vy 0\.000, wz 0\.000; speed 0\.330 m/s, turn 0\.660 rad/s"),
        (b"u", r"key u: vx 0\.330, vy 0\.000, wz 0\.660"),
        (b"J", r"refused: this robot is differential: it cannot drive sideways"),
        (b"k", r"key k: vx 0\.000"),
    ):
        it.type(key)
        it.wait_for(shown)
    it.type(b"\x03")
    assert it.end() == 0, it.text
    assert termios.tcgetattr(it.slave) == it.before
    assert "Traceback" not in it.text
    record = Record.load(tmp_path / "navstack_teleop")
    driven = [item["velocity"] for item in record.scenario["interactions"] if item["kind"] == "teleop"]
    assert driven == [[0.3, 0, 0], [0, 0, 0], pytest.approx([0.33, 0, 0.66]), [0, 0, 0], [0, 0, 0]]
    assert np.abs(record.velocities[-1]).max() < 1e-3
    replayed = replay(record)  # raises if a sample differs in a bit
    assert replayed.time == record.times[-1]


@pytest.mark.slow
def test_a_kill_restores_the_terminal_and_keeps_the_record(shell: Callable[..., Shell], tmp_path: Path) -> None:
    it = shell("--rate", "2")
    it.wait_for("any other key: stop")  # the map is drawn, with the help below it
    it.type(b"i")
    it.wait_for(r"key i: vx 0\.300")
    assert "█" in it.text
    assert any(arrow in it.text for arrow in ARROWS)
    it.process.terminate()
    assert it.end() == 128 + signal.SIGTERM, it.text
    assert termios.tcgetattr(it.slave) == it.before
    assert (tmp_path / "navstack_teleop" / "run.png").stat().st_size > 10_000
    assert len(Record.load(tmp_path / "navstack_teleop").times) > 3


def test_a_second_kill_restores_the_terminal_too(terminal: tuple[int, int]) -> None:
    _, slave = terminal
    before = termios.tcgetattr(slave)
    with pytest.raises(SystemExit) as left, interrupt_flag() as flag, single_keys():
        os.kill(os.getpid(), signal.SIGTERM)
        assert flag()
        assert termios.tcgetattr(slave) != before
        os.kill(os.getpid(), signal.SIGTERM)
    assert left.value.code == 128 + signal.SIGTERM
    assert termios.tcgetattr(slave) == before


# --- the session ------------------------------------------------------------------------------------------------------


def session(hold_s: float, *overrides: str) -> Session:
    scenario = Scenario(
        map=nav.load_map(nav.map_path("office")),
        configuration=load_configuration(["turtlebot"], overrides=list(overrides)),
        start=nav.load_places("office").start,
        goals=(),
    )
    return Session(Run(scenario), scenario, KeyboardTeleop(), hold_s)


def test_the_robot_stops_some_time_after_the_last_key() -> None:
    it = session(1.0)
    it.press("i")
    it.advance_to(3.0)
    assert it.run.robot.distance_travelled == pytest.approx(0.3 * 1.0, abs=0.02)
    for k in range(20):  # a key that repeats
        it.press("i")
        it.advance_to(3.0 + 0.1 * k)
    assert it.run.robot.distance_travelled == pytest.approx(0.3 * (1.0 + 1.9), abs=0.03)
    it.end()
    assert it.run.done


def test_a_base_with_a_timeout_keeps_driving_while_a_key_holds() -> None:
    it = session(2.0, "navstack/sim/command_timeout=0.2")
    it.press("i")
    it.advance_to(4.0)
    assert it.run.robot.distance_travelled == pytest.approx(0.3 * 2.0, abs=0.02)


def test_a_holonomic_robot_drives_sideways() -> None:
    it = session(1.0, "navstack/sim/kinematics=holonomic")
    y = it.run.robot.pose.y
    it.press("J")
    it.advance_to(1.5)
    assert it.run.robot.pose.y - y == pytest.approx(0.3, abs=0.02)
    assert not it.refused


def test_the_loop_ends_by_key_and_by_signal() -> None:
    it, keys = session(1.0), iter(["i", "", "\x03", "i"])
    drive(it, lambda timeout: next(keys), lambda: None, lambda: False, 1.0)
    assert it.keyboard.twist.vx == 0.3
    assert next(keys) == "i"  # not read any more
    it = session(1.0)
    drive(it, lambda timeout: "", lambda: None, lambda: True, 1.0)
    assert it.run.done


# --- the map ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("turned", [0.0, 1e-9])
def test_the_map_as_text(turned: float) -> None:
    data = np.zeros((10, 10), np.int8)
    data[:, 0] = 100  # a wall on the left
    data[0, :] = -1  # unknown below
    grid = OccupancyGrid(data, GridGeometry(10, 10, 1.0, 0.0, 0.0), turned)
    lines = map_lines(
        grid, Pose2D(5.0, 5.0, np.pi / 2), columns=10, rows=5, meters=1.0, trail=[(2.5, 5.0)], seen=[(7.5, 5.0)]
    )
    assert lines == [
        "█         ",
        "█         ",
        "█ ·  ↑ ▒  ",
        "█         ",
        "█         ",
    ]
    assert map_lines(grid, Pose2D(5.0, -8.0), columns=4, rows=3, meters=1.0) == ["░░░░", "░░→░", "░░░░"]

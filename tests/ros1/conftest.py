"""A ROS 1 graph from Debian's packages: a master on a free port, and a virtual display for RViz.

These tests run with NAVSTACK_ROS1_TESTS=1, and fail without the packages then. The programs are run by Debian's
Python, in processes of their own.
"""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, cast

import pytest

WANTED = os.environ.get("NAVSTACK_ROS1_TESTS") == "1"
PYTHON = "/usr/bin/python3"
TIMEOUT_S = 300.0
"""Longest wait for anything: far more than it takes, also on a machine on which programs stand still for minutes."""


PATIENT = tuple(
    part for costmap in ("local", "global") for part in ("--set", f"{costmap}_costmap/transform_tolerance=5.0")
)
"""Options of a node whose test is not about old data: at a multiple of real time a busy machine delays messages by seconds."""


def paced(fastest: float) -> str:
    """Return how fast to simulate: `fastest`, less with a load of more than two programs per core, at least real time.

    The limits of the stack are in simulated time: a program that waits for a core would exceed them.
    """
    return f"{max(1.0, fastest / max(1.0, os.getloadavg()[0] / (2 * (os.cpu_count() or 1)))):.1f}"


def wait_for(condition: Callable[[], Any], what: str, timeout_s: float = TIMEOUT_S) -> Any:
    """Return the first true value of `condition`; fail after the time-out."""
    end = time.monotonic() + timeout_s
    pause = subprocess.Popen(["/bin/cat"], stdin=subprocess.PIPE)
    try:
        while True:
            found = condition()
            if found:
                return found
            if time.monotonic() > end:
                pytest.fail(f"{what} did not happen within {timeout_s:g} s")
            try:
                pause.wait(0.1)
            except subprocess.TimeoutExpired:
                continue
    finally:
        pause.kill()
        pause.communicate()


def missing() -> str:
    """Return what is not installed; empty if everything is there."""
    programs = [name for name in ("rosmaster", "rosbag", "rviz", "Xvfb") if shutil.which(name, path="/usr/bin") is None]
    return ", ".join(programs)


class Graph:
    """A running master, and the programs that were started with it."""

    def __init__(self, folder: Path, port: int = 0) -> None:
        """`port`: of the master; 0 for a free one."""
        self.folder = folder
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(("127.0.0.1", port))
            self.port = int(probe.getsockname()[1])
        self.environment = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder),
            "ROS_MASTER_URI": f"http://127.0.0.1:{self.port}",
            "ROS_IP": "127.0.0.1",
            "ROS_HOME": str(folder / "ros"),
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "QT_X11_NO_MITSHM": "1",
        }
        self._programs: list[subprocess.Popen[bytes]] = []
        self.master = self.start_master()

    def start_master(self) -> subprocess.Popen[bytes]:
        """Start the master, also after its end."""
        self.master = self.start("rosmaster", "--core", "-p", str(self.port))
        wait_for(self._has_master, "the start of the ROS master")
        return self.master

    def _has_master(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0

    def start(self, *command: str, **environment: str) -> subprocess.Popen[bytes]:
        """Start a program; its output goes to a file."""
        log = (self.folder / self._log(command, len(self._programs))).open("wb")
        with log:
            program = subprocess.Popen(
                command, env={**self.environment, **environment}, stdout=log, stderr=log, start_new_session=True
            )
        self._programs.append(program)
        return program

    def _log(self, command: Sequence[str], number: int) -> str:
        return f"{Path(command[0]).name}_{number}.log"

    def log_of(self, program: subprocess.Popen[bytes]) -> Path:
        """Return the file with the output of a program."""
        command = [str(part) for part in cast("list[str]", program.args)]
        return self.folder / self._log(command, self._programs.index(program))

    def run(self, *command: str) -> str:
        """Run a program to its end; return its output."""
        done = subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=TIMEOUT_S, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def close(self) -> None:
        """End all programs at once, then the master, with which they unregister."""
        for programs in ([program for program in self._programs if program is not self.master], [self.master]):
            for program in programs:
                if program.poll() is None:
                    os.killpg(program.pid, signal.SIGTERM)
            end = time.monotonic() + 5.0
            for program in programs:
                try:
                    program.wait(max(0.1, end - time.monotonic()))
                except subprocess.TimeoutExpired:
                    os.killpg(program.pid, signal.SIGKILL)
                    program.wait()


def new_graph(folder: Path) -> Graph:
    """Start a ROS graph; skips, or fails, without Debian's packages."""
    absent = missing()
    if absent:
        message = f"no ROS 1 ({absent} missing): install Debian's packages with tools/install_ros1.sh"
        pytest.fail(message) if WANTED else pytest.skip(message)
    return Graph(folder)


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A ROS graph."""
    graph = new_graph(tmp_path)
    try:
        yield graph
    finally:
        graph.close()

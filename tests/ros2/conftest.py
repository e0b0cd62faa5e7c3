"""A real ROS 2 graph: programs of the environments of `tools/ros2_environment.py`, on a domain of their own.

These tests run with NAVSTACK_ROS2_TESTS=1, and fail without the environments then.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import pytest

from tests.ros1.conftest import PATIENT, paced, wait_for
from tools.ros2_environment import Environment, environment

WANTED: Final = os.environ.get("NAVSTACK_ROS2_TESTS") == "1"
TIMEOUT_S: Final = 300.0
"""Longest wait for anything: far more than it takes, also on a machine on which programs stand still for minutes."""
FASTEST: Final = 4.0
"""Speed of the simulated robot where the machine has nothing else to do: its limits of 0.3 s are 75 ms of the wall then."""
CLIENT: Final = Path(__file__).with_name("client.py")


def new_environment(distro: str) -> Environment:
    """Return an environment; skips, or fails, without it."""
    found = environment(distro)
    if not found.exists:
        message = f"no ROS 2 {distro}: create it with tools/install_ros2.sh"
        pytest.fail(message) if WANTED else pytest.skip(message)
    return found


def domain() -> int:
    """Return a domain that other tests do not use at the same time: by the number of the process."""
    return 1 + os.getpid() % 100


class Graph:
    """Programs of one domain; their output goes to files."""

    def __init__(self, folder: Path, distro: str = "kilted", number: int | None = None) -> None:
        self.folder = folder
        self.domain = domain() if number is None else number
        self.environment = new_environment(distro)
        self._programs: list[subprocess.Popen[bytes]] = []

    def start(self, *command: str, of: Environment | None = None, **variables: str) -> subprocess.Popen[bytes]:
        """Start a program with the Python of an environment."""
        found = of or self.environment
        log = (self.folder / f"program_{len(self._programs)}.log").open("wb")
        with log:
            program = subprocess.Popen(
                [found.python, *command],
                env=found.variables(self.domain, **variables),
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._programs.append(program)
        return program

    def navstack(self, *arguments: str, **variables: str) -> subprocess.Popen[bytes]:
        """Start `navstack ros2 ...`."""
        return self.start("-m", "navstack", "ros2", *arguments, **variables)

    def log_of(self, program: subprocess.Popen[bytes]) -> str:
        """Return the output of a program."""
        return (self.folder / f"program_{self._programs.index(program)}.log").read_text(errors="replace")

    def output(self) -> str:
        """Return the output of all programs."""
        return "".join(file.read_text(errors="replace")[-6000:] for file in sorted(self.folder.glob("*.log")))

    def start_robot(
        self,
        sim: Sequence[str],
        *navigators: Sequence[str],
        ready: str = "the simulated robot is ready",
        **variables: str,
    ) -> list[subprocess.Popen[bytes]]:
        """Start the simulated robot and navigators by its clock, all at once; return them when they are ready.

        Arguments of ROS follow `--ros-args`; `variables` are those of the navigators.
        """
        programs = [self.navstack("sim", *sim)]
        for given in navigators:
            own, _, of_ros = "\0".join(given).partition("\0--ros-args\0")
            more = (*PATIENT, "--ros-args", "-p", "use_sim_time:=true", *filter(None, of_ros.split("\0")))
            programs.append(self.navstack("navigator", *own.split("\0"), *more, **variables))
        self.wait_for_text(programs[0], ready)
        for program in programs[1:]:
            self.wait_for_text(program, "navstack is ready")
        return programs

    def start_sim(self, *arguments: str, ros: tuple[str, ...] = ()) -> subprocess.Popen[bytes]:
        """Start the simulated robot, and wait until it is ready."""
        return self.start_robot((*arguments, *(("--ros-args", *ros) if ros else ())))[0]

    def wait_for_text(self, program: subprocess.Popen[bytes], text: str) -> None:
        """Wait until a program has printed a text; fails if it ends before."""
        wait_for(lambda: text in self.log_of(program) or program.poll() is not None, text, TIMEOUT_S)
        assert text in self.log_of(program), self.log_of(program)[-4000:]

    def ask(self, script: str, *arguments: str, of: Environment | None = None) -> Any:
        """Run a script with the helpers of `client.py`; return what it has put into `found`."""
        out = self.folder / f"found_{len(self._programs)}.json"
        code = CLIENT.read_text() + script + "\nfinish(found)\n"
        program = self.start("-c", code, str(out), *arguments, of=of)
        assert program.wait(TIMEOUT_S) == 0, self.log_of(program)[-4000:] + self.output()[-4000:]
        return json.loads(out.read_text())

    def close(self) -> None:
        """End all programs, the last one first."""
        for program in reversed(self._programs):
            if program.poll() is None:
                os.killpg(program.pid, signal.SIGTERM)
        end = time.monotonic() + 10.0
        for program in self._programs:
            try:
                program.wait(max(0.1, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                os.killpg(program.pid, signal.SIGKILL)
                program.wait()


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    """A graph of Kilted."""
    graph = Graph(tmp_path)
    try:
        yield graph
    finally:
        graph.close()


@pytest.fixture(scope="package")
def office(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Graph]:
    """The packaged turtlebot in the office, with the navigator, at up to FASTEST; tests leave it as it was."""
    graph = Graph(tmp_path_factory.mktemp("ros2"), number=101 + os.getpid() % 100)
    try:
        graph.start_robot(("office", "--clock", "--speed", paced(FASTEST)), ("--params", "turtlebot"))
        yield graph
    finally:
        graph.close()

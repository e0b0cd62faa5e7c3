"""A ROS graph that the tests of a module share, with the commands of `navstack ros1` in it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path

import pytest

from tests.ros1.conftest import TIMEOUT_S, WANTED, Graph, missing, wait_for

ROOT = Path(__file__).resolve().parents[2]


class ModuleGraph(Graph):
    """A master, programs of ROS, and nodes of navstack."""

    def __init__(self, folder: Path) -> None:
        self._logs: dict[int, Path] = {}
        super().__init__(folder)
        kept = {name: os.environ[name] for name in ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME") if name in os.environ}
        self.own = {"PYTHONPATH": str(ROOT), "PATH": os.environ["PATH"], **kept}
        """Environment of a process that imports navstack."""

    def start(self, *command: str, **environment: str) -> subprocess.Popen[bytes]:
        """Start a program; its output goes to a file."""
        return self.launch(command, environment)

    def launch(
        self, command: Sequence[str], environment: Mapping[str, str], stdin: int | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a program with a file descriptor as its input; its output goes to a file."""
        file = self.folder / f"{Path(command[0]).name}_{len(self._programs)}.log"
        with file.open("wb") as log:
            program = subprocess.Popen(
                command,
                env={**self.environment, **environment},
                stdin=stdin,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )
        self._programs.append(program)
        self._logs[program.pid] = file
        return program

    def output_of(self, program: subprocess.Popen[bytes]) -> str:
        """Return what a program has printed."""
        return self._logs[program.pid].read_text(errors="replace")

    def node(
        self, *arguments: str, stdin: int | None = None, environment: Mapping[str, str] | None = None
    ) -> subprocess.Popen[bytes]:
        """Start a command of `navstack ros1`."""
        command = (sys.executable, "-m", "navstack", "ros1", *arguments)
        return self.launch(command, {**self.own, **(environment or {})}, stdin)

    def run_node(self, *arguments: str, code: int = 0, **environment: str) -> str:
        """Run a command of `navstack ros1` to its end; return its output, in one line."""
        program = self.node(*arguments, environment=environment)
        assert program.wait(TIMEOUT_S) == code, self.output_of(program)
        return " ".join(self.output_of(program).split())

    def wait_for_text(self, program: subprocess.Popen[bytes], text: str, timeout_s: float = TIMEOUT_S) -> None:
        """Wait until a program has printed a text."""

        def has_it() -> bool:
            assert program.poll() in (None, 0), self.output_of(program)
            return text in self.output_of(program)

        wait_for(has_it, f'the text "{text}"', timeout_s)


@contextlib.contextmanager
def module_graph(folder: Path) -> Generator[ModuleGraph]:
    """A ROS graph with its files in a folder."""
    absent = missing()
    if absent:
        message = f"no ROS 1 ({absent} missing): install Debian's packages with tools/install_ros1.sh"
        pytest.fail(message) if WANTED else pytest.skip(message)
    graph = ModuleGraph(folder)
    try:
        yield graph
    finally:
        graph.close()

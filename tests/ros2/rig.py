"""The simulated robot, the navigator and a probe between them: for tests and for the programs in tools/."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any, Final

from tests.ros1.conftest import wait_for
from tests.ros1.rig import Rig
from tests.ros2.conftest import Graph

RELAYED: Final = tuple(
    part
    for text in ("scan:=raw/scan", "odom:=raw/odom", "/tf:=/raw/tf", "/clock:=/raw/clock", "map:=raw/map")
    for part in ("-r", text)
)
"""Remappings of the simulated robot: the probe passes these topics on."""


class Rig2(Rig):
    """The programs of one run on ROS 2. Events of the probe are kept in `events`."""

    aborted = "6"
    reached = "4"
    node_name = "/navigator"
    graph: Any

    def __init__(self, folder: Path, number: int | None = None, *, clocked: bool = True) -> None:
        """With `clocked` the simulated robot publishes the clock, else all use that of the system."""
        self._clocked = clocked
        self.ros2 = Graph(folder, number=number)
        super().__init__(self.ros2)  # type: ignore[arg-type]

    def start_sim(self, *arguments: str, relayed: bool = True) -> None:
        """Start the simulated robot, by default behind the probe."""
        clock = ("--clock",) if self._clocked else ()
        self.sim = self.ros2.start_sim(*arguments, *clock, ros=RELAYED if relayed else ())

    def start_node(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start the navigator, and wait until it is ready."""
        clock = f"use_sim_time:={'true' if self._clocked else 'false'}"
        node = self.node = self.ros2.navstack("navigator", *arguments, "--ros-args", "-p", clock)
        wait_for(
            lambda: "navstack is ready" in self.ros2.log_of(node) or node.poll() is not None,
            "the start of the navigator",
        )
        return node

    def probe_command(self) -> tuple[list[str], dict[str, str]]:
        """Return the command of the probe, and its environment."""
        found = self.ros2.environment
        return [found.python, "-m", "tests.ros2.probe"], found.variables(self.ros2.domain)

    def output(self) -> str:
        """Return what all programs have printed."""
        return self.ros2.output()

"""A master, the simulated robot, the move_base node and a probe between them: for tests and for the programs in tools/."""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
import xmlrpc.client
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from tests.ros1.conftest import TIMEOUT_S, Graph, wait_for

ROOT: Final = Path(__file__).resolve().parents[2]
RELAYED: Final = ("scan:=raw/scan", "odom:=raw/odom", "/tf:=/raw/tf", "/clock:=/raw/clock", "map:=raw/map")
"""Remappings of the simulated robot: the probe passes these topics on."""
WARNING: Final = 4
"""Level of a warning on /rosout."""

Event = Mapping[str, Any]


def own_environment() -> dict[str, str]:
    """Return the environment of navstack's programs: this interpreter, this source, its compiled kernels."""
    kept = ("HOME", "NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    return {"PYTHONPATH": str(ROOT), "PATH": os.environ["PATH"], **{k: os.environ[k] for k in kept if k in os.environ}}


class Rig:
    """The programs of one run. Events of the probe are kept in `events`."""

    aborted = "4"
    """Number of a goal that was aborted."""
    reached = "3"
    node_name = "/move_base"

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.events: list[Event] = []
        self._arrived: queue.SimpleQueue[Event] = queue.SimpleQueue()
        self.sim: subprocess.Popen[bytes] | None = None
        self.node: subprocess.Popen[bytes] | None = None
        self._probe: subprocess.Popen[str] | None = None

    # --- programs -----------------------------------------------------------------------------------------------------

    def navstack(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start `navstack ros1 ...`."""
        return self.graph.start(sys.executable, "-m", "navstack", "ros1", *arguments, **own_environment())

    def start_sim(self, *arguments: str, relayed: bool = True) -> None:
        """Start the simulated robot, by default behind the probe; it has registered when this returns."""
        self.sim = self.navstack("sim", *arguments, *(RELAYED if relayed else ()))
        master: Any
        with xmlrpc.client.ServerProxy(self.graph.environment["ROS_MASTER_URI"]) as master:
            wait_for(lambda: master.lookupService("/rig", "/reset_positions")[0] == 1, "the simulated robot")

    def start_node(self, *arguments: str) -> subprocess.Popen[bytes]:
        """Start the move_base node, and wait until it is ready."""
        before = self.output().count("navstack is ready")
        node = self.node = self.navstack("move_base", *arguments)
        wait_for(
            lambda: self.output().count("navstack is ready") > before or node.poll() is not None,
            "the start of the node",
        )
        return node

    def probe_command(self) -> tuple[list[str], dict[str, str]]:
        """Return the command of the probe, and its environment."""
        return [sys.executable, "-m", "tests.ros1.probe"], {**self.graph.environment, **own_environment()}

    def start_probe(self, *arguments: str) -> None:
        """Start the probe; with `--results` it only sends goals and reports their results."""
        log = (self.graph.folder / "probe.log").open("wb")
        command, environment = self.probe_command()
        self._probe = subprocess.Popen(
            [*command, *arguments],
            cwd=ROOT,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            start_new_session=True,
        )
        log.close()
        self._reader = threading.Thread(target=self._read, args=(self._probe,), daemon=True)
        self._reader.start()
        self.wait(lambda event: event["what"] == "ready", "the start of the probe")

    def _read(self, probe: subprocess.Popen[str]) -> None:
        assert probe.stdout is not None
        for line in probe.stdout:
            self._arrived.put(json.loads(line))

    def output(self) -> str:
        """Return what all programs have printed."""
        return "".join(file.read_text(errors="replace") for file in sorted(self.graph.folder.glob("*.log")))

    def close(self) -> None:
        """End the probe; the graph ends the others."""
        probe = self._probe
        if probe is not None:
            os.killpg(probe.pid, signal.SIGKILL)
            probe.wait()
            self._reader.join()
            for pipe in (probe.stdin, probe.stdout):
                if pipe is not None:
                    pipe.close()

    # --- the probe ----------------------------------------------------------------------------------------------------

    def now(self) -> float:
        """Return ROS's time (s)."""
        return float(self.do("nothing")["now"])

    def request(self, do: str, **data: Any) -> float:
        """Give the probe a command; return the time (s, monotonic) at which it was done."""
        return float(self.do(do, **data)["t"])

    def do(self, do: str, **data: Any) -> Event:
        """Give the probe a command; return its answer."""
        probe = self._probe
        assert probe is not None and probe.stdin is not None
        mark = len(self.take())
        probe.stdin.write(json.dumps({"do": do, **data}) + "\n")
        probe.stdin.flush()
        return self.wait(lambda e: e["what"] == "done" and e["do"] == do, do, since=mark)

    def take(self) -> list[Event]:
        """Return all events so far."""
        while not self._arrived.empty():
            self.events.append(self._arrived.get())
        return self.events

    def wait(self, wanted: Callable[[Event], bool], what: str, timeout_s: float = TIMEOUT_S, since: int = 0) -> Event:
        """Return the first event from index `since` that is wanted; AssertionError after the time-out (s)."""
        end = time.monotonic() + timeout_s
        at = since
        while True:
            events = self.take()
            while at < len(events):
                if wanted(events[at]):
                    return events[at]
                at += 1
            left = end - time.monotonic()
            assert left > 0.0, f"{what} did not happen within {timeout_s:g} s\n{self.output()[-4000:]}"
            try:
                self.events.append(self._arrived.get(timeout=min(left, 1.0)))
            except queue.Empty:
                continue

    def after(self, time_s: float, what: str | None = None) -> list[Event]:
        """Return the events since a time (s, monotonic)."""
        return [e for e in self.take() if e["t"] >= time_s and what in (None, e["what"])]

    def run_for(self, seconds: float) -> None:
        """Collect events for some time (s, wall)."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            try:
                self.events.append(self._arrived.get(timeout=left))
            except queue.Empty:
                return

    def send_goal(self, x: float, y: float, **data: Any) -> float:
        """Send a goal; return the time."""
        return self.request("goal", x=x, y=y, **data)

    def wait_for_motion(self, speed: float = 0.2, since: int | None = None) -> float:
        """Wait until the robot moves at a speed (m/s); return the time."""
        first = len(self.take()) if since is None else since
        found = self.wait(lambda e: e["what"] == "truth" and e["v"] >= speed, f"motion at {speed} m/s", since=first)
        return float(found["t"])

    def warnings(self, since: float, name: str = "") -> list[str]:
        """Return the texts of warnings and errors of a node (by default that under test) since a time (s, monotonic)."""
        name = name or self.node_name
        return [e["text"] for e in self.after(since, "log") if e["level"] >= WARNING and e["name"] == name]


def rest_after(rig: Rig, since: float, what: str = "truth") -> float:
    """Return the time (s) from `since` until the robot (`truth`) or its commands (`cmd`) are zero for the rest of the events.

    Infinite if the last of them moves.
    """
    moving = [e["t"] for e in rig.after(since, what) if abs(e["v"]) + abs(e["w"]) > 1e-3]
    later = [e["t"] for e in rig.after(since, what) if not moving or e["t"] > moving[-1]]
    return (later[0] - since) if later else (0.0 if not moving else float("inf"))

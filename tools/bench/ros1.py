"""Times of the ROS 1 nodes: control period, scan to command, processor share; ten times real time, and an hour of it.

    python tools/bench/ros1.py                     # both parts, 1 minute and 10 minutes of simulated time
    python tools/bench/ros1.py --hours 1           # an hour of simulated time at ten times real time: 6 minutes
    python tools/bench/ros1.py --watched           # every topic of the node has a subscriber, and a record is kept

The graph is real: a master, `navstack ros1 sim`, `navstack ros1 move_base`; the packaged turtlebot with 640 beams at 10 Hz,
control at 20 Hz, local costmap at 10 Hz. Periods and delays are those that the node publishes on /diagnostics: of the last
five minutes, periods by the wall clock, delays by ROS's.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.ros1.conftest import Graph  # noqa: E402
from tests.ros1.rig import Rig  # noqa: E402

PARAMS: Final = (
    *("--params", "turtlebot", "--set", "controller_frequency=20.0"),
    *("--set", "local_costmap/update_frequency=10.0"),
    # at 20 Hz the packaged minimum speeds are out of reach within one period
    *("--set", "DWAPlannerROS/min_trans_vel=0.0", "--set", "DWAPlannerROS/min_rot_vel=0.0"),
)
GOALS: Final = ((11.0, 7.4), (1.2, 7.45))
"""The two ends of the corridor."""
GOAL_S: Final = 600.0
"""Longest wait for the end of a goal (s, wall): the machine may be stopped meanwhile."""
MEMORY_S: Final = 60.0
"""Time (s, wall) between two looks at the memory."""
NODE: Final = "/move_base"
WATCHED: Final = (
    *(
        f"{NODE}/{costmap}/{topic}"
        for costmap in ("global_costmap", "local_costmap")
        for topic in ("costmap", "footprint")
    ),
    *(f"{NODE}/{costmap}/costmap_updates" for costmap in ("global_costmap", "local_costmap")),
    *(
        f"{NODE}/{topic}"
        for topic in ("NavfnROS/plan", "DWAPlannerROS/global_plan", "DWAPlannerROS/local_plan", "feedback")
    ),
    "/cmd_vel",
)
TICK: Final = os.sysconf("SC_CLK_TCK")


def cpu_s(program: subprocess.Popen[bytes]) -> float:
    """Return the processor time (s) of a process so far."""
    fields = Path(f"/proc/{program.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICK


def resident_mb(program: subprocess.Popen[bytes]) -> float:
    """Return the resident memory (MB) of a process."""
    return int(Path(f"/proc/{program.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


class Memory:
    """The memory of a process over the time."""

    def __init__(self, program: subprocess.Popen[bytes]) -> None:
        self._program = program
        self._due = time.monotonic() + MEMORY_S
        self.found = [resident_mb(program)]

    def look(self) -> None:
        """Note the memory if it is due."""
        if time.monotonic() >= self._due:
            self._due += MEMORY_S
            self.found.append(resident_mb(self._program))

    def __str__(self) -> str:
        later = ", ".join(f"{found:.1f}" for found in self.found[1:])
        now = resident_mb(self._program)
        return f"{self.found[0]:.1f} -> {now:.1f} MB" + (f"; each {MEMORY_S:g} s: {later}" if later else "")


def drive(rig: Rig, until: float, memory: Memory | None = None) -> list[tuple[str, str]]:
    """Drive to and fro until a time (s, ROS); return the statuses of the goals, and their texts without numbers."""
    ends: list[tuple[str, str]] = []
    at = rig.now()
    while at < until:
        if memory is not None:
            memory.look()
        name = f"bench at {at:.3f}"
        mark = len(rig.take())
        rig.send_goal(*GOALS[len(ends) % 2], id=name)
        found = rig.wait(lambda e: e["what"] == "result", f"the end of {name}", GOAL_S, since=mark)
        ends.append((f"{found['status']}", re.sub(r"[-0-9.]+", "..", str(found.get("text", "")))))
        at = rig.now()
        del rig.events[:-100]
    return ends


def newest(rig: Rig) -> dict[str, Any]:
    """Return the newest diagnostics of the control loop."""
    mark = len(rig.take())
    return rig.wait(lambda e: e["what"] == "diagnostics", "diagnostics", since=mark)["found"][
        f"{rig.node_name[1:]}: control loop"
    ]


def growth(first: dict[str, Any], last: dict[str, Any]) -> dict[str, int]:
    """Return what was counted between two diagnostics: cycles, late cycles, and their causes."""
    counts = [key for key in last if key == "cycles" or (key.startswith("late") and key != "latest")]
    return {key: int(last[key]) - int(first.get(key, 0)) for key in counts}


def measure(title: str, rig: Rig, seconds: float) -> None:
    """Drive for some time (s, ROS), and print what the node measured."""
    drive(rig, rig.now() + 5.0)
    assert rig.node is not None and rig.sim is not None
    first = newest(rig)
    begin, wall = rig.now(), time.monotonic()
    cpu, sim_cpu, memory = cpu_s(rig.node), cpu_s(rig.sim), Memory(rig.node)
    ends = drive(rig, begin + seconds, memory)
    elapsed, took = rig.now() - begin, time.monotonic() - wall
    node_share = (cpu_s(rig.node) - cpu) / took
    sim_share = (cpu_s(rig.sim) - sim_cpu) / took
    last = newest(rig)
    print(f"{title}: {elapsed:.0f} s of ROS time in {took:.0f} s, {elapsed / took:.2f} times real time")
    others = Counter(text or status for status, text in ends if status != rig.reached)
    print(f"  goals           {len(ends)}, {len(ends) - others.total()} reached")
    for text, count in others.most_common():
        print(f"  {count:3d} ended: {text}")
    print(f"  node            {100 * node_share:.1f} % of a core")
    print(f"  simulated robot {100 * sim_share:.1f} % of a core")
    print(f"  memory          {memory}")
    for key, count in growth(first, last).items():
        print(f"  {key:45s} {count}")
    for key, value in last.items():
        if key.startswith(("control period", "scan to", "latest")):
            print(f"  {key:45s} {value}")


def run(title: str, port: int, seconds: float, *sim: str, watched: bool = False) -> None:
    """Start a graph, and measure."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Graph(Path(folder), port))
        try:
            rig.start_sim("office", *sim, relayed=False)
            rig.start_probe("--results")
            rig.start_node(*PARAMS, *(("--record", f"{folder}/runs") if watched else ()))
            if watched:
                rig.graph.start("rostopic", "hz", *WATCHED)
            measure(title, rig, seconds)
        finally:
            rig.close()
            rig.graph.close()


def main() -> int:
    """Run the chosen parts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=1.0 / 6.0, help="simulated hours at ten times real time; 0: not")
    parser.add_argument("--seconds", type=float, default=60.0, help="of driving in real time; 0: not")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--watched", action="store_true", help="subscribe to the topics of the node, and keep a record")
    parser.add_argument("--port", type=int, default=11420)
    chosen = parser.parse_args()
    # the programs of the graph must end with this one
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(1))
    if chosen.seconds > 0.0:
        run("real time", chosen.port, chosen.seconds, watched=chosen.watched)
    if chosen.hours > 0.0:
        sim = ("--clock", "--speed", f"{chosen.speed:g}")
        run("simulated time", chosen.port + 1, 3600.0 * chosen.hours, *sim, watched=chosen.watched)
    return 0


if __name__ == "__main__":
    sys.exit(main())

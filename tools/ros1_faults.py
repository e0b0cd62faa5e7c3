"""Breaks a ROS 1 graph in a goal, and prints how long the robot took to stop and what the node said.

    python tools/ros1_faults.py            # all faults, about 4 minutes
    python tools/ros1_faults.py tf scan    # some of them

The graph is real (Debian's packages): a master, `navstack ros1 sim`, `navstack ros1 move_base`, and a probe between them.
Exit code 1 if a fault ends otherwise than it should.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.ros1.conftest import Graph  # noqa: E402
from tests.ros1.rig import Rig, rest_after  # noqa: E402

PARAMS: Final = (
    "--params",
    "turtlebot",
    "--set",
    "controller_frequency=10.0",
    "--set",
    "local_costmap/obstacle_layer/scan/expected_update_rate=0.4",
)
FAR: Final = (11.0, 7.4)
"""A goal at the other end of the corridor: 20 s of driving."""
BACK: Final = (0.8, 7.45)


class Outcome(NamedTuple):
    """What a fault led to."""

    stopped_s: float
    """Time from the fault until the robot stood still."""
    limit_s: float
    lines: list[str]
    """Warnings of the node."""
    end: str
    """How the goal ended, or what the robot did afterwards."""
    is_right: bool


def driving(rig: Rig) -> None:
    """Send a goal, and wait until the robot drives."""
    events = rig.take()
    at = next((e["x"] for e in reversed(events) if e["what"] == "truth"), 0.8)
    mark = len(events)
    rig.send_goal(*(BACK if at > 6.0 else FAR))
    rig.wait_for_motion(0.3, since=mark)


def last_result(rig: Rig, since: float) -> str:
    """Return the status and the text of the last result since a time."""
    results = rig.after(since, "result")
    return "goal goes on" if not results else f"{results[-1]['status']}: {results[-1]['text']}"


def recovers(rig: Rig, since: float) -> str:
    """Wait until the robot drives again."""
    mark = next(i for i, e in enumerate(rig.take()) if e["t"] >= since)
    rig.wait_for_motion(0.2, since=mark)
    return "drives on"


def broken_topic(topic: str, mode: str, limit_s: float) -> Callable[[Rig], Outcome]:
    """Return a fault that changes a topic for 2 s."""

    def fault(rig: Rig) -> Outcome:
        driving(rig)
        at = rig.request("mode", topic=topic, mode=mode)
        rig.run_for(2.0)
        stopped = rest_after(rig, at)
        lines = rig.warnings(at)
        end = recovers(rig, rig.request("mode", topic=topic, mode="pass"))
        rig.request("cancel")
        rig.run_for(1.5)
        return Outcome(stopped, limit_s, lines, end, stopped <= limit_s and len(lines) == 1)

    return fault


def broken_for_good(topic: str, mode: str, limit_s: float) -> Callable[[Rig], Outcome]:
    """Return a fault that lasts: the goal must end."""

    def fault(rig: Rig) -> Outcome:
        driving(rig)
        at = rig.request("mode", topic=topic, mode=mode)
        mark = len(rig.take())
        rig.wait(lambda e: e["what"] == "result", "the end of the goal", 30.0, since=mark)
        stopped, end = rest_after(rig, at), last_result(rig, at)
        rig.request("mode", topic=topic, mode="pass")
        rig.run_for(1.0)
        return Outcome(stopped, limit_s, rig.warnings(at), end, stopped <= limit_s and end.startswith(rig.aborted))

    return fault


def partly_nan(rig: Rig) -> Outcome:
    """Every third beam is NaN: the robot goes on."""
    driving(rig)
    at = rig.request("mode", topic="scan", mode="some nan")
    rig.run_for(2.0)
    moving = rig.after(at, "truth")[-1]["v"] > 0.2
    lines = rig.warnings(at)
    rig.request("mode", topic="scan", mode="pass")
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(0.0, 0.0, lines, "drives on" if moving else "stands", moving and not lines)


def jump(rig: Rig) -> Outcome:
    """The odometry and its transform jump by 1.5 m."""
    driving(rig)
    at = rig.request("jump", by=1.5)
    rig.run_for(0.9)
    stopped, lines = rest_after(rig, at), rig.warnings(at)
    rig.request("jump", by=-1.5)
    end = recovers(rig, at + stopped)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.0, lines, end, stopped <= 1.0 and len(lines) == 1)


def other_map(rig: Rig) -> Outcome:
    """A map of another size and origin arrives; the robot drives on, on it."""
    driving(rig)
    at = rig.request("map", pad=37)
    rig.run_for(2.5)
    moving = rig.after(at, "truth")[-1]["v"] > 0.2
    said = [e["text"] for e in rig.after(at, "log") if "map of" in e["text"]]
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(0.0, 0.0, said, "drives on" if moving else "stands", moving and len(said) == 1)


def dead_client(rig: Rig) -> Outcome:
    """A client that listens to everything is stopped (SIGSTOP), then killed: the node must not wait for it."""
    names = ["/move_base/global_costmap/costmap", "/move_base/status", "/cmd_vel", "/move_base/feedback"]
    clients = [rig.graph.start("/usr/bin/rostopic", "echo", "--noarr", name) for name in names]
    driving(rig)
    rig.run_for(2.0)
    for client in clients:
        client.send_signal(signal.SIGSTOP)
    at = time.monotonic()
    rig.run_for(4.0)
    gaps = [e["t"] for e in rig.after(at, "cmd")]
    longest = max((b - a for a, b in zip([at, *gaps], gaps, strict=False)), default=99.0)
    for client in clients:
        client.kill()
    rig.run_for(1.0)
    moving = rig.after(at, "truth")[-1]["v"] > 0.2
    lines = rig.warnings(at)
    rig.request("cancel")
    rig.run_for(1.5)
    end = f"drives on; longest gap between commands {longest:.2f} s" if moving else "stands"
    return Outcome(0.0, 0.0, lines, end, moving and longest < 0.5 and not lines)


def master_killed(rig: Rig) -> Outcome:
    """The master is killed and comes back on its port; the robot drives on, and new clients find the node."""
    driving(rig)
    at = time.monotonic()
    rig.graph.master.kill()
    rig.graph.master.wait()
    rig.run_for(3.0)
    moving = rig.after(at, "truth")[-1]["v"] > 0.2
    rig.graph.start_master()
    rig.run_for(4.0)
    assert rig.node is not None
    # without a master, rospy cannot publish on /rosout
    text = rig.graph.log_of(rig.node).read_text()
    lines = [line for line in text.splitlines() if "master" in line and ("WARN" in line or "ERROR" in line)]
    topics = rig.graph.run("/usr/bin/rostopic", "list").split()
    found = "/move_base/goal" in topics and "/odom" in topics and "/raw/scan" in topics
    answer = rig.graph.run("/usr/bin/rosservice", "call", "/move_base/clear_costmaps")
    rig.request("cancel")
    rig.run_for(1.5)
    end = "drives on; topics and services are found again" if found else "the node is not found"
    return Outcome(0.0, 0.0, lines, end, moving and found and len(lines) == 2 and not answer.strip())


def sim_killed(rig: Rig) -> Outcome:
    """The robot's driver is killed: tf, odometry and scans end together."""
    driving(rig)
    assert rig.sim is not None
    rig.sim.kill()
    at = time.monotonic()
    mark = len(rig.take())
    rig.wait(lambda e: e["what"] == "result", "the end of the goal", 30.0, since=mark)
    stopped, end = rest_after(rig, at, "cmd"), last_result(rig, at)
    return Outcome(stopped, 1.0, rig.warnings(at), end, stopped <= 1.0 and end.startswith(rig.aborted))


def node_killed(rig: Rig) -> Outcome:
    """The node is killed (-9): the base times out. A new one serves the next goal."""
    driving(rig)
    assert rig.node is not None
    rig.node.kill()
    at = time.monotonic()
    rig.node.wait()
    rig.run_for(2.0)
    stopped = rest_after(rig, at)
    rig.start_node(*PARAMS)
    rig.run_for(1.0)
    lines = rig.warnings(at)
    driving(rig)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.2, lines, f"next goal: {last_result(rig, at)}", stopped <= 1.2)


def same_name(rig: Rig) -> Outcome:
    """A second node of the same name takes over: the first one stops the robot and ends its goal."""
    driving(rig)
    first = rig.node
    assert first is not None
    at = time.monotonic()
    second = rig.navstack("move_base", *PARAMS)
    assert first.wait(60.0) == 0
    began = next((e["t"] for e in rig.after(at, "result")), time.monotonic())
    rig.run_for(2.0)
    stopped = rest_after(rig, began)
    lines = [line for line in rig.output().splitlines() if "same name" in line]
    end = last_result(rig, at)
    rig.wait(lambda e: e["what"] == "log" and e["t"] > at and "is ready" in e["text"], "the second node", 120.0)
    rig.run_for(1.0)
    driving(rig)
    rig.request("cancel")
    rig.run_for(1.5)
    rig.node = second
    right = stopped <= 1.2 and end.startswith(rig.aborted) and second.poll() is None and len(lines) == 1
    return Outcome(stopped, 1.2, lines, end + "; the second node drives", right)


def clock_back(rig: Rig) -> Outcome:
    """The clock jumps back by 8 s, and everything with it."""
    rig.do("nothing", at=12.0)
    driving(rig)
    at = rig.request("clock back", by=8.0)
    rig.run_for(3.0)
    end, lines = recovers(rig, at + 0.5), rig.warnings(at)
    counts = len(rig.after(at + 1.0, "status"))
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(0.0, 0.0, lines, f"{end}; {counts} statuses in 2 s", len(lines) <= 2 and counts >= 8)


def clock_stopped(rig: Rig) -> Outcome:
    """The clock stands still: a paused simulator."""
    driving(rig)
    topics = ("scan", "odom", "tf", "clock")
    at = max(rig.request("mode", topic=topic, mode="stop") for topic in topics)
    rig.run_for(3.0)
    stopped = rest_after(rig, at, "cmd")
    end = recovers(rig, max(rig.request("mode", topic=topic, mode="pass") for topic in topics))
    lines = rig.warnings(at)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.5, lines, end, stopped <= 1.5 and 2 <= len(lines) <= 3)


def wrong_type(rig: Rig) -> Outcome:
    """A parameter of the wrong type on the parameter server: one sentence, exit code 2."""
    rig.graph.run("/usr/bin/rosparam", "set", "/other/max_planning_retries", "many")
    node = rig.navstack("move_base", "--params", "turtlebot", "--name", "other")
    code = node.wait(120.0)
    text = rig.graph.log_of(node).read_text()
    lines = [line for line in text.splitlines() if "max_planning_retries" in line]
    return Outcome(0.0, 0.0, lines[:1], f"exit code {code}", code == 2 and "Traceback" not in text and bool(lines))


RELAYED: Final[dict[str, Callable[[Rig], Outcome]]] = {
    "tf stopped for 2 s": broken_topic("tf", "stop", 1.2),
    "tf stopped": broken_for_good("tf", "stop", 1.2),
    "tf not finite": broken_topic("tf", "nan", 1.2),
    "tf without rotation": broken_topic("tf", "zero", 1.2),
    "scan stopped for 2 s": broken_topic("scan", "stop", 1.2),
    "scan stopped": broken_for_good("scan", "stop", 1.2),
    "scan of NaN": broken_topic("scan", "nan", 1.2),
    "scan with NaN": partly_nan,
    "odometry stopped": broken_topic("odom", "stop", 1.4),
    "odometry of NaN": broken_topic("odom", "nan", 1.0),
    "odometry jumps": jump,
    "map of other size": other_map,
    "client hangs and dies": dead_client,
    "parameter of the wrong type": wrong_type,
    "node killed and respawned": node_killed,
    "two nodes of one name": same_name,
    "roscore killed and back": master_killed,
    "sim killed": sim_killed,
}
CLOCKED: Final[dict[str, Callable[[Rig], Outcome]]] = {
    "clock jumps back": clock_back,
    "clock stands still": clock_stopped,
}


def rig_of(folder: Path, port: int, *sim: str) -> Rig:
    """Start a graph with the simulated robot, the probe and the node."""
    rig = Rig(Graph(folder, port))
    try:
        rig.start_sim("office", *sim)
        rig.start_probe()
        rig.start_node(*PARAMS)
    except BaseException:
        rig.close()
        rig.graph.close()
        raise
    return rig


def show(name: str, fault: Callable[[Rig], Outcome], rig: Rig) -> bool:
    """Break the graph, print what happened, and return True if it is what should happen."""
    try:
        found = fault(rig)
    except AssertionError as exc:
        print(f"{name:28s} FAILED  {str(exc)[:3000]}", flush=True)
        return False
    limit = f"{found.stopped_s:5.2f} s (limit {found.limit_s:3.1f})" if found.limit_s else "-"
    verdict = "ok" if found.is_right else "WRONG"
    print(f"{name:28s} {verdict:6s} stopped after {limit:22s} {found.end}", flush=True)
    for line in found.lines:
        print(f"{'':36s}{line}", flush=True)
    return found.is_right


def run(faults: dict[str, Callable[[Rig], Outcome]], port: int, *sim: str) -> int:
    """Run faults one after the other on one graph; return the number that ended otherwise than they should."""
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        rig = rig_of(Path(folder), port, *sim)
        try:
            for name, fault in faults.items():
                wrong += not show(name, fault, rig)
        finally:
            rig.close()
            rig.graph.close()
    return wrong


def main() -> int:
    """Run the chosen faults."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of the names of faults; all by default")
    parser.add_argument("--port", type=int, default=11400, help="of the ROS master")
    chosen = parser.parse_args()

    def wanted(faults: dict[str, Callable[[Rig], Outcome]]) -> dict[str, Callable[[Rig], Outcome]]:
        return {k: v for k, v in faults.items() if not chosen.names or any(n in k for n in chosen.names)}

    wrong = 0
    relayed, clocked = wanted(RELAYED), wanted(CLOCKED)
    if relayed:
        wrong += run(relayed, chosen.port)
    if clocked:
        wrong += run(clocked, chosen.port + 1, "--clock")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

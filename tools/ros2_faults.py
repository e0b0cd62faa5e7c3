"""Breaks a ROS 2 graph in a goal, and prints how long the robot took to stop and what the navigator said.

    python tools/ros2_faults.py            # all faults, about 5 minutes
    python tools/ros2_faults.py tf scan    # some of them

The graph is real (rclpy of Kilted, `tools/install_ros2.sh`): `navstack ros2 sim`, `navstack ros2 navigator`, and a probe between
them. Faults are those of `tools/ros1_faults.py`, but for those of the ROS master. Exit code 1 if one ends
otherwise than it should.
"""

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.ros1.rig import Rig, rest_after  # noqa: E402
from tests.ros2.rig import Rig2  # noqa: E402
from tools.ros1_faults import (  # noqa: E402
    PARAMS,
    Outcome,
    broken_for_good,
    broken_topic,
    clock_stopped,
    driving,
    jump,
    last_result,
    other_map,
    partly_nan,
    recovers,
    show,
    sim_killed,
)

LISTENER: Final = """
from nav_msgs.msg import OccupancyGrid, Path
from geometry_msgs.msg import TwistStamped
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
rclpy.init()
node = Node("listener")
latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
kept = [node.create_subscription(*of) for of in (
    (OccupancyGrid, "global_costmap/costmap", lambda m: None, latched), (Path, "plan", lambda m: None, 1),
    (TwistStamped, "cmd_vel", lambda m: None, 10))]
rclpy.spin(node)
"""


def dead_client(rig: Rig) -> Outcome:
    """A client that listens to everything is stopped (SIGSTOP), then killed: the node must not wait for it."""
    assert isinstance(rig, Rig2)
    client = rig.ros2.start("-c", LISTENER)
    driving(rig)
    rig.run_for(2.0)
    client.send_signal(signal.SIGSTOP)
    at = time.monotonic()
    rig.run_for(4.0)
    gaps = [e["t"] for e in rig.after(at, "cmd")]
    longest = max((b - a for a, b in zip([at, *gaps], gaps, strict=False)), default=99.0)
    client.kill()
    rig.run_for(1.0)
    moving = rig.after(at, "truth")[-1]["v"] > 0.2
    lines = rig.warnings(at)
    rig.request("cancel")
    rig.run_for(1.5)
    end = f"drives on; longest gap between commands {longest:.2f} s" if moving else "stands"
    return Outcome(0.0, 0.0, lines, end, moving and longest < 0.5 and not lines)


def node_killed(rig: Rig) -> Outcome:
    """The navigator is killed (-9): the base times out. A new one serves the next goal."""
    driving(rig)
    assert rig.node is not None
    rig.node.kill()
    at = time.monotonic()
    rig.node.wait()
    rig.run_for(2.0)
    stopped = rest_after(rig, at)
    rig.start_node(*PARAMS)
    rig.run_for(3.0)
    driving(rig)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.2, [], f"next goal: {last_result(rig, at)}", stopped <= 1.2)


def node_ended(rig: Rig) -> Outcome:
    """The navigator is asked to end (SIGTERM): it stops the robot, aborts the goal, and ends with code 0."""
    driving(rig)
    assert rig.node is not None
    rig.node.terminate()
    at = time.monotonic()
    code = rig.node.wait(30.0)
    rig.run_for(1.5)
    stopped, end = rest_after(rig, at), last_result(rig, at)
    rig.start_node(*PARAMS)
    rig.run_for(3.0)
    right = stopped <= 1.2 and code == 0 and end.startswith(rig.aborted)
    return Outcome(stopped, 1.2, [], f"exit code {code}; {end}", right)


def navigator_hangs(rig: Rig) -> Outcome:
    """The navigator stands still for 2 s (SIGSTOP): the base times out; then it goes on."""
    driving(rig)
    assert rig.node is not None
    rig.node.send_signal(signal.SIGSTOP)
    at = time.monotonic()
    rig.run_for(2.0)
    stopped = rest_after(rig, at)
    rig.node.send_signal(signal.SIGCONT)
    end = recovers(rig, time.monotonic() - 0.1)
    lines = rig.warnings(at)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.2, lines, end, stopped <= 1.2)


def deactivated(rig: Rig) -> Outcome:
    """A lifecycle manager deactivates the navigator in a goal: it stops and aborts; then it is activated again."""
    assert isinstance(rig, Rig2)
    driving(rig)
    change = (
        "import sys, rclpy\nfrom rclpy.node import Node\nfrom lifecycle_msgs.srv import ChangeState\nrclpy.init()\n"
        "node = Node('manager')\nclient = node.create_client(ChangeState, 'navigator/change_state')\n"
        "client.wait_for_service()\nrequest = ChangeState.Request()\nrequest.transition.id = int(sys.argv[1])\n"
        "rclpy.spin_until_future_complete(node, client.call_async(request))\n"
    )
    at = time.monotonic()
    assert rig.ros2.start("-c", change, "4").wait(60.0) == 0
    mark = next((e["t"] for e in rig.after(at, "result")), time.monotonic())
    rig.run_for(1.5)
    stopped, end = rest_after(rig, mark), last_result(rig, at)
    assert rig.ros2.start("-c", change, "3").wait(60.0) == 0
    driving(rig)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(stopped, 1.2, [], end + "; drives again", stopped <= 1.2 and end.startswith(rig.aborted))


def clock_back(rig: Rig) -> Outcome:
    """The clock jumps back by 8 s, and everything with it; the robot drives on, or again."""
    rig.do("nothing", at=12.0)
    driving(rig)
    at = rig.request("clock back", by=8.0)
    rig.run_for(3.0)
    end, lines = recovers(rig, at + 0.5), rig.warnings(at)
    rig.request("cancel")
    rig.run_for(1.5)
    return Outcome(0.0, 0.0, lines, end, len(lines) <= 2)


def wrong_type(rig: Rig) -> Outcome:
    """A parameter of the wrong type on the command line: one sentence, exit code 2."""
    assert isinstance(rig, Rig2)
    node = rig.ros2.navstack(
        "navigator", "--name", "other", "--params", "turtlebot", "--ros-args", "-p", "max_planning_retries:=many"
    )
    code = node.wait(120.0)
    text = rig.ros2.log_of(node)
    lines = [line for line in text.splitlines() if "max_planning_retries" in line]
    return Outcome(0.0, 0.0, lines[:1], f"exit code {code}", code == 2 and "Traceback" not in text and bool(lines))


FAULTS: Final[dict[str, Callable[[Rig], Outcome]]] = {
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
    "navigator hangs for 2 s": navigator_hangs,
    "navigator deactivated": deactivated,
    "navigator ended": node_ended,
    "navigator killed": node_killed,
    "clock stands still": clock_stopped,
    "clock jumps back": clock_back,
}


BY_WALL_CLOCK: Final[dict[str, Callable[[Rig], Outcome]]] = {"sim killed": sim_killed}
"""Faults of a robot without a simulated clock, which would end with the simulator."""


def run(faults: dict[str, Callable[[Rig], Outcome]], *, clocked: bool) -> int:
    """Run faults one after the other on one graph; return the number that ended otherwise than they should."""
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig2(Path(folder), clocked=clocked)
        try:
            rig.start_sim("office")
            rig.start_probe()
            rig.start_node(*PARAMS)
            for name, fault in faults.items():
                wrong += not show(name, fault, rig)
        finally:
            rig.close()
            rig.ros2.close()
    return wrong


def main() -> int:
    """Run the chosen faults."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of the names of faults; all by default")
    chosen = parser.parse_args()
    wrong = count = 0
    for faults, clocked in ((FAULTS, True), (BY_WALL_CLOCK, False)):
        wanted = {k: v for k, v in faults.items() if not chosen.names or any(n in k for n in chosen.names)}
        count += len(wanted)
        if wanted:
            wrong += run(wanted, clocked=clocked)
    print(f"{count - wrong} of {count}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

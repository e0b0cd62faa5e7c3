"""Time of one tick of a behavior tree while the robot follows its path.

    python tools/bench/behavior_trees.py [TREE.xml ..] [--ticks 20000] [--repeats 5]

Without a tree: the packaged ones. The servers answer at once, so this is the time of the tree alone. A row is the median and the
least of the repeats (us per tick), and the number of nodes ticked in each.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from navstack import core
from navstack.behavior_trees import ActionState, ActionTicket, BehaviorTree, NoServers, StampedPose
from navstack.core import data_folder

PATH = core.Path(np.column_stack((np.linspace(0.0, 20.0, 401), np.zeros((401, 2)))))


class Following(NoServers):
    """Plans at once, and follows for ever."""

    def send(self, server: str, goal: Mapping[str, object]) -> ActionTicket:
        ticket = ActionTicket()
        return ticket if server == "follow_path" else ticket.end(ActionState.SUCCEEDED, path=PATH)

    def call(self, service: str, kind: str, request: Mapping[str, object]) -> Mapping[str, object]:
        return {"success": True, "is_valid": True}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trees", nargs="*", type=Path)
    parser.add_argument("--ticks", type=int, default=20_000)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    for file in given.trees or sorted((data_folder("params") / "behavior_trees").glob("*.xml")):
        goal = {"goal": StampedPose(20.0, 0.0), "goals": [StampedPose(20.0, 0.0)]}
        tree = BehaviorTree(file, servers=Following(), blackboard=goal)
        times: list[float] = []
        clock = 0
        for _ in range(given.repeats):
            started = time.process_time()
            for _ in range(given.ticks):
                clock += 1
                tree.tick(0.01 * clock)
            times.append(1e6 * (time.process_time() - started) / given.ticks)
        per_tick = sum(sum(node.counts[1:]) for node in tree.nodes) / clock
        print(
            f"{file.name}: {statistics.median(times):.2f} us ({min(times):.2f}), {per_tick:.1f} nodes, {tree.status.name}"
        )


if __name__ == "__main__":
    main()

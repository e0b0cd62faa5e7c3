"""Willow's three goals over ROS, next to the spread of runs in one process.

    python tools/ros1_willow.py DATA GOLDEN [--runs 24] [--speed 5]

DATA: a folder with the turtlebot's published parameters and map (NAVSTACK_DATA), GOLDEN: the recorded runs of move_base
(NAVSTACK_GOLDEN). The runs in one process start within about a centimeter of C++'s start. Exit code 1 if a goal over ROS is not
reached, or its time or length is outside their spread by more than a control period and 5 cm.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import numpy as np

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from navstack.core import Pose2D  # noqa: E402
from navstack.map_io import load_map  # noqa: E402
from navstack.parameters import load_configuration  # noqa: E402
from navstack.scenario import Scenario, run_scenario  # noqa: E402
from tests.ros1.conftest import Graph  # noqa: E402
from tests.ros1.rig import Rig  # noqa: E402

WILLOW: Final = "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml"
PARAMS: Final = "params/turtlebot2/param"
PERIOD_S: Final = 0.2
LENGTH_M: Final = 0.05


def spread(data: Path, start: Pose2D, goals: tuple[Pose2D, ...], runs: int) -> tuple[Any, Any]:
    """Return the times (s) and lengths (m) of the goals in runs in this process, both (runs, goals)."""
    rng = np.random.default_rng(1)
    grid, configuration = load_map(data / WILLOW), load_configuration([data / PARAMS])
    times: list[list[float]] = []
    lengths: list[list[float]] = []
    for number in range(runs):
        offset = rng.normal(0.0, (0.01, 0.01, 0.02)) if number else np.zeros(3)
        found = run_scenario(Scenario(grid, configuration, Pose2D(*(np.array(start) + offset)), goals), record=False)
        times.append([goal.time_s for goal in found.goals])
        lengths.append([goal.path_length_m for goal in found.goals])
    return np.array(times), np.array(lengths)


def over_ros(rig: Rig, goals: tuple[Pose2D, ...]) -> list[tuple[int, float, float]]:
    """Return the status, the time (s, ROS) and the length (m) of each goal."""
    found: list[tuple[int, float, float]] = []
    for number, goal in enumerate(goals):
        name = f"willow {number}"
        mark = len(rig.take())
        half = 0.5 * goal.yaw
        rig.send_goal(goal.x, goal.y, id=name, q=(0.0, 0.0, float(np.sin(half)), float(np.cos(half))))
        result = rig.wait(lambda e, name=name: e["what"] == "result" and e["id"] == name, name, 300.0, since=mark)
        rig.run_for(0.2)
        events = rig.take()[mark:]
        begin = next(
            e["stamp"] for e in events if e["what"] == "status" and any(g[:2] == [name, 1] for g in e["goals"])
        )
        path = np.array([(e["x"], e["y"]) for e in events if e["what"] == "truth"])
        length = float(np.hypot(*np.diff(path, axis=0).T).sum())
        found.append((int(result["status"]), float(result["stamp"]) - begin, length))
    return found


def main() -> int:
    """Compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("golden", type=Path)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--speed", type=float, default=5.0)
    parser.add_argument("--port", type=int, default=11430)
    chosen = parser.parse_args()
    with gzip.open(chosen.golden / "e2e" / "three_goals_intended.json.gz") as file:
        cases = json.load(file)
    start = Pose2D(29.75, 7.95, 0.0)
    goals = tuple(Pose2D(*case["goal"][:3]) for case in cases)
    times, lengths = spread(chosen.data, start, goals, chosen.runs)
    params = ("--params", str(chosen.data / PARAMS))
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig(Graph(Path(folder), chosen.port))
        try:
            at = f"{start.x},{start.y},{start.yaw}"
            where = (str(chosen.data / WILLOW), *params, "--start", at)
            rig.start_sim(*where, "--clock", "--speed", f"{chosen.speed:g}", relayed=False)
            rig.start_probe()
            rig.start_node(*params)
            found = over_ros(rig, goals)
        finally:
            rig.close()
            rig.graph.close()
    wrong = 0
    print(f"{'goal':20s} {'over ROS':>20s} {'in one process (' + str(chosen.runs) + ' runs)':>34s} {'move_base':>20s}")
    for number, (status, time_s, length) in enumerate(found):
        t, d = times[:, number], lengths[:, number]
        in_time = t.min() - PERIOD_S <= time_s <= t.max() + PERIOD_S
        in_length = d.min() - LENGTH_M <= length <= d.max() + LENGTH_M
        right = status == 3 and in_time and in_length
        wrong += not right
        spread_text = f"{t.min():.1f} .. {t.max():.1f} s, {d.min():.2f} .. {d.max():.2f} m"
        case = cases[number]
        print(
            f"({goals[number].x:.2f}, {goals[number].y:.2f})".ljust(20),
            f"{time_s:9.1f} s {length:6.2f} m".rjust(20),
            spread_text.rjust(34),
            f"{case['time']:9.1f} s {case['path_length']:6.2f} m".rjust(20),
            "ok" if right else "WRONG",
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

"""Willow's three goals over ROS 2, next to the spread of runs in one process, and the costmap of both.

    python tools/ros2_willow.py DATA GOLDEN [--runs 24] [--speed 5]

DATA: a folder with the turtlebot's published parameters and map (NAVSTACK_DATA), GOLDEN: the recorded runs of move_base
(NAVSTACK_GOLDEN). The simulated robot and the navigator are two processes of Kilted (`tools/install_ros2.sh`). Exit code 1 if a
goal is not reached, its time or length is outside the spread by more than a control period and 5 cm, or a cell of the global
costmap beyond the reach of the scans differs.
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

from navstack.bringup import build_costmap  # noqa: E402
from navstack.core import FrameTree, Pose2D, Transform2D  # noqa: E402
from navstack.map_io import load_map  # noqa: E402
from navstack.parameters import load_configuration  # noqa: E402
from tests.ros2.rig import Rig2  # noqa: E402
from tools.ros1_willow import LENGTH_M, PARAMS, PERIOD_S, WILLOW, spread  # noqa: E402

COSTMAP: Final = """
import hashlib
from nav2_msgs.srv import ClearEntireCostmap, GetCostmap
grid = call(GetCostmap, "global_costmap/get_costmap", GetCostmap.Request()).map
found["size"] = [grid.metadata.size_x, grid.metadata.size_y]
found["data"] = bytes(grid.data).hex()
"""


def over_ros2(rig: Rig2, goals: tuple[Pose2D, ...]) -> list[tuple[int, float, float]]:
    """Return the status, the time (s, ROS) and the length (m) of each goal."""
    found: list[tuple[int, float, float]] = []
    for number, goal in enumerate(goals):
        name, mark, half = f"willow {number}", len(rig.take()), 0.5 * goal.yaw
        rig.send_goal(goal.x, goal.y, id=name, q=(0.0, 0.0, float(np.sin(half)), float(np.cos(half))))
        result = rig.wait(lambda e, name=name: e["what"] == "result" and e["id"] == name, name, 300.0, since=mark)
        rig.run_for(0.2)
        events = rig.take()[mark:]
        begin = next(e["stamp"] for e in events if e["what"] == "accepted")
        path = np.array([(e["x"], e["y"]) for e in events if e["what"] == "truth"])
        length = float(np.hypot(*np.diff(path, axis=0).T).sum())
        found.append((int(result["status"]), float(result["stamp"]) - begin, length))
    return found


def static_cells(data: Path) -> Any:
    """Return the cells (ny, nx) of the global costmap of the static map alone, built in this process."""
    frames = FrameTree()
    configuration = load_configuration([data / PARAMS])
    params = configuration.global_costmap.params
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(29.75, 7.95, 0.0))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, load_map(data / WILLOW))
    costmap.update(0.0)
    return costmap.master.data


def main() -> int:
    """Compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("golden", type=Path)
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--speed", type=float, default=5.0)
    chosen = parser.parse_args()
    with gzip.open(chosen.golden / "e2e" / "three_goals_intended.json.gz") as file:
        cases = json.load(file)
    start = Pose2D(29.75, 7.95, 0.0)
    goals = tuple(Pose2D(*case["goal"][:3]) for case in cases)
    times, lengths = spread(chosen.data, start, goals, chosen.runs)
    params = ("--params", str(chosen.data / PARAMS))
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig2(Path(folder))
        try:
            where = (str(chosen.data / WILLOW), *params, "--start", f"{start.x},{start.y},{start.yaw}")
            rig.start_sim(*where, "--speed", f"{chosen.speed:g}", relayed=False)
            rig.start_probe("--results")
            rig.start_node(*params)
            received = rig.ros2.ask(COSTMAP)
            found = over_ros2(rig, goals)
        finally:
            rig.close()
            rig.ros2.close()
    wrong = 0
    print(f"{'goal':20s} {'over ROS 2':>20s} {'in one process (' + str(chosen.runs) + ' runs)':>34s}")
    for number, (status, time_s, length) in enumerate(found):
        t, d = times[:, number], lengths[:, number]
        in_time = t.min() - PERIOD_S <= time_s <= t.max() + PERIOD_S
        in_length = d.min() - LENGTH_M <= length <= d.max() + LENGTH_M
        right = status == 4 and in_time and in_length
        wrong += not right
        text = f"{t.min():.1f} .. {t.max():.1f} s, {d.min():.2f} .. {d.max():.2f} m"
        name = f"({goals[number].x:.2f}, {goals[number].y:.2f})".ljust(20)
        print(name, f"{time_s:9.1f} s {length:6.2f} m".rjust(20), text.rjust(34), "ok" if right else "WRONG")
    nx, ny = received["size"]
    over, here = np.frombuffer(bytes.fromhex(received["data"]), np.uint8).reshape(ny, nx), static_cells(chosen.data)
    # beyond the reach of the scans around the start the costmap is that of the map
    iy, ix = np.indices(here.shape)
    resolution = 0.1
    far = np.hypot(ix * resolution - start.x, iy * resolution - start.y) > 6.0
    differ = int((over != here)[far].sum()) if over.shape == here.shape else -1
    print(f"global costmap: {over.shape} over ROS 2, {here.shape} here; {differ} of {int(far.sum())} cells differ")
    return 1 if wrong or differ else 0


if __name__ == "__main__":
    sys.exit(main())

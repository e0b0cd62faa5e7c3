"""Willow's three goals over ROS 2, next to the spread of runs in one process, and both costmaps of both.

    python tools/ros2_willow.py DATA GOLDEN [--runs 24] [--speed 5]

DATA: a folder with the turtlebot's published parameters and map (NAVSTACK_DATA), GOLDEN: the recorded runs of move_base
(NAVSTACK_GOLDEN). The simulated robot and the navigator are two processes of Kilted (`tools/install_ros2.sh`). Exit code 1 if a
goal is not reached, its time or length is outside the spread by more than a control period and 5 cm, or a cell of the global or
the local costmap of a robot that rests at the start or at a goal differs from that in one process. Scans have the directions of
messages there, which are float32; how many cells this changes is printed.
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

from navstack.bringup import build_move_base, simulated_robot  # noqa: E402
from navstack.core import LETHAL, LaserScan, Pose2D, SensorData  # noqa: E402
from navstack.map_io import load_map  # noqa: E402
from navstack.parameters import load_configuration  # noqa: E402
from tests.ros2.rig import Rig2  # noqa: E402
from tools.ros1_willow import LENGTH_M, PARAMS, PERIOD_S, WILLOW, spread  # noqa: E402

REST_S: Final = 5.0
"""Time (s) that the robot rests before its costmaps are compared."""
COSTMAPS: Final = """
from nav2_msgs.srv import GetCostmap

def cells(name):
    grid = call(GetCostmap, f"{name}/get_costmap", GetCostmap.Request()).map
    return [[grid.metadata.size_y, grid.metadata.size_x], bytes(grid.data).hex()]

begin = node.get_clock().now().nanoseconds
spin(lambda: node.get_clock().now().nanoseconds > 0, "the clock")
spin(lambda: node.get_clock().now().nanoseconds - begin > 5e9, "the time at rest")
for name in ("global_costmap", "local_costmap"):
    found[name] = cells(name)
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


def costmaps_over_ros2(where: tuple[str, ...], params: tuple[str, ...]) -> dict[str, Any]:
    """Return the cells (ny, nx) of both costmaps of a navigator whose robot rests at its start."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Rig2(Path(folder))
        try:
            rig.start_sim(*where, relayed=False)
            rig.start_node(*params)
            found = rig.ros2.ask(COSTMAPS)
        finally:
            rig.ros2.close()
    return {name: np.frombuffer(bytes.fromhex(data), np.uint8).reshape(size) for name, (size, data) in found.items()}


def as_in_message(data: SensorData) -> SensorData:
    """Return a scan with the directions of a sensor_msgs/LaserScan, which are float32."""
    if not isinstance(data, LaserScan):
        return data
    first, step = (float(np.float32(angle)) for angle in (data.angle_min, data.angle_increment))
    return LaserScan(
        data.ranges, first, step, data.range_min, data.range_max, data.stamp, data.frame, data.topic, data.height
    )


def costmaps_here(data: Path, start: Pose2D, *, by_messages: bool) -> dict[str, Any]:
    """Return the cells of both costmaps of a robot that rests at `start`, in this process; `by_messages`: see `as_in_message`."""
    grid, configuration = load_map(data / WILLOW), load_configuration([data / PARAMS])
    robot = simulated_robot(configuration, grid, start)
    if by_messages:
        measure = robot.scans
        robot.scans = lambda: [as_in_message(data) for data in measure()]  # type: ignore[method-assign]
    move_base = build_move_base(configuration, robot, static_map=grid)
    while robot.time < REST_S:
        robot.advance_to(move_base.next_due(robot.time))
        move_base.tick(robot.time)
    return {name: getattr(move_base, name).master.data for name in ("global_costmap", "local_costmap")}


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
    for number, pose in enumerate((start, *goals)):
        where = (str(chosen.data / WILLOW), *params, "--start", f"{pose.x!r},{pose.y!r},{pose.yaw!r}")
        over = costmaps_over_ros2(where, params)
        here, exact = (costmaps_here(chosen.data, pose, by_messages=by_messages) for by_messages in (True, False))
        for name, cells in here.items():
            differ = int((over[name] != cells).sum()) if over[name].shape == cells.shape else -1
            wrong += differ != 0
            place = "the start" if number == 0 else f"goal {number}"
            rounded = int((cells != exact[name]).sum())
            print(
                f"{name} at {place}: {differ} of {cells.size} cells differ ({int((cells == LETHAL).sum())} are lethal)",
                end="",
            )
            print(f"; {rounded} from directions in double precision" if rounded else "")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())

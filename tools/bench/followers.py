"""Time of a control cycle of the controllers that follow a path, on one core.

    python tools/bench/followers.py [CYCLES]

A robot among random obstacles follows a curved path of 2 m in a costmap of 6 m x 6 m at 0.05 m; the whole of `compute_command` is
timed: path handler, goal checker, command, collision check.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from navstack.bench.calibration import calibration_ms
from navstack.core import Costmap, Footprint, GridGeometry, Path, Pose2D, RobotState, Twist2D
from navstack.interfaces import ControlInput
from navstack.plugins import LOCAL_PLANNERS

NAMES = ("regulated_pure_pursuit", "rotation_shim", "graceful")


def scene(seed: int = 0) -> tuple[Path, list[ControlInput]]:
    """A path, and inputs along its first metre."""
    rng = np.random.default_rng(seed)
    costmap = Costmap(GridGeometry(120, 120, 0.05, -2.0, -3.0), frame="odom")
    angles = np.arange(0.0, 2.0, 0.025)
    path = np.column_stack((2.0 * np.sin(angles), 2.0 * (1.0 - np.cos(angles)), angles))
    for x, y in rng.uniform((-2.0, -3.0), (4.0, 3.0), (400, 2)).tolist():
        if np.hypot(path[:, 0] - x, path[:, 1] - y).min() > 0.6:
            cell = costmap.geometry.world_to_cell(x, y)
            if cell is not None:
                costmap.data[cell[1], cell[0]] = 254
    footprint = Footprint(np.array([[0.25, 0.15], [0.25, -0.15], [-0.25, -0.15], [-0.25, 0.15]]))
    inputs: list[ControlInput] = []
    for x, y, yaw in path[:20].tolist():
        dx, dy, turned = rng.normal(0.0, (0.02, 0.02, 0.05)).tolist()
        state = RobotState(Pose2D(x + dx, y + dy, yaw + turned), Twist2D(0.4, 0.0, 0.2))
        inputs.append(ControlInput(state, costmap, footprint))
    return Path(path, "odom"), inputs


def main() -> None:
    """Print median and 99th percentile for each controller."""
    cycles = int(sys.argv[1]) if len(sys.argv) > 1 else 20_000
    path, inputs = scene()
    goal = Pose2D(*path.poses[-1].tolist())
    print(f"calibration {calibration_ms():.2f} ms; {cycles} cycles")
    for name in NAMES:
        cls = LOCAL_PLANNERS.get(name).cls
        planner = cls(cls.Params())
        times = np.empty(cycles)
        for i in range(-200, cycles):
            if i % len(inputs) == 0:
                planner.set_plan(path, goal)
            begin = time.perf_counter()
            planner.compute_command(inputs[i % len(inputs)])
            if i >= 0:
                times[i] = time.perf_counter() - begin
        p50, p99 = (1e6 * float(np.percentile(times, q)) for q in (50, 99))
        print(f"{name:25} p50 {p50:7.1f} us   p99 {p99:7.1f} us   p99/p50 {p99 / max(p50, math.ulp(1.0)):.2f}")


if __name__ == "__main__":
    main()

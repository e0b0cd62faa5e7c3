"""How often, how soon and how surely a robot that turns in place finds its pose on a whole map.

    python tools/bench/spins.py [--count N] [--map office|willow] [--fov RAD] [--range M] [--things N] [--seed N]

A turtlebot stands at a random free pose among `--things` discs that are not on the map, and turns by 400 degrees at 0.6 rad/s;
the odometry slips; 5 scans per second with 1 cm noise. False confidence: a pose that is declared certain is more than 0.5 m off.
"""

from __future__ import annotations

import argparse
import math
import time

import numpy as np
from global_search import WRONG_M, load_grid

from navstack.bringup import simulated_robot
from navstack.core import LaserScan, NavError, OccupancyGrid, Pose2D, Twist2D
from navstack.localization import ScanMatcher
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.sim import SimulatedRobot

TURN_S = 11.6


def robot_somewhere(grid: OccupancyGrid, options: argparse.Namespace, seed: int) -> SimulatedRobot:
    """A robot at a random free pose of the map among random discs."""
    settings = {
        "laser/fov": options.fov,
        "laser/beams": 180,
        "laser/range_max": options.range,
        "laser/frequency": 5.0,
        "laser/range_noise": 0.01,
        "odometry_noise": 0.05,
        "wheel_slip": 0.05,
    }
    configuration = load_configuration(["turtlebot"], overrides=[f"navstack/sim/{k}={v}" for k, v in settings.items()])
    rng = np.random.default_rng(seed)
    free = np.argwhere(grid.data == 0)
    g = grid.geometry
    while True:
        iy, ix = free[rng.integers(len(free))].tolist()
        x, y = g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution
        around = rng.uniform(-5.0, 5.0, (options.things, 2))
        discs = [(x + dx, y + dy, 0.2) for dx, dy in around.tolist() if math.hypot(dx, dy) > 0.6]
        try:
            start = Pose2D(x, y, rng.uniform(-math.pi, math.pi))
            return simulated_robot(configuration, grid, start, obstacles=discs, seed=seed)
        except NavError:
            continue


def one_spin(matcher: ScanMatcher, robot: SimulatedRobot) -> tuple[float | None, bool, int]:
    """(time until certain, whether the certain pose was wrong, hypotheses at the end)."""
    matcher.start_globally()
    while robot.time < TURN_S:
        robot.command(Twist2D(0.0, 0.0, 0.6))
        robot.advance_to(robot.time + 0.1)
        for scan in robot.scans():
            if not isinstance(scan, LaserScan):
                continue
            odometry = robot.frames.lookup(robot.odom_frame, robot.base_frame, scan.stamp, math.inf)
            sensor = robot.frames.lookup(robot.base_frame, scan.frame)
            estimate = matcher.update(odometry, scan, sensor)
            if estimate is not None and matcher.is_certain:
                off = math.hypot(estimate.pose.x - robot.pose.x, estimate.pose.y - robot.pose.y)
                return robot.time, off > WRONG_M, 1
    return None, False, matcher.count


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--map", default="office", help="office or another packaged map, or willow of golden_ros1")
    parser.add_argument("--fov", type=float, default=math.pi, help="field of view of the lidar (rad)")
    parser.add_argument("--range", type=float, default=10.0, help="range of the lidar (m)")
    parser.add_argument("--things", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    grid = load_grid("willow") if options.map == "willow" else load_map(map_path(options.map))
    matcher = ScanMatcher()
    matcher.set_map(grid)
    began = time.process_time()
    results = [one_spin(matcher, robot_somewhere(grid, options, options.seed + i)) for i in range(options.count)]
    times = [when for when, wrong, _ in results if when is not None and not wrong]
    false = sum(wrong for _, wrong, _ in results)
    left = [count for when, _, count in results if when is None]
    print(
        f"{options.map}, fov {math.degrees(options.fov):.0f} degrees, {options.range:g} m, {options.things} things: "
        f"{len(times)} of {options.count} found, median {np.median(times) if times else math.nan:.1f} s; {false} falsely "
        f"certain; {len(left)} uncertain with {np.median(left) if left else 0:.0f} poses; "
        f"{time.process_time() - began:.0f} s of processor time"
    )


if __name__ == "__main__":
    main()

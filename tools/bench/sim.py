#!/usr/bin/env python3
"""What a scan and a physics step cost, in microseconds, with the calibration of the moment beside them.

The map is the turtlebot's Willow, from the folder NAVSTACK_DATA (by default ../shared/data from the repository), the
calibration from NAVSTACK_BENCH (by default ../shared/bench). Medians over poses of the best of seven runs: machines are
shared, and a scan is the same work each time.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import Footprint, LaserScan, OccupancyGrid, Pose2D, Twist2D
from navstack.map_io import load_map
from navstack.sim import Lidar, LidarParams, SimParams, SimulatedRobot, Track, TrackedDiscs, World

SHARED = Path(__file__).resolve().parents[2].parent / "shared"
WILLOW = "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml"
POSES = 200
TARGETS_US = {"scan": 60.0, "scan among 2000 moving discs": 300.0, "0.2 s of physics": 100.0}


def folder(variable: str, default: Path) -> Path:
    """A folder of foreign files, by environment variable."""
    return Path(os.environ.get(variable) or default)


def calibration(bench: Path) -> tuple[float, float] | None:
    """(now, when the C++ stack was timed) in ms; None where the folder is absent."""
    file = bench / "calibrate.py"
    if not file.exists():
        return None
    spec = importlib.util.spec_from_file_location("calibrate", file)
    assert spec is not None
    assert spec.loader is not None
    module: Any = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    then = json.loads((bench / "cpp_reference.json").read_text())["calibration_ms"]
    return module.calibration_ms(), then


def best_us(work: Callable[[], object], runs: int = 7) -> float:
    """Shortest time of a call, microseconds."""
    best = math.inf
    for _ in range(runs):
        begun = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - begun)
    return best * 1e6


def main() -> None:
    """Prints the table."""
    grid = load_map(folder("NAVSTACK_DATA", SHARED / "data") / WILLOW)
    rng = np.random.default_rng(0)
    free = np.argwhere(grid.data == 0)
    r = grid.geometry.resolution
    poses = [
        Pose2D((ix + rng.random()) * r, (iy + rng.random()) * r, rng.uniform(-math.pi, math.pi))
        for iy, ix in free[rng.integers(len(free), size=POSES)]
    ]
    rows: list[tuple[str, str, float]] = []

    begun = time.perf_counter()
    world = World(grid)
    first_world = time.perf_counter() - begun
    rows.append(("world from a known map", "", best_us(lambda: World(grid))))
    new = iter(range(grid.data.size))

    def unknown() -> World:
        data = grid.data.copy()
        data.flat[next(new)] = 100  # a map that was not seen before
        made = World(OccupancyGrid(data, grid.geometry, grid.origin_yaw))
        _ = made.leaps
        return made

    rows.append(("world from a new map", "", best_us(unknown)))

    def discs() -> Any:
        where = rng.uniform((0, 0), (grid.geometry.width_m, grid.geometry.height_m), (2000, 2))
        return np.column_stack((where, rng.uniform(0.05, 0.25, 2000)))

    for name, crowd in (("scan", False), ("scan among 2000 moving discs", True)):
        for fov, reach in ((1.0, 6.0), (2.0 * math.pi, 6.0), (1.0, 30.0), (2.0 * math.pi, 30.0)):
            lidar = Lidar(LidarParams(beams=640, fov=fov, range_max=reach), seed=0, number=0)
            lidar.scan(world, poses[0], 0, 0.0)
            found: list[float] = []
            for pose in poses:
                if crowd:
                    world.put_discs(discs())
                found.append(best_us(lambda lidar=lidar, pose=pose: lidar.scan(world, pose, 0, 0.0).ranges))
            world.put_discs(())
            rows.append((name, f"640 beams over {fov:.2f} rad, {reach:g} m", statistics.median(found)))

    footprint = Footprint.from_radius(0.18)
    for what, params in (
        ("without lidar", SimParams(lasers=[])),
        ("scans noted, not computed", SimParams()),
        ("scans included", SimParams()),
        ("drifting odometry, no lidar", SimParams(lasers=[], odometry_noise=0.05)),
    ):
        robot = SimulatedRobot(params, world, footprint, Pose2D(29.75, 7.95, 0.0))
        found = []
        for k in range(400):
            robot.command(Twist2D(0.4 if k % 20 < 10 else -0.4, 0.0, 0.2))
            begun = time.perf_counter()
            robot.advance_to(0.2 * (k + 1))
            if what == "scans included":
                for data in robot.scans():
                    if isinstance(data, LaserScan):
                        _ = data.ranges
            found.append((time.perf_counter() - begun) * 1e6)
        rows.append(("0.2 s of physics", f"10 steps, {what}", statistics.median(found)))

    tracks = [
        Track(rng.uniform((0, 0), (grid.geometry.width_m, grid.geometry.height_m), (3, 2)), 0.5, 0.1)
        for _ in range(2000)
    ]
    crowded = World(grid, (), [TrackedDiscs(tracks)])
    robot = SimulatedRobot(SimParams(lasers=[]), crowded, footprint, Pose2D(29.75, 7.95, 0.0))
    found = []
    for k in range(100):
        begun = time.perf_counter()
        robot.advance_to(0.2 * (k + 1))
        found.append((time.perf_counter() - begun) * 1e6)
    rows.append(("0.2 s among moving discs", "10 steps, 2000 tracks", statistics.median(found)))

    print(f"compiling or loading the first kernel: {first_world:.2f} s")
    for name, setting, us in rows:
        target = TARGETS_US.get(name)
        print(f"{name:30s} {setting:36s} {us:9.1f} us" + (f"   (wanted: under {target:g})" if target else ""))
    measured = calibration(folder("NAVSTACK_BENCH", SHARED / "bench"))
    if measured is not None:
        now, then = measured
        print(
            f"calibration {now:.1f} ms now, {then:.1f} ms when the C++ stack was timed: times here x {then / now:.2f} there"
        )


if __name__ == "__main__":
    main()

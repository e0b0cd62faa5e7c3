#!/usr/bin/env python3
"""Time of a scan and of a physics step (us), with the calibration of the machine.

The map is Willow Garage, from the folder `data` (see `reference.py`). Prints medians over poses of the best of seven runs: the
machine may be shared, and a scan is the same work each time.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from reference import Reference, data_folder

from navstack.core import Footprint, LaserScan, OccupancyGrid, Pose2D, Twist2D
from navstack.map_io import load_map
from navstack.sim import Lidar, LidarParams, SimParams, SimulatedRobot, Track, TrackedDiscs, World

WILLOW = "maps/turtlebot_apps__willow-2010-02-18-0.10/willow-2010-02-18-0.10.yaml"
POSES = 200
TARGETS_US = {
    "scan": 60.0,
    "scan among 273 posts": 35.0,
    "scan among 2000 moving discs": 300.0,
    "0.2 s of physics": 100.0,
}


def best_us(work: Callable[[], object], runs: int = 7) -> float:
    """Shortest time of a call (us)."""
    best = math.inf
    for _ in range(runs):
        started = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - started)
    return best * 1e6


def main() -> None:
    """Prints the table."""
    grid = load_map(data_folder("data") / WILLOW)
    rng = np.random.default_rng(0)
    free = np.argwhere(grid.data == 0)
    r = grid.geometry.resolution
    poses = [
        Pose2D((ix + rng.random()) * r, (iy + rng.random()) * r, rng.uniform(-math.pi, math.pi))
        for iy, ix in free[rng.integers(len(free), size=POSES)]
    ]
    rows: list[tuple[str, str, float]] = []

    started = time.perf_counter()
    world = World(grid)
    first_world = time.perf_counter() - started
    rows.append(("world from a known map", "", best_us(lambda: World(grid))))
    new = iter(range(grid.data.size))

    def unknown() -> World:
        data = grid.data.copy()
        data.flat[next(new)] = 100  # a map that is not cached
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

    posts = np.column_stack((rng.uniform(-6.0, 6.0, (273, 2)), np.full(273, 0.075)))
    among = World(None, posts)
    free = [Pose2D(*pose) for pose in rng.uniform((-5.0, -5.0, -3.0), (5.0, 5.0, 3.0), (POSES, 3)).tolist()]
    free = [pose for pose in free if among.clearance(pose) > 0.2]
    for beams in (180, 640):
        lidar = Lidar(LidarParams(beams=beams, fov=2.0 * math.pi, range_max=10.0), seed=0, number=0)
        took = best_us(lambda lidar=lidar: [lidar.scan(among, pose, 0, 0.0).ranges for pose in free], 200)
        rows.append(("scan among 273 posts", f"{beams} beams over 6.28 rad, 10 m", took / len(free)))

    footprint = Footprint.from_radius(0.18)
    for what, params in (
        ("without lidar", SimParams(lasers=[])),
        ("scans scheduled, not computed", SimParams()),
        ("scans computed", SimParams()),
        ("drifting odometry, no lidar", SimParams(lasers=[], odometry_noise=0.05)),
    ):
        robot = SimulatedRobot(params, world, footprint, Pose2D(29.75, 7.95, 0.0))
        found = []
        for k in range(400):
            robot.command(Twist2D(0.4 if k % 20 < 10 else -0.4, 0.0, 0.2))
            started = time.perf_counter()
            robot.advance_to(0.2 * (k + 1))
            if what == "scans computed":
                for data in robot.scans():
                    if isinstance(data, LaserScan):
                        _ = data.ranges
            found.append((time.perf_counter() - started) * 1e6)
        rows.append(("0.2 s of physics", f"10 steps, {what}", statistics.median(found)))

    tracks = [
        Track(rng.uniform((0, 0), (grid.geometry.width_m, grid.geometry.height_m), (3, 2)), 0.5, 0.1)
        for _ in range(2000)
    ]
    crowded = World(grid, (), [TrackedDiscs(tracks)])
    robot = SimulatedRobot(SimParams(lasers=[]), crowded, footprint, Pose2D(29.75, 7.95, 0.0))
    found = []
    for k in range(100):
        started = time.perf_counter()
        robot.advance_to(0.2 * (k + 1))
        found.append((time.perf_counter() - started) * 1e6)
    rows.append(("0.2 s among moving discs", "10 steps, 2000 tracks", statistics.median(found)))

    print(f"compiling or loading the first kernel: {first_world:.2f} s")
    for name, setting, us in rows:
        target = TARGETS_US.get(name)
        print(f"{name:30s} {setting:36s} {us:9.1f} us" + (f"   (target: below {target:g})" if target else ""))
    reference = Reference()
    if reference.available:
        now, then = reference.calibration_ms(), reference.calibration_then_ms
        print(f"calibration {now:.1f} ms, {then:.1f} ms with the C++ times: times here x {then / now:.2f} there")


if __name__ == "__main__":
    main()

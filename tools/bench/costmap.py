#!/usr/bin/env python3
"""Compare costmap updates with the C++ originals.

    python tools/bench/costmap.py [--reference FOLDER] [--runs N] [--soak N]

The scenes, the C++ times and the calibration are those of FOLDER (default: `bench`, see `reference.py`); the folder `golden`
contains the static costmap of Willow. A ratio above 1 is faster than C++. `--soak N` runs N random updates of a rolling costmap
instead, and checks its origin and the memory.
"""

from __future__ import annotations

import argparse
import gc
import math
import resource
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from reference import Reference, data_folder

from navstack.core import Costmap, Footprint, FrameTree, GridGeometry, LaserScan, Pose2D, Transform2D
from navstack.costmap import InflationLayer, InflationLayerParams
from navstack.plugins import LayerContext
from navstack.studies.speed import SCENES, frames_at_origin, rolling_costmap

TARGETS = {
    "inflate_willow_010": 2.0,
    "inflate_willow_005": 4.0,
    "inflate_willow_0025": 4.0,
    "obstacle_update_4m": 1.0,
    "obstacle_update_10m": 1.0,
    "costmap_update_4m": 1.5,
    "costmap_update_10m": 1.5,
    "voxel_update_4m": 1.5,
    "voxel_costmap_update_10m": 1.5,
}

SCENE_RUNS = {
    "obstacle_update_4m": 10,
    "obstacle_update_10m": 10,
    "costmap_update_4m": 5,
    "costmap_update_10m": 5,
    "voxel_update_4m": 5,
    "voxel_costmap_update_10m": 5,
}
"""Scenes of `bench speed` to measure, and how many times `--runs` each is repeated."""


def median_ms(work: Callable[[int], object], runs: int, prepare: Callable[[int], object] | None = None) -> float:
    """Return the median time (ms) of `work(i)` after five warm-up calls, without the time of `prepare(i)`."""
    times: list[float] = []
    gc.disable()
    for i in range(runs + 5):
        if prepare is not None:
            prepare(i)
        start = time.perf_counter()
        work(i)
        times.append(time.perf_counter() - start)
    gc.enable()
    return statistics.median(times[5:]) * 1e3


def bench_inflation(static: np.ndarray, resolution: float, runs: int) -> float:
    """Return the time (ms) to inflate a whole grid with unknown cells."""
    grid = Costmap(GridGeometry(*static.shape[::-1], resolution))
    layer = InflationLayer(
        InflationLayerParams(inflation_radius=0.5, cost_scaling_factor=5.0),
        LayerContext(name="inflation", frame="map", frames=FrameTree(), footprint=Footprint.from_radius(0.18)),
    )
    layer.match_size(grid.geometry)

    def fill(_: int) -> None:
        grid.data[...] = static

    return median_ms(lambda _: layer.update_costs(grid, grid.geometry.window), runs, fill)


def bench_scene(name: str, runs: int) -> float:
    """Return the time (ms) of a scene of `bench speed`."""
    return median_ms(SCENES[name](), runs)


def bench_overhead(runs: int) -> float:
    """Return the time (ms) of one update of a tiny costmap with a scan of one beam: the overhead of Python."""
    costmap = rolling_costmap(0.5, 0.2, inflate=True)
    scan = LaserScan(np.full(1, 0.15, np.float32), 0.0, 0.0, 0.1, 30.0, 0.0, "laser")
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)

    def update(_: int) -> None:
        costmap.observe(scan)
        costmap.update(0.0)

    return median_ms(update, runs)


def soak(updates: int) -> None:
    """Run random updates of a rolling costmap; check that the origin stays on its lattice and memory does not grow."""
    rng = np.random.default_rng(5)
    frames = frames_at_origin()
    costmap = rolling_costmap(4.0, 3.0, inflate=True, frames=frames)
    x = y = yaw = 0.0
    started = 0
    for i in range(updates):
        now = 0.1 * i
        x, y, yaw = x + rng.normal(0.0, 0.2), y + rng.normal(0.0, 0.2), yaw + rng.normal(0.0, 0.3)
        if rng.random() < 1e-4:  # kidnapped robot
            x, y = rng.uniform(-1e4, 1e4, 2).tolist()
        frames.set("odom", "base_link", Transform2D(x, y, math.remainder(yaw, 2 * math.pi)), now)
        ranges = rng.uniform(0.0, 6.0, 32).astype(np.float32)
        costmap.observe(LaserScan(ranges, -math.pi, 2 * math.pi / 32, 0.1, 5.0, now, "laser"))
        costmap.update(now)
        if i == min(20_000, updates // 10):
            gc.collect()
            started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    geometry = costmap.master.geometry
    drift = max(abs(math.remainder(o, geometry.resolution)) for o in (geometry.origin_x, geometry.origin_y))
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - started
    print(f"{updates:,} updates: origin {drift:.2e} m off its lattice, memory growth {grown} KiB since the first tenth")
    if drift > 2e-9 or grown > 1024:
        raise SystemExit("soak failed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", type=Path, help="folder with calibrate.py and cpp_reference.json")
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--soak", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.soak:
        soak(arguments.soak)
        return
    reference = Reference(arguments.reference)
    runs = arguments.runs
    willow = np.load(data_folder("golden") / "costmap_static_willow010_r018_csf5.npz")["static"]
    dense = np.where(np.random.default_rng(3).random(willow.shape) < 0.5, 254, 0).astype(np.uint8)
    cases: list[tuple[str, Callable[[], float]]] = [
        ("inflate_willow_010", lambda: bench_inflation(willow, 0.1, runs)),
        ("inflate_willow_005", lambda: bench_inflation(willow.repeat(2, 0).repeat(2, 1), 0.05, runs)),
        ("inflate_willow_0025", lambda: bench_inflation(willow.repeat(4, 0).repeat(4, 1), 0.025, max(15, runs // 3))),
        *((name, partial(bench_scene, name, factor * runs)) for name, factor in SCENE_RUNS.items()),
    ]
    print(f"{'case':28s} {'ours ms':>9s} {'x C++':>7s} {'target':>7s} {'calibration ms':>15s}")
    for name, measure in cases:
        ours = measure()
        now = reference.calibration_ms(5)
        ratio = reference.speedup(name, ours, now)
        print(
            f"{name:28s} {ours:9.4f} {ratio:7.2f} {TARGETS[name]:7.1f} {now:15.2f}{'' if ratio >= TARGETS[name] else '  <--'}"
        )
    for name, resolution, grid in (("0.1", 0.1, dense), ("0.05", 0.05, dense.repeat(2, 0).repeat(2, 1))):
        print(f"dense obstacles (50 %) at {name} m: {bench_inflation(grid, resolution, max(15, runs // 3)):.4f} ms")
    print(f"overhead of one update in Python: {bench_overhead(20 * runs) * 1e3:.1f} us")


if __name__ == "__main__":
    main()

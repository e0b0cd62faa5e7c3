#!/usr/bin/env python3
"""Costmap updates against the C++ they come from: ratios, with the calibration of the moment beside them.

The scenes, the C++ times and the calibration are those of a folder with `calibrate.py`, `cpp_reference.json` and the golden
static costmap of Willow beside it (`--reference`, default ../shared/bench from the repository). A ratio above 1 is faster
than C++. `--soak N` instead runs N random updates of a rolling costmap and checks origin and memory.
"""

from __future__ import annotations

import argparse
import gc
import importlib.util
import math
import resource
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import (
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    LaserScan,
    Pose2D,
    Transform2D,
)
from navstack.costmap import (
    CostmapParams,
    InflationLayer,
    InflationLayerParams,
    LayeredCostmap,
    LayerSpec,
    ObservationSourceParams,
    ObstacleLayer,
    ObstacleLayerParams,
    VoxelLayer,
    VoxelLayerParams,
)
from navstack.interfaces import LayerContext

ROOT = Path(__file__).resolve().parents[2]
BEAMS = 640
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


def room_scan(size: float, x: float = 0.0, y: float = 0.0) -> np.ndarray:
    """Ranges (640,) float32 of an exact sweep of the room with twelve discs, from (x, y)."""
    angles = -math.pi + np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    c, s = np.cos(angles), np.sin(angles)
    half = 0.45 * size
    with np.errstate(divide="ignore"):
        ranges = np.minimum(
            np.where(c > 0, (half - x) / c, (-half - x) / c), np.where(s > 0, (half - y) / s, (-half - y) / s)
        )
    for i in range(12):
        reach = 0.35 * size * (0.6 + 0.05 * i)
        dx, dy = reach * math.cos(0.7 * i + 0.2) - x, reach * math.sin(0.7 * i + 0.2) - y
        along = c * dx + s * dy
        inside = (0.02 * size) ** 2 - (dx * dx + dy * dy - along * along)
        hit = (inside > 0) & (along > 0)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(inside[hit]))
    return np.ascontiguousarray(ranges, np.float32)


def scan_of(size: float, stamp: float) -> LaserScan:
    return LaserScan(
        room_scan(size),
        -math.pi,
        2.0 * math.pi / BEAMS,
        0.1,
        30.0,
        stamp=stamp,
        frame="laser",
        topic="scan",
        height=0.3,
    )


def rolling_costmap(size: float, reach: float, *, voxel: bool, inflate: bool) -> tuple[LayeredCostmap, FrameTree]:
    """The local costmap of the scenes."""
    source = ObservationSourceParams(
        data_type="LaserScan", marking=True, clearing=True, obstacle_range=reach, raytrace_range=reach
    )
    common: dict[str, Any] = {"observation_sources": "scan", "sources": {"scan": source}, "track_unknown_space": voxel}
    obstacle = (
        LayerSpec("obstacle_layer", VoxelLayer, VoxelLayerParams(z_voxels=2, z_resolution=0.2, **common))
        if voxel
        else LayerSpec("obstacle_layer", ObstacleLayer, ObstacleLayerParams(**common))
    )
    layers = [obstacle]
    if inflate:
        layers.append(
            LayerSpec(
                "inflation_layer", InflationLayer, InflationLayerParams(inflation_radius=0.5, cost_scaling_factor=5.0)
            )
        )
    frames = FrameTree()
    frames.set_static("base_link", "laser", Transform2D())
    frames.set("odom", "base_link", Transform2D(), 0.0)
    costmap = LayeredCostmap(
        "local_costmap",
        CostmapParams(global_frame="odom", rolling_window=True, width=size, height=size, resolution=0.05),
        layers,
        footprint=Footprint.from_radius(0.18),
        frames=frames,
    )
    return costmap, frames


def median_ms(work: Callable[[int], object], runs: int, prepare: Callable[[int], object] | None = None) -> float:
    """Median time of `work(i)` after five warming calls, `prepare(i)` not counted."""
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


def bench_obstacle(size: float, reach: float, runs: int, *, voxel: bool, whole: bool) -> float:
    """One update: a scan arrives, rays, marks; the whole costmap with inflation when asked."""
    costmap, _ = rolling_costmap(size, reach, voxel=voxel, inflate=whole)
    scans = [scan_of(size, 0.0) for _ in range(5)]
    layer = costmap.layer("obstacle_layer")
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    nothing = costmap.bounds.__class__()

    def update(i: int) -> None:
        costmap.observe(scans[i % 5])
        if whole:
            costmap.update_at(Pose2D(0.06 * (i % 5), 0.0), 0.0)
        else:
            layer.update_bounds(Pose2D(0.0, 0.0), 0.0, nothing)

    return median_ms(update, runs)


def bench_inflation(static: np.ndarray, resolution: float, runs: int) -> float:
    """Inflation of a whole grid that is not inflated yet, unknown cells and all."""
    grid = Costmap(GridGeometry(*static.shape[::-1], resolution))
    layer = InflationLayer(
        InflationLayerParams(inflation_radius=0.5, cost_scaling_factor=5.0),
        LayerContext(name="inflation", frame="map", frames=FrameTree(), footprint=Footprint.from_radius(0.18)),
    )
    layer.match_size(grid.geometry)

    def fill(_: int) -> None:
        grid.data[...] = static

    return median_ms(lambda _: layer.update_costs(grid, grid.geometry.window), runs, fill)


def bench_overhead(runs: int) -> float:
    """One update of a tiny costmap with all layers and a scan of one beam: what Python itself costs."""
    costmap, _ = rolling_costmap(0.5, 0.2, voxel=False, inflate=True)
    scan = LaserScan(np.full(1, 0.15, np.float32), 0.0, 0.0, 0.1, 30.0, 0.0, "laser")
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)

    def update(_: int) -> None:
        costmap.observe(scan)
        costmap.update(0.0)

    return median_ms(update, runs)


def soak(updates: int) -> None:
    """Random updates of a rolling costmap: the origin stays on its lattice, memory does not grow."""
    rng = np.random.default_rng(5)
    costmap, frames = rolling_costmap(4.0, 3.0, voxel=False, inflate=True)
    x = y = yaw = 0.0
    started = 0
    for i in range(updates):
        now = 0.1 * i
        x, y, yaw = x + rng.normal(0.0, 0.2), y + rng.normal(0.0, 0.2), yaw + rng.normal(0.0, 0.3)
        if rng.random() < 1e-4:  # kidnapped
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
    print(
        f"{updates:,} updates: origin off its lattice by {drift:.2e} m, memory grown by {grown} KiB since the first tenth"
    )
    if drift > 2e-9 or grown > 1024:
        raise SystemExit("soak failed")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", type=Path, default=ROOT.parent / "shared" / "bench")
    parser.add_argument("--runs", type=int, default=60)
    parser.add_argument("--soak", type=int, default=0)
    arguments = parser.parse_args()
    if arguments.soak:
        soak(arguments.soak)
        return
    spec = importlib.util.spec_from_file_location("calibrate", arguments.reference / "calibrate.py")
    if spec is None or spec.loader is None:
        raise SystemExit(f"no calibrate.py in {arguments.reference}: give --reference")
    calibrate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(calibrate)
    runs = arguments.runs
    willow = np.load(arguments.reference.parent / "golden" / "costmap_static_willow010_r018_csf5.npz")["static"]
    dense = np.where(np.random.default_rng(3).random(willow.shape) < 0.5, 254, 0).astype(np.uint8)
    cases: list[tuple[str, Callable[[], float]]] = [
        ("inflate_willow_010", lambda: bench_inflation(willow, 0.1, runs)),
        ("inflate_willow_005", lambda: bench_inflation(willow.repeat(2, 0).repeat(2, 1), 0.05, runs)),
        ("inflate_willow_0025", lambda: bench_inflation(willow.repeat(4, 0).repeat(4, 1), 0.025, max(15, runs // 3))),
        ("obstacle_update_4m", lambda: bench_obstacle(4.0, 3.0, 10 * runs, voxel=False, whole=False)),
        ("obstacle_update_10m", lambda: bench_obstacle(10.0, 10.0, 10 * runs, voxel=False, whole=False)),
        ("costmap_update_4m", lambda: bench_obstacle(4.0, 3.0, 5 * runs, voxel=False, whole=True)),
        ("costmap_update_10m", lambda: bench_obstacle(10.0, 10.0, 5 * runs, voxel=False, whole=True)),
        ("voxel_update_4m", lambda: bench_obstacle(4.0, 3.0, 5 * runs, voxel=True, whole=False)),
        ("voxel_costmap_update_10m", lambda: bench_obstacle(10.0, 10.0, 5 * runs, voxel=True, whole=True)),
    ]
    print(f"{'case':28s} {'ours ms':>9s} {'x C++':>7s} {'target':>7s} {'calibration ms':>15s}")
    for name, measure in cases:
        ours = measure()
        now = calibrate.calibration_ms(5)
        ratio = calibrate.speedup(name, ours, now)
        print(
            f"{name:28s} {ours:9.4f} {ratio:7.2f} {TARGETS[name]:7.1f} {now:15.2f}{'' if ratio >= TARGETS[name] else '  <--'}"
        )
    for name, resolution, grid in (("0.1", 0.1, dense), ("0.05", 0.05, dense.repeat(2, 0).repeat(2, 1))):
        print(f"dense obstacles (50 %) at {name} m: {bench_inflation(grid, resolution, max(15, runs // 3)):.4f} ms")
    print(f"overhead of one update in Python: {bench_overhead(20 * runs) * 1e3:.1f} us")


if __name__ == "__main__":
    main()

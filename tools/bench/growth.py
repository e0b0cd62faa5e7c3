"""Measure time and memory of the global planners by map size, from 1e4 to 1e8 cells, and fit exponents.

    python tools/bench/growth.py GOLDEN_FOLDER [--cells 1e8] [--only navfn] [--repeats 3] [--json]

Two scenes: `building`, the costmap of Willow Garage at 0.1 m (GOLDEN_FOLDER/costmap_static_willow010_r020_csf5.npz) cut or
tiled to a square; and `rooms`, walls every 20 cells with a door at a random position in every wall, without inflation. The
query goes from corner to corner of the largest connected part. `corner` queries a path of a hundred cells on the largest
`building`.

Every row is measured in its own process. Time: processor time, the minimum of the repeats, planned from scratch. Memory: the
growth of the peak resident set (VmHWM, reset before) during the first plan and, in the second figure, including replanning
from a slightly different start, per cell; the costmap is not counted. `replanned` is the time of that second plan. The
exponent is that of a power law fitted from 1e6 cells.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import (
    AStarPlanner,
    GlobalPlannerROS,
    NavfnParams,
    NavfnROS,
    ThetaStarPlanner,
)
from navstack.plugins import GlobalPlanner

PLANNERS = {
    "navfn": NavfnROS,
    "navfn astar": lambda: NavfnROS(NavfnParams(use_astar=True)),
    "global_planner": GlobalPlannerROS,
    "astar": AStarPlanner,
    "theta_star": ThetaStarPlanner,
}
SIDES = (100, 316, 1000, 2000, 4123, 10000)  # 4123: 17 million cells
FIT_FROM = 1e6
OWN_PAGES = {"MALLOC_MMAP_THRESHOLD_": "65536", "MALLOC_TRIM_THRESHOLD_": "65536"}
"""Freed memory must not be reused: every array gets its own pages and returns them."""
FREE_BELOW = 253
UNKNOWN = 255


def building(golden: Path, side: int) -> NDArray[np.uint8]:
    with np.load(golden / "costmap_static_willow010_r020_csf5.npz") as z:
        master = z["master"]
    if side < 566:
        return np.ascontiguousarray(master[200 : 200 + side, 150 : 150 + side])
    times = (-(-side // master.shape[0]), -(-side // master.shape[1]))
    return np.ascontiguousarray(np.tile(master, times)[:side, :side])


def rooms(side: int) -> NDArray[np.uint8]:
    rng = np.random.default_rng(1)
    data = np.zeros((side, side), np.uint8)
    data[::20] = 254
    data[:, ::20] = 254
    for i in range(20, side, 20):
        for j in range(0, side - 19, 20):
            a, b = rng.integers(2, 17, 2)
            data[i, j + a : j + a + 3] = 0
            data[j + b : j + b + 3, i] = 0
    data[0] = data[-1] = 254
    data[:, 0] = data[:, -1] = 254
    return data


def far_apart(data: NDArray[np.uint8]) -> tuple[tuple[int, int], tuple[int, int]]:
    """The cells of the largest connected region nearest to the first and the last corner."""
    from scipy.ndimage import label

    free = (data < FREE_BELOW) | (data == UNKNOWN)  # by default all planners cross unknown cells
    free[0] = free[-1] = False
    free[:, 0] = free[:, -1] = False
    labels: NDArray[np.int32] = np.empty(free.shape, np.int32)
    label(free, output=labels)
    sizes = np.bincount(labels.ravel())
    sizes[0] = 0
    ys, xs = np.nonzero(labels == sizes.argmax())
    first, last = int(np.argmin(xs + ys)), int(np.argmax(xs + ys))
    return (int(xs[first]), int(ys[first])), (int(xs[last]), int(ys[last]))


def memory_kb(what: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(what + ":"))


def reset_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def measure(golden: Path, scene: str, side: int, name: str, repeats: int) -> dict[str, Any]:
    """Measure one row, in this process."""
    planner: GlobalPlanner = PLANNERS[name]()
    small = Costmap(GridGeometry(400, 400, 0.1))
    for x in (20.0, 20.5):  # compile, import and replan once
        planner.make_plan(small, Pose2D(39.0 - x / 10.0, 39.0), Pose2D(1.0, 1.0))
    data = rooms(side) if scene == "rooms" else building(golden, side)
    start, goal = far_apart(data)
    if scene == "corner":
        ys, xs = np.nonzero(data[:400, :400] < 100)
        best = int(np.argmin(np.abs(np.hypot(xs - start[0], ys - start[1]) - 100.0)))
        goal = int(xs[best]), int(ys[best])
    costmap = Costmap(GridGeometry(side, side, 0.1), data)
    a, b = (Pose2D(*costmap.geometry.cell_to_world(*cell)) for cell in (start, goal))
    planner = PLANNERS[name]()
    reset_peak()
    before = memory_kb("VmRSS")
    times: list[float] = []
    plan = None
    first_kb = 0
    for _ in range(repeats):
        planner.reset()
        started = time.process_time()
        plan = planner.make_plan(costmap, a, b)
        times.append(time.process_time() - started)
        if len(times) == 1:
            first_kb = memory_kb("VmHWM") - before
        if sum(times) > 8.0:
            break
    assert plan is not None
    poses = plan.path.poses
    x, y = poses[min(len(poses) - 1, 8), :2]
    data[2:4, 2:4] ^= 1  # without a change the cached plan would be returned
    started = time.process_time()
    planner.make_plan(costmap, Pose2D(float(x) + 0.02, float(y) + 0.02), b)  # builds the goal potential
    x, y = poses[min(len(poses) - 1, 16), :2]
    data[2:4, 2:4] ^= 1
    started = time.process_time()
    planner.make_plan(costmap, Pose2D(float(x) + 0.02, float(y) + 0.02), b)
    replanned = time.process_time() - started
    return {
        "scene": scene,
        "cells": side * side,
        "planner": name,
        "ms": min(times) * 1e3,
        "replanned_ms": replanned * 1e3,
        "bytes_per_cell": first_kb * 1024 / side**2,
        "replanning_bytes_per_cell": (memory_kb("VmHWM") - before) * 1024 / side**2,
        "first_mb": first_kb / 1024,
        "expanded": plan.cells_expanded,
    }


def exponent(rows: list[dict[str, Any]], key: str) -> float:
    points = [(r["cells"], r[key]) for r in rows if r["cells"] >= FIT_FROM * 0.9 and r[key] > 0]
    if len(points) < 2:
        return math.nan
    x, y = np.log(np.array(points)).T
    return float(np.polyfit(x, y, 1)[0])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("golden", type=Path)
    parser.add_argument("--cells", type=float, default=1e8, help="size of the largest map")
    parser.add_argument("--only", default="", help="name of a planner")
    parser.add_argument("--scene", choices=["building", "rooms", "corner"])
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--row", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.row:
        scene, side, name = args.row
        print(json.dumps(measure(args.golden, scene, int(side), name, args.repeats)))
        return
    rows: list[dict[str, Any]] = []
    sides = [s for s in SIDES if s * s <= args.cells * 1.01]
    for scene in [args.scene] if args.scene else ["building", "rooms", "corner"]:
        for name in PLANNERS:
            if args.only and args.only != name:
                continue
            mine: list[dict[str, Any]] = []
            for side in sides if scene != "corner" else sides[-1:]:
                command = [sys.executable, __file__, str(args.golden), "--repeats", str(args.repeats)]
                done = subprocess.run(
                    [*command, "--row", scene, str(side), name],
                    capture_output=True,
                    text=True,
                    env=os.environ | OWN_PAGES,
                )
                if done.returncode:
                    print(f"{scene} {name} {side}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
                    continue
                mine.append(json.loads(done.stdout))
                if not args.json:
                    r = mine[-1]
                    print(
                        f"{scene:9s} {name:15s} {r['cells']:10.2e} cells {r['ms']:10.2f} ms, replanned "
                        f"{r['replanned_ms']:9.2f} ms; {r['bytes_per_cell']:6.2f} B/cell, replanning "
                        f"{r['replanning_bytes_per_cell']:6.2f}; {r['first_mb']:8.1f} MB; expanded {r['expanded']}",
                        flush=True,
                    )
            if not args.json and len(mine) > 2:
                time_, memory = exponent(mine, "ms"), exponent(mine, "first_mb")
                print(f"{scene:9s} {name:15s} exponent of time {time_:.2f}, of memory {memory:.2f}")
            rows += mine
    if args.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()

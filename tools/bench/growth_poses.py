"""Measure time and memory of smac_hybrid by map size and number of headings.

    python tools/bench/growth_poses.py GOLDEN_FOLDER [--cells 17e6] [--headings 36 72 144]

The map: the costmap of Willow Garage at 0.1 m, cut or tiled to a square, as in `growth.py`. Queries with Reeds-Shepp, a radius of
0.4 m: `far` from one corner to the other, `near` over ten meters in the corner. Every row is measured in its own process, after
queries around a wall on a small map, which load the kernels. Time: processor time of one plan of a new planner, and of a plan to
the same goal from its tenth pose. Memory: growth of the peak resident set during the first plan, the costmap not counted; bytes
per state: of its arrays of states, hash table and queue.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from growth import building, far_apart, memory_kb, reset_peak

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner

SIDES = (316, 1000, 2000, 4123)
EASY = 60
"""Cost below which a cell is a good place to start or end."""
NEAR = 100.0


def query(data: Any, which: str) -> tuple[tuple[int, int], tuple[int, int]]:
    """Cells of the start and the goal."""
    if which == "far":
        first, last = far_apart(data)
        return nearest(data, first, 0.0), nearest(data, last, 0.0)
    start, _ = far_apart(np.where(data < EASY, data, np.uint8(254))[:1000, :1000])
    return start, nearest(data, start, NEAR)


def nearest(data: Any, cell: tuple[int, int], distance: float) -> tuple[int, int]:
    """The easy cell nearest to a distance (cells) from a cell, within 400 cells."""
    x0, y0 = max(0, cell[0] - 400), max(0, cell[1] - 400)
    ys, xs = np.nonzero(data[y0 : y0 + 800, x0 : x0 + 800] < EASY)
    best = int(np.argmin(np.abs(np.hypot(xs + x0 - cell[0], ys + y0 - cell[1]) - distance)))
    return int(xs[best]) + x0, int(ys[best]) + y0


def measure(golden: Path, side: int, headings: int, which: str) -> dict[str, Any]:
    """One row, in this process."""
    params = SmacHybridParams(motion_model_for_search="REEDS_SHEPP", angle_quantization_bins=headings)
    small = Costmap(GridGeometry(200, 200, 0.1))
    small.data[:150, 90:110] = 254
    planner = SmacHybridPlanner(params)
    for x in (3.0, 3.5):
        planner.make_plan(small, Pose2D(x, 3.0), Pose2D(16.0, 17.0, 2.0))
    data = building(golden, side)
    costmap = Costmap(GridGeometry(side, side, 0.1), data)
    start, goal = (Pose2D(*costmap.geometry.cell_to_world(*cell)) for cell in query(data, which))
    planner = SmacHybridPlanner(params)
    reset_peak()
    before, began = memory_kb("VmRSS"), time.process_time()
    plan = planner.make_plan(costmap, start, goal)
    took = time.process_time() - began
    peak = memory_kb("VmHWM") - before
    engine = next(iter(planner._engines.values()))
    visited = int(engine.settings["nodes"][0])
    per_state = engine.bytes_per_state
    began = time.process_time()
    planner.make_plan(costmap, plan.path[9], goal)
    return {
        "cells": side * side,
        "headings": headings,
        "query": which,
        "length_m": plan.length_m,
        "ms": took * 1e3,
        "again_ms": (time.process_time() - began) * 1e3,
        "expanded": plan.cells_expanded,
        "visited": visited,
        "bytes_per_state": per_state,
        "peak_mb": peak / 1024,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("golden", type=Path)
    parser.add_argument("--cells", type=float, default=1.7e7, help="size of the largest map")
    parser.add_argument("--headings", type=int, nargs="*", default=[36, 72, 144])
    parser.add_argument("--row", nargs=3, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.row:
        side, headings, which = args.row
        print(json.dumps(measure(args.golden, int(side), int(headings), which)))
        return
    for which in ("far", "near"):
        for side in (s for s in SIDES if s * s <= args.cells * 1.01):
            for headings in args.headings:
                row = [sys.executable, __file__, str(args.golden), "--row", str(side), str(headings), which]
                done = subprocess.run(row, capture_output=True, text=True)
                if done.returncode:
                    print(f"{which} {side} {headings}: {done.stderr.strip().splitlines()[-1]}", file=sys.stderr)
                    continue
                r = json.loads(done.stdout)
                print(
                    f"| {r['query']} | {r['cells']:.1e} | {r['headings']} | {r['length_m']:.0f} | {r['ms']:.1f} | "
                    f"{r['again_ms']:.1f} | {r['expanded']:,} | {r['visited']:,} | {r['bytes_per_state']:.0f} | "
                    f"{r['peak_mb']:.1f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()

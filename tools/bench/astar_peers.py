"""Compare astar with the A* of tcod (C): long queries on a map, with and without costs, at full and four times the resolution.

    pip install tcod && python tools/bench/astar_peers.py MAP.yaml [--queries 5] [--repeats 5]

Obstacles are dilated by 2 cells; weights increase from 1 to 50 near them. Prints medians of processor time (ms). tcod cuts
corners and uses the integer cost of the entered cell, so its paths differ; its graph is built before the measurement.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import tcod.path  # pyright: ignore[reportMissingImports]
from scipy import ndimage

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import AStarParams, AStarPlanner
from navstack.map_io import load_map
from navstack.studies.planners import reachable_pairs


def median_ms(run: Callable[[], object], repeats: int) -> float:
    times: list[float] = []
    for _ in range(repeats):
        started = time.process_time()
        run()
        times.append((time.process_time() - started) * 1e3)
    return statistics.median(times)


def from_scratch(planner: AStarPlanner, costmap: Costmap, start: Pose2D, goal: Pose2D) -> object:
    planner.reset()
    return planner.make_plan(costmap, start, goal)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", type=Path)
    parser.add_argument("--queries", type=int, default=5)
    parser.add_argument("--repeats", type=int, default=5)
    args = parser.parse_args()
    occupied = ndimage.binary_dilation(load_map(args.map).data != 0, iterations=2)
    near = np.clip(np.round(49.0 * np.exp(-ndimage.distance_transform_edt(~occupied) / 6.0)), 0, 49)
    for kind, extra in (("binary", np.zeros(occupied.shape)), ("weighted", near)):
        for scale in (1, 4):
            costs = np.kron(np.where(occupied, 254, extra).astype(np.uint8), np.ones((scale, scale), np.uint8))
            costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], 0.05), np.ascontiguousarray(costs))
            pairs = reachable_pairs(costmap, 8 * args.queries, seed=3)
            pairs = sorted(pairs, key=lambda p: -p[0].distance_to(p[1]))[: args.queries]
            peer = tcod.path.AStar(np.where(costs == 254, 0, costs.astype(np.int32) + 1).astype(np.int32), 1.41421356)
            planner = AStarPlanner(AStarParams(neutral_cost=1.0, cost_factor=1.0))
            planner.make_plan(costmap, *pairs[0])  # compiles and allocates
            ours: list[float] = []
            theirs: list[float] = []
            for start, goal in pairs:
                a = costmap.geometry.world_to_cell(start.x, start.y) or (0, 0)
                b = costmap.geometry.world_to_cell(goal.x, goal.y) or (0, 0)
                ours.append(median_ms(partial(from_scratch, planner, costmap, start, goal), args.repeats))
                theirs.append(median_ms(partial(peer.get_path, a[1], a[0], b[1], b[0]), args.repeats))
            x, y = statistics.median(ours), statistics.median(theirs)
            print(f"{kind:9} x{scale}  astar {x:8.1f} ms   tcod {y:8.1f} ms   {y / x:.2f}x", flush=True)


if __name__ == "__main__":
    main()

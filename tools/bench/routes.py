"""Time of routes on graphs: the golden jobs against Nav2's C++, and grids of up to a million nodes.

    python tools/bench/routes.py [--golden] [--sizes 100 10000 1000000] [--queries 200]

Golden: the median over the solved queries of the best of 20 searches, as the C++ was timed; its time is scaled by the calibration
taken next to each job (above 1, navstack is faster). Grids: nodes 1 m apart with edges both ways between neighbors, as in Nav2's
own benchmark; the mean over random pairs of nodes. Processor time.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from reference import Reference

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from navstack.core import Pose2D
from navstack.routes import RouteError, RouteGraph, RoutePlanner

NAV2_MS = {100: 0.0031, 10_000: 0.232, 90_000: 3.75, 250_000: 11.4, 1_000_000: 44.1}
"""Nav2's own table (machine not named)."""


def grid(side: int) -> RouteGraph:
    """Nodes 1 m apart, edges both ways between the four neighbors."""
    index = np.arange(side * side).reshape(side, side)
    pairs = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:])]
    a = np.concatenate([np.concatenate([p.ravel(), q.ravel()]) for p, q in pairs]).astype(np.int32)
    b = np.concatenate([np.concatenate([q.ravel(), p.ravel()]) for p, q in pairs]).astype(np.int32)
    xy = np.column_stack([index.ravel() % side, index.ravel() // side]).astype(np.float32)
    return RouteGraph(index.ravel().astype(np.int64), xy, np.arange(len(a)) + side * side, a, b)


def ms_of(planner: RoutePlanner, start: Pose2D | int, goal: Pose2D | int, blocked: list[int], repeats: int) -> float:
    """Best time of a search (ms), NaN without a route; scorers of headings need poses, so their association is in it."""
    graph = planner.graph
    needs_poses = any("Orientation" in type(scorer).__name__ for scorer in planner.scorers)
    best = float("inf")
    try:
        ends = [int(graph.node_ids[planner.node_at(pose, is_start=k == 0)]) for k, pose in enumerate((start, goal))]
        for _ in range(repeats + 1):
            began = time.process_time()
            if needs_poses:
                planner.plan(start, goal, blocked=blocked)
            else:
                planner.find(*ends, blocked=blocked)
            best = min(best, time.process_time() - began)
    except RouteError:
        return float("nan")
    return best * 1e3


def mean_ms(run: Callable[..., object], asked: Sequence[Sequence[Any]]) -> float:
    """Mean time of a call (ms)."""
    run(*asked[0])
    began = time.process_time()
    for ends in asked:
        run(*ends)
    return (time.process_time() - began) * 1e3 / len(asked)


def associate(planner: RoutePlanner, start: Pose2D, goal: Pose2D) -> None:
    """Find the nodes of two poses."""
    planner.node_at(start, is_start=True)
    planner.node_at(goal, is_start=False)


def golden() -> None:
    """Print a line per kind of job."""
    from tests.golden import test_routes as routes
    from tests.golden.nav2_w3 import FOLDER, arrays

    times = json.loads((FOLDER / "w3_times.json").read_text())["cases"]
    reference = Reference()
    reference.use_processor_time()
    print(f"{'job':34} {'navstack':>10} {'Nav2':>10} {'ratio':>7}")
    kinds: dict[str, list[str]] = {}
    for name, job in sorted(routes.JOBS.items()):
        group = "route_random" if job["graph_name"].startswith("random") else "route_shipped"
        kinds.setdefault(f"{group}/{name.split('/')[1]}", []).append(name)
    for kind, names in kinds.items():
        if kind not in times:
            continue
        found: list[float] = []
        for name in names:
            job = routes.JOBS[name]
            planner = routes.planner_of(name, job)
            for query in arrays("route")[f"{name}/queries"].tolist():
                start, goal = routes.ends_of(query)
                found += [ms_of(planner, start, goal, job.get("blocked", []), 20)]
        ours = float(np.nanmedian(found)) if np.isfinite(found).any() else float("nan")
        theirs = times[kind]["ms"] * reference.calibration_ms(3) / times[kind]["calibration_ms"]
        print(f"{kind:34} {ours:8.4f} ms {theirs:7.4f} ms {theirs / ours:6.2f}x")


def grids(sizes: list[int], queries: int) -> None:
    """Print a line per size."""
    rng = np.random.default_rng(0)
    print(f"{'nodes':>9} {'route':>10} {'with poses':>11} {'Dijkstra':>10} {'Nav2 says':>10}")
    for size in sizes:
        graph = grid(round(size**0.5))
        planner = RoutePlanner(graph)
        exact = RoutePlanner(graph, planner.params.model_copy(update={"search": "dijkstra"}))
        ends = graph.node_ids[rng.integers(0, len(graph), (queries, 2))]
        pairs = [(int(a), int(b)) for a, b in ends if a != b]
        poses = [[Pose2D(float(graph.xy[i, 0]), float(graph.xy[i, 1])) for i in pair] for pair in pairs]
        found = [mean_ms(planner.find, pairs)]
        found.append(found[0] + mean_ms(partial(associate, planner), poses))
        found.append(mean_ms(exact.find, pairs[:20]))
        said = NAV2_MS.get(size)
        print(f"{len(graph):9} {found[0]:7.4f} ms {found[1]:8.4f} ms {found[2]:7.4f} ms {said or float('nan'):7.4f} ms")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--golden", action="store_true", help="compare the golden jobs with C++ only")
    parser.add_argument("--sizes", type=int, nargs="*", default=[100, 10_000, 90_000, 250_000, 1_000_000])
    parser.add_argument("--queries", type=int, default=200)
    chosen = parser.parse_args()
    if chosen.golden:
        golden()
    else:
        grids(chosen.sizes, chosen.queries)

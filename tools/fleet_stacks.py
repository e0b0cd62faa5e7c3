"""Drive fleets with their whole stacks in packaged maps by each traffic rule, and print a table.

    python tools/fleet_stacks.py --suites corridor door --rules reservation pibt --count 3

Robots of `turtlebot_rpp` begin at nodes of a route graph. Without a rule, they drive to the same places with their own planners.
"single" is the time that the robots need one after another alone, divided by the time of all together, with the time of a robot
alone estimated from its route at the speed of its local planner. A run is "done" if every goal was reached.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from navstack.core import Pose2D
from navstack.fleet import Fleet, FleetResult, load_fleet, make_fleet, run_fleet, shipped_fleets
from navstack.parameters import load_configuration
from navstack.routes import RouteGraph, RoutePlanner, build_graph, load_graph
from navstack.scenario import Scenario

SPEED = 0.5
"""Of turtlebot_rpp (m/s)."""
RULES = ("none", "lanes", "reservation", "pibt")


@dataclass
class Stage:
    """A map with a route graph, starts and goals (ids of nodes)."""

    fleet: str
    """Name of the packaged fleet whose map it has."""
    graph: RouteGraph
    starts: list[int]
    goals: list[list[int]]
    time_limit_s: float = 400.0


def corridor(seed: int) -> Stage:
    """Two robots swap the ends of the corridor of the office; one bay beside it."""
    rng = np.random.default_rng(seed)
    nodes = {i: (2.0 + 2.0 * i, 7.3) for i in range(6)}
    bay = int(rng.integers(1, 5))
    nodes[10] = (nodes[bay][0], 8.1)
    graph = build_graph(nodes, [*((i, i + 1) for i in range(5)), (bay, 10)], both_ways=True)
    return Stage("corridor_two", graph, [0, 5], [[5], [0]])


def crossing(seed: int) -> Stage:
    """Four robots where two aisles of the warehouse cross; each drives to another one's start."""
    graph, ends = load_graph(shipped_fleets()["warehouse_lanes"].parent / "warehouse.geojson"), [58, 76, 101, 78]
    turn = 1 + seed % 3
    return Stage("crossing_four", graph, ends, [[ends[(i + turn) % 4]] for i in range(4)])


def door(seed: int) -> Stage:
    """Eight robots change sides of a door of 0.9 m."""
    rng = np.random.default_rng(seed)
    out = {i: (0.45 + 1.0 * i, 7.9) for i in range(8)}
    inside = {20: (0.45, 5.6), 21: (1.45, 5.6), 22: (2.45, 6.0), 23: (3.3, 5.6), 24: (3.3, 4.6), 25: (4.3, 6.0)}
    inside |= {26: (5.3, 6.0), 27: (3.3, 3.5), 28: (5.3, 5.0), 29: (5.3, 4.0)}
    edges = [*((i, i + 1) for i in range(7)), (1, 10), (10, 21), (20, 21), (21, 22), (22, 23), (23, 24), (24, 27)]
    edges += [(22, 25), (23, 25), (25, 26), (26, 28), (28, 29)]
    graph = build_graph(out | {10: (1.45, 6.8)} | inside, edges, both_ways=True)
    there, here = rng.permutation([*inside])[:4].tolist(), rng.permutation([*out])[:4].tolist()
    return Stage("narrow_door_eight", graph, [*here, *there], [*([n] for n in there), *([n] for n in here)])


def ring(seed: int) -> Stage:
    """Six robots drive around a rack of the warehouse in both directions."""
    whole = load_graph(shipped_fleets()["warehouse_lanes"].parent / "warehouse.geojson")
    loop = [11, 19, 26, 31, 41, 48, 58, 64, 77, 81, 78, 65, 59, 49, 42, 32, 27, 20, 12, 5, 4, 3]
    bays = [(11, 2), (12, 6), (77, 87), (78, 83)]
    xy = whole.xy.astype(float)
    at = {n: (xy[whole.node(n), 0], xy[whole.node(n), 1]) for n in {*loop, *(b for _, b in bays)}}
    graph = build_graph(at, [*zip(loop, [*loop[1:], loop[0]]), *bays], both_ways=True)
    starts = [int(n) for n in np.random.default_rng(seed).permutation(loop[::2])[:6]]
    far = {n: loop[(i + len(loop) // 2) % len(loop)] for i, n in enumerate(loop)}
    return Stage("ring", graph, starts, [[far[n], n] for n in starts])


def scattered(seed: int) -> Stage:
    """Ten robots between random nodes of the warehouse."""
    rng = np.random.default_rng(seed)
    graph = load_graph(shipped_fleets()["warehouse_lanes"].parent / "warehouse.geojson")

    def apart(count: int) -> list[int]:
        chosen: list[int] = []
        for node in rng.permutation(graph.node_ids).tolist():
            xy = graph.xy[[graph.node(n) for n in [*chosen, node]]]
            if len(chosen) < count and (len(xy) == 1 or np.hypot(*(xy[:-1] - xy[-1]).T).min() > 1.5):
                chosen.append(int(node))
        return chosen

    return Stage("warehouse_lanes", graph, apart(10), [[goal] for goal in apart(10)])


STAGES = {"corridor": corridor, "crossing": crossing, "door": door, "ring": ring, "random": scattered}


def fleet_of(stage: Stage, rule: str, seed: int) -> Fleet:
    """Return the robots of a stage."""
    configuration = load_configuration(["turtlebot_rpp"])
    world = load_fleet(stage.fleet).robots[0].scenario.map
    scenarios: dict[str, Scenario] = {}
    routes: dict[str, list[int]] = {}
    for number, (start, goals) in enumerate(zip(stage.starts, stage.goals)):
        (x, y), name = stage.graph.xy[stage.graph.node(start)].tolist(), f"robot_{number}"
        scenarios[name] = Scenario(world, configuration, Pose2D(x, y, 0.0), (), time_limit_s=stage.time_limit_s)
        routes[name] = goals
    return make_fleet(scenarios, seed=seed, routes=routes, graph=stage.graph, traffic={"rule": rule})


def alone_s(stage: Stage) -> float:
    """Return the sum of the times in which each robot alone drives its route (s)."""
    planner, total = RoutePlanner(stage.graph), 0.0
    for start, goals in zip(stage.starts, stage.goals):
        for before, goal in zip([start, *goals], goals):
            total += planner.find(before, goal).length_m / SPEED
    return total


def reached(result: FleetResult) -> tuple[int, int]:
    """Return how many goals were reached, and how many there were, without those of making way."""
    goals = [goal for robot in result.robots for goal in robot.run.goals if "make way" not in str(goal)]
    return sum(goal.succeeded for goal in goals), len(goals)


def main() -> None:
    """Print a line per run, and one per suite and rule."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1, help="seeds per suite")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--suites", nargs="+", default=list(STAGES), choices=list(STAGES))
    parser.add_argument("--rules", nargs="+", default=RULES, choices=RULES)
    parser.add_argument("--runs", action="store_true", help="print a line per run, with what went wrong")
    args = parser.parse_args()
    print("suite     rule         runs  done  goals    contacts  time_s  waiting  single", flush=True)
    for suite in args.suites:
        for rule in args.rules:
            rows, began = [], time.process_time()
            for seed in range(args.first, args.first + args.count):
                stage = STAGES[suite](seed)
                result = run_fleet(fleet_of(stage, rule, seed), record=False, measure=False)
                got, count = reached(result)
                last = result.makespan_s
                rows.append(
                    (
                        got,
                        count,
                        len(result.contacts),
                        last,
                        result.waiting_s / len(result.robots) / last,
                        alone_s(stage),
                    )
                )
                if args.runs:
                    print(f"  {suite} {rule} {seed}: {result}", *(str(c) for c in result.contacts[:4]), sep="; ")
                    for robot in result.robots:
                        for goal in robot.run.goals:
                            if not goal.succeeded:
                                print(f"    {robot.name}: {goal}; {[w.reason for w in robot.waits][-1:]}")
            done = [row for row in rows if row[0] == row[1]]
            mean = np.mean([row[3] for row in done]) if done else math.nan
            waiting = np.mean([row[4] for row in done]) if done else math.nan
            single = np.mean([row[5] / row[3] for row in done]) if done else math.nan
            print(
                f"{suite:9} {rule:12} {len(rows):4} {len(done):5} {sum(r[0] for r in rows):4}/{sum(r[1] for r in rows):<4} "
                f"{sum(r[2] for r in rows):7} {mean:7.1f} {waiting:8.0%} {single:7.2f}  ({time.process_time() - began:.0f} s)",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""Drive suites of fleets by each traffic rule, and print a table.

    python tools/fleet_runs.py --count 100 --rules lanes reservation pibt

The world is one of discs on graph edges, to run rules by the thousand: each disc drives its granted nodes at its own speed.
"single" is the time that the robots need one after another alone, divided by the time of all together: how many robots' work the
fleet does. `tests/traffic` uses the same world. `navstack simulate` drives fleets with the whole stack.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from navstack.core import Pose2D
from navstack.routes import RouteGraph, RoutePlanner, build_graph
from navstack.traffic import Communication, Grant, RobotReport, TrafficControl, TrafficParams, make_rule

RADIUS = 0.3


@dataclass
class Disc:
    """A robot of the rig."""

    name: str
    xy: np.ndarray
    goals: list[int]
    speed: float
    priority: float = 0.0
    alive: bool = True
    nodes: tuple[int, ...] = ()
    """Ids of what it has been granted, beginning with the last node that it passed."""
    granted: float = -math.inf
    """When its grant was given (s)."""
    until: float = math.inf
    """When its grant ends (s)."""
    driven_m: float = 0.0
    waited_s: float = 0.0
    reached: list[float] = field(default_factory=list)
    """Times."""


@dataclass
class Case:
    """A graph, and robots with starts and goals."""

    graph: RouteGraph
    starts: dict[str, int]
    goals: dict[str, list[int]]
    radius: float = RADIUS


@dataclass
class Result:
    """What happened."""

    time: float
    done: bool
    contacts: set[tuple[str, str]]
    robots: list[Disc]
    control: TrafficControl
    reasons: dict[str, str]

    @property
    def kinds(self) -> dict[str, int]:
        found: dict[str, int] = {}
        for event in self.control.rule.events:
            found[event.kind] = found.get(event.kind, 0) + 1
        return found


def drive(
    case: Case,
    rule: str,
    *,
    seed: int = 0,
    until: float = 600.0,
    step: float = 0.5,
    params: TrafficParams | None = None,
    link: Communication | None = None,
    deaths: dict[str, float] | None = None,
    silences: dict[str, tuple[float, float]] | None = None,
    order: int = 0,
    check: bool = True,
    watch: Callable[[TrafficControl], None] | None = None,
) -> Result:
    """Drive all robots through their goals; `order` turns the list of reports, `check` looks for contacts.

    `deaths`: when robots stop for good; `silences`: from when until when their messages are lost (s). `watch` is called after
    each exchange.
    """
    rng = np.random.default_rng(seed)
    robots = [
        Disc(
            name,
            case.graph.xy[case.graph.node(case.starts[name])].astype(float),
            list(case.goals[name]),
            0.5 + 0.5 * rng.random(),
        )
        for name in sorted(case.starts)
    ]
    for robot in robots:
        robot.nodes = (case.starts[robot.name],)
    control = TrafficControl(make_rule(rule, case.graph, params or TrafficParams(reach=0.05)), link)
    contacts: set[tuple[str, str]] = set()
    now, grants = 0.0, dict[str, Grant]()
    while now < until:
        for name, at in (deaths or {}).items():
            for robot in robots:
                if robot.name == name and now >= at:
                    robot.alive = False
        mute = {name for name, (begin, end) in (silences or {}).items() if begin <= now < end}
        reports = [
            RobotReport(
                r.name,
                Pose2D(float(r.xy[0]), float(r.xy[1]), 0.0),
                case.radius,
                r.goals[0] if r.goals else None,
                r.priority,
                r.alive,
                now,
                speed=1.0,
            )
            for r in robots
            if r.name not in mute
        ]
        turn = order % max(len(reports), 1)
        grants = control.update(now, reports[turn:] + reports[:turn])
        if watch is not None:
            watch(control)
        for robot in robots:
            if robot.alive:
                _move(robot, None if robot.name in mute else grants.get(robot.name), case.graph, step, now)
        if check:
            contacts |= _contacts(robots, case.radius)
        now += step
        if all(not r.goals or not r.alive for r in robots):
            break
    done = all(not r.goals or not r.alive for r in robots)
    return Result(now, done, contacts, robots, control, {name: grant.reason for name, grant in grants.items()})


def _move(robot: Disc, grant: Grant | None, graph: RouteGraph, step: float, now: float) -> None:
    if grant is not None and grant.nodes and grant.time > robot.granted:
        robot.granted, robot.until = grant.time, grant.until
        nodes = grant.nodes
        if robot.nodes[:2] in list(pairwise(nodes)):  # on the way it has driven since the report
            nodes = nodes[next(k for k, leg in enumerate(pairwise(nodes)) if leg == robot.nodes[:2]) :]
        elif len(robot.nodes) == 1 and robot.nodes[0] in nodes:
            nodes = nodes[nodes.index(robot.nodes[0]) :]
        robot.nodes = nodes
    left = robot.speed * step if now < robot.until else 0.0
    while left > 1e-9 and len(robot.nodes) > 1:
        target = graph.xy[graph.node(robot.nodes[1])].astype(float)
        way = target - robot.xy
        long = float(np.hypot(*way))
        if long <= left:
            robot.xy, left = target, left - long
            robot.driven_m += long
            robot.nodes = robot.nodes[1:]
        else:
            robot.xy = robot.xy + way * (left / long)
            robot.driven_m += left
            left = 0.0
    if robot.goals:
        robot.waited_s += left / robot.speed
        if len(robot.nodes) == 1 and robot.nodes[0] == robot.goals[0]:
            robot.goals.pop(0)
            robot.reached.append(now + step)


def _contacts(robots: list[Disc], radius: float) -> set[tuple[str, str]]:
    xy = np.array([r.xy for r in robots])
    away = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
    pairs = np.argwhere(np.triu(away < 2.0 * radius - 1e-6, 1))
    return {(robots[a].name, robots[b].name) for a, b in pairs.tolist()}


# --- cases ------------------------------------------------------------------------------------------------------------


def grid(nx: int, ny: int, spacing: float = 2.0, gone: set[int] | None = None) -> RouteGraph:
    """A grid of nodes with edges in both directions, without the nodes `gone`."""
    nodes = {
        iy * nx + ix: (ix * spacing, iy * spacing)
        for iy in range(ny)
        for ix in range(nx)
        if iy * nx + ix not in (gone or set())
    }
    edges = [(a, b) for a in nodes for b in (a + 1, a + nx) if b in nodes and (b != a + 1 or b % nx)]
    return build_graph(nodes, edges, both_ways=True)


def corridor(seed: int) -> Case:
    """Two robots that swap ends of a corridor with one bay."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 10))
    bay = int(rng.integers(1, n - 1))
    nodes = {i: (2.0 * i, 0.0) for i in range(n)} | {n: (2.0 * bay, 2.0)}
    graph = build_graph(nodes, [*((i, i + 1) for i in range(n - 1)), (bay, n)], both_ways=True)
    return Case(graph, {"robot_0": 0, "robot_1": n - 1}, {"robot_0": [n - 1], "robot_1": [0]})


def crossing(seed: int) -> Case:
    """Four robots that cross one node, and go back."""
    nodes, edges, ends = {0: (0.0, 0.0)}, [], []
    for arm, (dx, dy) in enumerate(((1, 0), (0, 1), (-1, 0), (0, -1))):
        for k in range(1, 5):
            number = 10 * (arm + 1) + k
            nodes[number] = (2.0 * k * dx, 2.0 * k * dy)
            edges.append((number - 1 if k > 1 else 0, number))
        nodes[10 * (arm + 1) + 9] = (8.0 * dx + 2.0 * dy, 8.0 * dy + 2.0 * dx)
        edges.append((10 * (arm + 1) + 4, 10 * (arm + 1) + 9))
        ends.append(10 * (arm + 1) + 4)
    graph = build_graph(nodes, edges, both_ways=True)
    turn = 1 + seed % 3
    return Case(
        graph,
        {f"robot_{i}": end for i, end in enumerate(ends)},
        {f"robot_{i}": [ends[(i + turn) % 4], end] for i, end in enumerate(ends)},
    )


def door(seed: int, count: int = 8) -> Case:
    """Two rooms of 3 by 4 nodes with a door between them, `count` robots that change rooms."""
    rng = np.random.default_rng(seed)
    nodes, edges = {}, []
    for room in (0, 1):
        for iy in range(4):
            for ix in range(3):
                number = 100 * room + 3 * iy + ix
                nodes[number] = (10.0 * room + 2.0 * ix, 2.0 * iy)
                edges += [(number, number + 1)] if ix < 2 else []
                edges += [(number, number + 3)] if iy < 3 else []
    nodes[200], nodes[201] = (6.0, 2.0), (8.0, 2.0)
    edges += [(5, 200), (200, 201), (201, 103)]
    graph = build_graph(nodes, edges, both_ways=True)
    sides = [rng.permutation(12)[: count // 2], 100 + rng.permutation(12)[: count // 2]]
    starts, goals = {}, {}
    for i in range(count):
        side, k = i % 2, i // 2
        starts[f"robot_{i}"] = int(sides[side][k])
        goals[f"robot_{i}"] = [int(sides[1 - side][k])]
    return Case(graph, starts, goals)


def ring(seed: int, count: int = 6) -> Case:
    """A ring of 12 nodes with two bays; robots go half around."""
    rng = np.random.default_rng(seed)
    n = 12
    nodes = {i: (4.5 * math.cos(math.tau * i / n), 4.5 * math.sin(math.tau * i / n)) for i in range(n)}
    nodes |= {20: (6.5, 0.0), 21: (-6.5, 0.0)}
    graph = build_graph(nodes, [*((i, (i + 1) % n) for i in range(n)), (0, 20), (6, 21)], both_ways=True)
    starts = rng.permutation(n)[:count].tolist()
    return Case(
        graph,
        {f"robot_{i}": start for i, start in enumerate(starts)},
        {f"robot_{i}": [(start + n // 2) % n, start] for i, start in enumerate(starts)},
    )


def warehouse(seed: int, count: int = 20, tasks: int = 3) -> Case:
    """Aisles in both directions between three cross aisles; robots drive from station to station."""
    rng = np.random.default_rng(seed)
    gone = {iy * 9 + ix for iy in (1, 2, 4, 5) for ix in (1, 3, 5, 7)}
    graph = grid(9, 7, 2.0, gone)
    ids = graph.node_ids.tolist()
    starts = rng.permutation(ids)[:count].tolist()
    return Case(graph, *_tasks(rng, ids, starts, tasks))


def random_graph(seed: int) -> Case:
    """A grid with holes, connected, and robots on a fifth to a third of its nodes."""
    rng = np.random.default_rng(seed)
    nx, ny = int(rng.integers(4, 8)), int(rng.integers(4, 8))
    gone: set[int] = set()
    for node in rng.permutation(nx * ny)[: int(0.25 * nx * ny)].tolist():
        if _connected(nx, ny, gone | {node}):
            gone.add(node)
    graph = grid(nx, ny, 2.0, gone)
    ids = graph.node_ids.tolist()
    count = max(2, int(len(ids) * rng.uniform(0.15, 0.33)))
    return Case(graph, *_tasks(rng, ids, rng.permutation(ids)[:count].tolist(), 2))


def _tasks(
    rng: np.random.Generator, ids: list[int], starts: list[int], tasks: int
) -> tuple[dict[str, int], dict[str, list[int]]]:
    goals: dict[str, list[int]] = {f"robot_{i}": [] for i in range(len(starts))}
    for _ in range(tasks):
        for i, goal in enumerate(rng.permutation(ids)[: len(starts)].tolist()):
            goals[f"robot_{i}"].append(int(goal))
    return {f"robot_{i}": int(start) for i, start in enumerate(starts)}, goals


def _connected(nx: int, ny: int, gone: set[int]) -> bool:
    nodes = [node for node in range(nx * ny) if node not in gone]
    seen, queue = {nodes[0]}, [nodes[0]]
    for node in queue:
        near = [node + nx, node - nx] + ([node + 1] if node % nx < nx - 1 else []) + ([node - 1] if node % nx else [])
        for other in near:
            if 0 <= other < nx * ny and other not in gone and other not in seen:
                seen.add(other)
                queue.append(other)
    return len(seen) == len(nodes)


CASES = {
    "corridor": corridor,
    "crossing": crossing,
    "door": door,
    "ring": ring,
    "warehouse": warehouse,
    "random": random_graph,
}


def alone_s(case: Case, seed: int) -> float:
    """Return the sum of the times in which each robot alone reaches its goals (s)."""
    total = 0.0
    rng = np.random.default_rng(seed)
    planner = RoutePlanner(case.graph)
    for name in sorted(case.starts):
        speed, here = 0.5 + 0.5 * rng.random(), case.starts[name]
        for goal in case.goals[name]:
            total += planner.find(here, goal).length_m / speed
            here = goal
    return total


def main() -> None:
    """Print one line per suite and rule."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20, help="seeds per suite")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--suites", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument(
        "--rules", nargs="+", default=["lanes", "reservation", "pibt"], choices=["lanes", "reservation", "pibt"]
    )
    parser.add_argument(
        "--until", type=float, default=1200.0, help="simulated time after which a run counts as locked (s)"
    )
    parser.add_argument("--dropout", type=float, default=0.0, help="share of the messages that is lost")
    parser.add_argument("--delay", type=float, default=0.0, help="delay of each message (s)")
    args = parser.parse_args()
    print(
        "suite      rule         runs  done  with contact  deadlocks  time_s  waiting  single  locked seeds", flush=True
    )
    for suite in args.suites:
        for rule in args.rules:
            runs, began = [], time.process_time()
            seeds = range(args.first, args.first + args.count)
            for seed in seeds:
                link = Communication(args.delay, args.dropout, seed)
                case = CASES[suite](seed)
                result = drive(case, rule, seed=seed, until=args.until, link=link)
                runs.append((seed, result.done, bool(result.contacts), result, alone_s(case, seed)))
            done = [run for run in runs if run[1]]
            mean = np.mean([run[3].time for run in done]) if done else math.nan
            waiting = (
                np.mean([np.mean([r.waited_s for r in run[3].robots]) / run[3].time for run in done])
                if done
                else math.nan
            )
            single = np.mean([run[4] / run[3].time for run in done]) if done else math.nan
            deadlocks = sum(run[3].kinds.get("deadlock", 0) for run in runs)
            print(
                f"{suite:10} {rule:12} {len(runs):4} {len(done):5} {sum(run[2] for run in runs):13} {deadlocks:10} {mean:7.1f} "
                f"{waiting:8.0%} {single:7.2f}  {[run[0] for run in runs if not run[1]][:12]}  "
                f"({time.process_time() - began:.0f} s of processor time)",
                flush=True,
            )


if __name__ == "__main__":
    main()

"""Traffic: which robot may drive how far on a route graph, who waits for whom, and how a deadlock is dissolved.

A rule reads reports of the robots and returns a grant for each: nodes that it may drive through, which are never taken back, and
the horizon beyond them. What a robot has been granted from its last reported place on is reserved for it; two reservations keep
the distance at which the footprints pass. So an old report makes a reservation longer, never shorter, and a lost grant only
makes a robot wait. The result depends on the reports, not on their order.
"""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any, ClassVar, Final

import numpy as np
import shapely

from navstack.core import InputError, Path, Pose2D
from navstack.plugins import ParamModel, param
from navstack.routes import NoValidRouteError, RouteGraph, RoutePlanner

_EPSILON: Final = 1e-6
_OFF_LINE_M: Final = 0.02
"""A robot farther than this from its edge holds the way back to it, too."""


class TrafficParams(ParamModel):
    """Parameters of the traffic rules."""

    ahead: float = param(4.0, "reserve nodes and edges up to this distance ahead", unit="m", gt=0.0)
    margin: float = param(0.1, "distance between two footprints at which they still pass each other", unit="m", ge=0.0)
    reach: float = param(0.3, "a node counts as passed at this distance", unit="m", gt=0.0)
    aging: float = param(30.0, "a robot on its way for this time counts as one priority higher", unit="s", gt=0.0)
    silence: float = param(5.0, "routes avoid a robot without a report for this time", unit="s", gt=0.0)
    detour: float = param(2.0, "to dissolve a deadlock a route may be this many times as long", ge=1.0)
    path_density: float = param(0.05, "distance between poses of the path of a grant", unit="m", gt=0.0)


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What a robot tells the traffic control."""

    name: str
    pose: Pose2D
    """In the frame of the graph."""
    radius: float
    """Of the circle around the footprint (m)."""
    goal: int | None = None
    """Id of the node to drive to; None: idle, may be sent out of the way."""
    priority: float = 0.0
    """Higher goes first."""
    active: bool = True
    """False: it stands and cannot drive."""
    time: float = 0.0
    """When it was written (s)."""
    battery: float = 1.0
    """State of charge, 0 to 1."""


@dataclass(frozen=True, slots=True)
class Grant:
    """What a robot may do."""

    nodes: tuple[int, ...] = ()
    """Ids of the nodes from the last one passed to the last one it may drive to; those are never taken back."""
    horizon: tuple[int, ...] = ()
    """Ids of the nodes after them, which may change."""
    reason: str = ""
    """Why it may not drive on: empty if it may drive to the end of its route."""
    waits_for: tuple[str, ...] = ()
    """Robots that hold what it needs next."""
    free: bool = False
    """True: no graph, it drives to its goal as it likes."""
    time: float = 0.0
    """When it was given (s)."""

    @property
    def up_to(self) -> int | None:
        """Id of the last node it may drive to."""
        return self.nodes[-1] if self.nodes else None


@dataclass(frozen=True, slots=True)
class TrafficEvent:
    """Something that the traffic control found or did."""

    time: float
    kind: str
    """`deadlock`, `dissolved`, `rerouted`, `makes_way`, `stuck`, `silent`."""
    robots: tuple[str, ...]
    text: str


class TrafficRule(ABC):
    """Grants robots their way; a pure function of the reports that it has got, whatever their order."""

    name: ClassVar[str]

    def __init__(self, graph: RouteGraph | None = None, params: TrafficParams | None = None) -> None:
        self.graph = graph
        self.params = params or TrafficParams()
        self.events: list[TrafficEvent] = []
        """In the order of time."""

    @abstractmethod
    def update(self, now: float, reports: Iterable[RobotReport]) -> dict[str, Grant]:
        """Return the grant of each robot that has ever reported; a robot without a new report keeps its last one."""

    def path(self, nodes: Sequence[int], pose: Pose2D | None = None) -> Path:
        """Return the path along the nodes (ids) of a grant, from the point next to `pose` on; heads for the next pose."""
        graph = _checked(self.graph, self.name)
        corners = graph.xy[[graph.node(node) for node in nodes]].astype(np.float64)
        line = shapely.LineString(corners if len(corners) > 1 else np.repeat(corners, 2, axis=0))
        begin = (
            0.0
            if pose is None or len(corners) < 2
            else shapely.line_locate_point(shapely.LineString(corners[:2]), shapely.Point(pose.x, pose.y))
        )
        whole = line.length - begin
        steps = max(1, math.ceil(whole / self.params.path_density))
        points = shapely.get_coordinates(
            shapely.line_interpolate_point(line, begin + np.linspace(0.0, whole, steps + 1))
        )
        poses = np.zeros((len(points), 3))
        poses[:, :2] = points
        moves = np.diff(points, axis=0)
        if whole > _EPSILON:
            poses[:-1, 2] = np.arctan2(moves[:, 1], moves[:, 0])
            poses[-1, 2] = poses[-2, 2]
        elif pose is not None:
            poses[:, 2] = pose.yaw
        return Path(poses, graph.frame)


class NoTraffic(TrafficRule):
    """No rule: each robot drives to its goal as if it were alone."""

    name = "none"

    def update(self, now: float, reports: Iterable[RobotReport]) -> dict[str, Grant]:
        """Return a free grant for each report."""
        return {report.name: Grant(free=True, time=now) for report in sorted(reports, key=lambda report: report.name)}


# --- reservations -----------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Robot:
    """A robot as the traffic control knows it. Nodes and edges are indices."""

    report: RobotReport
    route: list[int]
    """Nodes: the last one passed, those granted, and the horizon."""
    since: float
    """Since when it has its goal (s)."""
    goal: int | None = None
    clear: int = 0
    """Place in the route of the last granted node."""
    shapes: list[Any] = field(default_factory=list[Any])
    """What it holds as geometries, and their edges (-1: the place where it stands)."""
    edges: list[int] = field(default_factory=list[int])
    box: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    left_m: float = 0.0
    """Way to the end of the grant."""
    aside: str = ""
    """Name of the robot that it makes way for."""
    way_back: frozenset[int] = frozenset()
    """Nodes that robot has to have passed before this one returns."""
    avoided: set[str] = field(default_factory=set[str])
    """Robots for which it has taken another route to its goal: not twice, or it goes to and fro between two of them."""
    silent: bool = False
    stranded: bool = False
    """True: robots that stand for good bar every way to its goal."""
    text: str = ""
    """Why it waits, without whom for."""
    blockers: dict[str, str] = field(default_factory=dict[str, str])
    """What it needs next by the robot that holds it."""
    hard: tuple[str, ...] = ()
    """Of these the ones that hold it where their grants end."""

    @property
    def name(self) -> str:
        return self.report.name

    @property
    def end(self) -> int:
        return self.route[self.clear]

    @property
    def lost(self) -> bool:
        return self.silent or not self.report.active


class _GraphTraffic(TrafficRule):
    """Keeps what each robot has passed, holds and needs; a subclass decides about the next node."""

    def __init__(self, graph: RouteGraph | None = None, params: TrafficParams | None = None) -> None:
        super().__init__(_checked(graph, self.name), params)
        self._graph = _checked(graph, self.name)
        self._planner = RoutePlanner(self._graph)
        self._xy = self._graph.xy.astype(np.float64)
        self._robots: dict[str, _Robot] = {}
        self._said: set[tuple[str, ...]] = set()
        xy, starts, ends = self._xy, self._graph.starts, self._graph.ends
        self._lines: Any = shapely.linestrings(np.stack([xy[starts], xy[ends]], axis=1))
        self._points: Any = shapely.points(xy)
        self._boxes: list[list[float]] = shapely.bounds(self._lines).tolist()
        self._edge: dict[tuple[int, int], int] = {}
        for edge, pair in enumerate(zip(starts.tolist(), ends.tolist())):
            self._edge.setdefault(pair, edge)
        self._groups_of_edge = {
            edge: _groups(data) for edge, data in self._graph.edge_metadata.items() if "mutex" in data
        }
        self._groups_of_node = {
            node: _groups(data) for node, data in self._graph.node_metadata.items() if "mutex" in data
        }

    def update(self, now: float, reports: Iterable[RobotReport]) -> dict[str, Grant]:
        """Take the reports, grant what is free, and return all grants by the names of the robots."""
        for report in sorted(reports, key=lambda report: report.name):
            self._take(report, now)
        robots = [self._robots[name] for name in sorted(self._robots)]
        for robot in robots:
            silent = now - robot.report.time > self.params.silence
            if silent and not robot.silent:
                self._tell(now, "silent", (robot.name,), f"{robot.name} has not reported for {self.params.silence:g} s")
            robot.silent = silent
            self._advance(robot)
        self._decide(now, sorted(robots, key=lambda robot: self._rank(robot, now)))
        return {robot.name: self._grant(robot, now) for robot in robots}

    @abstractmethod
    def _decide(self, now: float, robots: list[_Robot]) -> None:
        """Extend the grants of the robots, highest rank first."""

    def held(self) -> dict[str, tuple[str, ...]]:
        """Return what each robot holds: edges, and the node it may drive to."""
        return {name: self._held(robot) for name, robot in sorted(self._robots.items())}

    def forget(self, name: str) -> None:
        """Take a robot out, once it has been carried away: nothing is reserved for it any more."""
        self._robots.pop(name, None)

    def _held(self, robot: _Robot) -> tuple[str, ...]:
        ids = self._graph.edge_ids
        edges = tuple(f"edge {int(ids[edge])}" for edge in dict.fromkeys(robot.edges) if edge >= 0)
        return *edges, f"node {self._id(robot.end)}"

    def _id(self, node: int) -> int:
        return int(self._graph.node_ids[node])

    def _tell(self, now: float, kind: str, robots: Iterable[str], text: str) -> None:
        self.events.append(TrafficEvent(now, kind, tuple(robots), text))

    def _rank(self, robot: _Robot, now: float) -> tuple[float, str, int]:
        """Return what sorts the robots, highest rank first: priority and time on the way, then the name; idle robots come last.

        Who makes way for another robot inherits its rank.
        """
        ranks: list[tuple[float, str, int]] = []
        seen = set[str]()
        each: _Robot | None = robot
        while each is not None and each.name not in seen:
            age = (now - each.since) / self.params.aging if each.goal is not None else -1e9
            ranks.append((-each.report.priority - age, each.name, len(seen)))
            seen.add(each.name)
            each = self._robots.get(each.aside)
        return min(ranks)

    # --- where the robots are -----------------------------------------------------------------------------------------

    def _take(self, report: RobotReport, now: float) -> None:
        robot = self._robots.get(report.name)
        if robot is not None and report.time < robot.report.time:
            return  # overtaken on its way by a later one
        goal = None if report.goal is None else self._graph.node(report.goal)
        if robot is None:
            away = np.hypot(*(self._xy - report.pose[:2]).T)
            robot = self._robots[report.name] = _Robot(report, [int(away.argmin())], now)
        if goal != robot.goal:
            robot.since, robot.goal = now, goal
            robot.avoided.clear()
        if not report.active and robot.report.active:
            self._tell(now, "stuck", (report.name,), f"{report.name} cannot drive")
        robot.report = report

    def _advance(self, robot: _Robot) -> None:
        """Find the place of a robot on what it holds; what is behind it is free."""
        x, y = robot.report.pose[0], robot.report.pose[1]
        xy, route, reach = self._xy, robot.route, self.params.reach
        if not robot.report.active:  # stands for good: only its place stays reserved
            del route[robot.clear + 1 :]
            robot.clear, robot.shapes, robot.edges, robot.left_m = len(route) - 1, [shapely.Point(x, y)], [-1], 0.0
            robot.box = (x, y, x, y)
            return
        spots = [self._nearest(x, y, *xy[a], *xy[b]) for a, b in pairwise(route[: robot.clear + 1])]
        at = 0
        if spots:
            least = min(away for away, _, _ in spots) + _EPSILON + 0.5 * self.params.margin
            at = next(i for i, spot in enumerate(spots) if spot[0] <= least)
            if math.hypot(x - xy[route[at + 1]][0], y - xy[route[at + 1]][1]) <= reach:
                at += 1
        del route[:at]
        robot.clear -= at
        place = tuple(xy[route[0]].tolist())
        if robot.clear > 0:
            place = self._nearest(x, y, *xy[route[0]], *xy[route[1]])[1:]
        robot.shapes, robot.edges = [], []
        if robot.clear > 0:
            robot.edges.append(self._edge[route[0], route[1]])
            robot.shapes.append(shapely.LineString([place, xy[route[1]]]))
        if robot.clear == 0 or math.hypot(x - place[0], y - place[1]) > _OFF_LINE_M:
            robot.edges.append(-1)
            robot.shapes.append(shapely.LineString([(x, y), place]))
        robot.left_m = math.hypot(x - place[0], y - place[1])
        if robot.clear > 0:
            robot.left_m += math.hypot(*(xy[route[1]] - place))
        for a, b in pairwise(route[1 : robot.clear + 1]):
            self._hold(robot, a, b)
        robot.box = tuple(shapely.total_bounds(robot.shapes).tolist())

    @staticmethod
    def _nearest(x: float, y: float, x0: float, y0: float, x1: float, y1: float) -> tuple[float, float, float]:
        """Return the distance to a segment, and its point there."""
        dx, dy = x1 - x0, y1 - y0
        share = min(max(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0.0), 1.0)
        px, py = float(x0 + share * dx), float(y0 + share * dy)
        return math.hypot(x - px, y - py), px, py

    def _hold(self, robot: _Robot, a: int, b: int) -> None:
        edge = self._edge[a, b]
        robot.edges.append(edge)
        robot.shapes.append(self._lines[edge])
        robot.left_m += float(self._graph.lengths[edge])
        low_x, low_y, high_x, high_y = self._boxes[edge]
        box = robot.box
        robot.box = (min(box[0], low_x), min(box[1], low_y), max(box[2], high_x), max(box[3], high_y))

    def _extend(self, robot: _Robot) -> None:
        """Grant the next node of the route."""
        self._hold(robot, robot.end, robot.route[robot.clear + 1])
        robot.clear += 1

    def _turns_back(self, robot: _Robot) -> bool:
        """Return whether it holds the next node already: its place would have two meanings, so it drives to the end first."""
        return robot.route[robot.clear + 1] in robot.route[: robot.clear]

    # --- who is in the way --------------------------------------------------------------------------------------------

    def _gap(self, a: _Robot, b: _Robot) -> float:
        return a.report.radius + b.report.radius + self.params.margin

    def _conflicts(self, robot: _Robot, edge: int) -> tuple[dict[str, str], tuple[str, ...]]:
        """Return what is held of the way along an edge by robot, and which hold it where their grants end."""
        found: dict[str, str] = {}
        hard: list[str] = []
        x0, y0, x1, y1 = self._boxes[edge]
        groups = self._groups_on(edge)
        for name in sorted(self._robots):
            other = self._robots[name]
            if other is robot:
                continue
            if groups:
                held, at_end = self._groups_held(other)
                if shared := sorted(groups & held):
                    found[name] = f'the group "{shared[0]}"'
                    if groups & at_end:
                        hard.append(name)
                    continue
            gap, box = self._gap(robot, other), other.box
            if box[0] - x1 >= gap or x0 - box[2] >= gap or box[1] - y1 >= gap or y0 - box[3] >= gap:
                continue
            away = shapely.distance(self._lines[edge], other.shapes)
            near = int(away.argmin())
            if away[near] >= gap - _EPSILON:
                continue
            now_m = float(shapely.distance(self._points[robot.end], other.shapes).min())
            need = gap
            if robot.report.radius + other.report.radius <= now_m < gap:
                # they stand nearer than that already: it may move away
                if (
                    away[near] >= now_m - _EPSILON
                    and shapely.distance(self._points[self._graph.ends[edge]], other.shapes).min() > now_m
                ):
                    continue
                need = now_m
            line = other.edges[near]
            found[name] = f"edge {int(self._graph.edge_ids[line])}" if line >= 0 else f"node {self._id(other.end)}"
            if (
                not other.report.active
                or shapely.distance(self._lines[edge], self._points[other.end]) < need - _EPSILON
            ):
                hard.append(name)
        return found, tuple(hard)

    def _groups_on(self, edge: int) -> frozenset[str]:
        none = frozenset[str]()
        return self._groups_of_edge.get(edge, none) | self._groups_of_node.get(int(self._graph.ends[edge]), none)

    def _groups_held(self, robot: _Robot) -> tuple[frozenset[str], frozenset[str]]:
        """Return the mutex groups of what a robot holds, and those that it keeps where its grant ends."""
        none = frozenset[str]()
        at_end = self._groups_of_node.get(robot.end, none)
        held = at_end.union(*(self._groups_of_edge.get(edge, none) for edge in robot.edges))
        for node in robot.route[1 : robot.clear]:
            held |= self._groups_of_node.get(node, none)
        behind = self._groups_of_node.get(robot.route[0], none)
        if (
            behind
            and math.hypot(*(self._xy[robot.route[0]] - robot.report.pose[:2]))
            < 2.0 * robot.report.radius + self.params.margin
        ):
            held |= behind
        return held, at_end

    # --- what the robots are told -------------------------------------------------------------------------------------

    def _grant(self, robot: _Robot, now: float) -> Grant:
        ids = self._graph.node_ids[robot.route].tolist()
        return Grant(
            tuple(ids[: robot.clear + 1]),
            tuple(ids[robot.clear + 1 :]),
            self._reason(robot, frozenset()),
            tuple(robot.blockers),
            time=now,
        )

    def _reason(self, robot: _Robot, told: frozenset[str]) -> str:
        if not robot.report.active:
            return "cannot drive"
        if robot.silent:
            return "does not report"
        if not robot.blockers:
            return robot.text
        name, what = next(iter(sorted(robot.blockers.items(), key=lambda item: (item[0] not in robot.hard, item[0]))))
        begin = f"{robot.text} {what}, held by {name}" if what else f"{robot.text} {name}"
        if name in told or name == robot.name:
            return begin
        further = self._reason(self._robots[name], told | {robot.name})
        return f"{begin}, which {further or 'drives'}"


class Lanes(_GraphTraffic):
    """Directed edges only: each robot drives its shortest route along them, and nothing is reserved."""

    name = "lanes"

    def _decide(self, now: float, robots: list[_Robot]) -> None:
        for robot in robots:
            robot.text = ""
            if robot.goal is not None and robot.route[-1] != robot.goal:
                try:
                    robot.route += self._planner.find(self._id(robot.end), self._id(robot.goal)).nodes[1:]
                except NoValidRouteError as error:
                    robot.text = f"has no way: {error.message}"
            while robot.clear < len(robot.route) - 1:
                self._extend(robot)


class Reservation(_GraphTraffic):
    """Reserves nodes and edges ahead for the robot of the highest rank; dissolves deadlocks when they close.

    A deadlock is a cycle of robots each of which needs what the next one holds where its grant ends. The one of the lowest rank
    takes another route if there is one, or drives to a refuge: a node off the ways of the others; robots that stand in the way of
    that, and idle ones, are moved on in the same manner.
    """

    name = "reservation"

    def _decide(self, now: float, robots: list[_Robot]) -> None:
        for robot in robots:
            self._plan(robot, now)
        for robot in robots:
            self._reserve(robot)
        for _ in robots:
            cycle = self._cycle(robots)
            if not cycle or not self._dissolve(cycle, now):
                break
        for robot in robots:
            self._clear_way(robot, now)

    # --- routes -------------------------------------------------------------------------------------------------------

    def _plan(self, robot: _Robot, now: float) -> None:
        """Plan the horizon of a robot, if it has none or may return from where it made way."""
        robot.text, robot.blockers, robot.hard = "", {}, ()
        if robot.lost:
            return
        if robot.aside:
            if robot.clear < len(robot.route) - 1:
                return
            other = self._robots.get(robot.aside)
            done = other is None or other.lost or (other.goal is None and other.clear == len(other.route) - 1)
            if other is None or done or other.aside == robot.name or robot.way_back.isdisjoint(other.route):
                robot.aside = ""
            else:
                robot.text, robot.blockers, robot.hard = "makes way for", {other.name: ""}, (other.name,)
                return
        if robot.goal is None or robot.route[-1] == robot.goal:
            return
        closed = self._closed([other for other in self._robots.values() if other.lost and other is not robot], robot)
        nodes = self._way(robot, closed)
        if nodes is None:
            nodes = self._way(robot, ())
            if nodes is None:
                robot.text = f"has no way to node {self._id(robot.goal)} on the graph"
                return
        del robot.route[robot.clear + 1 :]
        robot.route += nodes[1:]

    def _way(self, robot: _Robot, closed: Iterable[int]) -> list[int] | None:
        """Return the nodes from the end of the grant to the goal without the closed edges (ids); None without a way."""
        assert robot.goal is not None
        try:
            return list(self._planner.find(self._id(robot.end), self._id(robot.goal), blocked=closed).nodes)
        except NoValidRouteError:
            return None

    def _closed(self, others: Iterable[_Robot], robot: _Robot) -> list[int]:
        """Return the ids of the edges that come too near to where the grants of other robots end."""
        found: set[int] = set()
        for other in others:
            spot = other.shapes[0] if not other.report.active else self._points[other.end]
            gap = min(self._gap(robot, other), float(shapely.distance(self._points[robot.end], spot)))
            near = shapely.dwithin(self._lines, spot, gap - _EPSILON)
            found.update(self._graph.edge_ids[near].tolist())
        return sorted(found)

    def _reserve(self, robot: _Robot) -> None:
        """Grant what is free of the next `ahead` meters."""
        while robot.clear < len(robot.route) - 1 and not robot.lost and not robot.text:
            if (robot.left_m >= self.params.ahead and not robot.aside) or self._turns_back(robot):
                break
            blockers, hard = self._conflicts(robot, self._edge[robot.end, robot.route[robot.clear + 1]])
            if blockers:
                robot.text, robot.blockers, robot.hard = "waits for", blockers, hard
                break
            self._extend(robot)

    # --- deadlocks ----------------------------------------------------------------------------------------------------

    def _cycle(self, robots: Sequence[_Robot]) -> list[_Robot]:
        """Return robots each of which waits for the next one, the last one for the first; empty without a deadlock."""
        done: set[str] = set()
        for start in sorted(robot.name for robot in robots):
            path: list[str] = []
            if self._search(start, path, done):
                return [self._robots[name] for name in path]
        return []

    def _search(self, name: str, path: list[str], done: set[str]) -> bool:
        """Follow the waits from a robot, depth first; `path` is the cycle if there is one."""
        if name in path:
            del path[: path.index(name)]
            return True
        if name in done:
            return False
        done.add(name)
        path.append(name)
        if any(self._search(holder, path, done) for holder in self._robots[name].hard):
            return True
        path.pop()
        return False

    def _dissolve(self, cycle: list[_Robot], now: float) -> bool:
        """Send one robot of a cycle another way or to a refuge, that of the lowest rank if possible; False if none can."""
        names = tuple(robot.name for robot in cycle)
        key = tuple(sorted(names))
        if key not in self._said:
            waits = ", ".join(
                f"{a.name} {a.text} {a.blockers[b.name]}, held by {b.name}"
                if a.blockers[b.name]
                else f"{a.name} {a.text} {b.name}"
                for a, b in zip(cycle, [*cycle[1:], cycle[0]])
            )
            self._tell(now, "deadlock", names, waits)
        order = sorted(cycle, key=lambda robot: self._rank(robot, now))
        first, in_way = order[0], cycle[(cycle.index(order[0]) + 1) % len(cycle)]
        # who is in the way of the highest rank, else from the lowest one up: so the highest one gets on each time
        asked = [(in_way, first), *((robot, cycle[cycle.index(robot) - 1]) for robot in reversed(order))]
        for robot, asking in asked:
            if robot.lost or (asking.goal is None and asking.clear == len(asking.route) - 1):
                continue
            others = [other for other in self._robots.values() if other is not robot and (other in cycle or other.lost)]
            if asking.name not in robot.avoided and self._other_route(robot, others):
                robot.avoided.add(asking.name)
                text = f"{robot.name} takes another route: nodes {', '.join(str(self._id(n)) for n in robot.route[:8])}"
            elif self._make_way(robot, asking, {asking.name}, now):
                text = f"{robot.name} makes way for {asking.name} at node {self._id(robot.route[-1])}"
            else:
                continue
            self._said.discard(key)
            self._tell(now, "dissolved", names, text)
            return True
        if any(robot.goal is None and self._escape(robot, first) for robot in cycle if robot is not first):
            return True
        if key not in self._said:
            self._said.add(key)
            self._tell(now, "stuck", names, f"no robot of {', '.join(names)} has another route or a refuge")
        return False

    def _other_route(self, robot: _Robot, others: Iterable[_Robot]) -> bool:
        """Give a robot a route that avoids where others stand, and that it can begin now; False without one."""
        if robot.goal is None:
            return False
        nodes = self._way(robot, self._closed(others, robot))
        if nodes is None or len(nodes) < 2:
            return False
        allowed = self.params.detour * self._length(robot.route[robot.clear :]) + self.params.ahead
        if self._length(nodes) > allowed or self._conflicts(robot, self._edge[nodes[0], nodes[1]])[0]:
            return False
        self._send(robot, nodes)
        return True

    def _length(self, nodes: Sequence[int]) -> float:
        return float(sum(self._graph.lengths[self._edge[a, b]] for a, b in pairwise(nodes)))

    def _send(self, robot: _Robot, nodes: Sequence[int], aside: str = "", way_back: Iterable[int] = ()) -> None:
        """Replace the horizon of a robot and grant what is free of it."""
        del robot.route[robot.clear + 1 :]
        robot.route += nodes[1:]
        robot.aside, robot.way_back = aside, frozenset(way_back)
        robot.text, robot.blockers, robot.hard, robot.stranded = "", {}, (), False
        self._reserve(robot)

    def _make_way(self, robot: _Robot, asking: _Robot, barred: set[str], now: float) -> bool:
        """Send a robot to the nearest node off the way of the one that asks; False if it cannot get anywhere.

        `barred` are the robots that cannot be sent away for it; those that were asked are added.
        """
        if robot.lost:
            return False
        if asking.goal is not None and asking.aside and asking.clear == len(asking.route) - 1:
            asking.aside = ""
            self._plan(asking, now)  # the way that it needs, not where it made way
        ahead = asking.route[asking.clear :]
        way = shapely.LineString(self._xy[ahead]) if len(ahead) > 1 else self._points[ahead[0]]
        gap = self._gap(robot, asking) - _EPSILON
        free = ~shapely.dwithin(self._points, way, gap)
        came_from: dict[int, int] = {robot.end: -1}
        queue = [robot.end]
        for node in queue:
            if free[node] and node != robot.end:
                nodes = [node]
                while came_from[nodes[-1]] >= 0:
                    nodes.append(came_from[nodes[-1]])
                nodes.reverse()
                self._send(robot, nodes, asking.name, nodes[:-1])
                return True
            for edge in range(int(self._graph.first[node]), int(self._graph.first[node + 1])):
                after = int(self._graph.ends[edge])
                if after not in came_from and not self._conflicts(robot, edge)[0]:
                    came_from[after] = node
                    queue.append(after)
        barred |= {robot.name, asking.name}
        return self._push_on(robot, asking, barred, free, now)

    def _leave(self, robot: _Robot, asking: _Robot, now: float) -> bool:
        return self._make_way(robot, asking, {asking.name}, now) or self._escape(robot, asking)

    def _escape(self, robot: _Robot, asking: _Robot) -> bool:
        """Let an idle robot want a node beyond the one that asks, which so has to make way first; False if it does already."""
        if robot.clear < len(robot.route) - 1:
            return False
        graph, queue = self._graph, [[robot.end]]
        seen = {robot.end}
        on_way = set(asking.route[asking.clear :])
        for nodes in queue:
            if nodes[-1] not in on_way:
                self._send(robot, nodes, asking.name, nodes[:-1])
                return True
            for edge in range(int(graph.first[nodes[-1]]), int(graph.first[nodes[-1] + 1])):
                after = int(graph.ends[edge])
                if after not in seen and not set(self._conflicts(robot, edge)[0]) - {asking.name}:
                    seen.add(after)
                    queue.append([*nodes, after])
        return False

    def _push_on(self, robot: _Robot, asking: _Robot, barred: set[str], free: Any, now: float) -> bool:
        """Send a robot one node on by sending those away that stand there, or to any node that is free."""
        graph, here = self._graph, robot.end
        edges = range(int(graph.first[here]), int(graph.first[here + 1]))
        on_way = set(asking.route[asking.clear :])
        for edge in sorted(edges, key=lambda edge: (int(graph.ends[edge]) in on_way, not free[graph.ends[edge]], edge)):
            node = int(graph.ends[edge])
            if node == asking.end:
                continue
            blockers, hard = self._conflicts(robot, edge)
            if set(blockers) - set(hard) or any(name in barred or self._robots[name].lost for name in blockers):
                continue
            step = [here, node]
            kept = robot.route[robot.clear + 1 :], robot.aside, robot.way_back
            del robot.route[robot.clear + 1 :]
            robot.route.append(node)
            if all(self._make_way(self._robots[name], robot, barred, now) for name in blockers):
                self._send(robot, step, asking.name, [here])
                return True
            del robot.route[robot.clear + 1 :]
            robot.route += kept[0]
            robot.aside, robot.way_back = kept[1], kept[2]
        return False

    def _clear_way(self, robot: _Robot, now: float) -> None:
        """Send idle robots out of the way; find a way around those that stand for good."""
        for name in robot.hard:
            other = self._robots[name]
            if other.lost:
                lost = [each for each in self._robots.values() if each.lost]
                if robot.goal is not None and self._other_route(robot, lost):
                    self._tell(now, "rerouted", (robot.name, name), f"{robot.name} takes a route around {name}")
                elif not robot.aside:
                    robot.stranded = True
                continue
            idle = other.stranded or (other.goal is None and not other.aside)
            if idle and other.clear == len(other.route) - 1 and self._leave(other, robot, now):
                text = f"{name} makes way for {robot.name} at node {self._id(other.route[-1])}"
                self._tell(now, "makes_way", (name, robot.name), text)


class Pibt(_GraphTraffic):
    """Priority inheritance with backtracking (Okumura et al., AIJ 2022; causal as in AAAI 2021), one node at a time.

    Robots choose in the order of their ranks the next node nearest to their goal. Who stands there inherits the rank and
    chooses first; if it finds no node, the next best one is tried. A robot drives once the node has been left. Every robot
    reaches its goal if any two neighboring nodes lie on a cycle of the graph in both directions, and nodes are left over.
    """

    name = "pibt"

    def _decide(self, now: float, robots: list[_Robot]) -> None:
        decided: dict[str, int] = {}
        """The edge that each robot takes next; -1: it stays."""
        for robot in robots:
            robot.text, robot.blockers, robot.hard = "", {}, ()
        for robot in robots:
            if robot.lost:
                decided[robot.name] = -1
        for robot in robots:
            if robot.name not in decided and robot.left_m < self.params.ahead:
                self._choose(robot, (), decided)

    def _choose(self, robot: _Robot, above: tuple[_Robot, ...], decided: dict[str, int]) -> bool:
        """Choose the next node of a robot that those `above` push, the last one directly; False if it has to stay."""
        graph, here = self._graph, robot.end
        edges: list[int] = list(range(int(graph.first[here]), int(graph.first[here + 1])))
        away = self._distances(robot.goal) if robot.goal is not None else None
        ways = {node for other in above for node in self._descent(other)}
        if above:
            edges.sort(key=lambda edge: (int(graph.ends[edge]) in ways, self._cost(edge, away), edge))
        else:
            edges = [edge for edge in edges if away is not None and away[graph.ends[edge]] < away[here]]
            edges.sort(key=lambda edge: (self._cost(edge, away), edge))
        decided[robot.name] = -1
        blocked: dict[str, str] = {}
        first_hard: tuple[str, ...] = ()
        for edge in edges:
            if any(
                claim >= 0 and self._claimed(robot, edge, name, claim)
                for name, claim in decided.items()
                if name != robot.name
            ):
                continue
            blockers, hard = self._conflicts(robot, edge)
            if not blocked:
                blocked, first_hard = blockers, hard
            if any(name in decided for name in hard):
                if all(decided.get(name, -1) >= 0 for name in hard):
                    decided[robot.name] = edge  # they are about to leave
                    return self._wait(robot, blockers, hard)
                continue
            decided[robot.name] = edge
            if all(self._choose(self._robots[name], (*above, robot), decided) for name in hard if name not in decided):
                if not blockers:
                    robot.route[robot.clear + 1 :] = [int(graph.ends[edge])]
                    if not self._turns_back(robot):
                        self._extend(robot)
                    return True
                return self._wait(robot, blockers, hard)
            decided[robot.name] = -1
        if blocked:
            self._wait(robot, blocked, first_hard)
        return False

    def _wait(self, robot: _Robot, blockers: dict[str, str], hard: tuple[str, ...]) -> bool:
        robot.text, robot.blockers, robot.hard = "waits for", blockers, hard
        return True

    def _claimed(self, robot: _Robot, edge: int, name: str, claim: int) -> bool:
        """Return whether a robot of a higher rank is about to drive too near to an edge."""
        gap = self._gap(robot, self._robots[name]) - _EPSILON
        leaves = shapely.dwithin(self._points[robot.end], self._lines[claim], gap)
        way = self._points[self._graph.ends[edge]] if leaves else self._lines[edge]
        return bool(shapely.dwithin(way, self._lines[claim], gap))

    def _cost(self, edge: int, away: Any) -> float:
        return float(self._graph.lengths[edge]) + (0.0 if away is None else float(away[self._graph.ends[edge]]))

    def _descent(self, robot: _Robot) -> list[int]:
        """Return the next nodes of the shortest way of a robot to its goal."""
        if robot.goal is None:
            return []
        away, node, found = self._distances(robot.goal), robot.end, list[int]()
        while node != robot.goal and math.isfinite(away[node]) and len(found) < 50:
            edges = range(int(self._graph.first[node]), int(self._graph.first[node + 1]))
            node = int(self._graph.ends[min(edges, key=lambda edge: (self._cost(edge, away), edge))])
            found.append(node)
        return found

    @cached_property
    def _backward(self) -> Any:
        from scipy.sparse import csr_array  # slow import

        graph, n = self._graph, len(self._graph)
        return csr_array((graph.lengths.astype(np.float64), (graph.ends, graph.starts)), shape=(n, n))

    @cached_property
    def _tables(self) -> dict[int, Any]:
        return {}

    def _distances(self, goal: int) -> Any:
        """Return the distances (n,) of all nodes to a goal along the edges (m)."""
        from scipy.sparse.csgraph import dijkstra

        if goal not in self._tables:
            self._tables[goal] = dijkstra(self._backward, indices=goal)
        return self._tables[goal]


RULES: Final[Mapping[str, type[TrafficRule]]] = {rule.name: rule for rule in (NoTraffic, Lanes, Reservation, Pibt)}
"""Traffic rules by name."""


def make_rule(name: str, graph: RouteGraph | None = None, params: TrafficParams | None = None) -> TrafficRule:
    """Return a traffic rule by its name: none, lanes, reservation, pibt. Raises InputError."""
    if name not in RULES:
        raise InputError(f'there is no traffic rule "{name}"; choose one of {", ".join(RULES)}', value=name)
    return RULES[name](graph, params)


def _checked(graph: RouteGraph | None, name: str) -> RouteGraph:
    if graph is None:
        raise InputError(
            f'the traffic rule "{name}" needs a route graph; give one (traffic: graph: FILE.geojson), or use "none"'
        )
    return graph


def _groups(data: Mapping[str, Any]) -> frozenset[str]:
    """Return the mutex groups in the metadata of an edge or node: a name or a list of names."""
    value = data["mutex"]
    names = [value] if isinstance(value, str) else value
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise InputError(f"mutex is {value!r}; write the name of a group or a list of names")
    return frozenset(names)


# --- communication ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Communication:
    """Messages between robots and traffic control, which arrive later or not at all; each robot's fate is its own.

    What is lost is drawn from the seed, the robot's name and the number of the message: the order of the robots does not matter.
    """

    delay_s: float = 0.0
    dropout: float = 0.0
    """Share of the messages that is lost, in each direction."""
    seed: int = 0

    def __post_init__(self) -> None:
        if not (math.isfinite(self.delay_s) and self.delay_s >= 0.0):
            raise InputError(f"the delay of the communication is {self.delay_s} s; write 0 or more", value=self.delay_s)
        if not 0.0 <= self.dropout <= 1.0:
            raise InputError(
                f"the dropout of the communication is {self.dropout}; write a share, 0 to 1", value=self.dropout
            )

    def arrives(self, name: str, direction: str, number: int) -> bool:
        """Return whether message `number` of a robot gets through."""
        text = f"{self.seed}/{name}/{direction}/{number}".encode()
        return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest()) >= self.dropout * 2.0**64


class TrafficControl:
    """A rule behind a communication: takes what the robots report, and keeps the last grant that has reached each of them."""

    def __init__(self, rule: TrafficRule, communication: Communication | None = None) -> None:
        self.rule = rule
        self.communication = communication or Communication()
        self.grants: dict[str, Grant] = {}
        """By the name of the robot: what it knows."""
        self._reports: list[tuple[float, RobotReport]] = []
        """On their way, with the time of their arrival."""
        self._sent: list[tuple[float, str, Grant]] = []
        self._number = 0

    def update(self, now: float, reports: Iterable[RobotReport]) -> dict[str, Grant]:
        """Send the reports, run the rule on those that arrive, and return the grants that the robots have by now."""
        link, self._number = self.communication, self._number + 1
        self._reports += [(now + link.delay_s, r) for r in reports if link.arrives(r.name, "report", self._number)]
        arrived = [report for due, report in self._reports if due <= now + _EPSILON]
        self._reports = [each for each in self._reports if each[0] > now + _EPSILON]
        latest: dict[str, RobotReport] = {}
        for report in arrived:
            if report.name not in latest or latest[report.name].time <= report.time:
                latest[report.name] = report
        for name, grant in self.rule.update(now, latest.values()).items():
            if link.arrives(name, "grant", self._number):
                self._sent.append((now + link.delay_s, name, grant))
        for due, name, grant in self._sent:
            if due <= now + _EPSILON:
                self.grants[name] = grant
        self._sent = [each for each in self._sent if each[0] > now + _EPSILON]
        return dict(self.grants)

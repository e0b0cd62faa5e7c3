"""Traffic: which robot may drive how far on a route graph, who waits for whom, and how a deadlock is dissolved.

A rule reads reports of the robots and returns a grant for each: nodes that it may drive through, and the horizon beyond them.
What a robot has been granted from its last reported place on is reserved for it; two reservations keep the distance at which the
footprints pass. So an old report makes a reservation longer, never shorter, and a lost grant only makes a robot wait. A grant is
a lease: it is taken back only from a robot that has not reported for so long that it has stopped. The result depends on the
reports, not on their order.
"""

from __future__ import annotations

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
from navstack.traffic.shunting import Move, Shunting

_EPSILON: Final = 1e-6
_OFF_LINE_M: Final = 0.02
"""A robot farther than this from its edge holds the way back to it, too."""
_BRAKING_S: Final = 1.0
"""Time from the end of a grant to the time at which the traffic control takes the robot to stand (s)."""


class TrafficParams(ParamModel):
    """Parameters of the traffic rules."""

    ahead: float = param(4.0, "reserve nodes and edges up to this distance ahead", unit="m", gt=0.0)
    margin: float = param(0.1, "distance between two footprints at which they still pass each other", unit="m", ge=0.0)
    reach: float = param(0.3, "a node counts as passed at this distance", unit="m", gt=0.0)
    aging: float = param(30.0, "a robot on its way for this time counts as one priority higher", unit="s", gt=0.0)
    silence: float = param(
        5.0, "a robot without a report for this time is an obstacle; it stops one second before", unit="s", gt=1.0
    )
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
    speed: float = math.inf
    """How fast it drives at most (m/s)."""


@dataclass(frozen=True, slots=True)
class Grant:
    """What a robot may do."""

    nodes: tuple[int, ...] = ()
    """Ids of the nodes from the last one passed to the last one it may drive to."""
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
    until: float = math.inf
    """The robot stops at this time unless a later grant has reached it (s)."""

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
        self.lease_s = math.inf
        """How long a grant is valid after the report that it answers (s)."""
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
    avoided: set[str] = field(default_factory=set[str])
    """Robots for which it has taken another route to its goal: not twice, or it goes to and fro between two of them."""
    silent: bool = False
    stopped: bool = False
    """True: its last report changed whether it can drive."""
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
        """True: it does not move, whatever it is granted."""
        return self.silent or not self.report.active


class _GraphTraffic(TrafficRule):
    """Keeps what each robot has passed, holds and needs; a subclass decides about the next node."""

    def __init__(self, graph: RouteGraph | None = None, params: TrafficParams | None = None) -> None:
        super().__init__(_checked(graph, self.name), params)
        self.lease_s = self.params.silence - _BRAKING_S
        self._graph = _checked(graph, self.name)
        self._planner = RoutePlanner(self._graph)
        self._xy = self._graph.xy.astype(np.float64)
        self._robots: dict[str, _Robot] = {}
        self._moves: list[Move] = []
        """Those that dissolve deadlocks and have not been granted yet: each waits for the earlier ones that it comes near to."""
        self._said: set[tuple[str, ...]] = set()
        self._hopeless: dict[str, tuple[tuple[str, int, bool], ...]] = {}
        """Robots that cannot be helped, with where all robots stood."""
        self._near_nodes: dict[tuple[int, float], frozenset[int]] = {}
        self._near_edges: dict[tuple[int, float], frozenset[int]] = {}
        xy, starts, ends = self._xy, self._graph.starts, self._graph.ends
        self._lines: Any = shapely.linestrings(np.stack([xy[starts], xy[ends]], axis=1))
        self._points: Any = shapely.points(xy)
        self._tree_of_lines, self._tree_of_points = shapely.STRtree(self._lines), shapely.STRtree(self._points)
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
            was_lost = robot.lost
            self._advance(robot)
            silent = now - robot.report.time > self.params.silence
            if silent and not robot.silent:
                self._tell(now, "silent", (robot.name,), f"{robot.name} has not reported for {self.params.silence:g} s")
                self._cut(robot)
            robot.silent = silent
            if robot.lost != was_lost or robot.stopped:
                robot.stopped = False
                self._drop_moves()  # they count on where it stands
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
        self._drop_moves()
        self._robots.pop(name, None)

    def _held(self, robot: _Robot) -> tuple[str, ...]:
        ids = self._graph.edge_ids
        edges = tuple(f"edge {int(ids[edge])}" for edge in dict.fromkeys(robot.edges) if edge >= 0)
        return *edges, f"node {self._id(robot.end)}"

    def _id(self, node: int) -> int:
        return int(self._graph.node_ids[node])

    def _tell(self, now: float, kind: str, robots: Iterable[str], text: str) -> None:
        self.events.append(TrafficEvent(now, kind, tuple(robots), text))

    def _rank(self, robot: _Robot, now: float) -> tuple[float, str]:
        """Return what sorts the robots, highest rank first: priority and time on the way, then name; idle robots come last."""
        age = (now - robot.since) / self.params.aging if robot.goal is not None else -1e9
        return -robot.report.priority - age, robot.name

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
        robot.stopped = robot.stopped or report.active != robot.report.active
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
        corners = [(x, y), place]
        if robot.clear > 0:
            corners.append(tuple(xy[route[1]].tolist()))
            robot.left_m += math.dist(place, corners[-1])
        (low_x, high_x), (low_y, high_y) = ((min(each), max(each)) for each in zip(*corners))
        robot.box = (low_x, low_y, high_x, high_y)
        for a, b in pairwise(route[1 : robot.clear + 1]):
            self._hold(robot, a, b)

    def _cut(self, robot: _Robot) -> None:
        """Take back what a robot that is silent, and so has stopped, cannot have reached: all beyond the next node."""
        reach = robot.report.speed * self.params.silence
        way, place = 0.0, 1
        while place < robot.clear:
            way += (
                math.hypot(*(self._xy[robot.route[1]] - robot.report.pose[:2]))
                if place == 1
                else float(self._graph.lengths[self._edge[robot.route[place - 1], robot.route[place]]])
            )
            if way > reach:
                break
            place += 1
        robot.clear = min(robot.clear, place)
        del robot.route[robot.clear + 1 :]
        self._advance(robot)

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

    def _arrives_first(self, robot: _Robot) -> bool:
        """Return whether a robot drives to the end of its grant before it gets more: its goal is there, or it holds the next node
        already, so that its place would have two meanings.
        """
        return robot.end == robot.goal or robot.route[robot.clear + 1] in robot.route[: robot.clear]

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
            if other.lost or shapely.distance(self._lines[edge], self._points[other.end]) < need - _EPSILON:
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

    # --- deadlocks ----------------------------------------------------------------------------------------------------

    def _nodes_near(self, edge: int, gap: float) -> frozenset[int]:
        """Return the nodes at which a robot is in the way of another one on an edge; not if that one drives away from there."""
        key = edge, gap
        if key not in self._near_nodes:
            start, end = self._points[self._graph.starts[edge]], self._points[self._graph.ends[edge]]
            near = self._tree_of_points.query(self._lines[edge], predicate="dwithin", distance=gap - _EPSILON)
            spots = self._points[near]
            stays = ~self._parts(start, self._lines[edge], end, spots, gap)
            groups = self._groups_on(edge)
            same = {node for node, others in self._groups_of_node.items() if groups & others}
            self._near_nodes[key] = frozenset(near[stays].tolist()) | same - {int(self._graph.starts[edge])}
        return self._near_nodes[key]

    def _edges_near(self, edge: int, gap: float) -> frozenset[int]:
        """Return the edges on which a robot is in the way of another one on an edge."""
        key = edge, gap
        if key not in self._near_edges:
            near = self._tree_of_lines.query(self._lines[edge], predicate="dwithin", distance=gap - _EPSILON)
            groups = self._groups_on(edge) | self._groups_of_node.get(int(self._graph.starts[edge]), frozenset())
            same = (other for other in range(self._graph.edge_count) if groups and groups & self._groups_on(other))
            self._near_edges[key] = frozenset(near.tolist()) | frozenset(same)
        return self._near_edges[key]

    @staticmethod
    def _parts(start: Any, line: Any, end: Any, other: Any, gap: float) -> Any:
        """Return whether a robot that stands too near to another one (or an array of them) already drives away from it."""
        now_m = shapely.distance(start, other)
        return (
            (now_m < gap) & (shapely.distance(line, other) >= now_m - _EPSILON) & (shapely.distance(end, other) > now_m)
        )

    def _edges_at(self, robot: _Robot, gap: float) -> frozenset[int]:
        """Return the edges on which a robot that stands is in the way."""
        found: set[int] = set()
        for shape in robot.shapes:
            near = self._tree_of_lines.query(shape, predicate="dwithin", distance=gap - _EPSILON)
            starts, ends = self._points[self._graph.starts[near]], self._points[self._graph.ends[near]]
            found.update(near[~self._parts(starts, self._lines[near], ends, shape, gap)].tolist())
        return frozenset(found)

    def _shunting(self) -> Shunting:
        """Return the search for moves with the robots where their grants and moves end."""
        robots = self._robots
        standing = {
            name: robot
            for name, robot in robots.items()
            if robot.clear == 0 and not robot.lost and -1 in robot.edges and name not in self._movers
        }
        lost = [robot for robot in robots.values() if robot.lost]
        edges: dict[tuple[str, float], frozenset[int]] = {}
        radii = {name: robot.report.radius + self.params.margin for name, robot in robots.items()}

        def edges_at(robot: _Robot, gap: float) -> frozenset[int]:
            key = robot.name, gap
            if key not in edges:
                edges[key] = self._edges_at(robot, gap)
            return edges[key]

        def in_way(name: str, edge: int, other: str) -> frozenset[int]:
            gap = radii[name] + robots[other].report.radius
            nodes = self._nodes_near(edge, gap)
            if other in standing and edge in edges_at(standing[other], gap):
                nodes |= {standing[other].end}
            return nodes

        def closed(name: str, edge: int) -> bool:
            return any(edge in edges_at(robot, radii[name] + robot.report.radius) for robot in lost)

        return Shunting(self._graph, in_way, closed)

    def _drop_moves(self) -> None:
        for name in self._movers & set(self._robots):
            robot = self._robots[name]
            del robot.route[robot.clear + 1 :]
        self._moves.clear()

    @property
    def _movers(self) -> set[str]:
        return {name for name, _ in self._moves}

    def _help(self, robot: _Robot) -> bool:
        """Find moves that take a robot to its goal and put the others out of its way; False if there are none."""
        at = {name: other.end for name, other in sorted(self._robots.items()) if not other.lost}
        for name, edge in self._moves:
            at[name] = int(self._graph.ends[edge])
        state = tuple((name, other.end, other.clear == 0) for name, other in sorted(self._robots.items()))
        if robot.goal is None or robot.lost or self._hopeless.get(robot.name) == state:
            return False
        moves = self._shunting().find(at, robot.name, robot.goal)
        if not moves:
            self._hopeless[robot.name] = state
            return False
        self._moves += moves
        return True

    def _follow_moves(self) -> None:
        """Grant the moves that are not too near to earlier ones."""
        for name in self._movers:
            robot = self._robots[name]
            del robot.route[robot.clear + 1 :]
            robot.text, robot.blockers, robot.hard = "", {}, ()
        kept: list[Move] = []
        waiting: set[str] = set()
        for name, edge in self._moves:
            robot = self._robots[name]
            if name not in waiting:
                earlier = next(
                    (
                        each
                        for each in kept
                        if edge in self._edges_near(each[1], self._gap(robot, self._robots[each[0]]))
                    ),
                    None,
                )
                blockers: dict[str, str] = {}
                if earlier is not None:
                    robot.blockers = {earlier[0]: ""}
                    robot.text = "lets pass"
                elif robot.left_m < self.params.ahead:
                    blockers, robot.hard = self._conflicts(robot, edge)
                    robot.text, robot.blockers = ("waits for" if blockers else ""), blockers
                robot.route.append(int(self._graph.ends[edge]))
                free = earlier is None and not blockers and robot.left_m < self.params.ahead
                if free and not self._arrives_first(robot):
                    self._extend(robot)
                    continue
                waiting.add(name)
                if not kept and any(self._robots[each].clear == 0 for each in robot.hard):
                    self._drop_moves()  # it does not stand where it was expected to
                    return
            else:
                robot.route.append(int(self._graph.ends[edge]))
            kept.append((name, edge))
        self._moves = kept

    def _claimed_by(self, robot: _Robot, node: int) -> str:
        """Return the robot whose moves to come a robot at a node would be in the way of; empty without one."""
        for name, edge in self._moves:
            if name != robot.name and node in self._nodes_near(edge, self._gap(robot, self._robots[name])):
                return name
        return ""

    # --- what the robots are told -------------------------------------------------------------------------------------

    def _grant(self, robot: _Robot, now: float) -> Grant:
        ids = self._graph.node_ids[robot.route].tolist()
        return Grant(
            tuple(ids[: robot.clear + 1]),
            tuple(ids[robot.clear + 1 :]),
            self._reason(robot, frozenset()),
            tuple(robot.blockers),
            time=now,
            until=robot.report.time + self.lease_s,
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

    A robot is in a deadlock if it waits for others that do not drive on by themselves: each waits for the next one in a circle,
    or stands idle. One of a circle takes another route if there is one. Otherwise the robot of the highest rank is taken to its
    goal by moves of one robot at a time, found by a search (`Shunting`), with the others put out of its way. These moves go in
    their order as far as they come near to each other, and nobody else stops in their way. So they are carried out whatever the
    robots' speeds, and the robot that has been on its way for longest reaches its goal.
    """

    name = "reservation"

    def _decide(self, now: float, robots: list[_Robot]) -> None:
        self._reserve_all(robots)
        tried: set[str] = set()
        while jam := self._jam(robots, tried):
            tried.add(jam[0].name)
            if self._dissolve(*jam, now):
                self._reserve_all(robots)

    def _reserve_all(self, robots: list[_Robot]) -> None:
        self._follow_moves()
        movers = self._movers
        for robot in robots:
            if robot.name not in movers:
                self._plan(robot)
                self._reserve(robot)

    # --- routes -------------------------------------------------------------------------------------------------------

    def _plan(self, robot: _Robot) -> None:
        """Plan the horizon of a robot, if it has none."""
        if robot.lost or robot.goal is None or robot.route[-1] == robot.goal:
            return
        lost = [other for other in self._robots.values() if other.lost]
        nodes = self._way(robot, self._closed(lost, robot)) or self._way(robot, ())
        del robot.route[robot.clear + 1 :]
        robot.route += (nodes or ())[1:]

    def _way(self, robot: _Robot, closed: Iterable[int]) -> list[int] | None:
        """Return the nodes from the end of the grant to the goal without the closed edges (ids); None without a way."""
        assert robot.goal is not None
        try:
            return list(self._planner.find(self._id(robot.end), self._id(robot.goal), blocked=closed).nodes)
        except NoValidRouteError:
            return None

    def _closed(self, others: Iterable[_Robot], robot: _Robot) -> list[int]:
        """Return the ids of the edges that come too near to where robots stand, or where their grants end."""
        found: set[int] = set()
        for other in others:
            gap = self._gap(robot, other)
            if other.lost:
                found |= self._edges_at(other, gap)
            else:
                found.update(edge for edge in range(self._graph.edge_count) if other.end in self._nodes_near(edge, gap))
        return self._graph.edge_ids[sorted(found)].tolist()

    def _reserve(self, robot: _Robot) -> None:
        """Grant what is free of the next `ahead` meters, up to a node where it is in nobody's way."""
        robot.text, robot.blockers, robot.hard = "", {}, ()
        if robot.lost:
            return
        if robot.goal is not None and robot.route[-1] != robot.goal:
            robot.text = f"has no way to node {self._id(robot.goal)} on the graph"
            return
        while (
            robot.clear < len(robot.route) - 1 and robot.left_m < self.params.ahead and not self._arrives_first(robot)
        ):
            count, claimed = 0, ""
            for a, b in pairwise(robot.route[robot.clear :]):
                blockers, hard = self._conflicts(robot, self._edge[a, b])
                if blockers:
                    robot.text, robot.blockers, robot.hard = "waits for", blockers, hard
                    return
                count += 1
                claimed = self._claimed_by(robot, b)
                if not claimed:
                    break
            if claimed:
                robot.text, robot.blockers = "lets pass", {claimed: ""}
                return
            for _ in range(count):
                self._extend(robot)

    # --- deadlocks ----------------------------------------------------------------------------------------------------

    def _jam(self, robots: Sequence[_Robot], tried: set[str]) -> tuple[_Robot, list[_Robot]] | None:
        """Return the robot to help, and robots each of which waits for the next one; None without a deadlock."""
        movers, going = self._movers, set[str]()
        while True:
            more = {
                robot.name
                for robot in robots
                if robot.name not in going
                and not robot.lost
                and (
                    robot.name in movers
                    or (
                        robot.goal is not None
                        and bool(robot.blockers or not robot.text)
                        and going.issuperset(robot.hard)
                    )
                )
            }
            if not more:
                break
            going |= more
        jammed = [
            robot for robot in robots if robot.name not in going | tried and robot.goal is not None and robot.hard
        ]
        if not jammed:
            return None
        chain = [jammed[0]]
        while chain[-1] not in chain[:-1] and not chain[-1].lost and chain[-1].hard:
            chain.append(self._robots[next(name for name in chain[-1].hard if name not in going)])
        first = chain.index(chain[-1]) if chain[-1] in chain[:-1] else len(chain) - 2
        circle = chain[first:]
        on_way = [robot for robot in robots if robot.goal is not None and not robot.lost]
        helped = [robot for robot in on_way if robot in circle and robot.name not in tried and robot.hard]
        return (jammed[0] if jammed[0] is on_way[0] or not helped else helped[0]), circle

    def _dissolve(self, helped: _Robot, circle: list[_Robot], now: float) -> bool:
        """Give one robot of a deadlock another route, or find the moves that take one to its goal; False if there are none.

        `circle`: robots each of which waits for the next one; the last one is the first one, or does not drive.
        """
        closed = circle[-1] is circle[0]
        names = tuple(dict.fromkeys(robot.name for robot in circle))
        key = tuple(sorted(names))
        if closed and key not in self._said:
            waits = ", ".join(f"{a.name} {a.text} {a.blockers[b.name]}, held by {b.name}" for a, b in pairwise(circle))
            self._tell(now, "deadlock", names, waits)
        for asking, robot in [*pairwise(circle)][::-1] if closed else [(circle[-1], circle[-2])]:
            others = [
                other for other in self._robots.values() if other is not robot and (other in circle or other.lost)
            ]
            if asking.name not in robot.avoided and self._other_route(robot, others):
                robot.avoided.add(asking.name)
                kind, text = "rerouted", f"{robot.name} takes another route: nodes {self._ids(robot.route)}"
                break
        else:
            before = len(self._moves)
            if not self._help(helped):
                if key not in self._said:
                    self._said.add(key)
                    others = ", ".join(name for name in names if name != helped.name)
                    text = f"nothing takes {helped.name} to node {self._id(helped.goal or 0)} past {others}"
                    self._tell(now, "stuck", names, text)
                return False
            ends = {name: int(self._graph.ends[edge]) for name, edge in self._moves[before:] if name != helped.name}
            asides = ", ".join(f"{name} to node {self._id(node)}" for name, node in sorted(ends.items()))
            kind = "dissolved" if closed else "makes_way"
            text = f"{helped.name} goes first; out of its way: {asides or 'nobody'}"
        self._said.discard(key)
        self._tell(now, kind, names, text)
        return True

    def _ids(self, nodes: Sequence[int]) -> str:
        return ", ".join(str(self._id(node)) for node in nodes[:8])

    def _other_route(self, robot: _Robot, others: Iterable[_Robot]) -> bool:
        """Give a robot a route that avoids where others stand, and that it can begin now; False without one."""
        if robot.goal is None or robot.lost:
            return False
        nodes = self._way(robot, self._closed(others, robot))
        if nodes is None or len(nodes) < 2 or self._claimed_by(robot, nodes[1]):
            return False
        allowed = self.params.detour * self._length(robot.route[robot.clear :]) + self.params.ahead
        if self._length(nodes) > allowed or self._conflicts(robot, self._edge[nodes[0], nodes[1]])[0]:
            return False
        del robot.route[robot.clear + 1 :]
        robot.route += nodes[1:]
        return True

    def _length(self, nodes: Sequence[int]) -> float:
        return float(sum(self._graph.lengths[self._edge[a, b]] for a, b in pairwise(nodes)))


class Pibt(_GraphTraffic):
    """Priority inheritance with backtracking, one node at a time.

    As by Okumura et al., AIJ 2022, and without common time steps, as in Causal-PIBT (AAAI 2021).

    Robots choose in the order of their ranks the next node nearest to their goal. Who stands there inherits the rank and
    chooses first; if it finds no node, the next best one is tried. A robot drives once the node has been left. So the robot of
    the highest rank gets on if any two neighboring nodes lie on a cycle of the graph in both directions, and nodes are left over.
    Where it does not, moves of one robot at a time take it to its goal, as by `Reservation`.
    """

    name = "pibt"

    def _decide(self, now: float, robots: list[_Robot]) -> None:
        for robot in robots:
            robot.text, robot.blockers, robot.hard = "", {}, ()
        self._follow_moves()
        decided: dict[str, int] = {robot.name: -1 for robot in robots if robot.lost} | dict(reversed(self._moves))
        """The edge that each robot takes next; -1: it stays."""
        goes_on: dict[str, bool] = {}
        for robot in robots:
            if robot.name not in decided and robot.left_m < self.params.ahead:
                goes_on[robot.name] = self._choose(robot, (), decided)
        for robot in () if self._moves else robots:
            if robot.goal is None or robot.lost or robot.end == robot.goal:
                continue
            if goes_on.get(robot.name, True):
                break
            if self._help(robot):
                self._tell(now, "dissolved", (robot.name,), f"{robot.name} goes first, others are put out of its way")
                self._follow_moves()
                break

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
            if any(other.name in hard for other in above):
                continue  # robots in a circle would wait for each other
            if self._claimed_by(robot, int(graph.ends[edge])):
                continue
            if any(name in decided for name in hard):
                if all(decided.get(name, -1) >= 0 for name in hard):
                    decided[robot.name] = edge  # they are about to leave
                    return self._wait(robot, blockers, hard)
                continue
            decided[robot.name] = edge
            if all(self._choose(self._robots[name], (*above, robot), decided) for name in hard if name not in decided):
                if not blockers:
                    robot.route[robot.clear + 1 :] = [int(graph.ends[edge])]
                    if not self._arrives_first(robot):
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

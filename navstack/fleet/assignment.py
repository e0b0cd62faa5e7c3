"""Who gets which task: lengths of ways, the nearest robot, and sequential single-item auctions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid, Pose2D
from navstack.routes import RouteGraph
from navstack.sim import OCCUPIED

Stop = Pose2D | int
"""Where a robot goes: a pose in the map, or the id of a node of the route graph."""
Objective = Literal["average", "sum", "max"]
_SNAP_M: Final = 0.5
"""A pose this near to free space is taken for its nearest free cell."""
_COARSE: Final = 0.7
"""Largest cell of the search per radius of the robot: blocked bands are wide enough that no step leads across one."""


@dataclass(frozen=True, slots=True)
class Task:
    """A goal, or several stops in order such as pickup and drop-off."""

    name: str
    stops: tuple[Stop, ...]
    release: float = 0.0
    """Time from which on it may be given to a robot (s)."""
    priority: float = 0.0
    """Higher goes first."""
    deadline: float | None = None
    """Time allowed after its release (s); a late task is driven all the same."""
    handling: float = 0.0
    """Time that the robot stands at each stop (s)."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {
            "name": self.name,
            "stops": [list(stop) if isinstance(stop, Pose2D) else stop for stop in self.stops],
            "release": self.release,
            "priority": self.priority,
            "deadline": self.deadline,
            "handling": self.handling,
        }

    @classmethod
    def from_dict(cls, data: Mapping[str, Any]) -> Task:
        """Invert `as_dict`. Raises KeyError, TypeError or ValueError."""
        stops = tuple(stop if isinstance(stop, int) else Pose2D(*map(float, stop)) for stop in data["stops"])
        return replace(cls(**dict(data)), stops=stops)


class Ways:
    """Lengths of ways: along the route graph where a traffic rule guides the robots, else over the free cells of the map.

    Obstacles that are not on the map do not count.
    """

    def __init__(self, grid: OccupancyGrid, graph: RouteGraph | None = None, *, on_graph: bool = False) -> None:
        self._grid, self._graph, self._on_graph = grid, graph, on_graph
        self._spaces: dict[float, _Space] = {}
        self._tables: dict[int, NDArray[np.float64]] = {}

    def length(self, begin: Stop, end: Stop, radius: float) -> float:
        """Return the length (m) of the way of a robot with an inscribed `radius` (m); inf if there is none."""
        if self._on_graph:
            (a, before), (b, after) = self._node(begin), self._node(end)
            return before + float(self._from(a)[b]) + after
        if radius not in self._spaces:
            self._spaces[radius] = _Space(self._grid, radius)
        return self._spaces[radius].length(self.pose(begin), self.pose(end))

    def pose(self, stop: Stop) -> Pose2D:
        """Return the pose of a stop; that of a node has the heading 0."""
        if isinstance(stop, Pose2D):
            return stop
        assert self._graph is not None
        x, y = self._graph.xy[self._graph.node(stop)].tolist()
        return Pose2D(x, y, 0.0)

    def nearest_node(self, pose: Pose2D) -> int:
        """Return the id of the node nearest to a pose."""
        assert self._graph is not None
        return int(self._graph.node_ids[np.hypot(*(self._graph.xy - pose[:2]).T).argmin()])

    def _node(self, stop: Stop) -> tuple[int, float]:
        """Return the index of a stop's node, or of the one nearest to a pose, and the distance to it."""
        assert self._graph is not None
        if not isinstance(stop, Pose2D):
            return self._graph.node(stop), 0.0
        away = np.hypot(*(self._graph.xy - stop[:2]).T)
        nearest = int(away.argmin())
        return nearest, float(away[nearest])

    def _from(self, node: int) -> NDArray[np.float64]:
        from scipy.sparse import csr_array  # slow import
        from scipy.sparse.csgraph import dijkstra

        graph = self._graph
        assert graph is not None
        if node not in self._tables:
            n = len(graph)
            edges = csr_array((graph.lengths.astype(np.float64), (graph.starts, graph.ends)), shape=(n, n))
            self._tables[node] = np.asarray(dijkstra(edges, indices=node))
        return self._tables[node]


class _Space:
    """The cells of a map in which a disc fits, and the lengths of ways to each place that was asked for."""

    def __init__(self, grid: OccupancyGrid, radius: float) -> None:
        from scipy.ndimage import distance_transform_edt  # slow import

        geometry = grid.geometry
        self._grid = grid
        away = np.asarray(distance_transform_edt(grid.data < OCCUPIED)) * geometry.resolution
        self._factor = k = max(1, int(_COARSE * radius / geometry.resolution))
        rows, columns = -(-geometry.ny // k), -(-geometry.nx // k)
        padded = np.zeros((rows * k, columns * k), np.bool_)
        padded[: geometry.ny, : geometry.nx] = away > radius
        self._open: NDArray[np.bool_] = np.asarray(padded.reshape(rows, k, columns, k).any(axis=(1, 3)))
        self._cell = k * geometry.resolution
        self._fields: dict[tuple[int, int], NDArray[np.float64]] = {}
        if self._open.any():
            found: Any = distance_transform_edt(~self._open, return_indices=True)
            self._off, self._nearest = found[0] * self._cell, found[1]

    def length(self, begin: Pose2D, end: Pose2D) -> float:
        here, there = self._at(begin), self._at(end)
        if here is None or there is None:
            return math.inf
        if there not in self._fields:
            self._fields[there] = self._field(there)
        # two poses in one cell are as far from each other as they are
        return max(float(self._fields[there][here]), begin.distance_to(end) if here == there else 0.0)

    def _at(self, pose: Pose2D) -> tuple[int, int] | None:
        """Return row and column of the open cell of a pose, or of the one next to it."""
        geometry = self._grid.geometry
        c, s = math.cos(self._grid.origin_yaw), math.sin(self._grid.origin_yaw)
        dx, dy = pose.x - geometry.origin_x, pose.y - geometry.origin_y
        cell = geometry.world_to_cell(geometry.origin_x + c * dx + s * dy, geometry.origin_y + c * dy - s * dx)
        if cell is None or not self._open.any():
            return None
        row, column = cell[1] // self._factor, cell[0] // self._factor
        if self._off[row, column] > _SNAP_M:
            return None
        return int(self._nearest[0, row, column]), int(self._nearest[1, row, column])

    def _field(self, target: tuple[int, int]) -> NDArray[np.float64]:
        from scipy.sparse import coo_array  # slow import
        from scipy.sparse.csgraph import dijkstra

        rows, columns = len(self._open), self._open.size // len(self._open)
        number = np.arange(rows * columns).reshape(rows, columns)
        starts, ends, lengths = list[Any](), list[Any](), list[Any]()
        for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
            here = np.s_[: rows - dy, max(0, -dx) : columns - max(0, dx)]
            there = np.s_[dy:, max(0, dx) : columns + min(0, dx)]
            both = self._open[here] & self._open[there]
            starts.append(number[here][both])
            ends.append(number[there][both])
            lengths.append(np.full(len(starts[-1]), self._cell * math.hypot(dx, dy)))
        size = rows * columns
        links = coo_array((np.concatenate(lengths), (np.concatenate(starts), np.concatenate(ends))), shape=(size, size))
        found = dijkstra(links.tocsr(), directed=False, indices=int(number[target]))
        return np.asarray(found).reshape(rows, columns)


# --- assignment -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Bidder:
    """A robot that may get tasks."""

    name: str
    at: Stop
    """Where it is, or where what it does now ends."""
    radius: float = 0.0
    """Inscribed radius (m)."""
    ahead: float = 0.0
    """Length of its way until then (m)."""
    barred: frozenset[str] = frozenset()
    """Names of tasks that it has tried in vain."""


@dataclass(slots=True)
class Assignment:
    """Which tasks each robot is to drive, in order, and what was bid for each task."""

    queues: dict[str, list[Task]] = field(default_factory=dict[str, list[Task]])
    bids: dict[str, dict[str, float]] = field(default_factory=dict[str, dict[str, float]])
    """Bid (m) by robot by task; inf: the robot has no way."""


def in_order(tasks: Sequence[Task]) -> list[Task]:
    """Return tasks by priority, then by release and name."""
    return sorted(tasks, key=lambda task: (-task.priority, task.release, task.name))


def assign_nearest(tasks: Sequence[Task], robots: Sequence[Bidder], ways: Ways) -> Assignment:
    """Give each task in order to the robot with the shortest way to its first stop, one task to a robot."""
    found = Assignment()
    free = {robot.name: robot for robot in sorted(robots, key=lambda robot: robot.name)}
    for task in in_order(tasks):
        bids = {
            name: ways.length(robot.at, task.stops[0], robot.radius)
            for name, robot in free.items()
            if task.name not in robot.barred and math.isfinite(way_within(task, robot.radius, ways))
        }
        winner = min(bids, key=lambda name: (bids[name], name), default="")
        if winner and math.isfinite(bids[winner]):
            found.queues[winner] = [task]
            found.bids[task.name] = bids
            del free[winner]
    return found


def auction(
    tasks: Sequence[Task], robots: Sequence[Bidder], ways: Ways, objective: Objective = "average"
) -> Assignment:
    """Auction tasks one at a time: each robot bids what a task adds to its queue at the best place; the lowest bid wins.

    Sequential single-item auctions with the bidding rules MINISUM, MINIMAX and MINIAVE of Lagoudakis, Markakis, Kempe et al.,
    "Auction-Based Multi-Robot Routing", RSS 2005. `objective`: `sum`: the robot's additional way; `max`: its whole way then;
    `average`: what is added to the times at which its tasks are done, in meters of way. Tasks of a higher priority are
    auctioned, and driven, first. Equal bids: by the order of the tasks, then by the names of the robots.
    """
    found = Assignment()
    queues = {robot.name: _Queue(robot, ways, objective) for robot in sorted(robots, key=lambda robot: robot.name)}
    for priority in sorted({task.priority for task in tasks}, reverse=True):
        left = in_order([task for task in tasks if task.priority == priority])
        bids: dict[str, dict[str, tuple[float, int]]] = {task.name: {} for task in left}
        stale = list(queues)
        while left:
            for task in left:
                bids[task.name] |= {
                    name: queues[name].bid(task) for name in stale if task.name not in queues[name].robot.barred
                }
            offers = [
                (bid, number, name) for number, task in enumerate(left) for name, (bid, _) in bids[task.name].items()
            ]
            bid, number, name = min(offers, default=(math.inf, 0, ""))
            if not math.isfinite(bid):
                break
            task = left.pop(number)
            queues[name].insert(bids[task.name][name][1], task)
            found.bids[task.name] = {robot: each for robot, (each, _) in bids[task.name].items()}
            stale = [name]
    found.queues = {name: queue.tasks for name, queue in queues.items() if queue.tasks}
    return found


def way_within(task: Task, radius: float, ways: Ways) -> float:
    """Return the length of the way between the stops of a task (m)."""
    return sum(ways.length(a, b, radius) for a, b in pairwise(task.stops))


class _Queue:
    """The tasks that a robot has won in an auction, and its bids for another one."""

    def __init__(self, robot: Bidder, ways: Ways, objective: Objective) -> None:
        self.robot, self.tasks = robot, list[Task]()
        self._ways, self._objective = ways, objective
        self._legs: dict[tuple[Stop, Stop], float] = {}
        self._ends = [robot.ahead]
        """Length of the way to the end of what it does now, and of each task (m)."""

    def bid(self, task: Task) -> tuple[float, int]:
        """Return the lowest bid for a task, and its place in the queue."""
        within = way_within(task, self.robot.radius, self._ways)
        first = sum(other.priority > task.priority for other in self.tasks)
        best = (math.inf, first)
        for place in range(first, len(self.tasks) + 1):
            before = self.tasks[place - 1].stops[-1] if place else self.robot.at
            reached = self._leg(before, task.stops[0]) + within
            more, behind = reached, len(self.tasks) - place
            if behind:
                after = self.tasks[place].stops[0]
                more += self._leg(task.stops[-1], after) - self._leg(before, after)
            match self._objective:
                case "sum":
                    bid = more
                case "max":
                    bid = self._ends[-1] + more
                case _:
                    bid = self._ends[place] + reached + more * behind
            best = min(best, (bid, place)) if math.isfinite(bid) else best
        return best

    def insert(self, place: int, task: Task) -> None:
        """Take a task that was won."""
        self.tasks.insert(place, task)
        self._ends, at = [self.robot.ahead], self.robot.at
        for each in self.tasks:
            way = self._leg(at, each.stops[0]) + way_within(each, self.robot.radius, self._ways)
            self._ends.append(self._ends[-1] + way)
            at = each.stops[-1]

    def _leg(self, begin: Stop, end: Stop) -> float:
        if (begin, end) not in self._legs:
            self._legs[begin, end] = self._ways.length(begin, end, self.robot.radius)
        return self._legs[begin, end]

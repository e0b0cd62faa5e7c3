"""Tracking a route: which node the robot has passed, and the operations of nav2_route at nodes and edges."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final, Generic, Literal

import numpy as np
from typing_extensions import TypeVar

from navstack.core import Costmap, Pose2D, Transform2D
from navstack.plugins import LocalPlanner, ParamModel, limits_of, param
from navstack.routes.errors import OperationFailedError
from navstack.routes.graph import Metadata, Operation, RouteGraph
from navstack.routes.planner import RoutePlanner, closest_point
from navstack.routes.route import Route, RouteParams
from navstack.routes.search import costs_along

_HERE_M: Final = 1e-4
"""At this distance a node is passed in any case."""


class RouteTracker:
    """Follows the robot along a route from node to node, as nav2_route's RouteTracker does."""

    def __init__(self, route: Route, params: RouteParams, begun: int | None = None) -> None:
        """`begun` is the edge that the robot is already on, before the first node of the route."""
        self.route = route
        self.edge: int | None = begun
        """Index of the edge that the robot is on; None before the first node and after the last one."""
        self.last_node: int | None = None if begun is None else int(route.graph.starts[begun])
        self.next_node: int | None = route.first_node
        self.exited: int | None = None
        """Index of the edge before."""
        self.passed = -1
        """Index in the edges of the route; -1 before its first node."""
        self._nodes = route.nodes
        self._params = params
        self._within = False

    @property
    def completed(self) -> bool:
        """True once the last node has been reached."""
        return self.next_node is None

    @property
    def ahead(self) -> tuple[int, ...]:
        """Indices of the edges from the current one on."""
        rest = self.route.edges[max(self.passed, 0) :]
        return rest if self.edge is None or self.edge in rest else (self.edge, *rest)

    def update(self, pose: Pose2D) -> bool:
        """Return True if the robot has reached or passed the next node."""
        if self.next_node is None or not self._achieved(pose):
            return False
        self._within = False
        self.last_node, self.exited = self.next_node, self.edge
        self.passed += 1
        if self.passed < len(self.route.edges):
            self.edge = self.route.edges[self.passed]
            self.next_node = int(self.route.graph.ends[self.edge])
        else:
            self.edge = self.next_node = None
        return True

    def _achieved(self, pose: Pose2D) -> bool:
        xy, p = self.route.graph.xy, self._params
        assert self.next_node is not None
        here = xy[self.next_node].astype(np.float64)
        away = here - pose[:2]
        distance = float(np.hypot(*away))
        last = self.passed == len(self.route.edges) - 1
        boundary = last or (self.passed == -1 and self.edge is None)
        within = distance <= (p.boundary_radius_to_achieve_node if boundary else p.radius_to_achieve_node)
        if distance < _HERE_M or (self._within and not within):
            return True
        self._within = within
        if boundary or not within:
            return within
        # between two edges: passed once the robot is beyond the line through the node that halves their angle
        assert self.edge is not None
        n = here - xy[self.route.graph.starts[self.edge]]
        m = xy[self._nodes[self.passed + 2]] - here
        long_n, long_m = float(np.hypot(*n)), float(np.hypot(*m))
        if long_n < 1e-6 or long_m < 1e-6:
            return True
        return float((n * long_m + m * long_n) @ away) <= 0.0


# --- operations -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class OperationEvent:
    """What an operation gets."""

    time: float
    """s."""
    pose: Pose2D
    """The robot in the frame of the graph."""
    tracker: RouteTracker
    planner: RoutePlanner
    local_planner: LocalPlanner
    costmap: Costmap
    """The local costmap."""
    to_costmap: Transform2D
    """From the graph's frame to that of the costmap."""
    metadata: Metadata = field(default_factory=dict[str, Any])
    """That of the operation in the graph."""

    @property
    def graph(self) -> RouteGraph:
        """The graph."""
        return self.planner.graph


@dataclass(frozen=True, slots=True)
class OperationResult:
    """What an operation wants."""

    reroute: bool = False
    blocked: tuple[int, ...] = ()
    """Ids of edges to avoid."""
    reason: str = ""


NOTHING: Final = OperationResult()
P = TypeVar("P", bound=ParamModel, default=Any)


class RouteOperation(ABC, Generic[P]):
    """Does something while a route is driven: when a node or edge of the graph says so, at every node, or in every cycle."""

    Params: ClassVar[type[ParamModel]]
    when: ClassVar[Literal["graph", "change", "query"]] = "graph"

    def __init__(self, params: P | None = None, name: str = "") -> None:
        made: Any = self.Params() if params is None else params
        self.params: P = made
        self.name = name or type(self).__name__

    @abstractmethod
    def perform(self, event: OperationEvent) -> OperationResult:
        """Do it. May raise OperationFailedError, which ends the route."""

    def begin(self, local_planner: LocalPlanner, now: float) -> None:
        """Prepare a new drive."""

    def end(self, local_planner: LocalPlanner) -> None:
        """Undo what should not outlast the route."""


class SpeedLimitParams(ParamModel):
    """Parameters of AdjustSpeedLimit."""

    speed_tag: str = param("speed_limit", "metadata of an edge: percent of the full speed, or up to 1 the share of it")


class AdjustSpeedLimit(RouteOperation[SpeedLimitParams]):
    """Limits the speed on edges that say so.

    ROS differs: a value up to 1 is a share, as DistanceScorer reads the same metadata; Nav2 takes it as percent.
    """

    Params = SpeedLimitParams
    when = "change"

    def __init__(self, params: SpeedLimitParams | None = None, name: str = "") -> None:
        super().__init__(params, name)
        self._full = 0.0

    def begin(self, local_planner: LocalPlanner, now: float) -> None:
        """Read the full speed (m/s)."""
        limits = limits_of(local_planner)
        self._full = min(limits.max_vel_trans, math.hypot(limits.max_vel_x, limits.max_vel_y))

    def perform(self, event: OperationEvent) -> OperationResult:
        """Set the limit of the edge that the robot enters, or none."""
        edge = event.tracker.edge
        value = 100.0 if edge is None else event.graph.edge_metadata.get(edge, {}).get(self.params.speed_tag, 100.0)
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0.0:
            raise OperationFailedError(f"{self.params.speed_tag} of the edge is {value!r}; write a number above 0")
        share = value if value <= 1.0 else value / 100.0
        event.local_planner.set_limits(max_vel_trans=share * self._full if share < 1.0 else None)
        return NOTHING

    def end(self, local_planner: LocalPlanner) -> None:
        """Restore the full speed."""
        local_planner.set_limits()


class MonitorParams(ParamModel):
    """Parameters of CollisionMonitor."""

    rate: float = param(1.0, "checks per second", unit="Hz", gt=0.0)
    max_collision_dist: float = param(5.0, "distance ahead to check; 0 or less: the whole route", unit="m")
    max_cost: float = param(253.0, "cost that blocks an edge", gt=0.0, le=255.0)
    check_resolution: int = param(1, "look at every n-th cell", ge=1)
    reroute_on_collision: bool = param(True, "plan another route; otherwise the route fails")


class CollisionMonitor(RouteOperation[MonitorParams]):
    """Looks at the edges ahead on the local costmap; an obstacle on one blocks it, in both directions."""

    Params = MonitorParams
    when = "query"

    def __init__(self, params: MonitorParams | None = None, name: str = "") -> None:
        super().__init__(params, name)
        self._next = 0.0

    def begin(self, local_planner: LocalPlanner, now: float) -> None:
        """Wait a period before the first check."""
        self._next = now + 1.0 / self.params.rate

    def perform(self, event: OperationEvent) -> OperationResult:
        """Return the first blocked edge. Raises OperationFailedError without `reroute_on_collision`."""
        p, tracker, graph = self.params, event.tracker, event.graph
        if event.time < self._next or tracker.edge is None:
            return NOTHING
        self._next = event.time + 1.0 / p.rate
        left = p.max_collision_dist if p.max_collision_dist > 0.0 else math.inf
        begin = closest_point(
            np.array(event.pose[:2]), graph.xy[graph.starts[tracker.edge]], graph.xy[graph.ends[tracker.edge]]
        )
        for edge in tracker.ahead:
            end = graph.xy[graph.ends[edge]]
            length = float(np.hypot(*(end - begin)))
            if length > left > 0.0:
                end = begin + (end - begin) * np.float32(left / length)
            if self._is_blocked(event, begin, end):
                ids = event.planner.both_ways(edge)
                a, b = int(graph.node_ids[graph.starts[edge]]), int(graph.node_ids[graph.ends[edge]])
                reason = f"an obstacle is on edge {int(graph.edge_ids[edge])} (from node {a} to {b})"
                if not p.reroute_on_collision:
                    raise OperationFailedError(
                        f"{reason}, and reroute_on_collision is false", edge=int(graph.edge_ids[edge])
                    )
                return OperationResult(True, ids, reason)
            left -= length
            if left <= 0.0:
                break
            begin = graph.xy[graph.ends[edge]]
        return NOTHING

    def _is_blocked(self, event: OperationEvent, begin: Any, end: Any) -> bool:
        g = event.costmap.geometry
        points = event.to_costmap.apply_points(np.array([begin, end], np.float64))
        # only the part on the costmap: sampled, as the line may enter and leave it
        count = max(2, math.ceil(float(np.hypot(*(points[1] - points[0]))) / g.resolution) + 1)
        line = points[0] + (points[1] - points[0]) * np.linspace(0.0, 1.0, count)[:, None]
        cells = np.floor((line - (g.origin_x, g.origin_y)) / g.resolution).astype(np.int64)
        inside = ((cells >= 0) & (cells < (g.nx, g.ny))).all(axis=1)
        if not inside[0]:
            return False
        last = int(inside.argmin()) - 1 if not inside.all() else count - 1
        figures = np.zeros((1, 5))
        lines = np.array([[*cells[0], *cells[last]]], np.int64)
        costs_along(event.costmap.data.reshape(-1), g.nx, lines, self.params.check_resolution, figures)
        return bool(figures[0, 0] >= self.params.max_cost)


class NoParams(ParamModel):
    """An operation without parameters."""


class ReroutingService(RouteOperation[NoParams]):
    """Plans another route when asked: `request`."""

    Params = NoParams
    when = "query"

    def __init__(self, params: NoParams | None = None, name: str = "") -> None:
        super().__init__(params, name)
        self._reason = ""

    def request(self, reason: str = "a new route was requested") -> None:
        """Plan another route in the next cycle."""
        self._reason = reason

    def perform(self, event: OperationEvent) -> OperationResult:
        """Return the request."""
        reason, self._reason = self._reason, ""
        return OperationResult(True, (), reason) if reason else NOTHING


class TimeMarkerParams(ParamModel):
    """Parameters of TimeMarker."""

    time_tag: str = param("abs_time_taken", "metadata in which the time (s) is stored, for TimeScorer")


class TimeMarker(RouteOperation[TimeMarkerParams]):
    """Stores the time along each edge in the graph, from node to node."""

    Params = TimeMarkerParams
    when = "change"

    def __init__(self, params: TimeMarkerParams | None = None, name: str = "") -> None:
        super().__init__(params, name)
        self._entered: tuple[int | None, float] = None, 0.0

    def begin(self, local_planner: LocalPlanner, now: float) -> None:
        """Forget the edge of another drive."""
        self._entered = None, now

    def perform(self, event: OperationEvent) -> OperationResult:
        """Store the time since the robot entered the edge that it leaves."""
        edge, since = self._entered
        if edge is not None and edge == event.tracker.exited:
            event.graph.edge_metadata.setdefault(edge, {})[self.params.time_tag] = event.time - since
            event.planner.metadata_changed()
        self._entered = event.tracker.edge, event.time
        return NOTHING


class TriggerParams(ParamModel):
    """Parameters of TriggerEvent."""

    service_name: str = param("", "name of the function to call, unless the operation in the graph names one")


class TriggerEvent(RouteOperation[TriggerParams]):
    """Calls a function of yours where the graph says so: open a door, call a lift. It gets the event; False means failure."""

    Params = TriggerParams

    def __init__(
        self,
        params: TriggerParams | None = None,
        name: str = "",
        functions: Mapping[str, Callable[[OperationEvent], object]] | None = None,
    ) -> None:
        super().__init__(params, name)
        self.functions = dict(functions or {})

    def perform(self, event: OperationEvent) -> OperationResult:
        """Call the function; an OperationResult that it returns counts. Raises OperationFailedError."""
        wanted = event.metadata.get("service_name") or self.params.service_name
        function = self.functions.get(str(wanted))
        if function is None:
            known = ", ".join(self.functions) or "none"
            raise OperationFailedError(
                f'{self.name}: no function "{wanted}" was given (known: {known}); pass functions={{name: function}}'
            )
        try:
            found = function(event)
        except Exception as exc:
            raise OperationFailedError(f'{self.name}: "{wanted}" failed: {type(exc).__name__}: {exc}') from exc
        if found is False:
            raise OperationFailedError(f'{self.name}: "{wanted}" returned False')
        return found if isinstance(found, OperationResult) else NOTHING


OPERATIONS: Final[dict[str, type[RouteOperation]]] = {
    operation.__name__: operation
    for operation in (AdjustSpeedLimit, CollisionMonitor, ReroutingService, TimeMarker, TriggerEvent)
}
"""Operations by the name of their class; Nav2 writes `nav2_route::` before it."""
DEFAULT_OPERATIONS: Final = ("AdjustSpeedLimit", "ReroutingService", "CollisionMonitor")
"""ROS differs: with CollisionMonitor, so that a route that becomes blocked is left."""


class Operations:
    """The operations of a drive, in the order of nav2_route: of the graph, at every node, in every cycle."""

    def __init__(self, operations: Sequence[RouteOperation]) -> None:
        self.all = tuple(operations)
        self._of_graph = {operation.name: operation for operation in operations if operation.when == "graph"}

    def process(self, event: OperationEvent, *, changed: bool) -> tuple[OperationResult, list[str]]:
        """Return what the operations want together, and the names of those that the graph or a node triggered.

        Raises OperationFailedError, also for a type in the graph that is not there.
        """
        results: list[OperationResult] = []
        names: list[str] = []
        if changed:
            for operation in self._due(event):
                found = self._of_graph.get(operation.type)
                if found is None:
                    known = ", ".join(self._of_graph) or "none"
                    what = f'the graph has an operation of type "{operation.type}", but there is none (there: {known})'
                    raise OperationFailedError(
                        f"{what}; list it in operations with plugin: TriggerEvent, or remove it from the graph",
                        operation=operation.name,
                    )
                results.append(found.perform(replace(event, metadata=operation.metadata)))
                names.append(operation.name)
            for operation in self.all:
                if operation.when == "change":
                    results.append(operation.perform(event))
                    names.append(operation.name)
        for operation in self.all:
            if operation.when == "query":
                results.append(operation.perform(event))
                if results[-1] is not NOTHING:
                    names.append(operation.name)
        blocked = tuple(edge for result in results for edge in result.blocked)
        reasons = "; ".join(result.reason for result in results if result.reason)
        return OperationResult(any(result.reroute for result in results), blocked, reasons), names

    @staticmethod
    def _due(event: OperationEvent) -> list[Operation]:
        graph, tracker = event.graph, event.tracker
        places = (
            ("NODE", graph.node_operations.get(-1 if tracker.last_node is None else tracker.last_node, ())),
            ("ON_ENTER", graph.edge_operations.get(-1 if tracker.edge is None else tracker.edge, ())),
            ("ON_EXIT", graph.edge_operations.get(-1 if tracker.exited is None else tracker.exited, ())),
        )
        return [operation for trigger, operations in places for operation in operations if operation.trigger == trigger]

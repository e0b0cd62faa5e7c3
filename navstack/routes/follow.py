"""Driving a route: the local planner follows its path; what blocks it leads to another route, or to an error with a code."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from navstack.core import (
    Costmap,
    FrameError,
    NavError,
    Path,
    PlanningError,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
)
from navstack.plugins import (
    Behavior,
    BehaviorContext,
    BehaviorStatus,
    BehaviorStep,
    ControlInput,
    LocalPlanner,
    Plan,
)
from navstack.routes.errors import NoValidRouteError, RouteError, RouteFrameError
from navstack.routes.planner import RoutePlanner
from navstack.routes.route import PlannedRoute, RouteParams
from navstack.routes.tracking import (
    DEFAULT_OPERATIONS,
    OPERATIONS,
    OperationEvent,
    Operations,
    ReroutingService,
    RouteOperation,
    RouteTracker,
)

CONNECT_M: Final = 0.3
"""The global planner connects robot and route, and route and goal, if they are farther apart."""
PATIENCE_S: Final = 5.0
"""Time without a command of the local planner after which the way ahead counts as blocked (move_base's controller_patience)."""
STUCK_S: Final = 15.0
"""Time without a motion of STUCK_M after which the way ahead counts as blocked."""
STUCK_M: Final = 0.3
_TURNED_RAD: Final = 0.5


@dataclass(frozen=True, slots=True)
class RouteFeedback:
    """Progress on a route: the feedback of Nav2's ComputeAndTrackRoute."""

    last_node_id: int | None
    next_node_id: int | None
    current_edge_id: int | None
    route: PlannedRoute
    path: Path
    operations_triggered: tuple[str, ...]
    """Those of the last node."""
    rerouted: int
    """How often another route was planned."""


def _feedback(
    planned: PlannedRoute, tracker: RouteTracker, path: Path, triggered: tuple[str, ...], rerouted: int
) -> RouteFeedback:
    graph = planned.route.graph
    last, following = (
        None if node is None else int(graph.node_ids[node]) for node in (tracker.last_node, tracker.next_node)
    )
    edge = None if tracker.edge is None else int(graph.edge_ids[tracker.edge])
    return RouteFeedback(last, following, edge, planned, path, triggered, rerouted)


class TrackedRoute:
    """Follows the progress of a robot on a route that something else drives, as nav2_route's server does.

    Operations act, and another route is planned where one of them wants it.
    """

    def __init__(self, planner: RoutePlanner, planned: PlannedRoute, operations: Sequence[RouteOperation]) -> None:
        self.planner = planner
        self.planned = planned
        """The current route."""
        self.blocked: list[int] = []
        """Ids of edges that were found blocked."""
        self.rerouted = 0
        """How often another route was planned."""
        self.triggered: tuple[str, ...] = ()
        """Names of the operations of the last node."""
        self._operations = Operations(operations)
        self._tracker = RouteTracker(planned.route, planner.params, planned.begun)

    def begin(self, local_planner: LocalPlanner, now: float) -> None:
        """Begin at `now` (s): operations may limit the speed of the local planner."""
        for operation in self._operations.all:
            operation.begin(local_planner, now)

    def update(
        self, pose: Pose2D, now: float, local_planner: LocalPlanner, costmap: Costmap, to_costmap: Transform2D
    ) -> bool:
        """Return True once the last node has been reached. `pose` is in the frame of the graph, `costmap` the local one.

        Raises RouteError of an operation, or without another route.
        """
        tracker, planner = self._tracker, self.planner
        changed = tracker.update(pose)
        event = OperationEvent(now, pose, tracker, planner, local_planner, costmap, to_costmap)
        wanted, names = self._operations.process(event, changed=changed)
        if changed or names:
            self.triggered = tuple(names)
        if tracker.completed or not wanted.reroute:
            return tracker.completed
        kept = self.blocked if planner.params.aggregate_blocked_ids else []
        self.blocked = list(dict.fromkeys([*kept, *wanted.blocked]))
        ids, end = planner.graph.node_ids, self.planned.goal
        last = tracker.last_node
        self.planned = planner.plan(
            pose,
            int(ids[self.planned.whole.nodes[-1]]) if end is None else end,
            blocked=self.blocked,
            resume=None if last is None else (int(ids[last]), pose, tracker.edge),
        )
        self._tracker = RouteTracker(self.planned.route, planner.params, self.planned.begun)
        self.rerouted += 1
        return False

    def feedback(self) -> RouteFeedback:
        """Return the progress."""
        return _feedback(self.planned, self._tracker, self.planned.path, self.triggered, self.rerouted)

    def end(self, local_planner: LocalPlanner) -> None:
        """Undo what should not outlast the route."""
        for operation in self._operations.all:
            operation.end(local_planner)


class FollowRoute(Behavior[RouteParams]):
    """Drives along a route to a goal: from the robot to the graph, along it, and from it to the goal.

    With `between_nodes="planner"` the global planner connects the nodes, otherwise the robot follows the edges. An edge is
    blocked if CollisionMonitor sees an obstacle on it, if the local planner has no command for PATIENCE_S, or without progress
    for STUCK_S. Then another route is planned without it; NoValidRouteError (405) if there is none.
    """

    def __init__(
        self,
        planner: RoutePlanner,
        goal: Pose2D | int,
        *,
        start: Pose2D | int | None = None,
        operations: Sequence[RouteOperation] | None = None,
        between_nodes: Literal["path", "planner"] = "path",
        name: str = "route",
    ) -> None:
        """`start` and `goal` are poses in the graph's frame or ids of nodes; without `start` it is the robot's pose."""
        super().__init__(name, planner.params)
        self.planner = planner
        self.frame = planner.graph.frame
        self.goal = goal
        self.start_at = start
        self.between_nodes = between_nodes
        chosen = [OPERATIONS[key]() for key in DEFAULT_OPERATIONS] if operations is None else list(operations)
        self._service = next((o for o in chosen if isinstance(o, ReroutingService)), None) or ReroutingService()
        if self._service not in chosen:
            chosen.append(self._service)
        self.operations = Operations(chosen)
        self.planned: PlannedRoute | None = None
        """The current route; None before the first step."""
        self.blocked: list[int] = []
        """Ids of edges that were found blocked."""
        self.reroutes: list[dict[str, Any]] = []
        """Time (s), reason and blocked edges of each change of the route."""
        self.driven: list[int] = []
        """Ids of the edges that the robot has left behind."""
        self.triggered: tuple[str, ...] = ()
        self._context: BehaviorContext | None = None
        self._tracker: RouteTracker | None = None
        self._plan: Plan | None = None
        self._commanded_at = self._moved_at = 0.0
        self._moved_from: Pose2D | None = None

    # --- for clients --------------------------------------------------------------------------------------------------

    def adjust_edges(
        self, closed: Iterable[int] = (), opened: Iterable[int] = (), costs: Mapping[int, float] | None = None
    ) -> None:
        """Close edges, open them again, or change their costs while driving (Nav2's service adjust_edges).

        The route is planned again if a closed edge is ahead, or if edges were opened or changed. Raises InvalidGraphError for
        an edge that is not there, InputError for a cost.
        """
        closed, opened, costs = list(closed), list(opened), dict(costs or {})
        for edge in (*closed, *opened, *costs):
            self.planner.graph.edge(edge)
        self.planner.dynamic_edges.adjust(closed, opened, costs)
        self.blocked = [edge for edge in self.blocked if edge not in opened]
        ahead = (
            {int(self.planner.graph.edge_ids[edge]) for edge in self._tracker.ahead}
            if self._tracker is not None
            else set[int]()
        )
        if ahead & set(closed):
            self.request_reroute(f"edge {min(ahead & set(closed))} was closed")
        elif opened or costs:
            self.request_reroute("edges were opened or have other costs")

    def request_reroute(self, reason: str = "a new route was requested") -> None:
        """Plan another route in the next cycle (Nav2's service reroute)."""
        self._service.request(reason)

    def feedback(self) -> RouteFeedback | None:
        """Return the progress; None before the first step."""
        if self.planned is None or self._tracker is None or self._plan is None:
            return None
        return _feedback(self.planned, self._tracker, self._plan.path, self.triggered, len(self.reroutes))

    # --- steps --------------------------------------------------------------------------------------------------------

    def start(self, context: BehaviorContext, now: float) -> None:
        """Prepare the first step, which plans the route."""
        self._context = context
        self.planned = self._tracker = self._plan = None
        self.blocked, self.reroutes, self.driven = [], [], []
        self._commanded_at = self._moved_at = now
        self._moved_from = None
        for operation in self.operations.all:
            operation.begin(context.local_planner, now)

    def step(self, state: RobotState, now: float) -> BehaviorStep:
        """Track the route and return the command of the local planner. Raises RouteError and errors of the planners."""
        context = self._active
        pose = self._pose(now)
        if self._tracker is None:
            self._take(self._first_route(pose), pose, now)
        tracker, plan = self._state
        changed = tracker.update(pose)
        if changed and tracker.exited is not None:
            self.driven.append(int(self.planner.graph.edge_ids[tracker.exited]))
        inputs = self._inputs(plan, now)
        event = OperationEvent(
            now,
            pose,
            tracker,
            self.planner,
            context.local_planner,
            context.local_costmap.master,
            inputs.plan_to_costmap,
        )
        wanted, names = self.operations.process(event, changed=changed)
        if changed:
            self.triggered = tuple(names)
        if wanted.reroute:
            plan = self._reroute(pose, now, wanted.blocked, wanted.reason)
            inputs = self._inputs(plan, now)
        if context.local_planner.goal_reached(inputs):
            return BehaviorStep(BehaviorStatus.DONE, text=self._text(), data=self._data(inputs))
        self._watch(pose, state, now)
        try:
            command = context.local_planner.compute_command(inputs)
        except NavError as error:
            if now - self._commanded_at < PATIENCE_S:
                return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(), data=self._data(inputs))
            self._blocked_ahead(
                pose, now, f"the local planner has had no command for {PATIENCE_S:g} s: {error.message}"
            )
            return BehaviorStep(BehaviorStatus.RUNNING, Twist2D(), data=self._data(inputs))
        self._commanded_at = now
        self.local_plan = command
        return BehaviorStep(BehaviorStatus.RUNNING, command.command, data=self._data(inputs))

    def describe(self) -> dict[str, Any]:
        """Return the route (ids) for the record."""
        assert self.planned is not None
        route = self.planned.route
        return {"route": {"nodes": list(route.node_ids), "edges": list(route.edge_ids), "cost": route.cost}}

    def _watch(self, pose: Pose2D, state: RobotState, now: float) -> None:
        """Take the way ahead for blocked if the robot has not moved for STUCK_S."""
        del state
        last = self._moved_from
        if (
            last is None
            or pose.distance_to(last) >= STUCK_M
            or abs(math.remainder(pose.yaw - last.yaw, 2.0 * math.pi)) >= _TURNED_RAD
        ):
            self._moved_from, self._moved_at = pose, now
        elif now - self._moved_at >= STUCK_S:
            self._blocked_ahead(pose, now, f"the robot moved less than {STUCK_M:g} m in {STUCK_S:g} s")

    def _blocked_ahead(self, pose: Pose2D, now: float, reason: str) -> None:
        tracker, _ = self._state
        if not tracker.ahead:
            raise NoValidRouteError(f"the way from the route to the goal is blocked: {reason}", reason=reason)
        self._reroute(pose, now, self.planner.both_ways(tracker.ahead[0]), reason)

    # --- routes -------------------------------------------------------------------------------------------------------

    def _first_route(self, pose: Pose2D) -> PlannedRoute:
        self.planner.costmap = self._active.global_costmap.master
        return self.planner.plan(pose if self.start_at is None else self.start_at, self.goal)

    def _reroute(self, pose: Pose2D, now: float, blocked: Iterable[int], reason: str) -> Plan:
        """Plan another route from the last node, or from the robot before the first one. Raises RouteError."""
        tracker, _ = self._state
        fresh = [edge for edge in blocked if edge not in self.blocked]
        self.blocked = [*self.blocked, *fresh] if self.params.aggregate_blocked_ids else list(blocked)
        self.reroutes.append({"time": now, "reason": reason, "blocked": list(fresh)})
        self.planner.costmap = self._active.global_costmap.master
        resume = None
        if tracker.last_node is not None:
            resume = int(self.planner.graph.node_ids[tracker.last_node]), pose, tracker.edge
        try:
            planned = self.planner.plan(pose, self.goal, blocked=self.blocked, resume=resume)
        except RouteError as error:
            error.data["reroutes"] = self.reroutes
            error.message = f"{reason}, and there is no other route: {error.message}"
            raise
        self._take(planned, pose, now, reason)
        return self._state[1]

    def _take(self, planned: PlannedRoute, pose: Pose2D, now: float, reason: str = "") -> None:
        """Follow a route from now on. In the mode "planner", an edge without a plan is blocked, and another route is tried."""
        context = self._active
        while True:
            try:
                path = self._path(planned, pose)
                break
            except _EdgeBlockedError as error:
                ids = self.planner.both_ways(error.edge)
                self.blocked += ids
                self.reroutes.append({"time": now, "reason": error.text, "blocked": list(ids)})
                planned = self.planner.plan(
                    pose if planned.start is None else planned.start, self.goal, blocked=self.blocked
                )
        self.planned = planned
        self._tracker = RouteTracker(planned.route, self.params, planned.begun)
        self._plan = Plan(path, planned.route.cost, path[-1])
        self.reference, self.target = path, path[-1]
        self._commanded_at = self._moved_at = now
        context.local_planner.reset()
        context.local_planner.set_plan(path, path[-1])
        nodes = ", ".join(map(str, planned.route.node_ids[:12])) + (", .." if len(planned.route.nodes) > 12 else "")
        what = f"{len(planned.route.edges)} edges, {planned.route.length_m:.1f} m, cost {planned.route.cost:.4g}: nodes {nodes}"
        context.inform(now, f"rerouted, because {reason}: {what}" if reason else f"route of {what}")

    def _path(self, planned: PlannedRoute, pose: Pose2D) -> Path:
        """Return the path from the robot along the route to the goal."""
        along = planned.path.poses
        if self.between_nodes == "planner" and planned.route.edges:
            along = self._planned_between(planned)
        pieces = [along]
        if float(np.hypot(*(along[0, :2] - pose[:2]))) > CONNECT_M:
            pieces.insert(0, self._connection(pose, Pose2D(*along[0].tolist())))
        goal = planned.goal
        if goal is not None and (goal.distance_to(Pose2D(*along[-1].tolist())) > 1e-3):
            pieces.append(self._connection(Pose2D(*along[-1].tolist()), goal))
        elif goal is not None:
            pieces.append(np.array([goal], np.float64))
        return Path(np.concatenate(pieces), self.frame)

    def _planned_between(self, planned: PlannedRoute) -> Any:
        graph, pieces = self.planner.graph, list[Any]()
        nodes = graph.xy[list(planned.route.nodes)].astype(np.float64)
        for k, edge in enumerate(planned.route.edges):
            yaw = math.atan2(*(nodes[k + 1] - nodes[k])[::-1])
            a, b = (Pose2D(float(x), float(y), yaw) for x, y in (nodes[k], nodes[k + 1]))
            try:
                pieces.append(self._connection(a, b))
            except PlanningError as error:
                raise _EdgeBlockedError(
                    edge, f"edge {int(graph.edge_ids[edge])} has no plan: {error.message}"
                ) from None
        return np.concatenate(pieces)

    def _connection(self, a: Pose2D, b: Pose2D) -> Any:
        """Return poses of a plan between two poses, without a global planner of the straight line."""
        make_plan = self._active.make_plan
        return np.array([a, b], np.float64) if make_plan is None else make_plan(b, a).path.poses

    # --- state --------------------------------------------------------------------------------------------------------

    @property
    def _active(self) -> BehaviorContext:
        assert self._context is not None
        return self._context

    @property
    def _state(self) -> tuple[RouteTracker, Plan]:
        assert self._tracker is not None and self._plan is not None
        return self._tracker, self._plan

    def _pose(self, now: float) -> Pose2D:
        costmap = self._active.global_costmap
        try:
            pose = costmap.robot_pose(now)
        except FrameError as error:
            raise RouteFrameError(f"the robot's pose in {costmap.frame} is not known: {error.message}") from error
        if costmap.frame != self.frame:
            frames = f'the graph is in the frame "{self.frame}", the global costmap in "{costmap.frame}"'
            raise RouteFrameError(f"{frames}; write the graph in that frame", frame=self.frame)
        return pose

    def _inputs(self, plan: Plan, now: float) -> ControlInput:
        control_input = self._active.control_input
        if control_input is None:
            raise RouteError("a route needs a context with control_input; start it as a motion of move_base")
        return control_input(plan, now)

    def release(self) -> None:
        """Restore the full speed."""
        for operation in self.operations.all:
            operation.end(self._active.local_planner)

    def _data(self, inputs: ControlInput) -> dict[str, Any]:
        tracker, plan = self._state
        points = inputs.plan_to_costmap.apply_poses(plan.path.poses)[:, :2]
        nearest = int(np.hypot(*(points - inputs.state.pose[:2]).T).argmin())
        left = float(np.hypot(*np.diff(points[nearest:], axis=0).T).sum())
        ids = self.planner.graph.node_ids
        return {
            "left_m": left,
            "edges_driven": list(self.driven),
            "edges_ahead": [int(self.planner.graph.edge_ids[edge]) for edge in tracker.ahead],
            "last_node": None if tracker.last_node is None else int(ids[tracker.last_node]),
            "reroutes": [dict(reroute) for reroute in self.reroutes],
        }

    def _text(self) -> str:
        count = len(self.reroutes)
        return f"{self.name}: {len(self.driven)} edges driven, rerouted {count} time{'s' * (count != 1)}"


class _EdgeBlockedError(Exception):
    """The global planner finds no plan along an edge."""

    def __init__(self, edge: int, text: str) -> None:
        super().__init__(text)
        self.edge, self.text = edge, text

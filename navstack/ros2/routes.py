"""Routes over ROS 2: the actions ComputeRoute and ComputeAndTrackRoute, and the services and the graph of Nav2's route_server."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import numpy as np

from navstack.behavior_trees import StampedPose
from navstack.core import NavError
from navstack.move_base import RouteServer, RouteTrackingServer, TickResult, TreeMoveBase
from navstack.ros2 import ros
from navstack.ros2.ros import Publisher, RosNode
from navstack.ros2.tasks import ABORTED, CANCELED, SUCCEEDED, Codes, Outcome, Task, duration
from navstack.ros_messages import LINE_LIST, SPHERE_LIST, MessageBuilder
from navstack.ros_messages import messages as msg
from navstack.ros_node import Inbox, NodeClock
from navstack.routes import MAX_ID_IN_MESSAGES, DynamicEdgesScorer, InvalidGraphError, PlannedRoute, RouteGraph

MARKERS: Final = "visualization_msgs/msg/MarkerArray"
SERVER: Final = "route_server"
"""Name of Nav2's node, below which its services are."""


class RouteCodes(Codes):
    """The numbers of the errors of routes, which are those of Nav2 already."""

    def of(self, error: NavError) -> int:
        """Return the number of an error."""
        return error.code if self.first <= error.code < self.first + 10 else self.first


ROUTES: Final = RouteCodes(400)


class ComputeRouteTask(Task):
    """ComputeRoute."""

    codes = ROUTES
    is_aside = True
    server: RouteServer
    clock: NodeClock
    found: Mapping[str, object]

    def request(self) -> dict[str, object]:
        """Return the goal as the server takes it. Raises LogError for a rotation that is none."""
        goal = self.goal
        wanted: dict[str, object] = {"start_id": int(goal.start_id), "goal_id": int(goal.goal_id)}
        wanted |= {"use_start": bool(goal.use_start), "use_poses": bool(goal.use_poses)}
        if goal.use_poses:
            poses = {"goal": goal.goal, **({"start": goal.start} if goal.use_start else {})}
            wanted |= {key: StampedPose(*msg.pose_of(one.pose), msg.frame_of(one)) for key, one in poses.items()}
        return wanted

    def begin(self, now: float) -> None:
        """Plan the route. Raises a NavError."""
        self.started_at = now
        self.found = self.server.start(self.request(), now)

    def update(self, now: float) -> Outcome | None:
        """Return the end."""
        return Outcome(SUCCEEDED)

    def cancel(self) -> None:
        """Nothing: it has ended."""

    def fill(self, result: Any, now: float) -> None:
        """Fill route, path and time."""
        fill_route(self.build, result, self.found, self.clock.ns(now))
        result.planning_time = duration(self.build, now - self.started_at)


class TrackRouteTask(ComputeRouteTask):
    """ComputeAndTrackRoute: it does not drive; what follows the path of its feedback does."""

    feedback_s = 0.0
    tracker: RouteTrackingServer
    _tick: TickResult | None = None
    _told_at: TickResult | None = None
    _told: tuple[object, ...] = ()
    _ended = False

    def begin(self, now: float) -> None:
        """Plan the route. Raises a NavError."""
        self.started_at = now
        self.tracker.start(self.request(), now)

    def update(self, now: float) -> Outcome | None:
        """Track the robot after each tick; return the end."""
        if self._ended:
            return Outcome(CANCELED)
        if self.move_base.last_tick is self._tick:
            return None
        self._tick = self.move_base.last_tick
        try:
            done = self.tracker.update(now)
        except NavError as exc:
            self.tracker.stop()
            return Outcome(ABORTED, self.codes.of(exc), exc.message)
        if done is None:
            return None
        self.tracker.stop()
        return Outcome(SUCCEEDED)

    def cancel(self) -> None:
        """End the operations of the route."""
        self._ended = True
        self.tracker.stop()

    def feedback(self, message: Any, now: float, stamp_ns: int) -> bool:
        """Fill the progress when it has changed, as in Nav2."""
        if self._tick is self._told_at:
            return False
        self._told_at = self._tick
        seen = self.tracker.feedback()
        told = tuple(value for key, value in seen.items() if key not in ("route", "path"))
        if not seen or (told == self._told and not seen["rerouted"]):
            return False
        self._told = told
        for key in ("last_node_id", "next_node_id", "current_edge_id", "rerouted"):
            setattr(message, key, seen[key])
        message.operations_triggered = list(seen["operations_triggered"])  # type: ignore[call-overload]
        fill_route(self.build, message, seen, stamp_ns)
        return True

    def fill(self, result: Any, now: float) -> None:
        """Fill the time."""
        result.execution_duration = duration(self.build, now - self.started_at)


def fill_route(build: MessageBuilder, message: Any, found: Mapping[str, Any], stamp_ns: int) -> None:
    """Fill the fields `route` and `path`."""
    planned: PlannedRoute = found["route"].planned
    route, path = planned.route.as_dict(), planned.path
    message.path = build.path(stamp_ns, path.frame, path.poses)

    def point(at: Mapping[str, float]) -> Any:
        return build.of("geometry_msgs/msg/Point", x=at["x"], y=at["y"], z=0.0)

    message.route = build.of(
        "nav2_msgs/msg/Route",
        header=build.header(stamp_ns, path.frame),
        route_cost=route["route_cost"],
        nodes=[
            build.of("nav2_msgs/msg/RouteNode", nodeid=node["nodeid"], position=point(node["position"]))
            for node in route["nodes"]
        ],
        edges=[
            build.of("nav2_msgs/msg/RouteEdge", edgeid=e["edgeid"], start=point(e["start"]), end=point(e["end"]))
            for e in route["edges"]
        ],
    )


class RouteTopics:
    """The services of Nav2's route_server, and `route_graph`: the nodes and edges as markers."""

    def __init__(self, node: RosNode, move_base: TreeMoveBase, clock: NodeClock, inbox: Inbox) -> None:
        """Read the graph of the parameters. An error is logged; goals end with it, too."""
        self._node, self._build, self._clock = node, node.build, clock
        server = move_base.task_servers["compute_route"]
        assert isinstance(server, RouteServer)
        self.server = server
        self.tracker = RouteTrackingServer(server.graph, move_base.local_costmap, lambda: move_base.local_planner)
        self._out: Publisher | None = None
        if ros.has_message(MARKERS):
            self._out = node.publisher("route_graph", MARKERS, latched=True)
        names = ["DynamicEdgesScorer"]
        if server.graph.has_file:
            try:
                names = [one.name for one in server.graph.planner.scorers if isinstance(one, DynamicEdgesScorer)]
                self._take()
            except NavError as exc:
                node.log.logerr("route_server: %s", exc.message)
        if ros.has_message("nav2_msgs/srv/SetRouteGraph"):
            node.serve(f"{SERVER}/set_route_graph", "nav2_msgs/srv/SetRouteGraph", inbox, self._on_graph)
        if ros.has_message("nav2_msgs/srv/DynamicEdges"):
            for name in names:
                topic = f"{SERVER}/{name}/adjust_edges"
                node.serve(topic, "nav2_msgs/srv/DynamicEdges", inbox, partial(self._on_edges, name))

    def _take(self) -> None:
        """Check the graph, load the kernels of its search, and publish it. Raises InvalidGraphError."""
        planner = self.server.graph.planner
        self._check(planner.graph)
        with contextlib.suppress(NavError):  # there may be no route between these nodes
            planner.plan(int(planner.graph.node_ids[0]), int(planner.graph.node_ids[-1]))
        self._publish()

    @staticmethod
    def _check(graph: RouteGraph) -> None:
        highest = max((int(ids.max()) for ids in (graph.node_ids, graph.edge_ids) if len(ids)), default=0)
        if highest > MAX_ID_IN_MESSAGES:
            raise InvalidGraphError(
                f"the graph has the id {highest}, but ids in messages of ROS end at {MAX_ID_IN_MESSAGES}; number its nodes "
                "and edges from 0"
            )

    def _on_graph(self, request: Any, response: Any) -> None:
        response.success = False
        graph = self.server.graph
        before = graph.planner if graph.has_file else None
        graph.use_graph(str(request.graph_filepath).removeprefix("file://"))
        try:
            self._take()
        except InvalidGraphError:
            if before is not None:
                graph.planner = before
            raise
        response.success = True

    def _on_edges(self, name: str, request: Any, response: Any) -> None:
        response.success = False
        graph = self.server.graph.planner.graph
        costs = {int(one.edgeid): float(one.cost) for one in request.adjust_edges}
        closed, opened = list(map(int, request.closed_edges)), list(map(int, request.opened_edges))
        for edge in (*closed, *opened, *costs):
            graph.edge(edge)
        for scorer in self.server.graph.planner.scorers:
            if isinstance(scorer, DynamicEdgesScorer) and scorer.name == name:
                scorer.adjust(closed, opened, costs)
                response.success = True

    def _publish(self) -> None:
        if self._out is None:
            return
        build, graph = self._build, self.server.graph.planner.graph
        stamp, xy = self._clock.ns(self._clock.now()), graph.xy.astype(np.float64)
        lines = xy[np.stack([graph.starts, graph.ends], axis=1).ravel()]
        edges = build.marker(stamp, graph.frame, "edges", lines, kind=LINE_LIST, size=0.04)
        nodes = build.marker(stamp, graph.frame, "nodes", xy, kind=SPHERE_LIST, size=0.2, rgb=(0.9, 0.6, 0.0))
        self._out.publish(build.of(MARKERS, markers=[edges, nodes]))

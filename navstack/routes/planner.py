"""Routes between poses or nodes: association with the graph, search, pruning of the ends, as in nav2_route."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, Costmap, Pose2D
from navstack.routes.errors import (
    IndeterminateNodesError,
    InvalidGraphError,
    NoValidRouteError,
    RouteTimeoutError,
)
from navstack.routes.graph import RouteGraph
from navstack.routes.path import route_path
from navstack.routes.route import PlannedRoute, Route, RouteParams
from navstack.routes.scorers import (
    CLOSED,
    Costs,
    DistanceScorer,
    DynamicEdgesScorer,
    EdgeScorer,
    RouteRequest,
)
from navstack.routes.search import (
    FOUND,
    NEEDS_POSES,
    NO_COST,
    NO_COST_WEIGHT,
    NO_ROUTE,
    NODE,
    QUEUE_FULL,
    QUEUED,
    TOO_MANY,
    costs_along,
    edges_to,
    nearest_by_cells,
    shortest_route,
)

SMALL_GRAPH: Final = 2000
"""Up to this number of nodes, `auto` searches as Nav2 does, which decides among routes of equal cost."""
_EPSILON: Final = 1e-6
_UNLIMITED: Final = 2**62
_FIRST_QUEUE: Final = 4096


class RoutePlanner:
    """Plans routes in one graph.

    planner = RoutePlanner(load_graph("floor.geojson"))
    planner.plan(Pose2D(1.0, 2.0, 0.0), Pose2D(8.0, 4.0, 0.0)).route.edge_ids
    """

    def __init__(
        self,
        graph: RouteGraph,
        params: RouteParams | None = None,
        scorers: Sequence[EdgeScorer] | None = None,
        *,
        costmap: Costmap | None = None,
    ) -> None:
        """`scorers` default to Nav2's: distance, and edges that can be closed. `costmap` (frame of the graph) refines the
        association of poses, and CostmapScorer reads it; `costmap_changed` tells of changes.
        """
        self.graph = graph
        self.params = RouteParams() if params is None else params
        self.scorers: tuple[EdgeScorer, ...] = (
            (DistanceScorer(), DynamicEdgesScorer()) if scorers is None else tuple(scorers)
        )
        self._costmap = costmap
        self._parts: list[tuple[int, Costs]] = []
        """Version and costs of each scorer."""
        self._depends_on_ends = any(type(scorer).at_ends is not EdgeScorer.at_ends for scorer in self.scorers)
        self._weights: Costs | None = None
        self._scale = 0.0
        """Lower bound of cost per meter."""
        self._nodes = np.zeros(len(graph), NODE)
        self._nodes["x"], self._nodes["y"] = graph.xy[:, 0], graph.xy[:, 1]
        self._nodes["first"], self._nodes["end"] = graph.first[:-1], graph.first[1:]
        self._queue = np.zeros(_FIRST_QUEUE, QUEUED)
        self._found_edges = np.zeros(_FIRST_QUEUE, np.int64)
        self._search = 0

    @property
    def costmap(self) -> Costmap | None:
        """The costmap in use."""
        return self._costmap

    @costmap.setter
    def costmap(self, costmap: Costmap | None) -> None:
        self._costmap = costmap
        self.costmap_changed()

    def costmap_changed(self) -> None:
        """Read the costmap again before the next route."""
        if any(scorer.needs_costmap for scorer in self.scorers):
            self._weights, self._parts = None, []

    @property
    def dynamic_edges(self) -> DynamicEdgesScorer:
        """The scorer by which edges are closed and opened. Raises InvalidGraphError without one."""
        for scorer in self.scorers:
            if isinstance(scorer, DynamicEdgesScorer):
                return scorer
        raise InvalidGraphError("edges cannot be closed: add DynamicEdgesScorer to edge_cost_functions")

    def metadata_changed(self) -> None:
        """Read the metadata of the graph again before the next route."""
        self._weights, self._parts = None, []

    def both_ways(self, edge: int) -> tuple[int, ...]:
        """Return the ids of an edge (index) and of the edges between the same nodes in either direction."""
        graph = self.graph
        a, b = int(graph.starts[edge]), int(graph.ends[edge])
        there = np.arange(graph.first[a], graph.first[a + 1])
        back = np.arange(graph.first[b], graph.first[b + 1])
        same = np.concatenate([there[graph.ends[there] == b], back[graph.ends[back] == a]])
        return tuple(dict.fromkeys(graph.edge_ids[same].tolist()))

    # --- routes -------------------------------------------------------------------------------------------------------

    def plan(
        self,
        start: Pose2D | int,
        goal: Pose2D | int,
        *,
        blocked: Iterable[int] = (),
        resume: tuple[int, Pose2D, int | None] | None = None,
    ) -> PlannedRoute:
        """Return the route from `start` to `goal`, poses (frame of the graph) or node ids, and the path along it.

        `blocked` are ids of edges, or of nodes, to avoid. `resume` continues a route: id of the last node, the robot's pose, and
        the index of the edge that it is on. Raises RouteError.
        """
        node_a = self.node_at(start, is_start=True) if resume is None else self.graph.node(resume[0])
        node_b = self.node_at(goal, is_start=False)
        start_pose = start if isinstance(start, Pose2D) else None
        goal_pose = goal if isinstance(goal, Pose2D) else None
        if resume is not None:
            start_pose = resume[1]
        request = RouteRequest(node_a, node_b, start_pose, goal_pose, self.params.nav2_compatible)
        whole, iterations = self._find(request, blocked)
        route, begun, point = self._pruned(whole, request, None if resume is None else resume[2])
        path = route_path(route, self.params, None if begun is None or point is None else (begun, point))
        return PlannedRoute(route, whole, path, start_pose, goal_pose, begun, iterations)

    def find(self, start: int, goal: int, *, blocked: Iterable[int] = ()) -> Route:
        """Return the route between two nodes, by id, without pruning and path. Raises RouteError."""
        return self._find(RouteRequest(self.graph.node(start), self.graph.node(goal)), blocked)[0]

    def _find(self, request: RouteRequest, blocked: Iterable[int]) -> tuple[Route, int]:
        graph, p = self.graph, self.params
        if request.start == request.goal:
            return Route(graph, request.start, (), (), 0.0), 0
        weights, changed = self._weights_for(request)
        ids = set(blocked)
        if ids:
            weights = self._without(weights, ids)
        exact = p.search == "dijkstra" or p.max_iterations > 0 or (p.search == "auto" and len(graph) <= SMALL_GRAPH)
        result, edge, iterations = QUEUE_FULL, -1, 0
        while result == QUEUE_FULL:
            self._search += 1
            result, edge, iterations = shortest_route(
                self._nodes,
                graph.ends,
                weights,
                self._queue,
                self._search,
                request.start,
                request.goal,
                0.0 if exact else self._scale,
                p.max_iterations or _UNLIMITED,
            )
            if result == QUEUE_FULL:
                self._queue = np.zeros(2 * len(self._queue), QUEUED)
        if result != FOUND:
            self._restore(changed)
            raise self._failure(result, int(edge), request, ids)
        edges = self._edges_to(request.goal)
        costs = tuple(weights[edges].tolist())
        cost = float(self._nodes[request.goal]["route_cost"])
        self._restore(changed)
        return Route(graph, request.start, tuple(edges.tolist()), costs, cost), iterations

    def _edges_to(self, goal: int) -> NDArray[np.int64]:
        """Return the edges by which the search reached `goal`, in the order of driving."""
        count = edges_to(self._nodes, self.graph.starts, goal, self._found_edges)
        if count > len(self._found_edges):
            self._found_edges = np.zeros(2 * count, np.int64)
            edges_to(self._nodes, self.graph.starts, goal, self._found_edges)
        return self._found_edges[:count][::-1]

    # --- costs of edges -----------------------------------------------------------------------------------------------

    def weights(self) -> Costs:
        """(m,) float32 costs of the edges for the search, without those that depend on the request."""
        versions = [scorer.version for scorer in self.scorers]
        if self._weights is not None and versions == [version for version, _ in self._parts]:
            return self._weights
        graph = self.graph
        if len(self._parts) != len(self.scorers):
            self._parts = [(-1, graph.costs)] * len(self.scorers)
        for i, scorer in enumerate(self.scorers):
            if self._parts[i][0] != scorer.version:
                self._parts[i] = scorer.version, scorer.scores(graph, self._costmap).astype(np.float32)
        total = np.zeros(graph.edge_count, np.float32)
        for _, part in self._parts:
            total = total + part
        wrong = (total < 0.0) & graph.overridable if self.scorers else np.zeros(0, np.bool_)
        if wrong.any():
            edge = int(graph.edge_ids[int(wrong.argmax())])
            raise InvalidGraphError(
                f"the scores of edge {edge} add up to {total[wrong.argmax()]:g}; a cost must be 0 or more: raise its penalty, "
                "or the cost of its class",
                edge=edge,
            )
        fixed = np.where(graph.costs > 0.0, graph.costs, np.float32(NO_COST_WEIGHT))
        total = np.where(graph.overridable, total, fixed) if self.scorers else fixed
        self._weights = np.ascontiguousarray(total, np.float32)
        usable = np.isfinite(total) & (graph.lengths > 0.0)
        ratios = total[usable].astype(np.float64) / graph.lengths[usable]
        # below the true bound by more than the rounding of float32 sums
        self._scale = max(0.0, float(ratios.min()) * (1.0 - 1e-4)) if len(ratios) else 0.0
        return self._weights

    def _weights_for(self, request: RouteRequest) -> tuple[Costs, tuple[NDArray[np.intp], Costs] | None]:
        """Return the costs for a request, and what to restore after the search."""
        weights, graph = self.weights(), self.graph
        if not self._depends_on_ends:
            return weights, None
        edges = np.unique(
            np.append(np.arange(graph.first[request.start], graph.first[request.start + 1]), self._into(request.goal))
        )
        total, depends = np.zeros(len(edges), np.float32), False
        for i, scorer in enumerate(self.scorers):
            if type(scorer).at_ends is EdgeScorer.at_ends:
                total = total + self._parts[i][1][edges]
                continue
            if scorer.needs_pose(request):
                # Nav2 asks the scorers one after another, when the search reaches an edge
                before = sum((part for _, part in self._parts[:i]), np.zeros(graph.edge_count, np.float32))
                return np.where(graph.overridable & np.isfinite(before), np.float32(np.nan), weights), None
            own = scorer.at_ends(graph, request, edges)
            total = total + (self._parts[i][1][edges] if own is None else own)
            depends = depends or own is not None
        if not depends:
            return weights, None
        kept = weights[edges]
        weights[edges] = np.where(graph.overridable[edges], total, kept)
        return weights, (edges, kept)

    def _restore(self, changed: tuple[NDArray[np.intp], Costs] | None) -> None:
        if changed is not None and self._weights is not None:
            self._weights[changed[0]] = changed[1]

    def _into(self, node: int) -> NDArray[np.intp]:
        """Return the edges that end at a node."""
        order, first = self._incoming
        return order[first[node] : first[node + 1]]

    @cached_property
    def _incoming(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        order = np.argsort(self.graph.ends, kind="stable")
        return order, np.searchsorted(self.graph.ends[order], np.arange(len(self.graph) + 1))

    def _without(self, weights: Costs, ids: set[int]) -> Costs:
        """Return the costs with the edges, and those into the nodes, of these ids closed."""
        graph, found = self.graph, weights.copy()
        found[graph.edges_of(ids)] = CLOSED
        nodes = [graph.index_of_node[number] for number in ids if number in graph.index_of_node]
        if nodes:
            found[np.isin(graph.ends, nodes)] = CLOSED
        return found

    def _failure(self, result: int, edge: int, request: RouteRequest, blocked: set[int]) -> Exception:
        """Return the error for a result of the search."""
        graph = self.graph
        a, b = int(graph.node_ids[request.start]), int(graph.node_ids[request.goal])
        if result == TOO_MANY:
            limit = self.params.max_iterations
            return RouteTimeoutError(
                f"no route from node {a} to node {b} within max_iterations ({limit}); raise it, or 0 for no limit",
                start=a,
                goal=b,
                max_iterations=limit,
            )
        if result == NO_COST:
            number = int(graph.edge_ids[edge])
            return InvalidGraphError(
                f"edge {number} has no cost above 0, and no scorer may give it one; write its cost, or overridable: true",
                edge=number,
            )
        if result == NEEDS_POSES:
            scorer = next(s for s in self.scorers if s.needs_pose(request))
            return scorer.missing_pose(request)
        assert result == NO_ROUTE
        closed = sorted(graph.edge_ids[np.isinf(self.weights())].tolist())
        why: list[str] = []
        if blocked:
            why.append(f"{len(blocked)} blocked: {_listed(sorted(blocked))}")
        if closed:
            why.append(f"{len(closed)} edges closed: {_listed(closed)}")
        found = self._nodes["in_search"] == self._search
        text = f"; {'; '.join(why)}" if why else "; `navstack route check` finds nodes that edges do not reach"
        return NoValidRouteError(
            f"the graph has no way from node {a} to node {b} ({int(found.sum())} of {len(graph)} nodes can be reached){text}",
            start=a,
            goal=b,
            reachable=int(found.sum()),
            blocked=sorted(blocked),
            closed=closed[:100],
        )

    # --- nodes of poses -----------------------------------------------------------------------------------------------

    @cached_property
    def _tree(self) -> Any:
        from scipy.spatial import KDTree  # slow import

        return KDTree(self.graph.xy.astype(np.float64))

    def nearest_nodes(self, pose: Pose2D, count: int | None = None) -> NDArray[np.intp]:
        """Return the indices of the nodes nearest to a pose (m), nearest first; default `num_nearest_nodes` of them."""
        wanted = self.params.num_nearest_nodes if count is None else count
        if not (math.isfinite(pose.x) and math.isfinite(pose.y)):
            raise IndeterminateNodesError(
                f"no node is nearest to ({pose.x}, {pose.y}); give finite numbers (m)", pose=pose
            )
        away, found = self._tree.query((pose.x, pose.y), k=min(wanted, len(self.graph)))
        found = np.atleast_1d(np.asarray(found, np.intp))
        found = found[np.lexsort((found, np.atleast_1d(away)))]  # of nodes at one place the first
        if self.params.nav2_compatible and len(found) < wanted:
            found = np.append(found, np.zeros(wanted - len(found), np.intp))
        return found

    def node_at(self, where: Pose2D | int, *, is_start: bool) -> int:
        """Return the index of the node for a pose or an id.

        That is the nearest one, if the straight line to it is free on the costmap, or without a costmap. Otherwise the one of
        `num_nearest_nodes` that is nearest along free cells. Raises RouteError.
        """
        if not isinstance(where, Pose2D):
            return self.graph.node(where)
        candidates = self.nearest_nodes(where)
        costmap = self._costmap
        if costmap is None or not self.params.enable_nn_search or len(candidates) < 2:
            return int(candidates[0])
        g, here = costmap.geometry, costmap.geometry.world_to_cell(where.x, where.y)
        cells = [g.world_to_cell(x, y) for x, y in self.graph.xy[candidates].astype(np.float64).tolist()]
        nearest, flat = cells[0], costmap.data.reshape(-1)
        if here is None or nearest is None:
            return int(candidates[0])
        figures = np.zeros((1, 5))
        costs_along(flat, g.nx, np.array([[*nearest, *here]], np.int64), 1, figures)
        if figures[0, 0] < INSCRIBED:
            return int(candidates[0])
        wanted = [-1 if cell is None else cell[1] * g.nx + cell[0] for cell in cells]
        if self.params.nav2_compatible:
            wanted = [cell for cell in wanted if cell >= 0]
        limit = self.params.max_nn_search_iterations if is_start else _UNLIMITED
        found = nearest_by_cells(flat, g.nx, here[1] * g.nx + here[0], np.array(wanted, np.int64), limit)
        return int(candidates[max(found, 0)])

    # --- pruning ------------------------------------------------------------------------------------------------------

    def _pruned(
        self, whole: Route, request: RouteRequest, on_edge: int | None
    ) -> tuple[Route, int | None, tuple[float, float] | None]:
        """Return the route without ends that the poses are beside; and if the robot is on its first edge, this and the point."""
        p, route = self.params, whole
        begun: int | None = None
        point: tuple[float, float] | None = None
        xy, f = self.graph.xy, np.float32
        if route.edges and request.start_pose is not None:
            a, b = xy[route.first_node], xy[self.graph.ends[route.edges[0]]]
            pose = np.array(request.start_pose[:2])
            away = (pose - a).astype(f)
            closest = closest_point(pose, a, b)
            if (
                _normalized_dot(b - a, away) > _EPSILON
                and np.hypot(*away) > f(p.min_prune_dist_from_start)
                and f(np.hypot(*(closest - pose))) <= f(p.max_prune_dist_from_edge)
            ):
                if on_edge == route.edges[0]:
                    begun, point = on_edge, (float(closest[0]), float(closest[1]))
                cost = float(f(route.cost) - f(route.edge_costs[0]))
                route = Route(
                    self.graph, int(self.graph.ends[route.edges[0]]), route.edges[1:], route.edge_costs[1:], cost
                )
        if p.prune_goal and request.goal_pose is not None and route.edges:
            a, b = xy[self.graph.starts[route.edges[-1]]], xy[self.graph.ends[route.edges[-1]]]
            pose = np.array(request.goal_pose[:2])
            away = (pose - b).astype(f)
            closest = closest_point(pose, a, b)
            if (
                _normalized_dot(b - a, away) < -_EPSILON
                and np.hypot(*away) > f(p.min_prune_dist_from_goal)
                and f(np.hypot(*(closest - pose))) <= f(p.max_prune_dist_from_edge)
            ):
                cost = float(f(route.cost) - f(route.edge_costs[-1]))
                route = Route(self.graph, route.first_node, route.edges[:-1], route.edge_costs[:-1], cost)
        return route, begun, point


def _normalized_dot(a: NDArray[np.float32], b: NDArray[np.float32]) -> np.float32:
    """Return the cosine of the angle between two vectors, 0 if one is short; float32 as in Nav2."""
    long_a, long_b = np.hypot(*a), np.hypot(*b)
    if long_a < _EPSILON or long_b < _EPSILON:
        return np.float32(0.0)
    return (a[0] / long_a) * (b[0] / long_b) + (a[1] / long_a) * (b[1] / long_b)


def closest_point(point: NDArray[np.float64], a: NDArray[np.float32], b: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the point of the segment from `a` to `b` that is closest to `point` (m)."""
    v = b - a
    squared = float(v @ v)
    if squared < _EPSILON:
        return a
    share = min(max(float(v @ (point - a)) / squared, 0.0), 1.0)
    return ((1.0 - share) * a + share * b).astype(np.float32)


def _listed(ids: Sequence[int]) -> str:
    return ", ".join(map(str, ids[:8])) + (", .." if len(ids) > 8 else "")

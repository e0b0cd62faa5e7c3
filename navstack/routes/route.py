"""What a route is: nodes and edges in order; and the parameters by which routes are planned and driven."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from navstack.core import Path, Pose2D
from navstack.plugins import ParamModel, param
from navstack.routes.graph import RouteGraph


class RouteParams(ParamModel):
    """Parameters of Nav2's route server; names and defaults as in its code."""

    max_iterations: int = param(0, "nodes that a search takes from its queue at most; 0 for no limit", ge=0)
    search: Literal["auto", "dijkstra", "astar"] = param(
        "auto",
        "Dijkstra's algorithm as in Nav2, or A*, which finds a route of the same cost sooner; auto: A* above 2000 nodes",
    )
    enable_nn_search: bool = param(True, "prefer a node that can be reached from the pose on the costmap")
    num_nearest_nodes: int = param(5, "nodes near a pose to choose from", ge=1, le=1000)
    max_nn_search_iterations: int = param(10000, "cells that the search from the start visits at most", ge=1)
    prune_goal: bool = param(True, "leave out the last edge if the goal is beside it")
    max_prune_dist_from_edge: float = param(
        8.0, "leave out an edge only if the pose is as near to it", unit="m", ge=0.0
    )
    min_prune_dist_from_goal: float = param(
        0.15, "keep the last edge if the goal is as near to its end", unit="m", ge=0.0
    )
    min_prune_dist_from_start: float = param(
        0.10, "keep the first edge if the start is as near to its begin", unit="m", ge=0.0
    )
    path_density: float = param(0.05, "distance between poses of the path", unit="m", gt=0.0)
    smooth_corners: bool = param(False, "replace corners of the path by arcs")
    smoothing_radius: float = param(1.0, "radius of these arcs", unit="m", gt=0.0)
    smoothing_angle_threshold: float = param(
        2.9, "keep corners that are straighter: angle between the edges", unit="rad", gt=0.0
    )
    radius_to_achieve_node: float = param(2.0, "distance at which a node may count as passed", unit="m", gt=0.0)
    boundary_radius_to_achieve_node: float = param(
        1.0, "distance at which the first and the last node count as reached", unit="m", gt=0.0
    )
    aggregate_blocked_ids: bool = param(
        True,
        "keep edges blocked that were found blocked before",
        ros_differs="true, so that a robot does not go to and fro between two blocked ways for ever",
    )
    nav2_compatible: bool = param(
        False,
        "associate poses and score edges with the defects of Nav2, for comparisons",
        ros_differs="an edge from start to goal is scored as both; candidates off the costmap are left out",
    )


@dataclass(frozen=True, slots=True)
class Route:
    """Nodes and edges in order."""

    graph: RouteGraph = field(repr=False)
    first_node: int
    """Index."""
    edges: tuple[int, ...]
    """Indices."""
    edge_costs: tuple[float, ...]
    cost: float

    @property
    def nodes(self) -> tuple[int, ...]:
        """Indices of the nodes, one more than edges."""
        return self.first_node, *(int(self.graph.ends[edge]) for edge in self.edges)

    @property
    def node_ids(self) -> tuple[int, ...]:
        """Ids of the nodes."""
        return tuple(int(self.graph.node_ids[node]) for node in self.nodes)

    @property
    def edge_ids(self) -> tuple[int, ...]:
        """Ids of the edges."""
        return tuple(int(self.graph.edge_ids[edge]) for edge in self.edges)

    @property
    def length_m(self) -> float:
        """Sum of the lengths of the edges (m)."""
        return float(sum(float(self.graph.lengths[edge]) for edge in self.edges))

    def as_dict(self) -> dict[str, Any]:
        """Return Nav2's message Route as JSON data."""
        xy = self.graph.xy.astype(np.float64)
        place = [{"x": x, "y": y} for x, y in xy[list(self.nodes)].tolist()]
        return {
            "route_cost": self.cost,
            "nodes": [{"nodeid": node, "position": p} for node, p in zip(self.node_ids, place, strict=True)],
            "edges": [
                {"edgeid": edge, "start": a, "end": b, "cost": cost}
                for edge, (a, b), cost in zip(self.edge_ids, itertools.pairwise(place), self.edge_costs, strict=True)
            ],
        }


@dataclass(frozen=True, slots=True)
class PlannedRoute:
    """A route, and the path along it."""

    route: Route
    """The route without the edges that the robot, or the goal, is already beside."""
    whole: Route
    """The route from node to node."""
    path: Path
    start: Pose2D | None
    """None in a request by node ids."""
    goal: Pose2D | None
    begun: int | None = None
    """Index of the edge that the robot is already on, which the path begins with; None if it is in the route."""
    iterations: int = 0
    """Nodes that the search took from its queue."""

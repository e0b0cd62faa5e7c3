"""Edge scorers: what an edge costs. A scorer and its parameters are one class; names and defaults are those of nav2_route.

A scorer gives the costs of all edges at once (float32, as in Nav2); infinity closes an edge. The cost of an edge is the sum over
the scorers in their order.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, Field
from typing_extensions import TypeVar

from navstack.core import UNKNOWN, Costmap, InputError, Pose2D
from navstack.plugins import ParamModel, param
from navstack.routes.errors import EdgeScorerUseError, InvalidGraphError
from navstack.routes.graph import RouteGraph
from navstack.routes.search import costs_along, edge_directions

Costs = NDArray[np.float32]
CLOSED: Final = np.float32(np.inf)


@dataclass(frozen=True, slots=True)
class RouteRequest:
    """What a route is wanted for."""

    start: int
    """Index of the start node."""
    goal: int
    start_pose: Pose2D | None = None
    """None in a request by node ids."""
    goal_pose: Pose2D | None = None
    nav2_compatible: bool = False
    """An edge from start to goal is at the start only."""


P = TypeVar("P", bound=ParamModel, default=Any)


class EdgeScorer(ABC, Generic[P]):
    """Scores edges. Subclass it for a rule of your own, and pass an instance or the class to `RoutePlanner`."""

    Params: ClassVar[type[ParamModel]]
    needs_costmap: ClassVar[bool] = False

    def __init__(self, params: P | None = None, name: str = "") -> None:
        made: Any = self.Params() if params is None else params
        self.params: P = made
        self.name = name or type(self).__name__
        self.version = 0
        """Raise it when the costs change; they are computed again then."""

    @abstractmethod
    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return (m,) float32 costs of all edges, infinity for closed ones."""

    def at_ends(self, graph: RouteGraph, request: RouteRequest, edges: NDArray[np.intp]) -> Costs | None:
        """Return (k,) costs of `edges`, which leave the start or enter the goal, if they depend on the request."""
        del graph, request, edges
        return None

    def needs_pose(self, request: RouteRequest) -> bool:
        """Return True if the scorer needs a pose that the request does not have."""
        del request
        return False

    def missing_pose(self, request: RouteRequest) -> EdgeScorerUseError:
        """Return the error for such a request."""
        end = "start" if request.start_pose is None else "goal"
        return EdgeScorerUseError(
            f"{self.name} needs the pose of the {end}; give poses instead of node ids, or remove it"
        )


class DistanceParams(ParamModel):
    """Parameters of DistanceScorer."""

    weight: float = param(1.0, "factor of the cost", ge=0.0)
    speed_tag: str = param("speed_limit", "metadata of an edge: the share of the full speed that is allowed")


class DistanceScorer(EdgeScorer[DistanceParams]):
    """Length of the edge (m), divided by its speed limit."""

    Params = DistanceParams

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return weight * length / speed limit. Raises InvalidGraphError for a limit that is no number."""
        limits = graph.numbers(self.params.speed_tag, 1.0)
        return np.float32(self.params.weight) * graph.lengths / _positive(graph, limits, self.params.speed_tag)


class TimeParams(ParamModel):
    """Parameters of TimeScorer."""

    weight: float = param(1.0, "factor of the cost", ge=0.0)
    speed_tag: str = param("abs_speed_limit", "metadata of an edge: its speed (m/s), if above 0")
    time_tag: str = param("abs_time_taken", "metadata of an edge: the time that it took (s), if above 0")
    max_vel: float = param(0.5, "speed on edges without one", unit="m/s", gt=0.0)


class TimeScorer(EdgeScorer[TimeParams]):
    """Time along the edge (s): the time taken before, else its length by its speed."""

    Params = TimeParams

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return weight * time."""
        p, weight = self.params, np.float32(self.params.weight)
        taken = graph.numbers(p.time_tag, 0.0)
        speed = graph.numbers(p.speed_tag, 0.0)
        speed = np.where(speed > 0.0, speed, np.float32(p.max_vel))
        return np.where(taken > 0.0, weight * taken, weight * graph.lengths / speed)


class PenaltyParams(ParamModel):
    """Parameters of PenaltyScorer."""

    weight: float = param(1.0, "factor of the cost", ge=0.0)
    penalty_tag: str = param("penalty", "metadata of an edge: its penalty")


class PenaltyScorer(EdgeScorer[PenaltyParams]):
    """The penalty in the metadata of the edge."""

    Params = PenaltyParams

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return weight * penalty."""
        return np.float32(self.params.weight) * graph.numbers(self.params.penalty_tag, 0.0)


class CostmapParams(ParamModel):
    """Parameters of CostmapScorer."""

    weight: float = param(1.0, "factor of the cost", ge=0.0)
    use_maximum: bool = param(True, "the highest cost along the edge; otherwise the mean")
    invalid_on_collision: bool = param(True, "close edges with a cell of max_cost or more")
    invalid_off_map: bool = param(True, "close edges whose ends are not on the costmap")
    max_cost: float = param(253.0, "cost that closes an edge, and by which costs are divided", gt=0.0, le=255.0)
    check_resolution: int = param(2, "look at every n-th cell", ge=1)
    costmap_topic: str = param("global_costmap/costmap_raw", "no effect: the scorer reads the global costmap")
    nav2_compatible: bool = param(
        False,
        "count unknown cells as 255 in the mean, as Nav2 does",
        ros_differs="unknown cells do not count in the mean",
    )


class CostmapScorer(EdgeScorer[CostmapParams]):
    """Cost of the costmap along the edge, from 0 to 1 (at max_cost)."""

    Params = CostmapParams
    needs_costmap = True

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return weight * cost / max_cost. Without a costmap every edge is closed, as in Nav2."""
        p, count = self.params, graph.edge_count
        if costmap is None:
            return np.full(count, CLOSED)
        lines, outside = edge_cells(graph, costmap)
        figures = np.zeros((count, 5))
        costs_along(costmap.data.reshape(-1), costmap.geometry.nx, lines, p.check_resolution, figures)
        known, highest, total, cells, unknown = figures.astype(np.float32).T
        weight, limit = np.float32(p.weight), np.float32(p.max_cost)
        if p.use_maximum:
            found = weight * known / limit
        else:
            if p.nav2_compatible:
                total, unknown = total + np.float32(UNKNOWN) * unknown, np.zeros_like(unknown)
            # ROS differs: an unknown cell has no cost, as in the maximum; Nav2 adds 255
            found = weight * total / (np.maximum(cells - unknown, np.float32(1.0)) * limit)
        if p.invalid_on_collision and p.max_cost != UNKNOWN:
            found[highest >= limit] = CLOSED
        found[outside] = CLOSED if p.invalid_off_map else np.float32(0.0)
        return found


class SemanticParams(ParamModel):
    """Parameters of SemanticScorer."""

    model_config = ConfigDict(extra="allow")

    weight: float = param(1.0, "factor of the cost", ge=0.0)
    semantic_classes: list[str] = param([], "names of the classes; each has a cost under its name")
    semantic_key: str = param("class", "metadata that has the class; empty: every key is a class")
    costs: dict[str, float] = Field(default_factory=dict[str, float], description="cost by class, as under its name")


class SemanticScorer(EdgeScorer[SemanticParams]):
    """Costs of the classes of the edge and of its end node."""

    Params = SemanticParams

    def __init__(self, params: SemanticParams | None = None, name: str = "") -> None:
        """Raises InputError for a class without a cost."""
        super().__init__(params, name)
        given = {**self.params.costs, **(self.params.model_extra or {})}
        self.costs: dict[str, np.float32] = {}
        for kind in self.params.semantic_classes or self.params.costs:
            cost = given.get(kind)
            if isinstance(cost, bool) or not isinstance(cost, (int, float)) or not math.isfinite(cost):
                raise InputError(
                    f"{self.name}: the semantic class {kind} has no cost; write {kind}: 1.0 beside semantic_classes"
                )
            self.costs[kind] = np.float32(cost)
        unknown = set(self.params.model_extra or {}) - set(self.costs)
        if unknown:
            raise InputError(
                f"{self.name}: {min(unknown)} is neither a parameter nor one of semantic_classes; remove it"
            )

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return weight * sum of the costs of the classes."""
        of_node, of_edge = np.zeros(len(graph), np.float32), np.zeros(graph.edge_count, np.float32)
        for values, metadata in ((of_node, graph.node_metadata), (of_edge, graph.edge_metadata)):
            for index, items in metadata.items():
                values[index] = self._score(items)
        return np.float32(self.params.weight) * (of_node[graph.ends] + of_edge)

    def _score(self, metadata: Mapping[str, Any]) -> np.float32:
        key, zero = self.params.semantic_key, np.float32(0.0)
        if key:
            kind = metadata.get(key)
            return self.costs.get(kind, zero) if isinstance(kind, str) else zero
        return sum((self.costs[kind] for kind in metadata if kind in self.costs), zero)


class DynamicEdgesParams(ParamModel):
    """DynamicEdgesScorer has no parameters."""


class DynamicEdgesScorer(EdgeScorer[DynamicEdgesParams]):
    """Closes edges, opens them again, and adds costs to edges, at any time."""

    Params = DynamicEdgesParams

    def __init__(self, params: DynamicEdgesParams | None = None, name: str = "") -> None:
        super().__init__(params, name)
        self.closed: set[int] = set()
        """Ids of closed edges."""
        self.added: dict[int, float] = {}
        """Cost by id."""

    def adjust(
        self, closed: Iterable[int] = (), opened: Iterable[int] = (), costs: Mapping[int, float] | None = None
    ) -> None:
        """Close edges, open edges, set the costs of edges (0 removes one). Raises InputError for a cost that is below 0."""
        for edge, cost in (costs or {}).items():
            if not (math.isfinite(cost) and cost >= 0.0):
                raise InputError(f"the cost {cost} of edge {edge} is no cost; give 0 or more", edge=edge)
        self.closed |= set(closed)
        self.closed -= set(opened)
        self.added |= costs or {}
        self.version += 1

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return the added costs; ids that the graph does not have are ignored, as in Nav2."""
        found = np.zeros(graph.edge_count, np.float32)
        for edge in graph.edges_of(self.added).tolist():
            found[edge] = self.added[int(graph.edge_ids[edge])]
        found[graph.edges_of(self.closed)] = CLOSED
        return found


class OrientationParams(ParamModel):
    """Parameters of the orientation scorers."""

    orientation_weight: float = param(1.0, "cost per rad", ge=0.0)
    use_orientation_threshold: bool = param(False, "close edges that differ by more than orientation_tolerance")
    orientation_tolerance: float = param(math.pi / 2.0, "largest difference", unit="rad", ge=0.0)


class _OrientationScorer(EdgeScorer[OrientationParams]):
    """Difference between the direction of an edge at one end of the route and the heading of the pose there."""

    Params = OrientationParams
    at_goal: ClassVar[bool]

    def scores(self, graph: RouteGraph, costmap: Costmap | None) -> Costs:
        """Return 0: only edges at the end of the route have a cost."""
        return np.zeros(graph.edge_count, np.float32)

    def at_ends(self, graph: RouteGraph, request: RouteRequest, edges: NDArray[np.intp]) -> Costs:
        """Return the costs of the edges at this end."""
        pose = request.goal_pose if self.at_goal else request.start_pose
        if pose is None:
            raise self.missing_pose(request)
        d = graph.xy[graph.ends[edges]] - graph.xy[graph.starts[edges]]
        directions = np.zeros(len(edges))
        edge_directions(d, directions)
        away = directions - pose.yaw
        away = np.abs(np.remainder(away + math.pi, 2.0 * math.pi) - math.pi)
        found = np.float32(self.params.orientation_weight) * away.astype(np.float32)
        if self.params.use_orientation_threshold:
            found[away > self.params.orientation_tolerance] = CLOSED
        leaves = graph.starts[edges] == request.start
        here = graph.ends[edges] == request.goal if self.at_goal else leaves
        if self.at_goal and request.nav2_compatible:
            here &= ~leaves
        return np.where(here, found, np.float32(0.0))

    def needs_pose(self, request: RouteRequest) -> bool:
        """Return True without the pose of this end."""
        return (request.goal_pose if self.at_goal else request.start_pose) is None


class GoalOrientationScorer(_OrientationScorer):
    """Difference between the direction of the last edge and the heading of the goal (rad)."""

    at_goal = True


class StartPoseOrientationScorer(_OrientationScorer):
    """Difference between the direction of the first edge and the heading of the start (rad)."""

    at_goal = False


SCORERS: Final[dict[str, type[EdgeScorer]]] = {
    scorer.__name__: scorer
    for scorer in (
        DistanceScorer,
        TimeScorer,
        PenaltyScorer,
        CostmapScorer,
        SemanticScorer,
        DynamicEdgesScorer,
        GoalOrientationScorer,
        StartPoseOrientationScorer,
    )
}
"""Edge scorers by the name of their class; Nav2 writes `nav2_route::` before it."""


def edge_cells(graph: RouteGraph, costmap: Costmap) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the cells (m, 4) = x0, y0, x1, y1 of the ends of all edges, and (m,) True where one is not on the costmap."""
    g = costmap.geometry
    cells = (graph.xy.astype(np.float64) - (g.origin_x, g.origin_y)) / g.resolution
    off = (cells < 0.0).any(axis=1) | (cells[:, 0] >= g.nx) | (cells[:, 1] >= g.ny)
    cells = np.where(off[:, None], -1, cells).astype(np.int64)
    outside = off[graph.starts] | off[graph.ends]
    lines = np.hstack([cells[graph.starts], cells[graph.ends]])
    lines[outside] = -1
    return lines, outside


def _positive(graph: RouteGraph, values: Costs, tag: str) -> Costs:
    """Return the values. Raises InvalidGraphError for one that is not above 0: nothing can be divided by it."""
    if len(values) and not values.min() > 0.0:
        edge = int(graph.edge_ids[int(values.argmin())])
        raise InvalidGraphError(f"{tag} of edge {edge} is {values.min():g}; write a limit above 0", edge=edge, key=tag)
    return values

"""Routes: the shortest one, edge scorers, association with the costmap, pruning, paths, parameters."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from navstack.core import Costmap, GridGeometry, InputError, ParameterError, Pose2D
from navstack.routes import (
    InvalidGraphError,
    NoValidRouteError,
    RouteGraph,
    RouteParams,
    RoutePlanner,
    build_graph,
    read_scorers,
)
from navstack.routes.errors import EdgeScorerUseError, IndeterminateNodesError, RouteTimeoutError
from navstack.routes.scorers import (
    CostmapParams,
    CostmapScorer,
    DistanceScorer,
    GoalOrientationScorer,
    StartPoseOrientationScorer,
)


def random_graph(seed: int, nodes: int = 60, edges: int = 200) -> RouteGraph:
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0.0, 20.0, (nodes, 2))
    pairs = {(int(a), int(b)) for a, b in rng.integers(0, nodes, (edges, 2)) if a != b}
    return build_graph({i: (float(x), float(y)) for i, (x, y) in enumerate(xy)}, sorted(pairs))


def ring(count: int = 8, radius: float = 4.0) -> RouteGraph:
    turn = 2.0 * math.pi / count
    nodes = {i: (radius * math.cos(i * turn), radius * math.sin(i * turn)) for i in range(count)}
    return build_graph(nodes, [(i, (i + 1) % count) for i in range(count)], both_ways=True)


def lane(length: int = 4) -> RouteGraph:
    """Nodes 0 .. length every 2 m along x, both ways; edges length + 1, ..: there and back in turn."""
    return build_graph(
        {i: (2.0 * i, 0.0) for i in range(length + 1)}, [(i, i + 1) for i in range(length)], both_ways=True
    )


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["dijkstra", "astar"]))
def test_the_cost_is_that_of_scipy(seed: int, search: Literal["dijkstra", "astar"]) -> None:
    graph = random_graph(seed)
    planner = RoutePlanner(graph, RouteParams(search=search))
    matrix = csr_matrix((graph.lengths.astype(np.float64), (graph.starts, graph.ends)), (len(graph), len(graph)))
    for goal in (3, 7, 11):
        expected = float(dijkstra(matrix, indices=0)[goal])
        try:
            route = planner.find(0, goal)
        except NoValidRouteError:
            assert math.isinf(expected)
            continue
        assert route.cost == pytest.approx(expected, rel=1e-5)
        assert sum(route.edge_costs) == pytest.approx(route.cost, rel=1e-5)
        assert route.nodes[0] == 0
        assert route.nodes[-1] == goal
        for edge, (a, b) in zip(route.edges, zip(route.nodes[:-1], route.nodes[1:], strict=True), strict=True):
            assert (graph.starts[edge], graph.ends[edge]) == (a, b)


def test_closing_and_opening_edges() -> None:
    planner = RoutePlanner(ring())
    there = planner.find(0, 2)
    assert there.node_ids == (0, 1, 2)
    planner.dynamic_edges.adjust(closed=[there.edge_ids[1]])
    around = planner.find(0, 2)
    assert around.node_ids == (0, 7, 6, 5, 4, 3, 2)
    with pytest.raises(NoValidRouteError, match=r"1 blocked: 6; 1 edges closed: 10") as error:
        planner.find(0, 2, blocked=[6])
    assert error.value.code == 405
    planner.dynamic_edges.adjust(opened=[there.edge_ids[1]], costs={there.edge_ids[0]: 100.0})
    assert planner.find(0, 2).node_ids == around.node_ids
    planner.dynamic_edges.adjust(costs={there.edge_ids[0]: 0.0})
    assert planner.find(0, 2) == there
    with pytest.raises(InputError, match=r"the cost -1.0 of edge 8 is no cost"):
        planner.dynamic_edges.adjust(costs={8: -1.0})
    with pytest.raises(InvalidGraphError, match="add DynamicEdgesScorer"):
        _ = RoutePlanner(ring(), scorers=[DistanceScorer()]).dynamic_edges


def test_an_edge_with_its_own_cost_keeps_it() -> None:
    graph = lane(2)
    graph.overridable[:] = False
    with pytest.raises(InvalidGraphError, match=r"edge 3 has no cost above 0, .* overridable: true"):
        RoutePlanner(graph).find(0, 2)
    graph.costs[:] = 7.0
    assert RoutePlanner(graph).find(0, 2).cost == 14.0


def test_orientations_decide_about_first_and_last_edge() -> None:
    graph = ring()
    away = Pose2D(4.0, 0.0, -math.pi / 2.0)  # at node 0, against the ring's direction
    goal = Pose2D(-4.0, 0.0, math.pi / 2.0)
    scorers = [DistanceScorer(), StartPoseOrientationScorer(), GoalOrientationScorer()]
    planner = RoutePlanner(graph, scorers=scorers)
    assert planner.plan(away, goal).whole.node_ids == (0, 7, 6, 5, 4)
    assert planner.plan(away._replace(yaw=math.pi / 2.0), goal._replace(yaw=-math.pi / 2.0)).whole.node_ids == (
        0,
        1,
        2,
        3,
        4,
    )
    with pytest.raises(EdgeScorerUseError, match=r"StartPoseOrientationScorer needs the pose of the start") as error:
        planner.plan(0, 4)
    assert error.value.code == 407
    assert planner.plan(3, 3).route.edges == ()


def test_an_edge_from_start_to_goal_has_both_ends() -> None:
    """ROS differs: Nav2 scores such an edge at the start only."""
    here, there = Pose2D(0.0, 0.0, 0.0), Pose2D(2.0, 0.0, math.pi)
    costs = [
        RoutePlanner(lane(1), RouteParams(nav2_compatible=nav2), [DistanceScorer(), GoalOrientationScorer()])
        .plan(here, there)
        .whole.cost
        for nav2 in (False, True)
    ]
    assert costs == pytest.approx([2.0 + math.pi, 2.0])


def costmap_with(cost: int, *, row: int = 5) -> Costmap:
    costmap = Costmap(GridGeometry(40, 12, 0.25, -1.0, -1.5))
    costmap.data[row, 13:16] = cost
    return costmap


@pytest.mark.parametrize("use_maximum", [True, False])
def test_unknown_cells_have_no_cost_but_close_an_edge(use_maximum: bool) -> None:
    """ROS differs: Nav2's mean counts them as 255."""
    graph, costmap = lane(4), costmap_with(255, row=6)  # y = 0 is row 6
    open_, closed = (
        CostmapScorer(CostmapParams(use_maximum=use_maximum, check_resolution=1, invalid_on_collision=close)).scores(
            graph, costmap
        )
        for close in (False, True)
    )
    assert not open_.any()
    assert np.isinf(closed).sum() == 2  # one edge, both ways
    nav2 = CostmapParams(use_maximum=use_maximum, check_resolution=1, invalid_on_collision=False, nav2_compatible=True)
    assert CostmapScorer(nav2).scores(graph, costmap).any() != use_maximum


def test_a_wall_between_pose_and_nearest_node() -> None:
    """The nearest node is behind the wall; the one that free cells lead to is taken, also with a candidate off the costmap."""
    graph = build_graph({0: (1.0, 1.2), 1: (1.0, -2.0), 2: (50.0, 1.0), 3: (4.0, -2.0)}, [(0, 1), (1, 3), (2, 0)])
    costmap = Costmap(GridGeometry(60, 60, 0.1, -1.0, -3.0))
    costmap.data[35, :] = 254  # y = 0.5
    pose = Pose2D(1.0, 0.2, 0.0)
    assert RoutePlanner(graph).node_at(pose, is_start=True) == 0
    planner = RoutePlanner(graph, costmap=costmap)
    assert planner.node_at(pose, is_start=True) == 1
    assert RoutePlanner(graph, RouteParams(enable_nn_search=False), costmap=costmap).node_at(pose, is_start=True) == 0
    assert (
        RoutePlanner(graph, RouteParams(max_nn_search_iterations=3), costmap=costmap).node_at(pose, is_start=True) == 0
    )
    planner.costmap = None
    assert planner.node_at(pose, is_start=True) == 0
    with pytest.raises(IndeterminateNodesError):
        planner.node_at(Pose2D(math.nan, 0.0, 0.0), is_start=True)


def test_pruning_and_resuming() -> None:
    planner = RoutePlanner(lane(4))
    found = planner.plan(Pose2D(0.6, 0.3, 0.0), Pose2D(6.9, -0.2, 0.0))
    assert found.whole.node_ids == (0, 1, 2, 3)
    assert found.route.node_ids == (1, 2, 3)
    assert planner.plan(Pose2D(0.05, 0.0, 0.0), Pose2D(7.4, 0.0, 0.0)).route.node_ids == (
        0,
        1,
        2,
        3,
    )  # at a node; goal before its node
    again = planner.plan(0, Pose2D(8.0, 0.0, 0.0), resume=(1, Pose2D(3.0, 0.4, 0.0), found.route.edges[0]))
    assert again.begun == found.route.edges[0]
    assert again.route.node_ids[0] == 2
    assert again.path[0] == pytest.approx((3.0, 0.0, 0.0), abs=1e-6)
    assert again.path.length == pytest.approx(5.0)


def test_the_path_has_arcs_for_corners() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (4.0, 0.0), 2: (4.0, 4.0), 3: (4.5, 4.0)}, [(0, 1), (1, 2), (2, 3)])
    sharp = RoutePlanner(graph).plan(0, 3).path
    round_ = RoutePlanner(graph, RouteParams(smooth_corners=True, smoothing_radius=0.8)).plan(0, 3).path
    assert sharp.length == pytest.approx(8.5)
    assert round_.length == pytest.approx(
        8.5 - 1.6 + 0.8 * math.pi / 2.0, abs=1e-3
    )  # the edge of 0.5 m is too short for an arc
    middle = np.hypot(*(round_.poses[:, :2] - (3.2, 0.8)).T)
    assert middle.min() == pytest.approx(0.8, abs=1e-6)
    assert np.hypot(*np.diff(round_.poses[:, :2], axis=0).T).max() <= 0.05 + 1e-6


def test_limits_and_nodes_that_are_not_there() -> None:
    graph = random_graph(1)
    with pytest.raises(RouteTimeoutError, match=r"max_iterations \(2\); raise it"):
        RoutePlanner(graph, RouteParams(max_iterations=2)).find(0, 7)
    with pytest.raises(InvalidGraphError, match=r"the graph has no node 99; its 60 nodes are 0, 1, 2, 3, 4, \.\."):
        RoutePlanner(graph).find(0, 99)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"edge_cost_functions": ["D"]}, "D.plugin is missing; known: DistanceScorer"),
        (
            {"edge_cost_functions": ["D"], "D.plugin": "nav2_route::Distance"},
            "D.plugin is 'nav2_route::Distance', which is unknown",
        ),
        ({"edge_cost_functions": "D"}, "edge_cost_functions is 'D'; write a list"),
        ({"DistanceScorer.weight_": 2.0}, "DistanceScorer has no parameter weight_; did you mean weight?"),
        ({"DistanceScorer": {"weight": "a"}}, "DistanceScorer: weight is 'a'"),
        ({"prune_gaol": True}, "the route server has no parameter prune_gaol; did you mean prune_goal?"),
        (
            {"edge_cost_functions": ["S"], "S": {"plugin": "SemanticScorer", "semantic_classes": ["a"]}},
            "the semantic class a has no cost",
        ),
        (
            {"edge_cost_functions": ["S"], "S": {"plugin": "SemanticScorer", "b": 1.0}},
            "b is neither a parameter nor one of",
        ),
    ],
)
def test_parameters_that_are_wrong(parameters: dict[str, Any], message: str) -> None:
    with pytest.raises((ParameterError, InputError)) as error:
        read_scorers(parameters)
    assert message in error.value.message


def test_values_of_edges_that_are_wrong() -> None:
    graph = lane(1)
    for value, message in (
        ("fast", "speed_limit of edge 2 is 'fast'; write a number"),
        (0, "speed_limit of edge 2 is 0; write a limit"),
    ):
        graph.edge_metadata[0] = {"speed_limit": value}
        with pytest.raises(InvalidGraphError, match=message):
            RoutePlanner(graph).find(0, 1)
    graph.edge_metadata[0] = {"penalty": -5}
    params, scorers = read_scorers(
        {"edge_cost_functions": ["D", "P"], "D.plugin": "DistanceScorer", "P.plugin": "PenaltyScorer"}
    )
    with pytest.raises(InvalidGraphError, match="the scores of edge 2 add up to -3"):
        RoutePlanner(graph, params, scorers).find(0, 1)

"""Routes compared with nav2_route's, query by query: nodes, edges, costs, pruned routes, paths.

Two builds of Nav2 choose the same routes and costs; smoothed paths differ by 5e-5 m, because their points are sums of float32.
"""

from __future__ import annotations

import gzip
from functools import cache
from typing import Any

import numpy as np
import pytest

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.routes import (
    InvalidGraphError,
    NoValidRouteError,
    RouteError,
    RouteGraph,
    RoutePlanner,
    parse_graph,
    read_scorers,
)
from navstack.routes.errors import EdgeScorerUseError, RouteTimeoutError
from navstack.routes.scorers import CostmapScorer
from tests.conftest import golden_nav2_files
from tests.golden.nav2_w3 import FOLDER, arrays, jobs, needs_data, split

MAPS = golden_nav2_files("smac_maps.npz")
pytestmark = [
    needs_data,
    pytest.mark.skipif(not MAPS, reason="the golden data of Nav2 are absent (NAVSTACK_GOLDEN_NAV2)"),
]
JOBS = jobs("route")
PATH_M = 2e-4
"""Nav2 adds float32 steps: up to 100 of them per edge, each rounded by 1e-6 m at 20 m."""
YAW = 0.02
"""Heading of a step of 0.05 m between two such points: 1e-4 m aside, and more for the shorter steps of arcs."""
OK, NO_ROUTE, INVALID, NEEDS_POSES, ITERATIONS, UNKNOWN_ID = 1, -1, -2, -3, -4, -5


@cache
def graph_of(name: str) -> RouteGraph:
    return parse_graph(gzip.decompress((FOLDER / "graphs" / f"{name}.geojson.gz").read_bytes()).decode(), name)


@cache
def depot() -> Costmap:
    maps = np.load(MAPS[0])
    data, info = maps["depot/costmap_round"], maps["depot/info"].tolist()
    return Costmap(GridGeometry(data.shape[1], data.shape[0], info[2], info[0], info[1]), np.ascontiguousarray(data))


def planner_of(name: str, job: dict[str, Any], *, compatible: bool = True) -> RoutePlanner:
    params, scorers = read_scorers({**job["params"], "nav2_compatible": compatible})
    for scorer in scorers:
        if compatible and isinstance(scorer, CostmapScorer):
            scorer.params = scorer.params.model_copy(update={"nav2_compatible": True})
    costmap = depot() if job["graph_name"].startswith("random") else None
    planner = RoutePlanner(graph_of(job["graph_name"]), params, scorers, costmap=costmap)
    if job.get("closed_edges") or job.get("adjust_edges"):
        costs = {int(edge): float(cost) for edge, cost in job.get("adjust_edges", [])}
        planner.dynamic_edges.adjust(closed=job.get("closed_edges", []), costs=costs)
    return planner


def status_of(error: RouteError) -> int:
    if isinstance(error, InvalidGraphError):
        return UNKNOWN_ID if "node" in error.data else INVALID
    kinds: dict[type[RouteError], int] = {
        NoValidRouteError: NO_ROUTE,
        EdgeScorerUseError: NEEDS_POSES,
        RouteTimeoutError: ITERATIONS,
    }
    return kinds[type(error)]


def ends_of(query: list[float]) -> tuple[Pose2D | int, Pose2D | int]:
    if query[0]:
        return Pose2D(*query[1:4]), Pose2D(*query[4:])
    return int(query[1]), int(query[4])


@pytest.mark.parametrize("name", sorted(JOBS))
def test_routes(name: str) -> None:
    job = JOBS[name]
    case = {key.removeprefix(f"{name}/"): value for key, value in arrays("route").items() if key.startswith(f"{name}/")}
    planner, blocked = planner_of(name, job), job.get("blocked", [])
    graph = planner.graph
    edges, costs = split(case["edges"], case["edge_counts"]), split(case["edge_costs"], case["edge_counts"])
    pruned, paths = split(case["pruned_edges"], case["pruned_counts"]), split(case["path"], case["path_counts"])
    k = case["nearest"].shape[1] // 2
    index_in_file = {node: i for i, node in enumerate(graph.node_ids.tolist())}
    for i, query in enumerate(case["queries"].tolist()):
        start, goal = ends_of(query)
        if isinstance(start, Pose2D) and isinstance(goal, Pose2D):
            for pose, theirs in ((start, case["nearest"][i, :k]), (goal, case["nearest"][i, k:])):
                ours = planner.nearest_nodes(pose)
                # nodes at the same distance come in any order
                np.testing.assert_allclose(
                    *(np.hypot(*(graph.xy[n] - pose[:2]).T) for n in (ours, theirs.astype(int))), rtol=1e-9
                )
        try:
            found = planner.plan(start, goal, blocked=blocked)
        except RouteError as error:
            assert case["status"][i] == status_of(error), f"query {i}: {error}"
            continue
        assert case["status"][i] == OK, f"query {i}"
        whole = found.whole
        if not isinstance(start, int):
            assert [index_in_file[whole.node_ids[0]], index_in_file[whole.node_ids[-1]]] == case["ends"][i].tolist(), (
                f"query {i}"
            )
        assert list(whole.edge_ids) == edges[i].tolist(), f"query {i}"
        assert np.array_equal(np.array(whole.edge_costs, np.float32), costs[i]), f"query {i}"
        assert np.float32(whole.cost) == case["cost"][i]
        assert list(found.route.edge_ids) == pruned[i].tolist(), f"query {i}"
        assert found.route.node_ids[0] == case["pruned_start"][i]
        assert found.route.cost == pytest.approx(float(case["pruned_cost"][i]), rel=1e-6, abs=1e-5)
        poses = found.path.poses
        assert len(poses) == len(paths[i]), f"query {i}"
        np.testing.assert_allclose(poses[:, :2], paths[i][:, :2], rtol=0.0, atol=PATH_M)
        turned = np.remainder(poses[:, 2] - paths[i][:, 2] + np.pi, 2.0 * np.pi) - np.pi
        assert np.abs(turned).max() <= YAW, f"query {i}"

"""Findings of a graph: connections, costs, room."""

from __future__ import annotations

import numpy as np
import pytest

from navstack.core import Footprint, OccupancyGrid
from navstack.routes import RouteGraph, build_graph, check_graph

NODES = {i: (float(i), 0.0) for i in range(6)}


def rules(graph: RouteGraph, *args: object, **options: object) -> dict[str, tuple[tuple[int, ...], tuple[int, ...]]]:
    return {f.rule: (f.nodes, f.edges) for f in check_graph(graph, *args, **options)}  # type: ignore[arg-type]


def test_a_good_graph_has_no_findings() -> None:
    assert check_graph(build_graph(NODES, [(i, i + 1) for i in range(5)], both_ways=True)) == []


def test_connections() -> None:
    """0 <-> 1 <-> 2, 3 only leads in, 4 is a trap, 5 has no edge; 6 <-> 7 are apart."""
    nodes = {**NODES, 6: (0.0, 5.0), 7: (1.0, 5.0)}
    edges = [(0, 1), (1, 0), (1, 2), (2, 1), (3, 2), (2, 4), (6, 7), (7, 6)]
    found = rules(build_graph(nodes, edges))
    assert found == {
        "no-edges": ((5,), ()),
        "unreachable": ((3,), ()),
        "one-way-trap": ((4,), ()),
        "separate": ((6, 7), ()),
    }
    texts = [f.message for f in check_graph(build_graph(nodes, edges))]
    assert "node 3 at (3.00, 0.00) cannot be reached from the others; add edges that lead there" in texts
    assert "node 5 at (5.00, 0.00) has no edges; connect or remove them" in texts


def test_edges_without_a_cost_and_loops() -> None:
    graph = build_graph(NODES, [(0, 1), (1, 0), (0, 0)])
    graph.overridable[:2] = False
    found = rules(graph)
    assert found["loop"] == ((), (8,))
    assert found["no-cost"][1] == tuple(graph.edge_ids[:2].tolist())


def corridor(gap: int) -> OccupancyGrid:
    """A wall along x = 3 m with a gap of `gap` cells (0.1 m) around y = 0; unknown beyond x = 5.5 m."""
    cells = np.zeros((40, 70), np.int8)
    cells[:, 35] = 100
    cells[20 - gap // 2 : 20 + gap // 2, 35] = 0
    cells[:, 60:] = -1
    return OccupancyGrid.from_array(cells, 0.1, origin=(-0.5, -2.0), values="occupancy")


@pytest.mark.parametrize(("gap", "rule"), [(0, "wall"), (4, "too-narrow"), (6, "no-room-to-turn"), (16, None)])
def test_room(gap: int, rule: str | None) -> None:
    """A footprint of 0.8 x 0.5 m: inscribed radius 0.25 m, circumscribed 0.47 m."""
    box = Footprint(np.array([[0.4, 0.25], [-0.4, 0.25], [-0.4, -0.25], [0.4, -0.25]]))
    graph = build_graph(
        {0: (1.0, 0.0), 1: (2.4, 0.0), 2: (3.6, 0.0), 3: (4.5, 0.0)}, [(0, 1), (1, 2), (2, 3)], both_ways=True
    )
    edge = set(graph.edge_ids[[1, 2, 3, 4]].tolist())
    found = rules(graph, corridor(gap), box)
    assert set(found) == ({rule} if rule else set())
    if rule:
        across = {
            int(graph.edge_ids[k])
            for k in range(graph.edge_count)
            if {int(graph.starts[k]), int(graph.ends[k])} == {1, 2}
        }
        assert set(found[rule][1]) == across <= edge


def test_an_edge_at_whose_end_the_nose_touches_the_wall() -> None:
    """The node is 0.35 m before the wall, the footprint reaches 0.4 m ahead of it."""
    box = Footprint(np.array([[0.4, 0.25], [-0.4, 0.25], [-0.4, -0.25], [0.4, -0.25]]))
    graph = build_graph({0: (1.0, 0.0), 1: (2.65, 0.0)}, [(0, 1)], both_ways=True)
    assert set(rules(graph, corridor(0), box)) == {"too-narrow"}


def test_unknown_space_and_the_edge_of_the_map() -> None:
    graph = build_graph({0: (5.0, 0.0), 1: (5.9, 0.0), 2: (9.0, 0.0)}, [(0, 1), (1, 2)], both_ways=True)
    found = rules(graph, corridor(16), Footprint.from_radius(0.2))
    assert set(found) == {"unknown", "off-the-map"}
    assert set(rules(graph, corridor(16), Footprint.from_radius(0.2), allow_unknown=True)) == {"off-the-map"}

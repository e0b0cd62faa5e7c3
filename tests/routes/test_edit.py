"""Editing a graph: every step keeps it valid, can be undone, and what is saved loads again equal."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from navstack.core import InputError, NavError
from navstack.routes import GraphDraft, InvalidGraphError, Operation, build_graph, graph_text, load_graph, save_graph
from navstack.routes.edit import UNDO_STEPS


def square() -> GraphDraft:
    nodes = {0: (0.0, 0.0), 1: (1.0, 0.0), 2: (1.0, 1.0), 3: (0.0, 1.0)}
    graph = build_graph(nodes, [(0, 1), (1, 2), (2, 3), (3, 0)], both_ways=True, name="square")
    graph.edge_metadata[0] = {"clearance": 0.5, "speed_limit": 0.4}
    graph.node_operations[1] = (Operation("open", "OpenDoor", "NODE"),)
    return GraphDraft(graph)


def test_a_graph_is_drawn_from_nothing() -> None:
    draft = GraphDraft()
    with pytest.raises(InvalidGraphError, match="no nodes yet; add some"):
        draft.graph()
    a, b = draft.add_node(1.0, 2.0), draft.add_node(3.0, 2.0)
    with pytest.raises(InvalidGraphError, match="no edges yet; connect two nodes"):
        draft.graph()
    assert draft.connect(a, b, both_ways=True) == [2, 3]
    graph = draft.graph()
    assert graph.xy.tolist() == [[1.0, 2.0], [3.0, 2.0]] and graph.edge_ids.tolist() == [2, 3]
    assert (graph.starts.tolist(), graph.ends.tolist()) == ([0, 1], [1, 0])


def test_a_draft_is_the_graph_it_was_made_of() -> None:
    draft = square()
    assert graph_text(GraphDraft(draft.graph()).graph()) == graph_text(draft.graph())
    assert draft.graph().node_operations[1][0].name == "open"


def test_moving_a_node_drops_the_clearance_that_is_no_longer_true() -> None:
    draft = square()
    draft.move_node(0, -0.1, 0.2)
    edge = draft.edges[draft.graph().edge_ids.tolist()[0]]
    assert edge.metadata == {"speed_limit": 0.4}
    assert draft.nodes[0].x == pytest.approx(-0.1)


def test_a_missing_direction_is_added_and_none_twice() -> None:
    draft = GraphDraft(build_graph({0: (0.0, 0.0), 1: (1.0, 0.0)}, [(0, 1)]))
    (back,) = draft.connect(0, 1, both_ways=True)
    assert (draft.edges[back].start, draft.edges[back].end) == (1, 0)
    with pytest.raises(InputError, match="edge 2 connects node 0 to 1 both ways already"):
        draft.connect(0, 1, both_ways=True)


def test_deleting_a_node_deletes_its_edges() -> None:
    draft = square()
    draft.delete(nodes=[0])
    assert list(draft.nodes) == [1, 2, 3]
    assert all(0 not in (edge.start, edge.end) for edge in draft.edges.values()) and len(draft.edges) == 4


def test_attributes_are_set_and_removed() -> None:
    draft = square()
    (edge, *_) = draft.edges
    draft.set_attributes([edge], {"penalty": 2.0, "class": "narrow", "cost": 3.5, "overridable": False})
    graph = draft.graph()
    k = graph.edge(edge)
    assert graph.edge_metadata[k] == {"clearance": 0.5, "speed_limit": 0.4, "penalty": 2.0, "class": "narrow"}
    assert graph.costs[k] == 3.5 and not graph.overridable[k]
    draft.set_attributes(
        [edge], {"penalty": None, "class": None, "cost": None, "overridable": None, "speed_limit": None}
    )
    assert draft.edges[edge].metadata == {"clearance": 0.5}
    assert draft.edges[edge].cost == 0.0 and draft.edges[edge].overridable


WRONG: list[tuple[Callable[[GraphDraft], Any], str]] = [
    (lambda d: d.add_node(math.nan, 0.0), r"\(nan, 0\) is no position; give finite numbers"),
    (lambda d: d.move_node(0, 1e9, 0.0), "is no position"),
    (lambda d: d.move_node(77, 0.0, 0.0), "the graph has no node 77; it may have been deleted"),
    (lambda d: d.connect(0, 0), "an edge cannot lead from node 0 to itself"),
    (lambda d: d.connect(0, 99), "no node 99"),
    (lambda d: d.delete(), "nothing is selected to delete"),
    (lambda d: d.delete(nodes=[0], edges=[55]), "no edge 55"),
    (lambda d: d.set_attributes([4], {"speed_limit": 0}), "speed_limit is 0; give a share of the full speed"),
    (lambda d: d.set_attributes([4], {"speed_limit": math.nan}), "speed_limit is nan"),
    (lambda d: d.set_attributes([4], {"penalty": True}), "penalty is True; give a number from 0"),
    (lambda d: d.set_attributes([4], {"class": ""}), "class is ''; give a text"),
    (lambda d: d.set_attributes([4], {"overridable": "no"}), "overridable is 'no'; give true or false"),
    (
        lambda d: d.set_attributes([4], {"color": "red"}),
        '"color" is not an attribute of an edge; known: speed_limit',
    ),
    (lambda d: d.set_attributes([], {"cost": 1.0}), "no edge is selected"),
    (lambda d: GraphDraft().undo(), "there is no change to undo"),
]


@pytest.mark.parametrize(("edit", "message"), WRONG)
def test_a_wrong_edit_changes_nothing(edit: Callable[[GraphDraft], Any], message: str) -> None:
    draft = square()
    before = graph_text(draft.graph())
    with pytest.raises(NavError, match=message):
        edit(draft)
    assert graph_text(draft.graph()) == before and draft.version == 0 and not draft.can_undo


def test_an_edge_id_that_is_there_twice_is_refused() -> None:
    graph = build_graph({0: (0.0, 0.0), 1: (1.0, 0.0)}, [(0, 1)], both_ways=True)
    graph.edge_ids[:] = 5
    with pytest.raises(InvalidGraphError, match="edge id 5 is there twice"):
        GraphDraft(graph)


@pytest.mark.parametrize("seed", range(5))
def test_any_sequence_of_edits_gives_a_graph_that_loads_again_equal(seed: int, tmp_path: Path) -> None:
    rng = random.Random(seed)
    draft = GraphDraft()
    history: list[tuple[dict[int, Any], dict[int, Any]]] = []
    numbers = [-1e5, 1e9, math.nan, math.inf, 0.1, 3.3, -0.0, 7.7e-30]
    refused = saved = undone = 0
    ids: list[int] = []

    def number() -> float:
        return rng.choice([*numbers, rng.uniform(-20.0, 20.0), rng.uniform(-20.0, 20.0)])

    def some() -> list[int]:
        return rng.choices(ids, k=rng.randrange(3))

    for _ in range(400):
        before = (dict(draft.nodes), dict(draft.edges))
        ids = [*draft.nodes, *draft.edges, 12345]
        values = {
            "speed_limit": rng.choice([None, 0.5, 80, -1, "x", math.nan]),
            "penalty": rng.choice([None, 0, 2.5, math.inf]),
            "class": rng.choice([None, "lift", "", 5, "é\n"]),
            "cost": rng.choice([None, 0.1, 3, -2.0]),
            "overridable": rng.choice([True, False, None, 1]),
        }
        chosen = {name: values[name] for name in rng.sample(list(values), rng.randrange(1, 3))}
        edits: list[Callable[[], Any]] = [
            lambda: draft.add_node(number(), number()),
            lambda: draft.add_node(number(), number()),
            lambda: draft.move_node(rng.choice(ids), number(), number()),  # noqa: B023
            lambda: draft.connect(rng.choice(ids), rng.choice(ids), both_ways=rng.random() < 0.5),  # noqa: B023
            lambda: draft.connect(rng.choice(ids), rng.choice(ids), both_ways=rng.random() < 0.5),  # noqa: B023
            lambda: draft.set_attributes(some(), chosen),  # noqa: B023
        ]
        if rng.random() < 0.1:
            edits = [lambda: draft.delete(some(), some())]
        try:
            rng.choice(edits)()
        except NavError as error:
            refused += 1
            assert error.message and (draft.nodes, draft.edges) == before
        else:
            history.append(before)
        if history and rng.random() < 0.05:
            draft.undo()
            assert (draft.nodes, draft.edges) == history.pop()
            undone += 1
        if draft.nodes and draft.edges:
            assert all(edge.start in draft.nodes and edge.end in draft.nodes for edge in draft.edges.values())
            if rng.random() < 0.1:
                graph = draft.graph()
                save_graph(graph, tmp_path / "graph.geojson")
                loaded = load_graph(tmp_path / "graph.geojson")
                assert graph_text(loaded) == graph_text(graph)
                assert GraphDraft(loaded).nodes == draft.nodes and GraphDraft(loaded).edges == draft.edges
                saved += 1
    assert refused > 50 and saved > 5 and undone > 5
    for _ in range(min(len(history), UNDO_STEPS)):
        draft.undo()
        assert (draft.nodes, draft.edges) == history.pop()

"""GeoJSON graphs: what is read, written, and refused with its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.core import OutputError
from navstack.routes import InvalidGraphError, Operation, build_graph, load_graph, parse_graph, save_graph
from navstack.routes.geojson import graph_text


def node(number: Any = 0, x: Any = 0.0, y: Any = 0.0, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": number, **properties},
        "geometry": {"type": "Point", "coordinates": [x, y]},
    }


def edge(number: Any = 9, start: Any = 0, end: Any = 1, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": number, "startid": start, "endid": end, **properties},
        "geometry": {"type": "LineString", "coordinates": [[0.0, 0.0], [1.0, 0.0]]},
    }


def text_of(*features: Any) -> str:
    return (
        '{"type": "FeatureCollection", "name": "test",\n "features": [\n'
        + ",\n".join(map(json.dumps, features))
        + "\n]}"
    )


GOOD = (node(0), node(1, 1.0), edge())


def test_read_and_write() -> None:
    stop = {"stop": {"type": "TriggerEvent", "trigger": "NODE", "metadata": {"wait_for": 5.0}}}
    lights = {"region": {"x": [1.0, 2], "ok": True, "class": "hall"}}
    graph = parse_graph(
        text_of(node(4, 1.25, -2.0, metadata=lights, operations=stop), node(2), edge(7, 2, 4, cost=3.5), edge(8, 4, 2))
    )
    assert graph.name == "test"
    assert graph.node_ids.tolist() == [4, 2]
    assert graph.xy.tolist() == [[1.25, -2.0], [0.0, 0.0]]
    assert graph.edge_ids.tolist() == [8, 7]  # by start node
    assert graph.costs.tolist() == [0.0, 3.5]
    assert graph.node_metadata == {0: lights}
    assert graph.node_operations == {0: (Operation("stop", "TriggerEvent", "NODE", {"wait_for": 5.0}),)}
    again = parse_graph(graph_text(graph))
    assert graph_text(again) == graph_text(graph)
    assert np.array_equal(again.xy, graph.xy)
    assert again.node_operations == graph.node_operations


def test_a_file_is_written_whole_or_not(tmp_path: Path) -> None:
    graph = build_graph({0: (0.1, 0.2), 5: (3.0, 0.0)}, [(0, 5)], both_ways=True)
    save_graph(graph, tmp_path / "a.geojson")
    assert load_graph(tmp_path / "a.geojson").edge_ids.tolist() == [6, 7]
    with pytest.raises(OutputError):
        save_graph(graph, tmp_path / "none" / "a.geojson")
    with pytest.raises(InvalidGraphError, match="cannot be read"):
        load_graph(tmp_path / "none.geojson")


WRONG = [
    ([node("a"), *GOOD[1:]], "properties.id", "id is 'a'; write a whole number"),
    ([node(-1), *GOOD[1:]], "properties.id", "id is -1; write a whole number"),
    ([node(2**32), *GOOD[1:]], "properties.id", "id is 4294967296"),
    ([node(True), *GOOD[1:]], "properties.id", "id is True"),
    ([*GOOD, node(1)], "properties.id", "the id 1 is that of another node"),
    ([node(0, "x"), *GOOD[1:]], "geometry.coordinates", "coordinates is 'x'; write a finite number"),
    ([node(0, float("nan")), *GOOD[1:]], "geometry.coordinates", "coordinates is nan; write a finite number"),
    ([node(0, 1e39), *GOOD[1:]], "geometry.coordinates", "coordinates is 1e+39"),
    ([*GOOD[:2], edge(9, 0, 3)], "properties.endid", "endid of edge 9 is 3, but there is no node 3"),
    ([*GOOD[:2], edge(9, None)], "properties.startid", "startid is None"),
    ([*GOOD[:2], edge(cost="a")], "properties.cost", "cost is 'a'; write a finite number"),
    ([*GOOD[:2], edge(cost=-1.0)], "properties.cost", "cost is -1; write a cost of 0 or more"),
    ([*GOOD[:2], edge(overridable=1)], "properties.overridable", "overridable is 1; write true or false"),
    ([*GOOD[:2], edge(metadata=[1])], "properties.metadata", "metadata is [1]; write an object"),
    ([*GOOD[:2], edge(metadata={"speed": None})], "properties.metadata.speed", "speed is None"),
    (
        [*GOOD[:2], edge(operations={"a": {"trigger": "NODE"}})],
        "properties.operations.a",
        "the operation a has no type",
    ),
    (
        [*GOOD[:2], edge(operations={"a": {"type": "B", "trigger": "X"}})],
        "properties.operations.a.trigger",
        "write NODE, ON_ENTER or",
    ),
    ([node(0, frame="odom"), *GOOD[1:]], "properties.frame", 'that of the nodes before is "odom"'),
    ([{"type": "Feature", "properties": {"id": 3}}, *GOOD], "geometry", "it has no geometry"),
    ([7, *GOOD], "geometry", "it is not an object"),
    ([{**node(), "properties": None}, *GOOD], "properties", "properties is None"),
]


@pytest.mark.parametrize(("features", "key", "message"), WRONG, ids=[m for _, _, m in WRONG])
def test_a_mistake_is_named_with_its_place(features: list[Any], key: str, message: str) -> None:
    text = text_of(*features)
    with pytest.raises(InvalidGraphError) as error:
        parse_graph(text, "floor.geojson")
    assert message in error.value.message
    data = error.value.data
    assert data["key"] == key
    assert error.value.message.startswith(f"floor.geojson:{data['line']}:{data['column']}: feature {data['feature']}: ")
    # features are on a line each, from line 3
    assert data["line"] == 3 + data["feature"]
    place = text.splitlines()[data["line"] - 1][data["column"] - 1 :]
    last = key.rsplit(".", 1)[-1]
    assert place.startswith((f'"{last}"', '"properties"', "{", "7"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "1:1: the file is not a JSON object"),
        ("[]", "1:1: the file is not a JSON object"),
        ("{}", 'the file has no features; add "features"'),
        ('{"features": {}}', "1:14: features is not a list"),
        ('{"features": [', "1:15: this is not JSON: Expecting value"),
        ('{"features": [' + json.dumps(node()) + " 2]}", "a comma or ] is missing after feature 0"),
        ('{"features": []} x', "1:18: the file has more text"),
        ('{"features": [], "features": []}', "features twice"),
        ('{"features": []}', "the graph has no nodes"),
        (text_of(node()), "the graph has no edges"),
        ('{"a" 1}', '1:6: a colon is missing after "a"'),
        ("{1: 2}", "1 is not the name of a member"),
        ("{" + '"a": ' + "[" * 100_000, "nested"),
        ('{"features": [{"x": ' + "9" * 5000 + "}]}", "too many digits"),
    ],
)
def test_a_file_that_is_no_graph(text: str, message: str) -> None:
    with pytest.raises(InvalidGraphError) as error:
        parse_graph(text)
    assert message in error.value.message


def test_notes() -> None:
    polygon = {"type": "Feature", "properties": {}, "geometry": {"type": "Polygon", "coordinates": []}}
    graph = parse_graph(text_of(node(70_000), node(1, 4e6), edge(9, 70_000, 1), edge(9, 1, 70_000), polygon))
    text = " ".join(graph.notes)
    for part in (
        "uint16",
        "1 feature of type Polygon ignored",
        "edge id is there twice (first: 9, feature 3)",
        "rounded to 0.25 m",
    ):
        assert part in text
    assert graph.edges_of([9]).tolist() == [0, 1]
    assert not parse_graph(text_of(*GOOD)).notes


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_value_anywhere_is_read_or_named(data: st.DataObject) -> None:
    """A member of a good file gets any JSON value: a graph, or one sentence with the place; never another exception."""
    document = json.loads(text_of(*GOOD))
    place: Any = document
    while True:
        keys: list[Any] = list(place) if isinstance(place, dict) else list(range(len(place)))
        key = data.draw(st.sampled_from(keys))
        if not isinstance(place[key], (dict, list)) or not place[key] or data.draw(st.booleans()):
            break
        place = place[key]
    place[key] = data.draw(JSON)
    try:
        graph = parse_graph(json.dumps(document), "g")
    except InvalidGraphError as error:
        assert error.message.startswith("g:")
        assert "\n" not in error.message
    else:
        assert np.isfinite(graph.xy).all()


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 400))
def test_a_file_that_is_cut_off(cut: int) -> None:
    text = text_of(*GOOD)
    if cut < len(text):
        with pytest.raises(InvalidGraphError):
            parse_graph(text[:cut])


@pytest.mark.slow
def test_a_million_features_are_read_in_seconds() -> None:
    count = 300_000
    point = '{"type":"Feature","properties":{"id":%d},"geometry":{"type":"Point","coordinates":[%d,%d]}}'
    ends = '"geometry":{"type":"LineString","coordinates":[[0,0],[1,1]]}}'
    line = '{"type":"Feature","properties":{"id":%d,"startid":%d,"endid":%d},' + ends
    nodes = [point % (i, i % 1000, i // 1000) for i in range(count)]
    edges = [line % (i, i % count, (i * 7 + 1) % count) for i in range(1_000_000 - count)]
    graph = parse_graph('{"features":[' + ",".join([*nodes, *edges]) + "]}")
    assert len(graph) == count
    assert graph.edge_count == 1_000_000 - count
    assert graph.first[-1] == graph.edge_count

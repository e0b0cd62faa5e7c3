"""`navstack route`: what it prints, writes, and its exit codes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.routes import build_graph, load_graph, save_graph


@pytest.fixture
def graph_file(tmp_path: Path) -> Path:
    """Nodes along the corridor of the packaged office, and one edge through its wall."""
    nodes = {0: (1.5, 7.4), 1: (5.0, 7.4), 2: (9.6, 7.4), 3: (9.6, 11.0), 4: (5.0, 11.0)}
    save_graph(build_graph(nodes, [(0, 1), (1, 2), (2, 3), (1, 4)], both_ways=True), tmp_path / "lane.geojson")
    return tmp_path / "lane.geojson"


@pytest.mark.slow
def test_check_names_the_edges_through_walls(
    graph_file: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert run(["route", "check", str(graph_file), "--map", "office", "--out", str(tmp_path / "a.png")]) == 1
    out = capsys.readouterr().out
    assert (
        "error wall: 2 edges (11, 12) (from node 1 to 4, ..) run through an obstacle of the map; move their nodes"
        in out
    )
    assert "lane.geojson: 5 nodes, 8 edges: 1 error, 0 warnings" in out
    assert (tmp_path / "a.png").stat().st_size > 10_000
    assert run(["route", "check", str(graph_file), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"nodes": 5, "edges": 8, "findings": []}


@pytest.mark.slow
def test_plan(graph_file: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert (
        run(["route", "plan", str(graph_file), "--start", "1.2,7.0", "--goal", "3", "--out", str(tmp_path), "--json"])
        == 0
    )
    document = json.loads(capsys.readouterr().out)
    assert [node["nodeid"] for node in document["nodes"]] == [0, 1, 2, 3]
    assert document["route_cost"] == pytest.approx(11.7, abs=1e-3)
    assert {path.name for path in tmp_path.glob("route.*")} == {"route.png", "route.json"}
    assert run(["route", "plan", str(graph_file), "--start", "0", "--goal", "3", "--close", "7"]) == 1
    assert "no way from node 0 to node 3" in capsys.readouterr().err
    server = tmp_path / "nav2.yaml"
    server.write_text(
        "route_server:\n  ros__parameters:\n    edge_cost_functions: [T]\n"
        "    T: {plugin: 'nav2_route::TimeScorer', max_vel: 0.1}\n"
    )
    assert (
        run(["route", "plan", str(graph_file), "--start", "0", "--goal", "3", "--route-params", str(server), "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["route_cost"] == pytest.approx(117.0, abs=1e-2)


@pytest.mark.slow
def test_from_map_and_draw(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / "office.geojson"
    assert run(["route", "from-map", "office", "--out", str(file), "--clearance", "0.3"]) == 0
    assert "wanted: 0.300 m" in capsys.readouterr().out
    graph = load_graph(file)
    assert min(values["clearance"] for values in graph.edge_metadata.values()) >= 0.3
    assert run(["route", "draw", str(file), "--map", "office", "--out", str(tmp_path / "g.svg")]) == 0
    assert run(["route", "check", str(file), "--map", "office"]) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["plan", "none.geojson", "--start", "0", "--goal", "1"], "none.geojson cannot be read"),
        (["plan", "{graph}", "--start", "0", "--goal", "77"], "has no node 77"),
        (["plan", "{graph}", "--start", "0", "--goal", "1", "--close", "1"], "has no edge 1; its 8 edges"),
        (["plan", "{graph}", "--start", "a,b", "--goal", "1"], "--start"),
    ],
)
def test_wrong_input(graph_file: Path, arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["route", *(part.format(graph=graph_file) for part in arguments)]) == 2
    error = capsys.readouterr().err
    assert message in error.replace("\n", " ")
    assert "Traceback" not in error


@pytest.mark.parametrize("name", ["/robot1/route_server", "/**/route_server", "robot1:\n  route_server"])
def test_route_params_of_a_namespace(
    graph_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    server = tmp_path / "nav2.yaml"
    server.write_text(
        f"/**:\n  ros__parameters:\n    edge_cost_functions: [T]\n    T: {{plugin: 'nav2_route::TimeScorer', max_vel: 0.5}}\n"
        f"{name}:\n    ros__parameters:\n      T: {{plugin: 'nav2_route::TimeScorer', max_vel: 0.1}}\n"
    )
    command = ["route", "plan", str(graph_file), "--start", "0", "--goal", "3", "--route-params", str(server), "--json"]
    assert run(command) == 0
    assert json.loads(capsys.readouterr().out)["route_cost"] == pytest.approx(117.0, abs=1e-2)


def test_route_params_without_a_route_server(
    graph_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    server = tmp_path / "nav2.yaml"
    server.write_text("bt_navigator:\n  ros__parameters: {use_sim_time: true}\n")
    assert run(["route", "plan", str(graph_file), "--start", "0", "--goal", "3", "--route-params", str(server)]) == 2
    assert "has no section route_server (it has bt_navigator); add one" in " ".join(capsys.readouterr().err.split())

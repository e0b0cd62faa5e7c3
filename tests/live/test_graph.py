"""The route graph on the page: requests edit it, checks name places, saving keeps to its folder, the robot drives along it."""

from __future__ import annotations

import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError, NavError, OutputError
from navstack.live import messages
from navstack.live.graph import route_now
from navstack.live.session import Session
from navstack.live.stage import Options, Stage, world_frame
from navstack.routes import GraphDraft, build_graph, graph_text, load_graph, save_graph


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A lane in the corridor, one way, and a node in a wall."""
    graph = build_graph({0: (1.5, 7.45), 1: (3.0, 7.45), 2: (4.5, 7.45)}, [(0, 1), (1, 2)], name="lane")
    save_graph(graph, tmp_path / "lane.geojson")
    return tmp_path / "lane.geojson"


@pytest.fixture
def stage(session: Session, file: Path) -> Stage:
    return Stage([session], Options(graph=file))


def ask(stage: Stage, **request: Any) -> messages.Answer:
    """Sends a request as a page does."""
    return stage.request(messages.read_request(json.dumps(request)))


def test_a_page_draws_edits_checks_and_saves(stage: Stage, file: Path) -> None:
    data = ask(stage, type="graph").data
    assert data["nodes"][0] == [0, 1.5, 7.45] and data["edges"][0] == [3, 0, 1, {}] and not data["can_undo"]
    ask(stage, type="graph_add_node", x=6.0, y=7.45)
    ask(stage, type="graph_connect", start=2, end=5, both_ways=True)
    ask(stage, type="graph_move_node", node=5, x=5.5, y=7.45)
    ask(stage, type="graph_set", edges=[6, 7], values={"speed_limit": 0.5, "class": "wide"})
    data = ask(stage, type="graph_delete", edges=[7]).data
    assert data["edges"][-1] == [6, 2, 5, {"speed_limit": 0.5, "class": "wide"}]
    data = ask(stage, type="graph_undo").data
    assert [edge[0] for edge in data["edges"]] == [3, 4, 6, 7]
    answer = ask(stage, type="graph_save", name="mine")
    assert answer.text.endswith("navstack route check " + str(file.parent / "mine.geojson"))
    loaded = load_graph(file.parent / "mine.geojson")
    assert graph_text(loaded) == graph_text(stage.graph.draft.graph())
    assert len(load_graph(file)) == 3  # the given file is as it was


def test_findings_have_their_places(stage: Stage, session: Session) -> None:
    grid = session.scenario.map
    iy, ix = np.argwhere(grid.data == 100)[0]
    x = grid.geometry.origin_x + (ix + 0.5) * grid.geometry.resolution
    y = grid.geometry.origin_y + (iy + 0.5) * grid.geometry.resolution
    ask(stage, type="graph_add_node", x=x, y=y)
    ask(stage, type="graph_connect", start=2, end=5)
    answer = ask(stage, type="graph_check")
    found = {finding["rule"]: finding for finding in answer.data}
    wall = found["wall"]
    assert wall["edges"] and wall["severity"] == "error" and "errors" in answer.text
    assert wall["at"] == pytest.approx([0.5 * (4.5 + x), 0.5 * (7.45 + y)], abs=0.01)


def test_a_graph_from_the_map_can_be_undone(stage: Stage) -> None:
    answer = ask(stage, type="graph_from_map")
    assert len(answer.data["nodes"]) > 50 and "m from obstacles" in answer.text
    assert all(finding["severity"] != "error" for finding in ask(stage, type="graph_check").data)
    assert len(ask(stage, type="graph_undo").data["nodes"]) == 3


def test_saving_keeps_other_files(stage: Stage, session: Session, file: Path, tmp_path: Path) -> None:
    (file.parent / "other.geojson").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match=r"other\.geojson exists already; choose another name"):
        ask(stage, type="graph_save", name="other")
    ask(stage, type="graph_save", name="lane")  # the user's own file, by its own name
    ask(stage, type="graph_save", name="new")
    ask(stage, type="graph_save", name="new")
    for name in ("../out", "a/b", "", "."):
        with pytest.raises(InputError):
            ask(stage, type="graph_save", name=name)
    nowhere = Stage([session], Options())
    with pytest.raises(OutputError, match="start navstack live with --graph FILE or --save-to DIR"):
        ask(nowhere, type="graph_save", name="x")
    kept = Stage([session], Options(save_to=tmp_path / "saved"))
    with pytest.raises(NavError, match="the graph has no nodes yet; add some"):
        ask(kept, type="graph_save", name="x")
    assert not (tmp_path / "saved").exists()
    ask(kept, type="graph_from_map")
    ask(kept, type="graph_save", name="x.geojson")
    assert load_graph(tmp_path / "saved" / "x.geojson").edge_count


def test_a_recorded_run_shows_and_checks_only(session: Session, file: Path) -> None:
    stage = Stage([session], Options(graph=file, fixed=True))
    assert ask(stage, type="graph_check").ok
    with pytest.raises(InputError, match="recorded run"):
        ask(stage, type="graph_add_node", x=1.0, y=1.0)


def test_only_looking_is_allowed_to_viewers() -> None:
    kinds = set(messages.schema()["request"]["discriminator"]["mapping"])
    edits = {kind for kind in kinds if kind.startswith("graph_")} - {"graph_check"}
    assert len(edits) == 9 and not edits & messages.READ_ONLY


@pytest.mark.slow
def test_the_robot_drives_along_the_graph_and_the_run_is_saved(
    stage: Stage, session: Session, run_to: Callable[[Session, float], None], tmp_path: Path
) -> None:
    session.step_once()
    ask(stage, type="graph_drive", node=2)
    edges: list[int] = []
    while not session.is_done and session.time < 40.0:
        session.step_once()
        route = route_now(session)
        if route is not None and route["edge"] is not None and route["edge"] not in edges:
            edges.append(route["edge"])
    assert edges[-1] == 4
    assert [o.state for o in session.run.outcomes] == ["PREEMPTED", "SUCCEEDED"]
    assert session.run.robot.pose.distance_to(session.run.outcomes[-1].goal) < 0.4
    where = session.run.robot.pose
    assert session.save_scenario(tmp_path / "again.yaml").interactions == tuple(session.interactions)
    again = Session(session.current_scenario())
    run_to(again, session.time)
    assert again.run.robot.pose == where  # the same run, to the bit


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ({"dock": "home"}, 'no dock is called "home"'),
        ({"route": "/etc/passwd", "to": 1}, "the step route '/etc/passwd' has no graph"),
        ({"follow": "/etc/passwd"}, "has no trajectory"),
        ({"cover": "/etc/passwd"}, "/etc/passwd"),
        ({"goto": "nowhere"}, 'goto "nowhere" is not a place'),
        ({"fly": 1}, "is not one step; steps are .*cover: all"),
    ],
)
def test_a_wrong_step_is_refused_and_reads_no_file(
    step: dict[str, Any], message: str, stage: Stage, session: Session
) -> None:
    with pytest.raises(NavError, match=message):
        ask(stage, type="step_now", step=step)
    assert session.interactions == []


@pytest.mark.parametrize(
    "step", [{"cover": "all"}, {"wait": 2}, {"goto": [2.0, 7.45]}, {"undock": True}, {"move": 0.3}]
)
def test_steps_begin_from_the_page(step: dict[str, Any], stage: Stage, session: Session) -> None:
    ask(stage, type="step_now", step=step)
    assert [item.kind for item in session.interactions] == ["step"]


def test_the_world_names_graph_and_docks(stage: Stage) -> None:
    header = world_frame(stage, server="x", read_only=False).header
    assert len(header["graph"]["nodes"]) == 3 and header["docks"] == []


@pytest.mark.parametrize("seed", range(3))
def test_a_graph_survives_any_requests(seed: int, stage: Stage, file: Path) -> None:
    rng = random.Random(seed)
    values: list[Any] = [
        None,
        True,
        -1,
        0,
        1,
        2,
        3,
        4,
        5,
        7.45,
        1e6,
        1e9,
        2**40,
        "",
        "x",
        "../x",
        [],
        [0],
        [3, 4],
        {"cost": 1},
    ]
    values += [{"speed_limit": "fast"}, {"penalty": 2.0, "class": "a"}, {"x": 1}, float("nan")]
    kinds = [
        "graph_add_node",
        "graph_move_node",
        "graph_connect",
        "graph_delete",
        "graph_set",
        "graph_undo",
        "graph_save",
    ]
    fields = {
        "graph_add_node": ["x", "y"],
        "graph_move_node": ["node", "x", "y"],
        "graph_connect": ["start", "end", "both_ways"],
        "graph_delete": ["nodes", "edges"],
        "graph_set": ["edges", "values"],
        "graph_save": ["name"],
    }
    accepted = refused = 0
    for _ in range(600):
        kind = rng.choice(kinds)
        request = {"type": kind, **{name: rng.choice(values) for name in fields.get(kind, [])}}
        before = stage.graph.draft.version
        try:
            assert ask(stage, **request).ok
            accepted += 1
        except NavError as error:
            assert error.message and stage.graph.draft.version == before
            refused += 1
        draft = stage.graph.draft
        assert all(edge.start in draft.nodes and edge.end in draft.nodes for edge in draft.edges.values())
    assert accepted > 10 and refused > 100
    for saved in file.parent.glob("*.geojson"):
        assert saved.parent == file.parent and GraphDraft(load_graph(saved)).edges

"""The behavior tree of a Nav2 robot, as a page is sent it."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest

from navstack.live.checkpoints import Origin
from navstack.live.messages import Frame, decode
from navstack.live.session import Session
from navstack.live.view import TREE_PERIOD_S, SessionView, TreeView, tree_of
from navstack.map_io import map_path
from navstack.record import Record
from navstack.scenario import Scenario, load_scenario

NEVER, RUNNING, SUCCEEDED, FAILED, SKIPPED, HALTED = range(6)


def drive_to(folder: Path, goal: str) -> Session:
    """A session of a robot that is driven by a tree."""
    file = folder / "corridor.yaml"
    file.write_text(
        f"map: office\nparams: nav2_turtlebot\nstart: [0.8, 7.45, 0.0]\ngoals: [{goal}]\n", encoding="utf-8"
    )
    return Session(load_scenario(file), origin=Origin(map_path("office"), ("nav2_turtlebot",)))


@pytest.fixture
def nav2(tmp_path: Path) -> Session:
    return drive_to(tmp_path, "[2.3, 7.45, 0.0]")


def sent(view: SessionView) -> dict[str, Any]:
    frame = Frame({"type": "frame"})
    frame.header["side"] = view.frame(frame)
    return decode(frame.encode())[0]["side"]


def nodes_of(view: SessionView, session: Session) -> dict[str, list[Any]]:
    """State, ticks and failures by label."""
    tree = tree_of(session)
    assert tree is not None
    states = sent(view)["tree_states"]["nodes"]
    return {item.label: state for item, state in zip(tree.nodes, states, strict=True)}


@pytest.mark.slow
def test_nodes_run_and_end(nav2: Session) -> None:
    view = SessionView(nav2)
    view.set_layers(frozenset({"tree"}))
    first = sent(view)
    tree = tree_of(nav2)
    assert tree is not None and first["behavior_tree"]["name"] == tree.name
    rows = first["behavior_tree"]["nodes"]
    assert [row[1] for row in rows] == [item.label for item in tree.nodes] and rows[0][0] == 0
    assert all(later[0] <= row[0] + 1 for row, later in itertools.pairwise(rows))
    assert {row[2] for row in rows} == {"control", "decorator", "action", "condition"}
    assert {state for state, _, _ in first["tree_states"]["nodes"]} == {NEVER}

    while nav2.time < 2.0:
        nav2.step_once()
    driving = nodes_of(view, nav2)
    assert driving["FollowPath"][0] == RUNNING and driving["FollowPath"][1] > 20
    assert driving["ComputePathToPose"][0] == SUCCEEDED and 2 <= driving["ComputePathToPose"][1] <= 3  # planned at 1 Hz
    assert driving["Spin"] == [NEVER, 0, 0]
    assert next(iter(driving.values()))[0] == RUNNING

    while not nav2.is_done:
        nav2.step_once()
    after = nodes_of(view, nav2)
    assert not any(state[0] == RUNNING for state in after.values())
    assert after["FollowPath"][0] == SUCCEEDED
    assert all(state[2] <= state[1] for state in after.values())


@pytest.mark.slow
def test_a_reason_comes_with_a_failure(tmp_path: Path) -> None:
    """The goal is outside the map: planning fails, and so does the recovery."""
    session = drive_to(tmp_path, "[-3.0, -3.0, 0.0]")
    view = SessionView(session)
    view.set_layers(frozenset({"tree"}))
    while not session.is_done:
        session.step_once()
    tree, states = tree_of(session), sent(view)["tree_states"]
    assert tree is not None and tree.trace.retry_count > 0
    assert states["recoveries"] == tree.blackboard["number_recoveries"] == 0  # none helps
    (failed,) = [(tree.nodes[int(index)].label, text) for index, text in states["messages"].items()]
    assert failed[0] == "ComputePathToPose" and "outside the costmap" in failed[1]
    assert states["nodes"][0][0] == FAILED


@pytest.mark.slow
def test_states_are_sent_while_the_tab_is_shown_and_at_a_low_rate(nav2: Session) -> None:
    view = SessionView(nav2)
    assert "behavior_tree" in sent(view)
    nav2.step_once()
    assert not {"behavior_tree", "tree_states"} & sent(view).keys()
    view.set_layers(frozenset({"tree"}))
    assert "tree_states" in sent(view) and "tree_states" not in sent(view)
    nav2.restart()
    assert {"behavior_tree", "tree_states"} <= sent(view).keys()  # a page forgets everything then

    now = 0.0
    nav2.set_speed(1.0)
    nav2.pause(False)
    states, tree, times = TreeView(lambda: now), tree_of(nav2), []
    assert tree is not None
    for k in range(32):
        now = 0.03125 * k  # exact in binary
        nav2.advance(0.05, budget_s=10.0, timer=lambda: 0.0)
        if states.update(nav2, tree) is not None:
            times.append(now)
    assert len(times) == 5 and min(b - a for a, b in itertools.pairwise(times)) >= TREE_PERIOD_S
    nav2.pause(True)
    assert states.update(nav2, tree) is not None and states.update(nav2, tree) is None


@pytest.mark.slow
def test_a_recorded_run_shows_the_tree_of_its_time(nav2: Session, tmp_path: Path) -> None:
    """The page simulates a record again: the tree is in the state it had then."""
    while not nav2.is_done:
        nav2.step_once()
    nav2.seek(2.0)
    nav2.finish_seek()
    view = SessionView(nav2)
    view.set_layers(frozenset({"tree"}))
    before = nodes_of(view, nav2)
    nav2.recorded().save(tmp_path / "run")
    record = Record.load(tmp_path / "run")
    again = Session(Scenario.from_record(record))
    again.end = nav2.end
    again.seek(2.0)
    again.finish_seek()
    view = SessionView(again)
    view.set_layers(frozenset({"tree"}))
    after = nodes_of(view, again)
    assert after == before and before["FollowPath"][0] == RUNNING


def test_a_robot_of_move_base_has_no_tree(session: Session) -> None:
    view = SessionView(session)
    view.set_layers(frozenset({"tree"}))
    entries = sent(view)
    assert entries["behavior_tree"] is None and "tree_states" not in entries

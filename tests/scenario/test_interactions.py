"""Interactions: the same record whether they come from a person or from a scenario file, to the byte."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.core import InputError, NavError, Pose2D, ScenarioError
from navstack.explain import explain_goals, replay
from navstack.map_io import map_path
from navstack.plot import plot_run
from navstack.record import Record
from navstack.routes import build_graph, save_graph
from navstack.scenario import Run, Scenario, load_scenario, run_scenario
from navstack.scenario.file_writer import write_scenario
from navstack.scenario.interactions import INTERACTION, as_data

PERSON = {"kind": "pedestrian", "goals": [[10.0, 7.5], [4.0, 7.5]]}
BOX = {"name": "box", "box": [0.5, 0.4], "pose": [5.0, 7.5, 0.0]}
STORY: list[tuple[float, dict[str, Any]]] = [
    (2.0, {"kind": "put", "shape": BOX}),
    (3.0, {"kind": "put", "shape": {"name": "bob", "radius": 0.25, "pose": [9.0, 7.5], "motion": PERSON}}),
    (4.0, {"kind": "goal", "pose": [10.0, 7.0, 0.0]}),
    (5.0, {"kind": "queue", "goals": [[5.0, 8.0, 0.0], [2.0, 7.4]]}),
    (6.0, {"kind": "put", "shape": {**BOX, "pose": [6.0, 6.9, 0.3]}}),
    (7.0, {"kind": "set", "values": {"DWAPlannerROS/max_vel_x": 0.3}}),
    (8.0, {"kind": "drive", "velocity": [0.2, 0.0, 0.5], "until": 10.0}),
    (11.0, {"kind": "remove", "name": "box"}),
    (12.0, {"kind": "place", "pose": [3.0, 7.4, 0.0]}),
    (13.0, {"kind": "clear_costmaps"}),
    (15.0, {"kind": "cancel"}),
    (16.0, {"kind": "wait", "duration": 1.0}),
]


def office(tmp_path: Path, text: str = "") -> Scenario:
    file = tmp_path / "office.yaml"
    file.write_text(f"map: office\nstart: [0.8, 7.45, 0.0]\ngoals: [[6.2, 12.0, 1.57]]\n{text}", encoding="utf-8")
    return load_scenario(file)


def advance(run: Run) -> bool:
    """Steps until the time advances."""
    before = run.robot.time
    while run.step():
        if run.robot.time > before:
            return True
    return False


def driven(scenario: Scenario, story: list[tuple[float, dict[str, Any]]]) -> tuple[Run, Scenario]:
    """A run in which a person does `story`, and the scenario with what was done."""
    run, left, done = Run(scenario), list(story), []
    while True:
        while left and run.robot.time >= left[0][0]:
            item = INTERACTION.validate_python({"time": run.robot.time, **left.pop(0)[1]})
            run.interact(item)
            done.append(item)
        if not advance(run):
            break
    assert not left
    return run, replace(scenario, interactions=tuple(done))


def bytes_of(run: Run, scenario: Scenario, folder: Path) -> bytes:
    assert run.recorder is not None
    run.recorder.set_scenario(scenario.as_dict())
    return run.recorder.save(folder)["record"].read_bytes()


@pytest.mark.slow
def test_a_saved_session_gives_the_same_record_byte_for_byte(tmp_path: Path) -> None:
    run, scenario = driven(office(tmp_path), STORY)
    saved = write_scenario(scenario, tmp_path / "saved.yaml", map_file=map_path("office"), sources=["turtlebot"])
    assert saved.interactions == scenario.interactions
    again = run_scenario(load_scenario(tmp_path / "saved.yaml")).recorder
    assert again is not None
    mine = bytes_of(run, saved, tmp_path / "a")
    assert mine == again.save(tmp_path / "b")["record"].read_bytes()
    record = Record.load(tmp_path / "a")
    assert [goal.status for goal in explain_goals(record)] == [outcome.state for outcome in run.outcomes]
    replay(record)  # raises if it differs
    plot_run(record, tmp_path / "run.png")
    assert len(record.solids_at(1.0)[1]) == 0 and len(record.solids_at(2.5)[1]) == 1
    assert len(record.solids_at(2.5)[0]) == 0 and len(record.solids_at(3.5)[0]) == 1
    assert len(record.solids_at(12.0)[1]) == 0
    box = record.solids_at(6.5)[1][0].mean(axis=0)
    assert np.allclose(box, (6.0, 6.9), atol=1e-5)


def test_interactions_at_the_same_instant_keep_their_order(tmp_path: Path) -> None:
    story: list[tuple[float, dict[str, Any]]] = [
        (1.0, {"kind": "goal", "pose": [4.0, 7.4]}),
        (1.0, {"kind": "cancel"}),
        (1.0, {"kind": "goal", "pose": [3.0, 7.4]}),
    ]
    run, scenario = driven(office(tmp_path), story)
    again = Run(scenario)
    while again.step():
        pass
    assert [o.state for o in again.outcomes] == [o.state for o in run.outcomes]
    assert bytes_of(run, scenario, tmp_path / "a") == bytes_of(again, scenario, tmp_path / "b")
    assert run.outcomes[-1].goal == (3.0, 7.4, 0.0)


def test_an_interaction_after_the_end_continues_the_run(tmp_path: Path) -> None:
    scenario = replace(office(tmp_path), goals=())
    run = Run(scenario)
    assert not run.step()
    item = INTERACTION.validate_python({"time": run.robot.time, "kind": "goal", "pose": [2.0, 7.45, 0.0]})
    run.interact(item)
    while run.step():
        pass
    assert [outcome.state for outcome in run.outcomes] == ["SUCCEEDED"]
    scenario = replace(scenario, interactions=(item,))
    again = Run(scenario)
    while again.step():
        pass
    assert bytes_of(run, scenario, tmp_path / "a") == bytes_of(again, scenario, tmp_path / "b")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("action", "reason"),
    [
        ({"kind": "put", "shape": {"name": "box", "box": [1.0, 1.0], "pose": [0.8, 7.45]}}, "would overlap the robot"),
        ({"kind": "remove", "name": "nothing"}, 'no obstacle is called "nothing"'),
        ({"kind": "set", "values": {"DWAPlannerROS/max_vel_y_typo": 0.3}}, "max_vel_y_typo"),
        ({"kind": "set", "values": {"local_costmap/rolling_window": False}}, "cannot be changed at run time"),
        ({"kind": "set", "values": {"navstack/sim/odometry_noise": 0.3}}, "fixed during a run"),
        ({"kind": "place", "pose": [0.0, 0.0, 0.0]}, "collides"),
        ({"kind": "drive", "velocity": [0.0, 0.3, 0.0], "until": 3.0}, "cannot drive sideways"),
    ],
)
def test_a_refused_interaction_changes_nothing(tmp_path: Path, action: dict[str, Any], reason: str) -> None:
    run, plain = Run(office(tmp_path)), Run(office(tmp_path))
    try:
        run.interact(INTERACTION.validate_python({"time": 0.0, **action}))
    except NavError as exc:
        assert reason in exc.message
    else:
        # a misspelt name is a warning of the parameters, and has no effect
        assert "typo" in reason
    for _ in range(12):
        run.step(), plain.step()
    assert run.robot.pose == plain.robot.pose


@pytest.mark.slow
def test_the_record_restores_the_interactions(tmp_path: Path) -> None:
    run, scenario = driven(office(tmp_path), STORY[:6])
    assert run.recorder is not None
    run.recorder.set_scenario(scenario.as_dict())
    restored = Scenario.from_record(run.recorder.record())
    assert restored.interactions == scenario.interactions
    assert [as_data(item) for item in restored.interactions] == [as_data(item) for item in scenario.interactions]


@pytest.mark.parametrize(
    ("line", "wanted"),
    [
        ("interactions: 3", "interactions is 3, a number; write a list"),
        ("interactions: [5]", "interaction 1 is 5, a number; write a mapping"),
        ("interactions: [{time: 1.0}]", "interaction 1 has no kind; add `kind:`"),
        ("interactions: [{time: 1.0, kind: gaol, pose: [1, 2]}]", "did you mean goal?"),
        ("interactions: [{time: -1.0, kind: cancel}]", "time = -1.0"),
        ("interactions: [{time: 1.0, kind: goal, pose: [1]}]", "pose"),
        ("interactions: [{time: 1.0, kind: put, shape: {radius: 1.0}}]", "the shape has no name"),
    ],
)
def test_a_wrong_interaction_is_reported_with_its_line(tmp_path: Path, line: str, wanted: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        office(tmp_path, line)
    assert wanted in caught.value.message
    assert "office.yaml:4" in caught.value.message


def test_a_scenario_without_goals_needs_interactions(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text("map: office\ngoals: []\ninteractions: []\n", encoding="utf-8")
    assert load_scenario(file).goals == ()
    file.write_text("map: office\ngoals: []\n", encoding="utf-8")
    with pytest.raises(InputError, match="goals is empty"):
        load_scenario(file)


@pytest.mark.slow
def test_teleop_goes_through_the_collision_monitor(tmp_path: Path) -> None:
    """At each time, the command is sent once: sending it is work that is due at once."""
    file = tmp_path / "teleop.yaml"
    file.write_text(
        "map: office\nstart: [3.0, 7.45, 1.57]\ngoals: []\n"
        "params: [turtlebot, {collision_monitor: {polygons: [stop], stop: {type: circle, radius: 0.6, action_type: stop},"
        " observation_sources: [scan], scan: {type: scan, topic: scan}}}]\n"
        "interactions:\n"
        "  - {kind: teleop, time: 0.0, velocity: [0.3, 0.0, 0.0], until: 0.52}\n"  # then the multiplexer's time-out
        "  - {kind: teleop, time: 2.0, velocity: [0.3, 0.0, 0.0], until: 7.0}\n",
        encoding="utf-8",
    )
    run = Run(load_scenario(file), record=False)
    while run.robot.time < 7.0:
        assert run.step()
    assert (
        7.6 < run.robot.pose.y < 7.9 and not run.robot.collisions
    )  # the wall is 0.95 m away; the monitor stops at 0.6 m


def test_a_step_begins_at_once_and_the_queue_follows(tmp_path: Path) -> None:
    graph = build_graph({0: (0.8, 7.45), 1: (2.0, 7.45), 2: (3.0, 7.45)}, [(0, 1), (1, 2)])
    save_graph(graph, tmp_path / "lane.geojson")
    story = "interactions:\n- {time: 0.5, kind: step, step: {route: lane.geojson, to: 2}}\n"
    scenario = replace(
        office(tmp_path, f"stop_on_failure: true\n{story}"), goals=(Pose2D(6.2, 12.0), Pose2D(3.5, 7.45))
    )
    (step,) = scenario.interactions
    assert INTERACTION.validate_python(as_data(step)) == step
    result = run_scenario(scenario, record=False)
    assert [outcome.state for outcome in result.goals] == ["PREEMPTED", "SUCCEEDED", "SUCCEEDED"]
    assert result.goals[1].step == "route lane to node 2" and result.goals[2].goal == Pose2D(3.5, 7.45)


@pytest.mark.parametrize(
    ("step", "message"),
    [
        ("{dock: nowhere}", "nowhere"),
        ("{route: lane.geojson, to: 7}", "lane.geojson"),
        ("{fly: 3}", "is not one step"),
    ],
)
def test_a_wrong_step_is_refused_with_its_reason(step: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(NavError, match=message):
        run_scenario(office(tmp_path, f"interactions:\n- {{time: 0.0, kind: step, step: {step}}}\n"), record=False)

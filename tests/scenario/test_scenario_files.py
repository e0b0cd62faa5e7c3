"""Scenario files: relative paths, overrides, tours, shapes, conditions."""

from __future__ import annotations

import json
import pickle
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from navstack.cli.app import command_tree, run
from navstack.cli.arguments import scenario_file
from navstack.core import InputError, InternalError, Pose2D
from navstack.map_io import map_path
from navstack.record import Record
from navstack.record.metrics import metrics_of
from navstack.scenario import (
    Run,
    Scenario,
    SuccessConditions,
    check_scenario,
    is_scenario_file,
    load_scenario,
    read_scenario,
    run_scenario,
    shipped_scenarios,
)
from navstack.scenario.places import load_places
from navstack.studies import read_scenarios

SHORT = """
name: short
map: office
set: {DWAPlannerROS/max_vel_x: 0.4}
sim: {odometry_noise: 0.02, laser: {beams: 90}}
start: [3.0, 7.4]
goals: [[4.0, 7.4, 0.0]]
shapes:
  - {radius: 0.1, pose: [3.5, 8.2]}
  - {name: cart, radius: 0.1, motion: {kind: track, points: [[5, 7], [5, 8]], speed: 0.1}}
seed: 3
time_limit: 30
success: {max_time: 20, min_clearance: 0.01}
"""


@pytest.fixture
def short(tmp_path: Path) -> Path:
    file = tmp_path / "short.yaml"
    file.write_text(SHORT, encoding="utf-8")
    return file


def test_the_scenario_has_the_values_of_the_file(short: Path) -> None:
    scenario = load_scenario(short)
    assert scenario.name == "short" and scenario.seed == 3 and scenario.time_limit_s == 30.0
    assert scenario.start == Pose2D(3.0, 7.4, 0.0) and scenario.goals == (Pose2D(4.0, 7.4, 0.0),)
    assert scenario.configuration.local_planner.params.max_vel_x == 0.4
    assert scenario.configuration.navstack.sim.odometry_noise == 0.02
    assert scenario.configuration.navstack.sim.lidar("laser").beams == 90
    assert [shape.name for shape in scenario.shapes] == ["", "cart"]
    assert scenario.success == SuccessConditions(max_time_s=20.0, min_clearance_m=0.01)


def test_arguments_override_the_file(short: Path) -> None:
    spec = read_scenario(short)
    scenario = spec.build(
        seed=9,
        overrides=["DWAPlannerROS/max_vel_x=0.3"],
        time_limit_s=5.0,
        start=Pose2D(2.0, 7.4),
        goals=[Pose2D(2.5, 7.4)],
        obstacles=[(9.0, 7.0, 0.1)],
        distro="indigo",
    )
    assert scenario.seed == 9 and scenario.time_limit_s == 5.0 and scenario.obstacles == ((9.0, 7.0, 0.1),)
    assert scenario.start.x == 2.0 and scenario.goals[0].x == 2.5
    assert scenario.configuration.local_planner.params.max_vel_x == 0.3
    assert scenario.configuration.navstack.ros_distro == "indigo"
    # other parameters: the file's own changes still lie over them
    other = spec.build(params=["turtlebot", {"DWAPlannerROS": {"max_vel_x": 0.2, "sim_time": 1.1}}])
    assert other.configuration.local_planner.params.max_vel_x == 0.4
    assert other.configuration.local_planner.params.sim_time == 1.1


def test_paths_are_relative_to_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "maps").mkdir()
    (tmp_path / "scenarios").mkdir()
    for ending in (".yaml", ".png", ".places.yaml"):
        source = map_path("office").with_name(f"office{ending}")
        (tmp_path / "maps" / f"mine{ending}").write_bytes(source.read_bytes())
    text = (tmp_path / "maps" / "mine.yaml").read_text(encoding="utf-8").replace("office.png", "mine.png")
    (tmp_path / "maps" / "mine.yaml").write_text(text, encoding="utf-8")
    (tmp_path / "faster.yaml").write_text("DWAPlannerROS: {max_vel_x: 0.55}\n", encoding="utf-8")
    file = tmp_path / "scenarios" / "a.yaml"
    file.write_text(
        "map: ../maps/mine.yaml\nparams: [turtlebot, ../faster.yaml]\nstart: lounge\ngoals: [kitchen]\n",
        encoding="utf-8",
    )
    monkeypatch.chdir("/")
    scenario = load_scenario(file)
    assert scenario.goals == (load_places("office").places["kitchen"],)
    assert scenario.configuration.local_planner.params.max_vel_x == 0.55
    assert scenario.names["map"] == "mine.yaml" and scenario.names["params"] == ["turtlebot", "faster.yaml"]


def test_a_random_tour_depends_on_the_seed(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("map: office\ntour: {order: random, loops: 2}\n", encoding="utf-8")
    spec = read_scenario(file)
    first, second = spec.build(seed=1), spec.build(seed=2)
    assert len(first.goals) == 2 * len(load_places("office").places)
    assert first.goals != second.goals and sorted(first.goals) == sorted(second.goals)
    assert spec.build(seed=1).goals == first.goals


def test_the_places_of_the_map_supply_start_and_goals(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("map: maze\n", encoding="utf-8")
    scenario = load_scenario(file)
    assert (scenario.start, scenario.goals) == (load_places("maze").start, load_places("maze").goals)


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        (SHORT, True),
        ("map: maze\n", True),
        ("mpa: maze\nstart: [1, 1]\ngoals: [[2, 2]]\n", True),
        ("image: a.png\nresolution: 0.05\norigin: [0, 0, 0]\n", False),
        ("DWAPlannerROS: {max_vel_x: 1}\n", False),
        ("not: [closed", False),
    ],
)
def test_scenario_files_are_distinguished_from_others(text: str, is_one: bool, tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text(text, encoding="utf-8")
    assert is_scenario_file(file) is is_one
    assert not is_scenario_file(tmp_path)


def test_scenarios_and_specs_can_be_pickled(short: Path) -> None:
    spec = read_scenario(short)
    there = pickle.loads(pickle.dumps(spec))
    assert len(pickle.dumps(spec)) < 10_000
    assert there.build().as_dict() == spec.build().as_dict()
    scenario = pickle.loads(pickle.dumps(spec.build()))
    assert scenario.as_dict() == spec.build().as_dict()


def test_the_length_equals_that_of_the_recorded_poses_despite_slip(short: Path) -> None:
    result = run_scenario(load_scenario(short, overrides=["navstack/sim/wheel_slip=0.2"]))
    assert result.recorder is not None
    samples = result.recorder.record().samples
    way = np.hypot(np.diff(samples["x"]), np.diff(samples["y"])).sum()
    assert result.metrics.length_m == pytest.approx(way, rel=1e-9)
    assert sum(goal.path_length_m for goal in result.goals) == pytest.approx(way, rel=1e-9)


def test_the_record_contains_the_scenario_and_gives_the_metrics(short: Path, tmp_path: Path) -> None:
    result = run_scenario(load_scenario(short), timings=True)
    assert result.succeeded and [v.condition for v in result.conditions] == [
        *("goals", "max_collisions", "max_time", "min_clearance"),
    ]
    assert result.recorder is not None and result.timings is not None
    record = Record.load(result.recorder.save(tmp_path / "out")["record"])
    assert metrics_of(record) == result.metrics
    again = Scenario.from_record(record)
    assert again.as_dict() == load_scenario(short).as_dict()
    # without a record, the same numbers
    light = run_scenario(again, record=False)
    assert light.metrics == result.metrics and light.recorder is None and light.timings is None
    result_of = result.as_dict()
    assert result_of["metrics"]["length_m"] == pytest.approx(0.9, abs=0.2)
    assert result_of["timings"]["control_ms"]["count"] >= 10 and "timings" not in json.dumps(record.scenario)


def test_failed_conditions_are_reported(short: Path) -> None:
    short.write_text(
        SHORT.replace("max_time: 20, min_clearance: 0.01", "max_time: 1, min_clearance: 3, goals: ABORTED")
    )
    result = run_scenario(load_scenario(short), record=False)
    assert not result.succeeded
    found = {v.condition: v.text for v in result.conditions if not v.holds}
    assert set(found) == {"goals", "max_time", "min_clearance"}
    assert found["goals"] == "goal 1 ended SUCCEEDED, ABORTED required"
    assert found["max_time"].endswith("s, at most 1 required")


def test_a_condition_result_shows_enough_digits_to_differ_from_the_limit(short: Path) -> None:
    metrics = run_scenario(load_scenario(short), record=False).metrics
    wanted = SuccessConditions(max_time_s=100.0, max_collisions=0, max_recoveries=3)

    def texts(**values: Any) -> list[str]:
        return [v.text for v in wanted.evaluate(["SUCCEEDED"], replace(metrics, **values), 1)][1:]

    assert texts(collisions=1, time_s=100.004, recoveries=1) == [
        "1 collision, at most 0 required",
        "100.004 s, at most 100 required",
        "1 recovery, at most 3 required",
    ]
    assert texts(collisions=0, time_s=100.0, recoveries=4) == [
        "0 collisions, at most 0 required",
        "100 s, at most 100 required",
        "4 recoveries, at most 3 required",
    ]


def test_the_old_name_of_max_collisions_is_read_with_a_note(short: Path) -> None:
    short.write_text(SHORT.replace("max_time: 20", "max_contacts: 2, max_time: 20"))
    assert read_scenario(short).build().success.max_collisions == 2
    (note,) = [f for f in check_scenario(short) if f.key == "success/max_contacts"]
    assert note.severity == "info" and "max_contacts is the previous name of max_collisions" in note.message
    assert SuccessConditions.from_dict({"max_contacts": 2}) == SuccessConditions(max_collisions=2)


@pytest.mark.parametrize("wrong", [{"goals": []}, {"time_limit_s": 0.0}, {"time_limit_s": float("nan")}])
def test_invalid_arguments_are_rejected_before_building(short: Path, wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=r"goals is empty|must be above 0 s"):
        read_scenario(short).build(**wrong)


def test_the_number_of_states_must_match_the_goals(short: Path) -> None:
    short.write_text(SHORT.replace("max_time: 20", "goals: [ABORTED]"))
    scenario = read_scenario(short).build(goals=[Pose2D(4.0, 7.4), Pose2D(5.0, 7.4)])
    with pytest.raises(InputError, match="lists 1 state for 2 goals"):
        run_scenario(scenario, record=False)


@pytest.mark.slow
def test_simulate_takes_a_scenario_file(
    short: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(short.parent)
    assert run(["simulate", "short.yaml", "--json", "--out", "out", "--seed", "4", "--timings"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["success"] is True and document["seed"] == 4
    assert [c["holds"] for c in document["conditions"]] == [True] * 4
    assert document["metrics"]["collisions"] == 0 and document["timings"]["planning_ms"]["count"] >= 1
    assert json.loads(Path("out/summary.json").read_text())["metrics"] == document["metrics"]
    Path("late.yaml").write_text(SHORT.replace("max_time: 20", "max_time: 1"))
    assert run(["simulate", "late.yaml", "--out", "out"]) == 1
    assert "condition max_time not met: " in capfd.readouterr().out
    Path("wrong.yaml").write_text(SHORT + "sede: 1\n")
    assert run(["simulate", "wrong.yaml"]) == 2
    assert 'wrong.yaml:14:1: a scenario has no key "sede"; did you mean seed?' in capfd.readouterr().err


def test_check_takes_a_scenario_file(
    short: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(short.parent)
    assert run(["check", "short.yaml"]) == 0
    assert "0 errors" in capfd.readouterr().out
    Path("wrong.yaml").write_text(SHORT + "sede: 1\n")
    assert run(["check", "wrong.yaml", "--json"]) == 2
    errors = [f for f in json.loads(capfd.readouterr().out)["findings"] if f["severity"] == "error"]
    assert [(f["line"], f["column"], f["suggestion"]) for f in errors] == [(14, 1, "seed")]


def test_shipped_scenarios_have_descriptions() -> None:
    files = shipped_scenarios()
    assert len(files) >= 8
    for path in files.values():
        spec = read_scenario(path)
        assert spec.description and spec.values["name"]


@pytest.mark.slow
def test_a_pause_ends_despite_rounding(short: Path) -> None:
    # 1.86 + 0.5 is 2.3600000000000003, which a robot at 118 / 50 s never reaches by whole steps
    short.write_text(SHORT.replace("goals: [[4.0, 7.4, 0.0]]", "goals: [[9.0, 7.4], [9.0, 7.4]]"))
    spec = read_scenario(short)
    for hundredths in range(2, 60, 3):
        scenario = replace(spec.build(time_limit_s=0.1 + hundredths / 50.0), pause_s=hundredths / 100.0)
        driven = Run(scenario, record=False)
        cycles = 0
        while driven.step():
            cycles += 1
            assert cycles < 500
        assert [outcome.state for outcome in driven.outcomes] == ["ABORTED", "ABORTED"]


def test_a_run_without_progress_of_time_is_an_error(short: Path) -> None:
    driven = Run(load_scenario(short), record=False)
    for _ in range(5):
        driven.step()
    driven.robot.advance_to = lambda time: None  # type: ignore[method-assign,assignment,return-value]
    with pytest.raises(InternalError, match=r"does not advance beyond .* took no simulated time; .* please report it"):
        while driven.step():
            pass


def test_a_folder_of_the_same_name_does_not_hide_a_shipped_scenario(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Nor does an invalid file lose its own error, with file:line:column."""
    for name in ("narrow_door", "broken"):
        (tmp_path / "here" / name).mkdir(parents=True)
    (tmp_path / "broken.yaml").write_text("map: office\nstart: [1, 2\ngoals: x\n", encoding="utf-8")
    command_tree()  # imports all commands
    shipped = {**shipped_scenarios(), "broken": tmp_path / "broken.yaml"}
    for module in [module for name, module in sys.modules.items() if name.startswith("navstack")]:
        if vars(module).get("shipped_scenarios") is shipped_scenarios:
            monkeypatch.setattr(module, "shipped_scenarios", lambda: shipped)
    monkeypatch.chdir(tmp_path / "here")
    assert scenario_file("narrow_door") == shipped["narrow_door"]
    assert [found.name for found in read_scenarios(["narrow_door"], None)] == ["narrow door"]
    assert run(["check", "narrow_door"]) == 0
    capfd.readouterr()
    for command in (["simulate"], ["check"], ["bench", "controllers"], ["bench", "speed"], ["move", "1"]):
        assert run([*command, "broken"]) != 0
        assert f"{tmp_path / 'broken.yaml'}:3:6: " in "".join(capfd.readouterr())


def test_check_takes_the_name_of_a_shipped_scenario(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "narrow_door"]) == 0
    assert capfd.readouterr().out.endswith("infos\n")

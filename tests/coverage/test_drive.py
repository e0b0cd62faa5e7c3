"""Coverage driven in the simulator: as planned, and around what the map does not contain."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from navstack.bringup import BasicNavigator, TaskResult
from navstack.core import OccupancyGrid, Pose2D
from navstack.coverage import CoverageDrive, CoverageError, least_clearance
from navstack.explain import explain_coverage
from navstack.parameters import load_configuration
from navstack.scenario import RunResult, Scenario, load_places, load_scenario, run_scenario, step_text, write_scenario
from navstack.scenario.run import Run
from navstack.scenario.steps import read_step

START = Pose2D(0.6, 0.6, 0.0)


def small_room() -> OccupancyGrid:
    cells = np.zeros((50, 60), np.bool_)
    cells[[0, -1]] = cells[:, [0, -1]] = True
    return OccupancyGrid.from_array(cells, 0.05)


def scenario_of(obstacles: tuple[tuple[float, float, float], ...] = (), **values: Any) -> Scenario:
    return Scenario(
        map=small_room(),
        configuration=load_configuration(["turtlebot_rpp"]),
        start=START,
        goals=(),
        steps=(read_step({"cover": "all", "operation_width": 0.35, **values}),),
        obstacles=obstacles,
        time_limit_s=2000.0,
    )


def driven(scenario: Scenario) -> tuple[Run, CoverageDrive]:
    run = Run(scenario, record=False)
    behavior: CoverageDrive | None = None
    while run.step():
        running = run.move_base.motions.running
        if running is not None:
            assert isinstance(running.motion, CoverageDrive)
            behavior = running.motion
    assert behavior is not None
    return run, behavior


@pytest.mark.slow
def test_the_driven_coverage_is_that_of_the_plan() -> None:
    run, behavior = driven(scenario_of())
    assert run.outcomes[0].succeeded
    assert not run.robot.collisions
    track = run.track()
    works = behavior.works_at(track[:, 0])
    report = behavior.report(np.ascontiguousarray(track[:, 1:3]), works)
    assert report["plans"] == 1
    assert report["driven"]["share"] >= report["plan"]["share"] - 0.01
    assert report["driven"]["share"] >= 0.97
    assert report["driven"]["overlap"] <= 0.12 + 0.05, "a room of 7 m² is small for its border"
    assert report["driven"]["length_m"] == pytest.approx(report["plan"]["length_m"], rel=0.03)
    assert report["driven"]["time_s"] > 0.0


@pytest.mark.slow
def test_an_obstacle_on_a_swath_is_driven_around_and_its_place_is_left() -> None:
    obstacle = (1.9, 1.3, 0.2)
    run, behavior = driven(scenario_of((obstacle,)))
    outcome = run.outcomes[0]
    assert outcome.succeeded, outcome.message
    assert not run.robot.collisions
    report = behavior.report()
    assert report["plans"] > 1
    left = [part for part in report["left"] if "obstacle" in part["reason"]]
    assert left
    assert np.hypot(left[0]["x"] - obstacle[0], left[0]["y"] - obstacle[1]) < 0.6
    area = behavior.plan.area if behavior.plan is not None else None
    assert area is not None
    hidden = sum(part["area_m2"] for part in left)
    reachable = area.reachable_m2 - hidden
    assert report["driven"]["covered_m2"] >= 0.9 * reachable
    assert outcome.figures["left"] == report["left"]
    assert "left" in outcome.text


@pytest.mark.slow
def test_a_drive_keeps_the_distance_that_it_can_hold() -> None:
    run, behavior = driven(scenario_of(clearance=0.0))
    assert behavior.clearance == pytest.approx(least_clearance(0.05)) == pytest.approx(0.07)
    assert "0.07 m from obstacles instead of 0" in run.outcomes[0].text
    report = behavior.report()
    assert report["plans"] == 1 and not run.robot.collisions
    assert report["driven"]["share"] >= report["plan"]["share"] - 0.01


@pytest.mark.slow
def test_a_robot_that_cannot_leave_its_place_fails() -> None:
    around = tuple((1.5 + 0.45 * np.cos(a), 1.25 + 0.45 * np.sin(a), 0.1) for a in np.arange(0.0, 6.2, 0.4).tolist())
    run, behavior = driven(replace(scenario_of(around), start=Pose2D(1.5, 1.25, 0.0)))
    outcome = run.outcomes[0]
    assert (outcome.state, outcome.error_code) == ("ABORTED", CoverageError.code), outcome.message
    assert behavior.report()["driven"]["share"] < 0.2


@pytest.mark.slow
def test_a_run_with_coverage_is_reproducible_and_its_record_complete() -> None:
    results: list[RunResult] = [
        run_scenario(scenario_of(cover=[[0.2, 0.2], [1.8, 0.2], [1.8, 1.6], [0.2, 1.6]])) for _ in (0, 1)
    ]
    first, second = (result.recorder.record() for result in results if result.recorder is not None)
    assert np.array_equal(first.samples, second.samples)
    assert [event.data for event in first.events] == [event.data for event in second.events]
    report = explain_coverage(first)[0]
    assert report.driven["share"] > 0.95
    assert report.segments >= 3
    assert sum(report.reasons().values()) == pytest.approx(sum(part["area_m2"] for part in report.left))
    restored = Scenario.from_record(first)
    assert restored.steps == scenario_of(cover=[[0.2, 0.2], [1.8, 0.2], [1.8, 1.6], [0.2, 1.6]]).steps


def test_a_scenario_file_has_the_step(tmp_path: Any) -> None:
    file = tmp_path / "clean.yaml"
    file.write_text(
        "map: office\nparams: [turtlebot_rpp]\nstart: [7.6, 3.6, 0]\n"
        "goals:\n  - {cover: [[6.1, 0.0], [9.9, 0.0], [9.9, 6.3], [6.1, 6.3]], operation_width: 0.3}\n",
        encoding="utf-8",
    )
    scenario = load_scenario(file)
    assert len(scenario.steps) == 1
    assert write_scenario(scenario, tmp_path / "again.yaml").steps == scenario.steps
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(file.read_text(encoding="utf-8").replace("operation_width", "operation_with"), encoding="utf-8")
    with pytest.raises(Exception, match=r'wrong.yaml:5:\d+.*step 1: coverage has no field "operation_with"'):
        load_scenario(wrong)


def test_a_tour_has_the_step(tmp_path: Any) -> None:
    file = tmp_path / "rounds.places.yaml"
    file.write_text("places: {a: [1, 7.4, 0]}\nstart: a\ngoals: [a, {cover: all}]\n", encoding="utf-8")
    steps = load_places(file).steps
    assert [step_text(step) for step in steps] == ["a", "cover all"]


def test_a_car_is_refused() -> None:
    scenario = Scenario(
        map=small_room(),
        configuration=load_configuration(["car_rpp"]),
        start=START,
        goals=(),
        steps=(read_step({"cover": "all"}),),
    )
    with pytest.raises(Exception, match=r"a base with a turning radius of .* cannot turn in place"):
        Run(scenario)


@pytest.mark.slow
def test_the_navigator_covers_a_field() -> None:
    navigator = BasicNavigator.simulated(load_configuration(["turtlebot_rpp"]), small_room(), START)
    field = [[0.2, 0.2], [1.6, 0.2], [1.6, 1.4], [0.2, 1.4], [0.2, 0.2]]
    plan = navigator.getCoveragePath(field, operation_width=0.3, clearance=0.03)
    assert plan is not None
    assert plan.figures.share > 0.95
    assert navigator.getCoveragePath([[90, 90], [91, 90], [91, 91]]) is None
    assert navigator.getTaskError()[0] == 803
    assert navigator.navigateCoverage(field, operation_width=0.3, clearance=0.03)
    left: list[float] = []
    while not navigator.isTaskComplete():
        feedback = navigator.getFeedback()
        if feedback is not None:
            left.append(feedback.distance_remaining)
    assert navigator.getResult() is TaskResult.SUCCEEDED, navigator.getTaskError()
    assert max(left) > 3.0
    assert left[-1] < 0.5
    assert navigator.coverage is not None
    assert navigator.coverage.figures().share > 0.93

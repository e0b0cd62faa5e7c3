"""The Python interface of one line: names or objects, findings as warnings, results that print and draw themselves."""

from __future__ import annotations

import doctest
import warnings
from pathlib import Path

import numpy as np
import pytest

import navstack as nav
from navstack import shortcuts
from navstack.core import InputError, ParameterError


@pytest.mark.slow
def test_the_examples_of_the_docstrings() -> None:
    failed, tried = doctest.testmod(shortcuts, optionflags=doctest.ELLIPSIS)
    assert tried >= 8 and failed == 0


@pytest.mark.slow
def test_a_run_by_names_equals_the_run_of_the_objects() -> None:
    named = nav.simulate("office", robot="turtlebot", goals=["kitchen"], seed=3)
    places = nav.load_places("office")
    objects = nav.simulate(
        nav.load_map("office"),
        robot=nav.load_robot("turtlebot"),
        start=places.start,
        goals=[places.places["kitchen"]],
        seed=3,
    )
    assert str(named) == str(objects) and str(named).startswith("1/1 goals, ")
    assert np.array_equal(named.record.poses, objects.record.poses)


@pytest.mark.slow
def test_a_result_explains_and_draws_itself(tmp_path: Path) -> None:
    result = nav.simulate("office", goals="kitchen")
    assert result.explain(goal=1).startswith("goal 1: reached after")
    result.plot(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000
    assert result._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(InputError, match="goal 7"):
        result.explain(goal=7)


def test_a_plan_between_places_draws_itself(tmp_path: Path) -> None:
    plan = nav.plan("office", "corridor_west", "kitchen", planner="astar")
    assert plan.path.length > 10.0
    assert plan._repr_png_().startswith(b"\x89PNG")
    assert nav.plan(np.zeros((20, 20), bool), 0.1, (0.5, 0.5), (1.5, 0.5)).path.length == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(
    ("call", "suggestion"),
    [
        (lambda: nav.simulate("offise"), "office"),
        (lambda: nav.simulate("office", robot="turtlebt"), "turtlebot"),
        (lambda: nav.simulate("office", goals=["kitchn"]), "kitchen"),
        (lambda: nav.plan("office", "kitchn", "kitchen"), "kitchen"),
        (lambda: nav.load_robot("turtlebt"), "turtlebot"),
        (lambda: nav.load_robot(DWAPlannerROS={"sim_tme": 2.0}), "sim_time"),
    ],
)
def test_a_wrong_name_is_an_error_with_a_suggestion(call: object, suggestion: str) -> None:
    assert callable(call)
    with pytest.raises((InputError, ParameterError), match=f"did you mean [\"']?{suggestion}"):
        call()


def test_findings_warn_or_are_errors() -> None:
    sources = ["turtlebot", {"DWAPlannerROS": {"sim_tme": 2.0}}]
    with pytest.warns(nav.ParameterWarning, match="did you mean sim_time"):
        nav.load_configuration(sources)
    with pytest.raises(ParameterError, match="did you mean sim_time"):
        nav.load_configuration(sources, strict=True)
    with pytest.raises(ParameterError, match=r"overrides\[0\]: DWAPlannerROS/sim_tme = 2 sets nothing"):
        nav.load_configuration(["turtlebot"], overrides=["DWAPlannerROS/sim_tme=2"])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        nav.load_configuration(["turtlebot"])


@pytest.mark.slow
def test_many_runs_do_not_depend_on_the_number_of_processes() -> None:
    one = nav.simulate_many("narrow_door", count=2, processes=1)
    two = nav.simulate_many("narrow_door", count=2, processes=2)
    assert one.rows == two.rows and [row["run"] for row in one.rows] == ["seed 0", "seed 1"]
    assert one.success_rate == float(np.mean([row["succeeded"] for row in one.rows]))
    assert "| seed 1" in str(one)


def test_public_types_print_one_line() -> None:
    configuration = nav.load_robot("turtlebot")
    grid, places = nav.load_map("office"), nav.load_places("office")
    planned = nav.plan_on_map(configuration, grid, places.start, places.goals[0])
    scenario = shortcuts.make_scenario("office", goals="kitchen")
    scan = nav.LaserScan(np.array([1.0, np.inf], np.float32), 0.0, 0.1, 0.1, 10.0)
    shown = [
        configuration,
        grid,
        places,
        planned.plan,
        planned.plan.path,
        planned.costmap.master,
        planned.costmap.footprint,
        scenario,
        scan,
        nav.PointCloud(np.zeros((3, 3), np.float32)),
    ]
    for value in shown:
        assert len(repr(value)) < 200 and "\n" not in repr(value), repr(value)
    assert repr(grid) == "OccupancyGrid(480 x 320 cells of 0.05 m, 24.0 x 16.0 m, 93% known, frame 'map')"
    assert repr(scan).startswith("LaserScan(2 beams, 1 with a hit, at 0.000 s")

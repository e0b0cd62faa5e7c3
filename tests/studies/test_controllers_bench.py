"""Comparisons of controllers: what a row counts, and when times are compared."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from navstack.parameters import load_configuration
from navstack.plugins import LOCAL_PLANNERS
from navstack.record import resampled_jerk
from navstack.studies.controllers import (
    CONTROLLERS,
    MeasuredRun,
    causes_table,
    common_cases,
    controllers_notes,
    controllers_table,
    differences_table,
    failures_table,
    read_groups,
    read_tunings,
)


def run(controller: str, scenario: str, time_s: float | None, contacts: int = 0, **values: Any) -> MeasuredRun:
    measures = {
        "success": time_s is not None,
        "ended": "" if time_s is not None else "ABORTED",
        "text": "",
        "score": None,
        "time_s": time_s or 90.0,
        "simulated_s": 90.0,
        "clearance_min_m": 0.2,
        "jerk_rms_m_s3": 1.0,
        "contacts": contacts,
        "causes": {"it moved into the way": contacts},
        "recoveries": 0,
        "cycle_p50_ms": 0.1,
        "cycle_p99_ms": 0.2,
    }
    return MeasuredRun(controller, "office", scenario, 0, {**measures, **values})


RUNS = [
    *(run("dwa", f"s{i}", 20.0 + i) for i in range(8)),
    *(run("mppi", f"s{i}", 19.0 + i if i else None, contacts=i == 0) for i in range(8)),
]


def test_times_are_of_the_scenarios_that_all_solve() -> None:
    assert common_cases(RUNS) == {(f"s{i}", 0) for i in range(1, 8)}
    dwa, mppi = controllers_table(RUNS).rows
    assert dwa["success"].value == 1.0 and mppi["success"].value == 7 / 8
    assert dwa["time_s"].value == 24.0 and mppi["time_s"].value == 23.0
    assert (dwa["contacts"], mppi["contacts"]) == (0, 1)
    assert mppi["contacts_per_hour"].value == pytest.approx(1 / (8 * 90.0 / 3600.0))
    assert "office: every controller succeeds in 7 of 8" in controllers_notes(RUNS, 0.2)


def test_times_against_the_first_controller() -> None:
    (row,) = differences_table(RUNS).rows
    assert (row["controller"], row["pairs"], row["verdict"]) == ("mppi", 7, "faster")
    assert row["difference"].interval.value == pytest.approx(-1.0)


def test_avoidable_contacts_are_counted_apart() -> None:
    runs = [*RUNS, run("mppi", "s8", 20.0, contacts=3, causes={"unexplained": 2, "seen too late": 1})]
    row = controllers_table(runs).rows[1]
    assert row["avoidable_per_hour"].value == pytest.approx(2 / (9 * 90.0 / 3600.0))
    table = causes_table(runs)
    assert table is not None and [r["controller"] for r in table.rows] == ["mppi"]
    assert [table.rows[0][key] for key in ("unexplained", "seen too late", "it moved into the way")] == [2, 1, 1]
    assert causes_table(RUNS[:8]) is None


def test_failures_are_listed() -> None:
    table = failures_table(RUNS)
    assert table is not None and [r["scenario"] for r in table.rows] == ["s0"]
    assert failures_table(RUNS[:8]) is None


def test_scores_are_shown_where_there_are_any() -> None:
    assert "score" not in [c.key for c in controllers_table(RUNS).columns]
    table = controllers_table([run("dwa", "world 1", 9.0, score=0.5)])
    assert "score" in [c.key for c in table.columns] and table.rows[0]["score"].value == 0.5


@pytest.mark.parametrize("name", CONTROLLERS)
def test_packaged_tunings_use_their_controller(name: str) -> None:
    wanted = {"pure_pursuit": "regulated_pure_pursuit"}.get(name, name)
    for chosen in CONTROLLERS[name]:
        configuration = load_configuration(list(chosen.params))
        assert configuration.local_planner.cls is LOCAL_PLANNERS.get(wanted).cls
        assert [f for f in configuration.findings if f.severity == "error"] == []


def test_packaged_tunings_of_one_kind_have_the_same_robot() -> None:
    """Only the local planner and what belongs to it differ: costs, goals and the simulated robot are the same."""
    for kind in ("with_map", "without_map"):
        robots = [load_configuration(list(getattr(CONTROLLERS[name], kind).params)) for name in CONTROLLERS]
        sims = [robot.navstack.sim for robot in robots]
        assert all(sim == sims[0] for sim in sims)


def test_tunings_of_ones_own() -> None:
    tunings = read_tunings(["dwa", "mine=turtlebot,turtlebot_mppi"])
    assert list(tunings) == ["dwa", "mine"] and tunings["mine"].with_map.params == ("turtlebot", "turtlebot_mppi")
    assert list(read_tunings([])) == list(CONTROLLERS)


def test_groups() -> None:
    groups = read_groups([], 2)
    assert [(g.name, len(g.scenarios)) for g in groups] == [
        ("office", 2),
        ("narrow", 2),
        ("crowd", 2),
        ("warehouse", 2),
    ]
    (group,) = read_groups(["narrow_door"])
    assert group.name == "narrow door"


def test_jerk_does_not_depend_on_the_control_frequency() -> None:
    """x = sin t has the jerk cos t, whose root mean square over whole periods is sqrt(1/2).

    Third differences of a sine at a step h are smaller by (sin(h / 2) / (h / 2))³ = 0.995.
    """
    found: list[float] = []
    for rate in (5.0, 20.0, 50.0):
        times = [i / rate for i in range(int(40.0 * math.pi * rate) + 1)]
        poses = np.array([(math.sin(t), 0.0, 0.0) for t in times])
        found.append(resampled_jerk(np.array(times), poses, 0.2))
    assert found == pytest.approx([0.995 * math.sqrt(0.5)] * 3, rel=0.01)
    assert resampled_jerk(np.zeros(1), np.zeros((1, 3)), 0.2) == 0.0

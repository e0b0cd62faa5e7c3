"""`navstack bench random`: tables of the outcomes, resuming, and the exit code for violations."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.scenario import FOOTPRINTS
from navstack.scenario.footprint_scenarios import footprint_scenario, kind_of
from navstack.studies.jobs import JobResult
from navstack.studies.random_scenarios import RandomTask, footprint_tables, random_tables


def value(number: int, outcome: str, faults: list[str]) -> JobResult:
    fields = {"number": number, "outcome": outcome, "simulated_s": 36.0, "collisions": number, "faults": faults}
    return JobResult(f"random {number}", fields)


def test_tables_count_outcomes_and_list_violations() -> None:
    results = [value(0, "SUCCEEDED ABORTED", []), value(1, "refused START_OCCUPIED", []), value(2, "PREEMPTED", ["oh"])]
    counts, violations = random_tables(results)
    assert {row["what"]: row["count"] for row in counts.rows} == {
        "scenarios": 3,
        "hours simulated": pytest.approx(0.03),
        "with collisions": 2,
        "with violations": 1,
        "goals ended ABORTED": 1,
        "goals ended PREEMPTED": 1,
        "goals ended SUCCEEDED": 1,
        "refused START_OCCUPIED": 1,
    }
    assert violations.rows == [{"number": "2", "fault": "oh"}]
    assert len(random_tables(results[:2])) == 1


@pytest.mark.slow
def test_the_command_runs_saves_and_resumes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["bench", "random", "2", "--first", "5", "--time-limit", "1", "--processes", "1", "--out", str(tmp_path)]
    assert run([*command, "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["count"] == 2 and document["failed"] == []
    before = (tmp_path / "results.jsonl").read_bytes()
    assert run([*command, "--resume"]) == 0
    assert "with violations" in capfd.readouterr().out
    assert (tmp_path / "results.jsonl").read_bytes() == before
    task = RandomTask(5, 1, 1.0)
    assert [task(job.input)["number"] for job in task.jobs()] == [5]


# --- footprints among static obstacles --------------------------------------------------------------------------------


def test_a_footprint_scenario_depends_on_its_number_only() -> None:
    first, second = (footprint_scenario(9).build() for _ in range(2))
    assert first.as_dict() == second.as_dict()
    assert {kind_of(number) for number in range(8)} == {(name, r) for name in FOOTPRINTS for r in (False, True)}


@pytest.mark.slow
def test_no_footprint_touches_an_obstacle(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "random", "24", "--footprints", "--processes", "1", "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["failed"] == [] and list(document["tables"]) == ["footprints"]
    total = document["tables"]["footprints"][-1]
    assert (total["footprint"], total["runs"], total["collisions"]) == ("all", 24, 0)
    assert total["succeeded"] >= 20


def test_collisions_are_listed_with_their_scenario() -> None:
    collision = {"time": 3.25, "pose": [1.0, 2.0, 0.5], "kind": "disc", "index": 0, "at": [1.5, 2.0], "name": ""}
    ends = [("SUCCEEDED", None), ("COLLISION", collision)]
    fields = {"number": 4, "footprint": "L", "reverses": True, "simulated_s": 1800.0}
    results = [JobResult(f"random {s}", {**fields, "state": s, "collision": c}) for s, c in ends]
    counts, collisions = footprint_tables(results)
    assert counts.rows[0] == {
        "footprint": "L",
        "reverses": "yes",
        "runs": 2,
        "succeeded": 1,
        "collisions": 1,
        "hours": 1.0,
    }
    assert collisions.rows == [
        {
            "number": "4",
            "footprint": "L",
            "time": 3.25,
            "pose": "(1.000, 2.000, 0.500)",
            "obstacle": "disc at (1.500, 2.000)",
        }
    ]


def test_footprints_have_their_own_time_limits(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["bench", "random", "1", "--footprints", "--time-limit", "5"]) == 2
    assert "leave --time-limit out" in capfd.readouterr().err

"""`navstack bench random`: tables of the outcomes, resuming, and the exit code for violations."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.bench.random_bench import RandomTask, random_jobs, random_tables
from navstack.cli.app import run
from navstack.jobs import JobResult


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


def test_the_command_runs_saves_and_resumes(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    command = ["bench", "random", "2", "--first", "5", "--time-limit", "1", "--processes", "1", "--out", str(tmp_path)]
    assert run([*command, "--json"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["count"] == 2 and document["failed"] == []
    before = (tmp_path / "results.jsonl").read_bytes()
    assert run([*command, "--resume"]) == 0
    assert "with violations" in capfd.readouterr().out
    assert (tmp_path / "results.jsonl").read_bytes() == before
    job = random_jobs(5, 1)[0]
    assert RandomTask(1.0)(job.input)["number"] == 5

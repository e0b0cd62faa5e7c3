"""The shipped scenarios succeed, and give the same records in any process and any order."""

from __future__ import annotations

import hashlib
from multiprocessing import get_context
from pathlib import Path

import pytest

from navstack.scenario import check_scenario, load_scenario, run_scenario, shipped_scenarios

NAMES = sorted(shipped_scenarios())
DRIVEN_ELSEWHERE = {"car_park", "car_reverse_out", "omni_office"}
"""test_cars.py drives these, with their own parameters."""


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_scenario_is_sound(name: str) -> None:
    findings = check_scenario(shipped_scenarios()[name])
    assert [str(f) for f in findings if f.severity != "info"] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in NAMES if name not in DRIVEN_ELSEWHERE])
def test_a_shipped_scenario_succeeds(name: str) -> None:
    result = run_scenario(load_scenario(shipped_scenarios()[name]), record=False)
    assert [str(v) for v in result.conditions if not v.holds] == []
    assert result.succeeded


def record_of(job: tuple[str, str]) -> tuple[str, str]:
    """Drives a shipped scenario in this process; returns the digest of its record."""
    name, folder = job
    result = run_scenario(load_scenario(shipped_scenarios()[name]))
    assert result.recorder is not None
    files = result.recorder.save(Path(folder))
    return name, hashlib.sha256(files["record"].read_bytes() + files["log"].read_bytes()).hexdigest()


SOME = ("narrow_door", "crossing_pedestrian", "unreachable_goal", "noise")


@pytest.mark.slow
def test_records_are_the_same_in_one_process_and_in_two_in_any_order(tmp_path: Path) -> None:
    here = dict(record_of((name, str(tmp_path / "here" / name))) for name in SOME)
    jobs = [(name, str(tmp_path / "there" / name)) for name in reversed(SOME)]
    with get_context("spawn").Pool(2) as pool:
        there = dict(pool.imap_unordered(record_of, jobs, chunksize=1))
    assert there == here
    assert len(set(here.values())) == len(SOME)

"""A record contains its scenario, and the replay of the run is bit-identical."""

from __future__ import annotations

import copy
import math
from pathlib import Path

import numpy as np
import pytest

from navstack.core import InputError, RecordError
from navstack.explain import replay
from navstack.record import Record
from navstack.scenario import Run, Scenario, run_scenario
from tests.explain.conftest import scenario


def test_a_replayed_run_gives_the_same_bytes(record: Record, run_folder: Path, tmp_path: Path) -> None:
    again = run_scenario(Scenario.from_record(record)).recorder
    assert again is not None
    again.save(tmp_path)
    for name in ("run.npz", "run.log"):
        assert (tmp_path / name).read_bytes() == (run_folder / name).read_bytes()


def test_the_scenario_comes_back(record: Record) -> None:
    before, after = scenario(), Scenario.from_record(record)
    assert (after.start, after.goals, after.obstacles) == (before.start, before.goals, before.obstacles)
    assert (after.seed, after.time_limit_s, after.names) == (before.seed, before.time_limit_s, before.names)
    assert np.array_equal(after.map.data, before.map.data)
    assert after.map.geometry == before.map.geometry
    for part in (
        "move_base",
        "global_costmap",
        "local_costmap",
        "global_planner",
        "local_planner",
        "recoveries",
        "navstack",
    ):
        assert getattr(after.configuration, part) == getattr(before.configuration, part)


def test_a_run_can_be_stepped() -> None:
    run = Run(scenario(), record=False)
    steps = 0
    while run.step():
        steps += 1
    assert run.done
    assert not run.step()
    assert [outcome.state for outcome in run.outcomes] == ["SUCCEEDED", "SUCCEEDED"]
    whole = run_scenario(scenario(), record=False)
    assert whole.simulated_s == run.robot.time
    assert tuple(run.outcomes) == whole.goals


@pytest.mark.parametrize("share", [0.0, 0.3, 0.77, 1.0])
def test_a_replay_has_the_state_of_the_run(record: Record, share: float) -> None:
    t = float(record.times[0] + share * record.duration)
    then = replay(record, t)
    assert then.time == record.times[record.index_at(t)]
    assert then.run.robot.pose == record.pose_at(t)
    for name in ("global", "local"):
        recorded = record.costmap_at(name, t)
        live = then.costmap(name)
        if recorded is None:
            assert live.updated_at is None
            continue
        assert np.array_equal(live.master.data, recorded.data)
        assert live.master.geometry == recorded.geometry


@pytest.mark.parametrize("t", [-1.0, 1e6, math.nan, math.inf])
def test_a_time_outside_the_run_is_refused(record: Record, t: float) -> None:
    with pytest.raises(InputError, match=r"outside the run, which covers 0\.\d+ \.\. \d+\.\d+ s"):
        replay(record, t)


def changed(record: Record, **arrays: np.ndarray) -> Record:
    return Record(copy.deepcopy(record.meta), [], {**record.arrays, **arrays}, record.path)


def test_a_replay_that_differs_is_refused(record: Record) -> None:
    samples = record.samples.copy()
    samples["vx"][20] += 1e-12
    with pytest.raises(RecordError, match=r"made by another version.*vx is") as caught:
        replay(changed(record, samples=samples), float(samples["t"][30]))
    assert caught.value.data["time"] == samples["t"][20]
    replay(changed(record, samples=samples), float(samples["t"][19]))  # up to there it is the same


def test_a_costmap_that_differs_is_refused(record: Record) -> None:
    cells = record.arrays["costmaps/local_cells"].copy()
    cells[0] ^= 1
    with pytest.raises(RecordError, match="the local costmap differs"):
        replay(changed(record, **{"costmaps/local_cells": cells}))


def test_the_version_that_recorded_is_named(record: Record) -> None:
    samples = record.samples.copy()
    samples["x"][3] += 1.0
    other = changed(record, samples=samples)
    other.meta["scenario"]["navstack"] = "0.0.7"
    with pytest.raises(RecordError, match=r"recorded by navstack 0\.0\.7, replayed by"):
        replay(Record(other.meta, [], other.arrays))


def test_samples_after_the_last_goal_are_refused(record: Record) -> None:
    samples = np.concatenate((record.samples, record.samples[-1:]))
    samples["t"][-1] += 0.2
    with pytest.raises(RecordError, match="the run has ended"):
        replay(changed(record, samples=samples))


@pytest.mark.parametrize("key", ["parameters", "seed", "goals", "start"])
def test_a_record_without_its_scenario_is_refused(record: Record, key: str) -> None:
    without = changed(record)
    del without.meta["scenario"][key]
    with pytest.raises(RecordError, match=f"{key} missing"):
        replay(without)


@pytest.mark.parametrize(
    ("key", "value"), [("start", "here"), ("goals", 3), ("parameters", [1]), ("obstacles", [[1.0]])]
)
def test_a_damaged_scenario_is_refused(record: Record, key: str, value: object) -> None:
    damaged = changed(record)
    damaged.meta["scenario"][key] = value
    with pytest.raises(RecordError, match="damaged"):
        replay(damaged)

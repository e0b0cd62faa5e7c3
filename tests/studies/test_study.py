"""The search: reproducible, resumable, pruned; invalid arguments are refused."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from navstack.core import InputError, OutputError
from navstack.studies.evaluation import RunWork
from navstack.studies.jobs import SerialExecutor
from navstack.studies.problem import Trial, best_of, dominates, pareto_front, select_objectives
from navstack.studies.study import Study, open_storage
from tests.studies.bowl import Bowl, problem

importance: dict[str, float] = {}
"""Importance in the last study."""


def run(storage: str, trials: int, *, evaluation: Bowl | None = None, **options: object) -> list[Trial]:
    objectives: tuple[str, ...] = options.pop("objectives", ())  # type: ignore[assignment]
    p = problem(evaluation, objectives=objectives)
    with open_storage(storage) as opened, SerialExecutor(RunWork(p.base, p.evaluation)) as executor:
        study = Study(p, opened, place=storage, **options)  # type: ignore[arg-type]
        study.baseline(executor)
        study.run(executor, trials)
        importance.clear()
        importance.update(study.importance())
        return study.finished()


def fields(trials: list[Trial]) -> list[tuple[object, ...]]:
    return [(t.candidate, t.values, t.complete, t.origin, list(t.outcomes)) for t in trials]


@pytest.mark.slow
@pytest.mark.parametrize("sampler", ["tpe", "cmaes"])
def test_the_same_seed_gives_the_same_trials(tmp_path: Path, sampler: str) -> None:
    first = run(str(tmp_path / "a"), 13, sampler=sampler, seed=3)
    again = run(str(tmp_path / "b"), 13, sampler=sampler, seed=3)
    other = run(str(tmp_path / "c"), 5, sampler=sampler, seed=4)
    assert fields(first) == fields(again)
    assert fields(first)[:5] != fields(other)
    assert len(first) == 13


@pytest.mark.slow
def test_better_values_are_found_and_bad_trials_are_pruned(tmp_path: Path) -> None:
    trials = run(str(tmp_path / "study"), 25)
    p = problem()
    best = best_of(p, trials)
    assert best is not None
    assert best.values[0] > 0.8
    assert best.values[0] == max(t.values[0] for t in trials if t.complete)
    assert any(not t.complete for t in trials)
    # the evaluation ignores vx_samples
    assert list(importance)[-1] == "DWAPlannerROS/vx_samples"
    # the first trial has the current values and is complete
    assert trials[0].origin == "present"
    assert trials[0].complete


@pytest.mark.slow
def test_a_resumed_study_equals_an_uninterrupted_one(tmp_path: Path) -> None:
    run(str(tmp_path / "a"), 5, seed=5)
    in_two = run(str(tmp_path / "a"), 9, seed=5, resume=True)
    at_once = run(str(tmp_path / "b"), 9, seed=5)
    assert fields(in_two) == fields(at_once)


KILLED = """
from pathlib import Path
from tests.studies.bowl import Bowl
from tests.studies.test_study import run
run({storage!r}, 8, evaluation=Bowl(suicide=Path({count!r}), after={after}), seed=2, resume=True)
"""


@pytest.mark.slow
def test_no_trial_is_lost_or_repeated_after_a_kill(tmp_path: Path) -> None:
    storage, count = str(tmp_path / "study.journal"), str(tmp_path / "count")
    script = KILLED.format(storage=storage, count=count, after=11)
    killed = subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parents[2], capture_output=True)
    assert killed.returncode == -9
    # an incomplete line
    with Path(storage).open("a") as file:
        file.write('{"op_code": 5, "worker')
    resumed = run(storage, 8, seed=2, resume=True)
    assert fields(resumed) == fields(run(str(tmp_path / "whole"), 8, seed=2))


@pytest.mark.slow
def test_several_objectives_give_a_pareto_front(tmp_path: Path) -> None:
    names = ("time", "clearance")
    trials = run(str(tmp_path / "study"), 10, objectives=names)
    p = problem(objectives=names)
    front = pareto_front(p, trials)
    assert front
    assert all(t.complete for t in trials)
    for t in front:
        assert not any(dominates(o.values, t.values, p.objectives) for o in trials)
    best = best_of(p, trials)
    assert best is not None
    assert best.values[0] == min(t.values[0] for t in front)


@pytest.mark.slow
def test_a_study_in_a_database(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/study.db"
    run(url, 2, seed=1, single_process=False)
    assert len(run(url, 4, seed=1, single_process=False)) == 4


# --- invalid arguments ---------------------------------------------------------------------------------------------------


def test_a_different_study_is_refused(tmp_path: Path) -> None:
    storage = str(tmp_path / "study")
    run(storage, 2)
    with pytest.raises(InputError, match="add --resume to continue"):
        run(storage, 4)
    with pytest.raises(InputError, match=r"contains a different study: .*seed was 0 and is now 7"):
        run(storage, 4, seed=7, resume=True)
    with pytest.raises(InputError, match="other cases"):
        run(storage, 4, evaluation=Bowl(5), resume=True)
    other = Bowl()
    other.name = "narrow"
    with pytest.raises(InputError, match=r"its suite is \w+, not narrow; repeat .* or give another --out"):
        run(storage, 4, evaluation=other)
    with pytest.raises(InputError, match=r"objectives was \['score'\]"):
        run(storage, 4, objectives=("time",), resume=True)


def test_a_locked_study_is_refused(tmp_path: Path) -> None:
    storage = str(tmp_path / "study")
    with open_storage(storage), pytest.raises(InputError, match="is in use by another process"), open_storage(storage):
        pass


def test_a_read_only_study_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    storage = tmp_path / "study"
    storage.write_text("")
    monkeypatch.setattr("os.access", lambda path, mode: path != storage)  # root can write everywhere
    with pytest.raises(OutputError, match=r"is read-only; make it writable"), open_storage(str(storage)):
        pass


@pytest.mark.parametrize(
    ("storage", "expected"),
    [
        ("notes.txt", "is not a journal of a study"),
        ("folder", "is a folder"),
        ("sqlite:////no/such/place/study.db", "cannot be used"),
        ("nonsense://host/db", "cannot be used"),
    ],
)
def test_invalid_storages(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: str, expected: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("not a journal\n")
    Path("folder").mkdir()
    with pytest.raises(InputError, match=expected), open_storage(storage):
        pass
    assert Path("notes.txt").read_text() == "not a journal\n"
    with (
        pytest.raises(
            OutputError,
            match=r"cannot create the study's folder notes.txt/deeper: .*; choose another one with --storage",
        ),
        open_storage("notes.txt/deeper/study.journal"),
    ):
        pass


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"sampler": "annealing"}, "choose tpe, cmaes, random"),
        ({"sampler": "cmaes", "objectives": ("time", "clearance")}, "CMA-ES supports one objective only"),
    ],
)
def test_invalid_samplers(tmp_path: Path, options: dict[str, object], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        run(str(tmp_path / "study"), 2, **options)


def test_an_unknown_objective() -> None:
    with pytest.raises(InputError, match="choose score, time, clearance, smoothness, success"):
        select_objectives(["speed"])


def test_the_journal_is_json_lines(tmp_path: Path) -> None:
    run(str(tmp_path / "study"), 2)
    assert all(json.loads(line) for line in (tmp_path / "study").read_text().splitlines())

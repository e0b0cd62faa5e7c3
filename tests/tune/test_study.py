"""The search: reproducible, resumable, pruned, and clear about what it cannot do."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from navstack.core.errors import InputError, OutputError
from navstack.jobs import SerialExecutor
from navstack.tune.objectives import chosen, dominates
from navstack.tune.storage import opened
from navstack.tune.study import Study, Trial, best_of, pareto_front
from navstack.tune.work import RunWork
from tests.tune.bowl import Bowl, problem

importance: dict[str, float] = {}
"""Of the last study that was run."""


def run(storage: str, trials: int, *, course: Bowl | None = None, **options: object) -> list[Trial]:
    objectives: tuple[str, ...] = options.pop("objectives", ())  # type: ignore[assignment]
    p = problem(course, objectives=objectives)
    with opened(storage) as kept, SerialExecutor(RunWork(p.base, p.course)) as executor:
        study = Study(p, kept, place=storage, **options)  # type: ignore[arg-type]
        study.baseline(executor)
        study.run(executor, trials)
        importance.clear()
        importance.update(study.importance())
        return study.finished()


def told(trials: list[Trial]) -> list[tuple[object, ...]]:
    return [(t.candidate, t.values, t.complete, t.origin, list(t.outcomes)) for t in trials]


@pytest.mark.parametrize("sampler", ["tpe", "cmaes"])
def test_the_same_seed_gives_the_same_trials(tmp_path: Path, sampler: str) -> None:
    first = run(str(tmp_path / "a"), 13, sampler=sampler, seed=3)
    again = run(str(tmp_path / "b"), 13, sampler=sampler, seed=3)
    other = run(str(tmp_path / "c"), 5, sampler=sampler, seed=4)
    assert told(first) == told(again)
    assert told(first)[:5] != told(other)
    assert len(first) == 13


def test_a_better_place_is_found_and_bad_trials_are_given_up(tmp_path: Path) -> None:
    trials = run(str(tmp_path / "study"), 25)
    p = problem()
    best = best_of(p, trials)
    assert best is not None
    assert best.values[0] > 0.8
    assert best.values[0] == max(t.values[0] for t in trials if t.complete)
    assert any(not t.complete for t in trials)
    # the course does not look at vx_samples
    assert list(importance)[-1] == "DWAPlannerROS/vx_samples"
    # nothing is given up that would have become the best: the present values' own trial is driven in full, being first
    assert trials[0].origin == "present"
    assert trials[0].complete


def test_going_on_gives_the_trials_of_a_run_in_one_go(tmp_path: Path) -> None:
    run(str(tmp_path / "a"), 5, seed=5)
    in_two = run(str(tmp_path / "a"), 9, seed=5, resume=True)
    at_once = run(str(tmp_path / "b"), 9, seed=5)
    assert told(in_two) == told(at_once)


KILLED = """
from pathlib import Path
from tests.tune.bowl import Bowl
from tests.tune.test_study import run
run({storage!r}, 8, course=Bowl(suicide=Path({count!r}), after={after}), seed=2, resume=True)
"""


def test_after_a_kill_no_trial_is_lost_or_doubled(tmp_path: Path) -> None:
    storage, count = str(tmp_path / "study.journal"), str(tmp_path / "count")
    script = KILLED.format(storage=storage, count=count, after=11)
    killed = subprocess.run([sys.executable, "-c", script], cwd=Path(__file__).parents[2], capture_output=True)
    assert killed.returncode == -9
    # a line that the kill cut short
    with Path(storage).open("a") as file:
        file.write('{"op_code": 5, "worker')
    resumed = run(storage, 8, seed=2, resume=True)
    assert told(resumed) == told(run(str(tmp_path / "whole"), 8, seed=2))


def test_several_objectives_give_a_front_of_those_that_succeed(tmp_path: Path) -> None:
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


def test_a_database_holds_a_study_too(tmp_path: Path) -> None:
    url = f"sqlite:///{tmp_path}/study.db"
    run(url, 2, seed=1, alone=False)
    assert len(run(url, 4, seed=1, alone=False)) == 4


# --- what cannot be ---------------------------------------------------------------------------------------------------


def test_a_study_of_something_else_is_refused(tmp_path: Path) -> None:
    storage = str(tmp_path / "study")
    run(storage, 2)
    with pytest.raises(InputError, match="add --resume to go on"):
        run(storage, 4)
    with pytest.raises(InputError, match=r"holds a study of something else: .*seed was 0 and is 7 now"):
        run(storage, 4, seed=7, resume=True)
    with pytest.raises(InputError, match="other cases"):
        run(storage, 4, course=Bowl(5), resume=True)
    with pytest.raises(InputError, match=r"objectives was \['score'\]"):
        run(storage, 4, objectives=("time",), resume=True)


def test_a_locked_study_is_refused(tmp_path: Path) -> None:
    storage = str(tmp_path / "study")
    with opened(storage), pytest.raises(InputError, match="is in use by another navstack"), opened(storage):
        pass


def test_a_read_only_study_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    storage = tmp_path / "study"
    storage.write_text("")
    monkeypatch.setattr("os.access", lambda path, mode: path != storage)  # whoever runs this may be root
    with pytest.raises(OutputError, match=r"is read-only; make it writable"), opened(str(storage)):
        pass


@pytest.mark.parametrize(
    ("storage", "said"),
    [
        ("notes.txt", "is no journal of a study"),
        ("folder", "is a folder"),
        ("sqlite:////no/such/place/study.db", "cannot be used"),
        ("nonsense://host/db", "cannot be used"),
    ],
)
def test_storages_that_cannot_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, storage: str, said: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("notes.txt").write_text("not a journal\n")
    Path("folder").mkdir()
    with pytest.raises(InputError, match=said), opened(storage):
        pass
    assert Path("notes.txt").read_text() == "not a journal\n"
    with (
        pytest.raises(
            OutputError, match=r"cannot make the study's folder notes.txt/deeper: .*; choose another with --storage"
        ),
        opened("notes.txt/deeper/study.journal"),
    ):
        pass


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"sampler": "annealing"}, "choose tpe, cmaes, random"),
        ({"sampler": "cmaes", "objectives": ("time", "clearance")}, "CMA-ES has one objective only"),
    ],
)
def test_searches_that_cannot_be(tmp_path: Path, options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        run(str(tmp_path / "study"), 2, **options)


def test_an_unknown_objective() -> None:
    with pytest.raises(InputError, match="choose score, time, clearance, smoothness, success"):
        chosen(["speed"])


def test_the_journal_is_json_lines(tmp_path: Path) -> None:
    run(str(tmp_path / "study"), 2)
    assert all(json.loads(line) for line in (tmp_path / "study").read_text().splitlines())

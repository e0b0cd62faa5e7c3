"""From a spoiled YAML to files and a report, over scenarios that are driven for real."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.core.errors import InputError, InternalError, OutputError
from navstack.jobs import SerialExecutor
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.tune.comparison import compare
from navstack.tune.courses import Case, RunOutcome
from navstack.tune.given import search_space
from navstack.tune.objectives import chosen
from navstack.tune.report import Circumstances, write_report
from navstack.tune.request import TuneRequest, run_tuning, run_why
from navstack.tune.scenarios import read_place, split
from navstack.tune.sensitivity import sensitivity, steps_of
from navstack.tune.session import Tuning, tune
from navstack.tune.setup import Asked, prepare
from navstack.tune.space import SearchSpace
from navstack.tune.storage import opened
from navstack.tune.study import Study, evaluate
from navstack.tune.work import RunWork
from tests.tune.bowl import Bowl, problem, space
from tests.tune.room import make_room

SPOILED = ("DWAPlannerROS/max_vel_trans=0.12", "DWAPlannerROS/min_vel_trans=0.02")
SPEED = "DWAPlannerROS/max_vel_trans=0.1:0.5"


def test_a_slow_robot_is_tuned_and_the_report_says_so(tmp_path: Path) -> None:
    suite = make_room(tmp_path, names=("a", "b", "c"))
    asked = Asked(("turtlebot",), str(suite), param=(SPEED,), space=None, overrides=SPOILED)
    request = TuneRequest(prepare(asked), tmp_path / "out", trials=3, held_out=0.34, against="turtlebot", workers=1)
    done = run_tuning(request)
    assert done.tuning.found
    assert done.tuning.held_out is not None
    assert done.tuning.held_out.measure("time").difference.interval.value < -2.0
    # the files say it, loaded alone
    tuned = load_configuration(list(done.params))
    assert tuned.local_planner.params.max_vel_trans == done.tuning.candidate[SPEED.partition("=")[0]] > 0.2
    assert tuned.local_planner.params.min_vel_trans == 0.02  # given beforehand, so it is written too
    page = done.report.read_text()
    assert done.tuning.verdict in page
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert page.count("data:image/png;base64,") >= 4
    assert str(tmp_path) not in page
    for picture in (tmp_path / "out").glob("*.png"):
        with Image.open(picture) as image:
            assert len(np.unique(np.asarray(image.convert("L")))) > 10
    told = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert told["found"] is True
    assert len(told["held_out"]["runs"]) == 1
    # nothing is overwritten without being asked
    with pytest.raises(OutputError, match="holds files already"):
        run_tuning(request)


def session(
    tmp_path: Path, course: Bowl, *, sim_time: float, trials: int = 14, objectives: tuple[str, ...] = ()
) -> Tuning:
    p = problem(course, sim_time=sim_time, objectives=objectives)
    with opened(str(tmp_path / "study")) as storage, SerialExecutor(RunWork(p.base, p.course)) as executor:
        return tune(Study(p, storage, seed=1), executor, trials)


def test_nothing_better_is_said_so(tmp_path: Path) -> None:
    course = Bowl(3, hopeless=True)
    tuning = session(tmp_path, course, sim_time=2.0, trials=4)
    assert not tuning.found
    assert "no candidate reached a single goal" in tuning.verdict


class OneNever(Bowl):
    """Its first case cannot be done."""

    def drive(self, case: Case, configuration: Configuration, *, record: bool = False) -> tuple[RunOutcome, None]:
        outcome = super().drive(case, configuration)[0]
        if case.name == "case 0":
            return replace(outcome, success=False, outcome="timeout", score=-1.0), None
        return outcome, None


def test_a_scenario_that_always_fails_is_named(tmp_path: Path) -> None:
    tuning = session(tmp_path, OneNever(4), sim_time=0.6, trials=6)
    assert tuning.never == ["case 0 seed 0"]
    assert "No candidate ever got through case 0 seed 0" in tuning.verdict


def test_values_that_make_no_difference_are_set_back(tmp_path: Path) -> None:
    tuning = session(tmp_path, Bowl(3), sim_time=0.6, trials=10)
    assert tuning.found
    # the bowl does not look at vx_samples
    assert "DWAPlannerROS/vx_samples" not in tuning.candidate
    assert "DWAPlannerROS/sim_time" in tuning.candidate
    assert tuning.training.measure("score").difference.interval.value > 0.3
    assert len(tuning.training.mended) == 3


def test_training_and_held_out_scenarios_are_told_apart() -> None:
    names = [f"s{i}" for i in range(10)]
    train, held = split(names, 0.3, 7)
    assert (len(train), len(held)) == (7, 3)
    assert sorted(train + held) == sorted(names)
    assert split(names, 0.3, 7) == (train, held)
    assert split(names, 0.3, 8) != (train, held)
    assert split(names, 0.0, 7) == (names, [])
    for many, share in ((1, 0.4), (10, 0.01), (10, 1.0), (10, -0.1)):
        with pytest.raises(InputError):
            split(names[:many], share, 0)


def test_barn_worlds_are_a_suite(data_dir: Path) -> None:
    place = read_place(str(data_dir / "barn"))
    assert len(place.names) == 50
    assert place.environment(rough=False) != place.environment(rough=True)


def test_several_objectives_are_reported_as_a_front(tmp_path: Path) -> None:
    tuning = session(tmp_path, Bowl(3), sim_time=0.6, trials=12, objectives=("time", "clearance"))
    assert tuning.found
    assert tuning.best is not None
    assert len(tuning.front) >= 2
    page = write_report(
        tmp_path / "out", tuning, Circumstances("Tuning", "turtlebot", "navstack tune", "By hand."), None
    )
    text = page.read_text()
    assert "<h2>Pareto front</h2>" in text
    for t in tuning.front:
        assert f"<tr><td>{t.number}</td>" in text
    assert {f.name for f in page.parent.glob("*.png")} >= {"pareto.png", "importance.png", "slices.png", "trials.png"}


# --- why --------------------------------------------------------------------------------------------------------------


def test_what_changes_if_one_is_doubled() -> None:
    p = problem(sim_time=1.0)
    with SerialExecutor(RunWork(p.base, p.course)) as executor:
        steps = sensitivity(p.space, executor, p.cases)
    assert [abs(s.effect) for s in steps] == sorted((abs(s.effect) for s in steps), reverse=True)
    by_name = {(s.dimension.name.rpartition("/")[2], s.word): s for s in steps}
    doubled = by_name["sim_time", "doubled"]
    assert doubled.value == 2.0
    assert doubled.effect > 0.2
    assert "DWAPlannerROS/sim_time doubled (1.0 -> 2.0 s): " in doubled.sentence
    assert "success goes from 0% to 100% (4 more succeed, 0 more fail)" in doubled.sentence
    assert "(3 more succeed, 0 more fail)" in by_name["occdist_scale", "halved"].sentence
    assert "nothing changes at all in 4 runs" in by_name["vx_samples", "halved"].sentence


def test_a_run_that_raises_is_not_taken_for_a_bad_one() -> None:
    class Broken(Bowl):
        def drive(self, case: Case, configuration: Configuration, *, record: bool = False) -> tuple[RunOutcome, None]:
            raise ZeroDivisionError("by hand")

    p = problem(Broken(2), sim_time=1.0)
    for ask in (
        lambda executor: sensitivity(p.space, executor, p.cases),
        lambda executor: evaluate(executor, "present", (), p.cases),
    ):
        with (
            SerialExecutor(RunWork(p.base, p.course)) as executor,
            pytest.raises(
                InternalError, match=r"present, case 0 seed 0: this run could not be driven: ZeroDivisionError"
            ),
        ):
            ask(executor)


def test_a_choice_is_set_to_each_of_the_others() -> None:
    base = load_configuration(["turtlebot"])
    (dimension,) = search_space(base, params=["DWAPlannerROS/use_dwa"])
    ((word, value),) = steps_of(dimension)
    assert (word, value) == ("set", False)
    with SerialExecutor(RunWork(base, Bowl(2))) as executor:
        (step,) = sensitivity(SearchSpace((dimension,)), executor, Bowl(2).cases)
    assert step.what == "set to false"
    assert step.sentence.startswith("DWAPlannerROS/use_dwa set (true -> false)")


def test_nothing_is_worse_than_few_slow_successes() -> None:
    slow = [{"success": True, "time_s": 500.0, "jerk": 2.0}, *[{"success": False, "time_s": 9.0, "jerk": 0.0}] * 9]
    (time,) = chosen(["time"])
    (smooth,) = chosen(["smoothness"])
    for objective in (time, smooth):
        assert objective.better(objective.of(slow), objective.of(slow[1:]))


def test_steps_stay_what_the_parameter_is() -> None:
    base = load_configuration(["turtlebot"], overrides=["DWAPlannerROS/vx_samples=3", "DWAPlannerROS/sim_time=1.0"])
    by_name = {d.name: d for d in space(base)}
    assert steps_of(by_name["DWAPlannerROS/vx_samples"]) == [("halved", 2), ("doubled", 6)]


def test_why_writes_a_page(tmp_path: Path) -> None:
    suite = make_room(tmp_path)
    setup = prepare(Asked(("turtlebot",), str(suite), param=("DWAPlannerROS/max_vel_trans=0.1:0.5",)))
    steps, page = run_why(setup, tmp_path / "out", workers=1)
    assert steps[0].word == "halved"
    assert "longer" in steps[0].sentence
    # words and picture agree: where an interval of the score excludes nothing, no step is said to be without effect
    for step in steps:
        shown = step.comparison.measure("score").difference.shown
        assert not (shown and "but no effect is shown" in step.sentence)
    assert steps[0].sentence.split(":")[0] in page.read_text().replace("&gt;", ">")
    assert (tmp_path / "out" / "why.png").is_file()


def test_comparison_of_equal_runs_shows_no_difference() -> None:
    p = problem(sim_time=2.0)
    with SerialExecutor(RunWork(p.base, p.course)) as executor:
        runs = evaluate(executor, "a", (), p.cases)
    made = compare(p.cases, runs, runs)
    assert made.measure("score").verdict == "no difference shown"
    assert (made.mended, made.broken) == ([], [])

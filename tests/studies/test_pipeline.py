"""From detuned parameters to files and a report, with simulated scenarios."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.core import InputError, InternalError, OutputError
from navstack.parameters import Configuration, RewrittenFiles, load_configuration
from navstack.parameters.yaml_rewrite import ValueChange
from navstack.studies.comparison import Case, compare_outcomes
from navstack.studies.evaluation import RunOutcome, RunWork, evaluate
from navstack.studies.jobs import SerialExecutor
from navstack.studies.pipeline import TuneRequest, run_sensitivity, run_tuning
from navstack.studies.problem import select_objectives
from navstack.studies.report import ReportHeader, tuning_page, write_report
from navstack.studies.search_space import SearchSpace
from navstack.studies.search_space_parser import parse_search_space
from navstack.studies.sensitivity import sensitivity, values_to_try
from navstack.studies.setup import SearchOptions, prepare
from navstack.studies.study import Study, open_storage
from navstack.studies.suites import read_suite, split
from navstack.studies.tuning import TuningResult, tune
from tests.studies.bowl import Bowl, problem, space
from tests.studies.room import make_room

DETUNED = ("DWAPlannerROS/max_vel_trans=0.12", "DWAPlannerROS/min_vel_trans=0.02")
SPEED = "DWAPlannerROS/max_vel_trans=0.1:0.5"


@pytest.mark.slow
def test_a_detuned_slow_robot_is_tuned_and_reported(tmp_path: Path) -> None:
    suite = make_room(tmp_path, names=("a", "b", "c"))
    options = SearchOptions(("turtlebot",), str(suite), param=(SPEED,), space=None, overrides=DETUNED)
    request = TuneRequest(prepare(options), tmp_path / "out", trials=3, held_out=0.34, against="turtlebot", workers=1)
    output = run_tuning(request)
    assert output.tuning.found
    assert output.tuning.held_out is not None
    assert output.tuning.held_out.measure("time").difference.interval.value < -2.0
    # the files alone contain the new values
    tuned = load_configuration(list(output.params))
    assert tuned.local_planner.params.max_vel_trans == output.tuning.candidate[SPEED.partition("=")[0]] > 0.2
    assert tuned.local_planner.params.min_vel_trans == 0.02  # an override of the command line is written too
    page = output.report.read_text()
    assert output.tuning.verdict in page
    assert not re.search(r'(?:src|href)="(?!data:)', page)
    assert page.count("data:image/png;base64,") >= 4
    assert str(tmp_path) not in page
    for picture in (tmp_path / "out").glob("*.png"):
        with Image.open(picture) as image:
            assert len(np.unique(np.asarray(image.convert("L")))) > 10
    document = json.loads((tmp_path / "out" / "tune.json").read_text())
    assert document["found"] is True
    assert len(document["held_out"]["runs"]) == 1
    # existing files are not overwritten
    with pytest.raises(OutputError, match="contains files, which are not overwritten"):
        run_tuning(request)


def run_tune(
    tmp_path: Path, evaluation: Bowl, *, sim_time: float, trials: int = 14, objectives: tuple[str, ...] = ()
) -> TuningResult:
    p = problem(evaluation, sim_time=sim_time, objectives=objectives)
    with open_storage(str(tmp_path / "study")) as storage, SerialExecutor(RunWork(p.base, p.evaluation)) as executor:
        return tune(Study(p, storage, seed=1), executor, trials)


def test_no_better_parameters(tmp_path: Path) -> None:
    evaluation = Bowl(3, hopeless=True)
    tuning = run_tune(tmp_path, evaluation, sim_time=2.0, trials=4)
    assert not tuning.found
    assert "no candidate reached a goal" in tuning.verdict


class OneInfeasible(Bowl):
    """Its first case is infeasible."""

    def drive(self, case: Case, configuration: Configuration, *, record: bool = False) -> tuple[RunOutcome, None]:
        outcome = super().drive(case, configuration)[0]
        if case.name == "case 0":
            return replace(outcome, success=False, outcome="timeout", score=-1.0), None
        return outcome, None


@pytest.mark.slow
def test_a_scenario_that_always_fails_is_named(tmp_path: Path) -> None:
    tuning = run_tune(tmp_path, OneInfeasible(4), sim_time=0.6, trials=6)
    assert tuning.never_solved == ["case 0 seed 0"]
    assert "No candidate succeeded in case 0 seed 0" in tuning.verdict


@pytest.mark.slow
def test_values_that_make_no_difference_are_reverted(tmp_path: Path) -> None:
    tuning = run_tune(tmp_path, Bowl(3), sim_time=0.6, trials=10)
    assert tuning.found
    # the bowl ignores vx_samples
    assert "DWAPlannerROS/vx_samples" not in tuning.candidate
    assert "DWAPlannerROS/sim_time" in tuning.candidate
    assert tuning.training.measure("score").difference.interval.value > 0.3
    assert len(tuning.training.fixed) == 3


def test_split_into_training_and_held_out_scenarios() -> None:
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
    suite = read_suite(str(data_dir / "barn"))
    assert len(suite.names) == 50
    assert suite.environment(rough=False) != suite.environment(rough=True)


@pytest.mark.slow
def test_several_objectives_are_reported_as_a_front(tmp_path: Path) -> None:
    tuning = run_tune(tmp_path, Bowl(3), sim_time=0.6, trials=12, objectives=("time", "clearance"))
    assert tuning.found
    assert tuning.best is not None
    assert len(tuning.front) >= 2
    page = write_report(
        tmp_path / "out", tuning, ReportHeader("Tuning", "turtlebot", "navstack tune", "Summary."), None
    )
    text = page.read_text()
    assert "<h2>Pareto front</h2>" in text
    for t in tuning.front:
        assert f"<tr><td>{t.number}</td>" in text
    assert {f.name for f in page.parent.glob("*.png")} >= {"pareto.png", "importance.png", "slices.png", "trials.png"}


# --- sensitivity ------------------------------------------------------------------------------------------------------


def test_sensitivity_to_halving_and_doubling() -> None:
    p = problem(sim_time=1.0)
    with SerialExecutor(RunWork(p.base, p.evaluation)) as executor:
        found = sensitivity(p.space, executor, p.cases)
    assert [abs(one.effect) for one in found] == sorted((abs(one.effect) for one in found), reverse=True)
    by_name = {(one.dimension.name.rpartition("/")[2], one.word): one for one in found}
    doubled = by_name["sim_time", "doubled"]
    assert doubled.value == 2.0
    assert doubled.effect > 0.2
    assert "DWAPlannerROS/sim_time doubled (1.0 -> 2.0 s): " in doubled.sentence
    assert "success changes from 0% to 100% (4 more succeed, 0 more fail)" in doubled.sentence
    assert "(3 more succeed, 0 more fail)" in by_name["occdist_scale", "halved"].sentence
    assert "no change in 4 runs" in by_name["vx_samples", "halved"].sentence


def test_a_run_that_raises_is_an_error() -> None:
    class Broken(Bowl):
        def drive(self, case: Case, configuration: Configuration, *, record: bool = False) -> tuple[RunOutcome, None]:
            raise ZeroDivisionError("on purpose")

    p = problem(Broken(2), sim_time=1.0)
    for ask in (
        lambda executor: sensitivity(p.space, executor, p.cases),
        lambda executor: evaluate(executor, "present", (), p.cases),
    ):
        with (
            SerialExecutor(RunWork(p.base, p.evaluation)) as executor,
            pytest.raises(
                InternalError, match=r"present, case 0 seed 0: this run could not be driven: ZeroDivisionError"
            ),
        ):
            ask(executor)


def test_a_choice_is_set_to_each_of_the_others() -> None:
    base = load_configuration(["turtlebot"])
    (dimension,) = parse_search_space(base, params=["DWAPlannerROS/use_dwa"])
    ((word, value),) = values_to_try(dimension)
    assert (word, value) == ("set", False)
    with SerialExecutor(RunWork(base, Bowl(2))) as executor:
        (step,) = sensitivity(SearchSpace((dimension,)), executor, Bowl(2).cases)
    assert step.what == "set to false"
    assert step.sentence.startswith("DWAPlannerROS/use_dwa set (true -> false)")


def test_no_success_is_worse_than_few_slow_successes() -> None:
    slow = [{"success": True, "time_s": 500.0, "jerk": 2.0}, *[{"success": False, "time_s": 9.0, "jerk": 0.0}] * 9]
    (time,) = select_objectives(["time"])
    (smooth,) = select_objectives(["smoothness"])
    for objective in (time, smooth):
        assert objective.better(objective.of(slow), objective.of(slow[1:]))


def test_perturbed_integers_are_integers() -> None:
    base = load_configuration(["turtlebot"], overrides=["DWAPlannerROS/vx_samples=3", "DWAPlannerROS/sim_time=1.0"])
    by_name = {d.name: d for d in space(base)}
    assert values_to_try(by_name["DWAPlannerROS/vx_samples"]) == [("halved", 2), ("doubled", 6)]


@pytest.mark.slow
def test_sensitivity_report(tmp_path: Path) -> None:
    suite = make_room(tmp_path)
    setup = prepare(SearchOptions(("turtlebot",), str(suite), param=("DWAPlannerROS/max_vel_trans=0.1:0.5",)))
    found, page = run_sensitivity(setup, tmp_path / "out", workers=1)
    assert found[0].word == "halved"
    assert "longer" in found[0].sentence
    # sentence and chart agree
    for one in found:
        shown = one.comparison.measure("score").difference.shown
        assert not (shown and "but no effect is shown" in one.sentence)
    assert found[0].sentence.split(":")[0] in page.read_text().replace("&gt;", ">")
    assert (tmp_path / "out" / "why.png").is_file()


def test_comparison_of_equal_runs_shows_no_difference() -> None:
    p = problem(sim_time=2.0)
    with SerialExecutor(RunWork(p.base, p.evaluation)) as executor:
        runs = evaluate(executor, "a", (), p.cases)
    made = compare_outcomes(p.cases, runs, runs)
    assert made.measure("score").verdict == "no difference shown"
    assert (made.fixed, made.broken) == ([], [])


def test_the_report_does_not_contradict_itself(tmp_path: Path) -> None:
    """A scenario that the result solves was solved; few groups and the importance of reverted parameters are explained."""
    tuning = run_tune(tmp_path, OneInfeasible(4), sim_time=0.6, trials=6)
    solved = tuple({**o, "success": True} for o in tuning.training.after)
    tuning = replace(
        tuning,
        training=replace(tuning.training, after=solved),
        reverted=("DWAPlannerROS/vx_samples",),
        importance={"DWAPlannerROS/vx_samples": 0.29},
    )
    assert tuning.never_solved == [] and "No candidate succeeded" not in tuning.verdict
    header = ReportHeader("Tuning", "turtlebot", "navstack tune", "Summary.")
    text = "\n".join(
        tuning_page(
            tuning, header, RewrittenFiles({}, (), (ValueChange("DWAPlannerROS/sim_time", 1.0, 1.5, "", True),)), {}, ()
        )
    )
    assert "DWAPlannerROS/vx_samples (importance 29%). The importance describes the whole range" in text
    assert "Few scenarios (score 4, success 4" in text

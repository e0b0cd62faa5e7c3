"""`navstack sweep` and `navstack tune` at the command line: output and error messages."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run
from navstack.studies.jobs import SerialExecutor
from tests.studies.room import make_room


@pytest.mark.slow
def test_sweep_prints_a_ranking_and_writes_lines(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    suite = make_room(tmp_path)
    options = [
        "--suite",
        str(suite),
        "--param",
        "DWAPlannerROS/max_vel_trans=0.2:0.5",
        "--method",
        "grid",
        "--points",
        "2",
    ]
    code = run(["sweep", *options, "--workers", "1", "--out", str(tmp_path / "out"), "--json"])
    document = json.loads(capsys.readouterr().out)
    assert code == 0
    assert document["runs"] == 4
    assert document["ranking"][0]["values"] == {"DWAPlannerROS/max_vel_trans": 0.5}
    assert document["ranking"][0]["success"] == 1.0
    lines = (tmp_path / "out" / "runs.jsonl").read_text().splitlines()
    assert len(lines) == 5
    assert (
        run(["sweep", *options, "--workers", "1", "--out", str(tmp_path / "out")]) == 2
    )  # existing results are not overwritten
    assert run(["sweep", *options, "--workers", "1", "--out", str(tmp_path / "out"), "--resume"]) == 0
    assert "max_vel_trans 0.5" in capsys.readouterr().out


def test_a_sweep_reports_runs_without_a_result(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr("navstack.studies.evaluation.ScenarioEvaluation.drive", fail)
    monkeypatch.setattr("navstack.studies.sweep.ProcessExecutor", lambda work, workers: SerialExecutor(work))
    options = ["--suite", str(make_room(tmp_path)), "--param", "sim_time=1:2", "--samples", "1"]
    assert run(["sweep", *options, "--out", str(tmp_path / "out"), "--json"]) == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)["ranking"][0]["errors"] == 2
    assert "gave no result: ZeroDivisionError: on purpose" in captured.err


@pytest.mark.slow
@pytest.mark.parametrize("command", ["tune", "sweep"])
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--param", "DWAPlannerROS/sim_tme=1:2"], 'did you mean "DWAPlannerROS/sim_time"?'),
        (["--param", "DWAPlannerROS/sim_time=2:1"], "is empty"),
        (["--space", "dwaa.yaml"], "there is no such file"),
        (["--suite", "offfice"], 'did you mean "office"?'),
        (["--suite", "barn"], "give the folder of their worlds.npz"),
        (["--params", "turtlebott"], 'did you mean "turtlebot"?'),
        (["--scenario", "acros"], 'did you mean "across"?'),
        (["--keep", "nonsense"], "no parameter in use is named"),
        (["--set", "DWAPlannerROS/sim_time=-1"], "sim_time"),
        (["--seeds", "0"], "--seeds"),
    ],
)
def test_wrong_input(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str, options: list[str], expected: str
) -> None:
    suite = [] if "--suite" in options else ["--suite", str(make_room(tmp_path))]
    out = tmp_path / "out"
    assert run([command, *suite, "--workers", "1", "--out", str(out), *options, "--json"]) == 2
    message = json.loads(capsys.readouterr().out)["error"]["message"]
    assert expected in message
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--objective", "speed"], "choose score, time"),
        (["--sampler", "annealing"], "choose tpe"),
        (["--held-out", "1"], "give a share from 0 to below 1"),
        (["--storage", "nonsense://x"], "cannot be used"),
        (["--against", "nobody"], '"nobody" is not a file, folder or packaged set'),
    ],
)
def test_wrong_tuning_options(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], expected: str
) -> None:
    suite = make_room(tmp_path)
    assert (
        run(["tune", "--suite", str(suite), "--workers", "1", "--out", str(tmp_path / "out"), *options, "--json"]) == 2
    )
    assert expected in json.loads(capsys.readouterr().out)["error"]["message"]
    assert not list((tmp_path / "out").glob("*.html"))


def test_scenarios_that_cannot_start(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    suite = make_room(tmp_path)
    for file in suite.glob("*.yaml"):
        file.write_text(file.read_text().replace("[0.6, 1.0, 0]", "[0.05, 1.0, 0]"))
    assert (
        run(
            [
                "tune",
                "--suite",
                str(suite),
                "--held-out",
                "0",
                "--workers",
                "1",
                "--out",
                str(tmp_path / "out"),
                "--json",
            ]
        )
        == 2
    )
    assert (
        "no scenario can be driven with these parameters: " in json.loads(capsys.readouterr().out)["error"]["message"]
    )


@pytest.mark.parametrize(
    ("module", "command", "package"),
    [
        ("optuna", ["tune"], "optuna"),
        ("ruamel.yaml", ["tune"], "ruamel.yaml"),
        ("distributed", ["sweep", "--scheduler", "tcp://127.0.0.1:1", "--samples", "2"], "dask[distributed]"),
    ],
)
def test_without_the_extra(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    module: str,
    command: list[str],
    package: str,
) -> None:
    monkeypatch.setitem(__import__("sys").modules, module, None)
    suite = make_room(tmp_path)
    assert run([command[0], "--suite", str(suite), "--out", str(tmp_path / "out"), *command[1:], "--json"]) == 2
    message = json.loads(capsys.readouterr().out)["error"]["message"]
    assert f"needs {package}, which is not installed; install the extra `tune`: pip install '.[tune]'" in message


def test_an_interval_stays_within_the_possible_range() -> None:
    from navstack.studies.comparison import Case, compare_outcomes

    def outcome(score: float) -> dict[str, object]:
        return {"success": True, "score": score, "time_s": 1.0 / score, "clearance_m": 0.1, "jerk": 1.0, "error_m": 0.0}

    cases = [Case("a", 0), Case("b", 0)]
    before = {cases[0].key: outcome(0.99), cases[1].key: outcome(0.02)}
    after = {cases[0].key: outcome(0.02), cases[1].key: outcome(0.99)}
    compared = compare_outcomes(cases, before, after)
    score, time = compared.measure("score"), compared.measure("time")
    assert (score.before.low, score.before.high) == (-1.0, 1.0)
    assert (score.difference.interval.low, score.difference.interval.high) == (-2.0, 2.0)
    assert time.before.low == 0.0


def test_nothing_improved_writes_nothing_and_failures_have_reasons() -> None:
    from types import SimpleNamespace

    from navstack.cli.tune import failed_texts
    from navstack.studies.comparison import Case, compare_outcomes
    from navstack.studies.tuning import TuningResult

    def outcome(score: float, text: str = "") -> dict[str, object]:
        how = {"success": not text, "outcome": "timeout" if text else "success", "text": text}
        return {**how, "score": score, "time_s": 9.0, "clearance_m": 0.1, "jerk": 1.0, "error_m": 0.0}

    cases = [Case(name, 0) for name in "abc"]
    keys = [case.key for case in cases]
    before = dict(zip(keys, map(outcome, (0.5, 0.5, 0.5))))
    worse = dict(zip(keys, (outcome(0.4), outcome(0.5), outcome(-1.0, "GOAL_TIME_LIMIT: too late"))))
    comparison = compare_outcomes(cases, before, worse)
    given = {"trials": (), "best": None, "reverted": (), "training": comparison, "importance": {}, "front": ()}
    tuning = TuningResult(problem=SimpleNamespace(), candidate={"x": 1.0}, held_out=comparison, against=None, **given)
    assert tuning.found and not tuning.improved
    assert "so no parameters are written" in tuning.verdict
    assert "1 of 3 held-out runs fail: 1 timeout." in tuning.verdict
    assert failed_texts(comparison) == ["c seed 0: GOAL_TIME_LIMIT: too late"]

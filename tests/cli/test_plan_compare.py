"""`navstack plan --compare`: several planners, one table, one picture, one list."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run

QUERY = ["plan", "office", "--start", "0.8,7.45", "--goal", "22.2,7.45"]


@pytest.mark.slow
def test_list_and_picture(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run([*QUERY, "--compare", "navfn, astar,theta_star,astar", "--json", "--out", str(tmp_path)]) == 0
    documents = json.loads(capfd.readouterr().out)
    assert [d["planner"] for d in documents] == ["navfn", "astar", "theta_star"]
    by_name = {d["planner"]: d for d in documents}
    assert by_name["theta_star"]["cost"] <= by_name["astar"]["cost"]
    assert all(0.1 < d["clearance_m"] < 2.0 and d["time_ms"] > 0.0 for d in documents)
    assert json.loads((tmp_path / "plan.json").read_text()) == documents
    assert (tmp_path / "plan.png").stat().st_size > 10_000


def test_table_with_a_planner_that_finds_no_plan(capfd: pytest.CaptureFixture[str]) -> None:
    query = [*QUERY[:2], "--start", "0.8,7.45", "--goal", "15.0,12.0"]  # on a table
    assert run([*query, "--compare", "carrot_planner,astar"]) == 1  # the plan of the carrot passes through walls
    captured = capfd.readouterr()
    assert "no plan" in captured.out
    assert "carrot_planner: the path crosses" in captured.err
    assert "astar: the goal (15.000, 12.000) is in a cell of cost lethal" in captured.err


@pytest.mark.slow
def test_parameter_sets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    """A file over --params, a value of the planner, and a packaged set in the place of --params."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scale.yaml").write_text("NavfnROS: {default_tolerance: 0.1}\nglobal_costmap: {robot_radius: 0.3}\n")
    entries = ["navfn", "navfn:scale.yaml", "astar:cost_factor=3.0", "navfn:omni_dwa", ":omni_dwa"]
    assert run([*QUERY, "--compare", ",".join(entries), "--json", "--out", "out"]) == 0
    documents = json.loads(capfd.readouterr().out)
    # the planner of omni_dwa is navfn: the last two are one
    assert [d["candidate"] for d in documents] == entries[:4]
    plain, scaled, _, omni = documents
    assert scaled["clearance_m"] > plain["clearance_m"]
    assert omni["length_m"] != plain["length_m"]
    assert [d["cusps"] for d in documents] == [None] * 4
    assert [d["smoother"] for d in documents] == [None] * 4
    repeated = [word for entry in entries for word in ("--compare", entry)]
    assert run([*QUERY, *repeated]) == 0
    assert "\n :scale.yaml " in capfd.readouterr().out


@pytest.mark.parametrize(
    "arguments",
    [
        ["--compare", "navfn,astr"],
        ["--compare", ","],
        ["--compare", "astar", "--planner", "navfn"],
        ["--compare", "navfn:"],
        ["--compare", ":"],
        ["--compare", "navfn:turtlebot:omni_dwa"],
        ["--compare", "navfn:none.yaml"],
        ["--compare", "navfn:=1"],
    ],
)
def test_invalid_input_gives_one_message(arguments: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert run([*QUERY, *arguments]) == 2
    err = capfd.readouterr().err
    assert err.count("error:") == 1
    assert "Traceback" not in err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (
            ["--compare", "astar,navfn:default_tolerance=-1"],
            2,
            "--compare navfn:default_tolerance=-1: default_tolerance = -1",
        ),
        (
            ["--compare", "navfn:default_tolerance=far"],
            2,
            '--compare navfn:default_tolerance=far: default_tolerance = "far"',
        ),
        (
            ["--compare", "navfn:default_tolerence=1"],
            2,
            "--compare navfn:default_tolerence=1: NavfnROS/default_tolerence = 1 sets nothing",
        ),
        (["--footprint", "0x1"], 2, '--footprint "0x1" cannot be used: it is neither a box'),
        (["--footprint", "[[0,0],[1,1]]"], 2, "cannot be used: a footprint needs at least three points"),
        (
            ["--footprint", "[[0,0],[1,1],[2"],
            2,
            'cannot be used: footprint = "[[0,0],[1,1],[2" is not a list of points',
        ),
        (["--footprint", "[[1,1],[1,2],[2,2],[2,1]]"], 0, "warning: --footprint: the footprint does not contain"),
        (
            ["--compare", "navfn,navfn+simpel"],
            2,
            '--compare navfn+simpel: unknown smoother "simpel"; did you mean "simple"?',
        ),
        (["--compare", "navfn+"], 2, '--compare "navfn+" is not PLANNER[+SMOOTHER]'),
        (["--smoother", "simpel"], 2, 'unknown smoother "simpel"; did you mean "simple"?'),
    ],
)
def test_messages_name_the_option(
    arguments: list[str], code: int, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert run([*QUERY, *arguments]) == code
    err = capfd.readouterr().err
    assert " ".join(err.split()).count(message) == 1
    assert "--set" not in err


@pytest.mark.slow
def test_each_entry_may_have_a_smoother(capfd: pytest.CaptureFixture[str]) -> None:
    compare = "navfn+simple,navfn + constrained:default_tolerance=0.1,navfn"
    assert run([*QUERY, "--compare", compare, "--smoother", "savitzky_golay", "--json"]) == 0
    documents = json.loads(capfd.readouterr().out)
    assert [d["smoother"] for d in documents] == ["simple", "constrained", "savitzky_golay"]
    assert len({d["length_m"] for d in documents}) == 3


@pytest.mark.slow
def test_the_smoother_is_named_and_timed(capfd: pytest.CaptureFixture[str]) -> None:
    assert run([*QUERY, "--compare", "navfn,astar", "--smoother", "nav2_smoother::SimpleSmoother", "--json"]) == 0
    documents = json.loads(capfd.readouterr().out)
    assert [(d["candidate"], d["smoother"]) for d in documents] == [
        ("navfn + simple", "simple"),
        ("astar + simple", "simple"),
    ]


def test_parameters_are_an_argument_of_check(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "--params", "turtlebot"]) == 2
    assert "Give it without --params: navstack check PARAMS..|SCENARIO.yaml" in capfd.readouterr().err


@pytest.mark.parametrize("option", ["--planner", "--compare"])
def test_a_plan_through_walls_is_no_success(option: str, capfd: pytest.CaptureFixture[str]) -> None:
    query = [*QUERY[:2], "--start", "0.8,7.45", "--goal", "20.0,13.0"]
    assert run([*query, option, "carrot_planner"]) == 1
    assert "lethal cells, the first after" in capfd.readouterr().err
    assert run([*query, option, "carrot_planner", "--json"]) == 1
    found = json.loads(capfd.readouterr().out)
    document = found[0] if isinstance(found, list) else found
    assert document["lethal_cells"] > 4
    assert 0.0 < document["first_lethal_m"] < document["length_m"]
    assert run([*query, option, "navfn", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    document = found[0] if isinstance(found, list) else found
    assert (document["lethal_cells"], document["first_lethal_m"]) == (0, None)

"""The commands with valid input."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from PIL import Image

from navstack import __version__
from navstack.cli.app import run


@pytest.fixture
def in_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_simulate_without_arguments(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate"]) == 0
    out = capfd.readouterr().out
    assert out.count("SUCCEEDED") == 3
    folder = in_folder / "navstack_run"
    assert {p.name for p in folder.iterdir()} == {"run.npz", "run.log", "run.png", "summary.json"}
    summary = json.loads((folder / "summary.json").read_text())
    assert [g["state"] for g in summary["goals"]] == ["SUCCEEDED"] * 3
    assert summary["collisions"] == 0
    with Image.open(folder / "run.png") as picture:
        assert min(picture.size) > 400


@pytest.mark.slow
def test_simulate_prints_only_json_to_stdout(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code = run(["simulate", "--start", "3,3", "--goal", "4,3", "--json", "--seed", "7", "--out", "out"])
    captured = capfd.readouterr()
    document = json.loads(captured.out)
    assert code == (0 if document["goals"][0]["state"] == "SUCCEEDED" else 1)
    assert set(document) == {
        "success",
        "conditions",
        "metrics",
        "goals",
        "simulated_s",
        "wall_s",
        "real_time_factor",
        "collisions",
        "seed",
        "warnings",
        "advice",
        "files",
    }
    assert document["seed"] == 7
    wanted = "goal state text error_code error_name time_s path_length_m distance_left_m yaw_left_rad recoveries"
    assert set(wanted.split()) <= set(document["goals"][0])
    for name in document["files"].values():
        assert Path(name).is_file()


@pytest.mark.slow
def test_plan_json_and_files(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from navstack.scenario import load_places

    office = load_places("office")
    start, goal = (f"{p.x},{p.y},{p.yaw}" for p in (office.start, office.goals[0]))
    assert run(["plan", "office", "--start", start, "--goal", goal, "--json", "--out", "out"]) == 0
    document = json.loads(capfd.readouterr().out)
    assert {"planner", "length_m", "cost", "time_ms", "cells_expanded", "poses"} <= set(document)
    assert document["poses"][-1] == pytest.approx(list(office.goals[0]))
    assert document["length_m"] >= office.start.distance_to(office.goals[0]) - 0.1
    assert {p.name for p in (in_folder / "out").iterdir()} == {"plan.png", "plan.json"}
    assert json.loads(Path("out/plan.json").read_text())["poses"] == document["poses"]


@pytest.mark.slow
def test_plan_with_another_planner(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from navstack.scenario import load_places

    office = load_places("office")
    start, goal = (f"{p.x},{p.y}" for p in (office.start, office.goals[0]))
    for planner in ("global_planner", "navfn/NavfnROS"):
        assert run(["plan", "office", "--start", start, "--goal", goal, "--planner", planner, "--json"]) == 0
        assert json.loads(capfd.readouterr().out)["planner"] in ("global_planner", "navfn")


@pytest.mark.slow
def test_plot_reproduces_the_picture(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    run(["simulate", "--start", "3,3", "--goal", "4,3", "--out", "run"])
    first = Path("run/run.png").read_bytes()
    Path("run/run.png").unlink()
    capfd.readouterr()
    assert run(["plot", "run"]) == 0
    assert Path("run/run.png").read_bytes() == first
    assert run(["plot", "run", "--out", "again.svg", "--animate", "--json"]) == 0
    files = json.loads(capfd.readouterr().out.splitlines()[-1])["files"]
    assert Path("again.svg").read_text().lstrip().startswith("<?xml")
    with Image.open(files["animation"]) as movie:
        assert getattr(movie, "n_frames", 1) > 1


def test_check_accepts_the_turtlebot(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["check", "turtlebot"]) == 0
    assert "0 errors" in capfd.readouterr().out
    assert run(["check", "turtlebot", "--json"]) == 0
    for finding in json.loads(capfd.readouterr().out)["findings"]:
        wanted = {"severity", "rule", "file", "line", "column", "key", "message", "suggestion"}
        assert wanted <= set(finding)


def test_info(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert found["versions"]["navstack"] == __version__
    assert {"clinic", "office", "maze", "warehouse"} <= set(found["maps"])
    assert "turtlebot" in found["parameters"]
    planners = {p["name"]: p["aliases"] for p in found["plugins"]["global planner"]}
    assert "navfn/NavfnROS" in planners["navfn"]
    assert run(["info"]) == 0
    assert "navfn/NavfnROS" in capfd.readouterr().out


def test_python_minus_m() -> None:
    out = subprocess.run([sys.executable, "-m", "navstack", "--version"], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == f"navstack {__version__}"


def test_info_lists_maps_scenarios_and_suites(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "--json"]) == 0
    found = json.loads(capfd.readouterr().out)
    assert (
        {"office", "maze"} <= set(found["maps"]) and "narrow_door" in found["scenarios"] and "crowd" in found["suites"]
    )
    assert run(["info"]) == 0
    shown = capfd.readouterr().out
    assert "base_local_planner/TrajectoryPlannerROS" in shown  # in full, also on 80 columns
    assert "narrow_door" in shown


def test_compilation_is_announced_without_a_terminal(
    in_folder: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def compiled(report: Callable[[], None]) -> Generator[None]:
        report()
        report()  # another kernel, later
        yield

    monkeypatch.setattr("navstack.core.compilation_reported", compiled)
    assert run(["plan", "office", "--start", "0.8,7.45", "--goal", "3,7.45", "--json"]) == 0
    captured = capfd.readouterr()
    assert captured.err.count("note: compiling kernels, once per machine") == 1
    assert json.loads(captured.out)["planner"] == "navfn"


@pytest.mark.slow
def test_an_exceeded_time_limit_is_reported(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "--goal", "6.2,12", "--time-limit", "1", "--out", "out"]) == 1
    out = capfd.readouterr().out
    reason = "GOAL_TIME_LIMIT (9016): the goal was not reached within its time limit of 1 s"
    assert f"goal 6.2, 12: {reason}\n" in out
    assert "cancel" not in out
    Path("places.yaml").write_text("places: {desk: [6.2, 12.0, 1.57]}\n")
    assert run(["tour", "places.yaml", "office", "--start", "0.8,7.45", "--time-limit", "1", "--out", "out"]) == 1
    captured = capfd.readouterr()
    for text in (captured.err, captured.out):
        assert text.count(reason) == 1 and "cancel" not in text


def test_states_are_a_picture_or_a_table(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["info", "--states", "states.doc"]) == 2
    assert "one of .png, .svg, .pdf for a picture, or .md for a table" in capfd.readouterr().err
    assert not Path("states.doc").exists()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["simulate", "tour"])
def test_a_failed_goal_names_weights_of_another_scale(
    command: str, in_folder: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The weights of the packaged robot suit the scoring of indigo; a goal that succeeds gets no advice."""
    where = ["--start", "3,3", "--goal", "5,3"] if command == "simulate" else ["--loops", "1"]
    limit = ["--time-limit", "0.5"]
    assert run([command, "office", *where, *limit, "--distro", "noetic", "--json"]) == 1
    (advice,) = json.loads(capfd.readouterr().out)["advice"]
    assert "dwa_local_planner_params.yaml" in advice
    assert "set navstack/ros_distro to indigo (--distro indigo)" in advice
    assert run([command, "office", *where, *limit, "--distro", "noetic"]) == 1
    assert f"possible cause: {advice}" in capfd.readouterr().out
    assert run([command, "office", *where, *limit, "--distro", "indigo", "--json"]) == 1
    assert json.loads(capfd.readouterr().out)["advice"] == []


@pytest.mark.slow
def test_a_goal_that_is_reached_gets_no_advice(in_folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    where = ["--start", "3,3", "--goal", "3.4,3"]
    assert run(["simulate", "office", *where, "--distro", "noetic", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["advice"] == []

"""navstack move, turn, follow and tours with steps, from the command line."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from navstack.behaviors import poly_path, save_trajectory
from navstack.cli.app import run
from navstack.record import Record
from navstack.scenario import load_places


def document(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, dict[str, Any]]:
    code = run([*arguments, "--json"])
    return code, json.loads(capsys.readouterr().out)


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
def test_move_there_and_back(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    for distance in ("0.4", "-0.4"):
        code, found = document(capsys, "move", distance, "--speed", "0.4")
        assert code == 0
        assert found["goals"][0]["figures"]["driven_m"] == pytest.approx(float(distance), abs=0.01)
    assert {file.name for file in (folder / "navstack_move").iterdir()} >= {
        "run.npz",
        "run.log",
        "run.png",
        "summary.json",
    }
    assert run(["explain", "goal", "navstack_move"]) == 0
    assert "move-1 sent" in capsys.readouterr().out


@pytest.mark.slow
def test_turn_by_any_angle_in_a_scenario(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = document(capsys, "turn", "-400deg", "narrow_door", "--speed", "1.5", "--out", "here")
    assert code == 0
    assert found["goals"][0]["step"] == "turn -400 deg"
    assert found["goals"][0]["figures"]["turned_rad"] == pytest.approx(-6.981, abs=0.02)
    assert run(["turn", "270deg", "--shortest"]) == 0
    assert "turn: turned -89.9 of -90.0 degrees" in capsys.readouterr().out
    assert run(["turn", "7"]) == 0  # may be meant in degrees
    assert "7 is taken as radians, 401 degrees; for degrees, write 7deg" in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_drive_to_a_pose_and_to_a_place(capsys: pytest.CaptureFixture[str]) -> None:
    code, found = document(capsys, "drive-to", "1.2,7.6,0.5", "--speed", "0.5", "--tolerance", "0.02")
    assert code == 0
    assert found["goals"][0]["step"] == "drive to 1.2, 7.6, 0.5"
    assert found["goals"][0]["figures"]["left_m"] < 0.02
    assert found["goals"][0]["figures"]["left_rad"] < 0.02
    assert "reached, 0.0" in found["goals"][0]["text"]
    start = load_places("office").places["corridor_west"]
    away = f"{start.x},{start.y},{start.yaw}"
    assert run(["drive-to", "corridor_west", "--start", away, "--out", "place"]) == 0


@pytest.mark.slow
def test_follow_prints_draws_and_writes_the_errors(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    assert run(["follow", "figure_eight", "--size", "0.6", "--speed", "0.4"]) == 0
    text = capsys.readouterr()
    assert "follow: followed figure_eight for" in text.out
    assert "across (cm)" in text.out
    written = folder / "navstack_follow"
    assert (written / "tracking.png").stat().st_size > 10_000
    assert (written / "tracking.csv").read_text().startswith("t,ref_x")
    code, found = document(capsys, "explain", "tracking", "navstack_follow", "--csv", "t.csv", "--out", "t.png")
    assert code == 0
    assert found["trajectories"][0]["errors"]["distance_m"]["max"] < 0.02
    assert (folder / "t.csv").read_text() == (written / "tracking.csv").read_text()
    assert run(["explain", "tracking", "navstack_follow", "--trajectory", "2"]) == 2


@pytest.mark.slow
def test_follow_a_file_where_it_says(capsys: pytest.CaptureFixture[str], folder: Path) -> None:
    file = save_trajectory(
        poly_path([[2.4, 11.0], [2.4, 11.8], [2.0, 12.2]], 0.2, end_velocity=(0, 0)), folder / "way.yaml"
    )
    code, found = document(capsys, "follow", str(file), "--fit")
    assert code == 0
    assert found["goals"][0]["goal"][:2] == pytest.approx([2.0, 12.2], abs=1e-6)
    record = Record.load("navstack_follow")
    assert record.poses[0, :2] == pytest.approx([2.4, 11.0], abs=1e-6)
    fast = save_trajectory(poly_path([[2.4, 11.0], [2.4, 12.0]], 3.0), folder / "fast.csv")
    code, found = document(capsys, "follow", str(fast))
    assert code == 1
    assert found["goals"][0]["error_name"] == "INFEASIBLE_TRAJECTORY"
    assert "limit 0.5 m/s" in found["goals"][0]["message"]
    assert not list((folder / "navstack_follow").glob("tracking*"))  # those of the first run are gone


@pytest.mark.slow
def test_a_shape_starts_where_it_has_room(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["follow", "heart", "--size", "1.5", "--set", "navstack/motion/frequency=10"]) == 0
    assert "note: heart of 1.5 m starts at " in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["move", "1", "--sped=3"], 'there is no option "--sped=3"'),
        (["move", "far"], 'the distance "far" is not a number'),
        (["turn", "1 gon"], "neither rad nor deg"),
        (["drive-to", "3,x"], 'the pose "3,x": "x" is not a number'),
        (["drive-to", "kitchn"], 'the pose "kitchn" is no place of office; did you mean kitchen?'),
        (["follow", "circle"], "neither a shape (heart, figure_eight) nor a file"),
        (["follow", "absent.csv"], "cannot read absent.csv"),
        (["move", "1", "atlantis"], 'no file, packaged map or packaged scenario is called "atlantis"'),
        (["tour", "--step", "nowhere"], 'goto "nowhere" is not a place'),
        (["tour", "--step", "[1"], "is neither the name of a place nor a step"),
        (["tour", "--step", "{move: 1}", "--order", "random"], "--order random is for tours of places only"),
    ],
)
def test_wrong_input(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(arguments) == 2
    assert message in " ".join(capsys.readouterr().err.split())


@pytest.mark.slow
def test_a_tour_of_steps(capsys: pytest.CaptureFixture[str]) -> None:
    steps = ["{move: 0.4}", "{turn: 90 deg}", "{wait: 0.5}", "{goto: corridor_west}", "{move: 40}"]
    code, found = document(capsys, "tour", *(part for step in steps for part in ("--step", step)))
    assert code == 1
    assert [goal["place"] for goal in found["goals"]] == [
        "move 0.4 m",
        "turn 90 deg",
        "wait 0.5 s",
        "corridor_west",
        "move 40 m",
    ]
    assert [goal["state"] for goal in found["goals"]] == [*["SUCCEEDED"] * 4, "ABORTED"]
    assert found["success_rate"] == 0.8


def test_a_drive_that_does_not_start_shows_its_target_line_and_obstacle(capsys: pytest.CaptureFixture[str]) -> None:
    from navstack.plot import plot_run

    code, found = document(capsys, "drive-to", "6.2,12", "office", "--out", "stopped")
    assert code == 1
    assert found["goals"][0]["goal"][:2] == [6.2, 12.0]
    assert found["goals"][0]["distance_left_m"] == pytest.approx(7.06, abs=0.01)
    record = Record.load("stopped")
    assert len(record.plans) == 1
    (status,) = [e for e in record.events_of("status") if "collision_ahead" in e.data]
    assert math.hypot(*status.data["collision_ahead"][:2]) == pytest.approx(1.07, abs=0.05)
    axes = plot_run(record)
    legend = axes.get_legend() or axes.figure.legends[0]
    assert "stopped: obstacle ahead" in [text.get_text() for text in legend.get_texts()]

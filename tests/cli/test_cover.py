"""`navstack cover` and `navstack explain coverage`: the report, the files, the picture, and wrong input."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from navstack.cli.app import run

SMALL = {"type": "Polygon", "coordinates": [[[6.6, 2.2], [9.8, 2.2], [9.8, 6.2], [6.6, 6.2], [6.6, 2.2]]]}
FAST = ["--params", "turtlebot_rpp", "--set", "global_costmap/update_frequency=1.0"]


@pytest.fixture
def room(tmp_path: Path) -> Path:
    file = tmp_path / "manager.geojson"
    file.write_text(json.dumps(SMALL), encoding="utf-8")
    return file


@pytest.mark.slow
def test_a_plan_of_the_office(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["cover", "office", "--json", "--out", str(tmp_path / "out")]) == 0
    document = json.loads(capfd.readouterr().out)
    assert document["plan"]["share"] >= 0.97
    assert document["plan"]["overlap"] <= 0.12
    assert document["left"]
    assert (tmp_path / "out" / "coverage.png").stat().st_size > 50_000
    assert json.loads((tmp_path / "out" / "coverage.json").read_text()) == document


@pytest.mark.slow
def test_a_polygon_is_driven_and_explained(tmp_path: Path, room: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    command = ["cover", "office", *FAST, "--polygon", str(room), "--start", "manager", "--drive", "--out", str(out)]
    assert run(command) == 0
    shown = capfd.readouterr().out
    assert "driven" in shown
    assert str(out / "driven.png") in shown
    document = json.loads((out / "coverage.json").read_text())
    assert document["driven"]["state"] == "SUCCEEDED"
    assert document["driven"]["collisions"] == 0
    assert document["driven"]["share"] >= document["plan"]["share"] - 0.01
    figures = document["driven"]  # of the battery of the simulator: 14.8 V, 1 A at rest, 2 A more at 1 m/s
    assert figures["energy_wh"] == pytest.approx(14.8 * (figures["time_s"] + 2.0 * figures["length_m"]) / 3600.0)
    assert f"{figures['energy_wh']:.1f} Wh" in shown
    assert run(["explain", "coverage", str(out)]) == 0
    assert "uncovered: a pass would repeat more than it covers" in capfd.readouterr().out
    assert run(["explain", "coverage", str(out), "--at", "11.5,3"]) == 0
    assert "stayed uncovered" in capfd.readouterr().out
    assert run(["explain", "coverage", str(out), "--json"]) == 0
    assert len(json.loads(capfd.readouterr().out)["coverage"]) == 1


@pytest.mark.slow
def test_a_fixed_angle_and_a_start_that_is_chosen(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    from navstack.map_io import load_map, map_path, save_map

    grid = load_map(map_path("maze"))
    save_map(grid, tmp_path / "maze_copy.yaml")
    command = ["cover", str(tmp_path / "maze_copy.yaml"), "--angle", "30deg", "--json", "--out", str(tmp_path / "out")]
    assert run(command) == 0
    captured = capfd.readouterr()
    assert json.loads(captured.out)["swath_angle"] == pytest.approx(0.5236, abs=1e-3)
    assert "no start is given: begins at" in captured.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--tool-width", "0"], "--tool-width 0 is not a width; give meters above 0"),
        (["--tool-width", "nan"], "--tool-width nan is not a width"),
        (["--tool-width", "40"], "operation_width is 40 m, wider than the free space"),
        (["--angle", "steep"], 'the angle "steep" is neither rad nor deg'),
        (["--route", "zigzag"], "route_mode.mode is 'ZIGZAG'"),
        (["--polygon", "missing.geojson"], "missing.geojson: no such file; give a GeoJSON Polygon"),
        (["--start", "90,90"], "the start (90.00, 90.00) is"),
        (["--set", "global_costmap/robot_radius=9.0"], "fits nowhere on this map; check robot_radius"),
        (["--clearance", "9"], "fits nowhere on this map"),
        (["--clearance", "1e9"], "clearance is 1000000000.0: input should be less than or equal to 10"),
        (["--params", "car_rpp", "--drive"], "cannot turn in place"),
    ],
)
def test_wrong_input_is_one_message(
    arguments: list[str], message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert run(["cover", "office", *arguments, "--out", str(out)]) == 2
    captured = capfd.readouterr()
    assert message in captured.err
    assert "Traceback" not in captured.err
    assert captured.err.count("error:") == 1
    assert not out.exists(), "nothing is half-written"


@pytest.mark.parametrize(
    ("ring", "message"),
    [
        (
            [[0, 0], [5, 5], [5, 0], [0, 5], [0, 0]],
            "the border crosses itself; list the corners in order around the field",
        ),
        ([[90, 90], [95, 90], [95, 95]], "is outside the map"),
        ([[0, 0], [5, None], [5, 5]], "[1] is [5, None]; give a corner as [x, y]"),
    ],
)
def test_wrong_polygons(ring: list[object], message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "field.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}), encoding="utf-8")
    assert run(["cover", "office", "--polygon", str(file), "--out", str(tmp_path / "out")]) == 2
    assert message in capfd.readouterr().err


def test_a_run_without_coverage_is_said(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "run"
    assert run(["turn", "10deg", "--map", "office", "--start", "manager", "--out", str(out), "--json"]) in (0, 2)
    capfd.readouterr()
    if out.exists():
        assert run(["explain", "coverage", str(out)]) == 2
        assert "has no coverage task; record one with" in capfd.readouterr().err

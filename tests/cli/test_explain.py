"""`navstack explain`: reports, pictures and messages for invalid input."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from navstack.cli.app import run
from navstack.map_io import save_map
from navstack.record import Record
from navstack.scenario import run_scenario
from tests.cli.test_wrong_input import Outcome, navstack  # noqa: F401  (a fixture)
from tests.explain.conftest import scenario
from tests.explain.rooms import two_rooms


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("driven")
    recorder = run_scenario(scenario()).recorder
    assert recorder is not None
    recorder.save(folder)
    return folder


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path, _ = save_map(two_rooms({-2.5: 0.3, 0.0: 0.5, 2.5: 1.2}), tmp_path_factory.mktemp("map") / "rooms.yaml")
    return path


def is_picture(path: Path) -> bool:
    with Image.open(path) as image:
        image.load()
        return min(image.size) > 300 and len(image.getcolors(1 << 24) or ()) > 20


@pytest.mark.slow
def test_cell_reports_the_origin_of_a_cost(navstack, driven: Path) -> None:  # noqa: F811
    outcome: Outcome = navstack("explain", "cell", driven, "--at", "-2,0.3")
    assert outcome.code == 0
    assert "copied by static_layer from the map" in outcome.out
    assert "m from the lethal cell at (" in outcome.out
    document = json.loads(navstack("explain", "cell", driven, "--at", "-2,0.3", "--json").out)
    assert document["summary"] in outcome.out
    assert document["set_by"] == "inflation_layer"
    assert document["distance_m"] == pytest.approx(0.2, abs=0.051)
    assert [layer["layer"] for layer in document["layers"]] == ["static_layer", "obstacle_layer", "inflation_layer"]
    assert document["obstacle"]["set_by"] == "static_layer"
    recorded = Record.load(driven).costmap_at("global", 1e9)
    assert recorded is not None
    assert document["cost"] == recorded.cost_at(-2.0, 0.3)


def test_cell_at_a_time_in_the_local_costmap(navstack, driven: Path) -> None:  # noqa: F811
    outcome = navstack("explain", "cell", driven, "--at", "0.1,-1.9", "--time", "1.0", "--costmap", "local", "--json")
    document = json.loads(outcome.out)
    assert document["costmap"] == "local_costmap"
    assert document["time"] == pytest.approx(1.0, abs=0.21)
    assert document["frame"] == "odom"


@pytest.mark.slow
def test_passages_as_table_json_and_picture(navstack, drawn: Path, tmp_path: Path) -> None:  # noqa: F811
    out = tmp_path / "out"
    outcome = navstack("explain", "passages", drawn, "--out", out)
    assert outcome.code == 0
    assert "1 passable, 1 at high cost, 1 not passable" in outcome.out
    assert (
        "this robot: own width 0.40 m, turning width 0.40 m, low-cost width 0.65 m, minimum width 0.45 m" in outcome.out
    )
    assert is_picture(out / "passages.png")
    written = json.loads((out / "passages.json").read_text())
    document = json.loads(navstack("explain", "passages", drawn, "--json").out)
    assert document["passages"] == written["passages"]
    assert [(p["number"], p["width_m"], p["rating"]) for p in document["passages"]] == [
        (1, pytest.approx(0.3), "blocked"),
        (2, pytest.approx(0.5), "costly"),
        (3, pytest.approx(1.2), "free"),
    ]


@pytest.mark.slow
def test_pictures_of_passages_are_reproducible(tmp_path: Path) -> None:
    for name in ("office", "maze", "warehouse"):
        pictures = [tmp_path / f"{name}{i}" for i in (1, 2)]
        for folder in pictures:
            assert run(["explain", "passages", name, "--out", str(folder)]) == 0
        first, second = ((folder / "passages.png").read_bytes() for folder in pictures)
        assert first == second
        assert is_picture(pictures[0] / "passages.png")


def test_a_parameter_changes_the_rating(navstack, drawn: Path) -> None:  # noqa: F811
    slim = [f"{c}_costmap/robot_radius=0.1" for c in ("global", "local")]
    document = json.loads(
        navstack("explain", "passages", drawn, "--json", *(a for s in slim for a in ("--set", s))).out
    )
    assert document["passages"][0]["rating"] == "costly"


def test_a_map_without_walls_gets_a_note(navstack, tmp_path: Path) -> None:  # noqa: F811
    grid = two_rooms({0.0: 0.9})
    grid.data[grid.data == 100] = -1
    path, _ = save_map(grid, tmp_path / "foggy.yaml")
    outcome = navstack("explain", "passages", path, "--json")
    assert json.loads(outcome.out)["passages"] == []
    assert "--unknown" in outcome.err
    assert len(json.loads(navstack("explain", "passages", path, "--unknown", "--json").out)["passages"]) == 1


@pytest.mark.slow
def test_inflation_as_table_json_and_picture(navstack, tmp_path: Path) -> None:  # noqa: F811
    out = tmp_path / "out"
    setting = "local_costmap/inflation_layer/inflation_radius=0.3"
    outcome = navstack("explain", "inflation", "--set", setting, "--map", "office", "--out", out)
    assert outcome.code == 0
    assert "inscribed (253)" in outcome.out
    assert is_picture(out / "inflation.png")
    written = json.loads((out / "inflation.json").read_text())
    assert [curve["costmaps"] for curve in written["curves"]] == [["global"], ["local"]]
    assert written["curves"][1]["inflation_radius_m"] == 0.3
    assert written["curves"][0]["curve"][0] == {"cells": 0, "distance_m": 0.0, "cost": 254}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["global", "local"])
def test_costmap_draws_the_recorded_costmap(navstack, driven: Path, tmp_path: Path, name: str) -> None:  # noqa: F811
    picture = tmp_path / f"{name}.png"
    outcome = navstack("explain", "costmap", driven, "--costmap", name, "--time", "3", "--out", picture, "--json")
    assert outcome.code == 0
    assert json.loads(outcome.out)["updated_at"] <= 3.0
    assert is_picture(picture)


def test_the_picture_of_a_costmap_has_all_inputs_of_the_local_planner(driven: Path) -> None:
    from navstack.plot.maps import inputs_at

    record = Record.load(driven)
    assert set(inputs_at(record, "local", 3.0)) == {"robot", "plan", "goal", "trajectory", "scan"}
    marked: list[bool] = []
    for at in record.costmap_times("local").tolist():
        local = record.costmap_at("local", at)
        assert local is not None
        cells = (local.geometry.world_to_cell(x, y) for x, y in inputs_at(record, "local", at)["scan"].tolist())
        marked += [bool(local.data[cell[1], cell[0]] >= 253) for cell in cells if cell]
    assert len(marked) > 100
    assert np.mean(marked) > 0.95


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--at", "40,0"), "outside the global costmap at"),
        (("--at", "40,0"), "covers x -4.00 .. 4.00, y -4.00 .. 4.00 m in map"),
        (("--at", "1"), "--at"),
        (("--at", "1,2,3"), "has 3 numbers; give x,y"),
        (("--at", "a,b"), "not a number"),
        (("--at", "nan,0"), "finite"),
        (("--at", "0,0", "--time", "1e4"), "the run, which covers 0.0"),
        (("--at", "0,0", "--time", "nan"), "the run, which covers 0.0"),
        (("--at", "0,0", "--time", "soon"), "--time"),
        (("--at", "0,0", "--costmap", "lokal"), "give global or local"),
        ((), "--at"),
    ],
)
def test_invalid_options_of_cell(navstack, driven: Path, arguments: tuple[str, ...], words: str) -> None:  # noqa: F811
    outcome = navstack("explain", "cell", driven, *arguments)
    assert outcome.code == 2
    assert words in " ".join(outcome.err.split())
    as_json = navstack("explain", "cell", driven, *arguments, "--json")
    assert as_json.code == 2
    assert json.loads(as_json.out)["error"]["message"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("passages", "offic"), "office"),
        (("passages", "office", "--params", "turtlebt"), "turtlebot"),
        (("passages", "office", "--narrowest", "2", "--widest", "1"), "--narrowest below --widest"),
        (("passages", "office", "--widest", "-1"), "--widest"),
        (("passages", "office", "--costmap", "both"), "--costmap"),
        (("inflation", "--set", "global_costmap/inflation_layer/inflation_radius=wide"), "inflation_radius"),
        (("inflation", "--map", "absent.yaml"), "absent.yaml"),
        (("cell", "absent", "--at", "0,0"), "absent"),
        (("costmap", "absent", "--out", "x.png"), "absent"),
        (("whatever",), "whatever"),
    ],
)
def test_invalid_options(navstack, arguments: tuple[str, ...], words: str) -> None:  # noqa: F811
    outcome = navstack("explain", *arguments)
    assert outcome.code == 2
    assert words in outcome.err


@pytest.mark.slow
def test_invalid_output_files(navstack, driven: Path, tmp_path: Path) -> None:  # noqa: F811
    outcome = navstack("explain", "costmap", driven, "--out", tmp_path / "costmap.bmp")
    assert outcome.code == 2
    assert ".png" in outcome.err
    (tmp_path / "file").write_text("")
    outcome = navstack("explain", "passages", "office", "--out", tmp_path / "file" / "out")
    assert outcome.code == 2
    assert "--out" in outcome.err

"""Editing and merging maps."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from navstack.cli.app import run
from navstack.core import GridGeometry, InputError, NavError, OccupancyGrid, Pose2D, Transform2D
from navstack.map_io import load_map, save_map
from navstack.mapping import (
    align,
    compare,
    crop,
    fill_holes,
    keepout_mask,
    merged,
    paint,
    remove_specks,
    rotate,
    wall_direction,
)
from tests.localization.rooms import rooms


def polygon(folder: Path, *corners: tuple[float, float], name: str = "area.geojson") -> Path:
    file = folder / name
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [[*corners, corners[0]]]}))
    return file


def value_at(grid: OccupancyGrid, x: float, y: float) -> int:
    g = grid.geometry
    at = Transform2D(g.origin_x, g.origin_y, grid.origin_yaw).inverse().apply(Pose2D(x, y))
    return int(grid.data[int(at.y / g.resolution), int(at.x / g.resolution)])


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_a_cell_keeps_its_place_when_the_map_is_cropped(yaw: float) -> None:
    grid = rooms(yaw=yaw)
    part = crop(grid, (1.0, 5.0, 3.0, 7.0))
    assert part.data.size < grid.data.size
    for x, y in np.random.default_rng(0).uniform((1.0, 5.0), (3.0, 7.0), (200, 2)).tolist():
        assert value_at(part, x, y) == value_at(grid, x, y)
    with pytest.raises(InputError, match="contains no cell"):
        crop(grid, (100.0, 100.0, 101.0, 101.0))


def test_crop_to_what_is_known() -> None:
    data = np.full((40, 50), -1, np.int8)
    data[10:20, 5:25] = 0
    grid = OccupancyGrid(data, GridGeometry(50, 40, 0.1, 0.0, 0.0))
    assert crop(grid).geometry == GridGeometry(20, 10, 0.1, 0.5, 1.0)
    assert crop(grid, margin=0.3).geometry.shape == (16, 26)
    with pytest.raises(InputError, match="no known cell"):
        crop(OccupancyGrid(np.full((4, 4), -1, np.int8), GridGeometry(4, 4, 0.1, 0.0, 0.0)))


@pytest.mark.parametrize("degrees", [-40.0, -3.0, 0.0, 12.5, 44.0])
def test_the_walls_lie_along_the_axes_again(degrees: float) -> None:
    turned = rotate(rooms(), math.radians(degrees))
    assert wall_direction(turned) == pytest.approx(math.radians(degrees), abs=math.radians(0.15))
    straight = rotate(turned, -wall_direction(turned))
    assert wall_direction(straight) == pytest.approx(0.0, abs=math.radians(0.15))


def test_a_right_angle_moves_every_cell_exactly_and_no_angle_opens_a_wall() -> None:
    from scipy.ndimage import label

    grid = rooms()
    turned = rotate(grid, math.pi / 2)
    assert np.array_equal(turned.data, np.rot90(grid.data, -1))
    for degrees in (5.0, 23.0, 45.0, 61.0):
        slanted = rotate(grid, math.radians(degrees))
        # free space inside the walls and unknown space outside never touch
        found: Any = label(slanted.data != 100)
        labels = found[0]
        inside = np.unique(labels[slanted.data == 0])
        outside = labels[0, 0]
        assert slanted.data[0, 0] == -1
        assert outside not in inside
        area = (grid.data == 0).sum()
        assert (slanted.data == 0).sum() == pytest.approx(area, rel=0.04)


def test_a_map_without_walls_has_no_direction() -> None:
    noise = np.where(np.random.default_rng(0).random((80, 80)) < 0.1, 100, 0).astype(np.int8)
    for data in (noise, np.zeros((30, 30), np.int8)):
        with pytest.raises(InputError, match="no direction of walls stands out"):
            wall_direction(OccupancyGrid(data, GridGeometry(data.shape[1], data.shape[0], 0.1, 0.0, 0.0)))


def test_specks_and_holes() -> None:
    grid = rooms()
    data = grid.data.copy()
    data[30, 20] = data[60, 90] = 100
    data[40, 15:17] = -1
    before = int((grid.data == 100).sum())
    dirty = OccupancyGrid(data, grid.geometry)
    clean, specks = remove_specks(dirty, 0.025)
    clean, holes = fill_holes(clean, 0.05)
    added = int((data == 100).sum()) - before
    assert specks == added and holes == 1
    assert np.array_equal(clean.data, grid.data)
    unknown = OccupancyGrid(np.where(data == 0, -1, data).astype(np.int8), grid.geometry)
    assert (remove_specks(unknown, 0.025)[0].data != 0).all()


def test_areas_reach_every_cell_that_they_overlap(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.zeros((20, 20), np.int8), GridGeometry(20, 20, 0.1, 1.0, 1.0), 0.0)
    file = polygon(tmp_path, (1.5, 1.5), (1.7, 1.5), (1.7, 1.72), (1.5, 1.72))
    mask = keepout_mask(grid, [file])
    assert sorted({tuple(c) for c in np.argwhere(mask.data == 100)}) == [(y, x) for y in (5, 6, 7) for x in (5, 6)]
    assert np.array_equal(paint(grid, file, -1).data == -1, mask.data == 100)
    thin = polygon(tmp_path, (1.0, 1.05), (2.9, 1.05), (2.9, 1.051))
    assert (paint(grid, thin, 100).data == 100).any()
    with pytest.raises(InputError, match="reach no cell of the map"):
        paint(grid, polygon(tmp_path, (9.0, 9.0), (9.1, 9.0), (9.0, 9.1)), 100)


@pytest.mark.parametrize(
    ("mode", "negate", "thresholds"),
    [("trinary", 0, (0.65, 0.196)), ("trinary", 1, (0.65, 0.25)), ("scale", 0, (0.9, 0.1)), ("raw", 0, (0.65, 0.196))],
)
def test_the_fields_of_the_yaml_file_are_kept(
    mode: str, negate: int, thresholds: tuple[float, float], tmp_path: Path
) -> None:
    from PIL import Image

    pixels = np.random.default_rng(1).choice(
        np.array([0, 100, 205, 255] if mode != "raw" else [0, 50, 100, 255], np.uint8), (30, 40)
    )
    Image.fromarray(pixels).save(tmp_path / "a.png")
    fields = {
        "image": "a.png",
        "mode": mode,
        "resolution": 0.1,
        "origin": [1.0, 2.0, 0.0],
        "negate": negate,
        "occupied_thresh": thresholds[0],
        "free_thresh": thresholds[1],
        "floor": {"name": "first", "level": 1},
    }
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(fields))
    assert (
        run(["map", "edit", str(tmp_path / "a.yaml"), "--crop", "1.5,2.5,4,4.5", "--out", str(tmp_path / "b.yaml")])
        == 0
    )
    after = yaml.safe_load((tmp_path / "b.yaml").read_text())
    assert {**after, "image": "", "origin": 0} == {**fields, "image": "", "origin": 0}
    assert np.array_equal(load_map(tmp_path / "b.yaml").data, load_map(tmp_path / "a.yaml").data[5:25, 5:30])


def test_values_that_the_mode_cannot_express_are_saved_all_the_same(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.array([[0, 100, 37]], np.int8), GridGeometry(3, 1, 0.1, 0.0, 0.0))
    file, _ = save_map(grid, tmp_path / "x.yaml", like="office")
    assert np.array_equal(load_map(file).data, grid.data)
    assert "mode: raw" in file.read_text()


# --- merging ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [-17.0, 0.0, 100.0])
def test_two_parts_of_a_map_are_joined_to_the_whole(degrees: float) -> None:
    whole = rooms()
    truth = Transform2D(3.0, -1.5, math.radians(degrees))
    first = crop(whole, (-2.0, 1.0, 5.0, 10.0))
    right = crop(whole, (1.5, 1.0, 10.0, 10.0))
    # the same cells in a frame of its own: a pose p there is at truth.apply(p) here
    axes = truth.inverse() @ Transform2D(right.geometry.origin_x, right.geometry.origin_y, 0.0)
    second = OccupancyGrid(right.data, right.geometry.moved_to(axes.x, axes.y), axes.yaw)
    search = align(first, second)
    best = search.found[0]
    assert not search.refusal
    assert math.hypot(best.transform.x - truth.x, best.transform.y - truth.y) < 0.1
    assert best.transform.yaw == pytest.approx(truth.yaw, abs=0.01)
    assert best.share > 0.99
    joined = merged(first, second, truth)
    assert joined.geometry.shape == whole.geometry.shape
    assert (joined.data != whole.data).mean() < 0.01


def test_unclear_alignments_are_refused() -> None:
    data = np.zeros((60, 121), np.int8)
    data[[0, -1]] = 100
    data[:, [0, 60, 120]] = 100
    twins = OccupancyGrid(data, GridGeometry(121, 60, 0.1, 0.0, 0.0))
    room = crop(twins, (0.0, 0.0, 6.1, 6.0))
    assert align(twins, room).refusal.startswith("two alignments are nearly equal")
    other = align(rooms(), rooms(seed=8))
    assert other.refusal
    empty = OccupancyGrid(np.zeros((9, 9), np.int8), GridGeometry(9, 9, 0.1, 0.0, 0.0))
    with pytest.raises(InputError, match="second map has no occupied cell"):
        align(twins, empty)
    assert compare(twins, twins, Transform2D()).share == 1.0


def test_the_commands(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = rooms()
    for name, box in (("a", (-2.0, 1.0, 5.0, 10.0)), ("b", (1.5, 1.0, 10.0, 10.0))):
        save_map(crop(whole, box), tmp_path / name)
    a, b, out = str(tmp_path / "a.yaml"), str(tmp_path / "b.yaml"), str(tmp_path / "m.yaml")
    assert run(["map", "merge", a, b, "--out", out]) == 0
    assert np.array_equal(load_map(out).data, whole.data)
    area = polygon(tmp_path, (0.0, 2.0), (1.0, 2.0), (1.0, 3.0))
    line = ["map", "edit", out, "--keepout", str(area), "--rotate", "20deg", "--crop", "known", "--json"]
    capsys.readouterr()
    assert run([*line, "--out", str(tmp_path / "e.yaml")]) == 0
    document = json.loads(capsys.readouterr().out)
    mask, edited = load_map(document["files"]["keepout mask"]), load_map(tmp_path / "e.yaml")
    assert mask.geometry == edited.geometry
    assert set(np.unique(mask.data)) == {0, 100}
    at = Transform2D(0.0, 0.0, math.radians(20.0)).apply(Pose2D(0.8, 2.3))
    assert value_at(mask, at.x, at.y) == 100
    wrong = [
        (["map", "edit", a], "there is nothing to do"),
        (["map", "edit", a, "--crop", "50,50,51,51"], "contains no cell"),
        (["map", "edit", a, "--crop", "1,2,3"], "--crop"),
        (["map", "edit", a, "--fill", "-1"], "--fill -1 must be an area above 0"),
        (["map", "edit", a, "--free", str(tmp_path / "none.json")], "no such file"),
        (["map", "merge", a, "office"], "--transform"),
        (["map", "merge", a, b, "--transform", "nan,0,0"], "--transform"),
        (["map", "merge", a, b, "--transform", "1e9,0,0"], "check the transform"),
    ]
    for arguments, named in wrong:
        assert run([*arguments, "--out", str(tmp_path / "no.yaml")]) == 2, arguments
        message = " ".join(capsys.readouterr().err.split())
        assert named in message, message
        assert "internal" not in message
    assert not (tmp_path / "no.yaml").exists()


def test_damaged_input_raises_errors_of_navstack(tmp_path: Path) -> None:
    raw = OccupancyGrid(np.full((5, 5), 7, np.int8), GridGeometry(5, 5, 0.1, 0.0, 0.0))
    with pytest.raises(NavError, match="mode trinary"):
        merged(raw, raw, Transform2D())
    with pytest.raises(NavError, match="not finite"):
        rotate(raw, math.nan)
    with pytest.raises(NavError, match="above 0"):
        fill_holes(raw, 0.0)

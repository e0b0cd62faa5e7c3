"""Map files: the rules of map_server's image loader on small images."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from navstack.core import GridGeometry, OccupancyGrid, OutputError
from navstack.map_io import load_map, save_map


def write_map(folder: Path, image: Image.Image, name: str = "map.png", **keys: object) -> Path:
    image.save(folder / name)
    values = {
        "image": name,
        "resolution": 0.05,
        "origin": "[1.0, 2.0, 0.0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
    } | keys
    path = folder / "map.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in values.items()))
    return path


def gray(*rows: list[int]) -> Image.Image:
    return Image.fromarray(np.array(rows, np.uint8))


def test_trinary_mode_and_row_order(tmp_path: Path) -> None:
    grid = load_map(write_map(tmp_path, gray([0, 254], [205, 255])))
    # the lower row of the image comes first
    assert grid.data.tolist() == [[-1, 0], [100, 0]]
    assert grid.geometry == GridGeometry(2, 2, 0.05, 1.0, 2.0)
    assert (grid.origin_yaw, grid.frame) == (0.0, "map")


def test_thresholds_are_strict(tmp_path: Path) -> None:
    # (255 - 51) / 255 = 0.8 exactly in the arithmetic of map_server: neither above nor below 0.8
    grid = load_map(write_map(tmp_path, gray([51, 50, 52]), occupied_thresh=0.8, free_thresh=0.1))
    assert grid.data.tolist() == [[-1, 100, -1]]


def test_negate(tmp_path: Path) -> None:
    grid = load_map(write_map(tmp_path, gray([0, 255, 128]), negate=1))
    assert grid.data.tolist() == [[0, 100, -1]]
    assert load_map(write_map(tmp_path, gray([0]), negate="true")).data.tolist() == [[0]]


def test_scale(tmp_path: Path) -> None:
    pixels = [0, 60, 128, 200, 255]
    grid = load_map(write_map(tmp_path, gray(pixels), mode="scale"))
    expected = []
    for p in pixels:
        occ = (255 - p) / 255.0
        expected.append(100 if occ > 0.65 else 0 if occ < 0.196 else int(1 + 98 * (occ - 0.196) / (0.65 - 0.196)))
    assert grid.data.tolist() == [expected]


def test_scale_keeps_transparent_pixels_unknown(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[128, 128, 128, 0], [128, 128, 128, 255], [0, 0, 0, 0]]], np.uint8), "RGBA")
    assert load_map(write_map(tmp_path, image, mode="scale")).data.tolist() == [
        [-1, int(1 + 98 * (127 / 255 - 0.196) / (0.65 - 0.196)), 100]
    ]


def test_trinary_averages_the_alpha_channel(tmp_path: Path) -> None:
    # black but transparent: mean 0; black and opaque: mean 63.75, 75 % black; white and transparent: mean 191, 25 %
    pixels = np.array([[[0, 0, 0, 0], [0, 0, 0, 255], [255, 255, 255, 0], [255, 255, 255, 255]]], np.uint8)
    assert load_map(write_map(tmp_path, Image.fromarray(pixels, "RGBA"))).data.tolist() == [[100, 100, -1, 0]]


def test_raw(tmp_path: Path) -> None:
    assert load_map(write_map(tmp_path, gray([0, 50, 100, 255, 200]), mode="raw")).data.tolist() == [
        [0, 50, 100, -1, -56]
    ]


def test_colors_are_averaged(tmp_path: Path) -> None:
    image = Image.fromarray(np.array([[[255, 0, 0], [255, 255, 0], [10, 20, 30]]], np.uint8), "RGB")
    # 67 %, 33 % and 92 % black
    assert load_map(write_map(tmp_path, image)).data.tolist() == [[100, -1, 100]]


@pytest.mark.parametrize("mode", ["1", "P", "LA", "I;16"])
def test_other_pixel_formats(mode: str, tmp_path: Path) -> None:
    black_and_white = gray([0, 255])
    image = Image.fromarray(np.array([[0, 65535]], np.uint16)) if mode == "I;16" else black_and_white.convert(mode)
    assert load_map(write_map(tmp_path, image)).data.tolist() == [[100, 0]]


@pytest.mark.parametrize("name", ["map.pgm", "map.bmp", "map.png"])
def test_formats(name: str, tmp_path: Path) -> None:
    assert load_map(write_map(tmp_path, gray([0, 254, 205]), name)).data.tolist() == [[100, 0, -1]]


@pytest.mark.parametrize(
    "content",
    [b"P2\n# a comment\n3 1\n255\n0 254\n205\n", b"P5\n# CREATOR: map_saver\n3 1\n255\n\x00\xfe\xcd"],
    ids=["ascii", "binary"],
)
def test_pgm_with_a_comment(content: bytes, tmp_path: Path) -> None:
    path = write_map(tmp_path, gray([0]), "map.pgm")
    (tmp_path / "map.pgm").write_bytes(content)
    assert load_map(path).data.tolist() == [[100, 0, -1]]


def test_numbers_that_yaml_reads_as_text(tmp_path: Path) -> None:
    path = write_map(tmp_path, gray([0]), resolution="5e-2", origin="[1e1, -2, '0.5']")
    grid = load_map(path)
    assert grid.geometry == GridGeometry(1, 1, 0.05, 10.0, -2.0)
    assert grid.origin_yaw == 0.5


def test_byte_order_mark_and_line_endings(tmp_path: Path) -> None:
    path = write_map(tmp_path, gray([0]))
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes().replace(b"\n", b"\r\n"))
    assert load_map(path).data.tolist() == [[100]]


def test_saves_as_map_saver(tmp_path: Path) -> None:
    grid = OccupancyGrid(np.array([[0, 100, -1]], np.int8), GridGeometry(3, 1, 0.05, -1.5, 2.0), 0.25)
    yaml, image = save_map(grid, tmp_path / "new" / "kitchen")
    assert (yaml.name, image.name) == ("kitchen.yaml", "kitchen.pgm")
    assert np.asarray(Image.open(image)).tolist() == [[254, 0, 205]]
    assert "mode: trinary" in yaml.read_text()


def test_saving_to_a_path_that_is_not_writable(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    grid = OccupancyGrid(np.zeros((1, 1), np.int8), GridGeometry(1, 1, 0.05))
    with pytest.raises(OutputError, match="cannot create the output folder"):
        save_map(grid, tmp_path / "file" / "map.yaml")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]


@settings(deadline=None, max_examples=40)
@given(
    values=st.lists(st.integers(-128, 127), min_size=1, max_size=12),
    resolution=st.floats(1e-6, 1e3),
    x=st.floats(-1e6, 1e6),
    yaw=st.floats(-math.pi, math.pi),
)
def test_saved_maps_load_unchanged(
    tmp_path_factory: pytest.TempPathFactory, values: list[int], resolution: float, x: float, yaw: float
) -> None:
    geometry = GridGeometry(1, len(values), resolution, x, -x)
    grid = OccupancyGrid(np.array(values, np.int8)[:, None], geometry, yaw, raw=True)
    again = load_map(save_map(grid, tmp_path_factory.mktemp("map") / "map.yaml")[0])
    assert again.data.tolist() == grid.data.tolist()
    assert (again.geometry, again.origin_yaw) == (geometry, yaw)

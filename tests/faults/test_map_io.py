"""Invalid maps: one message each, with file, line, value and how to fix it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from navstack.core import MapError
from navstack.map_io import load_map

GOOD = {
    "image": "map.png",
    "resolution": "0.05",
    "origin": "[0.0, 0.0, 0.0]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "map.png")
    return tmp_path


def write(folder: Path, text: str | None = None, **keys: str | None) -> Path:
    path = folder / "map.yaml"
    values = {k: v for k, v in (GOOD | keys).items() if v is not None}
    path.write_text("".join(f"{k}: {v}\n" for k, v in values.items()) if text is None else text)
    return path


def error_of(path: Path) -> str:
    with pytest.raises(MapError) as caught:
        load_map(path)
    return caught.value.message


def test_valid_map_loads(folder: Path) -> None:
    assert load_map(write(folder)).geometry.shape == (4, 4)


@pytest.mark.parametrize("key", GOOD)
def test_missing_key(key: str, folder: Path) -> None:
    message = error_of(write(folder, **{key: None}))
    assert f'"{key}" is missing' in message
    assert f'add for example "{key}: ' in message


@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("resolution", "0", "positive number of meters per cell, not 0"),
        ("resolution", "-0.05", "not -0.05"),
        ("resolution", ".nan", "must be a number, not nan"),
        ("resolution", ".inf", "must be a number, not inf"),
        ("resolution", "coarse", "must be a number, not 'coarse'"),
        ("resolution", "[1]", "must be a number, not [1]"),
        ("resolution", "true", "must be a number, not True"),
        ("resolution", "9" * 400, "must be a number"),
        ("origin", "[0, 0]", "three numbers [x, y, yaw]"),
        ("origin", "0.0", "three numbers [x, y, yaw]"),
        ("origin", "[0, 0, .nan]", "three numbers [x, y, yaw]"),
        ("origin", "[0, 0, left]", "three numbers [x, y, yaw]"),
        ("negate", "2", "must be 0 or 1, not 2"),
        ("negate", "no thanks", "must be 0 or 1"),
        ("occupied_thresh", "65", "between 0 (white) and 1 (black), not 65"),
        ("occupied_thresh", "0.1", "free_thresh (0.196) must be smaller than occupied_thresh (0.1)"),
        ("free_thresh", "-0.1", "between 0 (white) and 1 (black), not -0.1"),
        ("free_thresh", "x", "must be a number, not 'x'"),
        ("mode", "binary", "one of trinary, scale, raw"),
        ("image", "42", "must be a file name, not 42"),
        ("image", "''", "must be a file name"),
        ("image", "none.png", "the path is relative to the YAML"),
        ("image", "/map/map.png", 'the folder of the YAML file contains it: write "image: map.png"'),
        ("image", "map.yaml", "is not a readable image"),
        ("image", ".", "cannot be read"),
    ],
)
def test_invalid_value(key: str, value: str, expected: str, folder: Path) -> None:
    path = write(folder, **{key: value})
    message = error_of(path)
    assert expected in message
    line = next((i for i, text in enumerate(path.read_text().splitlines(), 1) if text.startswith(key)), 1)
    if "free_thresh (" in expected:
        line = 6  # the second key
    assert message.startswith(f"{path}:{line}: ")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", ":1: the file is empty"),
        ("# only a comment\n", ":1: the file is empty"),
        ("- image: map.png\n", ":1: the YAML file of a map must be a mapping with the keys image, resolution"),
        ("just text", ":1: the YAML file of a map must be a mapping"),
        ("image: map.png\nresolution: [0.05\n", "invalid YAML"),
        ("image: map.png\n\tresolution: 0.05\n", ":2: invalid YAML"),
        ("a: &a [*a]\nb: !!python/object:os.system x\n", "invalid YAML"),
    ],
)
def test_invalid_yaml(text: str, expected: str, folder: Path) -> None:
    assert expected in error_of(write(folder, text))


def test_unknown_file_suggests_existing_ones(folder: Path) -> None:
    write(folder)
    assert "the folder contains map.yaml" in error_of(folder / "mpa.yaml")
    assert "check the path" in error_of(folder / "nowhere" / "map.yaml")
    assert f"pass {folder / 'map.yaml'}" in error_of(folder)


def test_image_instead_of_yaml(folder: Path) -> None:
    message = error_of(folder / "map.png")
    assert "is an image; pass the YAML file of the map" in message
    assert "image: map.png" in message


def test_binary_instead_of_text(folder: Path) -> None:
    path = folder / "map.yaml"
    path.write_bytes(b"\xff\xfe\x00\x01\x02" * 10)
    assert "not a text file" in error_of(path)
    # a text of another encoding is one
    path.write_bytes(b"# map\nimage: map.pgm  # Geb\xe4ude\n")
    assert error_of(path).endswith(":2: the byte 0xe4 is not UTF-8; save the file as UTF-8")


def test_truncated_images(folder: Path) -> None:
    rng = np.random.default_rng(0)
    Image.fromarray(rng.integers(0, 255, (64, 64), np.uint8)).save(folder / "map.png")
    whole = (folder / "map.png").read_bytes()
    for share in (0.02, 0.3, 0.9):
        (folder / "map.png").write_bytes(whole[: int(len(whole) * share)])
        assert "save it again" in error_of(write(folder))
    (folder / "map.pgm").write_bytes(b"P5\n64 64\n255\n" + b"\x00" * 100)
    assert "cannot be read" in error_of(write(folder, image="map.pgm"))


@pytest.mark.parametrize("size", [(9_500, 9_500), (200_000, 200_000)])
def test_images_that_are_too_large(size: tuple[int, int], folder: Path) -> None:
    (folder / "map.pgm").write_bytes(b"P5\n%d %d\n255\n" % size + b"\x00" * 10)
    assert "larger than the limit of 80,000,000 cells; crop or resample it" in error_of(write(folder, image="map.pgm"))


@settings(deadline=None, max_examples=60)
@given(
    content=st.binary(max_size=60), start=st.sampled_from([b"", b"P5\n", b"P2 3 3 255\n", b"\x89PNG\r\n\x1a\n", b"BM"])
)
def test_any_bytes_as_an_image(tmp_path_factory: pytest.TempPathFactory, content: bytes, start: bytes) -> None:
    folder = tmp_path_factory.mktemp("map")
    (folder / "map.png").write_bytes(start + content)
    try:
        grid = load_map(write(folder))
    except MapError:
        return
    assert grid.data.dtype == np.int8


@settings(deadline=None, max_examples=60)
@given(text=st.text(max_size=80), key=st.sampled_from([*GOOD, "mode", "x"]))
def test_any_text_as_a_value(tmp_path_factory: pytest.TempPathFactory, text: str, key: str) -> None:
    folder = tmp_path_factory.mktemp("map")
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(folder / "map.png")
    path = folder / "map.yaml"
    path.write_text("".join(f"{k}: {v}\n" for k, v in (GOOD | {key: text}).items()), encoding="utf-8")
    try:
        grid = load_map(path)
    except MapError as exc:
        assert str(path) in exc.message
    else:
        assert grid.geometry.shape == (4, 4)

"""Hostile files: pipes and devices, files that expand beyond memory, forged values. One short message each, little memory."""

from __future__ import annotations

import io
import json
import math
import os
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from navstack.core import (
    CappedFile,
    InputError,
    MapError,
    NavError,
    NotRegularFileError,
    RecordError,
    TooLargeError,
    open_regular,
    read_bytes,
    short_repr,
)
from navstack.map_io import load_map
from navstack.parameters import check_parameters
from navstack.record import Record
from navstack.record import archive as record_archive
from navstack.scenario import Scenario, load_places, load_worlds, read_scenario
from navstack.studies import read_reference
from navstack.studies.inputs import digest_of_file, read_csv
from navstack.studies.movingai import read_map
from tests.record import synthetic
from tools.fuzz.inputs import Inputs

MAP = (
    "image: map.png\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    Image.fromarray(np.zeros((4, 4), np.uint8)).save(tmp_path / "map.png")
    return tmp_path


def map_file(folder: Path, text: str) -> Path:
    path = folder / "map.yaml"
    path.write_text(text)
    return path


def message_of(load: Callable[[Path], object], path: Path, error: type[NavError] = InputError) -> str:
    with pytest.raises(error) as caught:
        load(path)
    assert len(caught.value.message) < 1000
    return caught.value.message


# --- files that are not regular -----------------------------------------------------------------------------------------

READERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "map": (".yaml", load_map),
    "places": (".yaml", load_places),
    "scenario": (".yaml", read_scenario),
    "record": (".npz", Record.load),
    "worlds": (".npz", load_worlds),
    "movingai map": (".map", read_map),
    "digest": (".tsv", digest_of_file),
    "reference": (".json", read_reference),
    "table": (".csv", lambda path: read_csv(path, ("a",), dict)),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_pipe_is_not_read(reader: str, tmp_path: Path) -> None:
    suffix, load = READERS[reader]
    path = tmp_path / f"pipe{suffix}"
    os.mkfifo(path)
    message = message_of(load, path)
    assert "pipe" in message or "does not exist" in message  # load_worlds asks for a regular file first


@pytest.mark.parametrize("reader", READERS)
def test_a_device_is_not_read(reader: str, tmp_path: Path) -> None:
    suffix, load = READERS[reader]
    path = tmp_path / f"device{suffix}"
    path.symlink_to("/dev/zero")
    message_of(load, path)


@pytest.mark.parametrize("suffix", [".yaml", ".launch"])
def test_parameters_from_a_pipe(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"costmap_common_params{suffix}"
    os.mkfifo(path)
    errors = [f for f in check_parameters([str(path)]) if f.severity == "error"]
    assert any("named pipe" in f.message for f in errors)


def test_the_image_of_a_map_is_a_pipe_or_a_device(folder: Path) -> None:
    os.mkfifo(folder / "pipe.png")
    assert "named pipe" in message_of(load_map, map_file(folder, MAP.replace("map.png", "pipe.png")), MapError)
    assert "character device" in message_of(load_map, map_file(folder, MAP.replace("map.png", "/dev/zero")), MapError)


def test_open_regular(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(TooLargeError, match="larger than 4 bytes"):
        read_bytes(path, 4)
    with pytest.raises(IsADirectoryError):
        open_regular(tmp_path)
    with pytest.raises(FileNotFoundError):
        open_regular(tmp_path / "b")
    with pytest.raises(NotRegularFileError, match="character device"):
        open_regular(Path("/dev/null"))
    with CappedFile(path) as capped:
        assert capped.read(3) == b"123"
        assert capped.read() == b"45"
    with path.open("wb") as sparse:
        sparse.truncate(9_000_000)
    with CappedFile(path) as capped:
        for size in (-1, None, 10**9):
            capped.seek(0)
            with pytest.raises(ValueError, match="8 MB"):
                capped.read(size)


# --- maps ---------------------------------------------------------------------------------------------------------------


def alias_bomb(levels: int = 9, width: int = 10) -> str:
    lines = ["a0: &a0 [" + ", ".join(["1"] * width) + "]"]
    lines += [f"a{i}: &a{i} [" + ", ".join([f"*a{i - 1}"] * width) + "]" for i in range(1, levels)]
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize("key", ["image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh", "mode"])
def test_an_alias_bomb_in_a_map(key: str, folder: Path) -> None:
    lines = [line for line in f"{MAP}mode: trinary\n".splitlines() if not line.startswith(f"{key}:")]
    path = map_file(folder, alias_bomb() + "\n".join(lines) + f"\n{key}: *a8\n")
    tracemalloc.start()
    try:
        assert "alias" in message_of(load_map, path, MapError)
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()


@pytest.mark.slow
@pytest.mark.parametrize("value", ["[" * 40 + "]" * 40, "[" + "1, " * 5000 + "1]", f"'{'x' * 50_000}'", "9" * 5000])
def test_a_large_value_is_shortened_in_the_message(value: str, folder: Path) -> None:
    for key in ("resolution", "origin", "negate", "mode"):
        lines = [line for line in MAP.splitlines() if not line.startswith(f"{key}:")]
        message_of(load_map, map_file(folder, "\n".join([*lines, f"{key}: {value}"])), MapError)


def test_a_key_set_twice_in_a_map(folder: Path) -> None:
    message = message_of(load_map, map_file(folder, f"{MAP}resolution: 0.1\n"), MapError)
    assert message.startswith(f"{folder / 'map.yaml'}:7: resolution is set twice (first on line 2)")
    assert "remove one of them" in message
    assert load_map(map_file(folder, f"{MAP}resolution: 0.05\n")).geometry.resolution == 0.05


@pytest.mark.parametrize(("suffix", "scale"), [("tif", 1.0), ("tif", 255.0), ("tiff", 65535.0)])
def test_an_image_of_floats_has_no_scale(suffix: str, scale: float, folder: Path) -> None:
    pixels = np.full((4, 4), scale, np.float32)
    Image.fromarray(pixels).save(folder / f"map.{suffix}")
    message = message_of(load_map, map_file(folder, MAP.replace("map.png", f"map.{suffix}")), MapError)
    assert "floating-point" in message
    assert "8 bits per pixel" in message


def test_an_image_of_32_bits_beyond_the_range(folder: Path) -> None:
    Image.fromarray(np.full((4, 4), 2**20, np.int32)).save(folder / "map.tif")
    path = map_file(folder, MAP.replace("map.png", "map.tif"))
    assert "not within 0 .. 65535" in message_of(load_map, path, MapError)


def test_postscript_is_not_run(folder: Path) -> None:
    (folder / "map.png").write_bytes(b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\nshowpage\n")
    assert "not a readable image" in message_of(load_map, map_file(folder, MAP), MapError)


def test_short_repr() -> None:
    nested: list[object] = [[[[[1]]]]]
    for value in (10**5000, list(range(10**6)), {i: i for i in range(100)}, "x" * 10**6, nested):
        assert len(short_repr(value)) <= 100


# --- records ------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return synthetic.record_run(3.0, scans=True).save(tmp_path_factory.mktemp("run"))["record"]


def members(path: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def forged(good: Path, out: Path, **changed: bytes) -> Path:
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in {**members(good), **changed}.items():
            archive.writestr(name, content)
    return out


def test_a_record_that_expands_beyond_the_limit(good: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, content in members(good).items():
            archive.writestr(name, content)
        with archive.open("bomb.npy", "w") as bomb:
            for _ in range(30):
                bomb.write(bytes(1_000_000))
    monkeypatch.setattr(record_archive, "MAX_BYTES", 20_000_000)
    tracemalloc.start()
    try:
        message = message_of(Record.load, path, RecordError)
        assert tracemalloc.get_traced_memory()[1] < 12_000_000
    finally:
        tracemalloc.stop()
    assert "more than 20 MB" in message
    assert "NAVSTACK_MAX_RECORD_MB" in message
    path = forged(good, tmp_path / "small.npz", **{"extra.npy": members(good)["map.npy"]})
    monkeypatch.setattr(record_archive, "MAX_BYTES", 1000)
    monkeypatch.setenv("NAVSTACK_MAX_RECORD_MB", "50")
    assert Record.load(path).duration > 0.0


def npy(shape: tuple[int, ...], descr: str, content: bytes) -> bytes:
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": descr, "fortran_order": False, "shape": shape})
    return header.getvalue() + content


@pytest.mark.parametrize("shape", [(10**12,), (2**62, 8), (-1,), (10**9, 10**9, 10**9)])
def test_an_array_that_states_a_wrong_size(good: Path, tmp_path: Path, shape: tuple[int, ...]) -> None:
    changed = {"scan_ranges.npy": npy(shape, "<f4", bytes(64))}
    tracemalloc.start()
    try:
        message_of(Record.load, forged(good, tmp_path / "run.npz", **changed), RecordError)
        assert tracemalloc.get_traced_memory()[1] < 50_000_000
    finally:
        tracemalloc.stop()


def test_other_compressions_and_large_texts_are_rejected(good: Path, tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_BZIP2) as archive:
        for name, content in members(good).items():
            archive.writestr(name, content)
    assert "compressed" in message_of(Record.load, path, RecordError)
    path = forged(good, tmp_path / "text.npz", **{"events.jsonl": b" " * 33_000_000})
    assert "larger than 32 MB" in message_of(Record.load, path, RecordError)


FORGED: dict[str, Any] = {
    "footprint of many corners": {"footprint": [[0.0, 0.0]] * 20_000},
    "footprint without end": {"footprint": [[0.0, math.inf], [1.0, 0.0], [0.0, 1.0]]},
    "resolution beyond floats": {"map": {"resolution": 10**400}},
    "resolution zero": {"map": {"resolution": 0.0}},
    "origin not a number": {"map": {"origin_x": math.nan}},
    "yaw a boolean": {"map": {"origin_yaw": True}},
    "critics": {"critics": ["x"] * 100_000},
    "version": {"version": 10**400},
}


@pytest.mark.parametrize("name", FORGED)
def test_a_forged_description(name: str, good: Path, tmp_path: Path) -> None:
    meta = json.loads(members(good)["meta.json"])
    for key, value in FORGED[name].items():
        meta[key] = {**meta[key], **value} if isinstance(value, dict) else value
    changed = {"meta.json": json.dumps(meta).encode()}
    message_of(Record.load, forged(good, tmp_path / "run.npz", **changed), RecordError)


FORGED_SCENARIOS: dict[str, tuple[str, Any, str]] = {
    "seed a text": ("seed", "x", "seed ('x')"),
    "seed negative": ("seed", -1, "seed (-1)"),
    "seed a boolean": ("seed", True, "seed (True)"),
    "many obstacles": ("obstacles", [[0.0, 0.0, 0.1]] * 200_000, "obstacles"),
    "many pedestrians": (
        "shapes",
        [{"radius": 0.2, "motion": {"kind": "pedestrian", "goals": [[0.0, 0.0], [1.0, 1.0]]}}] * 3_000,
        "shapes",
    ),
    "more pedestrians than are handled": (
        "shapes",
        [{"radius": 0.2, "motion": {"kind": "pedestrian", "goals": [[0.0, 0.0], [1.0, 1.0]]}}] * 600,
        "600 pedestrians",
    ),
    "start": ("start", [0.0, 1e308, 0.0], "start.1"),
    "goal": ("goals", [[0.0, None, 0.0]], "goals.0.1"),
    "time limit": ("time_limit_s", 1e30, "time_limit_s"),
    "parameters": ("parameters", [], "parameters"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FORGED_SCENARIOS)
def test_a_forged_scenario(name: str, tmp_path: Path) -> None:
    members = Inputs(tmp_path).members
    key, value, expected = FORGED_SCENARIOS[name]
    meta = json.loads(members["meta.json"])
    meta["scenario"][key] = value
    path = tmp_path / "forged.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for member, content in {**members, "meta.json": json.dumps(meta).encode()}.items():
            archive.writestr(member, content)
    message = message_of(lambda p: Scenario.from_record(Record.load(p)), path, RecordError)
    assert expected in message
    assert "\n" not in message


def test_many_pedestrians_in_a_scenario_file(tmp_path: Path) -> None:
    walking = "  - {radius: 0.2, pose: [1, 1], motion: {kind: pedestrian, goals: [[0, 0], [1, 1]]}}\n" * 501
    path = tmp_path / "crowd.yaml"
    path.write_text(f"map: office\nstart: [0.8, 7.45, 0]\ngoals: [[2, 7.45, 0]]\nshapes:\n{walking}")
    assert "501 pedestrians" in message_of(read_scenario, path)


# --- launch files -------------------------------------------------------------------------------------------------------


def expanding(levels: int, width: int) -> str:
    """Arguments that each repeat the one before: `width` to the power of `levels` times ten characters."""
    lines = ['<arg name="a0" value="xxxxxxxxxx"/>']
    lines += [f'<arg name="a{i}" value="{f"$(arg a{i - 1})" * width}"/>' for i in range(1, levels)]
    return "".join(lines)


@pytest.mark.parametrize(("levels", "width", "uses"), [(12, 8, 1), (60, 4, 1), (7, 7, 300)])
def test_arguments_that_expand_without_end(levels: int, width: int, uses: int, tmp_path: Path) -> None:
    path = tmp_path / "robot.launch"
    params = "".join(f'<param name="p{i}" value="$(arg a{levels - 1})"/>' for i in range(uses))
    node = f'<node pkg="move_base" type="move_base" name="move_base">{params}</node>'
    path.write_text(f"<launch>{expanding(levels, width)}{node}</launch>")
    tracemalloc.start()
    try:
        errors = [f.message for f in check_parameters([str(path)]) if f.severity == "error"]
        assert tracemalloc.get_traced_memory()[1] < 60_000_000
    finally:
        tracemalloc.stop()
    assert any("characters" in message and "shorten" in message for message in errors)
    assert max(map(len, errors)) < 1000


# --- BARN worlds ----------------------------------------------------------------------------------------------------------

WORLDS: dict[str, Any] = {
    "world": np.arange(2),
    "cyl_xy": np.zeros((5, 2)),
    "cyl_offset": np.array([0, 2, 5]),
    "cyl_radius": np.float64(0.075),
    "optimal_length_m": np.array([10.0, 11.0]),
}


def test_worlds_are_read_in_order(tmp_path: Path) -> None:
    np.savez(tmp_path / "worlds.npz", **WORLDS)
    assert [len(world.discs) for world in load_worlds(tmp_path / "worlds.npz")] == [2, 3]


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("cyl_offset", np.array([0, 2, 50]), "cyl_offset"),
        ("cyl_offset", np.array([3, 2, 5]), "cyl_offset"),
        ("cyl_xy", np.full((5, 2), np.nan), "cyl_xy"),
        ("cyl_xy", np.zeros((5, 3)), "shape"),
        ("cyl_radius", np.float64(-1.0), "positive"),
        ("world", np.array(["a", "b"]), "could not convert"),
        ("optimal_length_m", np.array([10.0, 1e300]), "lengths"),
        ("world", np.array([None, None]), "Python objects"),
    ],
)
def test_forged_worlds(name: str, value: Any, expected: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "worlds.npz", **{**WORLDS, name: value})
    assert expected in message_of(load_worlds, tmp_path / "worlds.npz")


def test_worlds_that_state_or_need_too_much(tmp_path: Path) -> None:
    np.savez(tmp_path / "good.npz", **WORLDS)
    good = members(tmp_path / "good.npz")
    path = forged(tmp_path / "good.npz", tmp_path / "a.npz", **{"world.npy": npy((10**12,), "<f8", bytes(64))})
    assert "bytes instead of" in message_of(load_worlds, path)
    with zipfile.ZipFile(tmp_path / "b.npz", "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for member, content in good.items():
            archive.writestr(member, content)
        archive.writestr("bomb.npy", bytes(120_000_000))
    assert "more than 100 MB" in message_of(load_worlds, tmp_path / "b.npz")

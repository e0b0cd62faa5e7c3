"""Invalid files give one clear RecordError; failed writes leave no partial file."""

from __future__ import annotations

import errno
import io
import json
import os
import zipfile
from contextlib import contextmanager

import numpy as np
import pytest

from navstack.core import OutputError, RecordError
from navstack.record import Record
from navstack.record import archive as record_archive
from navstack.record.archive import write
from tests.record import synthetic


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    return synthetic.record_run(6.0, scans=True).save(tmp_path_factory.mktemp("run"))["record"]


def refused(path, *words: str) -> None:
    with pytest.raises(RecordError) as caught:
        Record.load(path)
    message = caught.value.message
    assert "\n" not in message
    assert str(path) in message
    for word in words:
        assert word in message
    assert caught.value.code == 9006


def test_missing(tmp_path):
    refused(tmp_path / "nothing", "does not exist", "navstack simulate")
    refused(tmp_path, "run.npz")


@pytest.mark.parametrize("content", [b"", b"PK", b"not a record at all\n" * 40, bytes(range(256)) * 10])
def test_foreign_bytes(tmp_path, content):
    path = tmp_path / "run.npz"
    path.write_bytes(content)
    refused(path, "not a recorded run")


def test_foreign_archives(tmp_path):
    np.savez(tmp_path / "other.npz", x=np.zeros(3))
    refused(tmp_path / "other.npz", "not a recorded run", "meta.json")
    for meta in ("[]", "{}", '{"format": "other"}', '"navstack-run"', "null", "{", "\xff"):
        with zipfile.ZipFile(tmp_path / "z.npz", "w") as archive:
            archive.writestr("meta.json", meta.encode("latin-1"))
        refused(tmp_path / "z.npz", "not a recorded run")


@pytest.mark.parametrize("version", [2, 99])
def test_a_newer_version(good, tmp_path, version):
    path = rewritten(good, tmp_path, lambda meta, _: meta.update(version=version))
    refused(path, f"version {version}", "update navstack")


@pytest.mark.parametrize("version", [None, "1", 0, -3, 1.5, True])
def test_no_version(good, tmp_path, version):
    refused(rewritten(good, tmp_path, lambda meta, _: meta.update(version=version)), "version")


def test_truncated_anywhere(good, tmp_path):
    content = good.read_bytes()
    path = tmp_path / "run.npz"
    for end in np.linspace(1, len(content) - 1, 60).astype(int):
        path.write_bytes(content[:end])
        refused(path, "truncated")


@pytest.mark.slow
def test_a_flipped_bit_is_detected_or_harmless(good, tmp_path):
    """A zip file has checksums of its members; unprotected bytes (host names, flags) do not affect the data."""
    content = bytearray(good.read_bytes())
    whole = Record.load(good)
    rng = np.random.default_rng(11)
    path = tmp_path / "run.npz"
    noticed = 0
    # the last two thousand bytes are the archive's directory
    places = np.concatenate((rng.integers(0, len(content), 120), rng.integers(len(content) - 2000, len(content), 120)))
    for at in places.tolist():
        bit = 1 << int(rng.integers(0, 8))
        content[at] ^= bit
        path.write_bytes(content)
        try:
            read = Record.load(path)
        except RecordError:
            noticed += 1
        else:
            assert read.meta == whole.meta
            assert all(
                np.array_equal(read.arrays[n], a, equal_nan=a.dtype.kind == "f") for n, a in whole.arrays.items()
            )
        content[at] ^= bit
    assert noticed > 150


def rewritten(good, folder, change):
    """The record with a change in its meta data or arrays, with valid checksums."""
    with zipfile.ZipFile(good) as archive:
        meta = json.loads(archive.read("meta.json"))
        events = [json.loads(line) for line in archive.read("events.jsonl").splitlines()]
        arrays = {
            n[:-4]: np.lib.format.read_array(io.BytesIO(archive.read(n)))
            for n in archive.namelist()
            if n.endswith(".npy")
        }
    change(meta, arrays)
    path = folder / "changed.npz"
    with path.open("wb") as out:
        write(out, meta, events, arrays)
    return path


def drop(name):
    return lambda _, arrays: arrays.pop(name)


def put(name, column, row, value):
    def change(_, arrays):
        arrays[name] = arrays[name].copy()
        arrays[name][column][row] = value

    return change


def replace(name, make):
    return lambda _, arrays: arrays.update({name: make(arrays[name])})


def in_meta(key, value):
    return lambda meta, _: meta.update({key: value})


CHANGES = {
    "no samples": drop("samples"),
    "no map cells": drop("map"),
    "no cells": drop("costmaps/local_cells"),
    "a column less": replace("samples", lambda a: a[list(a.dtype.names[1:])]),
    "text for numbers": replace("goals", lambda a: np.zeros(3, [(n, "<U4") for n in a.dtype.names])),
    "a table of two dimensions": replace("goals", lambda a: a.reshape(1, -1)),
    "other numbers": replace("plan_poses", lambda a: a.astype("<f4")),
    "poses of two": replace("plan_poses", lambda a: a[:, :2]),
    "fewer poses": replace("plan_poses", lambda a: a[:5]),
    "fewer costs": replace("local_plan_costs", lambda a: a[:-1]),
    "fewer critics": in_meta("critics", ["one"]),
    "fewer weights": replace("local_plan_scales", lambda a: a[:-1]),
    "a plan from before the start": put("plans", "first", 0, -1),
    "a plan past the end": put("plans", "count", 0, 1 << 62),
    "a table past the end": put("local_plans", "first", 3, 1 << 40),
    "a trajectory past the end": put("local_plans", "first_pose", 3, 1 << 40),
    "a window outside": put("costmaps/local", "x1", 2, 81),
    "a window turned over": put("costmaps/local", "x0", 2, 81),
    "a grid of no width": put("costmaps/local", "nx", 0, 0),
    "a grid of vast width": put("costmaps/local", "nx", 0, 2**31 - 1),
    "no resolution": put("costmaps/local", "resolution", 0, float("nan")),
    "cells past the end": put("costmaps/local", "first", 5, 1 << 50),
    "a patch of nothing": put("costmaps/global", "x1", 0, 3),
    "a scan from nowhere": put("scans", "source", 0, 7),
    "a scan past the end": put("scans", "count", 0, 1 << 40),
    "a map of another type": replace("map", lambda a: a.astype(np.int16)),
    "a map of one dimension": replace("map", lambda a: a.ravel()),
    "a map without resolution": in_meta("map", {"origin_x": 0}),
    "a map of resolution 0": in_meta(
        "map", {"resolution": 0, "origin_x": 0, "origin_y": 0, "origin_yaw": 0, "frame": "map"}
    ),
    "a footprint of two points": in_meta("footprint", [[0, 1], [1, 0]]),
    "a footprint of text": in_meta("footprint", "circle"),
    "no frames": in_meta("frames", {}),
    "frames of numbers": in_meta("frames", {"global": 1, "local": 2, "base": 3}),
    "a costmap nobody kept": in_meta("costmaps", {"attic": "map"}),
    "costmaps in a list": in_meta("costmaps", ["local"]),
    "results in an object": in_meta("results", {}),
    "results of text": in_meta("results", ["fine"]),
    "no critics": in_meta("critics", None),
    "sources of one": in_meta("scan_sources", [["scan"]]),
    "a sensor without a yaw": in_meta("sensors", {"laser": [0.1, 0.0]}),
    "a sensor at infinity": in_meta("sensors", {"laser": [0.1, 0.0, 1e301]}),
    "notes of numbers": in_meta("local_plan_notes", {"0": 5}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CHANGES)
def test_invalid_contents_are_rejected(good, tmp_path, name):
    refused(rewritten(good, tmp_path, CHANGES[name]))


def test_unchanged_is_read(good, tmp_path):
    Record.load(rewritten(good, tmp_path, lambda meta, arrays: None))


def test_nothing_is_unpickled(good, tmp_path):
    class Bomb:
        def __reduce__(self):
            return (os.mkdir, (str(tmp_path / "exploded"),))

    buffer = io.BytesIO()
    np.save(buffer, np.array([Bomb()], object), allow_pickle=True)
    path = tmp_path / "bomb.npz"
    with zipfile.ZipFile(good) as source, zipfile.ZipFile(path, "w") as out:
        for name in source.namelist():
            out.writestr(name, buffer.getvalue() if name == "goals.npy" else source.read(name))
    refused(path, "bomb.npz")
    assert not (tmp_path / "exploded").exists()


# --- writing ----------------------------------------------------------------------------------------------------------


@contextmanager
def as_nobody():
    """True if the user is root, who can write everywhere."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def test_a_read_only_folder(tmp_path):
    recorder = synthetic.record_run(1.0)
    recorder.save(tmp_path / "fine")
    for folder in (tmp_path, *tmp_path.parents[:2]):
        folder.chmod(0o755)
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    with as_nobody(), pytest.raises(OutputError, match=r"[pP]ermission denied"):
        recorder.save(locked)
    assert list(locked.iterdir()) == []
    with as_nobody(), pytest.raises(OutputError, match="--out"):
        recorder.save(locked / "inside")


def test_a_file_in_place_of_the_folder(tmp_path):
    (tmp_path / "taken").write_text("mine")
    with pytest.raises(OutputError, match="taken"):
        synthetic.record_run(1.0).save(tmp_path / "taken")
    assert (tmp_path / "taken").read_text() == "mine"


@pytest.mark.parametrize("after", [0, 1, 5])
def test_a_full_disk_leaves_the_old_run(tmp_path, monkeypatch, after):
    synthetic.record_run(1.0).save(tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    recorder = synthetic.record_run(2.0)
    written = 0
    add = record_archive._add

    def full(*args):
        nonlocal written
        written += 1
        if written > after:
            raise OSError(errno.ENOSPC, "No space left on device")
        add(*args)

    monkeypatch.setattr(record_archive, "_add", full)
    with pytest.raises(OutputError, match="No space left"):
        recorder.save(tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before

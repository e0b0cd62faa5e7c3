"""Reads and writes the file of a run (`navstack.record.format`), and checks what it reads."""

from __future__ import annotations

import io
import json
import math
import os
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    CappedFile,
    NotRegularFileError,
    RecordError,
    expanded_size,
    read_array,
    read_member,
    short_repr,
    shortened,
    size_text,
)
from navstack.record.columns import Streamed
from navstack.record.commands import check_commands, check_zones
from navstack.record.estimates import check_estimates
from navstack.record.format import ARRAYS, COSTMAP_TABLE, EVENTS, FORMAT, META, RUN_FILE, TABLES, VERSION
from navstack.record.social import check_people
from navstack.record.steering import check_steering

# --- checks -----------------------------------------------------------------------------------------------------------


def check(meta: dict[str, Any], events: list[dict[str, Any]], arrays: dict[str, NDArray[Any]]) -> None:
    """Raises ValueError or KeyError unless the contents have the types, shapes and indices of the format."""
    _check_meta(meta)
    for name, columns in TABLES.items():
        _check_table(name, arrays[name], columns)
    for name, (dtype, ndim) in ARRAYS.items():
        array = arrays[name]
        if array.dtype != np.dtype(dtype) or array.ndim != ndim:
            raise ValueError(f"{name} has the type {array.dtype} and {array.ndim} dimensions")
    clearances = arrays.get("clearances")
    if clearances is not None and (
        clearances.dtype != np.dtype("<f8") or clearances.shape != (len(arrays["samples"]),)
    ):
        raise ValueError("clearances does not have one row per sample")
    check_steering(meta, arrays)
    if "solid_discs" in arrays:
        _check_solids(arrays)
    check_people(arrays)
    for name in ("plan_poses", "local_plan_samples", "local_plan_poses"):
        if arrays[name].shape[1] != 3:
            raise ValueError(f"{name} has shape {arrays[name].shape}")
    if "commands" in arrays:
        check_commands(arrays["commands"])
    check_estimates(arrays)
    check_zones(meta.get("zones", []))
    critics = len(meta["critics"])
    if arrays["local_plan_costs"].shape[1] != critics:
        raise ValueError("local_plan_costs does not have one column per critic")
    if arrays["local_plan_scales"].shape != (len(arrays["local_plans"]), critics):
        raise ValueError("local_plan_scales does not have one row per local plan")
    scored = len(arrays["local_plan_samples"])
    if any(len(arrays[f"local_plan_{name}"]) != scored for name in ("costs", "totals", "rejected_by")):
        raise ValueError("the tables of samples differ in length")
    _check_slices("plans", arrays["plans"]["first"], arrays["plans"]["count"], len(arrays["plan_poses"]))
    plans = arrays["local_plans"]
    _check_slices("local_plans", plans["first"], plans["count"], scored)
    _check_slices("local_plans", plans["first_pose"], plans["poses"], len(arrays["local_plan_poses"]))
    scans = arrays["scans"]
    _check_slices("scans", scans["first"], scans["count"], len(arrays["scan_ranges"]))
    if len(scans) and not (scans["source"].min() >= 0 and scans["source"].max() < len(meta["scan_sources"])):
        raise ValueError("scans refers to a source that is not listed")
    for name in meta["costmaps"]:
        _check_costmap(name, arrays[f"costmaps/{name}"], arrays[f"costmaps/{name}_cells"])
    if meta["map"] is not None:
        cells = arrays["map"]
        if cells.dtype != np.int8 or cells.ndim != 2:
            raise ValueError(f"map has the type {cells.dtype} and {cells.ndim} dimensions")
    for event in events:
        check_event(event)


def check_event(event: Any) -> None:
    """Raises ValueError or KeyError unless the event has the fields of the format."""
    if not isinstance(event, dict):
        raise ValueError("an event is not an object")
    if not (isinstance(event["data"], dict) and isinstance(event["kind"], str) and isinstance(event["text"], str)):
        raise ValueError("an event has fields of a wrong type")
    if not _is_finite(event["time"]):
        raise ValueError("an event has no time")


def _is_finite(value: Any) -> bool:
    """True for a number, finite and within the range of a float."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return -_MAX_NUMBER <= value <= _MAX_NUMBER  # false for NaN


def _check_solids(arrays: dict[str, NDArray[Any]]) -> None:
    discs, corners, first = (arrays[f"solid_{name}"] for name in ("discs", "corners", "first"))
    if discs.dtype != np.dtype("<f4") or discs.ndim != 3 or discs.shape[2] != 3:
        raise ValueError(f"solid_discs has the type {discs.dtype} and the shape {discs.shape}")
    if corners.dtype != np.dtype("<f4") or corners.ndim != 3 or corners.shape[2] != 2:
        raise ValueError(f"solid_corners has the type {corners.dtype} and the shape {corners.shape}")
    if len(discs) != len(corners) or len(discs) not in (1, len(arrays["samples"])):
        raise ValueError("the solids have neither one row nor one row per sample")
    if (
        first.dtype != np.dtype("<i8")
        or first.ndim != 1
        or not len(first)
        or first[0] != 0
        or first[-1] != corners.shape[1]
        or (np.diff(first) < 0).any()
    ):
        raise ValueError("solid_first does not divide solid_corners")


def _check_meta(meta: dict[str, Any]) -> None:
    def check_type(key: str, value: Any, *types: Any) -> None:
        if not isinstance(value, types):
            raise ValueError(f"{key} in {META} has the type {type(value).__name__}")

    for key, kind in _META_TYPES.items():
        check_type(key, meta[key], kind)
    for key in ("global", "local", "base"):
        check_type(f"frames.{key}", meta["frames"][key], str)
    if meta["map"] is not None:
        for key in ("resolution", "origin_x", "origin_y", "origin_yaw"):
            if not _is_finite(meta["map"][key]):
                raise ValueError(f"map.{key} in {META} is {short_repr(meta['map'][key])}, not a finite number")
        if meta["map"]["resolution"] <= 0:
            raise ValueError(f"map.resolution in {META} is not positive")
        check_type("map.frame", meta["map"]["frame"], str)
    corners = meta["footprint"]
    if not 3 <= len(corners) <= MAX_CORNERS or not all(
        isinstance(corner, list) and len(corner) == 2 and all(map(_is_finite, corner)) for corner in corners
    ):
        raise ValueError(f"footprint in {META} is not a list of 3 to {MAX_CORNERS} corners [x, y]")
    for key in ("critics", "costmaps", "scan_sources"):
        if len(meta[key]) > MAX_NAMES:
            raise ValueError(f"{key} in {META} lists {len(meta[key])} names, more than {MAX_NAMES}")
    for result in meta["results"]:
        check_type("results", result, dict)
    for name in meta["critics"]:
        check_type("critics", name, str)
    for notes in meta["local_plan_notes"].values():
        check_type("local_plan_notes", notes, list)
    for frame in meta["costmaps"].values():
        check_type("costmaps", frame, str)
    sensors = meta.get("sensors", {})  # absent in records of 0.1.0
    check_type("sensors", sensors, dict)
    for pose in sensors.values():
        if not (isinstance(pose, list) and len(pose) == 3 and all(map(_is_finite, pose))):
            raise ValueError(f"a pose of sensors in {META} is not [x, y, yaw]")
    for source in meta["scan_sources"]:
        topic, frame = source
        check_type("scan_sources", topic, str)
        check_type("scan_sources", frame, str)


MAX_CORNERS: Final = 10_000
MAX_NAMES: Final = 1_000
_MAX_NUMBER: Final = 1e300
_META_TYPES: Final[dict[str, Any]] = {
    "frames": dict,
    "map": (dict, type(None)),
    "footprint": list,
    "scenario": dict,
    "results": list,
    "critics": list,
    "local_plan_notes": dict,
    "costmaps": dict,
    "scan_sources": list,
}


def _check_table(name: str, array: NDArray[Any], columns: list[tuple[str, str]]) -> None:
    if array.ndim != 1 or array.dtype.names != tuple(column for column, _ in columns):
        raise ValueError(f"{name} does not have the columns of version {VERSION}")
    for column, kind in columns:
        if array.dtype[column].kind != "U" if kind == "<U" else array.dtype[column] != np.dtype(kind):
            raise ValueError(f"{name}.{column} has the type {array.dtype[column]}, not {kind}")


def _check_slices(name: str, first: NDArray[np.int64], count: NDArray[np.int64], total: int) -> None:
    if ((first < 0) | (count < 0) | (first > total) | (count > total - first)).any():
        raise ValueError(f"{name} refers to rows that do not exist")


def _check_costmap(name: str, updates: NDArray[Any], cells: NDArray[Any]) -> None:
    _check_table(f"costmaps/{name}", updates, COSTMAP_TABLE)
    if cells.dtype != np.uint8 or cells.ndim != 1:
        raise ValueError(f"costmaps/{name}_cells has the type {cells.dtype} and {cells.ndim} dimensions")
    if not len(updates):
        return
    wide = {column: updates[column].astype(np.int64) for column in ("nx", "ny", "x0", "y0", "x1", "y1")}
    inside = (
        (wide["nx"] > 0)
        & (wide["ny"] > 0)
        & (wide["x0"] >= 0)
        & (wide["y0"] >= 0)
        & (wide["x1"] >= wide["x0"])
        & (wide["y1"] >= wide["y0"])
        & (wide["x1"] <= wide["nx"])
        & (wide["y1"] <= wide["ny"])
    )
    positive = np.isfinite(updates["resolution"]) & (updates["resolution"] > 0.0)
    if not (inside & positive).all():
        raise ValueError(f"costmaps/{name} has a window outside its grid")
    count = (wide["x1"] - wide["x0"]) * (wide["y1"] - wide["y0"])
    _check_slices(f"costmaps/{name}", updates["first"], count, len(cells))
    whole = count == wide["nx"] * wide["ny"]
    same = np.ones(len(updates), bool)
    for column in ("nx", "ny", "resolution", "origin_x", "origin_y"):
        same[1:] &= updates[column][1:] == updates[column][:-1]
    same[0] = False
    if not (whole | same).all():
        raise ValueError(f"costmaps/{name} updates a grid whose complete state is missing")


MAX_BYTES: Final = 600_000_000
"""Largest sum of the members of a record that is read; NAVSTACK_MAX_RECORD_MB replaces it."""

MAX_JSON_BYTES: Final = 32_000_000
"""Largest `meta.json` and `events.jsonl`: an object takes up to twenty times the memory of its text."""

LIMIT_VARIABLE: Final = "NAVSTACK_MAX_RECORD_MB"
_PIECE: Final = 1 << 20


def dump_json(value: Any) -> str:
    """Returns JSON on one line; equal values give equal texts."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def write(
    file: IO[bytes],
    meta: dict[str, Any],
    events: Iterable[dict[str, Any]],
    arrays: Mapping[str, NDArray[Any] | Streamed],
) -> None:
    """Writes a record; equal contents give equal bytes (fixed order, no time stamps)."""
    with zipfile.ZipFile(file, "w") as archive:
        _add(archive, META, _encoded(dump_json(meta)))
        _add(archive, EVENTS, _encoded("".join(dump_json(event) + "\n" for event in events)))
        for name, array in arrays.items():
            _add(archive, f"{name}.npy", *_as_file(array))


def _encoded(text: str) -> bytes:
    # file names that are not UTF-8 contain lone surrogates: written as \\udcXX, which JSON reads back
    return text.encode("utf-8", "backslashreplace")


def _as_file(array: NDArray[Any] | Streamed) -> tuple[bytes, int, Iterable[Any]]:
    """Returns an array as a file of numpy: its header, the number of bytes that follow, and these."""
    buffer = io.BytesIO()
    if not isinstance(array, Streamed):
        np.lib.format.write_array(buffer, array, version=(1, 0), allow_pickle=False)
        return buffer.getvalue(), 0, ()
    described = {
        "descr": np.lib.format.dtype_to_descr(array.dtype),
        "fortran_order": array.column_major,
        "shape": array.shape,
    }
    np.lib.format.write_array_header_1_0(buffer, described)
    return buffer.getvalue(), math.prod(array.shape) * array.dtype.itemsize, array.pieces()


def _add(archive: zipfile.ZipFile, name: str, content: bytes, more: int = 0, pieces: Iterable[Any] = ()) -> None:
    """Adds a member: `content`, and then `pieces` of `more` bytes in all."""
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.create_system = 3
    info.external_attr = 0o644 << 16
    info.file_size = len(content) + more
    # level 1 already shrinks grids and tables of few values tenfold; higher levels take longer than the run itself. Only
    # `writestr`, which needs the whole content, takes the level as an argument
    info._compresslevel = 1  # pyright: ignore[reportAttributeAccessIssue]
    with archive.open(info, "w") as member:
        # pieces of one size, so that the compressed bytes do not depend on how the record was kept
        waiting = bytearray(content)
        for piece in pieces:
            waiting += piece
            if len(waiting) >= _PIECE:
                whole = len(waiting) - len(waiting) % _PIECE
                for at in range(0, whole, _PIECE):
                    member.write(waiting[at : at + _PIECE])
                del waiting[:whole]
        for at in range(0, len(waiting), _PIECE):
            member.write(waiting[at : at + _PIECE])


def locate(path: Path) -> Path:
    """Returns the file of a record, given the file or its folder. Raises RecordError if it does not exist."""
    if path.is_dir():
        inside = path / RUN_FILE
        if not inside.is_file():
            raise RecordError(
                f"{path} contains no recorded run (no {RUN_FILE}); give the output folder of `navstack simulate`",
                path=str(path),
            )
        return inside
    if not path.exists():
        raise RecordError(
            f"{path} does not exist; give the output folder of `navstack simulate`",
            path=str(path),
        )
    return path


def read(path: Path) -> tuple[dict[str, Any], list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Reads and checks meta, events and arrays of the record in the file `path`.

    Reads no more than the file may expand to: MAX_BYTES, or NAVSTACK_MAX_RECORD_MB. Raises RecordError.
    """
    try:
        with CappedFile(path) as file, zipfile.ZipFile(file) as archive:
            infos = {info.filename: info for info in archive.infolist()}
            if META not in infos:
                raise RecordError(
                    f"{path} is not a recorded run (no {META} in it); give the {RUN_FILE} of a run",
                    path=str(path),
                )
            _check_sizes(path, archive)
            meta = json.loads(read_member(archive, infos[META]))
            _check_version(path, meta)
            events = list(_events(archive, infos[EVENTS]))
            arrays = {name[:-4]: read_array(archive, info) for name, info in infos.items() if name.endswith(".npy")}
        check(meta, events, arrays)
    except RecordError:
        raise
    except PermissionError as exc:
        raise RecordError(f"cannot read {path}: permission denied", path=str(path)) from exc
    except NotRegularFileError as exc:
        raise RecordError(f"{path} {exc.strerror}; give the {RUN_FILE} of a run", path=str(path)) from exc
    except Exception as exc:
        # any error of zipfile, zlib, json, numpy or the checks: the file is not a valid record
        reason = shortened(" ".join(str(exc).split()), 200) or type(exc).__name__
        raise RecordError(
            f"{path} is truncated, damaged or not a recorded run ({reason}); record the run again", path=str(path)
        ) from exc
    return meta, events, arrays


def _check_sizes(path: Path, archive: zipfile.ZipFile) -> None:
    """Raises RecordError for a record that expands beyond the limit, ValueError for a member that no record has."""
    total = expanded_size(archive)
    for info in archive.infolist():
        if info.filename in (META, EVENTS) and info.file_size > MAX_JSON_BYTES:
            raise ValueError(f"{info.filename} is larger than {size_text(MAX_JSON_BYTES)}")
    limit = _limit()
    if total > limit:
        raise RecordError(
            f"{path} expands to {size_text(total)}, more than {size_text(limit)}; if the source of the file is trusted, set the "
            f"environment variable {LIMIT_VARIABLE} to {total // 1_000_000 + 1}",
            path=str(path),
            expanded_bytes=total,
        )


def _limit() -> int:
    text = os.environ.get(LIMIT_VARIABLE, "")
    return int(text) * 1_000_000 if text.isdecimal() and len(text) <= 9 else MAX_BYTES


def _events(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Iterator[dict[str, Any]]:
    """Yields the events, each checked before the next is read."""
    for line in read_member(archive, info).splitlines():
        event = json.loads(line)
        check_event(event)
        yield event


def _check_version(path: Path, meta: Any) -> None:
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise RecordError(f"{path} is not a recorded run of navstack; give the {RUN_FILE} of a run", path=str(path))
    version = meta.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise RecordError(f"{path} has no valid format version: {short_repr(version)}", path=str(path))
    if version > VERSION:
        raise RecordError(
            f"{path} has format version {short_repr(version)}, but this navstack reads versions up to {VERSION}; update navstack",
            path=str(path),
            version=version,
        )

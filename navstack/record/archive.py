"""Reads and writes the file of a run (`navstack.record.format`)."""

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

from navstack.core.bounded_archive import expanded_size, read_array, read_member
from navstack.core.bounded_reading import CappedFile, NotRegularFileError, short_repr, shortened, size_text
from navstack.core.errors import RecordError
from navstack.record.columns import Streamed
from navstack.record.format import EVENTS, FORMAT, META, RUN_FILE, VERSION
from navstack.record.validation import check, check_event

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

"""Reads and writes the file of a run (`navstack.record.format`)."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from navstack.core.errors import RecordError
from navstack.record.format import EVENTS, FORMAT, META, RUN_FILE, VERSION
from navstack.record.validation import check


def dump_json(value: Any) -> str:
    """Returns JSON on one line; equal values give equal texts."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def write(file: IO[bytes], meta: dict[str, Any], events: list[dict[str, Any]], arrays: dict[str, NDArray[Any]]) -> None:
    """Writes a record; equal contents give equal bytes (fixed order, no time stamps)."""
    with zipfile.ZipFile(file, "w") as archive:
        _add(archive, META, _encoded(dump_json(meta)))
        _add(archive, EVENTS, _encoded("".join(dump_json(event) + "\n" for event in events)))
        for name, array in arrays.items():
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, array, version=(1, 0), allow_pickle=False)
            _add(archive, f"{name}.npy", buffer.getbuffer())


def _encoded(text: str) -> bytes:
    # file names that are not UTF-8 contain lone surrogates: written as \\udcXX, which JSON reads back
    return text.encode("utf-8", "backslashreplace")


def _add(archive: zipfile.ZipFile, name: str, content: bytes | memoryview) -> None:
    info = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
    info.compress_type = zipfile.ZIP_DEFLATED
    info.create_system = 3
    info.external_attr = 0o644 << 16
    # level 1 already shrinks grids and tables of few values tenfold; higher levels take longer than the run itself
    archive.writestr(info, content, compresslevel=1)


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
    """Reads and checks meta, events and arrays of the record in the file `path`. Raises RecordError."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if META not in names:
                raise RecordError(
                    f"{path} is not a recorded run (no {META} in it); give the {RUN_FILE} of a run",
                    path=str(path),
                )
            meta = json.loads(archive.read(META))
            _check_version(path, meta)
            events = [json.loads(line) for line in archive.read(EVENTS).splitlines()]
            arrays: dict[str, NDArray[Any]] = {}
            for name in names:
                if name.endswith(".npy"):
                    member = io.BytesIO(archive.read(name))  # reading the whole member verifies its checksum
                    arrays[name[:-4]] = np.lib.format.read_array(member, allow_pickle=False)
                    if member.read(1):
                        raise ValueError(f"{name} has data after its last cell")
        check(meta, events, arrays)
    except RecordError:
        raise
    except PermissionError as exc:
        raise RecordError(f"cannot read {path}: permission denied", path=str(path)) from exc
    except Exception as exc:
        # any error of zipfile, zlib, json, numpy or the checks: the file is not a valid record
        reason = " ".join(str(exc).split()) or type(exc).__name__
        raise RecordError(
            f"{path} is truncated, damaged or not a recorded run ({reason}); record the run again", path=str(path)
        ) from exc
    return meta, events, arrays


def _check_version(path: Path, meta: Any) -> None:
    if not isinstance(meta, dict) or meta.get("format") != FORMAT:
        raise RecordError(f"{path} is not a recorded run of navstack; give the {RUN_FILE} of a run", path=str(path))
    version = meta.get("version")
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise RecordError(f"{path} has no valid format version: {version!r}", path=str(path))
    if version > VERSION:
        raise RecordError(
            f"{path} has format version {version}, but this navstack reads versions up to {VERSION}; update navstack",
            path=str(path),
            version=version,
        )

"""Inputs of studies: CSV tables, and digests and short names that show whether earlier results belong to a study."""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, Final, TypeVar

from navstack.core import InputError, OccupancyGrid, exists, read_bytes, resolved
from navstack.parameters import Configuration, short_name, split_namespace
from navstack.scenario import Scenario

MAX_BYTES: Final = 500_000_000
"""Largest input of a benchmark."""


def _digest(*parts: bytes) -> str:
    """Return the first sixteen hexadecimal digits of the SHA-256."""
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def digest_of_file(file: Path) -> str:
    """Return the digest of the file's content. Raises InputError."""
    try:
        return _digest(read_bytes(file, MAX_BYTES))
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc


def digest_of_configuration(configuration: Configuration) -> str:
    """Return the digest of all loaded parameters."""
    return _digest(_as_bytes(configuration.tree.as_dict()))


def digest_of_map(grid: OccupancyGrid) -> str:
    """Return the digest of the map's cells and of its position."""
    return _digest(_as_bytes([*astuple(grid.geometry), grid.origin_yaw]), grid.data.tobytes())


def digest_of_scenario(scenario: Scenario) -> str:
    """Return the digest of everything that affects a run of the scenario, including its parameters and its map."""
    return _digest(_as_bytes(scenario.as_dict()), digest_of_map(scenario.map).encode())


def _as_bytes(document: Any) -> bytes:
    return json.dumps(document, sort_keys=True, default=str).encode()


def short_names(sources: Sequence[str]) -> list[str]:
    """Name of parameter sources for tables."""
    return [short_name(source) for source in sources]


def for_workers(source: str) -> str:
    """Return a parameter source for any working directory: absolute paths; packaged sets and namespaces unchanged."""
    file, namespace = split_namespace(source)
    return f"{resolved(Path(file))}{'@' if namespace else ''}{namespace}" if exists(Path(file)) else source


# --- CSV tables -------------------------------------------------------------------------------------------------------


T = TypeVar("T")

MAX_CSV_BYTES = 50_000_000
"""Largest table."""


def read_csv(
    file: Path, columns: Sequence[str], convert: Callable[[Mapping[str, str]], T], *, delimiter: str = ","
) -> list[T]:
    """Return the lines of a table whose first line names the columns, each converted by `convert` from its texts by column.

    Raises InputError, with file and line, for an unreadable file, a missing column, a line that is too short, and a value
    for which `convert` raises ValueError.
    """
    needed = ", ".join(columns)
    try:
        lines = io.StringIO(read_bytes(file, MAX_CSV_BYTES).decode("utf-8"), newline="")
        table = csv.DictReader(lines, delimiter=delimiter)
        missing = [c for c in columns if c not in (table.fieldnames or ())]
        if missing:
            raise InputError(
                f"{file}:1: column {missing[0]} is missing; the table needs {needed}", file=str(file), line=1
            )
        return _rows(file, table, columns, convert)
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc
    except (UnicodeDecodeError, csv.Error) as exc:
        raise InputError(f"{file} is not a CSV table ({exc}); it needs the columns {needed}", file=str(file)) from exc


def _rows(
    file: Path, table: csv.DictReader[str], columns: Sequence[str], convert: Callable[[Mapping[str, str]], T]
) -> list[T]:
    found: list[T] = []
    for row in table:
        try:
            if any(row[c] is None for c in columns):
                raise ValueError("the line has too few columns")
            found.append(convert(row))
        except ValueError as exc:
            raise InputError(
                f"{file}:{table.line_num}: {exc}; a line holds {', '.join(columns)}",
                file=str(file),
                line=table.line_num,
            ) from exc
    return found

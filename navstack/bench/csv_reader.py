"""Reading CSV tables, with errors that name file and line."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from navstack.core.bounded_reading import read_bytes
from navstack.core.errors import InputError

T = TypeVar("T")

MAX_BYTES = 50_000_000
"""Largest table."""


def read_csv(
    file: Path, columns: Sequence[str], convert: Callable[[Mapping[str, str]], T], *, delimiter: str = ","
) -> list[T]:
    """The lines of a table whose first line names the columns, each converted by `convert` from its texts by column.

    Raises InputError, with file and line, for an unreadable file, a missing column, a line that is too short, and a value
    for which `convert` raises ValueError.
    """
    needed = ", ".join(columns)
    try:
        lines = io.StringIO(read_bytes(file, MAX_BYTES).decode("utf-8"), newline="")
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

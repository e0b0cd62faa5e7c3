"""Recorded trajectories of people: CSV files with the columns t, id, x, y, as the data sets of ETH and UCY are published."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Final

from navstack.core import InputError, read_bytes

COLUMNS: Final = ("t", "id", "x", "y")
MAX_BYTES: Final = 100_000_000


def read_trajectories(path: Path) -> dict[str, list[list[float]]]:
    """Return the positions [t, x, y] (s, m) of each person of a file by its id, in the order of the times.

    Rows `t, id, x, y` in any order, separated by commas, semicolons, tabs or spaces; a first row of names may order the columns
    otherwise. Raises InputError with the line.
    """
    try:
        text = read_bytes(path, MAX_BYTES).decode("utf-8-sig")
    except OSError as exc:
        raise InputError(
            f"{path}: {exc.strerror}; name a CSV file with the columns t, id, x, y", file=str(path)
        ) from exc
    except UnicodeDecodeError as exc:
        raise InputError(f"{path} is not a text file; name a CSV file with the columns t, id, x, y") from exc
    order = {name: k for k, name in enumerate(COLUMNS)}
    found: dict[str, list[list[float]]] = {}
    lines: dict[tuple[str, float], int] = {}
    for number, line in enumerate(text.splitlines(), 1):
        cells = _cells(line)
        if not cells or cells[0].startswith("#"):
            continue
        if not found and set(COLUMNS) <= {cell.lower() for cell in cells}:
            order = {name: [cell.lower() for cell in cells].index(name) for name in COLUMNS}
            continue
        try:
            t, x, y = (float(cells[order[name]]) for name in ("t", "x", "y"))
            person = cells[order["id"]]
        except (ValueError, IndexError):
            t = x = y = math.nan
            person = ""
        if not (math.isfinite(t) and math.isfinite(x) and math.isfinite(y)):
            raise _error(
                path,
                number,
                f'"{line.strip()[:60]}" is not t, id, x, y; write four numbers, for example 0.4, 1, 2.5, -1.0',
            )
        person = person.removesuffix(".0")
        before = lines.setdefault((person, t), number)
        if before != number:
            raise _error(
                path,
                number,
                f"person {person} is at two positions at {t:g} s (lines {before} and {number}); remove one of the rows",
            )
        found.setdefault(person, []).append([t, x, y])
    for points in found.values():
        points.sort()
    if not found:
        raise InputError(f"{path} has no rows t, id, x, y; name a file with the positions of people", file=str(path))
    return found


def _error(path: Path, line: int, text: str) -> InputError:
    return InputError(f"{path}:{line}:1: {text}", file=str(path), line=line, column=1)


def _cells(line: str) -> list[str]:
    """Split a row at commas or semicolons, else at white space."""
    for delimiter in ",;":
        if delimiter in line:
            return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    return line.split()

"""What a bench was given: tables read, files and parameters told apart by their content."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, TypeVar

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError
from navstack.core.files import exists
from navstack.parameters.configuration import Configuration
from navstack.parameters.sources import short_name, split_namespace
from navstack.scenario.run import Scenario

T = TypeVar("T")


def _digest(*parts: bytes) -> str:
    """Sixteen hexadecimal digits that change with the content."""
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def digest_of_file(file: Path) -> str:
    """Changes with the file's content. Raises InputError."""
    try:
        return _digest(file.read_bytes())
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc


def digest_of_configuration(configuration: Configuration) -> str:
    """Changes with any parameter as it was loaded."""
    return _digest(_as_bytes(configuration.tree.as_dict()))


def digest_of_map(grid: OccupancyGrid) -> str:
    """Changes with the map's cells, and with where they lie."""
    return _digest(_as_bytes([*astuple(grid.geometry), grid.origin_yaw]), grid.data.tobytes())


def digest_of_scenario(scenario: Scenario) -> str:
    """Changes with whatever shapes a run of the scenario: its parameters and its map too."""
    return _digest(_as_bytes(scenario.described()), digest_of_map(scenario.map).encode())


def _as_bytes(told: Any) -> bytes:
    return json.dumps(told, sort_keys=True, default=str).encode()


def short_names(sources: Sequence[str]) -> list[str]:
    """Parameter sources as a table names them."""
    return [short_name(source) for source in sources]


def for_workers(source: str) -> str:
    """A file or folder with its whole path, a packaged set by its name; `file@namespace` keeps its namespace."""
    file, namespace = split_namespace(source)
    return f"{Path(file).resolve()}{'@' if namespace else ''}{namespace}" if exists(Path(file)) else source


def read_table(
    file: Path, columns: Sequence[str], convert: Callable[[Mapping[str, str]], T], *, delimiter: str = ","
) -> list[T]:
    """The lines of a table whose first one names the columns, each as `convert` makes it of its texts by column.

    Raises InputError, with file and line, for a file that cannot be read, a column that is missing, a line that is too
    short, and a value that `convert` refuses by a ValueError.
    """
    found: list[T] = []
    needed = ", ".join(columns)
    try:
        with file.open(encoding="utf-8", newline="") as lines:
            table = csv.DictReader(lines, delimiter=delimiter)
            missing = [c for c in columns if c not in (table.fieldnames or ())]
            if missing:
                raise InputError(
                    f"{file}:1: the table has no column {missing[0]}; it must have {needed}", file=str(file), line=1
                )
            for row in table:
                try:
                    if any(row[c] is None for c in columns):
                        raise ValueError("the line ends before its last column")
                    found.append(convert(row))
                except ValueError as exc:
                    raise InputError(
                        f"{file}:{table.line_num}: {exc}; a line holds {needed}", file=str(file), line=table.line_num
                    ) from exc
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc
    except (UnicodeDecodeError, csv.Error) as exc:
        raise InputError(f"{file} is no table ({exc}); it must have the columns {needed}", file=str(file)) from exc
    return found

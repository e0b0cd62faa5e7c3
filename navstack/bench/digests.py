"""Digests and short names of the inputs of a benchmark; they show whether earlier results belong to it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path
from typing import Any, Final

from navstack.core import OccupancyGrid
from navstack.core.bounded_reading import read_bytes
from navstack.core.errors import InputError
from navstack.core.files import exists, resolved
from navstack.parameters.configuration import Configuration
from navstack.parameters.sources import short_name, split_namespace
from navstack.scenario import Scenario

MAX_BYTES: Final = 500_000_000
"""Largest input of a benchmark."""


def _digest(*parts: bytes) -> str:
    """The first sixteen hexadecimal digits of the SHA-256."""
    return hashlib.sha256(b"".join(parts)).hexdigest()[:16]


def digest_of_file(file: Path) -> str:
    """Digest of the file's content. Raises InputError."""
    try:
        return _digest(read_bytes(file, MAX_BYTES))
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc


def digest_of_configuration(configuration: Configuration) -> str:
    """Digest of all loaded parameters."""
    return _digest(_as_bytes(configuration.tree.as_dict()))


def digest_of_map(grid: OccupancyGrid) -> str:
    """Digest of the map's cells and of its position."""
    return _digest(_as_bytes([*astuple(grid.geometry), grid.origin_yaw]), grid.data.tobytes())


def digest_of_scenario(scenario: Scenario) -> str:
    """Digest of everything that affects a run of the scenario, including its parameters and its map."""
    return _digest(_as_bytes(scenario.as_dict()), digest_of_map(scenario.map).encode())


def _as_bytes(document: Any) -> bytes:
    return json.dumps(document, sort_keys=True, default=str).encode()


def short_names(sources: Sequence[str]) -> list[str]:
    """Names of parameter sources for tables."""
    return [short_name(source) for source in sources]


def for_workers(source: str) -> str:
    """A parameter source that is valid in any working directory: absolute paths; packaged sets and namespaces unchanged."""
    file, namespace = split_namespace(source)
    return f"{resolved(Path(file))}{'@' if namespace else ''}{namespace}" if exists(Path(file)) else source

"""What a bench was given, told apart by its content."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from navstack.configuration import Configuration
from navstack.core.errors import InputError


def digest_of_file(file: Path) -> str:
    """Sixteen hexadecimal digits that change with the content. Raises InputError."""
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()[:16]
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc


def digest_of_configuration(configuration: Configuration) -> str:
    """The same of all parameters as they were loaded."""
    tree: Any = configuration.tree.as_dict()
    return hashlib.sha256(json.dumps(tree, sort_keys=True, default=str).encode()).hexdigest()[:16]


def short_names(sources: Sequence[str]) -> list[str]:
    """Parameter sources as a table names them: `.../turtlebot2/param` is turtlebot2/param, wherever it lies."""
    paths = [Path(s) for s in sources]
    return [f"{p.parent.name}/{p.name}" if p.name in ("param", "params", "config") else p.name for p in paths]


def for_workers(source: str) -> str:
    """A file or folder with its whole path, a packaged set by its name; `file@namespace` keeps its namespace."""
    file, at, namespace = source.partition("@")
    return f"{Path(file).resolve()}{at}{namespace}" if Path(file).exists() else source

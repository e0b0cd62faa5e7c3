"""Files: whether there is one of that name, and writing them whole or not at all."""

from __future__ import annotations

import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from navstack.core.errors import OutputError, jsonable


def is_file(path: Path) -> bool:
    """`Path.is_file`, but False, not an OSError, for a name that is too long or lies where nobody may look."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_dir(path: Path) -> bool:
    """`Path.is_dir`, likewise."""
    try:
        return path.is_dir()
    except OSError:
        return False


def exists(path: Path) -> bool:
    """`Path.exists`, likewise."""
    try:
        return path.exists()
    except OSError:
        return False


def ensure_directory(path: Path) -> Path:
    """Makes the folder and its parents; raises OutputError when it cannot be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(
            f"cannot make the output folder {path}: {exc.strerror or exc}; choose another with --out", path=str(path)
        ) from exc
    if not os.access(path, os.W_OK | os.X_OK):
        raise OutputError(
            f"the output folder {path} cannot be written to: permission denied; choose another with --out",
            path=str(path),
        )
    return path


@contextmanager
def written_whole(path: Path) -> Generator[Path]:
    """A name beside `path` to write to, with the same ending; renamed to `path` on success, removed on failure."""
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield beside
        beside.replace(path)
    except OSError as exc:
        raise OutputError(f"cannot write {path}: {exc.strerror or exc}", path=str(path)) from exc
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: Path, document: Any) -> None:
    """Writes a document as indented JSON, whole or not at all; what is not finite becomes null."""
    write_text(path, json.dumps(jsonable(document), indent=2, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes `text` as UTF-8, whole or not at all."""
    with written_whole(path) as beside:
        beside.write_text(text, encoding="utf-8")

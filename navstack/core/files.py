"""File checks that do not raise, and atomic writes."""

from __future__ import annotations

import json
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from navstack.core.errors import OutputError, jsonable


def is_file(path: Path) -> bool:
    """Return `Path.is_file`, but False instead of an OSError for names that are too long or not accessible."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_dir(path: Path) -> bool:
    """Return `Path.is_dir`, but False instead of an OSError."""
    try:
        return path.is_dir()
    except OSError:
        return False


def exists(path: Path) -> bool:
    """Return `Path.exists`, but False instead of an OSError."""
    try:
        return path.exists()
    except OSError:
        return False


def resolved(path: Path) -> Path:
    """Return the absolute path without links; the absolute path itself for links that form a loop and names that no file has."""
    try:
        return Path(os.path.realpath(path))
    except (OSError, ValueError):
        return Path.cwd() / path


def ensure_directory(path: Path) -> Path:
    """Create the folder and its parents. Raises OutputError if it is not writable."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as exc:
        raise OutputError(
            f"cannot create the output folder {path}: {exc.strerror or exc}; choose another one with --out",
            path=str(path),
        ) from exc
    if not os.access(path, os.W_OK | os.X_OK):
        raise OutputError(
            f"cannot write to the output folder {path}: permission denied; choose another one with --out",
            path=str(path),
        )
    return path


def check_writable(path: Path) -> Path:
    """Raise OutputError unless `path`, a folder or a file, can be written, its folder being made if there is none."""
    above = path
    while not exists(above) and above != above.parent:
        above = above.parent
    if not is_dir(above) and above != path:
        raise OutputError(
            f"cannot write {path}: {above} is not a folder; choose another place with --out", path=str(path)
        )
    folder = above if is_dir(above) else above.parent
    if not os.access(folder, os.W_OK | os.X_OK):
        raise OutputError(
            f"cannot write {path}: {folder} is not writable; choose another place with --out", path=str(path)
        )
    return path


@contextmanager
def atomic_write(path: Path) -> Generator[Path]:
    """Yield a temporary file name next to `path` with the same suffix; rename it to `path` on success, remove it on failure."""
    beside = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield beside
        beside.replace(path)
    except OSError as exc:
        raise OutputError(f"cannot write {path}: {exc.strerror or exc}", path=str(path)) from exc
    finally:
        beside.unlink(missing_ok=True)


def write_json(path: Path, document: Any) -> None:
    """Write a document as indented JSON, atomically. NaN and infinity become null."""
    write_text(path, json.dumps(jsonable(document), indent=2, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Write `text` as UTF-8, atomically."""
    with atomic_write(path) as beside:
        beside.write_text(text, encoding="utf-8")

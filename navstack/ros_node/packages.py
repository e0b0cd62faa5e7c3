"""Writes packages of ROS into a workspace, all or none of them; only those that navstack has written are replaced."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from navstack.core import InputError, OutputError, ensure_directory

EXECUTABLE: Final = 0o755
_MANIFESTS: Final = ("package.xml", "manifest.xml")
_NO_PACKAGE: Final = ("CATKIN_IGNORE", "COLCON_IGNORE", "rospack_nosubdirs")
"""Files that keep tools from taking what is not yet in its place for a package."""


def write_packages(
    folder: Path, packages: Mapping[str, Mapping[str, bytes]], marker: str, *, force: bool
) -> list[Path]:
    """Write packages, given as their files by path, below `folder`; return their folders. Files in scripts/ are executable.

    An existing package whose manifest has the words `marker` is replaced with `force`; otherwise nothing is written and
    InputError is raised. Raises OutputError if the folder cannot be written; everything is as before then.
    """
    for name in packages:
        _check(folder / name, marker, force=force)
    ensure_directory(folder)
    beside = None
    try:
        beside = Path(tempfile.mkdtemp(prefix=".navstack.", dir=folder))
        for name in _NO_PACKAGE:
            (beside / name).touch()
        for name, files in packages.items():
            _write(beside / name, files)
        _exchange(folder, beside, list(packages))
    except OSError as exc:
        raise OutputError(f"cannot write {exc.filename or folder}: {exc.strerror or exc}", path=str(folder)) from exc
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)
    return [folder / name for name in packages]


def _check(target: Path, marker: str, *, force: bool) -> None:
    if not os.path.lexists(target):
        return
    if not _is_ours(target, marker):
        raise InputError(
            f"{target} exists and was not written by navstack; choose another folder, or move it away", path=str(target)
        )
    if not force:
        raise InputError(f"{target} exists; replace it with --force, or choose another folder", path=str(target))


def _is_ours(target: Path, marker: str) -> bool:
    for name in _MANIFESTS:
        try:
            if marker in (target / name).read_text(encoding="utf-8"):
                return not target.is_symlink()
        except (OSError, UnicodeDecodeError):
            continue
    return False


def _write(target: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        file = target / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
        if name.startswith("scripts/"):
            file.chmod(EXECUTABLE)


def _exchange(folder: Path, beside: Path, names: list[str]) -> None:
    """Move the new packages to their places and the old ones away; after an error everything is as before."""
    old = beside / "old"
    old.mkdir()
    done: list[str] = []
    try:
        for name in names:
            if (folder / name).exists():
                (folder / name).rename(old / name)
            done.append(name)
            (beside / name).rename(folder / name)
    except BaseException:
        for name in reversed(done):
            if (folder / name).exists() and not (beside / name).exists():
                (folder / name).rename(beside / name)
            if (old / name).exists():
                (old / name).rename(folder / name)
        raise

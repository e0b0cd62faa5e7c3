"""Locks between processes, which the system releases when the process ends."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from navstack.core.errors import OutputError
from navstack.core.files import ensure_directory, exists


def try_lock(file: int) -> bool:
    """Lock an open file or folder, by its descriptor; return False if another process holds the lock.

    Returns True where the system or the file system has no locks: there, two processes are not detected.
    """
    try:
        import fcntl
    except ImportError:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True


@contextmanager
def locked_folder(folder: Path) -> Generator[None]:
    """Create an output folder and hold its lock. Raises OutputError if it is not writable or another process writes into it.

    The folder itself is locked, so that no lock file remains in it. After an error, folders that were created and are still
    empty are removed.
    """
    missing = [path for path in (folder, *folder.parents) if not exists(path)]
    ensure_directory(folder)
    try:
        with _lock_of(folder):
            yield
    except BaseException:
        for path in missing:
            try:
                path.rmdir()
            except OSError:  # not empty
                break
        raise


@contextmanager
def _lock_of(folder: Path) -> Generator[None]:
    try:
        number = os.open(folder, os.O_RDONLY | getattr(os, "O_CLOEXEC", 0))
    except OSError:  # not readable, or a system that cannot open folders
        yield
        return
    try:
        if not try_lock(number):
            raise OutputError(
                f"another process is writing to {folder}; wait for it, or choose another folder with --out",
                path=str(folder),
            )
        yield
    finally:
        os.close(number)

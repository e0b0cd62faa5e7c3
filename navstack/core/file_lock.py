"""Locks between processes, which the system releases when the process ends."""

from __future__ import annotations

import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from navstack.core.errors import OutputError


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
    """Hold the lock of an output folder. Raises OutputError if another process writes into it.

    The folder itself is locked, so that no lock file remains in it.
    """
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

"""Storages of a study: a journal file for one machine, or a database supported by Optuna for several."""

from __future__ import annotations

import logging
import os
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from navstack.core.errors import InputError, OutputError
from navstack.core.files import ensure_directory
from navstack.tune.optuna_tools import load_optuna, without_warnings

HEARTBEAT_S: Final = 30
"""In a database, a trial is lost if there was no heartbeat for four times as long."""


def is_url(storage: str) -> bool:
    """True for a database, false for a file."""
    return "://" in storage


@contextmanager
def open_storage(storage: str) -> Generator[Any]:
    """Optuna's storage. A journal file is locked against other processes while it is open.

    Raises InputError or OutputError for an unusable storage.
    """
    optuna = load_optuna()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    if is_url(storage):
        yield _database(optuna, storage)
        return
    path = Path(storage)
    try:
        ensure_directory(path.parent)
    except OutputError as exc:
        raise OutputError(
            exc.message.replace("the output folder", "the study's folder").replace("--out", "--storage"), **exc.data
        ) from exc
    _check_writable(path)
    with _locked(path):
        _drop_partial_line(path)
        # we hold the lock, so a lock file of Optuna belongs to a killed process
        path.with_name(path.name + ".lock").unlink(missing_ok=True)
        journal = optuna.storages.journal
        try:
            yield optuna.storages.JournalStorage(journal.JournalFileBackend(str(path)))
        except (ValueError, KeyError) as exc:
            if _is_journal(path):
                raise
            raise _not_a_journal(path) from exc


def _is_journal(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(1) in (b"", b"{")


def _not_a_journal(path: Path) -> InputError:
    return InputError(f"{path} is not a journal of a study; give another file with --storage", path=str(path))


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give --storage the name of a file in it", path=str(path))
    if path.exists() and not os.access(path, os.W_OK):
        raise OutputError(
            f"the study in {path} is read-only; make it writable, or give --storage a copy of it",
            path=str(path),
        )
    if path.exists() and not _is_journal(path):
        raise _not_a_journal(path)


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Holds a lock that the system releases with the process."""
    try:
        import fcntl
    except ImportError:  # not available on this system: two processes on one file are not detected
        yield
        return
    lock = path.with_name(f".{path.name}.inuse")
    try:
        file = lock.open("w")
    except OSError as exc:
        raise OutputError(f"cannot write {lock}: {exc.strerror or exc}", path=str(lock)) from exc
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"the study in {path} is in use by another process; wait for it, or give another --storage (a database such "
                "as sqlite:///study.db allows several processes)",
                path=str(path),
            ) from None
        yield


def _drop_partial_line(path: Path) -> None:
    """Removes an incomplete last line, left by a killed process."""
    if not path.exists():
        return
    data = path.read_bytes()
    if data and not data.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(data.rfind(b"\n") + 1)


def _database(optuna: Any, url: str) -> Any:
    logging.getLogger("alembic").setLevel(logging.ERROR)
    engine = {"connect_args": {"timeout": 30}} if url.startswith("sqlite") else {}
    try:
        with without_warnings():
            return optuna.storages.RDBStorage(
                url, heartbeat_interval=HEARTBEAT_S, grace_period=4 * HEARTBEAT_S, engine_kwargs=engine
            )
    except Exception as exc:  # each driver has its own exceptions
        reason = str(exc).strip().splitlines()
        raise InputError(
            f'--storage "{url}" cannot be used: {reason[0] if reason else type(exc).__name__}; give a file, or a reachable '
            "database such as sqlite:///study.db",
            storage=url,
        ) from exc

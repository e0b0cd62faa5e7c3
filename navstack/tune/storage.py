"""Where a study is kept: a journal file for one machine, any database that Optuna takes for many."""

from __future__ import annotations

import logging
import os
import warnings
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from navstack.core.errors import InputError, OutputError
from navstack.core.files import ensure_directory
from navstack.tune.extras import need

HEARTBEAT_S: Final = 30
"""On a database, a trial that has not been heard of for four times as long belongs to nobody any more."""


def is_url(storage: str) -> bool:
    """True for a database, false for a file."""
    return "://" in storage


@contextmanager
def opened(storage: str) -> Generator[Any]:
    """Optuna's storage. A journal file is locked against other processes while it is open.

    Raises InputError or OutputError for one that cannot be used, with the reason.
    """
    optuna = need("optuna", "tuning")
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
        _mend(path)
        # nobody else writes while we hold the lock: one that a killed process left behind means nothing
        path.with_name(path.name + ".lock").unlink(missing_ok=True)
        journal = optuna.storages.journal
        try:
            yield optuna.storages.JournalStorage(journal.JournalFileBackend(str(path)))
        except (ValueError, KeyError) as exc:
            if _is_journal(path):
                raise
            raise InputError(
                f"{path} is no journal of a study; name another file by --storage", path=str(path)
            ) from exc


def _is_journal(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(1) in (b"", b"{")


def _check_writable(path: Path) -> None:
    if path.is_dir():
        raise OutputError(f"{path} is a folder; give --storage a file's name in it", path=str(path))
    if path.exists() and not os.access(path, os.W_OK):
        raise OutputError(
            f"the study in {path} is read-only; make it writable, or copy it and give --storage the copy",
            path=str(path),
        )
    if path.exists() and not _is_journal(path):
        raise InputError(f"{path} is no journal of a study; name another file by --storage", path=str(path))


@contextmanager
def _locked(path: Path) -> Generator[None]:
    """Holds a lock that ends with the process, however it ends."""
    try:
        import fcntl
    except ImportError:  # not on this system: whoever starts two at once is on their own
        yield
        return
    beside = path.with_name(f".{path.name}.inuse")
    try:
        file = beside.open("w")
    except OSError as exc:
        raise OutputError(f"cannot write {beside}: {exc.strerror or exc}", path=str(beside)) from exc
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(
                f"the study in {path} is in use by another navstack; wait for it, or give another --storage (for several "
                "at once, a database such as sqlite:///study.db)",
                path=str(path),
            ) from None
        yield


def _mend(path: Path) -> None:
    """Drops a last line that a kill cut short."""
    if not path.exists():
        return
    data = path.read_bytes()
    if data and not data.endswith(b"\n"):
        with path.open("r+b") as file:
            file.truncate(data.rfind(b"\n") + 1)


def _database(optuna: Any, url: str) -> Any:
    logging.getLogger("alembic").setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return optuna.storages.RDBStorage(
                url, heartbeat_interval=HEARTBEAT_S, grace_period=4 * HEARTBEAT_S, engine_kwargs=_engine_options(url)
            )
    except Exception as exc:  # whatever a database's driver raises
        reason = str(exc).strip().splitlines()
        raise InputError(
            f'--storage "{url}" cannot be used: {reason[0] if reason else type(exc).__name__}; give a file, or a database '
            "that can be reached, such as sqlite:///study.db",
            storage=url,
        ) from exc


def _engine_options(url: str) -> dict[str, Any]:
    return {"connect_args": {"timeout": 30}} if url.startswith("sqlite") else {}

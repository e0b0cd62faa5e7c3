"""Results as lines of JSON that survive a kill: appended immediately, read on resume, sorted at the end.

The first line describes the jobs: `{"navstack_jobs": 1, "what": {..}, "jobs": 50, "fingerprint": ".."}`; each
other line is a result: `{"key": .., "value": ..}` or `{"key": .., "error": ..}`.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Self

from navstack import __version__
from navstack.core import InputError, OutputError, atomic_write, ensure_directory, jsonable, try_lock
from navstack.studies.jobs import JobResult

FORMAT: Final = 1


class ResultsFile:
    """A results file, open for appending and locked against other processes.

    `what` (JSON data) describes the inputs other than the jobs' keys; a file with another description is rejected with a message
    that names the difference. Without `resume`, a file with results is rejected too. Results whose keys are not among `keys` are
    rejected; those with an error are computed again.

    Raises InputError, OutputError.
    """

    def __init__(self, path: Path, what: Mapping[str, Any], keys: Sequence[str], *, resume: bool) -> None:
        self.path = path
        self.done: dict[str, JobResult] = {}
        """Results read from the file."""
        self._keys = frozenset(keys)
        self._head = _head(what, keys)
        ensure_directory(path.parent)
        self._file = self._open()
        try:
            self._read(resume)
        except BaseException:
            self.close()
            raise

    def add(self, result: JobResult) -> None:
        """Append a line and flushes it to disk."""
        self._append(result.as_line())

    def put_in_order(self, results: Sequence[JobResult]) -> None:
        """Rewrite the file atomically with the results in this order, and closes it."""
        text = "".join(f"{line}\n" for line in (json.dumps(self._head), *(r.as_line() for r in results)))
        if self.path.read_bytes() != text.encode():
            with atomic_write(self.path) as beside, beside.open("w", encoding="utf-8") as file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
        self.close()

    def close(self) -> None:
        """Close the file. May be called twice."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self) -> int:
        while True:
            try:
                file = os.open(self.path, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o666)
            except OSError as exc:
                raise OutputError(f"cannot write {self.path}: {exc.strerror or exc}", path=str(self.path)) from exc
            if not try_lock(file):
                os.close(file)
                raise OutputError(
                    f"{self.path} is being written by another process; wait for it or choose another folder",
                    path=str(self.path),
                )
            # the previous owner of the lock may have replaced the file
            with contextlib.suppress(FileNotFoundError):
                if self.path.stat().st_ino == os.fstat(file).st_ino:
                    return file
            os.close(file)

    def _append(self, line: str) -> None:
        data = f"{line}\n".encode()
        try:
            while data:
                data = data[os.write(self._file, data) :]
            os.fsync(self._file)
        except OSError as exc:
            raise OutputError(
                f"cannot write {self.path}: {exc.strerror or exc}; its contents are intact, continue with --resume",
                path=str(self.path),
            ) from exc

    def _read(self, resume: bool) -> None:
        text = self.path.read_bytes()
        whole, _, torn = text.rpartition(b"\n")
        lines = whole.split(b"\n") if whole else []
        kept = len(text) - len(torn)
        if not lines:
            if len(torn) > 0 and not torn.startswith(b'{"navstack_jobs"'[: len(torn)]):
                raise self._foreign(1)
            os.ftruncate(self._file, 0)
            self._append(json.dumps(self._head))
            return
        self._compare(lines[0])
        if not resume and len(lines) > 1:
            raise InputError(
                f"{self.path} already contains {len(lines) - 1} of {len(self._keys)} results; continue with --resume, or choose "
                "another --out",
                path=str(self.path),
            )
        for number, line in enumerate(lines[1:], 2):
            try:
                result = JobResult.from_line(line)
            except ValueError:
                if number < len(lines):
                    raise self._foreign(number) from None
                kept -= len(line) + 1  # the last line is damaged: computed again
                break
            if result.key not in self._keys:
                raise self._foreign(number)
            if not result.failed:
                self.done[result.key] = result
        os.ftruncate(self._file, kept)

    def _compare(self, line: bytes) -> None:
        """Raise InputError if the file belongs to other jobs."""
        try:
            there: Any = json.loads(line)
            format_, what, fingerprint = there["navstack_jobs"], there["what"], there["fingerprint"]
        except (ValueError, KeyError, TypeError):
            raise self._foreign(1) from None
        if format_ == FORMAT and fingerprint == self._head["fingerprint"] and what == self._head["what"]:
            return
        differences = list(_differences(what, self._head["what"])) or ["the list of jobs differs"]
        raise InputError(
            f"{self.path} contains results of other jobs: {'; '.join(differences[:3])}; use the same arguments, or choose "
            "another --out",
            path=str(self.path),
            differences=differences,
        )

    def _foreign(self, line: int) -> InputError:
        return InputError(
            f"{self.path}:{line} is not a result of these jobs; choose another --out, or remove the file",
            path=str(self.path),
            line=line,
        )


def _head(what: Mapping[str, Any], keys: Sequence[str]) -> dict[str, Any]:
    description = jsonable({**what, "navstack": __version__})
    digest = hashlib.sha256(json.dumps([description, list(keys)], sort_keys=True).encode()).hexdigest()
    return {"navstack_jobs": FORMAT, "what": description, "jobs": len(keys), "fingerprint": digest[:16]}


def _differences(there: Any, here: Any, name: str = "") -> Iterator[str]:
    if isinstance(there, dict) and isinstance(here, dict):
        for key in dict.fromkeys([*there, *here]):
            yield from _differences(there.get(key), here.get(key), f"{name}.{key}" if name else str(key))
    elif there != here:
        yield f"{name or 'what'} was {_short(there)}, now it is {_short(here)}"


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."

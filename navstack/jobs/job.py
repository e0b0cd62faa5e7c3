"""What a job is, what comes of it, and who may run it."""

from __future__ import annotations

import json
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, Self

from navstack.core.errors import NavError, jsonable

Work = Callable[[Any], Any]
"""A job's input -> JSON. A pure function: where it runs and what ran before it must not matter."""


@dataclass(frozen=True, slots=True)
class Job:
    """One piece of work."""

    key: str
    """Its name among the jobs of a run: the same in every run of the same jobs (`world 31 seed 0`)."""
    input: Any
    """What `work` is called with; goes to another process, so it can be pickled."""


@dataclass(frozen=True, slots=True)
class JobResult:
    """What came of a job."""

    key: str
    value: Any = None
    """JSON; None with an `error`."""
    error: dict[str, Any] | None = None
    """Why there is no value: `code`, `name`, `message` and data, as `NavError.as_dict` has them."""

    @property
    def failed(self) -> bool:
        """True where there is no value."""
        return self.error is not None

    def as_line(self) -> str:
        """One line of JSON, without its end."""
        told = {"key": self.key, "error": self.error} if self.failed else {"key": self.key, "value": self.value}
        return json.dumps(told, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_line(cls, line: str | bytes) -> JobResult:
        """The inverse of `as_line`; raises ValueError for anything else."""
        told: Any = json.loads(line)
        if not isinstance(told, dict) or not isinstance(told.get("key"), str) or not {"value", "error"} & set(told):
            raise ValueError("not the result of a job")
        return cls(told["key"], told.get("value"), told.get("error"))


def perform(work: Work, job: Job) -> JobResult:
    """Does the job here and now. An exception is a result too; the value is what a results file would give back."""
    try:
        # there and back: the same whether it was computed now or read from a file
        return JobResult.from_line(JobResult(job.key, jsonable(work(job.input))).as_line())
    except NavError as error:
        return JobResult(job.key, error=error.as_dict())
    except Exception as error:
        where = "".join(traceback.format_exception(error))
        message = f"{type(error).__name__}: {error}"
        return JobResult(job.key, error={"code": 9099, "name": "INTERNAL", "message": message, "traceback": where})


class Executor(Protocol):
    """Runs jobs somewhere: here, in processes, on a cluster. Made with the work that all its jobs are for."""

    @property
    def slots(self) -> int:
        """How many jobs run at once."""
        ...

    def submit(self, job: Job) -> None:
        """Takes a job; returns at once."""
        ...

    def collect(self) -> JobResult:
        """Waits for any job to end. Each job submitted is collected once, in whatever order they end."""
        ...

    def close(self) -> None:
        """Ends whatever runs. May be called twice."""
        ...


class SerialExecutor:
    """Runs jobs in this process, one after the other."""

    slots = 1

    def __init__(self, work: Work) -> None:
        self._work = work
        self._waiting: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        """Puts the job in the queue."""
        self._waiting.append(job)

    def collect(self) -> JobResult:
        """Runs the next job of the queue."""
        return perform(self._work, self._waiting.popleft())

    def close(self) -> None:
        """Forgets what is waiting."""
        self._waiting.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

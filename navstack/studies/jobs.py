"""Jobs, their results, and what runs them: one at a time in this process, or another executor."""

from __future__ import annotations

import json
import traceback
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, Self

from navstack.core import NavError, jsonable

Work = Callable[[Any], Any]
"""A job's input -> JSON data. A pure function: its result does not depend on the process or on previous jobs."""


@dataclass(frozen=True, slots=True)
class Job:
    """One unit of work."""

    key: str
    """Unique name, the same in every run of the same jobs (`world 31 seed 0`)."""
    input: Any
    """Argument of `work`; must be picklable."""
    weight: float = 1.0
    """Its expected duration relative to others, for the estimate of the time left."""


@dataclass(frozen=True, slots=True)
class JobResult:
    """The result of a job."""

    key: str
    value: Any = None
    """JSON data; None if there is an `error`."""
    error: dict[str, Any] | None = None
    """`code`, `name`, `message` and data, as in `NavError.as_dict`."""

    @property
    def failed(self) -> bool:
        """True if the job has an error."""
        return self.error is not None

    def as_line(self) -> str:
        """Return one line of JSON, without the newline."""
        fields = {"key": self.key, "error": self.error} if self.failed else {"key": self.key, "value": self.value}
        return json.dumps(fields, allow_nan=False, separators=(",", ":"))

    @classmethod
    def from_line(cls, line: str | bytes) -> JobResult:
        """Invert `as_line`. Raises ValueError for anything else."""
        fields: Any = json.loads(line)
        if (
            not isinstance(fields, dict)
            or not isinstance(fields.get("key"), str)
            or not {"value", "error"} & set(fields)
        ):
            raise ValueError("not the result of a job")
        return cls(fields["key"], fields.get("value"), fields.get("error"))


def perform(work: Work, job: Job) -> JobResult:
    """Run the job in this process. An exception becomes an error result; the value is as read from a results file."""
    try:
        # round trip through JSON: the same value whether it was computed now or read from a file
        return JobResult.from_line(JobResult(job.key, jsonable(work(job.input))).as_line())
    except NavError as error:
        return JobResult(job.key, error=error.as_dict())
    except Exception as error:
        where = "".join(traceback.format_exception(error))
        message = f"{type(error).__name__}: {error}"
        return JobResult(job.key, error={"code": 9099, "name": "INTERNAL", "message": message, "traceback": where})


class Executor(Protocol):
    """Runs jobs: in this process, in worker processes or on a cluster. It is created for one work function."""

    @property
    def slots(self) -> int:
        """Number of jobs that run concurrently."""
        ...

    def submit(self, job: Job) -> None:
        """Queue a job; returns immediately."""
        ...

    def collect(self) -> JobResult:
        """Wait for any job to end and returns its result. Each submitted job is collected once, in order of completion."""
        ...

    def close(self) -> None:
        """Stop all jobs. May be called twice."""
        ...


class SerialExecutor:
    """Runs jobs in this process, one at a time."""

    slots = 1

    def __init__(self, work: Work) -> None:
        self._work = work
        self._waiting: deque[Job] = deque()

    def submit(self, job: Job) -> None:
        """Queue the job."""
        self._waiting.append(job)

    def collect(self) -> JobResult:
        """Run the next job in the queue."""
        return perform(self._work, self._waiting.popleft())

    def close(self) -> None:
        """Clear the queue."""
        self._waiting.clear()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

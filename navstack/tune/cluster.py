"""Runs the jobs of a sweep on a Dask cluster, with the same results as local processes."""

from __future__ import annotations

import itertools
import time
import uuid
from typing import Any, Final, Self

from navstack import __version__
from navstack.core.errors import InputError
from navstack.core.optional_dependencies import require
from navstack.jobs import Job, JobResult
from navstack.jobs.job import Work, perform

_POLL_S: Final = 0.005
_CHECK_WORKERS_S: Final = 5.0
NO_WORKERS_TIMEOUT_S: Final = 60.0
"""A cluster without workers for this long is an error."""
CONNECT_TIMEOUT_S: Final = 10.0


def _version() -> str:
    return __version__


class DaskExecutor:
    """An `Executor` of `navstack.jobs`. The scheduler restarts a job on another worker if its worker dies.

    Each worker receives the work once, including workers that join later. Raises InputError for an unreachable scheduler, one
    without workers, and workers with another version of navstack.
    """

    def __init__(self, work: Work, address: str) -> None:
        self._distributed: Any = require("distributed", "running on a cluster")
        try:
            self._client: Any = self._distributed.Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as exc:
            raise InputError(
                f"no Dask scheduler answers at {address} ({_reason(exc)}); start one with `dask scheduler` and give its "
                "address, such as tcp://127.0.0.1:8786",
                scheduler=address,
            ) from exc
        self._name = f"navstack-{uuid.uuid4().hex}"
        self._numbers = itertools.count()
        self._jobs: dict[str, str] = {}
        try:
            self._check(address)
            self._client.register_plugin(_plugin(self._distributed, self._name, work))
        except BaseException:
            self._client.close()
            raise
        self._ended: Any = self._distributed.as_completed(loop=self._client.loop, raise_errors=False)

    def _check(self, address: str) -> None:
        versions: dict[str, Any] = self._client.run(_version, on_error="return")
        if not versions:
            raise InputError(
                f"the Dask scheduler at {address} has no workers; start some with `dask worker {address} --nthreads 1`",
                scheduler=address,
            )
        for worker, version in sorted(versions.items()):
            if version != __version__:
                raise InputError(
                    f"the Dask worker {worker} has navstack {version}, this machine has {__version__}; install the same version",
                    scheduler=address,
                    worker=worker,
                )

    @property
    def slots(self) -> int:
        """Twice the number of threads of all workers, so that no worker waits for its next job."""
        return max(1, 2 * sum(self._client.nthreads().values()))

    def submit(self, job: Job) -> None:
        """Submits the job to the scheduler."""
        key = f"{self._name}-{next(self._numbers)}"
        self._jobs[key] = job.key
        self._ended.add(self._client.submit(_perform, self._name, job, key=key, pure=False))

    def collect(self) -> JobResult:
        """Waits for any job to end. Raises InputError after a minute without workers."""
        no_workers_since: float | None = None
        checked = time.monotonic()
        while not self._ended.has_ready():
            time.sleep(_POLL_S)
            now = time.monotonic()
            if now - checked < _CHECK_WORKERS_S:
                continue
            checked = now
            if self._client.status == "running" and self._client.nthreads():
                no_workers_since = None
            elif no_workers_since is None:
                no_workers_since = now
            elif now - no_workers_since > NO_WORKERS_TIMEOUT_S:
                raise InputError("the Dask cluster has lost all workers; start some, and add --resume to continue")
        future = next(self._ended)
        job = self._jobs.pop(future.key)
        if future.status == "finished":
            return JobResult.from_line(future.result())
        error = future.exception()
        message = f"{type(error).__name__}: {error}" if error is not None else "the cluster cancelled the job"
        return JobResult(job, error={"code": 9099, "name": "WORKER_DIED", "message": message})

    def close(self) -> None:
        """Drops the running jobs and disconnects."""
        self._client.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _reason(error: BaseException) -> str:
    text = str(error).strip().splitlines()
    return text[0] if text else type(error).__name__


def _plugin(distributed: Any, name: str, work: Work) -> Any:
    class NavstackWork(distributed.WorkerPlugin):  # type: ignore[misc]
        """Stores the work on each worker."""

        def __init__(self) -> None:
            self.name = name
            self.work = work

        def setup(self, worker: Any) -> None:
            setattr(worker, self.name.replace("-", "_"), self.work)

    return NavstackWork()


def _perform(name: str, job: Job) -> str:
    """Performs the job on a worker."""
    from distributed import get_worker

    return perform(getattr(get_worker(), name.replace("-", "_")), job).as_line()

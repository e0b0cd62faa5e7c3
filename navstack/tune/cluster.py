"""The jobs of a sweep on a Dask cluster: the same work, the same results, wherever the workers are."""

from __future__ import annotations

import itertools
import time
import uuid
from typing import Any, Final, Self

from navstack import __version__
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.jobs.job import Work, perform
from navstack.tune.extras import need

_POLL_S: Final = 0.005
_LOOK_S: Final = 5.0
ALONE_S: Final = 60.0
"""So long a cluster may be without workers."""
ANSWER_S: Final = 10.0
"""So long a scheduler may take to answer."""


def _version() -> str:
    return __version__


class DaskExecutor:
    """An `Executor` of `navstack.jobs`. A job whose worker dies is begun again by the scheduler, elsewhere.

    The work goes to each worker once, also to those that come later. Raises InputError where there is no scheduler,
    or one without workers, or workers of another navstack.
    """

    def __init__(self, work: Work, address: str) -> None:
        self._distributed: Any = need("distributed", "running on a cluster")
        try:
            self._client: Any = self._distributed.Client(address, timeout=ANSWER_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as exc:
            raise InputError(
                f"no Dask scheduler answers at {address} ({_reason(exc)}); start one by `dask scheduler` and give its "
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
                f"the Dask scheduler at {address} has no workers; start some by `dask worker {address} --nthreads 1`",
                scheduler=address,
            )
        for worker, version in sorted(versions.items()):
            if version != __version__:
                raise InputError(
                    f"the Dask worker {worker} has navstack {version}, not {__version__} as here; install the same there",
                    scheduler=address,
                    worker=worker,
                )

    @property
    def slots(self) -> int:
        """Twice the threads of all workers, so that none waits for the next job."""
        return max(1, 2 * sum(self._client.nthreads().values()))

    def submit(self, job: Job) -> None:
        """Hands the job to the scheduler."""
        key = f"{self._name}-{next(self._numbers)}"
        self._jobs[key] = job.key
        self._ended.add(self._client.submit(_perform, self._name, job, key=key, pure=False))

    def collect(self) -> JobResult:
        """Waits for any job to end. Raises InputError when the cluster has had no workers for a minute."""
        alone_since: float | None = None
        looked = time.monotonic()
        while not self._ended.has_ready():
            time.sleep(_POLL_S)
            now = time.monotonic()
            if now - looked < _LOOK_S:
                continue
            looked = now
            if self._client.status == "running" and self._client.nthreads():
                alone_since = None
            elif alone_since is None:
                alone_since = now
            elif now - alone_since > ALONE_S:
                raise InputError("the Dask cluster has lost its workers; start some, and go on with --resume")
        future = next(self._ended)
        job = self._jobs.pop(future.key)
        if future.status == "finished":
            return JobResult.from_line(future.result())
        error = future.exception()
        message = f"{type(error).__name__}: {error}" if error is not None else "the cluster cancelled the job"
        return JobResult(job, error={"code": 9099, "name": "WORKER_DIED", "message": message})

    def close(self) -> None:
        """Forgets what is under way and lets go of the scheduler."""
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
        """Puts the work where the jobs find it."""

        def __init__(self) -> None:
            self.name = name
            self.work = work

        def setup(self, worker: Any) -> None:
            setattr(worker, self.name.replace("-", "_"), self.work)

    return NavstackWork()


def _perform(name: str, job: Job) -> str:
    """Does the job on a worker."""
    from distributed import get_worker

    return perform(getattr(get_worker(), name.replace("-", "_")), job).as_line()

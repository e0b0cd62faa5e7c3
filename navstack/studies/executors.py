"""Executors: jobs in worker processes, which are replaced when they die and end with this process, or on a Dask cluster."""

from __future__ import annotations

import contextlib
import itertools
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import uuid
from collections import deque
from collections.abc import Generator
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final, Self

from navstack import __version__
from navstack.core import InputError, InternalError, require
from navstack.studies.jobs import Job, JobResult, Work, perform

MAX_ATTEMPTS: Final = 2
"""Maximum number of attempts for a job whose worker dies."""
_READY: Final = b"ready"
_UNPICKLABLE: Final = (pickle.PicklingError, AttributeError, TypeError, ImportError)


def usable_cores() -> int:
    """Return the number of cores that this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1


@dataclass(slots=True, eq=False)
class _Worker:
    process: BaseProcess
    pipe: Connection
    job: Job | None = None
    ready: bool = False


class ProcessExecutor:
    """Runs jobs in `processes` workers (default: all usable cores).

    A worker that dies is replaced and its job retried once. `work` and the jobs' inputs must be picklable; each worker
    receives `work` once, so data that it caches is loaded once per worker. Workers print to stderr, ignore Ctrl-C (this process
    stops them) and end when this process does.
    """

    def __init__(self, work: Work, processes: int | None = None) -> None:
        if processes is not None and processes < 1:
            raise InputError(f"processes is {processes}; it must be at least 1", argument="processes", value=processes)
        self._slots = processes or usable_cores()
        self._work = work
        # a fork of this process could inherit held locks; a fork server has none
        method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
        self._context: Any = multiprocessing.get_context(method)
        if method == "forkserver":
            self._context.set_forkserver_preload([__name__, getattr(work, "__module__", None) or __name__])
        self._workers: list[_Worker] = []
        self._waiting: deque[Job] = deque()
        self._finished: deque[JobResult] = deque()
        self._attempts: dict[str, int] = {}

    @property
    def slots(self) -> int:
        """How many jobs run at once."""
        return self._slots

    def submit(self, job: Job) -> None:
        """Send the job to an idle worker, or queues it."""
        self._waiting.append(job)
        self._dispatch()

    def collect(self) -> JobResult:
        """Wait for any job to end and returns its result."""
        while not self._finished:
            if not self._workers:
                raise InternalError("no job is running; submit one before collecting")
            ready = wait([w.pipe for w in self._workers])
            for worker in [w for w in self._workers if w.pipe in ready]:
                self._receive(worker)
            self._dispatch()
        return self._finished.popleft()

    def close(self) -> None:
        """Kill the workers."""
        workers, self._workers = self._workers, []
        self._waiting.clear()
        for worker in workers:
            worker.pipe.close()
            worker.process.kill()
        for worker in workers:
            worker.process.join()
            worker.process.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _dispatch(self) -> None:
        while self._waiting:
            idle = next((w for w in self._workers if w.job is None), None)
            if idle is None and len(self._workers) < self._slots:
                idle = self._start()
            if idle is None:
                return
            job = self._waiting.popleft()
            idle.job = job
            self._attempts[job.key] = self._attempts.get(job.key, 0) + 1
            # a worker that died while idle is detected by the next collect
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                try:
                    idle.pipe.send(job)
                except _UNPICKLABLE as exc:
                    raise InternalError(f"the job {job.key!r} cannot be sent to another process: {exc}") from exc

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        state = _ProcessState(os.getcwd(), dict(os.environ))  # noqa: PTH109
        process: BaseProcess = self._context.Process(target=_serve, args=(theirs, self._work, state), daemon=True)
        try:
            with _blocked_interrupts():
                process.start()
        except _UNPICKLABLE as exc:
            ours.close()
            raise InternalError(f"the work cannot be sent to another process: {exc}") from exc
        finally:
            theirs.close()
        worker = _Worker(process, ours)
        self._workers.append(worker)
        return worker

    def _receive(self, worker: _Worker) -> None:
        """Receive a message of a worker, or detects that it died."""
        try:
            message = worker.pipe.recv_bytes()
        except (EOFError, ConnectionResetError):
            self._remove_dead(worker)
            return
        if message == _READY:
            worker.ready = True
            return
        assert worker.job is not None
        self._attempts.pop(worker.job.key, None)
        worker.job = None
        self._finished.append(JobResult.from_line(message))

    def _remove_dead(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join()
        code = worker.process.exitcode or 0
        worker.process.close()
        how = f"killed by {_signal_name(-code)}" if code < 0 else f"exit code {code}"
        if not worker.ready:
            raise InternalError(
                f'the worker processes cannot start ({how}); in a script, call this under `if __name__ == "__main__":`'
            )
        job = worker.job
        if job is None:
            return
        if self._attempts[job.key] < MAX_ATTEMPTS:
            self._waiting.appendleft(job)
            return
        self._attempts.pop(job.key)
        message = f"the worker process died {MAX_ATTEMPTS} times during this job ({how})"
        if how.endswith("KILL"):
            message += "; the system kills processes when memory runs out: use fewer processes"
        self._finished.append(JobResult(job.key, error={"code": 9099, "name": "WORKER_DIED", "message": message}))


@contextlib.contextmanager
def _blocked_interrupts() -> Generator[None]:
    """Start processes that never see Ctrl-C, from their first instruction on: the mask of signals is inherited.

    The signal of this process waits until the end of the block.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    resource_tracker.ensure_running()  # otherwise a fork server starts it, which unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # real-time signals have no name, except the first and the last
        return f"signal {number}"


@dataclass(frozen=True, slots=True)
class _ProcessState:
    """Working folder and environment for a worker; a fork server would use those of its own start."""

    folder: str
    environment: dict[str, str]

    def apply(self) -> None:
        os.chdir(self.folder)
        os.environ.clear()
        os.environ.update(self.environment)


def _serve(pipe: Connection, work: Work, state: _ProcessState) -> None:
    """Run a worker: performs the jobs it receives until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    state.apply()
    sys.stdout.flush()
    os.dup2(2, 1)  # output of `work` must not mix with results
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pipe.send_bytes(_READY)
    while True:
        try:
            job: Job = pipe.recv()
            pipe.send_bytes(perform(work, job).as_line().encode())
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return


def _end_with_parent() -> None:
    """End this process when its parent ends, even during a job."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


# --- a Dask cluster ---------------------------------------------------------------------------------------------------


_POLL_S: Final = 0.005
_CHECK_WORKERS_S: Final = 5.0
NO_WORKERS_TIMEOUT_S: Final = 60.0
"""A cluster without workers for this long is an error."""
CONNECT_TIMEOUT_S: Final = 10.0


def _version() -> str:
    return __version__


class DaskExecutor:
    """An `Executor` of `navstack.studies.jobs`. The scheduler restarts a job on another worker if its worker dies.

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
        """Submit the job to the scheduler."""
        key = f"{self._name}-{next(self._numbers)}"
        self._jobs[key] = job.key
        self._ended.add(self._client.submit(_perform, self._name, job, key=key, pure=False))

    def collect(self) -> JobResult:
        """Wait for any job to end. Raises InputError after a minute without workers."""
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
        message = f"{type(error).__name__}: {error}" if error is not None else "the cluster canceled the job"
        return JobResult(job, error={"code": 9099, "name": "WORKER_DIED", "message": message})

    def close(self) -> None:
        """Drop the running jobs and disconnects."""
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
    """Perform the job on a worker."""
    from distributed import get_worker

    return perform(getattr(get_worker(), name.replace("-", "_")), job).as_line()

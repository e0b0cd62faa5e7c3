"""Jobs in persistent worker processes, which are replaced when they die and end with this process."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections import deque
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final, Self

from navstack.core.errors import InputError, InternalError
from navstack.jobs.job import Job, JobResult, Work, perform

MAX_ATTEMPTS: Final = 2
"""Maximum number of attempts for a job whose worker dies."""
_READY: Final = b"ready"
_UNPICKLABLE: Final = (pickle.PicklingError, AttributeError, TypeError, ImportError)


def usable_cores() -> int:
    """Returns the number of cores that this process may use."""
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

    @property
    def pids(self) -> list[int]:
        """Process ids of the live workers."""
        return [w.process.pid for w in self._workers if w.process.pid is not None]

    def submit(self, job: Job) -> None:
        """Sends the job to an idle worker, or queues it."""
        self._waiting.append(job)
        self._dispatch()

    def collect(self) -> JobResult:
        """Waits for any job to end and returns its result."""
        while not self._finished:
            if not self._workers:
                raise InternalError("no job is running; submit one before collecting")
            ready = wait([w.pipe for w in self._workers])
            for worker in [w for w in self._workers if w.pipe in ready]:
                self._receive(worker)
            self._dispatch()
        return self._finished.popleft()

    def close(self) -> None:
        """Kills the workers."""
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
        """Receives a message of a worker, or detects that it died."""
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
    """Runs a worker: performs the jobs it receives until the pipe is closed."""
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
    """Ends this process when its parent ends, even during a job."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)

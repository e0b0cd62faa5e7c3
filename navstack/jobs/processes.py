"""Jobs in worker processes that are kept alive, replaced when they die, and end with this one."""

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

TRIES: Final = 2
"""How often a job is begun whose worker dies."""
_READY: Final = b"ready"
_UNPICKLABLE: Final = (pickle.PicklingError, AttributeError, TypeError, ImportError)


def usable_cores() -> int:
    """The cores that this process may run on."""
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
    """Runs jobs in `processes` workers (all usable cores unless given).

    A worker that dies is replaced and its job begun once more.
    `work` and the jobs' inputs must be picklable; `work` goes to each worker once, so that what it loads and keeps is
    loaded once per worker. Workers print to stderr, ignore Ctrl-C (this process ends them) and end when this process does.
    """

    def __init__(self, work: Work, processes: int | None = None) -> None:
        if processes is not None and processes < 1:
            raise InputError(f"{processes} processes: give at least 1", argument="processes", value=processes)
        self._slots = processes or usable_cores()
        self._work = work
        # a fork of this process could inherit locks that are held; a server forks from a state where there are none
        method = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
        self._context: Any = multiprocessing.get_context(method)
        if method == "forkserver":
            self._context.set_forkserver_preload([__name__, getattr(work, "__module__", None) or __name__])
        self._workers: list[_Worker] = []
        self._waiting: deque[Job] = deque()
        self._finished: deque[JobResult] = deque()
        self._begun: dict[str, int] = {}

    @property
    def slots(self) -> int:
        """How many jobs run at once."""
        return self._slots

    @property
    def pids(self) -> list[int]:
        """Of the workers that live."""
        return [w.process.pid for w in self._workers if w.process.pid is not None]

    def submit(self, job: Job) -> None:
        """Hands the job to a worker that has nothing to do, or puts it in the queue."""
        self._waiting.append(job)
        self._dispatch()

    def collect(self) -> JobResult:
        """Waits for any job to end."""
        while not self._finished:
            if not self._workers:
                raise InternalError("no job is under way: submit one before collecting")
            ready = wait([w.pipe for w in self._workers])
            for worker in [w for w in self._workers if w.pipe in ready]:
                self._hear(worker)
            self._dispatch()
        return self._finished.popleft()

    def close(self) -> None:
        """Ends the workers, whatever they are at."""
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
            self._begun[job.key] = self._begun.get(job.key, 0) + 1
            # it may have died while idle: that is heard of at the next collect
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                try:
                    idle.pipe.send(job)
                except _UNPICKLABLE as exc:
                    raise InternalError(f"the job {job.key!r} cannot be sent to another process: {exc}") from exc

    def _start(self) -> _Worker:
        ours, theirs = self._context.Pipe()
        here = _Surroundings(os.getcwd(), dict(os.environ))  # noqa: PTH109
        process: BaseProcess = self._context.Process(target=_serve, args=(theirs, self._work, here), daemon=True)
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

    def _hear(self, worker: _Worker) -> None:
        """What a worker sends, or that it is gone."""
        try:
            message = worker.pipe.recv_bytes()
        except (EOFError, ConnectionResetError):
            self._bury(worker)
            return
        if message == _READY:
            worker.ready = True
            return
        assert worker.job is not None
        self._begun.pop(worker.job.key, None)
        worker.job = None
        self._finished.append(JobResult.from_line(message))

    def _bury(self, worker: _Worker) -> None:
        self._workers.remove(worker)
        worker.pipe.close()
        worker.process.join()
        code = worker.process.exitcode or 0
        worker.process.close()
        how = f"killed by {_signal_name(-code)}" if code < 0 else f"exit code {code}"
        if not worker.ready:
            raise InternalError(
                f"the worker processes cannot start ({how}); in a script of your own, call this under "
                '`if __name__ == "__main__":`'
            )
        job = worker.job
        if job is None:
            return
        if self._begun[job.key] < TRIES:
            self._waiting.appendleft(job)
            return
        self._begun.pop(job.key)
        message = f"the worker process died {TRIES} times at this job ({how})"
        if how.endswith("KILL"):
            message += "; when memory runs out, the system kills so: use fewer processes"
        self._finished.append(JobResult(job.key, error={"code": 9099, "name": "WORKER_DIED", "message": message}))


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:  # of those for programs of one's own, only the first and the last have a name
        return f"signal {number}"


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """A server of forks keeps those of its own start; a worker wants those of now."""

    folder: str
    environment: dict[str, str]

    def take(self) -> None:
        os.chdir(self.folder)
        os.environ.clear()
        os.environ.update(self.environment)


def _serve(pipe: Connection, work: Work, here: _Surroundings) -> None:
    """A worker: does the jobs that come, until none can come any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    here.take()
    sys.stdout.flush()
    os.dup2(2, 1)  # what work prints is not among the results
    threading.Thread(target=_end_with_parent, daemon=True).start()
    pipe.send_bytes(_READY)
    while True:
        try:
            job: Job = pipe.recv()
            pipe.send_bytes(perform(work, job).as_line().encode())
        except (EOFError, BrokenPipeError, ConnectionResetError):
            return


def _end_with_parent() -> None:
    """Ends this process when its parent ends in whatever way, though it be in the middle of a job."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)

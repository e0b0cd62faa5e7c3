"""Planning in a worker thread, for robots that do not wait: control goes on while a planner is slow.

Live use only. When the answer comes depends on the machine, so a simulation takes `InlinePlanning`, whose runs can be
repeated. Compiled kernels release the GIL: control has the other core to itself.

A planner that never returns cannot be stopped: Python ends no thread from outside. Its thread is given up after
`hang_timeout_s`, and a new planner of the same class and parameters, in a thread of its own, takes its place; that is done
`MAX_HUNG` times, after which every request fails at once until the planner is exchanged (`MoveBase.reconfigure`).
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from navstack.core.errors import NavError, PlanningTimeoutError
from navstack.interfaces import GlobalPlanner
from navstack.move_base import plugin_calls
from navstack.move_base.planning import PlanAnswer, PlanRequest

MAX_HUNG = 4
"""Threads that are given up before a planner is held to be broken: each keeps a copy of the costmap, and perhaps a core."""


@dataclass(slots=True)
class _Job:
    """A request; `answer` may be looked at once `done` is set."""

    request: PlanRequest
    answer: PlanAnswer | None = None
    seen_at: float | None = None
    """When it was first seen to be worked on, s."""
    lost: bool = False
    """Its planner hangs."""
    done: threading.Event = field(default_factory=threading.Event)
    abandoned: threading.Event = field(default_factory=threading.Event)


class _Worker:
    """The thread of one planner: plugins need not bear two calls at a time."""

    def __init__(self, planner: GlobalPlanner, on_answer: Callable[[], None] | None) -> None:
        self.planner = planner
        self.at: _Job | None = None
        """What it works on."""
        self.idle = threading.Event()
        self.idle.set()
        self._on_answer = on_answer
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        # a planner that never returns must not keep the program from ending
        self._thread = threading.Thread(target=self._work, name=f"plan-{type(planner).__name__}", daemon=True)
        self._thread.start()

    def submit(self, job: _Job | None) -> None:
        """A request, or None: end when what came before is done."""
        if job is not None:
            self.idle.clear()
        self._jobs.put(job)

    def join(self, timeout_s: float) -> bool:
        """True when the thread has ended."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self.at = job
            if not job.abandoned.is_set():
                job.answer = self._plan(job)
            self.at = None
            if self._jobs.empty():
                self.idle.set()
            job.done.set()
            if self._on_answer is not None and not job.abandoned.is_set():
                self._on_answer()
        self.idle.set()

    def _plan(self, job: _Job) -> PlanAnswer:
        request = job.request._replace(planner=self.planner)
        try:
            return request.answer(request.carry_out())
        except NavError as exc:
            return request.answer(error=exc)
        except BaseException as exc:  # SystemExit, say: it would end the thread, and nobody would ever have an answer
            return request.answer(error=plugin_calls.internal(type(self.planner).__name__, exc))


class ThreadPlanning:
    """Plans on a copy of the costmap, beside driving: `MoveBase(.., planning=ThreadPlanning())`.

    `tick` never waits for it. Patience counts as ever: a planner that is too slow ends in CLEARING. A request that nobody
    waits for any more is left to end by itself, and the next one of that planner comes after it; unless it hangs, see the
    module.
    """

    def __init__(self, on_answer: Callable[[], None] | None = None, *, hang_timeout_s: float = 60.0) -> None:
        """`on_answer` is called from the worker thread when there is an answer to `poll`: to wake whoever waits to tick.

        A planner that works on one request for longer than `hang_timeout_s` (s of the ticks' clock) hangs.
        """
        self.hang_timeout_s = hang_timeout_s
        self.hung = 0
        """How often the planner in use was given up."""
        self._on_answer = on_answer
        self._worker: _Worker | None = None
        self._planner: GlobalPlanner | None = None
        self._lost: list[_Worker] = []
        self._job: _Job | None = None

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        return self._job is not None

    @property
    def due(self) -> float:
        """Now, once there is an answer; until then nobody knows."""
        job = self._job
        return -math.inf if job is not None and job.done.is_set() else math.inf

    def request(self, request: PlanRequest) -> None:
        """Hands the request to the planner's thread and returns at once; the costmap is copied."""
        planner = request.planner
        if self._planner is not planner:
            if self._worker is not None:
                self._worker.submit(None)
            self._planner, self._worker, self.hung = planner, _Worker(planner, self._on_answer), 0
        self._job = _Job(request._replace(costmap=request.costmap.copy()))
        if self._worker is not None:
            self._worker.submit(self._job)

    def poll(self, now: float) -> PlanAnswer | None:
        """The answer, once, if it is there; a TIMEOUT when the planner hangs."""
        job = self._job
        if job is None:
            return None
        if not job.done.is_set():
            self._replace_hung(now)
        elif job.answer is not None:
            self._job = None
            return job.answer
        worker = self._worker
        if worker is not None and not job.lost:
            return None
        self._job = None
        much = f"works on one plan for longer than {self.hang_timeout_s:g} s: its thread was given up"
        if worker is None:
            much = f"hung {self.hung} times, for longer than {self.hang_timeout_s:g} s each: exchange it"
        error = PlanningTimeoutError(f"the global planner {much}", hung=self.hung, hang_timeout_s=self.hang_timeout_s)
        return job.request.answer(error=error)

    def _replace_hung(self, now: float) -> None:
        """Gives up a thread that hangs; another one takes over, and what waits for it."""
        worker, planner = self._worker, self._planner
        at = worker.at if worker is not None else None
        if worker is None or planner is None or at is None:
            return
        if at.seen_at is None:
            at.seen_at = now
        if now - at.seen_at < self.hang_timeout_s:
            return
        at.abandoned.set()
        worker.submit(None)  # should it ever return
        self._lost = [*(lost for lost in self._lost if not lost.idle.is_set()), worker]
        self.hung += 1
        self._worker = None
        if self.hung < MAX_HUNG:
            # not the same object: it may be in any state
            try:
                self._worker = _Worker(type(planner)(planner.params), self._on_answer)
            except Exception:
                self.hung = MAX_HUNG
        job = self._job
        if job is None:
            return
        if job is at:
            job.lost = True
        elif self._worker is not None:
            waiting = self._job = replace(job, done=threading.Event(), abandoned=threading.Event())
            job.abandoned.set()
            self._worker.submit(waiting)

    def abandon(self) -> None:
        """Nobody waits for the answer any more."""
        if self._job is not None:
            self._job.abandoned.set()
            self._job = None

    def is_using(self, planner: GlobalPlanner) -> bool:
        """True while that planner is at work, be it on a plan that nobody waits for."""
        workers = [*self._lost, *([self._worker] if self._worker is not None else [])]
        return any(worker.planner is planner and not worker.idle.is_set() for worker in workers)

    def close(self, timeout_s: float = 0.0) -> bool:
        """Ends the thread after what it is at; True when it has ended within `timeout_s` (s). Not those that hang."""
        self.abandon()
        worker, self._worker = self._worker, None
        self._planner = None
        if worker is None:
            return True
        worker.submit(None)
        return worker.join(timeout_s)

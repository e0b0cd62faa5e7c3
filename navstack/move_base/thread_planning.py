"""Planning in a worker thread, for robots in real time: control continues while a planner is slow.

For live use only: the time of the answer depends on the machine, so simulations use the reproducible `InlinePlanning`.
Compiled kernels release the GIL, so control runs on another core meanwhile.

Python cannot stop a thread from outside, so a planner that never returns is abandoned with its thread after
`hang_timeout_s`, and replaced by a new planner of the same class and parameters in a new thread. After `MAX_HUNG`
replacements every request fails at once until `MoveBase.reconfigure` changes the planner.
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
"""Number of abandoned threads after which a planner counts as broken: each keeps a costmap copy, perhaps also a core."""


@dataclass(slots=True)
class _Job:
    """A request; `answer` is valid once `done` is set."""

    request: PlanRequest
    answer: PlanAnswer | None = None
    seen_at: float | None = None
    """Time at which a poll first found it in progress (s)."""
    lost: bool = False
    """True if its planner hangs."""
    done: threading.Event = field(default_factory=threading.Event)
    abandoned: threading.Event = field(default_factory=threading.Event)


class _Worker:
    """The thread of one planner: a plugin does not need to support concurrent calls."""

    def __init__(self, planner: GlobalPlanner, on_answer: Callable[[], None] | None) -> None:
        self.planner = planner
        self.current: _Job | None = None
        """The job in progress."""
        self.idle = threading.Event()
        self.idle.set()
        self._on_answer = on_answer
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        # daemon: a planner that never returns must not keep the program from exiting
        self._thread = threading.Thread(target=self._work, name=f"plan-{type(planner).__name__}", daemon=True)
        self._thread.start()

    def submit(self, job: _Job | None) -> None:
        """Queue a job, or None to end the thread after the jobs before it."""
        if job is not None:
            self.idle.clear()
        self._jobs.put(job)

    def join(self, timeout_s: float) -> bool:
        """Return True if the thread ends within `timeout_s` (s)."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _work(self) -> None:
        while (job := self._jobs.get()) is not None:
            self.current = job
            if not job.abandoned.is_set():
                job.answer = self._plan(job)
            self.current = None
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
        except BaseException as exc:  # such as SystemExit, which would end the thread without an answer
            return request.answer(error=plugin_calls.plugin_error(self.planner, exc))


class ThreadPlanning:
    """Plans on a copy of the costmap while the robot drives: `MoveBase(.., planning=ThreadPlanning())`.

    `tick` never waits for it. planner_patience applies: a planner that is too slow leads to CLEARING. A discarded request runs
    to its end, and the next request of that planner follows it, unless the planner hangs (see the module).
    """

    def __init__(self, on_answer: Callable[[], None] | None = None, *, hang_timeout_s: float = 60.0) -> None:
        """Create the worker; it calls `on_answer` from its thread when `poll` has an answer, to wake the caller of `tick`.

        A planner that works on one request for longer than `hang_timeout_s` (s, in the time of the ticks) hangs.
        """
        self.hang_timeout_s = hang_timeout_s
        self.keep_potential = False
        """Whether plans are to have their potential, for viewers."""
        self.hung = 0
        """How often the present planner was replaced because it hung."""
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
        """-inf once an answer is available; inf before, because the time of the answer is not known."""
        job = self._job
        return -math.inf if job is not None and job.done.is_set() else math.inf

    def request(self, request: PlanRequest) -> None:
        """Pass the request, with a copy of the costmap, to the planner's thread and return at once."""
        planner = request.planner
        if self._planner is not planner:
            if self._worker is not None:
                self._worker.submit(None)
            self._planner, self._worker, self.hung = planner, _Worker(planner, self._on_answer), 0
        self._job = _Job(request._replace(costmap=request.costmap.copy(), keep_potential=self.keep_potential))
        if self._worker is not None:
            self._worker.submit(self._job)

    def poll(self, now: float) -> PlanAnswer | None:
        """Return the answer if it is available, and clear it; a TIMEOUT if the planner hangs."""
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
        limit = self.hang_timeout_s
        text = f"the global planner has worked on one plan for more than {limit:g} s: its thread was abandoned"
        if worker is None:
            text = (
                f"the global planner hung {self.hung} times, for more than {limit:g} s each: configure another planner"
            )
        error = PlanningTimeoutError(text, hung=self.hung, hang_timeout_s=limit)
        return job.request.answer(error=error)

    def _replace_hung(self, now: float) -> None:
        """Abandon a thread that hangs; a new one takes over, and takes the waiting job."""
        worker, planner = self._worker, self._planner
        job = worker.current if worker is not None else None
        if worker is None or planner is None or job is None:
            return
        if job.seen_at is None:
            job.seen_at = now
        if now - job.seen_at < self.hang_timeout_s:
            return
        job.abandoned.set()
        worker.submit(None)  # ends the thread if the planner returns after all
        self._lost = [*(lost for lost in self._lost if not lost.idle.is_set()), worker]
        self.hung += 1
        self._worker = None
        if self.hung < MAX_HUNG:
            # a new object: the old one may be in any state
            try:
                new_planner = plugin_calls.call(planner, type(planner), planner.params)
                self._worker = _Worker(new_planner, self._on_answer)
            except NavError:
                self.hung = MAX_HUNG
        waiting = self._job
        if waiting is None:
            return
        if waiting is job:
            job.lost = True
        elif self._worker is not None:
            self._job = replace(waiting, done=threading.Event(), abandoned=threading.Event())
            waiting.abandoned.set()
            self._worker.submit(self._job)

    def abandon(self) -> None:
        """Discard the pending request."""
        if self._job is not None:
            self._job.abandoned.set()
            self._job = None

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return True while that planner computes a plan, including that of a discarded request."""
        workers = [*self._lost, *([self._worker] if self._worker is not None else [])]
        return any(worker.planner is planner and not worker.idle.is_set() for worker in workers)

    def close(self, timeout_s: float = 0.0) -> bool:
        """End the thread after its present job; return True if it ends within `timeout_s` (s). Abandoned threads remain."""
        self.abandon()
        worker, self._worker = self._worker, None
        self._planner = None
        if worker is None:
            return True
        worker.submit(None)
        return worker.join(timeout_s)

"""Planning in a worker thread, for robots that do not wait: control goes on while a planner is slow.

Live use only. When the answer comes depends on the machine, so a simulation takes `InlinePlanning`, whose runs can be
repeated. Compiled kernels release the GIL: control has the other core to itself.
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from navstack.core import Costmap, Footprint, Pose2D
from navstack.core.errors import NavError
from navstack.interfaces import GlobalPlanner
from navstack.move_base import guards
from navstack.move_base.planning import PlanAnswer


@dataclass(slots=True)
class _Job:
    """A request; `answer` may be looked at once `done` is set."""

    costmap: Costmap
    start: Pose2D
    goal: Pose2D
    footprint: Footprint
    goal_id: str
    requested_at: float
    answer: PlanAnswer | None = None
    done: threading.Event = field(default_factory=threading.Event)
    abandoned: threading.Event = field(default_factory=threading.Event)


class _Worker:
    """The thread of one planner: plugins need not bear two calls at a time."""

    def __init__(self, planner: GlobalPlanner, on_answer: Callable[[], None] | None) -> None:
        self.planner = planner
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
            if not job.abandoned.is_set():
                job.answer = self._plan(job)
            if self._jobs.empty():
                self.idle.set()
            job.done.set()
            if self._on_answer is not None and not job.abandoned.is_set():
                self._on_answer()

    def _plan(self, job: _Job) -> PlanAnswer:
        try:
            plan = guards.make_plan(self.planner, job.costmap, job.start, job.goal, job.footprint)
        except NavError as exc:
            return PlanAnswer(job.goal_id, job.requested_at, None, exc)
        except BaseException as exc:  # SystemExit, say: it would end the thread, and nobody would ever have an answer
            error = guards.internal(type(self.planner).__name__, exc)
            return PlanAnswer(job.goal_id, job.requested_at, None, error)
        return PlanAnswer(job.goal_id, job.requested_at, plan, None)


class ThreadPlanning:
    """Plans on a copy of the costmap, beside driving: `MoveBase(.., planning=ThreadPlanning())`.

    `tick` never waits for it. Patience counts as ever: a planner that is too slow ends in CLEARING. A request that nobody
    waits for any more is left to end by itself, and the next one of that planner comes after it.
    """

    def __init__(self, on_answer: Callable[[], None] | None = None) -> None:
        """`on_answer` is called from the worker thread when there is an answer to `poll`: to wake whoever waits to tick."""
        self._on_answer = on_answer
        self._worker: _Worker | None = None
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

    def request(
        self,
        planner: GlobalPlanner,
        costmap: Costmap,
        start: Pose2D,
        goal: Pose2D,
        footprint: Footprint,
        goal_id: str,
        now: float,
    ) -> None:
        """Hands the request to the planner's thread and returns at once; the costmap is copied."""
        worker = self._worker
        if worker is None or worker.planner is not planner:
            if worker is not None:
                worker.submit(None)
            worker = self._worker = _Worker(planner, self._on_answer)
        self._job = _Job(costmap.copy(), start, goal, footprint, goal_id, now)
        worker.submit(self._job)

    def poll(self, now: float) -> PlanAnswer | None:
        """The answer, once, if it is there."""
        del now
        job = self._job
        if job is None or not job.done.is_set():
            return None
        self._job = None
        return job.answer

    def abandon(self) -> None:
        """Nobody waits for the answer any more."""
        if self._job is not None:
            self._job.abandoned.set()
            self._job = None

    def is_using(self, planner: GlobalPlanner) -> bool:
        """True while that planner is at work, be it on a plan that nobody waits for."""
        worker = self._worker
        return worker is not None and worker.planner is planner and not worker.idle.is_set()

    def close(self, timeout_s: float = 0.0) -> bool:
        """Ends the thread after what it is at; True when it has ended within `timeout_s` (s)."""
        self.abandon()
        worker, self._worker = self._worker, None
        if worker is None:
            return True
        worker.submit(None)
        return worker.join(timeout_s)

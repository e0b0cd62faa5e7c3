"""Plans while driving: when to request one, its request and answer, in the tick or in a thread, and plans without driving.

In a simulation `InlinePlanning` answers in the same tick, or after the planning time of the scenario, so that slow planners
can be studied and a run remains a pure function.

`ThreadPlanning` is for robots in real time: control continues while a planner is slow. The time of the answer depends on the
machine. Compiled kernels release the GIL, so control runs on another core meanwhile. Python cannot stop a thread from
outside, so a planner that never returns is abandoned with its thread after `hang_timeout_s`, and replaced by a new planner of
the same class and parameters in a new thread. After `MAX_HUNG` replacements every request fails at once until
`MoveBase.reconfigure` changes the planner.

Source: move_base/src/move_base.cpp (planThread, planService).
"""

from __future__ import annotations

import math
import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameError,
    GoalOccupiedError,
    InputError,
    NavError,
    Path,
    PlanningError,
    PlanningTimeoutError,
    Pose2D,
    StartOccupiedError,
)
from navstack.move_base import plugin_calls
from navstack.move_base.schedule import EPSILON_S, Schedule
from navstack.parameters import MoveBaseParams
from navstack.plugins import CostmapServer, GlobalPlanner, Plan

E = TypeVar("E", bound=NavError)

MAX_HUNG = 4
"""Number of abandoned threads after which a planner counts as broken: each keeps a costmap copy, perhaps also a core."""


# --- when to plan ------------------------------------------------------------------------------------------------------


class PlanSchedule:
    """Requests plans on demand and at planner_frequency; counts failures against planner_patience and max_planning_retries."""

    def __init__(self, params: MoveBaseParams) -> None:
        self.params = params
        self._replan = Schedule(params.planner_frequency)
        self._running = False
        self._woken = False
        self._failures = 0
        self._last_valid = 0.0

    @property
    def due(self) -> float:
        """Time of the next request (s)."""
        return self._replan.due if self._running else math.inf

    def wake(self, now: float) -> None:
        """Request a plan in this tick, then at planner_frequency."""
        del now
        self._woken = self._running = True

    def stop(self, now: float) -> None:
        """Stop requests."""
        del now
        self._woken = self._running = False

    def take_request(self, now: float) -> bool:
        """Return True if a plan must be requested at `now` (s); the next request is due one period later."""
        if self._woken:
            self._replan.restart(now)
        elif not self._running or now < self._replan.due - EPSILON_S:
            return False
        self._woken = False
        self._replan.advance(now)
        return True

    def succeed(self) -> None:
        """Record a plan: it also answers requests made while the planner was busy. Stops requests without a frequency."""
        self._woken = False
        if self.params.planner_frequency <= 0.0:
            self._running = False

    def fail(self, now: float) -> bool:
        """Record a failure at `now` (s); return True if patience or retries are exhausted."""
        self._failures += 1
        limit = self.params.max_planning_retries
        # patience ends at the deadline itself: in C++ the answer always arrives a few ms after the cycle of the request
        return self.waited(now) >= self.params.planner_patience - EPSILON_S or 0 <= limit < self._failures

    def waited(self, now: float) -> float:
        """Return the time since the last plan or the last reset (s)."""
        return now - self._last_valid

    def reset_patience(self, now: float) -> None:
        """Restart patience and retries at `now` (s)."""
        self._last_valid = now
        self._failures = 0

    def set_params(self, params: MoveBaseParams, now: float, *, may_plan: bool) -> None:
        """Replace the parameters at `now` (s); `may_plan`: the mode is PLANNING or CONTROLLING."""
        before, self.params = self.params, params
        if params.planner_frequency != before.planner_frequency:
            self._replan.set_frequency(params.planner_frequency, now)
            # C++ wakes the planner thread: with a frequency it plans again, without one it waits
            self._running = may_plan and (self._running or params.planner_frequency > 0.0)


# --- request and answer ------------------------------------------------------------------------------------------------


class PlanAnswer(NamedTuple):
    """The answer to a request."""

    goal_id: str
    requested_at: float
    """s"""
    plan: Plan | None
    error: NavError | None
    """Reason of a failure; None with a plan."""


class PlanRequest(NamedTuple):
    """A request at the time `at` (s) for a plan to the goal of that id."""

    planner: GlobalPlanner
    costmap: Costmap
    start: Pose2D
    goal: Pose2D
    footprint: Footprint
    goal_id: str
    at: float
    keep_potential: bool = False
    """Whether the plan is to have its potential."""

    def carry_out(self) -> Plan:
        """Plan. Raises NavError for any exception of the planner."""
        return plugin_calls.make_plan(
            self.planner, self.costmap, self.start, self.goal, self.footprint, keep_potential=self.keep_potential
        )

    def answer(self, plan: Plan | None = None, error: NavError | None = None) -> PlanAnswer:
        """Return the answer to this request."""
        return PlanAnswer(self.goal_id, self.at, plan, error)


class Planning(Protocol):
    """Executes plan requests, one at a time."""

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        ...

    @property
    def due(self) -> float:
        """Time at which an answer may be available (s); inf without a request."""
        ...

    def request(self, request: PlanRequest) -> None:
        """Request a plan; not allowed while busy."""
        ...

    def poll(self, now: float) -> PlanAnswer | None:
        """Return the answer once it is available, and clear it."""
        ...

    def abandon(self) -> None:
        """Discard the pending request."""
        ...

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return True while that planner computes a plan, including that of a discarded request."""
        ...


class InlinePlanning:
    """Plans at once on the current costmap; the answer is available `planning_time` (s) later."""

    def __init__(self, planning_time: float | Callable[[float], float] = 0.0) -> None:
        """Set the planning time (s): a number, or a function of the time of the request (s); inf for never."""
        self._planning_time = planning_time
        self._answer: PlanAnswer | None = None
        self._due = math.inf

    @property
    def is_busy(self) -> bool:
        """True between a request and its answer."""
        return self._answer is not None

    @property
    def due(self) -> float:
        """Time at which the answer is available (s)."""
        return self._due

    def request(self, request: PlanRequest) -> None:
        """Plan now."""
        try:
            answer = request.answer(request.carry_out())
        except NavError as exc:
            answer = request.answer(error=exc)
        duration = self._planning_time
        self._answer = answer
        self._due = request.at + (duration(request.at) if callable(duration) else duration)

    def poll(self, now: float) -> PlanAnswer | None:
        """Return the answer once its time has come, and clear it."""
        answer = self._answer
        if answer is None or now < self._due - EPSILON_S:
            return None
        self._answer = None
        self._due = math.inf
        return answer

    def abandon(self) -> None:
        """Discard the pending request."""
        self._answer = None
        self._due = math.inf

    def is_using(self, planner: GlobalPlanner) -> bool:
        """Return False: a plan is complete before `request` returns."""
        del planner
        return False


# --- in a thread -------------------------------------------------------------------------------------------------------


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
        """How often the current planner was replaced because it hung."""
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
        """End the thread after its current job; return True if it ends within `timeout_s` (s). Abandoned threads remain."""
        self.abandon()
        worker, self._worker = self._worker, None
        self._planner = None
        if worker is None:
            return True
        worker.submit(None)
        return worker.join(timeout_s)


# --- without driving ---------------------------------------------------------------------------------------------------


def plan_without_driving(
    planner: GlobalPlanner,
    costmap: CostmapServer,
    params: MoveBaseParams,
    goal: Pose2D,
    start: Pose2D | None,
    *,
    tolerance: float,
    now: float | None,
) -> Plan:
    """Return a plan in the costmap's frame from `start`, or from the robot's pose at `now` (s; None: the newest pose).

    See `MoveBase.make_plan`. Raises InputError, FrameError and the planner's error for the goal itself.
    """
    if not math.isfinite(tolerance) or tolerance < 0.0:
        raise InputError(f"tolerance must be a distance in meters (0 or more), not {tolerance}", tolerance=tolerance)
    master = costmap.master
    robot: Pose2D | None = None
    try:
        robot = plugin_calls.call(costmap, costmap.robot_pose, now, check=plugin_calls.checked_pose)
    except FrameError:
        if start is None:
            raise
    if start is None:
        assert robot is not None
        start = robot
    if params.make_plan_clear_costmap and robot is not None:
        radius = params.clearing_radius
        half = costmap.footprint.circumscribed_radius if radius is None else radius
        window = master.geometry.window_of(Bounds(robot.x, robot.y, robot.x, robot.y).grown(half))
        master = master.copy()
        master.data[window.slices] = 0
    try:
        return plugin_calls.make_plan(planner, master, start, goal, costmap.footprint)
    except PlanningError as exc:
        error = exc
    for near, offset in rings(goal, master.geometry.resolution, tolerance):
        try:
            plan = plugin_calls.make_plan(planner, master, start, near, costmap.footprint)
        except PlanningError:
            continue
        path = plan.path
        if params.make_plan_add_unreachable_goal:
            path = Path(np.vstack((path.poses, [tuple(goal)])), path.frame)
        note = f"the goal is unreachable ({error.name}); the plan ends {offset:.2f} m from it"
        return replace(plan, path=path, goal=near, goal_moved_m=offset, notes=(*plan.notes, note))
    raise add_layer(costmap, error)


def rings(goal: Pose2D, resolution: float, tolerance: float) -> list[tuple[Pose2D, float]]:
    """Return poses on growing square rings around `goal` and their distances from it (m), in move_base's order.

    The step is three cells, or `tolerance` (m) if that is smaller.
    """
    if tolerance <= 0.0:
        return []
    increment = min(3.0 * resolution, tolerance)
    count = int(tolerance / increment + 1e-9)
    found: list[tuple[Pose2D, float]] = []
    for ring in range(1, count + 1):
        for iy in range(ring + 1):
            for ix in range(ring + 1):
                if ix < ring and iy < ring:
                    continue
                for sign_y in (-1.0, 1.0) if iy else (1.0,):
                    for sign_x in (-1.0, 1.0) if ix else (1.0,):
                        dx, dy = sign_x * ix * increment, sign_y * iy * increment
                        found.append((Pose2D(goal.x + dx, goal.y + dy, goal.yaw), math.hypot(dx, dy)))
    return found


# --- errors ------------------------------------------------------------------------------------------------------------


def add_layer(costmap: CostmapServer, error: E) -> E:
    """Return the error with the layer that set the occupied cell's cost, in its message and its data.

    `data["layer"]` is the instance name of the layer, `data["source"]` its observation source (or "map"), `data["stamp"]` the
    time of the observation (s); the last two are None if unknown. Errors of other kinds, and errors about costs that are not
    in this costmap (any more), are returned unchanged.
    """
    cell, cost = error.data.get("cell"), error.data.get("cost")
    if not isinstance(error, (StartOccupiedError, GoalOccupiedError)) or cell is None or "layer" in error.data:
        return error
    master = costmap.master
    ix, iy = cell
    if not master.geometry.contains_cell(ix, iy) or int(master.data[iy, ix]) != cost:
        return error
    try:
        found = plugin_calls.call(costmap, costmap.explain, ix, iy)
    except NavError:
        return error  # an explanation that fails must not replace the error
    if found is None or found.set_by is None:
        return error
    data = {**error.data, "layer": found.set_by, "source": found.source, "stamp": found.stamp}
    origin = "" if found.source is None else f', from "{found.source}"'
    origin += "" if found.stamp is None else f" at {found.stamp:.3f} s"
    pose = "goal" if isinstance(error, GoalOccupiedError) else "start"
    return type(error)(
        f"{error.message}; the cost of the {pose}'s cell was set by the layer {found.set_by}{origin}", **data
    )

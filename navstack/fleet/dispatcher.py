"""Gives the tasks of a fleet to its robots and follows them: the queue, who drives which task, charging.

The dispatcher works at the times of the exchange with the traffic control. It knows of a robot what that reports: a robot that is
silent, or dead, loses its tasks to the others after `silence` seconds, and is told nothing.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal, Protocol

from navstack.bringup import true_footprint
from navstack.core import Pose2D
from navstack.fleet.assignment import Bidder, Stop, Task, Ways, assign_nearest, auction, in_order, way_within
from navstack.fleet.fleet import Fleet
from navstack.fleet.member import MemberRun
from navstack.fleet.tasks import Charger, RobotLoad, TaskPlan, TaskProgress, TaskReport
from navstack.scenario import GoalOutcome, Step, read_step
from navstack.sim import energy_of

_NO_CURRENT_S: Final = 5.0
"""A robot that stands at a charger for this time without a current has missed it."""
_AT_HOME_M: Final = 0.5
_APART_M: Final = 0.1
"""Distance of two footprints at which one of them does not stand in the other one's charger."""


class Robots(Protocol):
    """What the dispatcher needs of the run of a fleet."""

    fleet: Fleet
    runs: dict[str, MemberRun]

    @property
    def time(self) -> float:
        """Simulated time (s)."""
        ...

    def send(self, name: str, goal: Pose2D | Step | int) -> None:
        """Append a goal of a robot."""

    def reschedule(self, member: MemberRun) -> None:
        """Take over that the goals of a robot have changed."""


@dataclass(slots=True, eq=False)
class _Errand:
    """What a robot does for the dispatcher: stops one after another."""

    kind: Literal["task", "home", "charge"]
    items: tuple[Any, ...]
    """Stops, or steps of docking."""
    since: float
    task: TaskProgress | None = None
    charger: _ChargerState | None = None
    place: int = 0
    """Of the item that is sent or under way."""
    phase: Literal["sending", "driving", "standing"] = "sending"
    until: float = 0.0
    """End of the handling, or of the patience for a current (s)."""
    outcome: int = 0
    """Number of the goal among those of the robot."""
    length: float = 0.0
    """Way of the robot when it began (m)."""


@dataclass(slots=True, eq=False)
class _ChargerState:
    charger: Charger
    pose: Pose2D
    holder: _Worker | None = None


@dataclass(slots=True, eq=False)
class _Worker:
    """A robot as the dispatcher knows it."""

    member: MemberRun
    radius: float
    """Inscribed (m)."""
    outer: float
    """Circumscribed (m)."""
    home: Stop
    pose: Pose2D
    """That it reported last."""
    capacity: float | None
    charge: float | None = None
    queue: list[TaskProgress] = field(default_factory=list[TaskProgress])
    errand: _Errand | None = None
    heard_at: float = 0.0
    hears: bool = True
    lost: bool = False
    out: str = ""
    available: bool = False
    asks: float | None = None
    """Since when it waits for a charger."""
    missed: Counter[str] = field(default_factory=Counter[str])
    """How often it did not reach a charger, or that gave no current, by name."""
    strayed: bool = False
    """True if it did not get home: not again before its next task."""
    done: int = 0
    busy_s: float = 0.0
    charges: int = 0
    charging_s: float = 0.0

    @property
    def name(self) -> str:
        return self.member.name

    @property
    def free(self) -> bool:
        """True if it has nothing to do but to go home."""
        return self.errand is None or self.errand.kind == "home"


class Dispatcher:
    """Gives tasks to the robots of a run and follows them. `update` is called at each exchange, after all robots caught up."""

    def __init__(self, run: Robots, plan: TaskPlan, *, guided: bool) -> None:
        """`guided`: a traffic control leads the robots along the route graph of the fleet."""
        self.plan, self.params = plan, plan.params
        self.tasks = [TaskProgress(task) for task in plan.tasks]
        """In the order of the plan."""
        self._ordered = [self._progress(task) for task in in_order(plan.tasks)]
        self._run, fleet = run, run.fleet
        self._on_graph = guided and fleet.graph is not None
        self._ways = Ways(fleet.sorted_robots[0].scenario.map, fleet.graph, on_graph=self._on_graph)
        self._workers: list[_Worker] = []
        for member in run.runs.values():
            configuration, start = member.scenario.configuration, member.scenario.start
            footprint = true_footprint(configuration)
            home = self._ways.nearest_node(start) if self._on_graph else start
            capacity = configuration.navstack.sim.battery.capacity
            radii = footprint.inscribed_radius, footprint.circumscribed_radius
            self._workers.append(_Worker(member, *radii, home, start, capacity))
        self._chargers = [_ChargerState(charger, self._ways.pose(charger.stop)) for charger in plan.chargers]
        self._changed = True
        self._stopped = False
        self._released = 0
        self._ended_at = 0.0
        self._now = 0.0

    @property
    def is_done(self) -> bool:
        """True once every task has ended."""
        return self._stopped

    def stop(self) -> None:
        """Give and follow no tasks any more."""
        self._stopped = True

    def keeps(self, member: MemberRun) -> bool:
        """Return whether a robot stands at a stop or a charger, or is empty, and must not or cannot make way."""
        worker = next(worker for worker in self._workers if worker.member is member)
        empty = worker.charge is not None and worker.charge <= 0.0
        return empty or (worker.errand is not None and worker.errand.phase == "standing")

    def update(self, now: float) -> None:
        """Take the reports of the robots, and give them what to do."""
        if self._stopped:
            return
        self._now = now
        released = sum(progress.task.release <= now for progress in self.tasks)
        self._changed, self._released = self._changed or released != self._released, released
        for worker in self._workers:
            self._listen(worker)
        for worker in self._workers:
            if worker.hears:
                self._advance(worker)
        self._send_to_chargers()
        for worker in self._workers:
            available = self._is_available(worker)
            self._changed = self._changed or available != worker.available
            worker.available = available
        self._give_up()
        self._assign()
        for worker in self._workers:
            if worker.hears:
                self._begin(worker)
        if all(progress.ended is not None for progress in self.tasks):
            self._finish()

    def _finish(self) -> None:
        """End with the last task: nobody charges for its own sake."""
        self._stopped = True
        for worker in self._workers:
            if worker.errand is not None and worker.errand.kind == "charge" and worker.hears:
                self._end(worker)
                self._cancel(worker)

    # --- what robots report -------------------------------------------------------------------------------------------

    def _listen(self, worker: _Worker) -> None:
        member, now = worker.member, self._now
        worker.hears = not member.dead and now >= member.silent_until
        if not worker.hears:
            if not worker.lost and now - worker.heard_at > self.params.silence:
                worker.lost = True
                self._drop(worker, f"{worker.name} has not reported for {self.params.silence:g} s")
            return
        worker.heard_at, worker.pose = now, member.believed_pose
        if worker.lost:
            worker.lost = False
            self._cancel(worker)  # others have taken over what it drives
            self._changed = True
        battery = member.robot.battery_state
        worker.charge = None if battery is None or worker.capacity is None else battery.charge
        if worker.charge is not None and worker.charge <= 0.0 and not worker.out:
            worker.out = member.fault = f"ran empty at {now:.1f} s"
            member.tell(f"{worker.name} {worker.out}")
            self._drop(worker, f"{worker.name} {worker.out}")
            self._cancel(worker)

    def _drop(self, worker: _Worker, why: str) -> None:
        """Take everything back from a robot."""
        if worker.errand is not None and worker.errand.task is not None:
            self._return(worker.errand.task, why)
        self._end(worker)
        worker.queue.clear()
        worker.asks = None
        for state in self._chargers:
            if state.holder is worker:
                state.holder = None
        self._changed = True

    def _cancel(self, worker: _Worker) -> None:
        """Cancel the goal of a robot."""
        if not worker.member.is_idle:
            worker.member.abandon()
            self._run.reschedule(worker.member)

    def _return(self, progress: TaskProgress, why: str) -> None:
        progress.returns.append(why)
        progress.state, progress.robot, progress.started, progress.bids = "returned", "", None, {}
        self._changed = True

    def _end(self, worker: _Worker) -> None:
        """End what a robot does, and add up its time."""
        errand, worker.errand = worker.errand, None
        if errand is None:
            return
        if errand.kind == "task":
            worker.busy_s += self._now - errand.since
        elif errand.kind == "charge":
            worker.charging_s += self._now - errand.since
        self._changed = True

    # --- what robots do -----------------------------------------------------------------------------------------------

    def _advance(self, worker: _Worker) -> None:
        """Follow a robot: send the next item when it is ready, see how the last one ended, wait at stops and chargers."""
        errand, member = worker.errand, worker.member
        if errand is None:
            return
        if errand.phase == "sending":
            if member.is_idle:
                errand.outcome, errand.phase = len(member.outcomes), "driving"
                self._run.send(worker.name, self._item(worker, errand.items[errand.place]))
        elif errand.phase == "driving":
            if member.is_idle:
                self._arrive(worker, errand, member.outcomes[errand.outcome])
        elif errand.kind == "charge":
            self._charge(worker, errand)
        elif self._now >= errand.until:
            self._go_on(worker, errand)

    def _item(self, worker: _Worker, item: Any) -> Any:
        """Return what the robot is sent: off the graph a node is a pose, with the heading of the way there."""
        if not isinstance(item, int) or self._on_graph:
            return item
        at = self._ways.pose(item)
        near = worker.pose.distance_to(at) < worker.outer
        return at._replace(yaw=worker.pose.yaw if near else math.atan2(at.y - worker.pose.y, at.x - worker.pose.x))

    def _arrive(self, worker: _Worker, errand: _Errand, outcome: GoalOutcome) -> None:
        if outcome.succeeded:
            if errand.task is not None and errand.task.task.handling > 0.0:
                errand.phase, errand.until = "standing", self._now + errand.task.task.handling
            elif errand.charger is not None and not errand.charger.charger.dock:
                errand.phase, errand.until = "standing", self._now + _NO_CURRENT_S
            else:
                self._go_on(worker, errand)
            return
        why = f"{worker.name}: {outcome.message or outcome.text or outcome.state}"
        if errand.task is not None:
            progress = errand.task
            progress.barred.add(worker.name)
            self._return(progress, why)
            if len(progress.barred) >= self.params.attempts:
                self._fail(progress, why)
        elif errand.charger is not None:
            self._miss(worker, errand.charger)
        else:
            worker.strayed = True
        self._end(worker)

    def _go_on(self, worker: _Worker, errand: _Errand) -> None:
        """Go on to the next item of an errand, or end it."""
        if errand.place + 1 < len(errand.items):
            errand.place, errand.phase = errand.place + 1, "sending"
            self._advance(worker)
            return
        if errand.task is not None:
            progress = errand.task
            progress.state, progress.ended = "done", self._now
            progress.way = worker.member.path_length - errand.length
            self._ended_at, worker.done = self._now, worker.done + 1
        elif errand.kind == "charge":
            worker.charges += 1
        self._end(worker)

    def _fail(self, progress: TaskProgress, why: str) -> None:
        progress.state, progress.reason, progress.ended = "failed", why, self._now
        self._ended_at = self._now

    # --- charging -----------------------------------------------------------------------------------------------------

    def _charge(self, worker: _Worker, errand: _Errand) -> None:
        """Stay at a charger until there is charge enough; leave one that gives no current."""
        battery, state = worker.member.robot.battery_state, errand.charger
        if battery is None or battery.charge >= self.plan.charging.resume:
            self._go_on(worker, errand)
        elif battery.current > 0.0:
            errand.until = self._now + _NO_CURRENT_S
        elif self._now >= errand.until and state is not None:
            self._miss(worker, state)
            self._end(worker)

    def _miss(self, worker: _Worker, state: _ChargerState) -> None:
        worker.missed[state.charger.name] += 1
        worker.member.tell(f"{worker.name} does not charge at {state.charger.name}")
        state.holder = None

    def _send_to_chargers(self) -> None:
        """Let robots with little charge ask for a charger, and send them to free ones in the order of asking."""
        for state in self._chargers:
            holder = state.holder
            if holder is not None and holder.errand is not None and holder.errand.charger is state:
                continue
            if holder is not None and not self._stands_at(holder, state, holder):
                state.holder = None
        for worker in self._workers:
            if worker.hears and worker.free and worker.asks is None and not worker.out and self._is_low(worker):
                worker.asks = self._now
        asking = [worker for worker in self._workers if worker.asks is not None and worker.hears and not worker.out]
        for worker in sorted(asking, key=lambda worker: (worker.asks or 0.0, worker.name)):
            self._send_to_charger(worker)

    def _is_low(self, worker: _Worker) -> bool:
        return bool(self._chargers) and worker.charge is not None and worker.charge < self.plan.charging.threshold

    def _send_to_charger(self, worker: _Worker) -> None:
        known = [state for state in self._chargers if worker.missed[state.charger.name] < self.params.attempts]
        held = {state.charger.name: self._holder(worker, state) for state in known}
        free = [
            (way, number, state)
            for number, state in enumerate(known)
            if held[state.charger.name] is None
            and math.isfinite(way := self._ways.length(worker.pose, state.charger.stop, worker.radius))
        ]
        if free:
            _, _, state = min(free)
            state.holder, worker.asks = worker, None
            text = f"{worker.name} goes to {state.charger.name} with a charge of {worker.charge:.0%}"
            worker.member.tell(text, {"charger": state.charger.name}, kind="task")
            items: tuple[Any, ...] = (state.charger.stop,)
            if state.charger.dock:
                until = self.plan.charging.resume
                items = read_step({"dock": state.charger.name, "until_charge": until}), read_step({"undock": True})
            self._start(worker, _Errand("charge", items, self._now, charger=state))
        elif all(holder is not None and (holder.lost or holder.out) for holder in held.values()):
            names = ", ".join(f"{name} is held by {holder.name}" for name, holder in held.items() if holder is not None)
            worker.out = worker.member.fault = f"cannot charge: {names or 'it reached no charger'}"
            self._drop(worker, f"{worker.name} {worker.out}")

    def _holder(self, worker: _Worker, state: _ChargerState) -> _Worker | None:
        """Return the robot that another one would have to wait for at a charger."""
        if state.holder is not None and state.holder is not worker:
            return state.holder
        standing = (o for o in self._workers if o is not worker and (o.errand is None or o.lost or o.out))
        return next((other for other in standing if self._stands_at(other, state, worker)), None)

    def _stands_at(self, other: _Worker, state: _ChargerState, worker: _Worker) -> bool:
        return other.pose.distance_to(state.pose) < other.outer + worker.outer + _APART_M

    # --- assignment ---------------------------------------------------------------------------------------------------

    def _is_available(self, worker: _Worker) -> bool:
        """Return whether a robot can be given tasks: it answers, works, has charge, and has done its own goals."""
        if not worker.hears or worker.lost or worker.out or worker.asks is not None or self._is_low(worker):
            return False
        if worker.errand is not None:
            return worker.errand.kind == "home" or (
                worker.errand.kind == "task" and self.params.assignment == "auction"
            )
        guided = worker.member.guided
        return worker.member.is_idle or (guided is not None and guided.goal is None)

    def _open(self) -> list[TaskProgress]:
        """Return the tasks that are to be given to a robot, or may be given to another one."""
        return [
            progress
            for progress in self._ordered
            if progress.state in ("waiting", "returned", "assigned") and progress.task.release <= self._now
        ]

    def _give_up(self) -> None:
        """Fail the tasks that no robot can do any more."""
        if not self._changed:
            return
        working = [worker for worker in self._workers if not worker.lost and not worker.out]
        for progress in self._open():
            able = [worker for worker in working if worker.name not in progress.barred]
            reach = any(math.isfinite(self._way(worker, progress.task)) for worker in able)
            if not reach:
                last = progress.returns[-1] if progress.returns else ""
                none = "no robot is left that could do it" if not able else "no robot has a way to it on the map"
                for worker in self._workers:
                    if progress in worker.queue:
                        worker.queue.remove(progress)
                self._fail(progress, f"{none}; {last}" if last else none)
        if not working:  # what is released later is nobody's either
            for progress in self._ordered:
                if progress.ended is None:
                    self._fail(progress, "no robot is left that could do it")

    def _way(self, worker: _Worker, task: Task) -> float:
        return self._ways.length(worker.pose, task.stops[0], worker.radius) + way_within(
            task, worker.radius, self._ways
        )

    def _assign(self) -> None:
        """Give the open tasks to the robots that are available."""
        if not self._changed:
            return
        self._changed = False
        by_auction = self.params.assignment == "auction"
        waiting = self._open()
        bidders = [self._bidder(worker, waiting) for worker in self._workers if worker.available]
        if by_auction:
            found = auction([p.task for p in waiting], bidders, self._ways, self.params.objective)
        else:
            found = assign_nearest([p.task for p in waiting], bidders, self._ways)
        given = {task.name: name for name, queue in found.queues.items() for task in queue}
        for progress in waiting:
            name = given.get(progress.task.name, "")
            if name:
                progress.state, progress.robot, progress.bids = "assigned", name, found.bids[progress.task.name]
            elif progress.state == "assigned":
                progress.state, progress.robot, progress.bids = "waiting", "", {}
        by_name = {progress.task.name: progress for progress in waiting}
        for worker in self._workers:
            worker.queue = [by_name[task.name] for task in found.queues.get(worker.name, ())]

    def _bidder(self, worker: _Worker, waiting: Sequence[TaskProgress]) -> Bidder:
        at, ahead = worker.pose, 0.0
        errand = worker.errand
        if errand is not None and errand.task is not None:
            for stop in errand.items[errand.place :]:
                ahead += self._ways.length(at, stop, worker.radius)
                at = stop
        barred = frozenset(p.task.name for p in waiting if worker.name in p.barred)
        return Bidder(worker.name, at, worker.radius, ahead if math.isfinite(ahead) else 0.0, barred)

    def _begin(self, worker: _Worker) -> None:
        """Let a robot set out for its next task; without one, send it home."""
        if not worker.free or not (worker.available or worker.asks is not None):
            return
        if worker.queue:
            progress = worker.queue.pop(0)
            progress.state, progress.started = "running", self._now
            worker.strayed = False
            stops = progress.task.stops
            length = worker.member.path_length
            self._tell_bids(worker, progress)
            self._start(worker, _Errand("task", stops, self._now, task=progress, length=length))
        elif worker.errand is None and worker.member.is_idle and not worker.strayed:
            in_charger = any(state.holder is worker for state in self._chargers)
            away = worker.pose.distance_to(self._ways.pose(worker.home)) > _AT_HOME_M
            if away and (self.params.idle == "home" or in_charger):
                worker.member.tell(f"{worker.name} goes home: no task is given to it", {}, kind="task")
                self._start(worker, _Errand("home", (worker.home,), self._now))

    def _start(self, worker: _Worker, errand: _Errand) -> None:
        if worker.errand is not None:  # on its way home
            self._end(worker)
            self._cancel(worker)
        worker.errand = errand
        self._advance(worker)

    def _tell_bids(self, worker: _Worker, progress: TaskProgress) -> None:
        """Write into the record why the robot has got the task."""
        task, others = progress.task, sorted(progress.bids.items(), key=lambda item: (item[1], item[0]))
        bids = ", ".join(f"{name} {bid:.1f} m" if math.isfinite(bid) else f"{name} no way" for name, bid in others)
        silent = [f"{w.name} {self._why_not(w, progress)}" for w in self._workers if w.name not in progress.bids]
        what = "bids" if self.params.assignment == "auction" else "ways"
        text = f"{task.name} is given to {worker.name}; {what}: {bids}"
        if silent:
            text += f"; not asked: {', '.join(silent)}"
        worker.member.tell(text, {"task": task.name, "robot": worker.name, "bids": dict(progress.bids)}, kind="task")

    def _why_not(self, worker: _Worker, progress: TaskProgress) -> str:
        if worker.lost or not worker.hears:
            return "does not answer"
        if worker.out:
            return worker.out
        if worker.name in progress.barred:
            return "has failed it"
        if worker.asks is not None or (worker.errand is not None and worker.errand.kind == "charge"):
            return "has to charge"
        if worker.errand is not None and worker.errand.task is not None:
            return f"drives {worker.errand.task.task.name}"
        return "was busy" if worker.free else "is busy"

    # --- the result ---------------------------------------------------------------------------------------------------

    def report(self) -> TaskReport:
        """Return what has come of the tasks so far."""
        ended = all(task.ended is not None for task in self.tasks)
        horizon = self._ended_at if ended else self._run.time
        return TaskReport(tuple(self.tasks), tuple(map(self._load, self._workers)), self.params.assignment, horizon)

    def _load(self, worker: _Worker) -> RobotLoad:
        member, errand = worker.member, worker.errand
        under_way = self._run.time - errand.since if errand is not None else 0.0
        battery = member.scenario.configuration.navstack.sim.battery
        return RobotLoad(
            worker.name,
            worker.done,
            worker.busy_s + (under_way if errand is not None and errand.kind == "task" else 0.0),
            member.path_length,
            worker.charges,
            worker.charging_s + (under_way if errand is not None and errand.kind == "charge" else 0.0),
            worker.charge,
            energy_of(battery, self._run.time, member.path_length),
            worker.out or ("does not answer" if worker.lost else ""),
        )

    def _progress(self, task: Task) -> TaskProgress:
        return next(progress for progress in self.tasks if progress.task is task)

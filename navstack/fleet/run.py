"""Drives a fleet: the stacks of all robots in lockstep, in one world. The same fleet always gives the same records."""

from __future__ import annotations

import math
from bisect import insort
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from navstack.bringup import simulated_robot, true_footprint
from navstack.core import (
    InputError,
    Listener,
    NavError,
    Pose2D,
    RecordError,
    Transform2D,
    Twist2D,
    ensure_directory,
    working_time,
)
from navstack.fleet.dispatcher import Dispatcher
from navstack.fleet.drive import GuidedDrive
from navstack.fleet.fleet import Dies, Fleet, FleetRobot, LosesLocalization, Pushed, Silent
from navstack.fleet.member import NEVER, MemberRun, Wait
from navstack.fleet.tasks import TaskReport
from navstack.record import Record
from navstack.scenario import RunResult, Step
from navstack.sim import Lockstep, Nearest, SimulatedRobot
from navstack.traffic import (
    Communication,
    Grant,
    RobotReport,
    TrafficControl,
    TrafficEvent,
    TrafficParams,
    TrafficRule,
    make_rule,
)

TRAFFIC_PERIOD_S: Final = 0.2
"""Time between two exchanges of the robots with the traffic control (s)."""
WARM_UP_S: Final = 2.5
"""Simulated seconds of a warm-up."""
CUSTOM_RULE: Final = "given in Python"
_SAME_CONTACT_S: Final = 1.0
_PUSH_STEP_M: Final = 0.02

Progress = Callable[[float, int], None]
"""Called at each step with the simulated time (s) and the number of robots that are done."""


@dataclass(frozen=True, slots=True)
class Contact:
    """Two robots touched each other."""

    time: float
    """When it began (s)."""
    robot: str
    """The robot that drove into the other one, or was stopped by it."""
    other: str
    pose: Pose2D
    """Of `robot`, in the map."""

    def __str__(self) -> str:
        return f"{self.robot} touches {self.other} at {self.time:.2f} s"


@dataclass(frozen=True, slots=True, repr=False)
class RobotResult:
    """How one robot of a fleet fared."""

    name: str
    run: RunResult
    """As of a robot alone: goals, metrics, record. Its `collisions` include those with other robots."""
    finished_s: float
    """When its last goal ended (s)."""
    waiting_s: float
    """Time with a goal under way in which it stood (s)."""
    nearest: Nearest
    """How near it came to another robot."""
    contacts: tuple[Contact, ...]
    """Those that it is one of the two of."""
    waits: tuple[Wait, ...]
    """What the traffic control made it wait for."""
    fault: str = ""
    """Why it did not finish, such as that it died."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        nearest = self.nearest
        return {
            "name": self.name,
            "finished_s": round(self.finished_s, 6),
            "waiting_s": round(self.waiting_s, 6),
            "min_distance_m": nearest.distance_m if nearest.robot else None,
            "nearest_robot": nearest.robot or None,
            "nearest_time_s": round(nearest.time, 6) if nearest.robot else None,
            "contacts": len(self.contacts),
            "fault": self.fault or None,
            "waits": [{"begin": w.begin, "end": w.end, "reason": w.reason} for w in self.waits],
            **self.run.as_dict(),
        }

    def __repr__(self) -> str:
        return f"<RobotResult: {self.name}: {self.run}>"


@dataclass(frozen=True, slots=True, repr=False)
class FleetResult:
    """How a run of a fleet ended. Only `wall_s` varies between repetitions."""

    robots: tuple[RobotResult, ...]
    """By name."""
    contacts: tuple[Contact, ...]
    """Between robots, in the order of time; a lasting one counts once."""
    simulated_s: float
    wall_s: float
    seed: int
    events: tuple[TrafficEvent, ...] = ()
    """What the traffic control found and did: deadlocks, detours."""
    tasks: TaskReport | None = None
    """None for a fleet without tasks."""

    def robot(self, name: str) -> RobotResult:
        """Return the result of a robot. Raises InputError for an unknown name."""
        for robot in self.robots:
            if robot.name == name:
                return robot
        raise InputError(f'there is no robot "{name}"; robots: {", ".join(r.name for r in self.robots)}', robot=name)

    @property
    def succeeded(self) -> bool:
        """True if every robot met its success conditions: by default all goals SUCCEEDED without a collision.

        With tasks, all of them have to be done instead of all goals reached: another robot may do what one has not.
        """
        if self.tasks is None:
            return all(robot.run.succeeded for robot in self.robots)
        conditions = [each for robot in self.robots for each in robot.run.conditions if each.condition != "goals"]
        return self.tasks.all_done and all(condition.holds for condition in conditions)

    @property
    def makespan_s(self) -> float:
        """When the last goal of any robot ended (s)."""
        return max(robot.finished_s for robot in self.robots)

    @property
    def sum_of_times_s(self) -> float:
        """Sum over the robots of the times at which their last goals ended (s)."""
        return sum(robot.finished_s for robot in self.robots)

    @property
    def waiting_s(self) -> float:
        """Sum over the robots of the time that they stood with a goal under way (s)."""
        return sum(robot.waiting_s for robot in self.robots)

    @property
    def min_distance_m(self) -> float:
        """Smallest distance between two robots at any physics step (m); inf for a robot alone."""
        return min(robot.nearest.distance_m for robot in self.robots)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per wall second."""
        return self.simulated_s / self.wall_s if self.wall_s > 0.0 else math.inf

    def as_dict(self) -> dict[str, Any]:
        """Return the document of `navstack simulate --json`, without the file names."""
        least = self.min_distance_m
        return {
            "success": self.succeeded,
            "makespan_s": round(self.makespan_s, 6),
            "sum_of_times_s": round(self.sum_of_times_s, 6),
            "waiting_s": round(self.waiting_s, 6),
            "min_distance_m": least if math.isfinite(least) else None,
            "contacts": [{"time": c.time, "robots": [c.robot, c.other], "pose": list(c.pose)} for c in self.contacts],
            "traffic": [
                {"time": e.time, "kind": e.kind, "robots": list(e.robots), "text": e.text} for e in self.events
            ],
            "simulated_s": round(self.simulated_s, 6),
            "wall_s": self.wall_s,
            "real_time_factor": self.real_time_factor,
            "seed": self.seed,
            "robots": [robot.as_dict() for robot in self.robots],
            **({} if self.tasks is None else {"tasks": self._tasks_as_dict(self.tasks)}),
        }

    def _tasks_as_dict(self, report: TaskReport) -> dict[str, Any]:
        waits = [wait for robot in self.robots for wait in robot.waits]
        conflicts = {"waits": len(waits), "waits_s": sum(wait.end - wait.begin for wait in waits)}
        return {**report.as_dict(), "conflicts": {**conflicts, "contacts": len(self.contacts)}}

    def __str__(self) -> str:
        goals = [goal for robot in self.robots for goal in robot.run.goals]
        reached = sum(goal.succeeded for goal in goals)
        touches = "1 contact" if len(self.contacts) == 1 else f"{len(self.contacts)} contacts"
        robots = "1 robot" if len(self.robots) == 1 else f"{len(self.robots)} robots"
        done = f"{reached}/{len(goals)} goals"
        if self.tasks is not None:
            done = f"{self.tasks.count('done')}/{len(self.tasks.tasks)} tasks"
        return f"{robots}, {done}, makespan {self.makespan_s:.1f} s, {touches}"

    def __repr__(self) -> str:
        return f"<FleetResult: {self}>"


class FleetRun:
    """Drives a fleet one event at a time: control cycles of robots, the exchange with the traffic control, faults.

    Between two events all bodies advance together (`navstack.sim.Lockstep`).
    """

    def __init__(
        self,
        fleet: Fleet,
        *,
        traffic: TrafficRule | None = None,
        record: bool = True,
        scans: bool = True,
        spool: Path | None = None,
        measure: bool = True,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`traffic` replaces the rule of the fleet; records of such a run cannot be run again. The other arguments: see `Run`;
        `spool` gets a folder for each robot.

        Raises InputError or PlanningError, with the name of the robot, if a robot cannot start.
        """
        self.fleet = fleet
        self.world = fleet.world()
        members = fleet.sorted_robots
        self.traffic = _control_of(fleet, traffic)
        """The traffic control; None if every robot drives as it likes."""
        guided = self.traffic is not None
        robots: dict[str, SimulatedRobot] = {}
        for member in members:
            with _named(member.name):
                scenario = member.scenario
                robots[member.name] = simulated_robot(
                    scenario.configuration, self.world, scenario.start, seed=scenario.seed
                )
        self.lockstep = Lockstep(robots)
        stored = fleet.as_dict() if record else {}
        if record and traffic is not None:
            stored["traffic"] = {"rule": CUSTOM_RULE}
        self.runs: dict[str, MemberRun] = {}
        """By name, in their order."""
        for member in members:
            with _named(member.name):
                self.runs[member.name] = MemberRun(
                    self,
                    _recorded_as(member, stored),
                    robots[member.name],
                    record=record,
                    scans=scans,
                    spool=None if spool is None else ensure_directory(spool / member.name),
                    measure=measure,
                    listeners=listeners,
                    items=self._items(member, guided=guided) if member.route else None,
                )
        self._members = list(self.runs.values())
        self._routed = [i for i, member in enumerate(members) if (member.route or fleet.tasks) and guided]
        self._radii = [true_footprint(member.scenario.configuration).circumscribed_radius for member in members]
        self.tasks = None if fleet.tasks is None else Dispatcher(self, fleet.tasks, guided=guided)
        """Gives the tasks of the fleet to its robots; None without tasks."""
        self._faults = sorted(fleet.faults, key=lambda fault: (fault.time, fault.robot, fault.kind))
        self._exchanges = 0
        self._begun = False
        self.done = False

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the robots, sorted."""
        return self.lockstep.names

    @property
    def time(self) -> float:
        """Seconds since the start."""
        return self.lockstep.time

    def run_of(self, name: str) -> MemberRun:
        """Return the run of a robot. Raises InputError for an unknown name."""
        if name not in self.runs:
            raise InputError(f'there is no robot "{name}"; robots: {", ".join(self.runs)}', robot=name)
        return self.runs[name]

    # --- steps --------------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Advance to the next event, and carry out what is due then. Return False when all robots are done."""
        if not self._begun:
            self._begun = True
            for member in self._members:
                self._schedule(member)
            self._events_at(0)
        busy = [member for member in self._members if member.due < NEVER]
        if not busy and not self._faults and not self._has_tasks:
            self._finish()
            return False
        self.done = False
        step = min((member.due for member in busy), default=NEVER)
        if self._faults:
            step = min(step, self.lockstep.step_at(self._faults[0].time))
        if self._routed or self._has_tasks:
            step = min(step, self._next_exchange)
        step = max(step, self.lockstep.step)
        self.lockstep.advance_to(step)
        for number, member in enumerate(self._members):
            if member.due <= step:
                self.lockstep.catch_up(number)
                member.cycle()
                self._schedule(member)
        self._events_at(step)
        return True

    def _schedule(self, member: MemberRun) -> None:
        """Begin the next cycle of a robot, at the time that it has caught up with."""
        was = member.due
        due = member.begin_cycle()
        member.due = NEVER if due is None else self.lockstep.step_at(due)
        if due is None and was < NEVER:
            member.finished_s = self.time if member.cycles else 0.0
            member.robot.scans()  # nobody fetches them any more

    @property
    def _next_exchange(self) -> int:
        return self.lockstep.step_at(self._exchanges * TRAFFIC_PERIOD_S)

    def _events_at(self, step: int) -> None:
        """Carry out the faults and the exchange with the traffic control that are due."""
        while self._faults and self.lockstep.step_at(self._faults[0].time) <= step:
            self._apply(self._faults.pop(0))
        if (self._routed or self._has_tasks) and self._next_exchange <= step:
            self.lockstep.catch_up()
            if self.tasks is not None:
                self.tasks.update(self.time)
            if self._routed:
                self._exchange()
            self._exchanges += 1
            for member in self._members:
                if member.is_idle:
                    member.robot.scans()

    @property
    def _has_tasks(self) -> bool:
        return self.tasks is not None and not self.tasks.is_done

    def catch_up(self, member: MemberRun) -> None:
        """Let a robot take over what its body has done, before something is done to it."""
        self.lockstep.catch_up(self._members.index(member))
        if member.is_idle:
            member.robot.scans()  # nobody fetches them

    def reschedule(self, member: MemberRun) -> None:
        """Determine the next cycle of a robot anew, after something was done to it."""
        if self._begun:
            self._schedule(member)
            self.done = False

    def send(self, name: str, goal: Pose2D | Step | int) -> None:
        """Append a goal of a robot: a pose in the map, a step, or a node of the route graph. It may be done already.

        Raises InputError for an unknown robot or node, and for a robot that has died.
        """
        member = self.run_of(name)
        if member.dead:
            raise InputError(f"{name} has died; send the goal to another robot", robot=name)
        item = self._drive_to(goal) if isinstance(goal, int) else goal
        number = self._members.index(member)
        self.catch_up(member)
        if isinstance(item, GuidedDrive) and number not in self._routed:
            insort(self._routed, number)
        member.add_goal(item)
        self.reschedule(member)

    def stop(self) -> None:
        """End the run: cancel all goals and finish the records."""
        self._faults.clear()
        self._routed.clear()
        if self.tasks is not None:
            self.tasks.stop()
        self.lockstep.catch_up()
        for member in self._members:
            member.abandon()
            if self._begun:
                self._schedule(member)
        while self.step():
            pass

    def _finish(self) -> None:
        self.lockstep.catch_up()
        for member in self._members:
            self._end_wait(member)
        self.done = True

    # --- faults -------------------------------------------------------------------------------------------------------

    def _apply(self, fault: Any) -> None:
        member = self.runs[fault.robot]
        if member.dead:
            return
        robot = member.robot
        self.lockstep.catch_up(self._members.index(member))
        match fault:
            case Dies():
                member.tell(f"{member.name} dies")
                member.fault = f"died at {fault.time:g} s"
                member.abandon()
                member.dead = True
                robot.drive_by_hand(Twist2D())  # before the cancel takes effect
            case LosesLocalization():
                robot.mislocalize(Transform2D(*fault.offset))
                member.tell(f"{member.name} loses its localization")
            case Pushed():
                member.tell(f"{member.name} is pushed by {_push(robot, Transform2D(*fault.by)):.2f} m")
            case Silent():
                member.silent_until = fault.until
                member.tell(f"{member.name} is silent until {fault.until:g} s")
            case _:
                raise InputError(f"{fault!r} is no fault")
        if member.due < NEVER:
            self._schedule(member)

    # --- traffic ------------------------------------------------------------------------------------------------------

    def _items(self, member: FleetRobot, *, guided: bool) -> list[Pose2D | GuidedDrive]:
        """Return what a robot with a route drives to, in order."""
        if guided:
            return [self._drive_to(node) for node in member.route]
        poses, before = list[Pose2D | GuidedDrive](), member.scenario.start
        for node in member.route:
            at = self._pose_of(node)
            yaw = math.atan2(at.y - before.y, at.x - before.x) if before.distance_to(at) > 1e-3 else before.yaw
            before = at._replace(yaw=yaw)
            poses.append(before)
        return poses

    def _pose_of(self, node: int) -> Pose2D:
        graph = self.fleet.graph
        if graph is None:
            raise InputError(f"the fleet has no route graph with the node {node}; give it one", node=node)
        x, y = graph.xy[graph.node(node)].tolist()
        return Pose2D(x, y, 0.0)

    def _drive_to(self, node: int) -> GuidedDrive:
        target = self._pose_of(node)
        if self.traffic is None:
            raise InputError(f"nobody grants the way to node {node}; choose a traffic rule, or send a pose", node=node)
        graph = self.fleet.graph
        assert graph is not None
        return GuidedDrive(node, target, self.traffic.rule.path, graph.frame)

    def _exchange(self) -> None:
        """Report all robots with routes to the traffic control, and take its grants."""
        control, now = self.traffic, self.time
        assert control is not None
        talking = [i for i in self._routed if not self._members[i].dead and now >= self._members[i].silent_until]
        grants = control.update(now, [self._report(i) for i in talking])
        for number in talking:
            member = self._members[number]
            grant = grants.get(member.name)
            if grant is not None:
                self._take_grant(member, grant)

    def _report(self, number: int) -> RobotReport:
        member = self._members[number]
        robot, guided = member.robot, member.guided
        goal = None if guided is None else guided.goal
        if goal is None:
            waiting = member.goals.waiting[0] if member.goals.waiting else None
            goal = waiting.goal if isinstance(waiting, GuidedDrive) else None
        battery = robot.battery_state
        return RobotReport(
            member.name,
            member.believed_pose,
            self._radii[number],
            goal,
            member.priority,
            battery is None or battery.charge > 0.0,
            self.time,
            1.0 if battery is None else battery.charge,
            member.move_base.local_planner.limits.max_vel_trans,
        )

    def _take_grant(self, member: MemberRun, grant: Grant) -> None:
        guided = member.guided
        if guided is None:
            stays = member.due < NEVER or (self.tasks is not None and self.tasks.keeps(member))
            last = grant.up_to if not stays and len(grant.nodes) > 1 else None
            if last is not None and member.robot.pose.distance_to(self._pose_of(last)) > self.traffic_params.reach:
                guided = self._make_way(member, last)
        if guided is None:
            return
        guided.grant(grant.nodes, grant.reason, grant.until)
        if grant.reason != member.wait_reason:
            self._end_wait(member)
            member.wait_reason, member.waits_since = grant.reason, self.time if grant.reason else None

    def _make_way(self, member: MemberRun, node: int) -> GuidedDrive:
        drive = self._drive_to(node)
        drive.goal, drive.name = None, f"make way to node {node}"
        member.add_goal(drive)
        self._schedule(member)
        return drive

    @property
    def traffic_params(self) -> TrafficParams:
        """The parameters of the traffic rule."""
        return TrafficParams() if self.traffic is None else self.traffic.rule.params

    def _end_wait(self, member: MemberRun) -> None:
        if member.waits_since is not None:
            member.waits.append(Wait(member.name, member.waits_since, self.time, member.wait_reason))
            member.wait_reason, member.waits_since = "", None

    # --- the result ---------------------------------------------------------------------------------------------------

    def contacts(self) -> tuple[Contact, ...]:
        """Return the contacts between robots so far, by time."""
        found = [
            Contact(collision.time, member.name, collision.name, collision.pose)
            for member in self._members
            for collision in member.robot.collisions
            if collision.kind == "robot"
        ]
        kept, last = list[Contact](), dict[frozenset[str], float]()
        for contact in sorted(found, key=lambda contact: (contact.time, contact.robot, contact.other)):
            pair = frozenset((contact.robot, contact.other))
            if contact.time - last.get(pair, -math.inf) > _SAME_CONTACT_S:
                kept.append(contact)
            last[pair] = contact.time
        return tuple(kept)

    def result(self, wall_s: float) -> FleetResult:
        """Return the result so far; `wall_s` is the wall time that the caller measured."""
        self.lockstep.catch_up()
        contacts = self.contacts()
        robots = [
            RobotResult(
                member.name,
                member.result(wall_s),
                member.finished_s if member.due == NEVER else self.time,
                member.waiting_s,
                self.lockstep.nearest(number),
                tuple(c for c in contacts if member.name in (c.robot, c.other)),
                tuple(member.waits),
                member.fault,
            )
            for number, member in enumerate(self._members)
        ]
        events = () if self.traffic is None else tuple(self.traffic.rule.events)
        tasks = None if self.tasks is None else self.tasks.report()
        return FleetResult(tuple(robots), contacts, self.time, wall_s, self.fleet.seed, events, tasks)


def run_fleet(
    fleet: Fleet,
    traffic: TrafficRule | None = None,
    *,
    record: bool = True,
    scans: bool = True,
    spool: Path | None = None,
    measure: bool = True,
    progress: Progress | None = None,
    stop: Callable[[], bool] | None = None,
) -> FleetResult:
    """Drive all robots of a fleet until their goals have ended. Arguments: see `FleetRun` and `run_scenario`.

    Raises InputError or PlanningError if a robot cannot start.

        result = run_fleet(load_fleet("fleet.yaml"))
        print(result, result.robot("robot_1").waiting_s)
    """
    began = working_time()
    run = FleetRun(fleet, traffic=traffic, record=record, scans=scans, spool=spool, measure=measure)
    while run.step():
        if stop is not None and stop():
            run.stop()
            break
        if progress is not None:
            progress(run.time, sum(member.due == NEVER for member in run.runs.values()))
    return run.result(working_time() - began)


def warm_up_fleet(fleet: Fleet) -> None:
    """Compile and load the kernels by driving the beginning of a run, and discarding it. Raises the errors of `run_fleet`."""
    run = FleetRun(fleet)
    while run.time < WARM_UP_S and run.step():
        pass
    run.result(0.0)


def replay_member(record: Record) -> MemberRun:
    """Return the run of a record's robot, from its start, with the whole fleet around it. Raises RecordError."""
    fleet, name = Fleet.from_record(record)
    if fleet.traffic.get("rule") == CUSTOM_RULE:
        raise RecordError(
            f"{record.path or 'the record'} cannot be run again: its traffic rule was given in Python; name a rule in the fleet"
        )
    return FleetRun(fleet).run_of(name)


def _control_of(fleet: Fleet, rule: TrafficRule | None) -> TrafficControl | None:
    """Return the traffic control of a fleet; None for the rule `none`."""
    settings = dict(fleet.traffic)
    name = str(settings.get("rule", "none"))
    if rule is None and name == "none":
        return None
    if rule is None:
        rule = make_rule(name, fleet.graph, TrafficParams(**settings.get("params", {})))
    link = Communication(float(settings.get("delay", 0.0)), float(settings.get("dropout", 0.0)), fleet.seed)
    return TrafficControl(rule, link)


def _recorded_as(member: FleetRobot, fleet: dict[str, Any]) -> FleetRobot:
    """Return the robot with the whole fleet among what its record contains."""
    if not fleet:
        return member
    scenario = member.scenario
    return replace(member, scenario=replace(scenario, names={**scenario.names, "robot": member.name, "fleet": fleet}))


@contextmanager
def _named(name: str) -> Generator[None]:
    """Prepend the name of a robot to errors."""
    try:
        yield
    except NavError as error:
        error.message = f"{name}: {error.message}"
        error.args = (error.message,)
        raise


def _push(robot: SimulatedRobot, by: Transform2D) -> float:
    """Push a robot as far as it is free, and return how far (m)."""
    start = robot.pose
    way = math.hypot(by.x, by.y)
    count = max(1, math.ceil(max(way, abs(by.yaw) * robot.footprint.circumscribed_radius) / _PUSH_STEP_M))
    free = start
    for k in range(1, count + 1):
        share = k / count
        pose = Transform2D(*start).apply(Pose2D(share * by.x, share * by.y, share * by.yaw))
        if robot.world.collision(robot.footprint, pose, solids=robot.solids) is not None:
            break
        free = pose
    robot.place(free, inform_localization=False)
    return start.distance_to(free)

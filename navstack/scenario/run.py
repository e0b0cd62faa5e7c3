"""Drives the simulated robot through a scenario. The same scenario always gives the same record."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import build_move_base, odometry_frame, simulated_robot, true_footprint
from navstack.core import (
    GridGeometry,
    InputError,
    InternalError,
    Listener,
    NavError,
    OccupancyGrid,
    Pose2D,
    Transform2D,
    normalize_angle,
    touches_lethal,
    working_time,
)
from navstack.costmap import LayeredCostmap
from navstack.docking import DockDatabase, Docking, DockTask, Undocking
from navstack.move_base import MotionHandle, MoveBase
from navstack.parameters import Finding
from navstack.plugins import Behavior
from navstack.record import (
    Record,
    RunMetrics,
    RunRecorder,
    SolidNames,
    SteeredBase,
    Timings,
    metrics_of,
    record_tick_outputs,
)
from navstack.scenario.goal_sequence import GoalSequence, SentGoal
from navstack.scenario.interactions import effect_ends
from navstack.scenario.interventions import Interventions
from navstack.scenario.low_battery import LowBattery
from navstack.scenario.outcome import (
    BACKWARD_M_S,
    TURNING_RAD_S,
    GoalOutcome,
    RunMeasurements,
    RunResult,
    WarningCollector,
    advice_for,
)
from navstack.scenario.scenario import Scenario
from navstack.scenario.steps import DockStep, Step, UndockStep, motion_of
from navstack.scenario.success import SuccessConditions
from navstack.sim import SimulatedRobot, wheel_drive


def advice_of(record: Record) -> tuple[str, ...]:
    """Return what may explain missed goals or long turns in place of a recorded run; see `advice_for`."""
    try:
        findings = Scenario.from_record(record).configuration.findings
    except NavError:  # a log, or parameters of another version
        findings = ()
    return _advice_of(record, metrics_of(record), findings)


def _advice_of(record: Record, metrics: RunMetrics, findings: Sequence[Finding]) -> tuple[str, ...]:
    before = np.searchsorted(record.times, record.collision_times, side="left") - 1
    motions = ["" if i < 0 else blind_motion(*record.velocities[i, [0, 2]]) for i in before]
    times = dict(zip(record.collision_times.tolist(), motions, strict=True))
    return advice_for(
        metrics,
        findings,
        len(record.collisions),
        marked_collisions(record),
        [t for t, motion in times.items() if motion == "backward"],
        [t for t, motion in times.items() if motion == "turning"],
    )


def blind_motion(vx: float, wz: float) -> str:
    """Return the motion (m/s, rad/s) that a lidar at the front does not guard: `backward`, `turning` in place, or empty."""
    if vx < BACKWARD_M_S:
        return "backward"
    return "turning" if vx <= -BACKWARD_M_S and abs(wz) > TURNING_RAD_S else ""


def marked_collisions(record: Record) -> list[float]:
    """Return the times (s) of the collisions with obstacles that the local costmap had."""
    found: list[float] = []
    for t, pose in zip(record.collision_times.tolist(), record.collisions.tolist(), strict=True):
        costmap = record.costmap_at("local", t)
        if costmap is None:
            continue
        to_map = record.to_global(record.costmap_frame("local"), t)
        if touches_lethal(costmap, record.footprint, to_map.inverse().apply(Pose2D(*pose))):
            found.append(t)
    return found


def advice_for_goal(record: Record, findings: Sequence[Finding], *, failed: bool) -> tuple[str, ...]:
    """Return what may explain one goal of a record, with the findings about the parameters in force; see `advice_for`."""
    metrics = replace(metrics_of(record), goals=1, succeeded=int(not failed))
    return _advice_of(record, metrics, findings)


def new_recorder(scenario: Scenario, robot: SimulatedRobot, *, scans: bool, spool: Path | None = None) -> RunRecorder:
    """Returns the recorder of a run of the scenario, with the obstacles if they do not move."""
    configuration = scenario.configuration
    sim = configuration.navstack.sim
    lidars = [sim.lidar(name) for name in sim.lasers]
    recorder = RunRecorder(
        map=scenario.map,
        footprint=true_footprint(configuration),
        scenario=scenario.as_dict(),
        global_frame=configuration.global_costmap.params.global_frame,
        local_frame=odometry_frame(configuration),
        base_frame=configuration.local_costmap.params.robot_base_frame,
        sensors={lidar.frame: Transform2D(lidar.x, lidar.y, lidar.yaw) for lidar in lidars},
        steering=SteeredBase.of(sim),
        keep_scans=scans,
        spool=spool,
    )
    solids = robot.solids
    if not robot.moves and (scenario.shapes or scenario.dock_shapes):
        recorder.solids(solids.discs, solids.corners, solids.first)
    return recorder


def record_tick(
    recorder: RunRecorder, robot: SimulatedRobot, move_base: MoveBase, goal: int, solids: SolidNames | None
) -> None:
    """Adds what the last tick did to the record; `solids` are the names of the obstacles once they have changed."""
    t = move_base.last_tick.time
    record_tick_outputs(recorder, move_base)
    if robot.moves or solids is not None:
        recorder.solids(robot.solids.discs, robot.solids.corners, robot.solids.first, solids)
    localizer = robot.estimation.localizer
    if localizer is not None:
        recorder.estimate(localizer)
    recorder.sample(
        t,
        pose=robot.pose,
        odom=robot.state(),
        map_to_odom=robot.frames.lookup(robot.map_frame, robot.odom_frame),
        command=move_base.command if robot.by_hand is None else robot.by_hand,
        state=move_base.activity,
        goal_index=goal,
        steering=robot.steering_angle,
    )


WARM_UP_S = 2.5
"""Simulated seconds of a warm-up run: every stage of driving and of arriving runs once, also plans that revise earlier ones."""

MAX_IDLE_CYCLES = 1000
"""Maximum number of consecutive cycles without simulated time passing; a few occur when goals end and begin."""

LONGEST_IDLE_S = 0.2
"""Longest cycle without a goal (s)."""

_MAP_S = 1.0
"""Time between two maps of a robot that makes its own (s)."""
_UNKNOWN_M = 4.0
"""Width of the unknown map that it begins with (m)."""
DRIVING_S = 0.05
"""Longest cycle while the robot is driven by hand (s)."""

Progress = Callable[[float, int], None]
"""Called after each cycle with the simulated time (s) and the index of the current goal."""


class Run:
    """Drives a scenario one control cycle at a time; continues with the next goal when one fails.

    Without interactions, a run is done when its goals have ended. Interactions keep it going until their effect is over
    (`effect_ends`); `interact` adds one at any time, also after the end. The same interactions at the same times give the
    same record, whether they come from the scenario or from `interact`.

    Raises InputError or PlanningError if the robot cannot start.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        record: bool = True,
        scans: bool = True,
        spool: Path | None = None,
        measure: bool = True,
        timings: bool | Timings = False,
        listeners: Sequence[Listener] = (),
        known_map: OccupancyGrid | None = None,
        robot: SimulatedRobot | None = None,
        items: Sequence[Pose2D | Step | Behavior] | None = None,
    ) -> None:
        """`known_map`: the map that the robot has (default: that of the world; none if its localization makes one).

        `record=False` keeps only what the metrics need, `scans=False` all but the scans. `spool`: folder in which the
        record grows instead of in memory. `timings` measures the time of
        both planners, into the given `Timings` or by the wall clock. With `measure=False` there are no metrics either, and the
        memory does not grow with the run. `robot`: the scenario's robot, if it exists already and others advance it; then call
        `begin_cycle` and `end_cycle` instead of `step`. `items` are driven instead of those of the scenario.
        """
        configuration = scenario.configuration
        items = scenario.items if items is None else items
        scenario.success.check_goals(len(items))
        self.scenario = scenario
        if known_map is None and configuration.navstack.sim.localization == "mapping":
            known_map = _nothing_known(scenario)
        self.known_map = known_map or scenario.map
        """The map that the robot has; it grows if its localization makes one."""
        self._map_due = 0.0
        self.robot = robot or simulated_robot(
            configuration, scenario.world(), scenario.start, seed=scenario.seed, known_map=known_map
        )
        self._measurements = RunMeasurements(self.robot, keep=measure)
        self.recorder = new_recorder(scenario, self.robot, scans=scans, spool=spool) if record else None
        if self.recorder is not None:
            self._measure_for(self.recorder)
        self._warnings = WarningCollector()
        listening = [self._warnings, *listeners]
        if self.recorder is not None:
            listening.insert(0, self.recorder)
        self.timings: Timings | None = None
        if timings is not False:
            self.timings = Timings(clock=working_time) if timings is True else timings
        self.move_base = build_move_base(
            configuration,
            self.robot,
            static_map=self.known_map,
            listeners=listening,
            stopwatch=None if self.timings is None else self.timings.clock,
        )
        chain = self.move_base.chain
        if self.recorder is not None and chain is not None and chain.monitor is not None:
            self.recorder.zones(chain.monitor.as_dict()["zones"])
        self.docks = DockDatabase.of(configuration)
        """The docks that the robot knows."""
        self.goals = GoalSequence(
            items,
            self.robot,
            self._measurements,
            make_motion=self._make_motion,
            pause_s=scenario.pause_s,
            time_limit_s=scenario.time_limit_s,
            stop_on_failure=scenario.stop_on_failure,
            pass_through=scenario.pass_through,
            make_task=self._make_task,
            docks=self.docks,
            low_battery=scenario.low_battery,
        )
        self.interventions = Interventions(
            scenario, self.robot, self.move_base, self.goals, self.recorder, listening, self._record_goal
        )
        self._upcoming = deque(sorted(scenario.interactions, key=lambda item: item.time))
        for item in items:
            self.goals.check(item)  # before the robot drives
        if scenario.low_battery is not None:
            self._check_charger(scenario.low_battery)
        self._goes_on_until = -math.inf
        self._collisions_noted = 0
        self._marked_times: list[float] = []
        """Times of the collisions with obstacles that the local costmap had (s)."""
        self._blind_times: dict[str, list[float]] = {"backward": [], "turning": []}
        """Times of the collisions into which the robot drove backward, and turned in place (s)."""
        self._unrecorded: deque[SentGoal] = deque()
        self._idle_cycles = 0
        self._cycle_began, self._blind_motion = 0.0, ""
        self.done = False
        """True when every goal has ended and the interactions have had their effect."""
        # times are sums of floats: a difference below this is rounding and must not cause an extra physics step
        self._time_tolerance = 1e-5 / configuration.navstack.sim.physics_frequency

    @property
    def goal_index(self) -> int:
        """Index of the current goal, -1 before the first step."""
        return self.goals.last_index

    @property
    def outcomes(self) -> list[GoalOutcome]:
        """How the goals ended, in order."""
        return self.goals.outcomes

    def step(self) -> bool:
        """Runs one control cycle: advances the world to its time, then ticks move_base. Returns False when done."""
        due = self.begin_cycle()
        if due is None:
            return False
        self.robot.advance_to(due)
        self.end_cycle()
        return True

    def begin_cycle(self) -> float | None:
        """Carries out what is due between two cycles; returns the time (s) of the next cycle, None when the run is done."""
        self._settle()
        robot, move_base, goals = self.robot, self.move_base, self.goals
        due = math.inf
        if not goals.under_way:
            if robot.time < goals.pause_until - self._time_tolerance:
                due = goals.pause_until
            elif not self._send_next_goal():
                if not self._upcoming and robot.time >= self._goes_on_until:
                    self._finish()
                    return None
                due = robot.time + LONGEST_IDLE_S
        self.done = False
        if robot.by_hand is not None:
            robot.drive_by_hand(robot.by_hand)  # again, before the robot's command timeout
            due = min(due, robot.time + DRIVING_S)
        if self.goals.is_charging:
            due = min(due, robot.time + LONGEST_IDLE_S)
        if self.interventions.repeat_teleop():
            due = min(due, robot.time + DRIVING_S)
        velocity = robot.state().velocity
        self._cycle_began, self._blind_motion = robot.time, blind_motion(velocity.vx, velocity.wz)
        return min(due, move_base.next_due(robot.time))

    def end_cycle(self) -> None:
        """Ticks move_base at the robot's time, which is that of `begin_cycle` unless something happened before."""
        robot, move_base, goals = self.robot, self.move_base, self.goals
        self._note_collisions()
        self._take_map()
        move_base.tick(robot.time)
        goals.advance_tasks(move_base)
        if self.timings is not None:
            self.timings.add(move_base.last_tick)
        self._idle_cycles = self._idle_cycles + 1 if robot.time == self._cycle_began else 0
        if self._idle_cycles > MAX_IDLE_CYCLES:
            raise InternalError(
                f"the run does not advance beyond {robot.time:.3f} s: {MAX_IDLE_CYCLES} consecutive cycles took no "
                "simulated time; this is a bug in navstack, please report it with the scenario",
                time=robot.time,
            )
        self._measurements.add(move_base.activity, self.goal_index)
        if move_base.last_tick.plan is not None:
            self._measurements.note_plan(self.goal_index, move_base.last_tick.plan.path.poses)
        self._record_targets()
        if self.recorder is not None:
            changed = self.interventions.world_changed
            names = self.interventions.names_of_solids() if changed else None
            record_tick(self.recorder, robot, move_base, self.goal_index, names)
        goals.end_expired_motion(move_base)

    def _take_map(self) -> None:
        """Gives the costmaps the map that the localization makes, where it has grown."""
        localizer = self.robot.estimation.localizer
        if localizer is None or self.robot.time < self._map_due:
            return
        self._map_due = self.robot.time + _MAP_S
        grown = localizer.grown_map(self.robot.footprint.inscribed_radius)
        if grown is None:
            return
        self.known_map = grown
        for costmap in (self.move_base.global_costmap, self.move_base.local_costmap):
            if isinstance(costmap, LayeredCostmap) and costmap.set_static_map(grown) and not costmap.rolling_window:
                # a plan that is made before its next update must not find an empty costmap
                costmap.update(self.robot.time)

    def _note_collisions(self) -> None:
        """Notes which of the new collisions are with obstacles that the controller's costmap had, and the motion into them."""
        robot = self.robot
        if len(robot.collisions) == self._collisions_noted:
            return
        costmap = self.move_base.recovery_context.local_costmap
        from_map = robot.frames.lookup(costmap.frame, robot.map_frame)
        for collision in robot.collisions[self._collisions_noted :]:
            if touches_lethal(costmap.master, robot.footprint, from_map.apply(collision.pose)):
                self._marked_times.append(collision.time)
            if self._blind_motion:
                self._blind_times[self._blind_motion].append(collision.time)
        self._collisions_noted = len(robot.collisions)

    @property
    def is_paused(self) -> bool:
        """True between two goals."""
        return not self.goals.under_way and not self.done

    @property
    def upcoming(self) -> tuple[Any, ...]:
        """The interactions of the scenario whose time has not come."""
        return tuple(self._upcoming)

    def replace_upcoming(self, items: Iterable[Any] = ()) -> None:
        """Replaces the interactions whose time has not come, by others in the order of their times."""
        self._upcoming = deque(items)

    def interact(self, item: Any) -> None:
        """Carries out an interaction, a model of `navstack.scenario.interactions`, now; its time must be the current one.

        Call it only when the last `step` advanced the time or returned False: otherwise a run of a scenario with this
        interaction would carry it out earlier in the same instant. Raises NavError if it is refused; nothing has changed then.
        """
        self.goals.finish_ended()
        if self.done and self.recorder is not None:
            self._measure_for(self.recorder)
        self.interventions.apply(item)
        self.done = False
        self._goes_on_until = max(self._goes_on_until, effect_ends(item))
        self.goals.finish_ended()

    def add_goal(self, goal: Pose2D | Step | Behavior) -> None:
        """Appends a goal; a run that is done goes on. Raises the error of a step that this robot cannot do."""
        self.goals.check(goal)
        self.goals.finish_ended()
        if self.done and self.recorder is not None:
            self._measure_for(self.recorder)
        self.goals.waiting.append(goal)
        self.done = False

    def abandon(self) -> None:
        """Cancels what is under way and drops the waiting goals: the run is done as soon as that has ended."""
        self._upcoming.clear()
        self._goes_on_until = -math.inf
        self.goals.skip_waiting()
        for sent in self.goals.under_way:
            sent.cancel(self.move_base)

    def stop(self) -> None:
        """Ends the run: cancels the current goal, stops the robot and finishes the record."""
        under_way = self.goals.under_way
        self.abandon()
        while not all(sent.handle.is_done for sent in under_way):
            self.step()
        self.goals.finish_ended()
        self._finish()

    def record_from_here(self, scenario: Scenario) -> None:
        """Begins a record, without scans and clearances, that has all goals and, from now on, everything else.

        `scenario`: what the record says it is a run of.
        """
        recorder = self.recorder = new_recorder(scenario, self.robot, scans=False)
        for outcome in self.outcomes:
            recorder.goal(0.0, outcome.goal)
        for sent in self.goals.under_way:
            if sent not in self._unrecorded:
                recorder.goal(sent.time, sent.target or self.robot.pose)
        self.move_base.listeners.insert(0, recorder)
        self.interventions.record_with(recorder)
        chain = self.move_base.chain
        if chain is not None:
            chain.take_steps()
            if chain.monitor is not None:
                recorder.zones(chain.monitor.as_dict()["zones"])

    def result(self, wall_s: float) -> RunResult:
        """Returns the result so far; `wall_s` is the wall time that the caller measured."""
        metrics = self.metrics()
        states = [outcome.state for outcome in self.outcomes]
        return RunResult(
            goals=tuple(self.outcomes),
            simulated_s=self.robot.time,
            wall_s=wall_s,
            collisions=len(self.robot.collisions),
            seed=self.scenario.seed,
            recorder=self.recorder,
            metrics=metrics,
            conditions=self.scenario.success.evaluate(states, metrics, self.goals.total),
            timings=self.timings,
            min_clearance_m=self._measurements.min_clearance(),
            warnings=self._warnings.warnings(),
            advice=advice_for(
                metrics,
                self.scenario.configuration.findings,
                len(self.robot.collisions),
                self._marked_times,
                self._blind_times["backward"],
                self._blind_times["turning"],
            ),
        )

    def metrics(self) -> RunMetrics:
        """Returns the metrics so far; they count only the goals that have ended."""
        return self._measurements.metrics([outcome.as_dict() for outcome in self.outcomes])

    def track(self) -> NDArray[np.float64]:
        """Returns (n, 4) time (s) and true pose (m, m, rad) at each control cycle."""
        return self._measurements.track()

    @property
    def path_length(self) -> float:
        """Distance driven (m)."""
        return self._measurements.path_length

    def _measure_for(self, recorder: RunRecorder) -> None:
        """Lets the recorder ask for what is measured."""
        recorder.set_clearance_source(self._measurements.clearances)
        recorder.set_people_source(self._measurements.people)

    def _settle(self) -> None:
        """Stores the outcomes of ended goals and carries out the interactions whose time has come."""
        self.goals.finish_ended()
        passed = self.goals.pass_on(self.move_base)
        if passed is not None:
            self._record_goal(passed)
        while self._upcoming and self._upcoming[0].time <= self.robot.time + self._time_tolerance:
            self.interact(self._upcoming.popleft())
        self.interventions.stop_driving()

    def _send_next_goal(self) -> bool:
        """Sends the next goal; returns False if there is none."""
        sent = self.goals.send_next(self.move_base)
        if sent is not None:
            self._record_goal(sent)
        return sent is not None

    def _record_goal(self, sent: SentGoal) -> None:
        self._unrecorded.append(sent)
        if sent.pose is not None:
            self._record_targets()

    def _record_targets(self) -> None:
        """Records goals, and motions once it is known where they end: after their first step."""
        while self._unrecorded:
            sent = self._unrecorded[0]
            motion = sent.handle if isinstance(sent.handle, MotionHandle) else None
            if motion is not None and not motion.has_begun and not motion.is_done:
                return
            self._unrecorded.popleft()
            target = sent.target or self.robot.pose
            self._measurements.note_goal(target)
            if self.recorder is not None:
                self.recorder.goal(sent.time, target)

    def _make_motion(self, step: Step) -> Behavior:
        navstack = self.interventions.configuration.navstack
        sim, fastest = navstack.sim, navstack.sim.wheels.max_speed
        return motion_of(
            step,
            navstack.motion,
            turning_radius=sim.turning_radius,
            drive=None if fastest is None else wheel_drive(sim),
            max_wheel_speed=math.inf if fastest is None else fastest * sim.wheels.radius,
        )

    def _make_task(self, step: DockStep | UndockStep) -> DockTask:
        if isinstance(step, UndockStep):
            return Undocking(self.move_base, self.docks, step.undock, max_undocking_time_s=step.max_undocking_time)
        return Docking(
            self.move_base,
            self.docks,
            step.dock,
            navigate_to_staging_pose=step.navigate_to_staging_pose,
            charge_until=step.until_charge,
        )

    def _check_charger(self, rule: LowBattery) -> None:
        """Raise InputError, or DockNotInDatabaseError, for a rule without a dock or without a battery."""
        if rule.dock:
            self.docks.dock(rule.dock)
        elif not self.docks.docks:
            raise InputError("low_battery needs a dock; list one under docking_server/docks, or name a dock_database")
        if rule.resume <= rule.threshold:
            raise InputError(f"low_battery: resume {rule.resume:g} is not above threshold {rule.threshold:g}; raise it")
        if self.scenario.configuration.navstack.sim.battery.capacity is None:
            raise InputError("low_battery needs a battery that runs low; set navstack/sim/battery/capacity (Ah)")

    def _finish(self) -> None:
        if not self.done:
            self.done = True
            if self.recorder is not None:
                self.recorder.finish([outcome.as_dict() for outcome in self.outcomes], self.robot.collisions)


def _nothing_known(scenario: Scenario) -> OccupancyGrid:
    """Returns unknown space around the start, for a robot that begins to map."""
    resolution = scenario.map.geometry.resolution
    cells = max(1, math.ceil(_UNKNOWN_M / resolution))
    low = (scenario.start.x - 0.5 * cells * resolution, scenario.start.y - 0.5 * cells * resolution)
    return OccupancyGrid(np.full((cells, cells), -1, np.int8), GridGeometry(cells, cells, resolution, *low))


def warm_up(scenario: Scenario) -> None:
    """Compiles and loads the kernels by driving the beginning of the scenario, and an arrival, and discarding both.

    Raises the errors of `run_scenario`.
    """
    turned = scenario.start._replace(yaw=normalize_angle(scenario.start.yaw + 1.0))
    arrival = replace(scenario, goals=(turned,), steps=(), success=SuccessConditions(), interactions=())
    for part in (scenario, arrival):
        run = Run(part)
        while run.robot.time < WARM_UP_S and run.step():
            pass
        run.metrics()


def run_scenario(
    scenario: Scenario,
    *,
    record: bool = True,
    scans: bool = True,
    spool: Path | None = None,
    timings: bool = False,
    progress: Progress | None = None,
    listeners: Sequence[Listener] = (),
    stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Drives the simulated robot to each goal in order; continues with the next goal when one fails.

    `record=False` computes the same metrics without keeping a record, for large numbers of runs; `scans=False` keeps no
    scans in it; `spool` is the folder in which it grows instead of in memory. `timings` adds the wall times of both planners.
    `stop` is called before every cycle; when it returns True, the goal is canceled and the run ends with a complete record.

    Raises InputError or PlanningError if the robot cannot start.
    """
    wall_start = working_time()
    run = Run(scenario, record=record, scans=scans, spool=spool, timings=timings, listeners=listeners)
    while True:
        if stop is not None and stop():
            run.stop()
            break
        if not run.step():
            break
        if progress is not None:
            progress(run.robot.time, run.goal_index)
    return run.result(working_time() - wall_start)

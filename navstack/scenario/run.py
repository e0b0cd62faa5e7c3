"""Drives the simulated robot through a scenario. The same scenario always gives the same record."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from navstack.bringup import build_move_base, odometry_frame, simulated_robot, true_footprint
from navstack.core import LaserScan, Listener, Transform2D, angle_between, normalize_angle
from navstack.core.errors import InternalError
from navstack.move_base import GoalHandle, MoveBase
from navstack.record import RunRecorder
from navstack.record.metrics import RunMetrics
from navstack.record.timings import Timings, timed
from navstack.scenario.measurements import RunMeasurements
from navstack.scenario.outcome import GoalOutcome, RunResult
from navstack.scenario.scenario import Scenario
from navstack.scenario.success import SuccessConditions
from navstack.scenario.warnings import WarningCollector
from navstack.sim import SimulatedRobot

WARM_UP_S = 1.0
"""Simulated seconds of a warm-up run: enough for every stage of driving and of arriving to run once."""

MAX_IDLE_CYCLES = 1000
"""Maximum number of consecutive cycles without simulated time passing; a few occur when goals end and begin."""

Progress = Callable[[float, int], None]
"""Called after each cycle with the simulated time (s) and the index of the current goal."""


class Run:
    """Drives a scenario one control cycle at a time; continues with the next goal when one fails.

    Raises InputError or PlanningError if the robot cannot start.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        record: bool = True,
        scans: bool = True,
        timings: bool = False,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`record=False` keeps only what the metrics need, `scans=False` all but the scans; `timings` measures the wall time
        of both planners.
        """
        configuration = scenario.configuration
        scenario.success.check_goals(len(scenario.goals))
        self.scenario = scenario
        self.robot = simulated_robot(configuration, scenario.world(), scenario.start, seed=scenario.seed)
        self._measurements = RunMeasurements(self.robot)
        self.recorder = self._new_recorder(scans) if record else None
        self._warnings = WarningCollector()
        listening = [self._warnings, *listeners]
        if self.recorder is not None:
            listening.insert(0, self.recorder)
        self.move_base = build_move_base(configuration, self.robot, static_map=scenario.map, listeners=listening)
        self.timings: Timings | None = None
        if timings:
            self.timings = Timings()
            self._time_planners(self.timings)
        self.goal_index = -1
        """Index of the current goal, -1 before the first step."""
        self.outcomes: list[GoalOutcome] = []
        self._idle_cycles = 0
        self.done = False
        """True when every goal has ended."""
        self._handle: GoalHandle | None = None
        self._goal_start_time, self._goal_start_length = 0.0, 0.0
        self._pause_until = 0.0
        # times are sums of floats: a difference below this is rounding and must not cause an extra physics step
        self._time_tolerance = 1e-5 / configuration.navstack.sim.physics_frequency

    def step(self) -> bool:
        """Runs one control cycle: advances the world to its time, then ticks move_base. Returns False when done."""
        self._finish_goal()
        robot, move_base = self.robot, self.move_base
        due = math.inf
        if self._handle is None:
            if robot.time < self._pause_until - self._time_tolerance:
                due = self._pause_until
            elif not self._send_next_goal():
                return False
        before = robot.time
        robot.advance_to(min(due, move_base.next_due(before)))
        move_base.tick(robot.time)
        self._idle_cycles = self._idle_cycles + 1 if robot.time == before else 0
        if self._idle_cycles > MAX_IDLE_CYCLES:
            raise InternalError(
                f"the run does not advance beyond {robot.time:.3f} s: {MAX_IDLE_CYCLES} consecutive cycles took no "
                "simulated time; this is a bug in navstack, please report it with the scenario",
                time=robot.time,
            )
        self._measurements.add(move_base.state.name)
        if self.recorder is not None:
            _record_tick(self.recorder, robot, move_base, self.goal_index)
        if self._handle is not None and robot.time - self._goal_start_time > self.scenario.time_limit_s:
            move_base.cancel_goal(self._handle)
        return True

    @property
    def is_paused(self) -> bool:
        """True between two goals."""
        return self._handle is None and not self.done

    def stop(self) -> None:
        """Ends the run: cancels the current goal, stops the robot and finishes the record."""
        handle = self._handle
        if handle is not None:
            self.move_base.cancel_goal(handle)
            while not handle.is_done:
                self.step()
        self._finish_goal()
        self._finish()

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
            conditions=self.scenario.success.evaluate(states, metrics, len(self.scenario.goals)),
            timings=self.timings,
            min_clearance_m=self._measurements.min_clearance(),
            warnings=self._warnings.warnings(),
        )

    def metrics(self) -> RunMetrics:
        """Returns the metrics so far; they count only the goals that have ended."""
        return self._measurements.metrics([outcome.as_dict() for outcome in self.outcomes])

    def _new_recorder(self, scans: bool) -> RunRecorder:
        scenario, configuration = self.scenario, self.scenario.configuration
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
            keep_scans=scans,
        )
        recorder.set_clearance_source(self._measurements.clearances)
        solids = self.robot.solids
        if not self.robot.world.moves and scenario.shapes:
            recorder.solids(solids.discs, solids.corners, solids.first)
        return recorder

    def _time_planners(self, timings: Timings) -> None:
        planner, controller = self.move_base.global_planner, self.move_base.local_planner
        planner.make_plan = timed(planner.make_plan, timings.planning_s)
        controller.compute_command = timed(controller.compute_command, timings.control_s)

    def _send_next_goal(self) -> bool:
        """Sends the next goal; returns False if there is none."""
        if self.goal_index + 1 == len(self.scenario.goals):
            self._finish()
        if self.done:
            return False
        self.goal_index += 1
        goal = self.scenario.goals[self.goal_index]
        self._goal_start_time, self._goal_start_length = self.robot.time, self._measurements.path_length
        self._handle = self.move_base.send_goal(goal)
        if self.recorder is not None:
            self.recorder.goal(self._goal_start_time, goal)
        return True

    def _finish_goal(self) -> None:
        """If the current goal has ended, stores its outcome and starts the pause."""
        handle = self._handle
        if handle is None or not handle.is_done:
            return
        outcome = self._outcome(handle)
        self.outcomes.append(outcome)
        self._handle = None
        last = self.goal_index + 1 == len(self.scenario.goals)
        if last or (self.scenario.stop_on_failure and not outcome.succeeded):
            self._finish()
        else:
            self._pause_until = self.robot.time + self.scenario.pause_s

    def _finish(self) -> None:
        if not self.done:
            self.done = True
            if self.recorder is not None:
                self.recorder.finish([outcome.as_dict() for outcome in self.outcomes], self.robot.collisions)

    def _outcome(self, handle: GoalHandle) -> GoalOutcome:
        robot, goal, result = self.robot, self.scenario.goals[self.goal_index], handle.result
        return GoalOutcome(
            goal=goal,
            state=handle.status.name,
            text=handle.text,
            error_code=result.error_code,
            error_name=result.error_name,
            message=result.message,
            time_s=robot.time - self._goal_start_time,
            path_length_m=self._measurements.path_length - self._goal_start_length,
            distance_left_m=robot.pose.distance_to(goal),
            yaw_left_rad=abs(angle_between(robot.pose.yaw, goal.yaw)),
            recoveries=result.recoveries,
        )


def _record_tick(recorder: RunRecorder, robot: SimulatedRobot, move_base: MoveBase, goal: int) -> None:
    """Adds what the last tick did to the record."""
    tick = move_base.last_tick
    t = tick.time
    for name, costmap, window in (
        ("global", move_base.global_costmap, tick.global_window),
        ("local", move_base.local_costmap, tick.local_window),
    ):
        if window is not None:
            recorder.costmap(t, name, costmap.master, window)
    if tick.plan is not None:
        recorder.plan(t, tick.plan.path.poses, tick.plan.path.frame)
    if tick.local_plan is not None:
        recorder.local_plan(t, tick.local_plan)
    if robot.world.moves:
        recorder.solids(robot.solids.discs, robot.solids.corners, robot.solids.first)
    for scan in tick.scans:
        if isinstance(scan, LaserScan):
            recorder.scan(scan.stamp, scan)
    recorder.sample(
        t,
        pose=robot.pose,
        odom=robot.state(),
        map_to_odom=robot.frames.lookup(robot.map_frame, robot.odom_frame),
        command=move_base.command,
        state=move_base.state.name,
        goal_index=goal,
    )


def warm_up(scenario: Scenario) -> None:
    """Compiles and loads the kernels by driving the first second of the scenario, and an arrival, and discarding both.

    Raises the errors of `run_scenario`.
    """
    turned = scenario.start._replace(yaw=normalize_angle(scenario.start.yaw + 1.0))
    arrival = replace(scenario, goals=(turned,), success=SuccessConditions())
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
    timings: bool = False,
    progress: Progress | None = None,
    listeners: Sequence[Listener] = (),
    stop: Callable[[], bool] | None = None,
) -> RunResult:
    """Drives the simulated robot to each goal in order; continues with the next goal when one fails.

    `record=False` computes the same metrics without keeping a record, for large numbers of runs; `scans=False` keeps no
    scans in it. `timings` adds the wall
    times of both planners. `stop` is called before every cycle; when it returns True, the goal is cancelled and the run ends
    with a complete record.

    Raises InputError or PlanningError if the robot cannot start.
    """
    wall_start = time.perf_counter()
    run = Run(scenario, record=record, scans=scans, timings=timings, listeners=listeners)
    while True:
        if stop is not None and stop():
            run.stop()
            break
        if not run.step():
            break
        if progress is not None:
            progress(run.robot.time, run.goal_index)
    return run.result(time.perf_counter() - wall_start)

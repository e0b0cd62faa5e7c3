"""A scenario: map, parameters, start, goals, obstacles, seed. Running one gives the same record every time."""

from __future__ import annotations

import math
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from navstack import __version__
from navstack.bringup import build_move_base, odometry_frame, simulated_robot, true_footprint
from navstack.core import Listener, OccupancyGrid, Pose2D, angle_between, normalize_angle
from navstack.core.errors import InternalError, RecordError
from navstack.move_base import GoalHandle, MoveBase
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.record import Record, RunRecorder
from navstack.record.metrics import RunMetrics, compute_metrics
from navstack.record.timings import Timings, timed
from navstack.scenario.success import ConditionResult, SuccessConditions
from navstack.sim import Shape, SimulatedRobot, World

WARM_UP_S = 1.0
"""Simulated seconds after which every stage of driving, or of arriving, has had its turn."""

MAX_STANDSTILLS = 1000
"""Cycles in a row that may take no simulated time: a few follow one another when goals end and begin."""

Progress = Callable[[float, int], None]
"""Called now and then with the simulated time (s) and the index of the present goal."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """What a run is made from. Poses in the map frame, obstacles as (x, y, radius), metres and radians.

    It can be pickled (about 50 kB and the map's cells). Another seed or other parameters are one
    `dataclasses.replace(scenario, seed=7)` away.
    """

    map: OccupancyGrid
    configuration: Configuration
    start: Pose2D
    goals: tuple[Pose2D, ...]
    obstacles: tuple[tuple[float, float, float], ...] = ()
    seed: int = 0
    time_limit_s: float = 600.0
    """Simulated seconds a goal may take; then it is cancelled."""
    rest_s: float = 0.0
    """Simulated seconds that the robot stands between two goals."""
    stop_on_failure: bool = False
    """The goals that follow one that did not SUCCEED are left out."""
    shapes: tuple[Shape, ...] = ()
    """Whatever else stands or moves there: low things, boxes, walls, doors, people, discs on tracks."""
    success: SuccessConditions = SuccessConditions()
    """What the run is held to; it changes nothing in how it goes."""
    name: str = ""
    names: dict[str, Any] = field(default_factory=dict[str, Any])
    """Where map and parameters came from, for the record."""

    def world(self) -> World:
        """The map with everything that stands and moves in it."""
        return World(self.map, self.obstacles, shapes=self.shapes)

    def described(self) -> dict[str, Any]:
        """The scenario as the record keeps it (JSON): with the map, all that `from_record` needs to make it again."""
        return {
            **self.names,
            "ros_distro": self.configuration.navstack.ros_distro,
            "start": list(self.start),
            "goals": [list(goal) for goal in self.goals],
            "obstacles": [list(obstacle) for obstacle in self.obstacles],
            "seed": self.seed,
            "time_limit_s": self.time_limit_s,
            "rest_s": self.rest_s,
            "stop_on_failure": self.stop_on_failure,
            **self._described_extras(),
            "navstack": __version__,
            "parameters": _spelled(self.configuration.tree.as_dict()),
        }

    def _described_extras(self) -> dict[str, Any]:
        """What most runs do without, and then leave out of their records."""
        extras: dict[str, Any] = {}
        if self.name:
            extras["name"] = self.name
        if self.shapes:
            extras["shapes"] = [shape.model_dump(mode="json", exclude_none=True) for shape in self.shapes]
        if self.success != SuccessConditions():
            extras["success"] = self.success.as_dict()
        return extras

    @classmethod
    def from_record(cls, record: Record) -> Scenario:
        """The scenario that a record was made from, its parameters as they were then.

        Raises RecordError for records that do not hold one, ParameterError for parameters that this version refuses.
        """
        told = record.scenario
        missing = [key for key in _NEEDED if key not in told]
        if record.map is None:
            missing.append("map")
        if missing or record.map is None:
            raise RecordError(
                f"{record.path or 'the record'} does not hold what it takes to run it again ({', '.join(missing)} "
                "missing): it was recorded by an older navstack or by hand; record the run again",
                missing=missing,
            )
        try:
            return cls(
                map=record.map,
                configuration=load_configuration([dict(_read_back(told["parameters"]))], distro=told["ros_distro"]),
                start=Pose2D(*told["start"]),
                goals=tuple(Pose2D(*goal) for goal in told["goals"]),
                obstacles=tuple((x, y, r) for x, y, r in told["obstacles"]),
                seed=told["seed"],
                time_limit_s=told["time_limit_s"],
                rest_s=told.get("rest_s", 0.0),
                stop_on_failure=told.get("stop_on_failure", False),
                shapes=tuple(Shape.model_validate(shape) for shape in told.get("shapes", ())),
                success=SuccessConditions.from_dict(told.get("success", {})),
                name=told.get("name", ""),
                names={key: value for key, value in told.items() if key not in (*_NEEDED, *_OPTIONAL)},
            )
        except (TypeError, ValueError) as exc:
            raise RecordError(
                f"the scenario of {record.path or 'the record'} is damaged ({exc}); record the run again"
            ) from exc


_NEEDED: Final = ("ros_distro", "start", "goals", "obstacles", "seed", "time_limit_s", "parameters")
_OPTIONAL: Final = ("rest_s", "stop_on_failure", "shapes", "success", "name", "navstack")
_NOT_FINITE: Final = {".inf": math.inf, "-.inf": -math.inf, ".nan": math.nan}


def _spelled(value: Any) -> Any:
    """Parameters for JSON, which has no infinity: spelled as YAML does."""
    if isinstance(value, dict):
        return {key: _spelled(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_spelled(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return ".nan" if math.isnan(value) else ".inf" if value > 0.0 else "-.inf"
    return value


def _read_back(value: Any) -> Any:
    """The inverse of `_spelled`."""
    if isinstance(value, dict):
        return {key: _read_back(v) for key, v in value.items()}
    if isinstance(value, list):
        return [_read_back(v) for v in value]
    return _NOT_FINITE.get(value, value) if isinstance(value, str) else value


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """How one goal ended."""

    goal: Pose2D
    state: str
    text: str
    error_code: int
    error_name: str
    message: str
    """The reason in a sentence, beyond C++'s text."""
    time_s: float
    path_length_m: float
    distance_left_m: float
    yaw_left_rad: float
    recoveries: int

    @property
    def succeeded(self) -> bool:
        """True when the robot stands at the goal."""
        return self.state == "SUCCEEDED"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "goal": list(self.goal),
            "state": self.state,
            "text": self.text,
            "error_code": self.error_code,
            "error_name": self.error_name,
            "message": self.message,
            "time_s": round(self.time_s, 6),
            "path_length_m": self.path_length_m,
            "distance_left_m": self.distance_left_m,
            "yaw_left_rad": self.yaw_left_rad,
            "recoveries": self.recoveries,
        }


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended. Only `wall_s` and `timings` differ from run to run; loading and warming up are not in them."""

    goals: tuple[GoalOutcome, ...]
    simulated_s: float
    wall_s: float
    collisions: int
    seed: int
    recorder: RunRecorder | None
    metrics: RunMetrics
    conditions: tuple[ConditionResult, ...]
    """Each of the scenario's conditions, and whether the run met it."""
    timings: Timings | None = None
    nearest_m: float = math.inf
    """Least distance between the true outline and an obstacle as measured at the control cycles, collisions or not."""

    @property
    def succeeded(self) -> bool:
        """True when every condition holds: unless the scenario says otherwise, all goals SUCCEEDED and nothing was touched."""
        return all(condition.holds for condition in self.conditions)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds over wall seconds."""
        return self.simulated_s / self.wall_s if self.wall_s > 0.0 else math.inf

    def as_dict(self) -> dict[str, Any]:
        """The document of `navstack simulate --json`, without its files."""
        timings = {} if self.timings is None else {"timings": self.timings.as_dict()}
        return {
            "success": self.succeeded,
            "conditions": [condition.as_dict() for condition in self.conditions],
            "goals": [goal.as_dict() for goal in self.goals],
            "metrics": self.metrics.as_dict(),
            **timings,
            "simulated_s": round(self.simulated_s, 6),
            "wall_s": self.wall_s,
            "real_time_factor": self.real_time_factor,
            "collisions": self.collisions,
            "seed": self.seed,
        }


def _take_down(recorder: RunRecorder, robot: SimulatedRobot, move_base: MoveBase, goal: int) -> None:
    """Puts what the last tick did into the record."""
    turn = move_base.last_tick
    t = turn.time
    for name, costmap, window in (
        ("global", move_base.global_costmap, turn.global_window),
        ("local", move_base.local_costmap, turn.local_window),
    ):
        if window is not None:
            recorder.costmap(t, name, costmap.master, window)
    if turn.plan is not None:
        recorder.plan(t, turn.plan.path.poses, turn.plan.path.frame)
    if turn.local_plan is not None:
        recorder.local_plan(t, turn.local_plan)
    if robot.world.moves:
        recorder.solids(robot.solids.discs, robot.solids.corners, robot.solids.first)
    recorder.sample(
        t,
        pose=robot.pose,
        odom=robot.state(),
        map_to_odom=robot.frames.lookup(robot.map_frame, robot.odom_frame),
        command=move_base.command,
        state=move_base.state.name,
        goal_index=goal,
    )


class _Meter:
    """Notes what the metrics are made from, a control cycle at a time.

    Clearances are measured when they are asked for, or when something has moved: many at once take less time.
    """

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._rows = array("d")
        self._states: list[str] = []
        self._clearances = array("d")
        self._solids = robot.solids
        """What stood there in the cycles whose clearance is not measured yet."""
        self._last = robot.pose
        self.length = 0.0
        """From each cycle's pose to the next, m: what slip makes the body jitter between them is no way."""

    def note(self, state: str) -> None:
        """The cycle that has just been."""
        robot = self._robot
        if robot.solids is not self._solids:
            self._measure()
            self._solids = robot.solids
        pose = robot.pose
        self.length += pose.distance_to(self._last)
        self._last = pose
        self._rows.extend((robot.time, *pose))
        self._states.append(state)

    def clearances(self) -> array[float]:
        """Of all cycles so far (m)."""
        self._measure()
        return self._clearances

    def nearest(self) -> float:
        """The least clearance of all cycles so far, m."""
        return min(self.clearances(), default=math.inf)

    def metrics(self, results: Sequence[Mapping[str, Any]]) -> RunMetrics:
        """Of the cycles so far."""
        rows = np.array(self._rows, np.float64).reshape(-1, 4)
        return compute_metrics(
            rows[:, 0],
            rows[:, 1:4],
            self._states,
            np.array(self.clearances(), np.float64),
            results=results,
            collisions=len(self._robot.collisions),
        )

    def _measure(self) -> None:
        first = len(self._clearances)
        if first < len(self._states):
            poses = np.array(self._rows[4 * first :], np.float64).reshape(-1, 4)[:, 1:].copy()
            self._clearances.extend(self._robot.clearances(poses, self._solids).tolist())


class Run:
    """A scenario being driven, a control cycle at a time; goes on to the next goal when one fails.

    Raises an InputError or PlanningError when the robot cannot stand at the start.
    """

    def __init__(
        self,
        scenario: Scenario,
        *,
        record: bool = True,
        timings: bool = False,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """`record=False` keeps what the metrics need and no more; `timings` takes the wall times of both planners."""
        configuration = scenario.configuration
        scenario.success.check_goals(len(scenario.goals))
        self.scenario = scenario
        self.robot = simulated_robot(configuration, scenario.world(), scenario.start, seed=scenario.seed)
        self._meter = _Meter(self.robot)
        self.recorder: RunRecorder | None = None
        if record:
            self.recorder = RunRecorder(
                map=scenario.map,
                footprint=true_footprint(configuration),
                scenario=scenario.described(),
                global_frame=configuration.global_costmap.params.global_frame,
                local_frame=odometry_frame(configuration),
                base_frame=configuration.local_costmap.params.robot_base_frame,
            )
            self.recorder.ask_clearances(self._meter.clearances)
            solids = self.robot.solids
            if not self.robot.world.moves and scenario.shapes:
                self.recorder.solids(solids.discs, solids.corners, solids.first)
        heard = [self.recorder, *listeners] if self.recorder is not None else list(listeners)
        self.move_base = build_move_base(configuration, self.robot, static_map=scenario.map, listeners=heard)
        self.timings: Timings | None = None
        if timings:
            self.timings = Timings()
            self._time_planners(self.timings)
        self.goal_index = -1
        """The goal being driven to, -1 before the first step."""
        self.outcomes: list[GoalOutcome] = []
        self._standstills = 0
        self.done = False
        """True when every goal has ended."""
        self._handle: GoalHandle | None = None
        self._begun, self._driven = 0.0, 0.0
        self._rest_until = 0.0
        # times are sums: what is nearer than this is not worth a step of the body, and must not wait for one
        self._moment = 1e-5 / configuration.navstack.sim.physics_frequency

    def step(self) -> bool:
        """One control cycle: the world goes on to its time, then the goal manager ticks. False: nothing is left to do."""
        self._close()
        robot, move_base = self.robot, self.move_base
        due = math.inf
        if self._handle is None:
            if robot.time < self._rest_until - self._moment:
                due = self._rest_until
            elif not self._set_out():
                return False
        before = robot.time
        robot.advance_to(min(due, move_base.next_due(before)))
        move_base.tick(robot.time)
        self._standstills = self._standstills + 1 if robot.time == before else 0
        if self._standstills > MAX_STANDSTILLS:
            raise InternalError(
                f"the run does not go on from {robot.time:.3f} s: {MAX_STANDSTILLS} cycles in a row took no time; that is "
                "a fault of navstack, please report it with the scenario",
                time=robot.time,
            )
        self._meter.note(move_base.state.name)
        if self.recorder is not None:
            _take_down(self.recorder, robot, move_base, self.goal_index)
        if self._handle is not None and robot.time - self._begun > self.scenario.time_limit_s:
            move_base.cancel_goal(self._handle)
        return True

    @property
    def is_resting(self) -> bool:
        """True between two goals."""
        return self._handle is None and not self.done

    def stop(self) -> None:
        """Ends the run where it is: the goal at hand is cancelled, the robot stopped, the record finished."""
        handle = self._handle
        if handle is not None:
            self.move_base.cancel_goal(handle)
            while not handle.is_done:
                self.step()
        self._close()
        self._finish()

    def result(self, wall_s: float) -> RunResult:
        """How the run went so far; `wall_s` as whoever drove it measured."""
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
            conditions=self.scenario.success.judge(states, metrics, len(self.scenario.goals)),
            timings=self.timings,
            nearest_m=self._meter.nearest(),
        )

    def metrics(self) -> RunMetrics:
        """The run in numbers, so far; goals that have not ended are not among its goals."""
        return self._meter.metrics([outcome.as_dict() for outcome in self.outcomes])

    def _time_planners(self, timings: Timings) -> None:
        planner, driver = self.move_base.global_planner, self.move_base.local_planner
        planner.make_plan = timed(planner.make_plan, timings.planning_s)
        driver.compute_command = timed(driver.compute_command, timings.control_s)

    def _close(self) -> None:
        """Takes down how the goal at hand ended, if it has; a rest begins."""
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
            self._rest_until = self.robot.time + self.scenario.rest_s

    def _finish(self) -> None:
        if not self.done:
            self.done = True
            if self.recorder is not None:
                self.recorder.finish([outcome.as_dict() for outcome in self.outcomes], self.robot.collisions)

    def _set_out(self) -> bool:
        """Sends the next goal; False when there is none."""
        if self.goal_index + 1 == len(self.scenario.goals):
            self._finish()
        if self.done:
            return False
        self.goal_index += 1
        goal = self.scenario.goals[self.goal_index]
        self._begun, self._driven = self.robot.time, self._meter.length
        self._handle = self.move_base.send_goal(goal)
        if self.recorder is not None:
            self.recorder.goal(self._begun, goal)
        return True

    def _outcome(self, handle: GoalHandle) -> GoalOutcome:
        robot, goal, result = self.robot, self.scenario.goals[self.goal_index], handle.result
        return GoalOutcome(
            goal=goal,
            state=handle.status.name,
            text=handle.text,
            error_code=result.error_code,
            error_name=result.error_name,
            message=result.message,
            time_s=robot.time - self._begun,
            path_length_m=self._meter.length - self._driven,
            distance_left_m=robot.pose.distance_to(goal),
            yaw_left_rad=abs(angle_between(robot.pose.yaw, goal.yaw)),
            recoveries=result.recoveries,
        )


def warm_up(scenario: Scenario) -> None:
    """Drives the first moments of a run, and an arrival, and forgets them, so that the kernels are compiled and loaded.

    The run itself is not touched: it starts anew. Raises what `run_scenario` raises.
    """
    turned = scenario.start._replace(yaw=normalize_angle(scenario.start.yaw + 1.0))
    arriving = replace(scenario, goals=(turned,), success=SuccessConditions())
    for part in (scenario, arriving):
        run = Run(part)
        while run.robot.time < WARM_UP_S and run.step():
            pass
        run.metrics()


def run_scenario(
    scenario: Scenario,
    *,
    record: bool = True,
    timings: bool = False,
    progress: Progress | None = None,
    listeners: Sequence[Listener] = (),
) -> RunResult:
    """Drives the simulated robot to every goal in turn; goes on to the next when one fails.

    For many runs, `record=False`: the metrics are the same, and nothing else is kept. `timings` adds the wall times of
    both planners.

    Raises an InputError or PlanningError when the robot cannot stand at the start.
    """
    wall_start = time.perf_counter()
    run = Run(scenario, record=record, timings=timings, listeners=listeners)
    while run.step():
        if progress is not None:
            progress(run.robot.time, run.goal_index)
    return run.result(time.perf_counter() - wall_start)

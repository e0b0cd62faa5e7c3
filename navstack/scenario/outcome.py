"""How a run and its goals ended."""

from __future__ import annotations

import math
from array import array
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Event, Pose2D
from navstack.parameters import Finding
from navstack.record import (
    PeopleTrack,
    RunMetrics,
    RunRecorder,
    SocialMetrics,
    Timings,
    compute_metrics,
    social_metrics,
)
from navstack.scenario.success import ConditionResult
from navstack.sim import Shape, SimulatedRobot


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A warning about sensors, transforms or odometry, which may have been repeated during the run."""

    text: str
    time: float
    """Time of the first occurrence (s)."""
    count: int
    """Number of occurrences."""

    def as_dict(self) -> dict[str, Any]:
        """Return JSON data."""
        return {"text": self.text, "time": self.time, "count": self.count}


class WarningCollector:
    """Listens for the warnings that an error caused. Repetitions by the same sensor share an entry with the first text."""

    hears_feedback = False
    kinds = frozenset({"warning"})

    def __init__(self) -> None:
        self._found: dict[tuple[object, ...], RunWarning] = {}

    def on_event(self, event: Event) -> None:
        """Keep a warning."""
        data = event.data
        if event.kind not in self.kinds or "code" not in data:
            return
        costmap = event.text.partition(":")[0]
        key = (costmap, data["topic"], data.get("source")) if "topic" in data else (event.text,)
        first = self._found.get(key)
        if first is None:
            self._found[key] = RunWarning(event.text, event.time, 1)
        else:
            self._found[key] = RunWarning(first.text, first.time, first.count + 1)

    def warnings(self) -> tuple[RunWarning, ...]:
        """Return the warnings in the order of their first occurrence."""
        return tuple(self._found.values())


EXPLAIN_FAILURES: Final = frozenset(
    {
        "scoring-scale",
        "yaw-tolerance",
        "tolerance-under-cell",
        "blind",
        "fixed-window",
        "turns-too-tight",
        "deadband-too-large",
        "cannot-start",
        "window-too-small",
        "inflation-under-radius",
        "steep-inflation",
        "sideways-command",
        "default-planner",
        "progress-out-of-reach",
        "nothing-feeds-monitor",
        "global-window",
        "slow-turn",
        "standing-sample",
        "coarse-speeds",
        "dated-names",
        "heavy-path",
        "default-footprint",
    }
)
"""Rules of `navstack check` whose warning explains robots that stop, turn in place or circle around their goal."""
_INFOS: Final = frozenset({"steep-inflation", "global-window", "standing-sample", "dated-names", "heavy-path"})
"""Those of them that are no warning: most maps have room enough, or most robots drive well with them."""
BACKWARD_M_S: Final = -0.01
"""A robot with a lower forward velocity drives backward; one that is slower both ways and turns, turns in place."""
TURNING_RAD_S: Final = 0.01
"""A robot with a higher yaw rate turns."""
MUCH_TURNING_S: Final = 15.0
MUCH_TURNING: Final = 0.25
"""A run that turns in place for longer than both, this time and this share of its time, has a cause worth searching."""


EXPLAIN_COLLISIONS: Final = frozenset(
    {
        "assumed-lidar",
        "nothing-feeds",
        "simulated-robot-blind",
        "blind",
        "clearing-only",
        "updates-too-slow",
        "stopping-time",
        "coarse-simulation",
        "footprint-ignored",
        "inflation-not-last",
        "no-obstacle-critic",
        "no-deceleration",
    }
)
"""Rules whose finding explains collisions: the robot sees other things than the real one, nothing, or too late, or takes its
outline for a disc."""
_SENSORS: Final = frozenset({"assumed-lidar", "nothing-feeds", "simulated-robot-blind", "blind", "clearing-only"})
"""Those of them that explain no collision with an obstacle that the local costmap had."""


@dataclass(frozen=True, slots=True)
class GoalOutcome:
    """How one goal ended."""

    goal: Pose2D
    state: str
    text: str
    error_code: int
    error_name: str
    message: str
    """The reason in one sentence; more specific than `text`, which is the text of the C++ stack."""
    time_s: float
    path_length_m: float
    distance_left_m: float
    yaw_left_rad: float
    recoveries: int
    step: str = ""
    """The motion, in words, if it was one: `move 0.5 m`. `goal` is then where it was to end."""
    figures: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """The motion's own figures at its end: distance driven, mean error, .."""

    @property
    def succeeded(self) -> bool:
        """True if the robot reached the goal, or the motion was completed."""
        return self.state == "SUCCEEDED"

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        step = {"step": self.step, "figures": dict(self.figures)} if self.step else {}
        return {
            **step,
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


def failure_advice(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return the findings that may explain runs that fail, with file and line."""
    return _findings_of(EXPLAIN_FAILURES, [f for f in findings if f.severity == "warning" or f.rule in _INFOS])


def collision_advice(findings: Sequence[Finding], *, seen: bool = False) -> tuple[str, ...]:
    """Return the findings that may explain contacts, with file and line; `seen`: with obstacles that the costmap had."""
    return _findings_of(EXPLAIN_COLLISIONS - _SENSORS if seen else EXPLAIN_COLLISIONS, findings)


def _backward_advice(count: int, collisions: int) -> str:
    return (
        f"the robot drove backward into the obstacle of {_which(count, collisions)}, which the local costmap did not have: its "
        "sensors do not see what is behind it; forbid the controller to drive backward (min_vel_x: 0), or describe a sensor "
        "that sees behind (navstack: sim:)"
    )


def _turning_advice(count: int, collisions: int) -> str:
    return (
        f"the robot turned in place into the obstacle of {_which(count, collisions)}, which the local costmap did not have: its "
        "sensors do not see what is beside and behind it; describe a sensor that does (navstack: sim:), or let the robot turn "
        "only where it has room (inflation_radius above its circumscribed radius, clearing_rotation_allowed: false)"
    )


def _which(count: int, collisions: int) -> str:
    return "the collision" if collisions == 1 else f"{count} of {collisions} collisions"


def advice_for(
    metrics: RunMetrics,
    findings: Sequence[Finding],
    collisions: int = 0,
    marked: Sequence[float] = (),
    backward: Sequence[float] = (),
    turning: Sequence[float] = (),
) -> tuple[str, ...]:
    """Return what may explain a run that missed goals, collided, or turned in place for long; none for other runs.

    These are findings about the parameters, with file and line, and the time spent turning. Motions turn on purpose, and so do
    recovery behaviors: their time is subtracted. `marked`: times (s) of the collisions with obstacles that the local costmap had;
    no sensor is their cause. `backward` and `turning`: times (s) of the collisions into which the robot drove backward, and
    turned in place.
    """
    turned = metrics.turning_s - metrics.state_s.get("CLEARING", 0.0)
    turns_long = turned > max(MUCH_TURNING_S, MUCH_TURNING * metrics.time_s) and "MOTION" not in metrics.state_s
    advice = list(collision_advice(findings, seen=len(marked) == collisions)) if collisions else []
    if marked and not collision_advice(findings, seen=True):
        advice.append(
            f"the local costmap had the obstacle of {_which(len(marked), collisions)}, so no sensor is the cause: the base does "
            "not drive what the controller checks; navstack explain command RUN --time "
            f"{max(0.0, marked[0] - 0.5):.1f} shows the command before it"
        )
    for times, words in ((backward, _backward_advice), (turning, _turning_advice)):
        unseen = [t for t in times if t not in marked]
        if unseen:
            advice.append(words(len(unseen), collisions))
    if metrics.succeeded < metrics.goals or turns_long:
        advice += failure_advice(findings)
    if turns_long:
        advice.append(
            f"the robot turned in place for {turned:.0f} s of {metrics.time_s:.0f} s; navstack doctor tries the fixes of the "
            "usual causes and measures their effect"
        )
    return tuple(dict.fromkeys(advice))


def _findings_of(rules: Collection[str], findings: Sequence[Finding]) -> tuple[str, ...]:
    return tuple(f"{f.location}: {f.message}" if f.line else f.message for f in findings if f.rule in rules)


@dataclass(frozen=True, slots=True, repr=False)
class RunResult:
    """How a run ended. Only `wall_s` and `timings` vary between repetitions; both exclude loading and warm-up."""

    goals: tuple[GoalOutcome, ...]
    simulated_s: float
    wall_s: float
    collisions: int
    seed: int
    recorder: RunRecorder | None
    metrics: RunMetrics
    conditions: tuple[ConditionResult, ...]
    """The result of each success condition of the scenario."""
    timings: Timings | None = None
    min_clearance_m: float = math.inf
    """Minimum distance between the unpadded footprint and an obstacle, measured at the control cycles."""
    warnings: tuple[RunWarning, ...] = ()
    """Warnings about sensors, transforms and odometry."""
    advice: tuple[str, ...] = ()
    """What may explain missed goals or long turns in place, with what to try; empty for other runs."""

    def __str__(self) -> str:
        reached = sum(goal.succeeded for goal in self.goals)
        count = "1 collision" if self.collisions == 1 else f"{self.collisions} collisions"
        return f"{reached}/{len(self.goals)} goals, {self.simulated_s:.1f} s, {self.metrics.length_m:.1f} m, {count}"

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self}>"

    @property
    def succeeded(self) -> bool:
        """True if every condition is met: by default, all goals SUCCEEDED without a collision."""
        return all(condition.holds for condition in self.conditions)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per wall second."""
        return self.simulated_s / self.wall_s if self.wall_s > 0.0 else math.inf

    def as_dict(self) -> dict[str, Any]:
        """Returns the document of `navstack simulate --json`, without the file names."""
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
            "warnings": [warning.as_dict() for warning in self.warnings],
            "advice": list(self.advice),
        }


class _PeopleSamples:
    """The positions of the people at the control cycles. People may be added and removed by interactions."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._persons: list[Shape] = []
        self._columns: list[int] = []
        self._listed: object = None
        self._samples: list[tuple[list[int], NDArray[np.float64]]] = []
        self._track: tuple[int, PeopleTrack] | None = None

    @property
    def any(self) -> bool:
        """True if there are people now."""
        return bool(self._robot.world.persons)

    def add(self) -> None:
        """Records the current cycle."""
        persons = self._robot.world.persons
        if self._listed is not persons:
            self._listed = persons
            self._persons += [person for person in persons if person not in self._persons]
            self._columns = [self._persons.index(person) for person in persons]
        self._samples.append((self._columns, self._robot.people.copy() if persons else _NOBODY))

    def track(self) -> PeopleTrack | None:
        """Returns the positions so far, None if there was nobody."""
        if not self._persons:
            return None
        count = len(self._samples)
        if self._track is None or self._track[0] != count:
            positions = np.full((count, len(self._persons), 2), math.nan)
            for row, (columns, found) in zip(positions, self._samples, strict=True):
                row[columns] = found
            groups, walks = np.full(len(self._persons), -1, np.int32), np.full((len(self._persons), 3), math.nan)
            groups[self._columns], walks[self._columns] = self._robot.groups, self._robot.walks()
            radii = np.array([person.radius for person in self._persons], np.float64)
            self._track = count, PeopleTrack(positions, radii, groups, walks)
        return self._track[1]


_NOBODY: Final = np.empty((0, 2))


class RunMeasurements:
    """Collects pose, state and clearance at each control cycle.

    Clearances are computed on request, or when an obstacle has moved: one call for many poses is faster.
    """

    def __init__(self, robot: SimulatedRobot, *, keep: bool = True) -> None:
        """`keep=False` measures the path length only."""
        self._keep = keep
        self._robot = robot
        self._rows = array("d")
        self._states: list[str] = []
        self._clearances = array("d")
        self._solids = robot.solids
        """The obstacles during the cycles whose clearance has not been computed yet."""
        self._last_pose = robot.pose
        self._people = _PeopleSamples(robot)
        self._goal_numbers = array("q")
        self._targets: list[Pose2D] = []
        self._plans: dict[int, NDArray[np.float64]] = {}
        """The first plan of each goal of a run among people."""
        self.path_length = 0.0
        """Sum of the distances between consecutive cycles' poses (m); excludes slip within a cycle."""

    def note_goal(self, pose: Pose2D) -> None:
        """Records a goal, in the order of their numbers."""
        self._targets.append(pose)

    def note_plan(self, goal: int, poses: NDArray[np.float64]) -> None:
        """Records the plan (n, 3) for goal number `goal`."""
        if self._keep and self._people.any:
            self._plans.setdefault(goal, poses.copy())

    def add(self, state: str, goal: int = -1) -> None:
        """Records the current cycle, on the way to goal number `goal`."""
        robot = self._robot
        pose = robot.pose
        self.path_length += pose.distance_to(self._last_pose)
        self._last_pose = pose
        if not self._keep:
            return
        if robot.solids is not self._solids:
            self._compute_clearances()
            self._solids = robot.solids
        self._rows.extend((robot.time, *pose))
        self._states.append(state)
        self._goal_numbers.append(goal)
        self._people.add()

    def clearances(self) -> array[float]:
        """Returns the clearance at each cycle (m)."""
        self._compute_clearances()
        return self._clearances

    def min_clearance(self) -> float:
        """Returns the minimum clearance over all cycles (m)."""
        return min(self.clearances(), default=math.inf)

    def track(self) -> NDArray[np.float64]:
        """Returns (n, 4) time (s) and true pose (m, m, rad) at each cycle."""
        return np.array(self._rows, np.float64).reshape(-1, 4)

    def metrics(self, results: Sequence[Mapping[str, Any]]) -> RunMetrics:
        """Computes the metrics of the cycles so far; `results` are those of the goals."""
        rows = self.track()
        return compute_metrics(
            rows[:, 0],
            rows[:, 1:4],
            self._states,
            np.array(self.clearances(), np.float64),
            results=results,
            collisions=len(self._robot.collisions),
            social=self._social_metrics(rows, results),
        )

    def people(self) -> PeopleTrack | None:
        """Returns where the people were at each cycle; None if there were none."""
        return self._people.track()

    def _social_metrics(self, rows: NDArray[np.float64], results: Sequence[Mapping[str, Any]]) -> SocialMetrics | None:
        people = self.people()
        if people is None or not len(rows):
            return None
        goals = np.array([*self._targets, (math.nan,) * 3], np.float64).reshape(-1, 3)
        return social_metrics(
            rows[:, 0],
            rows[:, 1:4],
            people,
            footprint=self._robot.footprint,
            collisions=np.array([(c.time, *c.pose) for c in self._robot.collisions], np.float64).reshape(-1, 4),
            targets=goals[np.array(self._goal_numbers, np.int64), :2],
            plans=self._plans,
            results=results,
        )

    def _compute_clearances(self) -> None:
        first = len(self._clearances)
        if first < len(self._states):
            poses = np.array(self._rows[4 * first :], np.float64).reshape(-1, 4)[:, 1:].copy()
            self._clearances.extend(self._robot.clearances(poses, self._solids).tolist())

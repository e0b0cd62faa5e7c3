"""Evaluation of candidates: on scenarios, BARN worlds, or drives to localize along.

A run is a pure function of candidate, case and seed.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections import OrderedDict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple

import numpy as np

from navstack.core import InternalError, LogError, NavError, OccupancyGrid, ParameterError, Pose2D, Transform2D
from navstack.localization import Amcl, LoggedScan, Track, follow
from navstack.logs import RunScanLog, ScanLog, logged_scans, map_from_frames, open_scan_log
from navstack.move_base import GoalTimeLimitError
from navstack.parameters import AmclParams, Configuration, Source, load_configuration
from navstack.record import RunRecorder
from navstack.scenario import BarnWorld, Run, RunResult, Scenario
from navstack.studies.barn import run_world
from navstack.studies.comparison import Case
from navstack.studies.jobs import Executor, Job, JobResult

FAILED_SCORE: Final = -1.0
"""Score of a run that missed a goal or collided."""


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """How a run ended."""

    success: bool
    """Every goal reached, without a collision."""
    outcome: str
    """success, collision, timeout, the terminal state of a goal, or `refused` for invalid parameters."""
    score: float
    """By the rule of the evaluation; higher is better."""
    time_s: float
    """Simulated time: of all goals, or since a BARN robot has moved 0.1 m."""
    length_m: float
    """Distance driven."""
    clearance_m: float
    """Smallest distance between the footprint and any obstacle, at the control cycles; 0 without obstacles."""
    jerk: float
    """Root mean square of the jerk (m/s³)."""
    recoveries: int
    """Number of recovery behaviors run."""
    text: str = ""
    """Why the run failed; empty on success."""
    error_m: float = 0.0
    """Root mean square of the distance from the true pose, of a localizer; 0 for other runs."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON, rounded."""
        document = {
            "success": self.success,
            "outcome": self.outcome,
            "score": round(self.score, 6),
            "time_s": round(self.time_s, 4),
            "length_m": round(self.length_m, 4),
            "clearance_m": round(self.clearance_m, 4),
            "jerk": round(self.jerk, 4),
            "recoveries": self.recoveries,
            "text": self.text,
        }
        return {**document, "error_m": round(self.error_m, 6)} if self.error_m else document


class Evaluation(ABC):
    """A list of cases and how to drive them. Pickled with all it needs, for other processes and machines."""

    failed_score: ClassVar[float]
    """Score of a failed run."""
    best_score: ClassVar[float]
    """Upper bound of the score."""

    def __init__(self, name: str, cases: Sequence[Case]) -> None:
        self.name = name
        self.cases = tuple(cases)

    def overlays(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """Parameters of a case that override those of the robot."""
        del case
        return ()

    @abstractmethod
    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drive once. The recorder is None without `record`. Raises NavError if the run cannot start."""

    def outcome(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drive once; a run that cannot start is an outcome too."""
        try:
            return self.drive(case, configuration, record=record)
        except NavError as error:
            return self.refused(error.name.lower(), error.message), None

    def refused(self, outcome: str, text: str) -> RunOutcome:
        """Return the outcome of a run that was not driven."""
        return RunOutcome(False, outcome, self.failed_score, 0.0, 0.0, 0.0, 0.0, 0, text)


@dataclass(frozen=True, slots=True)
class NamedScenario:
    """A scenario of an evaluation. The parameters of the candidate replace its own."""

    name: str
    scenario: Scenario
    reference_s: float
    """Time along the straight line at full speed: the time that gives a score of 1."""
    overlays: tuple[Mapping[str, Any], ...] = ()
    """Parameters of the scenario (`set:` and `sim:`) that override those of the robot."""


class ScenarioEvaluation(Evaluation):
    """Scenarios; the score of a run is the reference time over the time taken, at most 1, or -1 without success."""

    failed_score = FAILED_SCORE
    best_score = 1.0

    def __init__(self, name: str, scenarios: Sequence[NamedScenario], seeds: Sequence[int]) -> None:
        self._scenarios = {s.name: s for s in scenarios}
        super().__init__(name, [Case(s.name, seed) for seed in seeds for s in scenarios])

    def overlays(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """Return the scenario's own."""
        return self._scenarios[case.name].overlays

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drive until all goals are done; stops at the first missed goal and at a collision that the scenario forbids."""
        named = self._scenarios[case.name]
        scenario = replace(named.scenario, configuration=configuration, seed=case.seed, stop_on_failure=True)
        allowed = scenario.success.max_collisions
        run = Run(scenario, record=record)
        while run.step():
            if allowed is not None and len(run.robot.collisions) > allowed:
                run.stop()
                break
        return _outcome_of(run.result(0.0), named.reference_s, allowed), run.recorder


def _outcome_of(result: RunResult, reference_s: float, allowed_collisions: int | None) -> RunOutcome:
    metrics, goals = result.metrics, result.goals
    failed = next((c for c in result.conditions if not c.holds), None)
    time_s = math.fsum(g.time_s for g in goals)
    ended, text = "success", ""
    if failed is not None:
        ended = failed.condition
        text = goals[-1].message if goals and goals[-1].message else failed.text
        if allowed_collisions is not None and metrics.collisions > allowed_collisions:
            ended = "collision"
        elif failed.condition == "goals":
            expired = not goals or goals[-1].error_name == GoalTimeLimitError.name
            ended = "timeout" if expired else goals[-1].state.lower()
    return RunOutcome(
        success=failed is None,
        outcome=ended,
        score=min(1.0, reference_s / max(time_s, 1e-9)) if failed is None else FAILED_SCORE,
        time_s=time_s,
        length_m=metrics.length_m,
        clearance_m=metrics.clearance_min_m if math.isfinite(metrics.clearance_min_m) else 0.0,
        jerk=metrics.jerk_rms_m_s3,
        recoveries=metrics.recoveries,
        text=text,
    )


class BarnEvaluation(Evaluation):
    """BARN worlds, scored by the rule of BARN: 0 without success, at most 0.5."""

    failed_score = 0.0
    best_score = 0.5

    def __init__(self, worlds: Sequence[BarnWorld], seeds: Sequence[int]) -> None:
        self._worlds = {f"world {w.number}": w for w in worlds}
        super().__init__("barn", [Case(name, seed) for seed in seeds for name in self._worlds])

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drive as `navstack.studies.barn` does."""
        o, recorder = run_world(self._worlds[case.name], configuration, seed=case.seed, record=record)
        outcome = RunOutcome(
            success=o.succeeded,
            outcome=o.outcome,
            score=o.score,
            time_s=o.time_s,
            length_m=o.length_m,
            clearance_m=o.clearance_m if math.isfinite(o.clearance_m) else 0.0,
            jerk=o.jerk_rms_m_s3,
            recoveries=o.recoveries,
            text=o.text,
        )
        return outcome, recorder


# --- a run as a job ---------------------------------------------------------------------------------------------------


Outcome = dict[str, Any]
"""`RunOutcome.as_dict()`."""

_CACHED: Final = 32
"""Number of configurations that a worker caches: enough for the active candidates."""


class RunInput(NamedTuple):
    """The input of a job."""

    overrides: tuple[str, ...]
    """The candidate, as `load_configuration` takes it."""
    case: Case


class RunWork:
    """Drives candidates over the cases of an evaluation.

    Pickled with all it needs, the user's files included. Results depend on the input only; configurations are cached.
    """

    def __init__(self, base: Configuration, evaluation: Evaluation) -> None:
        self.parameters: dict[str, Any] = base.tree.as_dict()
        self.distro = base.navstack.ros_distro
        self.evaluation = evaluation
        self._cache: OrderedDict[str, Configuration | ParameterError] = OrderedDict()

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_cache": OrderedDict()}

    def configuration(self, overrides: tuple[str, ...], overlays: tuple[Mapping[str, Any], ...] = ()) -> Configuration:
        """Return the parameters of a candidate below the `overlays`. Raises ParameterError for invalid ones."""
        key = repr((overrides, overlays))
        made = self._cache.get(key)
        if made is None:
            try:
                made = load_configuration([self.parameters, *overlays], overrides=overrides, distro=self.distro)
            except ParameterError as error:
                made = error
            self._cache[key] = made
            while len(self._cache) > _CACHED:
                self._cache.popitem(last=False)
        if isinstance(made, ParameterError):
            raise made
        return made

    def drive(self, job_input: RunInput, *, record: bool = False) -> tuple[RunOutcome, RunRecorder | None]:
        """Drive once. Invalid parameters give the outcome `refused`."""
        try:
            configuration = self.configuration(job_input.overrides, self.evaluation.overlays(job_input.case))
        except ParameterError as error:
            return self.evaluation.refused("refused", error.message), None
        return self.evaluation.outcome(job_input.case, configuration, record=record)

    def __call__(self, job_input: RunInput) -> Outcome:
        """The outcome, for JSON."""
        return self.drive(job_input)[0].as_dict()


def run_job(candidate_key: str, overrides: tuple[str, ...], case: Case) -> Job:
    """Return the job of a run."""
    return Job(f"{candidate_key}, {case.key}", RunInput(overrides, case))


def outcome_of(result: JobResult) -> Outcome:
    """Return the outcome of a `RunWork` job. Raises InternalError for a run that raised an exception."""
    if result.error is None:
        return result.value
    data = {key: value for key, value in result.error.items() if key != "message"}
    reason = result.error.get("message", "no reason given")
    raise InternalError(f"{result.key}: this run could not be driven: {reason}", **data)


def evaluate(
    executor: Executor,
    name: str,
    overrides: tuple[str, ...],
    cases: Sequence[Case],
    *,
    hopeless: Callable[[Sequence[Outcome]], bool] = lambda outcomes: False,
) -> dict[str, Outcome]:
    """Drive one candidate over the cases; the outcomes by the key of the case, in the order of the cases.

    Starts no further run once `hopeless` is true for the finished ones; then some outcomes are missing. Raises
    InternalError.
    """
    jobs = [(run_job(name, overrides, case), case) for case in cases]
    keys = {job.key: case.key for job, case in jobs}
    waiting = deque(job for job, _ in jobs)
    found: dict[str, Outcome] = {}
    running = 0
    while waiting or running:
        while waiting and running < executor.slots:
            executor.submit(waiting.popleft())
            running += 1
        result = executor.collect()
        running -= 1
        found[keys[result.key]] = outcome_of(result)
        if waiting and hopeless(list(found.values())):
            waiting.clear()
    return {case.key: found[case.key] for case in cases if case.key in found}


# --- localization along drives ----------------------------------------------------------------------------------------


HELD_M: Final = 0.5
"""A pose is held while it is less than this off (m)."""
HELD_SHARE: Final = 0.95
"""A drive succeeds if the pose is held at this share of its scans, and at the last one."""
START_ERROR: Final = (0.15, 0.15, 0.1)
"""Standard deviations of the error of the first pose (m, m, rad)."""
MOST_PARTS: Final = 16
"""Parts of a log that are cases of their own; half of them are held out."""
PART_SCANS: Final = 8
"""A part has at least this many scans."""
LEAST_PARTS: Final = 4
ENVIRONMENT: Final[Source] = {
    "amcl": {},
    "navstack": {
        "sim": {"localization": "truth", "odometry_turn": 0.03, "odometry_noise": 0.02, "wheel_slip": 0.02},
    },
}
"""Of simulated drives: the robot drives on true poses, with odometry that drifts."""


@dataclass(frozen=True, slots=True)
class LogPart:
    """A part of a log: scans `first` to `last` of those that are localized."""

    name: str
    path: Path
    first: int
    last: int


def parts_of_log(path: Path) -> tuple[LogPart, ...]:
    """Return the parts of a log. Raises LogError for a log without reference poses."""
    frames, _ = _log_frames(path)
    known = sum(frame.reference is not None for frame in frames)
    count = min(MOST_PARTS, known // PART_SCANS)
    if count < LEAST_PARTS:
        raise LogError(f"{path} has {known} scans with a reference pose; tuning needs {LEAST_PARTS * PART_SCANS}")
    ends = np.round(np.linspace(0, len(frames), count + 1)).astype(int).tolist()
    return tuple(LogPart(f"part {i + 1}", path, ends[i], ends[i + 1]) for i in range(count))


@cache
def _log_frames(path: Path) -> tuple[list[LoggedScan], OccupancyGrid]:
    """Return the scans to localize and the map: that of the log, or one made of the odd scans; then the even ones are used."""
    drive: ScanLog = open_scan_log(path)
    grid = drive.map
    if grid is not None:
        return list(logged_scans(drive)), grid
    grid, _ = map_from_frames(lambda: logged_scans(drive, every=2, first=0))
    return list(logged_scans(drive, every=2, first=1)), grid


class LocalizationEvaluation(Evaluation):
    """Drives with amcl; the score is 1 for no error, 0 for an error (rms) of HELD_M, -1 for a pose that was lost.

    A simulated drive is simulated once and does not depend on the candidate: the robot drives on its true pose.
    """

    failed_score = FAILED_SCORE
    best_score = 1.0

    def __init__(
        self, name: str, scenarios: Sequence[NamedScenario], parts: Sequence[LogPart], seeds: Sequence[int]
    ) -> None:
        self._scenarios = {s.name: s for s in scenarios}
        self._parts = {p.name: p for p in parts}
        self._frames: dict[Case, tuple[list[LoggedScan], OccupancyGrid]] = {}
        super().__init__(name, [Case(case, seed) for seed in seeds for case in (*self._scenarios, *self._parts)])

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_frames": {}}

    def overlays(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """Those of the scenario."""
        named = self._scenarios.get(case.name)
        return () if named is None else named.overlays

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Localize along the drive; there is no recorder."""
        frames, grid = self._drive_of(case)
        params = configuration.localization.amcl or AmclParams()
        localizer = Amcl(params, seed=case.seed)
        localizer.set_map(grid)
        reference = next(frame.reference for frame in frames if frame.reference is not None)
        start = Transform2D(*reference).apply(_start_error(case.seed))
        return _outcome(follow(frames, localizer, initial_pose=start)), None

    def _drive_of(self, case: Case) -> tuple[list[LoggedScan], OccupancyGrid]:
        found = self._frames.get(case)
        if found is None:
            part = self._parts.get(case.name)
            if part is None:
                found = _simulated(self._scenarios[case.name].scenario, case.seed)
            else:
                frames, grid = _log_frames(part.path)
                found = frames[part.first : part.last], grid
            self._frames[case] = found
        return found


def _simulated(scenario: Scenario, seed: int) -> tuple[list[LoggedScan], OccupancyGrid]:
    run = Run(replace(scenario, seed=seed), record=True)
    while run.step():
        pass
    assert run.recorder is not None
    return list(logged_scans(RunScanLog.of(run.recorder.record()))), scenario.map


def _start_error(seed: int) -> Pose2D:
    return Pose2D(*(np.random.default_rng([seed, 19]).standard_normal(3) * START_ERROR).tolist())


def _outcome(track: Track) -> RunOutcome:
    errors = track.errors[track.known]
    held = errors < HELD_M
    success = bool(len(held)) and bool(held[-1]) and float(held.mean()) >= HELD_SHARE
    rms = float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else math.inf
    steps = np.diff(track.references[track.known, :2], axis=0)
    return RunOutcome(
        success=success,
        outcome="success" if success else "lost",
        score=max(0.0, 1.0 - rms / HELD_M) if success else FAILED_SCORE,
        time_s=0.0,
        length_m=float(np.hypot(*steps.T).sum()),
        clearance_m=0.0,
        jerk=0.0,
        recoveries=0,
        text="" if success else f"within {HELD_M:g} m at {100.0 * float(held.mean()):.0f} % of the scans",
        error_m=rms,
    )

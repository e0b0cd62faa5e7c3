"""What candidates are driven over: scenarios, BARN worlds. A run of one is a pure function of candidate, case and seed."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

from navstack.bench.barn import BarnWorld, run_world
from navstack.core.errors import NavError
from navstack.parameters.configuration import Configuration
from navstack.record import RunRecorder
from navstack.scenario import Run, Scenario

FAILED_SCORE: Final = -1.0
"""Score of a run over a scenario that did not get to its goals, or touched something."""


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario with one seed."""

    name: str
    """Of the scenario; runs of one are a group."""
    seed: int

    @property
    def key(self) -> str:
        """Its name among all cases."""
        return f"{self.name} seed {self.seed}"


@dataclass(frozen=True, slots=True)
class RunOutcome:
    """How a run ended."""

    success: bool
    """At every goal, and nothing touched."""
    outcome: str
    """success, collision, timeout, the state in which a goal ended, `refused` for parameters that cannot be used."""
    score: float
    """The higher the better; of the course's own rule."""
    time_s: float
    """Simulated seconds, by the course's own clock: of all goals, or since a BARN robot has moved 0.1 m."""
    length_m: float
    """Metres driven."""
    clearance_m: float
    """Least distance between the robot's outline and anything, at the control cycles; 0 where there is nothing at all, so
    that it is a number."""
    jerk: float
    """Root mean square of the jerk (m/s³): how smooth the run was."""
    recoveries: int
    """Recovery behaviours run."""
    text: str = ""
    """Why it was no success; nothing for one."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON; rounded to what means something, so that a line is short."""
        return {
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


class Course(ABC):
    """A list of cases, and how one is driven. Goes to other processes and machines, with all it needs."""

    failed_score: ClassVar[float]
    """The score of a run that failed."""
    best_score: ClassVar[float]
    """No run has a higher one."""

    def __init__(self, name: str, cases: Sequence[Case]) -> None:
        self.name = name
        self.cases = tuple(cases)

    def over(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """Parameters that a case lays over those of the robot."""
        del case
        return ()

    @abstractmethod
    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drives once. The recorder only with `record`. Raises NavError where the run cannot begin."""

    def outcome(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """The same; a run that cannot begin is an outcome too."""
        try:
            return self.drive(case, configuration, record=record)
        except NavError as error:
            return self.refused(error.name.lower(), error.message), None

    def refused(self, outcome: str, text: str) -> RunOutcome:
        """The outcome of a run that was never driven."""
        return RunOutcome(False, outcome, self.failed_score, 0.0, 0.0, 0.0, 0.0, 0, text)


@dataclass(frozen=True, slots=True)
class NamedScenario:
    """A scenario of a course. Its parameters are replaced by the candidate's."""

    name: str
    scenario: Scenario
    reference_s: float
    """What the way takes at full speed: the time that a score of 1 needs."""
    over: tuple[Mapping[str, Any], ...] = ()
    """Parameters that the scenario lays over those of the robot: its `set:` and `sim:`."""


class ScenarioCourse(Course):
    """Scenarios; the score of a run is the reference time over the time taken, at most 1, or -1 without success."""

    failed_score = FAILED_SCORE
    best_score = 1.0

    def __init__(self, name: str, scenarios: Sequence[NamedScenario], seeds: Sequence[int]) -> None:
        self._scenarios = {s.name: s for s in scenarios}
        super().__init__(name, [Case(s.name, seed) for seed in seeds for s in scenarios])

    def over(self, case: Case) -> tuple[Mapping[str, Any], ...]:
        """The scenario's own."""
        return self._scenarios[case.name].over

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """A collision ends the run, unless the scenario allows it, and so does a goal that was not reached."""
        named = self._scenarios[case.name]
        scenario = replace(named.scenario, configuration=configuration, seed=case.seed, stop_on_failure=True)
        allowed = scenario.success.max_collisions
        run = Run(scenario, record=record)
        while run.step():
            if allowed is not None and len(run.robot.collisions) > allowed:
                run.stop()
                break
        result = run.result(0.0)
        metrics, goals = result.metrics, result.goals
        failed = next((c for c in result.conditions if not c.holds), None)
        ended = "success"
        if failed is not None:
            ended = failed.condition
            if allowed is not None and metrics.collisions > allowed:
                ended = "collision"
            elif failed.condition == "goals":
                ended = goals[-1].state.lower() if goals else "timeout"
                ended = "timeout" if ended == "preempted" else ended
        taken = math.fsum(g.time_s for g in goals)
        outcome = RunOutcome(
            success=failed is None,
            outcome=ended,
            score=min(1.0, named.reference_s / max(taken, 1e-9)) if failed is None else FAILED_SCORE,
            time_s=taken,
            length_m=metrics.length_m,
            clearance_m=metrics.clearance_min_m if math.isfinite(metrics.clearance_min_m) else 0.0,
            jerk=metrics.jerk_rms_m_s3,
            recoveries=metrics.recoveries,
            text="" if failed is None else (goals[-1].message if goals and goals[-1].message else failed.text),
        )
        return outcome, run.recorder


class BarnCourse(Course):
    """BARN worlds, scored by BARN's rule: 0 without success, 0.5 at most."""

    failed_score = 0.0
    best_score = 0.5

    def __init__(self, worlds: Sequence[BarnWorld], seeds: Sequence[int]) -> None:
        self._worlds = {f"world {w.number}": w for w in worlds}
        super().__init__("barn", [Case(name, seed) for seed in seeds for name in self._worlds])

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """As `navstack.bench.barn` does."""
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

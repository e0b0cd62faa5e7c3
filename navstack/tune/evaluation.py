"""Evaluation of candidates on scenarios or BARN worlds. A run is a pure function of candidate, case and seed."""

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
from navstack.scenario import Run, RunResult, Scenario

FAILED_SCORE: Final = -1.0
"""Score of a run that missed a goal or collided."""


@dataclass(frozen=True, slots=True)
class Case:
    """One scenario with one seed."""

    name: str
    """Name of the scenario; the runs of one scenario form a group."""
    seed: int

    @property
    def key(self) -> str:
        """Unique among all cases."""
        return f"{self.name} seed {self.seed}"


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
    """Number of recovery behaviours run."""
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
        """Drives once. The recorder is None without `record`. Raises NavError if the run cannot start."""

    def outcome(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drives once; a run that cannot start is an outcome too."""
        try:
            return self.drive(case, configuration, record=record)
        except NavError as error:
            return self.refused(error.name.lower(), error.message), None

    def refused(self, outcome: str, text: str) -> RunOutcome:
        """The outcome of a run that was not driven."""
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
        """The scenario's own."""
        return self._scenarios[case.name].overlays

    def drive(
        self, case: Case, configuration: Configuration, *, record: bool = False
    ) -> tuple[RunOutcome, RunRecorder | None]:
        """Drives until all goals are done; stops at the first missed goal and at a collision that the scenario forbids."""
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
            ended = goals[-1].state.lower() if goals else "timeout"
            ended = "timeout" if ended == "preempted" else ended
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
        """Drives as `navstack.bench.barn` does."""
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

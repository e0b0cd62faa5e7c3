"""How a run and its goals ended."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.core import Pose2D
from navstack.parameters.findings import Finding
from navstack.record import RunRecorder
from navstack.record.metrics import RunMetrics
from navstack.record.timings import Timings
from navstack.scenario.success import ConditionResult
from navstack.scenario.warnings import RunWarning

EXPLAIN_FAILURES: Final = frozenset({"scoring-scale"})
"""Rules of `navstack check` whose finding explains robots that stop or turn in place."""


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


def advice_for(goals: Sequence[GoalOutcome], findings: Sequence[Finding]) -> tuple[str, ...]:
    """Return the findings of the rules that explain failed goals, with file and line; none if no goal failed."""
    if all(goal.succeeded for goal in goals):
        return ()
    return tuple(f"{f.location}: {f.message}" for f in findings if f.rule in EXPLAIN_FAILURES)


@dataclass(frozen=True, slots=True)
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
    """Findings about the parameters that may explain the goals that failed, with what to try; empty if none failed."""

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

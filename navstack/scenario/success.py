"""Success conditions of a run and their evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Annotated, Any, Final

from pydantic import AfterValidator

from navstack.core import InputError
from navstack.plugins import ParamModel
from navstack.record import RunMetrics
from navstack.scenario.fields import described, file_fields, file_key, file_model

TERMINAL_STATES: Final = ("SUCCEEDED", "ABORTED", "PREEMPTED", "REJECTED", "RECALLED", "LOST")
"""States in which a goal can end."""
RENAMED: Final = {"max_contacts": "max_collisions"}
"""Condition of an earlier version -> current name; both are read."""


def state_error(state: str) -> str:
    """Returns a message if `state` is neither one of `TERMINAL_STATES` nor `any`, else an empty string."""
    if state in (*TERMINAL_STATES, "any"):
        return ""
    return f'"{state}" is not a terminal goal state; use {", ".join(TERMINAL_STATES)} or any'


@dataclass(frozen=True, slots=True)
class ConditionResult:
    """The result of one success condition."""

    condition: str
    holds: bool
    text: str
    """The measured value and the limit."""

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class SuccessConditions:
    """Conditions that a run must meet. Default: every goal SUCCEEDED, no collision. None disables a limit."""

    goals: Annotated[
        str | tuple[str, ...],
        described("terminal state required of every goal, or one state per goal; any: every state is accepted"),
    ] = "SUCCEEDED"
    max_collisions: Annotated[
        int | None, described("maximum number of collisions with obstacles; null (~): no limit", ge=0)
    ] = 0
    max_time_s: Annotated[float | None, described("maximum simulated time of the whole run", unit="s", gt=0.0)] = None
    min_clearance_m: Annotated[
        float | None,
        described("minimum distance between the unpadded footprint and an obstacle", unit="m", ge=0.0),
    ] = None
    """Measured at the control cycles."""
    max_length_m: Annotated[float | None, described("maximum distance driven", unit="m", gt=0.0)] = None
    max_recoveries: Annotated[int | None, described("maximum number of recovery behaviors run", ge=0)] = None

    def check_goals(self, count: int) -> None:
        """Raises InputError unless `goals` has valid states, either one or `count` of them."""
        for state in (self.goals,) if isinstance(self.goals, str) else self.goals:
            error = state_error(state)
            if error:
                raise InputError(f"success: goals: {error}", state=state)
        if not isinstance(self.goals, str) and len(self.goals) != count:
            raise InputError(
                f"success: goals lists {_plural(len(self.goals), 'state')} for {_plural(count, 'goal')}; list one state per "
                "goal, or give a single state for all",
                states=list(self.goals),
                goals=count,
            )

    def evaluate(self, states: Sequence[str], metrics: RunMetrics, goals: int) -> tuple[ConditionResult, ...]:
        """Evaluates every condition for a run of `goals` goals whose first ones ended in `states` (the rest were skipped)."""
        results = [self._evaluate_goals(states, goals)]
        for name, limit, value, unit, is_minimum in (
            ("max_collisions", self.max_collisions, metrics.collisions, "collision", False),
            ("max_time", self.max_time_s, metrics.time_s, "s", False),
            ("min_clearance", self.min_clearance_m, metrics.clearance_min_m, "m", True),
            ("max_length", self.max_length_m, metrics.length_m, "m", False),
            ("max_recoveries", self.max_recoveries, metrics.recoveries, "recovery", False),
        ):
            if limit is not None:
                holds = value >= limit if is_minimum else value <= limit
                bound = "at least" if is_minimum else "at most"
                text = f"{_format_value(value, limit, unit)}, {bound} {limit:g} required"
                results.append(ConditionResult(name, holds, text))
        return tuple(results)

    def _evaluate_goals(self, states: Sequence[str], goals: int) -> ConditionResult:
        required = (self.goals,) * goals if isinstance(self.goals, str) else self.goals
        failures = [
            f"goal {i} {'was skipped' if state is None else f'ended {state}'}, {wanted} required"
            for i, (state, wanted) in enumerate(zip([*states, *[None] * (goals - len(states))], required), 1)
            if state is None or wanted not in (state, "any")
        ]
        summary = "ended as required"
        if isinstance(self.goals, str):
            summary = {"SUCCEEDED": "reached", "any": "ended"}.get(self.goals, f"ended {self.goals}, as required")
        return ConditionResult("goals", not failures, "; ".join(failures) or f"{goals} of {goals} {summary}")

    def as_dict(self) -> dict[str, Any]:
        """Returns JSON data for the record."""
        out = asdict(self)
        out["goals"] = self.goals if isinstance(self.goals, str) else list(self.goals)
        return out

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SuccessConditions:
        """Inverts `as_dict`; reads keys of earlier versions too. Raises TypeError for unknown keys."""
        goals = values.get("goals", "SUCCEEDED")
        limits: dict[str, Any] = {RENAMED.get(key, key): value for key, value in values.items() if key != "goals"}
        return cls(goals=goals if isinstance(goals, str) else tuple(goals), **limits)

    @classmethod
    def from_file(cls, values: ParamModel) -> SuccessConditions:
        """Return the conditions of `success:`, bound to the model `Success`."""
        return cls.from_dict({field.name: getattr(values, file_key(field.name)) for field in fields(cls)})


def _known_states(value: str | list[str]) -> str | list[str]:
    for state in [value] if isinstance(value, str) else value:
        error = state_error(state)
        if error:
            raise ValueError(error)
    return value


Success: Final = file_model(
    "Success",
    "`success:` conditions that the run must meet.",
    file_fields(SuccessConditions, {"goals": Annotated[str | list[str], AfterValidator(_known_states)]}),
    RENAMED,
)
"""`success:` of a scenario file."""


def _plural(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"


def _format_value(value: float, limit: float, unit: str) -> str:
    """Formats a value with its unit, with enough digits to distinguish it from the limit."""
    text = next(
        (f"{value:.{n}g}" for n in range(4, 17) if (float(f"{value:.{n}g}") == limit) == (value == limit)), f"{value!r}"
    )
    plurals = {"collision": "collisions", "recovery": "recoveries"}
    return f"{text} {unit if value == 1 else plurals.get(unit, unit)}"

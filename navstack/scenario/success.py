"""What makes a run a success: conditions, and whether a run met them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from navstack.core.errors import InputError
from navstack.record.metrics import RunMetrics

ENDS: Final = ("SUCCEEDED", "ABORTED", "PREEMPTED", "REJECTED", "RECALLED", "LOST")
"""States in which a goal can end."""
RENAMED: Final = {"max_contacts": "max_collisions"}
"""Condition of an earlier version -> current name; both are read."""


def not_an_end(state: str) -> str:
    """Why no goal can be wanted to end in that state; nothing for one that can: one of `ENDS`, or `any`."""
    if state in (*ENDS, "any"):
        return ""
    return f'"{state}" is no state that a goal ends in; write {", ".join(ENDS)} or any'


@dataclass(frozen=True, slots=True)
class ConditionResult:
    """One condition, and whether it holds."""

    condition: str
    holds: bool
    text: str
    """What was wanted and what was."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True, slots=True)
class SuccessConditions:
    """What a run must keep to. The default: every goal SUCCEEDED, and nothing was touched."""

    goals: str | tuple[str, ...] = "SUCCEEDED"
    """The state in which every goal must end, or one for each goal in turn; `any`: whichever, as long as it ends."""
    max_collisions: int | None = 0
    """None: collisions do not matter."""
    max_time_s: float | None = None
    """Simulated seconds for the whole run."""
    min_clearance_m: float | None = None
    """Least distance (m) between the robot's true outline and an obstacle, at the control cycles."""
    max_length_m: float | None = None
    """Metres driven, over all goals."""
    max_recoveries: int | None = None
    """Recovery behaviours run, over all goals."""

    def check_goals(self, count: int) -> None:
        """Raises InputError when there is not one state for each of `count` goals, or one that is none."""
        for state in (self.goals,) if isinstance(self.goals, str) else self.goals:
            wrong = not_an_end(state)
            if wrong:
                raise InputError(f"success: goals: {wrong}", state=state)
        if not isinstance(self.goals, str) and len(self.goals) != count:
            raise InputError(
                f"success: goals lists {_many(len(self.goals), 'state')} for {_many(count, 'goal')}; give one for each, or "
                "one for all",
                states=list(self.goals),
                goals=count,
            )

    def judge(self, states: Sequence[str], metrics: RunMetrics, goals: int) -> tuple[ConditionResult, ...]:
        """Every condition against a run whose goals, `goals` in all, ended in `states` (those left out are missing)."""
        found = [self._goals(states, goals)]
        for name, limit, value, unit, above in (
            ("max_collisions", self.max_collisions, metrics.collisions, "collision", False),
            ("max_time", self.max_time_s, metrics.time_s, "s", False),
            ("min_clearance", self.min_clearance_m, metrics.clearance_min_m, "m", True),
            ("max_length", self.max_length_m, metrics.length_m, "m", False),
            ("max_recoveries", self.max_recoveries, metrics.recoveries, "recovery", False),
        ):
            if limit is not None:
                holds = value >= limit if above else value <= limit
                bound = "at least" if above else "at most"
                found.append(ConditionResult(name, holds, f"{_amount(value, limit, unit)}, {bound} {limit:g} wanted"))
        return tuple(found)

    def _goals(self, states: Sequence[str], goals: int) -> ConditionResult:
        wanted = (self.goals,) * goals if isinstance(self.goals, str) else self.goals
        wrong = [
            f"goal {i} {'was not driven' if state is None else state}, {want} wanted"
            for i, (state, want) in enumerate(zip([*states, *[None] * (goals - len(states))], wanted), 1)
            if state is None or want not in (state, "any")
        ]
        said = "ended as listed"
        if isinstance(self.goals, str):
            said = {"SUCCEEDED": "reached", "any": "ended"}.get(self.goals, f"ended {self.goals}, as wanted")
        return ConditionResult("goals", not wrong, "; ".join(wrong) or f"{goals} of {goals} {said}")

    def as_dict(self) -> dict[str, Any]:
        """For the record (JSON)."""
        out = asdict(self)
        out["goals"] = self.goals if isinstance(self.goals, str) else list(self.goals)
        return out

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SuccessConditions:
        """Inverts `as_dict`; reads keys of earlier versions too. Raises TypeError for unknown keys."""
        goals = values.get("goals", "SUCCEEDED")
        rest: dict[str, Any] = {RENAMED.get(key, key): value for key, value in values.items() if key != "goals"}
        return cls(goals=goals if isinstance(goals, str) else tuple(goals), **rest)


def _many(count: int, what: str) -> str:
    return f"{count} {what}{'' if count == 1 else 's'}"


def _amount(value: float, limit: float, unit: str) -> str:
    """A measured value with its unit, with as many digits as tell it from the limit."""
    text = next(
        (f"{value:.{n}g}" for n in range(4, 17) if (float(f"{value:.{n}g}") == limit) == (value == limit)), f"{value!r}"
    )
    many = {"collision": "collisions", "recovery": "recoveries"}
    return f"{text} {unit if value == 1 else many.get(unit, unit)}"

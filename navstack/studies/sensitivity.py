"""Sensitivity of the results to each parameter: its current value is halved and doubled, over the same runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.parameters import value_text
from navstack.studies.comparison import Case, Comparison, compare_outcomes
from navstack.studies.evaluation import Outcome, outcome_of, run_job
from navstack.studies.jobs import Executor, Job
from navstack.studies.search_space import Dimension, SearchSpace, Value

_SHOWN_EFFECTS: Final = (("time", ("longer", "shorter")), ("clearance", ("more clearance", "less clearance")))
"""Measures named in the sentence, with the words for an increase and a decrease."""


@dataclass(frozen=True, slots=True)
class Perturbation:
    """One parameter with another value."""

    dimension: Dimension
    value: Value
    word: str
    """halved or doubled; for other values raised, raised more, or set."""
    comparison: Comparison
    """Current parameters against the changed one."""

    @property
    def effect(self) -> float:
        """The difference in the score."""
        return self.comparison.measure("score").difference.interval.value

    @property
    def what(self) -> str:
        """`doubled to 2.0`."""
        return f"{self.word} to {value_text(self.value)}"

    @property
    def sentence(self) -> str:
        """The effect in words."""
        d, c = self.dimension, self.comparison
        unit = f" {d.unit}" if d.unit else ""
        present = value_text(d.present) if d.present is not None else "the default"
        also = "".join(f" and {name}" for name, factor in d.ties if factor == 1.0)
        head = f"{d.name}{also} {self.word} ({present} -> {value_text(self.value)}{unit})"
        refused = [o for o in c.after if o["outcome"] == "refused"]
        if len(refused) == len(c.after):
            return f"{head}: invalid value ({str(refused[0]['text']).splitlines()[-1]})"
        if all(_same(b, a) for b, a in zip(c.before, c.after)):
            return f"{head}: no change in {len(c.cases)} runs"
        score = c.measure("score").difference
        effects = _effects(c)
        if not effects:
            kinds = "on success, time or clearance " if score.excludes_zero else ""
            effects = [f"the runs differ, but no effect {kinds}is shown"]
        return f"{head}: {', '.join(effects)}; score {score.interval.text(3)}"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "parameter": self.dimension.name,
            "present": self.dimension.present,
            "value": self.value,
            "what": self.word,
            "sentence": self.sentence,
            "effect": self.effect,
            "comparison": {m.name: m.as_dict() for m in self.comparison.measures},
        }


def _same(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    return all(a[key] == b[key] for key in ("success", "outcome", "score", "time_s", "length_m", "clearance_m"))


def _effects(c: Comparison) -> list[str]:
    """Return the changes in success, time and clearance that are shown."""
    parts: list[str] = []
    if c.fixed or c.broken:
        success = c.measure("success")
        parts.append(
            f"success changes from {success.before.value:.0%} to {success.after.value:.0%} "
            f"({len(c.fixed)} more succeed, {len(c.broken)} more fail)"
        )
    for name, words in _SHOWN_EFFECTS:
        m = c.find(name)
        if m is not None and m.difference.excludes_zero:
            i = m.difference.interval
            word = words[0] if i.value > 0.0 else words[1]
            low, high = sorted((abs(i.low), abs(i.high)))
            parts.append(f"{abs(i.value):.2f} {m.unit} {word} [{low:.2f}, {high:.2f}]")
    return parts


def values_to_try(d: Dimension) -> list[tuple[str, Value]]:
    """Return the values for a dimension, as (word, value).

    Half and twice the current value, also outside the range; for 0 and an unknown value, a quarter of the range and its upper
    end; for a choice, all others.
    """
    if d.kind == "choice":
        return [("set", v) for v in d.choices if v != d.present]
    present = float(d.present) if d.present is not None and not isinstance(d.present, str) else 0.0
    if present == 0.0:
        return [("raised", d.at(0.25)), ("raised more", d.at(1.0))]
    found: list[tuple[str, Value]] = []
    for word, factor in (("halved", 0.5), ("doubled", 2.0)):
        value: Value = present * factor
        if d.kind == "int":
            value = max(1, round(present * factor))
        if value != d.present:
            found.append((word, value))
    return found


def sensitivity(
    space: SearchSpace,
    executor: Executor,
    cases: Sequence[Case],
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Perturbation]:
    """Change every dimension alone, over every case; the greatest effect on the score first.

    Half and twice a value may be outside the search range and outside the bounds of the model: the runs of an invalid value
    are refused. `progress` is called with the number of finished runs and of all runs. Raises InternalError for a run that
    raised an exception.
    """
    plan: list[tuple[Dimension, str, Value]] = [(d, word, value) for d in space for word, value in values_to_try(d)]
    candidates: list[tuple[str, tuple[str, ...]]] = [("present", ())]
    for number, (d, _, value) in enumerate(plan):
        candidates.append((f"step {number}", tuple(f"{name}={value_text(v)}" for name, v in d.settings(value))))
    jobs: list[Job] = []
    keys: dict[str, tuple[int, Case]] = {}
    for index, (name, overrides) in enumerate(candidates):
        for case in cases:
            job = run_job(name, overrides, case)
            keys[job.key] = (index, case)
            jobs.append(job)
    for job in jobs:
        executor.submit(job)
    found: list[dict[str, Outcome]] = [{} for _ in candidates]
    for done in range(1, len(jobs) + 1):
        result = executor.collect()
        index, case = keys[result.key]
        found[index][case.key] = outcome_of(result)
        progress(done, len(jobs))
    present, *changed = found
    made = [
        Perturbation(d, value, word, compare_outcomes(cases, present, outcomes))
        for (d, word, value), outcomes in zip(plan, changed, strict=True)
    ]
    return sorted(made, key=lambda p: (-abs(p.effect), p.dimension.name, p.word))

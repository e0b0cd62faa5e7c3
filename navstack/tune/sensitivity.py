"""What changes if one parameter is doubled, or halved: each around its present value, over the same runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navstack.jobs import Executor, Job
from navstack.tune.comparison import Comparison, compare
from navstack.tune.courses import Case
from navstack.tune.space import Dimension, SearchSpace, Value, value_of
from navstack.tune.study import Outcome
from navstack.tune.work import outcome_of, run_job


@dataclass(frozen=True, slots=True)
class Step:
    """One parameter, changed."""

    dimension: Dimension
    value: Value
    word: str
    """halved, doubled, or what was done where that is not possible: raised, raised more, set."""
    comparison: Comparison

    @property
    def effect(self) -> float:
        """The difference in the score."""
        return self.comparison.measure("score").difference.interval.value

    @property
    def what(self) -> str:
        """`doubled to 2.0`."""
        return f"{self.word} to {value_of(self.value)}"

    @property
    def sentence(self) -> str:
        """What changes, in words."""
        d, c = self.dimension, self.comparison
        unit = f" {d.unit}" if d.unit else ""
        present = value_of(d.present) if d.present is not None else "the default"
        also = "".join(f" and {name}" for name, factor in d.ties if factor == 1.0)
        head = f"{d.name}{also} {self.word} ({present} -> {value_of(self.value)}{unit})"
        refused = [o for o in c.after if o["outcome"] == "refused"]
        if len(refused) == len(c.after):
            return f"{head}: cannot be used ({str(refused[0]['text']).splitlines()[-1]})"
        if all(_same(b, a) for b, a in zip(c.before, c.after)):
            return f"{head}: nothing changes at all in {len(c.cases)} runs"
        parts: list[str] = []
        score, success = c.measure("score"), c.measure("success")
        if c.mended or c.broken:
            parts.append(
                f"success goes from {success.before.value:.0%} to {success.after.value:.0%} "
                f"({len(c.mended)} more succeed, {len(c.broken)} more fail)"
            )
        for name, words in (("time", ("longer", "shorter")), ("clearance", ("more clearance", "less clearance"))):
            m = next((m for m in c.measures if m.name == name), None)
            if m is not None and m.difference.shown:
                i = m.difference.interval
                word = words[0] if i.value > 0.0 else words[1]
                low, high = sorted((abs(i.low), abs(i.high)))
                parts.append(f"{abs(i.value):.2f} {m.unit} {word} [{low:.2f}, {high:.2f}]")
        if not parts:
            shown = "no effect on success, time or clearance" if score.difference.shown else "no effect"
            parts.append(f"runs differ, but {shown} is shown")
        return f"{head}: {', '.join(parts)}; score {score.difference.interval.text(3)}"

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


def steps_of(d: Dimension) -> list[tuple[str, Value]]:
    """What is tried of a dimension: (word, value).

    Half and twice the present value, whatever the range; of one that is 0 or unknown, a quarter of the range and its upper
    end; of a choice, all the others.
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
    hear: Callable[[int, int], None] = lambda done, total: None,
) -> list[Step]:
    """Every dimension of the space, changed alone, over every case; the greatest effect on the score first.

    Halving and doubling may leave the search's ranges, and what the model allows: a value that it refuses is a step whose
    runs were all refused. `hear` is called with the runs that are done and how many there are. Raises InternalError for a
    run that could not be driven.
    """
    plan: list[tuple[Dimension, str, Value]] = [(d, word, value) for d in space for word, value in steps_of(d)]
    inputs: dict[str, tuple[int, Case]] = {}
    jobs: list[Job] = []

    def add(number: int, overrides: tuple[str, ...]) -> None:
        for case in cases:
            job = run_job("present" if number < 0 else f"step {number}", overrides, case)
            inputs[job.key] = (number, case)
            jobs.append(job)

    add(-1, ())
    for number, (d, _, value) in enumerate(plan):
        add(number, tuple(f"{name}={value_of(v)}" for name, v in d.settings(value)))
    found: dict[int, dict[str, Outcome]] = {}
    for job in jobs:
        executor.submit(job)
    for done in range(1, len(jobs) + 1):
        result = executor.collect()
        number, case = inputs[result.key]
        found.setdefault(number, {})[case.key] = outcome_of(result)
        hear(done, len(jobs))
    made = [
        Step(d, value, word, compare(cases, found[-1], found[number])) for number, (d, word, value) in enumerate(plan)
    ]
    return sorted(made, key=lambda s: (-abs(s.effect), s.dimension.name, s.word))

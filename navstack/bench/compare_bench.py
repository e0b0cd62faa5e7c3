"""Two parameter sets on the same scenarios and seeds: the task, its jobs and the pairs of runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from navstack.bench.compare_scenarios import ComparedScenario, ParameterSet
from navstack.bench.digests import short_names
from navstack.jobs import Job, JobResult

SIDES: Final = ("A", "B")
_FEW_SCENARIOS: Final = 10


@dataclass(frozen=True)
class CompareTask:
    """Drives a scenario with the parameters of one side."""

    sets: Mapping[str, ParameterSet]
    scenarios: tuple[ComparedScenario, ...]

    def __call__(self, job_input: tuple[str, int, int]) -> dict[str, Any]:
        """Drives once, given as (`A` or `B`, index of the scenario, seed); the metrics of the run."""
        side, scenario, seed = job_input
        return self.scenarios[scenario].drive(self.sets[side], seed)

    def described(self) -> dict[str, Any]:
        """Everything that affects the runs, except the seed."""
        return {
            "bench": "compare",
            **{s: {"params": short_names(p.params), "set": list(p.overrides)} for s, p in self.sets.items()},
            "scenarios": {c.name: {side: c.digest(self.sets[side]) for side in self.sets} for c in self.scenarios},
        }

    def jobs(self, seeds: int) -> list[Job]:
        """A job per scenario, seed and side."""
        return [
            Job(f"{side}, {scenario.name}, seed {seed}", (side, i, seed))
            for seed in range(seeds)
            for i, scenario in enumerate(self.scenarios)
            for side in SIDES
        ]


@dataclass(frozen=True, slots=True)
class Pair:
    """The runs of both sides in one scenario with one seed."""

    scenario: str
    seed: int
    a: Mapping[str, Any]
    b: Mapping[str, Any]

    @property
    def both_succeed(self) -> bool:
        """True if both runs succeeded."""
        return bool(self.a["success"] and self.b["success"])


def pairs_of(task: CompareTask, results: Sequence[JobResult], jobs: Sequence[Job]) -> list[Pair]:
    """The pairs for which both runs gave a result."""
    found = {job.input: r.value for r, job in zip(results, jobs, strict=True) if not r.failed}
    cases = dict.fromkeys((scenario, seed) for _, scenario, seed in found)
    return [
        Pair(task.scenarios[i].name, seed, found["A", i, seed], found["B", i, seed])
        for i, seed in cases
        if ("A", i, seed) in found and ("B", i, seed) in found
    ]


def comparison_notes(task: CompareTask) -> list[str]:
    """What to consider when reading the tables."""
    notes = [f"{side}: {chosen.label}" for side, chosen in task.sets.items()]
    notes.append(
        "verdicts are not corrected for multiple comparisons: of twenty equal measures, one shows a difference by chance"
    )
    many = len(task.scenarios)
    if many == 1:
        notes.append("there is only one scenario: intervals are over its seeds and do not apply to other scenarios")
    elif many < _FEW_SCENARIOS:
        notes.append(
            f"{many} scenarios are few: intervals are over scenarios; more seeds only reduce the noise of each"
        )
    return notes

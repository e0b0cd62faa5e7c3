"""Random scenarios by the thousand: how they ended, and whether anything came of one that must never be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from navstack.bench.table import Column, Table
from navstack.jobs import Job, JobResult
from navstack.scenario.suites.random_scenarios import check_random


@dataclass(frozen=True, slots=True)
class RandomTask:
    """Drives the random scenario of a number."""

    time_limit_s: float

    def __call__(self, number: int) -> dict[str, Any]:
        """What became of it, as JSON."""
        return asdict(check_random(number, time_limit_s=self.time_limit_s))


def random_jobs(first: int, count: int) -> list[Job]:
    """The scenarios `first` .. `first + count - 1`."""
    return [Job(f"random {number}", number) for number in range(first, first + count)]


def random_tables(results: Sequence[JobResult]) -> list[Table]:
    """How the scenarios ended; and a line for each fault."""
    values = [result.value for result in results if not result.failed]
    ends: Counter[str] = Counter()
    for value in values:
        outcome = str(value["outcome"])
        ends.update([outcome] if outcome.startswith(("refused", "exception")) else outcome.split())
    faults = [(value["number"], fault) for value in values for fault in value["faults"]]
    simulated = sum(float(value["simulated_s"]) for value in values)
    collisions = sum(1 for value in values if value.get("collisions", value.get("contacts")))
    rows: list[dict[str, Any]] = [
        {"what": "scenarios", "many": len(values)},
        {"what": "hours simulated", "many": simulated / 3600.0},
        {"what": "with collisions", "many": collisions},
        {"what": "with faults", "many": sum(1 for value in values if value["faults"])},
        *({"what": f"goals that ended {end}" if end.isupper() else end, "many": ends[end]} for end in sorted(ends)),
    ]
    tables = [Table("random", (Column("what", "random scenarios"), Column("many", "how many")), rows)]
    if faults:
        rows = [{"number": str(number), "fault": fault} for number, fault in faults]
        tables.append(Table("faults", (Column("number", "scenario"), Column("fault", "what")), rows))
    return tables

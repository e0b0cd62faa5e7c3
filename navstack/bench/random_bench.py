"""Random scenarios by the thousand: how they end, and which invariants they violate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from navstack.bench.table import Column, Table
from navstack.jobs import Job, JobResult
from navstack.scenario.suites.random_check import check_random


@dataclass(frozen=True, slots=True)
class RandomTask:
    """Runs the random scenario of a number."""

    time_limit_s: float

    def __call__(self, number: int) -> dict[str, Any]:
        """The outcome and the violations, for JSON."""
        return asdict(check_random(number, time_limit_s=self.time_limit_s))


def random_jobs(first: int, count: int) -> list[Job]:
    """A job for each of the scenarios `first` .. `first + count - 1`."""
    return [Job(f"random {number}", number) for number in range(first, first + count)]


def random_tables(results: Sequence[JobResult]) -> list[Table]:
    """How the scenarios ended, and a row for each violation."""
    values = [result.value for result in results if not result.failed]
    ends: Counter[str] = Counter()
    for value in values:
        outcome = str(value["outcome"])
        ends.update([outcome] if outcome.startswith(("refused", "exception")) else outcome.split())
    faults = [(value["number"], fault) for value in values for fault in value["faults"]]
    simulated = sum(float(value["simulated_s"]) for value in values)
    collided = sum(1 for value in values if value.get("collisions", value.get("contacts")))
    rows: list[dict[str, Any]] = [
        {"what": "scenarios", "count": len(values)},
        {"what": "hours simulated", "count": simulated / 3600.0},
        {"what": "with collisions", "count": collided},
        {"what": "with violations", "count": sum(1 for value in values if value["faults"])},
        *({"what": f"goals ended {end}" if end.isupper() else end, "count": ends[end]} for end in sorted(ends)),
    ]
    tables = [Table("random", (Column("what", "random scenarios"), Column("count", "count")), rows)]
    if faults:
        rows = [{"number": str(number), "fault": fault} for number, fault in faults]
        tables.append(Table("violations", (Column("number", "scenario"), Column("fault", "violation")), rows))
    return tables

"""Random scenarios by the thousand: how they end, and which invariants they violate; or which footprints collide."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from navstack.scenario import FOOTPRINTS, check_footprint, check_random
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task


@dataclass(frozen=True)
class _Numbered(Task):
    """Scenarios that depend on their number only: `first` .. `first + count - 1`."""

    first: int
    count: int

    def jobs(self) -> list[Job]:
        """Return a job per number."""
        return [Job(f"random {number}", number) for number in range(self.first, self.first + self.count)]

    def _report(self, tables: list[Table], *, passed: bool) -> Report:
        document = {"first": self.first, "count": self.count, "tables": {table.title: table for table in tables}}
        return Report(tables, document, passed=passed)


@dataclass(frozen=True)
class RandomTask(_Numbered):
    """Runs the random scenario of a number."""

    time_limit_s: float

    def __call__(self, number: int, /) -> dict[str, Any]:
        """The outcome and the violations, for JSON."""
        return asdict(check_random(number, time_limit_s=self.time_limit_s))

    def described(self) -> dict[str, Any]:
        """Return the time limit."""
        return {"bench": "random", "time_limit_s": self.time_limit_s}

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return how the scenarios ended; not passed after a violation."""
        faults = any(result.value["faults"] for result in results if not result.failed)
        return self._report(random_tables(results), passed=not faults)


@dataclass(frozen=True)
class FootprintTask(_Numbered):
    """Runs the footprint scenario of a number."""

    def __call__(self, number: int, /) -> dict[str, Any]:
        """The end of the run and its collision, for JSON."""
        return asdict(check_footprint(number))

    def described(self) -> dict[str, Any]:
        """Return the kind of scenarios."""
        return {"bench": "random", "scenarios": "footprints"}

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return how the runs of each footprint ended; not passed after a collision."""
        collided = any(result.value["collision"] is not None for result in results if not result.failed)
        return self._report(footprint_tables(results), passed=not collided)


def random_tables(results: Sequence[JobResult]) -> list[Table]:
    """Return how the scenarios ended, and a row for each violation."""
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


def footprint_tables(results: Sequence[JobResult]) -> list[Table]:
    """Return how the runs of each footprint ended, and a row for each collision."""
    values = [result.value for result in results if not result.failed]
    rows: list[dict[str, Any]] = []
    for name in FOOTPRINTS:
        for reverses in (False, True):
            group = [v for v in values if v["footprint"] == name and v["reverses"] == reverses]
            if group:
                rows.append({"footprint": name, "reverses": "yes" if reverses else "no", **_counts(group)})
    rows.append({"footprint": "all", "reverses": "", **_counts(values)})
    columns = (
        Column("footprint", "footprint"),
        Column("reverses", "may reverse"),
        Column("runs", "runs"),
        Column("succeeded", "succeeded"),
        Column("collisions", "collisions"),
        Column("hours", "hours simulated", 2),
    )
    tables = [Table("footprints", columns, rows)]
    collided = [value for value in values if value["collision"] is not None]
    if collided:
        tables.append(_collision_table(collided))
    return tables


def _counts(values: Sequence[dict[str, Any]]) -> dict[str, Any]:
    return {
        "runs": len(values),
        "succeeded": sum(value["state"] == "SUCCEEDED" for value in values),
        "collisions": sum(value["collision"] is not None for value in values),
        "hours": sum(float(value["simulated_s"]) for value in values) / 3600.0,
    }


def _collision_table(values: Sequence[dict[str, Any]]) -> Table:
    columns = (
        Column("number", "scenario"),
        Column("footprint", "footprint"),
        Column("time", "time (s)", 2),
        Column("pose", "pose"),
        Column("obstacle", "obstacle"),
    )
    rows = [
        {
            "number": str(value["number"]),
            "footprint": value["footprint"],
            "time": value["collision"]["time"],
            "pose": _numbers(value["collision"]["pose"]),
            "obstacle": f"{value['collision']['kind']} at {_numbers(value['collision']['at'])}",
        }
        for value in values
    ]
    return Table("collisions", columns, rows)


def _numbers(values: Sequence[float]) -> str:
    return f"({', '.join(f'{value:.3f}' for value in values)})"

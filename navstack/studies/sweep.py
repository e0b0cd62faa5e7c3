"""A sweep: drives many candidates over all cases; one line of JSON per run, resumable, on this machine or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

from navstack.parameters import Configuration
from navstack.studies.evaluation import Evaluation, Outcome, RunInput, RunWork, run_job
from navstack.studies.executors import DaskExecutor, ProcessExecutor
from navstack.studies.jobs import Executor, Job, JobResult
from navstack.studies.search_space import Candidate, SearchSpace
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task, run_jobs

_SHOWN_CANDIDATES: Final = 10
_COLUMNS: Final = (
    Column("candidate", "no.", looks="number"),
    Column("score", "score", looks="number"),
    Column("success", "success", looks="number"),
    Column("time", "time", looks="number"),
    Column("values", "values"),
)


@dataclass(frozen=True)
class Sweep(Task):
    """Every candidate over every case."""

    base: Configuration
    space: SearchSpace
    candidates: Sequence[Candidate]
    evaluation: Evaluation
    settings: Mapping[str, Any]
    """Everything that affects the results except candidates and cases, for JSON: method, seed, names."""

    @cached_property
    def _work(self) -> RunWork:
        return RunWork(self.base, self.evaluation)

    def __getstate__(self) -> dict[str, Any]:
        return {"_work": self._work}  # all that a worker needs

    def __call__(self, job_input: RunInput, /) -> Outcome:
        """Drives once; the outcome, for JSON."""
        return self._work(job_input)

    def described(self) -> dict[str, Any]:
        """The settings, the search space and the parameters."""
        parameters = {"parameters": self._work.parameters, "distro": self._work.distro}
        return {**self.settings, "space": self.space.described(), **parameters}

    def jobs(self) -> list[Job]:
        """A job per candidate and case."""
        return [
            run_job(candidate_key(number, candidate), tuple(self.space.overrides(candidate)), case)
            for number, candidate in enumerate(self.candidates)
            for case in self.evaluation.cases
        ]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Each candidate with its means, sorted by score, ties in the order of the candidates; the table has the best ten."""
        many = len(self.evaluation.cases)
        ranking = [
            _summary(number, candidate, results[number * many : (number + 1) * many])
            for number, candidate in enumerate(self.candidates)
        ]
        ranking.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0.0), row["candidate"]))
        rows = [
            {
                "candidate": str(row["candidate"]),
                "score": None if row["score"] is None else f"{row['score']:.3f}",
                "success": f"{row['success']:.0%}",
                "time": None if row["time_s"] is None else f"{row['time_s']:.1f} s",
                "values": ", ".join(f"{name.rpartition('/')[2]} {value}" for name, value in row["values"].items()),
            }
            for row in ranking[:_SHOWN_CANDIDATES]
        ]
        document = {"candidates": len(ranking), "runs": len(results), "ranking": ranking}
        return Report([Table("best candidates", _COLUMNS, rows)], document)


def candidate_key(number: int, candidate: Candidate) -> str:
    """Return `17: sim_time=1.5 vx_samples=6`, so that a line of results is readable on its own."""
    return f"{number}: " + " ".join(f"{name}={value}" for name, value in candidate.items())


def run_sweep(
    sweep: Sweep,
    results: Path | None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: bool = False,
    on_result: Callable[[JobResult], None] | None = None,
) -> list[JobResult]:
    """Run everything, with `workers` processes or on the Dask cluster at `scheduler`; the results are the same.

    Raises InputError and OutputError as `run_jobs` does, and InputError for an unreachable cluster.
    """
    executor: Executor = ProcessExecutor(sweep, workers) if scheduler is None else DaskExecutor(sweep, scheduler)
    return run_jobs(
        sweep,
        sweep.jobs(),
        what=sweep.described(),
        executor=executor,
        results=results,
        resume=resume,
        progress=progress,
        on_result=on_result,
    )


def _summary(number: int, candidate: Candidate, results: Sequence[JobResult]) -> dict[str, Any]:
    outcomes = [result.value for result in results if not result.failed]
    return {
        "candidate": number,
        "values": dict(candidate),
        "runs": len(outcomes),
        "errors": len(results) - len(outcomes),
        "success": sum(bool(o["success"]) for o in outcomes) / len(outcomes) if outcomes else 0.0,
        "score": sum(o["score"] for o in outcomes) / len(outcomes) if outcomes else None,
        "time_s": _mean([o["time_s"] for o in outcomes if o["success"]]),
    }


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None

"""A sweep: many candidates, each over every case; a line of JSON per run, resumable, here or on a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navstack.jobs import Executor, JobResult, ProcessExecutor, run_jobs
from navstack.parameters.configuration import Configuration
from navstack.tune.courses import Course
from navstack.tune.space import Candidate, SearchSpace, Value
from navstack.tune.work import RunWork, run_job


@dataclass(frozen=True, slots=True)
class Sweep:
    """What is to be run."""

    base: Configuration
    space: SearchSpace
    candidates: Sequence[Candidate]
    course: Course
    what: Mapping[str, Any]
    """What shapes the results beyond candidates and cases (JSON): method, seed, names."""


@dataclass(frozen=True, slots=True)
class SweptRun:
    """A line of the results, read back."""

    candidate: int
    values: Mapping[str, Value]
    case: str
    result: JobResult


def candidate_key(number: int, candidate: Candidate) -> str:
    """`17: sim_time=1.5 vx_samples=6`: the values make a line readable by itself."""
    return f"{number}: " + " ".join(f"{name}={value}" for name, value in candidate.items())


def run_sweep(
    sweep: Sweep,
    results: Path | None,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    resume: bool = False,
    progress: bool = False,
    heard: Callable[[JobResult], None] | None = None,
) -> list[SweptRun]:
    """Runs everything, by `workers` processes or on the Dask cluster at `scheduler`; the lines are the same.

    Raises InputError and OutputError as `run_jobs` does, and InputError where there is no cluster.
    """
    work = RunWork(sweep.base, sweep.course)
    jobs = [
        run_job(candidate_key(number, candidate), tuple(sweep.space.overrides(candidate)), case)
        for number, candidate in enumerate(sweep.candidates)
        for case in sweep.course.cases
    ]
    executor: Executor
    if scheduler is not None:
        from navstack.tune.cluster import DaskExecutor

        executor = DaskExecutor(work, scheduler)
    else:
        executor = ProcessExecutor(work, workers)
    what = {**sweep.what, "space": sweep.space.described(), "parameters": work.parameters, "distro": work.distro}
    found = run_jobs(
        work, jobs, what=what, executor=executor, results=results, resume=resume, progress=progress, heard=heard
    )
    many = len(sweep.course.cases)
    return [
        SweptRun(i // many, sweep.candidates[i // many], sweep.course.cases[i % many].key, result)
        for i, result in enumerate(found)
    ]


def summary_of(runs: Sequence[SweptRun], cases: int) -> dict[str, Any]:
    """For JSON: each candidate with its means, the best score first; of equal ones, the first that was tried."""
    rows: list[dict[str, Any]] = []
    for first in range(0, len(runs), cases):
        mine = runs[first : first + cases]
        told = [r.result.value for r in mine if not r.result.failed]
        rows.append(
            {
                "candidate": mine[0].candidate,
                "values": dict(mine[0].values),
                "runs": len(told),
                "errors": len(mine) - len(told),
                "success": sum(bool(o["success"]) for o in told) / len(told) if told else 0.0,
                "score": sum(o["score"] for o in told) / len(told) if told else None,
                "time_s": _mean([o["time_s"] for o in told if o["success"]]),
            }
        )
    rows.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0.0), row["candidate"]))
    return {"candidates": len(rows), "runs": len(runs), "ranking": rows}


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None

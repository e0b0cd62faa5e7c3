"""A sweep: drives many candidates over all cases; one line of JSON per run, resumable, on this machine or a cluster."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from navstack.jobs import Executor, JobResult, ProcessExecutor, run_jobs
from navstack.parameters.configuration import Configuration
from navstack.tune.evaluation import Evaluation
from navstack.tune.space import Candidate, SearchSpace, Value
from navstack.tune.work import RunWork, run_job


@dataclass(frozen=True, slots=True)
class Sweep:
    """The runs of a sweep: every candidate over every case."""

    base: Configuration
    space: SearchSpace
    candidates: Sequence[Candidate]
    evaluation: Evaluation
    described: Mapping[str, Any]
    """Everything that affects the results except candidates and cases, for JSON: method, seed, names."""


@dataclass(frozen=True, slots=True)
class SweepRun:
    """The result of one run."""

    candidate: int
    values: Mapping[str, Value]
    case: str
    result: JobResult


def candidate_key(number: int, candidate: Candidate) -> str:
    """`17: sim_time=1.5 vx_samples=6`, so that a line of results is readable on its own."""
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
) -> list[SweepRun]:
    """Runs everything, with `workers` processes or on the Dask cluster at `scheduler`; the results are the same.

    Raises InputError and OutputError as `run_jobs` does, and InputError for an unreachable cluster.
    """
    work = RunWork(sweep.base, sweep.evaluation)
    cases = sweep.evaluation.cases
    jobs = [
        run_job(candidate_key(number, candidate), tuple(sweep.space.overrides(candidate)), case)
        for number, candidate in enumerate(sweep.candidates)
        for case in cases
    ]
    what = {**sweep.described, "space": sweep.space.described(), "parameters": work.parameters, "distro": work.distro}
    found = run_jobs(
        work,
        jobs,
        what=what,
        executor=_executor(work, workers, scheduler),
        results=results,
        resume=resume,
        progress=progress,
        on_result=on_result,
    )
    many = len(cases)
    return [
        SweepRun(i // many, sweep.candidates[i // many], cases[i % many].key, result) for i, result in enumerate(found)
    ]


def _executor(work: RunWork, workers: int | None, scheduler: str | None) -> Executor:
    if scheduler is None:
        return ProcessExecutor(work, workers)
    from navstack.tune.cluster import DaskExecutor

    return DaskExecutor(work, scheduler)


def summary_of(runs: Sequence[SweepRun], cases: int) -> dict[str, Any]:
    """For JSON: each candidate with its means, sorted by score; ties are in the order of the candidates."""
    rows = [_summary_row(runs[first : first + cases]) for first in range(0, len(runs), cases)]
    rows.sort(key=lambda row: (row["score"] is None, -(row["score"] or 0.0), row["candidate"]))
    return {"candidates": len(rows), "runs": len(runs), "ranking": rows}


def _summary_row(runs: Sequence[SweepRun]) -> dict[str, Any]:
    outcomes = [r.result.value for r in runs if not r.result.failed]
    return {
        "candidate": runs[0].candidate,
        "values": dict(runs[0].values),
        "runs": len(outcomes),
        "errors": len(runs) - len(outcomes),
        "success": sum(bool(o["success"]) for o in outcomes) / len(outcomes) if outcomes else 0.0,
        "score": sum(o["score"] for o in outcomes) / len(outcomes) if outcomes else None,
        "time_s": _mean([o["time_s"] for o in outcomes if o["success"]]),
    }


def _mean(values: Sequence[float]) -> float | None:
    return sum(values) / len(values) if values else None

"""The movingai problems as jobs, one per map and planner, and a table per planner."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.bench.movingai import Answer, Problem, build, read_problems, run, summary
from navstack.bench.table import Column, Table
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult

DEFAULT_PLANNERS: Final = ("astar", "theta_star")
_COLUMNS: Final = (
    Column("map", "map"),
    Column("problems", "problems"),
    Column("found", "found"),
    Column("optimal", "optimal"),
    Column("shorter", "shorter"),
    Column("worst_excess", "worst excess", 4),
    Column("mean_ratio", "mean ratio", 4),
    Column("median_expanded", "expanded", 0),
    Column("median_ms", "median (ms)"),
    Column("total_ms", "total (ms)", 0),
)


@dataclass(frozen=True)
class MovingaiTask:
    """Plans all problems of a map with a planner."""

    folder: Path

    def __call__(self, job_input: tuple[str, str]) -> list[list[float]]:
        """Plans, given (planner, map); [length (infinite: no path), expanded cells, time (ms)] of each problem, in order."""
        name, map_ = job_input
        problems = [p for p in read_problems(self.folder) if p.map == map_]
        return [[a.length, a.expanded, a.time_ms] for a in run(self.folder, build(name), problems)]


def movingai_jobs(folder: Path, planners: Sequence[str], maps: Sequence[str] = ()) -> list[Job]:
    """A job per planner and map; without `maps`, of all maps of the folder. Raises InputError, UnknownPluginError."""
    known = list(dict.fromkeys(p.map for p in read_problems(folder)))
    for name in maps:
        if name not in known:
            raise InputError(
                f'--map "{name}": {folder / "problems.tsv"} has no problems for this map; its maps: {", ".join(known)}',
                argument="--map",
                value=name,
            )
    for name in planners:
        build(name)
    return [Job(f"{planner} on {m}", (planner, m)) for planner in planners for m in maps or known]


def movingai_tables(folder: Path, results: Sequence[JobResult], jobs: Sequence[Job]) -> list[Table]:
    """A table per planner, with a row per map and one for all maps."""
    by_map: dict[str, list[Problem]] = {}
    for problem in read_problems(folder):
        by_map.setdefault(problem.map, []).append(problem)
    by_planner: dict[str, list[Answer]] = {}
    for result, job in zip(results, jobs, strict=True):
        planner, map_ = job.input
        answers = by_planner.setdefault(planner, [])
        if not result.failed:
            answers += [_answer(p, value) for p, value in zip(by_map[map_], result.value, strict=True)]
    return [Table(planner, _COLUMNS, summary(answers)) for planner, answers in by_planner.items()]


def _answer(problem: Problem, value: Sequence[Any]) -> Answer:
    length, expanded, time_ms = value
    return Answer(problem, math.inf if length is None else length, expanded, time_ms, np.empty((0, 2)))

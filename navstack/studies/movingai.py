"""N. Sturtevant's grid path finding benchmark (movingai.com): 8-connected shortest paths of known length.

A folder contains `maps/*.map` and `problems.tsv` (family, map, sx, sy, gx, gy, optimal). `.`, `G` and `S` are passable; x
counts columns, y rows from the top; a diagonal step costs sqrt 2 and needs both orthogonal neighbors.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, LETHAL, Costmap, GridGeometry, InputError, PlanningError, Pose2D, read_bytes
from navstack.plugins import GLOBAL_PLANNERS, GlobalPlanner
from navstack.studies.inputs import digest_of_file, read_csv
from navstack.studies.jobs import Job, JobResult
from navstack.studies.planners import reset_planner
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task

MAX_MAP_BYTES: Final = 100_000_000
"""Largest file of a map; the maps of the benchmark have up to 4 MB."""
PASSABLE: Final = b".GS"
TOLERANCE: Final = 0.006
"""Rounding of the published optima: a length within this tolerance is optimal."""


class Problem(NamedTuple):
    """One query, in the cells of the benchmark (y from the top)."""

    family: str
    map: str
    sx: int
    sy: int
    gx: int
    gy: int
    optimal: float


@dataclass(frozen=True, slots=True)
class Answer:
    """The plan of a problem."""

    problem: Problem
    length: float
    """In cells; infinite without a path."""
    expanded: int
    time_ms: float
    xy: NDArray[np.float64]
    """(n, 2) path in the cells of the benchmark, with centers at whole numbers."""


def read_problems(folder: Path) -> list[Problem]:
    """Return all problems of a folder. Raises InputError for a missing or invalid table."""
    file = folder / "problems.tsv"
    if not file.is_file():
        raise InputError(
            f"{folder} contains no problems.tsv; give the folder of the movingai benchmark", path=str(folder)
        )
    return read_csv(file, Problem._fields, _problem, delimiter="\t")


def _problem(r: Mapping[str, str]) -> Problem:
    return Problem(r["family"], r["map"], int(r["sx"]), int(r["sy"]), int(r["gx"]), int(r["gy"]), float(r["optimal"]))


def map_file(folder: Path, name: str) -> Path:
    """Return the file of a map."""
    return folder / "maps" / f"{name}.map"


def read_map(file: Path) -> NDArray[np.bool_]:
    """Return (height, width) passable cells, row 0 = the top. Raises InputError for an invalid file."""
    try:
        head, _, body = read_bytes(file, MAX_MAP_BYTES).replace(b"\r", b"").partition(b"\nmap\n")
        size = dict(line.split() for line in head.decode("ascii").splitlines())
        height, width = int(size["height"]), int(size["width"])
        rows = body.split(b"\n")[:height]
        cells = np.frombuffer(b"".join(rows), np.uint8).reshape(height, width)
    except (OSError, ValueError, KeyError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is not a map of the movingai benchmark ({error})", path=str(file)) from None
    return np.isin(cells, np.frombuffer(PASSABLE, np.uint8))


def as_costmap(passable: NDArray[np.bool_]) -> Costmap:
    """Free and lethal cells of 1 m; cell (x, y) of the benchmark has its center at (x + 0.5, height - y - 0.5)."""
    data = np.where(passable[::-1], np.uint8(FREE), np.uint8(LETHAL))
    return Costmap(GridGeometry(passable.shape[1], passable.shape[0], 1.0), np.ascontiguousarray(data))


def build(name: str, **params: Any) -> GlobalPlanner:
    """Return a planner that minimizes path length: costs of the costmap are ignored where the planner allows it.

    Raises UnknownPluginError for an unknown name.
    """
    entry = GLOBAL_PLANNERS.get(name)
    if {"neutral_cost", "cost_factor"} <= set(entry.cls.Params.model_fields) and name in ("astar", "theta_star"):
        params = {"neutral_cost": 1.0, "cost_factor": 0.0, **params}
    return entry.cls(entry.cls.Params(**params))


def solve(planner: GlobalPlanner, costmap: Costmap, problem: Problem) -> Answer:
    """Plan one problem and times `make_plan`."""
    height = costmap.geometry.ny
    start = Pose2D(problem.sx + 0.5, height - problem.sy - 0.5)
    goal = Pose2D(problem.gx + 0.5, height - problem.gy - 0.5)
    started = time.perf_counter()
    try:
        plan = planner.make_plan(costmap, start, goal)
    except PlanningError:
        return Answer(problem, math.inf, 0, (time.perf_counter() - started) * 1e3, np.empty((0, 2)))
    elapsed = (time.perf_counter() - started) * 1e3
    xy = plan.path.poses[:, :2] - 0.5
    xy[:, 1] = height - 1 - xy[:, 1]
    return Answer(problem, plan.path.length, plan.cells_expanded, elapsed, xy)


def run(folder: Path, planner: GlobalPlanner, problems: Iterable[Problem] | None = None) -> list[Answer]:
    """Plan the problems, by default all of the folder; each map is read once, in the order of the problems."""
    wanted = read_problems(folder) if problems is None else list(problems)
    maps: dict[str, Costmap] = {}
    answers: list[Answer] = []
    for problem in wanted:
        if problem.map not in maps:
            maps[problem.map] = as_costmap(read_map(map_file(folder, problem.map)))
            solve(planner, maps[problem.map], problem)  # untimed: allocates, and compiles on the first run
            reset_planner(planner)
        answers.append(solve(planner, maps[problem.map], problem))
    return answers


def summary(answers: Sequence[Answer]) -> list[dict[str, Any]]:
    """Return one row per map, in the order of the answers, and one for all: counts, excess length, expanded cells and times."""
    by_map: dict[str, list[Answer]] = {}
    for answer in answers:
        by_map.setdefault(answer.problem.map, []).append(answer)
    rows = [_statistics_of(name, group) for name, group in by_map.items()]
    return [*rows, _statistics_of("all", answers)] if answers else []


def _statistics_of(name: str, answers: Sequence[Answer]) -> dict[str, Any]:
    found = [a for a in answers if math.isfinite(a.length)]
    excess = [a.length - a.problem.optimal for a in found]
    ratios = [a.length / a.problem.optimal for a in found if a.problem.optimal > 0.0]
    return {
        "map": name,
        "problems": len(answers),
        "found": len(found),
        "optimal": sum(abs(e) <= TOLERANCE for e in excess),
        "shorter": sum(e < -TOLERANCE for e in excess),
        "worst_excess": max(excess, default=math.nan),
        "mean_ratio": sum(ratios) / len(ratios) if ratios else math.nan,
        "median_expanded": median(a.expanded for a in answers),
        "median_ms": median(a.time_ms for a in answers),
        "total_ms": sum(a.time_ms for a in answers),
    }


# --- the task ---------------------------------------------------------------------------------------------------------


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
class MovingaiTask(Task):
    """Plans all problems of a map with a planner."""

    folder: Path
    planners: tuple[str, ...] = DEFAULT_PLANNERS
    maps: tuple[str, ...] = ()
    """Empty: all maps of the folder."""

    def __call__(self, job_input: tuple[str, str], /) -> list[list[float]]:
        """Plan, given (planner, map); [length (infinite: no path), expanded cells, time (ms)] of each problem, in order."""
        name, map_ = job_input
        problems = [p for p in read_problems(self.folder) if p.map == map_]
        return [[a.length, a.expanded, a.time_ms] for a in run(self.folder, build(name), problems)]

    def described(self) -> dict[str, Any]:
        """Digests of the problems and the maps."""
        return {
            "bench": "movingai",
            "problems": digest_of_file(self.folder / "problems.tsv"),
            "maps": {name: digest_of_file(map_file(self.folder, name)) for name in self._maps()},
        }

    def jobs(self) -> list[Job]:
        """Return a job per planner and map. Raises InputError, UnknownPluginError."""
        maps = self._maps()
        for name in self.planners:
            build(name)
        return [Job(f"{planner} on {m}", (planner, m)) for planner in self.planners for m in maps]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return a table per planner, with a row per map and one for all maps."""
        by_map: dict[str, list[Problem]] = {}
        for problem in read_problems(self.folder):
            by_map.setdefault(problem.map, []).append(problem)
        by_planner: dict[str, list[Answer]] = {planner: [] for planner in self.planners}
        for (planner, map_), values in self.finished(results):
            by_planner[planner] += [_answer(p, value) for p, value in zip(by_map[map_], values, strict=True)]
        tables = [Table(planner, _COLUMNS, summary(answers)) for planner, answers in by_planner.items()]
        return Report(tables, {"planners": {table.title: table for table in tables}})

    def _maps(self) -> list[str]:
        known = list(dict.fromkeys(p.map for p in read_problems(self.folder)))
        for name in self.maps:
            if name not in known:
                raise InputError(
                    f'--map "{name}": {self.folder / "problems.tsv"} has no problems for this map; its maps: '
                    f"{', '.join(known)}",
                    argument="--map",
                    value=name,
                )
        return list(self.maps) or known


def _answer(problem: Problem, value: Sequence[Any]) -> Answer:
    length, expanded, time_ms = value
    return Answer(problem, math.inf if length is None else length, expanded, time_ms, np.empty((0, 2)))

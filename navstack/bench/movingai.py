"""N. Sturtevant's grid path finding benchmark (movingai.com): 8-connected shortest paths whose lengths are known.

A folder holds `maps/*.map` and `problems.tsv` (family, map, sx, sy, gx, gy, optimal). Passable are `.`, `G` and `S`; x counts
columns, y rows from the top; a diagonal step costs sqrt 2 and needs both orthogonal neighbours.
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

from navstack.bench.files import read_table
from navstack.bench.map_pairs import forget_plans
from navstack.core import FREE, LETHAL, Costmap, GridGeometry, Pose2D
from navstack.core.errors import InputError, PlanningError
from navstack.interfaces import GlobalPlanner
from navstack.plugins import GLOBAL_PLANNERS

PASSABLE: Final = b".GS"
TOLERANCE: Final = 0.006
"""The published optima are rounded: a length within this of them is optimal."""


class Problem(NamedTuple):
    """One query; cells as the benchmark counts them, y from the top."""

    family: str
    map: str
    sx: int
    sy: int
    gx: int
    gy: int
    optimal: float


@dataclass(frozen=True, slots=True)
class Answer:
    """What a planner made of a problem."""

    problem: Problem
    length: float
    """In cells; inf where it found none."""
    expanded: int
    time_ms: float
    xy: NDArray[np.float64]
    """(n, 2) the path in cells as the benchmark counts them, centres at whole numbers."""


def read_problems(folder: Path) -> list[Problem]:
    """All problems of a folder; raises InputError when it holds no table of them, or one that is wrong somewhere."""
    file = folder / "problems.tsv"
    if not file.is_file():
        raise InputError(f"{folder} holds no problems.tsv: give the folder of the movingai benchmark", path=str(folder))
    return read_table(file, Problem._fields, _problem, delimiter="\t")


def _problem(r: Mapping[str, str]) -> Problem:
    return Problem(r["family"], r["map"], int(r["sx"]), int(r["sy"]), int(r["gx"]), int(r["gy"]), float(r["optimal"]))


def map_file(folder: Path, name: str) -> Path:
    """Where a folder keeps the map of that name."""
    return folder / "maps" / f"{name}.map"


def read_map(file: Path) -> NDArray[np.bool_]:
    """(height, width) what is passable, row 0 = the top; raises InputError for a file that is no such map."""
    try:
        head, _, body = file.read_bytes().replace(b"\r", b"").partition(b"\nmap\n")
        size = dict(line.split() for line in head.decode("ascii").splitlines())
        height, width = int(size["height"]), int(size["width"])
        rows = body.split(b"\n")[:height]
        cells = np.frombuffer(b"".join(rows), np.uint8).reshape(height, width)
    except (OSError, ValueError, KeyError, UnicodeDecodeError) as error:
        raise InputError(f"{file} is no map of the movingai benchmark ({error})", path=str(file)) from None
    return np.isin(cells, np.frombuffer(PASSABLE, np.uint8))


def as_costmap(passable: NDArray[np.bool_]) -> Costmap:
    """Free and lethal cells of 1 m, the first row of the map uppermost; a cell's centre at x + 0.5, height - y - 0.5."""
    data = np.where(passable[::-1], np.uint8(FREE), np.uint8(LETHAL))
    return Costmap(GridGeometry(passable.shape[1], passable.shape[0], 1.0), np.ascontiguousarray(data))


def build(name: str, **params: Any) -> GlobalPlanner:
    """A planner that looks for the shortest path: for those that weigh the costmap's costs, without them.

    Raises UnknownPluginError for a name that is none.
    """
    entry = GLOBAL_PLANNERS.get(name)
    if {"neutral_cost", "cost_factor"} <= set(entry.cls.Params.model_fields) and name in ("astar", "theta_star"):
        params = {"neutral_cost": 1.0, "cost_factor": 0.0, **params}
    return entry.cls(entry.cls.Params(**params))


def solve(planner: GlobalPlanner, costmap: Costmap, problem: Problem) -> Answer:
    """Plans one problem; the time is that of `make_plan`."""
    height = costmap.geometry.ny
    start = Pose2D(problem.sx + 0.5, height - problem.sy - 0.5)
    goal = Pose2D(problem.gx + 0.5, height - problem.gy - 0.5)
    began = time.perf_counter()
    try:
        plan = planner.make_plan(costmap, start, goal)
    except PlanningError:
        return Answer(problem, math.inf, 0, (time.perf_counter() - began) * 1e3, np.empty((0, 2)))
    took = (time.perf_counter() - began) * 1e3
    xy = plan.path.poses[:, :2] - 0.5
    xy[:, 1] = height - 1 - xy[:, 1]
    return Answer(problem, plan.path.length, plan.cells_expanded, took, xy)


def run(folder: Path, planner: GlobalPlanner, problems: Iterable[Problem] | None = None) -> list[Answer]:
    """Plans all problems of a folder, or those given; each map is read once, in the order of the problems."""
    wanted = read_problems(folder) if problems is None else list(problems)
    maps: dict[str, Costmap] = {}
    answers: list[Answer] = []
    for problem in wanted:
        if problem.map not in maps:
            maps[problem.map] = as_costmap(read_map(map_file(folder, problem.map)))
            solve(planner, maps[problem.map], problem)  # allocates, and compiles on a first run: not to be timed
            forget_plans(planner)
        answers.append(solve(planner, maps[problem.map], problem))
    return answers


def summary(answers: Sequence[Answer]) -> list[dict[str, Any]]:
    """One row per map and one for all, in the order of the answers: problems, optimal ones, the excess, cells and times."""
    by_map: dict[str, list[Answer]] = {}
    for answer in answers:
        by_map.setdefault(answer.problem.map, []).append(answer)
    rows = [_row(name, group) for name, group in by_map.items()]
    return [*rows, _row("all", answers)] if answers else []


def _row(name: str, answers: Sequence[Answer]) -> dict[str, Any]:
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

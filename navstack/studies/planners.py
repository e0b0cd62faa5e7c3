"""Random reachable pairs on maps, for every planner: success, collisions, length, clearance and planning time."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.bringup import build_costmap
from navstack.core import (
    INSCRIBED,
    LETHAL,
    Costmap,
    Footprint,
    FrameTree,
    InputError,
    MapError,
    OccupancyGrid,
    PlanningError,
    Pose2D,
    Transform2D,
    exists,
    is_dir,
    read_bytes,
    resolved,
)
from navstack.map_io import MAX_BYTES as MAP_YAML_BYTES
from navstack.map_io import load_map
from navstack.parameters import Configuration, choose_global_planner, load_configuration
from navstack.plugins import GlobalPlanner, Plan
from navstack.studies.inputs import digest_of_configuration, digest_of_map, short_names
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table, mean_of
from navstack.studies.task import Report, Task

# --- pairs of poses ---------------------------------------------------------------------------------------------------


SEARCHING: Final = ("navfn", "global_planner", "astar", "theta_star")
"""Built-in planners that find every reachable goal; carrot_planner follows the straight line and may stop short."""
_POINTS_PER_CELL: Final = 20


@dataclass(frozen=True, slots=True)
class PairResult:
    """The plan of one planner for one pair. All numbers are NaN or 0 without a plan."""

    planner: str
    start: Pose2D
    goal: Pose2D
    error: str | None
    """Why planning failed; None if it succeeded."""
    blocked: int
    """Number of points of the path in blocked cells."""
    length_m: float = math.nan
    time_ms: float = math.nan
    cost: float = math.nan
    """In the unit of the planner."""
    clearance_m: float = math.nan
    expanded: int = 0


def costmap_of(configuration: Configuration, grid: OccupancyGrid) -> Costmap:
    """Return the global costmap without any sensor data: the map and its inflation."""
    frames = FrameTree()
    params = configuration.global_costmap.params
    frames.set_static(params.global_frame, params.robot_base_frame, Transform2D(0.0, 0.0, 0.0))
    costmap = build_costmap("global_costmap", configuration.global_costmap, frames, grid)
    costmap.update(0.0)
    return costmap.master


def reachable_pairs(costmap: Costmap, count: int, seed: int = 0) -> list[tuple[Pose2D, Pose2D]]:
    """Return random pairs of cells with a cost below 253 in the same 4-connected region, the border cells excluded.

    Poses are cell centers (m, in the costmap's frame) with a yaw in -3 .. 3 rad. Empty if no region has two cells.
    """
    from scipy import ndimage

    free = costmap.data < INSCRIBED
    free[[0, -1], :] = False
    free[:, [0, -1]] = False
    regions: NDArray[np.int32]
    regions, _ = ndimage.label(free)  # pyright: ignore[reportGeneralTypeIssues, reportAssignmentType, reportUnknownMemberType]
    sizes = np.bincount(regions.reshape(-1))
    starts = np.flatnonzero((regions.reshape(-1) > 0) & (sizes[regions.reshape(-1)] > 1))
    if len(starts) == 0:
        return []
    rng = np.random.default_rng(seed)
    nx = costmap.geometry.nx
    pairs: list[tuple[Pose2D, Pose2D]] = []
    for _ in range(count):
        a = int(rng.choice(starts))
        b = int(rng.choice(np.flatnonzero(regions.reshape(-1) == regions.reshape(-1)[a])))
        start, goal = (
            Pose2D(*costmap.geometry.cell_to_world(k % nx, k // nx), float(rng.uniform(-3, 3))) for k in (a, b)
        )
        pairs.append((start, goal))
    return pairs


def blocked_points(plan: Plan, costmap: Costmap, *, corners: bool) -> int:
    """Return the number of points of the path, sampled 20 per cell, in cells of cost 253 or 254 or outside the costmap.

    `corners`: the poses are lower left corners of cells, as for navfn. Points on the edge between cells are ignored.
    """
    g = costmap.geometry
    xy = (plan.path.poses[:, :2] - (g.origin_x, g.origin_y)) / g.resolution
    if corners:
        xy = xy[:-1] + 0.5  # the last pose is the goal itself
    pieces = [xy[:1]]
    for a, b in pairwise(xy):
        n = max(1, int(np.ceil(np.hypot(*(b - a)) * _POINTS_PER_CELL)))
        pieces.append(a + (b - a) * (np.arange(1, n + 1) / n)[:, None])
    points = np.concatenate(pieces)
    points = points[np.abs(points - np.rint(points)).min(axis=1) > 1e-6]
    cells = np.floor(points).astype(np.int64)
    inside = (cells >= 0).all(axis=1) & (cells < (g.nx, g.ny)).all(axis=1)
    costs = costmap.data[cells[inside, 1], cells[inside, 0]]
    return int((~inside).sum() + ((costs == INSCRIBED) | (costs == LETHAL)).sum())


def reset_planner(planner: GlobalPlanner) -> None:
    """Clear the caches of a planner, so that it makes the next plan from scratch."""
    reset = getattr(planner, "reset", None)
    if reset is not None:
        reset()


def run_pairs(
    planners: Mapping[str, GlobalPlanner],
    costmap: Costmap,
    pairs: Sequence[tuple[Pose2D, Pose2D]],
    *,
    footprint: Footprint | None = None,
) -> list[PairResult]:
    """Plan every pair with every planner, from scratch.

    `time_ms` is the wall time of `make_plan`, after an untimed first plan.
    """
    results: list[PairResult] = []
    for name, planner in planners.items():
        for start, goal in pairs[:1]:  # untimed: allocates, and compiles on the first run
            with suppress(PlanningError):
                planner.make_plan(costmap, start, goal, footprint=footprint)
        for start, goal in pairs:
            reset_planner(planner)
            started = time.perf_counter()
            try:
                plan = planner.make_plan(costmap, start, goal, footprint=footprint)
            except PlanningError as error:
                results.append(PairResult(name, start, goal, str(error), 0))
                continue
            elapsed = (time.perf_counter() - started) * 1e3
            results.append(
                PairResult(
                    planner=name,
                    start=start,
                    goal=goal,
                    error=None,
                    blocked=blocked_points(plan, costmap, corners=name == "navfn"),
                    length_m=plan.length_m,
                    time_ms=elapsed,
                    cost=plan.cost,
                    clearance_m=plan.clearance_m(costmap),
                    expanded=plan.cells_expanded,
                )
            )
    return results


_COLUMNS: Final = (
    Column("planner", "planner"),
    Column("pairs", "pairs"),
    Column("found", "found"),
    Column("in_collision", "in collision"),
    Column("length_m", "length (m)"),
    Column("cost", "cost, planner's unit", 0),
    Column("clearance_m", "clearance (m)"),
    Column("least_clearance_m", "minimum (m)"),
    Column("expanded", "expanded", 0),
    Column("p50_ms", "p50 (ms)"),
    Column("p95_ms", "p95 (ms)"),
    Column("p99_ms", "p99 (ms)"),
)


@dataclass(frozen=True)
class PlannersTask(Task):
    """Plans every pair of a map with a planner; the attributes are common to all jobs."""

    params: tuple[str, ...]
    overrides: tuple[str, ...]
    pairs: int
    seed: int
    files: Mapping[str, Path]
    """The maps by name."""
    planners: tuple[str, ...] = SEARCHING
    """Names as the parameters or the registry have them."""
    unreadable: tuple[str, ...] = ()
    """Errors of maps that were skipped."""
    _loaded: dict[str, Configuration] = field(default_factory=dict[str, Configuration], compare=False, repr=False)

    @property
    def configuration(self) -> Configuration:
        """The robot's parameters, read once per process. Raises ParameterError."""
        if "configuration" not in self._loaded:
            self._loaded["configuration"] = load_configuration(self.params, overrides=self.overrides)
        return self._loaded["configuration"]

    def described(self) -> dict[str, Any]:
        """Parameters, pairs and maps."""
        return {
            "bench": "planners",
            "params": short_names(self.params),
            "set": list(self.overrides),
            "parameters": digest_of_configuration(self.configuration),
            "pairs": self.pairs,
            "seed": self.seed,
            "maps": {name: digest_of_map(load_map(file)) for name, file in self.files.items()},
        }

    def __call__(self, job_input: tuple[str, str], /) -> list[dict[str, Any]]:
        """Plan every pair, given (file of the map, name of the planner); a result per pair."""
        file, name = job_input
        costmap = costmap_of(self.configuration, load_map(Path(file)))
        pairs = reachable_pairs(costmap, self.pairs, self.seed)
        choice = choose_global_planner(self.configuration, name)
        footprint = self.configuration.global_costmap.footprint
        results = run_pairs({choice.name: choice.cls(choice.params)}, costmap, pairs, footprint=footprint)
        return [{**asdict(r), "start": list(r.start), "goal": list(r.goal)} for r in results]

    def jobs(self) -> list[Job]:
        """Return a job per map and planner. Raises UnknownPluginError."""
        names = dict.fromkeys(choose_global_planner(self.configuration, name).name for name in self.planners)
        return [
            Job(f"{planner} on {name}", (str(file), planner)) for name, file in self.files.items() for planner in names
        ]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return a row per map and planner and, for several maps, one per planner; not passed for a bad map, pair or path."""
        plans = dict(self.finished(results))
        tables = _tables(self.files, plans)
        empty = {file for (file, _), found in plans.items() if not found}
        notes = [
            *(f"skipped an unreadable map: {message}" for message in self.unreadable),
            *(
                f"{name} has no row: the robot has no two connected poses on it"
                for name, file in self.files.items()
                if str(file) in empty
            ),
        ]
        document = {
            "rows": tables[0],
            "all_maps": tables[-1] if len(tables) > 1 else None,
            "plans": {result.key: result.value for result in results if not result.failed},
            "unreadable": list(self.unreadable),
        }
        safe = not any(row["found"] < row["pairs"] or row["in_collision"] for row in tables[0].rows)
        return Report(tables, document, notes, safe and not self.unreadable)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


# --- maps -------------------------------------------------------------------------------------------------------------


def map_files(names: Sequence[str]) -> tuple[dict[str, Path], list[str]]:
    """Map by name of packaged ones, files, or folders searched recursively for map YAML files.

    Returns a short name for each file, and the errors of maps in folders that cannot be read, which are skipped. Raises
    MapError for an unreadable map that was named itself, InputError for an unknown name and a folder without maps.
    """
    files: list[Path] = []
    errors: list[str] = []
    for name in names:
        if is_dir(Path(name)):
            for file in _maps_in(Path(name)):
                try:
                    load_map(file)
                except MapError as error:
                    errors.append(error.message)
                else:
                    files.append(file)
        else:
            files.append(_map_file(name))
    if not files:
        raise InputError(f"no map can be read: {'; '.join(errors)}", argument="MAP")
    choices = {file: _names(file) for file in dict.fromkeys(resolved(f) for f in files)}
    taken = Counter(name for names in choices.values() for name in names)
    return {next(n for n in names if taken[n] == 1): file for file, names in choices.items()}, errors


def _maps_in(folder: Path) -> list[Path]:
    found = [f for f in sorted(folder.rglob("*")) if _is_map(f)]
    if not found:
        raise InputError(f"{folder} contains no map YAML file (one with `image:`)", argument="MAP", value=str(folder))
    return found


def _map_file(name: str) -> Path:
    """Return the file of a map that was named itself. Raises MapError, InputError."""
    from navstack.map_io import map_names, map_path

    path = Path(name)
    if exists(path) or path.suffix or path.parent != Path():
        load_map(path)
        return path
    if name in map_names():
        return map_path(name)
    raise InputError(
        f'no file and no packaged map is named "{name}"; packaged: {", ".join(map_names())}',
        argument="MAP",
        value=name,
    )


def _names(file: Path) -> list[str]:
    """Return possible names of a map in a table, the shortest first; the full path is always unique."""
    short = file.stem if file.stem != "map" else file.parent.name
    return [short, f"{file.parent.name}/{file.stem}", str(file)]


def _is_map(file: Path) -> bool:
    """Return True for a YAML file with a key `image`, valid or not."""
    if file.suffix not in (".yaml", ".yml") or not file.is_file():
        return False
    try:
        text = read_bytes(file, MAP_YAML_BYTES).decode("utf-8", "replace")
    except OSError:
        return False
    return any(line.partition(":")[0].rstrip() == "image" for line in text.splitlines())


# --- results -----------------------------------------------------------------------------------------------------------


def _tables(files: Mapping[str, Path], found: Mapping[tuple[str, str], list[Mapping[str, Any]]]) -> list[Table]:
    planners = list(dict.fromkeys(planner for _, planner in found))
    rows: list[dict[str, Any]] = []
    everywhere: dict[str, list[tuple[Mapping[str, Any], bool]]] = {p: [] for p in planners}
    maps = {name: str(f) for name, f in files.items() if any(found.get((str(f), p)) for p in planners)}
    for name, file in maps.items():
        of_map = {p: found[file, p] for p in planners if (file, p) in found}
        # path lengths are comparable only for pairs that every planner found
        shared = [all(one["error"] is None for one in pair) for pair in zip(*of_map.values(), strict=True)]
        for planner, plans in of_map.items():
            marked = list(zip(plans, shared, strict=True))
            rows.append({"map": name, **_statistics_of(planner, marked)})
            everywhere[planner] += marked
    tables = [Table("plans between random reachable pairs", (Column("map", "map"), *_COLUMNS), rows)]
    if len(maps) > 1:
        tables.append(Table("all maps", _COLUMNS, [_statistics_of(p, marked) for p, marked in everywhere.items()]))
    return tables


def _statistics_of(planner: str, marked: Sequence[tuple[Mapping[str, Any], bool]]) -> dict[str, Any]:
    """`marked`: plans, and whether every planner found the pair."""
    found = [plan for plan, _ in marked if plan["error"] is None]
    times = [plan["time_ms"] for plan in found]
    p50, p95, p99 = np.percentile(times, [50, 95, 99]).tolist() if times else [float("nan")] * 3
    clearances = [plan["clearance_m"] for plan in found if plan["clearance_m"] is not None]
    return {
        "planner": planner,
        "pairs": len(marked),
        "found": len(found),
        "in_collision": sum(plan["blocked"] > 0 for plan in found),
        "length_m": mean_of([plan["length_m"] for plan, shared in marked if shared]),
        "cost": mean_of([plan["cost"] for plan in found]),
        "clearance_m": mean_of(clearances),
        "least_clearance_m": min(clearances, default=float("nan")),
        "expanded": mean_of([plan["expanded"] for plan in found]),
        "p50_ms": p50,
        "p95_ms": p95,
        "p99_ms": p99,
    }

"""Random reachable pairs on maps, every planner: found, free of collision, how long, how far from walls, how quick."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.bench.map_pairs import costmap_of, reachable_pairs, run_pairs
from navstack.bench.table import Column, Table
from navstack.core.errors import InputError, MapError
from navstack.core.files import exists, is_dir
from navstack.jobs import Job, JobResult
from navstack.map_io import load_map
from navstack.parameters.configuration import Configuration, choose_global_planner, load_configuration

ALL_MAPS: Final = "all"


@dataclass(frozen=True)
class PlannersTask:
    """What all jobs have in common; called with a map's file and a planner's name, plans every pair."""

    params: tuple[str, ...]
    overrides: tuple[str, ...]
    pairs: int
    seed: int
    _loaded: dict[str, Configuration] = field(default_factory=dict[str, Configuration], compare=False, repr=False)

    @property
    def configuration(self) -> Configuration:
        """The robot, read once per process. Raises ParameterError."""
        if "it" not in self._loaded:
            self._loaded["it"] = load_configuration(self.params, overrides=self.overrides)
        return self._loaded["it"]

    def __call__(self, asked: tuple[str, str]) -> list[dict[str, Any]]:
        """What the planner made of each pair."""
        file, name = asked
        costmap = costmap_of(self.configuration, load_map(Path(file)))
        pairs = reachable_pairs(costmap, self.pairs, self.seed)
        choice = choose_global_planner(self.configuration, name)
        footprint = self.configuration.global_costmap.footprint
        results = run_pairs({choice.name: choice.cls(choice.params)}, costmap, pairs, footprint=footprint)
        return [
            {
                "start": list(r.start),
                "goal": list(r.goal),
                "error": r.error,
                "blocked": r.blocked,
                "length_m": r.length_m,
                "cost": r.cost,
                "clearance_m": r.clearance_m,
                "expanded": r.expanded,
                "time_ms": r.time_ms,
            }
            for r in results
        ]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


def map_files(names: Sequence[str]) -> tuple[dict[str, Path], list[str]]:
    """Maps by name of packaged ones, files, or folders with YAML files somewhere in them.

    Returns a short name for each file, and what is wrong with those in folders that cannot be read, which are left out.
    Raises MapError for one that was named itself, InputError for a name that is none and a folder without a single map.
    """
    from navstack.map_io import map_names, map_path

    files: list[Path] = []
    wrong: list[str] = []
    for name in names:
        path = Path(name)
        if is_dir(path):
            inside = [f for f in sorted(path.rglob("*")) if _is_map(f)]
            if not inside:
                raise InputError(f"{path} holds no map's YAML (one with `image:`)", argument="MAP", value=name)
            for file in inside:
                try:
                    load_map(file)
                except MapError as error:
                    wrong.append(error.message)
                else:
                    files.append(file)
        elif exists(path) or path.suffix or path.parent != Path():
            load_map(path)
            files.append(path)
        elif name in map_names():
            files.append(map_path(name))
        else:
            raise InputError(
                f'there is no file and no packaged map "{name}"; packaged: {", ".join(map_names())}',
                argument="MAP",
                value=name,
            )
    if not files:
        raise InputError(f"there is no map that can be read: {'; '.join(wrong)}", argument="MAP")
    choices = {file: _names(file) for file in dict.fromkeys(f.resolve() for f in files)}
    taken = Counter(name for names in choices.values() for name in names)
    return {next(n for n in names if taken[n] == 1): file for file, names in choices.items()}, wrong


def _names(file: Path) -> list[str]:
    """What a map may be called in a table, the shortest first; its path is its own in any case."""
    short = file.stem if file.stem != "map" else file.parent.name
    return [short, f"{file.parent.name}/{file.stem}", str(file)]


def _is_map(file: Path) -> bool:
    """True for a YAML file with an `image:`; whether it is in order is another question."""
    if file.suffix not in (".yaml", ".yml") or not file.is_file():
        return False
    text = file.read_text(encoding="utf-8", errors="replace")
    return any(line.partition(":")[0].rstrip() == "image" for line in text.splitlines())


def planners_jobs(files: Mapping[str, Path], planners: Sequence[str]) -> list[Job]:
    """A job per map and planner."""
    return [Job(f"{planner} on {name}", (str(file), planner)) for name, file in files.items() for planner in planners]


def planners_tables(files: Mapping[str, Path], results: Sequence[JobResult], jobs: Sequence[Job]) -> list[Table]:
    """A table with a row per map and planner, and with several maps one with a row per planner.

    A map on which the robot finds no two poses to drive between has no row (`maps_without_pairs` names it).
    """
    names = {str(file): name for name, file in files.items()}
    told: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for result, job in zip(results, jobs, strict=True):
        file, planner = job.input
        if not result.failed:
            told[names[file], planner] = result.value
    planners = list(dict.fromkeys(planner for _, planner in told))
    maps = [m for m in files if any(told.get((m, p)) for p in planners)]
    rows: list[dict[str, Any]] = []
    everywhere: dict[str, list[tuple[Mapping[str, Any], bool]]] = {p: [] for p in planners}
    for m in maps:
        of_map = {p: told[m, p] for p in planners if (m, p) in told}
        # lengths of plans are comparable between planners where all have one
        shared = [all(one["error"] is None for one in pair) for pair in zip(*of_map.values(), strict=True)]
        for planner, answers in of_map.items():
            marked = list(zip(answers, shared, strict=True))
            rows.append({"map": m, **_row(planner, marked)})
            everywhere[planner] += marked
    tables = [Table("plans between random reachable pairs", (Column("map", "map"), *_COLUMNS), rows)]
    if len(maps) > 1:
        tables.append(Table("on all maps", _COLUMNS, [_row(p, marked) for p, marked in everywhere.items()]))
    return tables


def maps_without_pairs(files: Mapping[str, Path], results: Sequence[JobResult], jobs: Sequence[Job]) -> list[str]:
    """The maps on which the robot finds no two poses that a plan could join."""
    empty = {job.input[0] for result, job in zip(results, jobs, strict=True) if not result.failed and not result.value}
    return [name for name, file in files.items() if str(file) in empty]


def _row(planner: str, marked: Sequence[tuple[Mapping[str, Any], bool]]) -> dict[str, Any]:
    found = [a for a, _ in marked if a["error"] is None]
    times = [a["time_ms"] for a in found]
    p50, p95, p99 = np.percentile(times, [50, 95, 99]).tolist() if times else [math.nan] * 3
    clearances = [a["clearance_m"] for a in found if a["clearance_m"] is not None]
    return {
        "planner": planner,
        "pairs": len(marked),
        "found": len(found),
        "in_collision": sum(a["blocked"] > 0 for a in found),
        "length_m": _mean([a["length_m"] for a, shared in marked if shared]),
        "cost": _mean([a["cost"] for a in found]),
        "clearance_m": _mean(clearances),
        "least_clearance_m": min(clearances, default=math.nan),
        "expanded": _mean([a["expanded"] for a in found]),
        "p50_ms": p50,
        "p95_ms": p95,
        "p99_ms": p99,
    }


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


_COLUMNS: Final = (
    Column("planner", "planner"),
    Column("pairs", "pairs"),
    Column("found", "found"),
    Column("in_collision", "in collision"),
    Column("length_m", "length (m)"),
    Column("cost", "cost, its own unit", 0),
    Column("clearance_m", "clearance (m)"),
    Column("least_clearance_m", "least (m)"),
    Column("expanded", "expanded", 0),
    Column("p50_ms", "p50 (ms)"),
    Column("p95_ms", "p95 (ms)"),
    Column("p99_ms", "p99 (ms)"),
)

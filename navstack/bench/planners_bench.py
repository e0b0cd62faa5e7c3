"""Random reachable pairs on maps, for every planner: success, collisions, length, clearance and planning time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.bench.digests import digest_of_configuration, digest_of_map, short_names
from navstack.bench.map_pairs import costmap_of, reachable_pairs, run_pairs
from navstack.bench.table import Column, Table, mean_of
from navstack.core.bounded_reading import read_bytes
from navstack.core.errors import InputError, MapError
from navstack.core.files import exists, is_dir, resolved
from navstack.jobs import Job, JobResult
from navstack.map_io import MAX_BYTES as MAP_YAML_BYTES
from navstack.map_io import load_map
from navstack.parameters.configuration import Configuration, choose_global_planner, load_configuration

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
class PlannersTask:
    """Plans every pair of a map with a planner; the attributes are common to all jobs."""

    params: tuple[str, ...]
    overrides: tuple[str, ...]
    pairs: int
    seed: int
    _loaded: dict[str, Configuration] = field(default_factory=dict[str, Configuration], compare=False, repr=False)

    @property
    def configuration(self) -> Configuration:
        """The robot's parameters, read once per process. Raises ParameterError."""
        if "configuration" not in self._loaded:
            self._loaded["configuration"] = load_configuration(self.params, overrides=self.overrides)
        return self._loaded["configuration"]

    def described(self, files: Mapping[str, Path]) -> dict[str, Any]:
        """Everything that affects the plans on these maps."""
        return {
            "bench": "planners",
            "params": short_names(self.params),
            "set": list(self.overrides),
            "parameters": digest_of_configuration(self.configuration),
            "pairs": self.pairs,
            "seed": self.seed,
            "maps": {name: digest_of_map(load_map(file)) for name, file in files.items()},
        }

    def __call__(self, job_input: tuple[str, str]) -> list[dict[str, Any]]:
        """Plans every pair, given (file of the map, name of the planner); a result per pair."""
        file, name = job_input
        costmap = costmap_of(self.configuration, load_map(Path(file)))
        pairs = reachable_pairs(costmap, self.pairs, self.seed)
        choice = choose_global_planner(self.configuration, name)
        footprint = self.configuration.global_costmap.footprint
        results = run_pairs({choice.name: choice.cls(choice.params)}, costmap, pairs, footprint=footprint)
        return [{**asdict(r), "start": list(r.start), "goal": list(r.goal)} for r in results]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


# --- maps -------------------------------------------------------------------------------------------------------------


def map_files(names: Sequence[str]) -> tuple[dict[str, Path], list[str]]:
    """Maps by name of packaged ones, files, or folders searched recursively for map YAML files.

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
    """The file of a map that was named itself. Raises MapError, InputError."""
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
    """Possible names of a map in a table, the shortest first; the full path is always unique."""
    short = file.stem if file.stem != "map" else file.parent.name
    return [short, f"{file.parent.name}/{file.stem}", str(file)]


def _is_map(file: Path) -> bool:
    """True for a YAML file with a key `image`, valid or not."""
    if file.suffix not in (".yaml", ".yml") or not file.is_file():
        return False
    try:
        text = read_bytes(file, MAP_YAML_BYTES).decode("utf-8", "replace")
    except OSError:
        return False
    return any(line.partition(":")[0].rstrip() == "image" for line in text.splitlines())


# --- results ----------------------------------------------------------------------------------------------------------


def planners_jobs(files: Mapping[str, Path], planners: Sequence[str]) -> list[Job]:
    """A job per map and planner."""
    return [Job(f"{planner} on {name}", (str(file), planner)) for name, file in files.items() for planner in planners]


@dataclass(frozen=True, slots=True)
class PlannersReport:
    """The results of a benchmark."""

    tables: list[Table]
    """A table with a row per map and planner and, for several maps, one with a row per planner."""
    plans: Mapping[str, Any]
    """The results of all pairs, by the key of the job."""
    unreadable: list[str]
    """Errors of maps that were skipped."""
    without_pairs: list[str]
    """Maps without two poses that a plan could connect; they have no row."""

    @property
    def notes(self) -> list[str]:
        """Remarks on the results."""
        return [
            *(f"skipped an unreadable map: {message}" for message in self.unreadable),
            *(f"{name} has no row: the robot has no two connected poses on it" for name in self.without_pairs),
        ]

    @property
    def all_safe(self) -> bool:
        """True if every planner found every pair and no path crosses a blocked cell."""
        return not any(row["found"] < row["pairs"] or row["in_collision"] for row in self.tables[0].rows)

    def document(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "rows": self.tables[0],
            "all_maps": self.tables[-1] if len(self.tables) > 1 else None,
            "plans": self.plans,
            "unreadable": self.unreadable,
        }


def planners_report(
    files: Mapping[str, Path], unreadable: list[str], results: Sequence[JobResult], jobs: Sequence[Job]
) -> PlannersReport:
    """Collects the results of `planners_jobs`."""
    finished = [(r, job) for r, job in zip(results, jobs, strict=True) if not r.failed]
    empty = {job.input[0] for r, job in finished if not r.value}
    return PlannersReport(
        tables=_tables(files, {(job.input[0], job.input[1]): r.value for r, job in finished}),
        plans={r.key: r.value for r, _ in finished},
        unreadable=unreadable,
        without_pairs=[name for name, file in files.items() if str(file) in empty],
    )


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
            rows.append({"map": name, **_row(planner, marked)})
            everywhere[planner] += marked
    tables = [Table("plans between random reachable pairs", (Column("map", "map"), *_COLUMNS), rows)]
    if len(maps) > 1:
        tables.append(Table("all maps", _COLUMNS, [_row(p, marked) for p, marked in everywhere.items()]))
    return tables


def _row(planner: str, marked: Sequence[tuple[Mapping[str, Any], bool]]) -> dict[str, Any]:
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

"""BARN over many worlds and seeds: jobs, tables with confidence intervals, and what the C++ stack did beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from navstack.bench.barn import BarnOutcome, BarnWorld, barn_configuration, load_worlds, run_world
from navstack.bench.files import digest_of_configuration, digest_of_file, read_table, short_names
from navstack.bench.table import Column, Table
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.parameters.configuration import Configuration
from navstack.scenario.suites.barn_worlds import WORLDS_FILE
from navstack.statistics import (
    Difference,
    mean,
    paired_difference,
    paired_share_difference,
    rank_correlation,
    share,
)

CPP_FILE: Final = "cpp_results.csv"
CPP: Final = "C++"


@dataclass(frozen=True)
class BarnTask:
    """What all runs of a bench have in common; called with a world's number and a seed, it drives."""

    folder: Path
    params: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    distro: str | None = None
    rough: bool = False
    noise_m: float | None = None
    """Standard deviation of the lidar's ranges, when it is another than that of the simulator."""
    records: Path | None = None
    """Where runs that fail leave their records."""
    _loaded: dict[str, Any] = field(default_factory=dict[str, Any], compare=False, repr=False)
    """Read once per process."""

    @property
    def worlds(self) -> dict[int, BarnWorld]:
        """All worlds of the folder, by number. Raises InputError."""
        if "worlds" not in self._loaded:
            self._loaded["worlds"] = {w.number: w for w in load_worlds(self.folder / WORLDS_FILE)}
        return self._loaded["worlds"]

    @property
    def configuration(self) -> Configuration:
        """The robot. Raises ParameterError."""
        if "configuration" not in self._loaded:
            self._loaded["configuration"] = barn_configuration(
                self.params, distro=self.distro, rough=self.rough, noise_m=self.noise_m, overrides=self.overrides
            )
        return self._loaded["configuration"]

    def described(self) -> dict[str, Any]:
        """What shapes the outcomes, beyond world and seed."""
        return {
            "bench": "barn",
            "params": short_names(self.params),
            "set": list(self.overrides),
            "distro": self.configuration.navstack.ros_distro,
            "rough": self.rough,
            "noise_m": self.noise_m,
            "parameters": digest_of_configuration(self.configuration),
            "worlds": digest_of_file(self.folder / WORLDS_FILE),
        }

    def __call__(self, asked: tuple[int, int]) -> dict[str, Any]:
        """Drives through world `asked[0]` with seed `asked[1]`; the outcome by name."""
        number, seed = asked
        wanted = self.records is not None
        outcome, recorder = run_world(self.worlds[number], self.configuration, seed=seed, record=wanted)
        if recorder is not None and self.records is not None and not outcome.succeeded:
            recorder.save(self.records / f"world_{number}_seed_{seed}")
        return asdict(outcome)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


def barn_jobs(task: BarnTask, worlds: Sequence[int] | None, seeds: int) -> list[Job]:
    """A job per world and seed, seed by seed; all worlds of the folder unless given. Raises InputError."""
    known = task.worlds
    wanted = list(known) if worlds is None else list(dict.fromkeys(worlds))
    missing = [w for w in wanted if w not in known]
    if missing:
        raise InputError(
            f"--worlds: there is no world {missing[0]} in {task.folder}; there are {', '.join(map(str, known))}",
            argument="--worlds",
            value=missing[0],
        )
    return [Job(f"world {w} seed {s}", (w, s)) for s in range(seeds) for w in wanted]


@dataclass(frozen=True, slots=True)
class BarnReport:
    """What a bench comes to."""

    outcomes: list[BarnOutcome]
    seeds: list[int]
    """Of each outcome."""
    worlds: Table
    """One row per world."""
    totals: Table
    """One row for navstack and, where C++'s results are there, one for C++."""
    cpp: dict[int, Mapping[str, Any]]
    against_cpp: Table | None
    """Paired differences and rank correlations, per world; None without C++'s results."""
    failed: list[JobResult]
    """Runs that gave no outcome at all."""

    @property
    def all_seeds_alike(self) -> bool:
        """True when several seeds gave the same run in every world: nothing in it is random."""
        by_world: dict[int, set[BarnOutcome]] = {}
        for outcome in self.outcomes:
            by_world.setdefault(outcome.world, set()).add(outcome)
        return len(set(self.seeds)) > 1 and all(len(runs) == 1 for runs in by_world.values())


def barn_report(task: BarnTask, results: Sequence[JobResult], jobs: Sequence[Job]) -> BarnReport:
    """Puts the results of `barn_jobs` together, beside `cpp_results.csv` where the folder holds it."""
    good = [(_outcome_of(r.value), job.input[1]) for r, job in zip(results, jobs, strict=True) if not r.failed]
    outcomes, seeds = [o for o, _ in good], [s for _, s in good]
    numbers = list(dict.fromkeys(o.world for o in outcomes))
    cpp = {w: row for w, row in read_cpp(task.folder / CPP_FILE).items() if w in numbers}
    rows = [_world_row(task.worlds[w], [o for o in outcomes if o.world == w], cpp.get(w)) for w in numbers]
    totals = [_total("navstack", outcomes)]
    against = None
    if cpp:
        totals.append(_total(CPP, [_as_outcome(w, row) for w, row in cpp.items()]))
        against = _against(rows, outcomes, cpp)
    return BarnReport(
        outcomes=outcomes,
        seeds=seeds,
        worlds=Table("worlds", _WORLD if cpp else _WORLD[:-3], rows),
        totals=Table("totals, with 95 % confidence intervals over worlds", _TOTAL, totals),
        cpp=cpp,
        against_cpp=against,
        failed=[r for r in results if r.failed],
    )


def _outcome_of(told: Mapping[str, Any]) -> BarnOutcome:
    """Back from JSON, which has no infinity: the clearance in a world without cylinders."""
    outcome = BarnOutcome(**told)
    return outcome if told["clearance_m"] is not None else replace(outcome, clearance_m=math.inf)


def read_cpp(file: Path) -> dict[int, Mapping[str, Any]]:
    """C++'s results by world: outcome, time_s, length_m, clearance_m, score; empty without the file. Raises InputError."""
    if not file.is_file():
        return {}
    return dict(read_table(file, ("world", "outcome", "AT", "length", "clearance", "score"), _cpp_row))


def _cpp_row(row: Mapping[str, str]) -> tuple[int, Mapping[str, Any]]:
    told = {
        "outcome": row["outcome"],
        "time_s": float(row["AT"]),
        "length_m": float(row["length"]),
        "clearance_m": float(row["clearance"]),
        "score": float(row["score"]),
    }
    return int(row["world"]), told


_WORLD: Final = (
    Column("world", "world"),
    Column("runs", "runs"),
    Column("success", "success"),
    Column("collision", "contact"),
    Column("other", "other"),
    Column("time_s", "time (s)", 1),
    Column("length_m", "length (m)"),
    Column("clearance_m", "clearance (m)", 3),
    Column("turning_s", "turning (s)", 1),
    Column("score", "score", 4),
    Column("cpp_outcome", "C++"),
    Column("cpp_time_s", "C++ (s)", 1),
    Column("cpp_score", "C++ score", 4),
)
_TOTAL: Final = (
    Column("stack", "stack"),
    Column("runs", "runs"),
    Column("success", "success", 3),
    Column("collision", "contact", 3),
    Column("other", "other", 3),
    Column("time_s", "time of successes (s)", 1),
    Column("score", "score", 4),
)
_AGAINST: Final = (
    Column("what", "navstack against C++, by world"),
    Column("worlds", "worlds"),
    Column("difference", "difference", 3),
    Column("verdict", "verdict"),
    Column("rank_correlation", "rank correlation"),
)


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


def _world_row(world: BarnWorld, outcomes: Sequence[BarnOutcome], cpp: Mapping[str, Any] | None) -> dict[str, Any]:
    won = [o for o in outcomes if o.succeeded]
    row: dict[str, Any] = {
        "world": world.number,
        "optimal_time_s": world.optimal_time_s,
        "runs": len(outcomes),
        "success": len(won),
        "collision": sum(o.outcome == "collision" for o in outcomes),
        "other": sum(o.outcome not in ("success", "collision") for o in outcomes),
        "time_s": _mean([o.time_s for o in won]),
        "length_m": _mean([o.length_m for o in won]),
        "clearance_m": min(o.clearance_m for o in outcomes),
        "turning_s": _mean([o.turning_s for o in outcomes]),
        "score": _mean([o.score for o in outcomes]),
    }
    if cpp is not None:
        row |= {"cpp_outcome": cpp["outcome"], "cpp_score": cpp["score"]}
        row["cpp_time_s"] = cpp["time_s"] if cpp["outcome"] == "success" else None
    return row


def _total(stack: str, outcomes: Sequence[BarnOutcome]) -> dict[str, Any]:
    """Times are of successes."""
    worlds = [o.world for o in outcomes]
    won = [o for o in outcomes if o.succeeded]
    return {
        "stack": stack,
        "runs": len(outcomes),
        "success": share([o.succeeded for o in outcomes], worlds),
        "collision": share([o.outcome == "collision" for o in outcomes], worlds),
        "other": share([o.outcome not in ("success", "collision") for o in outcomes], worlds),
        "time_s": mean([o.time_s for o in won], [o.world for o in won]),
        "score": mean([o.score for o in outcomes], worlds),
    }


def _as_outcome(world: int, row: Mapping[str, Any]) -> BarnOutcome:
    return BarnOutcome(world, row["outcome"], row["time_s"], row["length_m"], row["clearance_m"], row["score"], 0.0)


def _against(
    rows: Sequence[Mapping[str, Any]], outcomes: Sequence[BarnOutcome], cpp: Mapping[int, Mapping[str, Any]]
) -> Table:
    both = [row for row in rows if row["world"] in cpp]
    won = [row for row in both if row["cpp_time_s"] is not None and row["success"] > 0]
    runs = [o for o in outcomes if o.world in cpp]
    success = paired_share_difference(
        [cpp[o.world]["outcome"] == "success" for o in runs], [o.succeeded for o in runs], [o.world for o in runs]
    )
    theirs = [float(r["cpp_outcome"] == "success") for r in both]
    told = [
        _row("success", success, theirs, [r["success"] / r["runs"] for r in both]),
        _compared("score", [r["cpp_score"] for r in both], [r["score"] for r in both]),
        _compared("time where both arrive (s)", [cpp[r["world"]]["time_s"] for r in won], [r["time_s"] for r in won]),
        _compared(
            "length where both arrive (m)", [cpp[r["world"]]["length_m"] for r in won], [r["length_m"] for r in won]
        ),
    ]
    return Table("navstack minus C++, paired by world", _AGAINST, told)


def _compared(what: str, theirs: Sequence[float], ours: Sequence[float]) -> dict[str, Any]:
    return _row(what, paired_difference(theirs, ours), theirs, ours)


def _row(what: str, difference: Difference, theirs: Sequence[float], ours: Sequence[float]) -> dict[str, Any]:
    return {
        "what": what,
        "worlds": len(ours),
        "difference": difference,
        "verdict": difference.verdict,
        "rank_correlation": rank_correlation(theirs, ours),
    }

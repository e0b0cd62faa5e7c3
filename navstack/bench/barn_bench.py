"""BARN over many worlds and seeds: the task, its jobs and the report."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from navstack.bench.barn import BarnOutcome, BarnWorld, barn_configuration, load_worlds, run_world
from navstack.bench.barn_tables import cpp_comparison_table, read_cpp_results, totals_table, worlds_table
from navstack.bench.digests import digest_of_configuration, digest_of_file, short_names
from navstack.bench.table import Table
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.parameters.configuration import Configuration
from navstack.scenario.suites.barn_worlds import WORLDS_FILE

CPP_FILE: Final = "cpp_results.csv"


@dataclass(frozen=True)
class BarnTask:
    """Drives through a world with a seed; the attributes are common to all runs of a benchmark."""

    folder: Path
    params: tuple[str, ...]
    overrides: tuple[str, ...] = ()
    distro: str | None = None
    rough: bool = False
    noise_m: float | None = None
    """Standard deviation of the lidar ranges, if not the simulator's default."""
    records: Path | None = None
    """Folder for the records of failed runs."""
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
        """The robot's parameters. Raises ParameterError."""
        if "configuration" not in self._loaded:
            self._loaded["configuration"] = barn_configuration(
                self.params, distro=self.distro, rough=self.rough, noise_m=self.noise_m, overrides=self.overrides
            )
        return self._loaded["configuration"]

    def described(self) -> dict[str, Any]:
        """Everything that affects the outcomes, except world and seed."""
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

    def __call__(self, job_input: tuple[int, int]) -> dict[str, Any]:
        """Drives through a world, given as (number, seed); the fields of the outcome."""
        number, seed = job_input
        outcome, recorder = run_world(
            self.worlds[number], self.configuration, seed=seed, record=self.records is not None
        )
        if recorder is not None and self.records is not None and not outcome.succeeded:
            recorder.save(self.records / f"world_{number}_seed_{seed}")
        return asdict(outcome)

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


def barn_jobs(task: BarnTask, worlds: Sequence[int] | None, seeds: int) -> list[Job]:
    """A job per world and seed, seed by seed; None: all worlds of the folder. Raises InputError."""
    known = task.worlds
    wanted = list(known) if worlds is None else list(dict.fromkeys(worlds))
    missing = [w for w in wanted if w not in known]
    if missing:
        raise InputError(
            f"--worlds: {task.folder} has no world {missing[0]}; it has {', '.join(map(str, known))}",
            argument="--worlds",
            value=missing[0],
        )
    return [Job(f"world {w} seed {s}", (w, s)) for s in range(seeds) for w in wanted]


@dataclass(frozen=True, slots=True)
class BarnReport:
    """The results of a benchmark."""

    outcomes: list[BarnOutcome]
    seeds: list[int]
    """The seed of each outcome."""
    worlds: Table
    """One row per world."""
    totals: Table
    """One row for navstack and, if its results are known, one for C++."""
    against_cpp: Table | None
    """Paired differences and rank correlations, per world; None without results of C++."""

    @property
    def tables(self) -> list[Table]:
        """The tables to show, in order."""
        return [self.worlds, self.totals, *([self.against_cpp] if self.against_cpp is not None else [])]

    @property
    def all_seeds_alike(self) -> bool:
        """True if every seed gave the same run in every world, that is, if nothing is random."""
        by_world: dict[int, set[BarnOutcome]] = {}
        for outcome in self.outcomes:
            by_world.setdefault(outcome.world, set()).add(outcome)
        return len(set(self.seeds)) > 1 and all(len(runs) == 1 for runs in by_world.values())

    @property
    def notes(self) -> list[str]:
        """Remarks on the results."""
        if not self.all_seeds_alike:
            return []
        return ["all seeds gave the same runs because nothing is random; each world counts once"]

    def document(self) -> dict[str, Any]:
        """For JSON: the tables and every run."""
        return {
            "worlds": self.worlds,
            "totals": self.totals,
            "against_cpp": self.against_cpp,
            "runs": [{"seed": s, **asdict(o)} for o, s in zip(self.outcomes, self.seeds, strict=True)],
        }


def barn_report(task: BarnTask, results: Sequence[JobResult], jobs: Sequence[Job]) -> BarnReport:
    """Collects the results of `barn_jobs`, compared with `cpp_results.csv` if the folder contains it."""
    finished = [(_outcome_of(r.value), job.input[1]) for r, job in zip(results, jobs, strict=True) if not r.failed]
    outcomes, seeds = [o for o, _ in finished], [s for _, s in finished]
    driven = {o.world for o in outcomes}
    cpp = {w: row for w, row in read_cpp_results(task.folder / CPP_FILE).items() if w in driven}
    worlds = worlds_table(task.worlds, outcomes, cpp)
    return BarnReport(
        outcomes=outcomes,
        seeds=seeds,
        worlds=worlds,
        totals=totals_table(outcomes, cpp),
        against_cpp=cpp_comparison_table(worlds.rows, outcomes, cpp) if cpp else None,
    )


def _outcome_of(value: Mapping[str, Any]) -> BarnOutcome:
    """From JSON, which has no infinity: the clearance in a world without cylinders is None."""
    outcome = BarnOutcome(**value)
    return outcome if value["clearance_m"] is not None else replace(outcome, clearance_m=math.inf)

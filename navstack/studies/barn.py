"""BARN: ten meters through a field of cylinders, without a map.

Perille, Truong, Xiao, Stone, "Benchmarking Metric Ground Navigation", SSRR 2020; scored as in the BARN Challenge. The robot
starts at the origin of its odometry, facing along y; the goal is 10 m ahead. Success: within 1 m of the goal, without a
collision, in under 100 s, counted from when it has moved 0.1 m. The score of a world is `OT / clip(AT, 2 OT, 8 OT)`, where OT
is the time of the shortest path at 2 m/s and AT the time taken; it is 0 without success and 0.5 at most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from navstack.core import InputError, mean, rank_correlation, share
from navstack.parameters import Configuration, load_configuration
from navstack.record import RunRecorder
from navstack.scenario import (
    GOAL,
    JACKAL,
    ROUGH_JACKAL,
    START,
    START_RADIUS_M,
    WORLDS_FILE,
    BarnWorld,
    Run,
    Scenario,
    barn_map,
    load_worlds,
)
from navstack.studies.comparison import Measure, Pair, compare
from navstack.studies.inputs import digest_of_configuration, digest_of_file, read_csv, short_names
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table, mean_of
from navstack.studies.task import Report, Task

GOAL_RADIUS_M: Final = 1.0
TIME_LIMIT_S: Final = 100.0


@dataclass(frozen=True, slots=True)
class BarnOutcome:
    """How a run through a world ended."""

    world: int
    outcome: str
    """success, collision, timeout, or the state of a goal that ended early (aborted, ..)."""
    time_s: float
    """Time since the robot had moved 0.1 m."""
    length_m: float
    clearance_m: float
    """Smallest distance between the robot's footprint and a cylinder, at the control cycles."""
    score: float
    turning_s: float
    """Time spent turning in place (below 0.01 m/s)."""
    jerk_rms_m_s3: float = math.nan
    """As in `RunMetrics`; NaN if unknown."""
    recoveries: int = 0
    """Number of recovery behaviors run."""
    text: str = ""
    """Message of the goal's result, if the goal ended."""

    @property
    def succeeded(self) -> bool:
        """True within 1 m of the goal, without a collision and in time."""
        return self.outcome == "success"


def barn_configuration(
    params: Path | Sequence[str],
    *,
    distro: str | None = None,
    rough: bool = False,
    noise_m: float | None = None,
    overrides: Sequence[str] = (),
) -> Configuration:
    """Return the parameters of a robot in the simulator of the benchmark.

    `noise_m`: standard deviation of the lidar ranges (m), instead of the simulator's default. Raises ParameterError.
    """
    simulator = dict(ROUGH_JACKAL if rough else JACKAL)
    if noise_m is not None:
        simulator["laser"] = {**simulator["laser"], "range_noise": noise_m}
    sources = [str(params)] if isinstance(params, Path) else list(params)
    return load_configuration([*sources, {"navstack": {"sim": simulator}}], overrides=overrides, distro=distro)


def barn_scenario(world: BarnWorld, configuration: Configuration, *, seed: int = 0) -> Scenario:
    """Return the scenario of a world. Its map is empty and only sets the extent of pictures."""
    return Scenario(
        map=barn_map(world),
        configuration=configuration,
        start=START,
        goals=(GOAL,),
        obstacles=tuple((x, y, r) for x, y, r in world.discs.tolist()),
        seed=seed,
        time_limit_s=2.0 * TIME_LIMIT_S,
        names={"map": f"BARN world {world.number}", "params": [], "overrides": []},
    )


class _Monitor:
    """Applies the rules of BARN while a run advances."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._started: float | None = None
        self._now = 0.0
        self.turning_s = 0.0

    @property
    def time_s(self) -> float:
        """Time since the robot had moved 0.1 m."""
        return self._now - (self._started or 0.0)

    def outcome_after_step(self, *, running: bool) -> str | None:
        """Return the outcome if the run is over; `running`: whether the scenario itself has more steps."""
        robot = self._run.robot
        pose, now = robot.pose, robot.time
        velocity = robot.state().velocity
        if velocity.speed < 0.01 and abs(velocity.wz) > 0.01:
            self.turning_s += now - self._now
        self._now = now
        if self._started is None and pose.distance_to(START) >= START_RADIUS_M:
            self._started = now
        if robot.collisions:
            return "collision"
        if self._started is not None and pose.distance_to(GOAL) <= GOAL_RADIUS_M:
            return "success"
        # the limit also holds for a robot that never moves 0.1 m
        if self.time_s >= TIME_LIMIT_S:
            return "timeout"
        return None if running else self._run.outcomes[-1].state.lower()


def run_world(
    world: BarnWorld, configuration: Configuration, *, seed: int = 0, record: bool = False
) -> tuple[BarnOutcome, RunRecorder | None]:
    """Drive through `world` once; a pure function of its arguments. The recorder is None without `record`.

    Raises InputError or PlanningError if the robot does not fit at the start.
    """
    run = Run(barn_scenario(world, configuration, seed=seed), record=record)
    outcome = drive_world(world, run)
    if run.recorder is not None and not run.outcomes:
        run.recorder.finish([], run.robot.collisions)
    return outcome, run.recorder


def drive_world(world: BarnWorld, run: Run) -> BarnOutcome:
    """Drive a new `run` of the scenario of `world` until the rules of BARN end it."""
    monitor = _Monitor(run)
    ended: str | None = None
    while ended is None:
        ended = monitor.outcome_after_step(running=run.step())
    driven = run.result(0.0)
    last = run.outcomes[-1] if run.outcomes else None
    return BarnOutcome(
        world=world.number,
        outcome=ended,
        time_s=monitor.time_s,
        length_m=run.robot.distance_travelled,
        clearance_m=0.0 if ended == "collision" else driven.min_clearance_m,
        score=world.score(monitor.time_s) if ended == "success" else 0.0,
        turning_s=monitor.turning_s,
        jerk_rms_m_s3=driven.metrics.jerk_rms_m_s3,
        recoveries=last.recoveries if last is not None else run.move_base.feedback.recoveries,
        text=last.message if last is not None else "",
    )


# --- tables -----------------------------------------------------------------------------------------------------------


CppResults = Mapping[int, Mapping[str, Any]]
"""By world: outcome, time_s, length_m, clearance_m, score."""

_WORLD_COLUMNS: Final = (
    Column("world", "world"),
    Column("runs", "runs"),
    Column("success", "success"),
    Column("collision", "collision"),
    Column("other", "other"),
    Column("time_s", "time (s)", 1),
    Column("length_m", "length (m)"),
    Column("clearance_m", "clearance (m)", 3),
    Column("turning_s", "turning (s)", 1),
    Column("score", "score", 4),
)
_CPP_COLUMNS: Final = (
    Column("cpp_outcome", "C++"),
    Column("cpp_time_s", "C++ (s)", 1),
    Column("cpp_score", "C++ score", 4),
)
_TOTAL_COLUMNS: Final = (
    Column("stack", "stack"),
    Column("runs", "runs"),
    Column("success", "success", 3),
    Column("collision", "collision", 3),
    Column("other", "other", 3),
    Column("time_s", "time of successes (s)", 1),
    Column("score", "score", 4),
)
_COMPARISON_COLUMNS: Final = (
    Column("what", "navstack against C++, by world"),
    Column("worlds", "worlds"),
    Column("difference", "difference", 3),
    Column("verdict", "verdict"),
    Column("rank_correlation", "rank correlation"),
)


def read_cpp_results(file: Path) -> CppResults:
    """Return the results of C++; empty without the file. Raises InputError."""
    if not file.is_file():
        return {}
    return dict(read_csv(file, ("world", "outcome", "AT", "length", "clearance", "score"), _cpp_result))


def _cpp_result(row: Mapping[str, str]) -> tuple[int, Mapping[str, Any]]:
    result = {
        "outcome": row["outcome"],
        "time_s": float(row["AT"]),
        "length_m": float(row["length"]),
        "clearance_m": float(row["clearance"]),
        "score": float(row["score"]),
    }
    return int(row["world"]), result


def worlds_table(worlds: Mapping[int, BarnWorld], outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """Return a row per world, in the order of the outcomes."""
    numbers = dict.fromkeys(o.world for o in outcomes)
    rows = [_world_statistics(worlds[w], [o for o in outcomes if o.world == w], cpp.get(w)) for w in numbers]
    return Table("worlds", (*_WORLD_COLUMNS, *_CPP_COLUMNS) if cpp else _WORLD_COLUMNS, rows)


def _world_statistics(
    world: BarnWorld, outcomes: Sequence[BarnOutcome], cpp: Mapping[str, Any] | None
) -> dict[str, Any]:
    won = [o for o in outcomes if o.succeeded]
    row: dict[str, Any] = {
        "world": world.number,
        "optimal_time_s": world.optimal_time_s,
        "runs": len(outcomes),
        "success": len(won),
        "collision": sum(o.outcome == "collision" for o in outcomes),
        "other": sum(o.outcome not in ("success", "collision") for o in outcomes),
        "time_s": mean_of([o.time_s for o in won]),
        "length_m": mean_of([o.length_m for o in won]),
        "clearance_m": min(o.clearance_m for o in outcomes),
        "turning_s": mean_of([o.turning_s for o in outcomes]),
        "score": mean_of([o.score for o in outcomes]),
    }
    if cpp is not None:
        row |= {"cpp_outcome": cpp["outcome"], "cpp_score": cpp["score"]}
        row["cpp_time_s"] = cpp["time_s"] if cpp["outcome"] == "success" else None
    return row


def totals_table(outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """Return a row for navstack and, if its results are known, one for C++."""
    rows = [_total_statistics("navstack", outcomes)]
    if cpp:
        theirs = [
            BarnOutcome(w, r["outcome"], r["time_s"], r["length_m"], r["clearance_m"], r["score"], 0.0)
            for w, r in cpp.items()
        ]
        rows.append(_total_statistics("C++", theirs))
    return Table("totals, with 95 % confidence intervals over worlds", _TOTAL_COLUMNS, rows)


def _total_statistics(stack: str, outcomes: Sequence[BarnOutcome]) -> dict[str, Any]:
    """Shares and means over the worlds; the time is that of the successes."""
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


def cpp_comparison_table(rows: Sequence[Mapping[str, Any]], outcomes: Sequence[BarnOutcome], cpp: CppResults) -> Table:
    """Return the differences navstack minus C++, paired by world; `rows` are those of `worlds_table`."""
    names = {w: str(w) for w in cpp}
    theirs = {w: {**cpp[w], "success": cpp[w]["outcome"] == "success"} for w in cpp}
    runs = [
        Pair(names[o.world], i, theirs[o.world], {"success": o.succeeded})
        for i, o in enumerate(outcomes)
        if o.world in cpp
    ]
    worlds = [
        Pair(names[row["world"]], 0, theirs[row["world"]], {**row, "success": row["success"] / row["runs"]})
        for row in rows
        if row["world"] in cpp
    ]
    compared = [
        _against_cpp(Measure("success", "success", 3, +1, both_succeed=False), runs, worlds),
        _against_cpp(Measure("score", "score", 4, +1, both_succeed=False), worlds, worlds),
        _against_cpp(Measure("time_s", "time, both succeed (s)", 1, -1), worlds, worlds),
        _against_cpp(Measure("length_m", "length, both succeed (m)", 2, -1), worlds, worlds),
    ]
    return Table("navstack minus C++, paired by world", _COMPARISON_COLUMNS, compared)


def _against_cpp(measure: Measure, pairs: Sequence[Pair], worlds: Sequence[Pair]) -> dict[str, Any]:
    """`pairs`: the runs of the difference; `worlds`: a pair per world for the rank correlation."""
    difference = compare(measure, pairs).difference
    used = [p for p in worlds if p.both_succeed or not measure.both_succeed]
    return {
        "what": measure.name,
        "worlds": len(used),
        "difference": difference,
        "verdict": difference.verdict,
        "rank_correlation": rank_correlation(
            [float(p.a[measure.key]) for p in used], [float(p.b[measure.key]) for p in used]
        ),
    }


# --- the task ---------------------------------------------------------------------------------------------------------


CPP_FILE: Final = "cpp_results.csv"


@dataclass(frozen=True)
class BarnTask(Task):
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
    numbers: tuple[int, ...] | None = None
    """The worlds to drive through; None: all of the folder."""
    seeds: int = 1
    """Runs per world, with seeds from 0."""
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
        """Return everything that affects the outcomes, except world and seed."""
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
        """Drive through a world, given as (number, seed); the fields of the outcome."""
        number, seed = job_input
        outcome, recorder = run_world(
            self.worlds[number], self.configuration, seed=seed, record=self.records is not None
        )
        if recorder is not None and self.records is not None and not outcome.succeeded:
            recorder.save(self.records / f"world_{number}_seed_{seed}")
        return asdict(outcome)

    def jobs(self) -> list[Job]:
        """Return a job per world and seed, seed by seed. Raises InputError."""
        known = self.worlds
        wanted = list(known) if self.numbers is None else list(dict.fromkeys(self.numbers))
        missing = [w for w in wanted if w not in known]
        if missing:
            raise InputError(
                f"--worlds: {self.folder} has no world {missing[0]}; it has {', '.join(map(str, known))}",
                argument="--worlds",
                value=missing[0],
            )
        return [Job(f"world {w} seed {s}", (w, s)) for s in range(self.seeds) for w in wanted]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return the worlds, totals and, if the folder contains `cpp_results.csv`, the comparison with C++."""
        runs = [(_outcome_of(value), seed) for (_, seed), value in self.finished(results)]
        outcomes = [o for o, _ in runs]
        driven = {o.world for o in outcomes}
        cpp = {w: row for w, row in read_cpp_results(self.folder / CPP_FILE).items() if w in driven}
        worlds, totals = worlds_table(self.worlds, outcomes, cpp), totals_table(outcomes, cpp)
        against_cpp = cpp_comparison_table(worlds.rows, outcomes, cpp) if cpp else None
        alike = len({seed for _, seed in runs}) > 1 and len(set(outcomes)) == len(driven)
        document = {
            "seeds": self.seeds,
            "worlds": worlds,
            "totals": totals,
            "against_cpp": against_cpp,
            "runs": [{"seed": seed, **asdict(o)} for o, seed in runs],
        }
        return Report(
            [worlds, totals, *([against_cpp] if against_cpp is not None else [])],
            document,
            ["all seeds gave the same runs because nothing is random; each world counts once"] if alike else [],
        )

    def draw(self, report: Report, folder: Path) -> dict[str, Path]:
        """Outcomes and times of the worlds."""
        from navstack.plot import plot_success, plot_times

        rows = report.document["worlds"].rows
        if not rows:
            return {}
        what = self.described()
        title = f"BARN, {' + '.join(what['params'])}, {what['distro']}{', rough' if self.rough else ''}"
        return {
            "success": plot_success(rows, folder / "success.png", title=f"{title}: outcomes"),
            "times": plot_times(rows, folder / "times.png", title=f"{title}: times"),
        }

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_loaded": {}}


def _outcome_of(value: Mapping[str, Any]) -> BarnOutcome:
    """From JSON, which has no infinity: the clearance in a world without cylinders is None."""
    outcome = BarnOutcome(**value)
    return outcome if value["clearance_m"] is not None else replace(outcome, clearance_m=math.inf)

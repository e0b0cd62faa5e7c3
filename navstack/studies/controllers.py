"""All controllers on the same scenarios, each with its packaged tuning: measures of runs, and their tables."""

from __future__ import annotations

import math
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, NamedTuple, get_args

import numpy as np

from navstack.core import InputError, Interval, mean, rate, share
from navstack.parameters import nearest
from navstack.record import Timings, resampled_jerk
from navstack.scenario import Run, load_suite, suite_names, warm_up
from navstack.studies.barn import drive_world
from navstack.studies.comparison import Measure, Pair, compare
from navstack.studies.contacts import UNEXPLAINED, Cause, ContactWatch
from navstack.studies.inputs import for_workers, short_names
from navstack.studies.jobs import Job, JobResult
from navstack.studies.parameter_sets import ComparedScenario, ParameterSet, read_scenarios
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task


class Tuning(NamedTuple):
    """The parameter sets of one controller."""

    with_map: ParameterSet
    """For scenarios with a map: a turtlebot."""
    without_map: ParameterSet
    """For BARN worlds: a Jackal."""


def _packaged(with_map: str, without_map: str) -> Tuning:
    return Tuning(ParameterSet((with_map,)), ParameterSet((without_map,)))


CONTROLLERS: Final[Mapping[str, Tuning]] = {
    "dwa": _packaged("turtlebot", "jackal_dwa"),
    "trajectory_rollout": _packaged("turtlebot_rollout", "jackal_rollout"),
    "mppi": _packaged("turtlebot_mppi", "jackal_mppi"),
    "pure_pursuit": _packaged("turtlebot_rpp", "jackal_rpp"),
    "rotation_shim": _packaged("turtlebot_shim", "jackal_shim"),
    "graceful": _packaged("turtlebot_graceful", "jackal_graceful"),
}
"""The controllers and their packaged tunings, in the order of the tables."""

DEFAULT_SUITES: Final = ("office", "narrow", "crowd", "warehouse")
JERK_PERIOD_S: Final = 0.2
"""Jerk is measured at this period for any control frequency: that of the slowest packaged controller."""


class Group(NamedTuple):
    """Scenarios that share a row of the tables."""

    name: str
    scenarios: tuple[ComparedScenario, ...]


@dataclass(frozen=True)
class ControllersTask(Task):
    """Drives a scenario with one controller."""

    tunings: Mapping[str, Tuning]
    groups: tuple[Group, ...]
    seeds: int = 1
    _warm: set[tuple[str, bool]] = field(default_factory=set[tuple[str, bool]], compare=False, repr=False)
    """Controllers that have driven in this process, with and without a map."""

    def __call__(self, job_input: tuple[str, int, int, int], /) -> dict[str, Any]:
        """Drive once, given as (controller, index of the group, of the scenario, seed); the measures of the run."""
        name, group, index, seed = job_input
        scenario = self.groups[group].scenarios[index]
        chosen = self._chosen(name, scenario)
        key = (name, scenario.world is not None)
        if key not in self._warm:
            # a kernel that is compiled or loaded during the run would count as the time of a cycle
            warm_up(scenario.scenario(chosen, seed))
            self._warm.add(key)
        return _drive(scenario, chosen, seed)

    def described(self) -> dict[str, Any]:
        """Return everything that affects the runs, except the seed."""
        return {
            "bench": "controllers",
            "controllers": {
                name: {
                    kind: {"params": short_names(chosen.params), "set": list(chosen.overrides)}
                    for kind, chosen in tuning._asdict().items()
                }
                for name, tuning in self.tunings.items()
            },
            "scenarios": {
                group.name: {
                    s.name: {name: s.digest(self._chosen(name, s)) for name in self.tunings} for s in group.scenarios
                }
                for group in self.groups
            },
        }

    def jobs(self) -> list[Job]:
        """Return a job per scenario, seed and controller; the controllers take turns: a busy moment affects all."""
        return [
            Job(f"{name}, {scenario.name}, seed {seed}", (name, g, i, seed))
            for g, group in enumerate(self.groups)
            for seed in range(self.seeds)
            for i, scenario in enumerate(group.scenarios)
            for name in self.tunings
        ]

    def measured_runs(self, results: Sequence[JobResult]) -> list[MeasuredRun]:
        """Return the runs that gave a result, in the order of the jobs."""
        return [
            MeasuredRun(name, self.groups[g].name, self.groups[g].scenarios[i].name, seed, values)
            for (name, g, i, seed), values in self.finished(results)
        ]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return a row per suite and controller; if there are any, times against the first controller, contacts, failures."""
        runs = self.measured_runs(results)
        tables = all_tables(runs)
        document = {
            "seeds": self.seeds,
            "rows": tables[0],
            "runs": [
                {"controller": r.controller, "suite": r.group, "scenario": r.scenario, "seed": r.seed, **r.values}
                for r in runs
            ],
        }
        return Report(tables, document, controllers_notes(runs, JERK_PERIOD_S))

    def draw(self, report: Report, folder: Path) -> dict[str, Path]:
        """Return the measures of each suite and controller."""
        from navstack.plot import plot_controllers

        rows = report.document["rows"].rows
        title = "Controllers with their packaged tunings"
        return {"picture": plot_controllers(rows, folder / "controllers.png", title=title)} if rows else {}

    def _chosen(self, name: str, scenario: ComparedScenario) -> ParameterSet:
        tuning = self.tunings[name]
        return tuning.with_map if scenario.world is None else tuning.without_map

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_warm": set()}


def _drive(scenario: ComparedScenario, chosen: ParameterSet, seed: int) -> dict[str, Any]:
    """Return the measures of one run; the times of cycles are processor times."""
    timings = Timings(clock=time.thread_time)
    run = Run(scenario.scenario(chosen, seed), record=False, timings=timings)
    score = None
    watch = ContactWatch(run)
    if scenario.world is not None:
        outcome = drive_world(scenario.world, run)
        success, ended, seconds = outcome.succeeded, outcome.outcome, outcome.time_s
        score, length, clearance = outcome.score, outcome.length_m, outcome.clearance_m
        text = outcome.text
    else:
        while run.step():
            watch.look()
        result = run.result(0.0)
        success, seconds = result.succeeded, result.metrics.time_s
        length, clearance = result.metrics.length_m, result.metrics.clearance_min_m
        missed = [condition.text for condition in result.conditions if not condition.holds]
        failed = [goal for goal in result.goals if not goal.succeeded]
        ended = "; ".join(missed) or " ".join(goal.state for goal in failed)
        text = failed[0].message if failed else ""
    watch.look()
    track = run.track()
    p50, p99 = (1e3 * np.percentile(timings.control_s, (50, 99))).tolist() if timings.control_s else (None, None)
    return {
        "success": success,
        "ended": ended,
        "text": text,
        "score": score,
        "time_s": seconds,
        "simulated_s": run.robot.time,
        "length_m": length,
        "clearance_min_m": clearance,
        "jerk_rms_m_s3": resampled_jerk(track[:, 0], track[:, 1:], JERK_PERIOD_S),
        "contacts": len(run.robot.collisions),
        "causes": dict(Counter(watch.causes)),
        "recoveries": sum(goal.recoveries for goal in run.outcomes),
        "cycle_p50_ms": p50,
        "cycle_p99_ms": p99,
    }


@dataclass(frozen=True, slots=True)
class MeasuredRun:
    """A run that gave a result."""

    controller: str
    group: str
    scenario: str
    seed: int
    values: Mapping[str, Any]


def read_tunings(texts: Sequence[str]) -> dict[str, Tuning]:
    """Return the controllers to compare: names of `CONTROLLERS`, or NAME=PARAMS for one's own. Raises InputError."""
    found: dict[str, Tuning] = {}
    for text in texts or list(CONTROLLERS):
        name, own, sources = text.partition("=")
        if own:
            params = tuple(for_workers(part.strip()) for part in sources.split(",") if part.strip())
            if not name or not params:
                raise InputError(
                    f'--controller "{text}" must be NAME=PARAMS, where PARAMS is a packaged set, a folder or files',
                    argument="--controller",
                    value=text,
                )
            tuning = Tuning(ParameterSet(params), ParameterSet(params))
        elif name in CONTROLLERS:
            tuning = CONTROLLERS[name]
        else:
            close = nearest(name, list(CONTROLLERS))
            hint = f'did you mean "{close}"?' if close else f"there are {', '.join(CONTROLLERS)}."
            raise InputError(
                f'--controller "{text}" has no packaged tuning; {hint} For your own parameters give NAME=PARAMS',
                argument="--controller",
                value=text,
            )
        if name in found:
            raise InputError(
                f'--controller "{name}" is given twice; give each a name of its own, as in NAME=PARAMS',
                argument="--controller",
                value=name,
            )
        found[name] = tuning
    return found


def read_groups(names: Sequence[str], count: int | None = None) -> tuple[Group, ...]:
    """Groups of scenarios: packaged suites, and all that `read_scenarios` reads. `count` limits each group.

    Raises InputError, ScenarioError.
    """
    groups: list[Group] = []
    generated = [name for name in suite_names() if name != "barn"]
    for name in names or DEFAULT_SUITES:
        if name in generated:
            scenarios = [ComparedScenario(spec.name, spec) for spec in load_suite(name, count=count)]
            groups.append(Group(name, tuple(scenarios)))
            continue
        if name == "barn":
            raise InputError(
                "the BARN worlds are not part of navstack; give the folder of their worlds.npz instead of barn",
                argument="SUITE",
                value=name,
            )
        scenarios = read_scenarios([name], None)[:count]
        groups.append(Group(_group_name(name, scenarios), tuple(scenarios)))
    _check_unique(groups)
    return tuple(groups)


def _group_name(name: str, scenarios: Sequence[ComparedScenario]) -> str:
    if scenarios[0].world is not None:
        return "BARN"
    return scenarios[0].name if len(scenarios) == 1 else short_names([name])[0]


def _check_unique(groups: Sequence[Group]) -> None:
    seen: set[str] = set()
    for scenario in (s for group in groups for s in group.scenarios):
        if scenario.name in seen:
            raise InputError(
                f'the scenario "{scenario.name}" is in two suites; leave one of them out', argument="SUITE"
            )
        seen.add(scenario.name)


# --- tables -----------------------------------------------------------------------------------------------------------


COLUMNS: Final = (
    Column("suite", "suite"),
    Column("controller", "controller"),
    Column("runs", "runs"),
    Column("success", "success", 2),
    Column("time_s", "time (s)", 1),
    Column("clearance_min_m", "min. clearance (m)", 3),
    Column("jerk_rms_m_s3", "jerk, rms (m/s³)", 2),
    Column("contacts", "contacts"),
    Column("contacts_per_hour", "contacts per hour", 1),
    Column("avoidable_per_hour", "avoidable per hour", 1),
    Column("cycle_p50_ms", "cycle, median (ms)", 3),
    Column("cycle_p99_ms", "cycle, p99 (ms)", 3),
)
_SCORE: Final = Column("score", "score", 3)
_TIME: Final = Measure("time_s", "time (s)", 1, -1)
_DIFFERENCE_COLUMNS: Final = (
    Column("suite", "suite"),
    Column("controller", "controller"),
    Column("pairs", "pairs"),
    Column("first_s", "time of the first (s)", 1),
    Column("time_s", "time (s)", 1),
    Column("difference", "difference (s)", 1),
    Column("verdict", "verdict"),
)


def all_tables(runs: Sequence[MeasuredRun]) -> list[Table]:
    """Return the tables to show: all measures; times against the first controller, contacts by cause, failures."""
    tables = [controllers_table(runs)]
    if len({run.controller for run in runs}) > 1:
        tables.append(differences_table(runs))
    return [*tables, *(table for table in (causes_table(runs), failures_table(runs)) if table is not None)]


def controllers_table(runs: Sequence[MeasuredRun]) -> Table:
    """Return a row per suite and controller, with confidence intervals over scenarios.

    Time, clearance and jerk are of the scenarios and seeds in which every controller succeeds; the rest is of all runs.
    """
    scored = any(run.values["score"] is not None for run in runs)
    columns = (*COLUMNS[:4], _SCORE, *COLUMNS[4:]) if scored else COLUMNS
    rows: list[dict[str, Any]] = []
    for suite in dict.fromkeys(run.group for run in runs):
        mine = [run for run in runs if run.group == suite]
        common = common_cases(mine)
        rows += [
            _measures_of(suite, name, [run for run in mine if run.controller == name], common)
            for name in dict.fromkeys(run.controller for run in mine)
        ]
    return Table("controllers, with 95 % confidence intervals over scenarios", columns, rows)


def common_cases(runs: Sequence[MeasuredRun]) -> set[tuple[str, int]]:
    """Return the scenarios and seeds in which every controller has a run, and succeeds."""
    names = {run.controller for run in runs}
    successes: dict[tuple[str, int], set[str]] = {}
    for run in runs:
        if run.values["success"]:
            successes.setdefault((run.scenario, run.seed), set()).add(run.controller)
    return {case for case, by in successes.items() if by == names}


def _measures_of(suite: str, name: str, runs: Sequence[MeasuredRun], common: set[tuple[str, int]]) -> dict[str, Any]:
    groups = [run.scenario for run in runs]
    compared = [run for run in runs if (run.scenario, run.seed) in common]
    contacts = [int(run.values["contacts"]) for run in runs]
    hours = [run.values["simulated_s"] / 3600.0 for run in runs]
    row: dict[str, Any] = {
        "suite": suite,
        "controller": name,
        "runs": len(runs),
        "compared": len(compared),
        "success": share([bool(run.values["success"]) for run in runs], groups),
        "contacts": sum(contacts),
        "contacts_per_hour": rate(contacts, hours, groups),
        "avoidable_per_hour": rate([_causes(run)[UNEXPLAINED] for run in runs], hours, groups),
        "simulated_h": math.fsum(hours),
        "recoveries": sum(int(run.values["recoveries"]) for run in runs),
    }
    for key in ("time_s", "clearance_min_m", "jerk_rms_m_s3"):
        row[key] = _mean(compared, key)
    for key in ("cycle_p50_ms", "cycle_p99_ms"):
        row[key] = _mean(runs, key)
    row["score"] = _mean(runs, "score") if runs[0].values["score"] is not None else None
    return row


def _mean(runs: Sequence[MeasuredRun], key: str) -> Interval:
    """Return the mean of the finite values, with an interval over scenarios."""
    used = [run for run in runs if isinstance(run.values[key], (int, float)) and math.isfinite(run.values[key])]
    return mean([float(run.values[key]) for run in used], [run.scenario for run in used])


def differences_table(runs: Sequence[MeasuredRun]) -> Table:
    """Return the times of each controller minus those of the first one, over the runs in which both succeed."""
    names = list(dict.fromkeys(run.controller for run in runs))
    first, *others = names
    found = {(r.controller, r.group, r.scenario, r.seed): r.values for r in runs}
    rows: list[dict[str, Any]] = []
    for suite in dict.fromkeys(run.group for run in runs):
        for name in others:
            cases = [(s, seed) for who, group, s, seed in found if (who, group) == (name, suite)]
            pairs = [
                Pair(s, seed, found[first, suite, s, seed], found[name, suite, s, seed])
                for s, seed in cases
                if (first, suite, s, seed) in found
            ]
            compared = compare(_TIME, pairs)
            rows.append(
                {
                    "suite": suite,
                    "controller": name,
                    "pairs": compared.difference.pairs,
                    "first_s": compared.before,
                    "time_s": compared.after,
                    "difference": compared.difference,
                    "verdict": compared.verdict_in("faster", "slower"),
                }
            )
    return Table(f"times against {first}, of the runs in which both succeed", _DIFFERENCE_COLUMNS, rows)


def causes_table(runs: Sequence[MeasuredRun]) -> Table | None:
    """Contacts by cause, a row per suite and controller that has any; None without contacts."""
    rows: list[dict[str, Any]] = []
    for suite, name in dict.fromkeys((run.group, run.controller) for run in runs):
        found = sum((_causes(run) for run in runs if (run.group, run.controller) == (suite, name)), Counter())
        if found:
            rows.append({"suite": suite, "controller": name, **{cause: found[cause] for cause in get_args(Cause)}})
    if not rows:
        return None
    causes: tuple[str, ...] = get_args(Cause)
    headings: dict[str, str] = {UNEXPLAINED: "avoidable"}
    columns = [Column("suite", "suite"), Column("controller", "controller")]
    columns += [Column(cause, headings.get(cause, cause)) for cause in causes]
    return Table("contacts by cause", columns, rows)


def _causes(run: MeasuredRun) -> Counter[Cause]:
    return Counter(run.values["causes"])


def failures_table(runs: Sequence[MeasuredRun]) -> Table | None:
    """Return a row per run without success; None if all succeed."""
    rows = [
        {
            "suite": run.group,
            "scenario": run.scenario,
            "seed": run.seed,
            "controller": run.controller,
            "recoveries": run.values["recoveries"],
            "ended": run.values["ended"],
        }
        for run in runs
        if not run.values["success"]
    ]
    if not rows:
        return None
    columns = [Column(key, key) for key in ("suite", "scenario", "seed", "controller", "recoveries", "ended")]
    return Table("runs without success", columns, rows)


def controllers_notes(runs: Sequence[MeasuredRun], period_s: float) -> list[str]:
    """Return what to consider when reading the tables."""
    notes = [
        "time, clearance and jerk are of the scenarios in which every controller succeeds; contacts and cycles are of all runs",
        "avoidable contacts: with something that the robot saw, after a command that was worse than a stop",
        f"jerk is measured at {period_s:g} s for any control frequency",
        "a cycle is processor time of the local planner's compute_command on this machine",
    ]
    for suite in dict.fromkeys(run.group for run in runs):
        mine = [run for run in runs if run.group == suite]
        many, all_ = len(common_cases(mine)), len({(run.scenario, run.seed) for run in mine})
        if many < all_:
            notes.append(f"{suite}: every controller succeeds in {many} of {all_}")
    return notes

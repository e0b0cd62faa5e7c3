"""All controllers on the same scenarios, each with its packaged tuning: the task, its jobs and the measured runs."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np

from navstack.bench.barn import drive_world
from navstack.bench.compare_scenarios import ComparedScenario, ParameterSet, read_scenarios
from navstack.bench.contact_watch import ContactWatch
from navstack.bench.digests import for_workers, short_names
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.parameters.spelling import nearest
from navstack.record.metrics import resampled_jerk
from navstack.record.timings import Timings
from navstack.scenario import Run
from navstack.scenario.run import warm_up
from navstack.scenario.suites.catalogue import load_suite, suite_names


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
class ControllersTask:
    """Drives a scenario with one controller."""

    tunings: Mapping[str, Tuning]
    groups: tuple[Group, ...]
    _warm: set[tuple[str, bool]] = field(default_factory=set[tuple[str, bool]], compare=False, repr=False)
    """Controllers that have driven in this process, with and without a map."""

    def __call__(self, job_input: tuple[str, int, int, int]) -> dict[str, Any]:
        """Drives once, given as (controller, index of the group, of the scenario, seed); the measures of the run."""
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
        """Everything that affects the runs, except the seed."""
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

    def jobs(self, seeds: int) -> list[Job]:
        """A job per scenario, seed and controller; the controllers take turns, so that a busy moment affects all of them."""
        return [
            Job(f"{name}, {scenario.name}, seed {seed}", (name, g, i, seed))
            for g, group in enumerate(self.groups)
            for seed in range(seeds)
            for i, scenario in enumerate(group.scenarios)
            for name in self.tunings
        ]

    def _chosen(self, name: str, scenario: ComparedScenario) -> ParameterSet:
        tuning = self.tunings[name]
        return tuning.with_map if scenario.world is None else tuning.without_map

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_warm": set()}


def _drive(scenario: ComparedScenario, chosen: ParameterSet, seed: int) -> dict[str, Any]:
    """The measures of one run; the times of cycles are processor times."""
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


def measured_runs(task: ControllersTask, results: Sequence[JobResult], jobs: Sequence[Job]) -> list[MeasuredRun]:
    """The runs that gave a result, in the order of the jobs."""
    runs: list[MeasuredRun] = []
    for result, job in zip(results, jobs, strict=True):
        if not result.failed:
            name, g, i, seed = job.input
            group = task.groups[g]
            runs.append(MeasuredRun(name, group.name, group.scenarios[i].name, seed, result.value))
    return runs


def read_tunings(texts: Sequence[str]) -> dict[str, Tuning]:
    """The controllers to compare: names of `CONTROLLERS`, or NAME=PARAMS for one's own. Raises InputError."""
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

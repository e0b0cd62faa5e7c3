"""Two parameter sets over the same scenarios and seeds: what differs, and by how much for certain."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.bench.barn import JACKAL, BarnWorld, barn_scenario, load_worlds, run_world
from navstack.bench.files import digest_of_scenario
from navstack.bench.table import DIGITS, Column, Table
from navstack.core.errors import InputError
from navstack.core.files import exists, is_dir, is_file
from navstack.jobs import Job, JobResult
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.unused import nearest
from navstack.scenario.file.spec import ScenarioSpec, check_names, read_scenario, scenarios_in
from navstack.scenario.run import Scenario, run_scenario
from navstack.scenario.suites.barn_worlds import WORLDS_FILE
from navstack.statistics import mean, paired_difference, paired_share_difference, share

SIDES: Final = ("A", "B")


class ParameterSet(NamedTuple):
    """One side of the comparison."""

    params: tuple[str, ...]
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Course:
    """A scenario or a BARN world, which is driven with either set."""

    name: str
    spec: ScenarioSpec | None = None
    world: BarnWorld | None = None

    def scenario(self, chosen: ParameterSet, seed: int) -> Scenario:
        """What is driven. Raises MapError, ParameterError, InputError."""
        if self.spec is not None:
            return self.spec.build(params=chosen.params, overrides=chosen.overrides, seed=seed)
        assert self.world is not None
        return barn_scenario(self.world, _in_barn(chosen), seed=seed)

    def digest(self, chosen: ParameterSet) -> str:
        """Changes with whatever shapes the runs of a set on it."""
        return digest_of_scenario(self.scenario(chosen, 0))

    def drive(self, chosen: ParameterSet, seed: int) -> dict[str, Any]:
        """Drives once; what the comparison looks at."""
        if self.world is not None:
            outcome, _ = run_world(self.world, _in_barn(chosen), seed=seed)
            return {
                "success": outcome.succeeded,
                "ended": outcome.outcome,
                "score": outcome.score,
                "time_s": outcome.time_s,
                "length_m": outcome.length_m,
                "clearance_min_m": outcome.clearance_m,
                "jerk_rms_m_s3": outcome.jerk_rms_m_s3,
                "turning_s": outcome.turning_s,
                "recoveries": outcome.recoveries,
                "collisions": int(outcome.outcome == "collision"),
            }
        result = run_scenario(self.scenario(chosen, seed), record=False)
        told = result.metrics.as_dict()
        ends = [goal.state for goal in result.goals if not goal.succeeded]
        missed = [condition.text for condition in result.conditions if not condition.holds]
        kept = {m.key: told[m.key] for m in MEASURES if m.key in told}
        return {"success": result.succeeded, "ended": "; ".join(missed) or " ".join(ends), **kept}


def _in_barn(chosen: ParameterSet) -> Configuration:
    simulator = {"navstack": {"sim": dict(JACKAL)}}
    return load_configuration([*chosen.params, simulator], overrides=chosen.overrides)


def read_courses(names: Sequence[str], suite: str | None, count: int | None = None) -> list[Course]:
    """Scenario files, names of shipped ones, folders of files, folders with BARN worlds, and a packaged suite.

    Raises InputError, ScenarioError.
    """
    from navstack.scenario.suites.catalogue import scenarios, shipped

    courses: list[Course] = []
    for name in names:
        path = Path(name)
        if is_file(path / WORLDS_FILE):
            courses += [Course(f"world {w.number}", world=w) for w in load_worlds(path / WORLDS_FILE)]
        elif is_dir(path):
            specs = scenarios_in(path)
            if not specs:
                raise InputError(
                    f"{path} holds neither scenario files nor {WORLDS_FILE}", argument="SCENARIO", value=name
                )
            courses += [_course(spec) for spec in specs]
        else:
            # as `simulate` does: a file, or one of those that come with navstack
            file = path if exists(path) else shipped().get(name)
            if file is None:
                raise InputError(_unknown(name, list(shipped())), argument="SCENARIO", value=name)
            courses.append(_course(read_scenario(file.resolve(), name)))
    if count is not None and suite is None:
        raise InputError("--count: say with --suite what it counts the scenarios of", argument="--count")
    if suite == "barn":
        raise InputError(
            f"--suite barn: BARN's worlds are not part of navstack; give the folder of their {WORLDS_FILE} as a SCENARIO",
            argument="--suite",
        )
    if suite is not None:
        courses += [_course(spec) for spec in scenarios(suite, count=count)]
    if not courses:
        raise InputError("nothing to drive: give scenario files, or --suite NAME", argument="SCENARIO")
    check_names([course.name for course in courses])
    return courses


def _unknown(name: str, shipped: list[str]) -> str:
    close = nearest(name, shipped)
    hint = f'; did you mean "{close}"?' if close else f"; shipped: {', '.join(shipped)}"
    return f'there is no scenario file and no shipped scenario "{name}"{hint}'


def _course(spec: ScenarioSpec) -> Course:
    return Course(spec.name, spec=spec)


@dataclass(frozen=True)
class CompareTask:
    """Called with a side (`A` or `B`), a course's index and a seed, drives once."""

    sets: Mapping[str, ParameterSet]
    courses: tuple[Course, ...]

    def __call__(self, asked: tuple[str, int, int]) -> dict[str, Any]:
        """What came of it."""
        side, course, seed = asked
        return self.courses[course].drive(self.sets[side], seed)

    def jobs(self, seeds: int) -> list[Job]:
        """A job per course, seed and side."""
        return [
            Job(f"{side}, {course.name}, seed {seed}", (side, i, seed))
            for seed in range(seeds)
            for i, course in enumerate(self.courses)
            for side in SIDES
        ]


class Measure(NamedTuple):
    """A number that two runs are compared by."""

    key: str
    name: str
    digits: int
    better: int
    """+1: more is better; -1: less is; 0: neither."""
    of_both: bool = True
    """Only pairs in which both sides succeed: a failure's time says nothing."""


MEASURES: Final = (
    Measure("score", "score", 4, +1, of_both=False),
    Measure("time_s", "time (s)", 1, -1),
    Measure("length_m", "length (m)", 2, -1),
    Measure("clearance_min_m", "least clearance (m)", 3, +1),
    Measure("clearance_mean_m", "mean clearance (m)", 3, +1),
    Measure("speed_mean_m_s", "mean speed (m/s)", 3, 0),
    Measure("jerk_rms_m_s3", "jerk, rms (m/s³)", 2, -1),
    Measure("curvature_mean_1_m", "curvature (1/m)", 3, -1),
    Measure("turning_s", "turning in place (s)", 1, -1),
    Measure("recoveries", "recoveries", 2, -1, of_both=False),
    Measure("collisions", "collisions", 2, -1, of_both=False),
)


@dataclass(frozen=True, slots=True)
class Pair:
    """Both sides' runs of one course and seed."""

    course: str
    seed: int
    a: Mapping[str, Any]
    b: Mapping[str, Any]

    @property
    def both(self) -> bool:
        """True when both succeeded."""
        return bool(self.a["success"] and self.b["success"])


def pairs_of(task: CompareTask, results: Sequence[JobResult], jobs: Sequence[Job]) -> list[Pair]:
    """The pairs of which both runs gave a result."""
    found = {job.input: r.value for r, job in zip(results, jobs, strict=True) if not r.failed}
    cases = dict.fromkeys((course, seed) for _, course, seed in found)
    return [
        Pair(task.courses[c].name, seed, found["A", c, seed], found["B", c, seed])
        for c, seed in cases
        if ("A", c, seed) in found and ("B", c, seed) in found
    ]


def measures_table(pairs: Sequence[Pair]) -> Table:
    """A row per measure: both sides, the difference and what it shows.

    What counts are scenarios; of a single one its seeds, and then the intervals speak of that scenario alone.
    """
    alone = len({p.course for p in pairs}) == 1
    groups = [p.seed if alone else p.course for p in pairs]
    won = [bool(p.a["success"]) for p in pairs], [bool(p.b["success"]) for p in pairs]
    rows: list[dict[str, Any]] = [
        _measured(
            "success",
            3,
            +1,
            share(won[0], groups),
            share(won[1], groups),
            paired_share_difference(won[0], won[1], groups),
        )
    ]
    for m in MEASURES:
        wanted = [p for p in pairs if (p.both or not m.of_both) and _finite(p.a.get(m.key)) and _finite(p.b.get(m.key))]
        if not wanted:
            continue
        a, b = [float(p.a[m.key]) for p in wanted], [float(p.b[m.key]) for p in wanted]
        groups = [p.seed if alone else p.course for p in wanted]
        rows.append(
            _measured(m.name, m.digits, m.better, mean(a, groups), mean(b, groups), paired_difference(a, b, groups))
        )
    over = "the seeds of one scenario" if alone else "scenarios"
    return Table(f"B against A, with 95 % confidence intervals over {over}", _MEASURES, rows)


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and math.isfinite(value)


def _measured(name: str, digits: int, better: int, a: Any, b: Any, difference: Any) -> dict[str, Any]:
    if not difference.shown:
        verdict = difference.verdict
    elif better == 0:
        verdict = f"B is {difference.verdict}"
    else:
        verdict = "B is better" if (difference.interval.value > 0.0) == (better > 0) else "A is better"
    return {
        "measure": name,
        "a": a,
        "b": b,
        "difference": difference,
        "pairs": difference.pairs,
        "verdict": verdict,
        DIGITS: digits,
    }


def courses_table(pairs: Sequence[Pair]) -> Table:
    """A row per scenario."""
    rows: list[dict[str, Any]] = []
    for name in dict.fromkeys(p.course for p in pairs):
        mine = [p for p in pairs if p.course == name]
        both = [p for p in mine if p.both]
        a = sum(p.a["time_s"] for p in both) / len(both) if both else None
        b = sum(p.b["time_s"] for p in both) / len(both) if both else None
        rows.append(
            {
                "scenario": name,
                "pairs": len(mine),
                "a_success": sum(bool(p.a["success"]) for p in mine),
                "b_success": sum(bool(p.b["success"]) for p in mine),
                "a_time_s": a,
                "b_time_s": b,
                "difference_s": b - a if a is not None and b is not None else None,
            }
        )
    return Table("scenarios (times where both succeed)", _COURSES, rows)


_MEASURES: Final = (
    Column("measure", "measure"),
    Column("pairs", "pairs"),
    Column("a", "A", 3),
    Column("b", "B", 3),
    Column("difference", "B - A", 3),
    Column("verdict", "verdict"),
)
_COURSES: Final = (
    Column("scenario", "scenario"),
    Column("pairs", "pairs"),
    Column("a_success", "A succeeds"),
    Column("b_success", "B succeeds"),
    Column("a_time_s", "A (s)", 1),
    Column("b_time_s", "B (s)", 1),
    Column("difference_s", "B - A (s)", 1),
)

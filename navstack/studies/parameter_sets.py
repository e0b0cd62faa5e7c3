"""Two parameter sets on the same scenarios and seeds: what they name, and the task that compares them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.core import InputError, exists, is_dir, is_file, resolved
from navstack.parameters import Configuration, load_configuration, nearest
from navstack.scenario import (
    JACKAL,
    WORLDS_FILE,
    BarnWorld,
    Scenario,
    ScenarioSpec,
    check_unique_names,
    load_suite,
    load_worlds,
    read_scenario,
    run_scenario,
    scenarios_in,
)
from navstack.studies.barn import barn_scenario, run_world
from navstack.studies.comparison import Measure, Pair, compare, comparison_table, distinct
from navstack.studies.inputs import digest_of_scenario, short_names
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task

_NOT_NEGATIVE: Final = (0.0, math.inf)
_SHARE: Final = (0.0, 1.0)
MEASURES: Final = (
    Measure("success", "success", 3, +1, both_succeed=False),
    Measure("score", "score", 4, +1, both_succeed=False),
    Measure("time_s", "time (s)", 1, -1, possible=_NOT_NEGATIVE),
    Measure("length_m", "length (m)", 2, -1, possible=_NOT_NEGATIVE),
    Measure("clearance_min_m", "minimum clearance (m)", 3, +1, possible=_NOT_NEGATIVE),
    Measure("clearance_mean_m", "mean clearance (m)", 3, +1, possible=_NOT_NEGATIVE),
    Measure("speed_mean_m_s", "mean speed (m/s)", 3, 0, possible=_NOT_NEGATIVE),
    Measure("jerk_rms_m_s3", "jerk, rms (m/s³)", 2, -1, possible=_NOT_NEGATIVE),
    Measure("curvature_mean_1_m", "curvature (1/m)", 3, -1, possible=_NOT_NEGATIVE),
    Measure("turning_s", "turning in place (s)", 1, -1, possible=_NOT_NEGATIVE),
    Measure("recoveries", "recoveries", 2, -1, both_succeed=False, possible=_NOT_NEGATIVE),
    Measure("collisions", "collisions", 2, -1, both_succeed=False, possible=_NOT_NEGATIVE),
    Measure(
        "distance_min_m", "minimum distance of people (m)", 3, +1, both_succeed=False
    ),  # below 0 where they overlap
    Measure("space_compliance", "share of time within 0.5 m of people", 3, -1, both_succeed=False, possible=_SHARE),
    Measure("discomfort", "share of time within 0.2 m of people", 3, -1, both_succeed=False, possible=_SHARE),
    Measure("personal", "share of time in personal space", 3, -1, both_succeed=False, possible=_SHARE),
    Measure(
        "time_to_collision_min_s", "minimum time to collision (s)", 2, +1, both_succeed=False, possible=_NOT_NEGATIVE
    ),
    Measure("contacts_by_robot", "contacts by the robot", 2, -1, both_succeed=False, possible=_NOT_NEGATIVE),
    Measure("contacts_by_people", "contacts by people", 2, -1, both_succeed=False, possible=_NOT_NEGATIVE),
    Measure("collisions_with_people", "collisions with people", 2, -1, both_succeed=False, possible=_NOT_NEGATIVE),
    Measure("path_efficiency", "driven / planned length", 3, -1, possible=_NOT_NEGATIVE),
    Measure("spl", "success weighted by path length", 3, +1, both_succeed=False, possible=_SHARE),
    Measure("social_work", "social work (m/s)", 2, -1, possible=_NOT_NEGATIVE),
    Measure("disturbance_s", "delay of people (s)", 2, -1, both_succeed=False),
    Measure("disturbance_m", "detour of people (m)", 2, -1, both_succeed=False),
)
"""Those of people exist only in runs among people."""
_FEW_SCENARIOS: Final = 10
_SCENARIO_COLUMNS: Final = (
    Column("scenario", "scenario"),
    Column("pairs", "pairs"),
    Column("a_success", "A succeeds"),
    Column("b_success", "B succeeds"),
    Column("a_time_s", "A (s)", 1),
    Column("b_time_s", "B (s)", 1),
    Column("difference_s", "B - A (s)", 1),
)


class ParameterSet(NamedTuple):
    """One side of the comparison."""

    params: tuple[str, ...]
    overrides: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Short names of the sources, and the overrides."""
        return " ".join([*short_names(self.params), *self.overrides])


@dataclass(frozen=True, slots=True)
class ComparedScenario:
    """A scenario file or a BARN world."""

    name: str
    spec: ScenarioSpec | None = None
    world: BarnWorld | None = None

    def scenario(self, chosen: ParameterSet, seed: int) -> Scenario:
        """Return the scenario with the parameters of one side. Raises MapError, ParameterError, InputError."""
        if self.spec is not None:
            return self.spec.build(params=chosen.params, overrides=chosen.overrides, seed=seed)
        assert self.world is not None
        return barn_scenario(self.world, _barn_configuration(chosen), seed=seed)

    def digest(self, chosen: ParameterSet) -> str:
        """Return the digest of everything that affects the runs of a side."""
        return digest_of_scenario(self.scenario(chosen, 0))

    def drive(self, chosen: ParameterSet, seed: int) -> dict[str, Any]:
        """Drive once; success, how it ended, and the metrics of the run."""
        if self.world is not None:
            return self._drive_world(self.world, chosen, seed)
        result = run_scenario(self.scenario(chosen, seed), record=False)
        ends = [goal.state for goal in result.goals if not goal.succeeded]
        missed = [condition.text for condition in result.conditions if not condition.holds]
        metrics = result.metrics.as_dict()
        metrics |= metrics.get("social", {})
        return {
            "success": result.succeeded,
            "ended": "; ".join(missed) or " ".join(ends),
            **{m.key: metrics[m.key] for m in MEASURES if m.key in metrics},
        }

    @staticmethod
    def _drive_world(world: BarnWorld, chosen: ParameterSet, seed: int) -> dict[str, Any]:
        outcome, _ = run_world(world, _barn_configuration(chosen), seed=seed)
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


def _barn_configuration(chosen: ParameterSet) -> Configuration:
    simulator = {"navstack": {"sim": dict(JACKAL)}}
    return load_configuration([*chosen.params, simulator], overrides=chosen.overrides)


def read_scenarios(names: Sequence[str], suite: str | None, count: int | None = None) -> list[ComparedScenario]:
    """Scenario files, shipped scenarios by name, folders of files, folders with BARN worlds, and a packaged suite.

    Raises InputError, ScenarioError.
    """
    if count is not None and suite is None:
        raise InputError("--count limits a suite; add --suite NAME", argument="--count")
    if suite == "barn":
        raise InputError(
            f"--suite barn: the BARN worlds are not part of navstack; give the folder of their {WORLDS_FILE} as a SCENARIO",
            argument="--suite",
        )
    found = [scenario for name in names for scenario in _read(name)]
    if suite is not None:
        found += [ComparedScenario(spec.name, spec) for spec in load_suite(suite, count=count)]
    if not found:
        raise InputError("no scenarios; give scenario files, or --suite NAME", argument="SCENARIO")
    check_unique_names([scenario.name for scenario in found])
    return found


def _read(name: str) -> list[ComparedScenario]:
    from navstack.scenario import shipped_scenarios

    path = Path(name)
    if is_file(path / WORLDS_FILE):
        return [ComparedScenario(f"world {w.number}", world=w) for w in load_worlds(path / WORLDS_FILE)]
    shipped = shipped_scenarios()
    # as in `simulate`: ./NAME is a folder that has the name of a shipped scenario
    if is_dir(path) and name not in shipped:
        specs = scenarios_in(path)
        if not specs:
            raise InputError(
                f"{path} contains neither scenario files nor {WORLDS_FILE}", argument="SCENARIO", value=name
            )
        return [ComparedScenario(spec.name, spec) for spec in specs]
    file = shipped.get(name) if is_dir(path) or not exists(path) else path
    if file is None:
        raise InputError(_unknown(name, list(shipped)), argument="SCENARIO", value=name)
    spec = read_scenario(resolved(file), name if file == path else None)
    return [ComparedScenario(spec.name, spec)]


def _unknown(name: str, shipped: list[str]) -> str:
    close = nearest(name, shipped)
    hint = f'; did you mean "{close}"?' if close else f"; shipped: {', '.join(shipped)}"
    return f'no scenario file and no shipped scenario is named "{name}"{hint}'


# --- the task ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CompareTask(Task):
    """Drives a scenario with the parameters of one side, A or B."""

    sets: Mapping[str, ParameterSet]
    """By side, A first."""
    scenarios: tuple[ComparedScenario, ...]
    seeds: int = 1

    def __call__(self, job_input: tuple[str, int, int], /) -> dict[str, Any]:
        """Drive once, given as (`A` or `B`, index of the scenario, seed); the metrics of the run."""
        side, scenario, seed = job_input
        return self.scenarios[scenario].drive(self.sets[side], seed)

    def described(self) -> dict[str, Any]:
        """Parameters and scenarios."""
        return {
            "bench": "compare",
            **{s: {"params": short_names(p.params), "set": list(p.overrides)} for s, p in self.sets.items()},
            "scenarios": {c.name: {side: c.digest(self.sets[side]) for side in self.sets} for c in self.scenarios},
        }

    def jobs(self) -> list[Job]:
        """Return a job per scenario, seed and side."""
        return [
            Job(f"{side}, {scenario.name}, seed {seed}", (side, i, seed))
            for seed in range(self.seeds)
            for i, scenario in enumerate(self.scenarios)
            for side in self.sets
        ]

    def pairs(self, results: Sequence[JobResult]) -> list[Pair]:
        """Return the pairs for which both runs gave a result."""
        found = dict(self.finished(results))
        cases = dict.fromkeys((scenario, seed) for _, scenario, seed in found)
        return [
            Pair(self.scenarios[i].name, seed, found["A", i, seed], found["B", i, seed])
            for i, seed in cases
            if ("A", i, seed) in found and ("B", i, seed) in found
        ]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return a row per scenario, and the differences B - A."""
        pairs = self.pairs(results)
        scenarios, measures = scenarios_table(pairs), measures_table(pairs)
        document = {
            "seeds": self.seeds,
            "measures": measures,
            "by_scenario": scenarios,
            "runs": [{"scenario": p.scenario, "seed": p.seed, "A": p.a, "B": p.b} for p in pairs],
        }
        return Report([scenarios, measures], document, comparison_notes(self))

    def draw(self, report: Report, folder: Path) -> dict[str, Path]:
        """Return the times of each pair."""
        from navstack.plot import plot_pairs

        runs = [(run["A"], run["B"]) for run in report.document["runs"]]
        if not runs:
            return {}
        times = [(a["time_s"] if a["success"] else None, b["time_s"] if b["success"] else None) for a, b in runs]
        title, names = "The same runs with A and with B", (self.sets["A"].label, self.sets["B"].label)
        return {"picture": plot_pairs(times, folder / "compare.png", title=title, names=names)}


def measures_table(pairs: Sequence[Pair]) -> Table:
    """Return a row per measure: both sides, the difference and the verdict.

    Scenarios are the independent groups; for a single scenario its seeds are, and the intervals hold for it alone. Identical
    runs count once: without noise, every seed repeats the same run.
    """
    pairs = distinct(pairs)
    single = len({p.scenario for p in pairs}) == 1
    compared = [compare(measure, pairs, by_seed=single) for measure in MEASURES]
    over = "the seeds of one scenario" if single else "scenarios"
    title = f"B against A, with 95 % confidence intervals over {over}"
    return comparison_table(title, [c for c in compared if c.difference.pairs or c.name == "success"])


def scenarios_table(pairs: Sequence[Pair]) -> Table:
    """Return a row per scenario."""
    names = dict.fromkeys(p.scenario for p in pairs)
    rows = [_scenario_times(name, [p for p in pairs if p.scenario == name]) for name in names]
    return Table("scenarios (times of pairs in which both succeed)", _SCENARIO_COLUMNS, rows)


def _scenario_times(name: str, pairs: Sequence[Pair]) -> dict[str, Any]:
    both = [p for p in pairs if p.both_succeed]
    a = sum(p.a["time_s"] for p in both) / len(both) if both else None
    b = sum(p.b["time_s"] for p in both) / len(both) if both else None
    return {
        "scenario": name,
        "pairs": len(pairs),
        "a_success": sum(bool(p.a["success"]) for p in pairs),
        "b_success": sum(bool(p.b["success"]) for p in pairs),
        "a_time_s": a,
        "b_time_s": b,
        "difference_s": b - a if a is not None and b is not None else None,
    }


def comparison_notes(task: CompareTask) -> list[str]:
    """Return what to consider when reading the tables."""
    notes = [f"{side}: {chosen.label}" for side, chosen in task.sets.items()]
    notes.append(
        "verdicts are not corrected for multiple comparisons: of twenty equal measures, one shows a difference by chance"
    )
    many = len(task.scenarios)
    if many == 1:
        notes.append("there is only one scenario: intervals are over its seeds and do not apply to other scenarios")
    elif many < _FEW_SCENARIOS:
        notes.append(
            f"{many} scenarios are few: intervals are over scenarios; more seeds only reduce the noise of each"
        )
    return notes

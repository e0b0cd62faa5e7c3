"""Scenario files and BARN worlds for comparisons of two parameter sets, and the compared metrics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from navstack.bench.barn import JACKAL, BarnWorld, barn_scenario, load_worlds, run_world
from navstack.bench.digests import digest_of_scenario, short_names
from navstack.core.errors import InputError
from navstack.core.files import exists, is_dir, is_file, resolved
from navstack.parameters.configuration import Configuration, load_configuration
from navstack.parameters.spelling import nearest
from navstack.scenario import Scenario, ScenarioSpec, read_scenario, run_scenario
from navstack.scenario.file.spec import check_unique_names, scenarios_in
from navstack.scenario.suites.barn_worlds import WORLDS_FILE


class Measure(NamedTuple):
    """A metric of a run that is compared."""

    key: str
    name: str
    digits: int
    better: int
    """+1: higher is better; -1: lower is better; 0: neither."""
    both_succeed: bool = True
    """Uses only the pairs in which both sides succeed: the time of a failure means nothing."""


MEASURES: Final = (
    Measure("score", "score", 4, +1, both_succeed=False),
    Measure("time_s", "time (s)", 1, -1),
    Measure("length_m", "length (m)", 2, -1),
    Measure("clearance_min_m", "minimum clearance (m)", 3, +1),
    Measure("clearance_mean_m", "mean clearance (m)", 3, +1),
    Measure("speed_mean_m_s", "mean speed (m/s)", 3, 0),
    Measure("jerk_rms_m_s3", "jerk, rms (m/s³)", 2, -1),
    Measure("curvature_mean_1_m", "curvature (1/m)", 3, -1),
    Measure("turning_s", "turning in place (s)", 1, -1),
    Measure("recoveries", "recoveries", 2, -1, both_succeed=False),
    Measure("collisions", "collisions", 2, -1, both_succeed=False),
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
        """The scenario with the parameters of one side. Raises MapError, ParameterError, InputError."""
        if self.spec is not None:
            return self.spec.build(params=chosen.params, overrides=chosen.overrides, seed=seed)
        assert self.world is not None
        return barn_scenario(self.world, _barn_configuration(chosen), seed=seed)

    def digest(self, chosen: ParameterSet) -> str:
        """Digest of everything that affects the runs of a side."""
        return digest_of_scenario(self.scenario(chosen, 0))

    def drive(self, chosen: ParameterSet, seed: int) -> dict[str, Any]:
        """Drives once; success, how it ended, and the metrics of the run."""
        if self.world is not None:
            return self._drive_world(self.world, chosen, seed)
        result = run_scenario(self.scenario(chosen, seed), record=False)
        ends = [goal.state for goal in result.goals if not goal.succeeded]
        missed = [condition.text for condition in result.conditions if not condition.holds]
        metrics = result.metrics.as_dict()
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
    from navstack.scenario import load_suite

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

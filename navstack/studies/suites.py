"""The scenarios of sweeps and tuning: suites by name, scenario files, BARN worlds and logs, in training and held-out parts."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, cast

from navstack.core import Footprint, InputError, is_dir, is_file, resolved
from navstack.parameters import Configuration, DictNode, Source, plain
from navstack.scenario import (
    JACKAL,
    ROUGH_JACKAL,
    WORLDS_FILE,
    BarnWorld,
    Scenario,
    ScenarioSpec,
    check_unique_names,
    load_suite,
    load_worlds,
    read_scenario,
    scaled,
    scenarios_in,
    suite_names,
    suite_scale,
)
from navstack.studies.evaluation import (
    ENVIRONMENT,
    BarnEvaluation,
    Evaluation,
    LocalizationEvaluation,
    LogPart,
    NamedScenario,
    ScenarioEvaluation,
    parts_of_log,
)

LOCALIZATION: Final = "localization"
"""Suite of simulated drives to tune amcl on."""
LOCALIZATION_DRIVES: Final = "office"
"""Packaged suite whose scenarios are these drives."""
LOG_SUFFIXES: Final = (".log", ".log.gz", ".bag", ".mcap", ".db3")
"""Files of logs to tune amcl on."""


@dataclass(frozen=True, slots=True)
class Suite:
    """The scenario files or BARN worlds of `--suite`."""

    name: str
    files: tuple[ScenarioSpec, ...] = ()
    worlds: tuple[BarnWorld, ...] = ()
    parts: tuple[LogPart, ...] = ()
    """Parts of a log, to localize along."""
    localizes: bool = False
    """Tunes localization: the scenarios are drives along which amcl runs."""
    held_out: tuple[str, ...] = ()
    """Scenarios that the suite reserves for validation; empty: they are drawn at random."""
    generated: str = ""
    """Name of the generated suite of the files."""
    scale: float = 1.0
    """How many times larger than usual the maps of a generated suite are."""

    def fitted(self, footprint: Footprint) -> Suite:
        """Return the suite on maps in which a robot with this footprint (with padding) has room."""
        scale = suite_scale(self.generated, footprint)
        if scale == 1.0:
            return self
        return replace(self, files=tuple(scaled(self.files, scale)), scale=scale)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of the scenarios."""
        worlds = tuple(f"world {w.number}" for w in self.worlds)
        return tuple(f.name for f in self.files) + worlds + tuple(p.name for p in self.parts)

    def environment(self, *, rough: bool) -> list[Source]:
        """Parameters of the benchmark's simulator, which override those of the user."""
        if self.localizes:
            return [ENVIRONMENT]
        return [{"navstack": {"sim": dict(ROUGH_JACKAL if rough else JACKAL)}}] if self.worlds else []


def read_suite(suite: str, count: int | None = None) -> Suite:
    """Return a packaged suite, a scenario file, a folder of them, or BARN worlds (`worlds.npz` or its folder).

    `count`: number of scenarios of a packaged suite, half of them held out. Raises InputError for an unknown name and a
    folder without scenarios, ScenarioError for invalid files.
    """
    # as for parameter sets, packaged names take precedence: ./office is the folder of that name
    if suite in suite_names() and suite != "barn":
        return _packaged(suite, count)
    if suite == LOCALIZATION:
        return replace(_packaged(LOCALIZATION_DRIVES, count), name=LOCALIZATION, localizes=True)
    path = Path(suite)
    if path.name.endswith(LOG_SUFFIXES) or is_file(path / "metadata.yaml") or is_file(path / "run.npz"):
        parts = parts_of_log(path)
        return Suite(path.name, parts=parts, localizes=True, held_out=tuple(p.name for p in parts[1::2]))
    if is_file(path / WORLDS_FILE):
        path = path / WORLDS_FILE
    if path.suffix == ".npz" and is_file(path):
        return Suite("barn", worlds=tuple(load_worlds(path)))
    if is_dir(path):
        files = scenarios_in(path)
        if not files:
            raise InputError(
                f"--suite {suite}: the folder contains neither scenario files nor {WORLDS_FILE}", suite=suite
            )
        return Suite(resolved(path).name, files=_unique(files))
    if is_file(path):
        return Suite(path.stem, files=(read_scenario(path),))
    return _packaged(suite, count)


def _packaged(suite: str, count: int | None) -> Suite:
    if suite == "barn":
        raise InputError(
            f"--suite barn: the BARN worlds are not part of navstack; give the folder of their {WORLDS_FILE}",
            suite=suite,
        )
    try:
        files = _unique(load_suite(suite, count=count))
    except InputError as error:
        raise InputError(f"--suite {suite}: no such file or folder, and {error.message}", suite=suite) from error
    return Suite(suite, files=files, held_out=tuple(f.name for f in files[1::2]), generated=suite)


def _unique(files: Sequence[ScenarioSpec]) -> tuple[ScenarioSpec, ...]:
    check_unique_names([file.name for file in files])
    return tuple(files)


def split(
    names: Sequence[str], held_out: float, seed: int, reserved: Sequence[str] = ()
) -> tuple[list[str], list[str]]:
    """Training and held-out scenarios, both in the given order.

    `held_out`: share of the held-out scenarios, drawn by `seed`. If the names contain `reserved` scenarios, those are held
    out for any share. Raises InputError if one of the two would be empty.
    """
    if not 0.0 <= held_out < 1.0:
        raise InputError(
            f"--held-out {held_out:g} is out of range; give a share from 0 to below 1",
            argument="--held-out",
            value=held_out,
        )
    if held_out == 0.0:
        return list(names), []
    training = [n for n in names if n not in reserved]
    if 0 < len(training) < len(names):
        return training, [n for n in names if n in reserved]
    many = round(len(names) * held_out)
    if many == 0 or many == len(names):
        raise InputError(
            f"--held-out {held_out:g} cannot split {len(names)} scenarios; give more scenarios, or --held-out 0 to skip the "
            "validation",
            scenarios=len(names),
        )
    shuffled = list(names)
    random.Random(seed).shuffle(shuffled)
    drawn = set(shuffled[:many])
    return [n for n in names if n not in drawn], [n for n in names if n in drawn]


def make_evaluation(
    suite: Suite, names: Sequence[str], seeds: Sequence[int], configuration: Configuration, speed: float
) -> Evaluation:
    """Return the evaluation on some of the scenarios. `speed` (m/s): for the reference times of the score.

    Raises MapError and InputError for invalid scenarios.
    """
    wanted = set(names)
    if suite.worlds:
        return BarnEvaluation([w for w in suite.worlds if f"world {w.number}" in wanted], seeds)
    if suite.localizes:
        files = [_scenario(f, configuration, speed) for f in suite.files if f.name in wanted]
        return LocalizationEvaluation(suite.name, files, [p for p in suite.parts if p.name in wanted], seeds)
    made = [_scenario(f, configuration, speed) for f in suite.files if f.name in wanted]
    return ScenarioEvaluation(suite.name, made, seeds)


def _scenario(file: ScenarioSpec, configuration: Configuration, speed: float) -> NamedScenario:
    scenario = file.build(params=[configuration.tree.as_dict()], distro=configuration.navstack.ros_distro)
    overlays = tuple(plain(node) if isinstance(node, DictNode) else node for node in file.overlays)
    assert all(isinstance(o, dict) for o in overlays)
    return NamedScenario(
        file.name, scenario, reference_time(scenario, speed), cast("tuple[Mapping[str, Any], ...]", overlays)
    )


def reference_time(scenario: Scenario, speed: float) -> float:
    """Return time (s) along the straight lines from goal to goal at full speed."""
    stations = [scenario.start, *scenario.goals]
    length = math.fsum(a.distance_to(b) for a, b in itertools.pairwise(stations))
    return max(length, 0.1) / speed

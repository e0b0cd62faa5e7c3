"""Where candidates are driven: suites by name, scenario files, BARN worlds; split into training and held-out ones."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from navstack.bench.barn import JACKAL, ROUGH_JACKAL, BarnWorld, load_worlds
from navstack.core.errors import InputError
from navstack.core.files import is_dir, is_file
from navstack.parameters.configuration import Configuration
from navstack.parameters.sources import Source
from navstack.parameters.yaml_reader import DictNode, plain
from navstack.scenario import Scenario, ScenarioSpec, load_suite, read_scenario, suite_names
from navstack.scenario.file.spec import check_unique_names, scenarios_in
from navstack.scenario.suites.barn_worlds import WORLDS_FILE
from navstack.tune.courses import BarnCourse, Course, NamedScenario, ScenarioCourse


@dataclass(frozen=True, slots=True)
class Place:
    """What `--suite` names, as read: scenario files, or BARN worlds."""

    name: str
    files: tuple[ScenarioSpec, ...] = ()
    worlds: tuple[BarnWorld, ...] = ()
    held_out: tuple[str, ...] = ()
    """Scenarios that the suite itself keeps for the proof; none where that is left to chance."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the scenarios."""
        return tuple(f.name for f in self.files) + tuple(f"world {w.number}" for w in self.worlds)

    def environment(self, *, rough: bool) -> list[Source]:
        """Parameters that lie over the user's: the simulator of the benchmark."""
        return [{"navstack": {"sim": dict(ROUGH_JACKAL if rough else JACKAL)}}] if self.worlds else []


def read_place(suite: str, count: int | None = None) -> Place:
    """A suite's name, a scenario file, a folder of them, or BARN worlds (`worlds.npz` or its folder).

    `count`: how many of a suite's; half of them are its held-out ones. Raises InputError for what is none of these,
    ScenarioError for files that cannot be used.
    """
    # as with parameter sets, a packaged one wins: ./office is the folder of that name
    if suite in suite_names() and suite != "barn":
        return _packaged(suite, count)
    path = Path(suite)
    if is_file(path / WORLDS_FILE):
        path = path / WORLDS_FILE
    if path.suffix == ".npz" and is_file(path):
        return Place("barn", worlds=tuple(load_worlds(path)))
    if is_dir(path):
        files = scenarios_in(path)
        if not files:
            raise InputError(f"--suite {suite}: the folder holds neither scenario files nor {WORLDS_FILE}", suite=suite)
        return Place(path.resolve().name, files=_named(files))
    if is_file(path):
        return Place(path.stem, files=(read_scenario(path),))
    return _packaged(suite, count)


def _packaged(suite: str, count: int | None) -> Place:
    if suite == "barn":
        raise InputError(
            f"--suite barn: BARN's worlds are not part of navstack; give the folder of their {WORLDS_FILE}", suite=suite
        )
    try:
        files = _named(load_suite(suite, count=count))
    except InputError as error:
        raise InputError(f"--suite {suite}: no such file or folder, and {error.message}", suite=suite) from error
    return Place(suite, files=files, held_out=tuple(f.name for f in files[1::2]))


def _named(files: Sequence[ScenarioSpec]) -> tuple[ScenarioSpec, ...]:
    check_unique_names([file.name for file in files])
    return tuple(files)


def split(names: Sequence[str], held_out: float, seed: int, known: Sequence[str] = ()) -> tuple[list[str], list[str]]:
    """Training and held-out scenarios, `held_out` being the share of the latter; both in the given order.

    The held-out ones are drawn by `seed`, or those that are `known` for it, whatever their share.

    Raises InputError where one of the two would be empty.
    """
    if not 0.0 <= held_out < 1.0:
        raise InputError(
            f"--held-out {held_out:g}: give a share from 0 to below 1", argument="--held-out", value=held_out
        )
    if held_out == 0.0:
        return list(names), []
    kept = [n for n in names if n not in known]
    if 0 < len(kept) < len(names):
        return kept, [n for n in names if n in known]
    many = round(len(names) * held_out)
    if many == 0 or many == len(names):
        raise InputError(
            f"{len(names)} scenarios cannot be split into training and held-out ones with --held-out {held_out:g}; give "
            "more scenarios, or --held-out 0 and do without the proof",
            scenarios=len(names),
        )
    shuffled = list(names)
    random.Random(seed).shuffle(shuffled)
    drawn = set(shuffled[:many])
    return [n for n in names if n not in drawn], [n for n in names if n in drawn]


def course_of(
    place: Place, names: Sequence[str], seeds: Sequence[int], configuration: Configuration, speed: float
) -> Course:
    """The cases of some of the scenarios. `speed` (m/s): of the way straight to the goals, the reference of the score.

    Raises MapError and InputError for scenarios that cannot be made.
    """
    wanted = set(names)
    if place.worlds:
        return BarnCourse([w for w in place.worlds if f"world {w.number}" in wanted], seeds)
    made = [_scenario(f, configuration, speed) for f in place.files if f.name in wanted]
    return ScenarioCourse(place.name, made, seeds)


def _scenario(file: ScenarioSpec, configuration: Configuration, speed: float) -> NamedScenario:
    scenario = file.build(params=[configuration.tree.as_dict()], distro=configuration.navstack.ros_distro)
    over = tuple(plain(node) if isinstance(node, DictNode) else node for node in file.overlays)
    assert all(isinstance(o, dict) for o in over)
    return NamedScenario(
        file.name, scenario, reference_time(scenario, speed), cast("tuple[Mapping[str, Any], ...]", over)
    )


def reference_time(scenario: Scenario, speed: float) -> float:
    """From goal to goal as the crow flies, at full speed (s)."""
    stations = [scenario.start, *scenario.goals]
    length = math.fsum(a.distance_to(b) for a, b in itertools.pairwise(stations))
    return max(length, 0.1) / speed

"""Scenarios by name and by number: those that come with navstack, and suites to tune and to compare parameters on.

    for spec in scenarios("office"):
        result = run_scenario(spec.build(params=["mine"], seed=3), record=False)

A suite is a list without an end: scenario number n of it is always the same. Even numbers are for training, odd ones are held
out, so that whoever tunes on the former can prove it on the latter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from navstack.core import OccupancyGrid, Pose2D
from navstack.core.errors import InputError
from navstack.map_io import load_map, map_path
from navstack.parameters.unused import nearest
from navstack.places import load_places
from navstack.scenario.file.spec import Parts, ScenarioSpec, Settings, read_scenario
from navstack.scenario.suites import random_maps
from navstack.scenario.suites.barn_worlds import GOAL, JACKAL, START, WORLDS_FILE, barn_map, load_worlds
from navstack.scenario.suites.free_space import FreeSpace
from navstack.sim.shapes import PedestrianMotion, Shape

Split = Literal["train", "held_out", "all"]

_SPLITS: Final[dict[str, tuple[int, int]]] = {"train": (0, 2), "held_out": (1, 2), "all": (0, 1)}
"""Name -> the first number and the step to the next."""

USUAL_COUNT: Final = 16
"""Scenarios of a suite where nobody says how many: half for training, half held out."""
_ROOM_M: Final = 0.4
"""Starts and goals keep this much from walls: a robot of 0.3 m radius fits, with its padding."""


def shipped() -> dict[str, Path]:
    """The scenario files that come with navstack, by name."""
    folder = Path(__file__).parent / "files"
    return {file.stem: file for file in sorted(folder.glob("*.yaml"))}


def suite_names() -> list[str]:
    """Names that `scenarios` knows."""
    return sorted([*_SUITES, "barn", "shipped"])


def scenarios(
    name: str, *, split: Split = "all", count: int | None = None, directory: Path | None = None
) -> list[ScenarioSpec]:
    """The scenarios of a suite. What they are run with is up to `ScenarioSpec.build`: parameters, seed.

    - `office`: from room to room of an office, with a few things in the way that are not on the map.
    - `narrow`: rooms whose doors are 0.55 to 0.75 m wide.
    - `crowd`: through an office with people in its corridor.
    - `barn`: the BARN worlds in `directory` (with `worlds.npz`), whose robot is a Jackal without a map.
    - `shipped`: the files that come with navstack.

    `count` (16; of `barn` and `shipped`, all there are) is taken from the split: `train` has the even numbers, `held_out`
    the odd ones. The same arguments give the same scenarios, anywhere. Raises InputError for a name or a split that is
    none, ScenarioError for a shipped file that cannot be used.
    """
    if split not in _SPLITS:
        raise InputError(f'there is no split "{split}"; there are {", ".join(_SPLITS)}', split=split)
    if count is not None and count < 1:
        raise InputError(f"a suite of {count} scenarios is none; ask for 1 at least", count=count)
    first, step = _SPLITS[split]
    if name == "shipped":
        return [read_scenario(path) for path in list(shipped().values())[first::step][:count]]
    if name == "barn":
        return _barn(directory)[first::step][:count]
    if name not in _SUITES:
        close = nearest(name, suite_names())
        hint = f'did you mean "{close}"?' if close else f"there are {', '.join(suite_names())}"
        raise InputError(f'there is no suite "{name}"; {hint}', suite=name, known=suite_names())
    if count is None:
        count = USUAL_COUNT if split == "all" else USUAL_COUNT // 2
    return [_SUITES[name](number) for number in range(first, first + step * count, step)]


# --- suites -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class _Ground:
    """A packaged map and where a robot can stand on it."""

    file: Path
    grid: OccupancyGrid
    space: FreeSpace
    wide: FreeSpace
    """Where something can stand that a robot still gets round."""


@lru_cache(maxsize=4)
def _ground(name: str) -> _Ground:
    file = map_path(name)
    grid = load_map(file)
    return _Ground(file, grid, FreeSpace(grid, _ROOM_M), FreeSpace(grid, 0.8))


def _rng(suite: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([suite, number]))


def _spec(name: str, start: Pose2D, goal: Pose2D, time_limit_s: float, **parts: Any) -> ScenarioSpec:
    settings = Settings(name=name, time_limit=time_limit_s)
    return ScenarioSpec(
        Parts(settings=settings, sources=["turtlebot"], start=start, goals=(goal,), goal_names=("",), **parts)
    )


def _office(number: int) -> ScenarioSpec:
    ground = _ground("office")
    rng = _rng(1, number)
    start, goal = ground.space.draw_pair(rng, 4.0, 14.0)
    things = [ground.wide.draw(rng) for _ in range(3)]
    shapes = tuple(
        Shape(radius=0.15, pose=list(thing))
        for thing in things
        if min(thing.distance_to(start), thing.distance_to(goal)) > 1.0
    )
    return _spec(f"office {number}", start, goal, 120.0, map_file=ground.file, shapes=shapes)


def _narrow(number: int) -> ScenarioSpec:
    rng = _rng(2, number)
    grid = random_maps.rooms(rng, rng.uniform(6.0, 8.0), rng.uniform(5.0, 7.0), (0.55, 0.75))
    start, goal = FreeSpace(grid, _ROOM_M).draw_pair(rng, 3.0, 9.0, across=True)
    return _spec(f"narrow {number}", start, goal, 90.0, grid=grid)


def _crowd(number: int) -> ScenarioSpec:
    ground = _ground("office")
    rng = _rng(3, number)
    places = load_places("office").places
    west, east = places["corridor_west"], places["corridor_east"]
    start, goal = (west, east) if number // 2 % 2 == 0 else (east, west)
    people: list[Shape] = []
    while len(people) < 3:
        # they walk up and down the corridor and through the doors beside it
        at = Pose2D(round(rng.uniform(4.0, 20.0), 2), round(rng.uniform(6.8, 8.0), 2))
        other = ground.wide.draw(rng) if rng.random() < 0.3 else Pose2D(round(rng.uniform(1.0, 22.0), 2), at.y)
        if min(at.distance_to(start), at.distance_to(other)) > 2.0:
            speed = round(rng.uniform(0.3, 0.6), 2)
            walk = PedestrianMotion(goals=[[other.x, other.y], [at.x, at.y]], speed=speed)
            people.append(Shape(radius=0.2, pose=[at.x, at.y], motion=walk))
    middle = Pose2D(round(rng.uniform(10.0, 13.0), 2), 7.4, goal.yaw)
    goal = middle if number // 2 % 4 == 3 else goal
    return _spec(f"crowd {number}", start, goal, 150.0, map_file=ground.file, shapes=tuple(people))


def _barn(directory: Path | None) -> list[ScenarioSpec]:
    if directory is None:
        raise InputError(
            f"the suite barn needs the folder of the BARN worlds, with {WORLDS_FILE} in it", argument="directory"
        )
    return [
        _spec(
            f"world {world.number}",
            START,
            GOAL,
            100.0,
            grid=barn_map(world),
            over=[{"navstack": {"sim": dict(JACKAL)}}],
            shapes=tuple(Shape(radius=r, pose=[x, y]) for x, y, r in world.discs.tolist()),
        )
        for world in load_worlds(directory / WORLDS_FILE if directory.is_dir() else directory)
    ]


_SUITES: Final[dict[str, Callable[[int], ScenarioSpec]]] = {"office": _office, "narrow": _narrow, "crowd": _crowd}

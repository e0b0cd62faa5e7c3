"""Named suites of scenarios: those shipped with navstack, and suites for tuning and for comparing parameters.

    for spec in load_suite("office"):
        result = run_scenario(spec.build(params=["mine"], seed=3), record=False)

A generated suite is an unlimited list: scenario number n is always the same. Even numbers are the training split, odd numbers
are held out to validate what was tuned on the training split.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal

import numpy as np

from navstack.core import Footprint, GridGeometry, InputError, OccupancyGrid, Pose2D
from navstack.map_io import load_map, map_path
from navstack.parameters import nearest
from navstack.scenario.barn import barn_scenarios
from navstack.scenario.file_reader import read_scenario
from navstack.scenario.places import load_places
from navstack.scenario.random_maps import FreeSpace, rooms
from navstack.scenario.recognition import shipped_scenarios
from navstack.scenario.spec import ScenarioSpec, single_goal_spec
from navstack.sim import PedestrianMotion, Shape

_CLEARANCE_M: Final = 0.4
"""Minimum distance of starts and goals from walls: enough for a robot of 0.3 m radius with its padding."""
_OBSTACLE_CLEARANCE_M: Final = 0.8
"""Minimum distance of obstacles from walls: enough for the robot to pass between."""


@dataclass(frozen=True, slots=True)
class _MapSpace:
    """A packaged map and its free space."""

    file: Path
    grid: OccupancyGrid
    space: FreeSpace
    obstacle_space: FreeSpace


@lru_cache(maxsize=4)
def _map_space(name: str) -> _MapSpace:
    file = map_path(name)
    grid = load_map(file)
    return _MapSpace(file, grid, FreeSpace(grid, _CLEARANCE_M), FreeSpace(grid, _OBSTACLE_CLEARANCE_M))


def _rng(suite: int, number: int) -> np.random.Generator:
    return np.random.Generator(np.random.PCG64([suite, number]))


def office_scenario(number: int) -> ScenarioSpec:
    """Between random poses of the office, with up to three discs that are not on the map."""
    office = _map_space("office")
    rng = _rng(1, number)
    start, goal = office.space.draw_pair(rng, 4.0, 14.0)
    discs = [office.obstacle_space.draw(rng) for _ in range(3)]
    shapes = tuple(
        Shape(radius=0.15, pose=list(disc))
        for disc in discs
        if min(disc.distance_to(start), disc.distance_to(goal)) > 1.0
    )
    return single_goal_spec(f"office {number}", start, goal, 120.0, map_file=office.file, shapes=shapes)


def narrow_scenario(number: int) -> ScenarioSpec:
    """Between rooms of a random map whose doors are 0.55 to 0.75 m wide."""
    rng = _rng(2, number)
    grid = rooms(rng, rng.uniform(6.0, 8.0), rng.uniform(5.0, 7.0), (0.55, 0.75))
    start, goal = FreeSpace(grid, _CLEARANCE_M).draw_pair(rng, 3.0, 9.0, across=True)
    return single_goal_spec(f"narrow {number}", start, goal, 90.0, grid=grid)


def crowd_scenario(number: int) -> ScenarioSpec:
    """Along the corridor of the office, with three pedestrians."""
    office = _map_space("office")
    rng = _rng(3, number)
    places = load_places("office").places
    west, east = places["corridor_west"], places["corridor_east"]
    start, goal = (west, east) if number // 2 % 2 == 0 else (east, west)
    pedestrians: list[Shape] = []
    while len(pedestrians) < 3:
        # they walk along the corridor and through the doors next to it
        at = Pose2D(round(rng.uniform(4.0, 20.0), 2), round(rng.uniform(6.8, 8.0), 2))
        other = (
            office.obstacle_space.draw(rng) if rng.random() < 0.3 else Pose2D(round(rng.uniform(1.0, 22.0), 2), at.y)
        )
        if min(at.distance_to(start), at.distance_to(other)) > 2.0:
            speed = round(rng.uniform(0.3, 0.6), 2)
            motion = PedestrianMotion(goals=[[other.x, other.y], [at.x, at.y]], speed=speed)
            pedestrians.append(Shape(radius=0.2, pose=[at.x, at.y], motion=motion))
    middle = Pose2D(round(rng.uniform(10.0, 13.0), 2), 7.4, goal.yaw)
    goal = middle if number // 2 % 4 == 3 else goal
    return single_goal_spec(f"crowd {number}", start, goal, 150.0, map_file=office.file, shapes=tuple(pedestrians))


def warehouse_scenario(number: int) -> ScenarioSpec:
    """Between random poses of the warehouse, whose aisles are 1.2 m wide, with up to three boxes that are not on the map."""
    warehouse = _map_space("warehouse")
    rng = _rng(4, number)
    start, goal = warehouse.space.draw_pair(rng, 8.0, 28.0)
    boxes = [warehouse.obstacle_space.draw(rng) for _ in range(3)]
    shapes = tuple(
        Shape(box=[0.4, 0.3], pose=list(box))
        for box in boxes
        if min(box.distance_to(start), box.distance_to(goal)) > 1.0
    )
    return single_goal_spec(f"warehouse {number}", start, goal, 240.0, map_file=warehouse.file, shapes=shapes)


CROWDNAV_CASES: Final = 500
_CROWDNAV_RADIUS_M: Final = 4.0
_CROWDNAV_PERSON_M: Final = 0.3
"""Radius of people and, when they are placed, of the robot."""
_CROWDNAV_GAP_M: Final = 0.2


@lru_cache(maxsize=1)
def _empty_square() -> OccupancyGrid:
    return OccupancyGrid(np.zeros((240, 240), np.int8), GridGeometry(240, 240, 0.05, -6.0, -6.0))


def circle_crossing_scenario(number: int) -> ScenarioSpec:
    """Test case `number` of CrowdNav (C. Chen et al., "Crowd-Robot Interaction", ICRA 2019): across a circle of 4 m among five.

    People by ORCA at 1 m/s start near the circle, where CrowdNav's generator puts them in this case, and walk to the opposite
    side. They do not notice the robot, which has 25 s from (0, -4) to (0, 4).
    """
    rng = np.random.RandomState(1000 + number)  # the test cases follow the 1000 of the validation
    start, goal = (0.0, -_CROWDNAV_RADIUS_M), (0.0, _CROWDNAV_RADIUS_M)
    apart = 2.0 * _CROWDNAV_PERSON_M + _CROWDNAV_GAP_M
    taken = [start, goal]
    people: list[Shape] = []
    while len(people) < 5:
        angle, noise_x, noise_y = rng.random_sample() * 2.0 * math.pi, rng.random_sample(), rng.random_sample()
        x = _CROWDNAV_RADIUS_M * math.cos(angle) + noise_x - 0.5
        y = _CROWDNAV_RADIUS_M * math.sin(angle) + noise_y - 0.5
        if any(math.hypot(x - other_x, y - other_y) < apart for other_x, other_y in taken):
            continue
        taken += [(x, y), (-x, -y)]
        motion = PedestrianMotion(
            goals=[[-x, -y]], speed=1.0, notices_robot=False, model="orca", time_horizon_obstacles=5.0
        )
        people.append(Shape(name=f"person {len(people) + 1}", radius=_CROWDNAV_PERSON_M, pose=[x, y], motion=motion))
    ends = Pose2D(*start, 0.5 * math.pi), Pose2D(*goal, 0.5 * math.pi)
    return single_goal_spec(f"crossing {number}", *ends, 25.0, grid=_empty_square(), shapes=tuple(people))


Split = Literal["train", "held_out", "all"]

_SPLITS: Final[dict[str, tuple[int, int]]] = {"train": (0, 2), "held_out": (1, 2), "all": (0, 1)}
"""Name -> first number and step."""
_GENERATED: Final[dict[str, Callable[[int], ScenarioSpec]]] = {
    "office": office_scenario,
    "narrow": narrow_scenario,
    "crowd": crowd_scenario,
    "circle_crossing": circle_crossing_scenario,
    "warehouse": warehouse_scenario,
}

DEFAULT_COUNT: Final = 16
"""Default number of scenarios of a generated suite: half for training, half held out."""


def suite_names() -> list[str]:
    """Returns the names that `load_suite` accepts."""
    return sorted([*_GENERATED, "barn", "shipped"])


def load_suite(
    name: str, *, split: Split = "all", count: int | None = None, directory: Path | None = None
) -> list[ScenarioSpec]:
    """Returns the scenarios of a suite. `ScenarioSpec.build` sets their parameters and seed.

    - `office`: between rooms of an office, with a few objects that are not on the map.
    - `narrow`: rooms whose doors are 0.55 to 0.75 m wide.
    - `crowd`: through an office with pedestrians in its corridor.
    - `circle_crossing`: the 500 test cases of CrowdNav, across a circle among five people.
    - `warehouse`: between the racks of a warehouse, with a few boxes that are not on the map.
    - `barn`: the BARN worlds in `directory` (with `worlds.npz`) for a Jackal without a map.
    - `shipped`: the scenario files shipped with navstack.

    `split`: `train` has the even numbers, `held_out` the odd ones. `count` limits the scenarios of the split (default: 16, or 8
    of a split; all of `barn`, `shipped` and `circle_crossing`). The same arguments give the same scenarios on every machine.
    Raises InputError for an unknown name or split, ScenarioError for an invalid shipped file.
    """
    if split not in _SPLITS:
        raise InputError(f'unknown split "{split}"; known splits: {", ".join(_SPLITS)}', split=split)
    if count is not None and count < 1:
        raise InputError(f"count is {count}; it must be at least 1", count=count)
    first, step = _SPLITS[split]
    if name == "shipped":
        return [read_scenario(path) for path in list(shipped_scenarios().values())[first::step][:count]]
    if name == "barn":
        return barn_scenarios(directory)[first::step][:count]
    if name not in _GENERATED:
        close = nearest(name, suite_names())
        hint = f'did you mean "{close}"?' if close else f"known suites: {', '.join(suite_names())}"
        raise InputError(f'unknown suite "{name}"; {hint}', suite=name, known=suite_names())
    if name == "circle_crossing":
        count = min(count or CROWDNAV_CASES, len(range(first, CROWDNAV_CASES, step)))
    elif count is None:
        count = DEFAULT_COUNT if split == "all" else DEFAULT_COUNT // 2
    return [_GENERATED[name](number) for number in range(first, first + step * count, step)]


# --- scenarios for large robots ---------------------------------------------------------------------------------------

_LARGEST_RADIUS_M: Final = 0.35
"""Circumscribed radius, with padding, of the largest robot that starts and goals at _CLEARANCE_M suit: a cell remains."""
_NARROWEST_RADIUS_M: Final = 0.25
"""Inscribed radius of the widest robot that passes the doors of `narrow` from 0.55 m on."""
_SCALE_STEP: Final = 0.25


def suite_scale(name: str, footprint: Footprint) -> float:
    """Return by how much the map of a generated suite must be larger for this footprint (with padding): 1 or more.

    A multiple of 0.25, so that robots of about the same size get the same maps. 1 for suites that are not generated: their
    scenarios say themselves for which robot they are.
    """
    if name not in _GENERATED or name == "circle_crossing":  # a benchmark stays as it is
        return 1.0
    needed = footprint.circumscribed_radius / _LARGEST_RADIUS_M
    if name == "narrow":
        needed = max(needed, footprint.inscribed_radius / _NARROWEST_RADIUS_M)
    return max(1.0, math.ceil(round(needed / _SCALE_STEP, 6)) * _SCALE_STEP)


def scaled(specs: Sequence[ScenarioSpec], factor: float) -> list[ScenarioSpec]:
    """Return the scenarios of a generated suite on a map that is `factor` times as large, with cells of the same size.

    Positions and the time limit grow with the map; obstacles, pedestrians and their speeds stay as they are. Raises InputError
    for a map that would be too large.
    """
    maps: dict[int, OccupancyGrid] = {}  # the scenarios of a packaged map share one, also when pickled
    found: list[ScenarioSpec] = []
    for spec in specs:
        grid = spec.map()
        larger = maps.setdefault(id(grid), _scaled_map(grid, factor))
        start = spec.start
        values = {
            **spec.values,
            "start": None if start is None else _scaled_pose(start, factor),
            "goals": tuple(_scaled_pose(goal, factor) for goal in spec.goals),
            "shapes": tuple(_scaled_shape(shape, factor) for shape in spec.shapes),
            "time_limit_s": spec.values["time_limit_s"] * factor,
        }
        found.append(replace(spec, values=values, map_file=None, grid=larger))
    return found


def _scaled_map(grid: OccupancyGrid, factor: float) -> OccupancyGrid:
    g = grid.geometry
    nx, ny = round(g.nx * factor), round(g.ny * factor)
    # the cell of the small map that contains the center of each cell
    ix = np.minimum(((np.arange(nx) + 0.5) / factor).astype(np.intp), g.nx - 1)
    iy = np.minimum(((np.arange(ny) + 0.5) / factor).astype(np.intp), g.ny - 1)
    geometry = GridGeometry(nx, ny, g.resolution, g.origin_x * factor, g.origin_y * factor)
    return replace(grid, data=np.ascontiguousarray(grid.data[np.ix_(iy, ix)]), geometry=geometry)


def _scaled_pose(pose: Pose2D, factor: float) -> Pose2D:
    return Pose2D(pose.x * factor, pose.y * factor, pose.yaw)


def _scaled_shape(shape: Shape, factor: float) -> Shape:
    x, y, *yaw = shape.pose
    motion = shape.motion
    if isinstance(motion, PedestrianMotion):
        motion = motion.model_copy(update={"goals": [[factor * v for v in goal] for goal in motion.goals]})
    return shape.model_copy(update={"pose": [factor * x, factor * y, *yaw], "motion": motion})

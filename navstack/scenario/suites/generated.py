"""Generated suites: `office`, `narrow`, `crowd` and `warehouse`. A scenario depends on its number only."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np

from navstack.core import OccupancyGrid, Pose2D
from navstack.map_io import load_map, map_path
from navstack.places import load_places
from navstack.scenario.file.models import Parts, Settings
from navstack.scenario.file.spec import ScenarioSpec
from navstack.scenario.suites.free_space import FreeSpace
from navstack.scenario.suites.random_maps import rooms
from navstack.sim.shapes import PedestrianMotion, Shape

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


def single_goal_spec(name: str, start: Pose2D, goal: Pose2D, time_limit_s: float, **parts: Any) -> ScenarioSpec:
    """Returns a scenario with one goal and the parameter set `turtlebot`; `parts` are further fields of `Parts`."""
    settings = Settings(name=name, time_limit=time_limit_s)
    return ScenarioSpec(
        Parts(settings=settings, sources=["turtlebot"], start=start, goals=(goal,), goal_names=("",), **parts)
    )


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
        # they walk along the corridor and through the doors beside it
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

"""Random scenarios in which nothing may be touched: static obstacles that the lidar sees all round, four footprints.

A scenario depends on its number only. The footprint changes with every number, and every second group of four may reverse.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from navstack.core import Footprint, GridGeometry, OccupancyGrid, Pose2D
from navstack.scenario import random_maps
from navstack.scenario.random_maps import FreeSpace
from navstack.scenario.run import Run
from navstack.scenario.spec import ScenarioSpec
from navstack.sim import Shape, World

FOOTPRINTS: Final[dict[str, dict[str, Any]]] = {
    "round": {"robot_radius": 0.2},
    "box": {"footprint": [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]},
    "long": {"footprint": [[0.7, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.7, -0.2]]},
    "L": {"footprint": [[0.45, 0.0], [0.15, 0.0], [0.15, 0.3], [-0.2, 0.3], [-0.2, -0.2], [0.45, -0.2]]},
}
"""Costmap parameters by name: a round base, a box, a long rectangle and an L (m)."""
PADDING_M: Final = 0.01
TIME_LIMIT_S: Final = 40.0


@dataclass(frozen=True, slots=True)
class FootprintResult:
    """The result of a run."""

    number: int
    footprint: str
    reverses: bool
    state: str
    """Terminal state of the goal; COLLISION if the robot touched an obstacle, which ends the run."""
    simulated_s: float
    collision: dict[str, Any] | None
    """Time (s), pose and obstacle of the collision."""


def footprint_scenario(number: int) -> ScenarioSpec:
    """Returns the scenario with that number, always the same."""
    rng = np.random.Generator(np.random.PCG64([number, 15]))
    name, reverses = kind_of(number)
    footprint = true_footprint(name)
    grid = _map(rng)
    shapes = _shapes(rng, grid)
    start, goal = _start_and_goal(rng, grid, shapes, footprint)
    costmap = {**FOOTPRINTS[name], "footprint_padding": PADDING_M}
    speed = round(rng.uniform(0.3, 0.8), 2)
    acceleration, turn = round(rng.uniform(0.8, 2.5), 2), round(rng.uniform(1.5, 3.5), 2)
    planner = {
        "max_vel_x": speed,
        "max_vel_trans": speed,
        "min_vel_x": -0.2 if reverses else 0.0,
        "max_vel_theta": round(rng.uniform(0.8, 2.0), 2),
        "acc_lim_x": acceleration,
        "acc_lim_theta": turn,
        "sim_time": round(rng.uniform(1.2, 2.0), 1),
    }
    sim = {
        "acc_lim_x": acceleration,
        "acc_lim_theta": turn,
        "bumpers": [],
        "laser": {"x": 0.0, "beams": 720, "fov": 2.0 * math.pi, "range_min": 0.02, "range_max": 8.0},
    }
    overlay = {
        "controller_frequency": 10.0 if rng.random() < 0.5 else 5.0,
        "global_costmap": costmap,
        "local_costmap": costmap,
        "DWAPlannerROS": planner,
        "navstack": {"sim": sim},
    }
    values = {
        "name": f"footprint {number} ({name})",
        "start": start,
        "goals": (goal,),
        "seed": number,
        "time_limit_s": TIME_LIMIT_S,
        "shapes": shapes,
    }
    return ScenarioSpec(values, grid=grid, sources=["turtlebot"], overlays=[overlay], goal_names=("",))


def kind_of(number: int) -> tuple[str, bool]:
    """Returns the name of the footprint, and whether the robot may reverse."""
    return tuple(FOOTPRINTS)[number % len(FOOTPRINTS)], number // len(FOOTPRINTS) % 2 == 1


def true_footprint(name: str) -> Footprint:
    """Returns a footprint without padding."""
    values = FOOTPRINTS[name]
    if "robot_radius" in values:
        return Footprint.from_radius(values["robot_radius"])
    return Footprint(np.array(values["footprint"]))


def check_footprint(number: int) -> FootprintResult:
    """Drives a scenario until its goal or the first collision."""
    name, reverses = kind_of(number)
    run = Run(footprint_scenario(number).build(), record=False)
    while run.step():
        if run.robot.collisions:
            found = run.robot.collisions[0]
            collision = {**asdict(found), "pose": list(found.pose), "at": list(found.at)}
            return FootprintResult(number, name, reverses, "COLLISION", run.robot.time, collision)
    result = run.result(0.0)
    return FootprintResult(number, name, reverses, result.goals[0].state, result.simulated_s, None)


def _map(rng: np.random.Generator) -> OccupancyGrid:
    """A room of 6 to 9 m with discs on the map."""
    width, height = rng.uniform(6.0, 9.0), rng.uniform(6.0, 9.0)
    drawn = random_maps.discs(rng, width, height, rng.uniform(0.0, 0.15), (0.03, 0.3))
    # the origin decides where obstacles lie within their cells
    x, y = rng.uniform(-1.0, 1.0, 2).round(3).tolist()
    g = drawn.geometry
    return OccupancyGrid(drawn.data, GridGeometry(g.nx, g.ny, g.resolution, x, y))


def _shapes(rng: np.random.Generator, grid: OccupancyGrid) -> tuple[Shape, ...]:
    """Static obstacles that are not on the map."""
    left, right, bottom, top = grid.geometry.extent
    shapes: list[Shape] = []
    for _ in range(int(rng.integers(4, 14))):
        pose = [round(rng.uniform(left, right), 3), round(rng.uniform(bottom, top), 3)]
        if rng.random() < 0.6:
            shapes.append(Shape(radius=round(rng.uniform(0.04, 0.3), 3), pose=pose))
        else:
            sides = rng.uniform(0.08, 0.7, 2).round(3).tolist()
            shapes.append(Shape(box=sides, pose=[*pose, round(rng.uniform(-math.pi, math.pi), 3)]))
    return tuple(shapes)


def _start_and_goal(
    rng: np.random.Generator, grid: OccupancyGrid, shapes: tuple[Shape, ...], footprint: Footprint
) -> tuple[Pose2D, Pose2D]:
    """A start from which the robot can turn, and a goal at least 2 m away where it fits, too, if there are such poses."""
    world = World(grid, shapes=shapes)
    space = FreeSpace(grid, footprint.inscribed_radius)
    free = footprint.circumscribed_radius + 0.05

    def draw() -> Pose2D:
        pose = space.draw(rng)
        for _ in range(200):
            if world.clearance(pose) >= free:
                break
            pose = space.draw(rng)
        return pose

    start = goal = draw()
    for _ in range(50):
        goal = draw()
        if start.distance_to(goal) >= 2.0:
            break
    return start, goal

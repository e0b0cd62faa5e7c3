"""Random goals in a real office with the published parameters of a robot.

    python tools/bench/office.py [--distro indigo] [--goals 30] [--seed 0] [--clearance 0.3] [--map NAME --params NAME]

Each leg goes from the last goal to a random one whose planned path keeps the given clearance from walls. Prints a line per goal
and a summary. Maps and parameters are in the folder `data` (see `reference.py`).
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from reference import data_folder

from navstack.bringup import plan_on_map, true_footprint
from navstack.core import OccupancyGrid, PlanningError, Pose2D
from navstack.map_io import load_map
from navstack.parameters import Configuration, load_configuration
from navstack.scenario import Scenario, run_scenario
from navstack.sim import World

DATA = data_folder("data")


class Leg(NamedTuple):
    start: Pose2D
    goal: Pose2D
    clearance: float
    length: float


def legs(configuration: Configuration, grid: OccupancyGrid, number: int, seed: int, clearance: float) -> list[Leg]:
    """`number` legs; each starts at the goal of the previous one."""
    rng = np.random.Generator(np.random.PCG64(seed))
    world, footprint = World(grid), true_footprint(configuration)
    left, right, bottom, top = grid.geometry.extent
    found: list[Leg] = []
    here: Pose2D | None = None
    while len(found) < number:
        there = Pose2D(
            float(rng.uniform(left, right)), float(rng.uniform(bottom, top)), float(rng.uniform(-np.pi, np.pi))
        )
        cell = grid.geometry.world_to_cell(there.x, there.y)
        if cell is None or grid.data[cell[1], cell[0]] != 0 or not world.is_free(footprint, there):
            continue
        if world.clearance(there) < clearance:
            continue
        if here is None:
            here = there
            continue
        try:
            path = plan_on_map(configuration, grid, here, there).plan.path
        except PlanningError:
            continue
        least = min(world.clearance(Pose2D(float(x), float(y))) for x, y, _ in path.poses[::2])
        if least >= clearance and path.length > 1.0:
            found.append(Leg(here, there, least, path.length))
            here = there
    return found


def drive(task: tuple[Leg, str, str, str | None, str | None]) -> str:
    leg, map_file, params, distro, record = task
    configuration = load_configuration([params], distro=distro)
    scenario = Scenario(load_map(Path(map_file)), configuration, leg.start, (leg.goal,), time_limit_s=300.0)
    result = run_scenario(scenario, record=record is not None)
    (goal,) = result.goals
    if record is not None and result.recorder is not None and not (goal.succeeded and result.collisions == 0):
        result.recorder.save(Path(record) / f"goal_{leg.goal.x:.2f}_{leg.goal.y:.2f}")
    return (
        f"({leg.goal.x:6.2f}, {leg.goal.y:6.2f}) route {leg.length:5.1f} m, clearance {leg.clearance:.2f} m: {goal.state} "
        f"in {goal.time_s:.1f} s, {goal.recoveries} recoveries, {result.collisions} collisions {goal.message}"
    ).rstrip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map", default="fetch_ros__9_16_15/9_16_15.yaml")
    parser.add_argument("--params", default="turtlebot2/param")
    parser.add_argument("--distro", choices=("noetic", "indigo"))
    parser.add_argument("--goals", type=int, default=30)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--clearance", type=float, default=0.3)
    parser.add_argument("--record", metavar="DIR", help="folder for the records of failed goals")
    parser.add_argument("--processes", type=int, default=2)
    args = parser.parse_args()
    map_file, params = str(DATA / "maps" / args.map), str(DATA / "params" / args.params)
    configuration = load_configuration([params], distro=args.distro)
    planned = legs(configuration, load_map(Path(map_file)), args.goals, args.seed, args.clearance)
    tasks = [(leg, map_file, params, args.distro, args.record) for leg in planned]
    with ProcessPoolExecutor(args.processes) as pool:
        lines = list(pool.map(drive, tasks))
    print("\n".join(lines))
    good = sum("SUCCEEDED" in line and " 0 collisions" in line for line in lines)
    print(f"{good} of {len(lines)} reached without collision ({args.distro or 'distro of the parameters'})")


if __name__ == "__main__":
    main()

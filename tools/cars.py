"""Drive maneuvers with the packaged cars, with noise and from several starts, and print a table.

    python tools/cars.py [--params car_mppi,car_rpp] [--case NAME] [--seeds 5] [--rows] [--set KEY=VALUE ..]

A seed draws the noise, and the start within 5 cm and 5 degrees of that of the case. The columns: runs that reached the goal of
all; the time of those that did, median and slowest; contacts with obstacles of all runs; changes of the driven direction, median
and most; distance and heading to the goal at the end of those that reached it, the largest. `--rows` prints each run as well.
"""

from __future__ import annotations

import argparse
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from navstack.core import Pose2D
from navstack.map_io import map_path
from navstack.scenario import Run, RunResult
from navstack.scenario.spec import single_goal_spec
from navstack.sim import Shape

EAST, NORTH, SOUTH, WEST = 0.0, math.pi / 2, -math.pi / 2, math.pi
NOISE = ("odometry_noise=0.02", "velocity_lag=0.1", "localization_noise=0.005", "laser/range_noise=0.01")
BAY = (Shape(box=[0.8, 0.8], pose=[17.75, 17.0]), Shape(box=[0.8, 0.8], pose=[19.55, 17.0]))
"""Pallets in a free bay of a rack: 1.0 m remain between them for a car of 0.80 x 0.50 m."""
CRAWLING = 0.05
"""m/s; below it, a car has no direction."""


@dataclass(frozen=True)
class Case:
    """A maneuver on the map `warehouse`."""

    name: str
    start: Pose2D
    goal: Pose2D
    shapes: tuple[Shape, ...] = ()


CASES = (
    Case("bay ahead", Pose2D(14.0, 18.8, EAST), Pose2D(18.65, 17.3, SOUTH), BAY),
    Case("bay behind", Pose2D(14.0, 18.8, EAST), Pose2D(18.65, 16.9, NORTH), BAY),
    Case("parallel parking", Pose2D(7.0, 8.0, EAST), Pose2D(10.75, 9.2, EAST)),
    Case("three-point turn", Pose2D(8.0, 18.8, EAST), Pose2D(8.0, 18.8, WEST)),
    Case(
        "dead end",
        Pose2D(17.5, 11.4, EAST),
        Pose2D(13.4, 6.7, SOUTH),
        (Shape(box=[0.8, 1.2], pose=[19.0, 11.4]),),
    ),
    Case("aisle to aisle", Pose2D(6.0, 8.0, EAST), Pose2D(21.0, 11.4, WEST)),
)


@dataclass(frozen=True)
class Drive:
    """A finished run and how often it changed its direction."""

    result: RunResult
    changes: int


def drive(case: Case, params: str, overrides: Sequence[str], seed: int) -> Drive:
    """Drives a case once."""
    rng = random.Random(seed)
    x, y, yaw = (rng.uniform(-limit, limit) for limit in (0.05, 0.05, math.radians(5.0)))
    start = Pose2D(case.start.x + x, case.start.y + y, case.start.yaw + yaw)
    spec = single_goal_spec(case.name, start, case.goal, 120.0, map_file=map_path("warehouse"), shapes=case.shapes)
    settings = [*(f"navstack/sim/{setting}" for setting in NOISE), *overrides]
    run = Run(spec.build(params=[params], overrides=settings, seed=seed), record=False)
    changes, direction = 0, 0.0
    while run.step():
        speed = run.robot.state().velocity.vx
        if abs(speed) > CRAWLING:
            changes += direction * speed < 0.0
            direction = speed
    return Drive(run.result(0.0), changes)


def row(case: Case, params: str, drives: Sequence[Drive]) -> str:
    """Returns the line of a table: the runs of a case with a parameter set."""
    reached = [drive for drive in drives if drive.result.goals[0].succeeded]
    ends = [drive.result.goals[0] for drive in reached]
    times, changes = [end.time_s for end in ends], [drive.changes for drive in reached]
    cells = [case.name, f"`{params}`", f"{len(reached)} of {len(drives)}"]
    cells.append(f"{median(times):.0f}, {max(times):.0f}" if ends else "-")
    cells.append(str(sum(drive.result.collisions for drive in drives)))
    cells.append(f"{median(changes):.0f}, {max(changes)}" if ends else "-")
    cells.append(f"{100 * max(end.distance_left_m for end in ends):.0f}" if ends else "-")
    cells.append(f"{math.degrees(max(abs(end.yaw_left_rad) for end in ends)):.0f}" if ends else "-")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--params", default="car_mppi,car_rpp", help="parameter sets, separated by commas")
    parser.add_argument("--case", choices=[case.name for case in CASES], help="only this case")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--rows", action="store_true", help="print each run as well")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="as in navstack simulate")
    arguments = parser.parse_args()
    print("| | | reached | s | contacts | changes of direction | cm left | degrees left |")
    print("|---|---|---|---|---|---|---|---|")
    for case in CASES:
        if arguments.case not in (None, case.name):
            continue
        for params in arguments.params.split(","):
            drives: list[Drive] = []
            for seed in range(arguments.seeds):
                drives.append(drive(case, params, arguments.set, seed))
                if arguments.rows:
                    result, end = drives[-1].result, drives[-1].result.goals[0]
                    print(
                        f"{case.name}, {params}, seed {seed}: {end.state} {end.time_s:.1f} s, {end.path_length_m:.1f} m, "
                        f"{drives[-1].changes} changes, {result.collisions} contacts, "
                        f"clearance {result.min_clearance_m:.2f} m, {end.recoveries} recoveries {end.message}",
                        flush=True,
                    )
            print(row(case, params, drives), flush=True)


if __name__ == "__main__":
    main()

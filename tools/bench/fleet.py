"""Measure how fast fleets run, and where the time goes: a growth table.

    python tools/bench/fleet.py --robots 1 2 5 10 20 50 --seconds 10 --map warehouse --params turtlebot

Robots drive between random poses of a packaged map, each with its own move_base, without a traffic rule and without records.
Times are processor times of this process; the first seconds, in which kernels are loaded and every robot plans, are not
counted unless `--warm-up 0`.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from navstack.core import Pose2D
from navstack.fleet import Fleet, FleetRun, make_fleet
from navstack.map_io import load_map, map_path
from navstack.parameters import load_configuration
from navstack.scenario import FreeSpace, Scenario

APART_M = 0.8


def random_fleet(count: int, map_name: str, params: str, seed: int = 1) -> Fleet:
    """Return robots between random poses of a packaged map that do not overlap."""
    grid, configuration = load_map(map_path(map_name)), load_configuration([params])
    space, rng = FreeSpace(grid, 0.4), np.random.default_rng(seed)
    poses: list[Pose2D] = []
    while len(poses) < 4 * count:
        pose = space.draw(rng)
        near = poses[: min(len(poses), count)] if len(poses) < count else []
        if all(pose.distance_to(other) > APART_M for other in near):
            poses.append(pose)
    return make_fleet(
        {
            f"robot_{i:03d}": Scenario(
                grid, configuration, poses[i], tuple(poses[count + i :: count]), time_limit_s=600.0
            )
            for i in range(count)
        },
        seed=seed,
    )


class Stopwatch:
    """Adds up the processor time of calls."""

    def __init__(self) -> None:
        self.spent = 0.0

    def around(self, owner: Any, name: str) -> None:
        """Measure a method of an object from now on."""
        inner: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            began = time.process_time()
            try:
                return inner(*args, **kwargs)
            finally:
                self.spent += time.process_time() - began

        setattr(owner, name, timed)


def measure(count: int, seconds: float, warm_up: float, map_name: str, params: str) -> dict[str, float]:
    """Return the figures of one row."""
    began = time.process_time()
    run = FleetRun(random_fleet(count, map_name, params), record=False)
    built = time.process_time() - began
    while run.time < warm_up and run.step():
        pass
    bodies, taking, stacks = Stopwatch(), Stopwatch(), Stopwatch()
    bodies.around(run.lockstep, "advance_to")
    taking.around(run.lockstep, "catch_up")
    for member in run.runs.values():
        stacks.around(member, "cycle")
    first, began = run.time, time.process_time()
    while run.time < first + seconds and run.step():
        pass
    spent, simulated = time.process_time() - began, run.time - first
    return {
        "robots": count,
        "build_s": built,
        "factor": simulated / spent,
        "ms_per_robot_s": 1e3 * spent / simulated / count,
        "bodies_%": 100.0 * bodies.spent / spent,
        "frames_sensors_%": 100.0 * taking.spent / spent,
        "stacks_%": 100.0 * stacks.spent / spent,
    }


def main() -> None:
    """Print the growth table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--robots", type=int, nargs="+", default=[1, 2, 5, 10, 20, 50])
    parser.add_argument("--seconds", type=float, default=10.0, help="simulated, per row")
    parser.add_argument("--warm-up", type=float, default=2.0, help="simulated seconds before")
    parser.add_argument("--map", default="warehouse")
    parser.add_argument("--params", default="turtlebot")
    given = parser.parse_args()
    gc.set_threshold(100_000, 20, 20)  # as the command navstack
    measure(min(2, max(given.robots)), 1.0, 0.5, given.map, given.params)  # loads the kernels
    print("robots  build s  times real time  ms per robot and s  bodies %  frames, sensors %  stacks %")
    for count in given.robots:
        row = measure(count, given.seconds, given.warm_up, given.map, given.params)
        print(
            f"{row['robots']:6.0f}  {row['build_s']:7.2f}  {row['factor']:15.1f}  {row['ms_per_robot_s']:18.2f}  "
            f"{row['bodies_%']:8.1f}  {row['frames_sensors_%']:17.1f}  {row['stacks_%']:8.1f}",
            flush=True,
        )


if __name__ == "__main__":
    main()

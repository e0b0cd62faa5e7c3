"""Where a simulated second goes: the share of each stage of a whole run, children not counted twice.

    python tools/bench/where_time_goes.py [--map MAP.yaml --params DIR --start x,y,yaw --goal x,y,yaw .. --repeat N]

A run is the same every time, call by call. So each call is timed in several runs and its fastest time kept: what other
processes took is left out, and the stages add up to what the run takes alone.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from end_to_end import calibration  # beside this file

from navstack.cli.arguments import map_of, parse_pose
from navstack.configuration import load_configuration
from navstack.core import FrameTree
from navstack.costmap import LayeredCostmap
from navstack.local_planner.plan_follower import PlanFollower
from navstack.maps import places
from navstack.move_base import MoveBase
from navstack.record import RunRecorder
from navstack.scenario import Run, Scenario
from navstack.sim import SimulatedRobot
from navstack.sim.lidar import Lidar
from navstack.sim.world import World


class Stages:
    """Exclusive times per stage, call by call."""

    def __init__(self) -> None:
        self.calls: dict[str, list[float]] = {}
        self._inner = [0.0]

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Times every call of `owner.name` from now on."""
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            began = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - began
                self.calls.setdefault(stage, []).append(took - self._inner.pop())
                self._inner[-1] += took

        setattr(owner, name, timed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", default="office")
    parser.add_argument("--params", nargs="+", default=["turtlebot"])
    parser.add_argument("--start")
    parser.add_argument("--goal", nargs="+")
    parser.add_argument("--repeat", type=int, default=9)
    args = parser.parse_args()
    _, grid = map_of(args.map)
    start = parse_pose(args.start, "--start") if args.start else places(args.map).start
    goals = tuple(parse_pose(g, "--goal") for g in args.goal) if args.goal else places(args.map).goals
    scenario = Scenario(grid, load_configuration(args.params), start, goals)

    stages = Stages()
    planner = scenario.configuration.global_planner.cls
    for owner, name, stage in (
        (Run, "step", "loop"),
        (SimulatedRobot, "advance_to", "simulator: body, odometry"),
        (SimulatedRobot, "scans", "simulator: body, odometry"),
        (Lidar, "_ranges", "simulator: lidar"),
        (World, "clearance", "metrics"),
        (MoveBase, "tick", "goal manager"),
        (LayeredCostmap, "observe", "costmaps"),
        (LayeredCostmap, "update_at", "costmaps"),
        (planner, "make_plan", "global planner"),
        (PlanFollower, "compute_command", "local planner"),
        (FrameTree, "lookup", "frames"),
        (FrameTree, "extend", "frames"),
        (RunRecorder, "sample", "recorder"),
        (RunRecorder, "costmap", "recorder"),
        (RunRecorder, "local_plan", "recorder"),
        (RunRecorder, "plan", "recorder"),
        (RunRecorder, "on_event", "recorder"),
    ):
        stages.watch(owner, name, stage)

    best: dict[str, Any] = {}
    simulated = 0.0
    for repeat in range(args.repeat + 1):
        stages.calls.clear()
        run = Run(scenario)
        while run.step():
            pass
        simulated = run.robot.time
        if repeat:  # the first one loads the kernels
            for stage, calls in stages.calls.items():
                times = np.array(calls)
                best[stage] = np.minimum(best[stage], times) if stage in best else times
    total = sum(times.sum() for times in best.values())
    print(f"{simulated:.1f} s simulated, {args.repeat} runs; {calibration()}")
    print(f"{'stage':28s} {'share':>6s} {'us per simulated second':>24s} {'calls/s':>8s}")
    for stage, times in sorted(best.items(), key=lambda item: -item[1].sum()):
        share = times.sum() / total
        print(f"{stage:28s} {share:6.1%} {times.sum() / simulated * 1e6:24.0f} {len(times) / simulated:8.1f}")
    print(f"{'in all':28s} {1:6.0%} {total / simulated * 1e6:24.0f}   = {simulated / total:.0f} times real time")


if __name__ == "__main__":
    main()

"""Time of a tick in the goal manager itself, without costmaps, planning, control, recoveries, frames and the robot.

    python tools/bench/move_base.py [--map MAP.yaml --params DIR --start x,y,yaw --goal x,y,yaw ..] [--profile]

Drives a run and subtracts the time of every call from the goal manager to another part, and the measured overhead of the timing
itself, from the time of each tick. By default the turtlebot drives to the three goals of the office.
"""

from __future__ import annotations

import argparse
import gc
import math
import statistics
import time
from collections.abc import Callable
from typing import Any

from reference import Reference, add_scenario_arguments, scenario_of

from navstack.move_base import MoveBase
from navstack.scenario import Run, Scenario

CALLS = {
    "global_costmap": ("observe", "update", "robot_pose", "is_current"),
    "local_costmap": ("observe", "update", "robot_pose", "is_current"),
    "global_planner": ("make_plan",),
    "local_planner": ("set_plan", "compute_command", "goal_reached"),
    "robot": ("scans", "state", "command"),
}


class Stopwatch:
    """Adds up the time in the wrapped calls; nested calls count once."""

    def __init__(self) -> None:
        self.spent = 0
        self.calls = 0
        self._depth = 0

    def wrap(self, call: Callable[..., Any]) -> Callable[..., Any]:
        clock = time.perf_counter_ns

        def timed(*args: Any, **kwargs: Any) -> Any:
            if self._depth:
                return call(*args, **kwargs)
            self._depth = 1
            started = clock()
            try:
                return call(*args, **kwargs)
            finally:
                self.spent += clock() - started
                self.calls += 1
                self._depth = 0

        return timed

    @staticmethod
    def overhead_ns() -> float:
        """Overhead of a wrapped call for its caller, beyond the measured time."""
        watch = Stopwatch()
        timed, clock = watch.wrap(math.cos), time.perf_counter_ns

        def once() -> float:
            watch.spent, started = 0, clock()
            for _ in range(1000):
                timed(0.0)
            return (clock() - started - watch.spent) / 1000.0

        return min(once() for _ in range(20))


def attach(move_base: MoveBase) -> Stopwatch:
    watch = Stopwatch()
    for part, names in CALLS.items():
        subject = getattr(move_base, part)
        for name in names:
            setattr(subject, name, watch.wrap(getattr(subject, name)))
    for recovery in move_base.recoveries:
        for name in ("start", "step", "follow_up"):
            setattr(recovery, name, watch.wrap(getattr(recovery, name)))
    frames = move_base.robot.frames
    frames.lookup = watch.wrap(frames.lookup)  # type: ignore[method-assign]
    return watch


def measure(scenario: Scenario, overhead: float) -> tuple[list[float], list[float]]:
    """Time (us) of every tick: of control cycles, and of the others."""
    run = Run(scenario, record=False)
    move_base = run.move_base
    watch = attach(move_base)
    tick, clock = move_base.tick, time.perf_counter_ns
    driving: list[float] = []
    others: list[float] = []

    def timed_tick(now: float) -> None:
        watch.spent = watch.calls = 0
        started = clock()
        tick(now)
        spent = clock() - started - watch.spent - watch.calls * overhead
        (driving if move_base.last_tick.local_plan is not None else others).append(spent / 1e3)

    move_base.tick = timed_tick  # type: ignore[method-assign]
    gc.disable()
    try:
        while run.step():
            pass
    finally:
        gc.enable()
    return driving, others


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_scenario_arguments(parser)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--profile", action="store_true", help="print a profile")
    args = parser.parse_args()
    scenario = scenario_of(args)
    overhead = Stopwatch.overhead_ns()
    measure(scenario, overhead)  # warm-up
    runs = [measure(scenario, overhead) for _ in range(args.repeat)]
    print(f"{Reference().text()}; overhead of timing a call: {overhead:.0f} ns, subtracted")
    for name, part in (("control cycles", 0), ("all ticks", None)):
        ticks = [d + o if part is None else (d, o)[part] for d, o in runs]
        medians = [statistics.median(t) for t in ticks]
        means = [statistics.fmean(sorted(t)[: math.ceil(0.98 * len(t))]) for t in ticks]
        print(
            f"{name} ({len(ticks[0])}): median {statistics.median(medians):.1f} us, best of {args.repeat} runs "
            f"{min(medians):.1f}; mean of all but the slowest 2 % {statistics.median(means):.1f} us, best {min(means):.1f}"
        )
    if args.profile:
        import cProfile
        import pstats

        profile = cProfile.Profile()
        run = Run(scenario, record=False)
        inner = run.move_base.tick
        run.move_base.tick = lambda now: profile.runcall(inner, now)  # type: ignore[method-assign]
        while run.step():
            pass
        pstats.Stats(profile).sort_stats("tottime").print_stats("move_base|recovery|events|geometry", 40)


if __name__ == "__main__":
    main()

"""The share of each stage in the time of a run, by timing calls of methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.scenario import Run, Scenario


class StageTimer:
    """Times calls of methods, without the time of timed calls within them."""

    def __init__(self) -> None:
        self.calls: dict[str, list[float]] = {}
        """By stage: the wall time of each call (s), in order."""
        self._inner = [0.0]
        self._replaced: list[tuple[Any, str, Any]] = []

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Starts timing every call of `owner.name`."""
        original: Any = owner.__dict__.get(name)
        function: Callable[..., Any] = getattr(owner, name)

        def timed(*args: Any, **kwargs: Any) -> Any:
            self._inner.append(0.0)
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                elapsed = time.perf_counter() - start
                self.calls.setdefault(stage, []).append(elapsed - self._inner.pop())
                self._inner[-1] += elapsed

        self._replaced.append((owner, name, original))
        setattr(owner, name, timed)

    def restore(self) -> None:
        """Restores all methods."""
        for owner, name, original in reversed(self._replaced):
            if original is None:
                delattr(owner, name)
            else:
                setattr(owner, name, original)
        self._replaced.clear()


def stage_times(scenario: Scenario, repeats: int) -> dict[str, Any]:
    """Wall time and number of calls of each stage of a run.

    Runs repeat call by call, so the fastest of `repeats` runs counts for each call: this removes the load of other
    processes.
    """
    timer = StageTimer()
    for owner, name, stage in _watched(scenario):
        timer.watch(owner, name, stage)
    best: dict[str, NDArray[np.float64]] = {}
    simulated = 0.0
    try:
        for repeat in range(repeats + 1):
            timer.calls.clear()
            run = Run(scenario)
            while run.step():
                pass
            simulated = run.robot.time
            if repeat:  # the first run loads the kernels
                for stage, calls in timer.calls.items():
                    times = np.array(calls)
                    best[stage] = np.minimum(best[stage], times) if stage in best else times
    finally:
        timer.restore()
    return {
        "simulated_s": simulated,
        "stages": {name: {"calls": len(times), "seconds": float(times.sum())} for name, times in best.items()},
    }


def _watched(scenario: Scenario) -> Sequence[tuple[Any, str, str]]:
    """Classes, methods and the stages they belong to."""
    from navstack.core import FrameTree
    from navstack.costmap import LayeredCostmap
    from navstack.move_base import MoveBase
    from navstack.record import RunRecorder
    from navstack.sim import SimulatedRobot
    from navstack.sim.lidar import Lidar
    from navstack.sim.world import World

    chosen = scenario.configuration
    return (
        (Run, "step", "loop"),
        (SimulatedRobot, "advance_to", "simulator"),
        (SimulatedRobot, "scans", "simulator"),
        (Lidar, "_ranges", "lidar"),  # rays are cast when a costmap reads the scan, during the costmap's update
        (World, "clearance", "metrics"),
        (MoveBase, "tick", "goal manager"),
        (LayeredCostmap, "observe", "costmaps"),
        (LayeredCostmap, "update_at", "costmaps"),
        (chosen.global_planner.cls, "make_plan", "global planner"),
        (chosen.local_planner.cls, "compute_command", "local planner"),
        (FrameTree, "lookup", "frames"),
        (FrameTree, "extend", "frames"),
        *((RunRecorder, name, "recorder") for name in ("sample", "costmap", "local_plan", "plan", "on_event")),
    )

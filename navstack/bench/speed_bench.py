"""How fast it is here and now: the whole stack's real-time factor, where a simulated second goes, and single stages.

Machines are shared and change their speed. So each figure comes with the time of a fixed piece of work, taken at the same
moment: the calibration. Reference times (of the C++ stack, or of an earlier state) bring theirs, and ratios are made from
both. Times are those that this thread had a core for: what other processes took is left out, in both; only of the whole
run the wall time is told, too.
"""

from __future__ import annotations

import gc
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np

from navstack.bench._calibration_kernels import flood, relax
from navstack.bench.table import Column, Table
from navstack.core.errors import InputError
from navstack.jobs import Job, JobResult
from navstack.scenario.run import Run, Scenario, run_scenario

CALIBRATION_RUNS: Final = 7
WHOLE, WHERE = "whole run", "stages of a run"


def calibration_ms(repeats: int = CALIBRATION_RUNS) -> float:
    """Best time (ms) of a breadth-first search over 1200 x 1200 cells, a quarter of them blocked, and a sweep over as many."""
    n = 1200
    rng = np.random.default_rng(7)
    blocked = rng.random((n, n)) < 0.25
    blocked[[0, -1], :] = True
    blocked[:, [0, -1]] = True
    blocked[n // 2, n // 2] = False
    field = rng.random((n, n), np.float32) * np.float32(100.0)
    best = math.inf
    for _ in range(repeats + 1):  # the first one loads the kernels
        work = field.copy()
        began = time.thread_time()
        # arrays and all: what is measured includes getting memory
        distance, queue = np.empty(n * n, np.int32), np.empty(n * n, np.int32)
        flood(blocked, n // 2 * n + n // 2, distance, queue)
        relax(work)
        best = min(best, time.thread_time() - began)
    return best * 1e3


class Stages:
    """Times of calls, those of calls within them left out."""

    def __init__(self) -> None:
        self.calls: dict[str, list[float]] = {}
        """By stage: the wall time of each call (s), in their order."""
        self._inner = [0.0]
        self._replaced: list[tuple[Any, str, Any]] = []

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Times every call of `owner.name` from now on."""
        own: Any = owner.__dict__.get(name)
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

        self._replaced.append((owner, name, own))
        setattr(owner, name, timed)

    def leave(self) -> None:
        """Puts everything back."""
        for owner, name, own in reversed(self._replaced):
            if own is None:
                delattr(owner, name)
            else:
                setattr(owner, name, own)
        self._replaced.clear()


def where_time_goes(scenario: Scenario, repeats: int) -> dict[str, Any]:
    """Wall time of each stage of a run.

    A run is the same every time, call by call: of each call, the fastest of `repeats` runs counts, so that what other
    processes took is left out.
    """
    stages = Stages()
    for owner, name, stage in _watched(scenario):
        stages.watch(owner, name, stage)
    best: dict[str, Any] = {}
    simulated = 0.0
    try:
        for repeat in range(repeats + 1):
            stages.calls.clear()
            run = Run(scenario)
            while run.step():
                pass
            simulated = run.robot.time
            if repeat:  # the first one loads the kernels
                for stage, calls in stages.calls.items():
                    times = np.array(calls)
                    best[stage] = np.minimum(best[stage], times) if stage in best else times
    finally:
        stages.leave()
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
        (Lidar, "_ranges", "lidar"),  # cast when a costmap reads it, within the costmap's update
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


@dataclass(frozen=True)
class SpeedTask:
    """Called with the name of what is to be measured."""

    scenario: Scenario
    repeats: int
    """Runs of the whole; of a scene 15 times as many calls."""

    def __call__(self, name: str) -> dict[str, Any]:
        """Its times, with the calibration of that moment."""
        before = calibration_ms(min(self.repeats, CALIBRATION_RUNS))
        if name == WHOLE:
            told = self._whole()
        elif name == WHERE:
            told = where_time_goes(self.scenario, self.repeats)
        else:
            told = {"ms": self._scene(name)}
        return {**told, "calibration_ms": min(before, calibration_ms(min(self.repeats, CALIBRATION_RUNS)))}

    def _whole(self) -> dict[str, Any]:
        run = run_scenario(self.scenario)
        factors: list[float] = []
        busy: list[float] = []
        for _ in range(self.repeats):
            began = time.thread_time()
            run = run_scenario(self.scenario)
            busy.append(run.simulated_s / (time.thread_time() - began))
            factors.append(run.real_time_factor)
        return {
            "simulated_s": run.simulated_s,
            "factors": factors,
            "factors_of_core_time": busy,
            "states": [goal.state for goal in run.goals],
        }

    def _scene(self, name: str) -> float:
        from navstack.bench.speed_scenes import SCENES

        work = SCENES[name]()
        many, warm = 15 * self.repeats, 5
        times: list[float] = []
        gc.disable()
        try:
            for i in range(many + warm):
                began = time.thread_time()
                work(i)
                times.append(time.thread_time() - began)
        finally:
            gc.enable()
        return 1e3 * median(times[warm:])


def speed_jobs() -> list[Job]:
    """The whole, its stages, and the single scenes."""
    from navstack.bench.speed_scenes import SCENES

    return [Job(name, name) for name in (WHOLE, WHERE, *SCENES)]


def read_reference(file: Path) -> dict[str, Any]:
    """Times to compare with: `{"calibration_ms": .., "cases": {name: {"ms": ..}}}`. Raises InputError."""
    try:
        told: Any = json.loads(file.read_text(encoding="utf-8"))
        calibration = float(told["calibration_ms"])
        cases = {str(name): float(case["ms"]) for name, case in told["cases"].items()}
        if not (calibration > 0.0 and all(ms > 0.0 for ms in cases.values())):
            raise ValueError("times must be above 0")
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc
    except (ValueError, KeyError, TypeError, AttributeError) as exc:
        raise InputError(
            f"{file} holds no reference times ({type(exc).__name__}: {exc}); it must look like "
            '{"calibration_ms": 25.0, "cases": {"dwa_turtlebot": {"ms": 1.5}}}',
            file=str(file),
        ) from exc
    return {"calibration_ms": calibration, "cases": cases}


def speed_tables(results: Sequence[JobResult], reference: Mapping[str, Any] | None) -> list[Table]:
    """The real-time factor, where a simulated second goes, and the scenes; with ratios to the reference where given."""
    found = {r.key: r.value for r in results if not r.failed}
    tables: list[Table] = []
    if WHOLE in found:
        whole = found[WHOLE]
        row = {
            "goals": " ".join(whole["states"]),
            "simulated_s": whole["simulated_s"],
            "runs": len(whole["factors"]),
            "median": median(whole["factors"]),
            "best": max(whole["factors"]),
            "core_median": median(whole["factors_of_core_time"]),
            "calibration_ms": whole["calibration_ms"],
        }
        tables.append(Table("the whole, recording on, one core: times real time", _WHOLE, [row]))
    if WHERE in found:
        tables.append(_where_table(found[WHERE]))
    rows = [
        {
            "scene": name,
            "ms": told["ms"],
            "calibration_ms": told["calibration_ms"],
            **_ratio(name, told, reference),
        }
        for name, told in found.items()
        if name not in (WHOLE, WHERE)
    ]
    columns = _SCENES if reference is not None else _SCENES[:-1]
    tables.append(Table("single stages", columns, rows))
    return tables


def _ratio(name: str, told: Mapping[str, Any], reference: Mapping[str, Any] | None) -> dict[str, Any]:
    if reference is None or name not in reference["cases"]:
        return {"ratio": None}
    then = reference["cases"][name] * told["calibration_ms"] / reference["calibration_ms"]
    return {"ratio": then / told["ms"]}


def _where_table(told: Mapping[str, Any]) -> Table:
    stages, simulated = told["stages"], told["simulated_s"]
    total = math.fsum(s["seconds"] for s in stages.values())
    rows = [
        {
            "stage": name,
            "percent": 100.0 * s["seconds"] / total,
            "us_per_s": 1e6 * s["seconds"] / simulated,
            "calls_per_s": s["calls"] / simulated,
            "us_per_call": 1e6 * s["seconds"] / s["calls"],
        }
        for name, s in sorted(stages.items(), key=lambda item: -item[1]["seconds"])
    ]
    rows.append({"stage": "all", "percent": 100.0, "us_per_s": 1e6 * total / simulated})
    title = f"where a simulated second goes: {simulated / total:.0f} times real time when nothing else runs"
    return Table(title, _WHERE, rows)


_WHOLE: Final = (
    Column("goals", "goals"),
    Column("simulated_s", "simulated (s)", 1),
    Column("runs", "runs"),
    Column("median", "median", 0),
    Column("best", "best", 0),
    Column("core_median", "median, by core time", 0),
    Column("calibration_ms", "calibration (ms)", 1),
)
_WHERE: Final = (
    Column("stage", "stage"),
    Column("percent", "share (%)", 1),
    Column("us_per_s", "us per simulated second", 0),
    Column("calls_per_s", "calls per second", 1),
    Column("us_per_call", "us per call", 1),
)
_SCENES: Final = (
    Column("scene", "stage"),
    Column("ms", "median (ms)", 4),
    Column("calibration_ms", "calibration (ms)", 1),
    Column("ratio", "times the reference's speed", 2),
)

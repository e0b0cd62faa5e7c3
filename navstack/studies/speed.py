"""Speed on this machine: the real-time factor of the whole stack, its share by stage, and single stages.

Shared machines change their speed. Therefore each figure comes with the calibration: the time of a fixed piece of work at the
same moment. Reference times (of the C++ stack, or of an earlier version) contain theirs, and ratios are scaled by both. Times
are CPU times of this thread, which excludes other processes; for the whole run, wall times are given as well.
"""

from __future__ import annotations

import gc
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    Bounds,
    Footprint,
    FrameTree,
    InputError,
    LaserScan,
    Pose2D,
    RobotState,
    Transform2D,
    Twist2D,
    kernel,
    read_bytes,
)
from navstack.core import Path as PosePath
from navstack.costmap import (
    CostmapParams,
    InflationLayer,
    InflationLayerParams,
    LayeredCostmap,
    ObservationSourceParams,
    ObstacleLayer,
    ObstacleLayerParams,
    VoxelLayer,
    VoxelLayerParams,
)
from navstack.local_planner import DWAParams, DWAPlanner
from navstack.plugins import ControlInput, Layer, Plugin
from navstack.scenario import Run, Scenario, run_scenario
from navstack.studies.inputs import digest_of_scenario
from navstack.studies.jobs import Job, JobResult
from navstack.studies.table import Column, Table
from navstack.studies.task import Report, Task

# --- time by stage ----------------------------------------------------------------------------------------------------


class StageTimer:
    """Times calls of methods, without the time of timed calls within them."""

    def __init__(self) -> None:
        self.calls: dict[str, list[float]] = {}
        """By stage: the wall time of each call (s), in order."""
        self._inner = [0.0]
        self._replaced: list[tuple[Any, str, Any]] = []

    def watch(self, owner: Any, name: str, stage: str) -> None:
        """Start timing every call of `owner.name`."""
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
        """Restore all methods."""
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
    from navstack.sim import Lidar, SimulatedRobot, World

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


# --- kernels of the calibration ---------------------------------------------------------------------------------------


@kernel
def flood(blocked: NDArray[np.bool_], start: int, distance: NDArray[np.int32], queue: NDArray[np.int32]) -> int:
    """Breadth-first distances from a cell of a (ny, nx) bool grid whose border is blocked; the number of reached cells.

    `distance` int32 and `queue` int32 have ny * nx elements.
    """
    ny, nx = blocked.shape
    flat = blocked.reshape(ny * nx)
    distance[:] = -1
    distance[start] = 0
    queue[0] = start
    head = 0
    tail = 1
    while head < tail:
        cell = queue[head]
        head += 1
        for step in (-1, 1, -nx, nx):
            other = cell + step
            if other >= 0 and other < flat.size and not flat[other] and distance[other] < 0:
                distance[other] = distance[cell] + 1
                queue[tail] = other
                tail += 1
    return tail


@kernel
def relax(field: NDArray[np.float32]) -> None:
    """One in-place sweep over a (ny, nx) float32 field: limits each cell to 0.7 above its smallest neighbor (of four)."""
    ny, nx = field.shape
    for iy in range(1, ny - 1):
        for ix in range(1, nx - 1):
            beside = min(field[iy, ix - 1], field[iy, ix + 1])
            above = min(field[iy - 1, ix], field[iy + 1, ix])
            bound = min(beside, above) + np.float32(0.7)
            if bound < field[iy, ix]:
                field[iy, ix] = bound


# --- the speed of the machine -----------------------------------------------------------------------------------------


CALIBRATION_RUNS: Final = 7
_CELLS: Final = 1200


def calibration_ms(repeats: int = CALIBRATION_RUNS) -> float:
    """Return the best time (ms) of a breadth-first search on 1200 x 1200 cells, a quarter blocked, and one relaxation sweep."""
    n = _CELLS
    rng = np.random.default_rng(7)
    blocked = rng.random((n, n)) < 0.25
    blocked[[0, -1], :] = True
    blocked[:, [0, -1]] = True
    blocked[n // 2, n // 2] = False
    field = rng.random((n, n), np.float32) * np.float32(100.0)
    best = math.inf
    for _ in range(repeats + 1):  # the first run loads the kernels
        work = field.copy()
        start = time.thread_time()
        # the allocation is part of the measured work
        distance, queue = np.empty(n * n, np.int32), np.empty(n * n, np.int32)
        flood(blocked, n // 2 * n + n // 2, distance, queue)
        relax(work)
        best = min(best, time.thread_time() - start)
    return best * 1e3


MAX_REFERENCE_BYTES: Final = 1_000_000
WHOLE_RUN, STAGES_OF_RUN = "whole run", "stages of a run"
_CALLS_PER_REPEAT: Final = 15
_SCENE_WEIGHT: Final = 0.12
"""Time of the calls of a scene relative to that of a run."""
_WARM_UP_CALLS: Final = 5

_WHOLE_COLUMNS: Final = (
    Column("goals", "goals"),
    Column("simulated_s", "simulated (s)", 1),
    Column("runs", "runs"),
    Column("median", "median", 0),
    Column("best", "best", 0),
    Column("core_median", "median, CPU time", 0),
    Column("calibration_ms", "calibration (ms)", 1),
)
_STAGES_COLUMNS: Final = (
    Column("stage", "stage"),
    Column("percent", "share (%)", 1),
    Column("us_per_s", "us per simulated second", 0),
    Column("calls_per_s", "calls per second", 1),
    Column("us_per_call", "us per call", 1),
)
_SCENES_COLUMNS: Final = (
    Column("scene", "stage"),
    Column("ms", "median (ms)", 4),
    Column("calibration_ms", "calibration (ms)", 1),
)
_RATIO_COLUMN: Final = Column("ratio", "speed relative to the reference", 2)


@dataclass(frozen=True)
class SpeedTask(Task):
    """Measures the whole run, its stages, or a single scene."""

    scenario: Scenario
    repeats: int
    """Number of runs; a scene is called 15 times as often."""
    named: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Names of the scenario and its parameters."""
    reference: Mapping[str, Any] | None = None
    """Times to compare with, as `read_reference` returns them."""

    def __call__(self, name: str, /) -> dict[str, Any]:
        """The times of the job of that name, with the calibration of that moment."""
        repeats = min(self.repeats, CALIBRATION_RUNS)
        before = calibration_ms(repeats)
        if name == WHOLE_RUN:
            times = self._whole_run()
        elif name == STAGES_OF_RUN:
            times = stage_times(self.scenario, self.repeats)
        else:
            times = {"ms": self._scene(name)}
        return {**times, "calibration_ms": min(before, calibration_ms(repeats))}

    def _whole_run(self) -> dict[str, Any]:
        run = run_scenario(self.scenario)
        factors: list[float] = []
        cpu_factors: list[float] = []
        for _ in range(self.repeats):
            start = time.thread_time()
            run = run_scenario(self.scenario)
            cpu_factors.append(run.simulated_s / (time.thread_time() - start))
            factors.append(run.real_time_factor)
        return {
            "simulated_s": run.simulated_s,
            "factors": factors,
            "factors_of_core_time": cpu_factors,
            "states": [goal.state for goal in run.goals],
        }

    def _scene(self, name: str) -> float:
        """Return the median CPU time of a call (ms)."""
        work = SCENES[name]()
        times: list[float] = []
        gc.disable()
        try:
            for i in range(_CALLS_PER_REPEAT * self.repeats + _WARM_UP_CALLS):
                start = time.thread_time()
                work(i)
                times.append(time.thread_time() - start)
        finally:
            gc.enable()
        return 1e3 * median(times[_WARM_UP_CALLS:])

    def described(self) -> dict[str, Any]:
        """Return the scenario and the number of runs."""
        scenario = digest_of_scenario(self.scenario)
        return {"bench": "speed", **self.named, "scenario": scenario, "repeats": self.repeats}

    def jobs(self) -> list[Job]:
        """Return the whole run, its stages, and the single scenes."""
        run = float(self.repeats + 1)
        weights = {WHOLE_RUN: run, STAGES_OF_RUN: run} | dict.fromkeys(SCENES, _SCENE_WEIGHT * self.repeats)
        return [Job(name, name, weight) for name, weight in weights.items()]

    def report(self, results: Sequence[JobResult]) -> Report:
        """Return the real-time factor, the stages of a run, and the scenes, with ratios to the reference if there is one."""
        return Report(speed_tables(results, self.reference), speed_document(results, self.reference))


def read_reference(file: Path) -> dict[str, Any]:
    """Reference times: `{"calibration_ms": .., "cases": {name: {"ms": ..}}}`. Raises InputError."""
    try:
        document: Any = json.loads(read_bytes(file, MAX_REFERENCE_BYTES))
        calibration = float(document["calibration_ms"])
        cases = {str(name): float(case["ms"]) for name, case in document["cases"].items()}
        if not (calibration > 0.0 and all(ms > 0.0 for ms in cases.values())):
            raise ValueError("times must be above 0")
    except OSError as exc:
        raise InputError(f"cannot read {file}: {exc.strerror or exc}", file=str(file)) from exc
    except (ValueError, KeyError, TypeError, AttributeError) as exc:
        raise InputError(
            f"{file} contains no reference times ({type(exc).__name__}: {exc}); the expected format is "
            '{"calibration_ms": 25.0, "cases": {"dwa_turtlebot": {"ms": 1.5}}}',
            file=str(file),
        ) from exc
    return {"calibration_ms": calibration, "cases": cases}


def speed_tables(results: Sequence[JobResult], reference: Mapping[str, Any] | None) -> list[Table]:
    """Return the real-time factor, the stages of a run, and the scenes, with ratios to the reference if there is one."""
    found = {r.key: r.value for r in results if not r.failed}
    tables: list[Table] = []
    if WHOLE_RUN in found:
        tables.append(_whole_table(found[WHOLE_RUN]))
    if STAGES_OF_RUN in found:
        tables.append(_stages_table(found[STAGES_OF_RUN]))
    rows = [
        {
            "scene": name,
            "ms": times["ms"],
            "calibration_ms": times["calibration_ms"],
            "ratio": _ratio(name, times, reference),
        }
        for name, times in found.items()
        if name not in (WHOLE_RUN, STAGES_OF_RUN)
    ]
    columns = _SCENES_COLUMNS if reference is None else (*_SCENES_COLUMNS, _RATIO_COLUMN)
    return [*tables, Table("single stages", columns, rows)]


def speed_document(results: Sequence[JobResult], reference: Mapping[str, Any] | None) -> dict[str, Any]:
    """For JSON; `--reference` reads `calibration_ms` and `cases`."""
    found = {r.key: r.value for r in results if not r.failed}
    scenes = {name: times for name, times in found.items() if name not in (WHOLE_RUN, STAGES_OF_RUN)}
    ratios = {name: _ratio(name, times, reference) for name, times in scenes.items()}
    return {
        "calibration_ms": min((times["calibration_ms"] for times in found.values()), default=None),
        "cases": {name: {"ms": times["ms"]} for name, times in scenes.items()},
        "measured": found,
        "ratios": ratios if reference is not None else None,
    }


def _ratio(name: str, times: Mapping[str, Any], reference: Mapping[str, Any] | None) -> float | None:
    """Reference time over measured time, both scaled by their calibrations."""
    if reference is None or name not in reference["cases"]:
        return None
    then = reference["cases"][name] * times["calibration_ms"] / reference["calibration_ms"]
    return then / times["ms"]


def _whole_table(whole: Mapping[str, Any]) -> Table:
    row = {
        "goals": " ".join(whole["states"]),
        "simulated_s": whole["simulated_s"],
        "runs": len(whole["factors"]),
        "median": median(whole["factors"]),
        "best": max(whole["factors"]),
        "core_median": median(whole["factors_of_core_time"]),
        "calibration_ms": whole["calibration_ms"],
    }
    return Table("real-time factor of the whole stack, with recording, on one core", _WHOLE_COLUMNS, [row])


def _stages_table(times: Mapping[str, Any]) -> Table:
    stages, simulated = times["stages"], times["simulated_s"]
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
    title = f"time per simulated second by stage: real-time factor {simulated / total:.0f} without other load"
    return Table(title, _STAGES_COLUMNS, rows)


# --- single stages ----------------------------------------------------------------------------------------------------
# In the scenes used to time the C++ stack. Costmaps: S x S m at 0.05 m around the robot; walls at 0.45 S; twelve discs of
# radius 0.02 S, disc i at distance 0.35 S (0.6 + 0.05 i) in direction 0.7 i + 0.2 (rad); one scan of 640 beams over a full
# circle. DWA: 4 x 4 m, walls at 1.9 m, three discs, range 3 m, inflation 0.5 m with cost scaling 5 / m; a plan of 42 poses;
# the turtlebot's limits.
#
# Global planners are missing: C++ was timed on the Willow Garage map, which is not part of navstack, and times on other maps
# do not compare. `tools/bench/global_planner.py` measures them where that map is available.


Stage = Callable[[int], object]
"""Performs the work; its argument is the number of the call."""
Disc = tuple[float, float, float]

BEAMS: Final = 640


def scan(walls: float, discs: Sequence[Disc], stamp: float = 0.0) -> LaserScan:
    """Return the scan of a lidar at the origin between walls at +-`walls` m and discs (x, y, radius)."""
    angles = -math.pi + np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    c, s = np.cos(angles), np.sin(angles)
    ranges: NDArray[np.float64] = walls / np.maximum(np.abs(c), np.abs(s))
    for x, y, radius in discs:
        along, off = c * x + s * y, c * y - s * x
        hit = (along > 0.0) & (np.abs(off) < radius)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(radius**2 - off[hit] ** 2))
    return LaserScan(
        ranges.astype(np.float32),
        -math.pi,
        2.0 * math.pi / BEAMS,
        0.1,
        30.0,
        stamp=stamp,
        frame="laser",
        topic="scan",
        height=0.3,
    )


def room(size: float) -> list[Disc]:
    """Return the twelve discs of a costmap scene of `size` (m)."""
    reaches = [(0.35 * size * (0.6 + 0.05 * i), 0.7 * i + 0.2) for i in range(12)]
    return [(reach * math.cos(angle), reach * math.sin(angle), 0.02 * size) for reach, angle in reaches]


def rolling_costmap(
    size: float, reach: float, *, voxel: bool = False, inflate: bool = False, frames: FrameTree | None = None
) -> LayeredCostmap:
    """Return the local costmap of the scenes: `size` x `size` m at 0.05 m, marked and cleared within `reach` m by `scan`.

    `frames` contains odom, base_link and the lidar's frame `laser`; by default, the robot is at the origin.
    """
    source = ObservationSourceParams(
        data_type="LaserScan", marking=True, clearing=True, obstacle_range=reach, raytrace_range=reach
    )
    common: dict[str, Any] = {"observation_sources": "scan", "sources": {"scan": source}, "track_unknown_space": voxel}
    layers = [
        Plugin[Layer[Any]]("obstacle_layer", VoxelLayer, VoxelLayerParams(z_voxels=2, z_resolution=0.2, **common))
        if voxel
        else Plugin[Layer[Any]]("obstacle_layer", ObstacleLayer, ObstacleLayerParams(**common))
    ]
    if inflate:
        params = InflationLayerParams(inflation_radius=0.5, cost_scaling_factor=5.0)
        layers.append(Plugin[Layer[Any]]("inflation_layer", InflationLayer, params))
    if frames is None:
        frames = frames_at_origin()
    return LayeredCostmap(
        "local_costmap",
        CostmapParams(global_frame="odom", rolling_window=True, width=size, height=size, resolution=0.05),
        layers,
        footprint=Footprint.from_radius(0.18),
        frames=frames,
    )


def frames_at_origin() -> FrameTree:
    """odom, base_link and laser, all at the origin at time 0."""
    frames = FrameTree()
    frames.set_static("base_link", "laser", Transform2D())
    frames.set("odom", "base_link", Transform2D(), 0.0)
    return frames


def costmap_stage(size: float, reach: float, *, voxel: bool = False, whole: bool = False) -> Stage:
    """Clear and marks with a scan; with `whole`, also moves the rolling window and inflates."""
    costmap = rolling_costmap(size, reach, voxel=voxel, inflate=whole)
    seen = [scan(0.45 * size, room(size)) for _ in range(5)]
    layer = costmap.layer("obstacle_layer")
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)

    def work(i: int) -> None:
        costmap.observe(seen[i % 5])
        if whole:
            costmap.update_at(Pose2D(0.06 * (i % 5), 0.0), 0.0)
        else:
            layer.update_bounds(Pose2D(0.0, 0.0), 0.0, Bounds())

    return work


def dwa_stage(vx_samples: int, vth_samples: int, sim_time: float) -> Stage:
    """Return a cycle of DWA: sets the plan, then rolls out, scores and selects."""
    costmap = rolling_costmap(4.0, 3.0, inflate=True)
    costmap.observe(scan(1.9, [(0.9, 0.6, 0.15), (0.8, -0.7, 0.15), (-0.9, 0.8, 0.2)]))
    costmap.update_at(Pose2D(0.0, 0.0), 0.0)
    planner = DWAPlanner(
        DWAParams(
            max_vel_trans=0.5, max_vel_x=0.5, min_vel_x=0.0, max_vel_y=0.0, min_vel_y=0.0, max_vel_theta=1.0,
            min_vel_theta=0.4, acc_lim_x=1.0, acc_lim_y=0.0, acc_lim_theta=2.0, controller_frequency=5.0,
            path_distance_bias=64.0, goal_distance_bias=24.0, occdist_scale=0.5, sim_granularity=0.025,
            vx_samples=vx_samples, vy_samples=1, vth_samples=vth_samples, sim_time=sim_time,
        )
    )  # fmt: skip
    i = np.arange(42)
    poses = np.column_stack((0.03 * i, 0.1 * np.sin(0.05 * i), np.zeros(42))).astype(np.float64)
    plan = PosePath(poses, "odom")
    goal = plan[len(plan) - 1]
    state = RobotState(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.1), 0.0)
    inputs = ControlInput(state, costmap.master, Footprint.from_radius(0.18))

    def work(_: int) -> None:
        planner.set_plan(plan, goal)
        planner.compute_command(inputs)

    return work


SCENES: Final[dict[str, Callable[[], Stage]]] = {
    "obstacle_update_4m": lambda: costmap_stage(4.0, 3.0),
    "obstacle_update_10m": lambda: costmap_stage(10.0, 10.0),
    "costmap_update_4m": lambda: costmap_stage(4.0, 3.0, whole=True),
    "costmap_update_10m": lambda: costmap_stage(10.0, 10.0, whole=True),
    "voxel_update_4m": lambda: costmap_stage(4.0, 3.0, voxel=True),
    "voxel_costmap_update_10m": lambda: costmap_stage(10.0, 10.0, voxel=True, whole=True),
    "dwa_turtlebot": lambda: dwa_stage(6, 20, 1.0),
    "dwa_6x20": lambda: dwa_stage(6, 20, 1.7),
    "dwa_20x20": lambda: dwa_stage(20, 20, 1.7),
    "dwa_20x40": lambda: dwa_stage(20, 40, 1.7),
}
"""By their names in files of reference times."""

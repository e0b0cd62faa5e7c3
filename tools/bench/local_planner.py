#!/usr/bin/env python3
"""Time of one cycle of the local planners, compared with C++, and their times and memory over many cycles.

    python tools/bench/local_planner.py [--reference FOLDER] [--runs N] [--json]
    python tools/bench/local_planner.py --cycles 100000

FOLDER contains `calibrate.py` and `cpp_reference.json` (default: see `reference.py`); without it, only the times of navstack are
printed. A cycle: transform of the plan, grids, velocity samples, rollouts, scores, table. The scoring lines are for 2000
trajectories of 56 points, as in Nav2's MPPI, from costmap and trajectories to the table of scores; grids are built each time.
--cycles runs that many cycles of each planner along a drive, and prints the memory in use.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import json
import math
import resource
import sys
import time
import tracemalloc
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from reference import Reference, data_folder
from scipy.ndimage import distance_transform_edt

from navstack.core import ControlError, Costmap, Footprint, GridGeometry, Path, Pose2D, RobotState, Twist2D
from navstack.local_planner import DWAParams, DWAPlanner, TrajectoryPlanner, TrajectoryPlannerParams
from navstack.local_planner.dwa import DEFAULT_CRITICS, make_critics
from navstack.local_planner.scoring import score
from navstack.plugins import CRITICS, LOCAL_PLANNERS, ControlInput, LocalPlanner, Rollouts, ScoringContext

sys.path.insert(0, str(FilePath(__file__).resolve().parents[2] / "examples" / "velocity_sequences"))
from velocity_sequences import simulate_sequences

TURTLEBOT: dict[str, Any] = {
    "max_vel_trans": 0.5,
    "max_vel_x": 0.5,
    "min_vel_x": 0.0,
    "max_vel_y": 0.0,
    "min_vel_y": 0.0,
    "max_vel_theta": 1.0,
    "min_vel_theta": 0.4,
    "acc_lim_x": 1.0,
    "acc_lim_y": 0.0,
    "acc_lim_theta": 2.0,
    "controller_frequency": 5.0,
    "path_distance_bias": 64.0,
    "goal_distance_bias": 24.0,
    "occdist_scale": 0.5,
    "sim_granularity": 0.025,
    "vy_samples": 1,
}
EXTRA: dict[str, dict[str, Any]] = {
    "trajectory_rollout": {
        "dwa": True,
        "holonomic_robot": False,
        "path_distance_bias": 0.6,
        "goal_distance_bias": 0.8,
        "occdist_scale": 0.01,
        "min_vel_theta": -1.0,
        "min_vel_x": 0.1,
    }
}
"""Further parameters of a planner for `--cycles`."""
CASES: dict[str, tuple[int, int, float]] = {
    "dwa_turtlebot": (6, 20, 1.0),
    "dwa_6x20": (6, 20, 1.7),
    "dwa_20x20": (20, 20, 1.7),
    "dwa_20x40": (20, 40, 1.7),
}
DISCS = ((0.9, 0.6, 0.15), (0.8, -0.7, 0.15), (-0.9, 0.8, 0.2))
WALL_M, BEAMS, RANGE_M, INFLATION_M, DECAY = 1.9, 640, 3.0, 0.5, 5.0


def beam_length(angle: float) -> float:
    """Distance (m) from the origin to the wall or disc that a beam hits."""
    c, s = math.cos(angle), math.sin(angle)
    length = WALL_M / max(abs(c), abs(s))
    for x, y, radius in DISCS:
        along = x * c + y * s
        off = x * s - y * c
        if along > 0.0 and abs(off) < radius:
            length = min(length, along - math.sqrt(radius * radius - off * off))
    return length


def scene(footprint: Footprint) -> Costmap:
    """4 x 4 m at 0.05 m around the origin: walls and discs in a full lidar scan, inflated."""
    geometry = GridGeometry(80, 80, 0.05, -2.0, -2.0)
    lethal = np.zeros(geometry.shape, bool)
    for angle in np.linspace(-math.pi, math.pi, BEAMS, endpoint=False):
        length = beam_length(float(angle))
        cell = geometry.world_to_cell(length * math.cos(angle), length * math.sin(angle))
        if length < RANGE_M and cell is not None:
            lethal[cell[1], cell[0]] = True
    away: NDArray[np.float64] = distance_transform_edt(~lethal) * geometry.resolution
    costs = np.trunc(252.0 * np.exp(-DECAY * (away - footprint.inscribed_radius)))
    costs = np.where(away <= footprint.inscribed_radius, 253.0, np.where(away <= INFLATION_M, costs, 0.0))
    costs[lethal] = 254.0
    return Costmap(geometry, costs.astype(np.uint8), "odom")


def plan() -> Path:
    """42 poses ahead of the robot, gently curved."""
    i = np.arange(42)
    return Path(np.column_stack((0.03 * i, 0.1 * np.sin(0.05 * i), np.zeros(42))), "odom")


def median_ms(planner: LocalPlanner, inputs: ControlInput, runs: int) -> tuple[float, float, int]:
    """(median, best) of a cycle in ms, and how many samples it had. A cycle sets the plan, as in the C++ measurement."""
    path = plan()
    goal = path[len(path) - 1]
    times: list[float] = []
    samples = 0
    for i in range(runs + 20):
        start = time.perf_counter()
        planner.set_plan(path, goal)
        result = planner.compute_command(inputs)
        if i >= 20:
            times.append(time.perf_counter() - start)
        samples = 0 if result.samples is None else len(result.samples)
    return 1e3 * float(np.median(times)), 1e3 * min(times), samples


def rollout_rows(calibration: Reference | None, runs: int) -> list[dict[str, Any]]:
    """Cycles of trajectory rollout in the scene of the C++ times: those of `times.json` in the folder `golden_ros1`."""
    folder = data_folder("golden_ros1")
    if not (folder / "times.json").is_file():
        return []
    times = json.loads((folder / "times.json").read_text())
    data, scenes = np.load(folder / "trajectory_planner.npz"), np.load(folder / "trajectory_planner_scenes.npz")
    ox, oy, resolution = scenes["obst360_2/info"].tolist()
    costs, path = scenes["obst360_2/costmap"], scenes["obst360_2/plan"]
    costmap = Costmap(GridGeometry(*costs.shape[::-1], resolution, ox, oy), costs.copy(), "odom")
    x, y, yaw, vx, vy, wz = scenes["obst360_2/state"].tolist()
    state = RobotState(Pose2D(x, y, yaw), Twist2D(vx, vy, wz))
    rows: list[dict[str, Any]] = []
    for case in times["trajectory_planner"]:
        values = json.loads(bytes(data[f"{case['config']}/config_json"]).decode())
        footprint = Footprint(data[f"footprint_{values.pop('footprint')}"])
        values["controller_frequency"] = 1.0 / values.pop("sim_period")
        values["vtheta_samples"] = {126: 18, 380: 18}.get(case["samples"], values["vtheta_samples"])
        fields = TrajectoryPlannerParams.model_fields
        typed = {k: bool(v) if fields[k].annotation is bool else v for k, v in values.items()}
        planner = TrajectoryPlanner(TrajectoryPlannerParams(**typed))
        now = calibration.calibration_ms() if calibration else None
        taken: list[float] = []
        result = None
        for i in range(runs + 20):
            start = time.perf_counter()
            with contextlib.suppress(ControlError):
                result = planner.search(state, costmap, footprint, path, Pose2D(*path[-1]))
            if i >= 20:
                taken.append(time.perf_counter() - start)
        median = 1e3 * float(np.median(taken))
        samples = 0 if result is None or result.samples is None else len(result.samples)
        name = f"rollout_{case['config']}"
        row: dict[str, Any] = {"case": name, "samples": samples, "median_ms": median, "best_ms": 1e3 * min(taken)}
        if now:
            row["calibration_ms"] = now
            row["times_cpp"] = case["ms"] * now / times["calibration_ms"] / median
        rows.append(row)
    return rows


SEQUENCES, POINTS, SEQUENCE_PERIOD_S = 2000, 56, 0.05


def trajectories(state: RobotState, planner: DWAPlanner) -> dict[str, Rollouts]:
    """2000 x 56 points: noise around one velocity as in MPPI, and constant velocities over the window."""
    rng = np.random.default_rng(0)
    noisy = np.zeros((SEQUENCES, POINTS, 3))
    noisy[:, :, 0] = 0.3 + rng.normal(0.0, 0.2, (SEQUENCES, POINTS))
    noisy[:, :, 2] = 0.1 + rng.normal(0.0, 0.4, (SEQUENCES, POINTS))
    fan = np.zeros((SEQUENCES, 1, 3))
    fan[:, 0, 0] = rng.uniform(0.1, 0.5, SEQUENCES)
    fan[:, 0, 2] = rng.uniform(-1.0, 1.0, SEQUENCES)
    sequences = {"noisy": noisy, "fan": np.repeat(fan, POINTS, axis=1)}
    return {name: simulate_sequences(v, state, planner.limits, SEQUENCE_PERIOD_S)[1] for name, v in sequences.items()}


def scoring_rows(inputs: ControlInput, calibration: Reference | None, runs: int) -> list[dict[str, Any]]:
    """Scored points per second, with the default critics of DWA and with all registered critics."""
    rows: list[dict[str, Any]] = []
    line = plan()
    for critics in (DEFAULT_CRITICS, tuple(entry.name for entry in CRITICS)):
        params = DWAParams(**TURTLEBOT, twirling_scale=0.1, critics=[{"name": c, "type": c} for c in critics])
        planner = DWAPlanner(params)
        made = make_critics(params)
        for name, rollouts in trajectories(inputs.state, planner).items():
            now = calibration.calibration_ms() if calibration else None
            times: list[float] = []
            table = None
            for i in range(runs + 3):
                context = ScoringContext(
                    inputs.state,
                    inputs.costmap,
                    inputs.footprint,
                    line.poses,
                    line[len(line) - 1],
                    planner.limits,
                )
                start = time.perf_counter()
                table = score(made, context, rollouts)
                if i >= 3:
                    times.append(time.perf_counter() - start)
            assert table is not None
            points = SEQUENCES * POINTS
            rows.append(
                {
                    "case": f"scoring_{name}",
                    "critics": len(critics),
                    "rejected": int((table.rejected_by >= 0).sum()),
                    "median_ms": 1e3 * float(np.median(times)),
                    "best_ms": 1e3 * min(times),
                    "million_points_s": points / float(np.median(times)) / 1e6,
                    "best_million_points_s": points / min(times) / 1e6,
                    "calibration_ms": now,
                }
            )
    return rows


def soak(name: str, values: dict[str, Any], cycles: int) -> dict[str, Any]:
    """Times and memory of `cycles` cycles of one planner, with a new plan every 50 cycles."""
    cls = LOCAL_PLANNERS.get(name).cls
    planner = cls(cls.Params(**{k: v for k, v in values.items() if k in cls.Params.model_fields}))
    footprint = Footprint.from_radius(0.18)
    costmap = scene(footprint)
    path = plan()
    goal = path[len(path) - 1]
    rng = np.random.default_rng(0)
    states = [
        RobotState(
            Pose2D(*rng.normal(0.0, 0.05, 3)), Twist2D(float(rng.uniform(0.0, 0.5)), 0.0, float(rng.uniform(-0.5, 0.5)))
        )
        for _ in range(997)
    ]
    times, busy = (
        np.full(cycles, np.nan),
        np.full(cycles, np.nan),
    )  # initialized, so that their pages are resident from the start
    memory: list[tuple[int, float]] = []
    traced: list[int] = []
    refused = 0
    for i in range(cycles):
        if i % max(cycles // 10, 1) == 0:
            gc.collect()
            memory.append((i, resident_mb()))
        inputs = ControlInput(states[i % len(states)], costmap, footprint)
        start, at = time.perf_counter(), time.thread_time()
        if i % 50 == 0:
            planner.set_plan(path, goal)
        try:
            planner.compute_command(inputs)
        except ControlError:
            refused += 1
        times[i], busy[i] = time.perf_counter() - start, time.thread_time() - at
    gc.collect()
    memory.append((cycles, resident_mb()))
    # memory of Python objects after more cycles; tracing is slow, so it starts here
    tracemalloc.start()
    for _ in range(3):
        for i in range(max(1000, cycles // 50)):
            with contextlib.suppress(ControlError):
                planner.compute_command(ControlInput(states[i % len(states)], costmap, footprint))
        gc.collect()
        traced.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    warm = min(cycles // 10, 1000)  # kernels loaded, buffers in place
    wall, cpu = 1e3 * times[warm:], 1e3 * busy[warm:]
    return {
        "planner": name,
        "cycles": cycles,
        "refused": refused,
        "resident_mb": [(i, round(now, 2)) for i, now in memory],
        "grown_mb": memory[-1][1] - memory[1][1],
        "traced_bytes": traced,
        "median_ms": float(np.median(wall)),
        "p99_ms": float(np.percentile(wall, 99)),
        "median_cpu_ms": float(np.median(cpu)),
        "p99_cpu_ms": float(np.percentile(cpu, 99)),
        "worst_cpu_ms": float(cpu.max()),
    }


def resident_mb() -> float:
    """Resident memory of this process (MiB)."""
    pages = int(FilePath("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 2**20


def main() -> None:
    """Prints a line per case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", type=FilePath, help="folder with calibrate.py and cpp_reference.json")
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--cycles", type=int, default=0, help="instead, run this many cycles of each planner")
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    args = parser.parse_args()

    if args.cycles:
        rows = [soak(name, {**TURTLEBOT, **EXTRA.get(name, {})}, args.cycles) for name in ("dwa", "trajectory_rollout")]
        if args.json:
            json.dump(rows, sys.stdout, indent=1)
            return
        for row in rows:
            print(f"{row['planner']}: {row['cycles']} cycles, {row['refused']} without a legal sample")
            for clock, unit in (("", "elapsed time"), ("_cpu", "CPU time")):
                median, p99 = row[f"median{clock}_ms"], row[f"p99{clock}_ms"]
                print(f"  median {median:.3f} ms, p99 {p99:.3f} ms = {p99 / median:.2f} x median, {unit}")
            print(f"  resident MiB {', '.join(f'{i}: {mb:.1f}' for i, mb in row['resident_mb'])}")
            print(
                f"  grown after the first tenth: {row['grown_mb']:+.2f} MiB; Python objects (bytes): {row['traced_bytes']}"
            )
        return

    footprint = Footprint.from_radius(0.18)
    inputs = ControlInput(RobotState(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.1)), scene(footprint), footprint)
    reference = Reference(args.reference)
    calibration = reference if reference.available else None
    rows = []
    cls = LOCAL_PLANNERS.get("dwa").cls
    for name, (nx, nw, sim_time) in CASES.items():
        now = calibration.calibration_ms() if calibration else None
        planner = cls(cls.Params(**TURTLEBOT, vx_samples=nx, vth_samples=nw, sim_time=sim_time))
        median, best, samples = median_ms(planner, inputs, args.runs)
        row: dict[str, Any] = {"case": name, "samples": samples, "median_ms": median, "best_ms": best}
        if calibration and now:
            row["calibration_ms"] = now
            row["times_cpp"] = calibration.speedup(name, median, now)
        rows.append(row)
    rows += rollout_rows(calibration, args.runs)
    scoring = scoring_rows(inputs, calibration, min(args.runs, 60))
    if args.json:
        json.dump(rows + scoring, sys.stdout, indent=1)
        return
    for row in rows:
        against = (
            f"  {row['times_cpp']:5.2f} x C++  (calibration {row['calibration_ms']:.1f} ms)"
            if "times_cpp" in row
            else ""
        )
        print(
            f"{row['case']:14s} {row['samples']:4d} samples  median {row['median_ms']:.3f} ms  "
            f"best {row['best_ms']:.3f} ms{against}"
        )
    for row in scoring:
        beside = f"  (calibration {row['calibration_ms']:.1f} ms)" if row["calibration_ms"] else ""
        print(
            f"{row['case']:14s} {SEQUENCES} x {POINTS}, {row['critics']:2d} critics, {row['rejected']:4d} rejected  median "
            f"{row['median_ms']:.2f} ms = {row['million_points_s']:.1f} M points/s  "
            f"best {row['best_ms']:.2f} ms = {row['best_million_points_s']:.1f}{beside}"
        )


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""How long one cycle of the local planners takes, against C++ where its times are at hand.

    python tools/bench/local_planner.py [--reference FOLDER] [--runs N] [--json]

FOLDER holds `calibrate.py` and `cpp_reference.json` (times of the real C++ stack with the calibration of that moment);
without it only our own times are printed. A cycle = plan into the costmap's frame, grids, samples, rollouts, scores, table.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import math
import sys
import time
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from navstack.core import Costmap, Footprint, GridGeometry, Path, Pose2D, RobotState, Twist2D
from navstack.interfaces import ControlInput, LocalPlanner
from navstack.plugins import LOCAL_PLANNERS

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
    """4 x 4 m at 0.05 m around the origin: what a full turn of a lidar sees of walls and discs, inflated."""
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


def load_calibration(folder: FilePath) -> Any:
    """The module `calibrate.py` of `folder`."""
    spec = importlib.util.spec_from_file_location("calibrate", folder / "calibrate.py")
    if spec is None or spec.loader is None:
        raise SystemExit(f"no calibrate.py in {folder}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main() -> None:
    """Prints a line per case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference", type=FilePath, help="folder with calibrate.py and cpp_reference.json")
    parser.add_argument("--runs", type=int, default=300)
    parser.add_argument("--json", action="store_true", help="one JSON document on stdout")
    args = parser.parse_args()

    footprint = Footprint.from_radius(0.18)
    inputs = ControlInput(RobotState(Pose2D(0.0, 0.0, 0.1), Twist2D(0.3, 0.0, 0.1)), scene(footprint), footprint)
    calibration = load_calibration(args.reference) if args.reference else None
    rows: list[dict[str, Any]] = []
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
    if args.json:
        json.dump(rows, sys.stdout, indent=1)
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


if __name__ == "__main__":
    main()

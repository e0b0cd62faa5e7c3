"""Time of a cycle of DWB on one core, next to Nav2's C++ (golden_nav2_w3/w3_times.json).

    python tools/bench/dwb.py [--repeats N] [--compile] [--stages]

The scene is that of the C++ times: 60 cycles of a closed loop on office_0 (64 x 64 cells), with the parameters of nav2_bringup
(20 x 20 samples, 419 of them legal), a rectangular footprint, 20 x 5 x 20 samples, or the other generator. The whole of
`compute_command` is timed: path handler, goal checker, samples, critics, table; in C++ computeVelocityCommands, which gets
its part of the plan. ratio = C++ ms * (calibration now / calibration then) / ms.

Processor times: other programs may share the processor. Calibrations are taken before and after each case, their mean counts.
`--compile` compiles the kernels of bringup in a new process without a cache, and prints the time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from reference import Reference

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, RobotState, Twist2D
from navstack.core import Path as NavPath
from navstack.plugins import LOCAL_PLANNERS, ControlInput, Inflation

NAV2 = Path(
    os.environ.get("NAVSTACK_GOLDEN_NAV2_W3") or Path(__file__).resolve().parents[3] / "shared" / "golden_nav2_w3"
)
PERIOD_S = 0.05
CYCLES = 60
OMNI = {"min_vel_x": -0.1, "min_vel_y": -0.2, "max_vel_y": 0.2, "acc_lim_y": 2.5, "decel_lim_y": -2.5}
CASES: dict[str, tuple[str, dict[str, Any]]] = {
    "dwb_bringup": ("round", {}),
    "dwb_bringup_quiet": ("round", {}),
    "dwb_noshort": ("round", {"short_circuit_trajectory_evaluation": False}),
    "dwb_rect_footprint": (
        "rect",
        {"critics": "BaseObstacle -> ObstacleFootprint", "ObstacleFootprint": {"scale": 0.02}},
    ),
    "dwb_omni": ("round", OMNI),
    "dwb_limited_accel": ("round", {"trajectory_generator_name": "dwb_plugins::LimitedAccelGenerator"}),
}


def bringup() -> dict[str, Any]:
    """nav2_bringup's parameters, as in the job of that name."""
    jobs = json.loads((NAV2 / "dwb_jobs.json").read_text())
    found: dict[str, Any] = {}
    for key, value in jobs["loop_bringup_start/office_0"]["params"].items():
        *above, last = key.removeprefix("FollowPath.").split(".")
        (found.setdefault(above[0], {}) if above else found)[last] = value
    return found


def planner(values: dict[str, Any]) -> Any:
    """DWB with nav2_bringup's parameters, and others."""
    cls: Any = LOCAL_PLANNERS.get("dwb_core::DWBLocalPlanner").cls
    tree = {**bringup(), **values}
    if isinstance(tree["critics"], str):
        old, new = tree["critics"].split(" -> ")
        tree["critics"] = [new if name == old else name for name in bringup()["critics"]]
    models = cls.Params.child_models(tree)
    sections = {n: models[n](**tree[n]) for n in models if isinstance(tree.get(n), dict)}
    known = {n: v for n, v in tree.items() if n in cls.Params.model_fields}
    return cls(cls.Params(**known, sections=sections))


class Loop:
    """The closed loop of the C++ times."""

    def __init__(self, footprint: str) -> None:
        with np.load(NAV2 / "dwb_scenes.npz") as data:
            x, y, resolution = data["scene/office_0/info"].tolist()
            costs = data[f"scene/office_0/costmap_used_{footprint}"]
            self.plan, self.start = data["scene/office_0/plan"], data["scene/office_0/start"].tolist()
            self.footprint = Footprint(data[f"footprint/{footprint}"])
        self.costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], resolution, x, y), costs, "map")

    def drive(self, controller: Any) -> list[float]:
        """Processor times (ms) of the cycles."""
        x, y, yaw, vx, vy, wz = self.start
        times = list[float]()
        controller.set_plan(NavPath(self.plan, "map"), Pose2D(*self.plan[-1].tolist()))
        for i in range(CYCLES):
            state = RobotState(Pose2D(x, y, yaw), Twist2D(vx, vy, wz), i * PERIOD_S)
            inputs = ControlInput(state, self.costmap, self.footprint, inflation=Inflation(0.22, 0.55, 3.0))
            begin = time.process_time_ns()
            vx, vy, wz = controller.compute_command(inputs).command
            times.append((time.process_time_ns() - begin) * 1e-6)
            x += PERIOD_S * (vx * np.cos(yaw) - vy * np.sin(yaw))
            y += PERIOD_S * (vx * np.sin(yaw) + vy * np.cos(yaw))
            yaw += PERIOD_S * wz
        return times


def compile_time() -> float:
    """Processor time (s) that the first cycle takes in a new process without a cache, beyond the import of numba."""
    code = (
        "import sys, time; sys.path.insert(0, sys.argv[1]); import numba; import dwb; loop, p = dwb.Loop('round'), "
        "dwb.planner({}); q, rect = dwb.planner(dwb.CASES['dwb_rect_footprint'][1]), dwb.Loop('rect'); "
        "t = time.process_time(); loop.drive(p); a = time.process_time() - t; rect.drive(q); "
        "print(a, time.process_time() - t - a)"
    )
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "XDG_CACHE_HOME": folder, "NAVSTACK_CACHE": folder}
        command = [sys.executable, "-c", code, str(Path(__file__).parent)]
        first, second = subprocess.run(
            command, check=True, capture_output=True, text=True, env=environment
        ).stdout.split()
    print(f"compiling: {float(first):.1f} s for bringup, {float(second):.1f} s more for ObstacleFootprint")
    return float(first)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=15, help="loops of 60 cycles per case")
    parser.add_argument("--compile", action="store_true")
    args = parser.parse_args()
    if args.compile:
        compile_time()
    reference = Reference()
    reference.use_processor_time()
    cases = json.loads((NAV2 / "w3_times.json").read_text())["cases"]
    print(f"{'case':20s} {'C++ here':>9s} {'median':>8s} {'best':>8s}  ratio  calibration")
    for case, (footprint, values) in CASES.items():
        loop = Loop(footprint)
        loop.drive(planner(values))
        before = reference.calibration_ms()
        times = np.array([loop.drive(planner(values)) for _ in range(args.repeats)])
        now = 0.5 * (before + reference.calibration_ms())
        median = float(np.median(times))
        scaled = cases[case]["ms"] * now / cases[case]["calibration_ms"]
        best = float(np.median(times, axis=1).min())
        print(f"{case:20s} {scaled:6.3f} ms {median:5.3f} ms {best:5.3f} ms {scaled / median:6.1f}  {now:.2f} ms")
    return 0


if __name__ == "__main__":
    sys.exit(main())

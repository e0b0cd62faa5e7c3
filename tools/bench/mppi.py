"""Time of a cycle of MPPI, whole and by stage and critic, beside Nav2's C++ (golden_nav2/nav2_times.json).

    python tools/bench/mppi.py [--repeats N] [--batch 1000 2000] [--memory]

The scene is that of the C++ times: a closed loop along the path of big_0_0_loop with nav2_bringup's parameters and its eight
critics, 56 steps. The best of the processor times of many cycles counts, because other programs may share the processor; the
median is beside it. The calibration does not cover the vector width, so the processor's name is printed. `--memory` runs
100,000 cycles and prints how the memory of the process grows.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from reference import Reference

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D, RobotState, Twist2D
from navstack.core import Path as NavPath
from navstack.interfaces import ControlInput, Inflation
from navstack.local_planner.mppi import MPPIParams, MPPIPlanner
from navstack.local_planner.mppi.critics.cost import CostCriticParams
from navstack.local_planner.mppi.critics.path_align import PathAlignCriticParams
from navstack.local_planner.mppi.critics.path_angle import PathAngleCriticParams
from navstack.local_planner.mppi.critics.path_follow import PathFollowCriticParams
from navstack.local_planner.mppi.motion_models import OMNI, MotionModelParams
from navstack.local_planner.mppi.optimizer import Optimizer
from navstack.local_planner.path_follower import Following

NAV2 = Path(os.environ.get("NAVSTACK_GOLDEN_NAV2") or Path(__file__).resolve().parents[3] / "shared" / "golden_nav2")


def processor() -> str:
    """Name of the processor."""
    for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.partition(":")[2].strip()
    return "unknown"


def planner(batch: int, kind: str, *, noise: bool) -> MPPIPlanner:
    """A controller with nav2_bringup's parameters."""
    sections: dict[str, Any] = {
        "CostCritic": CostCriticParams(near_goal_distance=1.0),
        "PathAlignCritic": PathAlignCriticParams(cost_weight=14.0, max_path_occupancy_ratio=0.05),
        "PathFollowCritic": PathFollowCriticParams(offset_from_furthest=5),
        "PathAngleCritic": PathAngleCriticParams(cost_weight=2.0, max_angle_to_furthest=1.0),
    }
    if kind == "omni":
        sections["omni"] = MotionModelParams(plugin=OMNI)
    model = "omni" if kind == "omni" else "diff_drive"
    return MPPIPlanner(
        MPPIParams(batch_size=batch, regenerate_noises=noise, motion_model=model, sections=sections, prune_distance=2.0)
    )


class Loop:
    """The closed loop of the C++ times."""

    def __init__(self) -> None:
        with np.load(NAV2 / "mppi_scenes.npz") as scenes:
            data = scenes["big_0_0_loop/costmap_inflated"]
            self.plan = scenes["big_0_0_loop/plan"]
            x, y, resolution = scenes["big_0_0_loop/info"].tolist()
            state = scenes["big_0_0_loop/state"].tolist()
            self.footprint = Footprint(scenes["footprint/r018"])
        self.start = Pose2D(*state[:3])
        self.costmap = Costmap(GridGeometry(data.shape[1], data.shape[0], resolution, x, y), data, "map")
        self.inflation = Inflation(self.footprint.inscribed_radius, 0.5, 5.0)

    def drive(self, controller: MPPIPlanner, cycles: int) -> tuple[list[float], Following]:
        """Processor times (ms) of the cycles, and the input of the last one."""
        pose, velocity, times = self.start, Twist2D(), list[float]()
        goal = Pose2D(*self.plan[-1].tolist())
        controller.set_plan(NavPath(self.plan, "map"), goal)
        for _ in range(cycles):
            inputs = ControlInput(RobotState(pose, velocity), self.costmap, self.footprint, inflation=self.inflation)
            if controller.goal_reached(inputs) or pose.distance_to(goal) < 1.5:
                pose, velocity = self.start, Twist2D()
                controller.set_plan(NavPath(self.plan, "map"), goal)
                continue
            begin = time.process_time_ns()
            velocity = controller.compute_command(inputs).command
            times.append((time.process_time_ns() - begin) * 1e-6)
            c, s = np.cos(pose.yaw), np.sin(pose.yaw)
            pose = Pose2D(
                pose.x + 0.05 * float(velocity.vx * c - velocity.vy * s),
                pose.y + 0.05 * float(velocity.vx * s + velocity.vy * c),
                pose.yaw + 0.05 * velocity.wz,
            )
        return times, inputs


def best(function: Callable[[], Any], repeats: int) -> float:
    """Best processor time (ms)."""
    times: list[int] = []
    for _ in range(repeats):
        begin = time.process_time_ns()
        function()
        times.append(time.process_time_ns() - begin)
    return min(times) * 1e-6


def stages(controller: MPPIPlanner, repeats: int) -> dict[str, float]:
    """Best processor times (ms) of the stages and critics, in the state after a loop."""
    optimizer: Optimizer = controller.optimizer
    context = controller._context
    assert context is not None
    start = optimizer.begin(context.state.velocity)
    found: dict[str, float] = {}
    controls = optimizer.controls.copy()

    def draw() -> None:
        optimizer._drawn = None
        optimizer.draw(0)

    found["noise"] = best(draw, repeats)

    def roll_out() -> None:
        optimizer.pin(start)
        optimizer.roll_out(start, context.state.pose)

    found["generateNoisedTrajectories"] = best(roll_out, repeats)
    context.begin(optimizer.batch.anchor)

    def furthest() -> None:
        context.furthest = -1
        context.furthest_reached(optimizer.batch)

    found["findPathFurthestReachedPoint"] = best(furthest, repeats)
    context.valid_poses()
    for index, critic in enumerate(optimizer.critics):
        critic.prepare(context)
        found[critic.name] = best(
            lambda c=critic, i=index: c.add_scores(optimizer.batch, optimizer.scores[i], optimizer.costs), repeats
        )

    def update() -> None:
        optimizer.controls = controls.copy()
        optimizer.add_control_cost()
        optimizer.weigh()
        optimizer.average()
        optimizer.smooth()
        optimizer.limit(start)

    optimizer.evaluate(context)
    found["updateControlSequence"] = best(update, repeats)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=300)
    parser.add_argument("--batch", type=int, nargs="*", default=[1000, 2000])
    parser.add_argument("--memory", action="store_true")
    args = parser.parse_args()
    reference = json.loads((NAV2 / "nav2_times.json").read_text(encoding="utf-8"))
    now = Reference()
    calibration = now.calibration_ms() if now.available else float("nan")
    print(f"processor: {processor()}; calibration {calibration:.2f} ms (C++: {reference['calibration_ms']:.2f} ms)")
    print("best processor time of a cycle, median in brackets; C++: median with -march=native, without; noise")
    loop = Loop()
    for kind in ("diff", "omni"):
        for batch in args.batch:
            cpp = reference["mppi"].get(f"{kind}_{batch}x56")
            kept, fresh = planner(batch, kind, noise=False), planner(batch, kind, noise=True)
            loop.drive(kept, 30)
            loop.drive(fresh, 30)
            a, _ = loop.drive(kept, args.repeats)
            b, _ = loop.drive(fresh, args.repeats)
            line = (
                f"{kind} {batch} x 56: same noise {min(a):.3f} ({np.median(a):.3f}, p99 {np.quantile(a, 0.99):.3f}) ms"
            )
            line += f", new noise {min(b):.3f} ({np.median(b):.3f}, p99 {np.quantile(b, 0.99):.3f}) ms"
            if cpp:
                native, plain = cpp["native"], cpp["plain"]
                line += f"; C++ {native['median_ms']:.3f}, {plain['median_ms']:.3f}; noise {native['noise_ms']:.3f} ms"
            print(line, flush=True)
            if cpp:
                for name, ms in stages(kept, args.repeats).items():
                    theirs = cpp["native"]["noise_ms"] if name == "noise" else cpp["native"]["parts_ms"].get(name)
                    beside = f"C++ {theirs:.4f} ms" if theirs is not None else ""
                    print(f"    {name:30s} {ms:8.4f} ms  {beside}")
    if args.memory:
        memory(loop)


def memory(loop: Loop) -> None:
    """Print the growth of the process over 100,000 cycles."""
    controller = planner(100, "diff", noise=True)
    for part in range(6):
        loop.drive(controller, 20_000 if part else 1000)
        print(
            f"{part * 20_000:7d} cycles: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.1f} MB", flush=True
        )


if __name__ == "__main__":
    main()

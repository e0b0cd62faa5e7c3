"""Time of a cycle of the controllers on one core, next to Nav2's C++ (golden_nav2/nav2_times.json).

    python tools/bench/controllers_speed.py [--repeats N] [--cycles N] [--batch 1000 2000] [--memory]

MPPI whole, with the same and with new noise; by stage and by critic, median of a drive with new noise; regulated pure pursuit,
rotation shim and graceful. The scene of MPPI is that of the C++ times: a closed loop along the path of big_0_0_loop with
nav2_bringup's parameters and its eight critics, 56 steps. The followers drive along a curved path of 2 m among random obstacles
in a costmap of 6 m x 6 m at 0.05 m; the whole of `compute_command` is timed: path handler, goal checker, command, collision
check.

Processor times: other programs may share the processor, the best is printed with the median (p50) and p99. The calibration does
not cover the vector width, so the processor's name is printed. `--memory` runs 100,000 cycles of each controller and prints how
the memory of the process grows.
"""

from __future__ import annotations

import argparse
import json
import math
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
from navstack.local_planner import OMNI, MotionModelParams, MPPIParams, MPPIPlanner
from navstack.local_planner.mppi.batch import TrajectoryContext
from navstack.local_planner.mppi.critics.cost import CostCriticParams
from navstack.local_planner.mppi.critics.path_align import PathAlignCriticParams
from navstack.local_planner.mppi.critics.path_angle import PathAngleCriticParams
from navstack.local_planner.mppi.critics.path_follow import PathFollowCriticParams
from navstack.local_planner.mppi.optimizer import Optimizer
from navstack.local_planner.path_follower import Following
from navstack.plugins import LOCAL_PLANNERS, ControlInput, Inflation

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


class Stages:
    """Processor times of the stages and critics of a controller while it drives, each without what it calls of the others.

    A context manager: the methods are timed inside it.
    """

    def __init__(self, controller: MPPIPlanner) -> None:
        optimizer: Optimizer = controller.optimizer
        self.times: dict[str, list[float]] = {}
        """Milliseconds per cycle."""
        self._inner = [0]
        self._cycle: dict[str, int] = {}
        self._wrapped: list[tuple[Any, str, Any]] = []
        for method in ("add_control_cost", "weigh", "average", "smooth", "limit"):
            self._wrap(optimizer, method, "updateControlSequence")
        for method in ("pin", "roll_out"):
            self._wrap(optimizer, method, "generateNoisedTrajectories")
        self._wrap(optimizer, "draw", "noise")
        for critic in optimizer.critics:
            self._wrap(critic, "add_scores", critic.name)
        self._wrap(TrajectoryContext, "furthest_reached", "findPathFurthestReachedPoint")
        self._wrap(controller, "compute_command", "")

    def _wrap(self, owner: Any, method: str, name: str) -> None:
        function = getattr(owner, method)
        self._wrapped.append((owner, method, function))

        def timed(*args: Any, **kwargs: Any) -> Any:
            begin = time.process_time_ns()
            self._inner.append(0)
            found = function(*args, **kwargs)
            spent = time.process_time_ns() - begin
            self._cycle[name] = self._cycle.get(name, 0) + spent - self._inner.pop()
            self._inner[-1] += spent
            if not name:
                self._end_cycle()
            return found

        setattr(owner, method, timed)

    def __enter__(self) -> Stages:
        return self

    def __exit__(self, *_: object) -> None:
        for owner, method, function in self._wrapped:
            setattr(owner, method, function)

    def _end_cycle(self) -> None:
        for name, spent in self._cycle.items():
            self.times.setdefault(name or "the rest", []).append(spent * 1e-6)
        self._cycle = {}


FOLLOWERS = {
    "regulated_pure_pursuit": "rpp_default",
    "rotation_shim": "shim_default",
    "graceful": "graceful_default",
}
"""The followers, and what the C++ times call them."""


def curve(seed: int = 0) -> tuple[NavPath, list[ControlInput]]:
    """A path, and inputs along its first meter."""
    rng = np.random.default_rng(seed)
    costmap = Costmap(GridGeometry(120, 120, 0.05, -2.0, -3.0), frame="odom")
    angles = np.arange(0.0, 2.0, 0.025)
    path = np.column_stack((2.0 * np.sin(angles), 2.0 * (1.0 - np.cos(angles)), angles))
    for x, y in rng.uniform((-2.0, -3.0), (4.0, 3.0), (400, 2)).tolist():
        if np.hypot(path[:, 0] - x, path[:, 1] - y).min() > 0.6:
            cell = costmap.geometry.world_to_cell(x, y)
            if cell is not None:
                costmap.data[cell[1], cell[0]] = 254
    footprint = Footprint(np.array([[0.25, 0.15], [0.25, -0.15], [-0.25, -0.15], [-0.25, 0.15]]))
    inputs: list[ControlInput] = []
    for x, y, yaw in path[:20].tolist():
        dx, dy, turned = rng.normal(0.0, (0.02, 0.02, 0.05)).tolist()
        state = RobotState(Pose2D(x + dx, y + dy, yaw + turned), Twist2D(0.4, 0.0, 0.2))
        inputs.append(ControlInput(state, costmap, footprint))
    return NavPath(path, "odom"), inputs


def follow(name: str, cycles: int) -> list[float]:
    """Processor times (us) of the cycles of a follower."""
    path, inputs = curve()
    goal = Pose2D(*path.poses[-1].tolist())
    cls = LOCAL_PLANNERS.get(name).cls
    controller = cls(cls.Params())
    times: list[float] = []
    for i in range(-200, cycles):
        if i % len(inputs) == 0:
            controller.set_plan(path, goal)
        begin = time.process_time_ns()
        controller.compute_command(inputs[i % len(inputs)])
        if i >= 0:
            times.append((time.process_time_ns() - begin) * 1e-3)
    return times


def line(times: list[float], unit: str) -> str:
    """Best, median and p99 of some times."""
    p50, p99 = np.quantile(times, (0.5, 0.99)).tolist()
    digits = 1 if unit == "us" else 3
    return (
        f"best {min(times):.{digits}f}, p50 {p50:.{digits}f}, p99 {p99:.{digits}f} {unit} "
        f"({p99 / max(p50, math.ulp(1.0)):.2f} times p50)"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=300, help="cycles of MPPI")
    parser.add_argument("--cycles", type=int, default=20_000, help="cycles of the followers")
    parser.add_argument("--batch", type=int, nargs="*", default=[1000, 2000])
    parser.add_argument("--memory", action="store_true")
    args = parser.parse_args()
    reference = json.loads((NAV2 / "nav2_times.json").read_text(encoding="utf-8"))
    now = Reference()
    calibration = now.calibration_ms() if now.available else float("nan")
    print(f"processor: {processor()}; calibration {calibration:.2f} ms (C++: {reference['calibration_ms']:.2f} ms)")
    for name, theirs in FOLLOWERS.items():
        cpp = reference["controllers"].get(theirs)
        beside = f"; C++ {cpp['median_us_per_cycle']:.1f} us, without path handler and goal checker" if cpp else ""
        print(f"{name:24} {line(follow(name, args.cycles), 'us')}{beside}", flush=True)
    loop = Loop()
    for kind in ("diff", "omni"):
        for batch in args.batch:
            time_mppi(loop, kind, batch, args.repeats, reference["mppi"].get(f"{kind}_{batch}x56"))
    if args.memory:
        memory(loop)


def time_mppi(loop: Loop, kind: str, batch: int, repeats: int, cpp: dict[str, Any] | None) -> None:
    """Print the times of MPPI with a motion model and a batch size."""
    kept, fresh = planner(batch, kind, noise=False), planner(batch, kind, noise=True)
    loop.drive(kept, 30)
    loop.drive(fresh, 30)
    same, _ = loop.drive(kept, repeats)
    new, _ = loop.drive(fresh, repeats)
    print(f"mppi, {kind}, {batch} x 56")
    print(f"    same noise: {line(same, 'ms')}")
    print(f"    new noise:  {line(new, 'ms')}", flush=True)
    if cpp is None:
        return
    native, plain = cpp["native"], cpp["plain"]
    print(
        f"    C++: p50 {native['median_ms']:.3f} ms with -march=native, {plain['median_ms']:.3f} without; "
        f"noise {native['noise_ms']:.3f} ms more, in another thread"
    )
    with Stages(fresh) as stages:
        loop.drive(fresh, repeats)
    for name, times in stages.times.items():
        ms = float(np.median(times))
        theirs = native["noise_ms"] if name == "noise" else native["parts_ms"].get(name)
        beside = f"C++ {theirs:.4f} ms" if theirs is not None else ""
        print(f"    {name:30s} {ms:8.4f} ms  {beside}")


def memory(loop: Loop) -> None:
    """Print the growth of the process over 100,000 cycles of each controller."""
    controller = planner(100, "diff", noise=True)
    runs: dict[str, Callable[[int], object]] = {"mppi": lambda n: loop.drive(controller, n)}
    for name in FOLLOWERS:
        runs[name] = lambda n, name=name: follow(name, n)
    for name, run in runs.items():
        grown: list[str] = []
        for part in range(6):
            run(20_000 if part else 1000)
            grown.append(f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.1f}")
        print(f"{name:24} after 0, 20,000 .. 100,000 cycles: {', '.join(grown)} MB", flush=True)


if __name__ == "__main__":
    main()

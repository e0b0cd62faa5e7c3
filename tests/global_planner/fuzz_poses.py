"""`python -m tests.global_planner.fuzz_poses hybrid|lattice 2000 [SEED]`: planners over poses and smoothers on random input.

Random grids (also tiny, full, unknown), footprints (round, boxes, random polygons, the reference point outside), radii, headings,
motion models, goal modes and limits. Every query ends within its limit, in a plan that the referee accepts, or in an error of the
tree with a text; smoothed paths are finite, keep their ends, and enter no obstacle that the path did not.
`NAVSTACK_BOUNDSCHECK=1` compiles the kernels with bounds checks.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import Costmap, Footprint, GridGeometry, InputError, NavError, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner, SmacLatticeParams, SmacLatticePlanner
from navstack.global_planner._lattice import MotionModel
from navstack.global_planner._lattice_file import write_lattice
from navstack.global_planner._lattice_generate import generate_lattice
from navstack.global_planner.smoothers import ConstrainedSmoother, ConstrainedSmootherParams
from navstack.plugins import Plan
from tests.global_planner.pose_referee import Referee, inflated

MODELS: tuple[MotionModel, ...] = ("ackermann", "diff", "omni")


def random_costmap(rng: np.random.Generator, resolution: float) -> Costmap:
    ny, nx = (int(v) for v in rng.integers(1, 70, 2))
    lethal = rng.random((ny, nx)) < rng.choice([0.0, 0.01, 0.05, 0.3])
    if rng.random() < 0.3:
        lethal[:, nx // 2] = True
        gap = int(rng.integers(0, ny))
        lethal[gap : gap + int(rng.integers(1, 20)), nx // 2] = False
    costmap = inflated(lethal, resolution, float(rng.uniform(0.0, 0.3)))
    data = costmap.data.copy()
    if rng.random() < 0.3:
        data[rng.random((ny, nx)) < 0.2] = 255
    g = costmap.geometry
    return (
        Costmap(GridGeometry(nx, ny, resolution, *(float(v) for v in rng.uniform(-9.0, 9.0, 2))), data)
        if g
        else costmap
    )


def random_footprint(rng: np.random.Generator) -> Footprint | None:
    kind = rng.integers(4)
    if kind == 0:
        return None
    if kind == 1:
        return Footprint.from_radius(float(rng.uniform(0.02, 0.5)))
    if kind == 2:
        a, b, w = (float(v) for v in rng.uniform(0.02, 0.6, 3))
        return Footprint(np.array([[a, w], [a, -w], [-b, -w], [-b, w]]))
    angles = np.sort(rng.uniform(0.0, 2.0 * math.pi, int(rng.integers(3, 9))))
    r = rng.uniform(0.05, 0.6, len(angles))
    corners = np.column_stack((r * np.cos(angles), r * np.sin(angles))) + rng.uniform(-0.2, 0.2, 2)
    try:
        return Footprint(corners)
    except InputError:  # corners on a line
        return None


@dataclass(frozen=True)
class Case:
    """A planner with random parameters, and what the referee needs to know of it."""

    planner: SmacHybridPlanner | SmacLatticePlanner
    model: MotionModel
    radius: float
    """Turning radius (m)."""
    resolution: float
    reverse: bool


def shared_values(rng: np.random.Generator) -> dict[str, Any]:
    """Random values of the parameters that both planners have."""
    return {
        "allow_unknown": bool(rng.random() < 0.5),
        "tolerance": float(rng.choice([0.0, 0.25, 1.0])),
        "max_iterations": int(rng.choice([50, 20_000])),
        "analytic_expansion_max_length": float(rng.choice([0.0, 3.0, 100.0])),
        "goal_heading_mode": str(rng.choice(["DEFAULT", "BIDIRECTIONAL", "ALL_DIRECTION"])),
        "coarse_search_resolution": int(rng.choice([1, 4])),
        "downsample_obstacle_heuristic": bool(rng.random() < 0.5),
        "lookup_table_size": float(rng.choice([0.3, 20.0])),
        "smooth_path": bool(rng.random() < 0.8),
        "start_policy": str(rng.choice(["clear_cell", "clear_footprint", "refuse"])),
        "use_quadratic_cost_penalty": bool(rng.random() < 0.3),
        "cusp_penalty": float(rng.choice([0.0, 0.5])),
        "max_on_approach_iterations": int(rng.choice([0, 1000])),
        "analytic_expansion_max_cost": float(rng.choice([0.0, 200.0])),
    }


def random_lattice(rng: np.random.Generator, folder: Path, number: int) -> Case:
    resolution = float(rng.choice([0.05, 0.1, 0.037]))
    radius = float(rng.uniform(2.0, 14.0)) * resolution
    model = MODELS[int(rng.integers(3))]
    lattice = generate_lattice(radius, resolution, headings=int(rng.choice([8, 16, 24])), motion_model=model)
    params = SmacLatticeParams(
        **shared_values(rng),
        lattice_filepath=str(write_lattice(lattice, folder / f"{number % 8}.json")),
        allow_reverse_expansion=bool(rng.random() < 0.5),
        rotation_penalty=float(rng.choice([0.0, 5.0])),
    )
    return Case(SmacLatticePlanner(params), model, radius, resolution, params.allow_reverse_expansion)


def random_hybrid(rng: np.random.Generator, folder: Path, number: int) -> Case:
    del folder, number
    resolution = float(rng.choice([0.05, 0.1, 0.037]))
    radius = float(rng.uniform(0.3, 30.0)) * resolution
    factor = int(rng.choice([1, 1, 1, 2, 3]))
    params = SmacHybridParams(
        **shared_values(rng),
        motion_model_for_search="REEDS_SHEPP" if rng.random() < 0.5 else "DUBIN",
        minimum_turning_radius=radius,
        angle_quantization_bins=int(rng.choice([4, 16, 72, 90, 360])),
        allow_primitive_interpolation=bool(rng.random() < 0.5),
        downsample_costmap=factor > 1,
        downsampling_factor=factor,
    )
    planned = max(radius, factor * resolution)  # at least one cell of the search
    return Case(SmacHybridPlanner(params), "ackermann", planned, resolution, params.motion_model_for_search != "DUBIN")


RANDOM = {"hybrid": random_hybrid, "lattice": random_lattice}


def faults_of(case: Case, plan: Plan, costmap: Costmap, footprint: Footprint | None, goal: Pose2D) -> list[str]:
    """What the referee says of a plan, of its way if no cells were cleared for it."""
    poses, params = plan.path.poses, case.planner.params
    if not np.isfinite(poses).all():
        return ["a pose is not finite"]
    moved = math.hypot(poses[-1, 0] - goal.x, poses[-1, 1] - goal.y)
    turned = min(abs(math.remainder(poses[-1, 2] - yaw, 2.0 * math.pi)) for yaw in case.planner.goal_yaws(goal.yaw))
    if abs(moved - plan.goal_moved_m) > 1e-6 or moved + case.radius * turned > params.tolerance + 1e-6:
        return [
            f"it ends {moved} m and {turned} rad from the goal, {plan.goal_moved_m} m stated, tolerance {params.tolerance}"
        ]
    if 0 < params.max_iterations < plan.cells_expanded:
        return [f"{plan.cells_expanded} states, max_iterations {params.max_iterations}"]
    if any("treated as free" in note for note in plan.notes) or footprint is None or len(footprint.vertices) == 16:
        return []
    blocked = costmap.data.copy()
    blocked[blocked == 255] = 0
    referee = Referee(Costmap(costmap.geometry, blocked), footprint, False, case.radius, case.reverse)
    found = referee.collisions(plan.path)
    return found + (referee.motion_faults(plan.path) if case.model == "ackermann" else [])


def smoother_faults(plan: Plan, costmap: Costmap, footprint: Footprint | None, rng: np.random.Generator) -> list[str]:
    values: dict[str, Any] = {
        "w_smooth": float(rng.choice([0.0, 3000.0, 2e6])),
        "w_curve": float(rng.choice([0.0, 0.5, 30.0])),
        "w_cost": float(rng.choice([0.0, 4.5e-5, 0.015, 1.0])),
        "w_dist": float(rng.choice([0.0, 1.0])),
        "path_downsampling_factor": int(rng.integers(1, 6)),
        "path_upsampling_factor": int(rng.integers(0, 4)),
        "minimum_turning_radius": float(rng.choice([0.0, 0.3])),
        "keep_start_orientation": bool(rng.random() < 0.7),
        "keep_goal_orientation": bool(rng.random() < 0.7),
        "reversing_enabled": bool(rng.random() < 0.7),
        "cost_check_points": [] if rng.random() < 0.6 else [0.2, 0.1, 1.0, -0.3, 0.0, 2.0],
    }
    out = ConstrainedSmoother(ConstrainedSmootherParams(**values)).smooth(plan.path, costmap, footprint=footprint).poses
    if not np.isfinite(out).all():
        return [f"the smoothed path is not finite: {values}"]
    if np.abs(out[[0, -1], :2] - plan.path.poses[[0, -1], :2]).max() > 1e-9:
        return [f"the smoothed path has other ends: {values}"]

    def is_blocked(x: float, y: float) -> bool:
        return costmap.cost_at(x, y) in (None, 253, 254)

    if not any(is_blocked(float(x), float(y)) for x, y in plan.path.poses[:, :2]) and any(
        is_blocked(float(x), float(y)) for x, y in out[:, :2]
    ):
        return [f"the smoothed path enters an obstacle: {values}"]
    return []


def run(kind: str, count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Plan three times each in `count` cases; return how many queries ended how, and the faults."""
    rng = np.random.default_rng(seed)
    ends: Counter[str] = Counter()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        for number in range(count):
            case = RANDOM[kind](rng, Path(name), number)
            costmap = random_costmap(rng, case.resolution)
            footprint = random_footprint(rng)
            g = costmap.geometry
            for _ in range(3):
                start, goal = (
                    Pose2D(
                        g.origin_x + float(rng.uniform(-0.02, 1.02)) * g.nx * case.resolution,
                        g.origin_y + float(rng.uniform(-0.02, 1.02)) * g.ny * case.resolution,
                        float(rng.choice([0.0, math.pi, rng.uniform(-math.pi, math.pi)])),
                    )
                    for _ in range(2)
                )
                try:
                    plan = case.planner.make_plan(costmap, start, goal, footprint=footprint)
                except NavError as error:
                    ends[error.name] += 1
                    if (
                        error.data.get("states_expanded", 0) > case.planner.params.max_iterations
                        or len(error.message) < 40
                    ):
                        faults.append(f"case {number} of seed {seed}: {error.message} {error.data}")
                    continue
                ends["plan"] += 1
                found = faults_of(case, plan, costmap, footprint, goal)
                found += smoother_faults(plan, costmap, footprint, rng)
                faults += [f"case {number} of seed {seed}: {fault}" for fault in found]
    return ends, faults


def main() -> None:
    kind = sys.argv[1] if len(sys.argv) > 1 else "hybrid"
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 1000
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 0
    ends, faults = run(kind, count, seed)
    print(", ".join(f"{name} {n}" for name, n in ends.most_common()))
    print(f"faults: {len(faults)}")
    for fault in faults[:20]:
        print("   ", fault)


if __name__ == "__main__":
    main()

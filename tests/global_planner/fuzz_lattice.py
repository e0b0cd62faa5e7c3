"""`python -m tests.global_planner.fuzz_lattice 2000 [SEED]`: smac_lattice and the constrained smoother on random input.

Random grids (also tiny, full, unknown), footprints (round, boxes, random polygons, the reference point outside), radii, headings,
motion models, goal modes and limits. Every query ends in a plan that the referee accepts, or in an error of the tree; smoothed
paths are finite, keep their ends, and enter no obstacle that the path did not. `NAVSTACK_BOUNDSCHECK=1` compiles the kernels
with bounds checks.
"""

from __future__ import annotations

import math
import sys
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from navstack.core import Costmap, Footprint, GridGeometry, Pose2D
from navstack.core.errors import InputError, NavError
from navstack.global_planner import SmacLatticeParams, SmacLatticePlanner
from navstack.interfaces import Plan
from navstack.lattice import MotionModel, generate_lattice, write_lattice
from navstack.smoother import ConstrainedSmoother, ConstrainedSmootherParams
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


def random_planner(
    rng: np.random.Generator, folder: Path, number: int
) -> tuple[SmacLatticePlanner, MotionModel, float, float]:
    resolution = float(rng.choice([0.05, 0.1, 0.037]))
    radius = float(rng.uniform(2.0, 14.0)) * resolution
    model = MODELS[int(rng.integers(3))]
    lattice = generate_lattice(radius, resolution, headings=int(rng.choice([8, 16, 24])), motion_model=model)
    file = write_lattice(lattice, folder / f"{number % 8}.json")
    params = SmacLatticeParams(
        lattice_filepath=str(file),
        allow_reverse_expansion=bool(rng.random() < 0.5),
        allow_unknown=bool(rng.random() < 0.5),
        tolerance=float(rng.choice([0.0, 0.25, 1.0])),
        max_iterations=int(rng.choice([50, 20_000])),
        analytic_expansion_max_length=float(rng.choice([0.0, 3.0, 100.0])),
        goal_heading_mode=str(rng.choice(["DEFAULT", "BIDIRECTIONAL", "ALL_DIRECTION"])),  # type: ignore[arg-type]
        coarse_search_resolution=int(rng.choice([1, 4])),
        downsample_obstacle_heuristic=bool(rng.random() < 0.5),
        lookup_table_size=float(rng.choice([0.3, 20.0])),
        smooth_path=bool(rng.random() < 0.8),
        rotation_penalty=float(rng.choice([0.0, 5.0])),
        start_policy=str(rng.choice(["clear_cell", "clear_footprint", "refuse"])),  # type: ignore[arg-type]
        use_quadratic_cost_penalty=bool(rng.random() < 0.3),
    )
    return SmacLatticePlanner(params), model, radius, resolution


def faults_of(
    plan: Plan, costmap: Costmap, footprint: Footprint | None, model: MotionModel, radius: float
) -> list[str]:
    """What the referee says of a plan that needed no cleared cells."""
    poses = plan.path.poses
    if not np.isfinite(poses).all():
        return ["a pose is not finite"]
    if any("treated as free" in note for note in plan.notes) or footprint is None or len(footprint.vertices) == 16:
        return []
    blocked = costmap.data.copy()
    blocked[blocked == 255] = 0
    referee = Referee(Costmap(costmap.geometry, blocked), footprint, False, radius, True)
    found = referee._collisions(plan)  # pyright: ignore[reportPrivateUsage]
    return found + (referee._motion(plan) if model == "ackermann" else [])  # pyright: ignore[reportPrivateUsage]


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


def run(count: int, seed: int) -> tuple[Counter[str], list[str]]:
    """Returns how many queries ended how, and the faults."""
    rng = np.random.default_rng(seed)
    ends: Counter[str] = Counter()
    faults: list[str] = []
    with tempfile.TemporaryDirectory() as name:
        for number in range(count):
            planner, model, radius, resolution = random_planner(rng, Path(name), number)
            costmap = random_costmap(rng, resolution)
            footprint = random_footprint(rng)
            g = costmap.geometry
            for _ in range(3):
                start, goal = (
                    Pose2D(
                        g.origin_x + float(rng.uniform(-0.02, 1.02)) * g.nx * resolution,
                        g.origin_y + float(rng.uniform(-0.02, 1.02)) * g.ny * resolution,
                        float(rng.choice([0.0, math.pi, rng.uniform(-math.pi, math.pi)])),
                    )
                    for _ in range(2)
                )
                try:
                    plan = planner.make_plan(costmap, start, goal, footprint=footprint)
                except NavError as error:
                    ends[error.name] += 1
                    continue
                ends["plan"] += 1
                found = faults_of(plan, costmap, footprint, model, radius) + smoother_faults(
                    plan, costmap, footprint, rng
                )
                faults += [f"case {number} of seed {seed}: {fault}" for fault in found]
    return ends, faults


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    ends, faults = run(count, seed)
    print(", ".join(f"{name} {n}" for name, n in ends.most_common()))
    print(f"faults: {len(faults)}")
    for fault in faults[:20]:
        print("   ", fault)


if __name__ == "__main__":
    main()

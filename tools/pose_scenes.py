"""Plan in parking and narrow scenes with known solutions, and in scenes without one.

    python tools/pose_scenes.py [--count 200] [--unsolvable 80] [--kind KIND] [--out FOLDER]

Prints a line per kind: scenes, found, faults of the plans (an independent referee), expansions, length over the known
solution; then the scenes that failed with their reason. `--out` draws them. Run it in the repository: it uses the tests.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from navstack.core import PlanningError
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from navstack.plugins import Plan
from tests.global_planner.pose_scenes import KINDS, RESOLUTION, UNSOLVABLE, Scene, solvable, unsolvable


def plan(scene: Scene, max_iterations: int) -> Plan | PlanningError:
    """The plan of smac_hybrid, or its error."""
    planner = SmacHybridPlanner(
        SmacHybridParams(
            minimum_turning_radius=scene.radius,
            motion_model_for_search="REEDS_SHEPP" if scene.reverse else "DUBIN",
            max_iterations=max_iterations,
            tolerance=0.0,
        )
    )
    try:
        return planner.make_plan(scene.costmap, scene.start, scene.goal, footprint=scene.footprint)
    except PlanningError as error:
        return error


def draw(scene: Scene, poses: np.ndarray, file: Path) -> None:
    """Write a picture of a scene, its known solution and a plan."""
    import matplotlib.pyplot as plt

    _, ax = plt.subplots(figsize=(6, 6))
    ny, nx = scene.lethal.shape
    ax.imshow(~scene.lethal, origin="lower", cmap="gray", extent=(0, nx * RESOLUTION, 0, ny * RESOLUTION))
    for pose, color in ((scene.start, "tab:blue"), (scene.goal, "tab:orange")):
        ax.fill(*scene.footprint.at(pose).T, alpha=0.5, color=color)
    if len(scene.drive):
        ax.plot(*scene.drive[:, :2].T, color="tab:green", lw=1, label="known")
    if len(poses):
        ax.plot(*poses[:, :2].T, color="tab:red", lw=1, label="plan")
    ax.set(title=f"{scene.name}, R {scene.radius:.2f} m", xlabel="x (m)", ylabel="y (m)")
    ax.legend(fontsize="small")
    file.parent.mkdir(parents=True, exist_ok=True)
    plt.savefig(file, dpi=80)
    plt.close()


def run_kind(kind: str, numbers: range, max_iterations: int, out: Path | None) -> tuple[int, int, list[str]]:
    """Plan in the scenes of a kind, and print a line; return plans found, faulty plans, and what failed."""
    expanded, ratios, times = [0], [1.0], [0.0]
    found, faulty, failed = 0, 0, list[str]()
    for number in numbers:
        scene = solvable(kind, number)
        wrong = scene.faults_of_drive()
        if wrong:
            raise SystemExit(f"{scene.name}: the known solution is none: {wrong}")
        began = time.process_time()
        result = plan(scene, max_iterations)
        times.append(1e3 * (time.process_time() - began))
        if isinstance(result, PlanningError):
            failed.append(f"{scene.name}: {result.message}")
        else:
            found += 1
            expanded.append(result.cells_expanded)
            ratios.append(result.length_m / float(np.hypot(*np.diff(scene.drive[:, :2], axis=0).T).sum()))
            wrong = scene.referee().faults(result, scene.start, scene.goal)
            faulty += bool(wrong)
            failed += [f"{scene.name}: {fault}" for fault in wrong]
        if out and (isinstance(result, PlanningError) or wrong):
            poses = np.zeros((0, 3)) if isinstance(result, PlanningError) else result.path.poses
            draw(scene, poses, out / f"{scene.name}.png")
    print(
        f"{kind:20} scenes {len(numbers):4} found {found:4} faulty {faulty:3} expanded median {np.median(expanded):7.0f} "
        f"max {max(expanded):8} ms median {np.median(times):7.1f} max {max(times):8.1f} "
        f"length/known median {np.median(ratios):.3f} max {max(ratios):.3f}",
        flush=True,
    )
    return found, faulty, failed


def run_unsolvable(kind: str, numbers: range, max_iterations: int, out: Path | None) -> int:
    """Print the reasons in scenes without a solution; return how many plans were found."""
    plans = 0
    for number in numbers:
        scene = unsolvable(kind, number)
        result = plan(scene, max_iterations)
        if isinstance(result, PlanningError):
            print(
                f"{scene.name}, at ({scene.place[0]:.2f}, {scene.place[1]:.2f}): {result.code} {result.message}",
                flush=True,
            )
            continue
        plans += 1
        print(
            f"{scene.name}: a plan of {result.length_m:.2f} m", scene.referee().faults(result, scene.start, scene.goal)
        )
        if out:
            draw(scene, result.path.poses, out / f"{scene.name}.png")
    return plans


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--unsolvable", type=int, default=80)
    parser.add_argument("--kind", default="", help="part of the name of the kinds")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene of each kind")
    parser.add_argument("--max-iterations", type=int, default=1_000_000)
    parser.add_argument("--out", type=Path, help="folder for pictures of the scenes that failed")
    args = parser.parse_args()
    total, failed = [0, 0, 0], list[str]()
    for kind in (k for k in KINDS if args.kind in k):
        numbers = range(args.first, args.first + args.count // len(KINDS))
        found, faulty, wrong = run_kind(kind, numbers, args.max_iterations, args.out)
        total = [total[0] + len(numbers), total[1] + found, total[2] + faulty]
        failed += wrong
    print(f"all: scenes {total[0]}, found {total[1]}, faulty {total[2]}")
    print(*failed, sep="\n")
    plans = 0
    for kind in (k for k in UNSOLVABLE if args.kind in k):
        numbers = range(args.first, args.first + args.unsolvable // len(UNSOLVABLE))
        plans += run_unsolvable(kind, numbers, args.max_iterations, args.out)
    print(f"plans in scenes without a solution: {plans}")


if __name__ == "__main__":
    main()

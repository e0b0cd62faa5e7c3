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

from navstack.core.errors import PlanningError
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner
from navstack.interfaces import Plan
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--unsolvable", type=int, default=80)
    parser.add_argument("--kind", help="part of the name of the kinds")
    parser.add_argument("--first", type=int, default=0, help="number of the first scene of each kind")
    parser.add_argument("--max-iterations", type=int, default=1_000_000)
    parser.add_argument("--out", type=Path, help="folder for pictures of the scenes that failed")
    args = parser.parse_args()
    total = [0, 0, 0]
    failed: list[str] = []
    for kind in KINDS:
        if args.kind and args.kind not in kind:
            continue
        expanded, ratios, times, found, faulty = [0], [1.0], [0.0], 0, 0
        numbers = range(args.first, args.first + args.count // len(KINDS))
        for number in numbers:
            scene = solvable(kind, number)
            wrong = scene.faults_of_drive()
            if wrong:
                raise SystemExit(f"{scene.name}: the known solution is none: {wrong}")
            began = time.process_time()
            result = plan(scene, args.max_iterations)
            times.append(1e3 * (time.process_time() - began))
            if isinstance(result, PlanningError):
                failed.append(f"{scene.name}: {result.message}")
                if args.out:
                    draw(scene, np.zeros((0, 3)), args.out / f"{scene.name}.png")
                continue
            found += 1
            expanded.append(result.cells_expanded)
            known = float(np.hypot(*np.diff(scene.drive[:, :2], axis=0).T).sum())
            ratios.append(result.length_m / known)
            wrong = scene.referee().faults(result, scene.start, scene.goal)
            faulty += bool(wrong)
            failed += [f"{scene.name}: {fault}" for fault in wrong]
            if wrong and args.out:
                draw(scene, result.path.poses, args.out / f"{scene.name}.png")
        total = [total[0] + len(numbers), total[1] + found, total[2] + faulty]
        print(
            f"{kind:20} scenes {len(numbers):4} found {found:4} faulty {faulty:3} expanded median {np.median(expanded):8.0f} max {max(expanded):8} "
            f"ms median {np.median(times):7.1f} max {max(times):8.1f} length/known median {np.median(ratios):.3f} max {max(ratios):.3f}",
            flush=True,
        )
    print(f"all: scenes {total[0]}, found {total[1]}, faulty {total[2]}")
    for kind in UNSOLVABLE:
        if args.kind and args.kind not in kind:
            continue
        for number in range(args.first, args.first + args.unsolvable // len(UNSOLVABLE)):
            scene = unsolvable(kind, number)
            result = plan(scene, args.max_iterations)
            if not isinstance(result, PlanningError):
                wrong = scene.referee().faults(result, scene.start, scene.goal)
                print(f"{scene.name}: a plan of {result.length_m:.2f} m {wrong}")
                if args.out:
                    draw(scene, result.path.poses, args.out / f"{scene.name}.png")
                continue
            spots = result.data.get("narrow") or []
            near = min(
                (float(np.hypot(s["x"] - scene.place[0], s["y"] - scene.place[1])) for s in spots), default=np.nan
            )
            print(
                f"{scene.name}: {result.code} {type(result).__name__}, nearest narrow place {near:.2f} m; {result.message}"
            )
    print(*failed, sep="\n")


if __name__ == "__main__":
    main()

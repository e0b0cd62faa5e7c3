"""`python -m tests.global_planner.check_plans 10000 [hybrid|lattice [SEED]]`: the referee over random queries on maps.

Maps: the shipped and the foreign ones. Robots: a box of 0.7 x 0.5 m and a round one, turning radii 0.4 and 0.8 m, forward only
and both ways.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from navstack.core import Costmap, Footprint, NavError
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner, SmacLatticeParams, SmacLatticePlanner
from navstack.global_planner._lattice_file import write_lattice
from navstack.global_planner._lattice_generate import generate_lattice
from navstack.map_io import load_map
from navstack.plugins import GlobalPlanner
from tests.conftest import SHARED
from tests.global_planner.pose_referee import Referee, inflated, random_queries

MotionModel = Literal["DUBIN", "REEDS_SHEPP"]
MODELS: tuple[MotionModel, ...] = ("DUBIN", "REEDS_SHEPP")
MAPS = Path(__file__).resolve().parents[2] / "maps"
BOX = Footprint(np.array([[0.35, 0.25], [0.35, -0.25], [-0.35, -0.25], [-0.35, 0.25]]))
ROUND = Footprint.from_radius(0.22)


def costmaps() -> Iterator[tuple[str, Costmap, Footprint]]:
    files = [*sorted(MAPS.rglob("*.yaml")), *sorted((SHARED / "data" / "maps").rglob("*.yaml"))]
    for file in files:
        try:
            grid = load_map(file)
        except NavError:
            continue
        for footprint in (BOX, ROUND):
            costmap = inflated(grid.data == 100, grid.geometry.resolution, footprint.inscribed_radius)
            yield file.stem, costmap, footprint


def planner_of(kind: str, radius: float, model: MotionModel, resolution: float, folder: Path) -> GlobalPlanner:
    """smac_hybrid, or smac_lattice with primitives of a car."""
    if kind == "hybrid":
        params = SmacHybridParams(minimum_turning_radius=radius, motion_model_for_search=model, max_iterations=200_000)
        return SmacHybridPlanner(params)
    file = write_lattice(
        generate_lattice(max(radius, 2.0 * resolution), resolution), folder / f"{radius}_{resolution}.json"
    )
    reverse = model == "REEDS_SHEPP"
    return SmacLatticePlanner(
        SmacLatticeParams(lattice_filepath=str(file), allow_reverse_expansion=reverse, max_iterations=200_000)
    )


def main() -> None:
    kind = sys.argv[2] if len(sys.argv) > 2 else "hybrid"
    with TemporaryDirectory() as folder:
        check(kind, Path(folder))


def check(kind: str, folder: Path) -> None:
    total = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    rng = np.random.default_rng(int(sys.argv[3]) if len(sys.argv) > 3 else 0)
    cases = [(n, c, f) for n, c, f in costmaps() if c.geometry.nx * c.geometry.ny < 3_000_000 and (c.data == 0).any()]
    share = max(1, total // (4 * len(cases)))
    sums = [0, 0, 0]
    for name, costmap, footprint in cases:
        for radius in (0.4, 0.8):
            for model in MODELS:
                referee = Referee(costmap, footprint, footprint is ROUND, radius, model == "REEDS_SHEPP")
                planner = planner_of(kind, radius, model, costmap.geometry.resolution, folder)
                found, failed, faults = random_queries(planner, referee, rng, share, 10.0)
                sums = [sums[0] + found, sums[1] + failed, sums[2] + len(faults)]
                shape = "round" if footprint is ROUND else "box"
                print(
                    f"{name:24} {shape:5} R {radius} {model:11} found {found} failed {failed} faults {len(faults)}",
                    flush=True,
                )
                for fault in faults[:3]:
                    print("   ", fault)
    print(f"all: found {sums[0]}, failed with a reason {sums[1]}, faults {sums[2]}")


if __name__ == "__main__":
    main()

"""Compare the times of the global planners with the C++ originals.

    python tools/bench/global_planner.py [REFERENCE_FOLDER] [--repeats 15] [--json]

REFERENCE_FOLDER contains `calibrate.py` and `cpp_reference.json` (C++ times and the calibration time measured with them);
`reference.py` describes the default and the other folders. For each case the script prints the
median of the repeats, the C++ time scaled to this machine by the calibration, and the ratio: above 1, navstack is faster.
The calibration is repeated before every case, because the machine may be shared. --cpu measures processor time instead of
elapsed time.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from reference import Reference, data_folder

from navstack.core import Costmap, GridGeometry, Pose2D
from navstack.global_planner import (
    GlobalPlannerParams,
    GlobalPlannerROS,
    NavfnParams,
    NavfnPropagation,
    NavfnROS,
    WaveCosts,
    wave_costs,
)
from navstack.global_planner._search.propagation import WaveQuery, WaveRun, propagate_navfn
from navstack.global_planner._search.traceback import navfn_path
from navstack.global_planner._search.wave_search import CoarseHeuristic
from navstack.global_planner._search.wavefront import Wavefront

Run = Callable[[], object]


def raw_costs() -> WaveCosts:
    """The bytes are navfn's costs, as in navfn's own test."""
    steps = np.arange(256, dtype=np.float32)
    return wave_costs(steps, steps >= 254)


def costmap(data: np.ndarray[Any, Any]) -> Costmap:
    return Costmap(GridGeometry(data.shape[1], data.shape[0], 0.1), np.ascontiguousarray(data))


def raw_navfn(
    data: np.ndarray[Any, Any],
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    stop: bool = True,
    use_astar: bool = False,
) -> Run:
    grid, costs, wave, heuristic = costmap(data), raw_costs(), Wavefront(), CoarseHeuristic()
    anywhere = Pose2D(0.0, 0.0)  # the potential is 0 at navfn's goal, and poses are not used
    query = WaveQuery(grid, costs, anywhere, goal, anywhere, start)

    def run() -> object:
        if use_astar:
            heuristic.search(WaveRun(wave, NavfnPropagation(), query))
        else:
            propagate_navfn(wave, grid, costs, root=goal, target=start, stop=stop)
        path = navfn_path(wave, start, root=goal)
        assert len(path) > 10
        return path

    return run


def world(
    data: np.ndarray[Any, Any], planner: NavfnROS | GlobalPlannerROS, start: tuple[int, int], goal: tuple[int, int]
) -> Run:
    grid = costmap(data)
    a, b = Pose2D(*grid.geometry.cell_to_world(*start)), Pose2D(*grid.geometry.cell_to_world(*goal))

    def run() -> object:
        planner.reset()
        return planner.make_plan(grid, a, b)

    return run


def replanning(
    data: np.ndarray[Any, Any],
    planner: NavfnROS | GlobalPlannerROS,
    start: tuple[int, int],
    goal: tuple[int, int],
    *,
    changes: bool,
) -> Run:
    """Replan as once per second: after a small step and a change of 6 x 6 cells next to the robot, or with no change."""
    grid = costmap(data.copy())
    target = Pose2D(*grid.geometry.cell_to_world(*goal))
    path = planner.make_plan(grid, Pose2D(*grid.geometry.cell_to_world(*start)), target).path.poses
    step = 0

    def run() -> object:
        nonlocal step
        if changes:
            step = step + 1 if step < 60 else 1
            ix, iy = grid.geometry.world_to_cell(*path[4 * step, :2]) or start
            grid.data[iy + 5 : iy + 11, ix + 5 : ix + 11] ^= 64
        return planner.make_plan(grid, Pose2D(path[4 * step, 0] + 0.02, path[4 * step, 1] + 0.02), target)

    return run


def cases(golden: Path, data: Path) -> dict[str, Run]:
    with Image.open(data / "maps/navfn__willow_costmap/willow_costmap.pgm") as image:
        willow = np.array(image)
    large = willow[np.arange(4000)[:, None] * 1217 // 4000, np.arange(4000)[None, :] * 1132 // 4000]
    with np.load(golden / "costmap_static_willow010_r020_csf5.npz") as z:
        master = z["master"]
    sx, sy, gx, gy = (int(v) for v in (golden / "queries.txt").read_text().split()[:4])

    def scaled(x: int, y: int) -> tuple[int, int]:
        return x * 4000 // 1132, y * 4000 // 1217

    free = np.where(large == 50, 0, large).astype(np.uint8)
    start, goal = (1106, 866), (350, 450)
    tiled = np.tile(master, (7, 7))
    far = (gx + 6 * master.shape[1], gy + 6 * master.shape[0])
    ends = (sx, sy), (gx, gy)
    return {
        "navfn_willow010 replanned": replanning(master, NavfnROS(), *ends, changes=True),
        "navfn_willow010 unchanged": replanning(master, NavfnROS(), *ends, changes=False),
        "gp_dijkstra_gradient_willow010 replanned": replanning(master, GlobalPlannerROS(), *ends, changes=True),
        "gp_dijkstra_gradient_willow010 unchanged": replanning(master, GlobalPlannerROS(), *ends, changes=False),
        "navfn_willow": raw_navfn(willow, start, goal),
        "navfn_willow_full": raw_navfn(willow, start, goal, stop=False),
        "navfn_4000": raw_navfn(large, scaled(*start), scaled(*goal)),
        "navfn_astar_willow": raw_navfn(willow, start, goal, use_astar=True),
        "navfn_willow010": world(master, NavfnROS(), (sx, sy), (gx, gy)),
        "navfn_astar_willow010": world(master, NavfnROS(NavfnParams(use_astar=True)), (sx, sy), (gx, gy)),
        "navfn_tiled": world(tiled, NavfnROS(), (sx, sy), far),
        "gp_dijkstra_gradient_willow010": world(master, GlobalPlannerROS(), (sx, sy), (gx, gy)),
        "gp_astar_grid_willow010": world(
            master,
            GlobalPlannerROS(GlobalPlannerParams(use_dijkstra=False, use_quadratic=False, use_grid_path=True)),
            (sx, sy),
            (gx, gy),
        ),
        "gp_dijkstra_gradient_4000": world(free, GlobalPlannerROS(), scaled(520, 362), scaled(691, 88)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("reference", type=Path, nargs="?", help="folder with calibrate.py and cpp_reference.json")
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--cpu", action="store_true")
    parser.add_argument("--only", default="")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    reference = Reference(args.reference)
    golden, data = data_folder("golden"), data_folder("data")
    rows: list[dict[str, Any]] = []
    if args.cpu:
        time.perf_counter = time.process_time  # for calibrate.py too
    for name, run in cases(golden, data).items():
        if args.only not in name:
            continue
        run()
        run()
        now = reference.calibration_ms()
        times: list[float] = []
        for _ in range(args.repeats):
            started = time.perf_counter()
            run()
            times.append((time.perf_counter() - started) * 1e3)
        now = min(now, reference.calibration_ms())
        ours = statistics.median(times)
        cpp = reference.scaled_ms(name.split()[0], now)
        rows.append(
            {"case": name, "ms": ours, "best_ms": min(times), "cpp_ms": cpp, "ratio": cpp / ours, "calibration_ms": now}
        )
        if not args.json:
            r = rows[-1]
            print(
                f"{name:41s} {ours:9.2f} ms (best {min(times):9.2f})  C++ {cpp:9.2f} ms  ratio {r['ratio']:6.2f}"
                f"  calibration {now:.1f} ms",
                flush=True,
            )
    if args.json:
        print(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()

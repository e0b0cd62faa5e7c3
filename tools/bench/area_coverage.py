"""Coverage of the packaged office and of maps of other projects: share, overlap, planning time, and the same driven.

    python tools/bench/area_coverage.py [--maps NAME ..] [--drive] [--tool-width 0.35] [--params NAME] [--clearance 0.075]

A line per map. `share` is of what the tool reaches from where the footprint fits with the clearance, `of all` of what it would
reach without one. The time is the least of five plans with loaded kernels. `--drive` drives the plan in the simulator; its
figures are those of the true track; 99 % of it are at most `off` from the plan (if no part was planned again). Maps are in the
folder `data` (see `reference.py`).
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np
import shapely
from numpy.typing import NDArray
from reference import data_folder

from navstack.bringup import costmap_on_map
from navstack.core import Pose2D
from navstack.coverage import CoverageDrive, make_area, plan_coverage, read_cover_step, roomy_start
from navstack.map_io import load_map, map_names, map_path
from navstack.parameters import load_configuration
from navstack.scenario import Run, Scenario, load_places

MAPS = {
    "office": "",
    "warehouse": "aws-robomaker-small-warehouse-world__map_005/map.yaml",
    "apartment": "cob_environments__map_ipa-apartment/map.yaml",
    "playground": "turtlebot_simulator__playground/playground.yaml",
    "small_office": "tiago_navigation__map_small_office/map.yaml",
    "depot": "navigation2__depot/depot.yaml",
    "hospital": "turtlebot_simulator__hospital_section/hospital_section.yaml",
}
MET = ("office", "warehouse", "apartment", "playground")


def measured(name: str, options: argparse.Namespace) -> str:
    """Return the line of a map."""
    packaged = name in map_names() and not MAPS.get(name)
    grid = load_map(map_path(name) if packaged else data_folder("data") / "maps" / MAPS[name])
    configuration = load_configuration([options.params])
    left, right, bottom, top = grid.geometry.extent
    middle = Pose2D(0.5 * (left + right), 0.5 * (bottom + top), 0.0)
    costmap = costmap_on_map(configuration, grid, middle)
    step = read_cover_step({"cover": "all", "operation_width": options.tool_width, "clearance": options.clearance})
    start = load_places(name).start_pose if packaged else None
    if start is None:
        start = roomy_start(costmap.master, costmap.footprint, clearance=options.clearance)
    plans = [
        plan_coverage(costmap.master, costmap.footprint, start, step) for _ in range(6)
    ]  # the first one loads kernels
    plan, took = plans[0], min(found.planning_time for found in plans[1:])
    whole = make_area(costmap.master, costmap.footprint, start, options.tool_width).reachable_m2
    f = plan.figures
    line = (
        f"{name:13} {f.reachable_m2:7.1f} {f.share:7.2%} {f.overlap:8.1%} {f.covered_m2 / whole:7.1%} {f.length_m:8.1f} "
        f"{f.turns:6} {took:7.3f}"
    )
    if not options.drive:
        return line
    scenario = Scenario(
        map=grid, configuration=configuration, start=start, goals=(), steps=(step,), time_limit_s=1e6, seed=options.seed
    )
    run = Run(scenario, record=False)
    behavior: CoverageDrive | None = None
    while run.step():
        running = run.move_base.motions.running
        if running is not None and isinstance(running.motion, CoverageDrive):
            behavior = running.motion
    assert behavior is not None
    track = run.track()
    report = behavior.report(np.ascontiguousarray(track[:, 1:3]), behavior.works_at(track[:, 0]))
    d = report["driven"]
    return (
        f"{line} | {d['share']:7.2%} {d['overlap']:8.1%} {d['share'] - report['plan']['share']:+7.2%} {d['length_m']:8.1f} "
        f"{d['time_s']:7.0f} {off_mm(behavior, track):6.0f} {report['plans']:5} {len(run.robot.collisions):5} "
        f"{run.outcomes[0].state}"
    )


def off_mm(behavior: CoverageDrive, track: NDArray[np.float64]) -> float:
    """Return the distance from the plan (mm) that 99 % of the true positions keep; NaN after another plan."""
    if behavior.plans != 1 or behavior.plan is None:
        return float("nan")
    line = shapely.LineString(behavior.plan.line()[0])
    shapely.prepare(line)
    return 1e3 * float(np.percentile(shapely.distance(line, shapely.points(track[::10, 1:3])), 99.0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--maps", nargs="+", choices=sorted(MAPS), default=list(MET))
    parser.add_argument("--drive", action="store_true")
    parser.add_argument("--tool-width", type=float, default=0.35)
    parser.add_argument("--clearance", type=float, default=0.075)
    parser.add_argument("--params", default="turtlebot_rpp")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    head = f"{'map':13} {'m²':>7} {'share':>7} {'overlap':>8} {'of all':>7} {'length':>8} {'turns':>6} {'plan s':>7}"
    if options.drive:
        head += f" | {'driven':>7} {'overlap':>8} {'change':>7} {'length':>8} {'time s':>7} {'off mm':>6}"
        head += f" {'plans':>5} {'hits':>5} state"
    print(head, flush=True)
    if options.processes == 1:
        for name in options.maps:
            print(measured(name, options), flush=True)
        return
    with ProcessPoolExecutor(options.processes) as pool:
        for line in pool.map(partial(measured, options=options), options.maps):
            print(line, flush=True)


if __name__ == "__main__":
    main()

"""Compare smac_lattice with Nav2's C++ on the golden queries: what is found, at what cost, and how fast.

    python tools/bench/smac_lattice.py [JOB ..] [--set NAME=VALUE] [--repeats N] [--queries]

Times and costs are those of `smac.py`; "first" is the first plan of a new planner, primitives and their tables included, which
stands next to C++'s configure. Turns in place cost rotation_penalty cells per
26.6 degrees in both paths alike; an omnidirectional robot has no backward.
"""

from __future__ import annotations

import argparse
import json
import time
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from reference import Reference, data_folder
from smac import cost_of, print_slowest

from navstack.core import Costmap, Footprint, GridGeometry, PlanningError, Pose2D
from navstack.global_planner import SmacLatticeParams, SmacLatticePlanner


def turns_in_place(poses: NDArray[np.float64]) -> float:
    """Angle (rad) turned where the position stays."""
    still = np.hypot(*np.diff(poses[:, :2], axis=0).T) < 1e-3
    turn = np.abs(np.remainder(np.diff(poses[:, 2]) + np.pi, 2.0 * np.pi) - np.pi)
    return float(turn[still].sum())


def plan(planner: SmacLatticePlanner, query: NDArray[np.float64], costmap: Costmap, footprint: Footprint | None) -> Any:
    """The plan, or the error."""
    start, goal = Pose2D(*(float(v) for v in query[:3])), Pose2D(*(float(v) for v in query[3:]))
    try:
        return planner.make_plan(costmap, start, goal, footprint=footprint)
    except PlanningError as error:
        return error


def run(name: str, job: Any, data: dict[str, Any], over: dict[str, Any], repeats: int) -> list[dict[str, Any]]:
    """One job: a row per query."""
    maps, paths = data["maps"], data["paths"]
    x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
    costs = maps[f"{job['map']}/costmap_{job['footprint']}"]
    costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], resolution, x, y), costs)
    footprint = None if job["use_radius"] else Footprint(maps[f"footprint/{job['footprint']}"])
    params = SmacLatticeParams(**{**{k: v for k, v in job["params"].items() if k != "max_planning_time"}, **over})
    raws = np.split(paths[f"{name}/raw"], np.cumsum(paths[f"{name}/raw_counts"])[:-1])
    rows: list[dict[str, Any]] = []
    for k, query in enumerate(paths[f"{name}/queries"]):
        row: dict[str, Any] = {"job": name, "query": k, "cpp": int(paths[f"{name}/status"][k]) == 1}
        row.update(ms=np.inf, first=np.inf, cpp_took_ms=float(paths[f"{name}/total_ms"][k]))
        result: Any = None
        for _ in range(repeats):
            planner = SmacLatticePlanner(params)
            began = time.process_time()
            result = plan(planner, query, costmap, footprint)
            row["first"] = min(row["first"], (time.process_time() - began) * 1e3)
            # another goal first: no heuristic nor plan is kept, the tables are
            plan(planner, query[[3, 4, 5, 3, 4, 5]] + [0, 0, 0, 0.3, 0.0, 0.0], costmap, footprint)
            began = time.process_time()
            result = plan(planner, query, costmap, footprint)
            row["ms"] = min(row["ms"], (time.process_time() - began) * 1e3)
        row["cpp_ms"] = row["cpp_took_ms"] if row["cpp"] else np.nan
        row["found"] = not isinstance(result, PlanningError)
        row["text"] = "" if row["found"] else str(result)
        if row["found"] and row["cpp"]:
            row["expanded"], row["iterations"] = result.cells_expanded, int(paths[f"{name}/iterations"][k])
            theirs = raws[k].astype(np.float64)
            per_rad = params.rotation_penalty * resolution / 0.4636
            values = params.model_copy(update={"reverse_penalty": 1.0}) if "omni" in name else params
            sums = [cost_of(p, costmap, values) + per_rad * turns_in_place(p) for p in (result.path.poses, theirs)]  # type: ignore[arg-type]
            row["ratio"] = sums[0] / max(sums[1], resolution)
        rows.append(row)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", nargs="*", help="parts of names of jobs")
    parser.add_argument("--set", action="append", default=[], help="a parameter of smac_lattice")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--queries", action="store_true", help="print a line per query")
    args = parser.parse_args()
    over = {k: yaml.safe_load(v) for k, v in (s.split("=", 1) for s in args.set)}
    folder = data_folder("golden_nav2")
    jobs = json.loads((folder / "smac_jobs.json").read_text())
    reference = json.loads((folder / "nav2_times.json").read_text())["smac_calibration_ms"]
    reference = reference if isinstance(reference, float) else float(np.median(reference))
    data = {kind: np.load(folder / f"smac_{kind}.npz") for kind in ("maps", "paths")}
    chosen = [n for n, j in jobs.items() if j["plugin"].endswith("Lattice")]
    names = [n for n in chosen if not args.job or any(a in n for a in args.job)]
    run(names[0], jobs[names[0]], data, over, 1)  # loads the kernels
    machine = Reference()
    machine.use_processor_time()
    calibrate = machine.calibration_ms
    before = calibrate()
    everything: list[dict[str, Any]] = []
    titles = ("job", "found/C++", "ms", "max", "C++", "max", "x C++", "first", "configure", "cost/C++", "max")
    print("{:50} {:>9} {:>7} {:>6} {:>7} {:>6} {:>6} {:>6} {:>9} {:>8} {:>6}".format(*titles))
    for name in names:
        rows = run(name, jobs[name], data, over, args.repeats)
        everything += rows
        both = [r for r in rows if r["cpp"] and r["found"]]
        speed = np.exp(np.mean([np.log(r["cpp_ms"] / r["ms"]) for r in both]))
        ratio = [r["ratio"] for r in both]
        missed = [r["query"] for r in rows if r["cpp"] and not r["found"]]
        more = [r["query"] for r in rows if r["found"] and not r["cpp"]]
        print(
            f"{name:50} {len(both):4}/{sum(r['cpp'] for r in rows):<4} {np.median([r['ms'] for r in rows]):7.2f} "
            f"{max(r['ms'] for r in rows):6.0f} {np.nanmedian([r['cpp_ms'] for r in rows]):7.2f} "
            f"{np.nanmax([r['cpp_ms'] for r in rows]):6.0f} {speed:6.2f} {np.median([r['first'] for r in rows]):6.1f} "
            f"{float(np.max(data['paths'][f'{name}/configure_ms'])):9.0f} {np.median(ratio):8.3f} {max(ratio):6.3f}"
            f"{f'  missed {missed}' if missed else ''}{f'  only here {more}' if more else ''}",
            flush=True,
        )
        if args.queries:
            for r in rows:
                if not r["cpp"] and not r["found"]:
                    continue
                print(
                    f"    {r['query']:3} {r['ms']:8.2f} ms, C++ {r['cpp_ms']:8.2f}; states {r.get('expanded')}, C++ "
                    f"{r.get('iterations')}; cost {r.get('ratio', np.nan):.3f} {r['text'][:150]}"
                )
    after = calibrate()
    both = [r for r in everything if r["cpp"] and r["found"]]
    speed = np.exp(np.mean([np.log(r["cpp_ms"] / r["ms"]) for r in both]))
    ratio = np.array([r["ratio"] for r in both])
    print(f"found {len(both)} of {sum(r['cpp'] for r in everything)} that C++ finds")
    print(
        f"cost at most 2 % above C++: {np.mean(ratio <= 1.02):.1%} of the queries; median of the ratios {np.median(ratio):.3f}"
    )
    scale = 0.5 * (before + after) / reference
    print(f"speed {speed:.2f} x C++, {speed * scale:.2f} x scaled by the calibration")
    print(f"calibration before {before:.1f}, after {after:.1f} ms; C++ {reference:.1f}")
    print_slowest(everything)


if __name__ == "__main__":
    main()

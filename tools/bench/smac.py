"""Compare smac_hybrid with Nav2's C++ on the golden queries: what is found, at what cost, and how fast.

    python tools/bench/smac.py [JOB ..] [--set NAME=VALUE] [--repeats N]

Times are processor time of `make_plan` with a new planner per query (no heuristic is kept), best of the repeats; "replan" plans
again from a third of the path. C++'s times are those of its createPlan, search and smoother, as ours. They are scaled by the
calibration, in processor time as well: the median of those between the jobs. Costs: integral of (1 + cost_penalty c / 252) over
the length, times reverse_penalty backward, the same for both; "raw" is C++'s path before its smoother, "path" after it.
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

from navstack.core import Costmap, Footprint, GridGeometry, PlanningError, Pose2D
from navstack.global_planner import SmacHybridParams, SmacHybridPlanner


def cost_of(poses: NDArray[np.float64], costmap: Costmap, params: SmacHybridParams) -> float:
    """The cost of a path by the function named above."""
    g = costmap.geometry
    step = np.diff(poses[:, :2], axis=0)
    middle = 0.5 * (poses[1:, :2] + poses[:-1, :2])
    ix = np.clip(((middle[:, 0] - g.origin_x) / g.resolution).astype(int), 0, g.nx - 1)
    iy = np.clip(((middle[:, 1] - g.origin_y) / g.resolution).astype(int), 0, g.ny - 1)
    weight = 1.0 + params.cost_penalty * costmap.data[iy, ix] / 252.0
    backward = step[:, 0] * np.cos(poses[:-1, 2]) + step[:, 1] * np.sin(poses[:-1, 2]) < 0.0
    return float((np.hypot(*step.T) * weight * np.where(backward, params.reverse_penalty, 1.0)).sum())


def timed(planner: SmacHybridPlanner, *args: Any, footprint: Footprint | None) -> tuple[float, Any]:
    """Processor time (ms) of a plan, and the plan or the error."""
    began = time.process_time()
    try:
        result: Any = planner.make_plan(*args, footprint=footprint)
    except PlanningError as error:
        result = error
    return (time.process_time() - began) * 1e3, result


def run(name: str, job: Any, data: dict[str, Any], over: dict[str, Any], repeats: int) -> list[dict[str, Any]]:
    """One job: a row per query."""
    maps, paths = data["maps"], data["paths"]
    x, y, resolution = (float(v) for v in maps[f"{job['map']}/info"])
    costs = maps[f"{job['map']}/costmap_{job['footprint']}"]
    costmap = Costmap(GridGeometry(costs.shape[1], costs.shape[0], resolution, x, y), costs)
    footprint = None if job["use_radius"] else Footprint(maps[f"footprint/{job['footprint']}"])
    values = {k: v for k, v in job["params"].items() if k != "max_planning_time"}
    params = SmacHybridParams(**{**values, **over})
    split = {
        kind: np.split(paths[f"{name}/{kind}"], np.cumsum(paths[f"{name}/{kind}_counts"])[:-1])
        for kind in ("raw", "path")
    }
    rows: list[dict[str, Any]] = []
    for k, query in enumerate(paths[f"{name}/queries"]):
        start, goal = Pose2D(*(float(v) for v in query[:3])), Pose2D(*(float(v) for v in query[3:]))
        best, again, planner = np.inf, np.nan, SmacHybridPlanner(params)
        result: Any = None
        for _ in range(repeats):
            planner = SmacHybridPlanner(params)
            ms, result = timed(planner, costmap, start, goal, footprint=footprint)
            best = min(best, ms)
        row = {"job": name, "query": k, "cpp": int(paths[f"{name}/status"][k]) == 1, "ms": best, "expanded": 0}
        row["cpp_took_ms"] = float(paths[f"{name}/total_ms"][k])
        row["cpp_ms"] = row["cpp_took_ms"] if row["cpp"] else np.nan
        row["found"] = not isinstance(result, PlanningError)
        if row["found"]:
            poses = result.path.poses
            again = timed(planner, costmap, result.path[len(poses) // 3], goal, footprint=footprint)[0]
            row["expanded"] = result.cells_expanded
            if row["cpp"]:
                ours = cost_of(poses, costmap, params)
                for kind in split:
                    row[kind] = ours / max(cost_of(split[kind][k].astype(np.float64), costmap, params), resolution)
        row["again"] = again
        rows.append(row)
    return rows


def print_slowest(rows: list[dict[str, Any]]) -> None:
    """The slowest queries here and in C++, by who finds a path; without a path, C++'s time is that of its failure."""
    kinds = {"both": (True, True), "only here": (True, False), "only C++": (False, True), "neither": (False, False)}
    for kind, (here, there) in kinds.items():
        chosen = [r for r in rows if r["found"] == here and r["cpp"] == there]
        if chosen:
            ours, theirs = (max(chosen, key=lambda r: r[key]) for key in ("ms", "cpp_took_ms"))
            print(
                f"slowest of {len(chosen):3} queries with a path in {kind:9}: {ours['ms']:5.0f} ms ({ours['job']} "
                f"{ours['query']}), C++ {theirs['cpp_took_ms']:5.0f} ms ({theirs['job']} {theirs['query']})"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", nargs="*", help="parts of names of jobs")
    parser.add_argument("--set", action="append", default=[], help="a parameter of smac_hybrid")
    parser.add_argument("--repeats", type=int, default=2)
    args = parser.parse_args()
    over = {k: yaml.safe_load(v) for k, v in (s.split("=", 1) for s in args.set)}
    folder = data_folder("golden_nav2")
    jobs = json.loads((folder / "smac_jobs.json").read_text())
    reference = json.loads((folder / "nav2_times.json").read_text())["smac_calibration_ms"]
    data = {kind: np.load(folder / f"smac_{kind}.npz") for kind in ("maps", "paths")}
    names = [
        n for n, j in jobs.items() if j["plugin"].endswith("Hybrid") and (not args.job or any(a in n for a in args.job))
    ]
    run(names[0], jobs[names[0]], data, over, 1)  # loads the kernels
    machine = Reference()
    machine.use_processor_time()
    calibrate = machine.calibration_ms
    calibrations = [calibrate(5)]
    everything: list[dict[str, Any]] = []
    titles = ("job", "found/C++", "ms", "max", "C++", "max", "x C++", "replan x", "cost/raw", "max")
    print("{:38} {:>10} {:>9} {:>7} {:>7} {:>7} {:>6} {:>8} {:>8} {:>6}".format(*titles))
    for name in names:
        rows = run(name, jobs[name], data, over, args.repeats)
        everything += rows
        calibrations.append(calibrate(5))
        both = [r for r in rows if r["cpp"] and r["found"]]
        speed = np.exp(np.mean([np.log(r["cpp_ms"] / r["ms"]) for r in both])) if both else np.nan
        replan = np.exp(np.mean([np.log(r["ms"] / r["again"]) for r in both])) if both else np.nan
        raw = [r["raw"] for r in both] or [np.nan]
        missed = [r["query"] for r in rows if r["cpp"] and not r["found"]]
        print(
            f"{name:38} {len(both):4}/{sum(r['cpp'] for r in rows):<4} {np.median([r['ms'] for r in rows]):9.2f} "
            f"{max(r['ms'] for r in rows):7.0f} {np.nanmedian([r['cpp_ms'] for r in rows]):7.2f} "
            f"{np.nanmax([r['cpp_ms'] for r in rows]):7.0f} {speed:6.2f} {replan:8.1f} {np.median(raw):8.3f} {max(raw):6.3f}"
            f"{'  missed ' + str(missed) if missed else ''}",
            flush=True,
        )
    both = [r for r in everything if r["cpp"] and r["found"]]
    speed = np.exp(np.mean([np.log(r["cpp_ms"] / r["ms"]) for r in both]))
    now = float(np.median(calibrations))
    scale = now / (reference if isinstance(reference, float) else float(np.median(reference)))
    raw, path = np.array([r["raw"] for r in both]), np.array([r["path"] for r in both])
    print(f"found {len(both)} of {sum(r['cpp'] for r in everything)} that C++ finds")
    print(
        f"cost at most 2 % above C++: raw {np.mean(raw <= 1.02):.1%}, smoothed {np.mean(path <= 1.02):.1%} of the queries"
    )
    print(f"medians of the ratios: raw {np.median(raw):.3f}, smoothed {np.median(path):.3f}")
    print(f"speed {speed:.2f} x C++, {speed * scale:.2f} x scaled by the calibration")
    again = np.exp(np.mean([np.log(r["ms"] / r["again"]) for r in both]))
    print(f"replanning {again:.1f} x as fast as planning (geometric mean)")
    spread = f"{min(calibrations):.1f} to {max(calibrations):.1f}"
    print(f"calibration {now:.1f} ms of processor time ({spread} between the jobs); C++ {reference}")
    print_slowest(everything)
    for radius in ("r0.4", "r1.0"):
        ms = [r["ms"] for r in everything if r["job"].startswith(f"willow_hybrid_dubin_{radius}")]
        if ms:
            p50, p95 = np.percentile(ms, (50, 95))
            print(
                f"Willow Garage, Dubins, {radius}: median {p50:.1f} ms, 95th percentile {p95:.1f} ms ({len(ms)} queries)"
            )


if __name__ == "__main__":
    main()

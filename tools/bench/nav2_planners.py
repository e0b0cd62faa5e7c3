"""Compare the planners and layers of Nav2's class names with Nav2's C++ in time, job by job.

    python tools/bench/nav2_planners.py [JOB ..] [--repeats N] [--data FOLDER]

The jobs and the C++ times are those of FOLDER (default: NAVSTACK_GOLDEN_NAV2_W3, else `../shared/golden_nav2_w3`), the maps
those of `golden_nav2`. Times are processor time of `make_plan` with a new planner per query, best of the repeats, and the median
over the queries; of a layer job, one update of its costmap, best of the repeats of the whole run. C++'s are scaled by the
calibration, in processor time as well, taken next to each job: above 1, navstack is faster.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from reference import Reference, data_folder

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from navstack.core import PlanningError, Pose2D
from navstack.plugins import GLOBAL_PLANNERS


def planner_ms(job: dict[str, Any], costmap: Any, queries: np.ndarray, repeats: int) -> float:
    """The median over the queries of the best time (ms) of a new planner."""
    cls = GLOBAL_PLANNERS.get(job["plugin"]).cls
    params = cls.Params(**{key.split(".", 1)[1]: value for key, value in job["params"].items()})
    best: list[float] = []
    for query in queries.tolist():
        times: list[float] = []
        for _ in range(repeats):
            planner = cls(params)
            began = time.process_time()
            with contextlib.suppress(PlanningError):
                planner.make_plan(costmap, Pose2D(*query[:3]), Pose2D(*query[3:]))
            times.append(time.process_time() - began)
        best.append(min(times))
    return float(np.median(best)) * 1e3


def layers_ms(name: str, repeats: int) -> float:
    """The mean time (ms) of an update with the layers of a job, in the best of the repeats."""
    from navstack.costmap.observation_buffer import Observation
    from tests.golden import nav2_w3 as data
    from tests.golden import test_nav2_layers as golden

    job, arrays = data.jobs("layers")[name], data.arrays("layers")
    case = {key.split("/", 1)[1]: value for key, value in arrays.items() if key.startswith(f"{name}/")}
    clouds = [np.ascontiguousarray(c) for c in data.split(case["in_points"].astype(np.float32), case["in_counts"])]
    best = np.inf
    for _ in range(repeats):
        costmap = golden.costmap_of(job, case)
        buffers = golden.buffers_of(costmap.layers)
        spent = 0.0
        for step, (x, y, yaw) in enumerate(case["in_poses"].tolist()):
            for buffer in buffers:
                buffer.observations = [Observation(buffer, clouds[step], len(clouds[step]), (x, y, job["sensor_z"]))]
            began = time.process_time()
            costmap.update_at(Pose2D(x, y, yaw), float(step))
            spent += time.process_time() - began
        best = min(best, spent / len(clouds))
    return best * 1e3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("job", nargs="*", help="parts of names of jobs")
    parser.add_argument("--repeats", type=int, default=4)
    parser.add_argument("--data", type=Path, help="folder with planners.npz and w3_times.json")
    args = parser.parse_args()
    folder = args.data or Path(os.environ.get("NAVSTACK_GOLDEN_NAV2_W3") or data_folder("golden_nav2_w3"))
    os.environ["NAVSTACK_GOLDEN_NAV2_W3"] = str(folder)
    cases = json.loads((folder / "w3_times.json").read_text())["cases"]
    jobs, arrays = json.loads((folder / "planners_jobs.json").read_text()), np.load(folder / "planners.npz")
    machine = Reference()
    machine.use_processor_time()
    from tests.golden.test_nav2_planners import costmap_of

    print(f"{'job':48} {'ms':>8} {'C++ here':>9} {'x C++':>6}")
    ratios: dict[str, list[float]] = {}
    for case, reference in cases.items():
        kind, _, name = case.partition("_")
        if kind not in ("planner", "layers") or (args.job and not any(part in name for part in args.job)):
            continue
        if kind == "planner":
            job = jobs[name]
            costmap, queries = costmap_of(job), arrays[f"queries/{job['map']}_{job['q']}"]
            planner_ms(job, costmap, queries[:1], 1)  # loads the kernels
            ours = planner_ms(job, costmap, queries, args.repeats)
        else:
            ours = layers_ms(name, 4 * args.repeats)
        theirs = reference["ms"] * machine.calibration_ms(5) / reference["calibration_ms"]
        group = "layers" if kind == "layers" else "navfn" if "navfn" in name else "theta star"
        ratios.setdefault(group, []).append(theirs / ours)
        print(f"{case:48} {ours:8.3f} {theirs:9.3f} {theirs / ours:6.2f}", flush=True)
    for group, values in ratios.items():
        print(
            f"{group}: {np.exp(np.mean(np.log(values))):.2f} times as fast as C++ (geometric mean of {len(values)} jobs)"
        )


if __name__ == "__main__":
    main()

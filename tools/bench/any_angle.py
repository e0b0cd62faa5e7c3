"""Time theta_star against astar on the movingai problems, and compare the lengths of their paths.

    python tools/bench/any_angle.py [FOLDER] [--map NAME ...]

FOLDER contains `maps/` and `problems.tsv`; by default `movingai` in the data folder. Times are processor time of all problems of
a map. "longer" counts the paths that are longer than astar's by more than rounding: there must be none.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from reference import data_folder

from navstack.studies.movingai import Problem, as_costmap, build, map_file, read_map, read_problems, solve
from navstack.studies.planners import reset_planner


def timed(name: str, folder: Path, problems: list[Problem]) -> tuple[float, list[float]]:
    """Processor time (s) and lengths (cells) of the plans of one map."""
    planner, costmap = build(name), as_costmap(read_map(map_file(folder, problems[0].map)))
    solve(planner, costmap, problems[0])  # compiles and allocates
    reset_planner(planner)
    started = time.process_time()
    lengths = [solve(planner, costmap, problem).length for problem in problems]
    return time.process_time() - started, lengths


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", default=data_folder("data") / "movingai")
    parser.add_argument("--map", action="append", default=[])
    args = parser.parse_args()
    by_map: dict[str, list[Problem]] = {}
    for problem in read_problems(args.folder):
        by_map.setdefault(problem.map, []).append(problem)
    totals = [0.0, 0.0]
    print(f"{'map':20} {'astar (s)':>10} {'theta_star (s)':>15} {'ratio':>6} {'length / astar':>15} {'longer':>7}")
    for name, problems in by_map.items():
        if args.map and name not in args.map:
            continue
        (first, octile), (second, any_angle) = (timed(p, args.folder, problems) for p in ("astar", "theta_star"))
        totals = [totals[0] + first, totals[1] + second]
        longer = sum(b > a * (1.0 + 1e-9) for a, b in zip(octile, any_angle, strict=True))
        shorter = sum(any_angle) / sum(octile)
        print(f"{name:20} {first:10.3f} {second:15.3f} {second / first:6.2f} {shorter:15.4f} {longer:7d}", flush=True)
    print(f"{'all':20} {totals[0]:10.3f} {totals[1]:15.3f} {totals[1] / totals[0]:6.2f}")


if __name__ == "__main__":
    main()

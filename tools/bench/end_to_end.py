"""What a user waits for: the whole stack's real-time factor, and the commands' start-up.

    python tools/bench/end_to_end.py [--map MAP.yaml --params DIR --start x,y,yaw --goal x,y,yaw ..]

Prints the real-time factor of a run (simulated seconds over wall seconds, one core, recording on, after warming up), the
calibration of the machine if ../shared/bench is there, and the times of `navstack --help` and a warm `navstack plan`.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from navstack.cli.arguments import map_of, parse_pose
from navstack.parameters.configuration import load_configuration
from navstack.places import load_places
from navstack.scenario import Scenario, run_scenario


def calibration() -> str:
    folder = Path(os.environ.get("NAVSTACK_BENCH") or Path(__file__).resolve().parents[3] / "shared" / "bench")
    if not (folder / "calibrate.py").is_file():
        return "no calibration: set NAVSTACK_BENCH to its folder"
    sys.path.insert(0, str(folder))
    from calibrate import calibration_ms  # pyright: ignore[reportMissingImports]

    return f"calibration {calibration_ms():.1f} ms"


def timed(*command: str) -> float:
    began = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--map", default="office")
    parser.add_argument("--params", nargs="+", default=["turtlebot"])
    parser.add_argument("--start")
    parser.add_argument("--goal", nargs="+")
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--profile", action="store_true", help="print where the time goes")
    args = parser.parse_args()
    _, grid = map_of(args.map)
    start = parse_pose(args.start, "--start") if args.start else load_places(args.map).start
    goals = tuple(parse_pose(g, "--goal") for g in args.goal) if args.goal else load_places(args.map).goals
    scenario = Scenario(grid, load_configuration(args.params), start, goals)
    began = time.perf_counter()
    first = run_scenario(scenario)
    print(f"first run in this process {time.perf_counter() - began:.2f} s")
    factors = [run_scenario(scenario).real_time_factor for _ in range(args.repeat)]
    states = ", ".join(goal.state for goal in first.goals)
    print(f"{first.simulated_s:.1f} s simulated ({states})")
    print(f"real-time factor: median {statistics.median(factors):.0f}, best {max(factors):.0f}; {calibration()}")
    if args.profile:
        import cProfile
        import pstats

        profile = cProfile.Profile()
        profile.runcall(run_scenario, scenario)
        pstats.Stats(profile).sort_stats("tottime").print_stats(30)
    python = sys.executable
    helps = [timed(python, "-m", "navstack", "--help") for _ in range(5)]
    print(f"navstack --help: median {statistics.median(helps):.2f} s")
    x, y, yaw = start
    gx, gy, gyaw = goals[0]
    command = (python, "-m", "navstack", "plan", args.map, "--params", args.params[0])
    command += ("--start", f"{x},{y},{yaw}", "--goal", f"{gx},{gy},{gyaw}")
    plans = [timed(*command) for _ in range(5)]
    print(f"navstack plan, warm: median {statistics.median(plans):.2f} s")


if __name__ == "__main__":
    main()

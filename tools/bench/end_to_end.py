"""Real-time factor of the whole stack, and start-up times of the commands.

    python tools/bench/end_to_end.py [--map MAP.yaml --params DIR --start x,y,yaw --goal x,y,yaw ..]

Prints the real-time factor of a run (simulated over elapsed time, one core, with recording, after a warm-up), the calibration
of the machine if it is available (see `reference.py`), and the times of `navstack --help` and of `navstack plan` with compiled
kernels.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys
import time

from reference import Reference, add_scenario_arguments, scenario_of

from navstack.scenario import run_scenario


def timed(*command: str) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return time.perf_counter() - started


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_scenario_arguments(parser)
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--profile", action="store_true", help="print a profile")
    args = parser.parse_args()
    scenario = scenario_of(args)
    started = time.perf_counter()
    first = run_scenario(scenario)
    print(f"first run in this process {time.perf_counter() - started:.2f} s")
    factors = [run_scenario(scenario).real_time_factor for _ in range(args.repeat)]
    states = ", ".join(goal.state for goal in first.goals)
    print(f"{first.simulated_s:.1f} s simulated ({states})")
    print(f"real-time factor: median {statistics.median(factors):.0f}, best {max(factors):.0f}; {Reference().text()}")
    if args.profile:
        import cProfile
        import pstats

        profile = cProfile.Profile()
        profile.runcall(run_scenario, scenario)
        pstats.Stats(profile).sort_stats("tottime").print_stats(30)
    python = sys.executable
    helps = [timed(python, "-m", "navstack", "--help") for _ in range(5)]
    print(f"navstack --help: median {statistics.median(helps):.2f} s")
    x, y, yaw = scenario.start
    gx, gy, gyaw = scenario.goals[0]
    command = (python, "-m", "navstack", "plan", args.map, "--params", args.params[0])
    command += ("--start", f"{x},{y},{yaw}", "--goal", f"{gx},{gy},{gyaw}")
    plans = [timed(*command) for _ in range(5)]
    print(f"navstack plan, compiled kernels: median {statistics.median(plans):.2f} s")


if __name__ == "__main__":
    main()

"""Runs a second of a sweep: in one process without the framework, by worker processes, on a Dask cluster of processes.

    python tools/bench/tune.py [--candidates 6] [--scenarios 4] [--processes 1 2] [--dask] [--repeats 3]

The same runs each time: a Latin hypercube of turtlebot parameters over the first scenarios of `office`. Starting workers and
loading kernels is left out: the clock runs from the first results on. The best of the repeats counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from navstack.jobs import JobResult, usable_cores
from navstack.parameters.configuration import load_configuration
from navstack.scenario import warm_up
from navstack.tune.sampling import candidates
from navstack.tune.scenarios import course_of, read_place
from navstack.tune.setup import Asked, prepare
from navstack.tune.sweep import Sweep, run_sweep

SPACE = ("DWAPlannerROS/sim_time=1.0:2.5", "DWAPlannerROS/vx_samples=4:8", "DWAPlannerROS/occdist_scale=0.01:0.1:log")


def plain(sweep: Sweep) -> float:
    """Runs a second of a loop that loads each candidate and drives each scenario."""
    runs = 0
    began = 0.0
    for candidate in sweep.candidates:
        configuration = load_configuration([sweep.base.tree.as_dict()], overrides=sweep.space.overrides(candidate))
        for case in sweep.course.cases:
            sweep.course.drive(case, configuration)
            runs += 1
            if runs == 1:
                began = time.perf_counter()
    return (runs - 1) / (time.perf_counter() - began)


def framework(sweep: Sweep, slots: int, run: Callable[[Callable[[JobResult], None]], object]) -> float:
    """The same by the framework: from the moment when every worker has given its first result."""
    ends: list[float] = []
    run(lambda result: ends.append(time.perf_counter()))
    return (len(ends) - slots) / (ends[-1] - ends[slots - 1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--candidates", type=int, default=6)
    parser.add_argument("--scenarios", type=int, default=4)
    parser.add_argument("--processes", type=int, nargs="+", default=list(range(1, usable_cores() + 1)))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--dask", action="store_true", help="also on a local Dask cluster of as many processes")
    args = parser.parse_args()

    setup = prepare(Asked(("turtlebot",), "office", param=SPACE, count=args.scenarios))
    chosen = candidates(setup.space, "lhs", samples=args.candidates, points=1, seed=0)
    place = read_place("office", args.scenarios)
    course = course_of(place, place.names, [0], setup.base, setup.speed)
    sweep = Sweep(setup.base, setup.space, chosen, course, {})
    warm_up(place.files[0].build(params=["turtlebot"]))
    runs = len(chosen) * len(course.cases)

    # in turn, so that a machine that is busy for a while is so for all
    rates: dict[str, list[float]] = {}
    for _ in range(args.repeats):
        rates.setdefault("one process, a plain loop", []).append(plain(sweep))
        for n in args.processes:

            def by_processes(heard: Callable[[JobResult], None], n: int = n) -> object:
                return run_sweep(sweep, None, workers=n, heard=heard)

            rates.setdefault(f"{n} worker process{'es' if n > 1 else ''}", []).append(framework(sweep, n, by_processes))
            if args.dask:
                rates.setdefault(f"Dask, {n} process{'es' if n > 1 else ''}", []).append(_on_dask(sweep, n))
    base = max(rates["one process, a plain loop"])
    print(f"{runs} runs, {1.0 / base:.3f} s each in a plain loop, {usable_cores()} cores")
    for name, found in rates.items():
        best = max(found)
        print(
            f"{name:28s} {best:7.2f} runs/s, x {best / base:.2f} of the plain loop  (all: {', '.join(f'{r:.2f}' for r in found)})"
        )


def _on_dask(sweep: Sweep, n: int) -> float:
    from distributed import LocalCluster

    with LocalCluster(n_workers=n, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:

        def run(heard: Callable[[JobResult], None]) -> object:
            return run_sweep(sweep, None, scheduler=cluster.scheduler_address, heard=heard)

        return framework(sweep, n, run)


if __name__ == "__main__":
    main()

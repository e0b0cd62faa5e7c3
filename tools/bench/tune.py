"""Overhead of sweeps: runs per second in a plain loop, with worker processes, and on a Dask cluster of processes.

    python tools/bench/tune.py [--candidates 6] [--scenarios 4] [--processes 1 2] [--dask] [--repeats 3]

All of them drive the same runs: a Latin hypercube of turtlebot parameters over the first scenarios of `office`. Starting
workers and loading kernels is not timed: the clock starts at the first results. The best of the repeats counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

from navstack.parameters import load_configuration
from navstack.scenario import warm_up
from navstack.studies import JobResult, SearchOptions, Sweep, candidates, prepare, run_sweep
from navstack.studies.executors import usable_cores

SPACE = ("DWAPlannerROS/sim_time=1.0:2.5", "DWAPlannerROS/vx_samples=4:8", "DWAPlannerROS/occdist_scale=0.01:0.1:log")


def plain(sweep: Sweep) -> float:
    """Runs per second of a loop that loads each candidate and drives each case."""
    runs = 0
    start = 0.0
    for candidate in sweep.candidates:
        configuration = load_configuration([sweep.base.tree.as_dict()], overrides=sweep.space.overrides(candidate))
        for case in sweep.evaluation.cases:
            sweep.evaluation.drive(case, configuration)
            runs += 1
            if runs == 1:
                start = time.perf_counter()
    return (runs - 1) / (time.perf_counter() - start)


def with_executor(sweep: Sweep, slots: int, run: Callable[[Callable[[JobResult], None]], object]) -> float:
    """Runs per second of a sweep, from when every worker has returned its first result."""
    ends: list[float] = []
    run(lambda result: ends.append(time.perf_counter()))
    return (len(ends) - slots) / (ends[-1] - ends[slots - 1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--candidates", type=int, default=6)
    parser.add_argument("--scenarios", type=int, default=4)
    parser.add_argument("--processes", type=int, nargs="+", default=list(range(1, usable_cores() + 1)))
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--dask", action="store_true", help="also use a local Dask cluster with as many processes")
    args = parser.parse_args()

    setup = prepare(SearchOptions(("turtlebot",), "office", param=SPACE, count=args.scenarios))
    chosen = candidates(setup.space, "lhs", samples=args.candidates, points=1, seed=0)
    evaluation = setup.evaluation()
    sweep = Sweep(setup.base, setup.space, chosen, evaluation, {})
    warm_up(setup.suite.files[0].build(params=["turtlebot"]))
    runs = len(chosen) * len(evaluation.cases)

    # alternating, so that other load affects all of them
    rates: dict[str, list[float]] = {}
    for _ in range(args.repeats):
        rates.setdefault("one process, a plain loop", []).append(plain(sweep))
        for n in args.processes:

            def by_processes(on_result: Callable[[JobResult], None], n: int = n) -> object:
                return run_sweep(sweep, None, workers=n, on_result=on_result)

            rates.setdefault(f"{n} worker process{'es' if n > 1 else ''}", []).append(
                with_executor(sweep, n, by_processes)
            )
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

        def run(on_result: Callable[[JobResult], None]) -> object:
            return run_sweep(sweep, None, scheduler=cluster.scheduler_address, on_result=on_result)

        return with_executor(sweep, n, run)


if __name__ == "__main__":
    main()

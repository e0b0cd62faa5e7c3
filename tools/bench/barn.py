"""BARN with navstack, beside what the C++ stack did in the same simulator.

    python tools/bench/barn.py [--distro indigo] [--seeds 0 1 2] [--rough] [--worlds 49 157] [--record DIR] [--set KEY=VALUE]

Worlds, parameters and C++'s results come from NAVSTACK_DATA (../shared/data by default). With --record every run that fails
leaves its record in DIR/world_N, for `navstack explain command DIR/world_N --time t`.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

from navstack.bench.barn import BarnOutcome, as_table, barn_configuration, load_worlds, run_world

DATA = Path(os.environ.get("NAVSTACK_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")


class Task(NamedTuple):
    number: int
    seed: int
    params: str
    distro: str | None
    rough: bool
    overrides: tuple[str, ...]
    record: str | None


def run(task: Task) -> BarnOutcome:
    world = next(w for w in load_worlds(DATA / "barn" / "worlds.npz") if w.number == task.number)
    configuration = barn_configuration(
        DATA / "params" / task.params, distro=task.distro, rough=task.rough, overrides=task.overrides
    )
    outcome, recorder = run_world(world, configuration, seed=task.seed, record=task.record is not None)
    if recorder is not None and task.record is not None and not outcome.succeeded:
        recorder.save(Path(task.record) / f"world_{task.number}")
    return outcome


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--params", default="jackal_barn")
    parser.add_argument("--distro", choices=("noetic", "indigo"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--worlds", type=int, nargs="*")
    parser.add_argument("--rough", action="store_true", help="lidar noise, lag and slip; without, seeds change nothing")
    parser.add_argument("--set", dest="overrides", action="append", default=[])
    parser.add_argument("--record", metavar="DIR")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--json", metavar="FILE", help="write the outcomes there too")
    args = parser.parse_args()

    known = [w.number for w in load_worlds(DATA / "barn" / "worlds.npz")]
    numbers = args.worlds or known
    if not set(numbers) <= set(known):
        parser.error(f"--worlds: there are {', '.join(map(str, known))}")
    tasks = [
        Task(number, seed, args.params, args.distro, args.rough, tuple(args.overrides), args.record)
        for seed in args.seeds
        for number in numbers
    ]
    began = time.perf_counter()
    with ProcessPoolExecutor(args.processes) as pool:
        outcomes = list(pool.map(run, tasks))
    wall = time.perf_counter() - began
    print("\n".join(as_table(outcomes)))
    simulated = sum(o.time_s for o in outcomes)
    print(f"{simulated:.0f} s simulated in {wall:.0f} s on {args.processes} processes")
    if args.json:
        rows = [{name: getattr(o, name) for name in BarnOutcome.__slots__} for o in outcomes]
        Path(args.json).write_text(json.dumps(rows, indent=1) + "\n")
    results = DATA / "barn" / "cpp_results.csv"
    if results.is_file() and args.params == "jackal_barn":
        with results.open() as file:
            cpp = {int(row["world"]): row for row in csv.DictReader(file)}
        both = Counter((cpp[o.world]["outcome"], o.outcome) for o in outcomes if o.world in cpp)
        print(
            "C++ (noetic, one run) -> navstack: " + ", ".join(f"{a} -> {b} {n}" for (a, b), n in sorted(both.items()))
        )


if __name__ == "__main__":
    main()

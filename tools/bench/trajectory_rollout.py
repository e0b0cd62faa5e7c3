"""Effect of the measures by which trajectory rollout avoids getting stuck: BARN worlds with and without each of them.

    python tools/bench/trajectory_rollout.py [--worlds 49 157] [--distro indigo] [--without full_turns check longer]

Without `full_turns`, the robot turns in place as long as that scores best; without `check`, it backs up into obstacles; without
`longer`, every escape ends after escape_reset_dist. By default, each is
removed on its own, then all together, in the worlds in which the C++ stack failed (folder `data`, see `reference.py`).
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from unittest.mock import patch

from reference import data_folder

from navstack.local_planner.trajectory_rollout import planner as trajectory_rollout
from navstack.local_planner.trajectory_rollout.escape import Additions
from navstack.scenario import load_worlds
from navstack.studies.barn import barn_configuration, run_world

DATA = data_folder("data")
MEASURES = ("full_turns", "check", "longer")
CASES: tuple[tuple[str, ...], ...] = ((), ("full_turns",), ("check",), ("longer",), MEASURES)


@contextmanager
def without(removed: tuple[str, ...]) -> Iterator[None]:
    """Switches some of MEASURES off in every planner that is made."""
    kept = partial(Additions, **dict.fromkeys(removed, False))
    with patch.object(trajectory_rollout, "Additions", kept):
        yield


def main() -> None:
    """Print a line per run and a summary per case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, nargs="*")
    parser.add_argument("--distro", choices=("noetic", "indigo"))
    parser.add_argument("--without", choices=MEASURES, nargs="*", help="only one case: without these")
    args = parser.parse_args()
    cases = CASES if args.without is None else (tuple(args.without),)
    with (DATA / "barn" / "cpp_results.csv").open() as file:
        failed = [int(row["world"]) for row in csv.DictReader(file) if row["outcome"] != "success"]
    numbers = args.worlds or failed
    worlds = [w for w in load_worlds(DATA / "barn" / "worlds.npz") if w.number in numbers]
    configuration = barn_configuration(DATA / "params" / "jackal_barn", distro=args.distro)
    for removed in cases:
        with without(removed):
            outcomes = [run_world(world, configuration)[0] for world in worlds]
        name = f"without {', '.join(removed)}" if removed else "complete"
        for o in outcomes:
            print(
                f"  {o.world:4d} {o.outcome:10s} {o.time_s:6.1f} s  {o.length_m:6.2f} m  turning {o.turning_s:5.1f} s"
            )
        ended = {kind: sum(o.outcome == kind for o in outcomes) for kind in sorted({o.outcome for o in outcomes})}
        turning = sum(o.turning_s for o in outcomes)
        score = sum(o.score for o in outcomes) / len(outcomes)
        print(
            f"{name}: {len(outcomes)} runs, {ended}, score {score:.3f}, turning in place {turning:.0f} s",
            flush=True,
        )


if __name__ == "__main__":
    main()

"""Effect of the measures by which trajectory rollout avoids getting stuck: BARN worlds with and without each of them.

    python tools/bench/trajectory_rollout.py [--worlds 49 157] [--distro indigo] [--without full_turns check longer]

Without `full_turns`, the robot turns in place as long as that scores best; without `check`, it backs up into obstacles; without
`longer`, every escape ends after escape_reset_dist. Without all three, the planner equals the C++ original. By default, each is
removed on its own, then all together, in the worlds in which the C++ stack failed (folder `data`, see `reference.py`).
"""

from __future__ import annotations

import argparse
import csv
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

from reference import data_folder

from navstack.bench.barn import barn_configuration, load_worlds, run_world
from navstack.core import Pose2D
from navstack.interfaces import Rollouts, ScoringContext
from navstack.local_planner.trajectory_rollout import planner as trajectory_rollout
from navstack.local_planner.trajectory_rollout.escape import Escape, FullTurnDetector

DATA = data_folder("data")
MEASURES = ("full_turns", "check", "longer")
CASES: tuple[tuple[str, ...], ...] = ((), ("full_turns",), ("check",), ("longer",), MEASURES)


def never_complete(self: FullTurnDetector, pose: Pose2D, *, moved: bool) -> bool:
    """Full turns are never detected."""
    del self, pose, moved
    return False


def all_points(context: ScoringContext, rollouts: Rollouts, distance: float) -> int:
    """Backing up is always allowed."""
    del context, distance
    return int(rollouts.counts[-1])


def always_short(self: Escape, pose: Pose2D) -> None:
    """Every escape is treated as the first one."""
    self.reset()
    _begin(self, pose)


_begin = Escape.begin


@contextmanager
def without(removed: tuple[str, ...]) -> Iterator[None]:
    """Disables some of MEASURES."""
    with (
        patch.object(
            FullTurnDetector, "complete", never_complete if "full_turns" in removed else FullTurnDetector.complete
        ),
        patch.object(
            trajectory_rollout,
            "free_backup_points",
            all_points if "check" in removed else trajectory_rollout.free_backup_points,
        ),
        patch.object(Escape, "begin", always_short if "longer" in removed else Escape.begin),
    ):
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

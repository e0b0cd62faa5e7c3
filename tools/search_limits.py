"""Search for commands that exceed a limit: velocity, acceleration from command to command, turning radius.

    python tools/search_limits.py [--cycles 1000000] [--seed 0] [CONTROLLER..]

Every controller drives through random scenes: paths with corners and cusps, obstacles, replans, goals near and far, robots that
follow late. Prints the largest excess over each limit, negative where it is kept; exits with 1 if one is exceeded. Run it
in the repository: it uses the tests.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from tests.local_planner.limits import LIMIT_CASES, search_excess


def main() -> int:
    """Search and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("controllers", nargs="*", default=list(LIMIT_CASES), metavar="CONTROLLER")
    parser.add_argument("--cycles", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    unknown = [name for name in args.controllers if name not in LIMIT_CASES]
    if unknown:
        parser.error(f'no controller "{unknown[0]}"; use one of: {"; ".join(LIMIT_CASES)}')
    exceeded = False
    for name in args.controllers:
        begin = time.process_time()
        found = search_excess(LIMIT_CASES[name], args.cycles, args.seed)
        worst = ", ".join(f"{limit} {value:+.1e}" for limit, value in found.by_limit.items() if value > float("-inf"))
        bad = not found.worst <= LIMIT_CASES[name].tolerance
        exceeded |= bad
        print(
            f"{name:24} {found.cycles:9,} commands, {found.refused:8,} cycles without one, "
            f"{time.process_time() - begin:6.0f} s: {worst}{'  EXCEEDED' if bad else ''}",
            flush=True,
        )
    return int(exceeded)


if __name__ == "__main__":
    sys.exit(main())

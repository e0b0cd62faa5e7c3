"""Random reachable pairs on the packaged maps and on a folder of maps, every planner: found, and free of collision?

    python tools/bench/map_pairs.py [DIR] [--pairs 25] [--params turtlebot] [--json]

Exit code 1 when a planner misses a pair or a path meets a blocked cell.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from navstack import maps
from navstack.bench.map_pairs import SEARCHING, costmap_of, reachable_pairs, run_pairs, summary
from navstack.configuration import load_configuration
from navstack.core.errors import MapError, jsonable
from navstack.map_io import load_map
from navstack.plugins import GLOBAL_PLANNERS


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR")
    parser.add_argument("--pairs", type=int, default=25)
    parser.add_argument("--params", default="turtlebot")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    configuration = load_configuration([args.params])
    files = [maps.map_path(name) for name in maps.map_names()]
    if args.folder is not None:
        files += sorted(args.folder.rglob("*.yaml"))
    rows = []
    for file in files:
        try:
            costmap = costmap_of(configuration, load_map(file))
        except MapError as error:
            print(f"{file.stem}: {error}", file=sys.stderr)
            continue
        pairs = reachable_pairs(costmap, args.pairs)
        planners = {n: GLOBAL_PLANNERS.get(n).cls(GLOBAL_PLANNERS.get(n).cls.Params()) for n in SEARCHING}
        for row in summary(run_pairs(planners, costmap, pairs)):
            rows.append({"map": file.parent.name if file.stem == "map" else file.stem, **row})
            if not args.json:
                r = rows[-1]
                print(
                    f"{r['map'][:36]:36} {r['planner']:15}{r['pairs']:5} pairs{r['found']:5} found"
                    f"{r['in_collision']:5} in collision ({r['blocked_points']} points)"
                    f"{r['length_m']:10.1f} m{r['median_ms']:9.2f} ms",
                    flush=True,
                )
    total, found = sum(r["pairs"] for r in rows), sum(r["found"] for r in rows)
    collisions = sum(r["in_collision"] for r in rows)
    if args.json:
        print(json.dumps(jsonable(rows), indent=2))
    else:
        print(f"{len(files)} maps, {total} plans: {found} found, {collisions} in collision")
    sys.exit(int(found < total or collisions > 0))


if __name__ == "__main__":
    main()

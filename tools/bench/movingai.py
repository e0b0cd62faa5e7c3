"""The movingai benchmark: lengths against the published optima, cells expanded and times, a table per map.

    python tools/bench/movingai.py DIR [--planner astar --planner theta_star] [--json]

DIR holds `maps/` and `problems.tsv`.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from navstack.bench.movingai import as_table, build, run, summary
from navstack.core.errors import jsonable


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--planner", action="append", metavar="NAME", help="astar unless given (repeat)")
    parser.add_argument("--json", action="store_true", help="one JSON document instead of tables")
    args = parser.parse_args()
    document = {}
    for name in args.planner or ["astar"]:
        rows = summary(run(args.folder, build(name)))
        document[name] = rows
        if not args.json:
            print(f"{name}\n{as_table(rows)}\n")
    if args.json:
        print(json.dumps(jsonable(document), indent=2))


if __name__ == "__main__":
    main()

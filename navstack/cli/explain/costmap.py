"""`navstack explain costmap`: draw a costmap of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from navstack.cli import options
from navstack.cli.arguments import parse_costmap_name
from navstack.cli.output import print_files, print_json
from navstack.explain import time_in
from navstack.plot import plot_costmap_at
from navstack.record import Record


def costmap(
    run: options.RunFolder,
    out: Annotated[Path, options.picture_file("costmap.png")],
    time: options.Time = None,
    costmap: options.CostmapName = "global",
    json_: options.Json = False,
) -> None:
    """Draw a costmap of a run at a given time, with its cost bands."""
    name = parse_costmap_name(costmap)
    record = Record.load(run)
    at = time_in(record, time)
    plot_costmap_at(record, name, at, out)
    updates = record.costmap_times(name)
    updated = float(updates[updates <= at][-1])
    files = {"picture": str(out)}
    if json_:
        print_json({"time": at, "updated_at": updated, "costmap": name, "files": files})
    else:
        print_files(files)

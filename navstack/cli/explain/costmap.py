"""`navstack explain costmap`: draw a costmap of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options


def costmap(
    run: options.RunFolder,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Write a picture (.png, .svg or .pdf).")],
    time: options.Time = None,
    costmap: options.CostmapName = "global",
    json_: options.Json = False,
) -> None:
    """Draw a costmap of a run at a given time, with its cost bands."""
    from navstack.cli.arguments import parse_costmap_name
    from navstack.cli.output import print_files, print_json
    from navstack.core.errors import RecordError
    from navstack.explain.replay import time_in
    from navstack.plot import plot_costmap
    from navstack.record import Record

    name = parse_costmap_name(costmap)
    record = Record.load(run)
    at = time_in(record, time)
    shown = record.costmap_at(name, at)
    if shown is None:
        raise RecordError(
            f"{run} contains no {name} costmap until {at:.3f} s: it was not recorded or not yet updated; give a later --time"
        )
    to_map = record.to_global(shown.frame, at)
    updates = record.costmap_times(name)
    updated = float(updates[updates <= at][-1])
    plot_costmap(
        shown,
        out,
        title=f"{name} costmap at {at:.2f} s (updated {updated:.2f} s), in {shown.frame}",
        robot=to_map.inverse().apply(record.pose_at(at)),
        footprint=record.footprint,
    )
    files = {"picture": str(out)}
    if json_:
        print_json({"time": at, "updated_at": updated, "costmap": name, "files": files})
    else:
        print_files(files)

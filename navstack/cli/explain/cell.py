"""`navstack explain cell`: where the cost of a cell comes from."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.arguments import parse_costmap_name, parse_point
from navstack.cli.output import print_json, stdout
from navstack.explain import explain_cell, print_cell, replay
from navstack.record import Record


def cell(
    run: options.RunFolder,
    at: Annotated[str, typer.Option("--at", metavar="X,Y", help="Point in the map frame (m).")],
    time: options.Time = None,
    costmap: options.CostmapName = "global",
    json_: options.Json = False,
) -> None:
    """Explain the cost of a cell: the layer and sensor that set it, the time, and the share of every layer.

    The run is replayed up to the given time.
    """
    x, y = parse_point(at, "--at")
    name = parse_costmap_name(costmap)
    report = explain_cell(replay(Record.load(run), time), x, y, costmap=name)
    if json_:
        print_json(report.as_dict())
    else:
        print_cell(stdout(), report)

"""`navstack explain cell`: where the cost of a cell comes from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.explain import CellReport


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
    from navstack.cli.arguments import parse_costmap_name, parse_point
    from navstack.cli.output import print_json
    from navstack.explain import explain_cell, replay
    from navstack.record import Record

    x, y = parse_point(at, "--at")
    name = parse_costmap_name(costmap)
    report = explain_cell(replay(Record.load(run), time), x, y, costmap=name)
    if json_:
        print_json(report.as_dict())
    else:
        _print(report)


def _print(report: CellReport) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout

    found, out = report.provenance, stdout()
    robot = report.robot
    out.print(
        f"{found.costmap} at {report.time:.3f} s: cell ({found.ix}, {found.iy}) at ({found.x:.3f}, {found.y:.3f}) in "
        f"{escape(report.frame)}; robot at ({robot.x:.2f}, {robot.y:.2f})"
    )
    out.print(f"[bold]{escape(report.summary)}[/]")
    table = Table("layer", "cost", "explanation", box=SIMPLE_HEAD, pad_edge=False)
    subjects = [("", found)] + ([("obstacle: ", found.obstacle)] if found.obstacle is not None else [])
    for prefix, subject in subjects:
        for i, share in enumerate(subject.layers):
            text = share.explanation.text if share.explanation is not None else "no explanation"
            change = f"{share.before} -> {share.after}" if share.after != share.before else str(share.after)
            last = i == len(subject.layers) - 1
            table.add_row(escape(prefix + share.layer), change, escape(text), end_section=last)
    out.print(table)

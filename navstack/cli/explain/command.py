"""`navstack explain command`: why the local planner chose its command."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.output import print_files, print_json, stdout
from navstack.explain import explain_command, print_command
from navstack.plot import plot_command
from navstack.record import Record


def command(
    run: options.RunFolder,
    time: options.Time = None,
    all_: Annotated[
        bool, typer.Option("--all", help="Print all samples, also rejected ones, instead of the best 12.")
    ] = False,
    out: Annotated[Path | None, options.picture_file("command.png")] = None,
    json_: options.Json = False,
) -> None:
    """Explain a velocity command: the samples, which critic rejected them and where, and the costs of the others.

    The run is replayed up to the given time.
    """
    report = explain_command(Record.load(run), time)
    files = {"picture": str(plot_command(report, out))} if out is not None else {}
    if json_:
        print_json(report.as_dict() | ({"files": files} if files else {}))
    else:
        print_command(stdout(), report, everything=all_)
        print_files(files)

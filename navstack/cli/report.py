"""`navstack report`: a recorded run as one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.options import file_in
from navstack.cli.output import counting_bar, print_files, print_json
from navstack.record import Record
from navstack.studies import write_run_report


def report(
    run: options.RunFolder,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Write the page here; in a folder: report.html. [default: report.html next to the record]",
            callback=options.writable,
        ),
    ] = None,
    film: Annotated[bool, typer.Option("--film/--no-film", help="Add an animation of the run.")] = True,
    title: Annotated[
        str | None, typer.Option("--title", metavar="TEXT", help="Title. [default: the outcome in a line]")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Write the report of a run as one HTML file: map, goals, timeline, possible causes, film and metrics.

    The file contains its pictures: it can be sent and read on a phone, without other files and without network.
    """
    record = Record.load(run)
    folder = run if run.is_dir() else run.parent
    page = file_in("report.html")(out) or folder / "report.html"
    with counting_bar("drawing", quiet=json_) as progress:
        write_run_report(record, page, film=film, title=title, progress=progress)
    files = {"report": str(page)}
    if json_:
        print_json({"files": files})
    else:
        print_files(files)

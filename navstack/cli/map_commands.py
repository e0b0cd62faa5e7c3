"""`navstack map`: make maps, and change them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.explore import explore
from navstack.cli.log_options import (
    LogFile,
    Mount,
    Partial,
    Reference,
    Scans,
    Topic,
    chosen_scans,
    drive_options,
    print_drive_notes,
)
from navstack.cli.map_building import build, solve_graph
from navstack.cli.map_edit import edit, merge_maps
from navstack.cli.options import file_in
from navstack.cli.output import loading_kernels, print_files, print_json
from navstack.core import InputError
from navstack.logs import MappingModel, logged_scans, map_from_frames, open_scan_log
from navstack.map_io import save_map

app = typer.Typer(no_args_is_help=True, rich_markup_mode="markdown", help="Make and edit maps.")
app.command("build")(build)
app.command("solve")(solve_graph)
app.command("edit")(edit)
app.command("merge")(merge_maps)
app.command("explore")(explore)


@app.command("from-log")
def from_log(
    log: LogFile,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Map to write: a YAML file, and a pgm image next to it; in a folder: map.yaml.",
            callback=file_in("map.yaml"),
        ),
    ],
    resolution: Annotated[float, typer.Option("--resolution", help="Cells (m).")] = 0.05,
    max_range: Annotated[float, typer.Option("--max-range", help="Use beams up to this range (m).")] = 30.0,
    scans: Scans = "all",
    clear: Annotated[
        bool, typer.Option("--clear", help="Beams without a return clear cells, too, up to --max-range.")
    ] = False,
    reference: Reference = None,
    topic: Topic = [],
    mount: Mount = [],
    partial: Partial = False,
    json_: options.Json = False,
) -> None:
    """Make an occupancy grid from a log whose poses are known (corrected logs, localized bags, recorded runs), for map_server.

    Each scan raises the log-odds of the cells where beams end and lowers those of the cells before them.
    """
    for name, value in (("--resolution", resolution), ("--max-range", max_range)):
        if not 1e-3 <= value <= 1e3:
            raise InputError(f"{name} must be a length between 0.001 and 1000 m, not {value:g}", argument=name)
    drive = open_scan_log(log, drive_options(topic, mount, reference=reference, partial=partial, poses_suffice=True))
    every, first = chosen_scans(scans)
    model = MappingModel(max_range=max_range, clear_without_return=clear)
    with loading_kernels(quiet=json_):
        grid, count = map_from_frames(
            lambda: logged_scans(drive, every=every, first=first), resolution=resolution, model=model
        )
    files = save_map(grid, out)
    g = grid.geometry
    if json_:
        print_json(
            {
                "scans": count,
                "cells": [g.nx, g.ny],
                "resolution": g.resolution,
                "origin": [g.origin_x, g.origin_y],
                "occupied": int((grid.data == 100).sum()),
                "free": int((grid.data == 0).sum()),
                "files": [str(file) for file in files],
            }
        )
        return
    print_drive_notes(drive)
    print(
        f"{count} scans: {g.nx} x {g.ny} cells of {g.resolution:g} m, {int((grid.data == 100).sum())} occupied, "
        f"{int((grid.data == 0).sum())} free"
    )
    print_files({"map": str(files[0]), "image": str(files[1])})

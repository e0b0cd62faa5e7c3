"""`navstack plot`: draw a recorded run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options


def plot(
    run: options.RunFolder,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="FILE", help="Write a picture (.png, .svg or .pdf). [default: run.png beside the record]"
        ),
    ] = None,
    animate: Annotated[
        bool, typer.Option("--animate", help="Also write an animation, with the picture's name and the suffix .gif.")
    ] = False,
    animation: Annotated[
        Path | None,
        typer.Option("--animation", metavar="FILE", help="Write the animation here (.gif, or .mp4 with ffmpeg)."),
    ] = None,
    speed: Annotated[
        float, typer.Option("--speed", help="Simulated seconds per second of the animation.", min=0.1)
    ] = 4.0,
    json_: options.Json = False,
) -> None:
    """Draw map, costmaps, planned and driven paths, footprints and goals of a recorded run."""
    from navstack.cli.output import counting_bar, print_files, print_json
    from navstack.plot import animate_run, plot_run
    from navstack.record import Record

    record = Record.load(run)
    folder = run if run.is_dir() else run.parent
    picture = out or folder / "run.png"
    plot_run(record, picture)
    files = {"picture": str(picture)}
    if animate or animation is not None:
        movie = animation or picture.with_suffix(".gif")
        with counting_bar("drawing", quiet=json_) as progress:
            animate_run(record, movie, speed=speed, progress=progress)
        files["animation"] = str(movie)
    if json_:
        print_json({"files": files})
    else:
        print_files(files)

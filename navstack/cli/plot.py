"""`navstack plot`: draw a recorded run again."""

from __future__ import annotations

from pathlib import Path

import typer


def plot(
    run: Path = typer.Argument(..., help="The folder of a run, or its run.npz."),
    out: Path | None = typer.Option(
        None, "--out", help="Picture to write (.png or .svg); beside the record if left out."
    ),
    animate: bool = typer.Option(False, "--animate", help="Also write an animation (run.gif beside the picture)."),
    animation: Path | None = typer.Option(
        None, "--animation", help="Name of the animation (.gif, or .mp4 with ffmpeg)."
    ),
    speed: float = typer.Option(4.0, "--speed", help="Simulated seconds a second of the animation shows.", min=0.1),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Map, costmaps, planned and driven path, footprints and goals of a recorded run."""
    from navstack.cli.output import counting_bar, print_json, stdout
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
        return
    for what, name in files.items():
        stdout().print(f"{what}: {name}")

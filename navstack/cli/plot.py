"""`navstack plot`: draw a recorded run or a map."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.arguments import map_of
from navstack.cli.last_run import last_run
from navstack.cli.options import file_in
from navstack.cli.output import counting_bar, print_files, print_json
from navstack.core import InputError, is_file
from navstack.map_io import map_names
from navstack.plot import (
    animate_fleet,
    animate_run,
    fleet_records,
    plot_commands,
    plot_estimate,
    plot_fleet,
    plot_map,
    plot_run,
    plot_steering,
)
from navstack.record import Record
from navstack.scenario import load_places

_Animation = Annotated[
    Path | None,
    typer.Option("--animation", metavar="FILE", help="Write the animation here (.gif, or .mp4 with ffmpeg)."),
]
_Commands = Annotated[
    Path | None,
    typer.Option(
        "--commands",
        metavar="FILE",
        help="Also draw the commands over time: requested, after the velocity smoother, sent to the robot.",
    ),
]
_Steering = Annotated[
    Path | None,
    typer.Option(
        "--steering",
        metavar="FILE",
        help="Also draw speed and steering angle of a car or a tricycle over time, with their limits.",
    ),
]

_Localization = Annotated[
    Path | None,
    typer.Option(
        "--localization",
        metavar="FILE",
        help="Also draw a moment of a run with a localizer: likelihood field, beams, particles, ellipse, believed and true pose.",
    ),
]


def plot(
    source: Annotated[
        str,
        typer.Argument(
            metavar="RUN|MAP.yaml",
            help="Folder of a recorded run or fleet, or a run.npz; or a map (file or packaged name). [default: the last run]",
            default_factory=lambda: str(last_run()),
            show_default=False,
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Write a picture (.png, .svg or .pdf); in a folder: run.png or MAP.png. "
            "[default: run.png next to the record, or MAP.png]",
            callback=options.writable,
        ),
    ] = None,
    animate: Annotated[
        bool, typer.Option("--animate", help="Also write an animation, with the picture's name and the suffix .gif.")
    ] = False,
    animation: _Animation = None,
    commands: _Commands = None,
    steering: _Steering = None,
    localization: _Localization = None,
    time: options.Time = None,
    speed: Annotated[
        float, typer.Option("--speed", help="Simulated seconds per second of the animation.", min=0.1)
    ] = 4.0,
    _style: options.Style = "screen",
    json_: options.Json = False,
) -> None:
    """Draw a recorded run (map, costmaps, paths, footprints, goals), or a map with its places, grid and coordinates."""
    run = Path(source)
    if run.suffix in (".yaml", ".yml") or (source in map_names() and not (run / "run.npz").exists()):
        if animate or animation is not None:
            raise InputError("a map has no animation; name a recorded run", argument="--animate")
        files = {"picture": str(_draw_map(source, out))}
        print_json({"files": files}) if json_ else print_files(files)
        return
    if run.is_dir() and not (run / "run.npz").exists():
        robots = fleet_records(run)
        if robots:
            _plot_fleet(robots, run, out, animation or (run / "fleet.gif" if animate else None), speed, json_=json_)
            return
    record = Record.load(run)
    folder = run if run.is_dir() else run.parent
    picture = file_in("run.png")(out) or folder / "run.png"
    files = {"picture": str(plot_run(record, picture))}
    files |= _draw_others(record, commands, steering, localization, time)
    if animate or animation is not None:
        movie = animation or picture.with_suffix(".gif")
        with counting_bar("drawing", quiet=json_) as progress:
            animate_run(record, movie, speed=speed, progress=progress)
        files["animation"] = str(movie)
    if json_:
        print_json({"files": files})
    else:
        print_files(files)


def _plot_fleet(
    robots: dict[str, Record], folder: Path, out: Path | None, movie: Path | None, speed: float, *, json_: bool
) -> None:
    files = {"picture": str(plot_fleet(robots, file_in("fleet.png")(out) or folder / "fleet.png"))}
    if movie is not None:
        with counting_bar("drawing", quiet=json_) as progress:
            animate_fleet(robots, movie, speed=speed, progress=progress)
        files["animation"] = str(movie)
    print_json({"files": files}) if json_ else print_files(files)


def _draw_others(
    record: Record, commands: Path | None, steering: Path | None, localization: Path | None, time: float | None
) -> dict[str, str]:
    """Draws the pictures that were asked for besides that of the run. Returns their names. Raises InputError."""
    files: dict[str, str] = {}
    if commands is not None:
        files["commands"] = str(plot_commands(record, file_in("commands.png")(commands) or commands))
    if steering is not None:
        files["steering"] = str(plot_steering(record, file_in("steering.png")(steering) or steering))
    if localization is not None:
        file = file_in("localization.png")(localization) or localization
        files["localization"] = str(plot_estimate(record, file, t=time))
    elif time is not None:
        raise InputError("--time is the moment of --localization FILE; give both", argument="--time")
    return files


def _draw_map(source: str, out: Path | None) -> Path:
    """Draws a map, with the places of NAME.places.yaml next to it."""
    file, grid = map_of(source)
    beside = file.with_name(f"{file.stem}.places.yaml")
    places = load_places(beside).places if is_file(beside) else {}
    picture = file_in(f"{file.stem}.png")(out) or Path(f"{file.stem}.png")
    return plot_map(grid, picture, places=places, title=file.name)

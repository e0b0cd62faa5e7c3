"""`navstack localize`: run a localizer over a log, and measure it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.map_commands import LogFile, Scans, chosen_scans

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.drives import Drive
    from navstack.drives.follow import Track
    from navstack.drives.methods import Method


class LocalizeOptions(NamedTuple):
    """What to localize, from where, and how."""

    log: LogFile
    map_: Annotated[str, typer.Option("--map", metavar="MAP.yaml", help="Map, or name of a packaged one.")]
    initial_pose: Annotated[
        str | None,
        typer.Option(
            "--initial-pose", metavar="X,Y,YAW", help="Start there (m, rad). [default: the reference of the first scan]"
        ),
    ] = None
    global_: Annotated[bool, typer.Option("--global", help="Start without a pose: search the whole map.")] = False
    scans: Annotated[Scans, typer.Option("--scans", help="Which scans to use.")] = "all"
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Parameter of the localizer, or `method=` scan_matching (default), amcl (supervised by searches over the "
            "map) or amcl_only (repeatable).",
        ),
    ] = []
    versus: Annotated[
        list[str],
        typer.Option(
            "--versus", metavar="KEY=VALUE", help="Compare with these parameters, on top of --set (repeatable)."
        ),
    ] = []
    seed: Annotated[int, typer.Option("--seed", help="Seed of the particles.")] = 0


class _Query(NamedTuple):
    drive: Drive
    grid: OccupancyGrid
    start: Pose2D | None
    methods: dict[str, Method]


@options.with_options(chosen=LocalizeOptions)
def localize(
    chosen: LocalizeOptions,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", metavar="DIR", help="Folder for localize.json, localize.png, errors.png and trajectory.csv."
        ),
    ] = None,
    animate: Annotated[
        Path | None, typer.Option("--animate", metavar="FILE", help="Animation of the particles (.gif, .mp4).")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Find the robot's pose along a log: trajectory, errors against the log's reference, particles.

    Logs: CARMEN (.log, .log.gz) and recorded runs. Without alignment: a localizer has no frame of its own.
    """
    from navstack.cli.out_path import folder_only
    from navstack.cli.output import loading_kernels, print_files, print_json
    from navstack.drives import drive_frames
    from navstack.drives.follow import follow

    folder_only(out)
    query = _load(chosen)
    every, first = chosen_scans(chosen.scans)
    tracks: dict[str, Track] = {}
    with loading_kernels(quiet=json_):
        for name, method in query.methods.items():
            localizer, cloud = method.build(chosen.seed)
            localizer.set_map(query.grid)
            frames = drive_frames(query.drive, every=every, first=first)
            tracks[name] = follow(frames, localizer, initial_pose=query.start, globally=chosen.global_, cloud=cloud)
    files = _write(tracks, query.grid, chosen.log.name, out, animate)
    document = {name: track.summary() for name, track in tracks.items()}
    if json_:
        print_json({"tracks": document, "files": files})
        return
    _print(tracks)
    print_files(files)


def _load(chosen: LocalizeOptions) -> _Query:
    from navstack.cli.arguments import map_of, parse_pose
    from navstack.core.errors import InputError
    from navstack.drives import open_drive
    from navstack.drives.methods import Method

    if chosen.global_ and chosen.initial_pose is not None:
        raise InputError("--global and --initial-pose exclude each other; give one of them", argument="--global")
    start = None if chosen.initial_pose is None else parse_pose(chosen.initial_pose, "--initial-pose")
    method = Method.parse(chosen.set_, "--set")
    methods = {method.label: method}
    if chosen.versus:
        other = Method.parse(chosen.versus, "--versus", method)
        methods[other.label if other.label != method.label else f"{other.label} (again)"] = other
    _, grid = map_of(chosen.map_)
    return _Query(open_drive(chosen.log), grid, start, methods)


def _print(tracks: dict[str, Track]) -> None:
    from navstack.cli.output import stdout

    for name, track in tracks.items():
        stdout().print(f"{name}:", markup=False)
        for line in _lines(track):
            stdout().print(f"  {line}", markup=False)


def _lines(track: Track) -> list[str]:
    import math

    import numpy as np

    particles = f"{np.median(track.particles):.0f} particles (median), {track.ms_per_scan:.2f} ms per scan"
    lines = [f"{len(track.indices)} scans, {int(track.lost.sum())} of them lost; {particles}"]
    if track.known.sum() > 1:
        absolute, relations = track.absolute(), track.relations()
        position, heading = absolute.position, math.degrees(absolute.heading.rms)
        lines.append(
            f"absolute error (not aligned): rms {position.rms:.3f} m, 95 % below {position.p95:.3f} m, max {position.max:.3f} m, "
            f"heading rms {heading:.2f} degrees"
        )
        moved, turned = relations.position, relations.heading
        lines.append(
            f"relations between scans: {moved.mean:.3f} +- {moved.std:.3f} m (max {moved.max:.3f}), "
            f"{math.degrees(turned.mean):.2f} +- {math.degrees(turned.std):.2f} degrees"
        )
        far = track.relative(10.0).position
        if far.count:
            lines.append(f"relative error over 10 m: rms {far.rms:.3f} m, max {far.max:.3f} m")
    return lines


def _write(
    tracks: dict[str, Track], grid: OccupancyGrid, title: str, out: Path | None, animate: Path | None
) -> dict[str, str]:
    """Write the products of `--out` and `--animate`; return their names."""
    from navstack.core.files import ensure_directory, write_json
    from navstack.plot.localization import animate_track, plot_track, plot_track_errors

    files: dict[str, str] = {}
    if out is not None:
        ensure_directory(out)
        write_json(out / "localize.json", {name: track.summary() for name, track in tracks.items()})
        plot_track(tracks, grid, out / "localize.png", title=title)
        plot_track_errors(tracks, out / "errors.png")
        _write_trajectory(next(iter(tracks.values())), out / "trajectory.csv")
        products: dict[str, Any] = {
            "results": "localize.json",
            "picture": "localize.png",
            "errors": "errors.png",
            "trajectory": "trajectory.csv",
        }
        files |= {what: str(out / name) for what, name in products.items()}
    if animate is not None:
        files["animation"] = str(animate_track(next(iter(tracks.values())), grid, animate, title=title))
    return files


def _write_trajectory(track: Track, path: Path) -> None:
    from navstack.core.files import write_text

    lines = ["scan,stamp,x,y,yaw,reference_x,reference_y,reference_yaw,particles,explained,lost"]
    for i in range(len(track.indices)):
        values = [track.stamps[i], *track.poses[i], *track.references[i]]
        texts = ",".join("" if v != v else f"{v:.6f}" for v in values)
        explained = "" if track.explained[i] != track.explained[i] else f"{track.explained[i]:.4f}"
        lines.append(f"{track.indices[i]},{texts},{track.particles[i]},{explained},{int(track.lost[i])}")
    write_text(path, "\n".join(lines) + "\n")

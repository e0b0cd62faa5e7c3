"""`navstack localize`: run a localizer over a log, and measure it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navstack.cli import options
from navstack.cli.drive_options import chosen_scans, print_drive_notes
from navstack.cli.localize_options import LocalizeOptions, LocalizeQuery

if TYPE_CHECKING:
    from navstack.drives.follow import Track
    from navstack.drives.relations import RelationResult


@options.with_options(chosen=LocalizeOptions)
def localize(
    chosen: LocalizeOptions,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for localize.json, localize.png, errors.png and trajectory.csv; of --starts: starts.json, .png, .csv.",
        ),
    ] = None,
    animate: Annotated[
        Path | None, typer.Option("--animate", metavar="FILE", help="Animation of the particles (.gif, .mp4).")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Find the robot's pose along a log: trajectory, errors against the log's reference, particles.

    Logs: CARMEN, bags of ROS 1 and 2, MCAP, recorded runs. Without alignment: a localizer has no frame of its own.
    """
    from navstack.cli.localize_report import print_tracks, write_tracks
    from navstack.cli.localize_starts import localize_starts
    from navstack.cli.out_path import folder_only
    from navstack.cli.output import print_files, print_json
    from navstack.drives.relations import errors_by_relations, read_relations

    folder_only(out)
    if chosen.starts is not None:
        _require_global(chosen, animate)
        localize_starts(
            chosen.query(),
            chosen.starts,
            chosen_scans(chosen.scans),
            seed=chosen.seed,
            title=chosen.log.name,
            out=out,
            json_=json_,
        )
        return
    known = None if chosen.relations is None else read_relations(chosen.relations)
    query = chosen.query()
    tracks = _tracks(query, chosen, quiet=json_)
    results: dict[str, RelationResult] = {}
    if known is not None:
        for name, track in tracks.items():
            results[name] = errors_by_relations(known, track.stamps + query.drive.epoch, track.poses)
    document: dict[str, Any] = {name: track.summary() for name, track in tracks.items()}
    for name, result in results.items():
        document[name]["relations_file"] = result.as_dict()
    files = write_tracks(tracks, document, query.grid, chosen.log.name, out, animate)
    if json_:
        print_json({"tracks": document, "files": files})
        return
    print_drive_notes(query.drive)
    print_tracks(tracks, results)
    print_files(files)


def _require_global(chosen: LocalizeOptions, animate: Path | None) -> None:
    from navstack.core.errors import InputError

    if not chosen.global_:
        raise InputError("--starts counts starts without a pose; use it with --global", argument="--starts")
    for name, value in (("--relations", chosen.relations), ("--animate", animate)):
        if value is not None:
            raise InputError(f"--starts and {name} exclude each other; run the command twice", argument=name)


def _tracks(query: LocalizeQuery, chosen: LocalizeOptions, *, quiet: bool) -> dict[str, Track]:
    """Run the localizers over the log."""
    from navstack.cli.output import loading_kernels
    from navstack.drives import drive_frames
    from navstack.drives.follow import follow

    every, first = chosen_scans(chosen.scans)
    tracks: dict[str, Track] = {}
    with loading_kernels(quiet=quiet):
        for name, method in query.methods.items():
            localizer, cloud = method.build(chosen.seed)
            localizer.set_map(query.grid)
            frames = drive_frames(query.drive, every=every, first=first)
            tracks[name] = follow(frames, localizer, initial_pose=query.start, globally=chosen.global_, cloud=cloud)
    return tracks

"""`navstack localize`: run a localizer over a log, and measure it."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.arguments import map_of, parse_place
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
from navstack.cli.options import folder_only
from navstack.cli.output import (
    counting_bar,
    loading_kernels,
    print_files,
    print_json,
    print_warnings,
    stdout,
    titled_table,
)
from navstack.core import InputError, LogError, ensure_directory, write_json, write_text
from navstack.localization import Method, errors_by_relations, follow, run_starts
from navstack.logs import logged_scans, open_scan_log, read_relations
from navstack.parameters import load_configuration
from navstack.plot import animate_track, plot_starts, plot_track, plot_track_errors

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.localization import PoseErrors, RelationResult, Starts, Track
    from navstack.logs import ScanLog
    from navstack.plugins import Localizer

# ----------------------------------------------------------------------------------------------------------------------
# Arguments of `navstack localize`: the log, the map, the start, the localizers to compare.


class LocalizeQuery(NamedTuple):
    """An open log, its map, the start and the localizers by name."""

    drive: ScanLog
    grid: OccupancyGrid
    start: Pose2D | None
    methods: dict[str, Method]


class LocalizeOptions(NamedTuple):
    """What to localize, from where, and how."""

    log: LogFile
    map_: Annotated[
        str | None,
        typer.Option("--map", metavar="MAP.yaml", help="Map, or name of a packaged one. [default: the map in the log]"),
    ] = None
    initial_pose: Annotated[
        str | None,
        typer.Option(
            "--initial-pose", metavar="X,Y,YAW", help="Start there (m, rad). [default: the reference of the first scan]"
        ),
    ] = None
    global_: Annotated[bool, typer.Option("--global", help="Start without a pose: search the whole map.")] = False
    relations: Annotated[
        Path | None,
        typer.Option(
            "--relations",
            metavar="FILE",
            help="Known relations between poses (Kümmerle et al. 2009): lines stamp1 stamp2 x y z roll pitch yaw.",
        ),
    ] = None
    starts: Annotated[
        int | None,
        typer.Option(
            "--starts",
            metavar="N",
            min=1,
            help="With --global: start at N scans along the log instead of the first, and count how many find the pose.",
        ),
    ] = None
    scans: Scans = "all"
    from_: Annotated[
        float | None,
        typer.Option("--from", metavar="T", help="First time (s since the beginning of the log).", min=0.0),
    ] = None
    to: Annotated[
        float | None, typer.Option("--to", metavar="T", help="Last time (s since the beginning of the log).", min=0.0)
    ] = None
    reference: Reference = None
    topic: Topic = []
    mount: Mount = []
    partial: Partial = False
    params: Annotated[
        list[str],
        typer.Option(
            "--params",
            metavar="NAME|DIR|FILE",
            help="Parameters of a robot: its section amcl is used (repeatable, in loading order).",
            autocompletion=options.complete_params,
        ),
    ] = []
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Parameter of the localizer, or `method=` scan_matching (default), amcl (default with --params) or a "
            "localizer of another package, which search the map once they are lost, or amcl_only or dead_reckoning, which only "
            "say that they are (`search=false` and `true` change that; repeatable).",
        ),
    ] = []
    versus: Annotated[
        list[str],
        typer.Option(
            "--versus",
            metavar="KEY=VALUE|NAME|DIR|FILE",
            help="Compare with these parameters: values on top of --set, or another robot's (repeatable).",
        ),
    ] = []
    seed: Annotated[int, typer.Option("--seed", help="Seed of the particles.")] = 0

    def query(self) -> LocalizeQuery:
        """Open the log and the map, and read the parameters. Raises NavError."""
        if self.global_ and self.initial_pose is not None:
            raise InputError("--global and --initial-pose exclude each other; give one of them", argument="--global")
        start = None if self.initial_pose is None else parse_place(self.initial_pose, "--initial-pose", self.map_)
        methods = self._methods()
        chosen = drive_options(self.topic, self.mount, reference=self.reference, partial=self.partial)
        drive = open_scan_log(self.log, dataclasses.replace(chosen, start=self.from_, end=self.to))
        grid = drive.map if self.map_ is None else map_of(self.map_)[1]
        if grid is None:
            raise LogError(f"{self.log} has no map; give one with --map FILE, or make one: navstack map from-log")
        return LocalizeQuery(drive, grid, start, methods)

    def _methods(self) -> dict[str, Method]:
        base = _robot(self.params) if self.params else None
        method = Method.parse(self.set_, "--set", base)
        methods = {method.label: method}
        if self.versus:
            files = [text for text in self.versus if "=" not in text]
            values = [text for text in self.versus if "=" in text]
            # a robot's parameters replace those of --params; --set holds for both
            other = Method.parse(self.set_, "--set", _robot(files)) if files else method
            other = Method.parse(values, "--versus", other)
            label = f"{other.label} {' '.join(files)}".strip()
            methods[label if label != method.label else f"{label} (again)"] = other
        return methods


def _robot(files: list[str]) -> Method:
    """Return amcl with the parameters of a robot. Raises NavError."""
    configuration = load_configuration(files)
    print_warnings(configuration, files)
    amcl = configuration.localization.amcl
    if amcl is None:
        raise InputError(
            f"{', '.join(files)}: there is no section amcl to localize with; write one, or use --set KEY=VALUE alone",
            argument="--params",
        )
    return Method("amcl", amcl=amcl)


@options.with_options(chosen=LocalizeOptions)
def localize(
    chosen: LocalizeOptions,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="DIR",
            help="Folder for localize.json, localize.png, errors.png and trajectory.csv; of --starts: starts.json, .png, .csv.",
            callback=options.folder_only,
        ),
    ] = None,
    animate: Annotated[
        Path | None,
        typer.Option(
            "--animate",
            metavar="FILE",
            help="Animation of the particles (.gif, .mp4).",
            callback=options.writable,
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Find the robot's pose along a log: trajectory, errors against the log's reference, particles.

    Logs: CARMEN, bags of ROS 1 and 2, MCAP, recorded runs. Without alignment: a localizer has no frame of its own.
    """
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
    if not chosen.global_:
        raise InputError("--starts counts starts without a pose; use it with --global", argument="--starts")
    for name, value in (("--relations", chosen.relations), ("--animate", animate)):
        if value is not None:
            raise InputError(f"--starts and {name} exclude each other; run the command twice", argument=name)


def _tracks(query: LocalizeQuery, chosen: LocalizeOptions, *, quiet: bool) -> dict[str, Track]:
    """Run the localizers over the log."""
    every, first = chosen_scans(chosen.scans)
    tracks: dict[str, Track] = {}
    with loading_kernels(quiet=quiet):
        for name, method in query.methods.items():
            localizer, cloud = method.build(chosen.seed)
            localizer.set_map(query.grid)
            frames = logged_scans(query.drive, every=every, first=first)
            tracks[name] = follow(frames, localizer, initial_pose=query.start, globally=chosen.global_, cloud=cloud)
    return tracks


# ----------------------------------------------------------------------------------------------------------------------
# What `navstack localize` prints and writes.


_LONGEST_NAME: Final = 24


def print_tracks(tracks: dict[str, Track], relations: dict[str, RelationResult]) -> None:
    """Print a table with a column for each track."""
    columns = {name: _rows(track, relations.get(name)) for name, track in tracks.items()}
    table = titled_table("localization", left=("",), right=short_names(list(columns)))
    labels = list(dict.fromkeys(label for rows in columns.values() for label in rows))
    for label in labels:
        table.add_row(label, *(rows.get(label, "-") for rows in columns.values()))
    stdout().print(table)


def short_names(names: list[str]) -> tuple[str, ...]:
    """Return names for columns; long ones are printed above the table and get a letter."""
    if all(len(name) <= _LONGEST_NAME for name in names):
        return tuple(names)
    letters = tuple("ABCDEFGH"[: len(names)])
    for letter, name in zip(letters, names, strict=True):
        stdout().print(f"{letter}: {name}", markup=False)
    return letters


def _rows(track: Track, relations: RelationResult | None) -> dict[str, str]:
    """Return the results of a track by name."""
    import numpy as np

    estimated = np.isfinite(track.poses).all(axis=1)
    rows = {
        "scans": f"{len(track.indices)}",
        "without an estimate": f"{int((~estimated).sum())}",
        "lost": f"{int(track.lost.sum())}",
        "in doubt": f"{int(track.in_doubt.sum())}",
        "particles, median": f"{np.median(track.particles):.0f}",
        "particles, most": f"{track.particles.max()}",
        "time per scan": f"{track.ms_per_scan:.2f} ms",
    }
    if track.known.sum() > 1:
        absolute, steps, far = track.absolute(), track.relations(), track.relative(10.0).position
        rows |= {
            "absolute error, rms": f"{absolute.position.rms:.3f} m",
            "absolute error, 95 %": f"{absolute.position.p95:.3f} m",
            "absolute error, most": f"{absolute.position.max:.3f} m",
            "heading error, rms": f"{math.degrees(absolute.heading.rms):.2f}°",
            "heading error, most": f"{math.degrees(absolute.heading.max):.2f}°",
            "sure, but 0.5 m off": f"{track.sure_but_wrong} scans",
            **_relation_rows("scan to scan", steps),
        }
        if far.count:
            rows |= {"over 10 m, rms": f"{far.rms:.3f} m", "over 10 m, most": f"{far.max:.3f} m"}
    if relations is not None:
        rows |= {
            "relations": f"{relations.errors.position.count}",
            "relations outside": f"{relations.outside}",
            "relations between scans": f"{relations.interpolated}",
            **_relation_rows("relations", relations.errors),
            "relations, squares": f"{relations.square_m2[0]:.4f} ± {relations.square_m2[1]:.4f} m²",
        }
    return rows


def _relation_rows(name: str, errors: PoseErrors) -> dict[str, str]:
    """Return mean, standard deviation and maximum of the errors of relations."""
    moved, turned = errors.position, errors.heading
    return {
        f"{name}, mean": f"{moved.mean:.3f} ± {moved.std:.3f} m",
        f"{name}, most": f"{moved.max:.3f} m",
        f"{name}, heading": f"{math.degrees(turned.mean):.2f} ± {math.degrees(turned.std):.2f}°",
    }


def write_tracks(
    tracks: dict[str, Track],
    document: dict[str, Any],
    grid: OccupancyGrid,
    title: str,
    out: Path | None,
    animate: Path | None,
) -> dict[str, str]:
    """Write the products of `--out` and `--animate`; return their names."""
    files: dict[str, str] = {}
    if out is not None:
        ensure_directory(out)
        write_json(out / "localize.json", document)
        plot_track(tracks, grid, out / "localize.png", title=title)
        plot_track_errors(tracks, out / "errors.png")
        files |= {"results": "localize.json", "picture": "localize.png", "errors": "errors.png"}
        for number, track in enumerate(tracks.values()):
            name = "trajectory.csv" if number == 0 else "trajectory_versus.csv"
            _write_trajectory(track, out / name)
            files[name.removesuffix(".csv").replace("_", " ")] = name
        files = {what: str(out / name) for what, name in files.items()}
    if animate is not None:
        files["animation"] = str(animate_track(next(iter(tracks.values())), grid, animate, title=title))
    return files


def _write_trajectory(track: Track, path: Path) -> None:
    lines = ["scan,stamp,x,y,yaw,reference_x,reference_y,reference_yaw,particles,explained,lost,sure"]
    for i in range(len(track.indices)):
        values = [track.stamps[i], *track.poses[i], *track.references[i]]
        texts = ",".join("" if v != v else f"{v:.6f}" for v in values)
        explained = "" if track.explained[i] != track.explained[i] else f"{track.explained[i]:.4f}"
        lines.append(
            f"{track.indices[i]},{texts},{track.particles[i]},{explained},{int(track.lost[i])},{int(track.sure[i])}"
        )
    write_text(path, "\n".join(lines) + "\n")


# ----------------------------------------------------------------------------------------------------------------------
# `navstack localize --global --starts N`: from how many places of a log a localizer finds the pose.


def localize_starts(
    query: LocalizeQuery, count: int, scans: tuple[int, int], *, seed: int, title: str, out: Path | None, json_: bool
) -> None:
    """Run the starts with each method, print a table, and write starts.json, starts.png and starts.csv."""
    every, first = scans
    found: dict[str, Starts] = {}
    with loading_kernels(quiet=json_):
        for name, method in query.methods.items():

            def make(number: int, method: Any = method) -> Localizer:
                localizer, _ = method.build(seed + number)
                localizer.set_map(query.grid)
                return localizer

            with counting_bar("starts", quiet=json_) as progress:
                found[name] = run_starts(
                    lambda: logged_scans(query.drive, every=every, first=first), make, count, progress
                )
    document = {name: starts.summary() for name, starts in found.items()}
    files = _write(found, document, query, title, out)
    if json_:
        print_json({"starts": document, "files": files})
        return
    print_drive_notes(query.drive)
    _print(found)
    print_files(files)


def _print(found: dict[str, Starts]) -> None:
    import numpy as np

    table = titled_table("global starts", left=("",), right=short_names(list(found)))
    columns: list[dict[str, str]] = []
    for starts in found.values():
        rate, times = starts.rate(), starts.table()
        rows = {
            "starts": f"{len(starts.results)}",
            "found": f"{len(starts.of('found'))}",
            "found, rate": f"{100 * rate.value:.0f} % [{100 * rate.low:.0f}, {100 * rate.high:.0f}]",
            "stayed uncertain": f"{len(starts.of('uncertain'))}",
            "certain of a wrong pose": f"{len(starts.of('wrong'))}",
        }
        if len(times):
            median, late = np.median(times, axis=0).tolist(), np.quantile(times, 0.95, axis=0).tolist()
            for name, unit, digits, a, b in zip(
                ("scans", "time", "distance"), ("", " s", " m"), (0, 1, 1), median, late, strict=True
            ):
                rows[f"{name}, median (95 % below)"] = f"{a:.{digits}f}{unit} ({b:.{digits}f}{unit})"
            errors = [r.error for r in starts.of("found")]
            rows["error then, median"] = f"{np.median(errors):.3f} m" if errors else "-"
        columns.append(rows)
    for label in dict.fromkeys(label for rows in columns for label in rows):
        table.add_row(label, *(rows.get(label, "-") for rows in columns))
    stdout().print(table)


def _write(
    found: dict[str, Starts], document: dict[str, Any], query: LocalizeQuery, title: str, out: Path | None
) -> dict[str, str]:
    if out is None:
        return {}
    ensure_directory(out)
    write_json(out / "starts.json", document)
    files = {"results": str(out / "starts.json")}
    for number, (name, starts) in enumerate(found.items()):
        suffix = "" if number == 0 else "_versus"
        picture, table = out / f"starts{suffix}.png", out / f"starts{suffix}.csv"
        plot_starts(starts, query.grid, picture, title=f"{title}: {name}")
        lines = ["scan,x,y,yaw,outcome,scans,seconds,meters,error,wrong"]
        for r in starts.results:
            x, y, yaw = r.pose
            error = "" if r.error != r.error else f"{r.error:.4f}"
            lines.append(
                f"{r.scan},{x:.4f},{y:.4f},{yaw:.4f},{r.outcome},{r.scans},{r.seconds:.3f},{r.meters:.3f},{error},{r.wrong}"
            )
        write_text(table, "\n".join(lines) + "\n")
        files |= {f"picture{suffix}".replace("_", " "): str(picture), f"table{suffix}".replace("_", " "): str(table)}
    return files

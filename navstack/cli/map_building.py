"""`navstack map build` and `navstack map solve`: a map from raw scans, and pose graphs."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError
from rich.progress import Progress, TextColumn, TimeElapsedColumn

from navstack.cli import options
from navstack.cli.log_options import LogFile, Mount, Partial, Topic, drive_options, print_drive_notes
from navstack.cli.options import file_in
from navstack.cli.output import loading_kernels, print_files, print_json, print_note, shows_progress, stderr
from navstack.core import InputError, Transform2D, ensure_directory, exists, short_repr, write_json
from navstack.localization import LoggedScan
from navstack.logs import ScanLog, open_scan_log
from navstack.map_io import save_map
from navstack.mapping import (
    Mapper,
    MapperParams,
    load_session,
    read_g2o,
    report_document,
    save_session,
    solve,
    write_g2o,
)
from navstack.parameters import nearest
from navstack.plot import plot_mapping

SAVE_S = 60.0
"""Time between two saved states of a mapping (s of the clock)."""


def build(
    log: LogFile,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Map to write: a YAML file; next to it the image, the graph, the picture and the report. In a folder: "
            "map.yaml.",
            callback=file_in("map.yaml"),
        ),
    ],
    set_: Annotated[
        list[str],
        typer.Option(
            "--set", metavar="NAME=VALUE", help="Parameter of the mapper, such as minimum_travel_distance=0.5."
        ),
    ] = [],
    no_odometry: Annotated[
        bool, typer.Option("--no-odometry", help="Match scans only; they must overlap well.")
    ] = False,
    turn_laser: Annotated[
        float, typer.Option("--turn-laser", metavar="RAD", help="Add this to the yaw of the laser on the base.")
    ] = 0.0,
    topic: Topic = [],
    mount: Mount = [],
    partial: Partial = False,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with the mapping that was saved next to the map, to the same bits.")
    ] = False,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="Stop after this many scans of the log.")] = None,
    json_: options.Json = False,
) -> None:
    """Make a map from a raw log: match the scans, recognize places, solve the graph of the poses.

    Writes the map (YAML and pgm), the graph (.g2o), a picture of both (.png), a report with every loop that was accepted or
    rejected (.report.json), and the mapping itself (.mapping.npz) for --resume and `explain map`.
    """
    files = {
        "graph": out.with_suffix(".g2o"),
        "picture": out.with_suffix(".png"),
        "report": out.with_suffix(".report.json"),
        "mapping": out.with_suffix(".mapping.npz"),
    }
    params = mapper_params(set_)
    if resume and not exists(files["mapping"]):
        raise InputError(f"--resume: {files['mapping']} does not exist; leave --resume out", argument="--resume")
    mapper = load_session(files["mapping"]) if resume else Mapper(params)
    if resume and set_ and mapper.params != params:
        raise InputError("--resume goes on with the parameters of the mapping; leave --set out", argument="--set")
    drive = open_scan_log(
        log, drive_options(topic, mount, reference="none", partial=partial, poses_suffice=no_odometry)
    )
    ensure_directory(out.parent)
    with loading_kernels(quiet=json_):
        _add_scans(mapper, drive, files["mapping"], no_odometry, turn_laser, limit, quiet=json_)
        mapper.finish()
        grid = mapper.map()
        document = report_document(mapper)
    written = save_map(grid, out)
    save_session(mapper, files["mapping"])
    write_g2o(mapper.final_graph or mapper.graph, files["graph"])
    plot_mapping(mapper, files["picture"], grid=grid, title=f"map of {log.name}")
    document["files"] = {"map": str(written[0]), "image": str(written[1])}
    document["files"] |= {name: str(file) for name, file in files.items()}
    document["problems"] = dict(drive.problems)
    write_json(files["report"], document)
    if json_:
        print_json(document)
        return
    print_drive_notes(drive)
    for line in document["lines"]:
        print(line)
    print_files(document["files"])


def _add_scans(
    mapper: Mapper,
    drive: ScanLog,
    state: Path,
    no_odometry: bool,
    turn_laser: float,
    limit: int | None,
    *,
    quiet: bool,
) -> None:
    """Add the scans of a log that the mapper has not had; show how the map grows; save the mapping now and then."""
    columns = TextColumn("{task.description}"), TimeElapsedColumn()
    turn = Transform2D(0.0, 0.0, turn_laser)
    began = saved = time.monotonic()
    with Progress(*columns, console=stderr(), transient=True, disable=not shows_progress(quiet=quiet)) as bar:
        task = bar.add_task("mapping", total=None)
        for n, frame in enumerate(_new_scans(mapper, drive, limit)):
            odometry = None if no_odometry else frame.odometry
            mapper.add_scan(frame.scan.stamp, odometry, frame.scan, frame.sensor @ turn)
            if n % 50 == 0:
                loops = sum(loop.accepted for loop in mapper.loops)
                text = f"{n + 1} scans, {mapper.travelled:.0f} m, {len(mapper.keyframes)} keyframes, {loops} loops"
                bar.update(task, description=text)
                now = time.monotonic()
                if now - saved > SAVE_S + 10.0 * (saved - began) / 100.0:
                    save_session(mapper, state)
                    save_map(mapper.map(), state.with_suffix("").with_suffix(".yaml"))
                    saved = time.monotonic()


def _new_scans(mapper: Mapper, drive: ScanLog, limit: int | None) -> Iterator[LoggedScan]:
    last = mapper.last_stamp
    for frame in itertools.islice(drive, limit):
        if last is None or frame.scan.stamp > last:
            yield frame


def mapper_params(texts: list[str]) -> MapperParams:
    """Return the parameters with these of NAME=VALUE. Raises InputError."""
    values: dict[str, str] = {}
    for text in texts:
        name, separator, value = text.partition("=")
        if not separator or name not in MapperParams.model_fields:
            near = nearest(name, MapperParams.model_fields)
            hint = f'did you mean "{near}"?' if near else f"known: {', '.join(MapperParams.model_fields)}"
            raise InputError(
                f'--set "{text}": give NAME=VALUE with a parameter of the mapper; {hint}', argument="--set"
            )
        values[name] = value
    try:
        return MapperParams.model_validate_strings(values)
    except ValidationError as exc:
        error = exc.errors(include_url=False, include_context=False)[0]
        problem = error["msg"][0].lower() + error["msg"][1:]
        name = ".".join(str(part) for part in error["loc"])
        raise InputError(f"--set {name}={short_repr(error['input'])}: {problem}", argument="--set") from None


def solve_graph(
    graph: Annotated[Path, typer.Argument(metavar="GRAPH.g2o", help="Pose graph in the plane (g2o text, or .g2o.gz).")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE|DIR", help="Solved graph to write.", callback=file_in("solved.g2o")),
    ] = None,
    robust: Annotated[
        float | None,
        typer.Option(
            "--robust",
            metavar="SIGMAS",
            min=0.1,
            help="Edges between poses that do not follow each other lose weight beyond this error.",
        ),
    ] = None,
    json_: options.Json = False,
) -> None:
    """Solve a pose graph: print chi2 before and after, and from which start it was found."""
    problem = read_g2o(graph)
    before = problem.chi2()
    began = time.process_time()
    found = solve(problem, kernel_width=robust)
    spent = time.process_time() - began
    document: dict[str, Any] = {
        "poses": len(problem.poses),
        "edges": len(problem.edges),
        "chi2_before": before,
        "chi2": found.chi2,
        "start": found.start,
        "steps": found.iterations,
        "converged": found.converged,
        "seconds": spent,
    }
    if not found.converged:
        print_note("the search ended before it converged")
    if out is not None:
        problem.poses = found.poses
        document["files"] = {"graph": str(write_g2o(problem, out))}
    if json_:
        print_json(document)
        return
    print(
        f"{len(problem.poses)} poses, {len(problem.edges)} edges: chi2 {before:.6g} -> {found.chi2:.6g} in {found.iterations} "
        f"steps from {found.start}, {spent:.2f} s"
    )
    print_files(document.get("files", {}))

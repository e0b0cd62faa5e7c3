"""Arguments of `navstack localize`: the log, the map, the start, the localizers to compare."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from navstack.cli import options
from navstack.cli.drive_options import LogFile, Mount, Partial, Reference, Scans, Topic, drive_options

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.drives import Drive
    from navstack.drives.methods import Method


class LocalizeQuery(NamedTuple):
    """An open log, its map, the start and the localizers by name."""

    drive: Drive
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
            help="Parameter of the localizer, or `method=` scan_matching (default), amcl (supervised by searches over the "
            "map; default with --params), amcl_only, dead_reckoning, or a localizer of another package (repeatable).",
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
        from navstack.cli.arguments import map_of, parse_pose
        from navstack.core.errors import InputError, LogError
        from navstack.drives import open_drive

        if self.global_ and self.initial_pose is not None:
            raise InputError("--global and --initial-pose exclude each other; give one of them", argument="--global")
        start = None if self.initial_pose is None else parse_pose(self.initial_pose, "--initial-pose")
        methods = self._methods()
        chosen = drive_options(self.topic, self.mount, reference=self.reference, partial=self.partial)
        drive = open_drive(self.log, dataclasses.replace(chosen, start=self.from_, end=self.to))
        grid = drive.map if self.map_ is None else map_of(self.map_)[1]
        if grid is None:
            raise LogError(f"{self.log} has no map; give one with --map FILE, or make one: navstack map from-log")
        return LocalizeQuery(drive, grid, start, methods)

    def _methods(self) -> dict[str, Method]:
        from navstack.drives.methods import Method

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
    from navstack.cli.output import print_warnings
    from navstack.core.errors import InputError
    from navstack.drives.methods import Method
    from navstack.parameters.configuration import load_configuration

    configuration = load_configuration(files)
    print_warnings(configuration)
    amcl = configuration.localization.amcl
    if amcl is None:
        raise InputError(
            f"{', '.join(files)}: there is no section amcl to localize with; write one, or use --set KEY=VALUE alone",
            argument="--params",
        )
    return Method("amcl", amcl=amcl)

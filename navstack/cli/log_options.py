"""Arguments of the commands that read a drive: the log, its topics, the frames of its sensors, which scans."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from navstack.cli import options
from navstack.cli.arguments import map_of, parse_numbers, parse_place
from navstack.cli.output import print_note, print_warnings, shows_progress, stderr
from navstack.core import InputError, LogError
from navstack.logs import ScanLogOptions, open_log
from navstack.parameters import load_configuration
from navstack.replay import ReplayOptions, empty_map, find_topics, last_pose, logged_map

if TYPE_CHECKING:
    from navstack.core import OccupancyGrid, Pose2D
    from navstack.logs import Log, ScanLog
    from navstack.parameters import Configuration

Scans = Annotated[Literal["all", "odd", "even"], typer.Option("--scans", help="Which scans to use.")]
LogFile = Annotated[
    Path,
    typer.Argument(
        metavar="LOG",
        help="CARMEN log (.log, .log.gz), bag of ROS 1 or 2, MCAP file, or a recorded run (folder or run.npz).",
    ),
]
Reference = Annotated[
    str | None,
    typer.Option(
        "--reference",
        metavar="TOPIC|tf|none",
        help="True poses of a bag: a topic, tf (the localization in the log), or none. [default: /base_pose_ground_truth, "
        "else tf]",
    ),
]
Topic = Annotated[
    list[str],
    typer.Option("--topic", metavar="NAME=TOPIC", help="Topic of a bag for scan, odom or map (repeatable)."),
]
Mount = Annotated[
    list[str],
    typer.Option(
        "--mount",
        metavar="FRAME=X,Y,Z,YAW",
        help="Pose on the base of a sensor's frame that is not in a bag (m, rad; repeatable).",
    ),
]
Partial = Annotated[bool, typer.Option("--partial", help="Use the part of a damaged bag that can be read.")]


def chosen_scans(scans: str) -> tuple[int, int]:
    """The scans of `--scans` as (every, first); the first scan of a log is number 1, an odd one."""
    return {"all": (1, 0), "odd": (2, 0), "even": (2, 1)}[scans]


def parse_topics(texts: list[str]) -> dict[str, str]:
    """The values of `--topic`: NAME=TOPIC. Raises InputError."""
    found: dict[str, str] = {}
    for text in texts:
        name, separator, topic = text.partition("=")
        if not separator or not name.strip() or not topic.strip():
            raise InputError(
                f'--topic "{text}": give NAME=TOPIC, such as scan=/front/scan', argument="--topic", value=text
            )
        found[name.strip()] = topic.strip()
    return found


def parse_mountings(texts: list[str]) -> dict[str, tuple[float, ...]]:
    """The values of `--mount`: FRAME=X,Y,Z,YAW. Raises InputError."""
    found: dict[str, tuple[float, ...]] = {}
    for text in texts:
        frame, separator, values = text.partition("=")
        if not separator or not frame.strip():
            raise InputError(
                f'--mount "{text}": give FRAME=X,Y,Z,YAW, such as base_scan=-0.03,0,0.17,0',
                argument="--mount",
                value=text,
            )
        found[frame.strip()] = tuple(parse_numbers(values, "--mount", "x,y,z,yaw in meters and radians", (4,)))
    return found


def drive_options(
    topic: list[str],
    mount: list[str],
    *,
    reference: str | None = None,
    partial: bool = False,
    poses_suffice: bool = False,
) -> ScanLogOptions:
    """What the options say about reading a log. Raises InputError."""
    topics = parse_topics(topic)
    unknown = sorted(set(topics) - {"scan", "odom", "map"})
    if unknown:
        raise InputError(f'--topic "{unknown[0]}": the names are scan, odom and map', argument="--topic")
    if reference is not None:
        topics["reference"] = reference
    return ScanLogOptions(topics, parse_mountings(mount), partial=partial, poses_suffice=poses_suffice)


def print_drive_notes(drive: ScanLog) -> None:
    """What was chosen of a log without being named, and what of it could not be used."""
    for note in drive.notes:
        print_note(note)
    for text, count in drive.problems.items():
        print_note(f"{count} time{'s' * (count != 1)}: {text}")


# ----------------------------------------------------------------------------------------------------------------------
# Arguments of the commands that read a log: the log, the map, the topics, the goals.


BagFile = Annotated[
    Path, typer.Argument(metavar="LOG", help="ROS 1 bag, ROS 2 bag (folder, .db3, .mcap) or MCAP file.")
]
PartialBag = Annotated[bool, typer.Option("--partial", help="Use the part of a damaged file that can be read.")]


class OpenedReplay(NamedTuple):
    """An open log and everything that a replay needs besides."""

    log: Log
    configuration: Configuration
    static_map: OccupancyGrid
    map_file: Path | None
    """File of the map, if it is not that of the log."""
    options: ReplayOptions
    notes: list[str]


class ReplayInput(NamedTuple):
    """A log with the options of its replay."""

    log: BagFile
    params: options.Params = []
    set_: options.Set = []
    distro: options.Distro = None
    allow_missing: options.AllowMissing = False
    map_: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="MAP.yaml|TOPIC|none",
            help="Map file, packaged map, topic of a map, or none: a free map around the robot. [default: /map of the log]",
        ),
    ] = None
    topic: Annotated[
        list[str],
        typer.Option(
            "--topic",
            metavar="NAME=TOPIC",
            help="Topic of the log for a topic of the parameters, or for odom, cmd_vel, goal, plan or map (repeatable).",
        ),
    ] = []
    goal: Annotated[
        list[str],
        typer.Option(
            "--goal",
            metavar="[T:]X,Y[,YAW]|end",
            help="Goal in the global frame (m, rad), sent at T (s); end: where the robot is at the end (repeatable).",
        ),
    ] = []
    initial_pose: Annotated[
        str | None,
        typer.Option(
            "--initial-pose", metavar="X,Y,YAW", help="First pose in the map of a robot without a localization."
        ),
    ] = None
    mount: Annotated[
        list[str],
        typer.Option(
            "--mount",
            metavar="FRAME=X,Y,Z,YAW",
            help="Pose on the base of a sensor's frame that is not in the log (m, rad; repeatable).",
        ),
    ] = []
    partial: PartialBag = False

    @contextmanager
    def opened(
        self, *, start: float | None = None, end: float | None = None, scans: bool = True
    ) -> Generator[OpenedReplay]:
        """Open the log and load the parameters and the map. Raises NavError."""
        pose = self._initial_pose()
        mountings, topics = parse_mountings(self.mount), self._topics()
        configuration = load_configuration(
            self.params or ["turtlebot"], overrides=self.set_, distro=self.distro, allow_missing=self.allow_missing
        )
        print_warnings(configuration, self.params or ["turtlebot"], self.set_, distro=self.distro)
        base = configuration.local_costmap.params.robot_base_frame
        with open_log(self.log, partial=self.partial) as log:
            static_map, file, notes = self._map(log, configuration, topics, pose)
            chosen = ReplayOptions(
                start,
                end,
                topics,
                self._goals(log, configuration, topics, pose, start or 0.0),
                pose,
                {frame: (base, values) for frame, values in mountings.items()},
                scans,
            )
            yield OpenedReplay(log, configuration, static_map, file, chosen, notes)

    def _initial_pose(self) -> Pose2D | None:
        return None if self.initial_pose is None else parse_place(self.initial_pose, "--initial-pose", self.map_)

    def _topics(self) -> dict[str, str]:
        found = parse_topics(self.topic)
        if self.map_ is not None and self.map_.startswith("/") and not Path(self.map_).exists():
            found["map"] = self.map_
        return found

    def _map(
        self, log: Log, configuration: Configuration, topics: dict[str, str], pose: Pose2D | None
    ) -> tuple[OccupancyGrid, Path | None, list[str]]:
        if self.map_ is not None and self.map_ != "none" and "map" not in topics:
            path, grid = map_of(self.map_)
            return grid, path, []
        found = find_topics(log, configuration, topics)
        if self.map_ != "none":
            notes: list[str] = []
            grid = logged_map(log, found, notes.append)
            if grid is not None:
                return grid, None, notes
            raise LogError(
                f"{log.path} has no map on /map; give one with --map FILE, or --map none for a free map around the robot"
            )
        frame = configuration.global_costmap.params.global_frame
        return empty_map(log, found, pose, frame), None, ["the map is free of obstacles (--map none)"]

    def _goals(
        self, log: Log, configuration: Configuration, topics: dict[str, str], pose: Pose2D | None, start: float
    ) -> tuple[tuple[float, Pose2D], ...]:
        found: list[tuple[float, Pose2D]] = []
        for text in self.goal:
            head, separator, rest = text.partition(":")
            time = start
            if separator:
                from navstack.cli.arguments import parse_numbers

                (time,) = parse_numbers(head, "--goal", "T:X,Y,YAW with T in seconds since the first message", (1,))
            body = rest if separator else text
            if body.strip() == "end":
                found.append((time, last_pose(log, configuration, topics, pose)))
            else:
                found.append((time, parse_place(body, "--goal", self.map_)))
        return tuple(found)


@contextmanager
def seconds_bar(what: str, duration: float, *, quiet: bool) -> Generator[Callable[[float], None]]:
    """A progress bar over `duration` (s) with the time left; yields its callback, which takes the time (s)."""
    columns = (
        TextColumn(what),
        BarColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=stderr(), transient=True, disable=not shows_progress(quiet=quiet)) as bar:
        task = bar.add_task(what, total=max(math.ceil(duration), 1))
        yield lambda now: bar.update(task, completed=now)


@contextmanager
def reading_bar(log: Log, *, quiet: bool) -> Generator[Callable[[float], None]]:
    """A progress bar over a log."""
    with seconds_bar("reading", log.duration, quiet=quiet) as progress:
        yield progress

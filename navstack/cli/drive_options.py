"""Arguments of the commands that read a drive: the log, its topics, the frames of its sensors, which scans."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

if TYPE_CHECKING:
    from navstack.drives import Drive, DriveOptions

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
    from navstack.core.errors import InputError

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
    from navstack.cli.arguments import parse_numbers
    from navstack.core.errors import InputError

    found: dict[str, tuple[float, ...]] = {}
    for text in texts:
        frame, separator, values = text.partition("=")
        if not separator or not frame.strip():
            raise InputError(
                f'--mount "{text}": give FRAME=X,Y,Z,YAW, such as base_scan=-0.03,0,0.17,0',
                argument="--mount",
                value=text,
            )
        found[frame.strip()] = tuple(parse_numbers(values, "--mount", "x,y,z,yaw in metres and radians", (4,)))
    return found


def drive_options(
    topic: list[str], mount: list[str], *, reference: str | None = None, partial: bool = False
) -> DriveOptions:
    """What the options say about reading a log. Raises InputError."""
    from navstack.core.errors import InputError
    from navstack.drives import DriveOptions

    topics = parse_topics(topic)
    unknown = sorted(set(topics) - {"scan", "odom", "map"})
    if unknown:
        raise InputError(f'--topic "{unknown[0]}": the names are scan, odom and map', argument="--topic")
    if reference is not None:
        topics["reference"] = reference
    return DriveOptions(topics, parse_mountings(mount), partial=partial)


def print_drive_notes(drive: Drive) -> None:
    """What was chosen of a log without being named, and what of it could not be used."""
    from navstack.cli.output import print_note

    for note in drive.notes:
        print_note(note)
    for text, count in drive.problems.items():
        print_note(f"{count} time{'s' * (count != 1)}: {text}")

"""`navstack ros1 install`: packages for roslaunch, and what a launch file must become."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from navstack.cli.output import stdout
from navstack.cli.ros1_nodes import NODE, NodeCommand
from navstack.core import InputError, resolved
from navstack.parameters import launch_argument
from navstack.ros1 import Advice, advise


def install(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="Folder for the packages, to be put on ROS_PACKAGE_PATH.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace packages that navstack wrote before.")] = False,
    drop_in: Annotated[
        bool,
        typer.Option(
            "--drop-in/--no-drop-in",
            help="Also packages named move_base, map_server, amcl, gmapping ..: existing launch files run unchanged.",
        ),
    ] = True,
    launch: Annotated[
        list[Path],
        typer.Option("--launch", metavar="FILE", help="Launch file: print what its nodes must become (repeatable)."),
    ] = [],
) -> int:
    """Write packages for roslaunch: navstack_ros1 (nodes, launch files), and move_base, map_server, amcl, gmapping ..

    The latter take the place of the originals.

    Afterwards: `export ROS_PACKAGE_PATH=DIR` and `roslaunch navstack_ros1 demo.launch`. With `--launch FILE`, arguments of the
    launch file follow as for roslaunch: `model:=burger`. Exit codes: 0 written, 2 invalid input or an existing folder.
    """
    if folder is None and not launch:
        raise InputError("nothing to do: name a folder for the packages, or a launch file with --launch")
    extra = [text for text in context.args if launch_argument(text) is None]
    if extra:
        raise InputError(f"{' '.join(extra)} is neither an option nor an argument NAME:=VALUE of a launch file")
    arguments = dict(pair for text in context.args if (pair := launch_argument(text)) is not None)
    advice = [(file, advise(file, arguments)) for file in launch]
    if folder is not None:
        _install(folder, force=force, drop_in=drop_in)
    for file, lines in advice:
        _print_advice(file, lines, drop_in=drop_in)
    return 0


def _install(folder: Path, *, force: bool, drop_in: bool) -> None:
    from navstack.ros1 import install

    for path in install(folder, force=force, drop_in=drop_in):
        stdout().print(escape(str(path)), soft_wrap=True)
    stdout().print(
        escape(
            f"export ROS_PACKAGE_PATH={resolved(folder)}${{ROS_PACKAGE_PATH:+:$ROS_PACKAGE_PATH}}\n"
            "roslaunch navstack_ros1 demo.launch"
        ),
        soft_wrap=True,
    )


def _print_advice(file: Path, advice: list[Advice], *, drop_in: bool) -> None:
    out = stdout()
    for item in advice:
        out.print(escape(str(item)), soft_wrap=True, highlight=False)
    needs = sorted({package for item in advice for package in item.needs})
    if not advice:
        out.print(escape(f"{file}: no node of it has to change"), soft_wrap=True)
    elif drop_in and any(item.after for item in advice):
        also = f", and {' and '.join(needs)}," if needs else ","
        out.print(
            f"With the packages of these names on ROS_PACKAGE_PATH{also} the file can also stay as it is.",
            soft_wrap=True,
        )
    if advice:
        out.print(escape(f"navstack check {file}    # what navstack reads of its parameters"), soft_wrap=True)


def add_to(app: typer.Typer) -> None:
    """Add the command to `navstack ros1`."""
    app.command("install", cls=NodeCommand, context_settings=NODE)(install)

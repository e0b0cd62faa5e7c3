"""`navstack explain migration`: what stands between a move_base robot and Nav2."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.output import print_json, stdout
from navstack.explain import explain_migration, listed

_PLACES = 4


def migration(
    params: options.ParamsArgument,
    distro: Annotated[
        str, typer.Option("--distro", metavar="NAME", help="Distribution of Nav2: foxy to lyrical.")
    ] = "jazzy",
    set_: options.Set = [],
    allow_missing: options.AllowMissing = False,
    json_: options.Json = False,
) -> None:
    """List what a move_base robot must change for Nav2, each with its place in the robot's files and what to do.

    `navstack params convert` makes these changes.
    """
    report = explain_migration(params, distro, overrides=set_, allow_missing=allow_missing)
    if json_:
        print_json(report.as_dict())
        return
    out = stdout()
    for number, point in enumerate(report.points, 1):
        out.print(f"[bold]{number}. {escape(point.title)}[/]", highlight=False)
        for line in listed(point, _PLACES):
            out.print(f"   {escape(line)}", soft_wrap=True, highlight=False)
        out.print(f"   {escape(point.cause)}; {escape(point.fix)}", soft_wrap=True, highlight=False)
    if report.others:
        count = len(report.others)
        out.print(
            f"{count} of {count + len(report.points)} do not apply to this robot: {', '.join(report.others)}",
            highlight=False,
        )

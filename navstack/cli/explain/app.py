"""The subcommands of `navstack explain`."""

from __future__ import annotations

import typer

from navstack.cli.explain.cell import cell
from navstack.cli.explain.command import command
from navstack.cli.explain.costmap import costmap
from navstack.cli.explain.goal import goal
from navstack.cli.explain.inflation import inflation
from navstack.cli.explain.passages import passages
from navstack.cli.explain.tracking import tracking

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Diagnose a run or a parameter set: goals, commands, cell costs, tracking, passages, inflation.",
)
app.command("command")(command)
app.command("goal")(goal)
app.command("cell")(cell)
app.command("tracking")(tracking)
app.command("passages")(passages)
app.command("inflation")(inflation)
app.command("costmap")(costmap)

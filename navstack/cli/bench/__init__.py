"""`navstack bench`: published tasks, planners, speed, and one parameter set against another."""

from __future__ import annotations

import typer

from navstack.cli.bench import barn, compare, movingai, planners, random, speed

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Measure: published tasks, planners, speed, and one parameter set against another.",
    epilog="With --out, each result is kept as it comes: a bench that was killed goes on with --resume. "
    "Exit codes: 0 it ran, 1 some of its runs gave no result, 2 the input was wrong, 130 interrupted.",
)
app.command("barn")(barn.barn)
app.command("movingai")(movingai.movingai)
app.command("planners")(planners.planners)
app.command("speed")(speed.speed)
app.command("compare")(compare.compare)
app.command("random")(random.random)

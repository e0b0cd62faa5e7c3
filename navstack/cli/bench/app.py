"""The commands of `navstack bench`."""

from __future__ import annotations

import typer

from navstack.cli.bench import barn, compare, controllers, movingai, planners, random, safety, speed

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Benchmark published tasks, planners, speed, and one parameter set against another.",
    epilog="With --out, results are saved as they arrive; --resume continues an interrupted benchmark. "
    "Exit codes: 0 all runs finished, 1 some runs gave no result, 2 invalid input, 130 interrupted.",
)
app.command("barn")(barn.barn)
app.command("movingai")(movingai.movingai)
app.command("planners")(planners.planners)
app.command("speed")(speed.speed)
app.command("compare")(compare.compare)
app.command("controllers")(controllers.controllers)
app.command("random")(random.random)
app.command("safety")(safety.safety)

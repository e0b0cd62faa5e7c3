"""`navstack bench random`: random scenarios and their invariant violations, or collisions of four footprints."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.core import InputError
from navstack.studies import FootprintTask, RandomTask


@with_options(output=BenchOutput)
def random(
    count: Annotated[int, typer.Argument(metavar="N", help="Number of scenarios.", min=1, max=10_000_000)] = 1000,
    first: Annotated[int, typer.Option("--first", help="Number of the first scenario.", min=0)] = 0,
    time_limit: Annotated[
        float | None, typer.Option("--time-limit", help="Simulated seconds allowed per goal; 20 by default.", min=0.5)
    ] = None,
    footprints: Annotated[
        bool,
        typer.Option(
            "--footprints",
            help="Four footprints among static obstacles that the lidar sees all round: no collision is allowed. "
            "It has its own time limits.",
        ),
    ] = False,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Run random scenarios (maps, robots, parameters, noise, obstacles) and check the invariants: no exception, every goal
    ends in a terminal state, no success with a collision. The exit code is 1 if a scenario violates one of them.

    A scenario depends on its number only: `navstack bench random 1 --first N` repeats it.
    """
    if not footprints:
        task = RandomTask(first, count, 20.0 if time_limit is None else time_limit)
        return output.carry_out(task, processes=processes)
    if time_limit is not None:
        raise InputError(
            "--footprints has its own time limits; leave --time-limit out", argument="--time-limit", value=time_limit
        )
    return output.carry_out(FootprintTask(first, count), processes=processes)

"""`navstack bench safety`: contacts in random scenes with and without the collision monitor."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.studies import SafetyTask


@with_options(output=BenchOutput)
def safety(
    count: Annotated[int, typer.Argument(metavar="N", help="Number of scenes.", min=1, max=10_000_000)] = 300,
    first: Annotated[int, typer.Option("--first", help="Number of the first scene.", min=0)] = 0,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Drive three robots by random velocities among people who walk and boxes that appear, with and without the collision
    monitor. Each contact with the monitor is explained; the exit code is 1 if one of them cannot be.
    """
    return output.carry_out(SafetyTask(first, count), processes=processes)

"""`navstack bench controllers`: all controllers on the same scenarios, each with its packaged tuning."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.studies import ControllersTask, read_groups, read_tunings


@with_options(output=BenchOutput)
def controllers(
    suite: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SUITE..]",
            help="Packaged suites (office, narrow, crowd, warehouse, circle_crossing, shipped), scenario files, folders of "
            "files, or a folder with BARN worlds. Default: the first four.",
        ),
    ] = None,
    controller: Annotated[
        list[str],
        typer.Option(
            "--controller",
            metavar="NAME[=PARAMS]",
            help="Only these (repeatable): a controller with a packaged tuning, or a name and your own parameters. The times "
            "of the others are compared with the first one's.",
        ),
    ] = [],
    count: Annotated[
        int | None, typer.Option("--count", metavar="N", min=1, help="Number of scenarios of each suite.")
    ] = None,
    seeds: Annotated[
        int,
        typer.Option("--seeds", metavar="N", min=1, help="Runs per scenario and controller, with seeds 0 to N - 1."),
    ] = 1,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Drive all controllers through the same scenarios, each with its packaged tuning.

    A row per suite and controller: success, time, clearance, jerk, contacts and the time of a control cycle, with confidence
    intervals. Controllers: dwa, trajectory_rollout, mppi, pure_pursuit, rotation_shim, graceful.
    """
    task = ControllersTask(read_tunings(controller), read_groups(suite or [], count), seeds)
    return output.carry_out(task, processes=processes)

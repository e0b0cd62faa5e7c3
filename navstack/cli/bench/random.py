"""`navstack bench random`: random scenarios and their invariant violations."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options


@with_options(output=BenchOutput)
def random(
    count: Annotated[int, typer.Argument(metavar="N", help="Number of scenarios.", min=1, max=10_000_000)] = 1000,
    first: Annotated[int, typer.Option("--first", help="Number of the first scenario.", min=0)] = 0,
    time_limit: Annotated[
        float, typer.Option("--time-limit", help="Simulated seconds allowed per goal.", min=0.5)
    ] = 20.0,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Run random scenarios (maps, robots, parameters, noise, obstacles) and check the invariants: no exception, every goal
    ends in a terminal state, no success with a collision. The exit code is 1 if a scenario violates one of them.
    """
    from navstack.bench.random_bench import RandomTask, random_jobs, random_tables

    what = {"bench": "random", "time_limit_s": time_limit}
    results = output.run(RandomTask(time_limit), random_jobs(first, count), what, processes=processes)
    tables = random_tables(results)
    document = {**what, "first": first, "count": count, "tables": {table.title: table for table in tables}}
    code = output.report(document, tables, results)
    return code or int(any(result.value["faults"] for result in results if not result.failed))

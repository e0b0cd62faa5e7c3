"""`navstack bench random`: random scenarios, and what must never come of them."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def random(
    count: int = typer.Argument(1000, metavar="N", help="How many.", min=1, max=10_000_000),
    first: int = typer.Option(0, "--first", help="Number of the first.", min=0),
    time_limit: float = typer.Option(
        20.0, "--time-limit", help="Simulated seconds that a goal may take at most.", min=0.5
    ),
    processes: int | None = running.PROCESSES,
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Drive random scenarios (maps, robots, parameters, noise, obstacles): no exception, no goal without an end, no success
    that touched something. Exit code 1 when one has a fault.
    """
    from navstack.bench.random_bench import RandomTask, random_jobs, random_tables

    what = {"bench": "random", "time_limit_s": time_limit}
    jobs = random_jobs(first, count)
    results = running.run(RandomTask(time_limit), jobs, what, processes=processes, out=out, resume=resume)
    tables = random_tables(results)
    failed = [r for r in results if r.failed]
    document = {**what, "first": first, "count": count, "tables": {table.title: table for table in tables}}
    code = running.report(document, tables, failed=failed, out=out, name="random", json_=json_)
    return code or int(any(result.value["faults"] for result in results if not result.failed))

"""`navstack bench movingai`: shortest paths of known length."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options


@with_options(output=BenchOutput)
def movingai(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder with maps/ and problems.tsv.")],
    planner: Annotated[
        list[str], typer.Option("--planner", metavar="NAME", help="Default: astar and theta_star (repeatable).")
    ] = [],
    map_: Annotated[
        list[str], typer.Option("--map", metavar="NAME", help="Only the problems of this map (repeatable).")
    ] = [],
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Solve N. Sturtevant's grid path finding problems and compare path lengths with the published optima."""
    from navstack.bench.digests import digest_of_file
    from navstack.bench.movingai import map_file
    from navstack.bench.movingai_bench import DEFAULT_PLANNERS, MovingaiTask, movingai_jobs, movingai_tables
    from navstack.core.files import resolved

    task = MovingaiTask(resolved(folder))
    jobs = movingai_jobs(task.folder, list(dict.fromkeys(planner)) or DEFAULT_PLANNERS, list(dict.fromkeys(map_)))
    used = list(dict.fromkeys(job.input[1] for job in jobs))
    what = {
        "bench": "movingai",
        "problems": digest_of_file(task.folder / "problems.tsv"),
        "maps": {name: digest_of_file(map_file(task.folder, name)) for name in used},
    }
    results = output.run(task, jobs, what, processes=processes)
    tables = movingai_tables(task.folder, results, jobs)
    return output.report({**what, "planners": {table.title: table for table in tables}}, tables, results)

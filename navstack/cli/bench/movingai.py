"""`navstack bench movingai`: shortest paths whose lengths are known."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def movingai(
    folder: Path = typer.Argument(..., metavar="DIR", help="Folder with maps/ and problems.tsv."),
    planner: list[str] = typer.Option(
        [], "--planner", metavar="NAME", help="astar and theta_star unless given (repeat)."
    ),
    map_: list[str] = typer.Option([], "--map", metavar="NAME", help="The problems of this map only (repeat)."),
    processes: int | None = running.PROCESSES,
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Plan N. Sturtevant's grid path finding problems: lengths against the published optima, a table per planner."""
    from navstack.bench.files import digest_of_file
    from navstack.bench.movingai import map_file
    from navstack.bench.movingai_bench import DEFAULT_PLANNERS, MovingaiTask, movingai_jobs, movingai_tables

    task = MovingaiTask(folder.resolve())
    jobs = movingai_jobs(task.folder, list(dict.fromkeys(planner)) or DEFAULT_PLANNERS, list(dict.fromkeys(map_)))
    used = list(dict.fromkeys(job.input[1] for job in jobs))
    what = {
        "bench": "movingai",
        "problems": digest_of_file(task.folder / "problems.tsv"),
        "maps": {name: digest_of_file(map_file(task.folder, name)) for name in used},
    }
    results = running.run(task, jobs, what, processes=processes, out=out, resume=resume)
    tables = movingai_tables(task.folder, results, jobs)
    document = {**what, "planners": {table.title: table for table in tables}}
    failed = [r for r in results if r.failed]
    return running.report(document, tables, failed=failed, out=out, name="movingai", json_=json_)

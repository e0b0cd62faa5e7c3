"""`navstack bench planners`: every planner on the same random start and goal pairs."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options


@with_options(output=BenchOutput)
def planners(
    map_: Annotated[
        list[str],
        typer.Argument(metavar="MAP..", help="map_server YAML files, folders of them, or names of packaged maps."),
    ],
    pairs: Annotated[
        int, typer.Option("--pairs", metavar="N", min=1, help="Random reachable start and goal pairs per map.")
    ] = 25,
    planner: Annotated[
        list[str],
        typer.Option(
            "--planner",
            metavar="NAME",
            help="Default: all search-based planners, navfn, global_planner, astar and theta_star (repeatable).",
        ),
    ] = [],
    params: options.Params = ["turtlebot"],
    set_: options.Set = [],
    seed: Annotated[int, typer.Option("--seed", min=0, help="Random seed of the pairs.")] = 0,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Plan between random reachable pairs: success, collisions, length, cost, clearance, expanded cells and times.

    Lengths are means over the pairs for which every planner found a plan; times are for planning from scratch.

    A map in a folder that cannot be read is reported and skipped. The exit code is 1 if a map was skipped, if a planner
    missed a pair, or if a path crosses a blocked cell. A map given by name or file that cannot be read is an error (exit
    code 2).
    """
    from navstack.bench.digests import for_workers
    from navstack.bench.map_pairs import SEARCHING
    from navstack.bench.planners_bench import PlannersTask, map_files, planners_jobs, planners_report
    from navstack.parameters.configuration import choose_global_planner

    files, unreadable = map_files(map_)
    task = PlannersTask(tuple(for_workers(p) for p in params), tuple(set_), pairs, seed)
    names = [choose_global_planner(task.configuration, n).name for n in planner or SEARCHING]
    jobs = planners_jobs(files, list(dict.fromkeys(names)))
    what = task.described(files)
    results = output.run(task, jobs, what, processes=processes)
    report = planners_report(files, unreadable, results, jobs)
    code = output.report({**what, **report.document()}, report.tables, results, notes=report.notes)
    return code if report.all_safe and not unreadable else 1

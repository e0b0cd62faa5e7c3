"""`navstack bench planners`: every planner on the same random start and goal pairs."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.studies import SEARCHING, PlannersTask, for_workers, map_files


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
    files, unreadable = map_files(map_)
    task = PlannersTask(
        tuple(for_workers(p) for p in params),
        tuple(set_),
        pairs,
        seed,
        files,
        tuple(planner) or SEARCHING,
        tuple(unreadable),
    )
    return output.carry_out(task, processes=processes)

"""`navstack bench movingai`: shortest paths of known length."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.core import resolved
from navstack.studies import DEFAULT_PLANNERS, MovingaiTask


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
    planners = tuple(dict.fromkeys(planner)) or DEFAULT_PLANNERS
    task = MovingaiTask(resolved(folder), planners, tuple(dict.fromkeys(map_)))
    return output.carry_out(task, processes=processes)

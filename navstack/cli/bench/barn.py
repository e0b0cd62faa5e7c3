"""`navstack bench barn`: ten meters through fields of cylinders, scored by the rule of the BARN Challenge."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.bench.execution import BenchOutput, Processes, whole_numbers
from navstack.cli.options import with_options
from navstack.core import InputError, resolved
from navstack.studies import BarnTask, for_workers


@with_options(output=BenchOutput)
def barn(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder with worlds.npz and, to compare with C++, cpp_results.csv.")
    ],
    params: options.Params,
    set_: options.Set = [],
    distro: options.Distro = None,
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="Runs per world, with seeds 0 to N - 1.")
    ] = 1,
    noise: Annotated[
        float | None,
        typer.Option("--noise", metavar="M", min=0.0, help="Standard deviation of the lidar ranges (m)."),
    ] = None,
    rough: Annotated[
        bool, typer.Option("--rough", help="1 mm of lidar noise at 50 Hz, 0.1 s of lag, 1 % of undetected wheel slip.")
    ] = False,
    worlds: Annotated[
        list[str], typer.Option("--worlds", metavar="N,N..", help="Only these worlds (repeatable).")
    ] = [],
    record: Annotated[
        bool, typer.Option("--record", help="Save the records of failed runs to OUT/records, for `navstack explain`.")
    ] = False,
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Drive through the BARN worlds, scored as in the BARN Challenge: a table per world, totals with confidence intervals."""
    if record and output.out is None:
        raise InputError("--record needs a folder for the records; add --out DIR", argument="--record")
    task = BarnTask(
        resolved(folder),
        tuple(for_workers(p) for p in params),
        tuple(set_),
        distro,
        rough,
        noise,
        records=resolved(output.out) / "records" if record and output.out is not None else None,
        numbers=tuple(whole_numbers(worlds, "--worlds")) or None,
        seeds=seeds,
    )
    return output.carry_out(task, processes=processes)

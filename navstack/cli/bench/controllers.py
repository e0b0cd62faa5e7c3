"""`navstack bench controllers`: all controllers on the same scenarios, each with its packaged tuning."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options

if TYPE_CHECKING:
    from navstack.bench.table import Table


@with_options(output=BenchOutput)
def controllers(
    suite: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SUITE..]",
            help="Packaged suites (office, narrow, crowd, warehouse, shipped), scenario files, folders of files, or a folder "
            "with BARN worlds. Default: the first four.",
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
    from navstack.bench.controllers_bench import (
        JERK_PERIOD_S,
        ControllersTask,
        measured_runs,
        read_groups,
        read_tunings,
    )
    from navstack.bench.controllers_tables import all_tables, controllers_notes

    task = ControllersTask(read_tunings(controller), read_groups(suite or [], count))
    jobs = task.jobs(seeds)
    results = output.run(task, jobs, task.described(), processes=processes)
    runs = measured_runs(task, results, jobs)
    tables = all_tables(runs)
    files = _plot(tables[0], output.out) if output.out is not None and runs else {}
    document = {
        **task.described(),
        "seeds": seeds,
        "rows": tables[0],
        "runs": [
            {"controller": r.controller, "suite": r.group, "scenario": r.scenario, "seed": r.seed, **r.values}
            for r in runs
        ],
    }
    return output.report(document, tables, results, files=files, notes=controllers_notes(runs, JERK_PERIOD_S))


def _plot(table: Table, folder: Path) -> dict[str, Path]:
    from navstack.plot.controllers import plot_controllers

    title = "Controllers with their packaged tunings"
    return {"picture": plot_controllers(table.rows, folder / "controllers.png", title=title)}

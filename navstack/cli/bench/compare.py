"""`navstack bench compare`: two parameter sets on the same scenarios and seeds."""

from __future__ import annotations

from typing import Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options
from navstack.core import InputError
from navstack.studies import CompareTask, ParameterSet, for_workers, read_scenarios


@with_options(output=BenchOutput)
def compare(
    a: Annotated[
        str,
        typer.Argument(metavar="A", help="Parameter set: a name, a folder, a file, or several separated by commas."),
    ],
    b: Annotated[str, typer.Argument(metavar="B", help="The other parameter set.")],
    scenario: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[SCENARIO..]",
            help="Scenario files, names of shipped scenarios, folders of files, or a folder with BARN worlds.",
        ),
    ] = None,
    suite: Annotated[
        str | None,
        typer.Option(
            "--suite",
            metavar="NAME",
            help="Packaged suite: office, narrow, crowd, warehouse, circle_crossing or shipped.",
        ),
    ] = None,
    count: Annotated[
        int | None, typer.Option("--count", metavar="N", min=1, help="Number of scenarios of the suite.")
    ] = None,
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="Runs per scenario and side, with seeds 0 to N - 1.")
    ] = 1,
    set_: Annotated[
        list[str], typer.Option("--set", metavar="KEY=VALUE", help="Override a parameter of both (repeatable).")
    ] = [],
    set_a: Annotated[
        list[str], typer.Option("--set-a", metavar="KEY=VALUE", help="Override a parameter of A (repeatable).")
    ] = [],
    set_b: Annotated[
        list[str], typer.Option("--set-b", metavar="KEY=VALUE", help="Override a parameter of B (repeatable).")
    ] = [],
    processes: Processes = None,
    *,
    output: BenchOutput,
) -> int:
    """Compare two parameter sets on the same scenarios and seeds: paired differences with confidence intervals.

    `no difference shown` means that the interval contains zero. Times, lengths and similar measures use the pairs in which
    both sides succeed.
    """
    sets = {"A": _parameter_set(a, "A", [*set_, *set_a]), "B": _parameter_set(b, "B", [*set_, *set_b])}
    task = CompareTask(sets, tuple(read_scenarios(scenario or [], suite, count)), seeds)
    return output.carry_out(task, processes=processes)


def _parameter_set(text: str, argument: str, overrides: list[str]) -> ParameterSet:
    """The sources that an argument names. Raises InputError for none."""
    sources = [part.strip() for part in text.split(",") if part.strip()]
    if not sources:
        raise InputError(
            f'{argument} "{text}" names no parameters; give a name, a folder or files', argument=argument, value=text
        )
    return ParameterSet(tuple(for_workers(s) for s in sources), tuple(overrides))

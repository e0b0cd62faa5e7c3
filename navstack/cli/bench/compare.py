"""`navstack bench compare`: two parameter sets on the same scenarios and seeds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli.bench.execution import BenchOutput, Processes
from navstack.cli.options import with_options

if TYPE_CHECKING:
    from navstack.bench.compare_bench import Pair
    from navstack.bench.compare_scenarios import ParameterSet


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
        typer.Option("--suite", metavar="NAME", help="Packaged suite: office, narrow, crowd, warehouse or shipped."),
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
    from navstack.bench.compare_bench import CompareTask, comparison_notes, pairs_of
    from navstack.bench.compare_scenarios import read_scenarios
    from navstack.bench.compare_tables import measures_table, scenarios_table

    sets = {"A": _parameter_set(a, "A", [*set_, *set_a]), "B": _parameter_set(b, "B", [*set_, *set_b])}
    task = CompareTask(sets, tuple(read_scenarios(scenario or [], suite, count)))
    jobs = task.jobs(seeds)
    results = output.run(task, jobs, task.described(), processes=processes)
    pairs = pairs_of(task, results, jobs)
    tables = [scenarios_table(pairs), measures_table(pairs)]
    labels = {side: chosen.label for side, chosen in sets.items()}
    files = _plot(pairs, output.out, (labels["A"], labels["B"])) if output.out is not None and pairs else {}
    document = {
        **task.described(),
        "seeds": seeds,
        "measures": tables[1],
        "by_scenario": tables[0],
        "runs": [{"scenario": p.scenario, "seed": p.seed, "A": p.a, "B": p.b} for p in pairs],
    }
    return output.report(document, tables, results, files=files, notes=comparison_notes(task))


def _parameter_set(text: str, argument: str, overrides: list[str]) -> ParameterSet:
    """The sources that an argument names. Raises InputError for none."""
    from navstack.bench.compare_scenarios import ParameterSet
    from navstack.bench.digests import for_workers
    from navstack.core.errors import InputError

    sources = [part.strip() for part in text.split(",") if part.strip()]
    if not sources:
        raise InputError(
            f'{argument} "{text}" names no parameters; give a name, a folder or files', argument=argument, value=text
        )
    return ParameterSet(tuple(for_workers(s) for s in sources), tuple(overrides))


def _plot(pairs: list[Pair], folder: Path, labels: tuple[str, str]) -> dict[str, Path]:
    from navstack.plot.compare import plot_pairs

    times = [(p.a["time_s"] if p.a["success"] else None, p.b["time_s"] if p.b["success"] else None) for p in pairs]
    title = "The same runs with A and with B"
    return {"picture": plot_pairs(times, folder / "compare.png", title=title, names=labels)}

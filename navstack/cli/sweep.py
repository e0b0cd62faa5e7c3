"""`navstack sweep`: many candidates over many scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from navstack.cli import options
from navstack.cli.options import with_options
from navstack.cli.search_options import Resume, SearchArguments, Workers

_SHOWN_CANDIDATES = 10


@with_options(search=SearchArguments)
def sweep(
    search: SearchArguments,
    method: Annotated[
        str, typer.Option("--method", metavar="grid|random|lhs", help="Sampling method; lhs: Latin hypercube.")
    ] = "lhs",
    samples: Annotated[int, typer.Option("--samples", metavar="N", help="Number of candidates (random and lhs).")] = 50,
    points: Annotated[int, typer.Option("--points", metavar="N", help="Values per range (grid).")] = 5,
    workers: Workers = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Run on this Dask cluster, such as tcp://host:8786."),
    ] = None,
    resume: Resume = False,
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", help="Folder for runs.jsonl and summary.json.", callback=options.folder_only
        ),
    ] = Path("navstack_sweep"),
    json_: options.Json = False,
) -> int:
    """Drive a grid or a sample of parameter values over scenarios: a line of JSON per run.

    The exit code is 1 if some runs gave no result.
    """
    from navstack.cli.output import print_json, print_note
    from navstack.core.files import ensure_directory, write_json
    from navstack.tune.sampling import candidates
    from navstack.tune.sweep import Sweep, run_sweep, summary_of

    setup = search.prepare()
    chosen = candidates(setup.space, method, samples=samples, points=points, seed=search.seed)
    evaluation = setup.evaluation()
    folder = ensure_directory(out)
    cases = len(evaluation.cases)
    if not json_:
        print_note(f"{_count(len(chosen), 'candidate')}, each over {_count(cases, 'run')} of {setup.suite.name}")
    described = {**setup.described(), "method": method, "seed": search.seed}
    runs = run_sweep(
        Sweep(setup.base, setup.space, chosen, evaluation, described),
        folder / "runs.jsonl",
        workers=workers,
        scheduler=scheduler,
        resume=resume,
        progress=not json_,
    )
    files = {"runs": str(folder / "runs.jsonl"), "summary": str(folder / "summary.json")}
    document = {**summary_of(runs, cases), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(document)
    failed = [run.result for run in runs if run.result.error is not None]
    for result in failed:
        print_note(f"{result.key} gave no result: {(result.error or {}).get('message', 'no reason given')}")
    return 1 if failed else 0


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _print(document: dict[str, Any]) -> None:
    """Prints the best candidates and the names of the files."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout

    table = Table(title="best candidates", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("no.", "score", "success", "time"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("values")
    for row in document["ranking"][:_SHOWN_CANDIDATES]:
        values = ", ".join(f"{name.rpartition('/')[2]} {value}" for name, value in row["values"].items())
        score = "-" if row["score"] is None else f"{row['score']:.3f}"
        time = "-" if row["time_s"] is None else f"{row['time_s']:.1f} s"
        table.add_row(str(row["candidate"]), score, f"{row['success']:.0%}", time, escape(values))
    stdout().print(table)
    stdout().print(f"{document['runs']} runs: {document['files']['runs']}", markup=False)

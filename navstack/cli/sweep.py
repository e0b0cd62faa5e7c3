"""`navstack sweep`: many candidates over many scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from navstack.cli import options
from navstack.cli.options import with_options
from navstack.cli.output import print_json, print_note, stdout
from navstack.cli.search_options import Resume, SearchArguments, Workers
from navstack.core import ensure_directory, write_json
from navstack.studies import Sweep, candidates, run_sweep


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
    setup = search.prepare()
    chosen = candidates(setup.space, method, samples=samples, points=points, seed=search.seed)
    evaluation = setup.evaluation()
    folder = ensure_directory(out)
    cases = len(evaluation.cases)
    if setup.scale_text and not json_:
        print_note(setup.scale_text)
    if not json_:
        print_note(f"{_count(len(chosen), 'candidate')}, each over {_count(cases, 'run')} of {setup.suite.name}")
    described = {**setup.described(), "method": method, "seed": search.seed}
    task = Sweep(setup.base, setup.space, chosen, evaluation, described)
    results = run_sweep(
        task,
        folder / "runs.jsonl",
        workers=workers,
        scheduler=scheduler,
        resume=resume,
        progress=not json_,
    )
    files = {"runs": str(folder / "runs.jsonl"), "summary": str(folder / "summary.json")}
    report = task.report(results)
    document = {**report.document, "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        for table in report.tables:
            table.print(stdout())
        stdout().print(f"{len(results)} runs: {files['runs']}", markup=False)
    failed = [result for result in results if result.failed]
    for result in failed:
        print_note(f"{result.key} gave no result: {(result.error or {}).get('message', 'no reason given')}")
    return 1 if failed else 0


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"

"""`navstack sweep`: many candidates over many scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer

from navstack.cli import tuning as options


def sweep(
    params: list[str] = options.PARAMS,
    suite: str = options.SUITE,
    param: list[str] = options.PARAM,
    space: str | None = options.SPACE,
    keep: list[str] = options.KEEP,
    method: str = typer.Option("lhs", "--method", metavar="grid|random|lhs", help="How candidates are chosen."),
    samples: int = typer.Option(50, "--samples", metavar="N", help="Candidates, of random and lhs."),
    points: int = typer.Option(5, "--points", metavar="N", help="Values of each range, of grid."),
    set_: list[str] = options.SET,
    distro: str | None = options.DISTRO,
    allow_missing: bool = options.ALLOW_MISSING,
    scenario: list[str] = options.SCENARIO,
    count: int | None = options.COUNT,
    seeds: int = options.SEEDS,
    seed: int = options.SEED,
    rough: bool = options.ROUGH,
    workers: int | None = options.WORKERS,
    scheduler: str | None = typer.Option(
        None, "--scheduler", metavar="ADDRESS", help="Run on the Dask cluster there, such as tcp://host:8786."
    ),
    resume: bool = options.RESUME,
    out: Path = typer.Option(
        Path("navstack_sweep"), "--out", metavar="DIR", help="Folder of runs.jsonl and summary.json."
    ),
    json_: bool = options.JSON,
) -> int:
    """Drive a grid or a sample of parameter values over scenarios: a line of JSON per run.

    Exit code 1: some of the runs gave no result.
    """
    from navstack.cli.output import print_json, print_note
    from navstack.core.files import ensure_directory, write_json
    from navstack.tune.sampling import candidates
    from navstack.tune.sweep import Sweep, run_sweep, summary_of

    setup = options.prepared(
        params, suite, space, param, keep, set_, distro, allow_missing, scenario, count, seeds, seed, rough
    )
    chosen = candidates(setup.space, method, samples=samples, points=points, seed=seed)
    course = setup.course()
    folder = ensure_directory(out)
    if not json_:
        count, runs = len(chosen), len(course.cases)
        print_note(
            f"{count} candidate{'s' * (count != 1)}, each over {runs} run{'s' * (runs != 1)} of {setup.place.name}"
        )
    what = {**setup.what(), "method": method, "seed": seed}
    runs = run_sweep(
        Sweep(setup.base, setup.space, chosen, course, what),
        folder / "runs.jsonl",
        workers=workers,
        scheduler=scheduler,
        resume=resume,
        progress=not json_,
    )
    files = {"runs": str(folder / "runs.jsonl"), "summary": str(folder / "summary.json")}
    document = {**summary_of(runs, len(course.cases)), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(document)
    failed = [run.result for run in runs if run.result.error is not None]
    for result in failed:
        print_note(f"{result.key} gave no result: {(result.error or {}).get('message', 'no reason given')}")
    return 1 if failed else 0


def _print(document: dict[str, Any]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout

    ranking = document["ranking"]
    table = Table(title="the best candidates", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("no.", "score", "success", "time"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("values")
    for row in ranking[:10]:
        values = ", ".join(f"{name.rpartition('/')[2]} {value}" for name, value in row["values"].items())
        score = "-" if row["score"] is None else f"{row['score']:.3f}"
        time = "-" if row["time_s"] is None else f"{row['time_s']:.1f} s"
        table.add_row(str(row["candidate"]), score, f"{row['success']:.0%}", time, escape(values))
    stdout().print(table)
    stdout().print(f"{document['runs']} runs: {document['files']['runs']}", markup=False)

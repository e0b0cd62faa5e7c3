"""`navstack bench compare`: two parameter sets over the same scenarios and seeds."""

from __future__ import annotations

from pathlib import Path

import typer

from navstack.cli.bench import running


def compare(
    a: str = typer.Argument(
        ..., metavar="A", help="A parameter set: a name, a folder, a file, or several with commas."
    ),
    b: str = typer.Argument(..., metavar="B", help="The other one."),
    scenario: list[str] = typer.Argument(
        None,
        metavar="[SCENARIO..]",
        help="Scenario files or names of shipped ones, folders of files, or a folder with BARN worlds.",
    ),
    suite: str | None = typer.Option(
        None, "--suite", metavar="NAME", help="A packaged suite: office, narrow, crowd or shipped."
    ),
    count: int | None = typer.Option(None, "--count", metavar="N", min=1, help="How many scenarios of the suite."),
    seeds: int = typer.Option(
        1, "--seeds", metavar="N", min=1, help="Runs per scenario and side, with seeds 0 to N - 1."
    ),
    set_: list[str] = typer.Option([], "--set", metavar="KEY=VALUE", help="Override a parameter of both (repeat)."),
    set_a: list[str] = typer.Option([], "--set-a", metavar="KEY=VALUE", help="Override a parameter of A (repeat)."),
    set_b: list[str] = typer.Option([], "--set-b", metavar="KEY=VALUE", help="Override a parameter of B (repeat)."),
    processes: int | None = running.PROCESSES,
    out: Path | None = running.OUT,
    resume: bool = running.RESUME,
    json_: bool = running.JSON,
) -> int:
    """Compare two parameter sets over the same scenarios and seeds: paired differences with confidence intervals.

    `no difference shown` is an answer. Times, lengths and the like are of pairs in which both sides succeed.
    """
    from navstack.bench.compare_bench import (
        CompareTask,
        ParameterSet,
        courses_table,
        measures_table,
        pairs_of,
        read_courses,
    )
    from navstack.bench.files import for_workers, short_names

    sources = {"A": _sources(a, "A"), "B": _sources(b, "B")}
    overrides = {"A": (*set_, *set_a), "B": (*set_, *set_b)}
    sets = {side: ParameterSet(tuple(for_workers(s) for s in sources[side]), overrides[side]) for side in sources}
    task = CompareTask(sets, tuple(read_courses(scenario or [], suite, count)))
    told = {side: {"params": short_names(sources[side]), "set": list(overrides[side])} for side in sources}
    what = {
        "bench": "compare",
        **told,
        "scenarios": {c.name: {side: c.digest(sets[side]) for side in sets} for c in task.courses},
    }
    jobs = task.jobs(seeds)
    results = running.run(task, jobs, what, processes=processes, out=out, resume=resume)
    pairs = pairs_of(task, results, jobs)
    tables = [courses_table(pairs), measures_table(pairs)]
    named = {side: " ".join([*told[side]["params"], *told[side]["set"]]) for side in sources}
    files: dict[str, Path] = {}
    if out is not None and pairs:
        from navstack.plot.compare import plot_pairs

        times = [(p.a["time_s"] if p.a["success"] else None, p.b["time_s"] if p.b["success"] else None) for p in pairs]
        files["picture"] = plot_pairs(
            times, out / "compare.png", title="the same runs with A and with B", names=(named["A"], named["B"])
        )
    notes = [f"A: {named['A']}", f"B: {named['B']}"]
    notes.append("each verdict stands for itself: of twenty measures that do not differ, one is shown to by chance")
    if len(task.courses) == 1:
        notes.append("there is one scenario: its seeds are what is counted, and other scenarios may differ otherwise")
    elif len(task.courses) < 10:
        notes.append(
            f"{len(task.courses)} scenarios are few: the intervals are over scenarios, seeds only sharpen them"
        )
    document = {
        **what,
        "seeds": seeds,
        "measures": tables[1],
        "courses": tables[0],
        "runs": [{"scenario": p.course, "seed": p.seed, "A": p.a, "B": p.b} for p in pairs],
    }
    failed = [r for r in results if r.failed]
    return running.report(
        document, tables, failed=failed, files=files, notes=notes, out=out, name="compare", json_=json_
    )


def _sources(text: str, argument: str) -> list[str]:
    from navstack.core.errors import InputError

    found = [part.strip() for part in text.split(",") if part.strip()]
    if not found:
        raise InputError(
            f'{argument} "{text}" names no parameters; give a name, a folder or files', argument=argument, value=text
        )
    return found

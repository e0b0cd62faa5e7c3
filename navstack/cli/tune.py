"""`navstack tune`: better parameters for the user's YAML files, validated on held-out scenarios."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table

from navstack.cli import options
from navstack.cli.options import with_options
from navstack.cli.output import Verbosity, counting_bar, print_advice, print_json, print_note, stderr, stdout, verbosity
from navstack.cli.search_options import Resume, SearchArguments, Workers
from navstack.core import require
from navstack.studies import LINE_INTERVAL_S, TuneRequest, run_sensitivity, run_tuning, time_left_bar

if TYPE_CHECKING:
    from navstack.studies import Comparison, Setup, Trial, TuneOutput

Trials = Annotated[int, typer.Option("--trials", metavar="N", help="Number of candidates.", min=1)]
Why = Annotated[
    bool,
    typer.Option("--why", help="No search: show the effect of halving and doubling each parameter, in all scenarios."),
]
Objectives = Annotated[
    list[str],
    typer.Option(
        "--objective",
        metavar="NAME",
        help="score (default), time, clearance, smoothness or success; several give a Pareto front (repeatable).",
    ),
]
MinSuccess = Annotated[
    float, typer.Option("--min-success", help="Required success rate, with several objectives.", min=0.0, max=1.0)
]
Sampler = Annotated[str, typer.Option("--sampler", metavar="tpe|cmaes|random", help="Sampler of the candidates.")]
HeldOut = Annotated[
    float,
    typer.Option(
        "--held-out",
        metavar="SHARE",
        help="Share of the scenarios reserved for validation; always half of a packaged suite.",
    ),
]
Against = Annotated[
    str | None,
    typer.Option("--against", metavar="NAME|DIR|FILE", help="Also compare the result with these parameters."),
]
Storage = Annotated[
    str | None,
    typer.Option(
        "--storage",
        metavar="FILE|URL",
        help="Storage of the study: a file (default: OUT/study.journal), or a database for several machines.",
    ),
]
Revert = Annotated[
    bool,
    typer.Option("--revert/--keep-all", help="Revert changes that make no difference, or keep all changes."),
]
Out = Annotated[
    Path,
    typer.Option(
        "--out",
        metavar="DIR",
        help="Folder for the tuned YAML files, the report and the study.",
        callback=options.folder_only,
    ),
]


@with_options(search=SearchArguments)
def tune(
    search: SearchArguments,
    trials: Trials = 100,
    why: Why = False,
    objective: Objectives = [],
    min_success: MinSuccess = 1.0,
    sampler: Sampler = "tpe",
    held_out: HeldOut = 0.4,
    against: Against = None,
    workers: Workers = None,
    storage: Storage = None,
    resume: Resume = False,
    revert: Revert = True,
    out: Out = Path("navstack_tune"),
    json_: options.Json = False,
) -> int:
    """Search for better parameters and validate them on scenarios that the search has not seen."""
    require("optuna", "tuning")
    require("ruamel.yaml", "writing tuned parameters")
    setup = search.prepare()
    command = shlex.join(["navstack", *sys.argv[1:]])
    if why:
        return _sensitivity(setup, out, workers, command, json_)

    request = TuneRequest(
        setup=setup,
        out=out,
        trials=trials,
        objectives=tuple(objective),
        min_success=min_success,
        sampler=sampler,
        held_out=held_out,
        against=against,
        storage=storage,
        resume=resume,
        revert=revert,
        workers=workers,
        command=command,
    )
    announce(setup, quiet=json_)
    with trial_progress(trials, quiet=json_) as (on_trial, notify):
        result = run_tuning(request, on_trial=on_trial, notify=notify)
    print_result(result, as_json=json_)
    return 0


def _sensitivity(setup: Setup, out: Path, workers: int | None, command: str, json_: bool) -> int:
    if not json_:
        if setup.scale_text:
            print_note(setup.scale_text)
        count, runs = len(setup.space), len(setup.evaluation().cases)
        print_note(f"{count} parameter{'s' * (count != 1)}, each halved and doubled over {runs} run{'s' * (runs != 1)}")
    with counting_bar("driving", quiet=json_) as progress:
        found, page = run_sensitivity(setup, out, workers=workers, command=command, progress=progress)
    if json_:
        print_json({"steps": [p.as_dict() for p in found], "files": {"report": str(page)}})
        return 0
    for number, one in enumerate(found, 1):
        stdout().print(f"{number:>3}. {one.sentence}", markup=False)
    stdout().print(f"report: {page}", markup=False)
    return 0


# ----------------------------------------------------------------------------------------------------------------------
# Output of `navstack tune`: announcement, progress and result.


def announce(setup: Setup, *, quiet: bool) -> None:
    """Prints the scale of the suite, the search space, and a reminder to check the limits of the robot."""
    if quiet:
        return
    if setup.scale_text:
        print_note(setup.scale_text)
    ranges = ", ".join(f"{d.name} {d.range_text()}" for d in setup.space)
    print_note(f"searching {len(setup.space)} parameters: {ranges}")
    limits = [f"{d.name.rpartition('/')[2]} up to {d.high:g} {d.unit}" for d in setup.space if d.robot]
    if limits:
        print_note(
            f"{', '.join(limits)}: check that your robot can do this; otherwise set --param NAME=LOW:HIGH or --keep NAME"
        )


_FAILED_SHOWN = 4
"""Failed runs that are printed."""


@contextmanager
def trial_progress(
    trials: int, *, quiet: bool
) -> Generator[tuple[Callable[[Trial, int], None], Callable[[str], None]]]:
    """A progress bar; without a terminal, a line from time to time. Two callbacks: for each trial, and for messages."""
    on_terminal = stderr().is_terminal
    quiet = quiet or verbosity() is Verbosity.QUIET
    with time_left_bar(trials, what="trials", shown=on_terminal and not quiet) as move:
        complete = 0
        printed = time.monotonic()

        def on_trial(trial: Trial, ended: int) -> None:
            nonlocal complete, printed
            complete += trial.complete
            move(ended, f"last {trial.values[0]:.3f}, {complete} complete")
            if not quiet and not on_terminal and time.monotonic() - printed >= LINE_INTERVAL_S:
                printed = time.monotonic()
                print_note(f"{ended} of {trials} trials, {complete} complete")

        yield on_trial, (lambda text: None) if quiet else print_note


def print_result(result: TuneOutput, *, as_json: bool) -> None:
    """Prints the comparison, the changes, the verdict and the files; or everything as one JSON document."""
    if as_json:
        print_json(result.as_dict())
        return
    out, tuning = stdout(), result.tuning
    _print_measures(tuning.validation, f"{len(tuning.validation.cases)} {tuning.validation_name} runs")
    if result.rewritten is not None:
        from navstack.parameters import value_text

        out.print("changed parameters:")
        for c in result.rewritten.changes:
            before = "default" if c.old is None else value_text(c.old)
            place = Path(c.place).name if c.place else "new line"
            out.print(f"  {c.name}: {before} -> {value_text(c.new)}  ({place})", markup=False)
    out.print(tuning.verdict, markup=False)
    for text in failed_texts(tuning.validation):
        out.print(f"  {text}", markup=False)
    if tuning.validation.failed:
        print_advice(result.advice)
    if tuning.against is not None:
        out.print(f"compared with the reference: {_against_text(tuning.against)}", markup=False)
    if result.params:
        out.print("parameters: " + " ".join(f"--params {p}" for p in result.params), markup=False)
    out.print(f"report: {result.report}", markup=False)


def failed_texts(comparison: Comparison) -> list[str]:
    """Why runs of the validation fail with the result."""
    found = [f"{comparison.cases[i].key}: {comparison.after[i]['text']}" for i in comparison.failed]
    more = len(found) - _FAILED_SHOWN
    return [*found[:_FAILED_SHOWN], f"{more} more in the report"] if more > 0 else found


def _print_measures(comparison: Comparison, title: str) -> None:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("", "before", "tuned", "difference", ""):
        table.add_column(name, overflow="fold")
    for m in comparison.measures:
        table.add_row(m.label, *(escape(text) for text in m.texts), m.verdict)
    stdout().print(table)


def _against_text(comparison: Comparison) -> str:
    parts: list[str] = []
    for name, digits in (("score", 3), ("success", 2), ("time", 1)):
        m = comparison.find(name)
        if m is not None and m.before.groups:
            text = f"{name} {m.before.value:.{digits}f}, tuned {m.after.value:.{digits}f}"
            parts.append(f"{text} (difference {m.difference.interval.text(digits)})")
    return ", ".join(parts)

"""Output of `navstack tune`: announcement, progress and result."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from navstack.cli.output import Verbosity, print_json, print_note, stderr, stdout, verbosity

if TYPE_CHECKING:
    from navstack.tune.comparison import Comparison
    from navstack.tune.pipeline import TuneOutput
    from navstack.tune.problem import Trial
    from navstack.tune.setup import Setup


def announce(setup: Setup, *, quiet: bool) -> None:
    """Prints the search space, and a reminder to check the limits of the robot."""
    if quiet:
        return
    ranges = ", ".join(f"{d.name} {d.range_text()}" for d in setup.space)
    print_note(f"searching {len(setup.space)} parameters: {ranges}")
    limits = [f"{d.name.rpartition('/')[2]} up to {d.high:g} {d.unit}" for d in setup.space if d.robot]
    if limits:
        print_note(
            f"{', '.join(limits)}: check that your robot can do this; otherwise set --param NAME=LOW:HIGH or --keep NAME"
        )


@contextmanager
def trial_progress(
    trials: int, *, quiet: bool
) -> Generator[tuple[Callable[[Trial, int], None], Callable[[str], None]]]:
    """A progress bar; without a terminal, a line from time to time. Two callbacks: for each trial, and for messages."""
    from navstack.jobs.progress import LINE_INTERVAL_S, time_left_bar

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
        from navstack.parameters.report import value_text

        out.print("changed parameters:")
        for c in result.rewritten.changes:
            before = "default" if c.old is None else value_text(c.old)
            place = Path(c.place).name if c.place else "new line"
            out.print(f"  {c.name}: {before} -> {value_text(c.new)}  ({place})", markup=False)
    out.print(tuning.verdict, markup=False)
    if tuning.against is not None:
        out.print(f"compared with the reference: {_against_text(tuning.against)}", markup=False)
    if result.params:
        out.print("parameters: " + " ".join(f"--params {p}" for p in result.params), markup=False)
    out.print(f"report: {result.report}", markup=False)


def _print_measures(comparison: Comparison, title: str) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

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

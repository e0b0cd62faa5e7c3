"""`navstack tune`: from a YAML that drives badly to one that drives well, with proof."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from navstack.cli import tuning as options

if TYPE_CHECKING:
    from navstack.tune.request import Done
    from navstack.tune.sensitivity import Step
    from navstack.tune.setup import Setup
    from navstack.tune.study import Trial


def tune(
    params: list[str] = options.PARAMS,
    suite: str = options.SUITE,
    trials: int = typer.Option(100, "--trials", metavar="N", help="Candidates to try.", min=1),
    why: bool = typer.Option(
        False, "--why", help="No search: what changes if each parameter is halved or doubled, over every scenario."
    ),
    param: list[str] = options.PARAM,
    space: str | None = options.SPACE,
    keep: list[str] = options.KEEP,
    objective: list[str] = typer.Option(
        [],
        "--objective",
        metavar="NAME",
        help="score (the default), time, clearance, smoothness or success; several give a Pareto front (repeat).",
    ),
    min_success: float = typer.Option(
        1.0, "--min-success", help="With several objectives: the share of runs that must succeed.", min=0.0, max=1.0
    ),
    sampler: str = typer.Option("tpe", "--sampler", metavar="tpe|cmaes|random", help="Who chooses the candidates."),
    held_out: float = typer.Option(
        0.4, "--held-out", metavar="SHARE", help="Scenarios that only the proof uses; of a suite, always half."
    ),
    against: str | None = typer.Option(
        None, "--against", metavar="NAME|DIR|FILE", help="Compare the result with these parameters too."
    ),
    set_: list[str] = options.SET,
    distro: str | None = options.DISTRO,
    allow_missing: bool = options.ALLOW_MISSING,
    scenario: list[str] = options.SCENARIO,
    count: int | None = options.COUNT,
    seeds: int = options.SEEDS,
    seed: int = options.SEED,
    rough: bool = options.ROUGH,
    workers: int | None = options.WORKERS,
    storage: str | None = typer.Option(
        None,
        "--storage",
        metavar="FILE|URL",
        help="Of the study: a file (OUT/study.journal), or a database for many machines.",
    ),
    resume: bool = options.RESUME,
    set_back: bool = typer.Option(
        True, "--set-back/--keep-all", help="Values that make no difference go back to what they were."
    ),
    out: Path = typer.Option(
        Path("navstack_tune"), "--out", metavar="DIR", help="Folder of the tuned YAML, the report and the study."
    ),
    json_: bool = options.JSON,
) -> int:
    """Search for better parameters and prove them on scenarios that the search has not seen."""
    from navstack.cli.output import print_json, print_note
    from navstack.tune.extras import need

    need("optuna", "tuning")
    need("ruamel.yaml", "writing tuned parameters")
    setup = options.prepared(
        params, suite, space, param, keep, set_, distro, allow_missing, scenario, count, seeds, seed, rough
    )
    command = shlex.join(["navstack", *sys.argv[1:]])
    if why:
        return _why(setup, out, workers, command, json_)
    from navstack.tune.request import TuneRequest, run_tuning

    request = TuneRequest(
        setup,
        out,
        trials=trials,
        objectives=tuple(objective),
        min_success=min_success,
        sampler=sampler,
        held_out=held_out,
        against=against,
        storage=storage,
        resume=resume,
        set_back=set_back,
        workers=workers,
        command=command,
    )
    if not json_:
        _announce(setup)
    with _progress(trials, quiet=json_) as hear:
        done = run_tuning(request, hear=hear, say=(lambda text: None) if json_ else print_note)
    if json_:
        print_json(done.as_dict())
    else:
        _print(done)
    return 0


def _announce(setup: Setup) -> None:
    from navstack.cli.output import print_note

    print_note(
        f"{len(setup.space)} parameters are searched: " + ", ".join(f"{d.name} {d.range_text()}" for d in setup.space)
    )
    robots = [d for d in setup.space if d.robot]
    if robots:
        said = ", ".join(f"{d.name.rpartition('/')[2]} up to {d.high:g} {d.unit}" for d in robots)
        print_note(f"{said}: what the robot is able to is yours to say, by --param NAME=LOW:HIGH or --keep NAME")


@contextmanager
def _progress(trials: int, *, quiet: bool) -> Generator[Callable[[Trial, int], None]]:
    from navstack.cli.output import print_note, stderr
    from navstack.jobs.progress import LINES_APART_S, time_left_bar

    on_terminal = stderr().is_terminal
    with time_left_bar(trials, what="trials", shown=on_terminal and not quiet) as move:
        full = 0
        said = time.monotonic()

        def hear(trial: Trial, ended: int) -> None:
            nonlocal full, said
            full += trial.complete
            move(ended, f"last {trial.values[0]:.3f}, {full} driven in full")
            # no terminal: a line now and then
            if not quiet and not on_terminal and time.monotonic() - said >= LINES_APART_S:
                said = time.monotonic()
                print_note(f"{ended} of {trials} trials, {full} driven in full")

        yield hear


def _print(done: Done) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout
    from navstack.tune.space import value_of

    out = stdout()
    tuning = done.tuning
    shown = tuning.held_out or tuning.training
    title = "held-out runs" if tuning.held_out is not None else "training runs"
    table = Table(title=f"{len(shown.cases)} {title}", title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    for name in ("", "before", "tuned", "difference", ""):
        table.add_column(name, overflow="fold")
    for m in shown.measures:
        digits = 1 if m.unit == "s" else 3
        unit = f" ({m.unit})" if m.unit else ""
        cells = (m.before.text(digits), m.after.text(digits), m.difference.interval.text(digits))
        table.add_row(f"{m.name}{unit}", *(escape(c) for c in cells), m.verdict)
    out.print(table)
    if done.written is not None:
        out.print("changed:")
        for c in done.written.changes:
            before = "default" if c.old is None else value_of(c.old)
            where = Path(c.place).name if c.place else "a new line"
            out.print(f"  {c.name}: {before} -> {value_of(c.new)}  ({where})", markup=False)
    out.print(tuning.verdict, markup=False)
    if tuning.against is not None:
        parts: list[str] = []
        for name, digits in (("score", 3), ("success", 2), ("time", 1)):
            m = next((m for m in tuning.against.measures if m.name == name), None)
            if m is not None and m.before.groups:
                text = f"{name} {m.before.value:.{digits}f} against {m.after.value:.{digits}f} tuned"
                parts.append(f"{text} (difference {m.difference.interval.text(digits)})")
        out.print("the parameters to compare with: " + ", ".join(parts), markup=False)
    if done.params:
        out.print("parameters: " + " ".join(f"--params {p}" for p in done.params), markup=False)
    out.print(f"report: {done.report}", markup=False)


def _why(setup: Setup, out: Path, workers: int | None, command: str, json_: bool) -> int:
    from navstack.cli.output import counting_bar, print_json, print_note, stdout
    from navstack.tune.request import run_why

    if not json_:
        count, runs = len(setup.space), len(setup.course().cases)
        print_note(f"{count} parameter{'s' * (count != 1)}, each halved and doubled over {runs} run{'s' * (runs != 1)}")
    with counting_bar("driving", quiet=json_) as hear:
        steps, page = run_why(setup, out, workers=workers, command=command, hear=hear)
    if json_:
        print_json({"steps": [s.as_dict() for s in steps], "files": {"report": str(page)}})
        return 0
    _print_steps(steps)
    stdout().print(f"report: {page}", markup=False)
    return 0


def _print_steps(steps: list[Step]) -> None:
    from navstack.cli.output import stdout

    for number, step in enumerate(steps, 1):
        stdout().print(f"{number:>3}. {step.sentence}", markup=False)

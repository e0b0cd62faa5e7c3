"""`navstack tour`: drive to named places, one after another."""

from __future__ import annotations

import signal
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from navstack.cli import options
from navstack.cli.tour_options import TourOptions

if TYPE_CHECKING:
    from navstack.scenario import GoalOutcome, Scenario, TourResult, TourState

EXIT_INTERRUPTED = 130


@options.with_options(chosen=TourOptions)
def tour(
    chosen: TourOptions,
    out: options.RunOutput = Path("navstack_tour"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot to named places. Ctrl-C stops the robot and keeps record and log.

    Exit codes: 0 every goal SUCCEEDED, 1 some did not, 2 invalid input, 130 interrupted.
    """
    from navstack.cli.output import loading_kernels, print_json
    from navstack.core.files import ensure_directory, write_json
    from navstack.plot import plot_run
    from navstack.scenario import warm_up

    scenario, names = chosen.build()
    folder = ensure_directory(out)
    with loading_kernels(quiet=json_):
        warm_up(scenario)
    result = _drive(scenario, names, quiet=json_)
    recorder = result.run.recorder
    assert recorder is not None
    files = {what: str(name) for what, name in recorder.save(folder).items()}
    plot_run(recorder.record(), folder / "run.png")
    files |= {"picture": str(folder / "run.png"), "summary": str(folder / "summary.json")}
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(result, files, scenario.time_limit_s)
    if result.interrupted:
        return EXIT_INTERRUPTED
    return 0 if result.succeeded else 1


def _drive(scenario: Scenario, names: tuple[str, ...], *, quiet: bool) -> TourResult:
    """Drives the tour; prints each goal's outcome to stderr unless `quiet`, and shows the state on a terminal."""
    from navstack.cli.output import reason_of, stderr
    from navstack.scenario import drive_tour

    def print_outcome(name: str, outcome: GoalOutcome, state: TourState) -> None:
        if not quiet:
            why = "" if outcome.succeeded else f", {reason_of(outcome, scenario.time_limit_s)}"
            stderr().print(f"{name}: {outcome.state} after {outcome.time_s:.1f} s{why}; {state}", markup=False)

    with _interrupt_flag() as interrupted, stderr().status("starting") as line:
        shown = -1.0

        def show(state: TourState) -> None:
            nonlocal shown
            if state.running_s - shown >= 1.0:
                shown = state.running_s
                line.update(f"{state.place or 'waiting'}: {state}")

        return drive_tour(scenario, names, on_goal=print_outcome, on_step=show, stop=interrupted)


@contextmanager
def _interrupt_flag() -> Generator[Callable[[], bool]]:
    """Yields a function that is True after the first Ctrl-C; the second Ctrl-C ends the command at once."""
    received: list[int] = []

    def handle(number: int, frame: object) -> None:
        del frame
        received.append(number)
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, handle)
    try:
        yield lambda: bool(received)
    finally:
        signal.signal(signal.SIGINT, before)


def _print(result: TourResult, files: dict[str, str], limit_s: float) -> None:
    from rich.markup import escape

    from navstack.cli.output import print_files, reason_of, stdout, titled_table

    out = stdout()
    table = titled_table("tour", left=("place", "state"), right=("time", "driven", "recoveries"))
    for name, goal in zip(result.names, result.run.goals):
        style = "green" if goal.succeeded else "bold red"
        table.add_row(
            escape(name),
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.2f} m",
            str(goal.recoveries),
        )
    out.print(table)
    for name, goal in zip(result.names, result.run.goals):
        if not goal.succeeded:
            out.print(escape(f"{name}: {reason_of(goal, limit_s)}"))
    out.print(_totals(result))
    print_files(files)


def _totals(result: TourResult) -> str:
    rate = result.state.success_rate
    success = "no goal has ended" if rate is None else f"success rate {100.0 * rate:.0f} %"
    left = len(result.names) - len(result.run.goals)
    return (
        f"{success} ({result.state.succeeded} of {result.state.done}), {result.state.running_s:.1f} s, "
        f"{result.state.distance_m:.2f} m driven, {result.run.collisions} collisions"
        + (f"; {left} goal{'s' * (left != 1)} skipped" if left else "")
        + ("; interrupted" if result.interrupted else "")
    )

"""`navstack tour`: drive to named places, one after another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from navstack.cli import options
from navstack.cli.tour_options import TourOptions

if TYPE_CHECKING:
    from navstack.cli.interrupts import Interrupt
    from navstack.scenario import GoalOutcome, Scenario, TourResult, TourState


@options.with_options(chosen=TourOptions)
def tour(
    chosen: TourOptions,
    out: options.RunOutput = Path("navstack_tour"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot to named places. Ctrl-C, SIGTERM and SIGHUP stop the robot and keep record and log.

    Exit codes: 0 every goal SUCCEEDED, 1 some did not, 2 invalid input, 130 interrupted (143 by SIGTERM, 129 by SIGHUP).
    """
    from navstack.cli.interrupts import interrupt_flag
    from navstack.core.file_lock import locked_folder
    from navstack.core.files import ensure_directory

    scenario, names = chosen.build()
    with locked_folder(ensure_directory(out)), interrupt_flag() as interrupt:
        return _tour(scenario, names, out, interrupt, json_=json_)


def _tour(scenario: Scenario, names: tuple[str, ...], folder: Path, interrupt: Interrupt, *, json_: bool) -> int:
    from navstack.cli.output import loading_kernels, print_json
    from navstack.core.files import write_json
    from navstack.plot import plot_run
    from navstack.scenario import warm_up

    with loading_kernels(quiet=json_):
        warm_up(scenario)
    result = _drive(scenario, names, interrupt, quiet=json_)
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
        return interrupt.exit_code
    return 0 if result.succeeded else 1


def _drive(scenario: Scenario, names: tuple[str, ...], interrupt: Interrupt, *, quiet: bool) -> TourResult:
    """Drives the tour; prints each goal's outcome to stderr unless `quiet`, and shows the state on a terminal."""
    from navstack.cli.output import Verbosity, reason_of, stderr, verbosity
    from navstack.scenario import drive_tour

    def print_outcome(name: str, outcome: GoalOutcome, state: TourState) -> None:
        if not quiet and verbosity() is not Verbosity.QUIET:
            why = "" if outcome.succeeded else f", {reason_of(outcome, scenario.time_limit_s)}"
            stderr().print(f"{name}: {outcome.state} after {outcome.time_s:.1f} s{why}; {state}", markup=False)

    with stderr().status("starting") as line:
        if quiet or verbosity() is Verbosity.QUIET:
            line.stop()
        shown = -1.0

        def show(state: TourState) -> None:
            nonlocal shown
            if state.running_s - shown >= 1.0:
                shown = state.running_s
                line.update(f"{state.place or 'waiting'}: {state}")

        return drive_tour(scenario, names, on_goal=print_outcome, on_step=show, stop=interrupt)


def _print(result: TourResult, files: dict[str, str], limit_s: float) -> None:
    from rich.markup import escape

    from navstack.cli.output import print_advice, print_files, reason_of, stdout, titled_table

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
    print_advice(result.run)
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

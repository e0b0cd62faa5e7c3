"""Runs a scenario of motions, writes its files and prints its outcome."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from navstack.cli.interrupts import Interrupt
    from navstack.record import Record
    from navstack.scenario import RunResult, Scenario


def run_motions(scenario: Scenario, folder: Path, *, json_: bool) -> int:
    """Drives the steps of a scenario; returns the exit code. Ctrl-C and SIGTERM stop the robot and keep the record."""
    from navstack.cli.interrupts import interrupt_flag
    from navstack.core.file_lock import locked_folder
    from navstack.core.files import ensure_directory

    with locked_folder(ensure_directory(folder)), interrupt_flag() as interrupt:
        return _run(scenario, folder, interrupt, json_=json_)


def _run(scenario: Scenario, folder: Path, interrupt: Interrupt, *, json_: bool) -> int:
    from navstack.cli.output import loading_kernels, print_json
    from navstack.core.files import write_json
    from navstack.plot import plot_run
    from navstack.scenario import run_scenario, warm_up

    with loading_kernels(quiet=json_):
        warm_up(scenario)
    result = run_scenario(scenario, stop=interrupt)
    assert result.recorder is not None
    files = {what: str(name) for what, name in result.recorder.save(folder).items()}
    record = result.recorder.record()
    plot_run(record, folder / "run.png")
    files["picture"] = str(folder / "run.png")
    if not json_:
        print_steps(result)
    files |= _tracking(record, folder, quiet=json_)
    files["summary"] = str(folder / "summary.json")
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        from navstack.cli.output import print_files

        print_files(files)
    if interrupt():
        return interrupt.exit_code
    return 0 if result.succeeded else 1


def print_steps(result: RunResult) -> None:
    """Prints the outcome of every step."""
    from rich.markup import escape

    from navstack.cli.output import stdout, titled_table

    out = stdout()
    table = titled_table("steps", left=("step", "state"), right=("time", "driven", "remaining"))
    for goal in result.goals:
        style = "green" if goal.succeeded else "bold red"
        table.add_row(
            escape(goal.step or f"{goal.goal.x:g}, {goal.goal.y:g}, {goal.goal.yaw:.2f}"),
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.3f} m",
            f"{goal.distance_left_m:.3f} m",
        )
    out.print(table)
    for goal in result.goals:
        reason = goal.text if goal.succeeded else f"{goal.error_name} ({goal.error_code}): {goal.message}"
        out.print(escape(reason))
    if result.collisions:
        out.print(f"[bold red]{result.collisions} collisions[/]")


def _tracking(record: Record, folder: Path, *, quiet: bool) -> dict[str, str]:
    """Prints, draws and writes how the trajectories of a run were followed; returns the files."""
    from navstack.cli.explain.tracking import draw, print_tracking
    from navstack.core.errors import RecordError
    from navstack.core.files import write_text
    from navstack.explain import explain_tracking

    for old in (*folder.glob("tracking*.png"), *folder.glob("tracking*.csv")):  # of an earlier run
        old.unlink(missing_ok=True)
    try:
        reports = explain_tracking(record)
    except RecordError:
        return {}
    files: dict[str, str] = {}
    for number, report in enumerate(reports, 1):
        name = "tracking" if len(reports) == 1 else f"tracking_{number}"
        files[name] = str(draw(report, folder / f"{name}.png"))
        write_text(folder / f"{name}.csv", report.table())
        files[f"{name} table"] = str(folder / f"{name}.csv")
        if not quiet:
            print_tracking(report)
    return files

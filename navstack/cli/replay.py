"""`navstack replay`: what costmaps, plans and commands would have been on what a robot recorded."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.log_options import OpenedReplay, ReplayInput, reading_bar
from navstack.cli.output import loading_kernels, print_files, print_json, print_note, stdout, titled_table
from navstack.core import InputError, ensure_directory, locked_folder, write_json
from navstack.parameters import load_configuration
from navstack.plot import plot_replay, plot_run
from navstack.replay import LogReplay, ReplayReport

if TYPE_CHECKING:
    from navstack.cli.interrupts import Interrupt
    from navstack.parameters import Configuration

WARM_UP_S: Final = 1.0
"""The first second is replayed twice: the first time compiles or loads the kernels."""


@options.with_options(chosen=ReplayInput)
def replay(
    chosen: ReplayInput,
    from_: Annotated[
        float | None, typer.Option("--from", metavar="T", help="First time (s since the first message).", min=0.0)
    ] = None,
    to: Annotated[
        float | None, typer.Option("--to", metavar="T", help="Last time (s since the first message).", min=0.0)
    ] = None,
    versus: Annotated[
        list[str],
        typer.Option(
            "--versus",
            metavar="NAME|DIR|FILE",
            help="Second parameter set, replayed on the same part (repeatable, in loading order).",
        ),
    ] = [],
    record: Annotated[
        bool,
        typer.Option(
            "--record/--no-record",
            help="Keep a record; it grows on disk by about 0.1 MB/s. Without, only the summary and the chart.",
        ),
    ] = True,
    scans: Annotated[bool, typer.Option("--scans/--no-scans", help="Record the scans (about 1 kB each).")] = True,
    out: options.RunOutput = Path("navstack_replay"),
    json_: options.Json = False,
) -> int:
    """Replay a log through costmaps, planners and controller, open loop: the robot does what the log says.

    The record opens with `navstack plot`, `explain` and `live`, which need the log again. Exit codes: 0, 2 invalid input, 130
    interrupted: the record ends there.
    """
    if from_ is not None and to is not None and not from_ < to:
        raise InputError(f"--from {from_:g} is not before --to {to:g}; give a span of the log in seconds")
    with (
        locked_folder(out),
        interrupt_flag() as interrupt,
        chosen.opened(start=from_, end=to, scans=scans) as opened,
    ):
        configurations = {"": opened.configuration}
        if versus:
            configurations["versus"] = load_configuration(
                versus, overrides=chosen.set_, distro=chosen.distro, allow_missing=chosen.allow_missing
            )
        return _replay(opened, configurations, out, interrupt, record=record, json_=json_)


def _replay(
    opened: OpenedReplay,
    configurations: dict[str, Configuration],
    folder: Path,
    interrupt: Interrupt,
    *,
    record: bool,
    json_: bool,
) -> int:
    documents: dict[str, Any] = {}
    files: dict[str, str] = {}
    reports: dict[str, ReplayReport] = {}
    for name, configuration in configurations.items():
        done = _run(opened, configuration, interrupt, folder if record else None, quiet=json_)
        reports[name] = ReplayReport(done)
        written = _write(done, reports[name], folder / name if name else folder)
        files |= {f"{name} {what}".strip(): file for what, file in written.items()}
        documents[name or "replay"] = {**reports[name].as_dict(), "wall_s": done.wall_s}
        if not json_:
            if len(configurations) > 1:
                stdout().print(f"\n--{name or 'params'}:")
            _print(done, reports[name], opened if not name else None)
    if len(reports) > 1 and not json_:
        _print_versus(*reports.values())
    files["summary"] = str(folder / "summary.json")
    document = {**documents, "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        print_files(files)
    return interrupt.exit_code if interrupt() else 0


def _run(
    opened: OpenedReplay, configuration: Configuration, interrupt: Interrupt, spool: Path | None, *, quiet: bool
) -> LogReplay:
    first = dataclasses.replace(opened.options, end=(opened.options.start or 0.0) + WARM_UP_S)
    with loading_kernels(configuration.planner_names, quiet=quiet):
        LogReplay(opened.log, configuration, opened.static_map, first, record=False).run()
    done = LogReplay(
        opened.log, configuration, opened.static_map, opened.options, record=spool is not None, spool=spool
    )
    with reading_bar(opened.log, quiet=quiet) as progress:
        done.run(progress, interrupt)
    return done


def _write(done: LogReplay, report: Any, folder: Path) -> dict[str, str]:
    """Write the record and the pictures; return their names."""
    ensure_directory(folder)
    files: dict[str, str] = {}
    recorder = done.run_recorder
    if recorder is not None:
        files = save_record(recorder, folder)
        record = recorder.record()
        if len(record.samples):
            plot_run(record, folder / "run.png")
            files["picture"] = str(folder / "run.png")
    if done.cycles:
        first = report.commands.first if report.commands is not None else None
        times, commands, recorded, rejected = report.series()
        plot_replay(
            times,
            commands,
            recorded,
            rejected,
            folder / "commands.png",
            title=f"replay of {done.log.path.name}: commands",
            first_difference=None if first is None else first.time,
        )
        files["commands"] = str(folder / "commands.png")
    return files


def _print(done: LogReplay, report: Any, opened: OpenedReplay | None) -> None:
    out = stdout()
    for note in [*(opened.notes if opened is not None else ()), *done.notes]:
        print_note(note)
    if done.goals:
        table = titled_table("goals", left=("goal", "navstack", "log"), right=("sent", "ended", "gave up"))
        for goal in done.goals:
            recorded = goal.recorded_text or ("ended" if goal.recorded_end == goal.recorded_end else "")
            table.add_row(
                f"{goal.pose.x:g}, {goal.pose.y:g}, {goal.pose.yaw:.2f}",
                goal.handle.status.name,
                escape(recorded),
                f"{goal.time:.1f} s",
                f"{goal.ended:.1f} s",
                str(len(goal.attempts)),
            )
        out.print(table)
        for goal in done.goals:
            for reason in dict.fromkeys(goal.attempts):
                out.print(f"goal {goal.pose.x:g}, {goal.pose.y:g}: navstack gave up: {escape(reason)}")
    else:
        out.print("no goal: give one with --goal x,y,yaw or --goal end; costmaps only")
    for line in report.lines():
        out.print(escape(line))
    factor = done.duration / done.wall_s if done.wall_s > 0.0 else 0.0
    out.print(f"{factor:.0f} times real time")


def _print_versus(first: Any, second: Any) -> None:
    """Print both replays side by side."""

    def values(report: Any) -> list[str]:
        commands, plans = report.commands, report.plans
        return [
            f"{report.controlled + report.rejected:,}",
            f"{100.0 * report.rejected_share:.1f} %" if report.rejected_share == report.rejected_share else "",
            f"{100.0 * commands.different / commands.cycles:.1f} %" if commands else "",
            f"{commands.mean_linear:.3f} m/s" if commands else "",
            f"{commands.mean_angular:.3f} rad/s" if commands else "",
            f"{commands.first.time:.2f} s" if commands and commands.first else "",
            f"{plans.length:.2f} m" if plans else "",
        ]

    names = [
        "control cycles",
        "without a valid command",
        "commands that differ from the log",
        "mean difference, forward",
        "mean difference, turn",
        "first difference",
        "mean length of the plans",
    ]
    table = titled_table("versus", left=("",), right=("--params", "--versus"))
    for name, a, b in zip(names, values(first), values(second), strict=True):
        if a or b:
            table.add_row(name, a, b)
    stdout().print(table)

"""`navstack simulate`: drive a simulated robot to its goals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from navstack.cli import options
from navstack.cli.fleet import simulate_fleet
from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
    counted,
    loading_kernels,
    print_advice,
    print_files,
    print_json,
    print_note,
    reason_of,
    shows_progress,
    stderr,
    stdout,
    titled_table,
)
from navstack.cli.scenario_options import ScenarioOptions
from navstack.core import locked_folder, write_json
from navstack.explain import narrow_advice
from navstack.plot import plot_run
from navstack.scenario import run_scenario, warm_up

if TYPE_CHECKING:
    from rich.console import Console

    from navstack.cli.interrupts import Interrupt
    from navstack.scenario import RunResult, Scenario

STATE_STYLE = {"SUCCEEDED": "green", "PREEMPTED": "yellow"}


@options.with_options(chosen=ScenarioOptions)
def simulate(
    chosen: ScenarioOptions,
    timings: Annotated[
        bool,
        typer.Option("--timings", help="Add wall times of planning and control to the summary (ms: p50, p95, p99)."),
    ] = False,
    scans: Annotated[
        bool, typer.Option("--scans/--no-scans", help="Record the scans of the lidars (about 1 kB each).")
    ] = True,
    out: options.RunOutput = Path("navstack_run"),
    json_: options.Json = False,
) -> int:
    """Drive a simulated robot to its goals on a map, or through a scenario file.

    Without arguments, a turtlebot drives through a packaged office. A fleet file drives many robots in one world. Options
    override the settings of a scenario file, and those of all robots of a fleet.

    Exit codes: 0 the run met its success conditions (by default: every goal SUCCEEDED, no collision), 1 it did not,
    2 invalid input, 130 interrupted (143 by SIGTERM, 129 by SIGHUP): the record ends there.
    """
    fleet = chosen.fleet()
    if fleet is not None:
        return simulate_fleet(fleet, out, scans=scans, json_=json_)
    scenario = chosen.build()
    with locked_folder(out), interrupt_flag() as interrupt:
        return _simulate(scenario, out, interrupt, timings=timings, scans=scans, json_=json_)


def _simulate(
    scenario: Scenario, folder: Path, interrupt: Interrupt, *, timings: bool, scans: bool, json_: bool
) -> int:
    result = _run(scenario, interrupt, folder, quiet=json_, timings=timings, scans=scans)
    assert result.recorder is not None
    files = save_record(result.recorder, folder)
    picture = folder / "run.png"
    record = result.recorder.record()
    plot_run(record, picture)
    result = replace(result, advice=(*result.advice, *narrow_advice(record)))
    files |= {"picture": str(picture), "summary": str(folder / "summary.json")}
    document = {**result.as_dict(), "files": files}
    write_json(folder / "summary.json", document)
    if json_:
        print_json(document)
    else:
        _print(result, files)
    if interrupt():
        print_note("interrupted: the goal was canceled, and the record ends there")
        return interrupt.exit_code
    return 0 if result.succeeded else 1


def _run(
    scenario: Scenario, interrupt: Interrupt, folder: Path, *, quiet: bool, timings: bool, scans: bool
) -> RunResult:
    with loading_kernels(scenario.configuration.planner_names, quiet=quiet):
        warm_up(scenario)

    # the duration of a run is unknown: the bar counts goals, the text shows the simulated time
    columns = (
        TextColumn("goal {task.fields[goal]} of {task.total:.0f}"),
        BarColumn(),
        TextColumn("{task.fields[now]:7.1f} s simulated"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=stderr(), transient=True, disable=not shows_progress(quiet=quiet)) as bar:
        task = bar.add_task("", total=len(scenario.goals), goal=1, now=0.0)
        shown = -1.0

        def progress(now: float, goal: int) -> None:
            nonlocal shown
            if now - shown >= 1.0:
                shown = now
                bar.update(task, completed=goal, goal=goal + 1, now=now)

        return run_scenario(scenario, scans=scans, spool=folder, timings=timings, progress=progress, stop=interrupt)


def _print(result: RunResult, files: dict[str, str]) -> None:
    out = stdout()
    out.print(_goal_table(result))
    _print_reasons(out, result)
    m = result.metrics
    out.print(
        f"{m.length_m:.1f} m in {m.time_s:.1f} s; clearance: minimum {m.clearance_min_m:.2f} m, mean "
        f"{m.clearance_mean_m:.2f} m; mean speed in motion {m.speed_mean_m_s:.2f} m/s, jerk {m.jerk_rms_m_s3:.2f} m/s³, "
        f"curvature {m.curvature_mean_1_m:.2f} rad/m"
    )
    if m.social is not None:
        out.print("; ".join(f"{name} {value}" for name, value in m.social.shown()))
    out.print(
        f"{result.simulated_s:.1f} s simulated in {result.wall_s:.2f} s: {result.real_time_factor:.0f} times real time; "
        f"{counted(result.collisions, 'collision')}; seed {result.seed}"
    )
    print_files(files)


def _goal_table(result: RunResult) -> Any:
    table = titled_table("goals", left=("goal", "state"), right=("time", "driven", "remaining", "recoveries"))
    for goal in result.goals:
        style = STATE_STYLE.get(goal.state, "bold red")
        table.add_row(
            f"{goal.goal.x:g}, {goal.goal.y:g}, {goal.goal.yaw:.2f}",
            f"[{style}]{goal.state}[/]",
            f"{goal.time_s:.1f} s",
            f"{goal.path_length_m:.2f} m",
            f"{goal.distance_left_m:.2f} m",
            str(goal.recoveries),
        )
    return table


def _print_reasons(out: Console, result: RunResult) -> None:
    """Why goals failed, and which conditions the run met."""
    for goal in result.goals:
        if not goal.succeeded:
            out.print(f"goal {goal.goal.x:g}, {goal.goal.y:g}: {escape(reason_of(goal))}")
    for warning in result.warnings:
        often = f" ({warning.count} times)" if warning.count > 1 else ""
        out.print(f"[yellow]warning[/] at {warning.time:.1f} s{often}: {escape(warning.text)}")
    print_advice(result.advice)
    for condition in result.conditions:
        mark = "[green]met[/]" if condition.holds else "[bold red]not met[/]"
        out.print(f"condition {condition.condition} {mark}: {escape(condition.text)}")

"""`navstack simulate FLEET.yaml`: drive the robots of a fleet."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from navstack.cli.interrupts import interrupt_flag
from navstack.cli.last_run import save_record
from navstack.cli.output import (
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
from navstack.core import locked_folder, write_json
from navstack.fleet import run_fleet, warm_up_fleet
from navstack.plot import plot_fleet, plot_run

if TYPE_CHECKING:
    from navstack.fleet import Fleet, FleetResult, TaskReport

_SHOWN: Final = 12
"""Lines of a kind that are printed; summary.json has all."""
_IN_TABLE: Final = ("goals", "max_collisions")


def simulate_fleet(fleet: Fleet, folder: Path, *, scans: bool, json_: bool) -> int:
    """Run a fleet, write the records of its robots, pictures and a summary, and print it. Return the exit code."""
    with locked_folder(folder), interrupt_flag() as interrupt:
        result = _run(fleet, interrupt, folder, quiet=json_, scans=scans)
        files = _write(result, folder)
        if json_:
            print_json({**result.as_dict(), "files": files})
        else:
            _print(result, files)
        if interrupt():
            print_note("interrupted: the goals were canceled, and the records end there")
            return interrupt.exit_code
    return 0 if result.succeeded else 1


def _run(fleet: Fleet, interrupt: Any, folder: Path, *, quiet: bool, scans: bool) -> FleetResult:
    planners = {name: None for r in fleet.robots for name in r.scenario.configuration.planner_names}
    with loading_kernels(tuple(planners), quiet=quiet):
        warm_up_fleet(fleet)
    columns = (
        TextColumn("{task.completed:.0f} of {task.total:.0f} robots done"),
        BarColumn(),
        TextColumn("{task.fields[now]:7.1f} s simulated"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=stderr(), transient=True, disable=not shows_progress(quiet=quiet)) as bar:
        task = bar.add_task("", total=len(fleet.robots), now=0.0)
        shown = -1.0

        def progress(now: float, done: int) -> None:
            nonlocal shown
            if now - shown >= 1.0:
                shown = now
                bar.update(task, completed=done, now=now)

        return run_fleet(fleet, scans=scans, spool=folder, progress=progress, stop=interrupt)


def _write(result: FleetResult, folder: Path) -> dict[str, Any]:
    files: dict[str, Any] = {}
    records = {}
    for robot in reversed(result.robots):  # the first one is remembered as the last run
        assert robot.run.recorder is not None
        own = folder / robot.name
        files[robot.name] = save_record(robot.run.recorder, own)
        records[robot.name] = robot.run.recorder.record()
        plot_run(records[robot.name], own / "run.png")
        files[robot.name]["picture"] = str(own / "run.png")
        write_json(own / "summary.json", {**robot.as_dict(), "files": files[robot.name]})
    files = dict(sorted(files.items()))
    files["picture"] = str(plot_fleet(dict(sorted(records.items())), folder / "fleet.png"))
    files["summary"] = str(folder / "summary.json")
    write_json(folder / "summary.json", {**result.as_dict(), "files": files})
    return files


def _print(result: FleetResult, files: dict[str, Any]) -> None:
    out = stdout()
    out.print(_table(result))
    for robot in result.robots:
        if robot.fault:
            out.print(f"{escape(robot.name)} [bold red]{escape(robot.fault)}[/]")
        for goal in robot.run.goals:
            if not goal.succeeded and result.tasks is None:
                out.print(f"{escape(robot.name)}, goal {goal.goal.x:g}, {goal.goal.y:g}: {escape(reason_of(goal))}")
        for condition in robot.run.conditions:
            if not condition.holds and condition.condition not in _IN_TABLE:
                out.print(f"{escape(robot.name)}: {condition.condition} [bold red]not met[/]: {escape(condition.text)}")
    if result.tasks is not None:
        _print_tasks(out, result.tasks)
    _print_first(out, [f"[bold red]contact[/]: {escape(str(contact))}" for contact in result.contacts], "contacts")
    events = [f"[yellow]traffic[/] at {event.time:.1f} s: {escape(event.text)}" for event in result.events]
    _print_first(out, events, "events of the traffic")
    advice = [f"{robot.name}: {line}" for robot in result.robots if robot.contacts == () for line in robot.run.advice]
    print_advice(tuple(advice[:_SHOWN]))
    least = result.min_distance_m
    apart = f"; robots at least {least:.2f} m apart" if len(result.robots) > 1 else ""
    touches = "1 contact" if len(result.contacts) == 1 else f"{len(result.contacts)} contacts"
    out.print(
        f"makespan {result.makespan_s:.1f} s, sum of times {result.sum_of_times_s:.1f} s, waiting {result.waiting_s:.1f} s; "
        f"{touches}{apart}"
    )
    out.print(
        f"{result.simulated_s:.1f} s simulated in {result.wall_s:.2f} s: {result.real_time_factor:.0f} times real time; "
        f"seed {result.seed}"
    )
    print_files({name: files[name] for name in ("picture", "summary")})
    out.print(
        f"records: {Path(files['summary']).parent}/ROBOT, for example: navstack explain goal {_example(result, files)}"
    )


def _print_tasks(out: Any, report: TaskReport) -> None:
    """Print which tasks failed, were returned or came late, and the figures of the fleet."""
    failed = [
        f"{escape(task.task.name)} [bold red]failed[/]: {escape(task.reason)}"
        for task in report.tasks
        if task.state == "failed"
    ]
    returned = [
        f"{escape(task.task.name)} was [yellow]returned[/]: {escape('; '.join(task.returns))}"
        for task in report.tasks
        if task.returns and task.state != "failed"
    ]
    late = [f"{escape(task.task.name)} was [yellow]late[/]" for task in report.tasks if task.is_late]
    for lines, what in ((failed, "failed tasks"), (returned, "returned tasks"), (late, "late tasks")):
        _print_first(out, lines, what)
    figures, done = report.as_dict(), report.count("done")
    waiting, completion, fair = figures["waiting_s"], figures["completion_s"], figures["fairness"]
    style = "green" if report.all_done else "bold red"
    text = (
        f"tasks by {report.assignment}: [{style}]{done} of {len(report.tasks)} done[/], {report.throughput_per_h:.0f}/h"
    )
    if waiting["mean"] is not None:
        text += f"; waiting {waiting['mean']:.1f} s (p95 {waiting['p95']:.1f} s)"
    if completion["mean"] is not None:
        text += f", done after {completion['mean']:.1f} s (p95 {completion['p95']:.1f} s)"
    out.print(text)
    out.print(
        f"robots with a task {report.utilization:.0%} of the time; fairness {fair['distance']:.2f} by distance, "
        f"{fair['tasks']:.2f} by tasks; {figures['energy_wh']:.1f} Wh"
    )


def _print_first(out: Any, lines: list[str], what: str) -> None:
    for line in lines[:_SHOWN]:
        out.print(line)
    if len(lines) > _SHOWN:
        out.print(f"{len(lines) - _SHOWN} more {what}: summary.json has all")


def _example(result: FleetResult, files: dict[str, Any]) -> str:
    late = max(result.robots, key=lambda robot: robot.finished_s)
    return str(Path(files["summary"]).parent / late.name)


def _table(result: FleetResult) -> Any:
    right = ("finished", "driven", "waiting", "contacts", "nearest")
    loads = {} if result.tasks is None else {load.name: load for load in result.tasks.robots}
    charge = any(load.charge is not None for load in loads.values())
    table = titled_table(
        "robots", left=("robot", "tasks" if loads else "goals"), right=(*right, "charge") if charge else right
    )
    for robot in result.robots:
        goals, load = robot.run.goals, loads.get(robot.name)
        reached = sum(goal.succeeded for goal in goals)
        style = "green" if reached == len(goals) else "bold red"
        table.add_row(
            escape(robot.name),
            f"[{style}]{reached}/{len(goals)}[/]" if load is None else str(load.tasks),
            f"{robot.finished_s:.1f} s",
            f"{robot.run.metrics.length_m:.1f} m",
            f"{robot.waiting_s:.1f} s",
            str(len(robot.contacts)),
            f"{robot.nearest.distance_m:.2f} m" if robot.nearest.robot else "-",
            *([f"{load.charge:.0%}" if load is not None and load.charge is not None else "-"] if charge else []),
        )
    return table

"""`navstack bag`: what a log contains, a run as a log, a moment of a log as a scenario."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.tree import Tree

from navstack.cli import options
from navstack.cli.log_options import BagFile as LogFile
from navstack.cli.log_options import PartialBag as Partial
from navstack.cli.log_options import ReplayInput, reading_bar, seconds_bar
from navstack.cli.options import file_in
from navstack.cli.output import loading_kernels, print_files, print_json, print_note, stdout
from navstack.core import ensure_directory, write_json
from navstack.logs import log_info, open_log
from navstack.record import Record
from navstack.replay import export_run, foxglove_layout, snapshot
from navstack.scenario import write_scenario

if TYPE_CHECKING:
    from navstack.logs import LogInfo, TopicInfo

app = typer.Typer(
    name="bag",
    no_args_is_help=True,
    rich_markup_mode="markdown",
    help="Read and write bags: ROS 1 (.bag), ROS 2 (folder, .db3, .mcap).",
)


@app.command("info")
def info(log: LogFile, partial: Partial = False, json_: options.Json = False) -> int:
    """Print topics, rates, gaps, the tf tree with its breaks, and what navigation needs.

    Exit codes: 0, 2 the file cannot be read.
    """
    with open_log(log, partial=partial) as opened, reading_bar(opened, quiet=json_) as progress:
        found = log_info(opened, progress)
        problem, notes = opened.problem, opened.notes
    if json_:
        print_json({**found.as_dict(), "problem": None if problem is None else problem.message})
    else:
        _print_info(found)
        for note in notes:
            print_note(note)
        if problem is not None:
            print_note(problem.message)
    return 0


def _print_info(found: LogInfo) -> None:
    out = stdout()
    start = datetime.fromtimestamp(found.start_ns / 1e9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    out.print(
        f"{escape(found.path)}: {found.format}, {found.duration:.1f} s from {start} UTC, {found.messages:,} messages"
    )
    for topic in found.topics:
        kinds = ", ".join(kind.replace("/msg/", "/") for kind in topic.types)
        frames = f' in "{", ".join(topic.frames[:4])}"' if topic.frames else ""
        out.print(f"[bold]{escape(topic.topic)}[/]: {escape(kinds + frames)}, {_rate_text(topic)}")
    out.print()
    _print_transforms(found)
    for need in found.needs:
        mark = "[green]yes[/]" if need.found else "[yellow]no[/] "
        out.print(f"{mark} {need.what}: {escape(need.text)}")
    for topic in found.topics:
        if topic.problem:
            out.print(f"[yellow]warning:[/] {escape(topic.problem)}")


def _rate_text(topic: TopicInfo) -> str:
    parts = [f"{topic.count:,} message{'s' * (topic.count != 1)}"]
    if topic.rate == topic.rate:
        parts.append(f"{topic.rate:.3g} Hz, longest gap {topic.longest_gap:.2f} s at {topic.gap_at:.1f} s")
    if abs(topic.delay) >= 0.0005:
        when = "after" if topic.delay > 0.0 else "before"
        parts.append(f"recorded {1000.0 * abs(topic.delay):.0f} ms {when} its stamp")
    return ", ".join(parts)


def _print_transforms(found: LogInfo) -> None:
    if not found.transforms:
        return
    roots = found.roots
    if not roots:
        stdout().print("[yellow]warning:[/] the tf tree is a cycle")
    for root in roots:
        _add_children(tree := Tree(escape(root)), root, found, {root})
        stdout().print(tree)
    if len(roots) > 1:
        stdout().print(f"[yellow]warning:[/] {len(roots)} trees are not connected: {escape(', '.join(roots))}")


def _add_children(tree: object, parent: str, found: LogInfo, seen: set[str]) -> None:
    assert isinstance(tree, Tree)
    for edge in found.transforms:
        if edge.parent != parent or edge.child in seen:
            continue
        if edge.is_static:
            text = "static"
        elif edge.count > 1 and edge.last > edge.first:
            rate = (edge.count - 1) / (edge.last - edge.first)
            text = f"{rate:.1f} Hz, longest gap {edge.longest_gap:.2f} s at {edge.gap_at:.1f} s"
            if edge.breaks:
                text += f", [yellow]{edge.breaks} break{'s' * (edge.breaks != 1)}[/]"
        else:
            text = f"{edge.count} message{'s' * (edge.count != 1)}"
        if len(edge.parents) > 1:
            text += f"; [yellow]several parents: {escape(', '.join(edge.parents))}[/]"
        seen.add(edge.child)
        _add_children(tree.add(f"{escape(edge.child)} ({text})"), edge.child, found, seen)


@app.command("export")
def export(
    run: options.RunFolder,
    to: Annotated[
        Path, typer.Option("--to", metavar="FILE", help="File to write: .bag (ROS 1) or .mcap (ROS 2 messages).")
    ],
    layout: Annotated[
        Path | None,
        typer.Option(
            "--layout",
            metavar="FILE",
            help="Also write a layout for Foxglove (.json) that shows map, costmaps, scan, plans and robot.",
            callback=file_in("navstack_foxglove.json"),
        ),
    ] = None,
    json_: options.Json = False,
) -> int:
    """Write a simulated run as a bag: tf, map, odometry, scans, goals, commands, costmaps with updates, plans, markers.

    The run is simulated again, which gives the same run. Exit codes: 0, 2 invalid input.
    """
    record = Record.load(run)
    ensure_directory(to.parent)
    with seconds_bar("exporting", record.duration, quiet=json_) as progress:
        exported = export_run(record, to, progress)
    files = {"log": str(to)}
    if layout is not None:
        write_json(layout, foxglove_layout(is_ros1=to.suffix.lower() == ".bag"))
        files["layout"] = str(layout)
    if json_:
        print_json(
            {"messages": exported.messages, "duration_s": exported.duration, "topics": exported.topics, "files": files}
        )
        return 0
    stdout().print(
        f"{exported.messages:,} messages on {len(exported.topics)} topics, {exported.duration:.1f} s; the run was simulated "
        "again and is equal to the record"
    )
    print_files(files)
    return 0


@app.command("scenario")
@options.with_options(chosen=ReplayInput)
def scenario(
    chosen: ReplayInput,
    at: Annotated[float, typer.Option("--at", metavar="T", help="Time (s since the first message).", min=0.0)],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            metavar="FILE|DIR",
            help="Scenario file to write; in a folder: scenario.yaml.",
            callback=file_in("scenario.yaml"),
        ),
    ] = Path("scenario.yaml"),
    json_: options.Json = False,
) -> int:
    """Write a moment of a log as a scenario: map, pose, observed obstacles as static boxes, goal.

    Simulate from there with other parameters: `navstack simulate scenario.yaml --params ..`. Exit codes: 0, 2 invalid input.
    """
    with chosen.opened() as opened, loading_kernels(quiet=json_):
        found = snapshot(opened.log, opened.configuration, opened.static_map, at, opened.options)
    if not found.goals:
        print_note("no goal was active at that time; give one with --goal, or write `goals:` into the file")
    if found.configuration is not opened.configuration:
        sim = found.configuration.navstack.sim
        for lidar in (sim.lidar(name) for name in sim.lasers):
            print_note(
                f"the simulated lidar of {lidar.topic} is that of the log: {lidar.beams} beams over {lidar.fov:.2f} rad, "
                f"{lidar.range_min:g} to {lidar.range_max:g} m, {lidar.frequency:.1f} Hz"
            )
    written = write_scenario(found, out, map_file=opened.map_file, sources=chosen.params or ["turtlebot"])
    if json_:
        print_json({"start": list(written.start), "shapes": len(written.shapes), "files": {"scenario": str(out)}})
        return 0
    x, y, yaw = written.start
    seen = f"{len(written.shapes)} observed obstacles that the map does not have"
    stdout().print(f"the robot at {x:.2f}, {y:.2f}, {yaw:.2f}; {seen}")
    print_files({"scenario": str(out)})
    return 0

"""`navstack explain command`: why the local planner chose its command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from navstack.explain import CommandReport


def command(
    run: options.RunFolder,
    time: options.Time = None,
    all_: Annotated[
        bool, typer.Option("--all", help="Print all samples, also rejected ones, instead of the best 12.")
    ] = False,
    out: Annotated[Path | None, options.picture_file("command.png")] = None,
    json_: options.Json = False,
) -> None:
    """Explain a velocity command: the samples, which critic rejected them and where, and the costs of the others.

    The run is replayed up to the given time.
    """
    from navstack.cli.output import print_files, print_json, stdout
    from navstack.explain import explain_command
    from navstack.explain.printing import print_command
    from navstack.record import Record

    report = explain_command(Record.load(run), time)
    files = {"picture": str(_draw(report, out))} if out is not None else {}
    if json_:
        print_json(report.as_dict() | ({"files": files} if files else {}))
    else:
        print_command(stdout(), report, everything=all_)
        print_files(files)


def _draw(report: CommandReport, out: Path) -> Path:
    from navstack.core.errors import InputError
    from navstack.explain.command_summary import velocity_text
    from navstack.plot.fan import Fan, plot_fan

    plan = report.plan
    if report.poses is None or report.counts is None or plan.totals is None:
        raise InputError(f"{report.planner} has no trajectories to draw; omit --out", planner=report.planner)
    rows = sorted(report.samples, key=lambda sample: sample.index)
    requested = f" (requested {report.requested:.2f} s)" if report.time != report.requested else ""
    fan = Fan(
        poses=report.poses,
        counts=report.counts,
        totals=plan.totals,
        rejected_by=[sample.rejected_by for sample in rows],
        best=plan.best,
        collisions=[int(sample.collision.get("step", -1)) for sample in rows],
    )
    return plot_fan(
        fan,
        report.costmap,
        out,
        robot=report.robot,
        footprint=report.footprint,
        plan=plan.local_plan.poses if plan.local_plan is not None else None,
        title=f"{report.planner} at {report.time:.2f} s{requested}: {velocity_text(plan.command)}",
        subtitle=_shortened(report.rejections),
    )


def _shortened(text: str, longest: int = 110) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"

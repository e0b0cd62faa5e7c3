"""`navstack explain tracking`: how well a trajectory was followed."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from navstack.cli import options
from navstack.cli.output import print_files, print_json, stdout, titled_table
from navstack.core import InputError, write_text
from navstack.explain import choose_tracking, explain_tracking
from navstack.plot import plot_tracking
from navstack.record import Record

if TYPE_CHECKING:
    from navstack.explain import TrackingReport


def tracking(
    run: options.RunFolder,
    number: Annotated[
        int | None,
        typer.Option(
            "--trajectory", metavar="N", help="Number of the trajectory in the run, from 1. [default: all]", min=1
        ),
    ] = None,
    out: Annotated[Path | None, options.picture_file("tracking.png")] = None,
    csv: Annotated[
        Path | None, typer.Option("--csv", metavar="FILE", help="Write reference, pose and errors over time (.csv).")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Explain how well a trajectory was followed: errors along, across and of the heading, mean and worst, over time.

    The errors are those of the true pose of the simulated robot; `believed` is the distance that the robot knew of.
    """
    reports = list(explain_tracking(Record.load(run)))
    if number is not None:
        reports = [choose_tracking(reports, number)]
    files: dict[str, str] = {}
    if (out is not None or csv is not None) and len(reports) > 1:
        raise InputError(f"the run has {len(reports)} trajectories; choose one with --trajectory N", argument="--out")
    if out is not None:
        files["picture"] = str(draw(reports[0], out))
    if csv is not None:
        write_text(csv, reports[0].table())
        files["table"] = str(csv)
    if json_:
        print_json({"trajectories": [r.as_dict() for r in reports]} | ({"files": files} if files else {}))
        return
    for report in reports:
        print_tracking(report)
    print_files(files)


def print_tracking(report: TrackingReport) -> None:
    """Prints the errors of a followed trajectory."""
    out = stdout()
    out.print(
        f"[bold]{escape(report.name)}[/] in {escape(report.frame)}, from {report.begin:.2f} s: followed for "
        f"{report.t[-1]:.1f} of {report.duration:.1f} s"
    )
    table = titled_table("errors", left=("error",), right=("mean", "rms", "p95", "worst"))
    for name, values in report.statistics().items():
        what, _, unit = name.rpartition("_")
        scale, shown = (100.0, "cm") if unit == "m" else (180.0 / math.pi, "degrees")
        table.add_row(f"{what} ({shown})", *(f"{scale * values[key]:.2f}" for key in ("mean", "rms", "p95", "max")))
    out.print(table)


def draw(report: TrackingReport, out: Path) -> Path:
    """Draws a followed trajectory. Raises OutputError."""
    found = report.statistics()["distance_m"]
    return plot_tracking(
        out,
        t=report.t,
        reference=report.reference,
        poses=report.poses,
        errors=(report.along, report.across, report.heading),
        speeds=(report.reference_speed, report.speed),
        title=f"{report.name}: mean error {100.0 * found['mean']:.2f} cm, worst {100.0 * found['max']:.2f} cm",
        subtitle=f"followed in {report.frame} for {report.t[-1]:.1f} of {report.duration:.1f} s; errors of the true pose",
    )

"""`navstack explain command`: why the local planner chose its command."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from navstack.cli import options

if TYPE_CHECKING:
    from rich.console import Console

    from navstack.explain import CommandReport
    from navstack.explain.samples import SampleReport

SHOWN = 12
"""Rows of the table without --all."""
PIPE_WIDTH = 400
"""Width of the table if stdout is not a terminal (columns): wide enough for every number."""


def command(
    run: options.RunFolder,
    time: options.Time = None,
    all_: Annotated[
        bool, typer.Option("--all", help=f"Print all samples, also rejected ones, instead of the best {SHOWN}.")
    ] = False,
    out: options.PictureFile = None,
    json_: options.Json = False,
) -> None:
    """Explain a velocity command: the samples, which critic rejected them and where, and the costs of the others.

    The run is replayed up to the given time.
    """
    from navstack.cli.output import print_files, print_json
    from navstack.explain import explain_command
    from navstack.record import Record

    report = explain_command(Record.load(run), time)
    files = {"picture": str(_draw(report, out))} if out is not None else {}
    if json_:
        print_json(report.as_dict() | ({"files": files} if files else {}))
    else:
        _print(report, everything=all_)
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


def _print(report: CommandReport, *, everything: bool) -> None:
    from rich.markup import escape

    from navstack.cli.output import stdout
    from navstack.explain.command_summary import velocity_text

    out, plan = stdout(), report.plan
    requested = f" (requested {report.requested:.3f} s)" if report.requested - report.time > 1e-3 else ""
    out.print(
        f"{report.planner} at {report.time:.3f} s{requested}, {report.state}, robot at ({report.robot.x:.2f}, "
        f"{report.robot.y:.2f}, {report.robot.yaw:.2f}) in {escape(report.costmap.frame)}: "
        f"{plan.mode}, {velocity_text(plan.command)}"
    )
    out.print(f"[bold]{escape(report.summary)}[/]")
    for note in plan.notes:
        out.print(f"note: {escape(note)}")
    shown = _shown_samples(report, everything=everything)
    if shown:
        _print_samples(out, report, shown)


def _shown_samples(report: CommandReport, *, everything: bool) -> tuple[SampleReport, ...]:
    """The best samples and the chosen one, or all."""
    if everything:
        return report.samples
    shown = report.legal[:SHOWN] or report.samples[:SHOWN]
    if all(sample.index != report.plan.best for sample in shown):
        shown += tuple(sample for sample in report.legal if sample.index == report.plan.best)
    return shown


def _print_samples(out: Console, report: CommandReport, shown: tuple[SampleReport, ...]) -> None:
    from rich.console import Console

    plan = report.plan
    # critics whose cost is zero in every shown row get no column
    scored = [n for n in plan.critics if any(s.costs.get(n) for s in shown)]
    table = _sample_table(report, shown, scored)
    (out if out.is_terminal else Console(highlight=False, width=PIPE_WIDTH)).print(table)
    scales = dict(zip(plan.critics, plan.scales.tolist())) if plan.scales is not None else {}
    weights = ", ".join(f"{name} {scales[name]:.4g}" for name in scored if name in scales)
    hidden = len(report.samples) - len(shown)
    more = f"; {hidden} more with --all" if hidden else ""
    out.print(f"[dim]columns of critics: weighted cost (raw cost); weights: {weights}{more}[/]")


def _sample_table(report: CommandReport, shown: tuple[SampleReport, ...], scored: list[str]) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    sideways = any(sample.velocity[1] for sample in report.samples)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for heading in ("rank", "vx", *(["vy"] if sideways else []), "wz", "total", *scored):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("rejected by")
    for sample in shown:
        vx, vy, wz = (_velocity(v) for v in sample.velocity)
        table.add_row(
            str(sample.rank) if sample.rank is not None else "-",
            vx,
            *([vy] if sideways else []),
            wz,
            f"{sample.total:.4g}" if sample.total is not None else "-",
            *(_cost(sample, name) for name in scored),
            escape(_rejection(sample)),
            style="bold green" if sample.index == report.plan.best else "dim" if sample.rank is None else None,
        )
    return table


def _cost(sample: SampleReport, name: str) -> str:
    if name not in sample.costs:
        return "-"
    return f"{sample.weighted[name]:.4g} ({sample.costs[name]:.4g})"


def _rejection(sample: SampleReport) -> str:
    if sample.rejected_by is None:
        return ""
    collision = sample.collision
    where = ""
    if "ahead_m" in collision:
        where = f" {collision['ahead_m']:.2f} m ahead" if collision["ahead_m"] > 0.0 else " at the robot's pose"
        if collision.get("cell"):
            where += f", cell ({collision['cell'][0]}, {collision['cell'][1]})"
    return f"{sample.rejected_by}: {sample.reason}{where}" if sample.reason else sample.rejected_by


def _velocity(value: float) -> str:
    """Three digits, without the sign of -0.000: samples of DWA can be -1e-17."""
    text = f"{value:.3f}"
    return "0.000" if text == "-0.000" else text

"""`navstack explain command`: why the robot was commanded what it was."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from navstack.explain.command import CommandExplanation, SampleAccount

SHOWN = 12
"""Rows of the table without --all."""
WIDEST = 400
"""Columns of a table that nobody looks at on a terminal."""


def command(
    run: Path = typer.Argument(..., help="The folder of a run, or its run.npz."),
    time: float | None = typer.Option(None, "--time", metavar="T", help="Second of the run; its end if left out."),
    all_: bool = typer.Option(False, "--all", help="Every sample, rejected ones too, not only the best."),
    out: Path | None = typer.Option(None, "--out", metavar="FILE", help="Picture of the fan of trajectories to write."),
    json_: bool = typer.Option(False, "--json", help="One JSON document on stdout."),
) -> None:
    """Why a velocity was commanded: who rejected which samples and where, what the others cost: the run is driven once more."""
    from navstack.cli.output import print_json
    from navstack.explain.command import explain_command
    from navstack.record import Record

    explained = explain_command(Record.load(run), time)
    document = explained.as_dict()
    if out is not None:
        document["files"] = {"picture": str(_draw(explained, out))}
    if json_:
        print_json(document)
    else:
        _print(explained, everything=all_)
        if out is not None:
            from navstack.cli.output import stdout

            stdout().print(f"picture: {out}")


def _draw(explained: CommandExplanation, out: Path) -> Path:
    from navstack.core.errors import InputError
    from navstack.explain.command import speed_of
    from navstack.plot.fan import plot_fan

    plan = explained.plan
    if explained.poses is None or explained.counts is None or plan.totals is None:
        raise InputError(
            f"{explained.planner} keeps no trajectories to draw; leave out --out", planner=explained.planner
        )
    rows = sorted(explained.samples, key=lambda sample: sample.index)
    if explained.time != explained.asked:
        asked = f" (asked for {explained.asked:.2f} s)"
    else:
        asked = ""
    return plot_fan(
        explained.costmap,
        explained.poses,
        explained.counts,
        plan.totals,
        [sample.rejected_by for sample in rows],
        out,
        best=plan.best,
        robot=explained.robot,
        footprint=explained.footprint,
        plan=plan.local_plan.poses if plan.local_plan is not None else None,
        contacts=[int(sample.where.get("step", -1)) for sample in rows],
        title=f"{explained.planner} at {explained.time:.2f} s{asked}: {speed_of(plan.command)}",
        subtitle=_short(explained.rejections),
    )


def _short(text: str, most: int = 110) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def _print(explained: CommandExplanation, *, everything: bool) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from navstack.cli.output import stdout
    from navstack.explain.command import speed_of

    out, plan = stdout(), explained.plan
    asked = f" (the last cycle until {explained.asked:.3f} s)" if explained.asked - explained.time > 1e-3 else ""
    out.print(
        f"{explained.planner} at {explained.time:.3f} s{asked}, {explained.state}, robot at ({explained.robot.x:.2f}, "
        f"{explained.robot.y:.2f}, {explained.robot.yaw:.2f}) in {escape(explained.costmap.frame)}: "
        f"{plan.mode}, {speed_of(plan.command)}"
    )
    out.print(f"[bold]{escape(explained.verdict)}[/]")
    for note in plan.notes:
        out.print(f"note: {escape(note)}")
    shown = explained.samples if everything else explained.legal[:SHOWN] or explained.samples[:SHOWN]
    if not everything and all(sample.index != plan.best for sample in shown):
        shown += tuple(sample for sample in explained.legal if sample.index == plan.best)
    if not shown:
        return
    # a critic that has nothing to say of any row shown needs no column
    scored = [n for n in plan.critics if any(s.costs.get(n) for s in shown)]
    sideways = any(sample.velocity[1] for sample in explained.samples)
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
            escape(_why(sample)),
            style="bold green" if sample.index == plan.best else "dim" if sample.rank is None else None,
        )
    _print_whole(table)
    scales = dict(zip(plan.critics, plan.scales.tolist())) if plan.scales is not None else {}
    weights = ", ".join(f"{name} {scales[name]:.4g}" for name in scored if name in scales)
    left = len(explained.samples) - len(shown)
    more = f"; {left} more with --all" if left else ""
    out.print(f"[dim]a critic's column is its weighted cost (raw); weights: {weights}{more}[/]")


def _print_whole(table: Any) -> None:
    """On a terminal as wide as that is; into a pipe or a file with every figure."""
    from rich.console import Console

    from navstack.cli.output import stdout

    out = stdout()
    (out if out.is_terminal else Console(highlight=False, width=WIDEST)).print(table)


def _cost(sample: SampleAccount, name: str) -> str:
    if name not in sample.costs:
        return "-"
    return f"{sample.weighted[name]:.4g} ({sample.costs[name]:.4g})"


def _why(sample: SampleAccount) -> str:
    if sample.rejected_by is None:
        return ""
    where = sample.where
    ahead = ""
    if "ahead_m" in where:
        ahead = f" {where['ahead_m']:.2f} m ahead" if where["ahead_m"] > 0.0 else " where it stands"
        if where.get("cell"):
            ahead += f", cell ({where['cell'][0]}, {where['cell'][1]})"
    return f"{sample.rejected_by}: {sample.reason}{ahead}" if sample.reason else sample.rejected_by


def _velocity(value: float) -> str:
    """Without the sign of what rounds to nothing: DWA's samples come within 1e-17 of zero from below."""
    text = f"{value:.3f}"
    return "0.000" if text == "-0.000" else text

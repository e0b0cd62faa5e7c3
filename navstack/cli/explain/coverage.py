"""`navstack explain coverage`: what a coverage task covered, and what stayed uncovered and why."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from navstack.cli import options
from navstack.cli.arguments import parse_point
from navstack.cli.output import print_json, print_note, stdout, titled_table
from navstack.explain import explain_coverage
from navstack.record import Record

if TYPE_CHECKING:
    from navstack.explain import CoverageReport

SHOWN = 12
"""Parts in the table."""


def coverage(
    run: options.RunFolder,
    at: Annotated[
        str | None, typer.Option("--at", metavar="X,Y", help="Only the uncovered part nearest to this point (m).")
    ] = None,
    json_: options.Json = False,
) -> None:
    """Explain which parts of a coverage task stayed uncovered and why, with the figures of the plan and of the drive."""
    point = None if at is None else parse_point(at, "--at")
    reports = explain_coverage(Record.load(run))
    if json_:
        print_json({"coverage": [report.as_dict() for report in reports]})
        return
    for report in reports:
        if point is not None:
            _print_part(report, point)
        else:
            _print(report)


def _print_part(report: CoverageReport, point: tuple[float, float]) -> None:
    part = report.left_near(*point)
    if part is None:
        stdout().print(f"{report.id}: nothing stayed uncovered", markup=False)
        return
    where = f"({part['x']:.2f}, {part['y']:.2f})"
    stdout().print(f"{report.id}: {part['area_m2']:.2f} m² at {where} stayed uncovered: {part['reason']}", markup=False)


def _print(report: CoverageReport) -> None:
    out = stdout()
    if not report.driven:
        out.print(f"{report.id}: no figures: it did not end, or it failed (navstack explain goal)", markup=False)
        return
    plan, driven = report.plan, report.driven
    table = titled_table(report.id, left=("",), right=("plan", "driven"))
    table.add_row("of what is in reach", f"{plan['share']:.1%}", f"{driven['share']:.1%}")
    table.add_row("overlap", f"{plan['overlap']:.1%}", f"{driven['overlap']:.1%}")
    table.add_row("length", f"{plan['length_m']:.1f} m", f"{driven['length_m']:.1f} m")
    table.add_row("turns", str(plan["turns"]), str(driven["turns"]))
    table.add_row("plans, time", "1", f"{report.plans}, {driven['time_s']:.0f} s")
    out.print(table)
    for reason, area in report.reasons().items():
        out.print(f"{area:.2f} m² uncovered: {reason}", markup=False)
    parts = titled_table("largest parts", left=("at", "area", "why"))
    parts.columns[2].no_wrap, parts.columns[2].overflow = False, "fold"
    for part in report.left[:SHOWN]:
        parts.add_row(f"{part['x']:.2f}, {part['y']:.2f}", f"{part['area_m2']:.2f} m²", part["reason"])
    if report.left:
        out.print(parts)
    if len(report.left) > SHOWN:
        print_note(f"and {len(report.left) - SHOWN} smaller parts; --json lists all")

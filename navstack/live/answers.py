"""Why: the texts of `navstack explain` about a running session."""

from __future__ import annotations

import io
import math
from typing import Any

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError
from navstack.explain import (
    CommandReport,
    PassageReport,
    Replay,
    explain_cell,
    explain_command,
    explain_goal,
    find_passages,
)
from navstack.explain.printing import print_cell, print_command, print_goal, print_passages
from navstack.live.session import Session
from navstack.parameters.configuration import Configuration
from navstack.record import Record

WIDTH = 100
"""Columns of the texts, as in a terminal of this width."""
NEAR_M = 2.0
"""A click this far from an opening still asks about it (m)."""


def why_cell(session: Session, x: float, y: float, costmap: str) -> str:
    """Returns why the cell at a point of the map frame (m) has its cost in the `global` or `local` costmap now."""
    report = explain_cell(Replay(None, session.explained, session.time), x, y, costmap=costmap)
    return _printed(print_cell, report)


def why_command(record: Record, time: float | None) -> str:
    """Returns why the last command until `time` (s; default: now) was chosen."""
    return _printed(print_command, explain_command(record, time))


def why_sample(record: Record, time: float | None, sample: int) -> str:
    """Returns the scores of one trajectory of a control cycle, or who rejected it and why."""
    report: CommandReport = explain_command(record, time)
    found = next((s for s in report.samples if s.index == sample), None)
    if found is None:
        raise InputError(f"the cycle at {report.time:.3f} s has no trajectory {sample}", sample=sample)
    vx, vy, wz = found.velocity
    head = f"trajectory {sample} at {report.time:.3f} s: vx {vx:.3f}, vy {vy:.3f}, wz {wz:.3f}"
    if found.rejected_by is not None:
        why = found.reason or "no reason given"
        ahead = found.collision.get("ahead_m")
        where = "" if ahead is None else f", {ahead:.2f} m ahead"
        return f"{head}\nrejected by {found.rejected_by}: {why}{where}\n\n{report.summary}"
    lines = [head, f"rank {found.rank} of {len(report.legal)}, total {found.total:.4g}"]
    width = max((len(name) for name in found.costs), default=0)
    for name, cost in found.costs.items():
        lines.append(f"  {name.ljust(width)}  {found.weighted[name]:.4g} (raw {cost:.4g})")
    if sample == report.plan.best:
        lines.append("This one was chosen.")
    return "\n".join([*lines, "", report.summary])


def what_happened(record: Record, number: int, goal_id: str | None = None) -> str:
    """Returns the timeline of a goal (from 1); `goal_id` as in `explain_goal`."""
    return _printed(print_goal, explain_goal(record, number, goal_id))


def passages_of(configuration: Configuration, grid: OccupancyGrid) -> PassageReport:
    """Returns the passages of a map for these parameters."""
    return find_passages(configuration, grid, turning_radius=0.0)  # no search for ways: a page waits


def why_passage(report: PassageReport, name: str, x: float, y: float) -> str:
    """Returns whether the robot passes the opening nearest to a point (m). Raises InputError if none is near."""
    distances = [(math.hypot(p.x - x, p.y - y), number) for number, p in enumerate(report.passages, 1)]
    nearest = min(distances, default=(math.inf, 0))
    if nearest[0] > NEAR_M:
        raise InputError(
            f"no opening between {report.narrowest:.2f} and {report.widest:.2f} m wide within {NEAR_M:g} m of "
            f"({x:.2f}, {y:.2f})"
        )
    text = io.StringIO()
    print_passages(_console(text), report, name, only=nearest[1])
    return _trimmed(text)


def _printed(print_report: Any, report: Any) -> str:
    text = io.StringIO()
    print_report(_console(text), report)
    return _trimmed(text)


def _console(text: io.StringIO) -> Any:
    from rich.console import Console

    return Console(file=text, width=WIDTH, highlight=False, soft_wrap=True, color_system=None)


def _trimmed(text: io.StringIO) -> str:
    return "\n".join(line.rstrip() for line in text.getvalue().splitlines()).strip("\n")

"""What the chain between the planner and the robot made of a command: who changed it, and why."""

from __future__ import annotations

import re
from typing import Final

from navstack.core import Twist2D
from navstack.explain.command_summary import velocity_text
from navstack.record import Record
from navstack.record.commands import RecordedCommand, recorded_command

_CLAUSE: Final = re.compile(r"; (?=(?:velocity_smoother|collision_monitor|release): )")
_LATEST_S: Final = 0.5
"""A command that reached the chain is passed on within this time (s)."""


def command_after(record: Record, time: float) -> RecordedCommand | None:
    """Return the first command that the chain passed on at `time` (s) or up to half a second later; None without a chain."""
    rows = record.command_steps
    after = rows[(rows["t"] >= time - 1e-9) & (rows["t"] <= time + _LATEST_S)]
    return recorded_command(after[0]) if len(after) else None


def chain_sentence(step: RecordedCommand) -> str:
    """Return one sentence: the command requested, what changed it and why, and the command that the robot got."""
    source = step.source or "no source"
    if not step.changed_by:
        return f"the command of {source} reached the robot unchanged"
    return (
        f"{source} requested {velocity_text(step.requested)}; the robot got {velocity_text(step.sent)} "
        f"({'; '.join(_parts(step))})"
    )


def _parts(step: RecordedCommand) -> list[str]:
    """The clauses of the reason, each with the part of the chain that made the change."""
    out: list[str] = []
    for clause in _CLAUSE.split(step.reason):
        part, _, reason = clause.partition(": ")
        if part == "velocity_smoother":
            out.append(f"{clause}: {_change(step.requested, step.smoothed)}")
        elif part == "release":
            out.append(f"velocity_smoother: {reason}")
        elif clause:
            out.append(clause)
    return out


def _change(before: Twist2D, after: Twist2D) -> str:
    return f"{velocity_text(before)} became {velocity_text(after)}"

"""Commands of a person: the last key or drag of teleop until a time of a run."""

from __future__ import annotations

from dataclasses import dataclass

from navstack.core import Twist2D
from navstack.explain.command_summary import velocity_text
from navstack.interfaces import LocalPlan
from navstack.record import Record


@dataclass(frozen=True, slots=True)
class HandCommand:
    """A command of teleop and how it stood at the requested time."""

    time: float
    """When it was given (s)."""
    is_held: bool
    """False if it had ended by then: the robot stops."""
    plan: LocalPlan
    reason: str


def driven_by_hand(record: Record, time: float) -> HandCommand | None:
    """Return the last command of a person until `time` (s); None before the first."""
    given = [
        item
        for item in record.scenario.get("interactions", ())
        if item["kind"] == "teleop" and item["time"] <= time + 1e-9
    ]
    if not given:
        return None
    last = given[-1]
    begin, until, twist = float(last["time"]), float(last["until"]), Twist2D(*map(float, last["velocity"]))
    asked = f"{velocity_text(twist)}, requested by hand at {begin:.3f} s"
    if time < until:
        return HandCommand(begin, True, LocalPlan(twist, "teleop"), f"{asked}, is held until {until:.3f} s")
    return HandCommand(
        begin, False, LocalPlan(Twist2D(), "teleop"), f"{asked}, ended at {until:.3f} s; since then the robot stops"
    )

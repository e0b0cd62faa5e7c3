"""Timeline lines of plans: first plans, new routes, and a summary of the replans between them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from navstack.core import Event
from navstack.explain.goal.report import TimelineEntry

NEW_ROUTE_M = 0.5
"""A plan that is this much longer than the previous one takes another route."""


def plan_lines(events: Sequence[Event]) -> list[TimelineEntry]:
    """Lines for the first plan, every plan after a failure and every new route; other replans share a line.

    Replans before the first failure of the controller have a line of their own; those between its failures share one.
    """
    lines: list[TimelineEntry] = []
    replans: list[Event] = []
    previous: Event | None = None
    control_fails = False
    for event in events:
        if event.kind in ("plan_failed", "recovery"):
            lines += _take(replans)
            previous, control_fails = None, False
        elif event.kind == "control_failed" and not control_fails:
            lines += _take(replans)
            control_fails = True
        if event.kind != "plan":
            continue
        if previous is None:
            lines += [*_take(replans), _line(event, _first_plan(event))]
        elif (longer := _length(event) - _length(previous)) > NEW_ROUTE_M:
            text = f"new route: {_length(event):.2f} m, {longer:.2f} m longer than the previous plan"
            lines += [*_take(replans), _line(event, text)]
        else:
            replans.append(event)
        previous = event
    return lines + _take(replans)


def _length(plan: Event) -> float:
    return float(plan.data.get("length_m", math.nan))


def _line(plan: Event, text: str) -> TimelineEntry:
    return TimelineEntry(plan.time, plan.time, "plan", text, data=dict(plan.data))


def _take(replans: list[Event]) -> list[TimelineEntry]:
    """The line of the replans, which are removed from the list; empty without any."""
    if not replans:
        return []
    first, last, count = replans[0], replans[-1], len(replans)
    replans.clear()
    if count == 1:
        text = f"replanned: {_length(first):.2f} m"
    else:
        text = f"replanned {count} times: from {_length(first):.2f} m to {_length(last):.2f} m"
    return [TimelineEntry(first.time, last.time, "plan", text, count)]


def _first_plan(event: Event) -> str:
    text = f"plan found: {_length(event):.2f} m"
    expanded = event.data.get("cells_expanded")
    if expanded:
        text += f" ({expanded:,} cells expanded)"
    moved = float(event.data.get("goal_moved_m", 0.0))
    if moved > 0.0:
        text += f"; it ends {moved:.2f} m from the goal"
    notes = event.data.get("notes") or ()
    return text + "".join(f"; {note}" for note in notes)

"""Timeline lines of failures: consecutive failures of one kind share a line, with the event that they caused."""

from __future__ import annotations

from collections.abc import Container, Sequence

from navstack.core import Event
from navstack.explain.goal.report import TERMINAL, TimelineEntry
from navstack.explain.goal.summary import times_text
from navstack.record import Record

NO_PROGRESS = "FAILED_TO_MAKE_PROGRESS"
_CONSEQUENCES = {
    "PLANNING_EXHAUSTED": ("planner patience exhausted", ("planner_patience", "max_planning_retries")),
    "CONTROL_EXHAUSTED": ("controller patience exhausted", ("controller_patience",)),
    "OSCILLATING": ("oscillation timeout reached", ("oscillation_timeout", "oscillation_distance")),
}
"""Meaning of the state machine's events, and the parameters that decide them."""


def failure_lines(record: Record, events: Sequence[Event]) -> list[TimelineEntry]:
    """Lines of failed planning requests and control cycles, in order."""
    lines: list[TimelineEntry] = []
    group: list[Event] = []
    known: set[str] = set()

    def close(consequence: str = "") -> None:
        if group:
            lines.append(_line(group, consequence, known))
            known.add(group[-1].text)
            group.clear()

    for event in events:
        if event.kind in ("plan_failed", "control_failed"):
            if group and (event.kind, event.data.get("name")) != (group[-1].kind, group[-1].data.get("name")):
                close()
            group.append(event)
        elif event.kind == "plan":
            # a plan ends a series of planning failures only: replanning continues while control fails
            if group and group[-1].kind == "plan_failed":
                close()
        elif event.kind == "state" and event.data.get("event") in _CONSEQUENCES:
            close(_consequence(record, event))
        elif event.kind == "recovery" or (event.kind == "status" and event.data["status"] in TERMINAL):
            close()
    close()
    return lines


def _consequence(record: Record, event: Event) -> str:
    what, names = _CONSEQUENCES[event.data["event"]]
    parameters = record.scenario.get("parameters")
    values = parameters if isinstance(parameters, dict) else {}
    known = [f"{name} {values[name]:g}" for name in names if isinstance(values.get(name), (int, float))]
    return what + (f" ({', '.join(known)})" if known else "")


def _line(group: Sequence[Event], consequence: str, known: Container[str]) -> TimelineEntry:
    """The line of a group of failures; a message in `known` is not repeated."""
    first, last = group[0], group[-1]
    name, code = last.data.get("name", "UNKNOWN"), last.data.get("code")
    what = "planning failed" if last.kind == "plan_failed" else "control failed"
    if len(group) > 1:
        what += f" {times_text(len(group))}"
    if name == NO_PROGRESS:
        what = "no progress"
    kind = f"{name} ({code})" if code is not None else str(name)
    text = f"{what}: {kind}" + (", as before" if last.text in known else f": {last.text}")
    if consequence:
        text += f"; {consequence}"
    return TimelineEntry(first.time, last.time, last.kind, text, len(group), dict(last.data))

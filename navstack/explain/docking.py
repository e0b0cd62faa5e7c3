"""What happened in a docking: the states of each attempt, how far the robot came, what it saw; from the record alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from navstack.record import Record


@dataclass(frozen=True, slots=True)
class DockingLine:
    """One stay in a state of docking, in a sentence."""

    begin: float
    """s."""
    end: float
    text: str
    data: Mapping[str, Any] = field(default_factory=dict[str, Any])


@dataclass(slots=True)
class DockingsOfRun:
    """The dockings among the goals of a record."""

    hidden: set[str] = field(default_factory=set[str])
    """Ids of goals and motions that are parts of a docking, or that were resumed under another id."""
    lines: dict[str, list[DockingLine]] = field(default_factory=dict[str, list[DockingLine]])
    """Id of a goal or motion -> the lines of its docking, or of the charging that interrupted it."""


def dockings_of(record: Record) -> DockingsOfRun:
    """Return the dockings of a record. A docking is reported as its last part, an interrupted goal as the resumed one."""
    found = DockingsOfRun()
    interrupted = ""
    errand: list[DockingLine] = []
    resumes = False
    known: set[str] = set()
    for event in record.events:
        data = event.data
        if event.kind == "status" and "id" in data:
            name = str(data["id"])
            if resumes and name not in known:
                found.lines[name], errand, resumes = errand, [], False
            known.add(name)
        if event.kind != "docking":
            continue
        if "interrupted" in data:
            interrupted = str(data["interrupted"])
            errand.append(DockingLine(event.time, event.time, event.text, data))
        elif "parts" in data:
            parts = [str(part) for part in data["parts"]]
            lines = [_line(visit) for visit in data.get("states", ())]
            if not data.get("errand"):
                found.hidden.update(parts[:-1])
                found.lines.update(dict.fromkeys(parts[-1:], lines))
                continue
            found.hidden.update(parts)
            errand += [*lines, DockingLine(event.time, event.time, event.text)]
            if data.get("status") != "SUCCEEDED":
                found.lines[interrupted], errand = errand, []
            elif data.get("kind") == "undock":
                found.hidden.add(interrupted)
                resumes = True
    return found


def _line(visit: Mapping[str, Any]) -> DockingLine:
    text = f"{visit['state']}, attempt {visit['attempt']}"
    distance = visit.get("distance_m")
    if isinstance(distance, (int, float)):
        text += f": ended {distance:.2f} m from the dock"
    if visit.get("seen"):
        text += f"; {visit['seen']}"
    if visit.get("error_code"):
        text += f"; failed with {visit['error_code']}: {visit['message']}"
    return DockingLine(float(visit["begin"]), float(visit["end"]), text, visit)

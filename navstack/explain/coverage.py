"""What a coverage task of a run covered, and what stayed uncovered and why, from the record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from navstack.core import RecordError
from navstack.record import Record


@dataclass(frozen=True, slots=True)
class CoverageReport:
    """A coverage task of a run. The figures are those of the believed track, with which the robot decided."""

    id: str
    begin: float
    """Time of its first step (s)."""
    end: float | None
    """Time of its end (s); None if the record ends before."""
    plan: dict[str, Any]
    """Figures of the first plan, see `navstack.coverage.CoverageFigures`; empty without an end."""
    driven: dict[str, Any]
    left: tuple[dict[str, Any], ...]
    """Parts that stayed uncovered: x, y (m), area_m2 and reason; the largest first."""
    plans: int
    """Number of plans: more than one if obstacles were in the way."""
    segments: int
    """Number of segments of the first plan."""

    def as_dict(self) -> dict[str, Any]:
        """Return the report as JSON data."""
        return {
            "id": self.id,
            "begin_s": self.begin,
            "end_s": self.end,
            "plan": self.plan,
            "driven": self.driven,
            "left": list(self.left),
            "plans": self.plans,
            "segments": self.segments,
        }

    def reasons(self) -> dict[str, float]:
        """Return the area (m²) that stayed uncovered for each reason, the largest first."""
        areas: dict[str, float] = {}
        for part in self.left:
            areas[part["reason"]] = areas.get(part["reason"], 0.0) + part["area_m2"]
        return dict(sorted(areas.items(), key=lambda item: -item[1]))

    def left_near(self, x: float, y: float) -> dict[str, Any] | None:
        """Return the uncovered part whose middle is nearest to a point (m); None if nothing is uncovered."""
        if not self.left:
            return None
        away = [float(np.hypot(part["x"] - x, part["y"] - y)) for part in self.left]
        return self.left[int(np.argmin(away))]


def explain_coverage(record: Record) -> tuple[CoverageReport, ...]:
    """Return a report for every coverage task of a run. Raises RecordError if there is none."""
    ends = {e.data["id"]: e for e in record.events if e.kind == "motion" and "id" in e.data and "cover" not in e.data}
    reports: list[CoverageReport] = []
    for event in record.events:
        if event.kind != "motion" or "cover" not in event.data:
            continue
        id = event.data["id"]
        end = ends.get(id)
        data = {} if end is None else end.data
        reports.append(
            CoverageReport(
                id,
                event.time,
                None if end is None else end.time,
                data.get("plan", {}),
                data.get("driven", {}),
                tuple(data.get("left", ())),
                int(data.get("plans", 1)),
                len(event.data.get("segments", ())),
            )
        )
    if not reports:
        raise RecordError("the run has no coverage task; record one with: navstack cover MAP --drive")
    return tuple(reports)

"""The velocity samples of a control cycle, ranked by cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from navstack.interfaces import LocalPlan, RejectionDetail


@dataclass(frozen=True, slots=True)
class SampleReport:
    """One velocity sample with its scores."""

    index: int
    """Row in the planner's table."""
    rank: int | None
    """Rank by total cost among the legal samples, from 1; None for a rejected sample."""
    velocity: tuple[float, float, float]
    """vx, vy (m/s), wz (rad/s)."""
    total: float | None
    """Weighted sum of the costs; None for a rejected sample."""
    rejected_by: str | None
    """Name of the critic, or `limits` for a velocity outside the limits; None for a legal sample."""
    reason: str = ""
    costs: dict[str, float] = field(default_factory=dict[str, float])
    """Raw cost of each critic that scored the sample."""
    weighted: dict[str, float] = field(default_factory=dict[str, float])
    """Raw costs times the scales of the critics; their sum is the total."""
    collision: dict[str, Any] = field(default_factory=dict[str, Any])
    """step, pose, ahead_m, cell and cost of a collision; empty without one."""

    def as_dict(self) -> dict[str, Any]:
        """Returns the sample for JSON."""
        return {
            "index": self.index,
            "rank": self.rank,
            "velocity": list(self.velocity),
            "total": self.total,
            "rejected_by": self.rejected_by,
            "reason": self.reason,
            "costs": self.costs,
            "weighted": self.weighted,
            **self.collision,
        }


def rank_samples(
    plan: LocalPlan, rejections: Sequence[tuple[str | None, RejectionDetail]] | None
) -> tuple[SampleReport, ...]:
    """Legal samples by total cost, then rejected ones by row.

    `rejections`: see `ControlDiagnostics.samples`; None for a planner without diagnostics.
    """
    if plan.samples is None or plan.totals is None:
        return ()
    details = rejections or _from_table(plan)
    k = len(plan.samples)
    legal = np.array([rejected_by is None for rejected_by, _ in details], np.bool_)
    order = np.lexsort((np.arange(k), np.where(legal, plan.totals, np.inf)))
    return tuple(_sample(plan, row, place, *details[row]) for place, row in enumerate(order.tolist(), 1))


def _from_table(plan: LocalPlan) -> list[tuple[str | None, RejectionDetail]]:
    """The rejections as far as the table has them."""
    assert plan.samples is not None
    by: list[int] = plan.rejected_by.tolist() if plan.rejected_by is not None else [-1] * len(plan.samples)
    names = {-1: None, -2: "limits"}
    return [(names[b] if b in names else plan.critics[b], RejectionDetail()) for b in by]


def _sample(plan: LocalPlan, row: int, place: int, rejected_by: str | None, detail: RejectionDetail) -> SampleReport:
    assert plan.samples is not None
    assert plan.totals is not None
    costs: dict[str, float] = {}
    weighted: dict[str, float] = {}
    if plan.costs is not None and plan.scales is not None:
        for name, cost, scale in zip(plan.critics, plan.costs[row].tolist(), plan.scales.tolist()):
            if np.isfinite(cost):
                costs[name], weighted[name] = cost, cost * scale
    vx, vy, wz = plan.samples[row].tolist()
    legal = rejected_by is None
    return SampleReport(
        index=row,
        rank=place if legal else None,
        velocity=(vx, vy, wz),
        total=float(plan.totals[row]) if legal else None,
        rejected_by=rejected_by,
        reason=detail.reason,
        costs=costs,
        weighted=weighted,
        collision={key: value for key, value in detail.as_dict().items() if key != "reason"},
    )

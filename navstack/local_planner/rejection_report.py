"""Why velocity samples were rejected: a sentence, and details per sample."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.interfaces import Critic, RejectionDetail
from navstack.local_planner._scoring_kernels import OUTSIDE_LIMITS
from navstack.local_planner.scoring import ScoreTable

SPEED_LIMITS = "too slow or too fast"
"""Reason for samples that were not simulated."""


def count_rejections(table: ScoreTable, critics: Sequence[Critic]) -> dict[str, int]:
    """Number of samples rejected by each critic and by the speed limits, highest first."""
    counted = {critic.name: int((table.rejected_by == i).sum()) for i, critic in enumerate(critics)}
    counted[SPEED_LIMITS] = int((table.rejected_by == OUTSIDE_LIMITS).sum())
    return {name: n for name, n in sorted(counted.items(), key=lambda item: -item[1]) if n}


def rejection_report(
    table: ScoreTable, critics: Sequence[Critic], samples: NDArray[np.float64]
) -> tuple[str, dict[str, Any]]:
    """Sentence and data of a NoValidControlError. `samples` (K, 3): the velocity samples."""
    counted = count_rejections(table, critics)
    data: dict[str, Any] = {"samples": len(table.totals), "rejected": counted}
    parts: list[str] = []
    for name, number in counted.items():
        words = ""
        index = next((i for i, critic in enumerate(critics) if critic.name == name), None)
        if index is not None:
            critic, rows = critics[index], np.flatnonzero(table.rejected_by == index)
            row = critic.nearest_rejection(rows)
            detail = critic.explain(row)
            words = _describe(detail) or _reasons(critic, table.totals[rows])
            if detail.step is not None:
                place = detail.as_dict()
                del place["reason"]
                data["collision"] = {**place, "sample": samples[row].tolist()}
        parts.append(f"{number} {name} ({words})" if words else f"{number} {name}")
    total = f"{sum(counted.values())} of {len(table.totals)} rejected"
    return f"{total}: {', '.join(parts)}" if parts else total, data


def rejection_details(table: ScoreTable, critics: Sequence[Critic]) -> tuple[tuple[str | None, RejectionDetail], ...]:
    """For each sample the critic that rejected it (`limits`: not simulated, None: legal) and why."""
    details: list[tuple[str | None, RejectionDetail]] = []
    for row, (by, total) in enumerate(zip(table.rejected_by.tolist(), table.totals.tolist())):
        if by == -1:
            details.append((None, RejectionDetail()))
        elif by == OUTSIDE_LIMITS:
            details.append(("limits", RejectionDetail(SPEED_LIMITS)))
        else:
            critic = critics[by]
            detail = critic.explain(row)
            if not detail.reason and np.isfinite(total):
                detail = RejectionDetail(critic.CODES.get(int(total), ""))
            details.append((critic.name, detail))
    return tuple(details)


def _describe(detail: RejectionDetail) -> str:
    if detail.ahead_m is None:
        return detail.reason
    return (
        f"{detail.reason} {detail.ahead_m:.2f} m ahead"
        if detail.ahead_m > 0.0
        else f"{detail.reason} at its current pose"
    )


def _reasons(critic: Critic, totals: NDArray[np.float64]) -> str:
    codes = sorted({int(code) for code in totals[np.isfinite(totals)]})
    return "; ".join(critic.CODES[code] for code in codes if code in critic.CODES)

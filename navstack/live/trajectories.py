"""The trajectories of the last control cycle as a page draws them: coloured by score, the rejected ones apart."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from navstack.interfaces import LocalPlanner
from navstack.live.frame import Frame

POINTS: Final = 6
"""Points per trajectory."""
MAX_ROWS: Final = 500
"""More samples than this are thinned out."""


def trajectories_of(planner: LocalPlanner, frame: Frame) -> dict[str, Any] | None:
    """Returns the entry of the header: rows in the local costmap's frame; None for a planner without rollouts.

    The blob `points` has (rows, POINTS, 2) i2: centimetres relative to `origin`; `scores` (rows,) f4, NaN for rejected rows;
    `samples` (rows,) u2: the row's number in the table of the cycle.
    """
    details = planner.diagnostics()
    if details is None or details.plan.totals is None:
        return None
    rollouts, plan = details.rollouts, details.plan
    rows = np.flatnonzero(rollouts.counts > 0)
    best = plan.best
    if len(rows) > MAX_ROWS:
        rows = rows[:: -(-len(rows) // MAX_ROWS)]
        if best >= 0 and best not in rows:
            rows = np.append(rows, best)
    if not len(rows):
        return None
    steps = np.linspace(0.0, 1.0, POINTS)
    last = rollouts.counts[rows] - 1
    index = np.rint(steps[None, :] * last[:, None]).astype(np.int64)
    points = rollouts.poses[rows[:, None], index, :2]
    origin = points[0, 0]
    totals = details.plan.totals[rows]
    rejected = plan.rejected_by[rows] != -1 if plan.rejected_by is not None else totals < 0.0
    scores = np.where(rejected, np.nan, totals).astype("<f4")
    return {
        "origin": [float(origin[0]), float(origin[1])],
        "rows": len(rows),
        "points": POINTS,
        "best": int(np.flatnonzero(rows == best)[0]) if best >= 0 and best in rows else -1,
        "blob": frame.blob(np.clip(np.rint((points - origin) * 100.0), -32767, 32767).astype("<i2")),
        "scores": frame.blob(scores),
        "samples": frame.blob(rows.astype("<u2")),
    }

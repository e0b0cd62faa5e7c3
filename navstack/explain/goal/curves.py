"""Curves over time: distance to the goal and remaining length of the plan."""

from __future__ import annotations

import math
from collections.abc import Container

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.record import Record


def cycles(record: Record, accepted: float | None, ended: float) -> tuple[NDArray[np.float64], slice]:
    """Times (n,) of the control cycles of a goal, and their rows in the record."""
    times = record.times
    if accepted is None:
        return times[:0], slice(0, 0)
    first, end = int(np.searchsorted(times, accepted)), int(np.searchsorted(times, ended, side="right"))
    return times[first:end], slice(first, end)


def distance_to(poses: NDArray[np.float64], goal: Pose2D | None) -> NDArray[np.float64]:
    """(n,) straight-line distances from poses (n, 3) to the goal (m); NaN without a goal."""
    if goal is None:
        return np.full(len(poses), np.nan)
    return np.hypot(poses[:, 0] - goal.x, poses[:, 1] - goal.y)


def remaining_length(
    record: Record, times: NDArray[np.float64], rows: slice, plan_times: Container[float]
) -> NDArray[np.float64]:
    """(n,) length of the current plan from the point nearest to the robot, plus the distance to that point (m).

    `plan_times`: times of the goal's plans; other plans of the record are ignored. The record stores plans by time, and
    the next goal can have its first plan at the time at which this goal ends.
    """
    remaining = np.full(len(times), np.nan)
    at = record.poses[rows]
    plans = [p for p in record.plans if p.t in plan_times]
    ends = [*(p.t for p in plans), math.inf][1:]
    for plan, end in zip(plans, ends, strict=False):
        points = plan.poses[:, :2]
        if plan.frame == record.local_frame != record.global_frame:
            points = record.to_global(plan.frame, plan.t).apply_points(points)
        mine = np.flatnonzero((times >= plan.t) & (times < end))
        if not len(mine) or not len(points):
            continue
        to_go = np.concatenate((np.cumsum(np.hypot(*np.diff(points, axis=0).T)[::-1])[::-1], [0.0]))
        away = np.hypot(at[mine, None, 0] - points[None, :, 0], at[mine, None, 1] - points[None, :, 1])
        nearest = away.argmin(axis=1)
        remaining[mine] = away[np.arange(len(mine)), nearest] + to_go[nearest]
    return remaining

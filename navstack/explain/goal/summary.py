"""The outcome of a goal in one sentence."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
from numpy.typing import NDArray

from navstack.core import angle_between
from navstack.explain.goal.report import GoalReport


def summary_of(report: GoalReport, poses: NDArray[np.float64]) -> str:
    """The sentence for a goal; `poses` (n, 3) are those of its control cycles."""
    driven = float(np.hypot(*np.diff(poses[:, :2], axis=0).T).sum()) if len(poses) > 1 else 0.0
    if report.status == "SUCCEEDED":
        return _success(report, poses, driven)
    if not report.ended_in_record:
        return f"{report.status} when the record ends, after {report.duration:.1f} s and {driven:.2f} m"
    return _failure(report, driven)


def _success(report: GoalReport, poses: NDArray[np.float64], driven: float) -> str:
    text = f"reached after {report.duration:.1f} s, {driven:.2f} m driven"
    if report.pose is not None and len(poses):
        off = math.degrees(abs(angle_between(float(poses[-1, 2]), report.pose.yaw)))
        text += f", {report.distance[-1]:.2f} m and {off:.0f} degrees from the goal"
    if len(report.plan_lengths):
        text += f"; first plan {report.plan_lengths[0]:.2f} m"
    return "; ".join([text, *_problems(report)])


def _failure(report: GoalReport, driven: float) -> str:
    text = f"{report.status} after {report.duration:.1f} s and {driven:.2f} m"
    if len(report.distance) and math.isfinite(report.distance[-1]):
        text += f", {report.distance[-1]:.2f} m from the goal"
    if report.expired_limit_s is not None:
        text += f": time limit of {report.expired_limit_s:g} s exceeded"
    elif report.error_name == "CANCELED":
        text += ": cancelled"
    elif report.error_name == "REPLACED":
        text += ": replaced by another goal"
    elif report.error_code:
        text += f": {report.error_name} ({report.error_code})"
    return "; ".join([text, *_problems(report)])


def times_text(count: int) -> str:
    """`once`, `3 times`."""
    return "once" if count == 1 else f"{count} times"


def _problems(report: GoalReport) -> list[str]:
    """Failures and recoveries during the goal."""
    parts: list[str] = []
    for failures, what in ((report.failed_plans, "planning"), (report.failed_commands, "control")):
        if failures:
            counted = Counter(name for _, name in failures).most_common()
            names = ", ".join(f"{n} {name}" if len(counted) > 1 else name for name, n in counted)
            parts.append(f"{what} failed {times_text(len(failures))} ({names})")
    if report.recoveries:
        names = ", ".join(recovery.name for recovery in report.recoveries)
        many = len(report.recoveries)
        parts.append(f"{many} recover{'y' if many == 1 else 'ies'} ({names})")
    return parts

"""The timeline of a goal in words. Events that repeat share a line."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from navstack.core import Event
from navstack.explain.goal.believed_pose import believed_lines
from navstack.explain.goal.failures import NO_PROGRESS, failure_lines
from navstack.explain.goal.plans import plan_lines
from navstack.explain.goal.report import GoalReport, RecoveryRun, TimelineEntry
from navstack.explain.goal.summary import times_text
from navstack.record import Record

STUCK_S = 3.0
"""A robot in CONTROLLING that moves less than `STUCK_M` for this time is reported as stuck."""
STUCK_M = 0.1
_REDUNDANT = ("Got new plan", "Goal reached", "Aborting because")
"""Beginnings of messages that other lines replace."""
_ORDER = (
    "goal",
    "info",
    "cancel",
    "plan_failed",
    "control_failed",
    "recovery",
    "warning",
    "plan",
    "lost",
    "stuck",
    "collision",
)
"""Order of lines that begin at the same time."""


def timeline_of(
    record: Record, report: GoalReport, events: Sequence[Event], poses: NDArray[np.float64]
) -> tuple[TimelineEntry, ...]:
    """All lines by time; `poses` (n, 3) are those of the goal's control cycles."""
    lines = [_sent(record, report)]
    lines += _cancels(report, events)
    lines += plan_lines(events)
    lines += failure_lines(record, events)
    lines += [_recovery(record, recovery) for recovery in report.recoveries]
    lines += _stuck(report, poses)
    lines += _collisions(record, report)
    lines += believed_lines(record, report)
    lines += [
        TimelineEntry(event.time, event.time, event.kind, event.text, data=dict(event.data))
        for event in events
        if event.kind in ("warning", "info") and not event.text.startswith(_REDUNDANT)
    ]
    lines.sort(key=lambda line: (line.begin, _ORDER.index(line.kind)))
    return (*lines, _end(report))


def _sent(record: Record, report: GoalReport) -> TimelineEntry:
    text = f"{report.id} sent"
    if report.pose is not None:
        x, y, yaw = report.pose
        text = f"{report.id} sent: ({x:.2f}, {y:.2f}, {yaw:.2f}) in {record.global_frame}"
    if report.accepted is not None and report.accepted > report.sent:
        text += f", accepted at {report.accepted:.1f} s"
    if report.accepted is not None and len(report.times):
        at = record.pose_at(report.accepted)
        text += f"; robot at ({at.x:.2f}, {at.y:.2f})"
        if report.pose is not None:
            text += f", {at.distance_to(report.pose):.2f} m from the goal"
    return TimelineEntry(report.sent, report.sent, "goal", text)


def _cancels(report: GoalReport, events: Iterable[Event]) -> list[TimelineEntry]:
    requests = [e for e in events if e.kind == "status" and e.data["status"] in ("PREEMPTING", "RECALLING")]
    limit = report.expired_limit_s
    text = "cancel requested" if limit is None else f"the time limit of {limit:g} s expired: the run ends the goal"
    return [TimelineEntry(e.time, e.time, "cancel", text) for e in requests]


def _recovery(record: Record, recovery: RecoveryRun) -> TimelineEntry:
    what = f"recovery {recovery.number} of {recovery.total}, {recovery.name}"
    if recovery.type:
        what += f" ({recovery.type})"
    text = f"{what}: {_recovery_outcome(recovery)}"
    if len(record.times):
        moved = record.pose_at(recovery.begin).distance_to(record.pose_at(recovery.end))
        if moved > 0.02:
            text += f"; the robot moved {moved:.2f} m"
    return TimelineEntry(recovery.begin, recovery.end, "recovery", text, data=recovery.as_dict())


def _recovery_outcome(recovery: RecoveryRun) -> str:
    duration = f"{recovery.end - recovery.begin:.1f} s"
    if recovery.outcome == "running":
        return f"interrupted after {duration}"
    if recovery.outcome == "failed":
        return f"failed after {duration}: {recovery.text}"
    if recovery.cleared is None:
        return f"done after {duration}: {recovery.text}"
    if recovery.cleared == 0:
        return f"no cells to clear: {recovery.text}"
    return f"cleared {recovery.cleared} cells in {duration}: {recovery.text}"


def _stuck(report: GoalReport, poses: NDArray[np.float64]) -> list[TimelineEntry]:
    """The parts of CONTROLLING in which the robot hardly moved."""
    lines: list[TimelineEntry] = []
    for span in report.spans:
        if span.state != "CONTROLLING" or span.end - span.begin < STUCK_S:
            continue
        k = int(np.searchsorted(report.times, span.begin))
        end = int(np.searchsorted(report.times, span.end, side="right"))
        while k < end:
            away = np.hypot(poses[k:end, 0] - poses[k, 0], poses[k:end, 1] - poses[k, 1]) > STUCK_M
            stop = k + int(away.argmax()) if away.any() else end
            begun, over = float(report.times[k]), float(report.times[stop - 1])
            if over - begun >= STUCK_S:
                lines.append(_stuck_line(poses[k:stop], report, begun, over))
                k = stop
            else:
                k += 1
    return lines


def _stuck_line(at: NDArray[np.float64], report: GoalReport, begin: float, end: float) -> TimelineEntry:
    turned = float(np.abs(np.diff(np.unwrap(at[:, 2]))).sum())
    what = f"turned {math.degrees(turned):.0f} degrees in place" if turned > 0.5 else "did not move"
    text = f"the robot {what} for {end - begin:.1f} s at ({at[0, 0]:.2f}, {at[0, 1]:.2f})"
    failed = sum(begin <= t <= end and name != NO_PROGRESS for t, name in report.failed_commands)
    if failed:
        text += f"; control failed {times_text(failed)}"
    return TimelineEntry(begin, end, "stuck", text, data={"turned_rad": turned, "failed_commands": failed})


def _collisions(record: Record, report: GoalReport) -> list[TimelineEntry]:
    if report.accepted is None:
        return []
    return [
        TimelineEntry(float(t), float(t), "collision", f"collision at ({x:.2f}, {y:.2f})")
        for t, (x, y) in zip(record.collision_times, record.collisions[:, :2], strict=True)
        if report.accepted <= t <= report.ended
    ]


def _end(report: GoalReport) -> TimelineEntry:
    if not report.ended_in_record:
        return TimelineEntry(report.ended, report.ended, "end", f"the record ends while the goal is {report.status}")
    text = report.status + (f': "{report.text}"' if report.text else "")
    if report.error_code and report.error_name not in ("CANCELED", "REPLACED"):
        text += f" Error {report.error_name} ({report.error_code}): {report.message}"
    elif report.expired_limit_s is not None:
        text += f" The time limit of {report.expired_limit_s:g} s was exceeded."
    elif report.message:
        text += f" {report.message}"
    return TimelineEntry(report.ended, report.ended, "end", text)

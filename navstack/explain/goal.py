"""What happened to a goal and why: a report with a timeline in words, from the record alone. Times in seconds of the run."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    Costmap,
    Event,
    InputError,
    Pose2D,
    RecordError,
    angle_between,
    nearest_lethal,
    touches_lethal,
)
from navstack.explain.docking import dockings_of
from navstack.move_base import GoalTimeLimitError
from navstack.record import STALL_S, Record, Stall, believed_poses, find_stalls

TERMINAL = ("PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "RECALLED")
"""Terminal states of a goal in actionlib."""


@dataclass(frozen=True, slots=True)
class StateSpan:
    """A time span in one state of the goal manager."""

    state: str
    begin: float
    end: float


@dataclass(slots=True)
class RecoveryRun:
    """One execution of a recovery behavior."""

    name: str
    type: str
    """Class of the plugin; empty in old records."""
    number: int
    """Position in the list of recovery behaviors, or among those of the goal that its behavior tree ran; from 1."""
    total: int
    """Length of the list; 0 with a behavior tree."""
    trigger: str
    """PLANNING_R, CONTROLLING_R, OSCILLATION_R or LOST_R."""
    begin: float
    end: float
    outcome: str = "running"
    """done, failed, or running if it was interrupted."""
    text: str = ""
    """Final message."""
    cleared: int | None = None
    """Number of cleared cells; None for behaviors that clear nothing."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class TimelineEntry:
    """One line of the timeline; repeated events share a line."""

    begin: float
    end: float
    kind: str
    """task, goal, plan, plan_failed, control_failed, recovery, docking, lost, stuck, collision, warning, info, cancel or end."""
    text: str
    count: int = 1
    """Number of events that the line stands for."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return {name: getattr(self, name) for name in ("begin", "end", "kind", "text", "count", "data")}


@dataclass(frozen=True, slots=True, eq=False)
class GoalReport:
    """A goal from its arrival to its terminal state."""

    number: int
    """Position among the goals of the run, from 1."""
    id: str
    pose: Pose2D | None
    """Goal pose in the global frame; None if it could not be transformed."""
    sent: float
    accepted: float | None
    """None for a goal that was canceled or replaced before it became active."""
    ended: float
    """Time of the terminal state; the end of the record for a goal without one."""
    status: str
    """Last goal state in the record, as in actionlib."""
    text: str
    """Status text, as in C++."""
    error_code: int
    error_name: str
    message: str
    summary: str
    """The outcome in one sentence."""
    spans: tuple[StateSpan, ...]
    recoveries: tuple[RecoveryRun, ...]
    timeline: tuple[TimelineEntry, ...]
    plan_times: NDArray[np.float64]
    """(p,) times of the plans found."""
    plan_lengths: NDArray[np.float64]
    """(p,) lengths of these plans (m)."""
    failed_plans: tuple[tuple[float, str], ...]
    """Time and error name of each failed planning request."""
    failed_commands: tuple[tuple[float, str], ...]
    """Time and error name of each control cycle without a command."""
    times: NDArray[np.float64]
    """(n,) times of the control cycles."""
    distance: NDArray[np.float64]
    """(n,) straight-line distance to the goal (m); NaN if the goal pose is unknown."""
    remaining: NDArray[np.float64]
    """(n,) remaining length of the current plan (m); NaN without a plan."""
    velocity: NDArray[np.float64]
    """(n, 3) vx, vy (m/s), wz (rad/s) from odometry."""
    expired_limit_s: float | None = None
    """Time limit (s) if the goal ended because it had expired; None otherwise."""

    @property
    def duration(self) -> float:
        """Time from arrival to terminal state (s)."""
        return self.ended - self.sent

    @property
    def ended_in_record(self) -> bool:
        """True if the record contains the terminal state."""
        return self.status in TERMINAL

    def seconds(self, state: str) -> float:
        """Total time in a state (s)."""
        return sum(span.end - span.begin for span in self.spans if span.state == state)

    def as_dict(self) -> dict[str, Any]:
        """Return the report for JSON, without the curves, which the record contains."""
        return {
            "number": self.number,
            "id": self.id,
            "goal": None if self.pose is None else list(self.pose),
            "sent": self.sent,
            "accepted": self.accepted,
            "ended": self.ended,
            "status": self.status,
            "text": self.text,
            "error_code": self.error_code,
            "error_name": self.error_name,
            "message": self.message,
            "expired_limit_s": self.expired_limit_s,
            "summary": self.summary,
            "states": [{"state": s.state, "begin": s.begin, "end": s.end} for s in self.spans],
            "seconds": {s: self.seconds(s) for s in dict.fromkeys(span.state for span in self.spans)},
            "recoveries": [recovery.as_dict() for recovery in self.recoveries],
            "plans": [{"time": t, "length_m": m} for t, m in zip(self.plan_times.tolist(), self.plan_lengths.tolist())],
            "failures": dict(Counter(name for _, name in self.failed_plans + self.failed_commands)),
            "timeline": [entry.as_dict() for entry in self.timeline],
        }


# --- events of a goal -------------------------------------------------------------------------------------------------


def last_time(record: Record) -> float:
    """Return the time of the last sample or event (s)."""
    return max([float(t) for t in record.times[-1:]] + [e.time for e in record.events[-1:]])


def events_of(record: Record, goal_id: str) -> list[Event]:
    """Return the events from the acceptance of a goal to its end, and all of its status events, in order."""
    found: list[Event] = []
    active = False
    for event in record.events:
        mine = event.kind == "status" and event.data.get("id") == goal_id
        if mine and event.data["status"] in ("ACTIVE", "PREEMPTING"):
            active = True
        if mine or (active and event.kind != "status"):
            found.append(event)
        if mine and event.data["status"] in TERMINAL:
            break
    return found


def goal_pose(record: Record, events: Iterable[Event], number: int) -> Pose2D | None:
    """Return the goal in the global frame; None if it is unknown or not finite."""
    pose: Pose2D | None = None
    for event in events:
        if event.kind == "goal" and event.data.get("frame") == record.global_frame:
            pose = Pose2D(*(float(v) for v in event.data["pose"]))
        elif event.kind == "info" and "goal_pose" in event.data:
            pose = Pose2D(*(float(v) for v in event.data["goal_pose"]))
    if pose is None and number <= len(record.goals):
        x, y, yaw = (float(v) for v in record.goals[number - 1])
        pose = Pose2D(x, y, yaw)
    return pose if pose is not None and pose.is_finite() else None


def state_spans(
    record: Record, events: Sequence[Event], accepted: float | None, ended: float, goal_id: str
) -> tuple[StateSpan, ...]:
    """Return the states of the goal manager from acceptance to end, without gaps."""
    if accepted is None:
        return ()
    state = _state_at_acceptance(record, goal_id)
    spans: list[StateSpan] = []
    begin = accepted
    for event in (e for e in events if e.kind == "state"):
        if event.time > begin:
            spans.append(StateSpan(state, begin, event.time))
        state, begin = str(event.data["to"]), event.time
    if ended > begin and state != "IDLE":
        spans.append(StateSpan(state, begin, ended))
    return tuple(spans)


def _state_at_acceptance(record: Record, goal_id: str) -> str:
    """Return a goal that replaces another one begins in the state of that goal."""
    state = "IDLE"
    for event in record.events:
        if event.kind == "status" and event.data.get("id") == goal_id and event.data["status"] == "ACTIVE":
            break
        if event.kind == "state":
            state = str(event.data["to"])
    return state


def recovery_runs(events: Iterable[Event], ended: float) -> tuple[RecoveryRun, ...]:
    """Return the executions of recovery behaviors; one that never ended ends with the goal."""
    found: list[RecoveryRun] = []
    running: RecoveryRun | None = None
    for event in events:
        if event.kind == "state" and running is not None and event.data["to"] != "CLEARING":
            running.end = event.time
            running = None
        if event.kind != "recovery":
            continue
        if running is None or running.name != event.data["name"]:
            running = _begun(event, ended)
            found.append(running)
        _update(running, event)
        if running.outcome != "running":
            running.end = event.time
            running = None
    return tuple(found)


def _begun(event: Event, ended: float) -> RecoveryRun:
    data = event.data
    return RecoveryRun(
        name=str(data["name"]),
        type=str(data.get("type", "")),
        number=int(data["index"]) + 1,
        total=int(data["total"]),
        trigger=str(data["trigger"]),
        begin=event.time,
        end=ended,
    )


def _update(recovery: RecoveryRun, event: Event) -> None:
    recovery.outcome = str(event.data["status"])
    recovery.text = event.text
    cells = event.data.get("cells_cleared")
    if isinstance(cells, dict):
        recovery.cleared = sum(n for by_layer in cells.values() for n in by_layer.values())
    elif isinstance(cells, int):
        recovery.cleared = cells


def failures(events: Iterable[Event], kind: str) -> tuple[tuple[float, str], ...]:
    """Return time and error name of every event of `kind`."""
    return tuple((e.time, str(e.data.get("name", "UNKNOWN"))) for e in events if e.kind == kind)


# --- curves over time -------------------------------------------------------------------------------------------------


def cycles(record: Record, accepted: float | None, ended: float) -> tuple[NDArray[np.float64], slice]:
    """Time (n,) of the control cycles of a goal, and their rows in the record."""
    times = record.times
    if accepted is None:
        return times[:0], slice(0, 0)
    first, end = int(np.searchsorted(times, accepted)), int(np.searchsorted(times, ended, side="right"))
    return times[first:end], slice(first, end)


def distance_to(poses: NDArray[np.float64], goal: Pose2D | None) -> NDArray[np.float64]:
    """Return (n,) straight-line distances from poses (n, 3) to the goal (m); NaN without a goal."""
    if goal is None:
        return np.full(len(poses), np.nan)
    return np.hypot(poses[:, 0] - goal.x, poses[:, 1] - goal.y)


def remaining_length(
    record: Record, times: NDArray[np.float64], rows: slice, plan_times: Container[float]
) -> NDArray[np.float64]:
    """Return (n,) length of the current plan from the point nearest to the robot, plus the distance to that point (m).

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


# --- the outcome in one sentence --------------------------------------------------------------------------------------


def summary_of(report: GoalReport, poses: NDArray[np.float64]) -> str:
    """Return the sentence for a goal; `poses` (n, 3) are those of its control cycles."""
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
        text += ": canceled"
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


# --- lines of plans ---------------------------------------------------------------------------------------------------


NEW_ROUTE_M = 0.5
"""A plan that is this much longer than the previous one takes another route."""


def plan_lines(events: Sequence[Event]) -> list[TimelineEntry]:
    """Return lines for the first plan, every plan after a failure and every new route; other replans share a line.

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
            lines += [*_take(replans), _plan_line(event, _first_plan(event))]
        elif (longer := _length(event) - _length(previous)) > NEW_ROUTE_M:
            text = f"new route: {_length(event):.2f} m, {longer:.2f} m longer than the previous plan"
            lines += [*_take(replans), _plan_line(event, text)]
        else:
            replans.append(event)
        previous = event
    return lines + _take(replans)


def _length(plan: Event) -> float:
    return float(plan.data.get("length_m", math.nan))


def _plan_line(plan: Event, text: str) -> TimelineEntry:
    return TimelineEntry(plan.time, plan.time, "plan", text, data=dict(plan.data))


def _take(replans: list[Event]) -> list[TimelineEntry]:
    """Return the line of the replans, which are removed from the list; empty without any."""
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


# --- lines of failures ------------------------------------------------------------------------------------------------


NO_PROGRESS = "FAILED_TO_MAKE_PROGRESS"
_CONSEQUENCES = {
    "PLANNING_EXHAUSTED": ("planner patience exhausted", ("planner_patience", "max_planning_retries")),
    "CONTROL_EXHAUSTED": ("controller patience exhausted", ("controller_patience",)),
    "OSCILLATING": ("oscillation timeout reached", ("oscillation_timeout", "oscillation_distance")),
}
"""Meaning of the state machine's events, and the parameters that decide them."""


def failure_lines(record: Record, events: Sequence[Event]) -> list[TimelineEntry]:
    """Return lines of failed planning requests and control cycles, in order."""
    lines: list[TimelineEntry] = []
    group: list[Event] = []
    known: set[str] = set()

    def close(consequence: str = "") -> None:
        if group:
            lines.append(_failure_line(group, consequence, known))
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


def _failure_line(group: Sequence[Event], consequence: str, known: Container[str]) -> TimelineEntry:
    """Return the line of a group of failures; a message in `known` is not repeated."""
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


# --- lines of a robot that was not where it believed to be ------------------------------------------------------------


OFF_M: Final = 0.5
"""A believed pose that is this far (m) from the true one is reported."""
SAME_S: Final = 1.0
"""Times that are this near (s) share a line."""


def believed_lines(record: Record, report: GoalReport) -> list[TimelineEntry]:
    """Return lines of the times in which the believed pose was far from the true one, within the goal.

    A replayed log has no true pose: its record repeats the believed one, which is never off.
    """
    first, last = (int(np.searchsorted(record.times, t)) for t in (report.sent, report.ended))
    rows = slice(first, last + 1)
    times, true = record.times[rows], record.poses[rows]
    believed = believed_poses(record)[rows]
    off = np.hypot(believed[:, 0] - true[:, 0], believed[:, 1] - true[:, 1])
    edges = np.flatnonzero(np.diff(np.concatenate(([False], off > OFF_M, [False])).astype(np.int8)))
    spans: list[tuple[int, int]] = []
    for begin, end in edges.reshape(-1, 2).tolist():
        if spans and times[begin] - times[spans[-1][1] - 1] < SAME_S:
            begin = spans.pop()[0]
        spans.append((begin, end))
    worst = [begin + int(off[begin:end].argmax()) for begin, end in spans]
    return [
        _believed_line(times, begin, end, off, believed[k].tolist(), true[k].tolist())
        for (begin, end), k in zip(spans, worst, strict=True)
    ]


def _believed_line(
    times: NDArray[np.float64],
    begin: int,
    end: int,
    off: NDArray[np.float64],
    believed: list[float],
    true: list[float],
) -> TimelineEntry:
    since, until = float(times[begin]), float(times[end - 1])
    most = float(off[begin:end].max())
    turned = math.degrees(abs(angle_between(believed[2], true[2])))
    text = f"believed pose {most:.1f} m and {turned:.0f} degrees off since {since:.1f} s"
    if end < len(times):
        text += f", until {until:.1f} s"
    text += f": at ({believed[0]:.2f}, {believed[1]:.2f}) instead of ({true[0]:.2f}, {true[1]:.2f})"
    return TimelineEntry(since, until, "lost", text, data={"off_m": most, "off_rad": math.radians(turned)})


# --- the timeline -----------------------------------------------------------------------------------------------------


_REDUNDANT = ("Got new plan", "Goal reached", "Aborting because")
"""Beginnings of messages that other lines replace."""
_ORDER = (
    "task",
    "goal",
    "info",
    "cancel",
    "plan_failed",
    "control_failed",
    "recovery",
    "docking",
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
    """Return all lines by time; `poses` (n, 3) are those of the goal's control cycles."""
    lines = [_sent(record, report)]
    lines += _given(record, report)
    lines += _cancels(events)
    lines += plan_lines(events)
    lines += failure_lines(record, events)
    lines += [_recovery(record, recovery) for recovery in report.recoveries]
    lines += _stuck(record, report, poses)
    lines += _collisions(record, report)
    lines += believed_lines(record, report)
    lines += [
        TimelineEntry(line.begin, line.end, "docking", line.text, data=dict(line.data))
        for line in dockings_of(record).lines.get(report.id, ())
    ]
    lines += [
        TimelineEntry(event.time, event.time, event.kind, event.text, data=dict(event.data))
        for event in events
        if event.kind in ("warning", "info") and not event.text.startswith(_REDUNDANT)
    ]
    lines.sort(key=lambda line: (line.begin, _ORDER.index(line.kind)))
    return (*lines, _end(report))


def _given(record: Record, report: GoalReport) -> list[TimelineEntry]:
    """Return why the robot of a fleet got the task of this goal: the last such event before it."""
    given = [event for event in record.events if event.kind == "task" and event.time <= report.sent]
    return [TimelineEntry(e.time, e.time, "task", e.text, data=dict(e.data)) for e in given[-1:]]


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


def _cancels(events: Iterable[Event]) -> list[TimelineEntry]:
    requests = [e for e in events if e.kind == "status" and e.data["status"] in ("PREEMPTING", "RECALLING")]
    return [TimelineEntry(e.time, e.time, "cancel", "cancel requested") for e in requests]


def _recovery(record: Record, recovery: RecoveryRun) -> TimelineEntry:
    what = f"recovery {recovery.number}{f' of {recovery.total}' if recovery.total else ''}, {recovery.name}"
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


def _stuck(record: Record, report: GoalReport, poses: NDArray[np.float64]) -> list[TimelineEntry]:
    """Return the parts of CONTROLLING in which the robot hardly moved."""
    lines: list[TimelineEntry] = []
    for span in report.spans:
        if span.state != "CONTROLLING" or span.end - span.begin < STALL_S:
            continue
        k = int(np.searchsorted(report.times, span.begin))
        end = int(np.searchsorted(report.times, span.end, side="right"))
        lines += [_stuck_line(stall, report) for stall in find_stalls(report.times[k:end], poses[k:end])]
    for number, line in enumerate(lines):
        t = 0.5 * (line.begin + line.end)
        cause = _pulled_through_obstacle(record, t) or _kept_off_by_margin(record, t)
        if cause:
            lines[number] = replace(line, text=f"{line.text}; {cause}")
            break  # the others have the same cause
    return lines


def _stuck_line(stall: Stall, report: GoalReport) -> TimelineEntry:
    begin, end, turned = stall.begin, stall.end, stall.turned_rad
    what = f"turned {math.degrees(turned):.0f} degrees in place" if turned > 0.5 else "did not move"
    text = f"the robot {what} for {end - begin:.1f} s at ({stall.x:.2f}, {stall.y:.2f})"
    failed = sum(begin <= t <= end and name != NO_PROGRESS for t, name in report.failed_commands)
    if failed:
        text += f"; control failed {times_text(failed)}"
    return TimelineEntry(begin, end, "stuck", text, data={"turned_rad": turned, "failed_commands": failed})


_DETOUR: Final = 1.1
"""A plan that is this many times as long as the straight line to its end leads around something."""


def _pulled_through_obstacle(record: Record, t: float) -> str:
    """Say that DWB waits before an obstacle at `t`: the plan in its window ends behind it, and its distances go through it."""
    parameters = record.scenario.get("parameters")
    own = parameters.get("DWBLocalPlanner") if isinstance(parameters, dict) else None
    plan, window, costmap = record.plan_at(t), record.costmap_at("local", t), record.costmap_at("global", t)
    if not isinstance(own, dict) or not {"GoalDist", "GoalAlign"} & {*record.critics}:
        return ""
    if plan is None or window is None or costmap is None:
        return ""
    points = record.to_global(plan.frame, t).apply_points(plan.poses[:, :2])
    at = np.array(record.pose_at(t)[:2])
    away = np.hypot(*(points - at).T)
    first = int(away.argmin())
    ahead = own.get("forward_prune_distance")
    reach = min(
        0.5 * max(window.geometry.width_m, window.geometry.height_m),
        float(ahead) if isinstance(ahead, (int, float)) else math.inf,
    )
    beyond = np.flatnonzero(away[first:] > reach)
    last = first + int(beyond[0]) if len(beyond) else len(points) - 1
    hidden = [k for k in range(first, last + 1) if _is_hidden(costmap, at, points[k])]
    along = float(np.hypot(*np.diff(points[first : last + 1], axis=0).T).sum())
    if not hidden or hidden[-1] != last or along < _DETOUR * away[last]:
        return ""
    x, y = points[last].tolist()
    # well before the plan turns out of sight, in half meters
    shorter = max(0.5, round(2.0 * 0.7 * float(away[first : hidden[0] + 1].max())) / 2.0)
    fix = f"forward_prune_distance: {shorter:g}" if ahead is not None else f"a local costmap of {2.0 * shorter:g} m"
    return (
        f"the plan in the local window ends at ({x:.2f}, {y:.2f}) behind an obstacle, {away[last]:.1f} m away and {along:.1f} m "
        f"along the plan: GoalDist and GoalAlign measure through obstacles, as in Nav2; {fix} ends it before"
    )


_AHEAD_M: Final = 2.0
"""The part of the plan in which a narrow place may hold the robot (m)."""


def _kept_off_by_margin(record: Record, t: float) -> str:
    """Say that MPPI waits before a place narrower than its robot with the margin of the ObstaclesCritic on both sides."""
    parameters = record.scenario.get("parameters")
    own = parameters.get("MPPIController") if isinstance(parameters, dict) else None
    critic = own.get("ObstaclesCritic") if isinstance(own, dict) else None
    plan, costmap = record.plan_at(t), record.costmap_at("global", t)
    listed = own.get("critics", ()) if isinstance(own, dict) else ()
    if not isinstance(critic, dict) or "ObstaclesCritic" not in listed or plan is None or costmap is None:
        return ""
    margin = float(critic.get("collision_margin_distance", 0.1))
    g = costmap.geometry
    iy, ix = np.nonzero(costmap.data == LETHAL)
    obstacles = np.column_stack((g.origin_x + (ix + 0.5) * g.resolution, g.origin_y + (iy + 0.5) * g.resolution))
    points = record.to_global(plan.frame, t).apply_points(plan.poses[:, :2])
    away = np.hypot(*(points - record.pose_at(t)[:2]).T)
    ahead = points[int(away.argmin()) :]
    ahead = ahead[np.cumsum(np.hypot(*np.diff(ahead, axis=0, prepend=ahead[:1]).T)) < _AHEAD_M]
    if not len(obstacles) or not len(ahead):
        return ""
    free = np.array([float(np.hypot(*(obstacles - point).T).min()) for point in ahead]) - 0.5 * g.resolution
    narrowest = int(free.argmin())
    left = float(free[narrowest]) - record.footprint.inscribed_radius
    if left <= 0.0 or left >= margin:
        return ""
    x, y = ahead[narrowest].tolist()
    return (
        f"the plan passes a place at ({x:.2f}, {y:.2f}) that leaves {left:.2f} m beside the footprint, less than "
        f"collision_margin_distance = {margin:g} m of ObstaclesCritic, which keeps the robot out with critical_weight; set it to "
        f"{math.floor(80.0 * left) / 100.0:g}, or name a wider way"
    )


def _is_hidden(costmap: Costmap, start: NDArray[np.float64], end: NDArray[np.float64]) -> bool:
    """True if a lethal cell is on the line between two points."""
    g = costmap.geometry
    count = 2 + int(2.0 * math.dist(start.tolist(), end.tolist()) / g.resolution)
    cells = (np.linspace(start, end, count) - (g.origin_x, g.origin_y)) / g.resolution
    ix, iy = np.floor(cells).astype(np.int64).T
    inside = (ix >= 0) & (ix < g.nx) & (iy >= 0) & (iy < g.ny)
    return bool((costmap.data[iy[inside], ix[inside]] == LETHAL).any())


def _collisions(record: Record, report: GoalReport) -> list[TimelineEntry]:
    if report.accepted is None:
        return []
    return [
        TimelineEntry(float(t), float(t), "collision", collision_text(record, float(t), Pose2D(*pose)))
        for t, pose in zip(record.collision_times, record.collisions.tolist(), strict=True)
        if report.accepted <= t <= report.ended
    ]


def collision_text(record: Record, t: float, pose: Pose2D) -> str:
    """Say where the robot collided, and whether its local costmap had the obstacle: seen and hit, or not seen."""
    text = f"collision at ({pose.x:.2f}, {pose.y:.2f})"
    costmap = record.costmap_at("local", t)
    if costmap is None:
        return text
    to_map = record.to_global(record.costmap_frame("local"), t)
    at = to_map.inverse().apply(pose)
    found = nearest_lethal(costmap, record.footprint, at)
    if found is None:
        return f"{text} with an obstacle that the local costmap did not have; it had none"
    distance, (x, y) = found[0], to_map.apply(Pose2D(*found[1]))[:2]
    if touches_lethal(costmap, record.footprint, at):
        return f"{text} with an obstacle that the local costmap had, marked at ({x:.2f}, {y:.2f})"
    return (
        f"{text} with an obstacle that the local costmap did not have; the nearest one that it had, at ({x:.2f}, {y:.2f}), is "
        f"{distance:.2f} m from the footprint"
    )


def _end(report: GoalReport) -> TimelineEntry:
    if not report.ended_in_record:
        return TimelineEntry(report.ended, report.ended, "end", f"the record ends while the goal is {report.status}")
    if report.expired_limit_s is not None:
        text = f"{report.status}: {report.error_name} ({report.error_code}): {report.message}"
        return TimelineEntry(report.ended, report.ended, "end", text)
    text = report.status + (f': "{report.text}"' if report.text else "")
    if report.error_code and report.error_name not in ("CANCELED", "REPLACED"):
        text += f" Error {report.error_name} ({report.error_code}): {report.message}"
    elif report.message:
        text += f" {report.message}"
    return TimelineEntry(report.ended, report.ended, "end", text)


# --- the report -------------------------------------------------------------------------------------------------------


def explain_goals(record: Record) -> tuple[GoalReport, ...]:
    """Report every goal of a run, in order of arrival. Raises RecordError for a run without goals."""
    hidden = dockings_of(record).hidden
    ids = dict.fromkeys(str(e.data["id"]) for e in record.events_of("status") if "id" in e.data)
    ids = [goal_id for goal_id in ids if goal_id not in hidden]
    if not ids:
        raise RecordError(f"{record.path or 'the record'} contains no goal: none was sent during the recording")
    return tuple(_report(record, number, goal_id) for number, goal_id in enumerate(ids, 1))


def explain_goal(record: Record, number: int, goal_id: str | None = None) -> GoalReport:
    """Report goal `number` (from 1). `goal_id`: its id, for a record that begins after the first goal.

    Raises InputError for an unknown number, RecordError as `explain_goals`.
    """
    if goal_id is not None:
        return _report(record, number, goal_id)
    reports = explain_goals(record)
    if not 1 <= number <= len(reports):
        known = "only goal 1" if len(reports) == 1 else f"goals 1 to {len(reports)}"
        raise InputError(f"--goal {number}: this run has {known}", argument="--goal", value=number)
    return reports[number - 1]


def _expired_limit(record: Record, last: Event) -> float | None:
    """Return the time limit (s) of a goal that ended with GOAL_TIME_LIMIT: the run's, or `goal_time_limit` if lower."""
    if last.data.get("error_name") != GoalTimeLimitError.name:
        return None
    parameters = record.scenario.get("parameters")
    own = parameters.get("navstack") if isinstance(parameters, dict) else None
    limits = [record.scenario.get("time_limit_s"), own.get("goal_time_limit") if isinstance(own, dict) else None]
    return min((float(limit) for limit in limits if isinstance(limit, (int, float)) and limit > 0.0), default=math.nan)


def _report(record: Record, number: int, goal_id: str) -> GoalReport:
    statuses = [e for e in record.events_of("status") if e.data.get("id") == goal_id]
    accepted = next((e.time for e in statuses if e.data["status"] == "ACTIVE"), None)
    sent, last = statuses[0].time, statuses[-1]
    docking = dockings_of(record).lines.get(goal_id, [])
    if docking and "state" in docking[0].data and accepted is not None:
        sent = accepted = docking[0].begin  # the way to the staging pose is a part of it, under another id
    ended = last.time if last.data["status"] in TERMINAL else last_time(record)
    events = events_of(record, goal_id)
    pose = goal_pose(record, events, number)
    times, rows = cycles(record, accepted, ended)
    plans = [e for e in events if e.kind == "plan"]
    report = GoalReport(
        number=number,
        id=goal_id,
        pose=pose,
        sent=sent,
        accepted=accepted,
        ended=ended,
        status=str(last.data["status"]),
        text=str(last.data.get("text", "")),
        error_code=int(last.data.get("error_code", 0)),
        error_name=str(last.data.get("error_name", "NONE")),
        message=str(last.data.get("message", "")),
        summary="",
        spans=state_spans(record, events, accepted, ended, goal_id),
        recoveries=recovery_runs(events, ended),
        timeline=(),
        plan_times=np.array([e.time for e in plans]),
        plan_lengths=np.array([float(e.data.get("length_m", math.nan)) for e in plans]),
        failed_plans=failures(events, "plan_failed"),
        failed_commands=failures(events, "control_failed"),
        times=times,
        distance=distance_to(record.poses[rows], pose),
        remaining=remaining_length(record, times, rows, {e.time for e in plans}),
        velocity=record.velocities[rows],
        expired_limit_s=_expired_limit(record, last),
    )
    poses = record.poses[rows]
    return replace(report, timeline=timeline_of(record, report, events, poses), summary=summary_of(report, poses))

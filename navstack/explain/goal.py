"""What became of a goal, and why: its time line in words, from the record alone.

Many events say the same thing over again (a failed plan every 0.2 s): what repeats is one line here, with how often, from
when to when, and what was said last.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from navstack.core import Event, Pose2D, angle_between
from navstack.core.errors import InputError, RecordError
from navstack.record import Record, RecordedPlan

HELD_UP_S = 3.0
"""A robot that is CONTROLLING and comes no further than `HELD_UP_M` for so long is held up."""
HELD_UP_M = 0.1
LONGER_M = 0.5
"""A plan so much longer than the one before it goes another way."""


@dataclass(frozen=True, slots=True)
class StateSpan:
    """The goal manager was in one state."""

    state: str
    begin: float
    """s of the run, as all times."""
    end: float


@dataclass(slots=True)
class Recovery:
    """A recovery behaviour that ran."""

    name: str
    type: str
    """The plugin's class; empty in records of before it was taken down."""
    number: int
    """Its place in the list, from 1."""
    total: int
    """How many there are in the list."""
    trigger: str
    """What it was for: PLANNING_R, CONTROLLING_R or OSCILLATION_R."""
    begin: float
    end: float
    outcome: str = "running"
    """done, failed; running when it was broken off."""
    text: str = ""
    """What it said at the end."""
    cleared: int | None = None
    """Cells cleared, for those that clear."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class Line:
    """One line of the time line."""

    begin: float
    end: float
    kind: str
    """goal, plan, plan_failed, control_failed, state, recovery, held_up, contact, warning, info, cancel, end."""
    text: str
    count: int = 1
    """How many events it stands for."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "begin": self.begin,
            "end": self.end,
            "kind": self.kind,
            "text": self.text,
            "count": self.count,
            "data": self.data,
        }


@dataclass(frozen=True, slots=True, eq=False)
class GoalAccount:
    """A goal from being sent to its end."""

    number: int
    """From 1, in the order in which they were sent."""
    id: str
    pose: Pose2D | None
    """In the global frame; None when it never could be brought there."""
    sent: float
    accepted: float | None
    """None for a goal that was taken off before its turn."""
    ended: float
    """The last time in the record for a goal that has not ended there."""
    status: str
    """The state of the goal at the end, as in actionlib."""
    text: str
    """C++'s text."""
    error_code: int
    error_name: str
    message: str
    verdict: str
    """The whole story in a sentence or two."""
    spans: tuple[StateSpan, ...]
    recoveries: tuple[Recovery, ...]
    lines: tuple[Line, ...]
    plan_times: NDArray[np.float64]
    """(p,) when a plan was found."""
    plan_lengths: NDArray[np.float64]
    """(p,) m"""
    failed_plans: tuple[tuple[float, str], ...]
    """When, and the error's name."""
    failed_commands: tuple[tuple[float, str], ...]
    times: NDArray[np.float64]
    """(n,) of the control cycles."""
    distance: NDArray[np.float64]
    """(n,) m, straight to the goal; NaN where the goal's place is not known."""
    remaining: NDArray[np.float64]
    """(n,) m along the plan in force; NaN without one."""
    velocity: NDArray[np.float64]
    """(n, 3) vx, vy, wz as odometry had it, m/s and rad/s."""

    @property
    def duration(self) -> float:
        """From being sent to the end, s."""
        return self.ended - self.sent

    def seconds(self, state: str) -> float:
        """Time spent in a state, s."""
        return sum(span.end - span.begin for span in self.spans if span.state == state)

    def as_dict(self) -> dict[str, Any]:
        """For JSON; without the curves, which are in the record."""
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
            "verdict": self.verdict,
            "states": [{"state": s.state, "begin": s.begin, "end": s.end} for s in self.spans],
            "seconds": {s: self.seconds(s) for s in dict.fromkeys(span.state for span in self.spans)},
            "recoveries": [recovery.as_dict() for recovery in self.recoveries],
            "plans": [{"time": t, "length_m": m} for t, m in zip(self.plan_times.tolist(), self.plan_lengths.tolist())],
            "failures": dict(Counter(name for _, name in self.failed_plans + self.failed_commands)),
            "lines": [line.as_dict() for line in self.lines],
        }


def explain_goals(record: Record) -> tuple[GoalAccount, ...]:
    """Every goal of a run, in the order in which they were sent. Raises RecordError for a run without a goal."""
    ids = list(dict.fromkeys(str(e.data["id"]) for e in record.events_of("status") if "id" in e.data))
    if not ids:
        raise RecordError(f"{record.path or 'the record'} holds no goal: nothing was sent while it was recorded")
    return tuple(_account(record, number, goal_id) for number, goal_id in enumerate(ids, 1))


def explain_goal(record: Record, number: int) -> GoalAccount:
    """Goal `number` (from 1). Raises InputError when there is none of that number, RecordError as `explain_goals`."""
    accounts = explain_goals(record)
    if not 1 <= number <= len(accounts):
        have = "1" if len(accounts) == 1 else f"1 to {len(accounts)}"
        raise InputError(f"--goal {number}: this run has goals {have}", argument="--goal", value=number)
    return accounts[number - 1]


# --- one goal ---------------------------------------------------------------------------------------------------------


def _account(record: Record, number: int, goal_id: str) -> GoalAccount:
    statuses = [e for e in record.events_of("status") if e.data.get("id") == goal_id]
    sent = statuses[0].time
    accepted = next((e.time for e in statuses if e.data["status"] == "ACTIVE"), None)
    last = statuses[-1]
    over = last.data["status"] in _ENDS
    ended = last.time if over else _last_time(record)
    events = _events_of(record, goal_id)
    pose = _pose(record, events, number)
    times, rows = _cycles(record, accepted, ended)
    found = [e for e in events if e.kind == "plan"]
    found_at = {e.time for e in found}  # at the time it ends the next goal may have its first plan
    plans = [p for p in record.plans if p.t in found_at]
    recoveries = _recoveries(events, ended)
    told = last.data
    away = _distance(record, rows, pose)
    account = GoalAccount(
        number=number,
        id=goal_id,
        pose=pose,
        sent=sent,
        accepted=accepted,
        ended=ended,
        status=str(told["status"]),
        text=str(told.get("text", "")),
        error_code=int(told.get("error_code", 0)),
        error_name=str(told.get("error_name", "NONE")),
        message=str(told.get("message", "")),
        verdict="",
        spans=_spans(record, events, accepted, ended, goal_id),
        recoveries=recoveries,
        lines=(),
        plan_times=np.array([e.time for e in found]),
        plan_lengths=np.array([float(e.data.get("length_m", math.nan)) for e in found]),
        failed_plans=_failures(events, "plan_failed"),
        failed_commands=_failures(events, "control_failed"),
        times=times,
        distance=away,
        remaining=_remaining(record, times, rows, plans),
        velocity=record.velocities[rows],
    )
    lines = _lines(record, account, events, rows)
    return _replace(account, lines=lines, verdict=_verdict(record, account, rows, over))


_ENDS = ("PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "RECALLED")


def _replace(account: GoalAccount, **changes: Any) -> GoalAccount:
    from dataclasses import replace

    return replace(account, **changes)


def _last_time(record: Record) -> float:
    return max([float(t) for t in record.times[-1:]] + [e.time for e in record.events[-1:]])


def _events_of(record: Record, goal_id: str) -> list[Event]:
    """The events between the goal's acceptance and its end, in the order in which they happened."""
    found: list[Event] = []
    inside = False
    for event in record.events:
        mine = event.kind == "status" and event.data.get("id") == goal_id
        if mine and event.data["status"] in ("ACTIVE", "PREEMPTING") and not inside:
            inside = True
        if mine or (inside and event.kind != "status"):
            found.append(event)
        if mine and event.data["status"] in _ENDS:
            break
    return found


def _pose(record: Record, events: Iterable[Event], number: int) -> Pose2D | None:
    """Where the goal lies in the global frame."""
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


def _cycles(record: Record, accepted: float | None, ended: float) -> tuple[NDArray[np.float64], slice]:
    times = record.times
    if accepted is None:
        return times[:0], slice(0, 0)
    first, end = int(np.searchsorted(times, accepted)), int(np.searchsorted(times, ended, side="right"))
    return times[first:end], slice(first, end)


def _distance(record: Record, rows: slice, pose: Pose2D | None) -> NDArray[np.float64]:
    at = record.poses[rows]
    if pose is None:
        return np.full(len(at), np.nan)
    return np.hypot(at[:, 0] - pose.x, at[:, 1] - pose.y)


def _remaining(
    record: Record, times: NDArray[np.float64], rows: slice, plans: Sequence[RecordedPlan]
) -> NDArray[np.float64]:
    """Along the plan in force, from its point nearest to the robot."""
    left = np.full(len(times), np.nan)
    at = record.poses[rows]
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
        left[mine] = away[np.arange(len(mine)), nearest] + to_go[nearest]
    return left


def _spans(
    record: Record, events: Sequence[Event], accepted: float | None, ended: float, goal_id: str
) -> tuple[StateSpan, ...]:
    if accepted is None:
        return ()
    state = "IDLE"
    for event in record.events:  # a goal that replaces another one begins in that one's state
        if event.kind == "status" and event.data.get("id") == goal_id and event.data["status"] == "ACTIVE":
            break
        if event.kind == "state":
            state = str(event.data["to"])
    spans: list[StateSpan] = []
    begin = accepted
    for event in (e for e in events if e.kind == "state"):
        if event.time > begin:
            spans.append(StateSpan(state, begin, event.time))
        state, begin = str(event.data["to"]), event.time
    if ended > begin and state != "IDLE":
        spans.append(StateSpan(state, begin, ended))
    return tuple(spans)


def _recoveries(events: Iterable[Event], ended: float) -> tuple[Recovery, ...]:
    found: list[Recovery] = []
    running: Recovery | None = None
    for event in events:
        if event.kind == "state" and running is not None and event.data["to"] != "CLEARING":
            running.end = event.time
            running = None
        if event.kind != "recovery":
            continue
        data = event.data
        if running is None:
            running = Recovery(
                name=str(data["name"]),
                type=str(data.get("type", "")),
                number=int(data["index"]) + 1,
                total=int(data["total"]),
                trigger=str(data["trigger"]),
                begin=event.time,
                end=ended,
            )
            found.append(running)
        running.outcome = str(data["status"])
        running.text = event.text
        cells = data.get("cells_cleared")
        if isinstance(cells, dict):
            running.cleared = sum(n for by_layer in cells.values() for n in by_layer.values())
        if running.outcome != "running":
            running.end = event.time
            running = None
    return tuple(found)


def _failures(events: Iterable[Event], kind: str) -> tuple[tuple[float, str], ...]:
    return tuple((e.time, str(e.data.get("name", "UNKNOWN"))) for e in events if e.kind == kind)


# --- lines ------------------------------------------------------------------------------------------------------------


def _lines(record: Record, account: GoalAccount, events: Sequence[Event], rows: slice) -> tuple[Line, ...]:
    lines: list[Line] = [_sent(record, account)]
    lines += _cancels(events)
    lines += _plan_lines(account, events)
    lines += _failure_lines(record, events)
    lines += _recovery_lines(record, account)
    lines += _held_up(record, account, rows)
    lines += [
        Line(float(t), float(t), "contact", f"the outline touched something at ({x:.2f}, {y:.2f})")
        for t, (x, y) in zip(record.collision_times, record.collisions[:, :2], strict=True)
        if account.accepted is not None and account.accepted <= t <= account.ended
    ]
    for event in events:
        if event.kind in ("warning", "info") and not event.text.startswith(_EVERYDAY):
            lines.append(Line(event.time, event.time, event.kind, event.text, data=dict(event.data)))
    lines.sort(key=lambda line: (line.begin, _ORDER.index(line.kind)))
    return (*lines, _end(account))


_EVERYDAY = ("Got new plan", "Goal reached", "Aborting because")
"""How the texts begin that other lines say better."""
_ORDER = (
    "goal",
    "info",
    "cancel",
    "plan_failed",
    "control_failed",
    "recovery",
    "warning",
    "plan",
    "held_up",
    "contact",
)


def _sent(record: Record, account: GoalAccount) -> Line:
    text = f"{account.id} was sent"
    if account.pose is not None:
        x, y, yaw = account.pose
        text = f"{account.id} was sent: ({x:.2f}, {y:.2f}, {yaw:.2f}) in {record.global_frame}"
    if account.accepted is None:
        return Line(account.sent, account.sent, "goal", text)
    if account.accepted > account.sent:
        text += f", and accepted at {account.accepted:.1f} s"
    if len(account.times):
        at = record.pose_at(account.accepted)
        text += f"; the robot stands at ({at.x:.2f}, {at.y:.2f})"
        if account.pose is not None:
            text += f", {at.distance_to(account.pose):.2f} m away"
    return Line(account.sent, account.sent, "goal", text)


def _cancels(events: Iterable[Event]) -> list[Line]:
    asked = [e for e in events if e.kind == "status" and e.data["status"] in ("PREEMPTING", "RECALLING")]
    return [Line(e.time, e.time, "cancel", "whoever sent it asked to cancel it") for e in asked]


def _plan_lines(account: GoalAccount, events: Sequence[Event]) -> list[Line]:
    """The first plan, each that goes another way or comes after failures, and the many others in one line each."""
    lines: list[Line] = []
    group: list[Event] = []
    before: Event | None = None

    def close() -> None:
        if group:
            first, last = (float(e.data.get("length_m", math.nan)) for e in (group[0], group[-1]))
            if len(group) == 1:
                text = f"replanned: {first:.2f} m"
            else:
                text = f"replanned {len(group)} times: from {first:.2f} m to {last:.2f} m"
            lines.append(Line(group[0].time, group[-1].time, "plan", text, len(group)))
            group.clear()

    for event in events:
        if event.kind in ("plan_failed", "recovery", "control_failed"):
            close()
            if event.kind != "control_failed":
                before = None
        if event.kind != "plan":
            continue
        length = float(event.data.get("length_m", math.nan))
        if before is None:
            close()
            lines.append(Line(event.time, event.time, "plan", _first_plan(event, length), data=dict(event.data)))
        elif length > (old := float(before.data.get("length_m", math.nan))) + LONGER_M:
            close()
            text = (
                f"the new plan is {length - old:.2f} m longer than the one before ({length:.2f} m): it goes another way"
            )
            lines.append(Line(event.time, event.time, "plan", text, data=dict(event.data)))
        else:
            group.append(event)
        before = event
    close()
    return lines


def _first_plan(event: Event, length: float) -> str:
    text = f"the global planner has a plan of {length:.2f} m"
    expanded = event.data.get("cells_expanded")
    if expanded:
        text += f" ({expanded:,} cells expanded)"
    moved = float(event.data.get("goal_moved_m", 0.0))
    if moved > 0.0:
        text += f"; it ends {moved:.2f} m from the goal"
    notes = event.data.get("notes") or ()
    return text + "".join(f"; {note}" for note in notes)


def _failure_lines(record: Record, events: Sequence[Event]) -> list[Line]:
    """Failures of the planners: those of one kind in a row are one line, with what they led to."""
    lines: list[Line] = []
    group: list[Event] = []
    said: set[str] = set()

    def close(led_to: str = "") -> None:
        if group:
            lines.append(_failure_line(group, led_to, said))
            said.add(group[-1].text)
            group.clear()

    for event in events:
        if event.kind in ("plan_failed", "control_failed"):
            if group and (event.kind, event.data.get("name")) != (group[-1].kind, group[-1].data.get("name")):
                close()
            group.append(event)
        elif event.kind == "plan":
            # replanning goes on while control fails
            if group and group[-1].kind == "plan_failed":
                close()
        elif event.kind == "state" and event.data.get("event") in _LED_TO:
            close(_led_to(record, event))
        elif event.kind == "recovery" or (event.kind == "status" and event.data["status"] in _ENDS):
            close()
    close()
    return lines


_NO_PROGRESS = "FAILED_TO_MAKE_PROGRESS"
_LED_TO = {
    "PLANNING_EXHAUSTED": ("patience with the global planner is used up", ("planner_patience", "max_planning_retries")),
    "CONTROL_EXHAUSTED": ("patience with the local planner is used up", ("controller_patience",)),
    "OSCILLATING": ("patience with the robot's progress is used up", ("oscillation_timeout", "oscillation_distance")),
}
"""What an event of the state machine means, and the parameters that decide it."""


def _led_to(record: Record, event: Event) -> str:
    what, names = _LED_TO[event.data["event"]]
    parameters = record.scenario.get("parameters")
    given = parameters if isinstance(parameters, dict) else {}
    known = [f"{name} {given[name]:g}" for name in names if isinstance(given.get(name), (int, float))]
    return what + (f" ({', '.join(known)})" if known else "")


def _failure_line(group: Sequence[Event], led_to: str, said: Container[str]) -> Line:
    first, last = group[0], group[-1]
    who = "the global planner" if last.kind == "plan_failed" else "the local planner"
    name, code = last.data.get("name", "UNKNOWN"), last.data.get("code")
    failed = f"{who} failed" if len(group) == 1 else f"{who} failed {_times(len(group))}"
    if name == _NO_PROGRESS:
        failed = "the robot got nowhere"
    kind = f"{name} ({code})" if code is not None else str(name)
    text = f"{failed}: {kind}" + (", as before" if last.text in said else f": {last.text}")
    if led_to:
        text += f"; {led_to}"
    return Line(first.time, last.time, last.kind, text, len(group), dict(last.data))


def _recovery_lines(record: Record, account: GoalAccount) -> list[Line]:
    lines: list[Line] = []
    for recovery in account.recoveries:
        what = f"recovery {recovery.number} of {recovery.total}, {recovery.name}"
        if recovery.type:
            what += f" ({recovery.type})"
        took = recovery.end - recovery.begin
        if recovery.outcome == "running":
            does = f"was broken off after {took:.1f} s"
        elif recovery.outcome == "failed":
            does = f"failed after {took:.1f} s: {recovery.text}"
        elif recovery.cleared is not None:
            does = f"cleared {recovery.cleared} cells in {took:.1f} s: {recovery.text}"
            if recovery.cleared == 0:
                does = f"had no cell to clear: {recovery.text}"
        else:
            does = f"done after {took:.1f} s: {recovery.text}"
        moved = _moved(record, recovery.begin, recovery.end)
        if moved is not None and moved > 0.02:
            does += f"; the robot moved {moved:.2f} m"
        lines.append(Line(recovery.begin, recovery.end, "recovery", f"{what}, {does}", data=recovery.as_dict()))
    return lines


def _moved(record: Record, begin: float, end: float) -> float | None:
    if not len(record.times):
        return None
    return record.pose_at(begin).distance_to(record.pose_at(end))


def _held_up(record: Record, account: GoalAccount, rows: slice) -> list[Line]:
    """The stretches of CONTROLLING in which the robot came no further."""
    at = record.poses[rows]
    lines: list[Line] = []
    for span in account.spans:
        if span.state != "CONTROLLING" or span.end - span.begin < HELD_UP_S:
            continue
        first = int(np.searchsorted(account.times, span.begin))
        end = int(np.searchsorted(account.times, span.end, side="right"))
        k = first
        while k < end:
            away = np.hypot(at[k:end, 0] - at[k, 0], at[k:end, 1] - at[k, 1]) > HELD_UP_M
            stop = k + int(away.argmax()) if away.any() else end
            begun, over = float(account.times[k]), float(account.times[stop - 1])
            if over - begun >= HELD_UP_S:
                lines.append(_held_up_line(at[k:stop], account, begun, over))
                k = stop
            else:
                k += 1
    return lines


def _held_up_line(at: NDArray[np.float64], account: GoalAccount, begin: float, end: float) -> Line:
    turned = float(np.abs(np.diff(np.unwrap(at[:, 2]))).sum())
    what = f"turned {math.degrees(turned):.0f} degrees on the spot" if turned > 0.5 else "stood still"
    text = f"the robot {what} for {end - begin:.1f} s at ({at[0, 0]:.2f}, {at[0, 1]:.2f})"
    failed = sum(begin <= t <= end and name != _NO_PROGRESS for t, name in account.failed_commands)
    if failed:
        text += f"; the local planner failed {_times(failed)} meanwhile"
    return Line(begin, end, "held_up", text, data={"turned_rad": turned, "failed_commands": failed})


def _end(account: GoalAccount) -> Line:
    if account.status not in _ENDS:
        return Line(account.ended, account.ended, "end", f"the record ends while the goal is {account.status}")
    text = account.status + (f': "{account.text}"' if account.text else "")
    if account.error_code and account.error_name not in ("CANCELED", "REPLACED"):
        text += f" The reason: {account.error_name} ({account.error_code}): {account.message}"
    elif account.message:
        text += f" {account.message}"
    return Line(account.ended, account.ended, "end", text)


# --- the verdict ------------------------------------------------------------------------------------------------------


def _verdict(record: Record, account: GoalAccount, rows: slice, over: bool) -> str:
    at = record.poses[rows]
    driven = float(np.hypot(*np.diff(at[:, :2], axis=0).T).sum()) if len(at) > 1 else 0.0
    tried = _tried(account)
    if account.status == "SUCCEEDED":
        parts = [f"reached after {account.duration:.1f} s, {driven:.2f} m driven"]
        if account.pose is not None and len(at):
            off = math.degrees(abs(angle_between(float(at[-1, 2]), account.pose.yaw)))
            parts.append(f"{account.distance[-1]:.2f} m and {off:.0f} degrees from the goal")
        if len(account.plan_lengths):
            parts.append(f"the first plan was {account.plan_lengths[0]:.2f} m")
        return "; ".join([", ".join(parts[:2]), *parts[2:], *([tried] if tried else [])])
    if not over:
        return f"{account.status} when the record ends, after {account.duration:.1f} s and {driven:.2f} m"
    text = f"{account.status} after {account.duration:.1f} s and {driven:.2f} m"
    if len(account.distance) and math.isfinite(account.distance[-1]):
        text += f", {account.distance[-1]:.2f} m from the goal"
    if account.error_name in ("CANCELED", "REPLACED"):
        text += f": {'cancelled' if account.error_name == 'CANCELED' else 'another goal took its place'}"
    elif account.error_code:
        text += f", because of {account.error_name} ({account.error_code})"
    return text + (f"; {tried}" if tried else "")


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"


def _tried(account: GoalAccount) -> str:
    parts: list[str] = []
    for failures, who in ((account.failed_plans, "planning"), (account.failed_commands, "control")):
        if failures:
            names = ", ".join(f"{_times(n)} {name}" for name, n in Counter(name for _, name in failures).most_common())
            parts.append(f"{who} failed {names}")
    if account.recoveries:
        names = ", ".join(recovery.name for recovery in account.recoveries)
        many = len(account.recoveries)
        parts.append(f"{many} recover{'y' if many == 1 else 'ies'} ({names})")
    return ", ".join(parts)

"""The events of a goal: its pose, states, recoveries and failures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from navstack.core import Event, Pose2D
from navstack.explain.goal.report import TERMINAL, RecoveryRun, StateSpan
from navstack.record import Record


def last_time(record: Record) -> float:
    """Time of the last sample or event (s)."""
    return max([float(t) for t in record.times[-1:]] + [e.time for e in record.events[-1:]])


def events_of(record: Record, goal_id: str) -> list[Event]:
    """The events from the acceptance of a goal to its end, and all of its status events, in order."""
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
    """The goal in the global frame; None if it is unknown or not finite."""
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
    """The states of the goal manager from acceptance to end, without gaps."""
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
    """A goal that replaces another one begins in the state of that goal."""
    state = "IDLE"
    for event in record.events:
        if event.kind == "status" and event.data.get("id") == goal_id and event.data["status"] == "ACTIVE":
            break
        if event.kind == "state":
            state = str(event.data["to"])
    return state


def recovery_runs(events: Iterable[Event], ended: float) -> tuple[RecoveryRun, ...]:
    """The executions of recovery behaviors; one that never ended ends with the goal."""
    found: list[RecoveryRun] = []
    running: RecoveryRun | None = None
    for event in events:
        if event.kind == "state" and running is not None and event.data["to"] != "CLEARING":
            running.end = event.time
            running = None
        if event.kind != "recovery":
            continue
        if running is None:
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


def failures(events: Iterable[Event], kind: str) -> tuple[tuple[float, str], ...]:
    """Time and error name of every event of `kind`."""
    return tuple((e.time, str(e.data.get("name", "UNKNOWN"))) for e in events if e.kind == kind)

"""The events that the goal manager publishes to its listeners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from navstack.core import Event, Listener, Pose2D
from navstack.core.errors import NavError
from navstack.interfaces import Plan, RecoveryBehavior, RecoveryStatus
from navstack.move_base.goal import Goal, GoalHandle
from navstack.move_base.states import NavEvent, NavState


class EventPublisher:
    """Creates events and passes them to the listeners."""

    def __init__(self, listeners: Sequence[Listener] = ()) -> None:
        self.listeners: list[Listener] = list(listeners)

    def publish(self, now: float, kind: str, text: str, data: dict[str, Any]) -> None:
        """Pass an event to every listener."""
        event = Event(now, kind, text, data)
        for listener in self.listeners:
            listener.on_event(event)

    def info(self, now: float, text: str, **data: Any) -> None:
        """Publish a message."""
        if self.listeners:
            self.publish(now, "info", text, data)

    def warn(self, now: float, text: str, error: NavError | None = None) -> None:
        """Publish a warning, with the error that caused it."""
        if self.listeners:
            self.publish(now, "warning", text, {} if error is None else error.as_dict())

    def failure(self, now: float, kind: str, error: NavError) -> None:
        """Publish a failure: `plan_failed` or `control_failed`."""
        if self.listeners:
            self.publish(now, kind, error.message, error.as_dict())

    def feedback(self, now: float, pose: Pose2D) -> None:
        """Publish the robot's pose, if a listener asks for it: most runs have none that does."""
        for listener in self.listeners:
            if getattr(listener, "hears_feedback", True):
                self.publish(now, "feedback", "", {"pose": list(pose)})
                return

    def goal(self, now: float, goal: Goal) -> None:
        """Publish a goal that was accepted."""
        if self.listeners:
            x, y, yaw = goal.pose
            text = f'goal {goal.id}: ({x:.3f}, {y:.3f}, {yaw:.3f}) in "{goal.frame}"'
            data = {"id": goal.id, "pose": list(goal.pose), "frame": goal.frame, "stamp": goal.stamp}
            self.publish(now, "goal", text, data)

    def status(self, handle: GoalHandle, now: float) -> None:
        """Publish the status of a goal."""
        if not self.listeners:
            return
        data: dict[str, Any] = {"id": handle.id, "status": handle.status.name, "number": int(handle.status)}
        if handle.is_done:
            result = handle.result
            data |= {"error_code": result.error_code, "error_name": result.error_name, "message": result.message}
        text = f"{handle.status.name}: {handle.text}" if handle.text else handle.status.name
        self.publish(now, "status", text, {**data, "text": handle.text})

    def plan(self, now: float, plan: Plan) -> None:
        """Publish the key figures of a plan."""
        if not self.listeners:
            return
        length = plan.path.length
        data: dict[str, Any] = {
            "length_m": length,
            "poses": len(plan.path),
            "cost": plan.cost,
            "cells_expanded": plan.cells_expanded,
            "goal_moved_m": plan.goal_moved_m,
            "notes": list(plan.notes),
        }
        self.publish(now, "plan", f"a plan of {length:.2f} m, {len(plan.path)} poses", data)

    def state(self, now: float, before: NavState, after: NavState, event: NavEvent) -> None:
        """Publish a change of the mode."""
        if not self.listeners:
            return
        data = {
            "from": before.mode.value,
            "to": after.mode.value,
            "event": event.name,
            "trigger": after.trigger.name,
            "recovery_index": after.recovery_index,
        }
        self.publish(now, "state", f"{before.mode.value} -> {after.mode.value}: {event.value}", data)

    def recovery(
        self,
        now: float,
        recovery: RecoveryBehavior,
        status: RecoveryStatus,
        text: str,
        data: dict[str, Any],
        state: NavState,
        total: int,
    ) -> None:
        """Publish the start, a message or the end of a recovery behavior, one of `total`."""
        if not self.listeners:
            return
        common: dict[str, Any] = {
            "name": recovery.name,
            "type": type(recovery).__name__,
            "index": state.recovery_index,
            "total": total,
            "status": status.value,
            "trigger": state.trigger.name,
        }
        self.publish(now, "recovery", text, {**data, **common})

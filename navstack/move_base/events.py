"""How one observes the goal manager: its events, as they happen, and the result of each tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from navstack.core import Event, Listener, NavError, Pose2D, SensorData, Twist2D, Window
from navstack.plugins import LocalPlan, Plan


@dataclass(slots=True)
class TickResult:
    """What one tick received, updated and commanded."""

    time: float
    scans: tuple[SensorData, ...] = ()
    global_window: Window | None = None
    """The updated cells of the global costmap; None without an update."""
    local_window: Window | None = None
    plan: Plan | None = None
    """The plan received from the global planner."""
    local_plan: LocalPlan | None = None
    """The result of the local planner."""
    command: Twist2D | None = None
    """The last command sent."""
    planning_s: float | None = None
    """Duration of the call of the global planner, failed or not, by the goal manager's stopwatch; None without a call."""
    control_s: float | None = None
    """Duration of the call of the local planner."""


class EventPublisher:
    """Creates events and passes them to the listeners."""

    def __init__(self, listeners: Sequence[Listener] = ()) -> None:
        self.listeners: list[Listener] = list(listeners)

    def hears(self, kind: str) -> bool:
        """Return True if a listener needs the events of this kind."""
        for listener in self.listeners:
            kinds = getattr(listener, "kinds", None)
            if kinds is None or kind in kinds:
                return True
        return False

    def publish(self, now: float, kind: str, text: str, data: dict[str, Any]) -> None:
        """Pass an event to every listener."""
        event = Event(now, kind, text, data)
        for listener in self.listeners:
            listener.on_event(event)

    def info(self, now: float, text: str, **data: Any) -> None:
        """Publish a message."""
        if self.hears("info"):
            self.publish(now, "info", text, data)

    def warn(self, now: float, text: str, error: NavError | None = None) -> None:
        """Publish a warning, with the error that caused it."""
        if self.listeners:
            self.publish(now, "warning", text, {} if error is None else error.as_dict())

    def failure(self, now: float, kind: str, error: NavError) -> None:
        """Publish a failure: `plan_failed` or `control_failed`."""
        if self.hears(kind):
            self.publish(now, kind, error.message, error.as_dict())

    def feedback(self, now: float, pose: Pose2D) -> None:
        """Publish the robot's pose, if a listener asks for it: most runs have none that does."""
        for listener in self.listeners:
            if getattr(listener, "hears_feedback", True):
                self.publish(now, "feedback", "", {"pose": list(pose)})
                return

    def plan(self, now: float, plan: Plan) -> None:
        """Publish the key figures of a plan."""
        if not self.hears("plan"):
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

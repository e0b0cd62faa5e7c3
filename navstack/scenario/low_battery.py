"""The rule `low_battery`: a robot that runs low interrupts its goal, charges, and drives on to the goal."""

from __future__ import annotations

from typing import Any

from navstack.core import Event, NavError, Pose2D
from navstack.docking import DockDatabase, Docking, DockTask, Undocking
from navstack.move_base import GoalHandle, GoalResult, GoalStatus, MoveBase
from navstack.plugins import ParamModel, param


class LowBattery(ParamModel):
    """`low_battery:` go to a charger before the battery is empty, then go on."""

    threshold: float = param(0.2, "charge below which the robot goes to the charger", gt=0.0, lt=1.0)
    resume: float = param(0.9, "charge at which it goes on", gt=0.0, le=1.0)
    dock: str = param("", "name of the dock; none: the nearest one")


class ChargingErrand:
    """In place of a goal: cancel it, dock, charge, undock. Then `is_over`, and the goal is sent again; or it failed.

    It has the interface of the handle of a goal.
    """

    def __init__(
        self, rule: LowBattery, interrupted: GoalHandle, move_base: MoveBase, docks: DockDatabase, charge: float
    ) -> None:
        self.task: DockTask | None = None
        self.is_over = False
        """True once the robot has undocked."""
        self._rule, self._goal, self._move_base, self._docks = rule, interrupted, move_base, docks
        self._failure: NavError | None = None
        move_base.cancel_goal(interrupted)
        text = f"the battery is at {charge:.0%}: {interrupted.id} is interrupted to charge"
        event = Event(move_base.last_tick.time, "docking", text, {"interrupted": interrupted.id, "charge": charge})
        for listener in move_base.listeners:
            listener.on_event(event)

    def advance(self) -> None:
        """Go on after a tick of the goal manager."""
        task = self.task
        if task is None:
            if self._goal.is_done:
                self._start(dock=True)
            return
        task.advance()
        if not task.is_done or not task.succeeded:
            return
        if task.kind == "dock":
            self._start(dock=False)
        else:
            self.is_over = True

    def cancel(self) -> None:
        """Stop the robot and end."""
        if self.task is not None:
            self.task.cancel()

    def _start(self, *, dock: bool) -> None:
        move_base, docks = self._move_base, self._docks
        try:
            self.task = self._docking() if dock else Undocking(move_base, docks)
        except NavError as exc:
            self._failure = exc
            return
        self.task.errand = True
        self.task.start()

    def _docking(self) -> Docking:
        here = self._move_base.global_costmap.robot_pose(self._move_base.last_tick.time)
        docks = self._docks.docks
        nearest = min(docks, key=lambda name: here.distance_to(docks[name].pose), default="")
        return Docking(self._move_base, self._docks, self._rule.dock or nearest, charge_until=self._rule.resume)

    # --- the handle of a goal -----------------------------------------------------------------------------------------

    @property
    def is_done(self) -> bool:
        """True if docking or undocking failed."""
        return self._failure is not None or (self.task is not None and self.task.is_done and not self.task.succeeded)

    @property
    def status(self) -> GoalStatus:
        """The state of the goal."""
        if self._failure is not None:
            return GoalStatus.ABORTED
        return self.task.status if self.is_done and self.task is not None else GoalStatus.ACTIVE

    @property
    def text(self) -> str:
        """Why it failed."""
        return self.result.message

    @property
    def target(self) -> Pose2D | None:
        """None: the goal itself is the target."""
        return None

    @property
    def result(self) -> GoalResult:
        """The outcome: the failure of docking."""
        if self.task is None or self._failure is not None:
            return GoalResult.of(self.status, "", self._failure)
        return self.task.result

    @property
    def data(self) -> dict[str, Any]:
        """The states of docking."""
        return {} if self.task is None else self.task.data

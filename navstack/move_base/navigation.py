"""State that the parts of `MoveBase` share, and the transitions that change it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from navstack.core import Pose2D
from navstack.core.errors import InternalError, NavError
from navstack.interfaces import (
    CostmapServer,
    GlobalPlanner,
    LocalPlan,
    LocalPlanner,
    Plan,
    RecoveryBehavior,
    Robot,
)
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.events import EventPublisher
from navstack.move_base.state_machine import step
from navstack.move_base.states import Action, Mode, NavEvent, NavState, Outcome, Transition
from navstack.move_base.tick_result import TickResult
from navstack.parameters.models.move_base import MoveBaseParams

_ILLEGAL_ACTIONS = (Action.STOP_PLANNER, Action.DROP_RECOVERY, Action.STOP, Action.STOP_COSTMAPS)


@dataclass(slots=True, eq=False)
class Navigation:
    """The plugins, the parameters, the active goal and its plans; `apply` is the only way to change the mode."""

    params: MoveBaseParams
    robot: Robot
    global_costmap: CostmapServer
    local_costmap: CostmapServer
    global_planner: GlobalPlanner
    local_planner: LocalPlanner
    recoveries: tuple[RecoveryBehavior, ...]
    events: EventPublisher
    state: NavState = NavState()
    goal: ActiveGoal | None = None
    """The active goal; None in the mode IDLE."""
    plan: Plan | None = None
    """The last plan for the active goal."""
    new_plan: Plan | None = None
    """That plan, until the local planner receives it."""
    local_plan: LocalPlan | None = None
    pose: Pose2D | None = None
    """The robot in the global costmap's frame in the last control cycle; None if unknown."""
    last_tick: TickResult = field(default_factory=lambda: TickResult(0.0))
    actions: Mapping[Action, Callable[[float], None]] = field(default_factory=dict[Action, Callable[[float], None]])
    """What executes each action, called with the time (s)."""
    finish: Callable[[Outcome, float], None] = lambda outcome, now: None
    """What ends the active goal, called with the outcome and the time (s)."""

    @property
    def is_idle(self) -> bool:
        """True without an active goal."""
        return self.state.mode is Mode.IDLE

    def drop_plans(self) -> None:
        """Discard the plans."""
        self.plan = self.new_plan = self.local_plan = None

    def apply(self, event: NavEvent, now: float, error: NavError | None = None) -> None:
        """Take the transition of an event at `now` (s), execute its actions and end the goal if the transition does.

        `error` is the reason for the event. An event that is illegal in the present state ends the goal.
        """
        if error is not None and self.goal is not None:
            self.goal.error = error
        before = self.state
        try:
            state, row = step(before, event)
        except InternalError as exc:
            if self.goal is not None:
                self.goal.error = exc
            state = NavState()
            row = Transition(before.mode, event, Mode.IDLE, _ILLEGAL_ACTIONS, Outcome.BAD_STATE)
        self.state = state
        if state.mode is not before.mode:
            self.events.state(now, before, state, event)
        for action in row.actions:
            self.actions[action](now)
        if row.outcome is not None:
            self.finish(row.outcome, now)

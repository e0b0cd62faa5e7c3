"""The goal manager's states: modes, events, actions and outcomes, the transition table as data, and the machine that reads it.

`step` is a pure function of the table. `MoveBase` determines the events (conditions such as patience, retries and sensor
data) and executes the actions.

Source: move_base/include/move_base/move_base.h (MoveBaseState, RecoveryTrigger), move_base/src/move_base.cpp (executeCb,
executeCycle, planThread, resetState). There, states, timers, locks and transitions are interleaved in two threads.

ROS differs (parity 24): one transition per cycle. In C++ a cycle that finds the robot oscillating continues to control, and
a late plan or a failed command can undo the CLEARING.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from navstack.core import InternalError

# --- texts: those of move_base to the letter, because clients compare them ----------------------------------------------

# move_base: status texts
REACHED: Final = "Goal reached."
CANCELED: Final = ""
BAD_QUATERNION: Final = "Aborting on goal because it was sent with an invalid quaternion"
PLAN_REFUSED: Final = "Failed to pass global plan to the controller."
NO_PLAN: Final = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL: Final = "Failed to find a valid control. Even after executing recovery behaviors."
OSCILLATING: Final = "Robot is oscillating. Even after executing recovery behaviors."
BAD_STATE: Final = "Reached a case that should not be hit in move_base. This is a bug, please report it."
KILLED: Final = "Aborting on the goal because the node has been killed"

# additions: ROS never ends such a goal
STALE_SENSORS: Final = "Sensor data is out of date: the robot was stopped for safety and no new data arrived."
BAD_POSITION: Final = "Aborting on goal because its position is not a finite number"
TIME_LIMIT: Final = "Aborting on goal because its time limit has expired"
LOST: Final = "The robot does not know where it is: it was stopped, and did not find itself."
DRIVER_FAILED: Final = "Aborting on goal because the robot rejects commands"

# move_base: log
LOG_STALE: Final = "[{name}]:Sensor data is out of date, we're not going to allow commanding of the base for safety"
LOG_NO_PLAN: Final = "Aborting because a valid plan could not be found. Even after executing all recovery behaviors"
LOG_NO_CONTROL: Final = (
    "Aborting because a valid control could not be found. Even after executing all recovery behaviors"
)
LOG_OSCILLATING: Final = (
    "Aborting because the robot appears to be oscillating over and over. Even after executing all recovery behaviors"
)
LOG_LOST: Final = "Aborting because the robot is lost. Even after executing all recovery behaviors"
LOG_NEW_PLAN: Final = "Got new plan"
LOG_REACHED: Final = "Goal reached"
LOG_BUSY: Final = "move_base must be in an inactive state to make a plan for an external user"

# --- modes, events, actions, outcomes ----------------------------------------------------------------------------------


class Mode(Enum):
    """What the goal manager does (MoveBaseState, plus IDLE)."""

    # Enum.__hash__ is Python code, and the table is read several times per tick: 0.1 us per look-up
    __hash__ = object.__hash__

    IDLE = "IDLE"
    PLANNING = "PLANNING"
    CONTROLLING = "CONTROLLING"
    CLEARING = "CLEARING"


class Trigger(IntEnum):
    """Reason of the last recovery (RecoveryTrigger)."""

    PLANNING_R = 0
    CONTROLLING_R = 1
    OSCILLATION_R = 2
    LOST_R = 3
    """An addition to ROS."""


class NavEvent(Enum):
    """An event; the value describes it."""

    __hash__ = object.__hash__

    GOAL_ACCEPTED = "a goal is accepted while idle"
    GOAL_REPLACED = "a new goal replaces the active goal"
    GOAL_INVALID = "the accepted goal has an invalid quaternion or position"
    FRAME_CHANGED = "the global costmap has another frame"
    CANCELED = "the goal was canceled"
    TIMED_OUT = "the goal's time limit has expired (an addition to ROS; no limit by default)"
    CYCLE = "control cycle with current sensor data"
    SENSORS_STALE = "control cycle with stale sensor data"
    SENSORS_LOST = "sensor data has been stale for controller_patience"
    LOST = "the robot is lost, and a recovery behavior is left (lost_action: recover)"
    LOST_WAITING = "control cycle in which the robot waits because it is lost"
    LOST_TOO_LONG = "the robot has been lost for lost_timeout"
    FOUND = "the robot is localized again"
    PLAN_FOUND = "the global planner found a plan"
    PLAN_FAILED = "the global planner found no plan"
    PLANNING_EXHAUSTED = "the global planner found no plan, and planner_patience or max_planning_retries is exhausted"
    PLAN_TAKEN = "the local planner accepted the new plan"
    PLAN_REFUSED = "the local planner rejected the new plan"
    GOAL_REACHED = "the local planner reports the goal reached"
    MOVED = "the robot moved oscillation_distance"
    OSCILLATING = "no progress for oscillation_timeout"
    COMMAND_FOUND = "the local planner found a command"
    COMMAND_FAILED = "the local planner found no command"
    CONTROL_EXHAUSTED = "the local planner found no command for controller_patience"
    RECOVERY_BEGINS = "control cycle in CLEARING with a recovery behavior left"
    RECOVERY_ENDED = "the recovery behavior succeeded or failed"
    RECOVERIES_EXHAUSTED = "control cycle in CLEARING without a recovery behavior left"
    PLANNERS_CHANGED = "a planner was replaced at run time"
    DRIVER_FAILED = "the robot rejects commands"
    SHUTDOWN = "the goal manager is shut down"


class Action(Enum):
    """An action of a transition; the value describes it."""

    __hash__ = object.__hash__

    STOP = "command zero velocity"
    STOP_IF_MOVING = "command zero velocity unless that was the last command"
    WAKE_PLANNER = "request a plan"
    STOP_PLANNER = "stop requesting plans"
    RESET_TIMERS = "restart planner_patience and controller_patience"
    RESET_PLAN_PATIENCE = "restart planner_patience"
    RESET_CONTROL_PATIENCE = "restart controller_patience"
    RESET_OSCILLATION = "restart oscillation_timeout"
    START_RECOVERY = "start the recovery behavior"
    DROP_RECOVERY = "abandon the running recovery behavior"
    START_COSTMAPS = "start costmap updates (shutdown_costmaps)"
    STOP_COSTMAPS = "stop costmap updates (shutdown_costmaps)"


class Outcome(Enum):
    """The end of a goal; the value is the text of C++."""

    REACHED = REACHED
    CANCELED = CANCELED
    BAD_QUATERNION = BAD_QUATERNION
    PLAN_REFUSED = PLAN_REFUSED
    NO_PLAN = NO_PLAN
    NO_CONTROL = NO_CONTROL
    OSCILLATING = OSCILLATING
    BAD_STATE = BAD_STATE
    KILLED = KILLED
    STALE_SENSORS = STALE_SENSORS
    LOST = LOST
    DRIVER_FAILED = DRIVER_FAILED
    TIME_LIMIT = TIME_LIMIT


class IndexRule(Enum):
    """Change of the index in the list of recovery behaviors."""

    KEEP = "keep"
    RESET = "0"
    NEXT = "+1"


class NavState(NamedTuple):
    """State of the state machine."""

    mode: Mode = Mode.IDLE
    trigger: Trigger = Trigger.PLANNING_R
    recovery_index: int = 0
    """Index of the running or next recovery behavior."""

    def change(self, after: NavState, event: NavEvent) -> tuple[str, dict[str, Any]]:
        """Return text and data of the event that publishes a change of the mode."""
        data = {
            "from": self.mode.value,
            "to": after.mode.value,
            "event": event.name,
            "trigger": after.trigger.name,
            "recovery_index": after.recovery_index,
        }
        return f"{self.mode.value} -> {after.mode.value}: {event.value}", data


class Transition(NamedTuple):
    """A row of the transition table."""

    mode: Mode
    event: NavEvent
    to: Mode
    actions: tuple[Action, ...] = ()
    outcome: Outcome | None = None
    """The outcome of a row that ends the goal."""
    index_rule: IndexRule = IndexRule.KEEP
    set_trigger: Trigger | None = None
    """The new trigger; None keeps it."""
    when_trigger: Trigger | None = None
    """The row applies to this trigger only; None: to triggers that no other row names."""


# --- transition table --------------------------------------------------------------------------------------------------

_M, _E, _A, _O, _T, _I = Mode, NavEvent, Action, Outcome, Trigger, IndexRule

# resetState() of C++, plus the end of a stepwise recovery behavior
_RESET = (_A.STOP_PLANNER, _A.DROP_RECOVERY, _A.STOP, _A.STOP_COSTMAPS)
_RECOVER = (_A.STOP_PLANNER, _A.STOP)
_NEW_GOAL = (_A.RESET_TIMERS, _A.RESET_OSCILLATION, _A.WAKE_PLANNER)
_FOUND = (_A.DROP_RECOVERY, _A.STOP, *_NEW_GOAL)
_NEW_PLANNERS = (_A.DROP_RECOVERY, _A.STOP, _A.RESET_TIMERS, _A.WAKE_PLANNER)


def _end(mode: Mode, event: NavEvent, outcome: Outcome, when: Trigger | None = None) -> Transition:
    """Return a row that ends the goal: resetState of C++."""
    return Transition(mode, event, _M.IDLE, _RESET, outcome, _I.RESET, _T.PLANNING_R, when)


def _with_goal(mode: Mode) -> tuple[Transition, ...]:
    """Return the rows that every mode with an active goal has."""
    # while driving, the robot keeps its command until the new plan, or until the next cycle without one
    stop = (_A.STOP_IF_MOVING,) if mode is _M.CLEARING else ()
    restart = (_A.DROP_RECOVERY, *stop, *_NEW_GOAL)
    return (
        Transition(mode, _E.GOAL_REPLACED, _M.PLANNING, restart, index_rule=_I.RESET),
        Transition(mode, _E.FRAME_CHANGED, _M.PLANNING, restart, index_rule=_I.RESET),
        # ROS differs (parity 25): C++ leaves the planner running and the robot moving
        _end(mode, _E.GOAL_INVALID, _O.BAD_QUATERNION),
        _end(mode, _E.CANCELED, _O.CANCELED),
        _end(mode, _E.TIMED_OUT, _O.TIME_LIMIT),
        _end(mode, _E.SENSORS_LOST, _O.STALE_SENSORS),
        _end(mode, _E.DRIVER_FAILED, _O.DRIVER_FAILED),
        _end(mode, _E.SHUTDOWN, _O.KILLED),
        _end(mode, _E.PLAN_REFUSED, _O.PLAN_REFUSED),
        Transition(mode, _E.SENSORS_STALE, mode, (_A.STOP,)),
        # ROS differs (parity 41): amcl does not report that the robot is lost
        Transition(mode, _E.LOST, _M.CLEARING, _RECOVER, set_trigger=_T.LOST_R),
        Transition(mode, _E.LOST_WAITING, mode, (_A.STOP_PLANNER, _A.STOP)),
        _end(mode, _E.LOST_TOO_LONG, _O.LOST),
        Transition(mode, _E.FOUND, _M.PLANNING, _FOUND, index_rule=_I.RESET),
        # a plan or a motion resets the index after recoveries that were triggered by its absence
        Transition(mode, _E.PLAN_TAKEN, mode, index_rule=_I.RESET, when_trigger=_T.PLANNING_R),
        Transition(mode, _E.PLAN_TAKEN, mode),
        Transition(mode, _E.MOVED, mode, index_rule=_I.RESET, when_trigger=_T.OSCILLATION_R),
        Transition(mode, _E.MOVED, mode),
        # resetState() of reconfigureCB. ROS differs: there, patience with the new planner includes time of the old one
        Transition(
            mode, _E.PLANNERS_CHANGED, _M.PLANNING, _NEW_PLANNERS, index_rule=_I.RESET, set_trigger=_T.PLANNING_R
        ),
    )


_GOALS = (
    Transition(_M.IDLE, _E.GOAL_ACCEPTED, _M.PLANNING, (_A.STOP, _A.START_COSTMAPS, *_NEW_GOAL)),
    Transition(_M.IDLE, _E.GOAL_INVALID, _M.IDLE, outcome=_O.BAD_QUATERNION),
)

_IDLE = (
    Transition(_M.IDLE, _E.PLANNERS_CHANGED, _M.IDLE, (_A.STOP,)),
    Transition(_M.IDLE, _E.SHUTDOWN, _M.IDLE, (_A.STOP,)),
)

_PLANNING = (
    Transition(_M.PLANNING, _E.CYCLE, _M.PLANNING, (_A.WAKE_PLANNER,)),
    Transition(_M.PLANNING, _E.PLAN_FOUND, _M.CONTROLLING, (_A.RESET_PLAN_PATIENCE,)),
    Transition(_M.PLANNING, _E.PLAN_FAILED, _M.PLANNING, (_A.STOP_IF_MOVING,)),
    Transition(_M.PLANNING, _E.PLANNING_EXHAUSTED, _M.CLEARING, _RECOVER, set_trigger=_T.PLANNING_R),
)

_CONTROLLING = (
    Transition(_M.CONTROLLING, _E.CYCLE, _M.CONTROLLING),
    Transition(_M.CONTROLLING, _E.PLAN_FOUND, _M.CONTROLLING, (_A.RESET_PLAN_PATIENCE,)),
    Transition(_M.CONTROLLING, _E.PLAN_FAILED, _M.CONTROLLING),  # the robot follows its current plan
    _end(_M.CONTROLLING, _E.GOAL_REACHED, _O.REACHED),
    Transition(_M.CONTROLLING, _E.OSCILLATING, _M.CLEARING, _RECOVER, set_trigger=_T.OSCILLATION_R),
    Transition(
        _M.CONTROLLING,
        _E.COMMAND_FOUND,
        _M.CONTROLLING,
        (_A.RESET_CONTROL_PATIENCE,),
        index_rule=_I.RESET,
        when_trigger=_T.CONTROLLING_R,
    ),
    Transition(_M.CONTROLLING, _E.COMMAND_FOUND, _M.CONTROLLING, (_A.RESET_CONTROL_PATIENCE,)),
    Transition(_M.CONTROLLING, _E.COMMAND_FAILED, _M.PLANNING, (_A.RESET_PLAN_PATIENCE, _A.STOP, _A.WAKE_PLANNER)),
    Transition(_M.CONTROLLING, _E.CONTROL_EXHAUSTED, _M.CLEARING, _RECOVER, set_trigger=_T.CONTROLLING_R),
)

_CLEARING = (
    Transition(_M.CLEARING, _E.CYCLE, _M.CLEARING),
    Transition(_M.CLEARING, _E.PLAN_FOUND, _M.CLEARING),  # in C++ this may undo the CLEARING
    Transition(_M.CLEARING, _E.PLAN_FAILED, _M.CLEARING),
    Transition(_M.CLEARING, _E.RECOVERY_BEGINS, _M.CLEARING, (_A.START_RECOVERY,)),
    # ROS differs (parity 19): the robot is stopped after a recovery
    Transition(
        _M.CLEARING,
        _E.RECOVERY_ENDED,
        _M.PLANNING,
        (_A.DROP_RECOVERY, _A.STOP_IF_MOVING, _A.RESET_PLAN_PATIENCE, _A.RESET_OSCILLATION),
        index_rule=_I.NEXT,
    ),
    _end(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.NO_PLAN, _T.PLANNING_R),
    _end(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.NO_CONTROL, _T.CONTROLLING_R),
    _end(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.OSCILLATING, _T.OSCILLATION_R),
    _end(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.LOST, _T.LOST_R),
)

ROWS: Final[tuple[Transition, ...]] = (
    *_GOALS,
    *_with_goal(_M.PLANNING),
    *_with_goal(_M.CONTROLLING),
    *_with_goal(_M.CLEARING),
    *_IDLE,
    *_PLANNING,
    *_CONTROLLING,
    *_CLEARING,
)
"""Every transition; an event without a row is illegal in that mode."""


# --- machine -----------------------------------------------------------------------------------------------------------


def _indexed() -> dict[tuple[Mode, NavEvent, Trigger], Transition]:
    found: dict[tuple[Mode, NavEvent, Trigger], Transition] = {}
    # rows that name a trigger come first: they have priority
    for row in sorted(ROWS, key=lambda r: r.when_trigger is None):
        for trigger in Trigger if row.when_trigger is None else (row.when_trigger,):
            found.setdefault((row.mode, row.event, trigger), row)
    return found


TABLE: Final[Mapping[tuple[Mode, NavEvent, Trigger], Transition]] = MappingProxyType(_indexed())
"""The rows by (mode, event, trigger)."""


ILLEGAL_ACTIONS: Final = (Action.STOP_PLANNER, Action.DROP_RECOVERY, Action.STOP, Action.STOP_COSTMAPS)
"""What follows an event that is illegal in the current state: the goal ends with BAD_STATE."""


@lru_cache(maxsize=4096)
def step(state: NavState, event: NavEvent) -> tuple[NavState, Transition]:
    """Return the state after `event`, and the row with the actions and the outcome.

    Raises InternalError for an event that is illegal in that state.
    """
    row = TABLE.get((state.mode, event, state.trigger))
    if row is None:
        raise InternalError(
            f"{event.name} is illegal in {state.mode.name}; please report this",
            mode=state.mode.name,
            event=event.name,
            trigger=state.trigger.name,
        )
    rule = row.index_rule
    index = state.recovery_index
    if rule is not IndexRule.KEEP:
        index = 0 if rule is IndexRule.RESET else index + 1
    trigger = state.trigger if row.set_trigger is None else row.set_trigger
    if row.to is state.mode and index == state.recovery_index and trigger is state.trigger:
        return state, row
    return NavState(row.to, trigger, index), row


# --- page of the documentation -----------------------------------------------------------------------------------------


def document_markdown() -> str:
    """Return docs/reference/states.md: states, events, actions and the transition table."""
    parts = [
        "# The goal manager's states",
        (
            "Generated by `navstack info --states docs/reference/states.md` from the table that `MoveBase` uses "
            "(`navstack/move_base/states.py`); do not edit."
        ),
        "![The states and the events between them](../images/states.png)",
        (
            "A transition is a pure function: `step(state, event) -> state, row`. The row contains the actions, and the "
            "outcome if the goal ends. An event without a row is illegal in that mode. A row that names a trigger has "
            "priority over one that does not."
        ),
        "## Events",
        _members("event", "when", NavEvent),
        "## Actions",
        _members("action", "effect", Action),
        "## Outcomes",
        _members("outcome", "text", Outcome),
        "## Transitions",
        table_markdown(),
    ]
    return "\n\n".join(parts) + "\n"


def table_markdown() -> str:
    """Return the transition table."""
    return "\n".join(
        [
            "| mode | event | last trigger | next mode | recovery index | actions | outcome |",
            "|---|---|---|---|---|---|---|",
            *(_line(row) for row in ROWS),
        ]
    )


def _members(name: str, value: str, members: type[Enum]) -> str:
    return "\n".join([f"| {name} | {value} |", "|---|---|", *(f"| {m.name} | {m.value} |" for m in members)])


def _line(row: Transition) -> str:
    cells = (
        row.mode.name,
        row.event.name,
        row.when_trigger.name if row.when_trigger is not None else "",
        row.to.name + (f", {row.set_trigger.name}" if row.set_trigger is not None else ""),
        "" if row.index_rule is IndexRule.KEEP else row.index_rule.value,
        ", ".join(action.name for action in row.actions),
        row.outcome.name if row.outcome is not None else "",
    )
    return f"| {' | '.join(cells)} |"

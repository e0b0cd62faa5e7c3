"""move_base's state machine as a table: (state, event) -> (state, actions).

Source: move_base/src/move_base.cpp (executeCb, executeCycle, planThread, resetState). There, states, timers, locks and
transitions are interleaved in two threads; here `step` is a pure function of a table, and `MoveBase` finds out which
event it is (plugin_calls: patience, retries, sensors) and carries out the actions.

ROS differs (parity 24): one transition per cycle. In C++ a cycle that finds the robot oscillating goes on controlling, and
a late plan or a failed command can undo the CLEARING.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum, IntEnum
from functools import lru_cache
from types import MappingProxyType
from typing import Final, NamedTuple

from navstack.core.errors import InternalError
from navstack.move_base import status_messages


class Mode(Enum):
    """What the goal manager is doing (move_base.h MoveBaseState, plus idle)."""

    __hash__ = object.__hash__  # Enum's own is Python code, and `step` is called several times a tick

    IDLE = "IDLE"
    PLANNING = "PLANNING"
    CONTROLLING = "CONTROLLING"
    CLEARING = "CLEARING"


class Trigger(IntEnum):
    """What the last recovery was for (move_base.h RecoveryTrigger)."""

    PLANNING_R = 0
    CONTROLLING_R = 1
    OSCILLATION_R = 2


class NavEvent(Enum):
    """What can happen to the machine; the value says when."""

    __hash__ = object.__hash__

    GOAL_ACCEPTED = "a goal is accepted while there is none"
    GOAL_REPLACED = "another goal is accepted while there is one"
    GOAL_INVALID = "the goal accepted cannot be one (quaternion, position)"
    FRAME_CHANGED = "the global costmap's frame is another one now"
    CANCELED = "the goal was cancelled"
    TIMED_OUT = "the goal's own time limit is over (ours; none by default)"
    CYCLE = "a control cycle, sensors current"
    SENSORS_STALE = "a control cycle, a sensor is silent"
    SENSORS_LOST = "a sensor has been silent for controller_patience"
    PLAN_FOUND = "the global planner has a plan"
    PLAN_FAILED = "the global planner has none"
    PLANNING_EXHAUSTED = "it has none, and planner_patience or max_planning_retries is used up"
    PLAN_TAKEN = "the local planner has the new plan"
    PLAN_REFUSED = "the local planner refuses the new plan"
    GOAL_REACHED = "the local planner says the goal is reached"
    MOVED = "the robot is oscillation_distance from where it last was so"
    OSCILLATING = "no progress for oscillation_timeout"
    COMMAND_FOUND = "the local planner has a command"
    COMMAND_FAILED = "the local planner has none"
    CONTROL_EXHAUSTED = "it has none, and has had none for controller_patience"
    RECOVERY_BEGINS = "the next cycle of CLEARING, a recovery is left"
    RECOVERY_ENDED = "the recovery behaviour is done, or has failed"
    RECOVERIES_EXHAUSTED = "the next cycle of CLEARING, no recovery is left"
    PLANNERS_CHANGED = "a planner plugin was exchanged at run time"
    DRIVER_FAILED = "the robot does not take commands"
    SHUTDOWN = "the goal manager is shut down"


class Action(Enum):
    """An action of a transition; the value describes it."""

    __hash__ = object.__hash__

    STOP = "command zero velocity"
    STOP_IF_MOVING = "command zero velocity unless that was the last command"
    WAKE_PLANNER = "plan now"
    STOP_PLANNER = "plan no more"
    RESET_TIMERS = "all patience starts anew"
    RESET_PLAN_PATIENCE = "the patience with the global planner starts anew"
    RESET_CONTROL_PATIENCE = "the patience with the local planner starts anew"
    RESET_OSCILLATION = "the patience with the robot's progress starts anew"
    START_RECOVERY = "start the recovery behaviour"
    DROP_RECOVERY = "abandon the recovery behaviour that runs"
    START_COSTMAPS = "update the costmaps again (shutdown_costmaps)"
    STOP_COSTMAPS = "update them no more (shutdown_costmaps)"


class Outcome(Enum):
    """How a goal ends; the value is C++'s text."""

    REACHED = status_messages.REACHED
    CANCELED = status_messages.CANCELED
    BAD_QUATERNION = status_messages.BAD_QUATERNION
    PLAN_REFUSED = status_messages.PLAN_REFUSED
    NO_PLAN = status_messages.NO_PLAN
    NO_CONTROL = status_messages.NO_CONTROL
    OSCILLATING = status_messages.OSCILLATING
    BAD_STATE = status_messages.BAD_STATE
    KILLED = status_messages.KILLED
    STALE_SENSORS = status_messages.STALE_SENSORS
    DRIVER_FAILED = status_messages.DRIVER_FAILED
    TIME_LIMIT = status_messages.TIME_LIMIT


class IndexRule(Enum):
    """What becomes of the position in the list of recoveries."""

    KEEP = "keep"
    RESET = "0"
    NEXT = "+1"


class NavState(NamedTuple):
    """The whole state."""

    mode: Mode = Mode.IDLE
    trigger: Trigger = Trigger.PLANNING_R
    recovery_index: int = 0
    """Which recovery is next, or runs."""


class Transition(NamedTuple):
    """A row of the table."""

    mode: Mode
    event: NavEvent
    to: Mode
    actions: tuple[Action, ...] = ()
    outcome: Outcome | None = None
    index_rule: IndexRule = IndexRule.KEEP
    set_trigger: Trigger | None = None
    when_trigger: Trigger | None = None
    """The row holds for this trigger only; None: for those that no other row names."""


_M, _E, _A, _O, _T = Mode, NavEvent, Action, Outcome, Trigger
_ACTIVE = (_M.PLANNING, _M.CONTROLLING, _M.CLEARING)
# resetState(), plus what a stepwise recovery needs
_RESET = (_A.STOP_PLANNER, _A.DROP_RECOVERY, _A.STOP, _A.STOP_COSTMAPS)


def _ends(mode: Mode, event: NavEvent, outcome: Outcome, when: Trigger | None = None) -> Transition:
    """A row that ends the goal: resetState of C++."""
    return Transition(mode, event, _M.IDLE, _RESET, outcome, IndexRule.RESET, _T.PLANNING_R, when)


def _rows() -> Iterable[Transition]:
    # --- goals
    yield Transition(
        _M.IDLE,
        _E.GOAL_ACCEPTED,
        _M.PLANNING,
        (_A.STOP, _A.START_COSTMAPS, _A.RESET_TIMERS, _A.RESET_OSCILLATION, _A.WAKE_PLANNER),
    )
    yield Transition(_M.IDLE, _E.GOAL_INVALID, _M.IDLE, outcome=_O.BAD_QUATERNION)
    for mode in _ACTIVE:
        # no stop while driving: the robot keeps its command until the new plan, or the next cycle without one
        halt = (_A.STOP_IF_MOVING,) if mode is _M.CLEARING else ()
        for event in (_E.GOAL_REPLACED, _E.FRAME_CHANGED):
            yield Transition(
                mode,
                event,
                _M.PLANNING,
                (_A.DROP_RECOVERY, *halt, _A.RESET_TIMERS, _A.RESET_OSCILLATION, _A.WAKE_PLANNER),
                index_rule=IndexRule.RESET,
            )
        # ROS differs (parity 25): C++ leaves the planner running and the robot moving
        yield _ends(mode, _E.GOAL_INVALID, _O.BAD_QUATERNION)
        yield _ends(mode, _E.CANCELED, _O.CANCELED)
        yield _ends(mode, _E.TIMED_OUT, _O.TIME_LIMIT)
        yield _ends(mode, _E.SENSORS_LOST, _O.STALE_SENSORS)
        yield _ends(mode, _E.DRIVER_FAILED, _O.DRIVER_FAILED)
        yield _ends(mode, _E.SHUTDOWN, _O.KILLED)
        yield _ends(mode, _E.PLAN_REFUSED, _O.PLAN_REFUSED)
        yield Transition(mode, _E.SENSORS_STALE, mode, (_A.STOP,))
        # recovery_index: a plan, a command, a motion ends the row of recoveries that was for want of it
        yield Transition(mode, _E.PLAN_TAKEN, mode, index_rule=IndexRule.RESET, when_trigger=_T.PLANNING_R)
        yield Transition(mode, _E.PLAN_TAKEN, mode)
        yield Transition(mode, _E.MOVED, mode, index_rule=IndexRule.RESET, when_trigger=_T.OSCILLATION_R)
        yield Transition(mode, _E.MOVED, mode)
        # resetState() of reconfigureCB; ROS differs: there patience goes on running against the new planner
        yield Transition(
            mode,
            _E.PLANNERS_CHANGED,
            _M.PLANNING,
            (_A.DROP_RECOVERY, _A.STOP, _A.RESET_TIMERS, _A.WAKE_PLANNER),
            index_rule=IndexRule.RESET,
            set_trigger=_T.PLANNING_R,
        )
    yield Transition(_M.IDLE, _E.PLANNERS_CHANGED, _M.IDLE, (_A.STOP,))
    yield Transition(_M.IDLE, _E.SHUTDOWN, _M.IDLE, (_A.STOP,))

    # --- PLANNING
    yield Transition(_M.PLANNING, _E.CYCLE, _M.PLANNING, (_A.WAKE_PLANNER,))
    yield Transition(_M.PLANNING, _E.PLAN_FOUND, _M.CONTROLLING, (_A.RESET_PLAN_PATIENCE,))
    yield Transition(_M.PLANNING, _E.PLAN_FAILED, _M.PLANNING, (_A.STOP_IF_MOVING,))
    yield Transition(
        _M.PLANNING, _E.PLANNING_EXHAUSTED, _M.CLEARING, (_A.STOP_PLANNER, _A.STOP), set_trigger=_T.PLANNING_R
    )

    # --- CONTROLLING
    yield Transition(_M.CONTROLLING, _E.CYCLE, _M.CONTROLLING)
    yield Transition(_M.CONTROLLING, _E.PLAN_FOUND, _M.CONTROLLING, (_A.RESET_PLAN_PATIENCE,))
    yield Transition(_M.CONTROLLING, _E.PLAN_FAILED, _M.CONTROLLING)  # the robot follows the plan it has
    yield _ends(_M.CONTROLLING, _E.GOAL_REACHED, _O.REACHED)
    yield Transition(
        _M.CONTROLLING, _E.OSCILLATING, _M.CLEARING, (_A.STOP_PLANNER, _A.STOP), set_trigger=_T.OSCILLATION_R
    )
    yield Transition(
        _M.CONTROLLING,
        _E.COMMAND_FOUND,
        _M.CONTROLLING,
        (_A.RESET_CONTROL_PATIENCE,),
        index_rule=IndexRule.RESET,
        when_trigger=_T.CONTROLLING_R,
    )
    yield Transition(_M.CONTROLLING, _E.COMMAND_FOUND, _M.CONTROLLING, (_A.RESET_CONTROL_PATIENCE,))
    yield Transition(_M.CONTROLLING, _E.COMMAND_FAILED, _M.PLANNING, (_A.RESET_PLAN_PATIENCE, _A.STOP, _A.WAKE_PLANNER))
    yield Transition(
        _M.CONTROLLING, _E.CONTROL_EXHAUSTED, _M.CLEARING, (_A.STOP_PLANNER, _A.STOP), set_trigger=_T.CONTROLLING_R
    )

    # --- CLEARING
    yield Transition(_M.CLEARING, _E.CYCLE, _M.CLEARING)
    yield Transition(_M.CLEARING, _E.PLAN_FOUND, _M.CLEARING)  # C++: may undo the CLEARING
    yield Transition(_M.CLEARING, _E.PLAN_FAILED, _M.CLEARING)
    yield Transition(_M.CLEARING, _E.RECOVERY_BEGINS, _M.CLEARING, (_A.START_RECOVERY,))
    # ROS differs (parity 19): the robot is stopped after a recovery
    yield Transition(
        _M.CLEARING,
        _E.RECOVERY_ENDED,
        _M.PLANNING,
        (_A.DROP_RECOVERY, _A.STOP_IF_MOVING, _A.RESET_PLAN_PATIENCE, _A.RESET_OSCILLATION),
        index_rule=IndexRule.NEXT,
    )
    yield _ends(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.NO_PLAN, _T.PLANNING_R)
    yield _ends(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.NO_CONTROL, _T.CONTROLLING_R)
    yield _ends(_M.CLEARING, _E.RECOVERIES_EXHAUSTED, _O.OSCILLATING, _T.OSCILLATION_R)


ROWS: Final[tuple[Transition, ...]] = tuple(_rows())
"""The table as written, for people."""


def _indexed() -> dict[tuple[Mode, NavEvent, Trigger], Transition]:
    found: dict[tuple[Mode, NavEvent, Trigger], Transition] = {}
    # rows that name a trigger first: they win over those that do not
    for row in sorted(ROWS, key=lambda r: r.when_trigger is None):
        for trigger in Trigger if row.when_trigger is None else (row.when_trigger,):
            found.setdefault((row.mode, row.event, trigger), row)
    return found


TABLE: Final[Mapping[tuple[Mode, NavEvent, Trigger], Transition]] = MappingProxyType(_indexed())
"""The same by (mode, event, trigger), for machines. What is not in it cannot happen."""


@lru_cache(maxsize=4096)
def step(state: NavState, event: NavEvent) -> tuple[NavState, Transition]:
    """The state after `event`, and the row that says what is to be done and whether the goal ends.

    Raises InternalError for an event that cannot happen in that state.
    """
    row = TABLE.get((state.mode, event, state.trigger))
    if row is None:
        raise InternalError(
            f"{event.name} cannot happen in {state.mode.name}; please report this",
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


def table_markdown() -> str:
    """The table for the documentation."""
    lines = [
        "| in | on | if the last trigger is | to | recovery index | do | the goal ends |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in ROWS:
        trigger = row.when_trigger.name if row.when_trigger is not None else ""
        to = row.to.name + (f", {row.set_trigger.name}" if row.set_trigger is not None else "")
        index = "" if row.index_rule is IndexRule.KEEP else row.index_rule.value
        does = ", ".join(action.name for action in row.actions)
        end = row.outcome.name if row.outcome is not None else ""
        lines.append(f"| {row.mode.name} | {row.event.name} | {trigger} | {to} | {index} | {does} | {end} |")
    return "\n".join(lines)


def document_markdown() -> str:
    """docs/reference/states.md: states, events, actions and the table."""
    parts = [
        "# The goal manager's states",
        (
            "Written by `navstack info --states docs/reference/states.md` from the table that `MoveBase` runs on "
            "(`navstack/move_base/state_machine.py`); do not edit."
        ),
        "![The states and the events between them](../images/states.png)",
        (
            "A transition is a pure function: `step(state, event) -> state, row`. The row says what is to be done and how the "
            "goal ends, if it does. "
            "What is not in the table cannot happen. A row that names a trigger wins over one that does not."
        ),
        "## Events",
        "\n".join(["| event | when |", "|---|---|", *(f"| {e.name} | {e.value} |" for e in NavEvent)]),
        "## Actions",
        "\n".join(["| action | what is done |", "|---|---|", *(f"| {a.name} | {a.value} |" for a in Action)]),
        "## How a goal ends",
        "\n".join(["| outcome | text |", "|---|---|", *(f"| {o.name} | {o.value} |" for o in Outcome)]),
        "## Transitions",
        table_markdown(),
    ]
    return "\n\n".join(parts) + "\n"

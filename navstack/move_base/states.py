"""Modes, events, actions and outcomes of the goal manager.

Source: move_base/include/move_base/move_base.h (MoveBaseState, RecoveryTrigger).
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import NamedTuple

from navstack.move_base import status_messages


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
    CANCELED = "the goal was cancelled"
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
    LOST = status_messages.LOST
    DRIVER_FAILED = status_messages.DRIVER_FAILED
    TIME_LIMIT = status_messages.TIME_LIMIT


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

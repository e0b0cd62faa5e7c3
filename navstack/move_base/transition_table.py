"""The transition table of the goal manager, as data.

Source: move_base/src/move_base.cpp (executeCb, executeCycle, planThread, resetState). There, states, timers, locks and
transitions are interleaved in two threads.

ROS differs (parity 24): one transition per cycle. In C++ a cycle that finds the robot oscillating continues to control, and
a late plan or a failed command can undo the CLEARING.
"""

from __future__ import annotations

from typing import Final

from navstack.move_base.states import Action, IndexRule, Mode, NavEvent, Outcome, Transition, Trigger

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
    Transition(_M.CONTROLLING, _E.PLAN_FAILED, _M.CONTROLLING),  # the robot follows its present plan
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

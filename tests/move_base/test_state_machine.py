from __future__ import annotations

import itertools

import pytest

from navstack.core import InternalError
from navstack.move_base import Mode, Trigger, states
from navstack.move_base.states import ROWS, TABLE, Action, NavEvent, NavState, Outcome, step, table_markdown

# event: (to, recovery index, outcome) per mode; "=" self-transition, "-" illegal.
# index: . keep, 0 reset, + next, p/c/o reset when the trigger is PLANNING_R/CONTROLLING_R/OSCILLATION_R; L the trigger LOST_R
EXPECTED_TABLE = """
event                IDLE                  PLANNING             CONTROLLING          CLEARING
GOAL_ACCEPTED        PLANNING/.            -                    -                    -
GOAL_REPLACED        -                     PLANNING/0           PLANNING/0           PLANNING/0
GOAL_INVALID         IDLE/./BAD_QUATERNION IDLE/0/BAD_QUATERNION IDLE/0/BAD_QUATERNION IDLE/0/BAD_QUATERNION
FRAME_CHANGED        -                     PLANNING/0           PLANNING/0           PLANNING/0
CANCELED             -                     IDLE/0/CANCELED      IDLE/0/CANCELED      IDLE/0/CANCELED
TIMED_OUT            -                     IDLE/0/TIME_LIMIT    IDLE/0/TIME_LIMIT    IDLE/0/TIME_LIMIT
CYCLE                -                     =/.                  =/.                  =/.
SENSORS_STALE        -                     =/.                  =/.                  =/.
SENSORS_LOST         -                     IDLE/0/STALE_SENSORS IDLE/0/STALE_SENSORS IDLE/0/STALE_SENSORS
LOST                 -                     CLEARING/./L         CLEARING/./L         CLEARING/./L
LOST_WAITING         -                     =/.                  =/.                  =/.
LOST_TOO_LONG        -                     IDLE/0/LOST          IDLE/0/LOST          IDLE/0/LOST
FOUND                -                     PLANNING/0           PLANNING/0           PLANNING/0
PLAN_FOUND           -                     CONTROLLING/.        =/.                  =/.
PLAN_FAILED          -                     =/.                  =/.                  =/.
PLANNING_EXHAUSTED   -                     CLEARING/./P         -                    -
PLAN_TAKEN           -                     =/p                  =/p                  =/p
PLAN_REFUSED         -                     IDLE/0/PLAN_REFUSED  IDLE/0/PLAN_REFUSED  IDLE/0/PLAN_REFUSED
GOAL_REACHED         -                     -                    IDLE/0/REACHED       -
MOVED                -                     =/o                  =/o                  =/o
OSCILLATING          -                     -                    CLEARING/./O         -
COMMAND_FOUND        -                     -                    =/c                  -
COMMAND_FAILED       -                     -                    PLANNING/.           -
CONTROL_EXHAUSTED    -                     -                    CLEARING/./C         -
RECOVERY_BEGINS      -                     -                    -                    =/.
RECOVERY_ENDED       -                     -                    -                    PLANNING/+
RECOVERIES_EXHAUSTED -                     -                    -                    IDLE/0/by-trigger
PLANNERS_CHANGED     IDLE/.                PLANNING/0/P         PLANNING/0/P         PLANNING/0/P
DRIVER_FAILED        -                     IDLE/0/DRIVER_FAILED IDLE/0/DRIVER_FAILED IDLE/0/DRIVER_FAILED
SHUTDOWN             IDLE/.                IDLE/0/KILLED        IDLE/0/KILLED        IDLE/0/KILLED
"""
_, *LINES = EXPECTED_TABLE.strip().split("\n")
MEANT = {
    (mode, NavEvent[line.split()[0]]): cell for line in LINES for mode, cell in zip(Mode, line.split()[1:], strict=True)
}
TRIGGERS = {
    "P": Trigger.PLANNING_R,
    "C": Trigger.CONTROLLING_R,
    "O": Trigger.OSCILLATION_R,
    "L": Trigger.LOST_R,
}
BY_TRIGGER = {
    Trigger.PLANNING_R: Outcome.NO_PLAN,
    Trigger.CONTROLLING_R: Outcome.NO_CONTROL,
    Trigger.OSCILLATION_R: Outcome.OSCILLATING,
    Trigger.LOST_R: Outcome.LOST,
}


def test_the_table_here_is_complete() -> None:
    assert len(MEANT) == len(Mode) * len(NavEvent)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "event", "trigger"), list(itertools.product(Mode, NavEvent, Trigger)), ids=lambda v: v.name
)
def test_every_entry(mode: Mode, event: NavEvent, trigger: Trigger) -> None:
    before = NavState(mode, trigger, 3)
    cell = MEANT[mode, event]
    if cell == "-":
        with pytest.raises(InternalError, match=f"{event.name} is illegal in {mode.name}"):
            step(before, event)
        return
    to, index, *rest = cell.split("/")
    state, row = step(before, event)
    assert state.mode is (mode if to == "=" else Mode[to])
    resets = index == "0" or (index in "pco" and TRIGGERS[index.upper()] is trigger)
    assert state.recovery_index == (0 if resets else 4 if index == "+" else 3)
    note = rest[0] if rest else ""
    if note in TRIGGERS:
        assert (state.trigger, row.outcome) == (TRIGGERS[note], None)
    elif note == "by-trigger":
        assert (state, row.outcome) == (NavState(), BY_TRIGGER[trigger])
    elif note:
        assert row.outcome is Outcome[note]
        if mode is not Mode.IDLE:
            assert state == NavState()
    else:
        assert row.outcome is None
        assert state.trigger is trigger


def test_every_row_is_reachable() -> None:
    assert {id(row) for row in TABLE.values()} == {id(row) for row in ROWS}


def test_rows_that_end_a_goal_stop_robot_and_planner() -> None:
    for row in ROWS:
        if row.outcome is not None and row.mode is not Mode.IDLE:
            assert row.to is Mode.IDLE
            assert {Action.STOP, Action.STOP_PLANNER, Action.DROP_RECOVERY} <= set(row.actions), row


def test_rows_that_leave_controlling_stop_the_robot_except_for_a_new_goal() -> None:
    for row in ROWS:
        if row.mode is Mode.CONTROLLING and row.to is not Mode.CONTROLLING:
            replaced = row.event in (NavEvent.GOAL_REPLACED, NavEvent.FRAME_CHANGED)
            assert (Action.STOP in row.actions) != replaced, row


def test_outcomes_have_the_texts_of_cpp() -> None:
    assert {o.name: o.value for o in Outcome} == {
        "REACHED": "Goal reached.",
        "CANCELED": "",
        "BAD_QUATERNION": "Aborting on goal because it was sent with an invalid quaternion",
        "PLAN_REFUSED": "Failed to pass global plan to the controller.",
        "NO_PLAN": "Failed to find a valid plan. Even after executing recovery behaviors.",
        "NO_CONTROL": "Failed to find a valid control. Even after executing recovery behaviors.",
        "OSCILLATING": "Robot is oscillating. Even after executing recovery behaviors.",
        "BAD_STATE": "Reached a case that should not be hit in move_base. This is a bug, please report it.",
        "KILLED": "Aborting on the goal because the node has been killed",
        "STALE_SENSORS": states.STALE_SENSORS,
        "LOST": states.LOST,
        "DRIVER_FAILED": states.DRIVER_FAILED,
        "TIME_LIMIT": states.TIME_LIMIT,
    }


def test_the_table_as_markdown() -> None:
    lines = table_markdown().split("\n")
    assert len(lines) == 2 + len(ROWS)
    assert all(line.count("|") == 8 for line in lines)
    assert "| CLEARING | RECOVERIES_EXHAUSTED | OSCILLATION_R | IDLE, PLANNING_R | 0 |" in table_markdown()

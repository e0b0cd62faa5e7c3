from __future__ import annotations

import pytest

from navstack.core import GoalTransitionError
from navstack.move_base.goals import SERVER_TRANSITIONS, GoalStatus, ServerCall, after

NUMBERS = [
    "PENDING",
    "ACTIVE",
    "PREEMPTED",
    "SUCCEEDED",
    "ABORTED",
    "REJECTED",
    "PREEMPTING",
    "RECALLING",
    "RECALLED",
    "LOST",
]

# columns in the order of the numbers; "-" = illegal
TABLE = """
setAccepted          ACTIVE     -          - - - - -          PREEMPTING - -
setCancelRequested   RECALLING  PREEMPTING - - - - -          -          - -
setCanceled          RECALLED   PREEMPTED  - - - - PREEMPTED  RECALLED   - -
setRejected          REJECTED   -          - - - - -          REJECTED   - -
setAborted           -          ABORTED    - - - - ABORTED    -          - -
setSucceeded         -          SUCCEEDED  - - - - SUCCEEDED  -          - -
"""
CELLS = [
    (ServerCall(call), GoalStatus(number), None if cell == "-" else GoalStatus[cell])
    for call, *cells in (line.split() for line in TABLE.split("\n") if line)
    for number, cell in enumerate(cells)
]


def test_numbers_of_ros() -> None:
    assert [s.name for s in sorted(GoalStatus)] == NUMBERS
    assert [int(GoalStatus[name]) for name in NUMBERS] == list(range(10))


def test_terminal_states() -> None:
    terminal = {s.name for s in GoalStatus if s.is_terminal}
    assert terminal == {"PREEMPTED", "SUCCEEDED", "ABORTED", "REJECTED", "RECALLED", "LOST"}


def test_the_table_here_is_complete() -> None:
    assert len(CELLS) == len(ServerCall) * len(GoalStatus)
    assert len(SERVER_TRANSITIONS) == sum(cell[2] is not None for cell in CELLS) == 14


@pytest.mark.parametrize(("call", "before", "reached"), CELLS, ids=lambda v: getattr(v, "name", "illegal"))
def test_every_entry_of_the_server_table(call: ServerCall, before: GoalStatus, reached: GoalStatus | None) -> None:
    if reached is not None:
        assert after(call, before) is reached
        return
    with pytest.raises(GoalTransitionError) as caught:
        after(call, before)
    assert before.name in caught.value.message
    assert call.value in caught.value.message
    assert caught.value.data["status"] == before.name

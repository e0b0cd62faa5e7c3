from __future__ import annotations

import pytest

from navstack.core import GoalTransitionError, InputError, Pose2D
from navstack.move_base import GoalStatus, SimpleActionClient
from navstack.move_base.action_client import CANCELLABLE, CLIENT_TRANSITIONS, ClientStateMachine, CommState
from navstack.move_base.goals import GoalResult

from .world import Bench

# "-" ignored, "E" illegal; WFR WAITING_FOR_RESULT, P PREEMPTING, R RECALLING, A ACTIVE, Q PENDING
TABLE = """
state                   PENDING ACTIVE PREEMPTED SUCCEEDED ABORTED REJECTED RECALLED PREEMPTING RECALLING
WAITING_FOR_GOAL_ACK    Q       A      A,P,WFR   A,WFR     A,WFR   Q,WFR    Q,WFR    A,P        Q,R
PENDING                 -       A      A,P,WFR   A,WFR     A,WFR   WFR      R,WFR    A,P        R
ACTIVE                  E       -      P,WFR     WFR       WFR     E        E        P          E
WAITING_FOR_RESULT      E       -      -         -         -       -        -        E          E
WAITING_FOR_CANCEL_ACK  -       -      P,WFR     P,WFR     P,WFR   WFR      R,WFR    P          R
RECALLING               E       E      P,WFR     P,WFR     P,WFR   WFR      WFR      P          -
PREEMPTING              E       E      WFR       WFR       WFR     E        E        -          E
DONE                    -       -      -         -         -       -        -        -          -
"""
SHORT = {
    "WFR": CommState.WAITING_FOR_RESULT,
    "P": CommState.PREEMPTING,
    "R": CommState.RECALLING,
    "A": CommState.ACTIVE,
    "Q": CommState.PENDING,
}
HEAD, *LINES = (line.split() for line in TABLE.strip().split("\n"))
CELLS = [
    (CommState[state], GoalStatus[status], cell)
    for state, *cells in LINES
    for status, cell in zip(HEAD[1:], cells, strict=True)
]


def test_numbers() -> None:
    assert [s.name for s in sorted(CommState)] == [line[0] for line in LINES[:4]] + [
        "WAITING_FOR_CANCEL_ACK",
        "RECALLING",
        "PREEMPTING",
        "DONE",
    ]
    assert len(CELLS) == 8 * 9
    assert len(CLIENT_TRANSITIONS) == sum(cell != "E" for _, _, cell in CELLS)


@pytest.mark.parametrize(("state", "status", "cell"), CELLS)
def test_every_entry_of_the_client_table(state: CommState, status: GoalStatus, cell: str) -> None:
    passed: list[CommState] = []
    machine = ClientStateMachine(passed.append)
    machine.state = state
    if cell == "E":
        with pytest.raises(GoalTransitionError):
            machine.update_status(status)
        assert (machine.state, passed) == (state, [])
        return
    machine.update_status(status)
    expected = [] if cell == "-" else [SHORT[s] for s in cell.split(",")]
    assert passed == expected
    assert machine.state is (expected[-1] if expected else state)


@pytest.mark.parametrize(("state", "status", "cell"), CELLS)
def test_a_result_ends_every_state_except_done(state: CommState, status: GoalStatus, cell: str) -> None:
    if not status.is_terminal:
        return
    machine = ClientStateMachine()
    machine.state = state
    if state is CommState.DONE or cell == "E":
        with pytest.raises(GoalTransitionError):
            machine.update_result(status)
        assert machine.state is state
    else:
        machine.update_result(status)
        assert machine.state is CommState.DONE
        assert machine.latest is status


@pytest.mark.parametrize("state", CommState)
def test_lost_and_cancel(state: CommState) -> None:
    machine = ClientStateMachine()
    machine.state = state
    machine.update_status(None)
    lost = state.name not in ("WAITING_FOR_GOAL_ACK", "WAITING_FOR_RESULT", "DONE")
    assert (machine.state is CommState.DONE) == (lost or state is CommState.DONE)
    assert (machine.latest is GoalStatus.LOST) == lost
    machine.state = state
    assert machine.cancel() == (state in CANCELLABLE)
    assert machine.state is (CommState.WAITING_FOR_CANCEL_ACK if state in CANCELLABLE else state)
    names = {"WAITING_FOR_GOAL_ACK", "PENDING", "ACTIVE", "WAITING_FOR_CANCEL_ACK"}
    assert {s.name for s in CANCELLABLE} == names


def test_a_client_drives() -> None:
    bench = Bench()
    client = SimpleActionClient(bench.move_base, bench.tick)
    assert client.get_state() is GoalStatus.LOST
    with pytest.raises(InputError):
        client.wait_for_result()
    calls: list[str] = []
    ended: list[tuple[GoalStatus, GoalResult]] = []
    far: list[float] = []
    client.send_goal(
        Pose2D(1.0, 0.0),
        done_cb=lambda status, result: ended.append((status, result)),
        active_cb=lambda: calls.append("active"),
        feedback_cb=lambda feedback: far.append(feedback.distance_remaining),
    )
    assert client.get_state() is GoalStatus.PENDING
    assert client.get_result() is None
    assert client.wait_for_result()
    assert client.get_state() is GoalStatus.SUCCEEDED
    assert client.get_goal_status_text() == "Goal reached."
    assert calls == ["active"]
    assert len(ended) == 1
    assert ended[0][0] is GoalStatus.SUCCEEDED
    assert ended[0][1] is client.get_result()
    assert far[0] == pytest.approx(1.0)
    assert far[-1] < 0.2


def test_a_client_cancels_after_its_timeout() -> None:
    bench = Bench()
    client = SimpleActionClient(bench.move_base, bench.tick)
    status = client.send_goal_and_wait(Pose2D(4.0, 0.0), execute_timeout_s=2.0, preempt_timeout_s=1.0)
    assert status is GoalStatus.PREEMPTED
    assert bench.robot.time == pytest.approx(2.2)
    assert bench.robot.twist == (0.0, 0.0, 0.0)

"""The client's side of a goal: actionlib's communication state machine as a table, and a client as in rospy.

Source: actionlib/include/actionlib/client/{comm_state.h,comm_state_machine_imp.h,simple_action_client.h}.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import Final

from navstack.core import Pose2D
from navstack.core.errors import GoalTransitionError, InputError
from navstack.move_base.goal import GoalHandle, GoalResult
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.move_base import Feedback, MoveBase


class CommState(IntEnum):
    """Where a client's goal stands, as far as the client knows."""

    WAITING_FOR_GOAL_ACK = 0
    PENDING = 1
    ACTIVE = 2
    WAITING_FOR_RESULT = 3
    WAITING_FOR_CANCEL_ACK = 4
    RECALLING = 5
    PREEMPTING = 6
    DONE = 7


_C, _S = CommState, GoalStatus
_ENDS = (_S.SUCCEEDED, _S.ABORTED)


def _table() -> dict[tuple[CommState, GoalStatus], tuple[CommState, ...]]:
    wait = _C.WAITING_FOR_RESULT
    rows: dict[CommState, dict[GoalStatus, tuple[CommState, ...]]] = {
        _C.WAITING_FOR_GOAL_ACK: {
            _S.PENDING: (_C.PENDING,),
            _S.ACTIVE: (_C.ACTIVE,),
            _S.PREEMPTED: (_C.ACTIVE, _C.PREEMPTING, wait),
            _S.SUCCEEDED: (_C.ACTIVE, wait),
            _S.ABORTED: (_C.ACTIVE, wait),
            _S.REJECTED: (_C.PENDING, wait),
            _S.RECALLED: (_C.PENDING, wait),
            _S.PREEMPTING: (_C.ACTIVE, _C.PREEMPTING),
            _S.RECALLING: (_C.PENDING, _C.RECALLING),
        },
        _C.PENDING: {
            _S.PENDING: (),
            _S.ACTIVE: (_C.ACTIVE,),
            _S.PREEMPTED: (_C.ACTIVE, _C.PREEMPTING, wait),
            _S.SUCCEEDED: (_C.ACTIVE, wait),
            _S.ABORTED: (_C.ACTIVE, wait),
            _S.REJECTED: (wait,),
            _S.RECALLED: (_C.RECALLING, wait),
            _S.PREEMPTING: (_C.ACTIVE, _C.PREEMPTING),
            _S.RECALLING: (_C.RECALLING,),
        },
        _C.ACTIVE: {
            _S.ACTIVE: (),
            _S.PREEMPTED: (_C.PREEMPTING, wait),
            _S.SUCCEEDED: (wait,),
            _S.ABORTED: (wait,),
            _S.PREEMPTING: (_C.PREEMPTING,),
        },
        _C.WAITING_FOR_RESULT: {
            _S.ACTIVE: (),
            _S.PREEMPTED: (),
            _S.SUCCEEDED: (),
            _S.ABORTED: (),
            _S.REJECTED: (),
            _S.RECALLED: (),
        },
        _C.WAITING_FOR_CANCEL_ACK: {
            _S.PENDING: (),
            _S.ACTIVE: (),
            _S.PREEMPTED: (_C.PREEMPTING, wait),
            _S.SUCCEEDED: (_C.PREEMPTING, wait),
            _S.ABORTED: (_C.PREEMPTING, wait),
            _S.REJECTED: (wait,),
            _S.RECALLED: (_C.RECALLING, wait),
            _S.PREEMPTING: (_C.PREEMPTING,),
            _S.RECALLING: (_C.RECALLING,),
        },
        _C.RECALLING: {
            _S.PREEMPTED: (_C.PREEMPTING, wait),
            _S.SUCCEEDED: (_C.PREEMPTING, wait),
            _S.ABORTED: (_C.PREEMPTING, wait),
            _S.REJECTED: (wait,),
            _S.RECALLED: (wait,),
            _S.PREEMPTING: (_C.PREEMPTING,),
            _S.RECALLING: (),
        },
        _C.PREEMPTING: {
            _S.PREEMPTED: (wait,),
            _S.SUCCEEDED: (wait,),
            _S.ABORTED: (wait,),
            _S.PREEMPTING: (),
        },
        _C.DONE: {status: () for status in GoalStatus if status is not _S.LOST},
    }
    return {(state, status): through for state, row in rows.items() for status, through in row.items()}


CLIENT_TRANSITIONS: Final[Mapping[tuple[CommState, GoalStatus], tuple[CommState, ...]]] = MappingProxyType(_table())
"""(state, status heard) -> the states passed through in order, each with a callback; () = nothing new. What is not in it
is an error: the server cannot say that."""

CANCELLABLE: Final = frozenset({_C.WAITING_FOR_GOAL_ACK, _C.PENDING, _C.ACTIVE, _C.WAITING_FOR_CANCEL_ACK})
"""States in which a cancel request is sent; in others it is ignored."""

LOSABLE: Final = frozenset(set(CommState) - {_C.WAITING_FOR_GOAL_ACK, _C.WAITING_FOR_RESULT, _C.DONE})
"""States in which a goal that the server no longer lists is LOST."""


class ClientStateMachine:
    """One goal as its client sees it."""

    def __init__(self, on_transition: Callable[[CommState], None] | None = None) -> None:
        self.state = CommState.WAITING_FOR_GOAL_ACK
        self.latest = GoalStatus.PENDING
        """The last status heard."""
        self._on_transition = on_transition

    def update_status(self, status: GoalStatus | None) -> None:
        """A status message; None when it does not list the goal. Raises GoalTransitionError for what cannot follow."""
        if self.state is CommState.DONE:
            return
        if status is None:
            if self.state in LOSABLE:
                self.latest = GoalStatus.LOST
                self._go(CommState.DONE)
            return
        through = CLIENT_TRANSITIONS.get((self.state, status))
        if through is None:
            raise GoalTransitionError(
                f"a client that is {self.state.name} cannot hear {status.name}: the server broke the protocol",
                state=self.state.name,
                status=status.name,
            )
        self.latest = status
        for state in through:
            self._go(state)

    def update_result(self, status: GoalStatus) -> None:
        """The result, with the status that comes with it; raises GoalTransitionError when there was one before."""
        if self.state is CommState.DONE:
            raise GoalTransitionError("Got a result when we were already in the DONE state", status=status.name)
        self.update_status(status)
        self.latest = status
        self._go(CommState.DONE)

    def cancel(self) -> bool:
        """True when a cancel request is to be sent."""
        if self.state not in CANCELLABLE:
            return False
        self._go(CommState.WAITING_FOR_CANCEL_ACK)
        return True

    def _go(self, state: CommState) -> None:
        self.state = state
        if self._on_transition is not None:
            self._on_transition(state)


class SimpleGoalState(Enum):
    """What SimpleActionClient tells its callbacks apart by."""

    PENDING = "PENDING"
    ACTIVE = "ACTIVE"
    DONE = "DONE"


_SIMPLE: Final[Mapping[CommState, SimpleGoalState]] = MappingProxyType(
    {
        _C.WAITING_FOR_GOAL_ACK: SimpleGoalState.PENDING,
        _C.PENDING: SimpleGoalState.PENDING,
        _C.RECALLING: SimpleGoalState.PENDING,
        _C.ACTIVE: SimpleGoalState.ACTIVE,
        _C.PREEMPTING: SimpleGoalState.ACTIVE,
        _C.DONE: SimpleGoalState.DONE,
    }
)

DoneCallback = Callable[[GoalStatus, GoalResult], None]
ActiveCallback = Callable[[], None]
FeedbackCallback = Callable[[Feedback], None]


class SimpleActionClient:
    """actionlib's SimpleActionClient on a `MoveBase` in the same process.

    Nothing here waits: `turn` is called to let the world go on by one tick and gives the time (s) after it, e.g.

        def turn() -> float:
            robot.advance_to(move_base.next_due(robot.time))
            move_base.tick(robot.time)
            return robot.time
    """

    def __init__(self, move_base: MoveBase, turn: Callable[[], float]) -> None:
        self.move_base = move_base
        self._turn = turn
        self._handle: GoalHandle | None = None
        self._machine = ClientStateMachine()
        self._simple = SimpleGoalState.DONE
        self._done_cb: DoneCallback | None = None
        self._active_cb: ActiveCallback | None = None
        self._feedback_cb: FeedbackCallback | None = None

    def send_goal(
        self,
        pose: Pose2D,
        frame: str | None = None,
        *,
        done_cb: DoneCallback | None = None,
        active_cb: ActiveCallback | None = None,
        feedback_cb: FeedbackCallback | None = None,
    ) -> GoalHandle:
        """Sends a goal and forgets the one before it; callbacks come from `spin_once` and the waiting methods."""
        self._machine = ClientStateMachine(self._on_transition)
        self._simple = SimpleGoalState.PENDING
        self._done_cb, self._active_cb, self._feedback_cb = done_cb, active_cb, feedback_cb
        self._handle = self.move_base.send_goal(pose, frame)
        return self._handle

    def spin_once(self) -> float:
        """One tick of the world, then the callbacks it gives rise to; the time (s)."""
        now = self._turn()
        handle = self._handle
        if handle is None or self._machine.state is CommState.DONE:
            return now
        if handle.is_done:
            self._machine.update_result(handle.status)
        else:
            self._machine.update_status(handle.status)
            if self._feedback_cb is not None and self.move_base.goal_handle is handle:
                self._feedback_cb(self.move_base.feedback)
        return now

    def wait_for_result(self, timeout_s: float | None = None) -> bool:
        """Until the goal is done, or for `timeout_s` of the world's time; True when it is done."""
        if self._handle is None:
            raise InputError("there is no goal to wait for; send one first")
        end = None if timeout_s is None else self.move_base.now + timeout_s
        while self._machine.state is not CommState.DONE:
            if end is not None and self.move_base.now >= end - 1e-6:
                return False
            self.spin_once()
        return True

    def send_goal_and_wait(
        self,
        pose: Pose2D,
        frame: str | None = None,
        *,
        execute_timeout_s: float | None = None,
        preempt_timeout_s: float | None = None,
    ) -> GoalStatus:
        """Sends a goal, waits for it, cancels it when it takes too long, waits for that; the state."""
        self.send_goal(pose, frame)
        if not self.wait_for_result(execute_timeout_s):
            self.cancel_goal()
            self.wait_for_result(preempt_timeout_s)
        return self.get_state()

    def get_state(self) -> GoalStatus:
        """PENDING, ACTIVE, or how the goal ended; LOST without one."""
        if self._handle is None:
            return GoalStatus.LOST
        if self._simple is SimpleGoalState.DONE:
            return self._machine.latest
        return GoalStatus.PENDING if self._simple is SimpleGoalState.PENDING else GoalStatus.ACTIVE

    def get_goal_status_text(self) -> str:
        """The text that came with the state."""
        return self._handle.text if self._handle is not None else ""

    def get_result(self) -> GoalResult | None:
        """The result once the goal is done."""
        return self._handle.result if self._handle is not None and self._handle.is_done else None

    def cancel_goal(self) -> None:
        """Asks to end the goal sent last."""
        if self._handle is not None and self._machine.cancel():
            self.move_base.cancel_goal(self._handle)

    def cancel_all_goals(self) -> None:
        """Asks to end every goal, also others'."""
        self.move_base.cancel_all_goals()

    def stop_tracking_goal(self) -> None:
        """Forgets the goal; it goes on."""
        self._handle = None

    def _on_transition(self, state: CommState) -> None:
        simple = _SIMPLE.get(state)  # while waiting, the last one stands
        if simple is None or simple is self._simple:
            return
        self._simple = simple
        if simple is SimpleGoalState.ACTIVE and self._active_cb is not None:
            self._active_cb()
        elif simple is SimpleGoalState.DONE and self._done_cb is not None and self._handle is not None:
            self._done_cb(self._machine.latest, self._handle.result)

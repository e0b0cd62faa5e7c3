"""actionlib's communication state machine: the state of a goal as its client sees it.

Source: actionlib/include/actionlib/client/{comm_state.h,comm_state_machine_imp.h}.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Final

from navstack.core.errors import GoalTransitionError
from navstack.move_base.goal_status import GoalStatus


class CommState(IntEnum):
    """State of a goal as known to its client."""

    WAITING_FOR_GOAL_ACK = 0
    PENDING = 1
    ACTIVE = 2
    WAITING_FOR_RESULT = 3
    WAITING_FOR_CANCEL_ACK = 4
    RECALLING = 5
    PREEMPTING = 6
    DONE = 7


_C, _S = CommState, GoalStatus
_WAIT = _C.WAITING_FOR_RESULT

_ROWS: Final[Mapping[CommState, Mapping[GoalStatus, tuple[CommState, ...]]]] = {
    _C.WAITING_FOR_GOAL_ACK: {
        _S.PENDING: (_C.PENDING,),
        _S.ACTIVE: (_C.ACTIVE,),
        _S.PREEMPTED: (_C.ACTIVE, _C.PREEMPTING, _WAIT),
        _S.SUCCEEDED: (_C.ACTIVE, _WAIT),
        _S.ABORTED: (_C.ACTIVE, _WAIT),
        _S.REJECTED: (_C.PENDING, _WAIT),
        _S.RECALLED: (_C.PENDING, _WAIT),
        _S.PREEMPTING: (_C.ACTIVE, _C.PREEMPTING),
        _S.RECALLING: (_C.PENDING, _C.RECALLING),
    },
    _C.PENDING: {
        _S.PENDING: (),
        _S.ACTIVE: (_C.ACTIVE,),
        _S.PREEMPTED: (_C.ACTIVE, _C.PREEMPTING, _WAIT),
        _S.SUCCEEDED: (_C.ACTIVE, _WAIT),
        _S.ABORTED: (_C.ACTIVE, _WAIT),
        _S.REJECTED: (_WAIT,),
        _S.RECALLED: (_C.RECALLING, _WAIT),
        _S.PREEMPTING: (_C.ACTIVE, _C.PREEMPTING),
        _S.RECALLING: (_C.RECALLING,),
    },
    _C.ACTIVE: {
        _S.ACTIVE: (),
        _S.PREEMPTED: (_C.PREEMPTING, _WAIT),
        _S.SUCCEEDED: (_WAIT,),
        _S.ABORTED: (_WAIT,),
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
        _S.PREEMPTED: (_C.PREEMPTING, _WAIT),
        _S.SUCCEEDED: (_C.PREEMPTING, _WAIT),
        _S.ABORTED: (_C.PREEMPTING, _WAIT),
        _S.REJECTED: (_WAIT,),
        _S.RECALLED: (_C.RECALLING, _WAIT),
        _S.PREEMPTING: (_C.PREEMPTING,),
        _S.RECALLING: (_C.RECALLING,),
    },
    _C.RECALLING: {
        _S.PREEMPTED: (_C.PREEMPTING, _WAIT),
        _S.SUCCEEDED: (_C.PREEMPTING, _WAIT),
        _S.ABORTED: (_C.PREEMPTING, _WAIT),
        _S.REJECTED: (_WAIT,),
        _S.RECALLED: (_WAIT,),
        _S.PREEMPTING: (_C.PREEMPTING,),
        _S.RECALLING: (),
    },
    _C.PREEMPTING: {
        _S.PREEMPTED: (_WAIT,),
        _S.SUCCEEDED: (_WAIT,),
        _S.ABORTED: (_WAIT,),
        _S.PREEMPTING: (),
    },
    _C.DONE: {status: () for status in GoalStatus if status is not _S.LOST},
}

CLIENT_TRANSITIONS: Final[Mapping[tuple[CommState, GoalStatus], tuple[CommState, ...]]] = MappingProxyType(
    {(state, status): path for state, row in _ROWS.items() for status, path in row.items()}
)
"""(state, received status) -> the states to pass in order, each with a callback; () for no change.

A combination that is missing violates the protocol.
"""

CANCELLABLE: Final = frozenset({_C.WAITING_FOR_GOAL_ACK, _C.PENDING, _C.ACTIVE, _C.WAITING_FOR_CANCEL_ACK})
"""States in which a cancel request is sent; it is ignored in others."""

LOSABLE: Final = frozenset(set(CommState) - {_C.WAITING_FOR_GOAL_ACK, _C.WAITING_FOR_RESULT, _C.DONE})
"""States in which a goal that the server no longer lists is LOST."""


class ClientStateMachine:
    """The communication state of one goal."""

    def __init__(self, on_transition: Callable[[CommState], None] | None = None) -> None:
        self.state = CommState.WAITING_FOR_GOAL_ACK
        self.latest = GoalStatus.PENDING
        """The last status received."""
        self._on_transition = on_transition

    def update_status(self, status: GoalStatus | None) -> None:
        """Process a status message; None if it does not list the goal. Raises GoalTransitionError if it is illegal."""
        if self.state is CommState.DONE:
            return
        if status is None:
            if self.state in LOSABLE:
                self.latest = GoalStatus.LOST
                self._enter(CommState.DONE)
            return
        path = CLIENT_TRANSITIONS.get((self.state, status))
        if path is None:
            raise GoalTransitionError(
                f"a client in the state {self.state.name} received the status {status.name}, which violates the protocol",
                state=self.state.name,
                status=status.name,
            )
        self.latest = status
        for state in path:
            self._enter(state)

    def update_result(self, status: GoalStatus) -> None:
        """Process the result, with its status. Raises GoalTransitionError for a second result."""
        if self.state is CommState.DONE:
            raise GoalTransitionError("Got a result when we were already in the DONE state", status=status.name)
        self.update_status(status)
        self.latest = status
        self._enter(CommState.DONE)

    def cancel(self) -> bool:
        """Return True if a cancel request must be sent."""
        if self.state not in CANCELLABLE:
            return False
        self._enter(CommState.WAITING_FOR_CANCEL_ACK)
        return True

    def _enter(self, state: CommState) -> None:
        self.state = state
        if self._on_transition is not None:
            self._on_transition(state)

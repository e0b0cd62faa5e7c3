"""The ten states of a goal and how a server may change them.

Source: actionlib_msgs/msg/GoalStatus.msg; actionlib/include/actionlib/server/server_goal_handle_imp.h.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import Final

from navstack.core.errors import GoalTransitionError


class GoalStatus(IntEnum):
    """Where a goal stands; the numbers are those on ROS's wire."""

    PENDING = 0
    ACTIVE = 1
    PREEMPTED = 2
    SUCCEEDED = 3
    ABORTED = 4
    REJECTED = 5
    PREEMPTING = 6
    RECALLING = 7
    RECALLED = 8
    LOST = 9
    """Never sent: what a client assumes when the server no longer lists its goal."""

    @property
    def is_terminal(self) -> bool:
        """True when nothing can follow."""
        return self in TERMINAL


TERMINAL: Final = frozenset(
    {
        GoalStatus.PREEMPTED,
        GoalStatus.SUCCEEDED,
        GoalStatus.ABORTED,
        GoalStatus.REJECTED,
        GoalStatus.RECALLED,
        GoalStatus.LOST,
    }
)
"""The states that end a goal."""


class ServerCall(Enum):
    """What a server may do to a goal, by actionlib's names."""

    SET_ACCEPTED = "setAccepted"
    SET_CANCEL_REQUESTED = "setCancelRequested"
    SET_CANCELED = "setCanceled"
    SET_REJECTED = "setRejected"
    SET_ABORTED = "setAborted"
    SET_SUCCEEDED = "setSucceeded"


_S, _C = GoalStatus, ServerCall

SERVER_TRANSITIONS: Final[Mapping[tuple[ServerCall, GoalStatus], GoalStatus]] = MappingProxyType(
    {
        (_C.SET_ACCEPTED, _S.PENDING): _S.ACTIVE,
        (_C.SET_ACCEPTED, _S.RECALLING): _S.PREEMPTING,
        (_C.SET_CANCEL_REQUESTED, _S.PENDING): _S.RECALLING,
        (_C.SET_CANCEL_REQUESTED, _S.ACTIVE): _S.PREEMPTING,
        (_C.SET_CANCELED, _S.PENDING): _S.RECALLED,
        (_C.SET_CANCELED, _S.RECALLING): _S.RECALLED,
        (_C.SET_CANCELED, _S.ACTIVE): _S.PREEMPTED,
        (_C.SET_CANCELED, _S.PREEMPTING): _S.PREEMPTED,
        (_C.SET_REJECTED, _S.PENDING): _S.REJECTED,
        (_C.SET_REJECTED, _S.RECALLING): _S.REJECTED,
        (_C.SET_ABORTED, _S.ACTIVE): _S.ABORTED,
        (_C.SET_ABORTED, _S.PREEMPTING): _S.ABORTED,
        (_C.SET_SUCCEEDED, _S.ACTIVE): _S.SUCCEEDED,
        (_C.SET_SUCCEEDED, _S.PREEMPTING): _S.SUCCEEDED,
    }
)
"""Every legal call: (call, status before) -> status after."""


def after(call: ServerCall, status: GoalStatus) -> GoalStatus:
    """The status after `call`; raises GoalTransitionError where actionlib logs an error and does nothing."""
    reached = SERVER_TRANSITIONS.get((call, status))
    if reached is None:
        legal = [s.name for c, s in SERVER_TRANSITIONS if c is call]
        raise GoalTransitionError(
            f"a goal that is {status.name} cannot be changed by {call.value}; that needs {' or '.join(legal)}",
            call=call.value,
            status=status.name,
            legal=legal,
        )
    return reached

"""The ten states of a goal and the legal changes by a server.

Source: actionlib_msgs/msg/GoalStatus.msg; actionlib/include/actionlib/server/server_goal_handle_imp.h.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import Final

from navstack.core.errors import GoalTransitionError


class GoalStatus(IntEnum):
    """Status of a goal, with the numbers of ROS."""

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
    """Never sent: a client sets it if the server no longer lists its goal."""

    @property
    def is_terminal(self) -> bool:
        """True for a status that cannot change."""
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
"""The terminal states."""


class ServerCall(Enum):
    """Calls of a server that change a status, with the names of actionlib."""

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
    """Return the status after `call`. Raises GoalTransitionError if it is illegal; actionlib logs an error instead."""
    reached = SERVER_TRANSITIONS.get((call, status))
    if reached is None:
        legal = [s.name for c, s in SERVER_TRANSITIONS if c is call]
        raise GoalTransitionError(
            f"{call.value} is illegal for a goal with the status {status.name}; it requires {' or '.join(legal)}",
            call=call.value,
            status=status.name,
            legal=legal,
        )
    return reached

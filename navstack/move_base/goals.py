"""Goals as actionlib knows them: their status, the handle that a client holds, their result, and the server.

Time is an argument, so that the state of a server is a function of its calls.

Source: actionlib_msgs/msg/GoalStatus.msg; actionlib/include/actionlib/server/{action_server_base,simple_action_server_imp,
server_goal_handle_imp}.h.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import Any, Final

from navstack.core import GoalTransitionError, InputError, NavError, Pose2D, clean_frame, require_pose
from navstack.move_base.errors import GoalCanceledError, GoalReplacedError, InvalidGoalError

# the texts of actionlib to the letter, because clients compare them; the spelling "recieved" is that of the source
ACCEPTED: Final = "This goal has been accepted by the simple action server"
REPLACED: Final = "This goal was canceled because another goal was recieved by the simple action server"
CANCELED_BEFORE: Final = (
    "This goal handle was canceled by the action server because its timestamp is before the timestamp of the last "
    "cancel request"
)
NOT_FINISHED: Final = (
    "This goal was aborted by the simple action server. The user should have set a terminal status on this goal and "
    "did not"
)

# --- status ------------------------------------------------------------------------------------------------------------


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


# --- goal, result, handle ----------------------------------------------------------------------------------------------

Quaternion = tuple[float, float, float, float]
"""x, y, z, w, as geometry_msgs/Quaternion."""

UP_TOLERANCE: Final = 1e-3
MIN_LENGTH_SQUARED: Final = 1e-6


def is_planar(quaternion: Quaternion) -> bool:
    """Return True for a rotation about z (move_base.cpp, isQuaternionValid): finite, not zero, without roll and pitch.

    After normalization, `up . rotated up` may differ from 1 by 1e-3.
    """
    if not all(math.isfinite(c) for c in quaternion):
        return False
    x, y, z, w = quaternion
    length = x * x + y * y + z * z + w * w
    if length < MIN_LENGTH_SQUARED:
        return False
    up = 1.0 - 2.0 * (x * x + y * y) / length
    return abs(up - 1.0) <= UP_TOLERANCE


def yaw_of(quaternion: Quaternion) -> float:
    """Return the heading (rad) of a quaternion, which need not be normalized."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal `pose` in `frame`, sent at `stamp` (s)."""

    pose: Pose2D
    frame: str
    id: str
    stamp: float
    orientation: Quaternion | None = None
    """The quaternion of a goal sent with one; `pose.yaw` is its heading, NaN if it is not finite."""
    time_limit_s: float | None = None
    """Time from acceptance to the end; None for the goal manager's limit."""

    @property
    def has_valid_orientation(self) -> bool:
        """False for what move_base calls an invalid quaternion."""
        if self.orientation is not None:
            return is_planar(self.orientation)
        return math.isfinite(self.pose.yaw)

    def problem(self) -> InvalidGoalError | None:
        """Return the error of a goal whose orientation has roll or pitch or whose position is not finite; None if it is valid."""
        if not self.has_valid_orientation:
            return InvalidGoalError(
                f"the goal's orientation {self.orientation or self.pose.yaw} is not a rotation about z; give a unit quaternion "
                "about z, or a finite yaw",
                orientation=self.orientation,
                yaw=self.pose.yaw,
            )
        if not self.pose.is_finite():
            return InvalidGoalError(
                f"the goal's position ({self.pose.x}, {self.pose.y}) is not finite; give meters in a frame",
                pose=self.pose,
            )
        return None

    def announcement(self) -> tuple[str, dict[str, Any]]:
        """Return text and data of the event that publishes the goal."""
        x, y, yaw = self.pose
        text = f'goal {self.id}: ({x:.3f}, {y:.3f}, {yaw:.3f}) in "{self.frame}"'
        return text, {"id": self.id, "pose": list(self.pose), "frame": self.frame, "stamp": self.stamp}


def make_goal(
    pose: Pose2D,
    frame: str,
    goal_id: str,
    stamp: float,
    orientation: Quaternion | None,
    time_limit_s: float | None,
) -> Goal:
    """Return a goal; a quaternion replaces the heading of the pose.

    Raises InputError if `pose` is not a Pose2D, or for an invalid stamp or time limit.
    """
    pose = require_pose(pose, "goal")
    if orientation is not None:
        yaw = yaw_of(orientation) if all(math.isfinite(c) for c in orientation) else math.nan
        pose = Pose2D(pose.x, pose.y, yaw)
    if not math.isfinite(stamp):
        raise InputError(f"stamp must be a time in seconds, not {stamp}", stamp=stamp)
    if time_limit_s is not None and not time_limit_s > 0.0:
        raise InputError(f"time_limit_s must be a positive time in seconds, not {time_limit_s}; None for no limit")
    return Goal(pose, clean_frame(frame), goal_id, stamp, orientation, time_limit_s)


@dataclass(frozen=True, slots=True)
class GoalResult:
    """The result of a goal. In ROS it is empty; everything except `status` and `text` is an addition (parity 26)."""

    status: GoalStatus
    text: str
    """The text of C++, to the letter."""
    error_code: int = 0
    """0 for success; otherwise the code of the error (`navstack.core.errors`, Nav2's numbers)."""
    error_name: str = "NONE"
    message: str = ""
    """The reason in one sentence."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])
    """Details: the last failure, the number of failures by kind, the robot's pose."""
    recovery_names: tuple[str, ...] = ()
    """The recovery behaviors that ran for this goal, in order."""
    sent_at: float = 0.0
    accepted_at: float | None = None
    ended_at: float = 0.0

    @classmethod
    def of(
        cls,
        status: GoalStatus,
        text: str,
        error: NavError | None,
        data: dict[str, Any] | None = None,
        *,
        sent_at: float = 0.0,
        accepted_at: float | None = None,
        ended_at: float = 0.0,
    ) -> GoalResult:
        """Return the result of a task that ended with an error, or with success (None)."""
        found = cls(status, text, data=data or {}, sent_at=sent_at, accepted_at=accepted_at, ended_at=ended_at)
        if error is None:
            return found
        return replace(found, error_code=error.code, error_name=error.name, message=error.message)

    @property
    def recoveries(self) -> int:
        """Number of recovery behaviors that ran."""
        return len(self.recovery_names)

    @property
    def time_s(self) -> float:
        """Time from sending to the end (s)."""
        return self.ended_at - self.sent_at

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "state": self.status.name,
            "text": self.text,
            "error_code": self.error_code,
            "error_name": self.error_name,
            "message": self.message,
            "data": self.data,
            "recoveries": list(self.recovery_names),
            "sent_at": self.sent_at,
            "accepted_at": self.accepted_at,
            "ended_at": self.ended_at,
        }


StatusListener = Callable[["GoalHandle", float], None]
"""Called with a goal and the time (s) when the status of the goal has changed."""


class GoalHandle:
    """A goal as its client sees it. Only the server changes it."""

    __slots__ = ("_listener", "_result", "accepted_at", "ended_at", "goal", "status", "text")

    def __init__(self, goal: Goal, listener: StatusListener | None = None) -> None:
        self.goal = goal
        self.status = GoalStatus.PENDING
        self.text = ""
        self.accepted_at: float | None = None
        self.ended_at: float | None = None
        self._result: GoalResult | None = None
        self._listener = listener

    @property
    def id(self) -> str:
        """The id of the goal, unique on its server."""
        return self.goal.id

    @property
    def is_done(self) -> bool:
        """True in a terminal state."""
        return self.status.is_terminal

    @property
    def is_active(self) -> bool:
        """True in the states ACTIVE and PREEMPTING (SimpleActionServer::isActive)."""
        return self.status in (GoalStatus.ACTIVE, GoalStatus.PREEMPTING)

    @property
    def result(self) -> GoalResult:
        """The result; raises InputError before the end."""
        if self._result is None:
            message = f'the goal "{self.id}" is {self.status.name} and has no result yet; check `is_done` first'
            raise InputError(message, goal=self.id)
        return self._result

    def change(self, call: ServerCall, now: float, text: str = "", result: GoalResult | None = None) -> None:
        """Apply a call of the server at `now` (s).

        A terminal status has a result; the default is made of status and text. Raises GoalTransitionError, and changes
        nothing, if the call is illegal in the current status.
        """
        status = after(call, self.status)
        self.status = status
        if call is not ServerCall.SET_CANCEL_REQUESTED:
            self.text = text
        if call is ServerCall.SET_ACCEPTED:
            self.accepted_at = now
        if status.is_terminal:
            self.ended_at = now
            self._result = result or GoalResult(
                status, text, sent_at=self.goal.stamp, accepted_at=self.accepted_at, ended_at=now
            )
        if self._listener is not None:
            self._listener(self, now)

    def announcement(self) -> tuple[str, dict[str, Any]]:
        """Return text and data of the event that publishes the status."""
        data: dict[str, Any] = {"id": self.id, "status": self.status.name, "number": int(self.status)}
        if self.is_done:
            result = self.result
            data |= {"error_code": result.error_code, "error_name": result.error_name, "message": result.message}
        text = f"{self.status.name}: {self.text}" if self.text else self.status.name
        return text, {**data, "text": self.text}

    def __repr__(self) -> str:
        return f"GoalHandle({self.id!r}, {self.status.name}, {self.text!r})"


# --- server ------------------------------------------------------------------------------------------------------------

STATUS_LIST_TIMEOUT_S = 5.0
"""Default of actionlib's status_list_timeout."""
MOST_ENDED: Final = 100
"""Goals that have ended and are still on the status list: it is published at each change of a status."""


class SimpleActionServer:
    """Accepts goals and cancel requests at any time and sets flags, which the executor reads when it is ready."""

    def __init__(self, listener: StatusListener | None = None) -> None:
        """Create a server that calls `listener(handle, now)` for every change of a status."""
        self.current: GoalHandle | None = None
        self.next: GoalHandle | None = None
        self.preempt_requested = False
        """True if the current goal must end: it was canceled, or another goal is waiting."""
        self.last_cancel = -float("inf")
        """Goals stamped up to this time (s) are recalled."""
        self.status_list_timeout_s = STATUS_LIST_TIMEOUT_S
        """Time (s) for which a goal remains on the status list after its end."""
        self._next_preempt_requested = False
        self._handles: dict[str, GoalHandle] = {}
        self._canceled_before_sent: dict[str, float] = {}
        self._listener = listener

    # --- state ---------------------------------------------------------------------------------------

    @property
    def is_active(self) -> bool:
        """True while the current goal is ACTIVE or PREEMPTING."""
        return self.current is not None and self.current.is_active

    @property
    def is_new_goal_available(self) -> bool:
        """True while a goal is waiting for acceptance."""
        return self.next is not None

    def statuses(self) -> list[GoalHandle]:
        """Return the status list: goals that have not ended and those that ended recently, in order of arrival."""
        return list(self._handles.values())

    def find(self, goal_id: str) -> GoalHandle | None:
        """Return the goal of that id, if it is on the status list."""
        return self._handles.get(goal_id)

    # --- calls of clients ----------------------------------------------------------------------------------------------

    def submit(self, goal: Goal, now: float) -> GoalHandle:
        """Submit a goal at `now` (s). It waits for `accept`, or is RECALLED at once.

        RECALLED are goals stamped up to the last cancel request, goals stamped before the current or the waiting goal, goals
        that were canceled before their arrival, and the waiting goal that this one replaces. For an id that is already on
        the status list, the handle of that goal is returned.
        """
        self.prune(now)
        known = self._handles.get(goal.id)
        if known is not None:
            return known
        handle = GoalHandle(goal, self._listener)
        self._handles[goal.id] = handle
        if self._listener is not None:
            self._listener(handle, now)
        if self._canceled_before_sent.pop(goal.id, None) is not None:
            handle.change(ServerCall.SET_CANCEL_REQUESTED, now)
            self._recall(handle, now, "")
            return handle
        if goal.stamp <= self.last_cancel:
            self._recall(handle, now, CANCELED_BEFORE)
            return handle
        if any(other is not None and goal.stamp < other.goal.stamp for other in (self.current, self.next)):
            self._recall(handle, now, REPLACED, replaced=True)
            return handle
        if self.next is not None:
            self._recall(self.next, now, REPLACED, replaced=True)
        self.next = handle
        self._next_preempt_requested = False
        if self.is_active:
            self.preempt_requested = True
        return handle

    def cancel(self, now: float, goal_id: str | None = None, stamp: float | None = None) -> list[GoalHandle]:
        """Process a cancel request at `now` (s); return the goals that it selects.

        Without id and stamp, it selects all goals. An id selects that goal, even before it is sent; a stamp selects every
        goal stamped up to it, including goals sent later. Both select both.
        """
        select_all = goal_id is None and stamp is None
        selected: list[GoalHandle] = []
        for handle in list(self._handles.values()):
            if not (select_all or handle.id == goal_id or (stamp is not None and handle.goal.stamp <= stamp)):
                continue
            selected.append(handle)
            if handle.status not in (GoalStatus.PENDING, GoalStatus.ACTIVE):
                continue
            handle.change(ServerCall.SET_CANCEL_REQUESTED, now)
            if handle is self.current:
                self.preempt_requested = True
            elif handle is self.next:
                self._next_preempt_requested = True
        if goal_id is not None and goal_id not in self._handles:
            self._canceled_before_sent[goal_id] = now
        if stamp is not None:
            self.last_cancel = max(self.last_cancel, stamp)
        return selected

    # --- calls of the executor ---------------------------------------------------------------------------------------

    def accept(self, now: float) -> GoalHandle:
        """Make the waiting goal the current goal; a previous active goal is PREEMPTED.

        Raises GoalTransitionError if no goal is waiting.
        """
        accepted = self.next
        if accepted is None:
            raise GoalTransitionError("no goal is waiting for acceptance; check `is_new_goal_available` first")
        replaced = self.current
        if replaced is not None and replaced.is_active:
            self.set_preempted(now, REPLACED, error=GoalReplacedError("the goal was replaced by a new goal"))
        self.current = accepted
        self.next = None
        self.preempt_requested = self._next_preempt_requested
        self._next_preempt_requested = False
        accepted.change(ServerCall.SET_ACCEPTED, now, ACCEPTED)
        return accepted

    def set_succeeded(self, now: float, text: str, result: GoalResult | None = None) -> None:
        """End the current goal: it is reached."""
        self._end(ServerCall.SET_SUCCEEDED, now, text, result)

    def set_aborted(self, now: float, text: str, result: GoalResult | None = None) -> None:
        """End the current goal: it cannot be reached."""
        self._end(ServerCall.SET_ABORTED, now, text, result)

    def set_preempted(
        self, now: float, text: str = "", result: GoalResult | None = None, error: NavError | None = None
    ) -> None:
        """End the current goal: it was canceled or replaced."""
        handle = self.current
        if result is None and handle is not None:
            result = _result(
                handle, GoalStatus.PREEMPTED, text, now, error or GoalCanceledError("the goal was canceled")
            )
        self._end(ServerCall.SET_CANCELED, now, text, result)

    def prune(self, now: float) -> None:
        """Remove goals from the status list that ended more than `status_list_timeout_s` before `now` (s).

        ROS differs: at most `MOST_ENDED` of those that have ended stay, so that a flood of goals costs what each of them costs.
        """
        if len(self._handles) < 2 and not self._canceled_before_sent:
            return
        old = now - self.status_list_timeout_s
        ended = [h for h in self._handles.values() if h.ended_at is not None and h is not self.current]
        for index, handle in enumerate(ended):
            if (handle.ended_at or 0.0) < old or index < len(ended) - MOST_ENDED:
                del self._handles[handle.id]
        for goal_id in [i for i, t in self._canceled_before_sent.items() if t < old]:
            del self._canceled_before_sent[goal_id]

    def _end(self, call: ServerCall, now: float, text: str, result: GoalResult | None) -> None:
        if self.current is None:
            raise GoalTransitionError(f"{call.value} requires a current goal; there is none")
        self.current.change(call, now, text, result)

    def _recall(self, handle: GoalHandle, now: float, text: str, *, replaced: bool = False) -> None:
        error: NavError = (
            GoalReplacedError("the goal was replaced by a new goal")
            if replaced
            else GoalCanceledError("the goal was canceled")
        )
        handle.change(ServerCall.SET_CANCELED, now, text, _result(handle, GoalStatus.RECALLED, text, now, error))


def _result(handle: GoalHandle, status: GoalStatus, text: str, now: float, error: NavError) -> GoalResult:
    sent_at, accepted_at = handle.goal.stamp, handle.accepted_at
    return GoalResult.of(status, text, error, sent_at=sent_at, accepted_at=accepted_at, ended_at=now)

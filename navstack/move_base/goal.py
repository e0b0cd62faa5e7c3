"""A goal, its result, and the handle that a client holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.core.frames import clean_frame
from navstack.core.poses import require_pose
from navstack.move_base.goal_status import GoalStatus, ServerCall, after

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
        nothing, if the call is illegal in the present status.
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

    def __repr__(self) -> str:
        return f"GoalHandle({self.id!r}, {self.status.name}, {self.text!r})"

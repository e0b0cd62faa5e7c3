"""A goal, what becomes of it, and the handle a client holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from navstack.core import Pose2D
from navstack.core.errors import InputError
from navstack.move_base.goal_status import GoalStatus, ServerCall, after

Quaternion = tuple[float, float, float, float]
"""x, y, z, w, as geometry_msgs/Quaternion."""

UP_TOLERANCE = 1e-3
MIN_LENGTH_SQUARED = 1e-6


def is_planar(quaternion: Quaternion) -> bool:
    """True for an orientation in the plane (move_base.cpp, isQuaternionValid): finite, not zero, no roll or pitch.

    After normalising, `up . rotated up` may differ from 1 by 1e-3.
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
    """Heading (rad) of an orientation; it need not be normalised."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


@dataclass(frozen=True, slots=True)
class Goal:
    """Where to go: `pose` in `frame`, asked for at `stamp` (s)."""

    pose: Pose2D
    frame: str
    id: str
    stamp: float
    orientation: Quaternion | None = None
    """As sent, when it was a quaternion; then `pose.yaw` is its heading, NaN when it has none."""
    time_limit_s: float | None = None
    """From acceptance to the end; None: the goal manager's own."""

    @property
    def has_valid_orientation(self) -> bool:
        """False for what move_base calls an invalid quaternion."""
        if self.orientation is not None:
            return is_planar(self.orientation)
        return math.isfinite(self.pose.yaw)


@dataclass(frozen=True, slots=True)
class GoalResult:
    """How a goal ended. ROS's result is empty: all but `status` and `text` is navstack's (parity 26)."""

    status: GoalStatus
    text: str
    """C++'s text to the letter."""
    error_code: int = 0
    """0 for success; else the code of the error behind it (`navstack.core.errors`, Nav2's numbers)."""
    error_name: str = "NONE"
    message: str = ""
    """The reason in a sentence."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])
    """What explains it: the last failure, how often what failed, where the robot stood."""
    recovery_names: tuple[str, ...] = ()
    """The recovery behaviours that ran for this goal, in order."""
    sent_at: float = 0.0
    accepted_at: float | None = None
    ended_at: float = 0.0

    @property
    def recoveries(self) -> int:
        """How many recovery behaviours ran."""
        return len(self.recovery_names)

    @property
    def time_s(self) -> float:
        """From sending to the end, s."""
        return self.ended_at - self.sent_at

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
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


class GoalHandle:
    """A goal on its way: what the sender watches. Only the server changes it."""

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
        """The goal's name; unique on its server."""
        return self.goal.id

    @property
    def is_done(self) -> bool:
        """True once the goal is in a terminal state."""
        return self.status.is_terminal

    @property
    def is_active(self) -> bool:
        """True while the server works on it: ACTIVE or PREEMPTING (SimpleActionServer::isActive)."""
        return self.status in (GoalStatus.ACTIVE, GoalStatus.PREEMPTING)

    @property
    def result(self) -> GoalResult:
        """How it ended; raises InputError before that."""
        if self._result is None:
            raise InputError(
                f'the goal "{self.id}" is {self.status.name}: it has no result yet; ask `is_done` first', goal=self.id
            )
        return self._result

    def change(self, call: ServerCall, now: float, text: str = "", result: GoalResult | None = None) -> None:
        """For the server: applies `call` at `now` (s); raises GoalTransitionError and changes nothing when it is illegal.

        With a terminal status goes a result; without one it is made from status and text.
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

"""actionlib's SimpleActionServer, without messages: one current goal and one that waits.

Source: actionlib/include/actionlib/server/{action_server_base,simple_action_server_imp,server_goal_handle_imp}.h.
Time is an argument, so that a server's life is a function of the calls it gets.
"""

from __future__ import annotations

from navstack.core.errors import GoalTransitionError, NavError
from navstack.move_base import status_messages
from navstack.move_base.errors import GoalCanceledError, GoalReplacedError
from navstack.move_base.goal import Goal, GoalHandle, GoalResult, StatusListener
from navstack.move_base.goal_status import GoalStatus, ServerCall

STATUS_LIST_TIMEOUT_S = 5.0
"""How long an ended goal stays on the status list (actionlib's status_list_timeout)."""


class SimpleActionServer:
    """Takes goals and cancel requests at any time; whoever executes them looks at the flags when it is ready to."""

    def __init__(self, listener: StatusListener | None = None) -> None:
        """`listener(handle, now)` hears every change of any goal's status."""
        self.current: GoalHandle | None = None
        self.next: GoalHandle | None = None
        self.preempt_requested = False
        """The current goal is to end: it was cancelled, or another one waits."""
        self.last_cancel = -float("inf")
        """No goal stamped up to this time (s) will be accepted."""
        self._next_preempt_requested = False
        self._handles: dict[str, GoalHandle] = {}
        self._cancelled_before_sent: dict[str, float] = {}
        self._listener = listener

    # --- what the executor asks ---------------------------------------------------------------------------------------

    @property
    def is_active(self) -> bool:
        """True while the current goal is ACTIVE or PREEMPTING."""
        return self.current is not None and self.current.is_active

    @property
    def is_new_goal_available(self) -> bool:
        """True while a goal waits to be accepted."""
        return self.next is not None

    def statuses(self) -> list[GoalHandle]:
        """The status list: every goal that has not ended, and those that ended lately, in order of arrival."""
        return list(self._handles.values())

    def find(self, goal_id: str) -> GoalHandle | None:
        """The goal of that id, while it is on the status list."""
        return self._handles.get(goal_id)

    # --- what clients do ----------------------------------------------------------------------------------------------

    def submit(self, goal: Goal, now: float) -> GoalHandle:
        """Takes in a goal at `now` (s). It waits for `accept`, or is RECALLED here and now.

        RECALLED are: a goal whose stamp is not after the last cancel request; one stamped before the current or the waiting
        goal; a waiting goal that this one takes the place of; one that was cancelled before it came. An id that is
        listed already gives that goal's handle.
        """
        self.prune(now)
        known = self._handles.get(goal.id)
        if known is not None:
            return known
        handle = GoalHandle(goal, self._listener)
        self._handles[goal.id] = handle
        if self._listener is not None:
            self._listener(handle, now)
        if self._cancelled_before_sent.pop(goal.id, None) is not None:
            handle.change(ServerCall.SET_CANCEL_REQUESTED, now)
            self._recall(handle, now, "")
            return handle
        if goal.stamp <= self.last_cancel:
            self._recall(handle, now, status_messages.CANCELED_BEFORE)
            return handle
        late = any(other is not None and goal.stamp < other.goal.stamp for other in (self.current, self.next))
        if late:
            self._recall(handle, now, status_messages.REPLACED, replaced=True)
            return handle
        if self.next is not None:
            self._recall(self.next, now, status_messages.REPLACED, replaced=True)
        self.next = handle
        self._next_preempt_requested = False
        if self.is_active:
            self.preempt_requested = True
        return handle

    def cancel(self, now: float, goal_id: str | None = None, stamp: float | None = None) -> list[GoalHandle]:
        """A cancel request at `now` (s): the goals it concerns.

        Neither id nor stamp: all goals. An id: that goal, even before it is sent. A stamp: every goal stamped up to it,
        also those that come later. Both: both.
        """
        everything = goal_id is None and stamp is None
        touched: list[GoalHandle] = []
        for handle in list(self._handles.values()):
            concerned = everything or handle.id == goal_id or (stamp is not None and handle.goal.stamp <= stamp)
            if not concerned:
                continue
            touched.append(handle)
            if handle.status not in (GoalStatus.PENDING, GoalStatus.ACTIVE):
                continue
            handle.change(ServerCall.SET_CANCEL_REQUESTED, now)
            if handle is self.current:
                self.preempt_requested = True
            elif handle is self.next:
                self._next_preempt_requested = True
        if goal_id is not None and goal_id not in self._handles:
            self._cancelled_before_sent[goal_id] = now
        if stamp is not None:
            self.last_cancel = max(self.last_cancel, stamp)
        return touched

    # --- what the executor does ---------------------------------------------------------------------------------------

    def accept(self, now: float) -> GoalHandle:
        """The waiting goal becomes the current one; an active one before it is PREEMPTED. Raises GoalTransitionError
        when none waits.
        """
        accepted = self.next
        if accepted is None:
            raise GoalTransitionError("no goal waits to be accepted; ask `is_new_goal_available` first")
        replaced = self.current
        if replaced is not None and replaced.is_active:
            self.set_preempted(now, status_messages.REPLACED, error=GoalReplacedError("another goal came"))
        self.current = accepted
        self.next = None
        self.preempt_requested = self._next_preempt_requested
        self._next_preempt_requested = False
        accepted.change(ServerCall.SET_ACCEPTED, now, status_messages.ACCEPTED)
        return accepted

    def set_succeeded(self, now: float, text: str, result: GoalResult | None = None) -> None:
        """The current goal is reached."""
        self._end(ServerCall.SET_SUCCEEDED, now, text, result)

    def set_aborted(self, now: float, text: str, result: GoalResult | None = None) -> None:
        """The current goal cannot be reached."""
        self._end(ServerCall.SET_ABORTED, now, text, result)

    def set_preempted(
        self, now: float, text: str = "", result: GoalResult | None = None, error: NavError | None = None
    ) -> None:
        """The current goal was cancelled or replaced."""
        handle = self.current
        if result is None and handle is not None:
            result = _result(
                handle, GoalStatus.PREEMPTED, text, now, error or GoalCanceledError("the goal was cancelled")
            )
        self._end(ServerCall.SET_CANCELED, now, text, result)

    def prune(self, now: float) -> None:
        """Takes goals off the status list that ended long ago."""
        if len(self._handles) < 2 and not self._cancelled_before_sent:
            return
        old = now - STATUS_LIST_TIMEOUT_S
        for handle in [h for h in self._handles.values() if h.ended_at is not None and h.ended_at < old]:
            if handle is not self.current:
                del self._handles[handle.id]
        for goal_id in [i for i, t in self._cancelled_before_sent.items() if t < old]:
            del self._cancelled_before_sent[goal_id]

    def _end(self, call: ServerCall, now: float, text: str, result: GoalResult | None) -> None:
        if self.current is None:
            raise GoalTransitionError(f"there is no goal for {call.value}")
        self.current.change(call, now, text, result)

    def _recall(self, handle: GoalHandle, now: float, text: str, *, replaced: bool = False) -> None:
        error: NavError = (
            GoalReplacedError("another goal came") if replaced else GoalCanceledError("the goal was cancelled")
        )
        handle.change(ServerCall.SET_CANCELED, now, text, _result(handle, GoalStatus.RECALLED, text, now, error))


def _result(handle: GoalHandle, status: GoalStatus, text: str, now: float, error: NavError) -> GoalResult:
    return GoalResult(
        status,
        text,
        error.code,
        error.name,
        error.message,
        sent_at=handle.goal.stamp,
        accepted_at=handle.accepted_at,
        ended_at=now,
    )

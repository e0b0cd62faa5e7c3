"""actionlib's SimpleActionServer without messages: one current goal and one waiting goal.

Source: actionlib/include/actionlib/server/{action_server_base,simple_action_server_imp,server_goal_handle_imp}.h.
Time is an argument, so that the state of a server is a function of its calls.
"""

from __future__ import annotations

from navstack.core.errors import GoalTransitionError, NavError
from navstack.move_base import status_messages
from navstack.move_base.errors import GoalCanceledError, GoalReplacedError
from navstack.move_base.goal import Goal, GoalHandle, GoalResult, StatusListener
from navstack.move_base.goal_status import GoalStatus, ServerCall

STATUS_LIST_TIMEOUT_S = 5.0
"""Default of actionlib's status_list_timeout."""


class SimpleActionServer:
    """Accepts goals and cancel requests at any time and sets flags, which the executor reads when it is ready."""

    def __init__(self, listener: StatusListener | None = None) -> None:
        """Create a server that calls `listener(handle, now)` for every change of a status."""
        self.current: GoalHandle | None = None
        self.next: GoalHandle | None = None
        self.preempt_requested = False
        """True if the current goal must end: it was cancelled, or another goal is waiting."""
        self.last_cancel = -float("inf")
        """Goals stamped up to this time (s) are recalled."""
        self.status_list_timeout_s = STATUS_LIST_TIMEOUT_S
        """Time (s) for which a goal remains on the status list after its end."""
        self._next_preempt_requested = False
        self._handles: dict[str, GoalHandle] = {}
        self._cancelled_before_sent: dict[str, float] = {}
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
        that were cancelled before their arrival, and the waiting goal that this one replaces. For an id that is already on
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
        if self._cancelled_before_sent.pop(goal.id, None) is not None:
            handle.change(ServerCall.SET_CANCEL_REQUESTED, now)
            self._recall(handle, now, "")
            return handle
        if goal.stamp <= self.last_cancel:
            self._recall(handle, now, status_messages.CANCELED_BEFORE)
            return handle
        if any(other is not None and goal.stamp < other.goal.stamp for other in (self.current, self.next)):
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
            self._cancelled_before_sent[goal_id] = now
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
            self.set_preempted(
                now, status_messages.REPLACED, error=GoalReplacedError("the goal was replaced by a new goal")
            )
        self.current = accepted
        self.next = None
        self.preempt_requested = self._next_preempt_requested
        self._next_preempt_requested = False
        accepted.change(ServerCall.SET_ACCEPTED, now, status_messages.ACCEPTED)
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
        """End the current goal: it was cancelled or replaced."""
        handle = self.current
        if result is None and handle is not None:
            result = _result(
                handle, GoalStatus.PREEMPTED, text, now, error or GoalCanceledError("the goal was cancelled")
            )
        self._end(ServerCall.SET_CANCELED, now, text, result)

    def prune(self, now: float) -> None:
        """Remove goals from the status list that ended more than `status_list_timeout_s` before `now` (s)."""
        if len(self._handles) < 2 and not self._cancelled_before_sent:
            return
        old = now - self.status_list_timeout_s
        for handle in [h for h in self._handles.values() if h.ended_at is not None and h.ended_at < old]:
            if handle is not self.current:
                del self._handles[handle.id]
        for goal_id in [i for i, t in self._cancelled_before_sent.items() if t < old]:
            del self._cancelled_before_sent[goal_id]

    def _end(self, call: ServerCall, now: float, text: str, result: GoalResult | None) -> None:
        if self.current is None:
            raise GoalTransitionError(f"{call.value} requires a current goal; there is none")
        self.current.change(call, now, text, result)

    def _recall(self, handle: GoalHandle, now: float, text: str, *, replaced: bool = False) -> None:
        error: NavError = (
            GoalReplacedError("the goal was replaced by a new goal")
            if replaced
            else GoalCanceledError("the goal was cancelled")
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

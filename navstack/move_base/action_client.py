"""actionlib's SimpleActionClient for a `MoveBase` in the same process, with the method names of rospy, and its state machine.

Source: actionlib/include/actionlib/client/{simple_action_client.h,comm_state.h,comm_state_machine_imp.h}.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import Final, Protocol

from navstack.core import GoalTransitionError, InputError, Pose2D
from navstack.move_base.active_goal import Feedback
from navstack.move_base.goals import GoalHandle, GoalResult, GoalStatus
from navstack.move_base.schedule import EPSILON_S

# --- the state of a goal as its client sees it -------------------------------------------------------------------------


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


# --- client -----------------------------------------------------------------------------------------------------------


class GoalManager(Protocol):
    """What a client needs of `MoveBase`."""

    def send_goal(self, pose: Pose2D, frame: str | None = None) -> GoalHandle:
        """Send a goal."""
        ...

    def cancel_goal(self, goal: GoalHandle | str) -> None:
        """Cancel a goal."""
        ...

    def cancel_all_goals(self) -> None:
        """Cancel every goal."""
        ...

    @property
    def now(self) -> float:
        """Time of the last tick (s)."""
        ...

    @property
    def goal_handle(self) -> GoalHandle | None:
        """The active goal."""
        ...

    @property
    def feedback(self) -> Feedback:
        """Feedback on the active goal."""
        ...


class SimpleGoalState(Enum):
    """The states that SimpleActionClient's callbacks distinguish."""

    PENDING = "PENDING"
    ACTIVE = "ACTIVE"
    DONE = "DONE"


_SIMPLE: Final[Mapping[CommState, SimpleGoalState]] = MappingProxyType(
    {
        CommState.WAITING_FOR_GOAL_ACK: SimpleGoalState.PENDING,
        CommState.PENDING: SimpleGoalState.PENDING,
        CommState.RECALLING: SimpleGoalState.PENDING,
        CommState.ACTIVE: SimpleGoalState.ACTIVE,
        CommState.PREEMPTING: SimpleGoalState.ACTIVE,
        CommState.DONE: SimpleGoalState.DONE,
    }
)

DoneCallback = Callable[[GoalStatus, GoalResult], None]
ActiveCallback = Callable[[], None]
FeedbackCallback = Callable[[Feedback], None]


class SimpleActionClient:
    """Sends one goal at a time and calls back when its state changes.

    Nothing here waits: `tick` executes one tick of the robot and the goal manager, and returns the time (s), e.g.

        def tick() -> float:
            robot.advance_to(move_base.next_due(robot.time))
            move_base.tick(robot.time)
            return robot.time
    """

    def __init__(self, move_base: GoalManager, tick: Callable[[], float]) -> None:
        self.move_base = move_base
        self._tick = tick
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
        """Send a goal and stop tracking the previous one. `spin_once` and the methods that wait call the callbacks."""
        self._machine = ClientStateMachine(self._on_transition)
        self._simple = SimpleGoalState.PENDING
        self._done_cb, self._active_cb, self._feedback_cb = done_cb, active_cb, feedback_cb
        self._handle = self.move_base.send_goal(pose, frame)
        return self._handle

    def spin_once(self) -> float:
        """Execute one tick and call the callbacks; return the time (s)."""
        now = self._tick()
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
        """Execute ticks until the goal is done or `timeout_s` (s, in the time of the ticks) is over; True if it is done."""
        if self._handle is None:
            raise InputError("no goal was sent; call send_goal first")
        end = None if timeout_s is None else self.move_base.now + timeout_s
        while self._machine.state is not CommState.DONE:
            if end is not None and self.move_base.now >= end - EPSILON_S:
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
        """Send a goal and wait; cancel it after `execute_timeout_s` and wait up to `preempt_timeout_s`; return the state."""
        self.send_goal(pose, frame)
        if not self.wait_for_result(execute_timeout_s):
            self.cancel_goal()
            self.wait_for_result(preempt_timeout_s)
        return self.get_state()

    def get_state(self) -> GoalStatus:
        """Return PENDING, ACTIVE, or the terminal state; LOST without a goal."""
        if self._handle is None:
            return GoalStatus.LOST
        if self._simple is SimpleGoalState.DONE:
            return self._machine.latest
        return GoalStatus.PENDING if self._simple is SimpleGoalState.PENDING else GoalStatus.ACTIVE

    def get_goal_status_text(self) -> str:
        """Return the text of the state."""
        return self._handle.text if self._handle is not None else ""

    def get_result(self) -> GoalResult | None:
        """Return the result; None before the goal is done."""
        return self._handle.result if self._handle is not None and self._handle.is_done else None

    def cancel_goal(self) -> None:
        """Cancel the goal that was sent last."""
        if self._handle is not None and self._machine.cancel():
            self.move_base.cancel_goal(self._handle)

    def cancel_all_goals(self) -> None:
        """Cancel every goal, including those of other clients."""
        self.move_base.cancel_all_goals()

    def stop_tracking_goal(self) -> None:
        """Stop tracking the goal, which continues."""
        self._handle = None

    def _on_transition(self, state: CommState) -> None:
        simple = _SIMPLE.get(state)  # the states that wait for the server keep the last simple state
        if simple is None or simple is self._simple:
            return
        self._simple = simple
        if simple is SimpleGoalState.ACTIVE and self._active_cb is not None:
            self._active_cb()
        elif simple is SimpleGoalState.DONE and self._done_cb is not None and self._handle is not None:
            self._done_cb(self._machine.latest, self._handle.result)

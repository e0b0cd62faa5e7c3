"""The action servers of the navigator: goals of clients become tasks, one for the robot at a time.

Goals arrive in the thread of rclpy and are driven in the thread of the node. The state of a goal is changed only in the thread of
rclpy, which also answers the requests for it.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from navstack.core import NavError
from navstack.move_base import BusyError, MoveBase
from navstack.ros2 import ros
from navstack.ros2.ros import RosNode
from navstack.ros2.tasks import ABORTED, CANCELED, SUCCEEDED, Codes, Outcome, Task
from navstack.ros_node import Inbox, NodeClock


class Goal:
    """A goal that was accepted, with its task."""

    def __init__(self, server: Server, handle: Any, task: Task) -> None:
        self.server, self.handle, self.task = server, handle, task
        self.has_begun = False
        self.is_canceled = False
        self.feedback_due = 0.0


class Server:
    """The server of one action."""

    def __init__(self, tasks: Tasks, name: str, kind: str, make: Callable[[Any], Task]) -> None:
        """`kind`: nav2_msgs/action/Spin. `make` returns the task of a goal message."""
        self.name, self.kind, self._make = name, ros.message(kind), make
        self._codes = ros.constants(self.kind.Result)
        self._tasks = tasks
        self._goals: dict[bytes, Goal] = {}
        module = ros.load("rclpy.action")
        response, cancel = module.GoalResponse, module.CancelResponse

        class Deferring(module.ActionServer):  # type: ignore[name-defined,misc]
            """Marks a goal as executing without a callback: rclpy would hold a coroutine, and poll it, until the end."""

            def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
                if execute_callback is not None:
                    super().notify_execute(goal_handle, execute_callback)

        def on_goal(goal: Any) -> Any:
            del goal
            return response.ACCEPT if tasks.is_active else response.REJECT

        def on_cancel(handle: Any) -> Any:
            found = self._goals.get(bytes(handle.goal_id.uuid))
            if found is None:
                return cancel.REJECT
            tasks.inbox.post(lambda: tasks.cancel(found))
            return cancel.ACCEPT

        def make_server() -> Any:
            return Deferring(
                tasks.node.handle,
                self.kind,
                name,
                execute_callback=_unused,
                goal_callback=on_goal,
                handle_accepted_callback=self._on_accepted,
                cancel_callback=on_cancel,
            )

        self._server = tasks.node.create(make_server)

    def _on_accepted(self, handle: Any) -> None:
        handle.execute()
        goal = self._goals[bytes(handle.goal_id.uuid)] = Goal(self, handle, self._make(handle.request))
        self._tasks.inbox.post(lambda: self._tasks.submit(goal))

    def publish_feedback(self, goal: Goal, now: float, stamp_ns: int) -> None:
        """Publish how far a goal is, if it is due."""
        if now < goal.feedback_due:
            return
        message = self.kind.Feedback()
        if goal.task.feedback(message, now, stamp_ns):
            goal.feedback_due = now + goal.task.feedback_s
            self._tasks.node.sender.send(f"{self.name}/feedback", lambda: goal.handle.publish_feedback(message))

    def _code(self, code: int, of: Codes) -> int:
        """Return the code, that of an unknown cause if the action of this distribution does not have it."""
        is_known = code in self._codes or code in of.passed or of.first not in self._codes
        return code if is_known else of.first

    def finish(self, goal: Goal, outcome: Outcome, now: float) -> None:
        """End a goal: its state and its result."""
        result = self.kind.Result()
        if goal.has_begun:
            goal.task.fill(result, now)
        if hasattr(result, "error_code"):
            result.error_code = self._code(outcome.code, goal.task.codes)
        if hasattr(result, "error_msg"):
            result.error_msg = outcome.text
        if hasattr(result, "success"):  # of docking; true by default
            result.success = outcome.status == SUCCEEDED

        def conclude(handle: Any) -> Any:
            if outcome.status == SUCCEEDED:
                handle.succeed()
            elif outcome.status == CANCELED and handle.is_cancel_requested:
                handle.canceled()
            else:
                handle.abort()
            return result

        def end() -> None:
            self._goals.pop(bytes(goal.handle.goal_id.uuid), None)
            self._server.notify_execute(goal.handle, conclude)

        self._tasks.node.later(end)


def _unused(handle: Any) -> Any:
    """Never called: goals end by `Server.finish`."""
    raise AssertionError(handle)


class Tasks:
    """The goals of all actions, in the thread of the node.

    The robot does one task at a time. The newest counts: the one before is aborted, as in Nav2, with the reason in its text. A
    drive takes over from a drive without a stop. Tasks that do not move it run besides, one per action.
    """

    def __init__(self, node: RosNode, inbox: Inbox, clock: NodeClock) -> None:
        self.node, self.inbox, self.clock = node, inbox, clock
        self.is_active = False
        """False: goals are rejected, as by an inactive server of Nav2."""
        self.pool = ThreadPoolExecutor(1, "plans")
        self._move_base: MoveBase | None = None
        self._running: Goal | None = None
        self._pending: Goal | None = None
        self._aside: dict[str, Goal] = {}

    def connect(self, move_base: MoveBase) -> None:
        """Use this goal manager."""
        self._move_base = move_base

    def submit(self, goal: Goal) -> None:
        """Begin a goal, or let it wait for the end of the one before."""
        now = self.clock.now()
        if goal.task.is_aside:
            before = self._aside.pop(goal.server.name, None)
            if before is not None:
                before.task.cancel()
                self._finish(before, Outcome(ABORTED, 0, "replaced by a newer goal"), now)
            if self._begin(goal, now):
                self._aside[goal.server.name] = goal
            return
        if self._pending is not None:
            self._finish(self._pending, Outcome(ABORTED, 0, "replaced by a newer goal"), now)
        self._pending = goal
        self._start_pending(now)

    def _start_pending(self, now: float) -> None:
        goal, running = self._pending, self._running
        if goal is None:
            return
        if running is not None:
            refusal = goal.task.refusal(running.task)
            if refusal:
                self._pending = None
                self._finish(goal, Outcome(ABORTED, goal.task.codes.first, refusal), now)
                return
            if not goal.task.takes_over and running.task.drives:
                running.task.cancel()  # a motion waits until the drive has stopped
                return
            self._running = None
            if not (goal.task.takes_over and running.task.takes_over):
                running.task.cancel()
            self._finish(running, Outcome(ABORTED, 0, f"replaced by a goal of {goal.server.name}"), now)
        self._pending = None
        if self._begin(goal, now):
            self._running = goal

    def _begin(self, goal: Goal, now: float) -> bool:
        """Begin a task; return False if it has ended at once."""
        if goal.is_canceled:
            self._finish(goal, Outcome(CANCELED), now)
            return False
        try:
            goal.task.begin(now)
            goal.has_begun = True
        except NavError as exc:
            code = goal.task.codes.first if isinstance(exc, BusyError) else goal.task.codes.of(exc)
            if exc.name in ("INVALID_CHOICE", "FAILED_TO_LOAD_BEHAVIOR_TREE"):
                code = exc.code
            self._finish(goal, Outcome(ABORTED, code, exc.message), now)
            return False
        return True

    def cancel(self, goal: Goal) -> None:
        """Cancel a goal of a client."""
        goal.is_canceled = True
        now = self.clock.now()
        if goal is self._pending:
            self._pending = None
            self._finish(goal, Outcome(CANCELED), now)
        elif goal is self._running or goal in self._aside.values():
            goal.task.cancel()

    def cancel_all(self, text: str) -> None:
        """Abort every goal: the node is deactivated or ends."""
        now = self.clock.now()
        goals = [goal for goal in (self._running, self._pending, *self._aside.values()) if goal is not None]
        self._running = self._pending = None
        self._aside.clear()
        for goal in goals:
            if goal.has_begun:
                goal.task.cancel()
            self._finish(goal, Outcome(ABORTED, goal.task.codes.first, text), now)

    def update(self, now: float) -> None:
        """End what has ended, begin what waits, and publish feedback."""
        for goal in (self._running, *self._aside.values()):
            outcome = None if goal is None else goal.task.update(now)
            if goal is None or outcome is None:
                continue
            if goal is self._running:
                self._running = None
                if self._pending is not None and not goal.is_canceled and outcome.status == CANCELED:
                    outcome = Outcome(ABORTED, 0, f"replaced by a goal of {self._pending.server.name}")
            else:
                del self._aside[goal.server.name]
            self._finish(goal, outcome, now)
        self._start_pending(now)
        for goal in (self._running, *self._aside.values()):
            if goal is not None:
                goal.server.publish_feedback(goal, now, self.clock.ns(now))

    def _finish(self, goal: Goal, outcome: Outcome, now: float) -> None:
        goal.server.finish(goal, outcome, now)

"""The action move_base on topics: goals and cancels in, status, feedback and results out, as actionlib's server does."""

from __future__ import annotations

import threading
from collections import deque
from typing import Any, Final

from navstack.core import Event, NavError, Pose2D
from navstack.move_base import REPLACED, STATUS_LIST_TIMEOUT_S, GoalHandle, GoalStatus, MoveBase
from navstack.ros1 import ros
from navstack.ros_messages import MessageBuilder
from navstack.ros_node import Inbox, NodeClock

STATUS_HZ: Final = 5.0
"""Default of actionlib_status_frequency (Hz)."""
QUEUE: Final = 50
"""Default of the lengths of actionlib's queues."""
MOST_KEPT: Final = 5_000
"""Goals and cancels that wait for the node; beyond, the oldest ones are lost, as all beyond `QUEUE` are in roscpp."""
MOST_STATUSES: Final = 10
"""Changes of a status that are published at once in one turn of the loop; the rest share one message at its end."""
WARNING_PERIOD_S: Final = 10.0
"""A flood of goals is one warning in this time (s)."""
LARGEST: Final = 1e6
"""Parameters of actionlib above are not valid."""


def _status_period(rospy: Any) -> float:
    """Return the time (s) between two status messages: actionlib_status_frequency, looked up in the enclosing namespaces."""
    if rospy.has_param("move_base/status_frequency"):
        rospy.logwarn(
            "the parameter move_base/status_frequency is deprecated in actionlib and has no effect; "
            "set actionlib_status_frequency"
        )
    name = rospy.search_param("actionlib_status_frequency")
    frequency = STATUS_HZ if name is None else _positive(rospy, name, STATUS_HZ)
    return 1.0 / frequency


def _positive(rospy: Any, name: str, default: float) -> float:
    """Return a parameter that is a positive number, or the default."""
    value = rospy.get_param(name, default)
    if isinstance(value, (int, float)) and not isinstance(value, bool) and 0.0 < value < LARGEST:
        return float(value)
    rospy.logwarn("the parameter %s is %r, not a positive number; %g is used", name, value, default)
    return default


class ActionInterface:
    """Publishes what the goal manager's action server does. A listener of the goal manager."""

    hears_feedback = True

    def __init__(self, clock: NodeClock, build: MessageBuilder, inbox: Inbox) -> None:
        rospy = ros.rospy()
        self._clock, self._build = clock, build
        self._move_base: MoveBase | None = None
        self._counter = 0
        self._period_s = _status_period(rospy)
        self._due = 0.0
        self._name = str(rospy.get_name())
        goal, cancel = ros.message("move_base_msgs/MoveBaseActionGoal"), ros.message("actionlib_msgs/GoalID")
        self._goal_type, self._cancel_type = goal, cancel
        self._inbox = inbox
        self._lock = threading.Lock()
        self._arrived: deque[Any] = deque(maxlen=MOST_KEPT)
        """Goals and cancels, in the order in which they were sent: one queue holds both."""
        self._is_posted = False
        self._refused: deque[Any] = deque(maxlen=MOST_KEPT)
        """Goals of a flood that newer ones have replaced before they were looked at; each gets its result."""
        self._warned = -WARNING_PERIOD_S
        """Time of the last warning of a flood (s)."""
        self._changes = 0
        """Changes of a status since the last regular call of `publish`."""
        self._list_timeout_s = _positive(rospy, "move_base/status_list_timeout", STATUS_LIST_TIMEOUT_S)
        out, into = (
            int(_positive(rospy, f"move_base/actionlib_server_{way}_queue_size", QUEUE)) for way in ("pub", "sub")
        )
        self._most_goals = max(into, 1)
        self._status = rospy.Publisher(
            "move_base/status", ros.message("actionlib_msgs/GoalStatusArray"), queue_size=out, latch=True
        )
        self._feedback_out = rospy.Publisher(
            "move_base/feedback", ros.message("move_base_msgs/MoveBaseActionFeedback"), queue_size=out
        )
        self._result = rospy.Publisher(
            "move_base/result", ros.message("move_base_msgs/MoveBaseActionResult"), queue_size=out
        )
        self._own_goals = rospy.Publisher("move_base/goal", goal, queue_size=1)
        rospy.Subscriber("move_base/goal", goal, self.receive, queue_size=into)
        rospy.Subscriber("move_base/cancel", cancel, self.receive, queue_size=into)
        simple = ros.message("geometry_msgs/PoseStamped")
        rospy.Subscriber("move_base_simple/goal", simple, self._on_simple_goal, queue_size=1)

    def connect(self, move_base: MoveBase) -> None:
        """Use this goal manager; goals and cancels that have arrived before wait for it."""
        move_base.server.status_list_timeout_s = self._list_timeout_s
        self._move_base = move_base
        self._inbox.post(self._take)

    # --- messages of clients ------------------------------------------------------------------------------------------

    def _on_simple_goal(self, message: Any) -> None:
        """Send the goal to the action, as move_base does."""
        goal = self._goal_type()
        goal.header.stamp = ros.rospy().Time.now()
        goal.goal.target_pose = message
        self._own_goals.publish(goal)

    def receive(self, message: Any) -> None:
        """Keep a goal or a cancel for the node. Called in the threads of rospy."""
        with self._lock:
            self._arrived.append(message)
            is_posted, self._is_posted = self._is_posted, True
        if not is_posted:
            self._inbox.post(self._take)

    def _take(self) -> None:
        """Process what has arrived. Of more goals than the subscriber's queue holds only the newest ones are looked at."""
        if self._move_base is None:
            return
        with self._lock:
            batch = list(self._arrived)
            self._arrived.clear()
            self._is_posted = False
        goals = [message for message in batch if not self._is_cancel(message)]
        refused = goals[: max(0, len(goals) - self._most_goals)]
        errors: list[NavError] = []
        older = len(refused)
        for message in batch:
            try:
                if self._is_cancel(message):
                    self._on_cancel(message)
                elif older > 0:
                    older -= 1
                else:
                    self._on_goal(message)
            except NavError as exc:
                errors.append(exc)
        self._refused.extend(refused)
        now = self._clock.now()
        if refused and not 0.0 <= now - self._warned < WARNING_PERIOD_S:
            self._warned = now
            ros.rospy().logwarn(
                "%d goals at once: the newest %d are looked at, the others are recalled", len(goals), self._most_goals
            )
        if errors:
            raise errors[0]

    def _is_cancel(self, message: Any) -> bool:
        return isinstance(message, self._cancel_type)

    def _refuse(self, now: float) -> None:
        """Send the results of some of the goals that were not looked at."""
        move_base = self._move_base
        for _ in range(min(len(self._refused), self._most_goals)):
            message = self._refused.popleft()
            # an id that the server knows has a result of its own
            if move_base is None or move_base.server.find(str(message.goal_id.id)) is not None:
                continue
            result = ros.message("move_base_msgs/MoveBaseActionResult")()
            result.header.stamp = self._stamp(now)
            result.status = ros.message("actionlib_msgs/GoalStatus")(
                goal_id=message.goal_id, status=int(GoalStatus.RECALLED), text=REPLACED
            )
            self._result.publish(result)

    def _on_goal(self, message: Any) -> None:
        move_base = self._move_base
        assert move_base is not None
        target = message.goal.target_pose
        stamp = message.goal_id.stamp
        now = self._clock.now()
        goal_id = str(message.goal_id.id) or self._new_id(now)
        o, p = target.pose.orientation, target.pose.position
        move_base.send_goal(
            Pose2D(float(p.x), float(p.y), 0.0),
            str(target.header.frame_id),
            orientation=(float(o.x), float(o.y), float(o.z), float(o.w)),
            goal_id=goal_id,
            stamp=now if stamp.is_zero() else self._clock.of(stamp),
        )

    def _new_id(self, now: float) -> str:
        """Return an id in the form of actionlib: node, counter, time."""
        self._counter += 1
        time_ns = self._clock.ns(now)
        return f"{self._name}-{self._counter}-{time_ns // 10**9}.{time_ns % 10**9}"

    def _on_cancel(self, message: Any) -> None:
        move_base = self._move_base
        assert move_base is not None
        name, stamp = str(message.id), message.stamp
        if not name and stamp.is_zero():
            move_base.cancel_all_goals()
            return
        if name:
            move_base.cancel_goal(name)
        if not stamp.is_zero():
            move_base.cancel_goals_at_and_before(self._clock.of(stamp))

    # --- messages to clients ------------------------------------------------------------------------------------------

    def on_event(self, event: Event) -> None:
        """Publish feedback, each result and each change of a status at once, as actionlib does."""
        move_base = self._move_base
        if event.kind == "feedback":
            if move_base is not None and move_base.goal_handle is not None:
                frame, pose = move_base.global_costmap.frame, Pose2D(*event.data["pose"])
                self._publish_feedback(move_base.goal_handle, event.time, frame, pose)
            return
        # a goal that has arrived is listed by the next regular status
        if event.kind != "status" or move_base is None or event.data["status"] == GoalStatus.PENDING.name:
            return
        now = event.time
        handle = move_base.server.find(str(event.data["id"]))
        if handle is not None and handle.is_done:
            self._publish_result(handle, now)
        self._changes += 1
        if self._changes <= MOST_STATUSES:
            self._publish_status(move_base.server.statuses(), now)

    def publish(self, now: float) -> None:
        """Publish the status at its frequency, and after many changes; and the results of goals that were not looked at."""
        move_base = self._move_base
        if self._refused:
            self._refuse(now)
        is_behind = self._changes > MOST_STATUSES
        self._changes = 0
        if move_base is not None and (is_behind or now >= self._due or now < self._due - 2.0 * self._period_s):
            self._due = now + self._period_s
            move_base.server.prune(now)
            self._publish_status(move_base.server.statuses(), now)

    def _stamp(self, time: float) -> Any:
        return self._build.time(self._clock.ns(time))

    def _goal_status(self, handle: GoalHandle) -> Any:
        goal_id = ros.message("actionlib_msgs/GoalID")(stamp=self._stamp(handle.goal.stamp), id=handle.id)
        return ros.message("actionlib_msgs/GoalStatus")(goal_id=goal_id, status=int(handle.status), text=handle.text)

    def _publish_status(self, handles: list[GoalHandle], now: float) -> None:
        array = ros.message("actionlib_msgs/GoalStatusArray")()
        array.header.stamp = self._stamp(now)
        array.status_list = [self._goal_status(handle) for handle in handles]
        self._status.publish(array)

    def _publish_feedback(self, handle: GoalHandle, time: float, frame: str, pose: Pose2D) -> None:
        feedback = ros.message("move_base_msgs/MoveBaseActionFeedback")()
        feedback.header.stamp = self._stamp(time)
        feedback.status = self._goal_status(handle)
        feedback.feedback.base_position = self._build.pose_stamped(self._clock.ns(time), frame, pose)
        self._feedback_out.publish(feedback)

    def _publish_result(self, handle: GoalHandle, now: float) -> None:
        result = ros.message("move_base_msgs/MoveBaseActionResult")()
        result.header.stamp = self._stamp(now)
        result.status = self._goal_status(handle)
        self._result.publish(result)

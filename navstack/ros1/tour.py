"""MultiNav: drives to places by the action move_base, and counts successes, time and distance."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

from navstack.core import InputError, Pose2D
from navstack.ros1 import parameters, ros
from navstack.ros_messages import MessageBuilder

SERVER_WAIT_S: Final = 60.0
"""Longest wait for the action server (s, wall)."""
GOAL_TIME_S: Final = 300.0
"""Time limit of a goal (s)."""
POLL_S: Final = 0.05
"""Time between two looks at the goal (s, wall)."""
STATUSES: Final = (
    "PENDING",
    "ACTIVE",
    "PREEMPTED",
    "SUCCEEDED",
    "ABORTED",
    "REJECTED",
    "PREEMPTING",
    "RECALLING",
    "RECALLED",
    "LOST",
)
"""Names of actionlib's codes."""
SUCCEEDED: Final = 3


class Score:
    """What a tour has reached so far."""

    def __init__(self) -> None:
        self.goals = self.successes = 0
        self.distance_m = 0.0
        self._from: Pose2D | None = None

    def add(self, place: Pose2D, start: Pose2D | None, *, succeeded: bool) -> None:
        """Count a goal that has ended; `start`: where the robot was when it began, if that is known.

        ROS differs: the known node takes the place before as the start even if it was not reached.
        """
        self.goals += 1
        begin = self._from or start
        self._from = None
        if succeeded:
            self.successes += 1
            self._from = place
            if begin is not None:
                self.distance_m += begin.distance_to(place)

    def lines(self, running_s: float) -> tuple[str, str]:
        """Return the two lines that are printed after each goal."""
        share = 100.0 * self.successes / self.goals if self.goals else 0.0
        return (
            f"Success so far: {self.successes}/{self.goals} = {share:.1f}%",
            f"Running time: {cut(running_s / 60.0)} min Distance: {cut(self.distance_m)} m",
        )


def cut(value: float) -> float:
    """Return a number cut, not rounded, to one decimal."""
    return math.trunc(value * 10.0 + 1e-9) / 10.0


class Tour:
    """The node."""

    def __init__(self, frame: str, limit_s: float, say: Callable[[str], None]) -> None:
        """`frame` of the places, time limit of a goal (s); `say` prints a line. Raises InputError."""
        rospy = self._rospy = ros.rospy()
        self._frame, self._limit_s, self._say = frame, limit_s, say
        self._rest_s = parameters.number("rest_time", 2.0, low=0.0, high=1e6)
        self._build = MessageBuilder(ros.MessageTypes(), ros1=True)
        self._cmd_vel = rospy.Publisher("cmd_vel", ros.message("geometry_msgs/Twist"), queue_size=5)
        # Not SimpleActionClient: it logs an error when a fast server answers before its send_goal() has returned.
        self._actionlib = ros.load("actionlib")
        self._client = self._actionlib.ActionClient("move_base", ros.message("move_base_msgs/MoveBaseAction"))
        self._start: Pose2D | None = None
        self.score = Score()

    def drive(self, places: Sequence[tuple[str, Pose2D]]) -> bool:
        """Drive to all places, then return True if each was reached. Raises InputError without an action server."""
        self._wait_for_server()
        begun = self._now()
        for k, (name, pose) in enumerate(places):
            if ros.is_stopping() or (k and not self._rest()):
                break
            self._say(f"Going to: {name}")
            status, text = self._go(pose)
            if ros.is_stopping():
                break
            self.score.add(pose, self._start, succeeded=status == SUCCEEDED)
            if status is None:
                self._say(f"Timed out achieving goal: {name} after {self._limit_s:g} s")
            elif status == SUCCEEDED:
                self._say("Goal succeeded!")
            else:
                self._say(f"Goal failed with error code: {STATUSES[status]}" + (f" ({text})" if text else ""))
            for line in self.score.lines(self._now() - begun):
                self._say(line)
        self._end()
        return self.score.successes == len(places)

    def _wait_for_server(self) -> None:
        end = time.monotonic() + SERVER_WAIT_S
        while not ros.is_stopping():
            if not self._rospy.Time.now().is_zero() and self._client.wait_for_server(self._rospy.Duration(0.2)):
                return
            if time.monotonic() > end:
                raise InputError(
                    f"no action server {self._rospy.resolve_name('move_base')} within {SERVER_WAIT_S:g} s; start move_base, "
                    "or its localization: move_base offers the action once it has its transforms and its map"
                )
            ros.STOP.wait(POLL_S)

    def _go(self, pose: Pose2D) -> tuple[int | None, str]:
        """Send a goal and wait for its end; return its code and text. The code is None if it took too long."""
        goal = ros.message("move_base_msgs/MoveBaseGoal")()
        goal.target_pose = self._build.pose_stamped(int(self._rospy.Time.now().to_nsec()), self._frame, pose)
        self._start = None
        handle = self._client.send_goal(goal, feedback_cb=self._on_feedback)
        begun = self._now()
        while not ros.is_stopping():
            if handle.get_comm_state() == self._actionlib.CommState.DONE:
                return int(handle.get_goal_status()), str(handle.get_goal_status_text())
            if self._now() - begun > self._limit_s:
                handle.cancel()
                return None, ""
            ros.STOP.wait(POLL_S)
        return None, ""

    def _on_feedback(self, _handle: Any, feedback: Any) -> None:
        """Keep where the robot was when the goal began."""
        if self._start is None:
            at = feedback.base_position.pose.position
            self._start = Pose2D(float(at.x), float(at.y), 0.0)

    def _rest(self) -> bool:
        """Pause; return False if the node was shut down."""
        until = self._now() + self._rest_s
        while self._now() < until and not ros.is_stopping():
            ros.STOP.wait(POLL_S)
        return not ros.is_stopping()

    def _now(self) -> float:
        return float(self._rospy.get_time())

    def _end(self) -> None:
        """If the tour was ended early: cancel the goal and stop the robot."""
        if ros.STOP.is_set() and not self._rospy.is_shutdown():
            self._client.cancel_all_goals()
            self._rospy.rostime.wallsleep(0.5)
            self._cmd_vel.publish(ros.message("geometry_msgs/Twist")())
        ros.shut_down(lambda: None)

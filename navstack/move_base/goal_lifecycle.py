"""How goals are accepted, preempted and ended."""

from __future__ import annotations

import contextlib
import math

from navstack.core import Pose2D
from navstack.core.errors import NavError
from navstack.move_base import plugin_calls, status_messages
from navstack.move_base.action_server import SimpleActionServer
from navstack.move_base.active_goal import ActiveGoal, check_goal
from navstack.move_base.errors import GoalReplacedError, GoalTimeLimitError
from navstack.move_base.goal_status import GoalStatus
from navstack.move_base.navigation import Navigation
from navstack.move_base.planning import Planning
from navstack.move_base.progress import OscillationChecker
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import NavEvent, Outcome


class GoalLifecycle:
    """Moves goals between the action server and the navigation state."""

    def __init__(self, navigation: Navigation, server: SimpleActionServer, planning: Planning) -> None:
        self.time_limit_s = math.inf
        """Time limit of goals without one of their own (s from acceptance)."""
        self._navigation = navigation
        self._server = server
        self._planning = planning

    def accept(self, now: float) -> ActiveGoal:
        """Make the waiting goal the active goal. An invalid goal has an error, which the caller must apply."""
        navigation = self._navigation
        handle = self._server.accept(now)
        limit = self.time_limit_s if handle.goal.time_limit_s is None else handle.goal.time_limit_s
        progress = OscillationChecker(navigation.params.oscillation_distance)
        goal = navigation.goal = ActiveGoal(handle, progress, now + limit)
        navigation.drop_plans()
        self._planning.abandon()
        navigation.events.goal(now, handle.goal)
        goal.error = check_goal(handle.goal)
        if goal.error is None:
            goal.frame = navigation.global_costmap.frame
            with contextlib.suppress(NavError):  # the plan request repeats the lookup
                locate_goal(navigation, goal, now)
        return goal

    @property
    def is_canceled(self) -> bool:
        """True if the active goal must end and no goal follows it."""
        return self._server.preempt_requested and not self._server.is_new_goal_available

    def must_end(self, now: float) -> bool:
        """Apply cancel requests, new goals and the time limit; return True if there is no active goal afterwards."""
        if self._server.preempt_requested and self._is_preempted(now):
            return True
        goal = self._navigation.goal
        if goal is None or now < goal.deadline - EPSILON_S:
            return False
        self._end_by_time_limit(goal, now)
        return True

    def finish(self, outcome: Outcome, now: float) -> None:
        """End the active goal."""
        navigation, server = self._navigation, self._server
        goal = navigation.goal
        if goal is None:
            return
        navigation.goal = None
        navigation.plan = navigation.new_plan = None
        text = outcome.value
        if outcome is Outcome.REACHED:
            server.set_succeeded(now, text, goal.result(GoalStatus.SUCCEEDED, text, None, now))
            return
        error = goal.reason(outcome, now)
        if outcome is Outcome.CANCELED:
            server.set_preempted(now, text, goal.result(GoalStatus.PREEMPTED, text, error, now))
            return
        if outcome is Outcome.BAD_QUATERNION and goal.handle.goal.has_valid_orientation:
            text = status_messages.BAD_POSITION
        server.set_aborted(now, text, goal.result(GoalStatus.ABORTED, text, error, now))

    def _is_preempted(self, now: float) -> bool:
        """Cancel or replace the active goal, as C++ does at the top of its loop; return True if it has no successor."""
        server, navigation = self._server, self._navigation
        if not server.is_new_goal_available:
            navigation.apply(NavEvent.CANCELED, now)
            return True
        replaced = navigation.goal
        if replaced is not None:
            text = status_messages.REPLACED
            error = GoalReplacedError(f"the goal was replaced by a new goal after {replaced.age(now):.1f} s")
            server.set_preempted(now, text, replaced.result(GoalStatus.PREEMPTED, text, error, now))
        if self.accept(now).error is not None:
            navigation.apply(NavEvent.GOAL_INVALID, now)
            return True
        navigation.apply(NavEvent.GOAL_REPLACED, now)
        return False

    def _end_by_time_limit(self, goal: ActiveGoal, now: float) -> None:
        """End the goal at its time limit. ROS differs: C++ has none."""
        navigation = self._navigation
        limit = goal.deadline - (goal.handle.accepted_at or 0.0)
        error = GoalTimeLimitError(
            f"the goal was not reached within its time limit of {limit:g} s", time_limit_s=limit, pose=navigation.pose
        )
        navigation.apply(NavEvent.TIMED_OUT, now, error)


def locate_goal(navigation: Navigation, goal: ActiveGoal, now: float) -> Pose2D:
    """Transform the goal into the global costmap's frame.

    Raises NavError if the transform is not known, or older than the costmap's transform_tolerance.
    """
    sent = goal.handle.goal
    target = navigation.global_costmap.frame
    tolerance = plugin_calls.transform_tolerance(navigation.global_costmap)
    transform = plugin_calls.lookup_transform(navigation.robot, target, sent.frame, now, tolerance)
    pose = goal.pose = transform.apply(sent.pose)
    if sent.frame != target:
        text = f'the goal is at ({pose.x:.3f}, {pose.y:.3f}) in "{target}"'
        navigation.events.info(now, text, goal_pose=list(pose))
    return pose

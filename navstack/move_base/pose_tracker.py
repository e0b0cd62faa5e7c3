"""The robot's pose in each control cycle: feedback, distance driven and progress."""

from __future__ import annotations

from navstack.core.errors import NavError
from navstack.move_base import plugin_calls
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.navigation import Navigation
from navstack.move_base.progress import Progress
from navstack.move_base.states import NavEvent


class PoseTracker:
    """Tracks the robot towards the active goal."""

    def __init__(self, navigation: Navigation) -> None:
        self._navigation = navigation

    def update(self, goal: ActiveGoal, now: float) -> bool:
        """Update pose and progress at `now` (s), and publish feedback; return False if the pose is unknown.

        An unknown pose is not an error here: the plan request and the local planner report it.
        """
        navigation = self._navigation
        try:
            pose = plugin_calls.robot_pose(navigation.global_costmap, now)
        except NavError:
            navigation.pose = None
            return False
        if navigation.pose is not None:
            goal.driven_m += navigation.pose.distance_to(pose)
        navigation.pose = goal.statistics.pose = pose
        progress = goal.progress.update(pose)
        if progress is not Progress.NONE:
            goal.last_progress = now
            if progress is Progress.MOVED:
                goal.rounds = 0
                navigation.apply(NavEvent.MOVED, now)
        navigation.events.feedback(now, pose)
        return True

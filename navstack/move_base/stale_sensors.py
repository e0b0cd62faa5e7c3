"""What happens while a command would rest on stale or impossible data (parity 23)."""

from __future__ import annotations

from navstack.core.errors import FrameError, NavError
from navstack.move_base import plugin_calls, status_messages
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.costmap_updater import CostmapUpdater
from navstack.move_base.errors import OdometryError, StaleSensorsError
from navstack.move_base.navigation import Navigation
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import Mode, NavEvent


class StaleSensorCheck:
    """Stops the robot while its inputs must not be used, and ends the goal after controller_patience.

    The inputs are the local costmap, the transform of the plan (while controlling) and the odometry.
    """

    def __init__(self, navigation: Navigation, costmaps: CostmapUpdater) -> None:
        self._navigation = navigation
        self._costmaps = costmaps

    def is_stale(self, goal: ActiveGoal, now: float) -> bool:
        """Return True if the robot must not move at `now` (s); the robot has stopped then, or the goal has ended."""
        navigation = self._navigation
        cause = self._costmaps.local_error
        try:
            stale = cause is not None or not plugin_calls.is_current(navigation.local_costmap, now)
        except NavError as exc:
            stale, cause = True, exc
        if not stale:
            cause = self._input_error(now)
            stale = cause is not None
        if not stale:
            goal.stale_since = None
            return False
        if goal.stale_since is None:
            goal.stale_since = now
            if isinstance(cause, (OdometryError, FrameError)) and self._costmaps.local_error is None:
                text = f"the robot is stopped: {cause.message}"
            else:
                text = status_messages.LOG_STALE.format(name=navigation.local_costmap.name)
            navigation.events.warn(now, text, cause)
        goal.statistics.stale_cycles += 1
        if now - goal.stale_since < navigation.params.controller_patience - EPSILON_S:
            navigation.apply(NavEvent.SENSORS_STALE, now)
            return True
        error = cause or self._timeout(goal)
        goal.statistics.add_failure(error, now)
        navigation.apply(NavEvent.SENSORS_LOST, now, error)
        return True

    def _input_error(self, now: float) -> NavError | None:
        """Return why the odometry or the transform of the plan must not be used at `now` (s).

        Other errors of the robot fail the control cycle, as in C++.
        """
        navigation, costmaps = self._navigation, self._costmaps
        plan = navigation.plan if navigation.state.mode is Mode.CONTROLLING else None
        try:
            costmaps.local_state(now)
        except OdometryError as exc:
            return exc
        except NavError:
            return None  # reported by the control cycle or the recovery behavior
        try:
            if plan is not None:
                costmaps.plan_transform(plan, now)
        except NavError as exc:
            return exc
        return None

    def _timeout(self, goal: ActiveGoal) -> NavError:
        costmap = self._navigation.local_costmap
        problems = plugin_calls.call(costmap, costmap.problems)
        reasons = "; ".join(problem.message for problem in problems) or "check the sensor and its topic"
        return StaleSensorsError(
            f"a sensor of {costmap.name} has been stale (no usable data within its expected_update_rate) for "
            f"controller_patience ({self._navigation.params.controller_patience:g} s); {reasons}",
            costmap=costmap.name,
            since=goal.stale_since,
            problems=[problem.as_dict() for problem in problems],
        )

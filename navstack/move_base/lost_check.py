"""What happens while the robot does not know where it is.

ROS differs: amcl does not report it, and move_base drives on.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, Literal

from navstack.core.errors import NavError
from navstack.interfaces import LocalizationStatus
from navstack.move_base import plugin_calls
from navstack.move_base.active_goal import ActiveGoal
from navstack.move_base.errors import LostError
from navstack.move_base.navigation import Navigation
from navstack.move_base.schedule import EPSILON_S
from navstack.move_base.states import NavEvent

LostAction = Literal["recover", "stop", "ignore"]
_KNOWN: Final = LocalizationStatus()
_UNEXPLAINED: Final = "its localization reports that it is lost"


class LostCheck:
    """Publishes when the robot is lost and when it has found itself, and stops it meanwhile."""

    def __init__(self, navigation: Navigation, refresh: Callable[[float], None]) -> None:
        """`refresh` makes the costmaps due at a time (s)."""
        self._refresh = refresh
        self.action: LostAction = "recover"
        """recover: run the recovery behaviors, then wait; stop: wait; ignore: drive on."""
        self.timeout_s = 60.0
        """A goal that has waited this long (s) for a lost robot is aborted."""
        self._navigation = navigation
        self._status = _KNOWN
        self._failed = False
        self._lost_at = 0.0
        """Time (s) at which the robot last began to be lost."""

    def observe(self, now: float) -> None:
        """Read the status at `now` (s) and publish a change."""
        events = self._navigation.events
        try:
            status = plugin_calls.localization_status(self._navigation.robot)
        except NavError as exc:
            if not self._failed:
                events.warn(now, f"it is not known whether the robot is lost: {exc.message}", exc)
            self._failed = True
            return
        if status is None:
            return
        before, self._status = self._status, status
        if status.lost == before.lost:
            return
        if status.lost:
            self._lost_at = now
            events.warn(now, status.text or _UNEXPLAINED, self._error(status))
            return
        since = self._lost_at
        events.info(now, f"the robot is localized again, after {now - since:.1f} s", lost=False, lost_since=since)
        self._forget(now)

    def blocks(self, goal: ActiveGoal, now: float) -> bool:
        """Return True if the robot is lost and must wait; False if it may drive, or recover in CLEARING."""
        status, navigation = self._status, self._navigation
        if not status.lost or self.action == "ignore":
            return False
        waited = now - max(self._lost_at, goal.handle.accepted_at or 0.0)
        params = navigation.params
        left = params.recovery_behavior_enabled and navigation.state.recovery_index < len(navigation.recoveries)
        if self.action == "recover" and left:
            goal.lost = self._error(status)
            navigation.apply(NavEvent.LOST, now, goal.lost)
            return False
        if waited < self.timeout_s - EPSILON_S:
            navigation.apply(NavEvent.LOST_WAITING, now)
            return True
        goal.lost = error = self._error(status, f" for {waited:.0f} s (navstack/lost_timeout {self.timeout_s:g} s)")
        goal.statistics.add_failure(error, now)
        navigation.apply(NavEvent.LOST_TOO_LONG, now, error)
        return True

    def _error(self, status: LocalizationStatus, waited: str = "") -> LostError:
        return LostError(
            f"the robot does not know where it is{waited}: {status.text or _UNEXPLAINED}",
            since=status.since,
            explained=status.explained,
        )

    def _forget(self, now: float) -> None:
        """Forget the obstacles that were marked from wrong poses, and plan again."""
        navigation = self._navigation
        if self.action == "ignore":
            return
        costmaps = [navigation.global_costmap]
        if navigation.local_costmap.frame == navigation.global_costmap.frame:
            costmaps.append(navigation.local_costmap)
        for costmap in costmaps:
            plugin_calls.call(costmap, costmap.reset)
        self._refresh(now)  # a plan must not rest on an empty costmap
        if navigation.goal is not None:
            navigation.apply(NavEvent.FOUND, now)

"""Sensor data and periodic updates for both costmaps."""

from __future__ import annotations

import math
from typing import Final

from navstack.core import NavError, Window
from navstack.move_base.events import EventPublisher, TickResult
from navstack.move_base.plugin_calls import call, checked_problems, checked_window
from navstack.move_base.schedule import EPSILON_S, NEAR_S, Schedule
from navstack.plugins import CostmapServer, Robot, plugin_error

DEFAULT_UPDATE_FREQUENCY: Final = 5.0
"""Hz; the default of costmap_2d, for costmap servers without the parameter update_frequency."""
DEFAULT_TOLERANCE_S: Final = 0.3
"""Default of transform_tolerance of a costmap."""
REPEAT_S: Final = 10.0
"""Time between two warnings about the same sensor (s)."""


def transform_tolerance(costmap: CostmapServer) -> float:
    """Return the largest age (s) of a transform that a costmap accepts; the default for a server without the parameter."""
    return float(getattr(getattr(costmap, "params", None), "transform_tolerance", DEFAULT_TOLERANCE_S))


class CostmapUpdater:
    """Updates both costmaps when they are due. A failed update is a warning, and makes its costmap stale."""

    def __init__(
        self,
        robot: Robot,
        global_costmap: CostmapServer,
        local_costmap: CostmapServer,
        events: EventPublisher,
        *,
        enabled: bool = True,
        global_frequency: float | None = None,
        local_frequency: float | None = None,
    ) -> None:
        """Create an updater; the update frequencies (Hz) default to the costmaps' parameters."""
        self.enabled = enabled
        """True while the costmaps are updated."""
        self.local_error: NavError | None = None
        """Error of the local costmap's last update."""
        self.global_error: NavError | None = None
        """Error of the global costmap's last update."""
        self._warned: dict[tuple[object, ...], float] = {}
        """Times of the last warning (s) by costmap, topic and frame."""
        self._robot = robot
        self._global_costmap = global_costmap
        self._local_costmap = local_costmap
        self._events = events
        self._global_frequency = global_frequency
        self._local_frequency = local_frequency
        self._followed = -math.inf
        """Time (s) of the last `approach`."""
        self._global_update = Schedule(_update_frequency(global_costmap, global_frequency))
        self._local_update = Schedule(_update_frequency(local_costmap, local_frequency))

    @property
    def due(self) -> float:
        """Time of the next update (s)."""
        return min(self._global_update.due, self._local_update.due) if self.enabled else math.inf

    def restart(self, now: float) -> None:
        """Make both costmaps due at `now` (s)."""
        self._global_update.restart(now)
        self._local_update.restart(now)

    def read_frequencies(self, now: float) -> None:
        """Read the update frequencies again; a costmap whose frequency has changed is due at `now` (s)."""
        self._global_update.set_frequency(_update_frequency(self._global_costmap, self._global_frequency), now)
        self._local_update.set_frequency(_update_frequency(self._local_costmap, self._local_frequency), now)

    def enable(self, enabled: bool, now: float) -> None:
        """Start or stop the updates; costmaps that were stopped are due at `now` (s)."""
        if enabled and not self.enabled:
            self.restart(now)
        self.enabled = enabled

    def retry_failed(self, now: float) -> None:
        """Make costmaps whose last update failed due at `now` (s): an earlier failure must not end a new goal."""
        if self.global_error is not None:
            self._global_update.restart(now)
        if self.local_error is not None:
            self._local_update.restart(now)

    def observe(self, tick: TickResult) -> None:
        """Pass new sensor data of the robot to both costmaps."""
        robot, now = self._robot, tick.time
        try:
            scans = tick.scans = call(robot, robot.scans, check=tuple)
        except NavError as exc:
            self._events.warn(now, f"no scans from the robot: {exc.message}", exc)
            return
        costmaps = self._local_costmap, self._global_costmap
        for data in scans:
            for costmap in costmaps:
                try:
                    costmap.observe(data)
                except Exception as exc:
                    error = exc if isinstance(exc, NavError) else plugin_error(costmap, exc)
                    self._events.warn(
                        now, f"{costmap.name} cannot use a message of {data.topic}: {error.message}", error
                    )

    def update(self, tick: TickResult) -> None:
        """Update the costmaps that are due."""
        if not self.enabled:
            return
        now = tick.time
        if now >= self._global_update.due - EPSILON_S:
            self._global_update.advance(now)
            tick.global_window, self.global_error = self._update(self._global_costmap, now, self.global_error)
        if now >= self._local_update.due - EPSILON_S:
            self._local_update.advance(now)
            tick.local_window, self.local_error = self._update(self._local_costmap, now, self.local_error)

    def approach(self, time: float, command: float) -> None:
        """Shift the updates of the local costmap towards `time` (s), a little after a scan; see `Schedule.approach`.

        A scan that comes too late for its update has another one at `command` (s), before the next command, unless scans come
        more often than updates.
        """
        update = self._local_update
        interval, self._followed = time - self._followed, time
        update.approach(time)
        if update.due - time > NEAR_S and interval > 0.75 * update.period:
            update.hasten(max(time, command))

    def _update(
        self, costmap: CostmapServer, now: float, before: NavError | None
    ) -> tuple[Window | None, NavError | None]:
        """Return the window of the updated cells and the error; publishes the first of several errors in a row."""
        try:
            window = call(costmap, costmap.update, now, check=checked_window)
            for problem in call(costmap, costmap.problems, check=checked_problems):
                self._warn_of_sensor(costmap, problem, now)
            return window, None
        except NavError as exc:
            if before is None:
                self._events.warn(now, f"{costmap.name} could not be updated: {exc.message}", exc)
            return None, exc

    def _warn_of_sensor(self, costmap: CostmapServer, problem: NavError, now: float) -> None:
        """Warn at once that a sensor is not used, then every `REPEAT_S`."""
        key = (costmap.name, problem.data.get("topic"), problem.data.get("source"))
        last = self._warned.get(key)
        if last is None or now - last >= REPEAT_S - EPSILON_S:
            self._warned[key] = now
            self._events.warn(now, f"{costmap.name}: {problem.message}", problem)


def _update_frequency(costmap: CostmapServer, frequency: float | None) -> float:
    if frequency is not None:
        return frequency
    return float(getattr(getattr(costmap, "params", None), "update_frequency", DEFAULT_UPDATE_FREQUENCY))

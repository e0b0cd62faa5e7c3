"""Sensor data and periodic updates for both costmaps, and the local costmap as input of the local planner."""

from __future__ import annotations

import math
from typing import Final

from navstack.core import RobotState, Transform2D, Window
from navstack.core.errors import NavError
from navstack.interfaces import ControlInput, CostmapServer, Plan
from navstack.move_base.navigation import Navigation
from navstack.move_base.odometry_check import OdometryCheck, check_age
from navstack.move_base.plugin_calls import call, lookup_transform, robot_pose, robot_state, transform_tolerance
from navstack.move_base.schedule import EPSILON_S, NEAR_S, Schedule
from navstack.move_base.tick_result import TickResult

DEFAULT_UPDATE_FREQUENCY: Final = 5.0
"""Hz; the default of costmap_2d, for costmap servers without the parameter update_frequency."""
REPEAT_S: Final = 10.0
"""Time between two warnings about the same sensor (s)."""


class CostmapUpdater:
    """Updates both costmaps when they are due. A failed update is a warning, and makes its costmap stale."""

    def __init__(
        self,
        navigation: Navigation,
        global_update_frequency: float | None = None,
        local_update_frequency: float | None = None,
    ) -> None:
        """Create an updater; the update frequencies (Hz) default to the costmaps' parameters."""
        self.enabled = not navigation.params.shutdown_costmaps
        """True while the costmaps are updated."""
        self.local_error: NavError | None = None
        """Error of the local costmap's last update."""
        self.global_error: NavError | None = None
        """Error of the global costmap's last update."""
        self._warned: dict[tuple[object, ...], float] = {}
        """Times of the last warning (s) by costmap, topic and frame."""
        self._navigation = navigation
        self._odometry = OdometryCheck()
        self._state: RobotState | None = None
        """The robot's state at `_state_at` (s)."""
        self._state_at = -math.inf
        self._transform: Transform2D | None = None
        self._transform_of: tuple[str, str, float] = "", "", -math.inf
        """Frame of the plan, frame of the local costmap and time (s) of `_transform`."""
        self._robot = navigation.robot
        self._global_costmap = navigation.global_costmap
        self._local_costmap = navigation.local_costmap
        self._events = navigation.events
        self._tolerance_s = self._largest_tolerance()
        """Largest age of the plan's transform (s)."""
        self._global_frequency = global_update_frequency
        self._local_frequency = local_update_frequency
        self._followed = -math.inf
        """Time (s) of the last `approach`."""
        self._global_update = Schedule(_update_frequency(navigation.global_costmap, global_update_frequency))
        self._local_update = Schedule(_update_frequency(navigation.local_costmap, local_update_frequency))

    @property
    def due(self) -> float:
        """Time of the next update (s)."""
        return min(self._global_update.due, self._local_update.due) if self.enabled else math.inf

    def restart(self, now: float) -> None:
        """Make both costmaps due at `now` (s)."""
        self._global_update.restart(now)
        self._local_update.restart(now)

    def read_frequencies(self, now: float) -> None:
        """Read the update frequencies and tolerances again; a costmap whose frequency has changed is due at `now` (s)."""
        self._tolerance_s = self._largest_tolerance()
        self._global_update.set_frequency(_update_frequency(self._global_costmap, self._global_frequency), now)
        self._local_update.set_frequency(_update_frequency(self._local_costmap, self._local_frequency), now)

    def enable(self, enabled: bool, now: float) -> None:
        """Start or stop the updates; costmaps that were stopped are due at `now` (s)."""
        if enabled and not self.enabled:
            self.restart(now)
        self.enabled = enabled

    def retry_failed(self, now: float) -> None:
        """Make costmaps whose last update failed due at `now` (s): an earlier failure must not end a new goal."""
        self._odometry.reset()
        if self.global_error is not None:
            self._global_update.restart(now)
        if self.local_error is not None:
            self._local_update.restart(now)

    def observe(self, now: float, tick: TickResult) -> None:
        """Pass new sensor data of the robot to both costmaps."""
        self._state = self._transform = None
        robot = self._robot
        try:
            scans = tuple(call(robot, robot.scans))
        except NavError as exc:
            self._events.warn(now, f"no scans from the robot: {exc.message}", exc)
            return
        tick.scans = scans
        for data in scans:
            for costmap in (self._local_costmap, self._global_costmap):
                try:
                    call(costmap, costmap.observe, data)
                except NavError as exc:
                    self._events.warn(now, f"{costmap.name} cannot use a message of {data.topic}: {exc.message}", exc)

    def update(self, now: float, tick: TickResult) -> None:
        """Update the costmaps that are due."""
        if not self.enabled:
            return
        if self._global_update.is_due(now):
            self._global_update.advance(now)
            tick.global_window, self.global_error = self._update(self._global_costmap, now, self.global_error)
        if self._local_update.is_due(now):
            self._local_update.advance(now)
            tick.local_window, self.local_error = self._update(self._local_costmap, now, self.local_error)

    def local_state(self, now: float) -> RobotState:
        """Return the robot's pose in the local costmap's frame at `now` (s), and its velocity.

        Raises NavError if the pose is not known at that time, StaleOdometryError if the odometry is older than
        transform_tolerance, OdometryError if it is impossible.
        """
        if self._state is not None and self._state_at == now:
            return self._state
        self._state = None
        costmap = self._local_costmap
        pose = robot_pose(costmap, now)
        state = robot_state(self._robot)
        check_age(state, now, transform_tolerance(costmap))
        checked = RobotState(pose, state.velocity, state.stamp, costmap.frame)
        navigation = self._navigation
        # commands rest on the pose of the transform if that is the odometry's; a single jump must not end the goal
        odometry = checked if state.frame == costmap.frame else state
        self._odometry.check(odometry, navigation.local_planner, now, 0.5 * navigation.params.controller_patience)
        self._state, self._state_at = checked, now
        return checked

    def plan_transform(self, plan: Plan, now: float) -> Transform2D | None:
        """Return the transform from the plan's frame to the local costmap's at `now` (s); None if the frames are equal.

        Raises FrameError if it is older than transform_tolerance (the larger one of the two costmaps).
        ROS differs: C++ uses the newest transform, however old it is.
        """
        source, target = plan.path.frame, self._local_costmap.frame
        if source == target:
            return None
        if self._transform is None or self._transform_of != (source, target, now):
            self._transform = lookup_transform(self._robot, target, source, now, self._tolerance_s)
            self._transform_of = source, target, now
        return self._transform

    def _largest_tolerance(self) -> float:
        return max(transform_tolerance(self._local_costmap), transform_tolerance(self._global_costmap))

    def control_input(self, plan: Plan, now: float) -> ControlInput:
        """Return the local planner's input for `plan` at `now` (s). Raises NavError."""
        costmap = self._local_costmap
        state = self.local_state(now)
        transform = self.plan_transform(plan, now) or Transform2D()
        inflation = next((found for layer in costmap.layers if (found := layer.inflation) is not None), None)
        unknown = bool(getattr(getattr(costmap, "params", None), "track_unknown_space", False))
        return ControlInput(state, costmap.master, costmap.footprint, transform, inflation, unknown)

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
            window = call(costmap, costmap.update, now)
            for problem in call(costmap, costmap.problems):
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

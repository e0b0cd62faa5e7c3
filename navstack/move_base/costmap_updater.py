"""What the goal manager knows of the world: scans go into both costmaps, costmaps are updated when due, silence is noticed."""

from __future__ import annotations

import math
from collections.abc import Callable

from navstack.core import RobotState, Window
from navstack.core.errors import InternalError, NavError
from navstack.interfaces import ControlInput, CostmapServer, Plan, Robot
from navstack.move_base import plugin_calls
from navstack.move_base.schedule import Schedule
from navstack.move_base.tick_result import TickResult

DEFAULT_UPDATE_FREQUENCY = 5.0
"""Hz; costmap_2d's, for costmap servers that have no word on it."""

Warn = Callable[[float, str, NavError | None], None]
"""Tells whoever listens: time (s), text, the error behind it."""


class CostmapUpdater:
    """Both costmaps, their schedules and the robot that feeds them. Failures are warnings, and held against the costmap."""

    def __init__(
        self,
        robot: Robot,
        global_costmap: CostmapServer,
        local_costmap: CostmapServer,
        warn: Warn,
        *,
        global_update_frequency: float | None = None,
        local_update_frequency: float | None = None,
        on: bool = True,
    ) -> None:
        """The frequencies (Hz) are those of the costmaps' own parameters unless given; `on`: costmaps are updated."""
        self.robot = robot
        self.global_costmap = global_costmap
        self.local_costmap = local_costmap
        self._costmaps = (local_costmap, global_costmap)
        self.on = on
        self.local_error: NavError | None = None
        """Why the last update of the local costmap failed."""
        self.global_error: NavError | None = None
        self._warn = warn
        self._given = (global_update_frequency, local_update_frequency)
        self._global_update = Schedule(_update_frequency(global_costmap, global_update_frequency))
        self._local_update = Schedule(_update_frequency(local_costmap, local_update_frequency))

    @property
    def due(self) -> float:
        """When a costmap is to be updated next, s."""
        return min(self._global_update.due, self._local_update.due) if self.on else math.inf

    def restart(self, now: float) -> None:
        """Both costmaps are due at `now` (s)."""
        self._global_update.restart(now)
        self._local_update.restart(now)

    def read_frequencies(self, now: float) -> None:
        """The costmaps' parameters have changed: those that are updated at another frequency now are due at `now` (s)."""
        whole, near = self._given
        for costmap, given, name in (
            (self.global_costmap, whole, "_global_update"),
            (self.local_costmap, near, "_local_update"),
        ):
            frequency = _update_frequency(costmap, given)
            if frequency != getattr(self, name).frequency:
                setattr(self, name, Schedule(frequency, now))

    def switch(self, on: bool, now: float) -> None:
        """Updates the costmaps, or does so no more; those that were off are due at once."""
        if on and not self.on:
            self.restart(now)
        self.on = on

    def retry_failed(self, now: float) -> None:
        """A costmap that failed is due at once, to have its chance before a goal is judged by it."""
        if self.global_error is not None:
            self._global_update.restart(now)
        if self.local_error is not None:
            self._local_update.restart(now)

    def observe(self, now: float, result: TickResult) -> None:
        """Hands what the robot has seen to both costmaps."""
        try:
            scans = tuple(self.robot.scans())
        except Exception as exc:
            self._warn(now, f"no scans from the robot: {describe(exc)}", None)
            return
        result.scans = scans
        for data in scans:
            for costmap in self._costmaps:
                try:
                    costmap.observe(data)
                except Exception as exc:
                    self._warn(now, f"{costmap.name} cannot use a message of {data.topic}: {describe(exc)}", None)

    def update(self, now: float, result: TickResult) -> None:
        """Updates the costmaps that are due."""
        if not self.on:
            return
        if self._global_update.is_due(now):
            self._global_update.advance(now)
            result.global_window, self.global_error = self._updated(self.global_costmap, now, self.global_error)
        if self._local_update.is_due(now):
            self._local_update.advance(now)
            result.local_window, self.local_error = self._updated(self.local_costmap, now, self.local_error)

    def staleness(self, now: float) -> tuple[bool, NavError | None]:
        """True while the local costmap cannot be trusted, and why, where that is not a sensor that is silent."""
        if self.local_error is not None:
            return True, self.local_error
        try:
            return not self.local_costmap.is_current(now), None
        except Exception as exc:
            return True, plugin_calls.internal(self.local_costmap.name, exc)

    def local_state(self, now: float) -> RobotState:
        """Pose in the local costmap's frame, velocity as the robot says; raises NavError."""
        costmap = self.local_costmap
        try:
            pose = costmap.robot_pose(now)
            state = self.robot.state()
        except NavError:
            raise
        except Exception as exc:
            raise plugin_calls.internal("the robot", exc) from exc
        velocity = state.velocity
        if not pose.is_finite() or not velocity.is_finite():
            raise InternalError(
                f"the robot's pose {tuple(pose)} or velocity {tuple(velocity)} is not finite",
                pose=pose,
                velocity=velocity,
            )
        return RobotState(pose, velocity, state.stamp, costmap.frame)

    def control_input(self, plan: Plan, now: float) -> ControlInput:
        """What the local planner needs to follow `plan`; raises NavError."""
        costmap = self.local_costmap
        state = self.local_state(now)
        frame = plan.path.frame
        if frame == state.frame:
            return ControlInput(state, costmap.master, costmap.footprint)
        try:
            transform = self.robot.frames.lookup(state.frame, frame)
        except NavError:
            raise
        except Exception as exc:
            raise plugin_calls.internal("the robot's frames", exc) from exc
        return ControlInput(state, costmap.master, costmap.footprint, transform)

    def _updated(
        self, costmap: CostmapServer, now: float, before: NavError | None
    ) -> tuple[Window | None, NavError | None]:
        try:
            return costmap.update(now), None
        except NavError as exc:
            error: NavError = exc
        except Exception as exc:
            error = plugin_calls.internal(costmap.name, exc)
        if before is None:
            self._warn(now, f"{costmap.name} could not be updated: {error.message}", error)
        return None, error


def describe(problem: Exception) -> str:
    """What an exception has to say."""
    return str(problem) or type(problem).__name__


def _update_frequency(costmap: CostmapServer, given: float | None) -> float:
    if given is not None:
        return given
    return float(getattr(getattr(costmap, "params", None), "update_frequency", DEFAULT_UPDATE_FREQUENCY))

"""Driving straight for a distance, collision-checked: what back_up and drive_on_heading share.

Source of behaviour and names: nav2_behaviors (drive_on_heading.hpp).
"""

from __future__ import annotations

import math
from typing import Any

from navstack.core import Costmap, Footprint, Pose2D, RobotState, Twist2D, describe_cost
from navstack.core.collision import footprint_cost
from navstack.core.costs import LETHAL
from navstack.core.errors import CollisionAheadError, RecoveryError
from navstack.interfaces import RecoveryBehavior, RecoveryContext, RecoveryStatus, RecoveryStep


def clear_distance(costmap: Costmap, footprint: Footprint, pose: Pose2D, distance: float) -> tuple[float, int | None]:
    """How far (m, up to `|distance|`) the outline can go from `pose` along its heading, backwards when negative.

    Looked at every half cell, the whole outline each time. Returns also the cost that ends it: below LETHAL when nothing
    does, None for the edge of the costmap.
    """
    step = 0.5 * costmap.geometry.resolution
    count = math.ceil(abs(distance) / step)
    worst = 0
    for k in range(count + 1):
        along = math.copysign(min(k * step, abs(distance)), distance)
        at = Pose2D(pose.x + along * math.cos(pose.yaw), pose.y + along * math.sin(pose.yaw), pose.yaw)
        cost = footprint_cost(costmap, footprint, at)
        if cost is None or cost >= LETHAL:
            return abs(along), cost
        worst = max(worst, cost)
    return abs(distance), worst


class StraightDrive:
    """One drive of `distance` (m, backwards when negative) at `speed` (m/s, positive), a command a step."""

    def __init__(
        self,
        name: str,
        context: RecoveryContext,
        now: float,
        *,
        distance: float,
        speed: float,
        time_allowance: float,
        look_ahead_s: float,
        frequency: float,
        check_collisions: bool,
        timeout: type[RecoveryError],
        collision: type[CollisionAheadError],
    ) -> None:
        self.name = name
        self.driven = 0.0
        """m since the first step, straight."""
        self._context = context
        self._began = now
        self._distance = distance
        self._speed = min(speed, context.local_planner.limits.max_vel_trans)
        self._time_allowance = time_allowance
        self._look_ahead_s = look_ahead_s
        self._frequency = frequency
        self._check = check_collisions
        self._timeout, self._collision = timeout, collision
        self._start: Pose2D | None = None

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """The next command; raises the timeout's or the collision's error."""
        pose = state.pose
        first = self._start is None
        if self._start is None:
            self._start = pose
        self.driven = self._start.distance_to(pose)
        left = abs(self._distance) - self.driven
        data = {"driven_m": self.driven, "left_m": max(0.0, left)}
        # the command holds for a whole period: stop at the step that comes nearest
        if left <= 0.5 * self._speed / self._frequency:
            return RecoveryStep(RecoveryStatus.DONE, text=f"{self.name}: drove {self.driven:.2f} m", data=data)
        if now - self._began > self._time_allowance:
            raise self._timeout(
                f"{self.name} drove {self.driven:.2f} of {abs(self._distance):.2f} m within its time_allowance of "
                f"{self._time_allowance:g} s",
                **data,
            )
        if self._check:
            ahead = math.copysign(min(left, self._speed * self._look_ahead_s), self._distance)
            costmap = self._context.local_costmap
            clear, cost = clear_distance(costmap.master, costmap.footprint, pose, ahead)
            if cost is None or cost >= LETHAL:
                what = "the edge of the costmap" if cost is None else f"cost {describe_cost(cost)}"
                raise self._collision(
                    f"{self.name} stopped after {self.driven:.2f} of {abs(self._distance):.2f} m: {clear:.2f} m further "
                    f"on the outline meets {what}",
                    cost=cost,
                    collision_after_m=clear,
                    **data,
                )
        text = f"{self.name}: driving {self._distance:.2f} m at {self._speed:g} m/s" if first else ""
        speed = math.copysign(self._speed, self._distance)
        return RecoveryStep(RecoveryStatus.RUNNING, Twist2D(speed, 0.0, 0.0), text, data)


class StraightRecovery(RecoveryBehavior):
    """A recovery that is one straight drive; who derives from it says in `start` how far and how fast."""

    def __init__(self, name: str, params: Any) -> None:
        super().__init__(name, params)
        self._drive: StraightDrive | None = None

    @property
    def frequency(self) -> float:
        """Commands per second."""
        return self.params.cycle_frequency

    def step(self, state: RobotState, now: float) -> RecoveryStep:
        """The next command; raises the timeout's or the collision's error."""
        assert self._drive is not None
        return self._drive.step(state, now)

    def drive(
        self,
        context: RecoveryContext,
        now: float,
        *,
        distance: float,
        speed: float,
        timeout: type[RecoveryError],
        collision: type[CollisionAheadError],
    ) -> None:
        """Begins: `distance` (m, backwards when negative) at `speed` (m/s), from the pose at the first step."""
        p = self.params
        self._drive = StraightDrive(
            self.name,
            context,
            now,
            distance=distance,
            speed=abs(speed),
            time_allowance=p.time_allowance,
            look_ahead_s=p.simulate_ahead_time,
            frequency=p.cycle_frequency,
            check_collisions=not p.disable_collision_checks,
            timeout=timeout,
            collision=collision,
        )

"""The action `approach`: keeps a time to the first contact, and a command from which the robot can still brake."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import Twist2D
from navstack.safety import _contact_kernels as contact
from navstack.safety import _zone_kernels as kernels
from navstack.safety.zones import MOST_SHOWN, Shape, Zone

FRACTIONS: Final = (1.0, 0.75, 0.5, 0.25)
"""Factors of a command that are tried until the robot can brake; then it stops."""
BRAKING_STEP_S: Final = 0.02
"""Time between two poses of the braking robot (s)."""
_MOST_POSES: Final = 500


@dataclass(frozen=True, slots=True, eq=False)
class ApproachLimit:
    """A slower command."""

    ratio: float
    """Factor of the command."""
    kind: Literal["inside", "contact", "braking"]
    """Points in the zone come nearer; points touch it within `time_before_collision`; the robot could not brake."""
    time: float
    """Seconds to the first contact, inf if it is not predicted."""
    points: NDArray[np.float64]
    """(k, 2) points in question, base frame."""


class Approach:
    """Predicts contacts of zones with points."""

    def __init__(
        self,
        body: NDArray[np.float64],
        hull: Shape,
        *,
        decel: NDArray[np.float64] | None,
        reaction_s: float,
        period_s: float,
        as_nav2: bool,
    ) -> None:
        """`body`: the robot's outline (n, 2), counter-clockwise; `hull`: the same, but a circle for a round robot.

        `decel` (3,): magnitudes (m/s², rad/s²); None if unknown. `reaction_s`: time until the robot follows a command (s);
        `period_s`: time between two checks (s). `as_nav2`: simulate in steps, as Nav2 does.
        """
        self.sent = np.zeros(3)
        """(3,) the last command that was sent to the robot."""
        self._body = body
        # the polygon of a circle would come nearer to points beside it when it turns
        self._hull = hull
        self._body_reach = float(np.hypot(body[:, 0], body[:, 1]).max())
        # an axis without deceleration is one that the robot does not have
        self._decel = None if decel is None else np.where(decel > 0.0, decel, 1e9)
        # the last command is in force until the robot reacts, then the new one until the next check
        self._until = np.array((reaction_s, reaction_s + period_s))
        self._as_nav2 = as_nav2
        self._times = np.empty(0)
        self._poses = np.empty((_MOST_POSES, 4))

    def limit(
        self, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D
    ) -> ApproachLimit | None:
        """Return the slower command that a zone demands, None if it lets the command pass.

        `points` (k, 2) in the base frame; `measured` is the robot's velocity.
        """
        shape = zone.shape
        assert shape is not None
        if not len(points):
            return None
        u = np.array(command, np.float64)
        if self._as_nav2:
            return self._stepped(zone, shape, points, u)
        horizon = zone.params.time_before_collision
        times = self._times
        if len(times) < len(points):
            times = self._times = np.empty(len(points))
        times = times[: len(points)]
        near = contact.first_contacts(points, shape.corners, shape.radius, shape.reach, u, horizon, times)
        found: ApproachLimit | None = None
        if near >= zone.least and command.speed + abs(command.wz) > 0.0:
            found = self._contact(zone, shape, points, times, u)
        if found is not None and found.ratio <= 0.0:
            return found
        return self._braking(zone, shape, points, u, measured, found)

    def moves_away(self, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D) -> bool:
        """Return True if a command brings none of the points in the zone nearer to the robot's outline.

        The robot, with the velocity `measured`, must not touch one of them either, before it has followed the command.
        """
        shape = zone.shape
        assert shape is not None
        found = np.empty(len(points), np.int64)
        count = kernels.count_inside(points, shape.corners, shape.radius, shape.reach, found)
        u = np.array(command, np.float64)
        if count == 0 or self._nearer(points, found, count, u) >= 0:
            return False
        if self._decel is None:
            return True
        velocity = np.array(measured, np.float64)
        return self._touched(zone, shape, points[found[:count]], velocity, u)[0] < zone.least

    def _nearer(self, points: NDArray[np.float64], found: NDArray[np.int64], count: int, u: NDArray[np.float64]) -> int:
        return kernels.any_nearer(points, found, count, self._hull.corners, self._hull.radius, u)

    def _stepped(
        self, zone: Zone, shape: Shape, points: NDArray[np.float64], u: NDArray[np.float64]
    ) -> ApproachLimit | None:
        horizon = zone.params.time_before_collision
        step = zone.params.simulation_time_step
        time = contact.stepped_contact(points, shape.corners, shape.radius, zone.least, u, horizon, step)
        if time < 0.0:
            return None
        kind: Literal["inside", "contact"] = "inside" if time == 0.0 else "contact"
        return ApproachLimit(time / horizon, kind, time, points[zone.inside(points)[1]])

    def _contact(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        times: NDArray[np.float64],
        u: NDArray[np.float64],
    ) -> ApproachLimit | None:
        """The limit by the time at which the last of `min_points` points touches the zone."""
        inside = times <= 0.0
        count = int(inside.sum())
        if count >= zone.least:
            index = np.flatnonzero(inside)
            leaves = zone.params.allow_moving_away
            nearer = self._nearer(points, index, len(index), u) if leaves else int(index[0])
            if nearer >= 0:
                return ApproachLimit(0.0, "inside", 0.0, points[index[:MOST_SHOWN]])
            # those points are left behind: what counts is what comes next
            times = np.where(inside, math.inf, times)
        wanted = zone.least
        if int(np.isfinite(times).sum()) < wanted:
            return None
        order = np.argpartition(times, wanted - 1)[:wanted]
        time = float(times[order].max())
        ratio = time / zone.params.time_before_collision
        return ApproachLimit(ratio, "contact", time, points[order[:MOST_SHOWN]]) if ratio < 1.0 else None

    def _braking(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        u: NDArray[np.float64],
        measured: Twist2D,
        found: ApproachLimit | None,
    ) -> ApproachLimit | None:
        """The limit by the way that the robot needs to brake; `found` if that is stricter."""
        if self._decel is None:
            return found
        ratio = found.ratio if found is not None else 1.0
        velocity = np.array(measured, np.float64)
        hit = -1
        for fraction in FRACTIONS:
            touched, last = self._touched(zone, shape, points, velocity, fraction * ratio * u)
            if touched < zone.least:
                if fraction == 1.0:
                    return found
                return ApproachLimit(
                    fraction * ratio, "braking", found.time if found else math.inf, points[hit : hit + 1]
                )
            hit = last
        return ApproachLimit(0.0, "braking", found.time if found else math.inf, points[hit : hit + 1])

    def _touched(
        self,
        zone: Zone,
        shape: Shape,
        points: NDArray[np.float64],
        velocity: NDArray[np.float64],
        command: NDArray[np.float64],
    ) -> tuple[int, int]:
        assert self._decel is not None
        commands = np.vstack((self.sent, command))
        count = contact.braking_poses(
            velocity, commands, self._until, self._decel, BRAKING_STEP_S, shape.reach, self._poses
        )
        return contact.touched_while_braking(
            points, shape.corners, shape.radius, shape.reach, self._body, self._poses, count, zone.least
        )

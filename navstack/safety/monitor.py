"""The collision monitor: stops or slows the robot down while obstacles are in zones around it.

Behavior and parameters: nav2_collision_monitor; deliberate differences: the parity page of the documentation.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Footprint, FrameTree, InputError, Twist2D
from navstack.parameters import CollisionDetectorParams, CollisionMonitorParams
from navstack.safety.approach import Approach, ApproachLimit
from navstack.safety.sources import NO_POINTS, Frames, Observation, PointField, body_shape
from navstack.safety.zones import Action, Shape, Zone

_STOP: Final = Twist2D()
_ROUNDING_S: Final = 1e-9
INVALID_SOURCE: Final = "invalid source"
"""Zone of a decision that no zone made, as Nav2 names it."""
TOO_NEAR: Final = "too near"
"""Zone of a decision that no zone made: a source sees hardly anything but something too near to measure."""


@dataclass(frozen=True, slots=True, eq=False)
class MonitorDecision:
    """What the monitor made of a command."""

    command: Twist2D
    """The command for the robot."""
    is_sent: bool
    """False if it has been zero for longer than `stop_pub_timeout`."""
    action: Action
    """What changed the command; `none` if nothing did."""
    zone: str
    """Zone that decided, `invalid source`, `too near`, or empty."""
    ratio: float
    """Factor of the command."""
    reason: str
    """Why, in one clause; empty for `none`."""
    points: NDArray[np.float64]
    """(k, 2) points that triggered the zone, base frame, at most 32."""
    time_to_contact: float
    """Seconds until the first contact with the incoming command; inf if there is none or the zone does not predict it."""


@dataclass(slots=True)
class _Verdict:
    """The strictest proposal so far."""

    ratio: float = 1.0
    action: Action = "none"
    zone: str = ""
    reason: str = ""
    points: NDArray[np.float64] = field(default_factory=lambda: NO_POINTS)
    time: float = math.inf

    def tighten(
        self, ratio: float, action: Action, zone: str, reason: str, points: NDArray[np.float64], time: float = math.inf
    ) -> None:
        """Take a proposal if it is slower than the one held; ties keep the earlier zone."""
        if ratio < self.ratio:
            self.ratio, self.action, self.zone, self.reason = ratio, action, zone, reason
            self.points, self.time = points, time


class CollisionMonitor:
    """Checks one command after the other against the latest sensor data."""

    def __init__(
        self,
        params: CollisionMonitorParams,
        *,
        frames: FrameTree,
        base_frame: str = "base_footprint",
        odom_frame: str = "odom",
        footprint: Footprint | None = None,
        padded_footprint: Footprint | None = None,
        max_decel: tuple[float, float, float] | None = None,
    ) -> None:
        """`base_frame` and `odom_frame` count where the parameters set none.

        `footprint` is the robot's true outline: which motion brings an obstacle nearer is measured from it. Zones that take the
        footprint have the `padded_footprint`. `max_decel` (m/s², rad/s², at most 0) is used where the parameters set none.
        """
        self.params = params
        self.enabled = params.enabled
        self.frames = Frames(
            frames,
            params.base_frame_id or base_frame,
            params.odom_frame_id or odom_frame,
            params.transform_tolerance,
            params.base_shift_correction,
        )
        names = tuple(params.sources)
        self.zones = [Zone(name, zone, names, padded_footprint or footprint) for name, zone in params.zones.items()]
        sources = params.sources
        if params.nav2_compatible:  # to Nav2, a scan without a valid beam is a free one
            sources = {name: source.model_copy(update={"min_valid_share": 0.0}) for name, source in sources.items()}
        self.field = PointField(sources, self.frames, params.source_timeout)
        self._body = footprint.vertices if footprint is not None else (padded_footprint or _point()).vertices
        self._body = Shape(self._body).corners
        self._hull = body_shape(self._body)
        decel = params.max_decel if params.max_decel is not None else max_decel
        self._approach = Approach(
            self._body,
            self._hull,
            decel=None if decel is None or params.nav2_compatible else np.abs(np.array(decel, np.float64)),
            reaction_s=params.reaction_time,
            period_s=1.0 / params.check_frequency,
            as_nav2=params.nav2_compatible,
        )
        self._stopped_since: float | None = None
        self.last: MonitorDecision | None = None
        """The last decision."""

    def observe(self, data: Observation) -> None:
        """Take sensor data; each source takes the messages of its topic."""
        self.field.observe(data)

    def set_shape(self, zone: str, shape: Shape) -> None:
        """Set the shape of a zone with a `polygon_sub_topic`, or of a footprint. Raises InputError for an unknown zone."""
        for one in self.zones:
            if one.name == zone:
                one.set_shape(shape)
                return
        known = ", ".join(one.name for one in self.zones)
        raise InputError(f'the collision monitor has no zone "{zone}" (it has: {known})', zone=zone)

    def process(self, command: Twist2D, now: float, velocity: Twist2D | None = None) -> MonitorDecision:
        """Check a command at `now` (s); `velocity` is the measured one (default: the command). Raises InputError for NaN."""
        if not command.is_finite():
            raise InputError(f"the command {tuple(command)} is not finite", command=command)
        verdict = _Verdict()
        if self.enabled:
            measured = velocity if velocity is not None and velocity.is_finite() else command
            self._judge(verdict, command, measured, now)
            if command == _STOP:
                verdict = _Verdict()  # nothing can make it slower
        r = verdict.ratio
        out = command if r == 1.0 else _STOP if r <= 0.0 else Twist2D(*(r * v for v in command))
        decision = MonitorDecision(
            out,
            self._is_sent(out, now),
            verdict.action,
            verdict.zone,
            verdict.ratio,
            verdict.reason,
            verdict.points,
            verdict.time,
        )
        self.last = decision
        self._approach.sent[:] = out
        return decision

    def note_sent(self, command: Twist2D) -> None:
        """Tell that the robot got a slower command than the last decision's: it is the one in force until the robot reacts."""
        self._approach.sent[:] = command

    # --- judgment -----------------------------------------------------------------------------------------------------

    def _judge(self, verdict: _Verdict, command: Twist2D, measured: Twist2D, now: float) -> None:
        zones = [zone for zone in self.zones if zone.enabled]
        used = None if self.params.nav2_compatible else {name for zone in zones for name in zone.sources}
        problems = self.field.update(now, used)
        if problems:
            name, problem = next(iter(problems.items()))
            verdict.tighten(
                0.0, "stop", INVALID_SOURCE, f"stop, because the source {name} is invalid: {problem}", NO_POINTS
            )
            return
        for near in self.field.near.values():
            places = near.towards(self._hull, command)
            if len(places):
                reason = f"stop, because the command moves the robot towards an obstacle: {near.what}{_nearest(places)}"
                verdict.tighten(0.0, "stop", TOO_NEAR, reason, places)
                return
        for zone in zones:
            self._judge_zone(verdict, zone, command, measured)
            if verdict.ratio <= 0.0:
                return

    def _judge_zone(self, verdict: _Verdict, zone: Zone, command: Twist2D, measured: Twist2D) -> None:
        zone.choose(command, largest=not self.params.nav2_compatible)
        if zone.shape is None:
            if not self.params.nav2_compatible:
                reason = f"stop, because the zone {zone.name} has no shape: nothing was received on its topic"
                verdict.tighten(0.0, "stop", zone.name, reason, NO_POINTS)
            return
        points = self.field.points(zone.sources)
        action = zone.params.action_type
        if action == "approach":
            self._judge_approach(verdict, zone, points, command, measured)
            return
        count, found = zone.inside(points)
        if not zone.debounce(count >= zone.least):
            return
        shown = points[found]
        what = f"{count} point{'s' if count != 1 else ''} in the zone {zone.name}{_nearest(shown)}"
        if action == "stop":
            if not self._may_leave(zone, points, command, measured):
                verdict.tighten(0.0, "stop", zone.name, f"stop, because of {what}", shown)
        elif action == "slowdown":
            ratio = zone.params.slowdown_ratio
            verdict.tighten(
                ratio, "slowdown", zone.name, f"slowdown to {ratio:g} of the command, because of {what}", shown
            )
        elif action == "limit":
            ratio = limit_ratio(command, zone.params.linear_limit, zone.params.angular_limit)
            limits = f"{zone.params.linear_limit:g} m/s and {zone.params.angular_limit:g} rad/s"
            verdict.tighten(ratio, "limit", zone.name, f"limit to {limits}, because of {what}", shown)

    def _judge_approach(
        self, verdict: _Verdict, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D
    ) -> None:
        limit = self._approach.limit(zone, points, command, measured)
        if limit is not None:
            verdict.tighten(limit.ratio, "approach", zone.name, _approach_reason(limit, zone), limit.points, limit.time)

    def _may_leave(self, zone: Zone, points: NDArray[np.float64], command: Twist2D, measured: Twist2D) -> bool:
        """True if a stop zone lets a command pass because it brings none of the obstacles in the zone nearer."""
        if self.params.nav2_compatible or not zone.params.allow_moving_away or command == _STOP:
            return False
        return self._approach.moves_away(zone, points, command, measured)

    def _is_sent(self, command: Twist2D, now: float) -> bool:
        """Zero velocities are sent for `stop_pub_timeout` only."""
        if command != _STOP:
            self._stopped_since = None
            return True
        if self._stopped_since is None:
            self._stopped_since = now
        return now - self._stopped_since <= self.params.stop_pub_timeout + _ROUNDING_S

    # --- what others see ----------------------------------------------------------------------------------------------

    def outlines(self) -> Mapping[str, NDArray[np.float64]]:
        """Return the corners (n, 2) of every enabled zone that has a shape, base frame (m)."""
        return {z.name: z.shape.outline() for z in self.zones if z.enabled and z.shape is not None}

    def as_dict(self) -> dict[str, Any]:
        """Return zones and sources for records: name, type, action and corners of each."""
        return {
            "zones": [
                {
                    "name": zone.name,
                    "action": zone.params.action_type,
                    "corners": zone.shape.outline().tolist() if zone.shape is not None else [],
                }
                for zone in self.zones
                if zone.enabled
            ],
            "sources": list(self.params.sources),
        }


def limit_ratio(command: Twist2D, linear: float, angular: float) -> float:
    """Return the factor that brings a command within a speed (m/s) and an angular velocity (rad/s), with its curvature kept."""
    ratio = 1.0
    if command.speed > linear:
        ratio = linear / command.speed
    if abs(command.wz) > angular:
        ratio = min(ratio, angular / abs(command.wz))
    return ratio


def _approach_reason(limit: ApproachLimit, zone: Zone) -> str:
    """The reason of an approach."""
    where = _nearest(limit.points)
    if limit.kind == "inside":
        return f"stop, because the command moves the robot towards points in the zone {zone.name}{where}"
    if limit.kind == "braking":
        part = f"{limit.ratio:.2f} of the command" if limit.ratio > 0.0 else "a stop"
        return f"approach with {part}, so that the robot can brake before points touch the zone {zone.name}{where}"
    return (
        f"approach with {limit.ratio:.2f} of the command, because points touch the zone {zone.name} in {limit.time:.2f} s "
        f"(time_before_collision {zone.params.time_before_collision:g} s){where}"
    )


def _nearest(points: NDArray[np.float64]) -> str:
    if not len(points):
        return ""
    x, y = points[int(np.argmin(np.hypot(points[:, 0], points[:, 1])))].tolist()
    return f", the nearest at ({x:.2f}, {y:.2f}) m from the base"


def _point() -> Footprint:
    """A footprint for a robot of unknown outline: distances are measured from the base."""
    return Footprint.from_radius(0.01)


# ----------------------------------------------------------------------------------------------------------------------
# The collision detector: reports in which zones obstacles are, without changing commands.


@dataclass(frozen=True, slots=True)
class Detections:
    """The result of one check."""

    time: float
    """Seconds."""
    zones: dict[str, bool] = field(default_factory=dict[str, bool])
    """Enabled zones -> obstacles are inside."""
    problems: dict[str, str] = field(default_factory=dict[str, str])
    """Sources without valid data -> why."""


class CollisionDetector:
    """Checks the zones at its frequency."""

    def __init__(
        self,
        params: CollisionDetectorParams,
        *,
        frames: FrameTree,
        base_frame: str = "base_footprint",
        odom_frame: str = "odom",
        footprint: Footprint | None = None,
    ) -> None:
        """`base_frame` and `odom_frame` count where the parameters set none; `footprint` as of the collision monitor."""
        self.params = params
        frame_names = (params.base_frame_id or base_frame, params.odom_frame_id or odom_frame)
        self.frames = Frames(frames, *frame_names, params.transform_tolerance, params.base_shift_correction)
        names = tuple(params.sources)
        self.zones = [Zone(name, zone, names, footprint) for name, zone in params.zones.items()]
        self.field = PointField(params.sources, self.frames, params.source_timeout)
        self.last: Detections | None = None
        """The last result."""
        self._due = -math.inf

    @property
    def due(self) -> float:
        """Time of the next check (s)."""
        return self._due

    def observe(self, data: Observation) -> None:
        """Take sensor data."""
        self.field.observe(data)

    def step(self, now: float, command: Twist2D | None = None) -> Detections:
        """Check all enabled zones at `now` (s). `command` chooses the polygon of a velocity polygon (default: standing)."""
        self._due += 1.0 / self.params.frequency
        if not self._due > now:
            self._due = now + 1.0 / self.params.frequency
        problems = self.field.update(now)
        problems |= {name: near.what for name, near in self.field.near.items()}
        found: dict[str, bool] = {}
        for zone in self.zones:
            if not zone.enabled:
                continue
            zone.choose(command or Twist2D(), largest=True)
            if zone.shape is None:
                problems[zone.name] = "the zone has no shape: nothing was received on its topic"
                continue
            count, _ = zone.inside(self.field.points(zone.sources))
            found[zone.name] = zone.debounce(count >= zone.least)
        self.last = Detections(now, found, problems)
        return self.last

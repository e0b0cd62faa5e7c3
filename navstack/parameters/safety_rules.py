"""Rules of `twist_mux`, `velocity_smoother`, `collision_monitor` and `collision_detector`: with the planner, with the sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import shapely

from navstack.core import Footprint
from navstack.core.parameter_checks import Issue
from navstack.parameters.models.collision_monitor import (
    CollisionDetectorParams,
    CollisionMonitorParams,
    MonitorSourceParams,
    ZoneParams,
)
from navstack.parameters.models.sim import LidarParams, SimParams
from navstack.parameters.planner_limits import VELOCITIES, Limit, PlannerLimits
from navstack.parameters.safety_sections import SafetyConfiguration

_LEG_M: Final = 0.1
"""Width of a leg: the narrowest obstacle that a zone should not overlook."""
_AXES: Final = ("x", "y", "yaw")
_ROUNDING: Final = 1e-9
_TOPICS_OF: Final = {"scan": "LaserScan", "pointcloud": "PointCloud2", "range": "Range", "polygon": "polygons"}
_COSTMAP_TOPICS: Final = ("local_costmap", "global_costmap")


@dataclass(frozen=True, slots=True)
class SafetyContext:
    """The robot around the sections."""

    safety: SafetyConfiguration
    sim: SimParams
    planner: PlannerLimits
    footprint: Footprint
    """Without padding."""
    controller_frequency: float
    """Hz."""
    frames: frozenset[str]
    """Names of the frames that exist."""


Monitor = CollisionMonitorParams | CollisionDetectorParams


def check_safety(context: SafetyContext) -> Iterator[Issue]:
    """Yield what does not fit together in the sections."""
    yield from smoother_limits(context)
    yield from smoother_deadband(context)
    yield from command_gaps(context)
    yield from mux_inputs(context)
    for name in ("collision_monitor", "collision_detector"):
        monitor: Monitor | None = getattr(context.safety, name)
        if monitor is not None:
            yield from monitor_frames(context, name, monitor)
            yield from monitor_sources(context, name, monitor)
            yield from monitor_zones(context, name, monitor)


# --- velocity smoother and multiplexer --------------------------------------------------------------------------------


def smoother_limits(context: SafetyContext) -> Iterator[Issue]:
    """Limits of the smoother that are stricter than the planner's act without the planner knowing them."""
    smoother, planner = context.safety.velocity_smoother, context.planner
    if smoother is None:
        return
    for name, limits in planner.lists().items():
        own: list[float] = list(smoother.planar(name))
        axes = [i for i in range(3) if (wanted := limits[i]) is not None and abs(own[i]) < abs(wanted[0]) - _ROUNDING]
        if not axes:
            continue
        parts = [f"{_AXES[i]} {own[i]:g} ({planner.name}/{_named(limits[i])})" for i in axes]
        fixed = [_value(limits[i]) if i in axes else own[i] for i in range(3)]
        effect = "drives slower" if name in VELOCITIES else "changes its velocity more slowly"
        message = (
            f"velocity_smoother/{name} is stricter than the limits of the local planner: {', '.join(parts)}; so the robot "
            f"{effect} than the planner computes; write {name}: [{', '.join(f'{v:g}' for v in fixed)}], or lower "
            f"the planner's limits"
        )
        yield Issue("warning", "smoother-limits", (f"/velocity_smoother/{name}",), message)


def _value(limit: Limit | None) -> float:
    return 0.0 if limit is None else limit[0]


def _named(limit: Limit | None) -> str:
    return "" if limit is None else limit[1]


def smoother_deadband(context: SafetyContext) -> Iterator[Issue]:
    """A deadband that no output exceeds, or, in Nav2's closed loop, that one step does not exceed."""
    smoother = context.safety.velocity_smoother
    if smoother is None:
        return
    where = ("/velocity_smoother/deadband_velocity",)
    deadband, accel = smoother.planar("deadband_velocity"), smoother.planar("max_accel")
    highest = [
        max(h, -low) for h, low in zip(smoother.planar("max_velocity"), smoother.planar("min_velocity"), strict=True)
    ]
    for i, axis in enumerate(_AXES):
        if deadband[i] > highest[i] > 0.0:
            message = (
                f"deadband_velocity {deadband[i]:g} of {axis} is above the highest velocity {highest[i]:g}, so the robot never "
                f"moves along {axis}; lower deadband_velocity"
            )
            yield Issue("warning", "deadband-too-large", where, message)
            continue
        step = accel[i] / smoother.smoothing_frequency
        if smoother.feedback == "CLOSED_LOOP" and deadband[i] > 0.0 and step <= deadband[i]:
            what = (
                f"one step from rest, max_accel {accel[i]:g} / smoothing_frequency {smoother.smoothing_frequency:g} = "
                f"{step:.3g}, stays in the deadband_velocity {deadband[i]:g} of {axis}"
            )
            fix = "lower deadband_velocity, or set feedback: OPEN_LOOP"
            if smoother.nav2_compatible:
                message = f"{what}, so the robot never starts in closed loop; {fix}"
                yield Issue("warning", "deadband-too-large", where, message)
            else:
                message = f"{what}; navstack starts, but Nav2's smoother never does in closed loop; for Nav2, {fix}"
                yield Issue("info", "deadband-too-large", where, message)


def command_gaps(context: SafetyContext) -> Iterator[Issue]:
    """Time-outs shorter than the time between two commands brake the robot again and again."""
    period = 1.0 / context.controller_frequency
    smoother, mux = context.safety.velocity_smoother, context.safety.twist_mux
    fix = f"raise it above 1 / controller_frequency = {period:g} s"
    if smoother is not None and smoother.velocity_timeout < period - _ROUNDING:
        message = (
            f"velocity_timeout = {smoother.velocity_timeout:g} s is shorter than the time between two commands, so the smoother "
            f"brakes between them; {fix}"
        )
        yield Issue("warning", "timeout-too-short", ("/velocity_smoother/velocity_timeout",), message)
    entry = mux.input_of("navigation") if mux is not None else None
    if entry is not None and 0.0 < entry.timeout < period - _ROUNDING:
        message = (
            f"the timeout {entry.timeout:g} s of the input {entry.name} is shorter than the time between two commands, so "
            f"the multiplexer stops the robot between them; {fix}"
        )
        yield Issue("warning", "timeout-too-short", ("/twist_mux/topics",), message)


def mux_inputs(context: SafetyContext) -> Iterator[Issue]:
    """An input that is missing, and inputs of equal priority, of which only the first one is used."""
    mux = context.safety.twist_mux
    if mux is None:
        return
    if mux.input_of("navigation") is None:
        known = ", ".join(entry.name for entry in mux.topics)
        message = (
            f"no input takes the commands of the local planner, so every goal is aborted (inputs: {known}); add "
            "{name: navigation, priority: 10} to topics"
        )
        yield Issue("warning", "no-navigation-input", ("/twist_mux/topics",), message)
    by_priority: dict[int, str] = {}
    for entry in mux.topics:
        first = by_priority.setdefault(entry.priority, entry.name)
        if first != entry.name:
            message = (
                f"the inputs {first} and {entry.name} have the same priority {entry.priority}, so {entry.name} is ignored "
                f"while {first} sends commands; give each input a priority of its own"
            )
            yield Issue("warning", "equal-priority", ("/twist_mux/topics",), message)


# --- collision monitor ------------------------------------------------------------------------------------------------


def monitor_frames(context: SafetyContext, name: str, monitor: Monitor) -> Iterator[Issue]:
    """A frame that is not published makes every source invalid: the robot stops."""
    for parameter in ("base_frame_id", "odom_frame_id"):
        frame: str | None = getattr(monitor, parameter)
        if not frame or frame in context.frames or (parameter == "odom_frame_id" and not monitor.base_shift_correction):
            continue
        known = ", ".join(sorted(context.frames))
        message = (
            f"{parameter} = {frame} is no frame of this robot ({known}), so no point can be transformed and the robot "
            f"stops; remove {parameter} to use that of the robot"
        )
        yield Issue("warning", "unknown-monitor-frame", (f"/{name}/{parameter}",), message)


def monitor_sources(context: SafetyContext, name: str, monitor: Monitor) -> Iterator[Issue]:
    """Sources that nothing feeds, that no zone uses, or whose data are stale between two messages."""
    zones = [zone for zone in monitor.zones.values() if zone.enabled]
    used = {s for zone in zones for s in (monitor.sources if zone.sources_names is None else zone.sources_names)}
    for source, params in monitor.sources.items():
        if not params.enabled:
            continue
        if source not in used:
            message = (
                f"no enabled zone uses the source {source}, so it has no effect; add it to a zone's sources_names, or remove "
                "it from observation_sources"
            )
            yield Issue("info", "unused-source", (f"/{name}/{source}/topic", f"/{name}/observation_sources"), message)
            continue
        fed = _frequency(context.sim, params)
        timeout = monitor.source_timeout if params.source_timeout is None else params.source_timeout
        if fed is None:
            yield _unfed(context, name, source, params, timeout)
        elif 0.0 < timeout < 1.0 / fed - _ROUNDING:
            message = (
                f"source_timeout = {timeout:g} s is shorter than the time {1.0 / fed:g} s between two messages on "
                f"{params.topic}, so the robot stops before each; raise source_timeout"
            )
            where = (f"/{name}/{source}/source_timeout", f"/{name}/source_timeout")
            yield Issue("warning", "source-timeout", where, message)


def _frequency(sim: SimParams, source: MonitorSourceParams) -> float | None:
    """How often a simulated sensor feeds a source (Hz); None if none does, inf if it is no sensor."""
    topic = source.topic.strip("/")
    if source.type == "costmap":
        return math.inf if topic.partition("/")[0] in _COSTMAP_TOPICS else None
    found: dict[str, float] = {}
    if source.type == "scan":
        found = {lidar.topic.strip("/"): lidar.frequency for lidar in map(sim.lidar, sim.lasers)}
    elif source.type == "range":
        found = {sonar.topic.strip("/"): sonar.frequency for sonar in map(sim.sonar, sim.sonars)}
    elif source.type == "pointcloud":
        found = {bumper.topic.strip("/"): math.inf for bumper in map(sim.bumper, sim.bumpers)}
    return found.get(topic)


def _unfed(context: SafetyContext, name: str, source: str, params: MonitorSourceParams, timeout: float) -> Issue:
    where = (f"/{name}/{source}/topic", f"/{name}/{source}/type", f"/{name}/observation_sources")
    effect = "so the robot stands" if timeout > 0.0 and name == "collision_monitor" else "so it sees nothing"
    if params.type == "costmap":
        fix = "write topic: local_costmap/costmap"
        what = f"{params.topic} is no topic of a costmap"
        return Issue(
            "warning", "nothing-feeds-monitor", where, f"nothing feeds the source {source}: {what}, {effect}; {fix}"
        )
    lidars = ", ".join(context.sim.lidar(laser).topic for laser in context.sim.lasers)
    fix = f"use a topic that is simulated (scans: {lidars})" if params.type == "scan" else "simulate a sensor for it"
    if params.type == "range":
        fix = f"write `navstack: {{sim: {{sonars: [sonar], sonar: {{topic: {params.topic}}}}}}}`"
    message = (
        f"nothing feeds the source {source}: no simulated sensor publishes {_TOPICS_OF[params.type]} on {params.topic}, {effect} "
        f"in simulation; {fix}, or set enabled: false"
    )
    return Issue("warning", "nothing-feeds-monitor", where, message)


def monitor_zones(context: SafetyContext, name: str, monitor: Monitor) -> Iterator[Issue]:
    """Zones that obstacles cannot trigger in time: hidden in the robot, beyond the sensors, or between their beams."""
    for zone_name, zone in monitor.zones.items():
        if not zone.enabled:
            continue
        where = f"/{name}/{zone_name}"
        shape = _shape(zone, context.footprint)
        body = context.footprint.polygon
        if zone.action_type in ("stop", "slowdown", "limit") and shape is not None and body.buffer(1e-6).covers(shape):
            message = (
                f"the zone {zone_name} is inside the footprint, so an obstacle touches the robot before it is in the zone; "
                "enlarge the zone"
            )
            yield Issue("warning", "zone-in-footprint", (f"{where}/points", f"{where}/radius"), message)
        scans = _scans(context.sim, monitor, zone)
        if shape is not None and scans:
            yield from _beams(where, zone_name, zone, shape, scans)
        if zone.action_type == "approach" and scans:
            yield from _horizon(context, where, zone_name, zone, scans)


def _shape(zone: ZoneParams, footprint: Footprint) -> shapely.Polygon | None:
    """The shape of a zone that does not change at run time; of a velocity polygon, all of its polygons together."""
    if zone.type == "circle":
        return None if zone.radius is None else shapely.Point(0.0, 0.0).buffer(zone.radius, quad_segs=32)
    if zone.type == "velocity_polygon":
        parts = [shapely.Polygon(sub.corners) for sub in zone.sub_polygons.values() if sub.corners]
        return shapely.union_all(parts).convex_hull if parts else None  # pyright: ignore[reportReturnType]
    if zone.corners:
        return shapely.Polygon(zone.corners)
    return footprint.polygon if zone.takes_footprint else None


def _scans(sim: SimParams, monitor: Monitor, zone: ZoneParams) -> list[LidarParams]:
    """The simulated lidars whose points count in a zone."""
    names = monitor.sources if zone.sources_names is None else zone.sources_names
    topics = {
        monitor.sources[n].topic.strip("/") for n in names if n in monitor.sources and monitor.sources[n].type == "scan"
    }
    return [lidar for lidar in map(sim.lidar, sim.lasers) if lidar.topic.strip("/") in topics]


def _beams(
    where: str, zone_name: str, zone: ZoneParams, shape: shapely.Polygon, scans: list[LidarParams]
) -> Iterator[Issue]:
    """`min_points` beams side by side are wide at the border of the zone: what is narrower does not trigger it."""
    corners = np.asarray(shape.exterior.coords)
    found: list[tuple[float, float, float]] = []
    for lidar in scans:
        distance = float(np.hypot(corners[:, 0] - lidar.x, corners[:, 1] - lidar.y).max())
        found.append((zone.least_points * distance * abs(lidar.angle_increment), distance, abs(lidar.angle_increment)))
    width, distance, spacing = min(found)
    if width <= _LEG_M:
        return
    most = max(int(_LEG_M / (distance * spacing)), 1)
    message = (
        f"{zone.least_points} points (min_points) of a lidar with a beam every {math.degrees(spacing):.2g} degrees are "
        f"{width:.2g} m wide at the border of the zone {zone_name}, {distance:.2g} m from the lidar, so narrower obstacles such "
        f"as legs do not trigger it there; set min_points: {most}"
    )
    yield Issue(
        "warning", "min-points", (f"{where}/min_points", f"{where}/max_points", f"{where}/type"), message, str(most)
    )


def _horizon(
    context: SafetyContext, where: str, zone_name: str, zone: ZoneParams, scans: list[LidarParams]
) -> Iterator[Issue]:
    """The time to a contact can only be kept within the range of the sensors."""
    forward = context.planner.lists()["max_velocity"][0]
    if forward is None:
        return
    reach = max(lidar.range_max for lidar in scans)
    way = zone.time_before_collision * forward[0]
    if way > reach:
        message = (
            f"at {forward[0]:g} m/s the robot drives {way:.3g} m in time_before_collision = {zone.time_before_collision:g} s of "
            f"the zone {zone_name}, but the lidar sees {reach:g} m, so obstacles are noticed later; set "
            f"time_before_collision: {math.floor(10.0 * reach / forward[0]) / 10.0:g} or less"
        )
        yield Issue("info", "approach-horizon", (f"{where}/time_before_collision", f"{where}/type"), message)

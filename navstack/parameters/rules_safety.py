"""Rules of `twist_mux`, `velocity_smoother`, `collision_monitor` and `collision_detector`: with the planner, with the sensors."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from navstack.core import Footprint
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.simulated_robot import frames_of, sideways_speed
from navstack.plugins import Problem, rule

if TYPE_CHECKING:
    from navstack.parameters.models.collision_monitor import (
        CollisionDetectorParams,
        CollisionMonitorParams,
        MonitorSourceParams,
        ZoneParams,
    )
    from navstack.parameters.models.sim import LidarParams, SimParams

    Monitor = CollisionMonitorParams | CollisionDetectorParams

_LEG_M: Final = 0.1
"""Width of a leg: the narrowest obstacle that a zone should not overlook."""
_AXES: Final = ("x", "y", "yaw")
_ROUNDING: Final = 1e-9
_TOPICS_OF: Final = {"scan": "LaserScan", "pointcloud": "PointCloud2", "range": "Range", "polygon": "polygons"}
_COSTMAP_TOPICS: Final = ("local_costmap", "global_costmap")

# --- limits of the local planner --------------------------------------------------------------------------------------

Limit = tuple[float, str]
"""A value (m/s, rad/s, m/s², rad/s²), and the parameter that sets it with its own value."""

VELOCITIES: Final = ("max_velocity", "min_velocity")

_NAMES: Final[Mapping[str, tuple[tuple[str, ...], ...]]] = {
    # list of the velocity smoother -> for x and yaw, the parameters of the planners
    "max_velocity": (
        ("max_vel_x", "vx_max", "max_linear_vel", "v_linear_max"),
        ("max_vel_theta", "wz_max", "v_angular_max", "rotate_to_heading_angular_vel"),
    ),
    "min_velocity": (("min_vel_x", "vx_min"), ()),
    "max_accel": (("acc_lim_x", "ax_max"), ("acc_lim_theta", "az_max", "max_angular_accel")),
    "max_decel": (("acc_lim_x", "ax_min"), ("acc_lim_theta", "az_max", "max_angular_decel", "max_angular_accel")),
}

_BOTH_WAYS: Final = frozenset({"acc_lim_x", "acc_lim_theta", "az_max", "max_angular_accel"})
"""Accelerations that also limit braking."""


@dataclass(frozen=True, slots=True)
class PlannerLimits:
    """The limits of a local planner."""

    name: str
    """Namespace of the planner."""
    params: Any

    def lists(self) -> dict[str, tuple[Limit | None, Limit | None, Limit | None]]:
        """Return the lists of the velocity smoother with the limits of the planner for x, y and yaw; None where it has none."""
        found: dict[str, tuple[Limit | None, Limit | None, Limit | None]] = {}
        for name, (x, yaw) in _NAMES.items():
            negative = name in ("min_velocity", "max_decel")
            found[name] = (self._first(x, negative), self._sideways(name), self._first(yaw, negative))
        turn = found["max_velocity"][2]
        x, y, _ = found["min_velocity"]
        found["min_velocity"] = (x, y, None if turn is None else (-turn[0], turn[1]))
        return found

    def _first(self, names: tuple[str, ...], negative: bool) -> Limit | None:
        for name in names:
            value = getattr(self.params, name, None)
            if value is None:
                continue
            if negative and name in _BOTH_WAYS:
                return (-float(value), f"{name} {value:g}")
            # a lowest velocity above 0 is no limit of driving backward
            return (float(value), f"{name} {value:g}") if negative == (float(value) < 0.0) else None
        return None

    def _sideways(self, name: str) -> Limit | None:
        if name not in VELOCITIES:
            return None
        speed, names = sideways_speed(self.params)
        written = [one for one in names if one in self.params.model_fields_set and getattr(self.params, one)]
        if speed == 0.0 or not written:
            return None
        return (speed if name == "max_velocity" else -speed, f"{written[0]} {getattr(self.params, written[0])}")


def planner_limits(configuration: Configuration) -> PlannerLimits:
    """Return the limits of the local planner; of a rotation shim, those of its primary controller."""
    planner = configuration.local_planner
    primary = getattr(planner.params, "primary", None)
    if primary is not None:
        return PlannerLimits(f"{planner.namespace}/primary_controller", primary[1])
    return PlannerLimits(planner.namespace, planner.params)


@rule("progress-out-of-reach", "warning")
def progress_is_possible(configuration: Configuration) -> Iterator[Problem]:
    """At its maximum speed the robot covers less than `required_movement_radius` within `movement_time_allowance` of the
    progress checker, so every drive fails with FAILED_TO_MAKE_PROGRESS; or a reverse drive takes longer than its time
    allowance. Example: 0.04 m/s for 10 s is less than 0.5 m.

    Fix: lower the radius, or raise the time allowance.
    """
    forward, sideways, _ = planner_limits(configuration).lists()["max_velocity"]
    speeds = [limit for limit in (forward, sideways) if limit is not None]
    fastest = max(speeds, default=None)
    for name, checker in configuration.move_base.sections.items():
        radius, allowed = (
            getattr(checker, key, None) for key in ("required_movement_radius", "movement_time_allowance")
        )
        # a checker of poses counts turns as progress, too
        if fastest is None or radius is None or allowed is None or hasattr(checker, "required_movement_angle"):
            continue
        if fastest[0] * allowed <= radius:
            message = (
                f"the robot covers {fastest[0] * allowed:g} m in movement_time_allowance = {allowed:g} s at {fastest[1]} m/s, "
                f"not more than required_movement_radius = {radius:g} m, so every drive fails; set the radius to "
                f"{0.25 * fastest[0] * allowed:.2g}"
            )
            yield Problem((f"/{name}/required_movement_radius", f"/{name}/movement_time_allowance"), message)
    for behavior in configuration.recoveries:
        values = [getattr(behavior.params, key, None) for key in ("backup_dist", "backup_speed", "time_allowance")]
        distance, speed, allowed = (abs(float(v)) if v is not None else math.nan for v in values)
        if distance >= speed * allowed:
            message = (
                f"{behavior.namespace} takes {distance / speed if speed else math.inf:g} s for {distance:g} m at {speed:g} m/s, "
                f"its time_allowance is {allowed:g} s, so it always fails; raise the speed or the time_allowance"
            )
            yield Problem((f"/{behavior.namespace}/backup_speed", f"/{behavior.namespace}/time_allowance"), message)


@rule("slow-turn", "warning")
def turn_ends_in_time(configuration: Configuration) -> Iterator[Problem]:
    """At its highest turning speed the robot needs longer for half a turn than `oscillation_timeout`. A turn in place is
    no progress for move_base, which counts the distance only, so a goal behind the robot starts the recovery behaviors.
    Example: 0.04 rad/s needs 79 s, oscillation_timeout is 10 s.

    Fix: raise the turning speed, or oscillation_timeout.
    """
    limit = planner_limits(configuration).lists()["max_velocity"][2]
    allowed = configuration.move_base.oscillation_timeout
    car = configuration.navstack.sim.min_turning_radius > 0.0
    if car or limit is None or not 0.0 < allowed * limit[0] < math.pi:
        return
    needed = math.pi / limit[0]
    message = (
        f"half a turn takes {needed:.3g} s at {limit[1]}, longer than oscillation_timeout = {allowed:g} s, and move_base counts "
        f"a turn in place as no progress, so recovery behaviors interrupt it; set oscillation_timeout to {2.0 * needed:.0f}, or "
        "raise the turning speed"
    )
    yield Problem(("/oscillation_timeout", "/base_local_planner"), message, f"{2.0 * needed:.0f}")


# --- velocity smoother and multiplexer --------------------------------------------------------------------------------


@rule("smoother-limits", "warning")
def smoother_limits(configuration: Configuration) -> Iterator[Problem]:
    """The velocity smoother has lower velocities or accelerations than the local planner, which does not know them:
    it plans with a robot that is faster than the real one. Nav2's defaults (0.5 m/s, no sideways velocity) do this
    without a word.

    Fix: write the planner's limits into the smoother, or lower the planner's. Threads:
    ros-navigation/navigation2#6292.
    """
    smoother, planner = configuration.safety.velocity_smoother, planner_limits(configuration)
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
            f"{effect} than the planner computes; write {name}: [{', '.join(map(_double, fixed))}], or lower "
            f"the planner's limits"
        )
        yield Problem((f"/velocity_smoother/{name}",), message)


def _value(limit: Limit | None) -> float:
    return 0.0 if limit is None else limit[0]


def _double(value: float) -> str:
    """A number with a decimal point: ROS 2 rejects an integer for a double."""
    return f"{value:g}" if not float(f"{value:g}").is_integer() else f"{value:.1f}"


def _named(limit: Limit | None) -> str:
    return "" if limit is None else limit[1]


@rule("deadband-too-large", "warning")
def smoother_deadband(configuration: Configuration) -> Iterator[Problem]:
    """A `deadband_velocity` above the highest velocity never lets the axis move. In closed loop, a deadband that one
    step from rest, `max_accel / smoothing_frequency`, does not exceed keeps Nav2's smoother (and `nav2_compatible:
    true`) at rest for ever; navstack's continues its ramp.

    Fix: lower `deadband_velocity`, or set `feedback: OPEN_LOOP`. Threads: ros-navigation/navigation2#3699.
    """
    smoother = configuration.safety.velocity_smoother
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
            yield Problem(where, message)
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
                yield Problem(where, message)
            else:
                message = f"{what}; navstack starts, but Nav2's smoother never does in closed loop; for Nav2, {fix}"
                yield Problem(where, message, severity="info")


@rule("timeout-too-short", "warning")
def command_gaps(configuration: Configuration) -> Iterator[Problem]:
    """`velocity_timeout` of the smoother, or the `timeout` of the multiplexer's input `navigation`, is shorter than
    the time between two commands of the local planner: the robot brakes between them.

    Fix: raise it above `1 / controller_frequency`.
    """
    period = 1.0 / configuration.move_base.controller_frequency
    smoother, mux = configuration.safety.velocity_smoother, configuration.safety.twist_mux
    fix = f"raise it above 1 / controller_frequency = {period:g} s"
    if smoother is not None and smoother.velocity_timeout < period - _ROUNDING:
        message = (
            f"velocity_timeout = {smoother.velocity_timeout:g} s is shorter than the time between two commands, so the smoother "
            f"brakes between them; {fix}"
        )
        yield Problem(("/velocity_smoother/velocity_timeout",), message)
    entry = mux.input_of("navigation") if mux is not None else None
    if entry is not None and 0.0 < entry.timeout < period - _ROUNDING:
        message = (
            f"the timeout {entry.timeout:g} s of the input {entry.name} is shorter than the time between two commands, so "
            f"the multiplexer stops the robot between them; {fix}"
        )
        yield Problem(("/twist_mux/topics",), message)


@rule("no-navigation-input", "warning")
def no_navigation_input(configuration: Configuration) -> Iterator[Problem]:
    """None of the inputs of the multiplexer has the name `navigation`, or one of the usual names and topics of a
    planner's commands (`navi`, `nav`, `nav_vel`, `move_base`, `cmd_vel_nav`, `input/navi`): every goal is aborted.

    Fix: add an entry with the name `navigation` to `topics`.
    """
    mux = configuration.safety.twist_mux
    if mux is not None and mux.input_of("navigation") is None:
        known = ", ".join(entry.name for entry in mux.topics)
        message = (
            f"no input takes the commands of the local planner, so every goal is aborted (inputs: {known}); add "
            "{name: navigation, priority: 10} to topics"
        )
        yield Problem(("/twist_mux/topics",), message)


@rule("equal-priority", "warning")
def equal_priority(configuration: Configuration) -> Iterator[Problem]:
    """Of two inputs of the multiplexer with equal priority, the second one is ignored while the first one sends
    commands.

    Fix: give each input a priority of its own.
    """
    mux = configuration.safety.twist_mux
    by_priority: dict[int, str] = {}
    for entry in mux.topics if mux is not None else ():
        first = by_priority.setdefault(entry.priority, entry.name)
        if first != entry.name:
            message = (
                f"the inputs {first} and {entry.name} have the same priority {entry.priority}, so {entry.name} is ignored "
                f"while {first} sends commands; give each input a priority of its own"
            )
            yield Problem(("/twist_mux/topics",), message)


# --- collision monitor ------------------------------------------------------------------------------------------------


def _monitors(configuration: Configuration) -> Iterator[tuple[str, Monitor]]:
    """The monitor and the detector that are written, by the names of their sections."""
    monitor, detector = configuration.safety.collision_monitor, configuration.safety.collision_detector
    if monitor is not None:
        yield "collision_monitor", monitor
    if detector is not None:
        yield "collision_detector", detector


@rule("unknown-monitor-frame", "warning")
def monitor_frames(configuration: Configuration) -> Iterator[Problem]:
    """`base_frame_id` or `odom_frame_id` of the collision monitor is a frame that the robot does not have, as in
    files of robots with another base frame. No point can be transformed, so every source is invalid and the robot
    stops.

    Fix: remove the parameter to use the frames of the costmaps.
    """
    sim = configuration.navstack.sim
    frames = frames_of(configuration) | sim.written_frames
    frames |= {sim.lidar(name).frame for name in sim.lasers}
    parameters = ("base_frame_id", "odom_frame_id")
    for name, monitor, parameter in ((n, m, p) for n, m in _monitors(configuration) for p in parameters):
        frame: str | None = getattr(monitor, parameter)
        if not frame or frame in frames or (parameter == "odom_frame_id" and not monitor.base_shift_correction):
            continue
        known = ", ".join(sorted(frames))
        message = (
            f"{parameter} = {frame} is no frame of this robot ({known}), so no point can be transformed and the robot "
            f"stops; remove {parameter} to use that of the robot"
        )
        yield Problem((f"/{name}/{parameter}",), message)


def _sources(configuration: Configuration) -> Iterator[tuple[str, Monitor, str, MonitorSourceParams, bool]]:
    """Section, monitor, name and parameters of each enabled source, and whether an enabled zone uses it."""
    for name, monitor in _monitors(configuration):
        zones = [zone for zone in monitor.zones.values() if zone.enabled]
        used = {s for zone in zones for s in (monitor.sources if zone.sources_names is None else zone.sources_names)}
        for source, params in monitor.sources.items():
            if params.enabled:
                yield name, monitor, source, params, source in used


@rule("unused-source", "info")
def unused_source(configuration: Configuration) -> Iterator[Problem]:
    """No enabled zone lists the source in its `sources_names`. navstack ignores it; Nav2 stops for its stale data all
    the same.

    Fix: add it to a zone, or remove it from `observation_sources`.
    """
    for name, _, source, _, used in _sources(configuration):
        if not used:
            message = (
                f"no enabled zone uses the source {source}, so it has no effect; add it to a zone's sources_names, or remove "
                "it from observation_sources"
            )
            yield Problem((f"/{name}/{source}/topic", f"/{name}/observation_sources"), message)


@rule("source-timeout", "warning")
def source_timeout(configuration: Configuration) -> Iterator[Problem]:
    """Data of a source are older than its `source_timeout` before the next message comes, so the robot stops between
    two messages.

    Fix: raise `source_timeout` above the period of the sensor.
    """
    for name, monitor, source, params, used in _sources(configuration):
        fed = _frequency(configuration.navstack.sim, params)
        timeout = _timeout(monitor, params)
        if used and fed is not None and 0.0 < timeout < 1.0 / fed - _ROUNDING:
            message = (
                f"source_timeout = {timeout:g} s is shorter than the time {1.0 / fed:g} s between two messages on "
                f"{params.topic}, so the robot stops before each; raise source_timeout"
            )
            yield Problem((f"/{name}/{source}/source_timeout", f"/{name}/source_timeout"), message)


def _timeout(monitor: Monitor, source: MonitorSourceParams) -> float:
    """Age at which the data of a source are stale (s)."""
    return monitor.source_timeout if source.source_timeout is None else source.source_timeout


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


@rule("nothing-feeds-monitor", "warning")
def nothing_feeds_monitor(configuration: Configuration) -> Iterator[Problem]:
    """No simulated sensor publishes the topic of an observation source of the collision monitor or detector. A source
    without data stops the robot, unless its `source_timeout` is 0.

    Fix: correct the topic, simulate a sensor for it, or set `enabled: false` for the source.
    """
    sim = configuration.navstack.sim
    for name, monitor, source, params, used in _sources(configuration):
        if not used or _frequency(sim, params) is not None:
            continue
        where = (f"/{name}/{source}/topic", f"/{name}/{source}/type", f"/{name}/observation_sources")
        stands = _timeout(monitor, params) > 0.0 and name == "collision_monitor"
        effect = "so the robot stands" if stands else "so it sees nothing"
        if params.type == "costmap":
            what = f"{params.topic} is no topic of a costmap"
            fix = "write topic: local_costmap/costmap"
            yield Problem(where, f"nothing feeds the source {source}: {what}, {effect}; {fix}")
            continue
        lidars = ", ".join(sim.lidar(laser).topic for laser in sim.lasers)
        fix = (
            f"use a topic that is simulated (scans: {lidars})" if params.type == "scan" else "simulate a sensor for it"
        )
        if params.type == "range":
            fix = f"write `navstack: {{sim: {{sonars: [sonar], sonar: {{topic: {params.topic}}}}}}}`"
        message = (
            f"nothing feeds the source {source}: no simulated sensor publishes {_TOPICS_OF[params.type]} on {params.topic}, "
            f"{effect} in simulation; {fix}, or set enabled: false"
        )
        yield Problem(where, message)


def _zones(configuration: Configuration) -> Iterator[tuple[str, Monitor, str, ZoneParams]]:
    """Name below move_base, monitor, own name and parameters of each enabled zone."""
    for name, monitor in _monitors(configuration):
        for zone_name, zone in monitor.zones.items():
            if zone.enabled:
                yield f"/{name}/{zone_name}", monitor, zone_name, zone


@rule("zone-in-footprint", "warning")
def zone_in_footprint(configuration: Configuration) -> Iterator[Problem]:
    """A zone to stop, slow down or limit that lies within the footprint is triggered only by obstacles that touch the
    robot already.

    Fix: enlarge the zone.
    """
    footprint = configuration.local_costmap.true_footprint
    body = footprint.polygon.buffer(1e-6)
    for where, _, zone_name, zone in _zones(configuration):
        shape = _shape(zone, footprint)
        if zone.action_type in ("stop", "slowdown", "limit") and shape is not None and body.covers(shape):
            message = (
                f"the zone {zone_name} is inside the footprint, so an obstacle touches the robot before it is in the zone; "
                "enlarge the zone"
            )
            yield Problem((f"{where}/points", f"{where}/radius"), message)


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


@rule("min-points", "warning")
def too_many_points(configuration: Configuration) -> Iterator[Problem]:
    """`min_points` beams side by side are wider than a leg (0.1 m) at the border of the zone: with n points, beams at
    an angle of a and a border at the distance d, obstacles narrower than n d a are overlooked.

    Fix: lower `min_points`, or choose a smaller zone.
    """
    for where, monitor, zone_name, zone in _zones(configuration):
        shape = _shape(zone, configuration.local_costmap.true_footprint)
        scans = _scans(configuration.navstack.sim, monitor, zone)
        if shape is None or not scans:
            continue
        corners = np.asarray(shape.exterior.coords)
        found: list[tuple[float, float, float]] = []
        for lidar in scans:
            distance = float(np.hypot(corners[:, 0] - lidar.x, corners[:, 1] - lidar.y).max())
            found.append(
                (zone.least_points * distance * abs(lidar.angle_increment), distance, abs(lidar.angle_increment))
            )
        width, distance, spacing = min(found)
        if width <= _LEG_M:
            continue
        most = max(int(_LEG_M / (distance * spacing)), 1)
        message = (
            f"{zone.least_points} points (min_points) of a lidar with a beam every {math.degrees(spacing):.2g} degrees are "
            f"{width:.2g} m wide at the border of the zone {zone_name}, {distance:.2g} m from the lidar, so narrower obstacles "
            f"such as legs do not trigger it there; set min_points: {most}"
        )
        yield Problem((f"{where}/min_points", f"{where}/max_points", f"{where}/type"), message, str(most))


@rule("approach-horizon", "info")
def approach_horizon(configuration: Configuration) -> Iterator[Problem]:
    """At the planner's highest speed, the robot drives farther in `time_before_collision` than its lidars see, so the
    time to a contact is kept only as far as they see.

    Fix: lower `time_before_collision` or the speed.
    """
    forward = planner_limits(configuration).lists()["max_velocity"][0]
    for where, monitor, zone_name, zone in _zones(configuration):
        scans = _scans(configuration.navstack.sim, monitor, zone)
        if zone.action_type != "approach" or not scans or forward is None:
            continue
        reach = max(lidar.range_max for lidar in scans)
        way = zone.time_before_collision * forward[0]
        if way > reach:
            message = (
                f"at {forward[0]:g} m/s the robot drives {way:.3g} m in time_before_collision = {zone.time_before_collision:g} s "
                f"of the zone {zone_name}, but the lidar sees {reach:g} m, so obstacles are noticed later; set "
                f"time_before_collision: {math.floor(10.0 * reach / forward[0]) / 10.0:g} or less"
            )
            yield Problem((f"{where}/time_before_collision", f"{where}/type"), message)

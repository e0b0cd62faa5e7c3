"""The simulated robot follows the YAML: its lidars the observation sources, its base the sideways velocities; and its rules.

What `navstack: sim:` sets is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from navstack.parameters.configuration_types import Configuration
from navstack.parameters.lidar_description import DescribedLidar
from navstack.parameters.models.sim import BodyParams, BumperParams, LidarParams, SimParams
from navstack.plugins import CostmapSetup, Problem, SensorSource, rule

FIRST = "laser"
"""Name of the simulated lidar of a robot without `navstack/sim/lasers`."""

ASSUMED_FOV = 1.5 * math.pi
"""Field of view of a lidar that no file of the robot describes (rad)."""
ASSUMED_RANGE_MIN = 0.05
_SIMULATED = ("LaserScan", "PointCloud2", "PointCloud")


def sources_of(costmaps: Sequence[CostmapSetup], *, enabled_only: bool = True) -> dict[str, SensorSource]:
    """Return the observation sources of the (enabled) layers: path below move_base -> source."""
    return {
        f"{costmap.name}/{layer.name}/{name}": source
        for costmap in costmaps
        for layer in costmap.layers
        if layer.traits.enabled or not enabled_only
        for name, source in layer.traits.sources.items()
    }


def monitor_scans(configuration: Configuration) -> dict[str, SensorSource]:
    """Return the scans that the collision monitor and detector read of a robot whose costmaps read none.

    Path below move_base -> source. Beside a lidar of the costmaps, another topic of scans is a mistake rather than a lidar.
    """
    if any(source.data_type == "LaserScan" for source in sources_of(configuration.costmaps).values()):
        return {}
    safety = configuration.safety
    monitors = {"collision_monitor": safety.collision_monitor, "collision_detector": safety.collision_detector}
    return {
        f"{section}/{name}": SensorSource(params.topic)
        for section, monitor in monitors.items()
        if monitor is not None
        for name, params in monitor.sources.items()
        if params.enabled and params.type == "scan"
    }


def follow_sources(
    sim: SimParams,
    sources: Sequence[SensorSource],
    base_frame: str,
    described: Callable[[], Sequence[DescribedLidar]] = tuple,
) -> SimParams:
    """Return the simulated robot with one lidar for each topic of scans or clouds, unless `lasers` is written.

    Topic, frame (`sensor_frame`) and height are those of the source; field of view, ranges and pose those of the robot's files
    (`described`), otherwise assumed. What the namespace of a lidar sets is kept. An assumed value is none that is set.
    """
    other = {sim.bumper(name).topic.strip("/") for name in sim.bumpers}
    wanted = [s for kind in _SIMULATED for s in sources if s.data_type == kind and s.topic.strip("/") not in other]
    scans = {s.topic.strip("/"): s for s in reversed(wanted)}
    if "lasers" in sim.model_fields_set or not scans:
        return sim
    own = sim.sensors.get(FIRST)
    first = own.topic.strip("/") if isinstance(own, LidarParams) and "topic" in own.model_fields_set else ""
    topics = sorted(scans, key=lambda topic: (topic != first, list(reversed(scans)).index(topic)))
    if first and first not in scans:
        return sim
    readers = {topic: [s for s in wanted if s.topic.strip("/") == topic] for topic in scans}
    known = match_lidars(topics, described())
    lidars: dict[str, LidarParams] = {}
    frames: dict[str, DescribedLidar | None] = {}
    for topic in topics:
        for found in known[topic] or [None]:
            number = len(lidars) + 1
            name = FIRST if number == 1 else f"{FIRST}_{number}"
            written = sim.sensors.get(name)
            lidar = written if isinstance(written, LidarParams) else LidarParams()
            made = _lidar(lidar, topic, scans[topic], number, base_frame, found, readers[topic])
            if frames.setdefault(made.frame, found) != found:
                made = made.model_copy(update={"frame": f"{made.frame}_{number}"})
            lidars[name] = made
    return sim.model_copy(update={"lasers": list(lidars), "sensors": {**sim.sensors, **lidars}})


def _lidar(
    lidar: LidarParams,
    topic: str,
    source: SensorSource,
    number: int,
    base_frame: str,
    found: DescribedLidar | None,
    readers: Sequence[SensorSource],
) -> LidarParams:
    """The lidar that feeds a source and the other `readers` of its topic; what the user wrote is kept."""
    values: dict[str, Any] = {"topic": topic, "message": source.data_type}
    assumed: dict[str, Any] = {}
    if found is not None:
        frame = source.sensor_frame or found.frame
        values |= {name: getattr(found, name) for name in found.FIELDS}
    else:
        frame = source.sensor_frame or (lidar.frame if number == 1 else f"{topic.replace('/', '_')}_link")
        reach = max(reader.raytrace_range for reader in readers)
        assumed = {"fov": ASSUMED_FOV, "range_min": ASSUMED_RANGE_MIN, "range_max": reach}
        assumed = {k: v for k, v in assumed.items() if k not in lidar.model_fields_set}
        if not assumed.get("range_min", lidar.range_min) < assumed.get("range_max", lidar.range_max):
            assumed.pop("range_max", None)  # a source that clears nothing
    values["frame"] = frame
    height = values.get("height", lidar.height)
    if not all(_accepts_height(reader, height) for reader in readers):
        low, high = max(0.0, *(r.min_height for r in readers)), min(r.max_height for r in readers)
        if high <= low:  # no height suits all of them
            low, high = max(0.0, source.min_height), source.max_height
        if high > 0.0:
            values["height"] = 0.5 * (low + high)
    if frame == base_frame:
        values |= {"x": 0.0, "y": 0.0, "yaw": 0.0}
    kept = lidar.model_fields_set
    made = lidar.model_copy(update=assumed | {k: v for k, v in values.items() if k not in kept})
    made.model_fields_set.difference_update(assumed)
    return made


def _accepts_height(source: SensorSource, height: float) -> bool:
    """True if a source takes points at a height (m). Points are float32, so a limit of 0.3 m rejects a lidar at 0.3 m."""
    return source.min_height <= float(np.float32(height)) <= source.max_height


def match_lidars(topics: Sequence[str], described: Sequence[DescribedLidar]) -> dict[str, list[DescribedLidar]]:
    """Return the lidars of the robot's files that feed each topic: by topic, by its last part, else all that feed no topic.

    Several lidars of one topic are merged there; a topic that no lidar publishes is a filtered or merged one.
    """
    found: dict[str, list[DescribedLidar]] = {
        topic: [lidar for lidar in described if lidar.topic == topic] for topic in topics
    }
    for topic in topics:
        last = topic.rpartition("/")[2]
        found[topic] = found[topic] or [lidar for lidar in described if lidar.topic.rpartition("/")[2] == last]
    used = [lidar for lidars in found.values() for lidar in lidars]
    rest = [lidar for lidar in described if lidar.filtered] or [lidar for lidar in described if lidar not in used]
    for topic in topics:
        found[topic] = found[topic] or rest
    return found


# --- sideways velocities ----------------------------------------------------------------------------------------------


def sideways_speed(params: Any) -> tuple[float, tuple[str, ...]]:
    """Return the highest sideways speed that a local planner may command (m/s) and the parameters that decide it."""
    if hasattr(params, "max_vel_y"):
        if getattr(params, "use_dwa", True) and params.acc_lim_y == 0.0:  # DWB has no use_dwa
            return 0.0, ()
        return max(abs(params.max_vel_y), abs(params.min_vel_y)), ("max_vel_y", "min_vel_y")
    if hasattr(params, "vy_max"):
        return (params.vy_max, ("motion_model", "vy_max")) if params.is_omni else (0.0, ())
    if getattr(params, "holonomic_robot", False) and hasattr(params, "y_vels"):
        written = params.y_vels.split(",") if isinstance(params.y_vels, str) else params.y_vels
        return max((abs(float(v)) for v in written if str(v).strip()), default=0.0), ("holonomic_robot", "y_vels")
    return 0.0, ()


def follow_planner(sim: SimParams, params: Any) -> SimParams:
    """Return the simulated robot, holonomic if the user writes that the planner may command sideways motion."""
    speed, names = sideways_speed(params)
    said = any(name in params.model_fields_set and getattr(params, name) not in (0.0, False) for name in names)
    if speed == 0.0 or not said or "kinematics" in sim.model_fields_set:
        return sim
    return sim.model_copy(update={"kinematics": "holonomic"})


def follow_accelerations(sim: SimParams, params: Any) -> SimParams:
    """Return the simulated robot with the accelerations that the trajectories of TrajectoryPlannerROS have.

    It commands a velocity at once and checks trajectories on which the base reaches it with `acc_lim_*`: a base without limits
    leaves them. Other planners command what can be reached within a period. What `navstack: sim:` says about the base is kept.
    An assumed value is none that is set.
    """
    if not hasattr(params, "y_vels") or sim.model_fields_set.intersection(BodyParams.model_fields):
        return sim
    found = {name: float(getattr(params, name)) for name in ("acc_lim_x", "acc_lim_y", "acc_lim_theta")}
    assumed = {name: value for name, value in found.items() if value > 0.0}
    made = sim.model_copy(update=assumed)
    made.model_fields_set.difference_update(assumed)
    return made


def simulated(configuration: Configuration, described: Callable[[], Sequence[DescribedLidar]] = tuple) -> SimParams:
    """Return the simulated robot that follows the observation sources and the local planner of a configuration.

    Scans that only the collision monitor or detector reads (`monitor_scans`) come from a lidar as far as costmaps clear.
    `described` reads the lidars of the robot's files; it is called if they are needed.
    """
    costmaps = configuration.costmaps
    sources = list(sources_of(costmaps).values())
    reach = max((source.raytrace_range for source in sources), default=0.0)
    sources += [replace(scan, raytrace_range=reach) for scan in monitor_scans(configuration).values()]
    sim = follow_sources(configuration.navstack.sim, sources, costmaps[1].robot_base_frame, described)
    planner = configuration.local_planner.params
    return follow_planner(follow_accelerations(sim, planner), planner)


def frames_of(configuration: Configuration) -> frozenset[str]:
    """Return the frames of the map, the odometry and the base."""
    both = (configuration.global_costmap.params, configuration.local_costmap.params)
    return frozenset({*(p.global_frame for p in both), both[1].robot_base_frame, "map", "odom"})


# --- rules ------------------------------------------------------------------------------------------------------------


@rule("simulated-robot-blind", "warning")
def simulated_robot_blind(configuration: Configuration) -> Iterator[Problem]:
    """Simulator only: the lidar publishes on a topic (`scan`) or at a height that no observation source of a costmap
    accepts; the limits of the source, of its layer and of the voxels count. The simulated robot sees nothing there and
    collides with everything that is not on the map.

    Fix: `navstack/sim/<lidar>/topic` or `height`.
    """
    sim = configuration.navstack.sim
    sources = sources_of(configuration.costmaps, enabled_only=False)
    if not sim.lidars or not sources:
        return
    name, first = next(iter(sim.lidars.items()))
    rejected: dict[str, Problem] = {}
    seeing: set[str] = set()
    for lidar in sim.lidars.values():
        for path, source in sources.items():
            if source.topic.strip("/") != lidar.topic.strip("/"):
                continue
            costmap = path.partition("/")[0]
            mismatch = _mismatch(source, lidar.height, lidar.message)
            if mismatch is None:
                seeing.add(costmap)
                continue
            why, names = mismatch
            problem = f"{path} rejects the scans of the simulated lidar on {first.topic}: {why}; correct it or set "
            rejected[costmap] = Problem(tuple(f"/{path}/{n}" for n in names), f"{problem}navstack/sim/{name}")
    for costmap, problem in rejected.items():
        if costmap not in seeing:
            who = f"the {costmap} of the simulated robot" if seeing else "the simulated robot"
            yield Problem(problem.parameters, f"{who} is blind: {problem.message}")
            return
    if not seeing:
        topics = ", ".join(sorted({source.topic.strip("/") for source in sources.values()}))
        message = (
            f"its lidar publishes on {first.topic}, but the costmaps listen to {topics}; set navstack/sim/{name}/topic"
        )
        yield Problem((f"/{next(iter(sources))}/topic",), f"the simulated robot is blind: {message}")


def _mismatch(source: SensorSource, height: float, message: str) -> tuple[str, tuple[str, str]] | None:
    """Why a source does not take a message of a lidar at a height (m), and the parameters that decide it; None if it does."""
    if source.data_type != message:
        return f"its data_type is {source.data_type}, not {message}", ("data_type", "topic")
    if not _accepts_height(source, height):
        heights = f"from {source.min_height:g} to {source.max_height:g} m"
        edge = (
            " (the points of a scan are rounded to float32)" if source.min_height <= height <= source.max_height else ""
        )
        return f"it accepts heights {heights}, and the lidar is at {height:g} m{edge}", (
            "min_obstacle_height",
            "max_obstacle_height",
        )
    return None


@rule("assumed-lidar", "info")
def assumed_lidar(configuration: Configuration) -> Iterator[Problem]:
    """The YAML of move_base names the topic of a lidar, not its field of view, range or pose. Without `navstack/sim`,
    a lidar is simulated for each topic of scans or clouds, with the frame and heights of its source. Field of view,
    ranges and pose are those of a lidar in the URDF or xacro files of the robot's packages; without them, 270 degrees
    from 0.05 m to the costmap's raytrace range are assumed, with the values in the message.

    Fix: write those of the real lidar: `navstack: {sim: {laser: {fov: 4.71, range_max: 30.0, x: 0.2}}}`.
    """
    sim, sources = configuration.navstack.sim, sources_of(configuration.costmaps) | monitor_scans(configuration)
    for name in sim.lasers:
        lidar = sim.lidar(name)
        path = next((p for p, s in sources.items() if s.topic.strip("/") == lidar.topic.strip("/")), None)
        if path is None or "fov" in lidar.model_fields_set:
            continue
        message = (
            f"no file of the robot describes the sensor on {lidar.topic}, so it is assumed: "
            f"{math.degrees(lidar.fov):.0f} degrees, {lidar.range_min:g} to {lidar.range_max:g} m, {lidar.x:g} m ahead of the "
            f"center, {lidar.height:g} m high; set "
            f"those of the real one: `navstack: {{sim: {{{name}: {{fov: .., range_max: ..}}}}}}`"
        )
        yield Problem((f"/{path}/topic", f"/{path}/data_type", f"/{path}/type"), message)


@rule("assumed-base", "info")
def assumed_base(configuration: Configuration) -> Iterator[Problem]:
    """TrajectoryPlannerROS commands a velocity at once and checks trajectories that reach it with `acc_lim_*`. A simulated
    base that `navstack: sim:` does not describe accelerates and brakes with them.

    Fix: write the limits of the real base: `navstack: {sim: {acc_lim_x: 2.5, acc_lim_theta: 3.2}}`.
    """
    sim, namespace = configuration.navstack.sim, configuration.local_planner.namespace
    values = {name: getattr(sim, name) for name in ("acc_lim_x", "acc_lim_theta") if name not in sim.model_fields_set}
    known = {name: value for name, value in values.items() if value is not None}
    if not known:
        return
    limits = ", ".join(f"{name} = {value:g}" for name, value in known.items())
    message = (
        f"the simulated base is assumed to accelerate as the trajectories of {namespace} do ({limits}); set those of the real "
        f"one: `navstack: {{sim: {{acc_lim_x: .., acc_lim_theta: ..}}}}`"
    )
    yield Problem((*(f"/{namespace}/{name}" for name in known), "/base_local_planner"), message)


def _seen_sources(configuration: Configuration) -> dict[str, SensorSource]:
    """The sources of a simulated robot that is not blind: that is reported alone."""
    if any(simulated_robot_blind(configuration)):
        return {}
    return sources_of(configuration.costmaps)


def _is_fed(sim: SimParams, source: SensorSource) -> bool:
    """True if a simulated sensor publishes what a source listens to."""
    fed = {(sim.lidar(name).message, sim.lidar(name).topic.strip("/")) for name in sim.lasers}
    clouds = {sim.bumper(name).topic.strip("/") for name in sim.bumpers}
    topic = source.topic.strip("/")
    return (source.data_type, topic) in fed or (source.data_type != "LaserScan" and topic in clouds)


@rule("nothing-feeds", "warning")
def nothing_feeds(configuration: Configuration) -> Iterator[Problem]:
    """No simulated sensor publishes on the topic of an observation source, so the robot does not see its obstacles.

    Fix: write the line of the message.
    """
    sim = configuration.navstack.sim
    reported: set[str] = set()
    for path, source in _seen_sources(configuration).items():
        topic = source.topic.strip("/")
        if _is_fed(sim, source) or topic in reported:
            continue
        reported.add(topic)
        kind = "" if source.data_type == "LaserScan" else f", message: {source.data_type}"
        name = topic.replace("/", "_")
        lasers = ", ".join([*sim.lasers, name])
        fix = f"write `navstack: {{sim: {{lasers: [{lasers}], {name}: {{topic: {topic}{kind}}}}}}}`"
        message = f"nothing feeds {path}: no simulated sensor publishes {source.data_type} on {topic}; {fix}"
        yield Problem((f"/{path}/topic", f"/{path}/data_type"), message)


@rule("unknown-frame", "warning")
def unknown_frame(configuration: Configuration) -> Iterator[Problem]:
    """The `sensor_frame` of a source is not a frame of the simulated robot, so its messages cannot be transformed.

    Fix: give the simulated sensor this frame.
    """
    sim = configuration.navstack.sim
    known = frames_of(configuration) | sim.written_frames
    known |= (
        {sim.lidar(n).frame for n in sim.lasers} | {sim.bumper(n).frame for n in sim.bumpers} | {BumperParams().frame}
    )
    for path, source in _seen_sources(configuration).items():
        if not _is_fed(sim, source) or not source.sensor_frame or source.sensor_frame in known:
            continue
        topic = source.topic.strip("/")
        lidar = next((n for n in sim.lasers if sim.lidar(n).topic.strip("/") == topic), FIRST)
        message = (
            f"sensor_frame = {source.sensor_frame} of {path} is unknown to tf, so its messages are not used; write "
            f"`navstack: {{sim: {{{lidar}: {{frame: {source.sensor_frame}}}}}}}`"
        )
        yield Problem((f"/{path}/sensor_frame",), message, source.sensor_frame)


@rule("clearing-only", "warning")
def clearing_only(configuration: Configuration) -> Iterator[Problem]:
    """A source clears but does not mark, and no other source marks its topic: its obstacles are ignored.

    Fix: set `marking: true`.
    """
    sources = _seen_sources(configuration)
    for path, source in sources.items():
        costmap = path.partition("/")[0]
        if any(s.marking and s.topic == source.topic for p, s in sources.items() if p.startswith(f"{costmap}/")):
            continue
        message = (
            f"{path} clears but does not mark, and no other source of {costmap} marks {source.topic.strip('/')}, so the "
            "obstacles that it sees are ignored; set marking: true"
        )
        yield Problem((f"/{path}/marking", f"/{path}/topic"), message, "true")


@rule("sideways-command", "warning")
def sideways_command(configuration: Configuration) -> Iterator[Problem]:
    """The local planner may command a sideways velocity (ROS's DWA default is 0.1 m/s to both sides), which a
    differential base or a car cannot execute. The robot then leaves the trajectory that was checked. If the YAML
    sets `max_vel_y`, `min_vel_y` or `holonomic_robot` and `kinematics` of `navstack: sim:` is not set, the
    simulated base is holonomic.

    Fix: set `max_vel_y: 0` and `min_vel_y: 0` (TrajectoryPlannerROS: `holonomic_robot: false`), or `kinematics:
    holonomic` in `navstack: sim:`.
    """
    sim, planner = configuration.navstack.sim, configuration.local_planner
    namespace = planner.namespace
    speed, names = sideways_speed(planner.params)
    if speed == 0.0 or sim.kinematics == "holonomic":
        return
    written = (*(f"/{namespace}/{name}" for name in names), "/base_local_planner")
    fix = "max_vel_y: 0 and min_vel_y: 0" if "max_vel_y" in names else "holonomic_robot: false"
    message = (
        f"{namespace} commands sideways velocities up to {speed:g} m/s, which a base of kinematics {sim.kinematics} cannot "
        f"execute, so the robot leaves the trajectory that was checked; set {fix}, or navstack/sim/kinematics: holonomic"
    )
    yield Problem(written, message)

"""The simulated robot follows the YAML: its lidars the observation sources, its base the sideways velocities.

What `navstack: sim:` sets is kept.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from navstack.core.parameter_checks import CostmapSetup, Issue, SensorSource
from navstack.parameters.models.sim import BumperParams, LidarParams, SimParams

FIRST = "laser"
"""Name of the simulated lidar of a robot without `navstack/sim/lasers`."""


def sources_of(costmaps: Sequence[CostmapSetup]) -> dict[str, SensorSource]:
    """Return the observation sources of the enabled layers: path below move_base -> source."""
    return {
        f"{costmap.name}/{layer.name}/{name}": source
        for costmap in costmaps
        for layer in costmap.layers
        if layer.traits.enabled
        for name, source in layer.traits.sources.items()
    }


def follow_sources(sim: SimParams, sources: Sequence[SensorSource], base_frame: str) -> SimParams:
    """Return the simulated robot with one lidar for each topic of laser scans, unless `lasers` is written.

    Topic, frame (`sensor_frame`) and height are those of the source; what the namespace of a lidar sets is kept. Poses are not
    in the YAML of move_base: the lidars have the default one.
    """
    scans = {s.topic.strip("/"): s for s in reversed(sources) if s.data_type == "LaserScan"}
    if "lasers" in sim.model_fields_set or not scans:
        return sim
    lidars: dict[str, LidarParams] = {}
    own = sim.sensors.get(FIRST)
    first = own.topic.strip("/") if isinstance(own, LidarParams) and "topic" in own.model_fields_set else ""
    topics = sorted(scans, key=lambda topic: (topic != first, list(reversed(scans)).index(topic)))
    if first and first not in scans:
        return sim
    for number, topic in enumerate(topics, 1):
        name = FIRST if number == 1 else f"{FIRST}_{number}"
        written = sim.sensors.get(name)
        lidar = written if isinstance(written, LidarParams) else LidarParams()
        lidars[name] = _lidar(lidar, topic, scans[topic], number, base_frame)
    return sim.model_copy(update={"lasers": list(lidars), "sensors": {**sim.sensors, **lidars}})


def _lidar(lidar: LidarParams, topic: str, source: SensorSource, number: int, base_frame: str) -> LidarParams:
    """The lidar that feeds a source; what the user wrote is kept."""
    frame = source.sensor_frame or (lidar.frame if number == 1 else f"{topic.replace('/', '_')}_link")
    values: dict[str, Any] = {"topic": topic, "frame": frame}
    if not source.min_height <= lidar.height <= source.max_height and source.max_height > 0.0:
        values["height"] = 0.5 * (max(source.min_height, 0.0) + source.max_height)
    if frame == base_frame:
        values |= {"x": 0.0, "y": 0.0, "yaw": 0.0}
    return lidar.model_copy(update={k: v for k, v in values.items() if k not in lidar.model_fields_set})


def assumed_lidar(sim: SimParams, sources: dict[str, SensorSource]) -> Iterator[Issue]:
    """Say which lidar is simulated if the user does not: move_base's YAML does not describe it."""
    for name in sim.lasers:
        lidar = sim.lidar(name)
        path = next((p for p, s in sources.items() if s.topic.strip("/") == lidar.topic.strip("/")), None)
        if path is None or "fov" in lidar.model_fields_set:
            continue
        message = (
            f"the lidar on {lidar.topic} is simulated with a field of view of {lidar.fov:g} rad, ranges from {lidar.range_min:g} "
            f"to {lidar.range_max:g} m, {lidar.x:g} m ahead of the centre, {lidar.height:g} m high; set fov, range_max "
            f"and x of the real one: `navstack: {{sim: {{{name}: {{fov: .., range_max: ..}}}}}}`"
        )
        yield Issue("info", "assumed-lidar", (f"/{path}/topic", f"/{path}/data_type"), message)


def nothing_feeds(sim: SimParams, sources: dict[str, SensorSource], frames: frozenset[str]) -> Iterator[Issue]:
    """Sources without a simulated sensor, of an unknown frame, or that only clear: the robot does not see their obstacles."""
    scans = {sim.lidar(name).topic.strip("/") for name in sim.lasers}
    clouds = {sim.bumper(name).topic.strip("/") for name in sim.bumpers}
    known = frames | {p.frame for p in sim.sensors.values()} | {sim.lidar(n).frame for n in sim.lasers}
    known |= {BumperParams().frame, *(sim.bumper(n).frame for n in sim.bumpers)}
    reported: set[str] = set()
    for path, source in sources.items():
        topic = source.topic.strip("/")
        costmap = path.partition("/")[0]
        fed = topic in (scans if source.data_type == "LaserScan" else clouds)
        if not fed and topic not in reported:
            reported.add(topic)
            fix = "a depth camera is not simulated, so set data_type: LaserScan to simulate it as a lidar"
            if source.data_type == "LaserScan":
                name = topic.replace("/", "_")
                lasers = ", ".join([*sim.lasers, name])
                fix = f"write `navstack: {{sim: {{lasers: [{lasers}], {name}: {{topic: {topic}}}}}}}`"
            message = f"nothing feeds {path}: no simulated sensor publishes {source.data_type} on {topic}; {fix}"
            yield Issue("warning", "nothing-feeds", (f"/{path}/topic", f"/{path}/data_type"), message)
        elif fed and source.sensor_frame and source.sensor_frame not in known:
            lidar = next((n for n in sim.lasers if sim.lidar(n).topic.strip("/") == topic), FIRST)
            message = (
                f"sensor_frame = {source.sensor_frame} of {path} is unknown to tf, so its messages are not used; write "
                f"`navstack: {{sim: {{{lidar}: {{frame: {source.sensor_frame}}}}}}}`"
            )
            yield Issue("warning", "unknown-frame", (f"/{path}/sensor_frame",), message, source.sensor_frame)
        marked = any(s.marking and s.topic == source.topic for p, s in sources.items() if p.startswith(f"{costmap}/"))
        if not marked:
            message = (
                f"{path} clears but does not mark, and no other source of {costmap} marks {topic}, so the obstacles that it sees "
                "are ignored; set marking: true"
            )
            yield Issue("warning", "clearing-only", (f"/{path}/marking", f"/{path}/topic"), message, "true")


# --- sideways velocities ----------------------------------------------------------------------------------------------


def sideways_speed(params: Any) -> tuple[float, tuple[str, ...]]:
    """Return the highest sideways speed that a local planner may command (m/s) and the parameters that decide it."""
    if hasattr(params, "max_vel_y"):
        if params.use_dwa and params.acc_lim_y == 0.0:
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


def sideways_command(sim: SimParams, namespace: str, params: Any) -> Iterator[Issue]:
    """A base that cannot move sideways drops such a command and leaves the trajectory that was checked."""
    speed, names = sideways_speed(params)
    if speed == 0.0 or sim.kinematics == "holonomic":
        return
    written = (*(f"/{namespace}/{name}" for name in names), "/base_local_planner")
    fix = "max_vel_y: 0 and min_vel_y: 0" if "max_vel_y" in names else "holonomic_robot: false"
    message = (
        f"{namespace} commands sideways velocities up to {speed:g} m/s, which a base of kinematics {sim.kinematics} cannot "
        f"execute, so the robot leaves the trajectory that was checked; set {fix}, or navstack/sim/kinematics: holonomic"
    )
    yield Issue("warning", "sideways-command", written, message)

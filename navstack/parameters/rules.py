"""Run the checks across parameters: those of each plugin in use (`ParamModel.check`) and those of the whole robot."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from navstack.core.parameter_checks import CheckContext, CostmapSetup, Issue, LayerSetup, SensorSource
from navstack.core.parameters import ParamModel
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.models.sim import SimParams
from navstack.parameters.planner_limits import PlannerLimits
from navstack.parameters.safety_rules import SafetyContext, check_safety
from navstack.parameters.simulated_robot import (
    assumed_lidar,
    follow_planner,
    follow_sources,
    nothing_feeds,
    sideways_command,
    sources_of,
)
from navstack.parameters.steering_rules import steering_rules
from navstack.parameters.tree import COSTMAPS, Leaf, Space
from navstack.plugins import PluginChoice


def check_rules(configuration: Configuration) -> list[Finding]:
    """Return the findings of every rule about a loaded configuration."""
    context = _context(configuration)
    found: list[Finding] = []
    for plugin, costmap in _plugins(configuration, context):
        own = CheckContext(
            plugin.name,
            context.ros_distro,
            context.controller_frequency,
            context.global_costmap,
            context.local_costmap,
            costmap,
        )
        found += _findings(
            configuration.tree, plugin.namespace, plugin.params, lambda p=plugin, c=own: p.params.check(c)
        )
    for costmap in context.costmaps:
        found += footprint_beside_center(configuration.tree, costmap)
    for rule in ROBOT_RULES:
        found += _findings(configuration.tree, "", None, lambda rule=rule: rule(context))
    sim = configuration.navstack.sim
    blind = list(_findings(configuration.tree, "", None, lambda: simulated_robot_blind(context, sim)))
    found += blind
    planner = configuration.local_planner
    frames = frozenset(
        {c.params.global_frame for c in (configuration.global_costmap, configuration.local_costmap)}
        | {context.local_costmap.robot_base_frame, "map", "odom"}
    )
    sources = sources_of(context.costmaps)
    found += _findings(configuration.tree, "", None, lambda: assumed_lidar(sim, sources))
    found += _findings(configuration.tree, "", None, lambda: sideways_command(sim, planner.namespace, planner.params))
    found += _findings(configuration.tree, "", None, lambda: steering_rules(configuration))
    if not blind:
        found += _findings(configuration.tree, "", None, lambda: nothing_feeds(sim, sources, frames))
    if configuration.safety.in_use:
        safety = _safety_context(configuration, frames)
        found += _findings(configuration.tree, "", None, lambda: check_safety(safety))
    return found


# --- the robot --------------------------------------------------------------------------------------------------------


def simulated(configuration: Configuration) -> SimParams:
    """Return the simulated robot that follows the observation sources and the local planner of a configuration."""
    context = _context(configuration)
    sources = list(sources_of(context.costmaps).values())
    sim = follow_sources(configuration.navstack.sim, sources, context.local_costmap.robot_base_frame)
    return follow_planner(sim, configuration.local_planner.params)


def _context(configuration: Configuration) -> CheckContext:
    global_costmap = _setup(COSTMAPS[0], configuration.global_costmap)
    local_costmap = _setup(COSTMAPS[1], configuration.local_costmap)
    return CheckContext(
        name="",
        ros_distro=configuration.navstack.ros_distro,
        controller_frequency=configuration.move_base.controller_frequency,
        global_costmap=global_costmap,
        local_costmap=local_costmap,
        costmap=local_costmap,
    )


def _safety_context(configuration: Configuration, frames: frozenset[str]) -> SafetyContext:
    planner, sim = configuration.local_planner, configuration.navstack.sim
    primary = getattr(planner.params, "primary", None)
    limits = PlannerLimits(planner.namespace, planner.params)
    if primary is not None:  # of a rotation shim
        limits = PlannerLimits(f"{planner.namespace}/primary_controller", primary[1])
    sensors = {sensor.frame for sensor in sim.sensors.values()} | {sim.lidar(name).frame for name in sim.lasers}
    return SafetyContext(
        configuration.safety,
        sim,
        limits,
        configuration.local_costmap.true_footprint,
        configuration.move_base.controller_frequency,
        frames | sensors,
    )


def _setup(name: str, costmap: CostmapConfiguration) -> CostmapSetup:
    p = costmap.params
    return CostmapSetup(
        name=name,
        robot_base_frame=p.robot_base_frame,
        rolling_window=p.rolling_window,
        track_unknown_space=p.track_unknown_space,
        width=p.width,
        height=p.height,
        resolution=p.resolution,
        update_frequency=p.update_frequency,
        footprint=costmap.footprint,
        layers=tuple(LayerSetup(layer.name, layer.cls.traits(layer.params)) for layer in costmap.layers),
    )


def _plugins(configuration: Configuration, context: CheckContext) -> Iterator[tuple[PluginChoice[Any], CostmapSetup]]:
    """Every plugin in use and the costmap that its checks look at first."""
    yield configuration.local_planner, context.local_costmap
    yield configuration.global_planner, context.local_costmap
    if configuration.smoother is not None:
        yield configuration.smoother, context.local_costmap
    for costmap, setup in zip((configuration.global_costmap, configuration.local_costmap), context.costmaps):
        for layer in costmap.layers:
            yield layer, setup
    for recovery in configuration.recoveries:
        yield recovery, context.local_costmap


# --- issues -> findings -----------------------------------------------------------------------------------------------


def _findings(
    root: Space, namespace: str, params: ParamModel | None, check: Callable[[], Iterator[Issue]]
) -> Iterator[Finding]:
    """Locate the issues of one check. A check that raises is itself a finding: a plugin's fault must not stop loading."""
    try:
        issues = list(check())
    except Exception as exc:
        message = (
            f"the check of {type(params).__name__ if params is not None else 'the robot'} failed with "
            f"{type(exc).__name__}: {exc}; report this to the author of the plugin"
        )
        at, key = _place(root, namespace, None, "")
        yield finding("warning", "check-failed", at, key, message)
        return
    for issue in issues:
        places = [_split(name, namespace, params) for name in issue.parameters]
        written = [leaf for space, model, name in places if (leaf := _leaf(root, space, model, name)) is not None]
        if written:
            at, key = written[0].at, written[0].path
        else:
            at, key = _place(root, *places[0])
        yield finding(issue.severity, issue.rule, at, key, issue.message, issue.suggestion)


def _split(name: str, namespace: str, params: ParamModel | None) -> tuple[str, type[ParamModel] | None, str]:
    """The namespace, the model that reads it and the last part of a parameter's name in an issue."""
    above, _, last = name.rpartition("/")
    if name.startswith("/"):
        return above[1:], None, last
    if not above:
        return namespace, type(params) if params is not None else None, last
    children: Mapping[str, Any] = (
        getattr(params, params.CHILD_FIELD) if params is not None and params.CHILD_FIELD else {}
    )
    child = children.get(above)
    return f"{namespace}/{above}", type(child) if isinstance(child, ParamModel) else None, last


def _space(root: Space, path: str) -> Space | None:
    at: Space | None = root
    for part in path.split("/") if path else ():
        at = at.space(part) if at is not None else None
    return at


def _leaf(root: Space, path: str, model: type[ParamModel] | None, name: str) -> Leaf | None:
    """The parameter as written, by its current or a former name; the costmap's level wins where it overrides."""
    space = _space(root, path)
    if space is None:
        return None
    if model is None:
        return space.leaf(name)
    if name in model.FROM_PARENT and space.parent is not None and space.parent.leaf(name) is not None:
        return space.parent.leaf(name)
    for known in (name, *(old for old, new in model.RENAMED.items() if new == name)):
        found = space.leaf(known)
        if found is not None:
            return found
    return space.search(name) if name in model.SEARCHED else None


def _place(root: Space, path: str, model: type[ParamModel] | None, name: str) -> tuple[Location, str]:
    """The location of a parameter that is not written: its namespace or the nearest one above, else the first file."""
    del model
    at = root
    for part in path.split("/") if path else ():
        below = at.space(part)
        if below is None:
            break
        at = below
    key = f"{path}/{name}".strip("/")
    if at is root or not at.at.file:
        first = next(root.leaves(), None)
        return Location(first.at.file if first else ""), key
    return at.at, key


# --- rules of the whole robot -----------------------------------------------------------------------------------------


def local_costmap_moves(context: CheckContext) -> Iterator[Issue]:
    """A local costmap that does not follow the robot is useless once the robot has left it."""
    costmap = context.local_costmap
    if not costmap.rolling_window and not any(layer.traits.has_static_map for layer in costmap.layers):
        message = (
            "the local costmap does not follow the robot (rolling_window = false) and has no static map, so the robot drives "
            "out of it; set rolling_window: true"
        )
        yield Issue("warning", "fixed-window", ("/local_costmap/rolling_window",), message, "true")


def local_costmap_sees(context: CheckContext) -> Iterator[Issue]:
    """Without sensor data in the local costmap nothing is avoided."""
    layers = context.local_costmap.layers
    if layers and not any(layer.traits.fed_by_sensors for layer in layers):
        message = (
            "no layer of the local costmap receives sensor data, so the robot avoids no obstacles; add an obstacle layer with "
            "observation_sources"
        )
        yield Issue("warning", "blind", ("/local_costmap/plugins",), message)


def base_frames_agree(context: CheckContext) -> Iterator[Issue]:
    """Both costmaps must describe one robot."""
    one, other = (c.robot_base_frame for c in context.costmaps)
    if one != other:
        message = (
            f"robot_base_frame differs between the costmaps: {one} (global), {other} (local); use one frame in both"
        )
        yield Issue("warning", "base-frames-differ", ("/local_costmap/robot_base_frame",), message)


ROBOT_RULES: tuple[Callable[[CheckContext], Iterator[Issue]], ...] = (
    local_costmap_moves,
    local_costmap_sees,
    base_frames_agree,
)


def footprint_beside_center(root: Space, costmap: CostmapSetup) -> Iterator[Finding]:
    """The inscribed radius of a footprint beside the robot's centre is meaningless."""
    if costmap.footprint.contains_center:
        return
    message = (
        "the footprint does not contain the robot's centre (0, 0), so its inscribed radius and all inflated costs are wrong; "
        "give the corners in the robot's base frame"
    )
    space = root.space(costmap.name)
    leaf = space.search("footprint") if space else None
    at, key = (leaf.at, leaf.path) if leaf else (Location(""), f"{costmap.name}/footprint")
    yield finding("warning", "footprint-beside-center", at, key, message)


def simulated_robot_blind(context: CheckContext, sim: SimParams) -> Iterator[Issue]:
    """A simulated lidar that no observation source accepts leaves the simulated robot blind."""
    sources = {
        f"{costmap.name}/{layer.name}/{name}": source
        for costmap in context.costmaps
        for layer in costmap.layers
        for name, source in layer.traits.sources.items()
    }
    if not sim.lidars or not sources:
        return
    name, first = next(iter(sim.lidars.items()))
    parameters = (f"/{next(iter(sources))}/topic",)
    problem = ""
    for lidar in sim.lidars.values():
        for path, source in sources.items():
            if source.topic.strip("/") != lidar.topic.strip("/"):
                continue
            mismatch = _mismatch(source, lidar.height)
            if mismatch is None:
                return
            problem, names = mismatch
            problem = f"{path} rejects the scans of the simulated lidar on {first.topic}: {problem}; correct it or set "
            problem += f"navstack/sim/{name}"
            parameters = tuple(f"/{path}/{n}" for n in names)
    if not problem:
        topics = ", ".join(sorted({source.topic.strip("/") for source in sources.values()}))
        problem = (
            f"its lidar publishes on {first.topic}, but the costmaps listen to {topics}; set navstack/sim/{name}/topic"
        )
    yield Issue("warning", "simulated-robot-blind", parameters, f"the simulated robot is blind: {problem}")


def _mismatch(source: SensorSource, height: float) -> tuple[str, tuple[str, str]] | None:
    """Why a source does not take a laser scan at a height (m), and the parameters that decide it; None if it does."""
    if source.data_type != "LaserScan":
        return f"its data_type is {source.data_type}, not LaserScan", ("data_type", "topic")
    if not source.min_height <= height <= source.max_height:
        heights = f"from {source.min_height:g} to {source.max_height:g} m"
        return f"it accepts heights {heights}, and the lidar is at {height:g} m", (
            "min_obstacle_height",
            "max_obstacle_height",
        )
    return None

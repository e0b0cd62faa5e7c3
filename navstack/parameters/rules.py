"""Checks across parameters: combinations that are each allowed and together go wrong on a robot, with the numbers.

A rule is a function that yields findings; `RULES` lists them. Parameters are looked up by their ROS names, so that a
third party's plugin with the same names is checked as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from navstack.core import Footprint
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.tree import Leaf, Space

Plugin = tuple[str, type[Any], Any]
"""Instance name, class, parameters."""

INSCRIBED_NEXT = 252.0
"""Cost of a cell just outside the inscribed radius."""
HORIZONS_LOST = 3.0
"""Passing an obstacle may cost this many horizons of progress; beyond it the robot rather stands still."""


@dataclass(frozen=True, slots=True)
class Subject:
    """What rules look at."""

    root: Space
    distro: str
    move_base: Any
    costmaps: Mapping[str, tuple[Any, Footprint, Sequence[Plugin]]]
    """By name: parameters, padded footprint, layers."""
    global_planner: Plugin
    local_planner: Plugin
    recoveries: Sequence[Plugin]
    sim: Any = None
    planner_space: str = ""
    """Namespace of the local planner."""
    global_space: str = ""
    """Namespace of the global planner."""

    def leaf(self, space: str, name: str, model: Any = None) -> Leaf | None:
        """The parameter as written, by today's name or a former one; what the costmap's level overrides with wins."""
        at: Space | None = self.root
        for part in space.split("/") if space else ():
            at = at.space(part) if at is not None else None
        if at is None:
            return None
        if name in getattr(model, "FROM_PARENT", ()) and at.parent is not None and at.parent.leaf(name) is not None:
            return at.parent.leaf(name)
        names = [name, *(old for old, new in getattr(model, "RENAMED", {}).items() if new == name)]
        for n in names:
            found = at.leaf(n)
            if found is not None:
                return found
        return at.search(name) if name in getattr(model, "SEARCHED", ()) else None

    def place(self, space: str, *names: str, model: Any = None) -> tuple[Location, str]:
        """Where the first of these parameters that is written stands; else its namespace or the nearest one above."""
        for name in names:
            leaf = self.leaf(space, name, model)
            if leaf is not None:
                return leaf.at, leaf.path
        at = self.root
        for part in space.split("/") if space else ():
            below = at.space(part)
            if below is None:
                break
            at = below
        if not at.at.file or at is self.root:
            first = next(self.root.leaves(), None)
            return (Location(first.at.file) if first else Location("")), f"{space}/{names[0]}".strip("/")
        return at.at, f"{space}/{names[0]}"


Rule = Callable[[Subject], Iterator[Finding]]


def check_rules(subject: Subject) -> list[Finding]:
    """Every rule's findings."""
    return [f for rule in RULES for f in rule(subject)]


def _say(
    subject: Subject,
    severity: Severity,
    rule: str,
    space: str,
    names: Sequence[str],
    message: str,
    suggestion: str | None = None,
    model: Any = None,
) -> Finding:
    at, key = subject.place(space, *names, model=model)
    return finding(severity, rule, at, key, message, suggestion)


def _get(params: Any, *names: str) -> list[Any] | None:
    """Those parameters, None unless the model has them all."""
    values = [getattr(params, n, None) for n in names]
    return None if any(v is None for v in values) else values


# --- the local planner ------------------------------------------------------------------------------------------------


def scoring_scale(s: Subject) -> Iterator[Finding]:
    """Parity 31: weights tuned before 2018 make obstacles 1 / (2 * resolution) times heavier than their authors saw."""
    params = s.local_planner[2]
    found = _get(params, "path_distance_bias", "goal_distance_bias", "occdist_scale", "sim_time", "max_vel_x")
    dwa, rollout = hasattr(params, "forward_point_distance"), hasattr(params, "meter_scoring")
    if found is None or not (dwa or rollout):
        return
    _, goal, occdist, sim_time, max_vel_x = found
    resolution = s.costmaps["local_costmap"][0].resolution
    horizon = sim_time * max_vel_x

    def worth(distro: str) -> tuple[float, float]:
        # the obstacle critic counts the dearest pose of a trajectory
        obstacle = occdist * INSCRIBED_NEXT
        if rollout:
            # TrajectoryPlannerROS counts cells unless told to count metres; only then did it weigh obstacles by resolution
            if not params.meter_scoring:
                return goal / resolution, obstacle
            return goal, obstacle * resolution if distro == "indigo" else obstacle
        # DWA: goal and goal_front both fall by a metre's worth
        if distro == "indigo":
            return goal, obstacle * resolution
        return 2.0 * goal, obstacle

    metre, passing = worth(s.distro)
    if occdist <= 0.0 or passing <= HORIZONS_LOST * metre * horizon:
        return
    numbers = (
        f"under ros_distro {s.distro}, a metre of progress is worth {metre:g} (goal_distance_bias {goal:g}), the "
        f"{horizon:.2g} m of a whole horizon {metre * horizon:.3g}, but passing at the inscribed radius costs {passing:.3g} "
        f"(occdist_scale {occdist:g})"
    )
    old_metre, old_passing = worth("indigo")
    factor = max(1.0, 1.0 / ((1.0 if rollout else 2.0) * resolution))
    way_out = f"divide occdist_scale by {factor:g}"
    if s.distro != "indigo" and old_passing <= HORIZONS_LOST * old_metre * horizon:
        way_out = (
            f"weights like these were tuned before 2018, when it was {old_metre:g} a metre against {old_passing:.3g}: set "
            f"navstack/ros_distro to indigo (--distro indigo), or divide occdist_scale by {factor:g}"
        )
    message = (
        f"obstacles outweigh progress, the robot will stop or turn in place in narrow places: {numbers}; {way_out}"
    )
    yield _say(s, "warning", "scoring-scale", s.planner_space, ("occdist_scale",), message, None, params)


def window_holds_horizon(s: Subject) -> Iterator[Finding]:
    """Trajectories that leave the local costmap are rejected."""
    params = s.local_planner[2]
    found = _get(params, "sim_time", "max_vel_x")
    costmap = s.costmaps["local_costmap"][0]
    if found is None or not costmap.rolling_window:
        return
    reach = found[0] * found[1] + (getattr(params, "forward_point_distance", None) or 0.0)
    half = min(costmap.width, costmap.height) / 2.0
    if half < reach:
        message = (
            f"the local costmap reaches {half:g} m from the robot, but trajectories reach {reach:.3g} m "
            f"(sim_time {found[0]:g} s * max_vel_x {found[1]:g} m/s, plus the look-ahead): fast ones will be rejected; "
            f"make width and height at least {math.ceil(20 * reach) / 10:g} m"
        )
        yield _say(s, "warning", "window-too-small", "local_costmap", ("width", "height"), message)


def window_starts_moving(s: Subject) -> Iterator[Finding]:
    """From rest, one control period must be enough to reach one of the two minimum speeds."""
    params = s.local_planner[2]
    found = _get(params, "acc_lim_x", "acc_lim_theta", "min_vel_trans", "min_vel_theta")
    if found is None or getattr(params, "use_dwa", True) is False:
        return
    acc_x, acc_theta, min_trans, min_theta = found
    hz = s.move_base.controller_frequency
    if acc_x / hz < min_trans and acc_theta / hz < min_theta:
        message = (
            f"standing still, the robot reaches {acc_x / hz:.3g} m/s and {acc_theta / hz:.3g} rad/s in one control period "
            f"(controller_frequency {hz:g} Hz), less than min_vel_trans {min_trans:g} and min_vel_theta {min_theta:g}: every "
            "command is rejected and it never starts; lower the minimum speeds or raise the acceleration limits"
        )
        yield _say(s, "warning", "cannot-start", s.planner_space, ("acc_lim_theta", "acc_lim_x"), message, None, params)


def stops_within_horizon(s: Subject) -> Iterator[Finding]:
    """A robot that cannot stop within what it simulates cannot avoid what it sees there."""
    params = s.local_planner[2]
    found = _get(params, "acc_lim_x", "max_vel_x", "sim_time")
    if found is None:
        return
    acc, speed, sim_time = found
    if acc > 0.0 and speed > 0.0 and speed / acc > sim_time:
        message = (
            f"at max_vel_x {speed:g} m/s the robot needs {speed / acc:.3g} s to stop (acc_lim_x {acc:g} m/s²), longer than "
            f"the simulated {sim_time:g} s: it cannot stop for what it sees; raise sim_time or lower max_vel_x"
        )
        yield _say(s, "warning", "stopping-time", s.planner_space, ("sim_time", "acc_lim_x"), message, None, params)


def minimum_over_maximum(s: Subject) -> Iterator[Finding]:
    """A minimum speed over the maximum leaves nothing to sample."""
    params = s.local_planner[2]
    for low, high in (
        ("min_vel_x", "max_vel_x"),
        ("min_vel_y", "max_vel_y"),
        ("min_vel_trans", "max_vel_trans"),
        ("min_vel_theta", "max_vel_theta"),
    ):
        found = _get(params, low, high)
        if found is not None and found[0] > found[1]:
            message = f"{low} = {found[0]:g} is over {high} = {found[1]:g}: no speed is left; exchange or correct them"
            yield _say(s, "error", "minimum-over-maximum", s.planner_space, (low, high), message, None, params)


def samples_of_none(s: Subject) -> Iterator[Finding]:
    """`vy_samples: 0` stands in many published files, and ROS silently takes 1 for it; so does navstack, with a note."""
    params = s.local_planner[2]
    if getattr(params, "vy_samples", None) == 0:
        message = "vy_samples = 0 counts as 1, as in ROS, which takes it without a word; write 1"
        yield _say(s, "info", "counts-as-one", s.planner_space, ("vy_samples",), message, "1", params)


def min_vel_trans_zero(s: Subject) -> Iterator[Finding]:
    """With 0, slow arcs count as driving and min_vel_theta never applies."""
    params = s.local_planner[2]
    found = _get(params, "min_vel_trans", "min_vel_theta")
    if found is not None and found[0] == 0.0 and found[1] > 0.0 and hasattr(params, "forward_point_distance"):
        message = (
            f"min_vel_trans = 0 makes every speed count as driving, so min_vel_theta {found[1]:g} never applies and the robot "
            "may turn in place too slowly for its motors; write 0.1 or so"
        )
        yield _say(s, "warning", "min-vel-trans-zero", s.planner_space, ("min_vel_trans",), message, "0.1", params)


def tolerances(s: Subject) -> Iterator[Finding]:
    """Tolerances that the robot's own steps are too coarse for."""
    params = s.local_planner[2]
    resolution = s.costmaps["local_costmap"][0].resolution
    xy = getattr(params, "xy_goal_tolerance", None)
    if xy is not None and xy < resolution:
        message = (
            f"xy_goal_tolerance = {xy:g} m is less than one cell of the local costmap ({resolution:g} m), finer than the "
            f"planner can tell places apart: the robot may circle its goal; write {resolution:g} or more"
        )
        yield _say(s, "warning", "tolerance-under-cell", s.planner_space, ("xy_goal_tolerance",), message, None, params)
    found = _get(params, "yaw_goal_tolerance", "min_vel_theta")
    if found is None or found[1] <= 0.0:
        return
    step = found[1] / s.move_base.controller_frequency
    if 2.0 * found[0] < step:
        message = (
            f"yaw_goal_tolerance = {found[0]:g} rad is passed within one control period, in which the robot turns at least "
            f"{step:.3g} rad (min_vel_theta {found[1]:g} rad/s): it may turn to and fro at the goal; write {step / 2:.2g} or "
            "more, or lower min_vel_theta"
        )
        yield _say(s, "warning", "yaw-tolerance", s.planner_space, ("yaw_goal_tolerance",), message, None, params)


# --- costmaps ---------------------------------------------------------------------------------------------------------


def inflation_covers_robot(s: Subject) -> Iterator[Finding]:
    """Inside the circumscribed radius the outline may touch; outside the inflation nothing says so."""
    for name, (_, footprint, layers) in s.costmaps.items():
        for layer, _, params in layers:
            radius = getattr(params, "inflation_radius", None)
            if radius is None or not getattr(params, "enabled", True) or radius >= footprint.circumscribed_radius:
                continue
            least = math.ceil(footprint.circumscribed_radius * 100.0) / 100.0
            below = radius < footprint.inscribed_radius
            end = (
                "even the inscribed one, so plans lead through walls' edges"
                if below
                else "so plans may pass where the robot's corners touch"
            )
            message = (
                f"inflation_radius = {radius:g} m is less than the robot's circumscribed radius of "
                f"{footprint.circumscribed_radius:.3g} m (inscribed {footprint.inscribed_radius:.3g} m), {end}; "
                f"write {least:g} or more"
            )
            space = f"{name}/{layer}"
            yield _say(
                s, "warning", "inflation-under-radius", space, ("inflation_radius",), message, f"{least:g}", params
            )


def inflation_has_gradient(s: Subject) -> Iterator[Finding]:
    """Costs that fall to nothing within a cell, or do not fall at all, keep no distance."""
    for name, (costmap, _, layers) in s.costmaps.items():
        for layer, _, params in layers:
            factor = getattr(params, "cost_scaling_factor", None)
            if factor is None or not hasattr(params, "inflation_radius"):
                continue
            reach = math.log(INSCRIBED_NEXT) / factor if factor > 0.0 else math.inf
            if factor == 0.0:
                message = "cost_scaling_factor = 0 gives every inflated cell the same cost; write 3 to 10"
            elif reach < costmap.resolution:
                message = (
                    f"cost_scaling_factor = {factor:g} lets the cost fall to nothing within {reach:.2g} m, less than a cell "
                    f"({costmap.resolution:g} m): no distance is kept from obstacles; write 3 to 10"
                )
            else:
                continue
            space = f"{name}/{layer}"
            yield _say(s, "warning", "no-gradient", space, ("cost_scaling_factor",), message, None, params)


def inflation_is_last(s: Subject) -> Iterator[Finding]:
    """Obstacles of layers behind the inflation are not inflated."""
    for name, (_, _, layers) in s.costmaps.items():
        inflations = [i for i, (_, _, p) in enumerate(layers) if hasattr(p, "inflation_radius")]
        if not inflations:
            continue
        late = [n for n, _, p in layers[inflations[-1] + 1 :] if getattr(p, "enabled", True)]
        if late:
            message = (
                f"{late[0]} comes after {layers[inflations[-1]][0]} in the plugins of {name}, so what it marks is not inflated; "
                "put the inflation last"
            )
            yield _say(s, "warning", "inflation-not-last", name, ("plugins",), message)


def sensors_reach(s: Subject) -> Iterator[Finding]:
    """Obstacles that are marked farther away than free space is cleared stay for ever."""
    for name, (_, _, layers) in s.costmaps.items():
        for layer, _, params in layers:
            for source, p in _sources(params).items():
                space = f"{name}/{layer}/{source}"
                found = _get(p, "obstacle_range", "raytrace_range")
                if found is not None and found[0] > found[1] and getattr(p, "marking", True):
                    message = (
                        f"obstacle_range = {found[0]:g} m of {source} is over its raytrace_range = {found[1]:g} m: what is "
                        "marked beyond is never cleared again; make raytrace_range the greater"
                    )
                    names = ("obstacle_range", "raytrace_range")
                    yield _say(s, "warning", "marks-beyond-clearing", space, names, message, None, p)
                heights = _get(p, "min_obstacle_height", "max_obstacle_height")
                if heights is None:
                    continue
                top = min(heights[1], getattr(params, "max_obstacle_height", math.inf))
                if heights[0] > top:
                    message = (
                        f"{source} keeps points from {heights[0]:g} m up to {top:g} m of height, which is none: the robot is "
                        "blind to it; correct min_obstacle_height or max_obstacle_height"
                    )
                    yield _say(s, "warning", "drops-every-point", space, ("min_obstacle_height",), message, None, p)


def _sources(params: Any) -> Mapping[str, Any]:
    """The observation sources of a layer, by name."""
    child = getattr(params, "CHILD_FIELD", None)
    found = getattr(params, child, None) if child else None
    return found if isinstance(found, Mapping) else {}


def local_window_moves(s: Subject) -> Iterator[Finding]:
    """A local costmap that stands still is left by the robot; one without sensors sees nothing."""
    params, _, layers = s.costmaps["local_costmap"]
    static = any(hasattr(p, "lethal_cost_threshold") for _, _, p in layers)
    if not params.rolling_window and not static:
        message = (
            "the local costmap is neither a rolling window nor has it a static map: the robot drives out of it; write "
            "rolling_window: true"
        )
        yield _say(s, "warning", "window-stands", "local_costmap", ("rolling_window",), message, "true")
    if layers and not any(_is_fed(p) for _, _, p in layers):
        message = "no layer of the local costmap is fed by a sensor: the robot sees no obstacle; add an obstacle layer"
        yield _say(s, "warning", "blind", "local_costmap", ("plugins",), message)


def _is_fed(params: Any) -> bool:
    """False for layers that are known to look at no sensor; a third party's layer may."""
    if hasattr(params, "observation_sources"):
        return bool(_sources(params)) and getattr(params, "enabled", True)
    return not (hasattr(params, "inflation_radius") or hasattr(params, "lethal_cost_threshold"))


def footprint_holds_center(s: Subject) -> Iterator[Finding]:
    """The inscribed radius of an outline beside the centre means nothing."""
    for name, (_, footprint, _) in s.costmaps.items():
        if not footprint.contains_center:
            message = (
                "the footprint does not contain the robot's centre (0, 0), so its inscribed radius means nothing and costs "
                "are wrong; give its corners in the robot's own frame"
            )
            leaf = s.root.space(name)
            there = leaf.search("footprint") if leaf else None
            at = there.at if there else Location("")
            yield finding(
                "warning", "footprint-beside-center", at, there.path if there else f"{name}/footprint", message
            )


def base_frames_agree(s: Subject) -> Iterator[Finding]:
    """Both costmaps are about one robot."""
    frames = {name: c[0].robot_base_frame for name, c in s.costmaps.items()}
    if len(set(frames.values())) > 1:
        message = (
            f"the costmaps are about different frames of the robot: {frames['global_costmap']} (global) and "
            f"{frames['local_costmap']} (local); write the same robot_base_frame in both"
        )
        yield _say(s, "warning", "base-frames-differ", "local_costmap", ("robot_base_frame",), message)


def unknown_is_tracked(s: Subject) -> Iterator[Finding]:
    """allow_unknown: false keeps robots out of unknown space only where some layer says what is unknown."""
    params = s.global_planner[2]
    costmap, _, layers = s.costmaps["global_costmap"]
    if getattr(params, "allow_unknown", True) is not False or costmap.track_unknown_space:
        return
    if any(getattr(p, "track_unknown_space", False) for _, _, p in layers):
        return
    message = (
        "allow_unknown: false has no effect: no layer of the global costmap tracks unknown space; write "
        "track_unknown_space: true in the global costmap"
    )
    yield _say(s, "warning", "unknown-not-tracked", s.global_space, ("allow_unknown",), message, None, params)


def updates_keep_up(s: Subject) -> Iterator[Finding]:
    """Between two updates of the local costmap the robot steers by old obstacles."""
    params = s.costmaps["local_costmap"][0]
    rate, control = params.update_frequency, s.move_base.controller_frequency
    speed = getattr(s.local_planner[2], "max_vel_x", None)
    if speed is None or rate <= 0.0 or rate >= control:
        return
    if speed / rate > s.costmaps["local_costmap"][1].inscribed_radius:
        message = (
            f"the local costmap is updated at {rate:g} Hz, so the robot drives up to {speed / rate:.3g} m between two updates "
            f"(max_vel_x {speed:g} m/s), more than its inscribed radius of "
            f"{s.costmaps['local_costmap'][1].inscribed_radius:.3g} m; raise update_frequency to {control:g}"
        )
        yield _say(s, "warning", "updates-too-slow", "local_costmap", ("update_frequency",), message, f"{control:g}")


def simulated_sensors_are_heard(s: Subject) -> Iterator[Finding]:
    """A simulated lidar that no source takes leaves the simulated robot blind."""
    lidars: Mapping[str, Any] = getattr(s.sim, "lidars", None) or {}
    sources = [
        (f"{name}/{layer}/{source}", (getattr(p, "topic", "") or source).strip("/"), p)
        for name, (_, _, layers) in s.costmaps.items()
        for layer, _, params in layers
        for source, p in _sources(params).items()
    ]
    if not lidars or not sources:
        return
    why = ""
    at, names = sources[0][0], ("topic",)
    for lidar in lidars.values():
        for space, topic, p in sources:
            if topic != lidar.topic.strip("/"):
                continue
            heights = _get(p, "min_obstacle_height", "max_obstacle_height") or [-math.inf, math.inf]
            if getattr(p, "data_type", "LaserScan") != "LaserScan":
                why, at, names = f"its data_type is {p.data_type}, not LaserScan", space, ("data_type", "topic")
            elif not heights[0] <= lidar.height <= heights[1]:
                why = (
                    f"it keeps heights from {heights[0]:g} to {heights[1]:g} m, and the lidar is at {lidar.height:g} m"
                )
                at, names = space, ("min_obstacle_height", "max_obstacle_height")
            else:
                return
    name, first = next(iter(lidars.items()))
    if why:
        message = f"{at} does not take what the simulated robot's lidar sees on {first.topic}: {why}; "
        message += f"correct it, or set navstack/sim/{name}"
    else:
        listed = ", ".join(sorted({topic for _, topic, _ in sources}))
        message = f"the simulated robot's lidar publishes on {first.topic}, but the costmaps listen to {listed}; "
        message += f"set navstack/sim/{name}/topic"
    yield _say(s, "warning", "simulated-robot-blind", at, names, f"in simulation the robot sees nothing: {message}")


# --- recoveries -------------------------------------------------------------------------------------------------------


def recovery_layers_exist(s: Subject) -> Iterator[Finding]:
    """Parity 18: a recovery that clears a layer nobody has clears nothing."""
    for name, _, params in s.recoveries:
        names = getattr(params, "layer_names", None)
        if not names:
            continue
        maps = getattr(params, "affected_maps", "both")
        looked = [c for c in s.costmaps if maps == "both" or c.startswith(str(maps))]
        there = [layer for c in looked for layer, _, _ in s.costmaps[c][2]]
        for wanted in names:
            if wanted in there:
                continue
            known = ", ".join(dict.fromkeys(there)) or "none"
            where = " and ".join(looked)
            message = (
                f'{name} is to clear the layer "{wanted}", which {where} {"do" if len(looked) > 1 else "does"} not have; '
                f"write one of: {known}; or leave layer_names out to clear every layer fed by sensors"
            )
            yield _say(s, "error", "no-such-layer", name, ("layer_names",), message)


RULES: tuple[Rule, ...] = (
    scoring_scale,
    window_holds_horizon,
    window_starts_moving,
    stops_within_horizon,
    minimum_over_maximum,
    samples_of_none,
    min_vel_trans_zero,
    tolerances,
    inflation_covers_robot,
    inflation_has_gradient,
    inflation_is_last,
    sensors_reach,
    local_window_moves,
    footprint_holds_center,
    base_frames_agree,
    unknown_is_tracked,
    updates_keep_up,
    simulated_sensors_are_heard,
    recovery_layers_exist,
)

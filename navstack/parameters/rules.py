"""Run the checks across parameters: those of each plugin in use (`ParamModel.check`) and those of the whole robot.

A rule of the whole robot is a function of the configuration with the decorator `rule`; those about both costmaps stand here,
others in `simulated_robot`, `rules_steering` and `rules_safety`; `rules_plugins` describes those of the plugins. `rules_page`
writes docs/reference/rules.md.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from navstack.parameters import rules_plugins, rules_safety, rules_steering, simulated_robot
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.tree import COSTMAPS, Leaf, Space
from navstack.plugins import RULES, CheckContext, CostmapSetup, Issue, ParamModel, Plugin, Problem, rule

RULE_MODULES: Final = (rules_plugins, rules_safety, rules_steering, simulated_robot)
"""Modules whose rules are registered by importing them."""

# --- running the rules ------------------------------------------------------------------------------------------------


def check_rules(configuration: Configuration, consequences: Mapping[str, list[str]] | None = None) -> list[Finding]:
    """Return the findings of every rule about a loaded configuration.

    `consequences` has an entry for each namespace that only has its defaults because its section is misspelt: what the rules
    say about those defaults is added there, for the finding about that section, and is no finding of its own.
    """
    consequences = consequences or {}
    global_costmap, local_costmap = configuration.costmaps
    found: list[Finding] = []
    for plugin, costmap in _plugins(configuration, global_costmap, local_costmap):
        own = CheckContext(
            plugin.name,
            configuration.navstack.ros_distro,
            configuration.move_base.controller_frequency,
            global_costmap,
            local_costmap,
            costmap,
        )
        found += _findings(
            configuration, plugin.namespace, plugin.params, lambda p=plugin, c=own: p.params.check(c), consequences
        )
    for one in list(RULES.values()):
        found += _findings(configuration, "", None, lambda one=one: one.issues(configuration), consequences)
    if any(f.rule == "scoring-scale" for f in found):  # it names the same cause, with numbers
        found = [f for f in found if f.rule != "dated-names"]
    return found


def _plugins(
    configuration: Configuration, global_costmap: CostmapSetup, local_costmap: CostmapSetup
) -> Iterator[tuple[Plugin[Any], CostmapSetup]]:
    """Every plugin in use and the costmap that its checks look at first."""
    yield configuration.local_planner, local_costmap
    yield configuration.global_planner, local_costmap
    if configuration.smoother is not None:
        yield configuration.smoother, local_costmap
    for layer in configuration.global_costmap.layers:
        yield layer, global_costmap
    for layer in configuration.local_costmap.layers:
        yield layer, local_costmap
    for recovery in configuration.recoveries:
        yield recovery, local_costmap


# --- issues -> findings -----------------------------------------------------------------------------------------------


def _findings(
    configuration: Configuration,
    namespace: str,
    params: ParamModel | None,
    check: Callable[[], Iterator[Issue]],
    consequences: Mapping[str, list[str]],
) -> Iterator[Finding]:
    """Locate the issues of one check. A check that raises is itself a finding: a plugin's fault must not stop loading."""
    root = configuration.tree
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
        message, (space, model, last) = issue.message, places[0]
        if issue.severity != "info" and _leaf(root, space, model, last) is None:
            if space in consequences:
                consequences[space].append(message.partition(";")[0])
                continue
            # a name that is written anywhere may be what the rule means: a namespace below, a searched parameter
            if not any(leaf.name == last for leaf in root.leaves()) and f"{space}/{last}" not in configuration.origins:
                what, separator, fix = message.partition("; ")
                message = f"{what} ({last} is not set, so this is about its default){separator}{fix}"
        yield finding(issue.severity, issue.rule, at, key, message, issue.suggestion)


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
    """The parameter as written, by its current or a previous name; the costmap's level wins where it overrides."""
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


# --- rules of both costmaps -------------------------------------------------------------------------------------------


@rule("fixed-window", "warning")
def local_costmap_moves(configuration: Configuration) -> Iterator[Problem]:
    """A local costmap that is neither a rolling window nor has a static map stays at the origin of its frame. Once
    the robot has left it, there is no valid command.

    Fix: `rolling_window: true`.
    """
    costmap = configuration.costmaps[1]
    if not costmap.rolling_window and not any(layer.traits.has_static_map for layer in costmap.layers):
        message = (
            "the local costmap does not follow the robot (rolling_window = false) and has no static map, so the robot drives "
            "out of it; set rolling_window: true"
        )
        yield Problem(("/local_costmap/rolling_window",), message, "true")


@rule("global-window", "info")
def global_costmap_covers_the_map(configuration: Configuration) -> Iterator[Problem]:
    """A global costmap that is a rolling window, or has no static layer, covers `width` x `height` only: around the
    robot, or from its origin. Goals outside are refused, and so is every goal of a robot that is itself outside.

    Fix: list a static layer and set `rolling_window: false`, so that the costmap takes the size of the map, or set width
    and height to the area of the goals.
    """
    p = configuration.global_costmap.params
    has_map = any(layer.traits.has_static_map for layer in configuration.costmaps[0].layers)
    if has_map and not p.rolling_window:
        return
    place = "around the robot" if p.rolling_window else f"from ({p.origin_x:g}, {p.origin_y:g})"
    fix = (
        "set rolling_window: false"
        if has_map
        else 'list a static layer ({name: static_layer, type: "costmap_2d::StaticLayer"})'
    )
    message = (
        f"the global costmap covers {p.width:g} x {p.height:g} m {place}, and goals outside are refused; {fix} for the whole "
        "map, or set width and height"
    )
    yield Problem(("/global_costmap/width", "/global_costmap/rolling_window", "/global_costmap/plugins"), message)


@rule("blind", "warning")
def local_costmap_sees(configuration: Configuration) -> Iterator[Problem]:
    """No layer of the local costmap receives sensor data (no `observation_sources`, or the layer is disabled), so no
    obstacle is avoided.

    Fix: add an obstacle layer and list its source.
    """
    layers = configuration.costmaps[1].layers
    if layers and not any(layer.traits.fed_by_sensors for layer in layers):
        message = (
            "no layer of the local costmap receives sensor data, so the robot avoids no obstacles; add an obstacle layer with "
            "observation_sources"
        )
        yield Problem(("/local_costmap/plugins",), message)


@rule("default-footprint", "warning")
def footprint_is_given(configuration: Configuration) -> Iterator[Problem]:
    """Neither `footprint` nor `robot_radius` is set for a costmap, so the robot is a disc of 0.46 m, the default of ROS:
    too large for most doors, and too small for a large robot. Example: `radius: 0.4`, which no layer reads.

    Fix: `robot_radius: 0.2`, or `footprint: [[x, y], ..]`, for both costmaps.
    """
    for name in COSTMAPS:
        space = configuration.tree.space(name)
        if space is None or any(space.search(key) is not None for key in ("footprint", "robot_radius")):
            continue
        radius = getattr(configuration, name).params.robot_radius
        message = (
            f"neither footprint nor robot_radius of {name} is set, so the robot is a disc with the default radius of ROS, "
            f"{radius:g} m; set robot_radius or footprint to those of the robot"
        )
        yield Problem((f"/{name}/plugins", f"/{name}/global_frame"), message)


@rule("dated-names", "info")
def names_tell_the_scoring(configuration: Configuration) -> Iterator[Problem]:
    """Navigation 1.16.0 (2018-07-25) renamed the speeds of DWAPlannerROS (`max_trans_vel`, `max_rot_vel` and others) and
    changed the scale of its scores. A file with the previous names only was tuned for the previous scale, in which
    obstacles weigh a tenth at 0.05 m. With `ros_distro: noetic` the robot may stop or turn in place near obstacles.

    Fix: `navstack: {ros_distro: indigo}` (`--distro indigo`), or the current names where the weights suit Noetic.
    """
    planner = configuration.local_planner
    space = configuration.tree.space(planner.namespace)
    if planner.name != "dwa" or space is None or configuration.navstack.ros_distro == "indigo":
        return
    former = [name for name in _SPEEDS_BEFORE_2018 if space.leaf(name) is not None]
    if not former or any(space.leaf(name) is not None for name in _SPEEDS_BEFORE_2018.values()):
        return
    names = f"{former[0]} is a name" if len(former) == 1 else f"{' and '.join(former[:2])} are names"
    message = (
        f"{names} from before 2018, when obstacles weighed less against the path and the goal, but the weights are scored as "
        "ros_distro noetic does; if the robot stops or turns in place near obstacles, set navstack/ros_distro to indigo "
        "(--distro indigo)"
    )
    yield Problem((f"/{planner.namespace}/{former[0]}",), message)


_SPEEDS_BEFORE_2018: Final = {
    "max_trans_vel": "max_vel_trans",
    "min_trans_vel": "min_vel_trans",
    "max_rot_vel": "max_vel_theta",
    "min_rot_vel": "min_vel_theta",
    "rot_stopped_vel": "theta_stopped_vel",
}
"""Names of DWAPlannerROS that no release since navigation 1.16.0 reads -> its current names."""


_MOST_PATH_PER_GOAL: Final = 3.0
"""The turtlebot's weights, which drive, are 2.7."""
_PATH_PER_GOAL: Final = 4.0 / 3.0
"""The ratio of ROS's defaults before 2018, 32 and 24, from which most robots' weights come; 0.75 since then."""


@rule("heavy-path", "info")
def path_outweighs_the_goal(configuration: Configuration) -> Iterator[Problem]:
    """`path_distance_bias` is more than three times `goal_distance_bias`: a trajectory that leaves the path by a cell costs
    more than it gains by driving on, so the robot turns in place until it is aligned with each piece of the plan, or
    stops where the plan bends.

    Fix: about 4/3 of `goal_distance_bias`, the ratio of ROS's defaults before 2018.
    """
    planner = configuration.local_planner
    path, goal = (getattr(planner.params, f"{what}_distance_bias", 0.0) for what in ("path", "goal"))
    if path <= _MOST_PATH_PER_GOAL * goal or goal <= 0.0:
        return
    better = f"{_PATH_PER_GOAL * goal:.6g}"
    message = (
        f"path_distance_bias = {path:g} is {path / goal:.1f} times goal_distance_bias = {goal:g}: staying on the path "
        f"outweighs progress, so the robot may turn in place or stop where the plan bends; set it to {better}"
    )
    yield Problem((f"/{planner.namespace}/path_distance_bias",), message, better)


@rule("footprint-beside-center", "warning")
def footprint_contains_center(configuration: Configuration) -> Iterator[Problem]:
    """The footprint does not contain (0, 0), the robot's center of rotation: its inscribed radius is the distance to
    an edge outside of it, and costs are meaningless. A typical cause is measuring the corners from a corner of the
    robot.

    Fix: subtract the center.
    """
    for name, costmap in zip(COSTMAPS, (configuration.global_costmap, configuration.local_costmap)):
        if not costmap.footprint.contains_center:
            message = (
                "the footprint does not contain the robot's center (0, 0), so its inscribed radius and all inflated costs are "
                "wrong; give the corners in the robot's base frame"
            )
            yield Problem((f"/{name}/footprint", "/footprint"), message)


@rule("base-frames-differ", "warning")
def base_frames_agree(configuration: Configuration) -> Iterator[Problem]:
    """The two costmaps use different frames of the robot: plans and obstacles are offset by the difference.

    Fix: use one robot_base_frame.
    """
    one = configuration.global_costmap.params.robot_base_frame
    other = configuration.local_costmap.params.robot_base_frame
    if one != other:
        message = (
            f"robot_base_frame differs between the costmaps: {one} (global), {other} (local); use one frame in both"
        )
        yield Problem(("/local_costmap/robot_base_frame",), message)


# --- the page ---------------------------------------------------------------------------------------------------------

_INTRO: Final = """# Rules across parameters

Parameters can be valid one by one and still fail together on a robot. `navstack check` looks for the combinations below and
reports the robot's own numbers; the name of the rule follows each finding in brackets. Threads in which users met the problem
are listed. This page is written by `tools/rules_page.py` from the rules themselves; see [Your own rules](#your-own-rules).
"""
_OWN: Final = '''## Your own rules

A rule is a method of the parameter model that it concerns, with the decorator `rule`; its docstring is its documentation:

```python
from collections.abc import Iterator

from navstack.plugins import CheckContext, ParamModel, Problem, param, rule


class MyLayerParams(ParamModel):
    """`<costmap>/my_layer:`."""

    radius: float = param(0.5, "distance up to which costs are added", unit="m", ge=0.0)

    @rule("my-layer-radius", "warning")
    def check_radius(self, context: CheckContext) -> Iterator[Problem]:
        """The radius does not cover the robot, so its corners touch obstacles."""
        needed = context.costmap.footprint.circumscribed_radius
        if self.radius < needed:
            message = (
                f"radius = {self.radius:g} m is less than the circumscribed radius; set it to {needed:.2f} m or more"
            )
            yield Problem(("radius",), message, f"{needed:.2f}")
```

`CheckContext` describes both costmaps with their layers and footprints. A layer states in `Layer.traits` what other checks need
to know about it: whether it is fed by sensors, has a static map, inflates or tracks unknown space.
'''


def rules_page() -> str:
    """Return docs/reference/rules.md: a section for each rule of navstack, in alphabetical order."""
    parts = [_INTRO]
    for name, one in sorted(RULES.items()):
        if not one.module.startswith("navstack."):
            continue
        paragraphs = [" ".join(p.split("\n")) for p in one.text.split("\n\n")]
        lines = [
            line
            for p in paragraphs
            for line in (*textwrap.wrap(p, 118, break_long_words=False, break_on_hyphens=False), "")
        ]
        parts.append("\n".join([f"## {name}", "", f"*{one.severity.capitalize()}.*", "", *lines]))
    return "\n".join([*parts, _OWN])

"""Load parameters into a typed configuration of the whole robot, or check them."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from navstack.core import Footprint, InputError, ParameterError, UnknownPluginError
from navstack.parameters.binding import Binder, show
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration, NavstackParams
from navstack.parameters.findings import Finding, Location, finding, in_order
from navstack.parameters.foreign import FOREIGN_LOCAL_PLANNERS
from navstack.parameters.models.move_base import CostmapParams, MoveBaseParams, builtin_recoveries
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nodes import load_docking, load_localization, load_safety, unwrap_ros2
from navstack.parameters.plugin_lists import (
    ListedPlugin,
    PluginLists,
    fixed_list,
    mark_used,
    own_namespaces,
    planner_namespaces,
    planner_space,
    shared_namespaces,
    short_type,
)
from navstack.parameters.rules import check_rules
from navstack.parameters.simulated_robot import simulated
from navstack.parameters.sources import Override, Source, read_sources, to_node
from navstack.parameters.spelling import nearest
from navstack.parameters.stand_in import stand_in
from navstack.parameters.tree import COSTMAPS, Leaf, Space
from navstack.parameters.unused import meant_sections, unused_parameters, with_consequences
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.plugins import (
    CRITICS,
    GLOBAL_PLANNERS,
    LAYERS,
    LOCAL_PLANNERS,
    RECOVERY_BEHAVIORS,
    SMOOTHERS,
    GlobalPlanner,
    Layer,
    Plugin,
    PluginSpec,
    RecoveryBehavior,
    Registry,
    Smoother,
)

if TYPE_CHECKING:
    from navstack.parameters.lidar_description import DescribedLidar
    from navstack.parameters.models.sim import SimParams

# ----------------------------------------------------------------------------------------------------------------------
# Convert costmap parameters from before ROS Hydro: without `plugins`, with all parameters at the costmap's own level.
#
# Source: costmap_2d/src/costmap_2d_ros.cpp, loadOldParameters.


_VOXEL = ("origin_z", "z_resolution", "z_voxels", "mark_threshold", "unknown_threshold", "publish_voxel_map")
_STATIC = ("map_topic", "unknown_cost_value", "lethal_cost_threshold")
_OBSTACLE = ("max_obstacle_height", "raytrace_range", "obstacle_range")
_INFLATION = ("cost_scaling_factor", "inflation_radius")


def convert_pre_hydro(costmap: Space, findings: list[Finding]) -> None:
    """Add `plugins` to a costmap that has none and move the parameters into the namespaces of the layers."""
    if "plugins" in costmap.children:
        return
    static = _take_flag(costmap, "static_map")
    voxel = _take_text(costmap, "map_type") == "voxel"
    layers: list[tuple[str, str]] = []
    moved: list[str] = []
    if static:
        layers.append(("static_layer", "costmap_2d::StaticLayer"))
        _move(costmap, "static_layer", _STATIC, moved)
        _copy(costmap, "static_layer", "track_unknown_space")
    layers.append(("obstacle_layer", "costmap_2d::VoxelLayer" if voxel else "costmap_2d::ObstacleLayer"))
    if voxel:
        _move(costmap, "obstacle_layer", _VOXEL, moved)
    _move(costmap, "obstacle_layer", _OBSTACLE, moved)
    if costmap.leaf("track_unknown_space") is not None:
        _copy(costmap, "obstacle_layer", "track_unknown_space")
    sources = costmap.leaf("observation_sources")
    if sources is not None and isinstance(sources.value, str):
        _move(costmap, "obstacle_layer", tuple(sources.value.split()), moved)
    _move(costmap, "obstacle_layer", ("observation_sources",), moved)
    layers.append(("inflation_layer", "costmap_2d::InflationLayer"))
    _move(costmap, "inflation_layer", _INFLATION, moved)
    at = costmap.at
    costmap.put("plugins", at, _plugin_list(layers, at))
    listed = ", ".join(name for name, _ in layers)
    also = f", which use its {', '.join(moved)}" if moved else ""
    message = (
        f"{costmap.path} has no `plugins`, so it is converted as before ROS Hydro to the layers {listed}{also}; list the "
        "layers under `plugins`"
    )
    findings.append(finding("info", "pre-hydro", at, costmap.path, message, "plugins"))


def _take_flag(space: Space, name: str) -> bool:
    leaf = space.leaf(name)
    if leaf is None:
        return False
    leaf.used = True
    return leaf.value is True


def _take_text(space: Space, name: str) -> str:
    leaf = space.leaf(name)
    if leaf is None:
        return ""
    leaf.used = True
    return leaf.value if isinstance(leaf.value, str) else ""


def _move(costmap: Space, layer: str, names: tuple[str, ...], moved: list[str]) -> None:
    """Move parameters and namespaces into the layer's namespace, replacing those of the same name."""
    for name in names:
        child = costmap.children.pop(name, None)
        if child is None:
            continue
        moved.append(name)
        _graft(costmap.ensure(layer, child.at), name, child)


def _graft(into: Space, name: str, child: Leaf | Space) -> None:
    if isinstance(child, Leaf):
        into.put(name, child.at, child.node)
        return
    into.children.pop(name, None)
    space = into.ensure(name, child.at)
    for key, below in child.children.items():
        _graft(space, key, below)


def _copy(costmap: Space, layer: str, name: str) -> None:
    leaf = costmap.leaf(name)
    if leaf is not None:
        leaf.used = True
        costmap.ensure(layer, leaf.at).put(name, leaf.at, leaf.node)


def _plugin_list(layers: list[tuple[str, str]], at: Location) -> ListNode:
    def entry(name: str, kind: str) -> Node:
        return DictNode(
            {"name": (at, ScalarNode(name, at, text=name)), "type": (at, ScalarNode(kind, at, text=kind))}, at
        )

    return ListNode([entry(n, t) for n, t in layers], at)


# ----------------------------------------------------------------------------------------------------------------------
# The robot's footprint from parameters, in the order of costmap_2d/src/footprint.cpp (makeFootprintFromParams).


ROS1_DISTROS = ("noetic", "indigo")
DEFAULT_RADIUS = 0.46
_NUMBER = r"\s*[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\s*"
_POINT = re.compile(rf"\[{_NUMBER},{_NUMBER}\]")
_POINTS = re.compile(rf"\s*\[\s*{_POINT.pattern}(?:\s*,\s*{_POINT.pattern})*\s*,?\s*\]\s*\Z")


@dataclass(frozen=True, slots=True)
class LoadedFootprint:
    """The footprint with and without padding, and the parameter it was read from (None: the default)."""

    padded: Footprint
    true: Footprint
    origin: Leaf | None


def parse_footprint(value: Any) -> list[list[float]]:
    """Convert `[[x, y], ..]` or its text to points; raise ValueError for anything else."""
    if isinstance(value, str):
        if not _POINTS.match(value):
            raise ValueError(f'footprint = "{value[:60]}" is not a list of points; write [[x, y], [x, y], [x, y], ..]')
        return [[float(n) for n in p.strip("[]").split(",")] for p in _POINT.findall(value)]
    if not isinstance(value, list):
        raise ValueError(f"footprint = {value!r} is not a list of points; write [[x, y], [x, y], [x, y], ..]")
    points: list[list[float]] = []
    for i, point in enumerate(value):
        numbers = isinstance(point, list) and all(
            isinstance(n, (int, float)) and not isinstance(n, bool) for n in point
        )
        if not numbers or len(point) != 2:
            raise ValueError(f"point {i + 1} of the footprint is {point!r}; write two numbers [x, y] in meters")
        points.append([float(n) for n in point])
    return points


def footprint_of(costmap: Space, padding: float, findings: list[Finding]) -> LoadedFootprint | None:
    """Return the footprint of a costmap, None after an error.

    The nearest `footprint` up the tree, otherwise the nearest `robot_radius`, otherwise 0.46 m.
    """
    leaf = costmap.search("footprint")
    if leaf is not None:
        leaf.used = True
        value = leaf.value
        if value is not None and value != [] and not (isinstance(value, str) and value.strip() in ("", "[]")):
            return _polygon(leaf, value, padding, findings)
    leaf = costmap.search("robot_radius")
    if leaf is None:
        return _load(lambda p: Footprint.from_radius(DEFAULT_RADIUS, p), padding, None, findings)
    leaf.used = True
    radius = leaf.value
    if isinstance(radius, bool) or not isinstance(radius, (int, float)) or radius < 0.0:
        return None  # reported with the costmap's other parameters
    if not radius > 0.0:
        message = f"robot_radius = {radius:g} is not positive; set it to the robot's radius in meters"
        findings.append(finding("error", "footprint", leaf.node.at, leaf.path, message))
        return None
    return _load(lambda p: Footprint.from_radius(float(radius), p), padding, leaf, findings)


def _polygon(leaf: Leaf, value: Any, padding: float, findings: list[Finding]) -> LoadedFootprint | None:
    try:
        points = parse_footprint(value)
    except ValueError as exc:
        findings.append(finding("error", "footprint", leaf.node.at, leaf.path, str(exc)))
        return None
    return _load(lambda p: Footprint(np.array(points, np.float64), p), padding, leaf, findings)


def _load(
    make: Callable[[float], Footprint], padding: float, leaf: Leaf | None, findings: list[Finding]
) -> LoadedFootprint | None:
    try:
        return LoadedFootprint(make(padding), make(0.0), leaf)
    except InputError as exc:
        if leaf is not None:
            findings.append(finding("error", "footprint", leaf.node.at, leaf.path, exc.message))
        return None


# ----------------------------------------------------------------------------------------------------------------------
# Sources of parameters -> typed configuration with all findings; errors do not stop the search for further errors.


_USUAL_WORDS = frozenset(
    {"params", "param", "common", "costmap", "local", "global", "planner", "base", "move", "launch", "config", "robot"}
)
"""Words of the names of parameter files that do not say which robot is meant."""


class Loader:
    """Loads one set of sources."""

    def __init__(
        self, sources: Sequence[Source], overrides: Sequence[str | Override], distro: str | None, allow_missing: bool
    ) -> None:
        read = read_sources(
            [sources] if isinstance(sources, str) else sources,
            overrides,
            distro=distro if distro in NAV2_DISTROS else None,
            substitute=allow_missing,
        )
        self.root = read.root
        self.findings = read.findings
        self.files = read.files
        self.overrides = frozenset(read.overrides)
        self._sources = read
        self._lidar_file = ""
        """The file that describes the simulated lidars; empty if none does."""
        self.complete = not any(f.severity == "error" for f in read.findings)
        """False if a source could not be read: rules about missing parameters would mislead."""
        self.not_in_use: list[Space] = []
        """Namespaces of planners that are not selected."""
        self.default_planners: dict[str, Finding] = {}
        """Namespace of a planner that is used because none is selected -> the warning about that."""
        self.translation = read.translation
        self.distro = self._ros1_distro(distro)
        self.binder = Binder(self.findings)
        self.plugins = PluginLists(self.binder, self.findings, allow_missing=allow_missing)

    def _ros1_distro(self, distro: str | None) -> str | None:
        """The distribution of ROS 1, None for files of Nav2; one that nobody knows is reported."""
        if self.translation is None:
            return distro
        if distro is not None and distro not in (*NAV2_DISTROS, *ROS1_DISTROS):
            close = nearest(distro, NAV2_DISTROS)
            hint = f"did you mean {close}? " if close else ""
            message = f"--distro {distro} is not a distribution of Nav2; {hint}known: {', '.join(NAV2_DISTROS)}"
            self.findings.append(finding("error", "nav2-distro", Location("--distro"), "", message, close))
        return None

    def load(self) -> tuple[Configuration | None, list[Finding]]:
        """Return the configuration, None if it cannot be used, and all findings in order."""
        configuration = self._load()
        findings = in_order(self._of_nav2() if self.translation is not None else self.findings)
        if configuration is None:
            return None, findings
        return replace(configuration, findings=tuple(findings)), findings

    def _of_nav2(self) -> list[Finding]:
        """The findings with the keys of the user's Nav2 files; without those about defaults, and those that were made before."""
        assert self.translation is not None
        wrong = {f.location for f in self.findings if f.rule.startswith("nav2-") and f.severity == "error" and f.line}
        kept: list[Finding] = []
        for f in self.findings:
            own = f.rule.startswith("nav2-")
            of_default = f.file == self.translation.default_file and f.severity != "error"
            of_filter = f.rule == "inflation-not-last" and f.message.partition(" ")[0] in self.translation.filters
            if own or not (of_default or of_filter or f.location in wrong):
                kept.append(f if own else self.translation.own_key(f))
        return kept

    def _check_unused_of_nav2(self) -> None:
        """Check the values of the controllers and planners of a Nav2 file that are not in use."""
        for registry, kind, space, name in self.translation.unused if self.translation is not None else ():
            found: list[Finding] = []
            entry = registry.get(kind)
            fixed: dict[str, Any] | None = None
            if "critics" in entry.cls.Params.model_fields and space.leaf("critics") is not None:
                listed = PluginLists(Binder([]), [], allow_missing=True).read(space, "critics", CRITICS)
                fixed = fixed_list(space, "critics", listed)
            Binder(found, self.binder.navstack).bind(entry.cls.Params, space, fixed=fixed, strictness="warning")
            self.findings += [replace(f, message=f"{name}: {f.message}") for f in found if f.severity != "info"]

    def _load(self) -> Configuration | None:
        if not self.root.children and not self.complete:
            return None  # nothing was loaded: further findings would be consequences
        if self.plugins.allow_missing and self.translation is None:
            self.findings += stand_in(self.root)
        if self.translation is not None:
            self._check_unused_of_nav2()
            if any(self.root.leaf(key) is None for key in ("base_local_planner", "base_global_planner")):
                return None  # reported by the translation
        navstack = self._navstack()
        self.binder.navstack = {"ros_distro": navstack.ros_distro if navstack else "noetic"}
        for name in COSTMAPS:
            self._prepare_costmap(name)
        parts: dict[str, Any] = {name: self._costmap(name) for name in COSTMAPS}
        listed = self.plugins.read_recoveries(self.root)
        move_base: Any = self.binder.bind(
            MoveBaseParams, self.root, fixed=fixed_list(self.root, "recovery_behaviors", listed)
        )
        parts["move_base"] = move_base
        parts["global_planner"] = self._planner(GLOBAL_PLANNERS, "base_global_planner")
        parts["local_planner"] = self._planner(LOCAL_PLANNERS, "base_local_planner")
        smoother = self._smoother()
        parts["recoveries"] = self._recoveries(listed, move_base, parts["local_costmap"])
        parts["navstack"] = navstack
        parts["safety"] = load_safety(self.root, self.binder, self.findings)
        parts["localization"] = load_localization(self.root, self.binder, self.findings)
        for_trees = self._for_trees()
        docking, docking_usable = load_docking(self.root, self.binder, self.findings)
        meant = meant_sections(self.root, self.binder)
        self._check_unselected_planners({section.path for section in meant})
        configuration = None
        consequences: dict[str, list[str]] = {space.path: [] for space in meant.values()}
        consequences |= {path: [] for path in self.default_planners}
        if docking_usable and all(part is not None for part in parts.values()):
            configuration = Configuration(
                **parts,
                smoother=smoother,
                docking=docking,
                **for_trees,
                findings=(),
                tree=self.root,
                origins=self.binder.origins,
                nav2_ids=self.translation.ids if self.translation is not None else {},
                nav2_distro=self.translation.distro if self.translation is not None else "",
            )
            sim = simulated(configuration, self._described)
            if self._lidar_file:
                self._write_lidars(sim)
            configuration = replace(configuration, navstack=configuration.navstack.model_copy(update={"sim": sim}))
            if self.complete:
                self.findings += check_rules(configuration, consequences)
        sections = tuple(f"{space.path}/" for space in self.not_in_use)
        for path, found in self.default_planners.items():
            self.findings.append(with_consequences(found, consequences[path]))
        unused = unused_parameters(self.root, self.binder, self.overrides, meant, consequences)
        self.findings += [f for f in unused if f.severity != "info" or not f.key.startswith(sections)]
        wrong = [f.key for f in unused if f.rule == "override"]
        self.findings = [
            replace(f, severity="warning") if self._is_idle_override(f) and not _is_above(f.key, wrong) else f
            for f in self.findings
        ]
        return configuration

    def _is_idle_override(self, found: Finding) -> bool:
        """True for a note that an override has no effect: in a file that is usual, but an override is meant to have one now."""
        is_idle = found.severity == "info" and found.rule in ("not-in-use", "no-effect")
        return is_idle and found.file in self.overrides

    def _described(self) -> list[DescribedLidar]:
        """The lidars that the robot's own files describe."""
        from navstack.parameters.lidar_description import described_lidars  # only for robots that do not say

        read = self._sources
        words = {word for file in read.files for word in Path(file).stem.lower().split("_")} - _USUAL_WORDS
        hints = [
            *(value for value in read.arguments.values() if len(value) > 2),
            *sorted(w for w in words if len(w) > 3),
        ]
        found = described_lidars(sorted(read.named), read.descriptions, hints)
        for lidar in found:
            if lidar.filtered:
                continue
            message = (
                f"the lidar on {lidar.topic} is simulated as this file describes it: {math.degrees(lidar.fov):.0f} degrees, "
                f"{lidar.beams} beams, {lidar.range_min:g} to {lidar.range_max:g} m, at ({lidar.x:g}, {lidar.y:g}) m; "
                "navstack/sim sets other values"
            )
            self._lidar_file = lidar.file
            self.findings.append(finding("info", "described-lidar", Location(lidar.file), "", message))
        return found

    def _write_lidars(self, sim: SimParams) -> None:
        """Write described lidars into the tree: a record, which keeps the tree, does not depend on the file later."""
        at = Location(self._lidar_file)
        space = self.root.ensure("navstack", at).ensure("sim", at)
        values: dict[str, dict[str, Any]] = {name: sim.lidar(name).model_dump() for name in sim.lasers}
        space.put("lasers", at, to_node(list(values), at)).used = True
        self.binder.origins[space.join("lasers")] = at
        for name, params in values.items():
            below = space.ensure(name, at)
            for key, value in params.items():
                if below.leaf(key) is None:
                    below.put(key, at, to_node(value, at)).used = True
                    self.binder.origins[below.join(key)] = at

    # --- parts --------------------------------------------------------------------------------------------------------

    def _navstack(self) -> NavstackParams | None:
        space = self.binder.child(self.root, "navstack")
        nodes = None
        if self.distro is not None:
            at = Location("--distro")
            nodes = {"ros_distro": (at, ScalarNode(self.distro, at, True, self.distro))}
            leaf = space.leaf("ros_distro")
            if leaf is not None:
                leaf.used = True
        params: Any = self.binder.bind(NavstackParams, space, nodes=nodes)
        return params

    def _prepare_costmap(self, name: str) -> None:
        space = self.binder.child(self.root, name)
        if self.root.children.get(name) is not space:
            space.at = Location(self.files[0] if self.files else "")
            self.root.children[name] = space
        before = len(self.findings)
        convert_pre_hydro(space, self.findings)
        if not self.complete:  # the list may be in the source that could not be read
            del self.findings[before:]

    def _costmap(self, name: str) -> CostmapConfiguration | None:
        space = self.root.ensure(name, self.root.at)
        listed = self.plugins.read(space, "plugins", LAYERS)
        params: Any = self.binder.bind(CostmapParams, space, fixed=fixed_list(space, "plugins", listed))
        padding = params.footprint_padding if params is not None else 0.0
        before = len(self.findings)
        footprint = footprint_of(space, padding, self.findings)
        # the footprint's own finding replaces the less specific ones of the model
        reported = {f.key for f in self.findings[before:] if f.rule == "footprint"}
        self.findings[:] = [f for f in self.findings if f.rule == "footprint" or f.key not in reported]
        self._check_radius(space, footprint)
        layers = self._layers(space, listed)
        if listed is None:  # without the list it is unknown what the layers read
            for leaf in space.leaves():
                leaf.used = True
        if params is None or footprint is None or layers is None:
            return None
        return CostmapConfiguration(params, footprint.padded, footprint.true, layers)

    def _check_radius(self, space: Space, footprint: LoadedFootprint | None) -> None:
        """Report an override of the radius of a robot whose footprint takes precedence."""
        radius = space.search("robot_radius")
        polygon = footprint.origin if footprint is not None else None
        if radius is None or radius.at.file not in self.overrides or polygon is None or polygon.name != "footprint":
            return
        message = (
            f"{radius.path} = {show(radius.value)} sets nothing: footprint ({polygon.at}) takes precedence; override "
            f"{polygon.path}, or empty it: {polygon.path}=[]"
        )
        self.findings.append(finding("error", "override", radius.at, radius.path, message))

    def _layers(self, space: Space, listed: list[ListedPlugin] | None) -> tuple[Plugin[Layer], ...] | None:
        layers: list[Plugin[Layer]] = []
        good = listed is not None
        for plugin in listed or ():
            entry = self.plugins.find(LAYERS, plugin)
            if entry is None:
                mark_used(space, plugin.name)
                good = False
                continue
            params = self.binder.bind(entry.cls.Params, self.binder.child(space, plugin.name))
            if params is None:
                good = False
                continue
            layers.append(Plugin(plugin.name, entry.cls, params, f"{space.path}/{plugin.name}"))
        return tuple(layers) if good else None

    # --- planners -----------------------------------------------------------------------------------------------------

    def _planner(self, registry: Registry[Any], key: str) -> Plugin[Any] | None:
        leaf = self.root.leaf(key)
        written = leaf.value if leaf is not None else MoveBaseParams.model_fields[key].default
        if not isinstance(written, str):
            return None  # its type is reported with move_base's other parameters
        if leaf is None and self.complete:
            self._report_default(registry, key, written)
        if leaf is None and written not in registry:
            known = ", ".join(entry.ros_name for entry in registry)
            message = (
                f'{key} is not set, and the default of ROS, "{written}", is not available; set it to one of: {known}'
            )
            self.findings.append(finding("error", "unknown-plugin", Location(self._move_base_file()), key, message))
            return None
        entry = self.plugins.find(registry, ListedPlugin(key, written, leaf.node.at if leaf else self.root.at, key))
        if entry is None:
            mark_used(self.root, short_type(written))
            return None
        space = planner_space(self.root, entry, written)
        if self.root.children.get(space.name) is not space:
            space = self.binder.child(self.root, space.name)
        fixed: dict[str, Any] | None = None
        critics = entry.cls.Params.model_fields.get("critics")
        if (
            critics is not None and critics.annotation == list[PluginSpec] | None
        ):  # DWB lists names, and has its own rule
            listed = self.plugins.read(space, "critics", CRITICS)
            known = [self.plugins.find(CRITICS, plugin) is not None for plugin in listed or ()]
            fixed = fixed_list(space, "critics", listed if all(known) else None)
        params: Any = self.binder.bind(entry.cls.Params, space, fixed=fixed)
        return None if params is None else Plugin(entry.name, entry.cls, params, space.path)

    def _smoother(self) -> Plugin[Any] | None:
        """The smoother of the plans; None if none is selected, or it cannot be used (reported)."""
        leaf = self.root.leaf("base_smoother")
        return None if leaf is None or leaf.value is None else self._planner(SMOOTHERS, "base_smoother")

    def _for_trees(self) -> dict[str, Any]:
        """What only behavior trees use: further behaviors, smoothers by their ids, the graph of routes."""
        behaviors = [
            self._recovery(p, {}) for p in self.plugins.read(self.root, "behavior_plugins", RECOVERY_BEHAVIORS) or ()
        ]
        routes = self._server_section("route_server")
        for leaf in routes.leaves() if routes is not None else ():
            leaf.used = True
        return {
            "behaviors": tuple(behavior for behavior in behaviors if behavior is not None),
            "smoothers": tuple(self._smoothers()),
            "route_server": {} if routes is None else routes.as_dict(),
        }

    def _smoothers(self) -> Iterator[Plugin[Smoother]]:
        server = self._server_section("smoother_server")
        if server is None:
            return
        for plugin in self.plugins.read(server, "smoother_plugins", SMOOTHERS) or ():
            entry = self.plugins.find(SMOOTHERS, plugin)
            if entry is None:
                mark_used(server, plugin.name)
                continue
            params = self.binder.bind(entry.cls.Params, self.binder.child(server, plugin.name))
            if params is not None:
                yield Plugin(plugin.name, entry.cls, params, f"{server.path}/{plugin.name}")

    def _server_section(self, name: str) -> Space | None:
        if self.root.space(name) is None:
            return None
        space = self.binder.child(self.root, name)
        unwrap_ros2(space, self.findings)
        return space

    def _move_base_file(self) -> str:
        """The file in which a missing parameter of move_base is expected."""
        return next((f for f in self.files if "move_base" in f), self.files[0] if self.files else "")

    def _report_default(self, registry: Registry[Any], key: str, default: str) -> None:
        """Report that a planner is not selected; a warning if the parameters of another one are written."""
        sections = [(entry.ros_name, name) for entry in registry for name in planner_namespaces(entry)]
        if registry is LOCAL_PLANNERS:
            sections += [("", name) for name in sorted(FOREIGN_LOCAL_PLANNERS)]
        others = [(ros, space) for ros, name in sections if (space := self.root.space(name)) and space.children]
        if any(space.name in planner_namespaces(registry.get(default)) for _, space in others if default in registry):
            others = []
        message = f'{key} is not set, so the default of ROS, "{default}", is in use'
        if not others:
            self.findings.append(finding("info", "default-planner", Location(self._move_base_file()), key, message))
            return
        ros, space = others[0]
        fix = f"set {key}: {ros}" if ros else f"set {key} to the planner that is meant"
        message += f", with its own defaults; the parameters of {space.name} have no effect; {fix}"
        namespace = planner_namespaces(registry.get(default))[0] if default in registry else default
        self.default_planners[namespace] = finding(
            "warning", "default-planner", space.at, space.path, message, ros or None
        )

    def _check_unselected_planners(self, meant: Collection[str]) -> None:
        """Report each planner that is written but not selected, with its wrong values as warnings."""
        kinds = ((GLOBAL_PLANNERS, "base_global_planner"), (LOCAL_PLANNERS, "base_local_planner"))
        for registry, key in (*kinds, (SMOOTHERS, "base_smoother")):
            for registered, aliases in registry.names():
                for name in own_namespaces(registered, aliases):
                    space = self.root.space(name)
                    if space is None or space.used or space.path in meant:
                        continue
                    entry = registry.get(registered)
                    selected = self.root.leaf(key)
                    known = selected is None or not isinstance(selected.value, str) or selected.value in registry
                    foreign = not known and name in FOREIGN_LOCAL_PLANNERS
                    if name in shared_namespaces(entry) or foreign:  # ROS 1 has another DWBLocalPlanner
                        continue
                    before = len(self.findings)
                    self.binder.bind(entry.cls.Params, space, strictness="warning")
                    # notes on how a value is used would be wrong
                    self.findings[before:] = [f for f in self.findings[before:] if f.severity != "info"]
                    self.not_in_use.append(space)
                    if space.children and selected is not None:
                        message = f"{name} has no effect: {key} selects {show(selected.value)}"
                        self.findings.append(finding("info", "not-in-use", space.at, space.path, message))
                    elif space.children and registry is SMOOTHERS:
                        message = f"{name} has no effect: no smoother is selected; write {key}: {entry.name}"
                        self.findings.append(finding("warning", "not-in-use", space.at, space.path, message))

    # --- recoveries ---------------------------------------------------------------------------------------------------

    def _recoveries(
        self,
        listed: list[ListedPlugin] | None,
        move_base: MoveBaseParams | None,
        local_costmap: CostmapConfiguration | None,
    ) -> tuple[Plugin[RecoveryBehavior], ...] | None:
        wanted: list[tuple[ListedPlugin, Mapping[str, Any]]] = []
        if "recovery_behaviors" in self.root.children:
            if listed is None:
                return None
            wanted = [(plugin, {}) for plugin in listed]
        else:
            if move_base is None or local_costmap is None:
                return None
            at = Location(self._move_base_file())
            for spec, imposed in builtin_recoveries(move_base, local_costmap.footprint.circumscribed_radius):
                wanted.append((ListedPlugin(spec.name, spec.type, at, spec.name), imposed))
        made = [self._recovery(plugin, imposed) for plugin, imposed in wanted]
        recoveries = tuple(recovery for recovery in made if recovery is not None)
        return recoveries if len(recoveries) == len(made) else None

    def _recovery(self, plugin: ListedPlugin, imposed: Mapping[str, Any]) -> Plugin[RecoveryBehavior] | None:
        entry = self.plugins.find(RECOVERY_BEHAVIORS, plugin)
        if entry is None:
            mark_used(self.root, plugin.name)
            return None
        space = self.binder.child(self.root, plugin.name)
        self._report_imposed(space, imposed)
        params = self.binder.bind(entry.cls.Params, space, fixed=imposed)
        return None if params is None else Plugin(plugin.name, entry.cls, params, plugin.name)

    def _report_imposed(self, space: Space, imposed: Mapping[str, Any]) -> None:
        for name, value in imposed.items():
            leaf = space.leaf(name)
            if leaf is None or leaf.used:
                continue
            leaf.used = True
            message = (
                f"{name} of {space.name} is ignored: without recovery_behaviors, move_base sets it to {value:g}; list the "
                "recovery behaviors under recovery_behaviors to set it"
            )
            self.findings.append(finding("warning", "no-effect", leaf.at, leaf.path, message, "recovery_behaviors"))


def load_configuration(
    sources: Sequence[Source],
    *,
    overrides: Sequence[str | Override] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Configuration:
    """Load a packaged set (`turtlebot`), folders, files (`file@namespace`) or mappings; later sources override earlier ones.

    Files of Nav2 are recognized by `ros__parameters`; `controller:=ID`, `planner:=ID` and `namespace:=NAME` choose within them.

    `overrides` are `NAME=VALUE` texts, `distro` overrides `navstack/ros_distro` and is the distribution of files of Nav2, which
    is otherwise found from their keys. With `allow_missing`, layers, critics and recovery behaviors of an unknown type are left
    out with a warning; unknown planners remain errors, but for those of files of Nav2 others stand in.

    Raise ParameterError if the parameters cannot be used: its message has a line per error, its `data["findings"]` all
    findings.
    """
    configuration, findings = Loader(sources, overrides, distro, allow_missing).load()
    errors = [f for f in findings if f.severity == "error"]
    if configuration is None or errors:
        raise _error(errors, findings)
    return configuration


def check_parameters(
    sources: Sequence[Source],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> list[Finding]:
    """Return all findings about the parameters, sorted by file and line; never raises because of their content."""
    return Loader(sources, overrides, distro, allow_missing).load()[1]


def choose_global_planner(configuration: Configuration, name: str) -> Plugin[GlobalPlanner]:
    """Return another global planner than the selected one, with the parameters of its namespace.

    Raise UnknownPluginError for a name that is not registered, ParameterError for parameters that cannot be used.
    """
    entry = GLOBAL_PLANNERS.get(name)
    findings: list[Finding] = []
    binder = Binder(findings, {"ros_distro": configuration.navstack.ros_distro})
    space = planner_space(configuration.tree, entry, name)
    params = binder.bind(entry.cls.Params, space)
    errors = [f for f in in_order(findings) if f.severity == "error"]
    if params is None or errors:
        raise _error(errors, in_order(findings))
    return Plugin(entry.name, entry.cls, params, space.path)


def _error(errors: Sequence[Finding], findings: Sequence[Finding]) -> ParameterError:
    count = "" if len(errors) == 1 else f" ({len(errors)} errors)"
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    unknown = [f for f in errors if f.rule == "unknown-plugin"]
    cls = UnknownPluginError if unknown and len(unknown) == len(errors) else ParameterError
    return cls(f"the parameters cannot be used{count}:\n{lines}", findings=[f.as_dict() for f in findings])


def _is_above(name: str, paths: Sequence[str]) -> bool:
    """True if one of the paths is below a name."""
    return any(path.startswith(f"{name}/") for path in paths)

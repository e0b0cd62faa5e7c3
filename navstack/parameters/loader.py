"""Sources of parameters -> typed configuration with all findings; errors do not stop the search for further errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from navstack.interfaces import Layer, RecoveryBehavior
from navstack.parameters.binding import Binder
from navstack.parameters.catalogue import catalogue_of
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration, NavstackParams
from navstack.parameters.findings import Finding, Location, finding, in_order
from navstack.parameters.footprint import footprint_of
from navstack.parameters.foreign import FOREIGN_LOCAL_PLANNERS
from navstack.parameters.localization_sections import load_localization
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.move_base import MoveBaseParams, builtin_recoveries
from navstack.parameters.namespaces import planner_namespaces, planner_space
from navstack.parameters.plugin_lists import ListedPlugin, PluginLists, fixed_list, mark_used, short_type
from navstack.parameters.pre_hydro import convert_pre_hydro
from navstack.parameters.rules import check_rules, simulated
from navstack.parameters.safety_sections import load_safety
from navstack.parameters.sources import Override, Source, read_sources
from navstack.parameters.tree import COSTMAPS, Space
from navstack.parameters.unused import unused_parameters
from navstack.parameters.value_messages import show
from navstack.parameters.yaml_nodes import ScalarNode
from navstack.plugins import (
    CRITICS,
    GLOBAL_PLANNERS,
    LAYERS,
    LOCAL_PLANNERS,
    RECOVERY_BEHAVIORS,
    SMOOTHERS,
    PluginChoice,
    Registry,
)


class Loader:
    """Loads one set of sources."""

    def __init__(
        self, sources: Sequence[Source], overrides: Sequence[str | Override], distro: str | None, allow_missing: bool
    ) -> None:
        read = read_sources([sources] if isinstance(sources, str) else sources, overrides)
        self.root = read.root
        self.findings = read.findings
        self.files = read.files
        self.complete = not any(f.severity == "error" for f in read.findings)
        """False if a source could not be read: rules about missing parameters would mislead."""
        self.not_in_use: list[Space] = []
        """Namespaces of planners that are not selected."""
        self.distro = distro
        self.binder = Binder(self.findings)
        self.plugins = PluginLists(self.binder, self.findings, allow_missing=allow_missing)

    def load(self) -> tuple[Configuration | None, list[Finding]]:
        """Return the configuration, None if it cannot be used, and all findings in order."""
        configuration = self._load()
        findings = in_order(self.findings)
        if configuration is None:
            return None, findings
        return replace(configuration, findings=tuple(findings)), findings

    def _load(self) -> Configuration | None:
        if not self.root.children and not self.complete:
            return None  # nothing was loaded: further findings would be consequences
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
        self._check_unselected_planners()
        configuration = None
        if all(part is not None for part in parts.values()):
            configuration = Configuration(
                **parts, smoother=smoother, findings=(), tree=self.root, origins=self.binder.origins
            )
            sim = simulated(configuration)
            configuration = replace(configuration, navstack=configuration.navstack.model_copy(update={"sim": sim}))
            if self.complete:
                self.findings += check_rules(configuration)
        sections = tuple(f"{space.path}/" for space in self.not_in_use)
        unused = unused_parameters(self.root, self.binder, catalogue_of(self.binder))
        self.findings += [f for f in unused if f.severity != "info" or not f.key.startswith(sections)]
        return configuration

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
        layers = self._layers(space, listed)
        if listed is None:  # without the list it is unknown what the layers read
            for leaf in space.leaves():
                leaf.used = True
        if params is None or footprint is None or layers is None:
            return None
        return CostmapConfiguration(params, footprint.padded, footprint.true, layers)

    def _layers(self, space: Space, listed: list[ListedPlugin] | None) -> tuple[PluginChoice[Layer], ...] | None:
        layers: list[PluginChoice[Layer]] = []
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
            layers.append(PluginChoice(plugin.name, entry.cls, params, f"{space.path}/{plugin.name}"))
        return tuple(layers) if good else None

    # --- planners -----------------------------------------------------------------------------------------------------

    def _planner(self, registry: Registry[Any], key: str) -> PluginChoice[Any] | None:
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
        if "critics" in entry.cls.Params.model_fields:
            listed = self.plugins.read(space, "critics", CRITICS)
            known = [self.plugins.find(CRITICS, plugin) is not None for plugin in listed or ()]
            fixed = fixed_list(space, "critics", listed if all(known) else None)
        params: Any = self.binder.bind(entry.cls.Params, space, fixed=fixed)
        return None if params is None else PluginChoice(entry.name, entry.cls, params, space.path)

    def _smoother(self) -> PluginChoice[Any] | None:
        """The smoother of the plans; None if none is selected, or it cannot be used (reported)."""
        leaf = self.root.leaf("base_smoother")
        return None if leaf is None or leaf.value is None else self._planner(SMOOTHERS, "base_smoother")

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
        self.findings.append(finding("warning", "default-planner", space.at, space.path, message, ros or None))

    def _check_unselected_planners(self) -> None:
        """Report each planner that is written but not selected, with its wrong values as warnings."""
        kinds = ((GLOBAL_PLANNERS, "base_global_planner"), (LOCAL_PLANNERS, "base_local_planner"))
        for registry, key in (*kinds, (SMOOTHERS, "base_smoother")):
            for entry in registry:
                for name in planner_namespaces(entry):
                    space = self.root.space(name)
                    if space is None or space.used or name in getattr(entry.cls, "NAMESPACES", ()):
                        continue  # the names of Nav2's files do not say which planner is meant
                    before = len(self.findings)
                    self.binder.bind(entry.cls.Params, space, strictness="warning")
                    # notes on how a value is used would be wrong
                    self.findings[before:] = [f for f in self.findings[before:] if f.severity != "info"]
                    self.not_in_use.append(space)
                    selected = self.root.leaf(key)
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
    ) -> tuple[PluginChoice[RecoveryBehavior], ...] | None:
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

    def _recovery(self, plugin: ListedPlugin, imposed: Mapping[str, Any]) -> PluginChoice[RecoveryBehavior] | None:
        entry = self.plugins.find(RECOVERY_BEHAVIORS, plugin)
        if entry is None:
            mark_used(self.root, plugin.name)
            return None
        space = self.binder.child(self.root, plugin.name)
        self._report_imposed(space, imposed)
        params = self.binder.bind(entry.cls.Params, space, fixed=imposed)
        return None if params is None else PluginChoice(plugin.name, entry.cls, params, plugin.name)

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

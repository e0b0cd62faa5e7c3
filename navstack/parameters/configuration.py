"""Sources of parameters -> typed parameters of everything: move_base, both costmaps with their layers, planners, recoveries.

Every key is accounted for. What stops is an error; all of them are reported at once, with file, line and column.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, Literal, NamedTuple, TypeVar

from navstack.core import Footprint
from navstack.core.errors import ParameterError, UnknownPluginError
from navstack.core.parameters import ParamModel, PluginSpec, param
from navstack.interfaces import GlobalPlanner, Layer, LocalPlanner, RecoveryBehavior
from navstack.parameters import Finding, Leaf, Location, Space, read_sources
from navstack.parameters.binding import Binder
from navstack.parameters.findings import finding, in_order
from navstack.parameters.footprint import outline_of
from navstack.parameters.models.costmap import CostmapParams
from navstack.parameters.models.move_base import MoveBaseParams, builtin_recoveries
from navstack.parameters.models.sim import SimParams
from navstack.parameters.pre_hydro import convert_pre_hydro
from navstack.parameters.rules import Subject, check_rules
from navstack.parameters.sources import Source
from navstack.parameters.tree import COSTMAPS
from navstack.parameters.unused import FOREIGN, Accountant, Catalogue, nearest
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.plugins import (
    CRITICS,
    GLOBAL_PLANNERS,
    LAYERS,
    LOCAL_PLANNERS,
    RECOVERY_BEHAVIORS,
    REGISTRIES,
    PluginEntry,
    Registry,
    normalize,
)

T = TypeVar("T")

DISTROS = ("noetic", "indigo")


class NavstackParams(ParamModel):
    """The `navstack:` section, which is ours: ROS does not read it."""

    ros_distro: Literal["noetic", "indigo"] = param(
        "noetic",
        "the scoring scale that the planners' weights were tuned in: noetic, or indigo for those of before 2018",
    )
    goal_time_limit: float = param(
        0.0,
        "how long a goal may take from being accepted until it is aborted; 0 = for ever, as in ROS",
        unit="s",
        ge=0.0,
    )
    sim: SimParams = param(SimParams(), "the simulated robot")


class PluginChoice(NamedTuple, Generic[T]):
    """A plugin that the parameters name, ready to be made."""

    name: str
    """Instance name: of a layer or recovery its namespace, of a planner its registered name."""
    cls: type[T]
    params: Any
    """Of the plugin's own model `cls.Params`."""
    namespace: str = ""
    """Where its parameters stand, below move_base."""


@dataclass(frozen=True, slots=True)
class CostmapConfiguration:
    """Parameters of a costmap and its layers."""

    params: CostmapParams
    footprint: Footprint
    """With the padding."""
    true_footprint: Footprint
    """Without it: what collides."""
    layers: tuple[PluginChoice[Layer], ...]
    """In the order in which they write."""


@dataclass(frozen=True, slots=True)
class Configuration:
    """Everything that parameters decide."""

    move_base: MoveBaseParams
    global_costmap: CostmapConfiguration
    local_costmap: CostmapConfiguration
    global_planner: PluginChoice[GlobalPlanner]
    local_planner: PluginChoice[LocalPlanner]
    recoveries: tuple[PluginChoice[RecoveryBehavior], ...]
    navstack: NavstackParams
    findings: tuple[Finding, ...]
    """Warnings and notes, by file and line."""
    tree: Space = field(repr=False, compare=False)
    """All parameters as loaded."""
    origins: Mapping[str, Location] = field(repr=False, compare=False)
    """Full name of a parameter (`DWAPlannerROS/max_vel_x`) -> where its value was written; not there: the default."""


def load_configuration(
    sources: Sequence[Source],
    *,
    overrides: Sequence[str] = (),
    distro: str | None = None,
    allow_missing: bool = False,
) -> Configuration:
    """Loads a packaged set (`turtlebot`), folders, files (`file@namespace`), mappings: later over earlier.

    `overrides` are `NAME=VALUE` texts, `distro` overrides `navstack/ros_distro`. With `allow_missing`, layers, critics
    and recovery behaviours of a type that is not here are left out, with a warning (planners are not: nothing could
    stand in for them). Raises ParameterError when something cannot be used: its message has a line per error, its
    `data["findings"]` everything that was found.
    """
    configuration, findings = _Assembly(sources, overrides, distro, allow_missing).run()
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
    """Everything there is to say about the parameters, by file and line; raises nothing whatever they are."""
    return _Assembly(sources, overrides, distro, allow_missing).run()[1]


def choose_global_planner(configuration: Configuration, name: str) -> PluginChoice[GlobalPlanner]:
    """Another global planner than the parameters select, with the parameters of its namespace.

    Raises UnknownPluginError for a name that is not registered, ParameterError for parameters it cannot use.
    """
    entry = GLOBAL_PLANNERS.get(name)
    findings: list[Finding] = []
    binder = Binder(findings, {"ros_distro": configuration.navstack.ros_distro})
    space = _planner_space(configuration.tree, entry, name)
    made = binder.bind(entry.cls.Params, space)
    errors = [f for f in in_order(findings) if f.severity == "error"]
    if made is None or errors:
        raise _error(errors, in_order(findings))
    return PluginChoice(entry.name, entry.cls, made, space.path)


def _error(errors: Sequence[Finding], findings: Sequence[Finding]) -> ParameterError:
    many = (
        "the parameters cannot be used" if len(errors) == 1 else f"the parameters cannot be used ({len(errors)} errors)"
    )
    lines = "\n".join(f"{f.location}: {f.message}" for f in errors)
    unknown = [f for f in errors if f.rule == "unknown-plugin"]
    cls = UnknownPluginError if unknown and len(unknown) == len(errors) else ParameterError
    return cls(f"{many}:\n{lines}", findings=[f.as_dict() for f in findings])


# --- namespaces -------------------------------------------------------------------------------------------------------


def _short(name: str) -> str:
    """`navfn/NavfnROS` -> NavfnROS, as pluginlib's getName."""
    return normalize(name).rpartition("/")[2]


def planner_namespaces(entry: PluginEntry[Any], written: str = "") -> list[str]:
    """The namespaces a planner's parameters may stand in: that of the name as written, then of its ROS names, its own."""
    names = [_short(written)] if "/" in normalize(written) else []
    names += [_short(a) for a in entry.aliases if "/" in a]
    return list(dict.fromkeys([*names, entry.name]))


def _planner_space(root: Space, entry: PluginEntry[Any], written: str) -> Space:
    names = planner_namespaces(entry, written)
    for name in names:
        space = root.space(name)
        if space is not None:
            return space
    return Space(root.join(names[0]), root.at, root)


class _Spec(NamedTuple):
    """An entry of a plugin list."""

    name: str
    type: str
    at: Location
    key: str


class _Assembly:
    """One loading, from sources to configuration."""

    def __init__(
        self, sources: Sequence[Source], overrides: Sequence[str], distro: str | None, allow_missing: bool
    ) -> None:
        read = read_sources([sources] if isinstance(sources, str) else sources, overrides)
        self.root = read.root
        self.findings = read.findings
        self.files = read.files
        self.complete = not any(f.severity == "error" for f in read.findings)
        """False when a source could not be read: what is missing says nothing about the rest."""
        self.distro = distro
        self.allow_missing = allow_missing
        self.binder = Binder(self.findings)

    def run(self) -> tuple[Configuration | None, list[Finding]]:
        configuration = self._configuration()
        findings = in_order(self.findings)
        if configuration is None:
            return None, findings
        return replace(configuration, findings=tuple(findings)), findings

    def say(
        self, severity: Any, rule: str, at: Location, key: str, message: str, suggestion: str | None = None
    ) -> None:
        self.findings.append(finding(severity, rule, at, key, message, suggestion))

    def _configuration(self) -> Configuration | None:
        if not self.root.children and any(f.severity == "error" for f in self.findings):
            return None  # nothing was loaded: the rest would only say so many times over
        navstack = self._navstack()
        self.binder.navstack = {"ros_distro": navstack.ros_distro if navstack else "noetic"}
        for name in COSTMAPS:
            space = self.binder.child(self.root, name)
            if self.root.children.get(name) is not space:
                space.at = Location(self.files[0] if self.files else "")
                self.root.children[name] = space
            convert_pre_hydro(space, self.findings)
        global_costmap = self._costmap("global_costmap")
        local_costmap = self._costmap("local_costmap")
        listed = self._plugin_list(self.root, "recovery_behaviors", RECOVERY_BEHAVIORS)
        move_base: Any = self.binder.bind(
            MoveBaseParams, self.root, fixed=_fixed_list(self.root, "recovery_behaviors", listed)
        )
        global_planner = self._planner(GLOBAL_PLANNERS, "base_global_planner")
        local_planner = self._planner(LOCAL_PLANNERS, "base_local_planner")
        recoveries = self._recoveries(listed, move_base, local_costmap)
        self._check_planners_not_in_use()
        made = None
        if not (
            move_base is None
            or navstack is None
            or global_costmap is None
            or local_costmap is None
            or global_planner is None
            or local_planner is None
            or recoveries is None
        ):
            made = Configuration(
                move_base=move_base,
                global_costmap=global_costmap,
                local_costmap=local_costmap,
                global_planner=global_planner,
                local_planner=local_planner,
                recoveries=recoveries,
                navstack=navstack,
                findings=(),
                tree=self.root,
                origins=self.binder.origins,
            )
            if self.complete:
                self.findings += check_rules(_subject(made))
        self.findings += Accountant(self.root, self.binder, self._catalogue()).settle()
        return made

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
        made: Any = self.binder.bind(NavstackParams, space, nodes=nodes)
        return made

    def _costmap(self, name: str) -> CostmapConfiguration | None:
        space = self.root.ensure(name, self.root.at)
        specs = self._plugin_list(space, "plugins", LAYERS)
        params: Any = self.binder.bind(CostmapParams, space, fixed=_fixed_list(space, "plugins", specs))
        padding = params.footprint_padding if params is not None else 0.0
        before = len(self.findings)
        outline = outline_of(space, padding, self.findings)
        # what is wrong with a footprint is said once, by those who know what one is
        told = {f.key for f in self.findings[before:] if f.rule == "footprint"}
        self.findings[:] = [f for f in self.findings if f.rule == "footprint" or f.key not in told]
        layers: list[PluginChoice[Layer]] = []
        good = specs is not None
        for spec in specs or ():
            entry = self._plugin(LAYERS, spec)
            made = None
            if entry is not None:
                made = self.binder.bind(entry.cls.Params, self.binder.child(space, spec.name))
            if entry is None:
                _excuse(space, spec.name)
            if entry is None or made is None:
                good = False
                continue
            layers.append(PluginChoice(spec.name, entry.cls, made, f"{name}/{spec.name}"))
        if params is None or outline is None or not good:
            return None
        return CostmapConfiguration(params, outline.padded, outline.true, tuple(layers))

    def _planner(self, registry: Registry[Any], key: str) -> PluginChoice[Any] | None:
        leaf = self.root.leaf(key)
        default = MoveBaseParams.model_fields[key].default
        written = leaf.value if leaf is not None else default
        if not isinstance(written, str):
            return None  # its type is reported with move_base's other parameters
        if leaf is None and written not in registry:
            known = ", ".join(_ros_name(e) for e in registry)
            message = f'{key} is not given, and ROS\'s default "{written}" is not among the plugins here; write one of: {known}'
            self.say("error", "unknown-plugin", Location(self._somewhere()), key, message)
            return None
        spec = _Spec(key, written, leaf.node.at if leaf else self.root.at, key)
        entry = self._plugin(registry, spec)
        if entry is None:
            _excuse(self.root, _short(written))
            return None
        space = _planner_space(self.root, entry, written)
        if self.root.children.get(space.name) is not space:
            space = self.binder.child(self.root, space.name)
        fixed: dict[str, Any] | None = None
        if "critics" in entry.cls.Params.model_fields:
            specs = self._plugin_list(space, "critics", CRITICS)
            known = [self._plugin(CRITICS, s) is not None for s in specs or ()]
            fixed = _fixed_list(space, "critics", specs if all(known) else None)
        made: Any = self.binder.bind(entry.cls.Params, space, fixed=fixed)
        return None if made is None else PluginChoice(entry.name, entry.cls, made, space.path)

    def _somewhere(self) -> str:
        """The file that a missing parameter of move_base's own would stand in."""
        return next((f for f in self.files if "move_base" in f), self.files[0] if self.files else "")

    def _recoveries(
        self, specs: list[_Spec] | None, move_base: MoveBaseParams | None, local_costmap: CostmapConfiguration | None
    ) -> tuple[PluginChoice[RecoveryBehavior], ...] | None:
        todo: list[tuple[_Spec, dict[str, Any]]] = []
        if "recovery_behaviors" not in self.root.children:
            if move_base is None or local_costmap is None:
                return None
            at = Location(self._somewhere())
            for spec, imposed in builtin_recoveries(move_base, local_costmap.footprint.circumscribed_radius):
                todo.append((_Spec(spec.name, spec.type, at, spec.name), imposed))
        elif specs is None:
            return None
        else:
            todo = [(spec, {}) for spec in specs]
        made: list[PluginChoice[RecoveryBehavior]] = []
        good = True
        for spec, imposed in todo:
            entry = self._plugin(RECOVERY_BEHAVIORS, spec)
            if entry is None:
                _excuse(self.root, spec.name)
                good = False
                continue
            space = self.binder.child(self.root, spec.name)
            self._say_imposed(space, imposed)
            params = self.binder.bind(entry.cls.Params, space, fixed=imposed)
            if params is None:
                good = False
                continue
            made.append(PluginChoice(spec.name, entry.cls, params, spec.name))
        return tuple(made) if good else None

    def _say_imposed(self, space: Space, imposed: dict[str, Any]) -> None:
        for name, value in imposed.items():
            leaf = space.leaf(name)
            if leaf is None or leaf.used:
                continue
            leaf.used = True
            message = (
                f"{name} of {space.name} has no effect: without recovery_behaviors, move_base sets it to {value:g}; "
                "list the recoveries under recovery_behaviors to set it yourself"
            )
            self.say("warning", "no-effect", leaf.at, leaf.path, message, "recovery_behaviors")

    # --- plugins ------------------------------------------------------------------------------------------------------

    def _plugin(self, registry: Registry[T], spec: _Spec) -> PluginEntry[T] | None:
        try:
            return registry.get(spec.type)
        except UnknownPluginError:
            known = ", ".join(_ros_name(e) for e in registry)
            other = next((r.kind for r in REGISTRIES if spec.type in r), None)
            # a planner that exists elsewhere is not a misspelt one
            foreign = _short(spec.type) in FOREIGN
            close = _meant(registry, spec.type) if other is None and not foreign else None
            hint = f'did you mean "{close}"? ' if close else ""
            what = f'there is no {registry.kind} "{spec.type}" here'
            if other is not None:
                what = f'"{spec.type}" is a {other}, not a {registry.kind}'
            if spec.name == spec.key:  # a planner: nothing could stand in for it
                message = f"{what}; {hint}known: {known}; choose one there or by --set {spec.key}=.."
                self.say("error", "unknown-plugin", spec.at, spec.key, message, close)
            elif self.allow_missing:
                message = f"{what}, so {spec.name} is left out; {hint}known: {known}"
                self.say("warning", "unknown-plugin", spec.at, spec.key, message, close)
            else:
                message = f"{what}; {hint}known: {known}; or leave {spec.name} out by --allow-missing"
                self.say("error", "unknown-plugin", spec.at, spec.key, message, close)
            return None

    def _there(self, registry: Registry[Any], specs: list[_Spec], space: Space, leaf: Leaf) -> list[_Spec]:
        """Without the plugins that are not here, in the tree as well: what is kept of it loads again."""
        found = [s for s in specs if self._plugin(registry, s) is not None]
        for gone in (s for s in specs if s not in found):
            _excuse(space, gone.name)
        if len(found) < len(specs) and isinstance(leaf.node, ListNode):
            items = [item for item, spec in zip(leaf.node.items, specs) if spec in found]
            leaf.node = ListNode(items, leaf.node.at)
        return found

    def _plugin_list(self, space: Space, key: str, registry: Registry[Any]) -> list[_Spec] | None:
        """The entries of a plugin list; empty without one, None after an error."""
        child = space.children.get(key)
        if child is None:
            return []
        way_out = f'write {key} as a list of entries like {{name: .., type: ".."}}'
        if isinstance(child, Space):
            for leaf in child.leaves():
                leaf.used = True
            self.say("error", "plugin-list", child.at, child.path, f"{key} is a namespace, not a list; {way_out}")
            return None
        child.used = True
        node = child.node
        if not isinstance(node, ListNode):
            what = "has no value" if node_is_none(node) else f"is {_shown(node)}, not a list"
            self.say("error", "plugin-list", node.at, child.path, f"{key} {what}; {way_out}")
            return None
        specs: list[_Spec] = []
        good = True
        for number, item in enumerate(node.items, 1):
            spec = self._spec(item, key, child, number)
            if spec is None:
                good = False
                continue
            twin = next((s for s in specs if s.name == spec.name), None)
            if twin is not None:
                message = f'{key} has two entries named "{spec.name}" (the first at {twin.at}); give each its own name'
                self.say("error", "plugin-list", spec.at, child.path, message)
                good = False
                continue
            specs.append(spec)
        if not good:
            return None
        self.binder.origins[child.path] = node.at
        return self._there(registry, specs, space, child) if self.allow_missing else specs

    def _spec(self, item: Node, key: str, leaf: Leaf, number: int) -> _Spec | None:
        if not isinstance(item, DictNode):
            message = f'entry {number} of {key} is {_shown(item)}; write it as {{name: .., type: ".."}}'
            self.say("error", "plugin-list", item.at, leaf.path, message)
            return None
        found: dict[str, str] = {}
        at = item.at
        for name in ("name", "type"):
            there = item.items.get(name)
            value = there[1].value if there is not None and isinstance(there[1], ScalarNode) else None
            if not isinstance(value, str) or not value:
                what = f"has no {name}" if there is None else f"has a {name} that is not text"
                message = f'entry {number} of {key} {what}; write it as {{name: .., type: ".."}}'
                self.say("error", "plugin-list", there[1].at if there else item.at, leaf.path, message)
                return None
            found[name] = value
            if name == "type" and there is not None:
                at = there[1].at
        for name, (there_at, _) in item.items.items():
            if name not in found:
                message = (
                    f"{name} in an entry of {key} has no effect; parameters of {found['name']} stand in its namespace"
                )
                self.say("warning", "unknown", there_at, f"{leaf.path}/{name}", message)
        return _Spec(found["name"], found["type"], at, leaf.path)

    def _check_planners_not_in_use(self) -> None:
        """The namespaces of planners that are there but not selected: wrong values are warnings."""
        for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS):
            for entry in registry:
                for name in planner_namespaces(entry):
                    space = self.root.space(name)
                    if space is not None and not space.used:
                        self.binder.bind(entry.cls.Params, space, strictness="warning")

    def _catalogue(self) -> Catalogue:
        catalogue = Catalogue()
        catalogue.learn("move_base", MoveBaseParams)
        for name in COSTMAPS:
            catalogue.learn(name, CostmapParams)
        for registry in (GLOBAL_PLANNERS, LOCAL_PLANNERS):
            for entry in registry:
                for name in planner_namespaces(entry):
                    catalogue.planners[name] = entry.cls.Params
                if entry.name not in planner_namespaces(entry)[:1]:
                    catalogue.learn(planner_namespaces(entry)[0], entry.cls.Params)
                else:
                    catalogue.learn(entry.name, entry.cls.Params)
        for entry in LAYERS:
            for name in layer_names(entry):
                catalogue.layers.setdefault(name, []).append(entry.cls.Params)
            catalogue.learn(layer_names(entry)[0], entry.cls.Params)
        for entry in RECOVERY_BEHAVIORS:
            catalogue.recoveries.append(entry.cls.Params)
            catalogue.learn(entry.name, entry.cls.Params)
        catalogue.learn("navstack", NavstackParams)
        catalogue.learn("navstack/sim", SimParams)
        for space, model in self.binder.bound:
            if space.parent is not None and space.children:
                catalogue.learn(space.name, model)
        return catalogue


def _excuse(parent: Space, name: str) -> None:
    """Nothing more needs to be said about the parameters of a plugin that is not there."""
    space = parent.space(name)
    for leaf in space.leaves() if space is not None else ():
        leaf.used = True


def layer_names(entry: PluginEntry[Layer]) -> list[str]:
    """Instance names that layers of this type usually have, the plain one first."""
    base = entry.name.removesuffix("_layer")
    names = [f"{base}_layer", base, f"{base}r_layer"]
    if base == "voxel":
        names = ["obstacle_layer", "voxel_layer", *names]
    return list(dict.fromkeys(names))


def _fixed_list(space: Space, key: str, specs: Sequence[_Spec] | None) -> dict[str, Any] | None:
    """A plugin list as checked here, in the place of what was written; None where nothing was."""
    if key not in space.children:
        return None
    return {key: [PluginSpec(name=s.name, type=s.type) for s in specs] if specs is not None else None}


def _ros_name(entry: PluginEntry[Any]) -> str:
    return next((a for a in entry.aliases if "/" in a), entry.name)


def _meant(registry: Registry[Any], written: str) -> str | None:
    """The ROS name that a misspelt one means."""
    names = {n: _ros_name(e) for e in registry for n in (e.name, *(_short(a) for a in e.aliases))}
    close = nearest(_short(written), names, cutoff=0.75)
    return names[close] if close else None


def node_is_none(node: Node) -> bool:
    """True for a value that is nothing."""
    return isinstance(node, ScalarNode) and node.value is None


def _shown(node: Node) -> str:
    if isinstance(node, ScalarNode):
        return f'"{node.text}"' if isinstance(node.value, str) else node.text or "nothing"
    return "a list" if isinstance(node, ListNode) else "a mapping"


def _subject(configuration: Configuration) -> Subject:
    return Subject(
        root=configuration.tree,
        distro=configuration.navstack.ros_distro,
        move_base=configuration.move_base,
        costmaps={
            name: (c.params, c.footprint, [(layer.name, layer.cls, layer.params) for layer in c.layers])
            for name, c in (
                ("global_costmap", configuration.global_costmap),
                ("local_costmap", configuration.local_costmap),
            )
        },
        global_planner=configuration.global_planner[:3],
        local_planner=configuration.local_planner[:3],
        sim=configuration.navstack.sim,
        recoveries=[r[:3] for r in configuration.recoveries],
        planner_space=configuration.local_planner.namespace,
        global_space=configuration.global_planner.namespace,
    )


__all__ = [
    "Configuration",
    "CostmapConfiguration",
    "NavstackParams",
    "PluginChoice",
    "check_parameters",
    "choose_global_planner",
    "load_configuration",
]

"""Plugin lists (`plugins`, `recovery_behaviors`, `critics`) and the look-up of plugins by their type, with findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple, TypeVar

from navstack.core import UnknownPluginError
from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.foreign import FOREIGN_PLANNERS
from navstack.parameters.spelling import is_typo, nearest
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.plugins import RECOVERY_BEHAVIORS, REGISTRIES, Plugin, PluginSpec, Registry, normalize

T = TypeVar("T")

BUILT_IN = "until then the built-in recovery behaviors are used, as in ROS"


class ListedPlugin(NamedTuple):
    """An entry of a plugin list, or a planner named by a parameter."""

    name: str
    type: str
    at: Location
    """Location of its type."""
    key: str
    """Full name of the parameter that lists it."""


def short_type(name: str) -> str:
    """Return the last part of a type as pluginlib's getName does: `navfn/NavfnROS` -> NavfnROS."""
    return normalize(name).rpartition("/")[2]


def mark_used(parent: Space, name: str) -> None:
    """Mark the parameters of a plugin that is not available as used, so that they cause no findings of their own."""
    space = parent.space(name)
    for leaf in space.leaves() if space is not None else ():
        leaf.used = True


def fixed_list(space: Space, key: str, plugins: Sequence[ListedPlugin] | None) -> dict[str, Any] | None:
    """Return a checked plugin list as the value of its field; None if the list is not written."""
    if key not in space.children:
        return None
    return {key: None if plugins is None else [PluginSpec(name=p.name, type=p.type) for p in plugins]}


class PluginLists:
    """Reads plugin lists from the tree and looks their plugins up."""

    def __init__(self, binder: Binder, findings: list[Finding], *, allow_missing: bool) -> None:
        self.binder = binder
        self.findings = findings
        self.allow_missing = allow_missing
        """Leave out plugins of an unknown type with a warning, instead of an error."""

    def add_finding(
        self, severity: Severity, rule: str, at: Location, key: str, message: str, suggestion: str | None = None
    ) -> None:
        """Add a finding."""
        self.findings.append(finding(severity, rule, at, key, message, suggestion))

    # --- look-up ------------------------------------------------------------------------------------------------------

    def find(self, registry: Registry[T], plugin: ListedPlugin) -> Plugin[T] | None:
        """Return the registered plugin, or None with a finding."""
        try:
            return registry.get(plugin.type)
        except UnknownPluginError:
            self._add_unknown(registry, plugin)
            return None

    def _add_unknown(self, registry: Registry[Any], plugin: ListedPlugin) -> None:
        by_name = _is_bare(plugin.type)
        known = ", ".join(entry.name if by_name else entry.ros_name for entry in registry)
        other = next((r.kind for r in REGISTRIES if plugin.type in r), None)
        close = _closest(registry, plugin.type) if other is None else None
        # a planner that exists elsewhere is not a misspelt one, unless its package is
        package = normalize(plugin.type).rpartition("/")[0]
        misspelt = close is not None and is_typo(package, normalize(close).rpartition("/")[0])
        foreign = short_type(plugin.type) in FOREIGN_PLANNERS and not misspelt
        close = None if foreign else close
        hint = f'did you mean "{close}"? ' if close else ""
        problem = f'unknown {registry.kind} "{plugin.type}"'
        if other is not None:
            problem = f'"{plugin.type}" is a {other}, not a {registry.kind}'
        severity: Severity = "error"
        if plugin.name == plugin.key:  # a planner cannot be left out
            elsewhere = f" here or with --set {plugin.key}=.." if plugin.at.line else ""  # not of the command line
            message = f"{problem}; {hint}known: {known}; choose one of them{elsewhere}"
            if foreign and plugin.key != "base_smoother":
                message += ", or let another one stand in with its limits: --allow-missing"
        elif self.allow_missing:
            severity = "warning"
            message = f"{problem}, so {plugin.name} is left out; {hint}known: {known}"
        else:
            message = f"{problem}; {hint}known: {known}; or leave {plugin.name} out with --allow-missing"
        self.add_finding(severity, "unknown-plugin", plugin.at, plugin.key, message, close)

    def _without_missing(
        self, registry: Registry[Any], plugins: list[ListedPlugin], space: Space, leaf: Leaf
    ) -> list[ListedPlugin]:
        """Return the known plugins and drop the others from the tree, so that the saved tree can be loaded again."""
        found = [p for p in plugins if self.find(registry, p) is not None]
        for missing in (p for p in plugins if p not in found):
            mark_used(space, missing.name)
        if len(found) < len(plugins) and isinstance(leaf.node, ListNode):
            items = [item for item, plugin in zip(leaf.node.items, plugins) if plugin in found]
            leaf.node = ListNode(items, leaf.node.at)
        return found

    # --- lists --------------------------------------------------------------------------------------------------------

    def read(self, space: Space, key: str, registry: Registry[Any]) -> list[ListedPlugin] | None:
        """Return the entries of a plugin list; empty if it is not written, None after an error."""
        child = space.children.get(key)
        if child is None:
            return []
        fix = f'write {key} as a list of entries {{name: .., type: ".."}}'
        if isinstance(child, Space):
            for leaf in child.leaves():
                leaf.used = True
            message = f"{key} is a namespace, not a list; {fix}"
            self.add_finding("error", "plugin-list", child.at, child.path, message)
            return None
        child.used = True
        node = child.node
        if not isinstance(node, ListNode):
            empty = isinstance(node, ScalarNode) and node.value is None
            message = f"{key} {'has no value' if empty else f'is {_shown(node)}, not a list'}; {fix}"
            self.add_finding("error", "plugin-list", node.at, child.path, message)
            return None
        plugins = self._entries(node, key, child)
        if plugins is None:
            return None
        self.binder.origins[child.path] = node.at
        return self._without_missing(registry, plugins, space, child) if self.allow_missing else plugins

    def read_recoveries(self, root: Space) -> list[ListedPlugin] | None:
        """Return the entries of `recovery_behaviors`; a list that cannot be read counts as not written, as in ROS."""
        before = len(self.findings)
        listed = self.read(root, "recovery_behaviors", RECOVERY_BEHAVIORS)
        if listed is not None:
            return listed
        self.findings[before:] = [
            replace(f, severity="warning", message=f"{f.message}; {BUILT_IN}") if f.rule == "plugin-list" else f
            for f in self.findings[before:]
        ]
        leaf = root.leaf("recovery_behaviors")
        for item in leaf.node.items if leaf is not None and isinstance(leaf.node, ListNode) else ():
            name = item.items.get("name") if isinstance(item, DictNode) else None
            if name is not None and isinstance(name[1], ScalarNode):
                mark_used(root, str(name[1].value))
        del root.children["recovery_behaviors"]
        return []

    def _entries(self, node: ListNode, key: str, leaf: Leaf) -> list[ListedPlugin] | None:
        plugins: list[ListedPlugin] = []
        good = True
        for number, item in enumerate(node.items, 1):
            plugin = self._entry(item, key, leaf, number)
            if plugin is None:
                good = False
                continue
            twin = next((p for p in plugins if p.name == plugin.name), None)
            if twin is not None:
                message = f'{key} has two entries named "{plugin.name}" (the first at {twin.at}); use unique names'
                self.add_finding("error", "plugin-list", plugin.at, leaf.path, message)
                good = False
                continue
            plugins.append(plugin)
        return plugins if good else None

    def _entry(self, item: Node, key: str, leaf: Leaf, number: int) -> ListedPlugin | None:
        fix = 'write it as {name: .., type: ".."}'
        if key == "critics" and isinstance(item, ScalarNode) and isinstance(item.value, str) and item.value:
            return ListedPlugin(item.value, item.value, item.at, leaf.path)  # as in Nav2
        if not isinstance(item, DictNode):
            message = f"entry {number} of {key} is {_shown(item)}; {fix}"
            self.add_finding("error", "plugin-list", item.at, leaf.path, message)
            return None
        values: dict[str, str] = {}
        at = item.at
        for name in ("name", "type"):
            found = item.items.get(name)
            value = found[1].value if found is not None and isinstance(found[1], ScalarNode) else None
            if not isinstance(value, str) or not value:
                problem = f"has no {name}" if found is None else f"has a {name} that is not text"
                where = found[1].at if found else item.at
                self.add_finding("error", "plugin-list", where, leaf.path, f"entry {number} of {key} {problem}; {fix}")
                return None
            values[name] = value
            if name == "type" and found is not None:
                at = found[1].at
        for name, (there, _) in item.items.items():
            if name not in values:
                message = f"{name} in an entry of {key} has no effect; write the parameters of {values['name']} in its namespace"
                self.add_finding("warning", "unknown", there, f"{leaf.path}/{name}", message)
        return ListedPlugin(values["name"], values["type"], at, leaf.path)


def _closest(registry: Registry[Any], written: str) -> str | None:
    """The name closest to a misspelt one, written as that one: with or without a ROS package."""
    names: dict[str, list[str]] = {}
    for entry in registry:
        for name in (entry.name, *(short_type(a) for a in entry.aliases)):
            names.setdefault(name, []).append(entry.name if _is_bare(written) else entry.ros_name)
    close = nearest(short_type(written), names, cutoff=0.75)
    if close is None:
        return None
    # types of several packages may have the name: that of the package that is written, then that of the name itself
    package = normalize(written).rpartition("/")[0]
    found = min(names[close], key=lambda name: (name.rpartition("/")[0] != package, name != close))
    # a class of another package is another plugin, unless its name is the same but for a typo
    same_package = not package or is_typo(package, normalize(found).rpartition("/")[0])
    return found if same_package or is_typo(short_type(written), close) else None


def _is_bare(type_: str) -> bool:
    """True for a type without a ROS package, as Nav2 lists critics: CostCritic."""
    return "/" not in type_ and "::" not in type_


def _shown(node: Node) -> str:
    if isinstance(node, ScalarNode):
        return f'"{node.text}"' if isinstance(node.value, str) else node.text or "nothing"
    return "a list" if isinstance(node, ListNode) else "a mapping"


# ----------------------------------------------------------------------------------------------------------------------
# Namespaces in which the parameters of planners and layers are usually written.


def planner_namespaces(entry: Plugin[Any], written: str = "") -> list[str]:
    """Return the possible namespaces of a planner: of its type as written, of its ROS names, its registered names."""
    names = [short_type(written)] if "/" in normalize(written) else []
    return list(dict.fromkeys([*names, *own_namespaces(entry.name, entry.aliases), *shared_namespaces(entry)]))


def own_namespaces(name: str, aliases: tuple[str, ...]) -> list[str]:
    """Return the namespaces that only the planner of these names uses: of its ROS names, its registered names."""
    ros = [short_type(alias) for alias in aliases if "/" in alias]
    return list(dict.fromkeys([*ros, name, *(alias for alias in aliases if "/" not in alias)]))


def shared_namespaces(entry: Plugin[Any]) -> tuple[str, ...]:
    """Return the names of Nav2's files (`FollowPath`), which do not say which planner is meant."""
    return tuple(getattr(entry.cls, "NAMESPACES", ()))


def planner_space(root: Space, entry: Plugin[Any], written: str) -> Space:
    """Return the first of the planner's namespaces that is written, an empty one otherwise."""
    names = planner_namespaces(entry, written)
    for name in names:
        space = root.space(name)
        if space is not None:
            return space
    return Space(root.join(names[0]), root.at, root)


def layer_names(registered: str) -> list[str]:
    """Return the instance names that layers of a type usually have, the plain one first."""
    base = registered.removesuffix("_layer")
    names = [f"{base}_layer", base, f"{base}r_layer"]
    if base == "voxel":
        names = ["obstacle_layer", "voxel_layer", *names]
    return list(dict.fromkeys(names))

"""The tree of the parameter server, namespaces and values with their locations, that sources of parameters are merged into."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.yaml_reader import DictNode, Node, plain

if TYPE_CHECKING:
    from navstack.plugins import Registry

MAX_DEPTH = 50
"""Namespaces within each other; the methods of a namespace recurse."""

COSTMAPS = ("global_costmap", "local_costmap")
"""The namespaces of move_base's two costmaps."""


class Leaf:
    """A parameter."""

    __slots__ = ("at", "node", "path", "used")

    def __init__(self, path: str, at: Location, node: Node) -> None:
        self.path = path
        self.at = at
        """Location of its key."""
        self.node = node
        self.used = False
        """True if it was read or reported."""

    @property
    def value(self) -> Any:
        """The value as Python objects."""
        return plain(self.node)

    @property
    def name(self) -> str:
        """The last part of its path."""
        return self.path.rpartition("/")[2]


class Space:
    """A namespace."""

    __slots__ = ("at", "children", "parent", "path", "used")

    def __init__(self, path: str, at: Location, parent: Space | None = None) -> None:
        self.path = path
        self.at = at
        self.parent = parent
        self.children: dict[str, Leaf | Space] = {}
        self.used = False
        """True if a model was read from it."""

    @property
    def name(self) -> str:
        """The last part of its path."""
        return self.path.rpartition("/")[2]

    def join(self, name: str) -> str:
        """Return the path of a child."""
        return f"{self.path}/{name}" if self.path else name

    def leaf(self, name: str) -> Leaf | None:
        """Return the parameter `name` of this namespace."""
        found = self.children.get(name)
        return found if isinstance(found, Leaf) else None

    def space(self, name: str) -> Space | None:
        """Return the namespace `name` in this one."""
        found = self.children.get(name)
        return found if isinstance(found, Space) else None

    def search(self, name: str) -> Leaf | None:
        """Return the nearest parameter `name` in this or the enclosing namespaces (ROS searchParam)."""
        at: Space | None = self
        while at is not None:
            found = at.leaf(name)
            if found is not None:
                return found
            at = at.parent
        return None

    def leaves(self) -> Iterator[Leaf]:
        """Yield every parameter in and below this namespace."""
        for child in self.children.values():
            if isinstance(child, Leaf):
                yield child
            else:
                yield from child.leaves()

    def ensure(self, name: str, at: Location) -> Space:
        """Return the namespace `name`, created if it does not exist."""
        found = self.children.get(name)
        if isinstance(found, Space):
            return found
        made = Space(self.join(name), at, self)
        self.children[name] = made
        return made

    def put(self, name: str, at: Location, node: Node) -> Leaf:
        """Set a parameter, replacing a parameter or namespace of that name."""
        made = Leaf(self.join(name), at, node)
        self.children.pop(name, None)
        self.children[name] = made
        return made

    def as_node(self) -> DictNode:
        """Return the tree as a mapping with locations."""
        return DictNode(
            {k: (c.at, c.node if isinstance(c, Leaf) else c.as_node()) for k, c in self.children.items()}, self.at
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the tree as plain dictionaries."""
        return {k: (c.value if isinstance(c, Leaf) else c.as_dict()) for k, c in self.children.items()}


def parts_of(key: str) -> list[str]:
    """Split a name at its slashes: `/a//b/` -> a, b."""
    return [p for p in key.split("/") if p]


def overlay(space: Space, node: DictNode, findings: list[Finding]) -> None:
    """Merge a mapping into a namespace as roslaunch does: later values win, lists are replaced as a whole."""
    for key, (at, child) in node.items.items():
        names = parts_of(key)
        if not names:
            message = f'the key "{key}" is not a parameter name; rename or remove it'
            findings.append(finding("error", "no-name", at, space.join(key), message))
            continue
        into = space
        for name in names[:-1]:
            into = descend(into, name, at, findings)
        put(into, names[-1], at, child, findings)


def descend(space: Space, name: str, at: Location, findings: list[Finding]) -> Space:
    """Return the namespace `name` in `space`; a parameter of that name is dropped, with a finding.

    Beyond MAX_DEPTH, the namespace that is returned is not part of the tree.
    """
    found = space.leaf(name)
    if found is not None:
        if found.value is not None:
            message = f"{found.path} is a namespace here but a value before ({found.at}), which is dropped; remove one of them"
            findings.append(finding("warning", "namespace-over-value", at, found.path, message))
        del space.children[name]
    if space.path.count("/") >= MAX_DEPTH:
        message = f"the name has more than {MAX_DEPTH} parts, so its value is dropped; no parameter is nested that deep"
        findings.append(finding("error", "too-deep", at, space.path, message))
        return Space("", at)
    return space.ensure(name, at)


def put(space: Space, name: str, at: Location, node: Node, findings: list[Finding]) -> None:
    """Set a parameter, or merge a mapping into the namespace of that name."""
    if isinstance(node, DictNode):
        # an empty mapping is a namespace without parameters, which the parameter server does not keep
        overlay(descend(space, name, at, findings), node, findings)
        return
    found = space.space(name)
    if found is not None:
        if plain(node) is None:
            return
        if next(found.leaves(), None) is not None:
            message = (
                f"{found.path} is a value here but a namespace before ({found.at}), which is dropped with its parameters; "
                "remove one of them"
            )
            findings.append(finding("warning", "value-over-namespace", at, found.path, message))
    space.put(name, at, node)


# ----------------------------------------------------------------------------------------------------------------------
# What the tree of a robot of Nav2 was made of.


@dataclass(slots=True)
class Translation:
    """What became of Nav2's files."""

    distro: str = ""
    keys: dict[Location, str] = field(default_factory=dict[Location, str])
    """Location of a key or a value -> its name in Nav2: `controller_server/FollowPath.max_vel_x`."""
    sections: dict[str, str] = field(default_factory=dict[str, str])
    """Path of a section of the tree -> where its parameters stand in Nav2: MPPIController -> `controller_server/FollowPath.`"""
    unused: list[tuple[Registry[Any], str, Space, str]] = field(default_factory=list)
    """Controllers and planners that the default tree does not use: registry, type, section, id."""
    filters: set[str] = field(default_factory=set[str])
    """Ids of costmap filters, which Nav2 applies after all layers: nothing of them is to be inflated."""

    @property
    def ids(self) -> dict[str, str]:
        """Id of a plugin -> path of its section, for those at the root; of a behavior with several, the first is in use."""
        at_root = [(own.rpartition("/")[2].rstrip("."), path) for path, own in self.sections.items() if "/" not in path]
        found = dict(reversed(at_root))
        return {id_: path for id_, path in found.items() if id_ and id_ != path}

    @property
    def default_file(self) -> str:
        """The location of values that Nav2 has without being told."""
        return f"default of Nav2 {self.distro}"

    def own_key(self, found: Finding) -> Finding:
        """Return a finding about the tree with the user's own key."""
        key = self.keys.get(found.location, "") if found.line else ""
        message = found.message
        for section, own in self.sections.items():
            message = message.replace(f"{section}/", own)
            if not key and found.key.startswith(f"{section}/"):
                key = own + found.key[len(section) + 1 :].replace("/", ".")
        return replace(found, key=key or found.key, message=message)


# ----------------------------------------------------------------------------------------------------------------------
# The tree that sources of parameters are merged into.


@dataclass(slots=True)
class Sources:
    """The merged tree, the findings and the files read."""

    root: Space = field(default_factory=lambda: Space("", Location("")))
    findings: list[Finding] = field(default_factory=list[Finding])
    files: list[str] = field(default_factory=list[str])
    """Files read, as shown in messages, in order."""
    named: set[Path] = field(default_factory=set[Path])
    """Absolute paths of the files and folders that the user named."""
    descriptions: list[tuple[Path, dict[str, str]]] = field(default_factory=list[tuple[Path, dict[str, str]]])
    """URDF and xacro files that launch files name, each with its arguments."""
    overrides: list[str] = field(default_factory=list[str])
    """Names of the overrides in messages."""
    arguments: dict[str, str] = field(default_factory=dict[str, str])
    """Arguments for launch files: the sources of the form `name:=value`."""
    nav2: list[tuple[str, DictNode]] = field(default_factory=list[tuple[str, DictNode]])
    """Files of Nav2: name in messages, content."""
    beside_move_base: bool = False
    """Those files came after parameters of move_base, which count instead."""
    translation: Translation | None = None
    """What became of the files of Nav2; None without such files, or if they could not be read."""

    def add_finding(
        self, severity: Severity, rule: str, at: Location, message: str, suggestion: str | None = None
    ) -> None:
        """Add a finding about a whole source."""
        self.findings.append(finding(severity, rule, at, "", message, suggestion))

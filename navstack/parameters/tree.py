"""The parameter server's tree: namespaces and values, each with the place it came from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.yaml_reader import DictNode, Node, plain

COSTMAPS = ("global_costmap", "local_costmap")
"""The namespaces of move_base's two costmaps."""


class Leaf:
    """A parameter: a value that is no namespace."""

    __slots__ = ("at", "node", "path", "used")

    def __init__(self, path: str, at: Location, node: Node) -> None:
        self.path = path
        self.at = at
        """Where its key stands."""
        self.node = node
        self.used = False
        """True once something read it, or something was said about it."""

    @property
    def value(self) -> Any:
        """As Python values."""
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
        """True once something took its parameters from here."""

    @property
    def name(self) -> str:
        """The last part of its path."""
        return self.path.rpartition("/")[2]

    def join(self, name: str) -> str:
        """Path of a child."""
        return f"{self.path}/{name}" if self.path else name

    def leaf(self, name: str) -> Leaf | None:
        """The parameter of that name in this namespace."""
        found = self.children.get(name)
        return found if isinstance(found, Leaf) else None

    def space(self, name: str) -> Space | None:
        """The namespace of that name in this one."""
        found = self.children.get(name)
        return found if isinstance(found, Space) else None

    def search(self, name: str) -> Leaf | None:
        """The nearest parameter of that name here or in the enclosing namespaces (ROS searchParam)."""
        at: Space | None = self
        while at is not None:
            found = at.leaf(name)
            if found is not None:
                return found
            at = at.parent
        return None

    def leaves(self) -> Iterator[Leaf]:
        """Every parameter at and below this namespace."""
        for child in self.children.values():
            if isinstance(child, Leaf):
                yield child
            else:
                yield from child.leaves()

    def ensure(self, name: str, at: Location) -> Space:
        """The namespace of that name, made where it is missing."""
        found = self.children.get(name)
        if isinstance(found, Space):
            return found
        made = Space(self.join(name), at, self)
        self.children[name] = made
        return made

    def put(self, name: str, at: Location, node: Node) -> Leaf:
        """Sets a parameter, replacing what was there."""
        made = Leaf(self.join(name), at, node)
        self.children.pop(name, None)
        self.children[name] = made
        return made

    def as_node(self) -> DictNode:
        """The tree as a mapping, with its places."""
        return DictNode(
            {k: (c.at, c.node if isinstance(c, Leaf) else c.as_node()) for k, c in self.children.items()}, self.at
        )

    def as_dict(self) -> dict[str, Any]:
        """The tree as plain dictionaries."""
        return {k: (c.value if isinstance(c, Leaf) else c.as_dict()) for k, c in self.children.items()}


def parts_of(key: str) -> list[str]:
    """`/a//b/` -> a, b."""
    return [p for p in key.split("/") if p]


def overlay(space: Space, node: DictNode, findings: list[Finding]) -> None:
    """Lays a mapping over a namespace as roslaunch does: value by value, the later one wins; lists are replaced whole."""
    for key, (at, child) in node.items.items():
        names = parts_of(key)
        if not names:
            message = f'the key "{key}" is no parameter name; give it one or remove it'
            findings.append(finding("error", "no-name", at, space.join(key), message))
            continue
        into = space
        for name in names[:-1]:
            into = descend(into, name, at, findings)
        put(into, names[-1], at, child, findings)


def descend(space: Space, name: str, at: Location, findings: list[Finding]) -> Space:
    """The namespace `name` in `space`; a parameter of that name gives way, which is said."""
    found = space.leaf(name)
    if found is not None:
        if found.value is not None:
            message = f"{found.path} is a namespace here and was a value before ({found.at}); the value is dropped, remove one"
            findings.append(finding("warning", "namespace-over-value", at, found.path, message))
        del space.children[name]
    return space.ensure(name, at)


def put(space: Space, name: str, at: Location, node: Node, findings: list[Finding]) -> None:
    """Sets a parameter or lays a mapping over the namespace of that name."""
    if isinstance(node, DictNode):
        # an empty mapping is a namespace without parameters, which the parameter server forgets
        overlay(descend(space, name, at, findings), node, findings)
        return
    found = space.space(name)
    if found is not None:
        if plain(node) is None:
            return
        if next(found.leaves(), None) is not None:
            message = (
                f"{found.path} is a value here and was a namespace before ({found.at}); "
                "what stood in the namespace is dropped, remove one"
            )
            findings.append(finding("warning", "value-over-namespace", at, found.path, message))
    space.put(name, at, node)

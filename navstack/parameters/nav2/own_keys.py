"""The parameter of Nav2 behind a parameter of a translated robot, and its place in the user's file: what a rewrite edits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from navstack.parameters.findings import Location
from navstack.parameters.nav2.audit import NodeAudit, audits_of
from navstack.parameters.nav2.declared import NAV2_DISTROS, Declared
from navstack.parameters.nav2.document import Nodes, RosNode, read_nodes
from navstack.parameters.tree import Sources, Translation


class OwnKey(NamedTuple):
    """A parameter of a node of Nav2."""

    node: RosNode
    name: str
    """With dots: `FollowPath.PathDist.scale`."""
    row: Declared

    @property
    def text(self) -> str:
        """Its name on the command line: `controller_server.FollowPath.PathDist.scale`."""
        return f"{self.node.name}.{self.name}"

    def typed(self, value: Any) -> Any:
        """Return a value with the type that Nav2 declares; its strict parser takes no 1 for 1.0. None if it has none."""
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return value
        if self.row.type == "double":
            return float(value)
        if self.row.type == "int":
            return int(value) if float(value).is_integer() else None
        return value

    def neighbors(self) -> Iterator[tuple[Location, str]]:
        """Yield location and name of the parameters written for this node alone, those of the nearest block first."""
        block = self.name
        seen: set[str] = set()
        while block:
            block = block.rpartition(".")[0]
            for param in reversed(self.node.params.values()):
                inside = param.name.startswith(f"{block}.") if block else True
                if inside and not param.wild and param.name not in seen:
                    seen.add(param.name)
                    yield param.at, param.name


def own_keys(read: Sources) -> Mapping[str, OwnKey] | None:
    """Return the parameters of Nav2 by their names in the translated tree; None for sources that were not translated."""
    made = read.translation
    if made is None:
        return None
    nodes = read_nodes(read.nav2, read.arguments, [])
    if nodes is None:
        return None
    audits = audits_of(nodes, NAV2_DISTROS.index(made.distro))
    found: dict[str, OwnKey] = {}
    for path, node, prefix in _sections(made, nodes, audits):
        for name, row in audits[node.name].declared.items():
            if not row.native or not name.startswith(prefix) or not name.endswith(row.name):
                continue
            block = name[len(prefix) : len(name) - len(row.name)].replace(".", "/")
            full = f"{path}/{block}{row.native}".lstrip("/")
            found.setdefault(full, OwnKey(node, name, row))
    return found


def _sections(made: Translation, nodes: Nodes, audits: Mapping[str, NodeAudit]) -> Sequence[tuple[str, RosNode, str]]:
    """Section of the tree, node, prefix of the section's parameters there; the longest prefixes first."""
    found = [("", nodes.nodes["controller_server"], "")] if "controller_server" in audits else []
    for path, own in made.sections.items():
        name, _, prefix = own.partition("/")
        if name in audits:
            found.append((path, nodes.nodes[name], prefix))
    return sorted(found, key=lambda section: -len(section[2]))

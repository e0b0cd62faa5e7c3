"""Nav2's YAML -> the parameters of each node: namespaces, wildcards, dotted keys, substitutions of launch.

Sources: rcl_yaml_param_parser (structure, types), nav2_common's RewrittenYaml and launch_ros' ParameterFile (substitutions).
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.nodes import NODE_SECTIONS, ROS2_PARAMETERS
from navstack.parameters.tree import MAX_DEPTH
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode, scalar

COSTMAP_NODES: Final = ("global_costmap", "local_costmap")
SERVERS: Final[Mapping[str, str]] = {
    "amcl": "amcl",
    "behavior_server": "behavior_server",
    "bt_navigator": "bt_navigator",
    "collision_detector": "collision_detector",
    "collision_monitor": "collision_monitor",
    "controller_server": "controller_server",
    "costmap_filter_info_server": "costmap_filter_info_server",
    "docking_server": "docking_server",
    "filter_mask_server": "map_server",
    "following_server": "following_server",
    "global_costmap": "costmap",
    "keepout_costmap_filter_info_server": "costmap_filter_info_server",
    "keepout_filter_mask_server": "map_server",
    "lifecycle_manager": "lifecycle_manager",
    "lifecycle_manager_costmap_filters": "lifecycle_manager",
    "lifecycle_manager_localization": "lifecycle_manager",
    "lifecycle_manager_navigation": "lifecycle_manager",
    "local_costmap": "costmap",
    "loopback_simulator": "loopback_simulator",
    "map_saver": "map_saver",
    "map_server": "map_server",
    "planner_server": "planner_server",
    "recoveries_server": "behavior_server",
    "route_server": "route_server",
    "smoother_server": "smoother_server",
    "speed_costmap_filter_info_server": "costmap_filter_info_server",
    "speed_filter_mask_server": "map_server",
    "vector_object_server": "vector_object_server",
    "velocity_smoother": "velocity_smoother",
    "waypoint_follower": "waypoint_follower",
}
"""Names of Nav2's nodes -> their scope in the table."""
NAVIGATION: Final = ("controller_server", "planner_server")
"""The nodes without which nothing drives."""
_AUXILIARY: Final = re.compile(r"(_rclcpp_node|_client)\Z")
"""Internal nodes of Nav2 up to Humble, whose parameters nobody reads."""
NAMESPACE_TOKEN: Final = "<robot_namespace>"
_TOKENS: Final[Mapping[str, str]] = {
    "KEEPOUT_ZONE_ENABLED": "use_keepout_zones",
    "SPEED_ZONE_ENABLED": "use_speed_zones",
}
"""Values that nav2_bringup's launch files replace -> the launch argument; its default is true."""
_SHOWN: Final = 40
"""Characters of a name that is too long for a message."""
_SUBSTITUTION: Final = re.compile(r"\$\((find-pkg-share|env|var|dirname)(?:\s+([^()]*))?\)")


@dataclass(slots=True)
class Param:
    """A parameter of a node as written."""

    name: str
    """With dots: `FollowPath.max_vel_x`."""
    at: Location
    """Location of its key."""
    node: Node
    wild: bool = False
    """Written for several nodes at once (`/**`)."""


@dataclass(slots=True)
class RosNode:
    """A node and its parameters, the last written value of each."""

    name: str
    at: Location
    params: dict[str, Param] = field(default_factory=dict[str, Param])

    @property
    def scope(self) -> str:
        """Its name in the table."""
        return SERVERS[self.name]

    def key(self, name: str) -> str:
        """Return the full name of a parameter for a message: `controller_server/FollowPath.max_vel_x`."""
        return f"{self.name}/{name}"

    def value(self, name: str) -> object:
        """Return a scalar or a list of scalars as written; None if it is not."""
        param = self.params.get(name)
        if param is None:
            return None
        if isinstance(param.node, ListNode):
            return [n.value if isinstance(n, ScalarNode) else None for n in param.node.items]
        return param.node.value if isinstance(param.node, ScalarNode) else None

    def text(self, name: str) -> str | None:
        """Return a text parameter, None if it is not written or no text."""
        value = self.value(name)
        return value if isinstance(value, str) else None


@dataclass(frozen=True, slots=True)
class _Entry:
    """The `ros__parameters` of one pattern of node names."""

    pattern: tuple[str, ...]
    at: Location
    params: DictNode

    @property
    def is_wild(self) -> bool:
        return any("*" in part for part in self.pattern)


def entries(root: DictNode, above: tuple[str, ...] = ()) -> Iterator[_Entry]:
    """Yield everything below `ros__parameters` in the order of the file."""
    for key, (at, child) in root.items.items():
        if key == ROS2_PARAMETERS:
            if isinstance(child, DictNode):
                yield _Entry(above, at, child)
        elif isinstance(child, DictNode):
            parts = tuple(part for part in key.split("/") if part and part != NAMESPACE_TOKEN)
            yield from entries(child, (*above, *parts))


def is_nav2(root: DictNode) -> bool:
    """Return True for a file with the parameters of nodes of ROS 2."""
    return next(entries(root), None) is not None


def navigates(root: DictNode) -> bool:
    """Return True if a file has a node of Nav2 that a move_base robot cannot have as a section of its own."""
    return any(e.pattern and e.pattern[-1] not in NODE_SECTIONS for e in entries(root))


@dataclass(slots=True)
class Nodes:
    """The nodes of one robot."""

    namespace: str
    nodes: dict[str, RosNode]
    others: list[tuple[str, Location, int]] = field(default_factory=list[tuple[str, Location, int]])
    """Nodes that are not Nav2's: full name, location and number of parameters."""


def read_nodes(
    documents: Sequence[tuple[str, DictNode]], arguments: Mapping[str, str], findings: list[Finding]
) -> Nodes | None:
    """Return the nodes of the robot that the files describe; None if they describe several and none is chosen."""
    all_entries = [e for _, root in documents for e in entries(root)]
    namespace = _namespace(all_entries, arguments, findings)
    if namespace is None:
        return None
    found = Nodes("/".join(namespace), {})
    fill = _Filler(arguments, "/".join(namespace))
    deep: dict[Location, str] = {}
    for name in SERVERS:
        last = (name, name) if name in COSTMAP_NODES else (name,)
        full = (*namespace, *last)
        node = RosNode(name, Location(""))
        named = False
        for entry in all_entries:
            if not _matches(entry.pattern, full):
                continue
            if not entry.is_wild or entry.pattern[-1] == name:
                node.at, named = entry.at, True
            for param in _flat(entry.params, "", fill):
                if levels(param.name) > MAX_DEPTH:
                    deep.setdefault(param.at, param.name)
                    continue
                param.wild = entry.is_wild and entry.pattern[-1] != name
                node.params.pop(param.name, None)
                node.params[param.name] = param
        if named:
            found.nodes[name] = node
    for at, name in deep.items():
        findings.append(finding("error", "too-deep", at, shortened(name), f"the name {too_deep(name)}, or remove it"))
    _other_nodes(all_entries, namespace, found, findings)
    return found


def levels(name: str) -> int:
    """Return the number of levels of a name, which are sections of the tree."""
    return name.count(".") + name.count("/") + 1


def shortened(name: str) -> str:
    """Return a name that may be too long for a message."""
    return name if len(name) <= _SHOWN else f"{name[:_SHOWN]}.."


def too_deep(name: str) -> str:
    """Return what is wrong with a name of too many levels, and the fix."""
    return (
        f"{shortened(name)} has {levels(name)} levels, more than {MAX_DEPTH}, so it is dropped; nothing in Nav2 is nested that "
        "deep: shorten the name"
    )


def _namespace(
    all_entries: Sequence[_Entry], arguments: Mapping[str, str], findings: list[Finding]
) -> tuple[str, ...] | None:
    """The namespace of the robot: the one that is chosen, or the only one."""
    robots: dict[tuple[str, ...], Location] = {}
    for entry in all_entries:
        if not entry.is_wild and entry.pattern and entry.pattern[-1] in NAVIGATION:
            robots.setdefault(entry.pattern[:-1], entry.at)
    chosen = arguments.get("namespace")
    if chosen is not None:
        wanted = tuple(part for part in chosen.split("/") if part)
        if robots and wanted not in robots and () not in robots:
            known = ", ".join("/".join(r) for r in robots)
            message = f"namespace:={chosen} is not in the files; their robots are {known}"
            findings.append(finding("error", "nav2-namespace", next(iter(robots.values())), "", message))
            return None
        return wanted if wanted in robots else ()
    if len(robots) > 1 and () not in robots:
        known = ", ".join("/".join(r) for r in robots)
        first = "/".join(next(iter(robots)))
        message = f"the files describe {len(robots)} robots: {known}; choose one with namespace:={first}"
        findings.append(finding("error", "nav2-namespace", next(iter(robots.values())), "", message))
        return None
    return () if not robots or () in robots else next(iter(robots))


def _matches(pattern: Sequence[str], full: Sequence[str]) -> bool:
    """True if the pattern of an entry (`*` one part, `**` any number of parts) fits a full node name."""
    ends = {0}  # numbers of parts that the pattern so far fits
    for part in pattern:
        if part == "**":
            ends = set(range(min(ends), len(full) + 1))
        else:
            ends = {end + 1 for end in ends if end < len(full) and part in ("*", full[end])}
        if not ends:
            return False
    return len(full) in ends


def _other_nodes(
    all_entries: Sequence[_Entry], namespace: tuple[str, ...], found: Nodes, findings: list[Finding]
) -> None:
    """Note the entries of no node of Nav2, and report costmaps whose names are not doubled."""
    for entry in all_entries:
        name = "/".join(entry.pattern)
        last = entry.pattern[-1] if entry.pattern else ""
        if entry.is_wild or _AUXILIARY.search(last):
            continue
        if last in COSTMAP_NODES and entry.pattern == (*namespace, last):
            message = (
                f"the node {last} runs in the namespace {last}, so ROS 2 ignores these {len(entry.params.items)} parameters; "
                f"write `{last}: {last}: ros__parameters:`"
            )
            findings.append(finding("warning", "nav2-costmap-name", entry.at, last, message))
        elif last not in SERVERS or (last in COSTMAP_NODES and entry.pattern[-2:] != (last, last)):
            found.others.append((name, entry.at, len(entry.params.items)))


# --- values -----------------------------------------------------------------------------------------------------------


class _Filler:
    """Fills in what launch files replace."""

    def __init__(self, arguments: Mapping[str, str], namespace: str) -> None:
        self._arguments = arguments
        self._namespace = f"/{namespace}" if namespace else ""

    def __call__(self, node: Node) -> Node:
        if isinstance(node, ListNode):
            return ListNode([self(item) for item in node.items], node.at, node.size)
        if not isinstance(node, ScalarNode) or not isinstance(node.value, str):
            return node
        text = node.value.replace(NAMESPACE_TOKEN, self._namespace)
        if text in _TOKENS:
            text = self._arguments.get(_TOKENS[text], "true")
            return ScalarNode(text.strip().lower() == "true", node.at, False, text)
        filled = _SUBSTITUTION.sub(lambda match: self._substitute(match, node.at), text)
        if filled == node.value:
            return node
        return ScalarNode(filled if node.quoted else scalar(filled), node.at, node.quoted, filled)

    def _substitute(self, match: re.Match[str], at: Location) -> str:
        words = (match[2] or "").split()
        if match[1] == "dirname":
            return str(Path(at.file).parent)
        if match[1] == "var" and words:
            return self._arguments.get(words[0], match[0])
        if match[1] == "env" and words:
            return os.environ.get(words[0], " ".join(words[1:]) if len(words) > 1 else match[0])
        return match[0]


def _flat(root: DictNode, prefix: str, fill: _Filler) -> Iterator[Param]:
    """Yield the parameters below a mapping, with dotted names."""
    for key, (at, child) in root.items.items():
        if isinstance(child, DictNode):
            yield from _flat(child, f"{prefix}{key}.", fill)
        else:
            yield Param(f"{prefix}{key}", at, fill(child))

"""Nav2's nodes -> the tree of move_base that configurations bind; every value keeps its location in the user's file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from navstack.core import is_file
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.nav2.audit import Block, NodeAudit, audits_of, check_nodes, exists, find_distro, type_of
from navstack.parameters.nav2.declared import (
    CLASSES,
    ELOQUENT,
    EVERY_NODE,
    GALACTIC,
    HUMBLE,
    LYRICAL,
    NATIVE,
    NAV2_DISTROS,
    Declared,
    declared,
    declared_natively,
    exported_name,
)
from navstack.parameters.nav2.document import COSTMAP_NODES, NAVIGATION, Nodes, Param, RosNode, read_nodes
from navstack.parameters.spelling import nearest
from navstack.parameters.tree import Space, Translation
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.plugins import GLOBAL_PLANNERS, LAYERS, LOCAL_PLANNERS, SMOOTHERS, Registry

MAX_PLANNING_RETRIES: Final = 1
"""The default tree clears the global costmap and plans once more before it recovers."""
FOREVER_S: Final = 1e6
"""`failure_tolerance: -1.0`: as long as a goal can last."""
RECOVERIES: Final = 6
"""Recoveries of the default tree before a goal fails (number_of_retries)."""
SUBSTITUTE: Final = "nav2_mppi_controller::MPPIController"
_STAND_IN_PLANNER: Final = "navfn/NavfnROS"
_SPEEDS: Final = {"vx_max": ("max_vel_x", "max_linear_vel", "desired_linear_vel"), "wz_max": ("max_vel_theta",)}
"""Speeds of the controller that stands in -> those of others that it takes over."""


def translate(
    documents: Sequence[tuple[str, DictNode]],
    root: Space,
    findings: list[Finding],
    *,
    arguments: Mapping[str, str],
    distro: str | None,
    overrides: Sequence[tuple[str, Location, Node]] = (),
    substitute: bool = False,
    native: bool = True,
) -> Translation | None:
    """Read, check and translate Nav2's files into `root`; None if no robot could be read.

    `overrides` replace parameters: name (`controller_server.FollowPath.max_vel_x`), location, value. With `substitute`, another
    plugin stands in for one that navstack does not have. With `native`, plugins have Nav2's rules; otherwise those of ROS 1,
    where there are two of a kind.
    """
    nodes = read_nodes(documents, arguments, findings)
    if nodes is None:
        return None
    chosen = NAV2_DISTROS.index(distro) if distro is not None else -1
    if _is_eloquent(nodes, findings):
        return None
    if distro is None:
        guess = find_distro(nodes)
        chosen = guess.distro
        also = f" (or {', '.join(NAV2_DISTROS[i] for i in guess.also)})" if guess.also else ""
        message = f"the keys are those of Nav2 {NAV2_DISTROS[chosen]}{also}; name another distribution with --distro"
        findings.append(finding("info", "nav2-distro", Location(documents[0][0]), "", message))
    for name, at, value in overrides:
        _override(nodes, name, at, value, chosen)
    audits = audits_of(nodes, chosen)
    _check_overrides(nodes, audits, overrides, findings)
    findings += check_nodes(nodes, audits.values())
    missing = [name for name in NAVIGATION if name not in nodes.nodes]
    if missing:
        have = ", ".join(nodes.nodes) or "none of Nav2"
        message = (
            f"the files have no {' and no '.join(missing)} (their nodes: {have}), so nothing can drive; name the file that "
            "has them, too"
        )
        findings.append(finding("error", "nav2-no-server", Location(documents[0][0]), "", message))
        return None
    made = Translation(NAV2_DISTROS[chosen])
    _Translator(root, nodes, audits, chosen, made, findings, arguments, substitute, native).run()
    return made


def _is_eloquent(nodes: Nodes, findings: list[Finding]) -> bool:
    """Report a file of a distribution before Foxy."""
    for node in nodes.nodes.values():
        for name in sorted(ELOQUENT & node.params.keys()):
            message = (
                f"{node.name} lists its plugins with {name}, as Nav2 up to Eloquent does, which is not supported; write "
                "`plugins` with the names and `plugin: class` in the block of each, as from Foxy on"
            )
            findings.append(finding("error", "nav2-eloquent", node.params[name].at, node.key(name), message))
            return True
    return False


def override_target(documents: Sequence[tuple[str, DictNode]], name: str, arguments: Mapping[str, str]) -> bool:
    """Return True if a dotted name means a parameter of a node of the files, which must be replaced before the translation."""
    nodes = read_nodes(documents, arguments, [])
    return nodes is not None and _node_of(nodes, name) is not None


def _node_of(nodes: Nodes, name: str) -> tuple[RosNode, str] | None:
    """The node and the parameter that a name means: with the node's name first, or that of a block or parameter of one node."""
    first, _, rest = name.partition(".")
    if first in nodes.nodes and rest:
        if first in COSTMAP_NODES:
            rest = rest.removeprefix(f"{first}.")
        return nodes.nodes[first], rest
    holders = [
        node
        for node in nodes.nodes.values()
        if name in node.params or any(n.startswith(f"{first}.") for n in node.params if rest)
    ]
    return (holders[0], name) if len(holders) == 1 else None


def _override(nodes: Nodes, name: str, at: Location, value: Node, distro: int) -> None:
    target = _node_of(nodes, name)
    if target is None:
        return
    node, param = target
    row = NodeAudit(node, distro).declared.get(param)
    if row is not None and row.type == "double" and isinstance(value, ScalarNode) and type_of(value.value) == "int":
        value = ScalarNode(float(value.value), at, text=f"{value.value}.0")  # on a command line, 1 means 1.0
    node.params[param] = Param(param, at, value)


def _check_overrides(
    nodes: Nodes,
    audits: Mapping[str, NodeAudit],
    overrides: Sequence[tuple[str, Location, Node]],
    findings: list[Finding],
) -> None:
    """Report overrides of parameters that Nav2 does not declare: what the user asked for does not happen."""
    for name, at, _ in overrides:
        target = _node_of(nodes, name)
        if target is None:
            continue
        node, param = target
        audit = audits[node.name]
        if param in audit.declared or audit.is_free(param):
            continue
        del node.params[param]
        block = audit.block_of(param)
        prefix = block.prefix if block is not None else ""
        close = nearest(param[len(prefix) :], [n[len(prefix) :] for n in audit.declared if n.startswith(prefix)])
        last = param.rpartition(".")[2]
        hint = (
            f"did you mean {prefix}{close}?" if close else "`navstack params show` lists the parameters that there are"
        )
        if last in audit.declared:
            hint = f"it stands at the level of the server: write {node.name}.{last}"
        message = f"{name} sets nothing: {node.name} declares no {param} in Nav2 {NAV2_DISTROS[audit.distro]}; {hint}"
        findings.append(finding("error", "override", at, node.key(param), message, close))


# ----------------------------------------------------------------------------------------------------------------------
# The translation of one robot.


class _Translator:
    def __init__(
        self,
        root: Space,
        nodes: Nodes,
        audits: Mapping[str, NodeAudit],
        distro: int,
        made: Translation,
        findings: list[Finding],
        arguments: Mapping[str, str],
        substitute: bool,
        native: bool,
    ) -> None:
        self.root = root
        self.nodes = nodes
        self.audits = audits
        self.distro = distro
        self.made = made
        self.findings = findings
        self.arguments = arguments
        self.substitute = substitute
        self.classes = NATIVE if native else CLASSES
        self._table = declared_natively if native else declared
        self._default = Location(made.default_file)
        self._without: dict[str, list[str]] = {}
        """Node -> written keys that navstack has nothing for."""

    def run(self) -> None:
        self._controller_server()
        self._planner_server()
        for name in COSTMAP_NODES:
            self._costmap(name)
        self._one_base()
        self._behaviors()
        for name in ("velocity_smoother", "collision_monitor", "collision_detector", "amcl"):
            if name in self.nodes.nodes and exists(name, self.distro):
                self._node_section(name)
        self._docking()
        self._smoother_server()
        self._route_server()
        self._behavior_tree()
        self._report_without()
        self._report_not_run()
        for leaf in self.root.leaves():
            leaf.used = True

    # --- helpers ------------------------------------------------------------------------------------------------------

    def _declared(self, scope: str) -> Mapping[str, Declared]:
        return self._table(scope, self.distro)

    def _add(self, severity: Severity, rule: str, at: Location, key: str, message: str) -> None:
        self.findings.append(finding(severity, rule, at, key, message))

    def _scalar(self, value: Any, at: Location | None = None) -> ScalarNode:
        text = value if isinstance(value, str) else json.dumps(value)
        return ScalarNode(value, at or self._default, isinstance(value, str), text)

    def _node(self, value: Any, at: Location | None = None) -> Node:
        if isinstance(value, list):
            return ListNode([self._node(v, at) for v in value], at or self._default)
        if isinstance(value, dict):
            where = at or self._default
            return DictNode({k: (where, self._node(v, at)) for k, v in value.items()}, where)
        return self._scalar(value, at)

    def _put(self, space: Space, name: str, value: Any, at: Location | None = None) -> None:
        """Set a value that the file does not have; `at` is the location of what it stands for."""
        space.put(name, at or self._default, self._node(value, at))

    def _take(self, node: RosNode, param: Param, space: Space, name: str) -> None:
        """Set a value of the file, and remember what it is called there."""
        *above, last = name.split("/")
        for part in above:
            space = space.ensure(part, param.at)
        space.put(last, param.at, param.node)
        self.made.keys[param.at] = self.made.keys[param.node.at] = node.key(param.name)

    def _section(self, path: str, node: RosNode, prefix: str) -> Space:
        """The section of a block of a node."""
        space = self.root
        at = next((p.at for n, p in node.params.items() if n.startswith(prefix)), node.at)
        for part in path.split("/"):
            space = space.ensure(part, at)
        self.made.sections[path] = node.key(prefix)
        return space

    def _rows(self, node: RosNode, prefix: str, rows: Mapping[str, Declared], space: Space) -> None:
        """Translate what a scope declares: the written value, otherwise the default of the distribution."""
        for name, row in rows.items():
            param = node.params.get(prefix + name)
            if not row.counterpart:
                if param is not None:
                    self._without.setdefault(node.name, []).append(prefix + name)
            elif param is not None and not _is_empty(param.node):
                self._take(node, param, space, row.counterpart)
            elif param is None and row.default is not None and not self._is_written(space, row.counterpart):
                target = space
                *above, last = row.counterpart.split("/")
                for part in above:
                    target = target.ensure(part, self._default)
                self._put(target, last, row.default)

    def _is_written(self, space: Space, name: str) -> bool:
        *above, last = name.split("/")
        here: Space | None = space
        for part in above:
            here = here.space(part) if here is not None else None
        return here is not None and last in here.children

    def _report_without(self) -> None:
        for name, keys in self._without.items():
            node = self.nodes.nodes[name]
            shown = [k for k in keys if k.rpartition(".")[2] not in self._declared(EVERY_NODE)]
            if not shown:
                continue
            listed = ", ".join(shown[:_LISTED]) + (f" and {len(shown) - _LISTED} more" if len(shown) > _LISTED else "")
            message = f"navstack has nothing that these parameters of {name} would set: {listed}"
            self._add("info", "nav2-no-counterpart", node.params[shown[0]].at, name, message)

    def _report_not_run(self) -> None:
        """Note the nodes whose parameters are only checked."""
        idle = [n for n, a in self.audits.items() if not (a.runs or n == "bt_navigator") and exists(n, self.distro)]
        if idle:
            whose = "its" if len(idle) == 1 else "their"
            message = f"navstack does not run {', '.join(idle)}: {whose} parameters are checked, but they set nothing"
            self._add("info", "nav2-not-run", self.nodes.nodes[idle[0]].at, idle[0], message)

    def _behavior_tree(self) -> None:
        """The tree that drives goals: the file that the navigator names, or the default one."""
        navigator = self.nodes.nodes.get("bt_navigator")
        key = "default_nav_to_pose_bt_xml" if self.distro >= GALACTIC else "default_bt_xml_filename"
        named = navigator.text(key) if navigator is not None else None
        if navigator is not None:
            others = [n for n in navigator.params if n != key and n in self.audits[navigator.name].declared]
            self._without.setdefault(navigator.name, []).extend(others)
        space = self.root.ensure("navstack", self._default)
        default = DEFAULT_TREE + _TREES.get(NAV2_DISTROS[self.distro], "")
        if navigator is None or not named:
            self._put(space, "behavior_tree", default)
            return
        at = navigator.params[key].at
        self.made.keys[at] = navigator.key(key)
        file = _tree_file(named, Path(at.file).parent)
        if file is None and Path(named).stem not in DEFAULT_TREES:
            message = (
                f"the tree {Path(named).name} is not found, neither as {named} nor next to the parameters, so Nav2's default "
                "tree drives instead; put the file next to the parameters, or into a folder behavior_trees there"
            )
            self._add("warning", "nav2-tree", at, navigator.key(key), message)
        self._put(space, "behavior_tree", str(file) if file is not None else default, at)

    # --- controllers --------------------------------------------------------------------------------------------------

    def _controller_server(self) -> None:
        node, audit = self.nodes.nodes["controller_server"], self.audits["controller_server"]
        plain = {
            name: row
            for name, row in self._declared("controller_server").items()
            if row.counterpart in ("controller_frequency", "controller_patience") or not row.counterpart
        }
        plain = {n: r for n, r in plain.items() if not n.endswith(("_plugins", "_plugin"))}
        self._rows(node, "", plain, self.root)
        patience = self.root.leaf("controller_patience")
        if patience is not None and isinstance(patience.value, (int, float)) and patience.value < 0.0:
            self._put(self.root, "controller_patience", FOREVER_S, patience.at)
        self._checkers(node, audit)
        block = self._chosen(audit, "controller")
        if block is None:
            return
        kind = self._type_of(node, block, "controller", LOCAL_PLANNERS, SUBSTITUTE)
        for other in audit.of_kind("controller"):
            if other is not block:
                self._other(node, audit, other, LOCAL_PLANNERS, "controller")
        own = self.classes["controller"].get(block.scope, "")
        space = self._section((kind or own or block.id).rpartition("::")[2], node, block.prefix)
        if kind is not None:
            self._put(self.root, "base_local_planner", kind, block.at)
            self.made.keys[block.at] = node.key(f"{block.prefix}plugin")
        if own and kind in (own, None):
            self._controller(node, audit, block, space)
        elif kind is not None:
            self._stand_in(node, block, space)

    def _checkers(self, node: RosNode, audit: NodeAudit) -> None:
        """Goal checker, progress checker and path handler: sections next to the controller's."""
        for kind, key in (
            ("progress checker", "progress_checker_plugins"),
            ("goal checker", "goal_checker_plugins"),
            ("path handler", "path_handler_plugins"),
        ):
            blocks = audit.of_kind(kind)
            usable = [b for b in blocks if self.classes[kind].get(b.scope)]
            for block in blocks:
                if block not in usable and block.scope:
                    known = ", ".join(self.classes[kind])
                    message = f"navstack has no {kind} {block.scope} ({block.id}); use one of: {known}"
                    first = block is blocks[0]
                    if first and not self.substitute:
                        message += "; or let its default stand in with --substitute"
                    severity: Severity = "error" if first and not self.substitute else "warning"
                    self._add(severity, "nav2-no-such-plugin", block.at, node.key(f"{block.prefix}plugin"), message)
            if not blocks:
                continue
            chosen = next((b for b in usable if b is blocks[0]), None)
            self._put(self.root, key, [blocks[0].id], self._array_at(node, audit, kind))
            space = self._section(blocks[0].id, node, blocks[0].prefix)
            if chosen is None:
                continue
            self._put(space, "plugin", self.classes[kind][chosen.scope], chosen.at)
            self._rows(node, chosen.prefix, self._declared(chosen.scope), space)
            for block in usable:
                if block is not chosen:
                    other = self._section(block.id, node, block.prefix)
                    self._put(other, "plugin", self.classes[kind][block.scope], block.at)
                    self._rows(node, block.prefix, self._declared(block.scope), other)

    def _array_at(self, node: RosNode, audit: NodeAudit, kind: str) -> Location | None:
        key = next((k for k, of in audit.arrays.items() if of == kind), "")
        param = node.params.get(key)
        return param.node.at if param is not None else None

    def _controller(self, node: RosNode, audit: NodeAudit, block: Block, space: Space) -> None:
        """A controller that navstack has, with the blocks below its own."""
        rows = dict(self._declared(block.scope))
        primary = next(
            (
                b
                for b in audit.of_kind("primary controller")
                if b is not block
                and block.scope.endswith("::RotationShimController")
                and b.prefix.startswith(block.prefix)
            ),
            None,
        )
        rows.pop("primary_controller", None)
        rows.pop("critics", None)
        self._rows(node, block.prefix, rows, space)
        self._critics(node, audit, block, space)
        if "AckermannConstraints" in space.children and node.value(f"{block.prefix}motion_model") != "Ackermann":
            del space.children["AckermannConstraints"]  # only read by that motion model
        if node.value(f"{block.prefix}motion_model") not in _OMNI:
            for name in _SIDEWAYS:  # used by that motion model only, and never 0 there
                leaf = space.leaf(name)
                if leaf is not None and leaf.value == 0.0:
                    del space.children[name]
        model = node.text(f"{block.prefix}motion_model")
        if self.distro >= LYRICAL and model is not None:
            below = space.ensure(model, node.at)
            plugin = node.params.get(f"{block.prefix}{model}.plugin")
            if plugin is not None:
                self._take(node, plugin, below, "plugin")
            self._rows(node, f"{block.prefix}{model}.", self._declared("mppi motion model"), below)
        if primary is not None:
            self._primary(node, audit, primary, space)

    def _primary(self, node: RosNode, audit: NodeAudit, primary: Block, space: Space) -> None:
        kind = self._type_of(node, primary, "controller", LOCAL_PLANNERS, SUBSTITUTE)
        if kind is None:
            return
        below = space.ensure("primary_controller", primary.at)
        self.made.sections[below.path] = node.key(primary.prefix)
        self._put(below, "plugin", kind, primary.at)
        if self.classes["controller"].get(primary.scope) == kind:
            self._controller(node, audit, primary, below)
        else:
            self._stand_in(node, primary, below)

    def _critics(self, node: RosNode, audit: NodeAudit, block: Block, space: Space) -> None:
        listed = node.params.get(f"{block.prefix}critics")
        row = self._declared(block.scope).get("critics")
        if row is None:
            return
        if listed is None:
            if row.default is not None:
                self._put(space, "critics", row.default)
            return
        self._take(node, listed, space, "critics")
        if block.kind == "primary controller" and block.scope.startswith("nav2_mppi_controller"):
            entries = [{"name": name, "type": name} for name in _texts(listed.node)]
            self._put(space, "critics", entries, listed.node.at)
        for critic in audit.of_kind("critic"):
            if critic.prefix != f"{block.prefix}{critic.id}.":
                continue
            below = space.ensure(critic.id, critic.at)
            rows = dict(self._declared(critic.scope))
            if critic.scope.startswith("dwb_critics"):
                rows["class"] = Declared("class", "string", None, 0, LYRICAL, "class")
            self._rows(node, critic.prefix, rows, below)
            if not below.children:
                del space.children[critic.id]

    def _stand_in(self, node: RosNode, block: Block, space: Space) -> None:
        """The speeds that a controller that stands in takes over, and a step of its model as long as the control period."""
        frequency = self.root.leaf("controller_frequency")
        hertz = frequency.value if frequency is not None else None
        if isinstance(hertz, (int, float)) and hertz > 0.0:
            self._put(space, "model_dt", 1.0 / hertz)
        for name, others in _SPEEDS.items():
            param = next((p for o in others if (p := node.params.get(block.prefix + o)) is not None), None)
            if param is not None:
                self._take(node, param, space, name)

    def _chosen(self, audit: NodeAudit, kind: str) -> Block | None:
        """The plugin that the default tree uses: the first of the list, or the one that `controller:=ID` names."""
        blocks = audit.of_kind(kind)
        wanted = self.arguments.get(kind)
        found = next((b for b in blocks if b.id == wanted), None)
        if wanted is not None and found is None:
            known = ", ".join(b.id for b in blocks)
            close = nearest(wanted, [b.id for b in blocks])
            hint = f"did you mean {close}? " if close else ""
            message = f"{kind}:={wanted} is not in the files; {hint}known: {known}"
            self._add("error", "nav2-no-such-id", Location(f"{kind}:={wanted}"), "", message)
            return None
        if not blocks:
            message = f"{audit.node.name} lists no {kind}; write {kind}_plugins with its name"
            self._add("error", "nav2-no-such-id", audit.node.at, audit.node.name, message)
            return None
        return found or blocks[0]

    def _type_of(
        self, node: RosNode, block: Block, kind: str, registry: Registry[Any], stand_in: str, *, used: bool = True
    ) -> str | None:
        """The registered type of a plugin's class; None, with a finding, without one."""
        if not block.scope:
            return None  # reported by the audit
        made = self.classes[kind].get(block.scope, "")
        if made and made in registry:
            return made
        if not made and block.scope in registry:
            return block.scope  # a plugin of another package that is installed
        known = ", ".join(c for c, t in self.classes[kind].items() if t and t in registry)
        message = f"navstack has no {kind} {block.scope} ({block.id})"
        key = node.key(f"{block.prefix}plugin")
        if not used:
            self._add("info", "nav2-no-such-plugin", block.at, key, f"{message}; it is not used")
        elif self.substitute:
            self._add("warning", "nav2-substituted", block.at, key, f"{message}, so {stand_in} stands in")
            return stand_in
        else:
            message += f"; use one of: {known}; or let {stand_in} stand in with --substitute"
            self._add("error", "nav2-no-such-plugin", block.at, key, message)
        return None

    def _other(self, node: RosNode, audit: NodeAudit, block: Block, registry: Registry[Any], kind: str) -> None:
        """Translate a plugin that is not used into a tree of its own, to check its values."""
        stand_in = SUBSTITUTE if kind == "controller" else _STAND_IN_PLANNER
        made = self._type_of(node, block, kind, registry, stand_in, used=False)
        if made is None:
            return
        main, self.root = self.root, Space("", node.at)
        sections = dict(self.made.sections)
        for checker in ("goal_checker_plugins", "path_handler_plugins", "controller_frequency"):
            leaf = main.leaf(checker)
            if leaf is not None:
                self.root.put(checker, leaf.at, leaf.node)
        for name, child in main.children.items():
            if isinstance(child, Space) and child.leaf("plugin") is not None:
                copied = self.root.ensure(name, child.at)
                for leaf in child.children.values():
                    if not isinstance(leaf, Space):
                        copied.put(leaf.name, leaf.at, leaf.node)
        space = self._section(block.id, node, block.prefix)
        if kind == "controller":
            self._controller(node, audit, block, space)
        else:
            self._rows(node, block.prefix, self._declared(block.scope), space)
        self.made.unused.append((registry, made, space, block.id))
        self.root, self.made.sections = main, sections

    # --- planners -----------------------------------------------------------------------------------------------------

    def _planner_server(self) -> None:
        node, audit = self.nodes.nodes["planner_server"], self.audits["planner_server"]
        rows = {n: r for n, r in self._declared("planner_server").items() if not r.counterpart}
        self._rows(node, "", rows, self.root)
        block = self._chosen(audit, "planner")
        self._put(self.root, "planner_frequency", 1.0)
        self._put(self.root, "max_planning_retries", MAX_PLANNING_RETRIES)
        if block is None:
            return
        kind = self._type_of(node, block, "planner", GLOBAL_PLANNERS, _STAND_IN_PLANNER)
        for other in audit.of_kind("planner"):
            if other is not block:
                self._other(node, audit, other, GLOBAL_PLANNERS, "planner")
        if kind is None:
            return
        self._put(self.root, "base_global_planner", kind, block.at)
        self.made.keys[block.at] = node.key(f"{block.prefix}plugin")
        name = kind.replace("::", "/").rpartition("/")[2]
        space = self._section(name, node, block.prefix)
        if self.classes["planner"].get(block.scope) == kind:
            self._rows(node, block.prefix, self._declared(block.scope), space)

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def _costmap(self, name: str) -> None:
        node = self.nodes.nodes.get(name)
        if node is None:
            node = RosNode(name, self.nodes.nodes["planner_server"].at)
            message = (
                f"the files have no {name}, so it has the defaults of Nav2 {NAV2_DISTROS[self.distro]}; add "
                f"`{name}: {name}: ros__parameters:`"
            )
            self._add("warning", "nav2-no-costmap", node.at, name, message)
        audit = self.audits.get(name) or NodeAudit(node, self.distro)
        space = self._section(name, node, "")
        rows = dict(self._declared("costmap"))
        rows.pop("plugins", None)
        shared = {n: rows.pop(n) for n in list(rows) if rows[n].counterpart.startswith("static/")}
        self._rows(node, "", rows, space)
        static = {n: r._replace(counterpart=r.counterpart.partition("/")[2]) for n, r in shared.items()}
        layers = self._layers(node, audit, "", name, static)
        layers += self._filters(node, audit, name)
        listed = node.params.get("plugins")
        at = listed.node.at if listed is not None else self._default
        entries: list[Node] = []
        for id_, kind, where in layers:
            items: dict[str, tuple[Location, Node]] = {
                "name": (where, self._scalar(id_, where)),
                "type": (where, self._scalar(kind, where)),
            }
            entries.append(DictNode(items, where))
        space.put("plugins", at, ListNode(entries, at))

    def _layers(
        self, node: RosNode, audit: NodeAudit, prefix: str, path: str, static: Mapping[str, Declared]
    ) -> list[tuple[str, str, Location]]:
        """Translate the layers of a costmap, or of a container of layers: name, type and location of each."""
        found: list[tuple[str, str, Location]] = []
        for block in audit.of_kind("layer"):
            if block.prefix != f"{prefix}{block.id}.":
                continue
            kind = self._layer_type(node, block)
            if kind is None:
                continue
            found.append((block.id, kind, block.at))
            section = f"{path}/{block.id}"
            below = self._section(section, node, block.prefix)
            if self.classes["layer"].get(block.scope) == kind:
                self._rows(node, block.prefix, self._layer_rows(block), below)
            elif block.scope == _ASYMMETRIC:
                self._rows(node, block.prefix, self._declared(_ASYMMETRIC), below)
                self._symmetric_factor(node, block, below)
            if block.scope == "nav2_costmap_2d::StaticLayer":
                self._rows(node, "", static, below)
            for source in audit.of_kind("layer source"):
                if source.prefix == f"{block.prefix}{source.id}.":
                    at_source = self._section(f"{section}/{source.id}", node, source.prefix)
                    self._rows(node, source.prefix, self._declared(source.scope), at_source)
            if block.scope == "nav2_costmap_2d::PluginContainerLayer":
                inside = self._layers(node, audit, block.prefix, section, static)
                self._put(below, "plugins", [id_ for id_, _, _ in inside], block.at)
                for id_, inner, at in inside:
                    self._put(below.ensure(id_, at), "plugin", inner, at)
        return found

    def _one_base(self) -> None:
        """Give both costmaps the base frame of the local one: base_link and base_footprint of a planar robot are one frame."""
        both = [self.root.space(name) for name in COSTMAP_NODES]
        leaves = [space.leaf("robot_base_frame") for space in both if space is not None]
        if len(leaves) == 2 and leaves[0] is not None and leaves[1] is not None and leaves[0].value != leaves[1].value:
            one, other = leaves[0].value, leaves[1].value
            message = f"robot_base_frame = {one} of global_costmap is taken as {other}, that of local_costmap: poses are planar"
            self._add("info", "nav2-base-frame", leaves[0].at, "global_costmap/robot_base_frame", message)
            leaves[0].node = self._node(other, leaves[0].node.at)

    def _layer_rows(self, block: Block) -> dict[str, Declared]:
        rows = dict(self._declared(block.scope))
        if block.scope == "nav2_costmap_2d::StaticLayer":
            rows.pop("map_topic", None)  # the map is passed by the program
        return rows

    def _symmetric_factor(self, node: RosNode, block: Block, below: Space) -> None:
        """The decay of the costs where no plan is near: the larger of both sides."""
        rows = self._declared(_ASYMMETRIC)
        sides = [f"cost_scaling_factor_{side}" for side in ("left", "right")]
        given = [(node.value(block.prefix + name), name) for name in sides]
        values = [value if isinstance(value, (int, float)) else rows[name].default for value, name in given]
        self._put(below, "cost_scaling_factor", max(values), block.at)

    def _layer_type(self, node: RosNode, block: Block) -> str | None:
        if not block.scope:
            return None
        kind = self.classes["layer"].get(block.scope, "")
        if kind and kind in LAYERS:
            return kind
        if not kind and block.scope in LAYERS:
            return block.scope
        message = f"navstack has no layer {block.scope} ({block.id})"
        key = node.key(f"{block.prefix}plugin")
        if block.scope == _ASYMMETRIC:
            message += ", whose costs depend on the plan, which layers of navstack do not see"
            if self.substitute:
                message += f", so {_BASELINE} stands in with the larger of its cost_scaling_factors"
                self._add("warning", "nav2-substituted", block.at, key, message)
                return self.classes["layer"][_BASELINE]
            message += (
                f"; write {_BASELINE} with the larger of cost_scaling_factor_left and cost_scaling_factor_right, its costs "
                "away from the plan, or let that stand in with --substitute"
            )
            self._add("error", "nav2-no-such-plugin", block.at, key, message)
            return None
        if self.substitute:
            self._add("warning", "nav2-substituted", block.at, key, f"{message}, so it is left out")
        else:
            known = ", ".join(exported_name("layer", c, self.distro) for c, t in self.classes["layer"].items() if t)
            message += f"; use one of: {known}; or leave it out with --substitute"
            self._add("error", "nav2-no-such-plugin", block.at, key, message)
        return None

    def _filters(self, node: RosNode, audit: NodeAudit, name: str) -> Iterator[tuple[str, str, Location]]:
        for block in audit.of_kind("filter"):
            if not block.scope:
                continue
            kind = self.classes["filter"].get(block.scope, "")
            if not kind:
                message = f"navstack has no filter {block.scope} ({block.id}), so it is left out"
                self._add("warning", "nav2-no-such-plugin", block.at, node.key(f"{block.prefix}plugin"), message)
                continue
            path = f"{name}/{block.id}"
            below = self._section(path, node, block.prefix)
            self._rows(node, block.prefix, self._declared(block.scope), below)
            enabled = node.params.get(f"{block.prefix}enabled")
            if enabled is not None:
                self._take(node, enabled, below, "enabled")
            self._mask(node, block, below)
            self.made.filters.add(block.id)
            yield block.id, kind, block.at

    def _mask(self, node: RosNode, block: Block, below: Space) -> None:
        """The mask of a filter, found through the info server and the map server that its topics name."""
        topic = node.text(f"{block.prefix}filter_info_topic") or ""
        param = node.params.get(f"{block.prefix}filter_info_topic")
        at = param.at if param is not None else block.at
        if topic:
            self._put(below, "filter_info_topic", topic, at)

        def left_out(why: str) -> None:
            message = f"{block.id} has no effect: {why}; name the mask: --set {below.path}/mask=FILE.yaml"
            self._add("info", "nav2-no-mask", at, node.key(f"{block.prefix}filter_info_topic"), message)

        info = self._publisher("costmap_filter_info_server", "filter_info_topic", topic, "costmap_filter_info")
        if info is None:
            left_out(f"no costmap_filter_info_server of the files publishes {topic or 'its filter_info_topic'}")
            return
        mask_topic = info.text("mask_topic") or "filter_mask"
        server = self._publisher("map_server", "topic_name", mask_topic, "map")
        file = server.text("yaml_filename") if server is not None else None
        if server is None or not file:
            left_out(f"no map server of the files has a yaml_filename for {mask_topic}")
            return
        written = server.params["yaml_filename"]
        path = Path(file) if Path(file).is_absolute() else Path(written.at.file).parent / file
        if not is_file(path):
            left_out(f"its mask {file} is not a file next to the parameters")
            return
        self._put(below, "mask", str(path), written.at)
        kind = info.value("type")
        if "Speed" in block.scope:
            self._put(below, "type", "absolute" if kind == 2 else "percent", info.at)
        if "Keepout" not in block.scope:
            for name in ("base", "multiplier"):
                if name in info.params:
                    self._take(info, info.params[name], below, name)

    def _publisher(self, scope: str, key: str, topic: str, default: str) -> RosNode | None:
        """The node of a kind whose parameter names a topic."""
        for node in self.nodes.nodes.values():
            if node.scope == scope and (node.text(key) or default).strip("/") == topic.strip("/"):
                return node
        return None

    # --- behaviors and further nodes ----------------------------------------------------------------------------------

    def _behaviors(self) -> None:
        """The recovery branch of the default tree, with the behaviors of the behavior server."""
        name = "behavior_server" if self.distro >= HUMBLE else "recoveries_server"
        node = self.nodes.nodes.get(name)
        audit = self.audits.get(name)
        if node is None or audit is None:
            node = RosNode(name, self._default)
            audit = NodeAudit(node, self.distro)
        rows = self._declared("behavior_server")
        self._rows(node, "", {n: r for n, r in rows.items() if not r.counterpart}, self.root)
        order = [("Spin", {"spin_dist": 1.57}), ("Wait", {"wait_duration": 5.0})]
        if self.distro > GALACTIC:
            order.append(("BackUp", {"backup_dist": 0.3, "backup_speed": 0.05 if self.distro == HUMBLE else 0.15}))
        usable: list[tuple[str, str, Block | None, dict[str, float]]] = [
            ("clear_costmaps", "clear_costmap_recovery/ClearCostmapRecovery", None, {"reset_distance": 0.0})
        ]
        blocks = {b.scope: b for b in audit.of_kind("behavior")}
        for cls, values in order:
            block = blocks.get(f"nav2_behaviors::{cls}")
            if block is not None:
                usable.append((block.id, f"nav2_behaviors::{cls}", block, values))
        entries: list[dict[str, str]] = []
        for number in range(RECOVERIES):
            id_, kind, block, values = usable[number % len(usable)]
            again = number // len(usable)
            section = f"{id_}_{again + 1}" if again else id_
            entries.append({"name": section, "type": kind})
            space = self._section(section, node, block.prefix if block is not None else f"{section}.")
            for key, value in values.items():
                self._put(space, key, value)
            if block is not None and "Wait" not in kind:
                self._behavior_rows(node, kind, rows, space)
        self._put(self.root, "recovery_behaviors", entries)
        self._other_behaviors(node, audit, rows, {block.id for _, _, block, _ in usable if block is not None})
        for block in audit.of_kind("behavior"):
            if block.scope and not self.classes["behavior"].get(block.scope):
                message = f"navstack has no behavior {block.scope} ({block.id}); the default tree does not use it"
                self._add("info", "nav2-no-such-plugin", block.at, node.key(f"{block.prefix}plugin"), message)

    def _other_behaviors(
        self, node: RosNode, audit: NodeAudit, rows: Mapping[str, Declared], recoveries: set[str]
    ) -> None:
        """The behaviors of the server that are no recoveries of the default tree, for other trees."""
        entries: list[dict[str, str]] = []
        for block in audit.of_kind("behavior"):
            kind = self.classes["behavior"].get(block.scope, "")
            if not kind or block.id in recoveries:
                continue
            space = self._section(block.id, node, block.prefix)
            if not kind.endswith("Wait"):
                self._behavior_rows(node, kind, rows, space)
            entries.append({"name": block.id, "type": kind})
        if entries:
            self._put(self.root, "behavior_plugins", entries)

    def _behavior_rows(self, node: RosNode, kind: str, rows: Mapping[str, Declared], space: Space) -> None:
        """Keys at the level of the server, which its behaviors share."""
        own = {"cycle_frequency", "simulate_ahead_time"}
        if kind.endswith("Spin"):
            own |= {"max_rotational_vel", "min_rotational_vel", "rotational_acc_lim"}
        elif kind.endswith("AssistedTeleop"):
            own = {"cycle_frequency", "projection_time", "simulation_time_step"}
        shared = {n: r._replace(counterpart=r.counterpart.partition("/")[2]) for n, r in rows.items() if n in own}
        self._rows(node, "", shared, space)
        slowest = space.leaf("min_rotational_vel")
        if slowest is not None and isinstance(slowest.value, (int, float)) and slowest.value < 0.0:
            self._put(space, "min_rotational_vel", 0.0, slowest.at)  # Nav2 takes a negative one as none

    def _node_section(self, name: str) -> None:
        """A node that navstack has with Nav2's keys."""
        node, audit = self.nodes.nodes[name], self.audits[name]
        space = self._section(name, node, "")
        rows = dict(self._declared(name))
        if name != "amcl":
            rows.pop("base_frame_id", None)
            if "odom_frame_id" not in node.params:
                rows.pop("odom_frame_id", None)
            self._base_frame(node)
        else:
            rows = {n: r for n, r in rows.items() if not n.startswith("initial_pose.") or n in node.params}
        self._rows(node, "", rows, space)
        for kind, scope in (
            ("zone", "monitor polygon"),
            ("monitor source", "monitor source"),
            ("sub-polygon", "monitor sub-polygon"),
            ("exclusion zone", "monitor exclusion zone"),
        ):
            for block in audit.of_kind(kind):
                below = self._section(f"{name}/{block.prefix[:-1].replace('.', '/')}", node, block.prefix)
                rows = {n: r for n, r in self._declared(scope).items() if block.prefix + n in node.params}
                self._rows(node, block.prefix, rows, below)

    def _docking(self) -> None:
        """The docking server, with the types of docks and the docks."""
        name = "docking_server"
        if name not in self.nodes.nodes or not exists(name, self.distro):
            return
        node, audit = self.nodes.nodes[name], self.audits[name]
        space = self._section(name, node, "")
        self._rows(node, "", self._declared(name), space)
        self._dock_database(node, space)
        backwards = node.params.get("dock_backwards")
        for block in audit.of_kind("dock plugin"):
            below = self._section(f"{name}/{block.id}", node, block.prefix)
            plugin = node.params.get(f"{block.prefix}plugin")
            if plugin is not None:
                self._take(node, plugin, below, "plugin")
            self._rows(node, block.prefix, self._declared(block.scope), below)
            for param in node.params.values():
                if not block.known and param.name.startswith(
                    block.prefix
                ):  # a type of another package has its own names
                    self._take(node, param, below, param.name.removeprefix(block.prefix).replace(".", "/"))
            if backwards is not None and node.value("dock_backwards") is True:
                self._put(below, "dock_direction", "backward", backwards.at)
        for block in audit.of_kind("dock"):
            at_dock = self._section(f"{name}/{block.id}", node, block.prefix)
            self._rows(node, block.prefix, self._declared("dock"), at_dock)

    def _dock_database(self, node: RosNode, space: Space) -> None:
        """The file of docks: where the parameters say, or under its name next to them."""
        named, param = node.text("dock_database"), node.params.get("dock_database")
        if not named or param is None:
            return
        file = _next_to(named, Path(param.at.file).parent)
        if file is not None:
            self._put(space, "dock_database", str(file), param.at)
            return
        message = (
            f"the dock database {Path(named).name} is not found, neither as {named} nor next to the parameters, so no dock has "
            "a name; put the file next to the parameters"
        )
        self._add("warning", "nav2-docks", param.at, node.key("dock_database"), message)
        self._put(space, "dock_database", "", param.at)

    def _smoother_server(self) -> None:
        """The smoothers of the server, which trees ask for by their ids."""
        name = "smoother_server"
        if name not in self.nodes.nodes or not exists(name, self.distro):
            return
        node, audit = self.nodes.nodes[name], self.audits[name]
        space = self._section(name, node, "")
        entries: list[dict[str, str]] = []
        for block in audit.of_kind("smoother"):
            kind = self.classes["smoother"].get(block.scope, block.scope)
            if kind not in SMOOTHERS:
                if block.scope:
                    message = f"navstack has no smoother {block.scope} ({block.id}); a tree that asks for it fails with code 501"
                    self._add("warning", "nav2-no-such-plugin", block.at, node.key(f"{block.prefix}plugin"), message)
                continue
            entries.append({"name": block.id, "type": kind})
            below = self._section(f"{name}/{block.id}", node, block.prefix)
            self._rows(node, block.prefix, self._declared(block.scope), below)
        self._put(space, "smoother_plugins", entries, self._array_at(node, audit, "smoother"))

    def _route_server(self) -> None:
        """The graph of routes with its edge scorers and operations."""
        name = "route_server"
        if name not in self.nodes.nodes or not exists(name, self.distro):
            return
        node, audit = self.nodes.nodes[name], self.audits[name]
        space = self._section(name, node, "")
        self._rows(node, "", self._declared(name), space)
        for kind in ("edge scorer", "route operation"):
            for block in audit.of_kind(kind):
                if block.scope:
                    below = self._section(f"{name}/{block.id}", node, block.prefix)
                    self._put(below, "plugin", block.scope, block.at)
                    rows = self._declared(block.scope)
                    self._rows(node, block.prefix, rows, below)
                    for param in node.params.values():  # the classes of SemanticScorer have names of their own
                        own = param.name.removeprefix(block.prefix)
                        if param.name.startswith(block.prefix) and own not in rows and own != "plugin":
                            self._take(node, param, below, own)
        named, param = node.text("graph_filepath"), node.params.get("graph_filepath")
        if not named or param is None:
            return
        file = _next_to(named, Path(param.at.file).parent)
        if file is None:
            message = (
                f"the graph {Path(named).name} is not found, neither as {named} nor next to the parameters, so trees that ask "
                "for routes fail; put the file next to the parameters"
            )
            self._add("warning", "nav2-route-graph", param.at, node.key("graph_filepath"), message)
        self._put(space, "graph_filepath", "" if file is None else str(file), param.at)

    def _base_frame(self, node: RosNode) -> None:
        """Note that another base frame is taken as that of the costmap: poses are planar, so base_footprint is base_link."""
        frame, param = node.text("base_frame_id"), node.params.get("base_frame_id")
        base = (self.root.space("local_costmap") or self.root).leaf("robot_base_frame")
        if frame is not None and param is not None and base is not None and base.value != frame:
            message = f"base_frame_id = {frame} is taken as {base.value}, robot_base_frame of the local costmap: poses are planar"
            self._add("info", "nav2-base-frame", param.at, node.key("base_frame_id"), message)


_ASYMMETRIC: Final = "nav2_costmap_2d::AsymmetricInflationLayer"
_BASELINE: Final = "nav2_costmap_2d::InflationLayer"
_OMNI: Final = ("Omni", "omni")
_SIDEWAYS: Final = ("vy_std", "ay_max", "ay_min")
DEFAULT_TREE: Final = "navigate_to_pose_w_replanning_and_recovery"
"""The packaged tree that drives a robot whose parameters name none, from Lyrical on."""
_TREES: Final = {
    "foxy": "_foxy",
    "galactic": "_galactic",
    "humble": "_format_3",
    "iron": "_iron",
    "jazzy": "_jazzy",
    "kilted": "_jazzy",
}
"""Distribution -> suffix of the name of its default tree."""
DEFAULT_TREES: Final = (DEFAULT_TREE, "navigate_w_replanning_and_recovery")
"""Names of that tree in Nav2's installations."""
_LISTED: Final = 12
"""Keys that a message lists."""


def _next_to(named: str, folder: Path) -> Path | None:
    """A file that the parameters name: where they say, or under its name next to them."""
    places = (folder / Path(named).expanduser(), folder / Path(named).name)
    return next((place.resolve() for place in places if is_file(place)), None)


def _tree_file(named: str, folder: Path) -> Path | None:
    """The file of a tree: where the parameters say, next to them, or in a folder `behavior_trees` next to them or above."""
    name = Path(named).name
    places = (folder / named, folder / name, folder / "behavior_trees" / name, folder.parent / "behavior_trees" / name)
    return next((place.resolve() for place in places if is_file(place)), None)


def _texts(node: Node) -> list[str]:
    """The texts of a list."""
    items = node.items if isinstance(node, ListNode) else []
    return [item.value for item in items if isinstance(item, ScalarNode) and isinstance(item.value, str)]


def _is_empty(node: Node) -> bool:
    return isinstance(node, ScalarNode) and node.value is None

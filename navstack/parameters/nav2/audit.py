"""Check the parameters of Nav2's nodes against what Nav2 declares: keys, types, plugin arrays, classes, values."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from navstack.parameters.binding import show
from navstack.parameters.findings import Finding, Location, Severity, finding
from navstack.parameters.nav2.declared import (
    CLASSES,
    ELOQUENT,
    EVERY_NODE,
    FOXY,
    GALACTIC,
    HUMBLE,
    IRON,
    JAZZY,
    KILTED,
    LYRICAL,
    NAV2_DISTROS,
    RENAMED,
    Declared,
    canonical,
    declared,
    every_row,
    exported_name,
    is_known,
)
from navstack.parameters.nav2.document import Nodes, Param, RosNode, levels, shortened, too_deep
from navstack.parameters.spelling import nearest
from navstack.parameters.tree import MAX_DEPTH
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode


@dataclass(slots=True)
class Block:
    """A plugin, a sensor source or a zone, and where its parameters stand."""

    kind: str
    id: str
    prefix: str
    """Beginning of its parameters' names: `FollowPath.`"""
    scope: str
    """Its class, or its scope in the table."""
    at: Location
    """Location of its class, or of the list that names it."""
    known: bool = True
    """False for a class that is not Nav2's: its parameters are not checked."""


_ARRAYS: Final[tuple[tuple[str, str, str, int, int, tuple[tuple[str, str], ...]], ...]] = (
    (
        "controller_server",
        "progress_checker_plugin",
        "progress checker",
        FOXY,
        HUMBLE,
        (("progress_checker", "nav2_controller::SimpleProgressChecker"),),
    ),
    (
        "controller_server",
        "progress_checker_plugins",
        "progress checker",
        IRON,
        LYRICAL,
        (("progress_checker", "nav2_controller::SimpleProgressChecker"),),
    ),
    (
        "controller_server",
        "goal_checker_plugin",
        "goal checker",
        FOXY,
        FOXY,
        (("goal_checker", "nav2_controller::SimpleGoalChecker"),),
    ),
    (
        "controller_server",
        "goal_checker_plugins",
        "goal checker",
        GALACTIC,
        LYRICAL,
        (("goal_checker", "nav2_controller::SimpleGoalChecker"),),
    ),
    (
        "controller_server",
        "path_handler_plugins",
        "path handler",
        LYRICAL,
        LYRICAL,
        (("PathHandler", "nav2_controller::FeasiblePathHandler"),),
    ),
    (
        "controller_server",
        "controller_plugins",
        "controller",
        FOXY,
        LYRICAL,
        (("FollowPath", "dwb_core::DWBLocalPlanner"),),
    ),
    (
        "planner_server",
        "planner_plugins",
        "planner",
        FOXY,
        LYRICAL,
        (("GridBased", "nav2_navfn_planner::NavfnPlanner"),),
    ),
    (
        "smoother_server",
        "smoother_plugins",
        "smoother",
        HUMBLE,
        LYRICAL,
        (("simple_smoother", "nav2_smoother::SimpleSmoother"),),
    ),
    (
        "behavior_server",
        "recovery_plugins",
        "behavior",
        FOXY,
        GALACTIC,
        (("spin", "nav2_behaviors::Spin"), ("backup", "nav2_behaviors::BackUp"), ("wait", "nav2_behaviors::Wait")),
    ),
    (
        "behavior_server",
        "behavior_plugins",
        "behavior",
        HUMBLE,
        LYRICAL,
        (
            ("spin", "nav2_behaviors::Spin"),
            ("backup", "nav2_behaviors::BackUp"),
            ("drive_on_heading", "nav2_behaviors::DriveOnHeading"),
            ("wait", "nav2_behaviors::Wait"),
        ),
    ),
    (
        "costmap",
        "plugins",
        "layer",
        FOXY,
        LYRICAL,
        (
            ("static_layer", "nav2_costmap_2d::StaticLayer"),
            ("obstacle_layer", "nav2_costmap_2d::ObstacleLayer"),
            ("inflation_layer", "nav2_costmap_2d::InflationLayer"),
        ),
    ),
    ("costmap", "filters", "filter", GALACTIC, LYRICAL, ()),
    (
        "bt_navigator",
        "navigators",
        "navigator",
        IRON,
        LYRICAL,
        (
            ("navigate_to_pose", "nav2_bt_navigator::NavigateToPoseNavigator"),
            ("navigate_through_poses", "nav2_bt_navigator::NavigateThroughPosesNavigator"),
        ),
    ),
    ("waypoint_follower", "waypoint_task_executor_plugin", "task", GALACTIC, LYRICAL, ()),
    ("docking_server", "dock_plugins", "dock plugin", JAZZY, LYRICAL, ()),
    (
        "route_server",
        "edge_cost_functions",
        "edge scorer",
        HUMBLE,
        LYRICAL,
        (("DistanceScorer", "nav2_route::DistanceScorer"), ("DynamicEdgesScorer", "nav2_route::DynamicEdgesScorer")),
    ),
    (
        "route_server",
        "operations",
        "route operation",
        HUMBLE,
        LYRICAL,
        (("AdjustSpeedLimit", "nav2_route::AdjustSpeedLimit"), ("ReroutingService", "nav2_route::ReroutingService")),
    ),
)
"""Scope, key, kind, first and last distribution, default ids and classes of every plugin array."""
_FREE: Final = ("qos_overrides.", "diagnostic_updater.", "GeoJsonGraphFileLoader.", "GeoJsonGraphFileSaver.")
"""Parameters that rclcpp and helpers declare."""


Problem = tuple[Severity, str, Location, str, str]
"""Severity, rule, location, key, message."""


class NodeAudit:
    """What one node declares in a distribution, given its plugin arrays."""

    def __init__(self, node: RosNode, distro: int) -> None:
        self.node = node
        self.distro = distro
        self.declared: dict[str, Declared] = {}
        self.blocks: list[Block] = []
        self.arrays: dict[str, str] = {}
        """Key of each array that names blocks -> kind."""
        self.problems: list[Problem] = []
        self.add("", EVERY_NODE)
        self.add("", node.scope)
        for scope, key, kind, first, last, defaults in _ARRAYS:
            if scope == node.scope and first <= distro <= last:
                self.add_array("", key, kind, defaults)
        if node.scope in ("collision_monitor", "collision_detector"):
            self._monitor()
        if node.scope == "docking_server":
            self._named("", "docks", "dock", "dock")
        if node.scope == "vector_object_server":
            self._named("", "shapes", "shape", "vector object shape")

    def of_kind(self, kind: str) -> list[Block]:
        """Return the blocks of a kind in the order of their array."""
        return [b for b in self.blocks if b.kind == kind]

    # --- what is declared ---------------------------------------------------------------------------------------------

    def add(self, prefix: str, scope: str) -> None:
        """Add what a scope declares."""
        for name, row in declared(scope, self.distro).items():
            self.declared[prefix + name] = row

    def _declare(self, name: str, kind: Any, default: Any = None) -> None:
        self.declared[name] = Declared(name, kind, default, FOXY, LYRICAL, "")

    def ids(self, key: str) -> tuple[list[str], Location] | None:
        """Return the names that a list, or a text, contains, and where it stands; None if it is not written."""
        param = self.node.params.get(key)
        if param is None:
            return None
        value = self.node.value(key)
        if isinstance(value, str):
            written = value.split()
        else:
            written = list(dict.fromkeys(v for v in value if isinstance(v, str))) if isinstance(value, list) else []
        names = [name for name in written if levels(name) <= MAX_DEPTH]
        for name in written:
            problem: Problem = ("error", "too-deep", param.node.at, shortened(key), f"the name {too_deep(name)}")
            if name not in names and problem not in self.problems:
                self.problems.append(problem)
        return names, param.node.at

    def add_array(self, prefix: str, key: str, kind: str, defaults: Sequence[tuple[str, str]]) -> None:
        """Add the blocks that a plugin array names, and what their classes declare."""
        name = prefix + key
        self.arrays[name] = kind
        written = self.ids(name)
        usual = dict(defaults)
        ids, at = written if written is not None else (list(usual), self.node.at)
        in_default_order = ids == list(usual)
        for id_ in ids:
            where = f"{prefix}{id_}."
            plugin = self.node.params.get(f"{where}plugin")
            self._declare(f"{where}plugin", "string")
            given = self.node.text(f"{where}plugin")
            if plugin is None and in_default_order:
                given, at_class = exported_name(kind, usual[id_], self.distro), at
            elif plugin is None:
                self._without_class(name, id_, kind, at)
                self.blocks.append(Block(kind, id_, where, "", at, known=False))
                continue
            else:
                at_class = plugin.node.at
            if given is None:
                self.blocks.append(Block(kind, id_, where, "", at_class, known=False))
                continue
            self._block(kind, id_, where, given, at_class)

    def _without_class(self, name: str, id_: str, kind: str, at: Location) -> None:
        has = any(other.startswith(f"{id_}.") for other in self.node.params)
        known = [exported_name(kind, c, self.distro) for c in CLASSES.get(kind, {})]
        example = f'"{known[0]}"' if known else '".."'
        what = f"its block has no plugin; add `plugin: {example}`" if has else "there is no block of that name"
        if not has:
            what += f"; write `{id_}: {{plugin: {example}}}`, or remove it from {name}"
        message = f"{name} lists {id_}, but {what}"
        self.problems.append(("error", "nav2-no-plugin", at, name, message))

    def _block(self, kind: str, id_: str, prefix: str, given: str, at: Location) -> None:
        cls = canonical(given)
        known = is_known(cls)
        self.blocks.append(Block(kind, id_, prefix, cls, at, known))
        if not known:
            return
        self._check_class(kind, cls, given, at, f"{prefix}plugin")
        self.add(prefix, cls)
        expand = _EXPANSIONS.get(cls)
        if expand is not None:
            expand(self, prefix, at)

    def _check_class(self, kind: str, cls: str, given: str, at: Location, name: str) -> None:
        """Report a class that the distribution exports under another name, or has not yet."""
        distro = NAV2_DISTROS[self.distro]
        exported = exported_name(kind, cls, self.distro)
        if cls in CLASSES.get(kind, {}) and given.strip() != exported and cls != "smac_planner::SmacPlanner":
            message = (
                f'Nav2 {distro} does not export {given}; the class is called "{exported}" there; write it, or name the '
                "distribution of the file with --distro"
            )
            self.problems.append(("error" if self.runs else "warning", "nav2-class-name", at, name, message))

    def _named(self, prefix: str, key: str, kind: str, scope: str) -> list[str]:
        """Add the blocks without a class that a list names."""
        self.arrays[prefix + key] = kind
        written = self.ids(prefix + key)
        names, at = written if written is not None else ([], self.node.at)
        for name in names:
            where = f"{prefix}{name}."
            self.blocks.append(Block(kind, name, where, scope, at))
            self.add(where, scope)
            if kind in ("layer source", "monitor source", "zone") and not any(
                other.startswith(where) for other in self.node.params
            ):
                message = (
                    f"{prefix}{key} lists {name}, but there is no block {where[:-1]}; write it, or remove the name"
                )
                self.problems.append(("warning", "nav2-no-block", at, prefix + key, message))
        return names

    def _monitor(self) -> None:
        for zone in self._named("", "polygons", "zone", "monitor polygon"):
            self._named(f"{zone}.", "velocity_polygons", "sub-polygon", "monitor sub-polygon")
        for source in self._named("", "observation_sources", "monitor source", "monitor source"):
            self._named(f"{source}.", "exclusion_zones", "exclusion zone", "monitor exclusion zone")

    def sources(self, prefix: str, scope: str = "layer source") -> None:
        """Add the sensor sources of a layer."""
        self._named(prefix, "observation_sources", "layer source", scope)

    def critics(self, prefix: str, at: Location, package: str) -> None:
        """Add the critics of a controller."""
        written = self.ids(f"{prefix}critics")
        self.arrays[f"{prefix}critics"] = "critic"
        for name in written[0] if written is not None else ():
            where = f"{prefix}{name}."
            base = name
            if package == "dwb_critics":
                self._declare(f"{where}class", "string")
                base = self.node.text(f"{where}class") or name
                base = base.rpartition("::")[2].removesuffix("Critic") + "Critic"
            scope = f"{package}::{base}"
            self.blocks.append(Block("critic", name, where, scope, written[1] if written else at, is_known(scope)))
            if is_known(scope) or package == "mppi::critics":
                self.add(where, scope)
            elif package == "dwb_critics":
                self.add(where, "dwb critic")
        if package == "mppi::critics":
            for row in declared("mppi critic", self.distro):
                for name in written[0] if written is not None else ():
                    self.declared[f"{prefix}{name}.{row}"] = declared("mppi critic", self.distro)[row]

    def shim(self, prefix: str, at: Location) -> None:
        """Add the controller of a rotation shim: in the same block up to Kilted, in a block of its own from Lyrical on."""
        key = f"{prefix}primary_controller"
        where = prefix
        if self.distro >= LYRICAL:
            key, where = f"{key}.plugin", f"{key}."
            self._declare(key, "string")
        given = self.node.text(key)
        param = self.node.params.get(key)
        if given is None or param is None:
            return
        if canonical(given).endswith("::RotationShimController"):
            message = "the primary_controller of a rotation shim is a rotation shim; name a controller that drives"
            self.problems.append(("error", "nav2-shim-in-shim", param.node.at, key, message))
            return
        name = f"{prefix}primary_controller"
        self._block("controller", name, where, given, param.node.at)
        next(b for b in self.blocks if b.kind == "controller" and b.id == name).kind = "primary controller"

    def motion_model(self, prefix: str) -> None:
        """Add the block of MPPI's motion model, which has one from Lyrical on."""
        name = self.node.text(f"{prefix}motion_model") or "diff_drive"
        if self.distro >= LYRICAL:
            self._declare(f"{prefix}{name}.plugin", "string")
            self.add(f"{prefix}{name}.", "mppi motion model")
            self.arrays[f"{prefix}motion_model"] = "motion model"

    # --- findings -----------------------------------------------------------------------------------------------------

    def findings(self, nodes: Nodes) -> Iterator[Finding]:
        """Yield everything that is wrong with the node's keys."""
        if not exists(self.node.name, self.distro):
            yield self._absent()
            return
        for severity, rule, at, name, message in self.problems:
            yield finding(severity, rule, at, self.node.key(name), message)
        reported: set[str] = set()
        for param in self.node.params.values():
            row = self.declared.get(param.name)
            if row is not None:
                yield from _type_problems(self.node, param, row, self.runs)
            elif not param.wild and not self.is_free(param.name):
                found = self._undeclared(param, nodes, reported)
                if found is not None:
                    yield found

    def _absent(self) -> Finding:
        """The finding about a node that the distribution does not have."""
        name, distro = self.node.name, NAV2_DISTROS[self.distro]
        first, last = _NODES[name]
        other = {"recoveries_server": "behavior_server", "behavior_server": "recoveries_server"}.get(name, "")
        since = (
            f"up to {NAV2_DISTROS[last].title()}" if last < self.distro else f"from {NAV2_DISTROS[first].title()} on"
        )
        message = f"the node {name} exists {since}, so Nav2 {distro} ignores its parameters; "
        message += (
            f"{distro} has {other}" if other else "remove them, or name the distribution of the file with --distro"
        )
        return finding("warning", "nav2-node", self.node.at, name, message, other or None)

    @property
    def runs(self) -> bool:
        """True if navstack runs this node: a wrong type stops the robot."""
        return self.node.scope in _RUN

    def is_free(self, name: str) -> bool:
        """Return True for a parameter of a plugin that is not Nav2's, which declares it itself."""
        return name.startswith(_FREE) or any(not b.known and name.startswith(b.prefix) for b in self.blocks)

    def block_of(self, name: str) -> Block | None:
        """Return the innermost block that a parameter stands in."""
        inside = [b for b in self.blocks if name.startswith(b.prefix)]
        return max(inside, key=lambda b: len(b.prefix), default=None)

    def undeclared(self) -> list[Param]:
        """Return the parameters that no code declares."""
        return [
            p
            for p in self.node.params.values()
            if p.name not in self.declared and not p.wild and not self.is_free(p.name)
        ]

    def other_distros(self, name: str) -> list[Declared]:
        """Return the rows of other distributions for a parameter in its block."""
        found: list[Declared] = []
        for prefix, scope in [*((b.prefix, b.scope) for b in reversed(self.blocks)), ("", self.node.scope)]:
            if name.startswith(prefix):
                rest = name[len(prefix) :]
                found += [row for row in every_row(scope) if row.name == rest]
                if scope.startswith("dwb_critics") or found:
                    break
        return found or [row for row in every_row(EVERY_NODE) if row.name == name]

    def _undeclared(self, param: Param, nodes: Nodes, reported: set[str]) -> Finding | None:
        """The finding about a parameter that no code declares; None if it is part of one already made."""
        name, node = param.name, self.node
        distro = NAV2_DISTROS[self.distro]
        ignored = f"so Nav2 {distro} ignores it silently"

        def made(rule: str, message: str, suggestion: str | None = None) -> Finding:
            return finding("warning", rule, param.at, node.key(name), message, suggestion)

        if name in ELOQUENT:
            message = (
                f"{name} is read up to Eloquent only, {ignored}; write `plugins` with the names and `plugin: class` in the "
                "block of each"
            )
            return made("nav2-removed", message)
        others = self.other_distros(name)
        if others:
            return made(*self._of_other_distro(name, others))
        block = self.block_of(name)
        within_block = block.prefix if block is not None else ""
        first, dot, _ = name[len(within_block) :].partition(".")
        if dot:
            if within_block + first in reported:
                return None
            unlisted = self._unlisted(within_block, first)
            if unlisted is not None:
                reported.add(within_block + first)
                return finding("warning", "nav2-not-listed", param.at, node.key(within_block + first), unlisted)
        last = name.rpartition(".")[2]
        prefix = block.prefix if block is not None else ""
        within = [n[len(prefix) :] for n in self.declared if n.startswith(prefix)]
        place = self._place_of(last, prefix, nodes)
        if place is not None:
            message = f"{name} = {_shown(param.node)} is not declared at this level, {ignored}; move it to {place}"
            return made("nav2-wrong-level", message, place)
        close = nearest(name[len(prefix) :], [n for n in within if _bounds(n) == _bounds(name)], cutoff=0.75)
        if close is not None:
            message = f"{name} = {_shown(param.node)} is not declared, {ignored}; did you mean {prefix}{close}?"
            return made("nav2-undeclared", message, prefix + close)
        owner = f"{block.id} ({block.scope})" if block is not None and block.scope else node.name
        message = f"{name} = {_shown(param.node)} is not declared by {owner}, {ignored}; remove it"
        return made("nav2-undeclared", message)

    def _of_other_distro(self, name: str, rows: Sequence[Declared]) -> tuple[str, str, str | None]:
        """Rule, message and suggestion about a parameter that other distributions declare."""
        distro = NAV2_DISTROS[self.distro]
        last = max(row.last for row in rows)
        if last < self.distro:
            scope = next((s for s, new in RENAMED.items() if rows[0].name in new and self._stands_in(name, s)), None)
            new = RENAMED[scope][rows[0].name] if scope is not None else None
            message = (
                f"{name} is declared up to {NAV2_DISTROS[last].title()} only, so Nav2 {distro} ignores it silently; "
            )
            message += f"{distro} has {new} instead" if new else "remove it"
            return ("nav2-renamed" if new else "nav2-removed", message, new)
        first = min(row.first for row in rows)
        message = (
            f"{name} is declared from {NAV2_DISTROS[first].title()} on, so Nav2 {distro} ignores it silently; remove it, or name "
            "the distribution of the file with --distro"
        )
        return "nav2-newer", message, None

    def _stands_in(self, name: str, scope: str) -> bool:
        block = self.block_of(name)
        return any(b.scope == scope and name.startswith(b.prefix) for b in self.blocks) or (
            block is None and self.node.scope == scope
        )

    def _unlisted(self, prefix: str, first: str) -> str | None:
        """The message about a block below a prefix that no array names; None if it is not a block."""
        block = prefix + first
        count = sum(n.startswith(f"{block}.") for n in self.node.params)
        if any(n.startswith(f"{block}.") for n in self.declared):
            return None
        arrays = [key for key in self.arrays if key.startswith(prefix) and "." not in key[len(prefix) :]]
        if not arrays and (prefix or (count == 1 and f"{block}.plugin" not in self.node.params)):
            return None
        kind = next((k for k in arrays if self._fits(block, self.arrays[k])), arrays[0] if len(arrays) == 1 else "")
        listed = self.ids(kind) if kind else None
        names = ", ".join(listed[0]) if listed is not None else "not written"
        close = nearest(first, listed[0], cutoff=0.8) if listed is not None else None
        what = f"its {count} parameters are" if count > 1 else "its parameter is"
        if close is not None and f"{block}.plugin" not in self.node.params:
            return f"{block} is not in {kind} ({names}), so {what} ignored silently; did you mean {close}?"
        if kind:
            return f"{block} is not in {kind} ({names}), so {what} ignored silently; list it there, or remove the block"
        return f"no array of {self.node.name} names {block}, so {what} ignored silently; remove the block"

    def _fits(self, first: str, kind: str) -> bool:
        """True if a block belongs to an array of this kind, by its class or its name."""
        given = self.node.text(f"{first}.plugin")
        if given is not None:
            return canonical(given) in CLASSES.get(kind, {})
        usual = {"layer": "_layer", "filter": "_filter", "goal checker": "goal_checker", "zone": "olygon"}
        return kind in usual and first.endswith(usual[kind])

    def _place_of(self, last: str, prefix: str, nodes: Nodes) -> str | None:
        """Where a parameter of that name is declared: in this node, or at the top level of another one."""
        if "." in last or last in ("enabled", "plugin"):
            return None
        at = [n for n in self.declared if n.rpartition(".")[2] == last and not n.startswith(prefix)]
        at = at or [n for n in self.declared if n.rpartition(".")[2] == last and n != prefix + last]
        if at:
            return min(at, key=lambda n: n.count("."))
        others = [n for n in nodes.nodes.values() if n is not self.node and last in declared(n.scope, self.distro)]
        return f"{others[0].name}/{last}" if len(others) == 1 else None  # every node has a frame or an odom_topic


def _bounds(name: str) -> set[str]:
    """Which bound a name says: min_vel_theta is not a misspelt max_vel_theta."""
    return {"min", "max"} & set(name.replace(".", "_").split("_"))


def _layer_sources(audit: NodeAudit, prefix: str, at: Location) -> None:
    del at
    audit.sources(prefix)


def _decaying_sources(audit: NodeAudit, prefix: str, at: Location) -> None:
    del at
    audit.sources(prefix, "decaying source")


def _smac(audit: NodeAudit, prefix: str, at: Location) -> None:
    del at
    audit.add(f"{prefix}smoother.", "smac smoother")


def _mppi(audit: NodeAudit, prefix: str, at: Location) -> None:
    audit.critics(prefix, at, "mppi::critics")
    audit.motion_model(prefix)


def _dwb(audit: NodeAudit, prefix: str, at: Location) -> None:
    audit.critics(prefix, at, "dwb_critics")


def _shim(audit: NodeAudit, prefix: str, at: Location) -> None:
    audit.shim(prefix, at)


def _container(audit: NodeAudit, prefix: str, at: Location) -> None:
    del at
    audit.add_array(prefix, "plugins", "layer", ())


_EXPANSIONS: Final[dict[str, Callable[[NodeAudit, str, Location], None]]] = {
    "nav2_costmap_2d::ObstacleLayer": _layer_sources,
    "nav2_costmap_2d::VoxelLayer": _layer_sources,
    "spatio_temporal_voxel_layer::SpatioTemporalVoxelLayer": _decaying_sources,
    "nav2_costmap_2d::PluginContainerLayer": _container,
    "nav2_smac_planner::SmacPlanner2D": _smac,
    "nav2_smac_planner::SmacPlannerHybrid": _smac,
    "nav2_smac_planner::SmacPlannerLattice": _smac,
    "dwb_core::DWBLocalPlanner": _dwb,
    "nav2_mppi_controller::MPPIController": _mppi,
    "nav2_rotation_shim_controller::RotationShimController": _shim,
}
"""Class -> what adds the blocks below its own."""

_RUN: Final = frozenset(
    {
        "amcl",
        "behavior_server",
        "collision_detector",
        "collision_monitor",
        "controller_server",
        "costmap",
        "docking_server",
        "planner_server",
        "route_server",
        "smoother_server",
        "velocity_smoother",
    }
)
"""Nodes that navstack runs."""

# ----------------------------------------------------------------------------------------------------------------------
# Types: strict, as rclcpp's parameters are.


_NAMES: Final = {"bool": "a boolean", "int": "an integer", "double": "a double", "string": "text"}
_LISTS: Final = {"strings": "string", "doubles": "double", "ints": "int"}


def type_of(value: Any) -> str:
    """Return the type that rcl gives a scalar."""
    if isinstance(value, bool):
        return "bool"
    if isinstance(value, int):
        return "int"
    return "double" if isinstance(value, float) else "string"


def _type_problems(node: RosNode, param: Param, row: Declared, runs: bool) -> Iterator[Finding]:
    message, at = _type_message(param, row)
    if message:
        severity: Severity = "error" if runs else "warning"
        yield finding(severity, "nav2-type", at, node.key(param.name), message)


def _type_message(param: Param, row: Declared) -> tuple[str, Location]:
    """What is wrong with the type of a value, and where; empty if nothing is."""
    value, wanted = param.node, row.type
    if isinstance(value, DictNode):
        return f"{param.name} is a mapping, but it is declared as {_wanted(wanted)}; write a value", value.at
    if isinstance(value, ScalarNode):
        return _scalar_message(param.name, value, wanted), value.at
    if wanted not in _LISTS:
        if wanted == "string" and param.name.rpartition(".")[2] in ("footprint", "points"):
            text = str(_plain(value)).replace("'", "")
            return f'{param.name} is a list, but Nav2 wants text; write it in quotes: "{_cut(text)}"', value.at
        return f"{param.name} is a list, but it is declared as {_wanted(wanted)}; {_write(wanted)}", value.at
    kinds: list[str] = []
    for item in value.items:
        if not isinstance(item, ScalarNode):
            what = "lists in lists are not possible in parameters of ROS 2"
            if wanted == "doubles" and param.name.endswith("points"):
                return f"{param.name}: {what}; write one list of numbers: [x, y, x, y, ..]", item.at
            return f"{param.name}: {what}; write a list of {_plural(wanted)}", item.at
        kinds.append(type_of(item.value))
    if len(set(kinds)) > 1:
        odd = next(i for i, kind in enumerate(kinds) if kind != kinds[0])
        at = value.items[odd].at
        message = (
            f"{param.name} mixes {_NAMES[kinds[0]]} ({_shown(value.items[0])}) and {_NAMES[kinds[odd]]} "
            f"({_shown(value.items[odd])}); rcl rejects such a list; {_fix_list(value, wanted)}"
        )
        return message, at
    if kinds and kinds[0] != _LISTS[wanted]:
        message = (
            f"{param.name} is a list of {_NAMES[kinds[0]].partition(' ')[2]}s, but it is declared as a list of "
            f"{_plural(wanted)}; {_fix_list(value, wanted)}"
        )
        return message, value.at
    return "", value.at


def _scalar_message(name: str, node: ScalarNode, wanted: str) -> str:
    value = node.value
    if value is None:
        return f"{name} has no value, but it is declared as {_wanted(wanted)}; {_write(wanted)}, or remove the line"
    if isinstance(value, str) and "$(" in value and wanted != "string":
        return f'{name} = "{value}" is a substitution of launch; give its value, for example with NAME:=VALUE'
    kind = type_of(value)
    if wanted in _LISTS:
        what = f"{name} = {_shown(node)} is {_NAMES[kind]}, but it is declared as a list of {_plural(wanted)}"
        fits = kind == _LISTS[wanted] and "[" not in node.text
        return f"{what}; write a list: [{node.text}]" if fits else f"{what}; write a list"
    if kind == wanted:
        return ""
    if kind == "int" and wanted == "double":
        what = f"{name} = {node.text} is an integer, but it is declared as a double"
        return f"{what}; Nav2 stops with an error; write {float(value)}"
    fix = _write(wanted)
    if wanted == "int" and isinstance(value, float) and value.is_integer():
        fix = f"write {int(value)}"
    elif wanted == "string" and not isinstance(value, str):
        fix = f'write it in quotes: "{node.text}"'
    elif node.quoted and isinstance(value, str):
        fix = "remove the quotes" if wanted != "bool" or value.lower() in ("true", "false") else fix
    elif wanted == "bool" and kind == "int":
        fix = f"write {'true' if value else 'false'}"
    return f"{name} = {_shown(node)} is {_NAMES[kind]}, but it is declared as {_wanted(wanted)}; Nav2 stops with an error; {fix}"


def _wanted(kind: str) -> str:
    return f"a list of {_plural(kind)}" if kind in _LISTS else _NAMES[kind]


def _plural(kind: str) -> str:
    return {"strings": "texts", "doubles": "doubles", "ints": "integers"}[kind]


def _write(kind: str) -> str:
    if kind in _LISTS:
        return f"write a list of {_plural(kind)}"
    return {"bool": "write true or false", "int": "write an integer", "double": "write a number such as 1.0"}.get(
        kind, "write text"
    )


def _fix_list(value: ListNode, wanted: str) -> str:
    if wanted != "doubles":
        return f"write a list of {_plural(wanted)}"
    texts: list[str] = []
    for item in value.items:
        number = item.value if isinstance(item, ScalarNode) else None
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            return f"write a list of {_plural(wanted)}"
        texts.append(str(float(number)))
    return f"write [{_cut(', '.join(texts))}]"


def _plain(node: Node) -> Any:
    if isinstance(node, ScalarNode):
        return node.value
    return [_plain(n) for n in node.items] if isinstance(node, ListNode) else {}


def _shown(node: Node) -> str:
    return show(_plain(node))


def _cut(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."


# ----------------------------------------------------------------------------------------------------------------------
# The distribution of a file: the one that its keys contradict least.


_NEWER, _OLDER, _FATAL, _NODE = 3, 1, 100, 4
"""Weights: a key that a later distribution brought, a key that was removed before, what keeps Nav2 from starting, a node."""
_NODES: Final = {
    "recoveries_server": (FOXY, GALACTIC),
    "behavior_server": (HUMBLE, LYRICAL),
    "smoother_server": (HUMBLE, LYRICAL),
    "velocity_smoother": (HUMBLE, LYRICAL),
    "collision_monitor": (HUMBLE, LYRICAL),
    "collision_detector": (IRON, LYRICAL),
    "docking_server": (JAZZY, LYRICAL),
    "vector_object_server": (LYRICAL, LYRICAL),
}
"""First and last distribution of nodes that not every one has."""
_NAMED_SINCE: Final = {"keepout_filter_mask_server": KILTED, "speed_filter_mask_server": KILTED}
"""Names of nodes that the launch files of a distribution brought."""


def exists(node: str, distro: int) -> bool:
    """Return True if a distribution has the node."""
    first, last = _NODES.get(node, (FOXY, LYRICAL))
    return first <= distro <= last


@dataclass(slots=True)
class Guess:
    """The distribution that the keys of files fit best."""

    distro: int
    also: list[int] = field(default_factory=list[int])
    """Others that fit as well."""


def find_distro(nodes: Nodes) -> Guess:
    """Return the distribution whose declarations the files contradict least; of several, the oldest."""
    costs = [_cost(nodes, distro) for distro in range(len(NAV2_DISTROS))]
    best = [i for i, cost in enumerate(costs) if cost == min(costs)]
    return Guess(best[0], best[1:])


def _cost(nodes: Nodes, distro: int) -> int:
    total = 0
    for node in nodes.nodes.values():
        total += _NODE * (distro < _NAMED_SINCE.get(node.name, FOXY))
        if not exists(node.name, distro):
            total += (_NEWER if distro < _NODES[node.name][0] else _OLDER) * (1 + len(node.params))
            continue
        audit = NodeAudit(node, distro)
        total += _FATAL * sum(problem[1] == "nav2-class-name" for problem in audit.problems)
        for param in audit.undeclared():
            rows = audit.other_distros(param.name)
            if rows:
                total += _OLDER if max(row.last for row in rows) < distro else _NEWER
        for name, param in node.params.items():
            row = audit.declared.get(name)
            if row is not None and name.endswith(".points"):
                total += _FATAL * bool(_type_message(param, row)[0])
    return total


# ----------------------------------------------------------------------------------------------------------------------
# Values that are declared and of the right type, and still wrong.


def value_problems(audit: NodeAudit) -> Iterator[Finding]:
    """Yield the values of a node that keep a robot from driving as its file says."""
    for block in audit.blocks:
        if block.scope == "layer source":
            yield from _heights(audit, block)
        elif block.scope == "dwb_core::DWBLocalPlanner" and block.kind in ("controller", "primary controller"):
            yield from _dwb_limits(audit, block)
            yield from _tolerances(audit, block)


def _heights(audit: NodeAudit, block: Block) -> Iterator[Finding]:
    node = audit.node
    if f"{block.prefix}max_obstacle_height" in node.params or not _has(node, block.prefix):
        return
    at = next(p.at for p in node.params.values() if p.name.startswith(block.prefix))
    message = (
        f"{block.prefix[:-1]} has no max_obstacle_height; its default is 0.0, so all points above the ground are dropped and the "
        "source sees nothing; set max_obstacle_height: 2.0"
    )
    yield finding("warning", "nav2-no-height", at, node.key(f"{block.prefix}max_obstacle_height"), message)


def _has(node: RosNode, prefix: str) -> bool:
    return any(name.startswith(prefix) for name in node.params)


def _number(node: RosNode, name: str) -> float:
    value = node.value(name)
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else 0.0


def _dwb_limits(audit: NodeAudit, block: Block) -> Iterator[Finding]:
    node, p = audit.node, block.prefix

    def problem(name: str, message: str) -> Finding:
        param = node.params.get(p + name)
        return finding("warning", "nav2-dwb-limit", param.at if param else block.at, node.key(p + name), message)

    def value(name: str) -> float:
        return _number(node, p + name)

    def is_missing(name: str) -> bool:
        return p + name not in node.params

    for axis, velocity in (("x", "max_vel_x"), ("y", "max_vel_y"), ("theta", "max_vel_theta")):
        accel, decel = f"acc_lim_{axis}", f"decel_lim_{axis}"
        if value(velocity) == 0.0:
            continue
        if value(accel) == 0.0:
            what = "missing (default 0.0)" if is_missing(accel) else "0"
            message = (
                f"{p}{accel} is {what}, so DWB cannot speed up along {axis} to {velocity} = {value(velocity):g}; set it"
            )
            yield problem(accel, message)
        elif is_missing(decel):
            message = f"{p}{decel} is missing; its default is 0.0, so DWB cannot slow down along {axis}; write {-value(accel)}"
            yield problem(decel, message)
        elif value(decel) > 0.0:
            message = f"{p}{decel} = {value(decel):g} is positive; decelerations are at most 0; write {-value(decel)}"
            yield problem(decel, message)
    if all(value(name) == 0.0 for name in ("max_vel_x", "min_vel_x", "max_vel_y", "max_vel_theta")):
        message = (
            f"max_vel_x, max_vel_y and max_vel_theta of {p[:-1]} are 0 or missing (default 0.0), so the robot does not move; "
            "set them"
        )
        yield problem("max_vel_x", message)
    elif value("max_speed_xy") == 0.0 and value("max_vel_x") != 0.0:
        what = "missing (default 0.0)" if is_missing("max_speed_xy") else "0"
        message = (
            f"{p}max_speed_xy is {what}, so every sample that moves forward is rejected; write {value('max_vel_x')}"
        )
        yield problem("max_speed_xy", message)


def _tolerances(audit: NodeAudit, block: Block) -> Iterator[Finding]:
    """Report a position tolerance of DWB that contradicts that of the goal checker."""
    node = audit.node
    critics = audit.ids(f"{block.prefix}critics")
    checkers = [b for b in audit.of_kind("goal checker") if "xy_goal_tolerance" in declared(b.scope, audit.distro)]
    if critics is None or "RotateToGoal" not in critics[0] or not checkers:
        return
    own = node.params.get(f"{block.prefix}xy_goal_tolerance")
    mine = _number(node, own.name) if own is not None else 0.25
    checker = checkers[0]
    theirs_param = node.params.get(f"{checker.prefix}xy_goal_tolerance")
    theirs = _number(node, theirs_param.name) if theirs_param is not None else 0.25
    if mine > theirs:
        key = f"{block.prefix}xy_goal_tolerance"
        message = (
            f"{key} is {mine:g}{'' if own else ' (default)'}, above xy_goal_tolerance = {theirs:g} of {checker.id}: RotateToGoal "
            f"stops the robot before the goal checker accepts the position; set both to {theirs:g}"
        )
        at = own.at if own is not None else theirs_param.at if theirs_param is not None else block.at
        yield finding("warning", "nav2-tolerances", at, node.key(key), message, f"{theirs:g}")


def audits_of(nodes: Nodes, distro: int) -> dict[str, NodeAudit]:
    """Return the audit of every node."""
    return {name: NodeAudit(node, distro) for name, node in nodes.nodes.items()}


def check_nodes(nodes: Nodes, audits: Iterable[NodeAudit]) -> Iterator[Finding]:
    """Yield every finding about keys, types, classes and values."""
    for audit in audits:
        yield from audit.findings(nodes)
        yield from value_problems(audit)
    for name, at, count in nodes.others:
        what = f"its {count} parameters are" if count != 1 else "its parameter is"
        close = nearest(name.rpartition("/")[2], [n for n in _SERVER_NAMES if n not in nodes.nodes], cutoff=0.85)
        if close is not None:
            message = f"{name} is not a node of Nav2, so {what} not read; did you mean {close}?"
            yield finding("warning", "nav2-node", at, name, message, close)
        else:
            message = f"{name} is not a node that navstack has, so {what} not read"
            yield finding("info", "nav2-node", at, name, message)


_SERVER_NAMES: Final = ("controller_server", "planner_server", "behavior_server", "bt_navigator", "smoother_server")

"""Nav2's parameters and behavior tree -> one file for move_base: the inverse of `convert`.

DWB becomes DWA, the checkers become the tolerances and the oscillation of move_base, and the tree gives the replanning rate and
the recoveries. Other controllers stay: navstack's move_base runs them, ROS 1 has none of their kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from pydantic.fields import FieldInfo

from navstack.core import InputError, is_file
from navstack.parameters.configuration import load_configuration
from navstack.parameters.configuration_types import Configuration
from navstack.parameters.findings import Location
from navstack.parameters.models.move_base import MoveBaseParams
from navstack.parameters.nav2.conversion import Change, Conversion, Kind, origin_of
from navstack.parameters.nav2.convert import FOREVER_S, REPORT_FILE
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nav2.document import COSTMAP_NODES, Nodes, read_nodes
from navstack.parameters.nav2.tree_xml import TreeRecovery, TreeSpec, default_tree, read_tree
from navstack.parameters.report import Parameter, as_yaml, parameters_of
from navstack.parameters.sources import Source, read_sources
from navstack.plugins import LOCAL_PLANNERS, RECOVERY_BEHAVIORS

MOVE_BASE_FILE: Final = "move_base_params.yaml"
_DWA: Final = "dwa_local_planner/DWAPlannerROS"
_SECTION: Final = "DWAPlannerROS"
_SAME: Final = (
    "min_vel_x",
    "max_vel_x",
    "min_vel_y",
    "max_vel_y",
    "max_vel_theta",
    "acc_lim_x",
    "acc_lim_y",
    "acc_lim_theta",
    "sim_time",
    "vx_samples",
    "vy_samples",
    "prune_plan",
)
_RENAMED: Final[Mapping[str, str]] = {
    "max_vel_trans": "max_speed_xy",
    "min_vel_trans": "min_speed_xy",
    "min_vel_theta": "min_speed_theta",
    "vth_samples": "vtheta_samples",
    "sim_granularity": "linear_granularity",
    "angular_sim_granularity": "angular_granularity",
    "forward_point_distance": "PathAlign/forward_point_distance",
    "oscillation_reset_dist": "Oscillation/oscillation_reset_dist",
    "oscillation_reset_angle": "Oscillation/oscillation_reset_angle",
    "twirling_scale": "Twirling/scale",
    "xy_goal_tolerance": "goal_checker/xy_goal_tolerance",
    "yaw_goal_tolerance": "goal_checker/yaw_goal_tolerance",
    "latch_xy_goal_tolerance": "goal_checker/stateful",
    "trans_stopped_vel": "trans_stopped_velocity",
    "theta_stopped_vel": "goal_checker/rot_stopped_velocity",
}
"""Key of DWA -> key below DWB's section; `goal_checker` stands for the id of the first one."""


def to_move_base(
    sources: Sequence[Source],
    *,
    distro: str | None = None,
    overrides: Sequence[str] = (),
    allow_missing: bool = False,
) -> Conversion:
    """Convert parameter files of Nav2 to one of move_base, with what their behavior tree does.

    Raise InputError for files that are not of Nav2, ParameterError for parameters that cannot be used.
    """
    names = tuple(str(s) for s in sources)
    read = read_sources(sources, overrides, distro=distro, substitute=allow_missing, native=False)
    if not read.nav2 and not any(f.severity == "error" for f in read.findings):
        raise InputError(
            f"{' '.join(names)} is of move_base already; convert to Nav2 with --to nav2, or write it with current names with "
            "`navstack params migrate`",
            argument="PARAMS",
            value=" ".join(names),
        )
    native = load_configuration(sources, overrides=overrides, distro=distro, allow_missing=allow_missing)
    assert read.translation is not None  # otherwise loading fails
    own = native.tree.space("navstack")
    if own is not None:
        read.root.children["navstack"] = own  # with the lidars that other files describe
    configuration = load_configuration([read.root.as_node()], allow_missing=allow_missing)  # with the plugins of ROS 1
    index = NAV2_DISTROS.index(read.translation.distro)
    nodes = read_nodes(read.nav2, read.arguments, [])
    return _Converter(configuration, index, nodes, names, read.translation.keys).run()


class _Converter:
    def __init__(
        self,
        configuration: Configuration,
        distro: int,
        nodes: Nodes | None,
        names: tuple[str, ...],
        keys: Mapping[Location, str],
    ) -> None:
        self.keys = keys
        self.c = configuration
        self.distro = distro
        self.nodes = nodes
        self.made = Conversion("move_base", names)
        self.params: dict[str, Parameter] = {p.name: p for p in parameters_of(configuration)}
        self.out: dict[str, Parameter] = {}
        self.used: set[str] = set()

    @property
    def program(self) -> str:
        return f"Nav2 {NAV2_DISTROS[self.distro]}"

    def run(self) -> Conversion:
        skip: tuple[str, ...] = ("recovery_behaviors", "planner_frequency", "max_planning_retries")
        sections = [r.namespace for r in self.c.recoveries]
        if self.c.local_planner.name == LOCAL_PLANNERS.get("dwb_core::DWBLocalPlanner").name:
            sections.append(self.c.local_planner.namespace)
            self._dwa(self.c.local_planner.namespace)
            skip = (*skip, "base_local_planner", "controller_frequency")
            self._copy("controller_frequency")
        self._progress(sections)
        spec, at = self._spec()
        self._tree(spec, at)
        for name, p in self.params.items():
            if name in skip or name in self.out or name in self.used or p.origin is None or p.remark:
                continue
            if any(name.startswith(f"{s}/") for s in sections):
                continue
            self._copy(name)
            if name.endswith("/unknown_cost_value") and p.value == 255:
                self.out[name] = replace(self.out[name], value=-1)  # a signed byte in ROS 1
        for name, p in self.params.items():
            written = p.origin is not None and bool(p.origin.line)
            if (
                written
                and name not in self.used
                and any(name.startswith(f"{s}/") for s in sections[len(self.c.recoveries) :])
            ):
                loss = f"lost: {p.info.description or name.rpartition('/')[2]}"
                self.made.changes.append(Change("no counterpart", name, p.value, p.origin_text, "", None, loss))
        self._map_topics()
        self._without()
        header = (
            f"move_base: converted from {' '.join(self.made.sources)} ({self.program})",
            "comments: source of each value",
        )
        self.made.files[MOVE_BASE_FILE] = as_yaml(list(self.out.values()), header)
        self.made.params = (MOVE_BASE_FILE,)
        self.made.files[REPORT_FILE] = self.made.markdown()
        return self.made

    def _put(
        self,
        name: str,
        value: Any,
        sources: Sequence[Parameter],
        kind: Kind,
        note: str = "",
        info: FieldInfo | None = None,
    ) -> None:
        origins = list(dict.fromkeys(origin_of(p, self.program) for p in sources))
        comment = "; ".join([*origins, *([note] if note else [])])
        self.out[name] = Parameter(name, value, Location(comment or "required by move_base"), info or FieldInfo())
        for p in sources:
            self.used.add(p.name)
            self.made.changes.append(Change(kind, p.name, p.value, origin_of(p, self.program), name, value, note))

    def _copy(self, name: str) -> None:
        p = self.params[name]
        if p.value is not None:
            note = ""
            if name == "base_local_planner":
                note = "no controller of ROS 1: only navstack's move_base runs it"
            self._put(name, p.value, [p], "carried over", note, p.info)

    # --- DWB ----------------------------------------------------------------------------------------------------------

    def _dwa(self, section: str) -> None:
        planner = self.params["base_local_planner"]
        self._put("base_local_planner", _DWA, [planner], "nearest", "the planner of ROS 1 that DWB comes from")
        for name in _SAME:
            self._from(section, name, name)
        checker = self._goal_checker(section)
        for name, source in _RENAMED.items():
            first, slash, key = source.partition("/")
            self._from(section, name, f"{checker}/{key}" if slash and first == "goal_checker" else source)
        generator = self.params[f"{section}/trajectory_generator_name"]
        limited = "LimitedAccel" in str(generator.value)
        self._put(f"{_SECTION}/use_dwa", limited, [generator], "converted", "true for LimitedAccelGenerator")
        note = "scale / 2"
        for name, critic in (("path_distance_bias", "PathDist"), ("goal_distance_bias", "GoalDist")):
            scale = self.params.get(f"{section}/{critic}/scale")
            value = 0.5 * float(scale.value) if scale is not None else 0.0
            self._put(
                f"{_SECTION}/{name}", value, [scale] if scale else [], "converted", note if scale else "no such critic"
            )
            align = self.params.get(f"{section}/{critic.replace('Dist', 'Align')}/scale")
            if align is not None:
                same = scale is not None and align.value == scale.value
                text = (
                    "the same bias" if same else f"DWA has one bias for {critic} and its Align critic: that of {critic}"
                )
                self.used.add(align.name)
                self.made.changes.append(
                    Change(
                        "converted" if same else "nearest",
                        align.name,
                        align.value,
                        align.origin_text,
                        f"{_SECTION}/{name}",
                        value,
                        text,
                    )
                )
        obstacle = next(
            (p for c in ("ObstacleFootprint", "BaseObstacle") if (p := self.params.get(f"{section}/{c}/scale"))), None
        )
        if obstacle is not None:
            note = "" if "Footprint" in obstacle.name else "DWA scores the footprint, BaseObstacle the center"
            kind: Kind = "nearest" if note else "carried over"
            self._put(f"{_SECTION}/occdist_scale", float(obstacle.value), [obstacle], kind, note)
            total = self.params[obstacle.name.replace("/scale", "/sum_scores")]
            self._put(f"{_SECTION}/sum_scores", total.value, [total], "carried over")
        # navstack's own section: biases are per meter, as in noetic
        self._put("navstack/ros_distro", "noetic", [], "added", "scale of the biases")

    def _goal_checker(self, section: str) -> str:
        """The id of the goal checker, of which DWA has the tolerances."""
        listed = self.params.get(f"{section}/goal_checker_plugins")
        ids = listed.value if listed is not None and isinstance(listed.value, list) else []
        id_ = str(ids[0]) if ids else "goal_checker"
        plugin = self.params.get(f"{section}/{id_}/plugin")
        if plugin is not None and "::Simple" in str(plugin.value):
            self.used.update((f"{section}/goal_checker_plugins", plugin.name))
        return id_

    def _from(self, section: str, name: str, source: str) -> None:
        p = self.params.get(f"{section}/{source}")
        if p is None or p.value is None:
            return
        self._put(f"{_SECTION}/{name}", p.value, [p], "carried over")

    def _progress(self, sections: list[str]) -> None:
        """The progress checker as move_base's oscillation."""
        for name in self.c.move_base.sections:
            sections.append(name)
            self.used.update(("progress_checker_plugins", f"{name}/plugin"))
            allowance = self.params.get(f"{name}/movement_time_allowance")
            radius = self.params.get(f"{name}/required_movement_radius")
            if allowance is not None:
                off = float(allowance.value) >= FOREVER_S
                note = "no limit" if off else ""
                self._put(
                    "oscillation_timeout",
                    0.0 if off else allowance.value,
                    [allowance],
                    "converted" if off else "carried over",
                    note,
                )
            if radius is not None:
                self._put("oscillation_distance", radius.value, [radius], "carried over")

    def _without(self) -> None:
        """Report what the files set and navstack has nothing for; lists and classes of plugins are used by themselves."""
        for node in self.nodes.nodes.values() if self.nodes is not None else ():
            for name, param in node.params.items():
                structural = name.rpartition(".")[2].endswith(
                    ("plugin", "plugins", "critics", "filters", "_bt_xml", "topic")
                )
                if structural or param.wild or param.at in self.keys or param.node.at in self.keys:
                    continue
                note = "navstack has no parameter for it, so it is not converted"
                change = Change("no counterpart", node.key(name), node.value(name), str(param.at), "", None, note)
                self.made.changes.append(change)

    def _map_topics(self) -> None:
        """Topics of static layers, which no configuration has: programs pass the map."""
        for name in COSTMAP_NODES:
            node = self.nodes.nodes.get(name) if self.nodes is not None else None
            for key, param in node.params.items() if node is not None else ():
                layer, _, last = key.rpartition(".")
                topic = self.params.get(f"{name}/{layer}/map_topic")
                if last == "map_topic" and topic is not None and node is not None and node.text(key):
                    found = replace(topic, value=node.text(key), origin=param.node.at)
                    self._put(f"{name}/{layer}/map_topic", found.value, [found], "carried over", "", found.info)

    # --- the tree -----------------------------------------------------------------------------------------------------

    def _spec(self) -> tuple[TreeSpec, str]:
        """What the tree does, and its file."""
        server = self.nodes.nodes.get("bt_navigator") if self.nodes is not None else None
        for key in ("default_nav_to_pose_bt_xml", "default_bt_xml_filename"):
            written = server.text(key) if server is not None else None
            if not written or server is None:
                continue
            at = server.params[key].at
            file = Path(written)
            here = Path(at.file).parent
            found = next((f for f in (file, here / file, here / file.name) if is_file(f)), None)
            spec = read_tree(found) if found is not None else None
            if spec is not None and found is not None:
                return spec, str(found)
            why = "is not here" if found is None else "has another structure"
            note = f"the tree {why}; the default of {self.program} is taken"
            self.made.changes.append(
                Change("nearest", f"bt_navigator/{key}", written, str(at), "planner_frequency", None, note)
            )
        return default_tree(self.distro), f"default tree of {self.program}"

    def _tree(self, spec: TreeSpec, at: str) -> None:
        notes = {
            "planner_frequency": "" if spec.planner_frequency else "the tree does not replan",
            "max_planning_retries": "retries do not clear the costmap",
            "recovery_behavior_enabled": "the tree has no recovery",
            "recovery_behaviors": "the rounds of number_of_retries written out",
        }
        made = tree_values(spec)
        for name, value in made.items():
            note = notes.get(name, "")
            info = MoveBaseParams.model_fields.get(name)
            self.out[name] = Parameter(name, value, Location(f"{at}; {note}" if note else at), info or FieldInfo())
            kind: Kind = "nearest" if name == "max_planning_retries" else "converted" if note else "carried over"
            self.made.changes.append(Change(kind, f"tree: {_IN_TREE.get(name, name)}", value, at, name, value, note))
        for entry in made.get("recovery_behaviors", ()):
            self._behavior_keys(entry["name"], entry["type"])

    def _behavior_keys(self, name: str, type_: str) -> None:
        """What the behavior server sets for all of a kind."""
        entry = RECOVERY_BEHAVIORS.get(type_)
        for recovery in self.c.recoveries:
            if recovery.cls is not entry.cls:
                continue
            for key in entry.cls.Params.model_fields:
                p = self.params.get(f"{recovery.namespace}/{key}")
                full = f"{name}/{key}"
                if p is not None and p.value is not None and full not in self.out and p.origin is not None:
                    self.out[full] = Parameter(full, p.value, Location(origin_of(p, self.program)), p.info)
            return


_IN_TREE: Final[Mapping[str, str]] = {
    "planner_frequency": "RateController hz",
    "max_planning_retries": "RecoveryNode number_of_retries of ComputePathToPose",
    "recovery_behavior_enabled": "RecoveryNode",
    "recovery_behaviors": "RecoveryActions",
}
MAX_RECOVERIES: Final = 20


def tree_values(spec: TreeSpec) -> dict[str, Any]:
    """Return the parameters of move_base that a tree stands for, by full name."""
    made: dict[str, Any] = {"planner_frequency": spec.planner_frequency, "max_planning_retries": spec.planning_retries}
    if not spec.attempts or not spec.recoveries:
        return {**made, "recovery_behavior_enabled": False}
    entries: list[dict[str, str]] = []
    below: dict[str, Any] = {}
    for number in range(min(spec.attempts, MAX_RECOVERIES)):
        recovery = spec.recoveries[number % len(spec.recoveries)]
        name = _section_name(recovery.name, number // len(spec.recoveries))
        type_, values = _behavior(recovery)
        entries.append({"name": name, "type": type_})
        below.update({f"{name}/{key}": value for key, value in values.items()})
    return {**made, "recovery_behaviors": entries, **below}


def _section_name(name: str, again: int) -> str:
    bare = "".join(c if c.isalnum() or c == "_" else "_" for c in name)
    return f"{bare}_{again + 1}" if again else bare


def _behavior(recovery: TreeRecovery) -> tuple[str, dict[str, Any]]:
    """Type and parameters of a recovery of move_base that does what nodes of a tree do."""
    tag, ports = recovery.nodes[0]

    def number(name: str, default: float) -> float:
        try:
            return float(ports.get(name, default))
        except ValueError:  # from the blackboard
            return default

    if tag.startswith("Clear"):
        services = {n[1].get("service_name", "").rpartition("_")[0].rpartition("_")[2] for n in recovery.nodes}
        affected = services.pop() if len(services) == 1 else "both"
        values: dict[str, Any] = {
            "reset_distance": 0.0 if tag == "ClearEntireCostmap" else number("reset_distance", 1.0),
            "invert_area_to_clear": tag == "ClearCostmapAroundRobot",
            "affected_maps": affected if affected in ("local", "global") else "both",
        }
        return "clear_costmap_recovery/ClearCostmapRecovery", values
    keys = {
        "Spin": (("spin_dist", 1.57), ("time_allowance", 10.0)),
        "BackUp": (("backup_dist", 0.15), ("backup_speed", 0.025), ("time_allowance", 10.0)),
        "DriveOnHeading": (("dist_to_travel", 0.15), ("speed", 0.025), ("time_allowance", 10.0)),
        "Wait": (("wait_duration", 1.0),),
    }[tag]
    if tag == "Spin" and number("spin_dist", 1.57) >= FULL_TURN_AT_LEAST:
        return "rotate_recovery/RotateRecovery", {}
    return f"nav2_behaviors/{tag}", {k: number(k, d) for k, d in keys}


FULL_TURN_AT_LEAST: Final = 6.2
"""rad: a Spin of this or more is the turn of rotate_recovery."""

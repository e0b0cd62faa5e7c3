"""move_base's parameters -> a parameter file and a behavior tree of Nav2, with the source of every value.

What both have with the same meaning is in the table of declared parameters. The rest is here: DWA and the trajectory rollout for
DWB, the planners, costmaps, recoveries and the frequencies that Nav2 has in its tree. Sources: move_base, costmap_2d,
dwa_local_planner and base_local_planner of ROS 1; dwb_core, dwb_critics, nav2_controller and nav2_costmap_2d of Nav2.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

from navstack.core import InputError
from navstack.parameters.configuration import load_configuration, parse_footprint
from navstack.parameters.configuration_types import Configuration, CostmapConfiguration
from navstack.parameters.nav2.conversion import Change, Conversion, Item, Kind, nav2_yaml, origin_of, typed
from navstack.parameters.nav2.declared import (
    CLASSES,
    FOXY,
    HUMBLE,
    IRON,
    JAZZY,
    KILTED,
    LYRICAL,
    NAV2_DISTROS,
    Declared,
    declared,
    exported_name,
)
from navstack.parameters.nav2.tree_xml import FULL_TURN, TreeRecovery, TreeSpec, clear, write_tree
from navstack.parameters.nodes import NODE_SECTIONS
from navstack.parameters.report import Parameter, as_yaml, parameters_of
from navstack.parameters.sources import Source, read_sources
from navstack.parameters.spelling import nearest
from navstack.parameters.tree import COSTMAPS
from navstack.plugins import (
    DOCK_TYPES,
    GLOBAL_PLANNERS,
    LAYERS,
    LOCAL_PLANNERS,
    RECOVERY_BEHAVIORS,
    SMOOTHERS,
    Plugin,
    Registry,
)

PARAMS_FILE: Final = "nav2_params.yaml"
TREE_FILE: Final = "navigate_to_pose.xml"
NAVSTACK_FILE: Final = "navstack.yaml"
REPORT_FILE: Final = "conversion.md"
PLAN_AHEAD_M: Final = (1.0, 2.0)
"""forward_prune_distance of DWB."""
FOREVER_S: Final = 1e6
"""A time that no goal lasts, for limits that move_base switches off."""
_ACCELERATIONS: Final = (
    ("acc_lim_x", "ax_max", "max_linear_accel"),
    ("acc_lim_y", "ay_max"),
    ("acc_lim_theta", "az_max", "max_angular_accel"),
)
_DECELERATIONS: Final = (
    ("decel_lim_x", "ax_min", "max_linear_decel"),
    ("decel_lim_y", "ay_min"),
    ("decel_lim_theta", "max_angular_decel"),
)
_BASE: Final = (2.5, 2.5, 3.2)
"""m/s², rad/s²: accelerations of nav2_bringup, for a controller without limits."""
_SPIN_TIME_S: Final = 60.0


def check_distro(name: str) -> int:
    """Return the index of a distribution. Raises InputError."""
    if name in NAV2_DISTROS:
        return NAV2_DISTROS.index(name)
    close = nearest(name, NAV2_DISTROS)
    hint = f"did you mean {close}? " if close else ""
    raise InputError(
        f'unknown distribution "{name}" of Nav2; {hint}known: {", ".join(NAV2_DISTROS)}',
        argument="--distro",
        value=name,
    )


def to_nav2(
    sources: Sequence[Source],
    distro: str,
    folder: str,
    *,
    overrides: Sequence[str] = (),
    allow_missing: bool = False,
) -> Conversion:
    """Convert the parameters of a move_base robot to files of Nav2; `folder` is where the files will be.

    Raise InputError for an unknown distribution and for files that are of Nav2 already, ParameterError for parameters that
    cannot be used.
    """
    index = check_distro(distro)
    names = tuple(str(s) for s in sources)
    if read_sources(sources, overrides).translation is not None:
        raise InputError(
            f"{' '.join(names)} is of Nav2 already; name the files of move_base, or convert back with "
            "`navstack params convert --to move_base`",
            argument="PARAMS",
            value=" ".join(names),
        )
    configuration = load_configuration(sources, overrides=overrides, allow_missing=allow_missing)
    return _Converter(configuration, index, folder, names).run()


# ----------------------------------------------------------------------------------------------------------------------
# What is lost without a counterpart, and what differs.


_LOSS: Final[Mapping[str, str]] = {
    "acc_lim_trans": "Nav2 limits each axis only",
    "base_global_planner": "the class stands in planner_server",
    "cheat_factor": "alignment ends at forward_point_distance from the goal",
    "clearing_rotation_allowed": "the recoveries stand in the behavior tree",
    "conservative_reset_dist": "the distance stands in the behavior tree",
    "cost_factor": "NavFn has a fixed cost of 50 + 0.8 · cost for a cell: paths keep another distance from obstacles",
    "escape_reset_dist": "DWB has no escape backward; the recovery back_up of the tree does it",
    "escape_reset_theta": "DWB has no escape backward; the recovery back_up of the tree does it",
    "escape_vel": "DWB has no escape backward; the recovery back_up of the tree does it",
    "first_map_only": "Nav2's static layer takes every map that it receives",
    "force_updating": "Nav2 updates a cleared costmap in its next cycle",
    "heading_lookahead": "DWB does not compare turns in place at a distance",
    "layer_names": "Nav2 clears every layer that can be cleared",
    "lethal_cost": "NavFn blocks cells from 253 on",
    "make_plan_add_unreachable_goal": "planner_server never adds an unreachable goal",
    "make_plan_clear_costmap": "ComputePathToPose never clears a costmap; call clear_around_global_costmap before",
    "max_scaling_factor": "the footprint does not grow with the speed: the robot passes obstacles closer at full speed",
    "min_valid_share": "an addition of navstack",
    "neutral_cost": "NavFn has a cost of 50 for a free cell",
    "orientation_mode": "NavFn's poses have no headings but the last",
    "planner_patience": "Nav2 counts planning failures instead of timing them",
    "published_footprint_topic": "Nav2 always publishes on published_footprint",
    "footprint_topic": "Nav2 always listens on footprint of the costmap",
    "recovery_behavior_enabled": "the recoveries stand in the behavior tree",
    "scaling_speed": "the footprint does not grow with the speed",
    "shutdown_costmaps": "Nav2 updates its costmaps while no goal is active, too: more load",
    "transform_tolerance": "Nav2 takes that of the costmap",
    "theta_stopped_vel": "with min_vel_theta not below it, DWB could never stop: the goal is reached at any turning speed",
    "visualize_potential": "Nav2 does not publish the potential",
    "width": "a static map sets the size",
}
_KEPT: Final = ("navstack", "twist_mux", "ekf_filter_node", "supervision")
"""Sections that are no part of Nav2: kept for navstack."""


class _Row(NamedTuple):
    """A parameter of Nav2, and the one of move_base that it comes from."""

    target: str
    source: str
    kind: Kind = "carried over"
    value: Callable[[float], float] | None = None
    note: str = ""


def _same(names: str) -> tuple[_Row, ...]:
    return tuple(_Row(n, n) for n in names.split())


def _at_least_one(value: float) -> float:
    return max(1, value)


def _standing(value: float) -> float:
    return min(0.0, value)


def _negated(value: float) -> float:
    return -value


_BOTH: Final = (
    _Row(
        "min_vel_x",
        "min_vel_x",
        "nearest",
        _standing,
        "DWB turns in place with a sample of 0 m/s; move_base has its own turns",
    ),
    *_same("max_vel_x acc_lim_x acc_lim_y acc_lim_theta sim_time vx_samples"),
    _Row("linear_granularity", "sim_granularity"),
    _Row("angular_granularity", "angular_sim_granularity"),
    _Row(
        "prune_plan",
        "prune_plan",
        "nearest",
        None,
        "drops poses by distance from the robot; move_base, poses that it has passed",
    ),
)
"""What DWA and the trajectory rollout share."""
_DWA: Final = (
    *_BOTH,
    *_same("min_vel_y max_vel_y max_vel_theta"),
    _Row("vy_samples", "vy_samples", "carried over", _at_least_one, "0 counts as 1"),
    _Row("max_speed_xy", "max_vel_trans"),
    _Row("min_speed_xy", "min_vel_trans"),
    _Row("vtheta_samples", "vth_samples"),
    _Row("publish_cost_grid_pc", "publish_cost_grid_pc"),
    _Row("publish_trajectories", "publish_traj_pc", "nearest", None, "MarkerArray instead of a point cloud"),
)
_ROLLOUT: Final = (
    *_BOTH,
    _Row("min_speed_xy", "min_vel_x", "nearest", None, "slower samples must turn by min_speed_theta"),
    *_same("vtheta_samples"),
)
_TURN: Final = "path and goal scale together: the turn at the goal outweighs the distances, as in move_base"
_DECELERATION: Final = tuple(
    _Row(
        f"decel_lim_{a}",
        f"acc_lim_{a}",
        "converted",
        _negated,
        f"-acc_lim_{a}",
    )
    for a in ("x", "y", "theta")
)
_PATH_HANDLER: Final = (
    "prune_distance",
    "max_robot_pose_search_dist",
    "enforce_path_inversion",
    "inversion_xy_tolerance",
    "inversion_yaw_tolerance",
)


class _Converter:
    def __init__(self, configuration: Configuration, distro: int, folder: str, names: tuple[str, ...]) -> None:
        self.c = configuration
        self.distro = distro
        self.folder = folder
        self.names = names
        self.params: dict[str, Parameter] = {p.name: p for p in parameters_of(configuration)}
        self.nodes: dict[str, dict[str, Item]] = {}
        self.changes: list[Change] = []
        self.used: set[str] = set()
        self.recoveries_server = "behavior_server" if distro >= HUMBLE else "recoveries_server"

    @property
    def program(self) -> str:
        return f"Nav2 {NAV2_DISTROS[self.distro]}"

    def run(self) -> Conversion:
        for name in ("amcl", "bt_navigator", "controller_server"):
            self.nodes[name] = {}
        self._controller_server()
        for name, costmap in ((COSTMAPS[1], self.c.local_costmap), (COSTMAPS[0], self.c.global_costmap)):
            self._costmap(name, costmap)
        self._planner_server()
        self._smoother_server()
        spec = self._tree()
        self._behavior_server()
        self._bt_navigator()
        self._safety()
        self._docking()
        self._route_server()
        self._amcl()
        self._required_nodes()
        kept = self._kept()
        self._rest()
        made = Conversion(self.program, self.names, self.changes)
        made.files[PARAMS_FILE] = nav2_yaml(self.nodes, self._header())
        listed = " ".join(self.names).replace("--", "- -")
        made.files[TREE_FILE] = write_tree(spec, self.distro, f"NavigateToPose for {listed}, {self.program}")
        made.params = (PARAMS_FILE,)
        if kept:
            made.files[NAVSTACK_FILE] = kept
            made.params = (PARAMS_FILE, NAVSTACK_FILE)
        made.files[REPORT_FILE] = made.markdown()
        made.tree = TREE_FILE
        return made

    def _header(self) -> list[str]:
        header = [
            f"{self.program}: converted from {' '.join(self.names)}",
            "comments: source of each value; values that are not written are the same defaults in both",
        ]
        if self.distro >= KILTED:
            header.append(
                "velocity topics are TwistStamped: set enable_stamped_cmd_vel to false for a base that takes Twist"
            )
        return header

    # --- helpers ------------------------------------------------------------------------------------------------------

    def _declared(self, scope: str, name: str) -> Declared | None:
        return declared(scope, self.distro).get(name)

    def put(
        self,
        node: str,
        scope: str,
        name: str,
        value: Any,
        sources: Iterable[str] = (),
        *,
        prefix: str = "",
        kind: Kind = "carried over",
        note: str = "",
    ) -> bool:
        """Write a parameter if the distribution declares it, and it was written or has another default there."""
        row = self._declared(scope, name)
        found = [self.params[s] for s in sources if s in self.params]
        if row is None:
            return False
        made = typed(row.type, value)
        self.used.update(p.name for p in found)
        written = any(p.origin is not None for p in found)
        if not written and kind not in ("added", "nearest") and row.default is not None and made == row.default:
            return True
        self._item(node, f"{prefix}{name}", made, row.type, found, kind, note)
        return True

    def _item(
        self, node: str, name: str, value: Any, type_: Any, found: Sequence[Parameter], kind: Kind, note: str
    ) -> None:
        origins = list(dict.fromkeys(origin_of(p, "move_base") for p in found))
        comment = "; ".join([*origins, *([note] if note else [])]) or "required by Nav2"
        self.nodes.setdefault(node, {})[name] = Item(value, type_, comment)
        target = f"{node.rpartition('/')[2]}/{name}"
        if not found:
            self.changes.append(Change("added", "", None, "", target, value, note))
        for p in found:
            self.changes.append(Change(kind, p.name, p.value, origin_of(p, "move_base"), target, value, note))

    def text(self, node: str, name: str, value: Any, sources: Iterable[str] = (), note: str = "") -> None:
        """Write a text or list that no scope declares: a class, a list of plugins."""
        found = [self.params[s] for s in sources if s in self.params]
        self.used.update(p.name for p in found)
        type_ = "strings" if isinstance(value, list) else "string"
        self._item(node, name, value, type_, found, "converted" if found else "added", note)

    def table(self, node: str, scope: str, section: str, prefix: str = "", skip: Collection[str] = ()) -> None:
        """Carry over what both have with the same meaning."""
        for name, row in declared(scope, self.distro).items():
            if not row.counterpart or name in skip:
                continue
            source = f"{section}/{row.counterpart}" if section else row.counterpart
            p = self.params.get(source)
            if p is None or p.value is None or _is_specs(p.value):
                continue
            value, note = p.value, ""
            kind: Kind = "carried over"
            if name in _TOPICS and node.rpartition("/")[2] in COSTMAPS and self.distro < KILTED:
                value = _absolute(p.value)
                if name == "map_topic" and value == "/map":
                    self.used.add(source)  # the default
                    continue
                if value != p.value:
                    kind, note = "converted", "a relative topic is below the costmap's own namespace up to Jazzy"
            self.put(node, scope, name, value, [source], prefix=prefix, kind=kind, note=note)

    def rows(self, node: str, scope: str, section: str, prefix: str, rows: Iterable[_Row]) -> None:
        for row in rows:
            source = f"{section}/{row.source}"
            p = self.params.get(source)
            if p is None or p.value is None:
                continue
            value = p.value if row.value is None else row.value(p.value)
            changed = row.value is None or value != p.value
            note, kind = (row.note, row.kind) if changed else ("", "carried over")
            self.put(node, scope, row.target, value, [source], prefix=prefix, kind=kind, note=note)

    def value(self, name: str) -> Any:
        """Return the effective value of a parameter of move_base."""
        return self.params[name].value

    # --- controller_server --------------------------------------------------------------------------------------------

    def _controller_server(self) -> None:
        node = "controller_server"
        self.put(node, node, "controller_frequency", self.value("controller_frequency"), ["controller_frequency"])
        patience = "without a valid command; Nav2 aborts FollowPath then, and the tree recovers"
        self.put(
            node, node, "failure_tolerance", self.value("controller_patience"), ["controller_patience"], note=patience
        )
        self._progress_checker()
        local = self.c.local_planner
        nav2 = _class_of("controller", LOCAL_PLANNERS, local.name)
        self.text(node, "controller_plugins", ["FollowPath"])
        if nav2:
            self._own_controller(nav2, local)
        elif LOCAL_PLANNERS.get(local.name).name == "dwa":
            self._dwa(local.namespace)
        elif local.name == "trajectory_rollout":
            self._rollout(local.namespace)
        else:
            self._unknown_controller(local)

    def _progress_checker(self) -> None:
        node = "controller_server"
        plural = self.distro >= IRON
        sections = self.c.move_base.sections
        key = "progress_checker_plugins" if plural else "progress_checker_plugin"
        for name, params in sections.items():
            self.text(node, key, [name] if plural else name, ["progress_checker_plugins"])
            kind = str(getattr(params, "plugin", "") or "nav2_controller::SimpleProgressChecker")
            self.text(node, f"{name}.plugin", kind, [f"{name}/plugin"])
            self.table(node, kind, name, f"{name}.")
            return
        name, scope = "progress_checker", "nav2_controller::SimpleProgressChecker"
        self.text(node, key, [name] if plural else name)
        self.text(node, f"{name}.plugin", scope)
        timeout = self.value("oscillation_timeout")
        note = "" if timeout > 0.0 else "0 switches the check off in move_base; Nav2 always checks"
        self.put(
            node,
            scope,
            "movement_time_allowance",
            timeout or FOREVER_S,
            ["oscillation_timeout"],
            prefix=f"{name}.",
            kind="carried over" if timeout else "converted",
            note=note,
        )
        self.put(
            node,
            scope,
            "required_movement_radius",
            self.value("oscillation_distance"),
            ["oscillation_distance"],
            prefix=f"{name}.",
        )

    def _checker(self, section: str, *, stopped: tuple[str, str] | None) -> None:
        """The goal checker of a planner of ROS 1, which has the tolerances itself."""
        node, name = "controller_server", "goal_checker"
        scope = f"nav2_controller::{'Stopped' if stopped else 'Simple'}GoalChecker"
        if self.distro == FOXY:
            self.text(node, "goal_checker_plugin", name)
        else:
            self.text(node, "goal_checker_plugins", [name])
        self.text(node, f"{name}.plugin", scope)
        prefix = f"{name}."
        for key in ("xy_goal_tolerance", "yaw_goal_tolerance"):
            self.put(node, scope, key, self.value(f"{section}/{key}"), [f"{section}/{key}"], prefix=prefix)
        latch = f"{section}/latch_xy_goal_tolerance"
        self.put(node, scope, "stateful", self.value(latch), [latch], prefix=prefix)
        if stopped:
            for target, source in zip(("trans_stopped_velocity", "rot_stopped_velocity"), stopped):
                self.put(node, scope, target, self.value(f"{section}/{source}"), [f"{section}/{source}"], prefix=prefix)

    def _dwb(
        self, section: str, critics: Mapping[str, tuple[float, str, str, Kind]], *, limited: bool, why: str
    ) -> str:
        """DWB with critics: name -> scale, source, formula; return the beginning of its keys."""
        node, scope, prefix = "controller_server", "dwb_core::DWBLocalPlanner", "FollowPath."
        self.text(
            node, f"{prefix}plugin", scope, ["base_local_planner"], f"nearest to {self.value('base_local_planner')}"
        )
        generator = f"dwb_plugins::{'LimitedAccel' if limited else 'Standard'}Generator"
        generator = generator.replace("StandardGenerator", "StandardTrajectoryGenerator")
        self.put(
            node,
            scope,
            "trajectory_generator_name",
            generator,
            [why],
            prefix=prefix,
            kind="converted",
            note=f"{why.rpartition('/')[2]}",
        )
        self.rows(node, scope, section, prefix, _DECELERATION)
        self._plan_window(section)
        self.put(
            node, scope, "critics", list(critics), prefix=prefix, kind="added", note="the terms of move_base's score"
        )
        for name, (scale, source, note, kind) in critics.items():
            critic = f"dwb_critics::{name}Critic"
            sources = [f"{section}/{source}"] if source else []
            self.put(node, critic, "scale", scale, sources, prefix=f"{prefix}{name}.", kind=kind, note=note)
        tolerance = f"{section}/xy_goal_tolerance"
        self.put(
            node,
            scope,
            "xy_goal_tolerance",
            self.value(tolerance),
            [tolerance],
            prefix=prefix,
            note="for RotateToGoal",
        )
        return prefix

    def _least_turn(self, section: str, source: str, generator: str, note: str = "") -> float:
        """The slowest turn in place: DWB samples it, so it must be in reach from rest, or the robot never turns at the goal.

        `generator`: key that selects the generator with limited acceleration. Returns the value that is written (rad/s).
        """
        node, scope, written = "controller_server", "dwb_core::DWBLocalPlanner", f"{section}/{source}"
        own = self.params.get(f"{section}/controller_frequency")
        frequency = (own.value if own is not None else 0.0) or self.value("controller_frequency")
        limited = self.value(f"{section}/{generator}") and frequency > 0.0
        seconds = 1.0 / frequency if limited else self.value(f"{section}/sim_time")
        least = max(0.0, self.value(written))
        reached = round(self.value(f"{section}/acc_lim_theta") * seconds, 9)
        if reached < least:
            within = "/ controller_frequency" if limited else "· sim_time"
            reason = f"acc_lim_theta {within}: {least:g} is out of DWB's reach from rest; move_base has its own turns"
            self.put(
                node, scope, "min_speed_theta", reached, [written], prefix="FollowPath.", kind="nearest", note=reason
            )
            return reached
        kind: Kind = "nearest" if note else "carried over"
        self.put(node, scope, "min_speed_theta", least, [written], prefix="FollowPath.", kind=kind, note=note)
        return least

    def _plan_window(self, section: str) -> None:
        """The part of the plan that is followed: as far as a trajectory reaches, 1 to 2 m, within the local costmap.

        move_base's reaches to the edge of the local costmap, around obstacles; DWB's distances go through them, so an end of
        the plan that is farther away pulls the robot across corners, or holds it where the plan turns back.
        """
        node, scope, prefix = "controller_server", "dwb_core::DWBLocalPlanner", "FollowPath."
        note = (
            "speed · sim_time, 1 to 2 m: DWB's distances cross obstacles; move_base follows to the edge of the costmap"
        )
        side = 0.5 * max(self.c.local_costmap.params.width, self.c.local_costmap.params.height)
        reach = self.value(f"{section}/max_vel_x") * self.value(f"{section}/sim_time")
        ahead = round(min(max(PLAN_AHEAD_M[0], reach), PLAN_AHEAD_M[1], side), 9)
        if self.distro < LYRICAL:
            if self.value(f"{section}/prune_plan"):
                self.put(node, scope, "prune_distance", 1.0, prefix=prefix, kind="added", note="constant of move_base")
            self.put(node, scope, "forward_prune_distance", ahead, prefix=prefix, kind="added", note=note)
            return
        handler = "nav2_controller::FeasiblePathHandler"
        self.text(node, "path_handler_plugins", ["PathHandler"])
        self.text(node, "PathHandler.plugin", handler)
        self.put(node, handler, "prune_distance", ahead, prefix="PathHandler.", kind="added", note=note)

    def _dwa(self, section: str) -> None:
        node, scope = "controller_server", "dwb_core::DWBLocalPlanner"
        least = self._least_turn(section, "min_vel_theta", "use_dwa")
        slow = least < self.value(f"{section}/theta_stopped_vel") and (
            self.value(f"{section}/min_vel_trans") < self.value(f"{section}/trans_stopped_vel")
        )  # otherwise DWB has no sample that counts as stopped, and the goal would never be reached
        self._checker(section, stopped=("trans_stopped_vel", "theta_stopped_vel") if slow else None)
        indigo = self.c.navstack.ros_distro == "indigo"
        resolution = self.c.local_costmap.params.resolution
        factor, formula = (1.0, "= bias, as before 2018") if indigo else (2.0, "2 · bias, DWB halves it")
        path = factor * self.value(f"{section}/path_distance_bias")
        goal = factor * self.value(f"{section}/goal_distance_bias")
        obstacle = self.value(f"{section}/occdist_scale") * (resolution if indigo else 1.0)
        scaled: Kind = "carried over" if factor == 1.0 else "converted"
        critics: dict[str, tuple[float, str, str, Kind]] = {
            "RotateToGoal": (path + goal, "", _TURN, "added"),
            "Oscillation": (1.0, "", "no score, only forbids", "added"),
            "ObstacleFootprint": (
                obstacle,
                "occdist_scale",
                "occdist_scale · resolution, as before 2018" if indigo else "",
                "converted" if indigo else "carried over",
            ),
            "GoalAlign": (goal, "goal_distance_bias", formula, scaled),
            "PathAlign": (path, "path_distance_bias", formula, scaled),
            "PathDist": (path, "path_distance_bias", formula, scaled),
            "GoalDist": (goal, "goal_distance_bias", formula, scaled),
        }
        if self.value(f"{section}/twirling_scale") > 0.0:
            critics["Twirling"] = (self.value(f"{section}/twirling_scale"), "twirling_scale", "", "carried over")
        prefix = self._dwb(section, critics, limited=self.value(f"{section}/use_dwa"), why=f"{section}/use_dwa")
        self.used.add(f"{section}/twirling_scale")
        self.rows(node, scope, section, prefix, _DWA)
        frequency = f"{section}/controller_frequency"
        if self.value(frequency) != self.value("controller_frequency") and self.value(frequency) > 0.0:
            period, note = 1.0 / self.value(frequency), "1 / controller_frequency of the planner"
            self.put(node, scope, "sim_period", period, [frequency], prefix=prefix, kind="converted", note=note)
        self.used.add(frequency)
        stopped = f"{section}/trans_stopped_vel"
        self.put(
            node,
            scope,
            "trans_stopped_velocity",
            self.value(stopped),
            [stopped],
            prefix=prefix,
            note="for RotateToGoal",
        )
        for critic in ("GoalAlign", "PathAlign"):
            ahead = f"{section}/forward_point_distance"
            self.put(
                node,
                f"dwb_critics::{critic}Critic",
                "forward_point_distance",
                self.value(ahead),
                [ahead],
                prefix=f"{prefix}{critic}.",
            )
        for key in ("oscillation_reset_dist", "oscillation_reset_angle"):
            source = f"{section}/{key}"
            self.put(
                node,
                "dwb_critics::OscillationCritic",
                key,
                self.value(source),
                [source],
                prefix=f"{prefix}Oscillation.",
            )
        total = f"{section}/sum_scores"
        self.put(
            node,
            "dwb_critics::BaseObstacleCritic",
            "sum_scores",
            self.value(total),
            [total],
            prefix=f"{prefix}ObstacleFootprint.",
            kind="nearest",
            note="without it, DWB takes the last pose, move_base the highest cost",
        )

    def _rollout(self, section: str) -> None:
        node, scope = "controller_server", "dwb_core::DWBLocalPlanner"
        self._checker(section, stopped=None)
        resolution = self.c.local_costmap.params.resolution
        meters = bool(self.value(f"{section}/meter_scoring"))
        indigo = self.c.navstack.ros_distro == "indigo"
        factor = 2.0 if meters else 2.0 / resolution
        formula = "2 · bias, in meters" if meters else f"2 · bias / resolution ({resolution:g} m), in cells"
        obstacle = self.value(f"{section}/occdist_scale") * (resolution if meters and indigo else 1.0)
        path, goal = (factor * self.value(f"{section}/{n}_distance_bias") for n in ("path", "goal"))
        critics: dict[str, tuple[float, str, str, Kind]] = {
            "RotateToGoal": (path + goal, "", _TURN, "added"),
            "Oscillation": (1.0, "", "no score, only forbids", "added"),
            "ObstacleFootprint": (obstacle, "occdist_scale", "", "carried over"),
            "PathDist": (path, "path_distance_bias", formula, "converted"),
            "GoalDist": (goal, "goal_distance_bias", formula, "converted"),
        }
        prefix = self._dwb(section, critics, limited=self.value(f"{section}/dwa"), why=f"{section}/dwa")
        self.rows(node, scope, section, prefix, _ROLLOUT)
        self._least_turn(section, "min_in_place_vel_theta", "dwa", "applies below min_speed_xy")
        self.used.update((f"{section}/meter_scoring", f"{section}/controller_frequency"))
        turns = [f"{section}/max_vel_theta", f"{section}/min_vel_theta"]
        fastest = max(self.value(turns[0]), -self.value(turns[1]))
        same = self.value(turns[0]) == -self.value(turns[1])
        note = "one limit for both directions" + ("" if same else ": the larger one")
        self.put(
            node,
            scope,
            "max_vel_theta",
            fastest,
            turns,
            prefix=prefix,
            kind="converted" if same else "nearest",
            note=note,
        )
        self.put(
            node,
            scope,
            "max_speed_xy",
            self.value(f"{section}/max_vel_x"),
            [f"{section}/max_vel_x"],
            prefix=prefix,
            kind="converted",
            note="= max_vel_x",
        )
        sideways = [f"{section}/holonomic_robot", f"{section}/y_vels"]
        speeds = _numbers(self.value(sideways[1])) if self.value(sideways[0]) else []
        limit = max((abs(v) for v in speeds), default=0.0)
        samples = len(set(speeds)) + 1 if speeds else 1
        self.put(node, scope, "max_vel_y", limit, sideways, prefix=prefix, kind="converted", note="largest of y_vels")
        self.put(node, scope, "min_vel_y", -limit, sideways, prefix=prefix, kind="converted", note="-largest of y_vels")
        self.put(
            node, scope, "vy_samples", samples, sideways, prefix=prefix, kind="converted", note="number of y_vels and 0"
        )
        reset = f"{section}/oscillation_reset_dist"
        self.put(
            node,
            "dwb_critics::OscillationCritic",
            "oscillation_reset_dist",
            self.value(reset),
            [reset],
            prefix=f"{prefix}Oscillation.",
        )

    def _own_controller(self, scope: str, local: Plugin[Any]) -> None:
        """A controller that Nav2 has, too, with its goal checker and path handler."""
        node, prefix, section = "controller_server", "FollowPath.", local.namespace
        for key, kind, default in (
            ("goal_checker_plugins", "goal checker", "nav2_controller::SimpleGoalChecker"),
            ("path_handler_plugins", "path handler", "nav2_controller::FeasiblePathHandler"),
        ):
            listed = self.params.get(f"{section}/{key}")
            id_ = listed.value[0] if listed is not None and listed.value else key.removesuffix("_plugins")
            of_class = self.params.get(f"{section}/{id_}/plugin")
            chosen = str(of_class.value) if of_class is not None and of_class.value else default
            chosen = chosen if chosen in CLASSES[kind] else default
            if kind == "goal checker" or self.distro >= LYRICAL:
                single = kind == "goal checker" and self.distro == FOXY
                self.text(node, key[:-1] if single else key, id_ if single else [id_], [f"{section}/{key}"])
                self.text(node, f"{id_}.plugin", chosen, [f"{section}/{id_}/plugin"])
                self.table(node, chosen, f"{section}/{id_}", f"{id_}.")
            else:
                self._path_keys(scope, section, id_)
        self.text(node, f"{prefix}plugin", scope, ["base_local_planner"])
        self.table(node, scope, section, prefix, skip=("critics", "motion_model", "primary_controller", *_PATH_HANDLER))
        stops = f"{section}/RotateToGoal/xy_goal_tolerance"
        if stops in self.params and f"{section}/xy_goal_tolerance" in self.params:
            note = "of RotateToGoal, which reads it here"
            self.put(
                node, scope, "xy_goal_tolerance", self.value(stops), [stops], prefix=prefix, kind="converted", note=note
            )
        for key in _PATH_HANDLER:
            source = f"{section}/{key}"
            if source in self.params and self.params[source].value is not None:
                self.put(node, scope, key, self.params[source].value, [source], prefix=prefix)
        self._motion_model(scope, section)
        self._critics(scope, section)
        below = self.params.get(f"{section}/primary_controller/plugin")
        if below is not None:
            self._primary(scope, section, str(below.value))

    def _path_keys(self, scope: str, section: str, handler: str) -> None:
        """Keys of the path handler, which belong to the controller up to Kilted."""
        for key in _PATH_HANDLER:
            source, own = f"{section}/{handler}/{key}", self.params.get(f"{section}/{key}")
            p = self.params.get(source)
            if p is None or p.value is None or (own is not None and own.value is not None):
                continue
            if not self.put("controller_server", scope, key, p.value, [source], prefix="FollowPath."):
                continue
            if scope.startswith("dwb_core") and key == "prune_distance":
                forward = "forward_prune_distance"
                self.put("controller_server", scope, forward, p.value, [source], prefix="FollowPath.")

    def _motion_model(self, scope: str, section: str) -> None:
        if "motion_model" not in declared(scope, self.distro):
            return
        node, prefix, source = "controller_server", "FollowPath.", f"{section}/motion_model"
        written = str(self.value(source))
        model = self.params.get(f"{section}/{written}/plugin")
        kind = str(model.value) if model is not None else written
        old = next((m for m in ("Ackermann", "Omni") if m.lower() in kind.lower()), "DiffDrive")
        radius = next(
            (
                n
                for n in (f"{section}/{written}/min_turning_r", f"{section}/AckermannConstraints/min_turning_r")
                if n in self.params
            ),
            None,
        )
        if self.distro < LYRICAL:
            self.put(
                node, scope, "motion_model", old, [source], prefix=prefix, kind="converted", note="name up to Kilted"
            )
            if old == "Ackermann" and radius is not None:
                key = "AckermannConstraints.min_turning_r"
                self.put(node, scope, key, self.value(radius), [radius], prefix=prefix)
            self.used.update(n for n in self.params if n.startswith(f"{section}/{written}/"))
            return
        id_ = {"Ackermann": "ackermann", "Omni": "omni", "DiffDrive": "diff_drive"}[old]
        self.put(node, scope, "motion_model", id_, [source], prefix=prefix)
        self.text(node, f"{prefix}{id_}.plugin", f"mppi::{old}MotionModel", [f"{section}/{written}/plugin"])
        if radius is not None and old == "Ackermann":
            self.put(node, "mppi motion model", "min_turning_r", self.value(radius), [radius], prefix=f"{prefix}{id_}.")
        self.used.update(n for n in self.params if n.startswith(f"{section}/{written}/"))

    def _critics(self, scope: str, section: str) -> None:
        source = f"{section}/critics"
        if source not in self.params or "critics" not in declared(scope, self.distro):
            return
        listed: list[Any] = self.value(source) or []
        names = [c["type"].rpartition("::")[2] if isinstance(c, dict) else c for c in listed]
        node, prefix = "controller_server", "FollowPath."
        self.put(node, scope, "critics", names, [source], prefix=prefix)
        for entry, name in zip(listed, names):
            own = entry["name"] if isinstance(entry, dict) else entry
            written = self.params.get(f"{section}/{own}/class")
            if scope.startswith("dwb_core"):
                cls = str(written.value) if written is not None and written.value else f"{name}Critic"
                short = cls.rpartition("::")[2].removesuffix("Critic")
                if short != name:
                    self.text(node, f"{prefix}{name}.class", cls, [f"{section}/{own}/class"])
                self.used.add(f"{section}/{own}/class")
                self.table(node, f"dwb_critics::{short}Critic", f"{section}/{own}", f"{prefix}{name}.")
            else:
                self.table(node, f"mppi::critics::{name}", f"{section}/{own}", f"{prefix}{name}.")

    def _primary(self, scope: str, section: str, kind: str) -> None:
        """The controller below a rotation shim."""
        nav2 = _class_of("controller", LOCAL_PLANNERS, kind)
        node, prefix = "controller_server", "FollowPath."
        below = f"{section}/primary_controller"
        if self.distro < LYRICAL:
            self.put(node, scope, "primary_controller", nav2, [f"{below}/plugin"], prefix=prefix)
            self.table(node, nav2, below, prefix, skip=("critics",))
            return
        self.text(node, f"{prefix}primary_controller.plugin", nav2, [f"{below}/plugin"])
        self.table(node, nav2, below, f"{prefix}primary_controller.", skip=("critics",))

    def _unknown_controller(self, local: Plugin[Any]) -> None:
        written = self.value("base_local_planner")
        raise InputError(
            f"Nav2 has no controller like {written}; select one that it has: {', '.join(CLASSES['controller'])}, or "
            "dwa_local_planner/DWAPlannerROS, which becomes DWB",
            argument="base_local_planner",
            value=local.name,
        )

    # --- planner_server, smoother_server ------------------------------------------------------------------------------

    def _planner_server(self) -> None:
        node, prefix = "planner_server", "GridBased."
        planner = self.c.global_planner
        scope = _class_of("planner", GLOBAL_PLANNERS, planner.name)
        if scope and scope not in {s for s in CLASSES["planner"] if declared(s, self.distro)}:
            scope = ""
        nearest_note = "" if scope else f"nearest to {self.value('base_global_planner')}"
        scope = scope or "nav2_navfn_planner::NavfnPlanner"
        rate = self.value("planner_frequency")
        note = "only warns of slow plans; RateController in the tree sets the rate"
        if rate:
            self.put(node, node, "expected_planner_frequency", rate, kind="added", note=note)
        self.text(node, "planner_plugins", ["GridBased"])
        exported = exported_name("planner", scope, self.distro)
        self.text(node, f"{prefix}plugin", exported, ["base_global_planner"], nearest_note)
        section = planner.namespace
        if not nearest_note:
            self.table(node, scope, section, prefix)
            return
        for target, source, invert in (
            ("tolerance", "default_tolerance", False),
            ("allow_unknown", "allow_unknown", False),
            ("use_astar", "use_dijkstra", True),
            ("use_astar", "use_astar", False),
        ):
            p = self.params.get(f"{section}/{source}")
            if p is not None and p.value is not None:
                kind: Kind = "converted" if invert else "carried over"
                note = "not use_dijkstra" if invert else ""
                value = not p.value if invert else p.value
                self.put(node, scope, target, value, [p.name], prefix=prefix, kind=kind, note=note)

    def _smoother_server(self) -> None:
        if self.distro < HUMBLE:
            return
        node, listed = "smoother_server", [*self.c.smoothers]
        note = ""
        if self.c.smoother is not None and not listed:
            listed, note = [self.c.smoother], "add SmoothPath to the tree to use it"
        found = {s.namespace.rpartition("/")[2]: (s, _class_of("smoother", SMOOTHERS, s.name, s)) for s in listed}
        found = {id_: (smoother, scope) for id_, (smoother, scope) in found.items() if scope}
        if not found:
            return
        self.text(node, "smoother_plugins", [*found], ["base_smoother" if note else f"{node}/smoother_plugins"], note)
        for id_, (smoother, scope) in found.items():
            self.text(node, f"{id_}.plugin", scope)
            self.table(node, scope, smoother.namespace, f"{id_}.")

    def _route_server(self) -> None:
        """The graph of routes, with its edge scorers and operations."""
        node = "route_server"
        if not self.c.route_server or self.distro < KILTED:
            return
        self.table(node, node, node)
        for key in ("edge_cost_functions", "operations"):
            for id_ in self.c.route_server.get(key, ()):
                section = f"{node}/{id_}"
                plugin = self.params.get(f"{section}/plugin")
                scope = str(plugin.value) if plugin is not None else f"nav2_route::{id_}"
                self.text(node, f"{id_}.plugin", scope, [plugin.name] if plugin is not None else ())
                self.table(node, scope, section, f"{id_}.")

    # --- costmaps -----------------------------------------------------------------------------------------------------

    def _costmap(self, name: str, costmap: CostmapConfiguration) -> None:
        node, scope = f"{name}/{name}", "costmap"
        self._footprint(node, name)
        static = next((layer for layer in costmap.layers if layer.name and "static" in _type_of(layer)), None)
        skip = {"plugins", "footprint", "robot_radius", "width", "height", "track_unknown_space"}
        shared = {n for n, r in declared(scope, self.distro).items() if r.counterpart.startswith("static/")}
        self.table(node, scope, name, skip=skip | shared)
        self._size(node, name)
        self._unknown(node, name, static)
        if static is not None:
            for key, row in declared(scope, self.distro).items():
                source = f"{static.namespace}/{row.counterpart.partition('/')[2]}"
                if key in shared and source in self.params:
                    value = self.value(source)
                    value = 255 if key == "unknown_cost_value" and value < 0 else value
                    self.put(node, scope, key, value, [source], note="a parameter of the costmap in Nav2")
        layers: list[tuple[str, str, Plugin[Any]]] = []
        for layer in costmap.layers:
            nav2 = _class_of("layer", LAYERS, layer.cls.__name__, layer)
            if nav2 and declared(nav2, self.distro):
                layers.append((layer.name, nav2, layer))
            else:
                note = f"{self.program} has no such layer"
                self.changes.append(Change("no counterpart", f"{layer.namespace}", _type_of(layer), "", "", None, note))
                self.used.update(n for n in self.params if n.startswith(f"{layer.namespace}/"))
        self.text(node, "plugins", [id_ for id_, _, _ in layers], [f"{name}/plugins"])
        for id_, nav2, layer in layers:
            self.text(node, f"{id_}.plugin", nav2)
            self._layer(node, id_, nav2, layer)

    def _footprint(self, node: str, name: str) -> None:
        p = self.params.get(f"{name}/footprint")
        points = parse_footprint(p.value) if p is not None and p.value not in (None, [], "", "[]") else []
        if points and p is not None:
            text = "[" + ", ".join(f"[{x!r}, {y!r}]" for x, y in points) + "]"
            note = "" if isinstance(p.value, str) else "a text in Nav2"
            self.put(node, "costmap", "footprint", text, [p.name], kind="converted", note=note)
            self.used.add(f"{name}/robot_radius")
        else:
            radius = f"{name}/robot_radius"
            self.put(node, "costmap", "robot_radius", self.value(radius), [radius])
            self.used.add(f"{name}/footprint")

    def _size(self, node: str, name: str) -> None:
        for key in ("width", "height"):
            p = self.params[f"{name}/{key}"]
            whole = math.ceil(p.value - 1e-9)
            note = "" if whole == p.value else "whole meters in Nav2: rounded up"
            self.put(node, "costmap", key, whole, [p.name], kind="nearest" if note else "carried over", note=note)
            self.used.add(p.name)

    def _unknown(self, node: str, name: str, static: Plugin[Any] | None) -> None:
        own = f"{name}/track_unknown_space"
        value, sources = self.value(own), [own]
        if static is not None and not value and self.value(f"{static.namespace}/track_unknown_space"):
            value, sources = True, [f"{static.namespace}/track_unknown_space"]
        note = "one for the whole costmap in Nav2" if sources != [own] else ""
        kind: Kind = "converted" if note else "carried over"
        self.put(node, "costmap", "track_unknown_space", value, sources, kind=kind, note=note)
        self.used.update(n for n in self.params if n.startswith(f"{name}/") and n.endswith("/track_unknown_space"))

    def _layer(self, node: str, id_: str, scope: str, layer: Plugin[Any]) -> None:
        skip = {"map_topic"} if self.params.get(f"{layer.namespace}/map_topic") is None else set[str]()
        self.table(node, scope, layer.namespace, f"{id_}.", skip=skip)
        if "observation_sources" not in declared(scope, self.distro):
            return
        self.used.update(f"{layer.namespace}/{n}" for n in ("obstacle_range", "raytrace_range"))
        for source in str(self.value(f"{layer.namespace}/observation_sources")).split():
            own = f"{layer.namespace}/{source}/data_type"
            cloud = self.value(own) == "PointCloud"  # Nav2 refuses it
            self.table(
                node,
                "layer source",
                f"{layer.namespace}/{source}",
                f"{id_}.{source}.",
                skip={"data_type"} if cloud else set(),
            )
            if cloud:
                note = "Nav2 reads no PointCloud; the sensor must publish PointCloud2"
                prefix = f"{id_}.{source}."
                self.put(
                    node, "layer source", "data_type", "PointCloud2", [own], prefix=prefix, kind="nearest", note=note
                )

    # --- behaviors, tree ----------------------------------------------------------------------------------------------

    def _tree(self) -> TreeSpec:
        """The tree, with the changes of its parameters."""
        m = self.c.move_base
        recoveries = [self._recovery(plugin) for plugin in (self.c.recoveries if m.recovery_behavior_enabled else ())]
        rate = m.planner_frequency
        hz = "RateController hz" if rate else "GoalUpdatedController" if self.distro > FOXY else "Sequence"
        note = "in the tree" if rate else "no replanning: plans for each goal, and after a recovery"
        self._in_tree("planner_frequency", hz, rate, "carried over" if rate else "converted", note)
        retries = m.max_planning_retries if m.max_planning_retries >= 0 else 1
        note = "each failure clears the global costmap"
        if m.max_planning_retries < 0:
            note = "Nav2 counts failures; move_base tries for planner_patience"
        self._in_tree(
            "max_planning_retries", "RecoveryNode number_of_retries of ComputePathToPose", retries, "nearest", note
        )
        attempts = len(recoveries)
        note = "the list is run in turn; Nav2 counts the recoveries of a goal, move_base those since the last valid command"
        self._in_tree("recovery_behaviors", "RecoveryActions", [r.name for r in recoveries], "nearest", note)
        return TreeSpec(rate, retries, tuple(recoveries), attempts)

    def _in_tree(self, source: str, target: str, value: Any, kind: Kind, note: str) -> None:
        p = self.params[source]
        self.used.add(source)
        self.changes.append(
            Change(kind, source, p.value, origin_of(p, "move_base"), f"{TREE_FILE}: {target}", value, note)
        )

    def _recovery(self, plugin: Plugin[Any]) -> TreeRecovery:
        section, name = plugin.namespace, plugin.name

        def own(key: str) -> Parameter:
            return self.params[f"{section}/{key}"]

        registered = _registered(plugin)

        def note(key: str, target: str, value: Any, of: Kind = "carried over", text: str = "") -> None:
            p = own(key)
            self.used.add(p.name)
            self.changes.append(
                Change(of, p.name, p.value, origin_of(p, "move_base"), f"{TREE_FILE}: {name} {target}", value, text)
            )

        match registered:
            case "clear_costmap_recovery":
                inside, distance = bool(own("invert_area_to_clear").value), float(own("reset_distance").value)
                maps = {"both": COSTMAPS[::-1], "local": COSTMAPS[1:], "global": COSTMAPS[:1]}[
                    own("affected_maps").value
                ]
                nodes = tuple(clear(costmap, distance, inside, self.distro) for costmap in maps)
                if self.distro == FOXY:
                    note("reset_distance", "ClearEntireCostmap", None, "nearest", "Foxy clears the whole costmap")
                else:
                    note("reset_distance", f"{nodes[0][0]} reset_distance", distance)
                note("invert_area_to_clear", nodes[0][0], inside, "converted")
                note("affected_maps", nodes[0][0], [n[1]["service_name"].partition("/")[0] for n in nodes], "converted")
                return TreeRecovery(name, nodes)
            case "rotate_recovery":
                return TreeRecovery(name, (("Spin", {"spin_dist": f"{FULL_TURN}", **self._allowance(_SPIN_TIME_S)}),))
            case "spin" | "spin_to_localize":
                note("spin_dist", "Spin spin_dist", own("spin_dist").value)
                note("time_allowance", "Spin time_allowance", own("time_allowance").value)
                ports = {"spin_dist": repr(own("spin_dist").value), **self._allowance(own("time_allowance").value)}
                return TreeRecovery(name, (("Spin", ports),))
            case "back_up":
                note("backup_dist", "BackUp backup_dist", own("backup_dist").value)
                note("backup_speed", "BackUp backup_speed", own("backup_speed").value)
                ports = {k: repr(own(k).value) for k in ("backup_dist", "backup_speed")}
                return TreeRecovery(name, (("BackUp", ports | self._allowance(own("time_allowance").value)),))
            case "drive_on_heading":
                note("dist_to_travel", "DriveOnHeading dist_to_travel", own("dist_to_travel").value)
                note("speed", "DriveOnHeading speed", own("speed").value)
                ports = {k: repr(own(k).value) for k in ("dist_to_travel", "speed")}
                return TreeRecovery(name, (("DriveOnHeading", ports | self._allowance(own("time_allowance").value)),))
            case "wait":
                seconds = math.ceil(own("wait_duration").value)
                note("wait_duration", "Wait wait_duration", seconds)
                return TreeRecovery(name, (("Wait", {"wait_duration": str(seconds)}),))
            case "move_slow_and_clear":
                side = 2.0 * own("clearing_distance").value
                text = "2 · clearing_distance; the robot does not slow down"
                note("clearing_distance", "ClearCostmapAroundRobot reset_distance", side, "nearest", text)
                return TreeRecovery(name, tuple(clear(c, side, True, self.distro) for c in COSTMAPS[::-1]))
            case _:
                text = "Nav2 has no such behavior; Wait stands in"
                self.changes.append(Change("nearest", section, registered, "", f"{TREE_FILE}: {name} Wait", 5, text))
                return TreeRecovery(name, (("Wait", {"wait_duration": "5"}),))

    def _allowance(self, seconds: float) -> dict[str, str]:
        return {"time_allowance": repr(float(seconds))} if self.distro >= HUMBLE else {}

    def _behavior_server(self) -> None:
        node, scope = self.recoveries_server, "behavior_server"
        key = "behavior_plugins" if self.distro >= HUMBLE else "recovery_plugins"
        behaviors = {"spin": "Spin", "backup": "BackUp", "drive_on_heading": "DriveOnHeading", "wait": "Wait"}
        if self.distro < HUMBLE:
            del behaviors["drive_on_heading"]
        teleop = [b for b in self.c.behaviors if b.cls.__name__ == "AssistedTeleop"]
        if teleop and self.distro >= HUMBLE:
            behaviors["assisted_teleop"] = "AssistedTeleop"
        self.text(node, key, list(behaviors), ["behavior_plugins"])
        for id_, name in behaviors.items():
            self.text(node, f"{id_}.plugin", exported_name("behavior", f"nav2_behaviors::{name}", self.distro))
        frames = ("local_frame", "global_frame") if self.distro >= IRON else ("global_frame",)
        for frame in frames:
            costmap = COSTMAPS[0] if frame == "global_frame" and len(frames) == 2 else COSTMAPS[1]
            source = f"{costmap}/global_frame"
            self.put(node, scope, frame, self.value(source), [source])
        self._base_frame(node, scope)
        found: dict[str, list[str]] = {}
        for plugin in (*self.c.recoveries, *self.c.behaviors):
            for name in (
                "simulate_ahead_time",
                "cycle_frequency",
                "max_rotational_vel",
                "min_rotational_vel",
                "rotational_acc_lim",
                "projection_time",
                "simulation_time_step",
            ):
                if f"{plugin.namespace}/{name}" in self.params:
                    found.setdefault(name, []).append(f"{plugin.namespace}/{name}")
        for name, sources in found.items():
            note = "one for all behaviors in Nav2" if len({self.value(s) for s in sources}) > 1 else ""
            kind: Kind = "nearest" if note else "carried over"
            self.put(node, scope, name, self.value(sources[0]), list(dict.fromkeys(sources)), kind=kind, note=note)
        if "max_rotational_vel" in found:  # DWA's slowest turn is not above the fastest of Spin
            fastest = self.value(found["max_rotational_vel"][0])
            if fastest < 0.4 and "min_rotational_vel" not in found:
                self.put(node, scope, "min_rotational_vel", fastest, kind="added", note="not above max_rotational_vel")

    def _base_frame(self, node: str, scope: str) -> None:
        source = f"{COSTMAPS[1]}/robot_base_frame"
        self.put(node, scope, "robot_base_frame", self.value(source), [source])

    def _bt_navigator(self) -> None:
        node = "bt_navigator"
        source = f"{COSTMAPS[0]}/global_frame"
        self.put(node, node, "global_frame", self.value(source), [source])
        self._base_frame(node, node)
        odometry = f"{self.c.local_planner.namespace}/odom_topic"
        if odometry in self.params:
            self.put(node, node, "odom_topic", self.value(odometry), [odometry])
        key = "default_bt_xml_filename" if self.distro == FOXY else "default_nav_to_pose_bt_xml"
        note = "replanning rate and recoveries; change it if the folder moves"
        self.put(node, node, key, f"{self.folder}/{TREE_FILE}", kind="added", note=note)

    # --- safety, localization -----------------------------------------------------------------------------------------

    def _safety(self) -> None:
        for name in ("velocity_smoother", "collision_monitor", "collision_detector"):
            if f"{name}/" not in {n[: len(name) + 1] for n in self.params} or not declared(name, self.distro):
                continue
            self.table(name, name, name)
            for scope, key in (("monitor polygon", "polygons"), ("monitor source", "observation_sources")):
                for child in self.params[f"{name}/{key}"].value if f"{name}/{key}" in self.params else ():
                    self.table(name, scope, f"{name}/{child}", f"{child}.", skip=_unset(self.params, f"{name}/{child}"))
                    below = self.params.get(f"{name}/{child}/velocity_polygons")
                    for sub in below.value or () if below is not None else ():
                        self.table(name, "monitor sub-polygon", f"{name}/{child}/{sub}", f"{child}.{sub}.")

    def _docking(self) -> None:
        """The docking server, with the types of docks and the docks."""
        node = "docking_server"
        docking = self.c.docking
        if docking is None or self.distro < JAZZY:
            return
        self.table(node, node, node)
        for name in docking.dock_plugins:
            plugin = self.params.get(f"{node}/{name}/plugin")
            written = str(plugin.value) if plugin is not None else _DOCK_TYPE
            kind = DOCK_TYPES.get(written).name if written in DOCK_TYPES else ""
            scope = _DOCK_TYPES.get(kind, written)
            self.text(node, f"{name}.plugin", scope, [plugin.name] if plugin is not None else ())
            self.table(node, scope, f"{node}/{name}", f"{name}.")
        for name in docking.docks:
            self.table(node, "dock", f"{node}/{name}", f"{name}.")

    def _amcl(self) -> None:
        if not any(n.startswith("amcl/") for n in self.params):
            del self.nodes["amcl"]
            return
        self.table(
            "amcl", "amcl", "amcl", skip=("robot_model_type", "initial_pose.x", "initial_pose.y", "initial_pose.yaw")
        )
        model = str(self.value("amcl/odom_model_type"))
        omni = model.startswith("omni")
        if self.distro < HUMBLE:
            name = "omnidirectional" if omni else "differential"
        else:
            name = f"nav2_amcl::{'Omni' if omni else 'Differential'}MotionModel"
        corrected = model.endswith("corrected")
        note = (
            ""
            if corrected
            else "the corrected model; divide alpha1..alpha4 of the old one by their squares if they were tuned"
        )
        kind: Kind = "converted" if corrected else "nearest"
        self.put("amcl", "amcl", "robot_model_type", name, ["amcl/odom_model_type"], kind=kind, note=note)
        self.put("amcl", "amcl", "transform_tolerance", 0.1, kind="added", note="default of amcl of ROS 1")

    def _required_nodes(self) -> None:
        """Nodes that nav2_bringup starts, and whose defaults would change the drive or keep it from starting."""
        if self.distro >= HUMBLE and "velocity_smoother" not in self.nodes:
            self._passing_smoother()
        if self.distro >= JAZZY and "collision_monitor" not in self.nodes:
            self._passing_monitor()
        base = f"{COSTMAPS[1]}/robot_base_frame"
        if self.distro >= HUMBLE:
            self._base_frame("smoother_server", "smoother_server")
        if self.distro >= JAZZY and self.c.docking is None:
            self.put("docking_server", "docking_server", "base_frame", self.value(base), [base])
            self.text("docking_server", "dock_plugins", [_DOCK_TYPE], note="nav2_bringup starts it; it needs one")
            self.text("docking_server", f"{_DOCK_TYPE}.plugin", _DOCK_TYPES[_DOCK_TYPE])

    def _passing_smoother(self) -> None:
        node, scope = "velocity_smoother", "velocity_smoother"
        p = self.c.local_planner.params
        forward, backward, left, right, turn = _limits(p)
        turn = max(turn, *(self.value(n) for n in self.params if n.endswith("/max_rotational_vel")), 0.0)
        note = "limits of the controller: move_base has no smoother"
        self.put(node, scope, "max_velocity", [forward, left, turn], kind="added", note=note)
        backward = min(backward, *(-abs(self.value(n)) for n in self.params if n.endswith("/backup_speed")), 0.0)
        self.put(node, scope, "min_velocity", [backward, right, -turn], kind="added", note=note)
        up, down = _accelerations(p)
        self.put(node, scope, "max_accel", up, kind="added", note=note)
        self.put(node, scope, "max_decel", down, kind="added", note=note)

    def _passing_monitor(self) -> None:
        """A monitor that lets every command pass: one that has no polygon and no source does not start."""
        node = "collision_monitor"
        note = "nav2_bringup starts it; move_base has none"
        self.put(node, node, "polygons", ["FootprintApproach"], kind="added", note=note)
        self.put(node, node, "observation_sources", ["scan"], kind="added", note=note)
        self.put(
            node,
            node,
            "base_frame_id",
            self.value(f"{COSTMAPS[1]}/robot_base_frame"),
            [f"{COSTMAPS[1]}/robot_base_frame"],
        )
        self.put(
            node, node, "odom_frame_id", self.value(f"{COSTMAPS[1]}/global_frame"), [f"{COSTMAPS[1]}/global_frame"]
        )
        self.put(node, node, "source_timeout", 0.0, kind="added", note="does not stop the robot without data")
        polygon: dict[str, Any] = {
            "type": "polygon",
            "action_type": "approach",
            "footprint_topic": "/local_costmap/published_footprint",
            "min_points": 6,
            "enabled": False,
        }
        for key, value in polygon.items():
            text = "set it to true to use the monitor" if key == "enabled" else ""
            self.put(node, "monitor polygon", key, value, prefix="FootprintApproach.", kind="added", note=text)
        scans = [n for n in self.params if n.endswith("/data_type") and self.value(n) == "LaserScan"]
        topic = f"{scans[0].rpartition('/')[0]}/topic" if scans else ""
        self.put(node, "monitor source", "type", "scan", prefix="scan.", kind="added")
        self.put(
            node,
            "monitor source",
            "topic",
            self.value(topic) if topic else "scan",
            [topic] if topic else [],
            prefix="scan.",
            kind="added",
        )

    # --- the rest -----------------------------------------------------------------------------------------------------

    def _kept(self) -> str:
        """The YAML of what is no part of Nav2, for navstack; empty without."""
        kept = [p for p in self.params.values() if p.name.partition("/")[0] in _KEPT or _is_filter(p.name)]
        kept = [p for p in kept if p.origin is not None and p.name != "navstack/ros_distro"]  # a scale of DWA's weights
        self.used.update(
            p.name for p in self.params.values() if p.name.partition("/")[0] in _KEPT or _is_filter(p.name)
        )
        for p in kept:
            self.changes.append(
                Change(
                    "carried over",
                    p.name,
                    p.value,
                    origin_of(p, "move_base"),
                    f"{NAVSTACK_FILE}: {p.name}",
                    p.value,
                    "no part of Nav2; navstack reads it",
                )
            )
        if not kept:
            return ""
        return as_yaml(kept, ("settings of navstack, which Nav2 does not read",), written_only=True)

    def _rest(self) -> None:
        """Report the written parameters that have no counterpart, with what is lost."""
        for p in self.params.values():
            if p.name in self.used or p.origin is None or p.value is None:
                continue
            last = p.name.rpartition("/")[2]
            loss = _LOSS.get(last) or f"lost: {p.info.description or last}"
            self.changes.append(Change("no counterpart", p.name, p.value, origin_of(p, "move_base"), "", None, loss))


def _class_of(kind: Any, registry: Registry[Any], name: str, layer: Plugin[Any] | None = None) -> str:
    """The class of Nav2 that navstack has under a name, "" without."""
    for nav2, own in CLASSES[kind].items():
        if own and own in registry and nav2.startswith(("nav2", "dwb")):
            entry = registry.get(own)
            if (
                (entry.cls is layer.cls)
                if layer is not None
                else (name in (entry.name, own) or (name in registry and registry.get(name) is entry))
            ):
                return nav2
    return ""


def _type_of(plugin: Plugin[Any]) -> str:
    """The registered name of a layer."""
    return next((e.name for e in LAYERS if e.cls is plugin.cls), plugin.cls.__name__)


def _registered(plugin: Plugin[Any]) -> str:
    """The registered name of a recovery behavior."""
    return next((e.name for e in RECOVERY_BEHAVIORS if e.cls is plugin.cls), plugin.cls.__name__)


_TOPICS: Final = ("topic", "map_topic", "topics")


def _absolute(topic: Any) -> Any:
    if isinstance(topic, str):
        return topic if topic.startswith(("/", "~")) else f"/{topic}"
    return [_absolute(t) for t in topic]


_DOCK_TYPE: Final = "simple_charging_dock"
_DOCK_TYPES: Final = {
    _DOCK_TYPE: "opennav_docking::SimpleChargingDock",
    "simple_non_charging_dock": "opennav_docking::SimpleNonChargingDock",
}
"""Registered name of a type of docks -> its class."""


def _is_specs(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(v, dict) for v in value)


def _is_filter(name: str) -> bool:
    section = name.partition("/")[0]
    return section in NODE_SECTIONS and section not in (
        "velocity_smoother",
        "collision_monitor",
        "collision_detector",
        "amcl",
        "docking_server",
    )


def _unset(params: Mapping[str, Parameter], section: str) -> set[str]:
    """Keys of a section that are at their default: polygons and sources read those of their type only."""
    return {n.rpartition("/")[2] for n, p in params.items() if n.startswith(f"{section}/") and p.origin is None}


def _numbers(value: Any) -> list[float]:
    """The sideways speeds of the trajectory rollout: a list, or a text with commas."""
    items = value.replace(",", " ").split() if isinstance(value, str) else value or []
    return [float(v) for v in items]


def _limits(params: Any) -> tuple[float, float, float, float, float]:
    """Forward, backward, left and right speed (m/s) and turning speed (rad/s) of a controller."""

    def of(*names: str, default: float) -> float:
        return next((float(getattr(params, n)) for n in names if getattr(params, n, None) is not None), default)

    forward = of("max_vel_x", "vx_max", "max_linear_vel", "v_linear_max", default=0.5)
    backward = min(0.0, of("min_vel_x", "vx_min", default=-forward), of("escape_vel", default=0.0))
    left = of("max_vel_y", default=0.0)
    if getattr(params, "holonomic_robot", False):
        left = max((abs(v) for v in _numbers(params.y_vels)), default=0.0)
    if "omni" in str(getattr(params, "motion_model", "")).lower():
        left = of("vy_max", default=0.0)
    turn = of("max_vel_theta", "wz_max", "max_angular_vel", "v_angular_max", default=2.5)
    turn = max(
        turn,
        of("rotate_to_heading_angular_vel", default=0.0),
        -of("min_vel_theta", default=0.0) if hasattr(params, "y_vels") else 0.0,
    )
    return forward, backward, left, -left, turn


def _accelerations(params: Any) -> tuple[list[float], list[float]]:
    """Largest accelerations and decelerations (negative) of a controller along x, y and in a turn."""

    def of(names: Sequence[str], default: float) -> float:
        return next((float(v) for n in names if (v := getattr(params, n, None)) is not None), default)

    up = [of(names, default) or default for names, default in zip(_ACCELERATIONS, _BASE)]
    down = [of(names, -limit) or -limit for names, limit in zip(_DECELERATIONS, up)]
    return up, down

"""Conversion between move_base and Nav2."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from navstack.core import InputError, NavError, OutputError, ParameterError
from navstack.local_planner.map_grid import distance_weight
from navstack.parameters import (
    Configuration,
    Conversion,
    check_parameters,
    load_configuration,
    parameters_of,
    to_move_base,
    to_nav2,
)
from navstack.parameters.nav2.conversion import rcl_text
from navstack.parameters.nav2.declared import NAV2_DISTROS
from navstack.parameters.nav2.tree_xml import TreeRecovery, TreeSpec, read_tree, write_tree
from tests.parameters.robots import name_of, robots

ROBOTS = robots()
PACKAGED = [
    "turtlebot",
    "turtlebot_rollout",
    "turtlebot_dwb",
    "turtlebot_mppi",
    "turtlebot_rpp",
    "turtlebot_shim",
    "turtlebot_graceful",
    "jackal_dwa",
    "omni_dwa",
    "car_rpp",
]

OWN_TREE = "nav2-tree"
"""The rule that notes that navstack does not run a tree of the user."""
ONE_SIDED = frozenset(
    {
        # move_base only
        "planner_patience",
        "recovery_behavior_enabled",
        "clearing_rotation_allowed",
        "clearing_radius",
        "conservative_reset_dist",
        "shutdown_costmaps",
        "make_plan_clear_costmap",
        "make_plan_add_unreachable_goal",
        "footprint_topic",
        "published_footprint_topic",
        "first_map_only",
        "visualize_potential",
        "min_valid_share",
        "start_policy",
        "max_expansions",
        # counted in Nav2, timed in move_base
        "max_planning_retries",
        # one for the costmap in Nav2, one for each layer in move_base
        "track_unknown_space",
        # -1 and 255 are one byte
        "unknown_cost_value",
        # lists of plugins: compared by the plugins themselves
        "plugins",
        "recovery_behaviors",
        # DWA is compared by itself; the other becomes DWA
        "base_local_planner",
        # lists or texts
        "footprint",
    }
)


def nav2(sources: list[Any], folder: Path, distro: str = "jazzy") -> tuple[Conversion, list[str]]:
    """Convert and write; the files that navstack loads."""
    made = to_nav2(sources, distro, str(folder), allow_missing=True)
    made.save(folder, force=True)
    return made, [str(folder / name) for name in made.params]


def there_and_back(sources: list[Any], folder: Path, distro: str = "jazzy") -> Configuration:
    """The configuration after PARAMS -> Nav2 -> move_base."""
    _, files = nav2(sources, folder / "nav2", distro)
    back = to_move_base(files, distro=distro)
    back.save(folder / "back", force=True)
    return load_configuration([str(folder / "back" / name) for name in back.params])


def values(configuration: Configuration) -> dict[str, Any]:
    return {p.name: p.value for p in parameters_of(configuration) if p.value is not None}


def same(name: str, old: Any, new: Any) -> bool:
    if name.endswith("topic") and isinstance(old, str):
        return old.lstrip("/") == new.lstrip("/")
    if isinstance(old, float):
        return new == pytest.approx(old)
    return bool(old == new)


def is_one_sided(name: str, old: Mapping[str, Any]) -> bool:
    """True for what only one stack has; ranges of a layer stand in its sources in Nav2."""
    section, _, last = name.rpartition("/")
    return last in ONE_SIDED or (
        last in ("obstacle_range", "raytrace_range") and f"{section}/observation_sources" in old
    )


def assert_same_effect(before: Configuration, after: Configuration) -> None:
    """Every key that both stacks have has the same effective value."""
    old, new = values(before), values(after)
    planner = before.global_planner.namespace if before.global_planner.cls is after.global_planner.cls else "none"
    sections = ("local_costmap/", "global_costmap/", f"{planner}/")
    carried = [n for n in old if ("/" not in n or n.startswith(sections)) and not is_one_sided(n, old)]
    if before.global_planner.cls is not after.global_planner.cls:
        carried.remove("base_global_planner")
    assert len(carried) > 30
    for costmap in ("global_costmap", "local_costmap"):
        size = {f"{costmap}/width", f"{costmap}/height"}
        assert all(math.ceil(old[n] - 1e-9) == new[n] for n in size)  # whole meters
        carried = [n for n in carried if n not in size]
        one, other = getattr(before, costmap), getattr(after, costmap)
        assert [(x.name, x.cls) for x in one.layers] == [(x.name, x.cls) for x in other.layers]
        assert other.footprint.vertices == pytest.approx(one.footprint.vertices)
        if one.footprint.vertices.shape[0] != 16:
            carried = [n for n in carried if n != f"{costmap}/robot_radius"]  # the footprint takes precedence
    clouds = [n for n in carried if n.endswith("/data_type") and old[n] == "PointCloud"]  # Nav2 reads PointCloud2 only
    assert all(new[n] == "PointCloud2" for n in clouds)
    carried = [n for n in carried if n not in clouds]
    assert {n: (old[n], new.get(n)) for n in carried if not same(n, old[n], new.get(n))} == {}


def assert_same_dwa(before: Configuration, after: Configuration) -> None:
    """DWA has the same limits, samples, tolerances and weights."""
    one, other = before.local_planner.params, after.local_planner.params
    names = (
        "max_vel_trans min_vel_trans max_vel_x max_vel_y min_vel_y max_vel_theta acc_lim_x acc_lim_y "
        "acc_lim_theta xy_goal_tolerance yaw_goal_tolerance latch_xy_goal_tolerance trans_stopped_vel sim_time sim_granularity "
        "angular_sim_granularity twirling_scale oscillation_reset_dist oscillation_reset_angle forward_point_distance vx_samples "
        "vth_samples use_dwa sum_scores prune_plan"
    )
    for name in names.split():
        assert getattr(other, name) == pytest.approx(getattr(one, name)), name
    frequency = getattr(one, "controller_frequency", 0.0) or before.move_base.controller_frequency
    reached = one.acc_lim_theta * (1.0 / frequency if one.use_dwa else one.sim_time)
    assert other.min_vel_theta == pytest.approx(min(one.min_vel_theta, reached))  # DWB samples its turns in place
    assert other.min_vel_x == min(0.0, one.min_vel_x)  # DWB turns in place with a sample of 0 m/s
    assert other.vy_samples == max(1, one.vy_samples)
    resolution = before.local_costmap.params.resolution
    for name in ("path_distance_bias", "goal_distance_bias"):
        weights = [
            distance_weight(getattr(c.local_planner.params, name), resolution, c.navstack.ros_distro)
            for c in (before, after)
        ]
        assert weights[1] == pytest.approx(weights[0]), name
    scaled = one.occdist_scale * (resolution if before.navstack.ros_distro == "indigo" else 1.0)
    assert other.occdist_scale == pytest.approx(scaled)


def test_docks_and_their_types_survive_the_way_there_and_back(tmp_path: Path) -> None:
    docking = {
        "max_retries": 7,
        "dock_plugins": ["charger", "place"],
        "charger": {"plugin": "simple_charging_dock", "staging_x_offset": -0.5},
        "place": {"plugin": "opennav_docking::SimpleNonChargingDock", "dock_direction": "backward"},
        "docks": ["home"],
        "home": {"type": "charger", "pose": [1.0, 2.0, 0.5]},
        "controller": {"k_phi": 2.5},
    }
    sources = ["turtlebot", {"docking_server": docking}]
    made, files = nav2(sources, tmp_path / "nav2", "kilted")
    there = load_configuration(files, distro="kilted")
    back = there_and_back(sources, tmp_path, "kilted")
    for other in (there, back):
        assert other.docking is not None
        assert (other.docking.max_retries, other.docking.controller.k_phi) == (7, 2.5)
        charger, place = (other.docking.sections[name] for name in ("charger", "place"))
        assert type(charger).__name__ == "SimpleChargingDockParams" and charger.staging_x_offset == -0.5
        assert type(place).__name__ == "SimpleNonChargingDockParams" and place.dock_direction == "backward"
        assert other.docking.sections["home"].pose == [1.0, 2.0, 0.5]
    assert [c for c in made.of_kind("no counterpart") if c.source.startswith("docking_server")] == []


@pytest.mark.parametrize("id_", ["goal_checker", "general_goal_checker"])
def test_the_tolerances_of_the_goal_checker_come_back_whatever_its_id(id_: str, tmp_path: Path) -> None:
    _, (file, *_) = nav2(["turtlebot"], tmp_path, "humble")
    path = Path(file)
    values = {"xy_goal_tolerance": 0.31, "yaw_goal_tolerance": 0.22}
    text = path.read_text("utf-8").replace('["goal_checker"]', f'["{id_}"]').replace("    goal_checker:", f"    {id_}:")
    found = yaml.safe_load(text)
    found["controller_server"]["ros__parameters"][id_].update(values)
    path.write_text(yaml.safe_dump(found), encoding="utf-8")
    made = yaml.safe_load(to_move_base([str(path)], distro="humble").files["move_base_params.yaml"])
    assert {key: made["DWAPlannerROS"][key] for key in values} == values


def test_servers_of_trees_survive_the_way_there_and_back(tmp_path: Path) -> None:
    robot = {
        "behavior_plugins": [{"name": "assisted_teleop", "type": "nav2_behaviors::AssistedTeleop"}],
        "assisted_teleop": {"projection_time": 2.5},
        "smoother_server": {
            "smoother_plugins": [{"name": "route_smoother", "type": "nav2_smoother::SimpleSmoother"}],
            "route_smoother": {"refinement_num": 5, "w_data": 0.4},
        },
        "route_server": {
            "smooth_corners": True,
            "edge_cost_functions": ["D"],
            "D": {"plugin": "nav2_route::DistanceScorer", "weight": 2.0},
        },
    }
    before = load_configuration(["turtlebot", robot])
    after = there_and_back(["turtlebot", robot], tmp_path, "kilted")
    assert after.smoothers == before.smoothers
    (teleop,) = [b for b in after.behaviors if b.name == "assisted_teleop"]
    assert teleop.params.projection_time == 2.5
    assert {key: after.route_server[key] for key in ("smooth_corners", "edge_cost_functions")} == {
        "smooth_corners": True,
        "edge_cost_functions": ["D"],
    }
    assert after.route_server["D"]["weight"] == 2.0


@pytest.mark.parametrize("distro", NAV2_DISTROS)
def test_nav2_accepts_the_file_of_every_distribution(distro: str, tmp_path: Path) -> None:
    _, files = nav2(["turtlebot"], tmp_path / "out", distro)
    found = check_parameters(files, distro=distro)
    assert [str(f) for f in found if f.severity != "info" and f.rule != OWN_TREE] == []


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.parametrize("distro", ["humble", "jazzy", "lyrical"])
@pytest.mark.parametrize("name", PACKAGED)
def test_nav2_accepts_the_packaged_robots(name: str, distro: str, tmp_path: Path) -> None:
    _, files = nav2([name], tmp_path / "out", distro)
    assert [str(f) for f in check_parameters(files, distro=distro) if f.severity == "error"] == []
    found = check_parameters(files, distro=distro)
    ignored = [str(f) for f in found if f.rule.startswith("nav2") and f.severity == "warning" and f.rule != OWN_TREE]
    assert ignored == []


@pytest.mark.parametrize("sources", [["turtlebot"], ["jackal_dwa"], ["omni_dwa"]])
def test_dwa_comes_back_unchanged(sources: list[Any], tmp_path: Path) -> None:
    before = load_configuration(sources)
    after = there_and_back(sources, tmp_path)
    assert_same_effect(before, after)
    assert_same_dwa(before, after)


@pytest.mark.sampled
@pytest.mark.slow
@pytest.mark.skipif(not ROBOTS, reason="no foreign data here: set NAVSTACK_DATA to their folder")
@pytest.mark.parametrize("sources", ROBOTS, ids=[name_of(r) for r in ROBOTS])
def test_published_robots_come_back_unchanged(sources: list[str], tmp_path: Path) -> None:
    try:
        before = load_configuration(sources, allow_missing=True)
    except ParameterError:
        with pytest.raises(ParameterError):
            to_nav2(sources, "jazzy", str(tmp_path), allow_missing=True)
        return
    after = there_and_back(sources, tmp_path)
    assert_same_effect(before, after)
    written = str(tmp_path / "nav2" / "nav2_params.yaml")
    assert [str(f) for f in check_parameters([written], distro="jazzy") if f.severity == "error"] == []
    if before.local_planner.name == "dwa":
        assert_same_dwa(before, after)


SPEED = st.floats(0.05, 2.0)
SCALE = st.floats(0.01, 60.0)
TIME = st.floats(0.1, 30.0)


@st.composite
def parameters(draw: st.DrawFn) -> dict[str, Any]:
    """Parameters of a DWA robot, in nested namespaces."""
    fastest = draw(SPEED)
    planner: dict[str, Any] = {
        "max_vel_x": fastest,
        "min_vel_x": draw(st.floats(-fastest, 0.0)),
        "max_vel_trans": fastest,
        "min_vel_trans": draw(st.floats(0.0, 0.05)),
        "max_vel_theta": draw(st.floats(0.5, 3.0)),
        "min_vel_theta": draw(st.floats(0.0, 0.5)),
        "acc_lim_x": draw(st.floats(0.1, 20.0)),
        "acc_lim_theta": draw(st.floats(0.1, 20.0)),
        "xy_goal_tolerance": draw(st.floats(0.05, 1.0)),
        "yaw_goal_tolerance": draw(st.floats(0.05, 3.0)),
        "latch_xy_goal_tolerance": draw(st.booleans()),
        "trans_stopped_vel": draw(st.floats(0.0, 0.3)),
        "theta_stopped_vel": draw(st.floats(0.0, 0.6)),
        "sim_time": draw(st.floats(0.5, 4.0)),
        "sim_granularity": draw(st.floats(0.01, 0.2)),
        "path_distance_bias": draw(SCALE),
        "goal_distance_bias": draw(SCALE),
        "occdist_scale": draw(st.floats(0.0, 2.0)),
        "twirling_scale": draw(st.sampled_from([0.0, 0.5, 3.0])),
        "forward_point_distance": draw(st.floats(0.0, 0.5)),
        "vx_samples": draw(st.integers(1, 30)),
        "vy_samples": draw(st.integers(0, 10)),
        "vth_samples": draw(st.integers(1, 40)),
        "use_dwa": draw(st.booleans()),
        "sum_scores": draw(st.booleans()),
        "prune_plan": draw(st.booleans()),
    }
    layer = {
        "obstacle_range": draw(st.floats(0.5, 10.0)),
        "max_obstacle_height": draw(st.floats(0.5, 3.0)),
        "observation_sources": "scan",
        "scan": {
            "data_type": "LaserScan",
            "topic": draw(st.sampled_from(["scan", "/base/scan"])),
            "marking": draw(st.booleans()),
        },
    }
    inflation = {"inflation_radius": draw(st.floats(0.1, 2.0)), "cost_scaling_factor": draw(st.floats(0.5, 20.0))}
    both = {
        "robot_radius": draw(st.floats(0.1, 0.5)),
        "update_frequency": draw(st.floats(1.0, 20.0)),
        "obstacle_layer": layer,
        "inflation_layer": inflation,
    }
    obstacles = {"name": "obstacle_layer", "type": "costmap_2d::ObstacleLayer"}
    around = {"name": "inflation_layer", "type": "costmap_2d::InflationLayer"}
    static = {"name": "static_layer", "type": "costmap_2d::StaticLayer"}
    return {
        "base_local_planner": "dwa_local_planner/DWAPlannerROS",
        "controller_frequency": draw(st.floats(1.0, 50.0)),
        "controller_patience": draw(TIME),
        "planner_frequency": draw(st.sampled_from([0.0, 0.3, 1.0, 5.0])),
        "oscillation_timeout": draw(st.sampled_from([0.0, 5.0, 33.3])),
        "oscillation_distance": draw(st.floats(0.05, 1.0)),
        "clearing_rotation_allowed": draw(st.booleans()),
        "NavfnROS": {"default_tolerance": draw(st.floats(0.0, 1.0)), "allow_unknown": draw(st.booleans())},
        "DWAPlannerROS": planner,
        "global_costmap": {**both, "plugins": [static, obstacles, around]},
        "local_costmap": {
            **both,
            "global_frame": "odom",
            "rolling_window": True,
            "width": float(draw(st.integers(3, 12))),
            "height": 6.0,
            "resolution": draw(st.sampled_from([0.025, 0.05, 0.1])),
            "plugins": [obstacles, around],
        },
        "navstack": {"ros_distro": draw(st.sampled_from(["noetic", "indigo"]))},
    }


@pytest.mark.slow
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(raw=parameters(), distro=st.sampled_from(["galactic", "humble", "iron", "jazzy", "kilted"]))
def test_any_parameters_come_back_with_the_same_effect(raw: dict[str, Any], distro: str, tmp_path: Path) -> None:
    before = load_configuration([raw])
    after = there_and_back([raw], tmp_path, distro)
    assert_same_effect(before, after)
    assert_same_dwa(before, after)
    kinds = [type(r.params).__name__ for r in before.recoveries]
    assert [type(r.params).__name__ for r in after.recoveries] == kinds
    distances = [getattr(r.params, "reset_distance", None) for r in before.recoveries]
    back = [getattr(r.params, "reset_distance", None) for r in after.recoveries]
    assert back == [pytest.approx(d, rel=1e-5) if d is not None else None for d in distances]


def test_a_default_that_differs_is_written(tmp_path: Path) -> None:
    """move_base's source keeps points up to 2 m; the default of Nav2 would drop them all."""
    made, _ = nav2(["jackal_dwa"], tmp_path / "out")
    costmap = yaml.safe_load(made.files["nav2_params.yaml"])["local_costmap"]["local_costmap"]["ros__parameters"]
    written = load_configuration(["jackal_dwa"]).tree.space("local_costmap")
    assert written is not None
    (layer,) = [v for v in costmap.values() if isinstance(v, dict) and "observation_sources" in v]
    source = layer[layer["observation_sources"].split()[0]]
    assert source["max_obstacle_height"] > 0.0
    planner = yaml.safe_load(made.files["nav2_params.yaml"])["planner_server"]["ros__parameters"]["GridBased"]
    assert planner["tolerance"] == 0.0


def test_values_have_the_types_of_nav2(tmp_path: Path) -> None:
    raw = {
        "base_local_planner": "dwa",
        "controller_frequency": 10,
        "local_costmap": {
            "rolling_window": True,
            "plugins": [],
            "footprint": [[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]],
        },
        "global_costmap": {"plugins": [], "robot_radius": 0.3},
    }
    made = to_nav2([raw], "jazzy", str(tmp_path))
    text = made.files["nav2_params.yaml"]
    assert "controller_frequency: 10.0 " in text
    assert 'footprint: "[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]"' in text
    root = yaml.safe_load(text)
    costmap = root["local_costmap"]["local_costmap"]["ros__parameters"]
    assert costmap["width"] == 10 and isinstance(costmap["width"], int)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1.0, "1.0"),
        (1e-10, "1.0e-10"),
        (math.inf, ".inf"),
        (-math.inf, "-.inf"),
        (1e22, "1.0e+22"),
        ('a"b', '"a\\"b"'),
        ([1.0, 2.5], "[1.0, 2.5]"),
    ],
)
def test_doubles_are_doubles_in_yaml_1_1(value: Any, text: str) -> None:
    assert rcl_text(value) == text
    assert yaml.safe_load(text) == value


def test_every_written_key_is_reported_once_or_more(tmp_path: Path) -> None:
    made, _ = nav2(["turtlebot"], tmp_path / "out")
    reported = {c.source for c in made.changes}
    written = {
        p.name for p in parameters_of(load_configuration(["turtlebot"])) if p.origin is not None and p.value is not None
    }
    layer_ranges = {
        n for n in written if n.endswith(("obstacle_layer/obstacle_range", "obstacle_layer/raytrace_range"))
    }
    merged = {n for n in written if n.endswith("/track_unknown_space")}
    assert written - reported - layer_ranges - merged <= {"DWAPlannerROS/controller_frequency", "navstack/ros_distro"}


def test_the_report_states_what_a_loss_does(tmp_path: Path) -> None:
    made, _ = nav2(["turtlebot"], tmp_path / "out")
    lost = {c.source: c for c in made.of_kind("no counterpart")}
    assert "footprint does not grow" in lost["DWAPlannerROS/scaling_speed"].note
    assert lost["DWAPlannerROS/scaling_speed"].origin.startswith("turtlebot/dwa_local_planner_params.yaml:")
    assert all(c.note for c in lost.values())
    assert "`DWAPlannerROS/scaling_speed`" in made.files["conversion.md"]


def test_topics_of_costmaps_are_absolute_up_to_jazzy(tmp_path: Path) -> None:
    for distro, topic in (("jazzy", '"/scan"'), ("kilted", '"scan"')):
        made, _ = nav2(["turtlebot"], tmp_path / distro, distro)
        costmap = made.files["nav2_params.yaml"].partition("local_costmap:")[2].partition("planner_server:")[0]
        assert f"topic: {topic} " in costmap


@pytest.mark.parametrize(("written", "least", "kind"), [(1.37, 0.32, "nearest"), (0.2, 0.2, "carried over")])
def test_the_slowest_turn_is_in_reach_from_rest(written: float, least: float, kind: str, tmp_path: Path) -> None:
    """A turtlebot3 has 1.37 rad/s and reaches 3.2 / 10 in a cycle: DWB would have no turn in place and never end a goal."""
    raw = {
        "base_local_planner": "dwa_local_planner/DWAPlannerROS",
        "controller_frequency": 10.0,
        "DWAPlannerROS": {"acc_lim_theta": 3.2, "min_vel_theta": written, "max_vel_theta": 2.75},
        "local_costmap": {"rolling_window": True, "plugins": [], "robot_radius": 0.2},
        "global_costmap": {"plugins": [], "robot_radius": 0.2},
    }
    made = to_nav2([raw], "jazzy", str(tmp_path))
    follow = yaml.safe_load(made.files["nav2_params.yaml"])["controller_server"]["ros__parameters"]["FollowPath"]
    assert follow["min_speed_theta"] == pytest.approx(least)
    (change,) = [c for c in made.changes if c.source == "DWAPlannerROS/min_vel_theta"]
    assert change.kind == kind and ("out of DWB's reach" in change.note) == (kind == "nearest")


def test_trajectory_rollout_counts_cells_or_meters(tmp_path: Path) -> None:
    for meters, scale in ((True, 2.0 * 0.7), (False, 2.0 * 0.7 / 0.05)):
        raw = {
            "base_local_planner": "base_local_planner/TrajectoryPlannerROS",
            "TrajectoryPlannerROS": {"meter_scoring": meters, "path_distance_bias": 0.7, "holonomic_robot": False},
            "local_costmap": {"rolling_window": True, "plugins": [], "robot_radius": 0.2, "resolution": 0.05},
            "global_costmap": {"plugins": [], "robot_radius": 0.2},
        }
        made = to_nav2([raw], "jazzy", str(tmp_path))
        follow = yaml.safe_load(made.files["nav2_params.yaml"])["controller_server"]["ros__parameters"]["FollowPath"]
        assert follow["PathDist"]["scale"] == pytest.approx(scale)
        assert follow["max_vel_y"] == 0.0


@pytest.mark.parametrize("distro", range(len(NAV2_DISTROS)))
def test_a_tree_is_read_as_it_was_written(distro: int, tmp_path: Path) -> None:
    back = TreeRecovery("back", (("BackUp", {"backup_dist": "0.3", "backup_speed": "0.1"}),))
    turn = TreeRecovery("turn", (("Spin", {"spin_dist": "6.28"}), ("Wait", {"wait_duration": "2"})))
    for frequency in (0.0, 0.5):
        spec = TreeSpec(frequency, 2, (back, turn), 4)
        file = tmp_path / "tree.xml"
        file.write_text(write_tree(spec, distro, "a test"), encoding="utf-8")
        read = read_tree(file)
        assert read is not None
        assert (read.planner_frequency, read.planning_retries, read.attempts) == (frequency, 2, 4)
        assert [[(n, p.get("spin_dist"), p.get("backup_dist")) for n, p in r.nodes] for r in read.recoveries] == [
            [("BackUp", None, "0.3")],
            [("Spin", "6.28", None), ("Wait", None, None)],
        ]
        assert ("BTCPP_format" in file.read_text(encoding="utf-8")) == (
            NAV2_DISTROS[distro] in ("jazzy", "kilted", "lyrical")
        )


def test_recoveries_and_rate_are_in_the_tree(tmp_path: Path) -> None:
    nav2(["turtlebot"], tmp_path / "out")
    spec = read_tree(tmp_path / "out" / "navigate_to_pose.xml")
    assert spec is not None
    assert spec.planner_frequency == 1.0
    assert [n for r in spec.recoveries for n, _ in r.nodes] == [
        *["ClearCostmapExceptRegion"] * 2,
        "Spin",
        *["ClearCostmapExceptRegion"] * 2,
    ]


def test_nothing_is_overwritten_without_force(tmp_path: Path) -> None:
    made, _ = nav2(["turtlebot"], tmp_path / "out")
    (tmp_path / "out" / "mine.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(OutputError, match="--force"):
        made.save(tmp_path / "out")
    made.save(tmp_path / "out", force=True)
    assert (tmp_path / "out" / "mine.txt").read_text(encoding="utf-8") == "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("sources", "distro", "message"),
    [
        (["turtlebot"], "jazy", "did you mean jazzy"),
        (["nowhere.yaml"], "jazzy", "is not a file"),
        ([{"controller_frequency": -1.0}], "jazzy", "controller_frequency"),
    ],
)
def test_wrong_input_has_a_message(sources: list[Any], distro: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(NavError, match=message):
        to_nav2(sources, distro, str(tmp_path))


def test_a_file_of_the_target_is_rejected(tmp_path: Path) -> None:
    _, files = nav2(["turtlebot"], tmp_path / "out")
    with pytest.raises(InputError, match="of Nav2 already"):
        to_nav2(files, "humble", str(tmp_path))
    with pytest.raises(InputError, match="of move_base already"):
        to_move_base(["turtlebot"])
    with pytest.raises(ParameterError, match="is not a file"):
        to_move_base(["nowhere.yaml"])


def test_what_move_base_does_not_have_is_reported(tmp_path: Path) -> None:
    _, files = nav2(["turtlebot"], tmp_path / "out")
    lost = {c.source: c for c in to_move_base(files).of_kind("no counterpart")}
    assert lost["planner_server/expected_planner_frequency"].value == 1.0
    assert lost["planner_server/expected_planner_frequency"].origin.startswith(f"{files[0]}:")
    assert not any("max_vel_x" in name or "obstacle_max_range" in name for name in lost)


def test_a_tree_that_is_missing_gives_that_of_the_distribution(tmp_path: Path) -> None:
    _, files = nav2(["turtlebot"], tmp_path / "out")
    (tmp_path / "out" / "navigate_to_pose.xml").unlink()
    back = to_move_base(files)
    (missing,) = [c for c in back.changes if "default_nav_to_pose_bt_xml" in c.source]
    assert "is not here" in missing.note
    back.save(tmp_path / "back")
    names = [
        type(r.params).__name__
        for r in load_configuration([str(tmp_path / "back" / "move_base_params.yaml")]).recoveries
    ]
    assert "BackUpParams" in names

"""Nav2's parameters: how a file is read, what is declared, and what becomes of it."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from navstack.behavior_trees import find_tree
from navstack.core import FrameTree, LaserScan, ParameterError, Pose2D, Transform2D
from navstack.costmap import LayeredCostmap, Nav2ObservationSourceParams
from navstack.docking import DockDatabase
from navstack.parameters import (
    Configuration,
    Finding,
    check_parameters,
    load_configuration,
    parameters_of,
    read_sources,
    same_parameters,
)
from navstack.parameters.nav2.declared import (
    CLASSES,
    HUMBLE,
    JAZZY,
    LYRICAL,
    NATIVE,
    NAV2_DISTROS,
    declared,
    every_row,
    is_known,
    scopes,
)
from navstack.plugins import GLOBAL_PLANNERS, LAYERS
from navstack.routes import read_scorers

ROBOT = Path(__file__).with_name("nav2_robot.yaml")
TEXT = ROBOT.read_text(encoding="utf-8")


def written(folder: Path, text: str, name: str = "robot.yaml") -> str:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return str(path)


def loaded(text: str, folder: Path, **options: Any) -> Configuration:
    return load_configuration([written(folder, text)], **options)


def is_the_robot(other: Configuration) -> bool:
    """All but the simulated lidar is that of the file; a file beside other tests' robots may find their descriptions."""
    robot = load_configuration([str(ROBOT)])
    return same_parameters(replace(other, navstack=robot.navstack), robot)


def replaced(old: str, new: str) -> str:
    assert TEXT.count(old) == 1, f"{old!r} occurs {TEXT.count(old)} times"
    return TEXT.replace(old, new)


def problems(text: str, folder: Path, *more: str, **options: Any) -> list[Finding]:
    found = check_parameters([written(folder, text), *more], **options)
    return [f for f in found if f.severity != "info"]


def with_plugins_of_iron(text: str) -> str:
    for name in ("NavfnPlanner", "Spin", "BackUp", "Wait"):
        text = re.sub(rf"(nav2_\w+)::{name}", rf"\1/{name}", text)
    return text.replace("nav2_recoveries", "nav2_behaviors")


# --- the table --------------------------------------------------------------------------------------------------------


def test_every_class_that_navstack_has_is_in_the_table() -> None:
    assert [name for kind in CLASSES.values() for name in kind if not is_known(name)] == []


def test_no_name_is_declared_twice_in_a_distribution() -> None:
    for scope in scopes():
        for distro in range(len(NAV2_DISTROS)):
            names = [row.name for row in every_row(scope) if row.first <= distro <= row.last]
            twice = {name for name in names if names.count(name) > 1}
            assert not twice, (scope, NAV2_DISTROS[distro], twice)


def test_a_default_has_the_type_of_its_parameter() -> None:
    kinds = {"bool": bool, "int": int, "double": (int, float), "string": str}
    for scope in scopes():
        for row in every_row(scope):
            if row.default is None:
                continue
            values = row.default if isinstance(row.default, list) else [row.default]
            kind = kinds[row.type.removesuffix("s") if row.type.endswith("s") else row.type]
            assert all(isinstance(v, kind) for v in values), (scope, row)


def test_defaults_that_changed_between_distributions() -> None:
    critic = "mppi::critics::PathAngleCritic"
    assert declared(critic, HUMBLE)["max_angle_to_furthest"].default == 1.2
    assert declared(critic, JAZZY)["max_angle_to_furthest"].default == pytest.approx(0.785398)
    assert declared("controller_server", JAZZY)["enable_stamped_cmd_vel"].default is False
    assert declared("controller_server", LYRICAL)["enable_stamped_cmd_vel"].default is True
    assert "goal_checker_plugin" not in declared("controller_server", HUMBLE)


@pytest.mark.parametrize("classes", [CLASSES, NATIVE], ids=["as in ROS 1", "native"])
@pytest.mark.parametrize("kind", ["planner", "layer"])
def test_every_counterpart_of_the_table_is_a_parameter_of_the_plugin(kind: str, classes: Any) -> None:
    """For the planners and layers that exist with the rules of Nav2 and with those of ROS 1."""
    registry: Any = GLOBAL_PLANNERS if kind == "planner" else LAYERS
    for scope, type_ in classes[kind].items():
        if NATIVE[kind][scope] == CLASSES[kind][scope] or not type_:
            continue
        fields = registry.get(type_).cls.Params.model_fields
        for row in every_row(scope):
            counterpart = row.native if classes is NATIVE else row.counterpart
            assert not counterpart or "/" in counterpart or counterpart in fields, (scope, row.name, counterpart)


def test_the_classes_with_two_variants_are_those_with_the_rules_of_nav2() -> None:
    for kind, registry in (("planner", GLOBAL_PLANNERS), ("layer", LAYERS)):
        for scope, type_ in NATIVE[kind].items():
            if scope in registry:  # a plugin of this name has the rules of Nav2
                assert registry.get(type_).cls is registry.get(scope).cls


def test_every_source_range_of_nav2_is_a_parameter_of_its_sources() -> None:
    fields = Nav2ObservationSourceParams.model_fields
    assert [r.name for r in every_row("layer source") if r.native and r.native not in fields] == []
    assert [r.name for r in every_row("layer source") if "range" in r.name and r.native not in fields] == []


# --- reading ----------------------------------------------------------------------------------------------------------


def test_a_robot_of_nav2() -> None:
    robot = load_configuration([str(ROBOT)])
    assert [(f.severity, f.message) for f in robot.findings if f.severity != "info"] == []
    assert robot.local_planner.name == "regulated_pure_pursuit"
    assert robot.local_planner.params.max_linear_vel == 0.4
    assert robot.global_planner.name == "nav2_navfn"
    assert robot.global_planner.params.tolerance == 0.3
    assert robot.move_base.controller_patience == 0.3
    assert robot.move_base.planner_frequency == 1.0
    assert [r.cls.__name__ for r in robot.recoveries[:4]] == ["ClearCostmapRecovery", "Spin", "Wait", "BackUp"]
    spin = robot.recoveries[1].params
    assert (spin.spin_dist, spin.max_rotational_vel, spin.min_rotational_vel) == (1.57, 0.8, 0.4)
    assert (robot.recoveries[3].params.backup_dist, robot.recoveries[3].params.backup_speed) == (0.3, 0.15)
    assert robot.local_costmap.true_footprint.inscribed_radius == pytest.approx(0.15)
    source = robot.local_costmap.layers[0].params.sources["scan"]
    assert (source.obstacle_range, source.raytrace_range, source.data_type) == (2.4, 3.0, "LaserScan")
    assert robot.safety.velocity_smoother is not None and robot.safety.velocity_smoother.max_velocity[0] == 0.4
    assert robot.safety.collision_monitor is not None and robot.safety.collision_monitor.polygons == ["Stop"]


@pytest.mark.slow
@pytest.mark.parametrize(("nearest", "marked"), [("0.0", True), ("1.2", False)])
@pytest.mark.parametrize("layer", ["Obstacle", "Voxel"])
def test_a_minimum_range_of_a_file_has_an_effect(layer: str, nearest: str, marked: bool, tmp_path: Path) -> None:
    """A beam that ends 1 m ahead."""
    text = replaced("obstacle_max_range: 2.4", f"obstacle_max_range: 2.4\n          obstacle_min_range: {nearest}")
    text = text.replace("nav2_costmap_2d::ObstacleLayer", f"nav2_costmap_2d::{layer}Layer")
    made = loaded(text, tmp_path).local_costmap
    frames = FrameTree()
    frames.set("odom", "base_link", Transform2D(), 1.0)
    grid = LayeredCostmap("local", made.params, made.layers[:1], footprint=made.footprint, frames=frames)
    grid.observe(
        LaserScan(np.array([1.02, 1.02], np.float32), 0.0, 0.1, 0.0, 10.0, stamp=1.0, frame="base_link", topic="scan")
    )
    grid.update_at(Pose2D(0.0, 0.0), 1.0)
    assert bool((grid.master.data == 254).any()) is marked


def test_the_defaults_are_nav2s_not_those_of_ros_1() -> None:
    shown = {p.name: p for p in parameters_of(load_configuration([str(ROBOT)]))}
    expected = {
        "local_costmap/publish_frequency": 1.0,
        "local_costmap/robot_radius": 0.1,
        "progress_checker/movement_time_allowance": 10.0,
        "local_costmap/inflation_layer/cost_scaling_factor": 10.0,
    }
    for name, value in expected.items():
        assert (shown[name].value, shown[name].origin_text) == (value, "default of Nav2 jazzy")
    origin = shown["progress_checker/required_movement_radius"].origin
    assert origin is not None and TEXT.splitlines()[origin.line - 1].strip() == "required_movement_radius: 0.4"


def test_what_is_shown_loads_back_to_the_same_robot(tmp_path: Path) -> None:
    robot = load_configuration([str(ROBOT)])
    assert same_parameters(robot, load_configuration([robot.tree.as_dict()]))


def test_a_mapping_is_read_like_a_file() -> None:
    assert same_parameters(load_configuration([yaml.safe_load(TEXT)]), load_configuration([str(ROBOT)]))


def test_several_files_apply_in_order(tmp_path: Path) -> None:
    overlay = written(
        tmp_path, "controller_server: {ros__parameters: {FollowPath: {desired_linear_vel: 0.25}}}", "b.yaml"
    )
    assert load_configuration([str(ROBOT), overlay]).local_planner.params.max_linear_vel == 0.25
    assert load_configuration([overlay, str(ROBOT)]).local_planner.params.max_linear_vel == 0.4


def test_a_folder_with_one_file_of_nav2(tmp_path: Path) -> None:
    written(tmp_path, TEXT, "nav2_params.yaml")
    written(tmp_path, "slam_toolbox: {ros__parameters: {mode: mapping}}", "notes.txt")
    assert load_configuration([str(tmp_path)]).local_planner.name == "regulated_pure_pursuit"
    written(tmp_path, TEXT, "other.yaml")
    (found,) = check_parameters([str(tmp_path)])
    assert found.message == (
        f"the folder has 2 parameter files of Nav2; name the one that is meant: {tmp_path}/nav2_params.yaml, "
        f"{tmp_path}/other.yaml"
    )


@pytest.mark.parametrize("key", ["tb4", "/tb4", "/fleet/tb4", "<robot_namespace>", "/"])
def test_a_robot_in_a_namespace(tmp_path: Path, key: str) -> None:
    inside = "\n".join(f"  {line}" for line in TEXT.splitlines())
    robot = loaded(f"{key}:\n{inside}\n", tmp_path)
    assert is_the_robot(robot)


def test_node_names_with_slashes(tmp_path: Path) -> None:
    text = re.sub(r"(?m)^(\w+):$", r"/tb4/\1:", TEXT)
    assert is_the_robot(loaded(text, tmp_path))


def test_two_robots_in_a_file(tmp_path: Path) -> None:
    inside = "\n".join(f"  {line}" for line in TEXT.splitlines())
    text = f"one:\n{inside}\ntwo:\n{inside.replace('desired_linear_vel: 0.4', 'desired_linear_vel: 0.3')}\n"
    (found,) = check_parameters([written(tmp_path, text)])
    assert found.message == "the files describe 2 robots: one, two; choose one with namespace:=one"
    robot = load_configuration([written(tmp_path, text), "namespace:=two"])
    assert robot.local_planner.params.max_linear_vel == 0.3


@pytest.mark.parametrize("pattern", ["/**", "/*", "/**/controller_server", "'*'"])
def test_wildcards_of_node_names(tmp_path: Path, pattern: str) -> None:
    text = f"{TEXT}\n{pattern}:\n  ros__parameters:\n    use_sim_time: true\n    controller_frequency: 30.0\n"
    assert loaded(text, tmp_path).move_base.controller_frequency == 30.0
    assert problems(text, tmp_path) == []


def test_a_wildcard_before_the_node_is_overridden_by_it(tmp_path: Path) -> None:
    text = f"/**:\n  ros__parameters:\n    controller_frequency: 30.0\n{TEXT}"
    assert loaded(text, tmp_path).move_base.controller_frequency == 20.0


def test_substitutions_of_launch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOT_SPEED", "0.33")
    text = replaced("desired_linear_vel: 0.4", "desired_linear_vel: $(env ROBOT_SPEED)")
    assert loaded(text, tmp_path).local_planner.params.max_linear_vel == 0.33
    text = replaced("desired_linear_vel: 0.4", "desired_linear_vel: $(env NO_SUCH_SPEED 0.31)")
    assert loaded(text, tmp_path).local_planner.params.max_linear_vel == 0.31
    text = replaced("desired_linear_vel: 0.4", "desired_linear_vel: $(var speed)")
    robot = load_configuration([written(tmp_path, text), "speed:=0.32"])
    assert robot.local_planner.params.max_linear_vel == 0.32


def test_tokens_of_nav2_bringup(tmp_path: Path) -> None:
    text = replaced(
        "      width: 3\n",
        '      width: 3\n      filters: ["keepout_filter"]\n      keepout_filter:\n'
        '        plugin: "nav2_costmap_2d::KeepoutFilter"\n        enabled: KEEPOUT_ZONE_ENABLED\n'
        '        filter_info_topic: "keepout_info"\n',
    )
    assert loaded(text, tmp_path).local_costmap.layers[-1].params.enabled is True
    robot = load_configuration([written(tmp_path, text), "use_keepout_zones:=False"])
    assert robot.local_costmap.layers[-1].params.enabled is False


def test_a_keepout_filter_finds_its_mask_through_its_topics(tmp_path: Path) -> None:
    written(tmp_path, "image: mask.pgm", "mask.yaml")
    text = replaced(
        "      width: 3\n",
        '      width: 3\n      filters: ["speed"]\n      speed:\n        plugin: "nav2_costmap_2d::SpeedFilter"\n'
        '        filter_info_topic: "/info"\n',
    )
    text += (
        "costmap_filter_info_server:\n  ros__parameters: {type: 2, filter_info_topic: info, mask_topic: /mask, base: 1.0}\n"
        "filter_mask_server:\n  ros__parameters: {topic_name: mask, yaml_filename: mask.yaml}\n"
    )
    layer = loaded(text, tmp_path).local_costmap.layers[-1].params
    assert (layer.mask, layer.type, layer.base) == (str(tmp_path / "mask.yaml"), "absolute", 1.0)


def test_a_binary_filter_finds_its_mask_through_its_topics(tmp_path: Path) -> None:
    written(tmp_path, "image: mask.pgm", "mask.yaml")
    text = replaced(
        "      width: 3\n",
        '      width: 3\n      filters: ["light"]\n      light:\n        plugin: "nav2_costmap_2d::BinaryFilter"\n'
        '        filter_info_topic: "/info"\n        default_state: true\n        flip_threshold: 20.0\n',
    )
    text += (
        "costmap_filter_info_server:\n  ros__parameters: {type: 3, filter_info_topic: info, mask_topic: /mask, multiplier: 2.0}\n"
        "filter_mask_server:\n  ros__parameters: {topic_name: mask, yaml_filename: mask.yaml}\n"
    )
    layer = loaded(text, tmp_path).local_costmap.layers[-1]
    assert layer.cls is LAYERS.get("binary_mask").cls
    assert layer.params.model_dump() == {
        "enabled": True,
        "mask": str(tmp_path / "mask.yaml"),
        "filter_info_topic": "/info",
        "base": 0.0,
        "multiplier": 2.0,
        "default_state": True,
        "flip_threshold": 20.0,
    }


_DECAYING = (
    '      width: 3\n      plugins: ["voxels"]\n      voxels:\n'
    '        plugin: "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer"\n        voxel_decay: 15.0\n'
    "        observation_sources: livox\n        livox: {topic: cloud, model_type: 1, obstacle_range: 5.0, clearing: true}\n"
)


def test_a_spatio_temporal_voxel_layer(tmp_path: Path) -> None:
    text = re.sub(r"      width: 3\n(.|\n)*?\n(?=\S)", _DECAYING, TEXT, count=1)
    (layer,) = loaded(text, tmp_path).local_costmap.layers
    assert layer.cls is LAYERS.get("decaying_voxel").cls
    params = layer.params
    assert (params.voxel_decay, params.voxel_size) == (15.0, 0.05)
    source = params.sources["livox"]
    assert (source.topic, source.model_type, source.obstacle_range) == ("cloud", 1, 5.0)
    assert source.max_obstacle_height == 3.0  # the layer's own default: no finding about a source that sees nothing
    assert not any(f.rule == "nav2-no-height" and "livox" in f.key for f in problems(text, tmp_path))


@pytest.mark.parametrize(
    ("old", "new", "rule", "expected"),
    [
        ("voxel_decay: 15.0", "voxel_decay: 15", "nav2-type", "write 15.0"),
        ("voxel_decay: 15.0", "obstacle_range: 3.0", "nav2-wrong-level", "move it to voxels.livox.obstacle_range"),
        (
            "voxel_layer/Spatio",
            "voxel_layer::Spatio",
            "nav2-class-name",
            "spatio_temporal_voxel_layer/SpatioTemporalVoxelLayer",
        ),
    ],
)
def test_a_spatio_temporal_voxel_layer_is_checked(old: str, new: str, rule: str, expected: str, tmp_path: Path) -> None:
    text = re.sub(r"      width: 3\n(.|\n)*?\n(?=\S)", _DECAYING.replace(old, new), TEXT, count=1)
    (found,) = [f for f in problems(text, tmp_path) if f.rule == rule]
    assert expected in found.message


def test_assisted_teleop_is_a_behavior_that_navstack_has(tmp_path: Path) -> None:
    lines = 'behavior_plugins: ["spin", "assisted"]\n    assisted: {plugin: "nav2_behaviors::AssistedTeleop"}\n'
    text = re.sub(r"behavior_plugins: .*\n", lines, TEXT)
    assert "AssistedTeleop" in text
    found = check_parameters([written(tmp_path, text)])
    assert not [f for f in found if f.rule == "nav2-no-such-plugin"]


_DOCKING = {
    "undock_linear_tolerance": 0.1,
    "dock_plugins": ["charger"],
    "docks": ["home"],
    "charger": {"plugin": "opennav_docking::SimpleChargingDock", "staging_x_offset": -0.5, "rotate_to_dock": False},
    "home": {"type": "charger", "pose": [1.0, 2.0, 0.5]},
    "controller": {"k_phi": 2.5, "lambda": 1.5},
}


def docking_of(parameters: dict[str, Any], folder: Path, **options: Any) -> Any:
    text = TEXT + yaml.safe_dump({"docking_server": {"ros__parameters": parameters}})
    return loaded(text, folder, **options)


def test_a_docking_server_is_that_of_a_section_of_move_base(tmp_path: Path) -> None:
    robot = docking_of(_DOCKING, tmp_path, distro="kilted")
    other = load_configuration(["turtlebot", {"docking_server": _DOCKING}])
    assert robot.docking is not None
    assert robot.docking == other.docking
    assert DockDatabase.of(robot).docks == DockDatabase.of(other).docks
    assert DockDatabase.of(robot).dock("home").pose == Pose2D(1.0, 2.0, 0.5)


@pytest.mark.parametrize("name", ["docks.yaml", "$(find-pkg-share my_docks)/config/docks.yaml"])
def test_a_file_of_docks_stands_next_to_the_parameters(name: str, tmp_path: Path) -> None:
    written(tmp_path, yaml.safe_dump({"docks": {"home": {"type": "charger", "pose": [1.0, 2.0, 0.5]}}}), "docks.yaml")
    parameters = {k: v for k, v in _DOCKING.items() if k not in ("docks", "home")} | {"dock_database": name}
    database = DockDatabase.of(docking_of(parameters, tmp_path, distro="kilted"))
    assert database.dock("home").pose == Pose2D(1.0, 2.0, 0.5)


def test_a_file_of_docks_that_is_missing_is_reported(tmp_path: Path) -> None:
    parameters = {k: v for k, v in _DOCKING.items() if k not in ("docks", "home")} | {"dock_database": "docks.yaml"}
    text = TEXT + yaml.safe_dump({"docking_server": {"ros__parameters": parameters}})
    (found,) = [f for f in problems(text, tmp_path, distro="kilted") if f.rule == "nav2-docks"]
    assert "put the file next to the parameters" in found.message
    assert DockDatabase.of(docking_of(parameters, tmp_path, distro="kilted")).docks == {}


@pytest.mark.parametrize("backwards", [False, True])
def test_a_robot_of_jazzy_docks_backward(backwards: bool, tmp_path: Path) -> None:
    """Up to Jazzy the server has the direction, from Kilted on each type of dock."""
    charger = {"plugin": "opennav_docking::SimpleChargingDock"}
    parameters = {**_DOCKING, "charger": charger, "dock_backwards": backwards}
    docking = docking_of(parameters, tmp_path, distro="jazzy").docking
    assert docking.sections["charger"].dock_direction == ("backward" if backwards else "forward")


@pytest.mark.parametrize(
    ("section", "values", "expected"),
    [
        ("controller", {"k_phi": 3}, "controller.k_phi = 3 is an integer, but it is declared as a double"),
        ("charger", {"plugin": "opennav_docking::SimpleChargingDock", "staging_offset": 1.0}, "staging_offset"),
        ("home", {"type": "charger", "pose": [1.0, 2.0]}, "write [x, y, yaw]"),
    ],
)
def test_a_docking_server_is_checked(section: str, values: dict[str, Any], expected: str, tmp_path: Path) -> None:
    text = TEXT + yaml.safe_dump({"docking_server": {"ros__parameters": {**_DOCKING, section: values}}})
    found = problems(text, tmp_path, distro="kilted")
    assert any(expected in f.message for f in found), [f.message for f in found]


def test_another_controller_by_its_id() -> None:
    robot = load_configuration([str(ROBOT), "controller:=Careful"])
    assert (robot.local_planner.name, robot.local_planner.params.vx_max) == ("mppi", 0.2)
    (found,) = [f for f in check_parameters([str(ROBOT), "controller:=Careful_"]) if f.severity == "error"]
    assert found.message == (
        "controller:=Careful_ is not in the files; did you mean Careful? known: FollowPath, Careful"
    )


def test_a_controller_that_is_not_used_is_checked(tmp_path: Path) -> None:
    (found,) = problems(replaced("vx_max: 0.2", "vx_max: -0.2"), tmp_path)
    assert found.severity == "warning" and found.key == "controller_server/Careful.vx_max"
    assert found.message.startswith("Careful: vx_max = -0.2 is out of range")


@pytest.mark.parametrize(
    "name",
    [
        "FollowPath.desired_linear_vel",
        "controller_server.FollowPath.desired_linear_vel",
        "FollowPath/desired_linear_vel",
    ],
)
def test_overrides_by_nav2s_names(name: str) -> None:
    assert load_configuration([str(ROBOT)], overrides=[f"{name}=0.2"]).local_planner.params.max_linear_vel == 0.2
    assert load_configuration([str(ROBOT)], overrides=[f"{name}=1"]).local_planner.params.max_linear_vel == 1.0


def test_sections_of_navstack_beside_nodes_of_nav2(tmp_path: Path) -> None:
    robot = loaded(f"{TEXT}navstack: {{sim: {{laser: {{fov: 3.0}}}}}}\n", tmp_path)
    assert robot.navstack.sim.lidar("laser").fov == 3.0
    robot = load_configuration([str(ROBOT), {"FollowPath": {"lookahead_dist": 0.7}, "local_costmap": {"width": 4.0}}])
    assert (robot.local_planner.params.lookahead_dist, robot.local_costmap.params.width) == (0.7, 4.0)


# --- distributions ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distro", ["humble", "iron"])
def test_the_distribution_decides_defaults_and_classes(tmp_path: Path, distro: str) -> None:
    text = with_plugins_of_iron(TEXT).replace("progress_checker_plugins: [", "progress_checker_plugins: [")
    if distro == "humble":
        text = text.replace(
            'progress_checker_plugins: ["progress_checker"]', 'progress_checker_plugin: "progress_checker"'
        )
    text = text.replace(
        'points: "[[0.3, 0.2], [0.3, -0.2], [-0.2, -0.2], [-0.2, 0.2]]"',
        "points: [0.3, 0.2, 0.3, -0.2, -0.2, -0.2, -0.2, 0.2]",
    )
    robot = loaded(text, tmp_path, distro=distro)
    assert [f.message for f in robot.findings if f.severity != "info"] == []
    assert robot.recoveries[3].params.backup_speed == (0.05 if distro == "humble" else 0.15)
    assert robot.safety.collision_monitor is not None
    assert len(robot.safety.collision_monitor.zones["Stop"].corners) == 4


def test_rotation_shim_in_both_forms(tmp_path: Path) -> None:
    """Up to Kilted the keys of the primary controller stand in the shim's block, from Lyrical on in their own."""
    rpp = "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController"
    shim = "nav2_rotation_shim_controller::RotationShimController"
    head = f'      plugin: "{shim}"\n      angular_dist_threshold: 0.6\n'
    old = replaced(
        f'      plugin: "{rpp}"\n      desired_linear_vel: 0.4\n',
        f'{head}      primary_controller: "{rpp}"\n      desired_linear_vel: 0.4\n',
    )
    new = replaced(
        f'      plugin: "{rpp}"\n      desired_linear_vel: 0.4\n      lookahead_dist: 0.5\n',
        f'{head}      primary_controller:\n        plugin: "{rpp}"\n        max_linear_vel: 0.4\n        lookahead_dist: 0.5\n',
    )
    for text, distro in ((old, "jazzy"), (new, "lyrical")):
        params = loaded(text, tmp_path, distro=distro).local_planner.params
        assert params.angular_dist_threshold == 0.6
        assert (params.primary[1].max_linear_vel, params.primary[1].lookahead_dist) == (0.4, 0.5)


# --- wrong input: the value, the cause, the fix, at its place ---------------------------------------------------------


INFLATION = '"nav2_costmap_2d::InflationLayer"'
WRONG = [
    (
        "controller_frequency: 20.0",
        "controller_frequency: 20",
        (
            "4:27: error: controller_frequency = 20 is an integer, but it is declared as a double; Nav2 stops with an error; "
            "write 20.0"
        ),
    ),
    (
        "width: 3\n",
        "width: 3.0\n",
        "38:14: error: width = 3 is a double, but it is declared as an integer; Nav2 stops with an error; write 3",
    ),
    (
        "rolling_window: true",
        'rolling_window: "true"',
        (
            '37:23: error: rolling_window = "true" is text, but it is declared as a boolean; Nav2 stops with an error; remove '
            "the quotes"
        ),
    ),
    (
        "rolling_window: true",
        "rolling_window: 1",
        "37:23: error: rolling_window = 1 is an integer, but it is declared as a boolean; Nav2 stops with an error; write true",
    ),
    (
        "max_velocity: [0.4, 0.0, 1.8]",
        "max_velocity: [0.4, 0, 1.8]",
        "77:25: error: max_velocity mixes a double (0.4) and an integer (0); rcl rejects such a list; write [0.4, 0.0, 1.8]",
    ),
    (
        "max_velocity: [0.4, 0.0, 1.8]",
        "max_velocity: [1, 0, 2]",
        "77:19: error: max_velocity is a list of integers, but it is declared as a list of doubles; write [1.0, 0.0, 2.0]",
    ),
    (
        'controller_plugins: ["FollowPath", "Careful"]',
        "controller_plugins: FollowPath",
        (
            '8:25: error: controller_plugins = "FollowPath" is text, but it is declared as a list of texts; write a list: '
            "[FollowPath]"
        ),
    ),
    (
        'points: "[[0.3, 0.2], [0.3, -0.2], [-0.2, -0.2], [-0.2, 0.2]]"',
        "points: [[0.3, 0.2], [0.3, -0.2], [-0.2, 0.2]]",
        (
            "84:15: error: Stop.points is a list, but Nav2 wants text; write it in quotes: "
            '"[[0.3, 0.2], [0.3, -0.2], [-0.2, 0.2]]"'
        ),
    ),
    (
        "global_frame: odom",
        "global_frame:",
        "36:20: error: global_frame has no value, but it is declared as text; write text, or remove the line",
    ),
    (
        "lookahead_dist: 0.5",
        "lookahead_dists: 0.5",
        (
            "21:7: warning: FollowPath.lookahead_dists = 0.5 is not declared, so Nav2 jazzy ignores it silently; did you mean "
            "FollowPath.lookahead_dist?"
        ),
    ),
    (
        "      inflation_layer:\n        plugin: XXX\n        inflation_radius: 0.6\nglobal_costmap".replace(
            "XXX", INFLATION
        ),
        "      inflation_radius: 0.6\n      inflation_layer:\n        plugin: XXX\nglobal_costmap".replace(
            "XXX", INFLATION
        ),
        (
            "51:7: warning: inflation_radius = 0.6 is not declared at this level, so Nav2 jazzy ignores it silently; move it to "
            "inflation_layer.inflation_radius"
        ),
    ),
    (
        'plugins: ["obstacle_layer", "inflation_layer"]',
        'plugins: ["inflation_layer"]',
        (
            "44:9: warning: obstacle_layer is not in plugins (inflation_layer), so its 6 parameters are ignored silently; list "
            "it there, or remove the block"
        ),
    ),
    (
        'plugins: ["static_layer", "inflation_layer"]',
        'plugins: ["static_layer", "voxel_layer", "inflation_layer"]',
        (
            "59:16: error: plugins lists voxel_layer, but there is no block of that name; write `voxel_layer: {plugin: "
            '"nav2_costmap_2d::StaticLayer"}`, or remove it from plugins'
        ),
    ),
    (
        '    GridBased:\n      plugin: "nav2_navfn_planner::NavfnPlanner"\n      tolerance',
        '    Grid:\n      plugin: "nav2_navfn_planner::NavfnPlanner"\n      tolerance',
        (
            "31:7: warning: Grid is not in planner_plugins (GridBased), so its 2 parameters are ignored silently; list it there, "
            "or remove the block"
        ),
    ),
    (
        "          max_obstacle_height: 2.0\n",
        "",
        (
            "47:11: warning: obstacle_layer.scan has no max_obstacle_height; its default is 0.0, so all points above the ground "
            "are dropped and the source sees nothing; set max_obstacle_height: 2.0"
        ),
    ),
    (
        "obstacle_max_range: 2.4",
        "obstacle_range: 2.4",
        (
            "50:11: warning: obstacle_layer.scan.obstacle_range is declared up to Foxy only, so Nav2 jazzy ignores it silently; "
            "jazzy has obstacle_max_range instead"
        ),
    ),
    (
        "    failure_tolerance: 0.3\n",
        "    failure_tolerance: 0.3\n    search_window: 2.0\n",
        (
            "6:5: warning: search_window is declared from Lyrical on, so Nav2 jazzy ignores it silently; remove it, or name the "
            "distribution of the file with --distro"
        ),
    ),
    (
        "nav2_navfn_planner::NavfnPlanner",
        "nav2_navfn_planner/NavfnPlanner",
        (
            "31:15: error: Nav2 jazzy does not export nav2_navfn_planner/NavfnPlanner; the class is called "
            '"nav2_navfn_planner::NavfnPlanner" there; write it, or name the distribution of the file with --distro'
        ),
    ),
    (
        "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
        "teb_local_planner::TebLocalPlannerROS",
        "19:15: error: navstack has no controller teb_local_planner::TebLocalPlannerROS (FollowPath); use one of: ",
    ),
    (
        "local_costmap:\n  local_costmap:\n    ros__parameters:\n",
        "local_costmap:\n    ros__parameters:\n",
        (
            "34:5: warning: the node local_costmap runs in the namespace local_costmap, so ROS 2 ignores these 9 parameters; "
            "write `local_costmap: local_costmap: ros__parameters:`"
        ),
    ),
    (
        "behavior_server:",
        "behaviour_server:",
        "66:3: warning: behaviour_server is not a node of Nav2, so its 5 parameters are not read; did you mean behavior_server?",
    ),
    (
        "lookahead_dist: 0.5",
        "lookahead_dist: -0.5",
        "21:23: error: lookahead_dist = -0.5 is out of range; it must be greater than 0 m",
    ),
    (
        "lookahead_dist: 0.5",
        "lookahead_dist: $(var distance)",
        (
            '21:23: error: FollowPath.lookahead_dist = "$(var distance)" is a substitution of launch; give its value, for '
            "example with NAME:=VALUE"
        ),
    ),
]
"""Text of the file -> what stands there instead -> the finding about it."""


@pytest.mark.parametrize(("old", "new", "expected"), WRONG, ids=[str(i) for i in range(len(WRONG))])
def test_wrong_input(tmp_path: Path, old: str, new: str, expected: str) -> None:
    found = problems(replaced(old, new), tmp_path, distro="jazzy")
    shown = [f"{f.line}:{f.column}: {f.severity}: {f.message}" for f in found]
    assert any(text == expected or (expected.endswith(": ") and text.startswith(expected)) for text in shown), shown


def test_aliases_are_rejected_as_by_ros_2(tmp_path: Path) -> None:
    text = replaced("desired_linear_vel: 0.4", "desired_linear_vel: &speed 0.4").replace(
        "lookahead_dist: 0.5", "lookahead_dist: *speed"
    )
    (found,) = [f for f in problems(text, tmp_path) if f.severity == "error"]
    assert (found.line, found.message) == (
        21,
        "the parameter files of ROS 2 cannot have anchors and aliases (`&name`, `*name`); write the value out",
    )


def test_files_without_servers(tmp_path: Path) -> None:
    (found,) = problems("slam_toolbox: {ros__parameters: {mode: mapping}}", tmp_path)
    assert found.message == (
        "the files have no controller_server and no planner_server (their nodes: none of Nav2), so nothing can drive; name the "
        "file that has them, too"
    )


def test_an_override_that_sets_nothing() -> None:
    with pytest.raises(ParameterError, match=r"sets nothing: controller_server declares no FollowPath.lookahed_dist"):
        load_configuration([str(ROBOT)], overrides=["FollowPath.lookahed_dist=0.4"])


def test_an_override_at_the_level_of_a_plugin_names_that_of_its_server() -> None:
    with pytest.raises(
        ParameterError, match=r"it stands at the level of the server: write behavior_server.max_rotational_vel"
    ):
        load_configuration([str(ROBOT)], overrides=["spin.max_rotational_vel=0.4"])


@pytest.mark.parametrize(
    "name", ["local_costmap/obstacle_layer/scan/obstacle_min_range", "obstacle_layer.scan.obstacle_min_range"]
)
def test_an_override_of_a_source_by_its_path(name: str) -> None:
    layer = load_configuration([str(ROBOT)], overrides=[f"{name}=0.25"]).local_costmap.layers[0]
    assert layer.params.sources["scan"].obstacle_min_range == 0.25


def test_an_id_means_the_section_that_is_in_use() -> None:
    """Spin is in the list of recoveries twice; the tree runs the first."""
    robot = load_configuration([str(ROBOT), {"spin": {"spin_dist": 0.7}}])
    assert robot.nav2_ids == {"FollowPath": "RegulatedPurePursuitController", "GridBased": "NavfnPlanner"}
    assert [r.params.spin_dist for r in robot.recoveries if r.cls.__name__ == "Spin"] == [0.7, 1.57]


def test_a_distribution_that_nobody_knows() -> None:
    (found,) = [f for f in check_parameters([str(ROBOT)], distro="humbel") if f.severity == "error"]
    assert found.message == (
        "--distro humbel is not a distribution of Nav2; did you mean humble? known: foxy, galactic, humble, iron, jazzy, "
        "kilted, lyrical"
    )


def test_another_controller_stands_in_only_if_it_is_wanted(tmp_path: Path) -> None:
    text = replaced(
        "nav2_regulated_pure_pursuit_controller::RegulatedPurePursuitController",
        "teb_local_planner::TebLocalPlannerROS",
    )
    with pytest.raises(ParameterError, match="let nav2_mppi_controller::MPPIController stand in with --substitute"):
        loaded(text, tmp_path)
    robot = loaded(text, tmp_path, allow_missing=True)
    assert robot.local_planner.name == "mppi" and robot.local_planner.params.vx_max == 0.4


DWB = """
      plugin: "dwb_core::DWBLocalPlanner"
      critics: ["RotateToGoal", "PathAlign", "BaseObstacle"]
      max_vel_x: 0.3
      max_vel_theta: 1.0
      acc_lim_x: 2.5
      acc_lim_theta: 3.2
      PathAlign.scale: 32.0
"""


def test_limits_and_tolerances_of_dwb(tmp_path: Path) -> None:
    rpp = TEXT[TEXT.index('\n      plugin: "nav2_regulated') : TEXT.index("    Careful:")]
    found = {f.rule: f for f in problems(TEXT.replace(rpp, DWB), tmp_path)}
    messages = [f.message for f in problems(TEXT.replace(rpp, DWB), tmp_path) if f.rule == "nav2-dwb-limit"]
    assert messages == [
        "FollowPath.decel_lim_theta is missing; its default is 0.0, so DWB cannot slow down along theta; write -3.2",
        "FollowPath.decel_lim_x is missing; its default is 0.0, so DWB cannot slow down along x; write -2.5",
        "FollowPath.max_speed_xy is missing (default 0.0), so every sample that moves forward is rejected; write 0.3",
    ]
    assert found["nav2-tolerances"].message == (
        "FollowPath.xy_goal_tolerance is 0.25 (default), above xy_goal_tolerance = 0.2 of goal_checker: RotateToGoal stops the "
        "robot before the goal checker accepts the position; set both to 0.2"
    )


def test_the_tree_of_dwb(tmp_path: Path) -> None:
    """The block passes through with Nav2's names and defaults, whether the controller is registered or not."""
    rpp = TEXT[TEXT.index('\n      plugin: "nav2_regulated') : TEXT.index("    Careful:")]
    tree = read_sources([written(tmp_path, TEXT.replace(rpp, DWB))]).root
    section = tree.space("DWBLocalPlanner")
    assert section is not None
    values = section.as_dict()
    assert (values["max_vel_x"], values["decel_lim_x"], values["vx_samples"], values["sim_time"]) == (0.3, 0.0, 20, 1.7)
    assert values["critics"] == ["RotateToGoal", "PathAlign", "BaseObstacle"]
    assert values["PathAlign"] == {"scale": 32.0, "forward_point_distance": 0.325, "aggregation_type": "last"}
    assert values["BaseObstacle"] == {"scale": 1.0, "sum_scores": False}
    assert "xy_goal_tolerance" not in values["RotateToGoal"]


def test_the_tree_that_the_parameters_name_drives_the_goals(tmp_path: Path) -> None:
    """Where they say, next to them, or in a folder behavior_trees; the default tree is packaged."""
    default = "$(find-pkg-share nav2_bt_navigator)/behavior_trees/navigate_to_pose_w_replanning_and_recovery.xml"
    text = TEXT + "bt_navigator: {ros__parameters: {default_nav_to_pose_bt_xml: PLACE}}\n"

    def tree(place: str) -> str:
        return loaded(text.replace("PLACE", f'"{place}"'), tmp_path).navstack.behavior_tree

    packaged = "navigate_to_pose_w_replanning_and_recovery_jazzy"
    assert loaded(TEXT, tmp_path).navstack.behavior_tree == tree(default) == packaged
    (found,) = problems(text.replace("PLACE", "/opt/my_tree.xml"), tmp_path)
    assert found.message == (
        "the tree my_tree.xml is not found, neither as /opt/my_tree.xml nor next to the parameters, so Nav2's default tree "
        "drives instead; put the file next to the parameters, or into a folder behavior_trees there"
    )
    trees = tmp_path / "behavior_trees"
    trees.mkdir()
    (trees / "my_tree.xml").write_text("<root/>", encoding="utf-8")
    assert tree("/opt/my_tree.xml") == str(trees / "my_tree.xml")
    assert problems(text.replace("PLACE", "/opt/my_tree.xml"), tmp_path) == []


@pytest.mark.parametrize(("distro", "hz", "back_up"), [
    ("foxy", "1.0", ""),
    ("galactic", "1.0", "0.15"),
    ("humble", "1.0", "0.30"),
    ("iron", "1.0", "0.30"),
    ("jazzy", "1.0", "0.30"),
    ("kilted", "1.0", "0.30"),
    ("lyrical", "1.0", "0.30"),
])  # fmt: skip
def test_the_default_tree_is_that_of_the_distribution(distro: str, hz: str, back_up: str, tmp_path: Path) -> None:
    """Only from Lyrical on does the robot keep its path near the goal; Foxy does not back up."""
    root = read_sources([written(tmp_path, TEXT)], distro=distro).root
    named = root.space("navstack").leaf("behavior_tree").value  # type: ignore[union-attr]
    tree = ElementTree.parse(find_tree(named))
    (rate,), backups = tree.findall(".//RateController"), [e.get("backup_dist", "") for e in tree.iter("BackUp")]
    assert (rate.get("hz"), "".join(backups)) == (hz, back_up)
    assert bool(tree.findall(".//IsGoalNearby")) == (distro == "lyrical")
    assert bool(tree.findall(".//WouldAPlannerRecoveryHelp")) == (distro in ("iron", "jazzy", "kilted", "lyrical"))


# --- properties -------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(st.lists(st.booleans(), min_size=8, max_size=8))
def test_dotted_and_nested_keys_are_equal(dotted: list[bool]) -> None:
    document = yaml.safe_load(TEXT)
    choices = iter(dotted * 10)

    def flatten(values: dict[str, Any]) -> dict[str, Any]:
        made: dict[str, Any] = {}
        for key, value in values.items():
            if isinstance(value, dict) and next(choices):
                made |= {f"{key}.{name}": v for name, v in flatten(value).items()}
            else:
                made[key] = flatten(value) if isinstance(value, dict) else value
        return made

    for node in ("controller_server", "planner_server", "collision_monitor"):
        document[node]["ros__parameters"] = flatten(document[node]["ros__parameters"])
    assert same_parameters(load_configuration([document]), load_configuration([yaml.safe_load(TEXT)]))


NAMES = st.text(st.sampled_from("abcxyz_"), min_size=1, max_size=12)


@settings(max_examples=40)
@given(
    st.sampled_from(
        ["controller_server", "planner_server", "behavior_server", "velocity_smoother", "collision_monitor"]
    ),
    st.lists(NAMES, min_size=1, max_size=3),
    st.one_of(st.integers(-9, 9), st.floats(-9.0, 9.0), st.booleans(), NAMES, st.lists(st.integers(0, 3), min_size=1)),
)
def test_every_key_is_accounted_for(node: str, parts: list[str], value: Any) -> None:
    """A key that Nav2 does not declare always has a finding."""
    document = yaml.safe_load(TEXT)
    document[node]["ros__parameters"][".".join(["zz", *parts])] = value
    keys = [f.key for f in check_parameters([document]) if f.rule.startswith("nav2-") and f.severity == "warning"]
    assert any(key.startswith(f"{node}/zz") for key in keys)


# --- rules of a Nav2 robot ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("speed", "reported"), [("0.04", True), ("0.041", False)])
def test_a_robot_too_slow_for_its_progress_checker(speed: str, reported: bool, tmp_path: Path) -> None:
    """0.4 m in 10 s."""
    text = replaced("desired_linear_vel: 0.4", f"desired_linear_vel: {speed}")
    found = [f for f in problems(text, tmp_path) if f.rule == "progress-out-of-reach"]
    assert bool(found) is reported
    if reported:
        assert found[0].key == "controller_server/progress_checker.required_movement_radius"
        assert "covers 0.4 m in movement_time_allowance = 10 s at max_linear_vel 0.04 m/s" in found[0].message
        fixed = text.replace(
            "required_movement_radius: 0.4", f"required_movement_radius: {found[0].message.split()[-1]}"
        )
        assert [f for f in problems(fixed, tmp_path) if f.rule == "progress-out-of-reach"] == []


@pytest.mark.parametrize(("allowance", "reported"), [(5.9, True), (6.1, False)])
def test_a_reverse_drive_that_takes_longer_than_it_may(allowance: float, reported: bool) -> None:
    """0.15 m at 0.025 m/s take 6 s."""
    behavior = {"name": "back", "type": "nav2_behaviors::BackUp"}
    more = {"recovery_behaviors": [behavior], "back": {"time_allowance": allowance}}
    found = [f.message for f in check_parameters(["turtlebot", more]) if f.rule == "progress-out-of-reach"]
    assert [message.partition(",")[0] for message in found] == ["back takes 6 s for 0.15 m at 0.025 m/s"] * reported


def test_a_node_that_is_not_run_is_named_once() -> None:
    more = {"waypoint_follower": {"ros__parameters": {"loop_rate": 20}}}
    (found,) = [f for f in check_parameters([str(ROBOT), more]) if f.rule == "nav2-not-run"]
    assert found.message == (
        "navstack does not run waypoint_follower: its parameters are checked, but they set nothing"
    )


def test_an_asymmetric_inflation_layer_is_refused_or_its_costs_away_from_the_plan_stand_in(tmp_path: Path) -> None:
    block = '        plugin: "nav2_costmap_2d::InflationLayer"\n'
    sides = "        cost_scaling_factor_left: 2.5\n        cost_scaling_factor_right: 6.0\n"
    text = TEXT.replace(block, block.replace("Inflation", "AsymmetricInflation") + sides, 1)
    with pytest.raises(ParameterError, match=r"costs depend on the plan.* the larger of cost_scaling_factor_left"):
        loaded(text, tmp_path, distro="lyrical")
    robot = loaded(text, tmp_path, distro="lyrical", allow_missing=True)
    (layer,) = [layer for layer in robot.local_costmap.layers if layer.name == "inflation_layer"]
    assert (layer.params.cost_scaling_factor, layer.params.inflation_radius) == (6.0, 0.6)
    assert any("stands in with the larger" in f.message and f.line for f in robot.findings)


def test_servers_that_only_trees_ask_are_read_with_the_defaults_of_the_distribution(tmp_path: Path) -> None:
    graph = tmp_path / "lanes.geojson"
    graph.write_text("{}", encoding="utf-8")
    text = TEXT.replace(
        'behavior_plugins: ["spin", "backup", "wait"]',
        'behavior_plugins: ["spin", "backup", "wait", "drive", "teleop"]\n    projection_time: 2.5\n'
        "    simulate_ahead_time: 1.5\n"
        '    drive: {plugin: "nav2_behaviors::DriveOnHeading"}\n    teleop: {plugin: "nav2_behaviors::AssistedTeleop"}',
    )
    text += """
smoother_server:
  ros__parameters:
    smoother_plugins: ["route_smoother"]
    route_smoother: {plugin: "nav2_smoother::SimpleSmoother", w_data: 0.4}
route_server:
  ros__parameters:
    graph_filepath: /opt/robot/lanes.geojson
    edge_cost_functions: ["D"]
    D: {plugin: "nav2_route::DistanceScorer", weight: 2.0}
"""
    robot = loaded(text, tmp_path, distro="kilted")
    found = {b.name: b.params for b in robot.behaviors}
    assert (found["drive"].simulate_ahead_time, found["teleop"].projection_time) == (1.5, 2.5)
    (smoother,) = robot.smoothers
    assert (smoother.name, smoother.params.w_data, smoother.params.w_smooth) == ("route_smoother", 0.4, 0.3)
    routes = robot.route_server
    assert (routes["graph_filepath"], routes["D"]["weight"]) == (str(graph), 2.0)
    assert (routes["aggregate_blocked_ids"], routes["operations"]) == (False, ["AdjustSpeedLimit", "ReroutingService"])
    params, (scorer,) = read_scorers(routes)
    assert (params.path_density, scorer.params.weight) == (0.05, 2.0)


# --- names that are too deep --------------------------------------------------------------------------------------------


def test_a_name_of_many_levels_is_refused_at_its_place(tmp_path: Path) -> None:
    name = ".".join("a" * 400)
    text = TEXT.replace("controller_plugins: [", f"{name}: 1.0\n    controller_plugins: [{name.replace('.', '/')}, ", 1)
    found = [f for f in problems(text, tmp_path) if f.rule == "too-deep"]
    key = text.splitlines().index(next(line for line in text.splitlines() if line.lstrip().startswith("a.a.")))
    assert [(f.severity, f.line) for f in found] == [("error", key + 1), ("error", key + 2)]
    assert found[0].message == (
        f"the name {'a.' * 20}.. has 400 levels, more than 50, so it is dropped; nothing in Nav2 is nested that deep: shorten "
        "the name, or remove it"
    )
    with pytest.raises(ParameterError, match="400 levels"):
        loaded(text, tmp_path)


def test_a_name_of_fifty_levels_is_an_undeclared_one(tmp_path: Path) -> None:
    name = ".".join("a" * 50)
    text = TEXT.replace("controller_plugins: [", f"{name}: 1.0\n    controller_plugins: [", 1)
    found = problems(text, tmp_path)
    assert [f.rule for f in found if f.key == "controller_server/a"] == ["nav2-not-listed"]


def test_a_pattern_of_many_wildcards_fits_at_once(tmp_path: Path) -> None:
    for pattern in ("/".join(["**"] * 300), "/".join(["**", "*"] * 150)):
        more = written(tmp_path, f'"{pattern}":\n  ros__parameters: {{use_sim_time: true}}\n', "more.yaml")
        assert is_the_robot(loaded(TEXT, tmp_path)) and load_configuration([str(ROBOT), more])

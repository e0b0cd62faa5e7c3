"""Sources -> typed configuration, with a finding for every unused key."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from navstack.core import ParameterError, UnknownPluginError
from navstack.parameters import Finding
from navstack.parameters.configuration import check_parameters, choose_global_planner, load_configuration
from tests.conftest import data_files

DWA = "dwa_local_planner/DWAPlannerROS"
STATIC = {"name": "static_layer", "type": "costmap_2d::StaticLayer"}
OBSTACLE = {"name": "obstacle_layer", "type": "costmap_2d::ObstacleLayer"}
VOXEL = {"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}
INFLATION = {"name": "inflation_layer", "type": "costmap_2d::InflationLayer"}
SCAN = {
    "observation_sources": "scan",
    "scan": {"data_type": "LaserScan", "topic": "scan", "marking": True, "clearing": True},
}


def robot(**more: Any) -> dict[str, Any]:
    """A small robot without warnings; `a__b` in a name means a/b."""
    made: dict[str, Any] = {
        "base_local_planner": DWA,
        "global_costmap": {"plugins": [STATIC, OBSTACLE, INFLATION], "obstacle_layer": dict(SCAN), "robot_radius": 0.2},
        "local_costmap": {
            "plugins": [OBSTACLE, INFLATION],
            "obstacle_layer": dict(SCAN),
            "rolling_window": True,
            "robot_radius": 0.2,
        },
    }
    for key, value in more.items():
        at = made
        *above, last = key.split("__")
        for name in above:
            at = at.setdefault(name, {})
        at[last] = value
    dwa = made.setdefault("DWAPlannerROS", {})
    if isinstance(dwa, dict):  # a differential robot
        dwa.setdefault("max_vel_y", 0.0)
        dwa.setdefault("min_vel_y", 0.0)
    return made


def check(*sources: Any, **options: Any) -> list[Finding]:
    return check_parameters(list(sources), **options)


def keys_of(findings: list[Finding], severity: str | None = None) -> set[tuple[str, str]]:
    return {(f.rule, f.key) for f in findings if severity is None or f.severity == severity}


# --- the turtlebot ----------------------------------------------------------------------------------------------------


def test_the_packaged_turtlebot() -> None:
    loaded = load_configuration(["turtlebot"])
    assert loaded.navstack.ros_distro == "indigo"
    assert [f for f in loaded.findings if f.severity != "info"] == []
    assert [r.name for r in loaded.recoveries] == ["conservative_reset", "rotate_recovery", "aggressive_reset"]
    assert loaded.recoveries[0].params.layer_names == ["obstacle_layer"]
    assert loaded.local_planner.params.ros_distro == "indigo"
    assert list(loaded.navstack.sim.lidars) == ["laser"]


def test_the_published_turtlebot(data_dir: Path) -> None:
    loaded = load_configuration([str(data_dir / "params/turtlebot2/param")])
    assert loaded.navstack.ros_distro == "noetic"
    assert (loaded.global_planner.name, loaded.local_planner.name) == ("navfn", "dwa")
    dwa = loaded.local_planner.params
    # renamed parameters are used (parity 16)
    assert (dwa.max_vel_trans, dwa.min_vel_trans, dwa.max_vel_theta, dwa.min_vel_theta) == (0.5, 0.1, 5.0, 0.4)
    assert (dwa.theta_stopped_vel, dwa.vth_samples, dwa.controller_frequency) == (0.4, 20, 5.0)
    assert loaded.move_base.controller_patience == 3.0
    local, whole = loaded.local_costmap, loaded.global_costmap
    assert [layer.name for layer in whole.layers] == ["static_layer", "obstacle_layer", "inflation_layer"]
    assert [layer.name for layer in local.layers] == ["obstacle_layer", "inflation_layer"]
    assert (whole.params.global_frame, whole.params.robot_base_frame) == ("map", "base_footprint")
    assert (local.params.width, local.params.rolling_window) == (4.0, True)
    assert local.layers[0].params.sources["scan"].max_obstacle_height == 0.35
    assert local.layers[1].params.cost_scaling_factor == 5.0
    # parity 2: a 16-gon, padded along the axes
    assert local.true_footprint.inscribed_radius == pytest.approx(0.2 * 0.9808, abs=1e-4)
    assert local.footprint.circumscribed_radius == pytest.approx(0.2141, abs=1e-4)
    # without a list: the built-in one, with the real circumscribed radius (parity 21)
    assert [r.name for r in loaded.recoveries] == [
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
        "rotate_recovery",
    ]
    assert loaded.recoveries[2].params.reset_distance == pytest.approx(4 * local.footprint.circumscribed_radius)
    warnings = keys_of(list(loaded.findings), "warning")
    assert warnings == {("scoring-scale", "DWAPlannerROS/occdist_scale")}
    renamed = {f.key.rpartition("/")[2]: f.suggestion for f in loaded.findings if f.rule == "renamed"}
    assert renamed == {
        "max_trans_vel": "max_vel_trans",
        "min_trans_vel": "min_vel_trans",
        "max_rot_vel": "max_vel_theta",
        "min_rot_vel": "min_vel_theta",
        "rot_stopped_vel": "theta_stopped_vel",
        "vtheta_samples": "vth_samples",
    }
    silent = {f.key.rpartition("/")[2] for f in loaded.findings if f.rule == "no-effect"}
    assert {
        "map_type",
        "static_map",
        "planner_window_x",  # of NavfnROS
        "stop_time_buffer",
    } <= silent


def test_every_published_misspelling_is_found(data_dir: Path) -> None:
    findings = check(str(data_dir / "params_misspelt"), overrides=[f"base_local_planner={DWA}"])
    meant = {f.key.rpartition("/")[2]: f.suggestion for f in findings if f.rule in ("unknown", "unknown-namespace")}
    assert meant == {
        "enable": "enabled",
        "unknow_threshold": "unknown_threshold",
        "combination_methold": "combination_method",
        "min_obstacle_dist": None,
        "costmap_obstacles_behind_robot_dist": None,
        "weight_obstacle": None,
        "use_dijsktra": "use_dijkstra",
        "allow_unknow": "allow_unknown",
        "planner_windows_x": "planner_window_x",
        "planner_windows_y": "planner_window_y",
        "DWAPlanerROS": "DWAPlannerROS",
        "max_rotational_vel": "max_vel_theta",
        "vthea_samples": "vth_samples",
    }
    assert sum(f.key.endswith("/enable") for f in findings) == 3
    assert ("duplicated", "DWAPlanerROS/max_rotational_vel") in keys_of(findings, "warning")
    elsewhere = [f for f in findings if f.rule == "elsewhere"]
    assert [(f.key, f.suggestion) for f in elsewhere] == [
        ("global_costmap/obstacle_layer/min_obstacle_height", "scan/min_obstacle_height")
    ]
    # the sideways speed is a default: no line sets it
    assert all(f.line > 0 for f in findings if f.severity == "warning" and f.rule != "sideways-command")
    assert not [f for f in findings if f.severity == "error"]


# --- every key --------------------------------------------------------------------------------------------------------


def test_a_correct_robot_has_no_findings() -> None:
    findings = check(robot(DWAPlannerROS={"occdist_scale": 0.01}))
    assert [str(f) for f in findings if f.severity != "info"] == []


@pytest.mark.parametrize(
    ("more", "rule", "key", "suggestion"),
    [
        ({"controler_frequency": 5.0}, "unknown", "controler_frequency", "controller_frequency"),
        ({"recovery_behaviour_enabled": True}, "unknown", "recovery_behaviour_enabled", "recovery_behavior_enabled"),
        ({"DWAPlannerROS__vel_max_x": 0.3}, "unknown", "DWAPlannerROS/vel_max_x", "max_vel_x"),
        ({"DWAPlannerROS__simTime": 1.0}, "unknown", "DWAPlannerROS/simTime", "sim_time"),
        ({"DWAPlannerROS__wheels": 4}, "unknown", "DWAPlannerROS/wheels", None),
        (
            {"local_costmap__obstacle_layer": {**SCAN, "inflation_radius": 0.3}},
            "elsewhere",
            "local_costmap/obstacle_layer/inflation_radius",
            "inflation_layer/inflation_radius",
        ),
        ({"sim_time": 1.0}, "elsewhere", "sim_time", "DWAPlannerROS/sim_time"),
        (
            {"DWAPlannerROS__planner_frequency": 1.0},
            "elsewhere",
            "DWAPlannerROS/planner_frequency",
            "planner_frequency",
        ),
        ({"local_costmap__origin_z": 2}, "elsewhere", "local_costmap/origin_z", None),
        ({"local_costmap__z_voxels": 2}, "elsewhere", "local_costmap/z_voxels", None),
        ({"local_costmap__static_layer": {"enabled": True}}, "layer-not-listed", "local_costmap/static_layer", None),
        (
            {"local_costmap__inflaton_layer": {"enabled": True}},
            "unknown-namespace",
            "local_costmap/inflaton_layer",
            "inflation_layer",
        ),
        (
            {"local_costmap__obstacle_layer": {**SCAN, "bump": {"topic": "b"}}},
            "source-not-listed",
            "local_costmap/obstacle_layer/bump",
            None,
        ),
        ({"my_reset": {"reset_distance": 1.0}}, "recovery-not-listed", "my_reset", None),
        ({"Local_costmap": {"width": 3}}, "unknown-namespace", "Local_costmap", "local_costmap"),
        ({"navstck": {"ros_distro": "indigo"}}, "unknown-namespace", "navstck", "navstack"),
        ({"navstack__ros_distrib": "indigo"}, "unknown", "navstack/ros_distrib", "ros_distro"),
        ({"navstack__sim": {"laser": {"topic": "scan", "beems": 10}}}, "unknown", "navstack/sim/laser/beems", "beams"),
        (
            {"conservative_reset": {"reset_distance": 1.0}},
            "no-effect",
            "conservative_reset/reset_distance",
            "recovery_behaviors",
        ),
    ],
)
def test_keys_without_effect_cause_warnings(more: dict[str, Any], rule: str, key: str, suggestion: str | None) -> None:
    findings = [f for f in check(robot(**more)) if f.severity == "warning" and f.rule not in ("scoring-scale",)]
    assert [(f.rule, f.key, f.suggestion) for f in findings] == [(rule, key, suggestion)]


def test_a_value_read_in_one_costmap_is_not_reported_in_the_other(tmp_path: Path) -> None:
    (tmp_path / "costmap_common_params.yaml").write_text("static_layer: {enabled: true}\nobstacle_layer: {bogus: 1}\n")
    made = robot()
    for costmap in ("global_costmap", "local_costmap"):
        del made[costmap]["obstacle_layer"]
    findings = check(str(tmp_path / "costmap_common_params.yaml"), made)
    # static_layer is used by the global costmap; bogus is reported once for both
    about = [f for f in findings if f.rule == "unknown"]
    assert [(f.key, f.line) for f in about] == [("global_costmap/obstacle_layer/bogus", 2)]
    assert not [f for f in findings if f.rule == "layer-not-listed"]


def test_planners_that_are_not_in_use_are_checked_with_warnings() -> None:
    findings = check(
        robot(
            base_global_planner="navfn/NavfnROS",
            GlobalPlanner={"cost_factor": "x", "lethal_cost": 300, "use_dijkstra": True},
        )
    )
    about = {(f.severity, f.rule, f.key) for f in findings if f.key.startswith("GlobalPlanner")}
    assert about == {
        ("warning", "wrong-type", "GlobalPlanner/cost_factor"),
        ("warning", "out-of-range", "GlobalPlanner/lethal_cost"),
        ("info", "not-in-use", "GlobalPlanner"),
    }


def test_the_section_of_a_planner_that_the_default_replaces_is_one_warning() -> None:
    made = robot(DWAPlannerROS={"max_trans_vel": 0.7, "stop_time_buffer": 0.2, "max_vel_x": 0.7})
    del made["base_local_planner"]
    findings = [f for f in check(made) if f.key.startswith("DWAPlannerROS") or f.key == "base_local_planner"]
    [found] = findings
    assert (found.severity, found.rule, found.key) == ("warning", "default-planner", "DWAPlannerROS")
    assert (
        "base_local_planner/TrajectoryPlannerROS" in found.message and "DWAPlannerROS have no effect" in found.message
    )
    assert found.suggestion == "dwa_local_planner/DWAPlannerROS"
    assert load_configuration([made]).local_planner.name == "trajectory_rollout"
    # no other section: worth a note
    notes = {f.key: f.severity for f in check(robot()) if f.rule == "default-planner"}
    assert notes == {"base_global_planner": "info"}
    teb = robot(TebLocalPlannerROS={"max_vel_x": 0.4})
    del teb["base_local_planner"], teb["DWAPlannerROS"]
    assert ("default-planner", "TebLocalPlannerROS") in keys_of(check(teb), "warning")


@pytest.mark.parametrize(
    "written",
    [
        [{"name": "a", "type": "clear_costmap_recovery/ClearCostmapRecovery"}, {"name": "b"}],
        [{"type": "clear_costmap_recovery/ClearCostmapRecovery"}],
        ["a"],
        [{"name": 1, "type": "a"}],
        "a",
        None,
        [{"name": "a", "type": "clear_costmap_recovery/ClearCostmapRecovery"}] * 2,
    ],
)
def test_a_recovery_list_that_ros_rejects_falls_back_to_the_built_in_one(written: Any) -> None:
    more = {e["name"]: {"reset_distance": 1.0} for e in (written if len(written or "") == 2 else [])}
    loaded = load_configuration([robot(recovery_behaviors=written, **more)])
    names = ["conservative_reset", "rotate_recovery", "aggressive_reset", "rotate_recovery"]
    assert [r.name for r in loaded.recoveries] == names
    [found] = [f for f in loaded.findings if f.severity == "warning"]
    assert (found.rule, found.key) == ("plugin-list", "recovery_behaviors")
    assert "the built-in recovery behaviors are used, as in ROS" in found.message


def test_suggestions_are_for_near_misses_only() -> None:
    with pytest.raises(ParameterError) as caught:
        load_configuration([robot(base_local_planner="neo_local_planner/NeoLocalPlanner", NeoLocalPlanner={"a": 1})])
    assert "did you mean" not in caught.value.message
    assert not [f for f in check(robot(NeoLocalPlanner={"a": 1})) if "PalLocalPlanner" in f.message]
    assert any(f.suggestion == "DWAPlannerROS" for f in check(robot(DWAPlanerROS={"max_vel_x": 0.4})))
    for other in ("wpbh_local_planner/WpbhLocalPlanner", "my_dwb/DWBPlanner"):
        assert not [f for f in check(robot(base_local_planner=other)) if "did you mean" in f.message]
    for typo in ("dwa_local_planer/DWAPlannerROS", "dwa/DWAPlanerROS", "DWAPlanerROS"):
        [found] = [f for f in check(robot(base_local_planner=typo)) if f.rule == "unknown-plugin"]
        assert 'did you mean "dwa' in found.message


def test_a_layer_that_the_other_costmap_uses_is_not_to_be_removed(tmp_path: Path) -> None:
    common = tmp_path / "costmap_common_params.yaml"
    common.write_text("static_layer: {enabled: true, enabeld: true}\n")
    findings = [f for f in check(str(common), robot()) if f.key.endswith(("static_layer", "enabeld"))]
    assert [(f.rule, f.suggestion) for f in findings] == [("unknown", "enabled")]


def test_a_value_that_one_costmap_adds_to_a_layer_of_the_other_is_reported(tmp_path: Path) -> None:
    common, local = tmp_path / "costmap_common_params.yaml", tmp_path / "local_costmap_params.yaml"
    common.write_text("static_layer: {enabled: true, enabeld: true}\n")
    local.write_text("local_costmap:\n  static_layer: {map_topic: other}\n")
    found = [f for f in check(str(common), str(local), robot()) if f.line and f.file in (str(common), str(local))]
    assert [(f.rule, Path(f.file).name, f.line) for f in found] == [
        ("unknown", common.name, 1),
        ("layer-not-listed", local.name, 2),
    ]
    assert "map_topic of local_costmap/static_layer has no effect" in found[1].message


def test_planners_of_other_packages_are_noted_once() -> None:
    findings = check(robot(TebLocalPlannerROS={"max_vel_x": 0.4, "weight_obstacle": 50}))
    assert [(f.severity, f.key) for f in findings if f.rule == "not-in-use"] == [("info", "TebLocalPlannerROS")]


def test_an_empty_namespace_causes_no_finding() -> None:
    assert keys_of(check(robot(NavfnROS=None, GlobalPlanner=None))) == keys_of(check(robot()))


# --- values that ROS clamps -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("key", "written", "used"),
    [
        ("DWAPlannerROS__min_rot_vel", -0.4, 0.0),  # the previous name of min_vel_theta
        ("DWAPlannerROS__min_vel_theta", -0.4, 0.0),
        ("DWAPlannerROS__acc_lim_x", 30.0, 20.0),
        ("DWAPlannerROS__vx_samples", 0, 1),
        ("TrajectoryPlannerROS__path_distance_bias", 32, 5.0),
        ("TrajectoryPlannerROS__min_vel_theta", 0.3, 0.0),
        ("GlobalPlanner__cost_factor", 0, 0.01),
        ("local_costmap__obstacle_layer__origin_z", -0.5, 0.0),
        ("local_costmap__obstacle_layer__z_voxels", 20, 16),
        ("local_costmap__inflation_layer__inflation_radius", -1, 0.0),
        ("global_costmap__transform_tolerance", 20, 10.0),
        ("planner_frequency", -1, 0.0),
        ("planner_patience", -5, 0.0),
    ],
)
def test_a_value_that_ros_clamps_loads_clamped_with_a_warning(key: str, written: float, used: float) -> None:
    planners = {
        "TrajectoryPlannerROS": {"base_local_planner": "base_local_planner/TrajectoryPlannerROS"},
        "GlobalPlanner": {"base_global_planner": "global_planner/GlobalPlanner"},
    }
    made = robot(**{key: written})
    made |= planners.get(key.partition("__")[0], {})
    voxel = {"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}
    made["local_costmap"]["plugins"] = [voxel, {"name": "inflation_layer", "type": "costmap_2d::InflationLayer"}]
    loaded = load_configuration([made])
    path = key.replace("__", "/")
    [found] = [f for f in loaded.findings if f.rule == "clamped"]
    assert (found.severity, found.key, found.suggestion) == ("warning", path, f"{used:g}")
    assert f"{written:g} is out of range, so {used:g} is used, as in ROS" in found.message
    namespace, _, name = path.rpartition("/")
    of: dict[str, Any] = {"": loaded.move_base, "global_costmap": loaded.global_costmap.params}
    of |= {p.namespace: p.params for p in (loaded.local_planner, loaded.global_planner, *loaded.local_costmap.layers)}
    assert getattr(of[namespace], "min_vel_theta" if name == "min_rot_vel" else name) == used


def test_move_base_uses_values_over_its_sliders_as_written() -> None:
    loaded = load_configuration([robot(planner_patience=600.0, oscillation_timeout=120.0)])
    assert (loaded.move_base.planner_patience, loaded.move_base.oscillation_timeout) == (600.0, 120.0)
    assert not [f for f in loaded.findings if f.rule == "clamped"]


# --- what stops -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "rule", "key", "words"),
    [
        ({"controller_frequency": "fast"}, "wrong-type", "controller_frequency", ("fast", "number")),
        ({"DWAPlannerROS__max_vel_x": [1]}, "wrong-type", "DWAPlannerROS/max_vel_x", ("list",)),
        ({"DWAPlannerROS__xy_goal_tolerance": -1}, "out-of-range", "DWAPlannerROS/xy_goal_tolerance", ("at least 0",)),
        ({"global_costmap__robot_radius": -0.2}, "out-of-range", "global_costmap/robot_radius", ("-0.2", "at least 0")),
        ({"global_costmap__robot_radius": 0.0}, "footprint", "global_costmap/robot_radius", ("0", "positive")),
        ({"local_costmap__footprint": [[0, 0], [1, 1]]}, "footprint", "local_costmap/footprint", ("three points",)),
        ({"local_costmap__footprint": "[[0, 0], [1, 1]]"}, "footprint", "local_costmap/footprint", ("three points",)),
        ({"local_costmap__footprint": "round"}, "footprint", "local_costmap/footprint", ("round", "[[x, y]")),
        ({"footprint": [[0, 0], [1, "a"], [1, 1]]}, "footprint", "footprint", ("point 2",)),
        ({"footprint": [[1, 1], [-1, -1], [1, -1], [-1, 1]]}, "footprint", "footprint", ("crosses",)),
        ({"local_costmap__plugins": "inflation_layer"}, "plugin-list", "local_costmap/plugins", ("not a list",)),
        ({"local_costmap__plugins": {"name": "a"}}, "plugin-list", "local_costmap/plugins", ("namespace",)),
        ({"local_costmap__plugins": None}, "plugin-list", "local_costmap/plugins", ("no value",)),
        ({"local_costmap__plugins": ["a"]}, "plugin-list", "local_costmap/plugins", ("entry 1",)),
        ({"local_costmap__plugins": [{"name": "a"}]}, "plugin-list", "local_costmap/plugins", ("no type",)),
        ({"local_costmap__plugins": [OBSTACLE, OBSTACLE]}, "plugin-list", "local_costmap/plugins", ("two entries",)),
        (
            {"local_costmap__plugins": [{"name": "a", "type": "costmap_2d::InflatonLayer"}]},
            "unknown-plugin",
            "local_costmap/plugins",
            ("InflatonLayer", 'did you mean "costmap_2d/InflationLayer"', "known:"),
        ),
        ({"base_local_planner": "teb/TebLocalPlannerROS"}, "unknown-plugin", "base_local_planner", ("Teb", "known:")),
        (
            {"base_global_planner": DWA},
            "unknown-plugin",
            "base_global_planner",
            ("local planner, not a global planner",),
        ),
        ({"base_global_planner": 3}, "wrong-type", "base_global_planner", ("text",)),
        (
            {"recovery_behaviors": [{"name": "a", "type": "nope/Nope"}]},
            "unknown-plugin",
            "recovery_behaviors",
            ("Nope",),
        ),
        (
            {
                "recovery_behaviors": [{"name": "r", "type": "clear_costmap_recovery/ClearCostmapRecovery"}],
                "r": {"layer_names": ["obstacles"]},
            },
            "no-such-layer",
            "r/layer_names",
            ('"obstacles"', "obstacle_layer", "remove layer_names"),
        ),
        ({"DWAPlannerROS__critics": "path"}, "plugin-list", "DWAPlannerROS/critics", ("not a list",)),
        ({"navstack__ros_distro": "kinetic"}, "wrong-value", "navstack/ros_distro", ("kinetic", "noetic", "indigo")),
        ({"local_costmap__inflation_layer": 3}, "wrong-type", "local_costmap/inflation_layer", ("namespace",)),
        ({"global_costmap": 3}, "wrong-type", "global_costmap", ("namespace",)),
        (
            {"DWAPlannerROS__critics": [{"name": "a", "type": "nope"}]},
            "unknown-plugin",
            "DWAPlannerROS/critics",
            ("critic",),
        ),
        (
            {"DWAPlannerROS": {"min_vel_x": 1.0, "max_vel_x": 0.5}},
            "minimum-over-maximum",
            "DWAPlannerROS/min_vel_x",
            ("1", "0.5"),
        ),
    ],
)
def test_errors(more: dict[str, Any], rule: str, key: str, words: tuple[str, ...]) -> None:
    made = robot(**more)
    errors = [f for f in check(made) if f.severity == "error"]
    assert {(f.rule, f.key) for f in errors} == {(rule, key)}
    for word in words:
        assert word in errors[0].message
    with pytest.raises(ParameterError, match="cannot be used"):
        load_configuration([made])


def test_the_error_lists_every_reason_with_its_location(tmp_path: Path) -> None:
    path = tmp_path / "move_base_params.yaml"
    path.write_text(
        f"base_local_planner: {DWA}\ncontroller_frequency: fast\nDWAPlannerROS:\n  xy_goal_tolerance: -1.0\n  sim_tme: 1\n"
    )
    with pytest.raises(ParameterError) as caught:
        load_configuration([str(path)])
    lines = caught.value.message.splitlines()
    assert lines[0] == "the parameters cannot be used (2 errors):"
    assert lines[1].startswith(f"{path}:2:23: controller_frequency")
    assert lines[2].startswith(f"{path}:4:22: xy_goal_tolerance")
    findings = json.loads(json.dumps(caught.value.as_dict()))["findings"]
    assert {"severity", "rule", "file", "line", "column", "key", "message", "suggestion", "replacement"} == findings[
        0
    ].keys()
    # warnings are listed as well
    assert any(f["suggestion"] == "sim_time" for f in findings)
    assert findings == sorted(findings, key=lambda f: (f["file"], f["line"], f["column"]))


def test_unknown_plugins_alone_raise_their_own_error() -> None:
    with pytest.raises(UnknownPluginError):
        load_configuration([robot(base_global_planner="nope/Nope")])


def test_check_never_raises(tmp_path: Path) -> None:
    assert [f.rule for f in check("nowhere")] == ["no-source"]
    assert [f.rule for f in check()] == ["no-source"]
    (tmp_path / "a.yaml").write_bytes(b"\xff\xfe")
    assert [f.rule for f in check(str(tmp_path / "a.yaml"))] == ["not-utf8"]


def test_an_unavailable_default_planner_names_the_alternatives() -> None:
    made = robot()
    del made["base_local_planner"]
    findings = check(made)
    from navstack.plugins import LOCAL_PLANNERS

    if "base_local_planner/TrajectoryPlannerROS" in LOCAL_PLANNERS:
        assert not [f for f in findings if f.severity == "error"]
    else:
        (error,) = [f for f in findings if f.severity == "error"]
        assert DWA in error.message


# --- how values are found ---------------------------------------------------------------------------------------------


def load(**more: Any) -> Any:
    return load_configuration([robot(**more)])


def test_the_footprint_is_found_as_in_costmap_2d() -> None:
    square = [[0.3, 0.3], [-0.3, 0.3], [-0.3, -0.3], [0.3, -0.3]]
    # a footprint in any enclosing namespace takes precedence over a radius nearby
    loaded = load(footprint=square)
    assert len(loaded.local_costmap.footprint.vertices) == 4
    assert loaded.local_costmap.true_footprint.inscribed_radius == pytest.approx(0.3)
    assert loaded.local_costmap.footprint.inscribed_radius == pytest.approx(0.31)
    # text is parsed, an empty footprint is ignored, the nearest one is used
    text = "[[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]"
    assert load(footprint=square, local_costmap__footprint=text).local_costmap.true_footprint.inscribed_radius == 0.5
    for empty in ("[]", "", []):
        assert len(load(local_costmap__footprint=empty).local_costmap.footprint.vertices) == 16
    made = robot(robot_radius=0.7, local_costmap__footprint_padding=0.0)
    del made["local_costmap"]["robot_radius"]
    loaded = load_configuration([made])
    assert loaded.local_costmap.footprint.circumscribed_radius == pytest.approx(0.7)
    assert loaded.global_costmap.true_footprint.circumscribed_radius == pytest.approx(0.2)
    # without both: 0.46 m, the default of costmap_2d
    del made["robot_radius"]
    assert load_configuration([made]).local_costmap.true_footprint.circumscribed_radius == pytest.approx(0.46)


def test_costmap_values_override_those_of_layers_for_the_names_that_ros_copies() -> None:
    loaded = load(
        local_costmap__inflation_radius=0.9,
        local_costmap__inflation_layer={"inflation_radius": 0.3},
        local_costmap__max_obstacle_height=0.5,
    )
    assert loaded.local_costmap.layers[1].params.inflation_radius == 0.9
    assert loaded.local_costmap.layers[0].params.max_obstacle_height == 0.5
    assert ("overridden-by-parent", "local_costmap/inflation_layer/inflation_radius") in keys_of(
        list(loaded.findings), "info"
    )
    # ROS does not copy the height to a voxel layer
    loaded = load(local_costmap__max_obstacle_height=0.5, local_costmap__plugins=[VOXEL, INFLATION])
    assert loaded.local_costmap.layers[0].params.max_obstacle_height == 2.0


def test_ranges_are_searched_from_the_source_upward() -> None:
    loaded = load(local_costmap__obstacle_layer={**SCAN, "obstacle_range": 1.0}, raytrace_range=9.0)
    source = loaded.local_costmap.layers[0].params.sources["scan"]
    assert (source.obstacle_range, source.raytrace_range) == (1.0, 9.0)


def test_parameters_from_before_hydro() -> None:
    old = {
        "base_local_planner": DWA,
        "global_costmap": {
            "static_map": True,
            "map_type": "costmap",
            "lethal_cost_threshold": 90,
            "inflation_radius": 0.7,
        },
        "local_costmap": {
            "map_type": "voxel",
            "rolling_window": True,
            "z_voxels": 4,
            "obstacle_range": 1.5,
            "raytrace_range": 2.0,
            "observation_sources": "scan",
            "scan": {"data_type": "LaserScan", "topic": "scan", "clearing": True},
            "cost_scaling_factor": 3.0,
            "inflation_layer": {"cost_scaling_factor": 8.0},
        },
    }
    loaded = load_configuration([old])
    assert [layer.name for layer in loaded.global_costmap.layers] == [
        "static_layer",
        "obstacle_layer",
        "inflation_layer",
    ]
    assert loaded.global_costmap.layers[0].params.lethal_cost_threshold == 90
    assert loaded.global_costmap.layers[2].params.inflation_radius == 0.7
    obstacle, inflation = loaded.local_costmap.layers
    assert obstacle.cls.__name__ == "VoxelLayer"
    assert obstacle.params.z_voxels == 4
    assert obstacle.params.sources["scan"].obstacle_range == 1.5
    # replaces the value in the layer's own namespace, as in C++
    assert inflation.params.cost_scaling_factor == 3.0
    assert {f.key for f in loaded.findings if f.rule == "pre-hydro"} == {"global_costmap", "local_costmap"}
    assert not [f for f in loaded.findings if f.rule in ("unknown", "elsewhere", "unknown-namespace")]


def test_overrides_and_distro() -> None:
    loaded = load_configuration(
        [robot()], overrides=["DWAPlannerROS/max_vel_x=0.4", "local_costmap.width=6"], distro="indigo"
    )
    assert loaded.local_planner.params.max_vel_x == 0.4
    assert loaded.local_costmap.params.width == 6
    assert loaded.navstack.ros_distro == loaded.local_planner.params.ros_distro == "indigo"
    assert load_configuration(["turtlebot"], distro="noetic").local_planner.params.ros_distro == "noetic"
    (error,) = [f for f in check(robot(), distro="kinetic") if f.severity == "error"]
    assert (error.file, error.rule) == ("--distro", "wrong-value")
    (error,) = [f for f in check(robot(), overrides=["DWAPlannerROS/max_vel_x=fast"]) if f.severity == "error"]
    assert error.file == "overrides[0]"


def test_recoveries_have_their_own_namespaces() -> None:
    clear = "clear_costmap_recovery/ClearCostmapRecovery"
    listed = [{"name": "near", "type": clear}, {"name": "far", "type": clear}]
    loaded = load(recovery_behaviors=listed, near={"reset_distance": 1.0}, far={"reset_distance": 5.0})
    assert [(r.name, r.params.reset_distance) for r in loaded.recoveries] == [("near", 1.0), ("far", 5.0)]
    assert load(recovery_behaviors=[]).recoveries == ()
    assert [r.name for r in load(clearing_rotation_allowed=False).recoveries] == [
        "conservative_reset",
        "aggressive_reset",
    ]


def test_critics_that_are_listed_have_namespaces() -> None:
    listed = [{"name": "near", "type": "path"}, {"name": "goal", "type": "goal"}]
    loaded = load(DWAPlannerROS={"critics": listed, "near": {}})
    assert [c.name for c in loaded.local_planner.params.critics] == ["near", "goal"]
    assert list(loaded.local_planner.params.critic_params) == ["near", "goal"]
    assert not [f for f in loaded.findings if f.severity == "warning"]


def test_planners_by_registered_name_and_other_than_the_selected_one() -> None:
    loaded = load(
        base_global_planner="global_planner", GlobalPlanner={"cost_factor": 2.0}, NavfnROS={"default_tolerance": 0.5}
    )
    assert (loaded.global_planner.name, loaded.global_planner.params.cost_factor) == ("global_planner", 2.0)
    other = choose_global_planner(loaded, "navfn/NavfnROS")
    assert (other.name, other.params.default_tolerance, other.namespace) == ("navfn", 0.5, "NavfnROS")
    with pytest.raises(UnknownPluginError):
        choose_global_planner(loaded, "nope")
    bad = load(NavfnROS=None, GlobalPlanner={"cost_factor": "x"})
    with pytest.raises(ParameterError, match="cost_factor"):
        choose_global_planner(bad, "global_planner")


def test_every_value_has_its_location() -> None:
    loaded = load_configuration(["turtlebot"], overrides=["DWAPlannerROS/sim_time=1.5"])
    origins = loaded.origins
    # by the current name, also for a previous one, and where a source finds it by searching
    assert str(origins["DWAPlannerROS/max_vel_trans"]) == "turtlebot/dwa_local_planner_params.yaml:10:18"
    assert str(origins["DWAPlannerROS/sim_time"]) == "overrides[0]"
    assert origins["DWAPlannerROS/controller_frequency"].file == "turtlebot/move_base_params.yaml"
    scan = origins["local_costmap/obstacle_layer/scan/obstacle_range"]
    assert (scan.file, scan.line) == ("turtlebot/costmap_common_params.yaml", 19)
    assert "DWAPlannerROS/twirling_scale" not in origins


def test_loading_is_repeatable() -> None:
    first, second = load_configuration(["turtlebot"]), load_configuration(["turtlebot"])
    assert first == second
    assert [str(f) for f in first.findings] == [str(f) for f in second.findings]


@pytest.mark.parametrize(
    ("override", "names"),
    [
        (
            "inflation_radius=0.4",
            ["global_costmap/inflation_layer/inflation_radius", "local_costmap/inflation_layer/infl"],
        ),
        ("local_costmap/inflation_layr/inflation_radius=0.4", ["is local_costmap/inflation_layer/inflation_radius"]),
        ("max_vel_x=0.2", ["is DWAPlannerROS/max_vel_x"]),
        ("DWAPlannerROS/max_vel=0.2", ["DWAPlannerROS/max_vel_x", "DWAPlannerROS/max_vel_trans"]),
        ("DWAPlannerROS={max_vel_x: 0.2, acc_limit_x: 1.0}", ["is DWAPlannerROS/acc_lim_x"]),
        ("sim/laser/fov=2", ["is navstack/sim/laser/fov"]),
        ("TebLocalPlannerROS/max_vel_x=0.2", ["belongs to the planner of teb_local_planner"]),
        ("qwertyuiop=1", ["no parameter of that name"]),
    ],
)
def test_an_override_that_sets_nothing_is_one_error_with_the_names_that_exist(override: str, names: list[str]) -> None:
    found = [f for f in check("turtlebot", overrides=["planner_frequency=1.0", override]) if f.severity != "info"]
    assert [(f.severity, f.rule, f.file) for f in found] == [("error", "override", "overrides[1]")]
    for name in names:
        assert name in found[0].message
    with pytest.raises(ParameterError, match=r"overrides\[1\]: .* sets nothing"):
        load_configuration(["turtlebot"], overrides=["planner_frequency=1.0", override])
    if found[0].suggestion is not None:
        again = f"{found[0].suggestion}=0.3"
        assert not [f for f in check("turtlebot", overrides=[again]) if f.rule == "override"]


@pytest.mark.parametrize(
    "override", ["TrajectoryPlannerROS/vx_samples=8", "dwa/max_vel_x=2", "NavfnROS/planner_window_x=1.0"]
)
def test_an_override_without_an_effect_is_a_warning(override: str) -> None:
    """In a file it is a note: a section for another planner is usual there."""
    [found] = [f for f in check("turtlebot", overrides=[override]) if f.file == "overrides[0]"]
    assert found.severity == "warning" and found.rule in ("not-in-use", "no-effect")
    assert "has no effect" in found.message


def test_overrides_of_other_planners_and_of_former_names_are_no_errors() -> None:
    for override in (
        "TrajectoryPlannerROS/max_vel_x=0.3",
        "amcl/max_particles=2000",
        "DWAPlannerROS/max_trans_vel=0.3",
    ):
        assert not [f for f in check("turtlebot", overrides=[override]) if f.severity == "error"]


@pytest.mark.parametrize(
    "name", ["DWAPlanerROS", "dwa_local_planner", "TrajectoryPlannerROS", "FollowPath", "my_planner"]
)
def test_a_section_of_the_planner_under_another_name_is_one_finding(name: str, tmp_path: Path) -> None:
    """The content says what is meant; what the defaults cause that are in use instead is part of the finding."""
    for file in Path("params/turtlebot").iterdir():
        text = file.read_text(encoding="utf-8").replace("\nDWAPlannerROS:", f"\n{name}:")
        (tmp_path / file.name).write_text(text, encoding="utf-8")
    [found] = [f for f in check(str(tmp_path)) if f.severity != "info"]
    assert (found.key, found.replacement) == (name, "DWAPlannerROS")
    assert "Because of its defaults: " in found.message
    assert "DWAPlannerROS commands sideways velocities" in found.message


def test_a_finding_about_a_default_says_so() -> None:
    planner = {"base_local_planner": "dwa_local_planner/DWAPlannerROS", "DWAPlannerROS": {"max_vel_x": 0.3}}
    [found] = [f for f in check(planner) if f.rule == "sideways-command"]
    assert "(max_vel_y is not set, so this is about its default)" in found.message
    planner["DWAPlannerROS"] = {"max_vel_y": 0.1}
    kept = {"navstack": {"sim": {"kinematics": "differential"}}}
    [found] = [f for f in check(planner, kept) if f.rule == "sideways-command"]
    assert "default" not in found.message


def test_parameters_of_an_unselected_planner_keep_their_section() -> None:
    both = {"TrajectoryPlannerROS": {"pdist_scale": 0.6, "gdist_scale": 0.8, "acc_lim_x": 1.0, "max_vel_x": 0.3}}
    found = check({"base_local_planner": "dwa_local_planner/DWAPlannerROS"}, both)
    assert [f.rule for f in found if f.key == "TrajectoryPlannerROS"] == ["not-in-use"]


def test_an_override_of_the_radius_below_a_footprint_is_an_error() -> None:
    [error] = [f for f in check("jackal_dwa", overrides=["local_costmap/robot_radius=0.3"]) if f.severity == "error"]
    assert "footprint" in error.message and "local_costmap/footprint=[]" in error.message
    both = ["local_costmap/footprint=[]", "local_costmap/robot_radius=0.3"]
    assert load_configuration(
        ["jackal_dwa"], overrides=both
    ).local_costmap.true_footprint.inscribed_radius == pytest.approx(0.3, abs=0.01)


# --- the robots of the world ------------------------------------------------------------------------------------------

LAUNCHES = data_files("params/*/_launch/*")
FOLDERS = [p for p in data_files("params/*") if p.is_dir()]


@pytest.mark.slow
@pytest.mark.skipif(not LAUNCHES, reason="no foreign data here")
@pytest.mark.parametrize("path", LAUNCHES, ids=lambda p: f"{p.parts[-3]}-{p.stem}"[:70])
def test_launch_files_of_published_robots(path: Path) -> None:
    arguments = ["model:=burger", "name:=fetch", "config:=2d", "cmd_vel_topic:=cmd_vel", "odom_topic:=odom"]
    findings = check(str(path), *arguments)
    # every error has a location, a value and a fix
    for f in findings:
        assert f.file and f.message and f.rule
        if f.severity == "error" and f.rule in ("wrong-type", "out-of-range"):
            assert f.line > 0
    acceptable = {"unknown-plugin", "out-of-range", "wrong-type", "launch", "plugin-list", "no-such-layer", "footprint"}
    assert {f.rule for f in findings if f.severity == "error"} <= acceptable


@pytest.mark.slow
@pytest.mark.skipif(not FOLDERS, reason="no foreign data here")
@pytest.mark.parametrize("path", FOLDERS, ids=lambda p: p.name)
def test_folders_of_published_robots(path: Path) -> None:
    findings = check(str(path), overrides=[f"base_local_planner={DWA}"])
    acceptable = {"unknown-plugin", "out-of-range", "wrong-type", "ambiguous", "no-source", "footprint"}
    assert {f.rule for f in findings if f.severity == "error"} <= acceptable


def test_a_packaged_name_selects_the_packaged_set_in_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "turtlebot").mkdir()
    monkeypatch.chdir(tmp_path)
    loaded = load_configuration(["turtlebot"])
    assert loaded.navstack.ros_distro == "indigo"
    assert [f.rule for f in loaded.findings if f.rule == "packaged-set"] == ["packaged-set"]
    assert [f.rule for f in check("./turtlebot")] == ["no-source"]


@pytest.mark.parametrize("name", ["NavfnROS", "DWAPlannerROS", "navstack", "conservative_reset"])
def test_a_value_instead_of_a_namespace(name: str) -> None:
    errors = [f for f in check(robot(**{name: 3})) if f.severity == "error"]
    assert [(f.rule, f.key) for f in errors] == [("wrong-type", name)]
    without = robot()
    without.pop(name, None)
    assert keys_of(check(robot(**{name: None}))) == keys_of(check(without))


def test_an_unknown_layer_can_be_left_out() -> None:
    depth = {"name": "depth", "type": "costmap_2d::FetchDepthLayer"}
    listed = robot(local_costmap__plugins=[depth, OBSTACLE, INFLATION], local_costmap__depth={"beams": 3})
    (error,) = [f for f in check(listed) if f.severity == "error"]
    assert (error.rule, "--allow-missing" in error.message) == ("unknown-plugin", True)
    with pytest.raises(UnknownPluginError):
        load_configuration([listed])
    loaded = load_configuration([listed], allow_missing=True)
    assert [layer.name for layer in loaded.local_costmap.layers] == ["obstacle_layer", "inflation_layer"]
    assert [(f.rule, f.severity) for f in loaded.findings if f.severity != "info"] == [("unknown-plugin", "warning")]
    assert [s.name for s in loaded.local_costmap.params.plugins or []] == ["obstacle_layer", "inflation_layer"]
    # the saved tree loads without the option
    again = load_configuration([loaded.tree.as_dict()])
    assert again.local_costmap == loaded.local_costmap


def test_an_unknown_planner_cannot_be_left_out() -> None:
    for key in ("base_local_planner", "base_global_planner"):
        (error,) = [f for f in check(robot(**{key: "teb/Nope"}), allow_missing=True) if f.severity == "error"]
        assert (error.rule, error.key) == ("unknown-plugin", key)
    eband = robot(base_local_planner="eband_local_planner/EBandPlannerROS")
    (error,) = [f for f in check(eband) if f.severity == "error"]
    assert error.suggestion is None  # a planner that exists elsewhere is not a misspelt one


def test_a_planner_that_exists_elsewhere_can_be_replaced_with_its_limits() -> None:
    car = {"max_vel_x": 0.4, "max_vel_x_backwards": 0.2, "acc_lim_x": 0.5, "min_turning_radius": 0.8, "wheelbase": 0.4}
    teb = robot(
        base_local_planner="teb_local_planner/TebLocalPlannerROS",
        base_global_planner="SBPLLatticePlanner",
        TebLocalPlannerROS={**car, "yaw_goal_tolerance": 0.1, "weight_obstacle": 50.0},
        controller_frequency=10.0,
    )
    assert all("--allow-missing" in f.message for f in check(teb) if f.severity == "error")
    loaded = load_configuration([teb], allow_missing=True)
    replaced = [f for f in loaded.findings if f.rule == "substituted-planner"]
    assert [f.key for f in replaced] == ["base_global_planner", "base_local_planner"]
    params: Any = loaded.local_planner.params
    assert (params.vx_max, params.vx_min, params.ax_max, params.ax_min) == (0.4, -0.2, 0.5, -0.5)
    assert (params.turning_radius, params.model_dt, params.time_steps) == (0.8, 0.1, 28)
    assert params.validator.consider_footprint  # the average of trajectories without contact may have one
    assert loaded.navstack.sim.kinematics == "ackermann"
    assert loaded.navstack.sim.turning_radius == pytest.approx(0.8)
    assert loaded.turning_radius == pytest.approx(0.8)
    assert load_configuration([loaded.tree.as_dict()]).local_planner == loaded.local_planner
    # a base that moves sideways, and a planner without parameters
    omni = teb | {"TebLocalPlannerROS": {"max_vel_y": 0.3}, "goal_checker": {"plugin": "simple"}}
    assert load_configuration([omni], allow_missing=True).navstack.sim.kinematics == "holonomic"
    bare = {key: value for key, value in teb.items() if key != "TebLocalPlannerROS"}
    assert load_configuration([bare], allow_missing=True).navstack.sim.kinematics == "differential"


def test_unknown_critics_and_recoveries_can_be_left_out() -> None:
    critics = [{"name": "near", "type": "path"}, {"name": "far", "type": "mine"}]
    loaded = load_configuration([robot(DWAPlannerROS={"critics": critics})], allow_missing=True)
    assert [c.name for c in loaded.local_planner.params.critics] == ["near"]
    listed = [{"name": "a", "type": "their/Recovery"}, {"name": "b", "type": "rotate_recovery/RotateRecovery"}]
    loaded = load_configuration([robot(recovery_behaviors=listed, a={"x": 1})], allow_missing=True)
    assert [r.name for r in loaded.recoveries] == ["b"]


def test_sideways_speeds_of_trajectory_rollout_have_no_effect() -> None:
    rollout = robot(base_local_planner="base_local_planner/TrajectoryPlannerROS")
    rollout["TrajectoryPlannerROS"] = {"max_vel_y": 0.0, "min_vel_y": 0.0, "holonomic_robot": False, "min_vel_x": 0.1}
    said_of = [(f.rule, f.severity) for f in check(rollout) if f.key.startswith("TrajectoryPlannerROS")]
    assert said_of == [("no-effect", "info")] * 2


# --- the simulated robot follows the YAML -----------------------------------------------------------------------------


def sources(**more: dict[str, Any]) -> dict[str, Any]:
    """A robot whose obstacle layers have these sources."""
    layer = {"observation_sources": " ".join(more), **more}
    return robot(global_costmap__obstacle_layer=layer, local_costmap__obstacle_layer=layer)


def test_the_simulated_lidars_follow_the_observation_sources() -> None:
    front = {"data_type": "LaserScan", "topic": "/front/scan", "sensor_frame": "front_laser", "clearing": True}
    rear = {"data_type": "LaserScan", "topic": "rear_scan", "min_obstacle_height": 0.5, "max_obstacle_height": 0.7}
    loaded = load_configuration([sources(front=front, rear=rear)])
    sim = loaded.navstack.sim
    assert sim.lasers == ["laser", "laser_2"]
    made = [sim.lidar(name) for name in sim.lasers]
    assert [(p.topic, p.frame, p.height) for p in made] == [
        ("front/scan", "front_laser", 0.3),
        ("rear_scan", "rear_scan_link", pytest.approx(0.6)),
    ]
    assert not [f for f in loaded.findings if f.severity == "warning"]
    [assumed, _] = [f.message for f in loaded.findings if f.rule == "assumed-lidar"]
    assert "270 degrees" in assumed and "0.05 to 3 m" in assumed and "navstack: {sim: {laser: {fov" in assumed
    # what the user says is kept, and not assumed
    own = sources(front=front) | {"navstack": {"sim": {"laser": {"fov": 4.7, "frame": "mine", "x": 0.3}}}}
    kept = load_configuration([own])
    lidar = kept.navstack.sim.lidar("laser")
    assert (lidar.topic, lidar.frame, lidar.fov, lidar.x) == ("front/scan", "mine", 4.7, 0.3)
    assert not [f for f in kept.findings if f.rule == "assumed-lidar"]


@pytest.mark.parametrize(
    ("layer", "scan", "height"),
    [
        # points are float32: 0.3 m is above 0.3
        ({}, {"min_obstacle_height": 0.1, "max_obstacle_height": 0.3}, 0.2),
        # the limit of the layer applies as well
        ({"max_obstacle_height": 0.2}, {}, 0.1),
    ],
)
def test_an_assumed_lidar_has_a_height_that_its_costmaps_accept(
    layer: dict[str, Any], scan: dict[str, Any], height: float
) -> None:
    written = {**layer, "observation_sources": "scan", "scan": {"data_type": "LaserScan", "topic": "scan", **scan}}
    both = robot(global_costmap__obstacle_layer=written, local_costmap__obstacle_layer=written)
    assert load_configuration([both]).navstack.sim.lidar("laser").height == pytest.approx(height)
    # a height that is written is kept, and its mismatch is a warning
    both["navstack"] = {"sim": {"laser": {"height": 0.3}}}
    [blind] = [f for f in check(both) if f.rule == "simulated-robot-blind"]
    assert "it accepts heights" in blind.message and "the lidar is at 0.3 m" in blind.message


def test_an_assumed_lidar_is_within_the_voxels() -> None:
    scan = {"data_type": "LaserScan", "topic": "scan"}
    voxels = {"observation_sources": "scan", "scan": scan, "z_voxels": 3, "z_resolution": 0.1}
    plugins = [{"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}, INFLATION]
    local = robot(local_costmap__plugins=plugins, local_costmap__obstacle_layer=voxels)
    assert load_configuration([local]).navstack.sim.lidar("laser").height < 0.3
    # the global costmap sees a lidar at 0.5 m, the voxels do not
    local["navstack"] = {"sim": {"laser": {"height": 0.5}}}
    [blind] = [f for f in check(local) if f.rule == "simulated-robot-blind"]
    assert "the local_costmap of the simulated robot is blind" in blind.message


def test_sources_that_the_simulated_robot_does_not_feed_are_warnings() -> None:
    scan = {"data_type": "LaserScan", "topic": "scan"}
    camera = {"data_type": "PointCloud", "topic": "camera/points"}
    assert not [f for f in check(sources(scan=scan, camera=camera)) if f.severity == "warning"]
    unfed = sources(scan=scan, camera=camera) | {"navstack": {"sim": {"lasers": ["laser"]}}}
    [found] = [f for f in check(unfed) if f.severity == "warning"]
    assert found.rule == "nothing-feeds" and "{topic: camera/points, message: PointCloud}" in found.message
    # the line of the message helps
    two = sources(scan=scan, rear={"data_type": "LaserScan", "topic": "rear"})
    two |= {"navstack": {"sim": {"lasers": ["laser"]}}}
    [found] = [f for f in check(two) if f.severity == "warning"]
    assert "{lasers: [laser, rear], rear: {topic: rear}}" in found.message
    two["navstack"] = {"sim": {"lasers": ["laser", "rear"], "rear": {"topic": "rear", "frame": "rear_link"}}}
    assert not [f for f in check(two) if f.severity == "warning"]
    frame = sources(scan=scan | {"sensor_frame": "nowhere"}) | {"navstack": {"sim": {"lasers": ["laser"]}}}
    assert [f.rule for f in check(frame) if f.severity == "warning"] == ["unknown-frame"]
    clearing = sources(scan=scan, other=scan | {"topic": "other", "marking": False, "clearing": True})
    assert [f.rule for f in check(clearing) if f.severity == "warning"] == ["clearing-only"]


def test_sideways_commands_and_the_base() -> None:
    def loaded(**dwa: float) -> tuple[str, bool]:
        made = load_configuration([robot(DWAPlannerROS=dwa) | {"navstack": navstack}])
        return made.navstack.sim.kinematics, any(f.rule == "sideways-command" for f in made.findings)

    navstack: dict[str, Any] = {}
    assert loaded() == ("differential", False)  # robot() sets both limits to 0
    assert loaded(max_vel_y=0.3, min_vel_y=-0.3) == ("holonomic", False)
    bare = robot()
    del bare["DWAPlannerROS"]  # the default of ROS: 0.1 m/s
    [found] = [f for f in check(bare) if f.rule == "sideways-command"]
    assert found.severity == "warning" and "0.1 m/s" in found.message and "max_vel_y: 0" in found.message
    navstack = {"sim": {"kinematics": "differential"}}
    assert loaded(max_vel_y=0.3, min_vel_y=-0.3) == ("differential", True)
    assert loaded(max_vel_y=0.3, min_vel_y=-0.3, acc_lim_y=0.0) == ("differential", False)


# --- suggestions ------------------------------------------------------------------------------------------------------


def messages_about(name: str, *sources: Any) -> list[str]:
    return [f.message for f in check_parameters(list(sources)) if f.key.rpartition("/")[2] == name]


@pytest.mark.parametrize(
    ("planner", "name", "never"),
    [
        ("base_local_planner/TrajectoryPlannerROS", "max_in_place_vel_theta", "min_in_place_vel_theta"),
        ("base_local_planner/TrajectoryPlannerROS", "vy_samples", "vx_samples"),
        ("base_local_planner/TrajectoryPlannerROS", "acc_limit_trans", "acc_lim_theta"),
        ("dwa_local_planner/DWAPlannerROS", "min_vel_trasn", None),
    ],
)
def test_a_name_of_the_opposite_is_not_suggested(planner: str, name: str, never: str | None) -> None:
    values = robot(base_local_planner=planner)
    values[planner.rpartition("/")[2]] = {name: 1.0}
    [message] = messages_about(name, values)
    if never is None:
        assert "did you mean min_vel_trans?" in message
    else:
        assert never not in message


def test_a_parameter_of_a_planner_that_is_not_in_use_is_not_to_be_moved_there() -> None:
    [message] = messages_about("simple_attractor", robot(DWAPlannerROS={"simple_attractor": True}))
    assert message == (
        "simple_attractor is a parameter of TrajectoryPlannerROS, which is not in use, and has no effect under "
        "DWAPlannerROS; remove it"
    )


def test_a_name_without_a_home_nearby_gets_no_far_fetched_suggestion() -> None:
    """Some plugin somewhere reads a `radius` and a `type`."""
    clear = {"name": "reset", "type": "clear_costmap_recovery/ClearCostmapRecovery"}
    values = robot(recovery_behaviors=[clear], reset={"type": "x"}, global_costmap__radius=0.4)
    for name in ("radius", "type"):
        for message in messages_about(name, values):
            assert "did you mean" not in message and "remove it" in message


def test_a_parameter_that_the_type_of_a_layer_does_not_read() -> None:
    """The local costmap has a voxel layer of the name that is an obstacle layer in the global one."""
    voxels = [{"name": "obstacle_layer", "type": "costmap_2d::VoxelLayer"}, INFLATION]
    values = robot(local_costmap__plugins=voxels, global_costmap__obstacle_layer={**SCAN, "unknown_threshold": 9})
    [message] = messages_about("unknown_threshold", values)
    assert "did you mean" not in message and "remove it" in message

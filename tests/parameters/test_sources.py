"""Folders, files and overrides -> one tree, merged as by roslaunch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.core import ParameterError
from navstack.parameters import check_parameters, load_configuration, packaged_sets, read_sources
from navstack.parameters.sources import role_of


def write(folder: Path, **files: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / f"{name}.yaml").write_text(text)
    return folder


def tree(*sources: Any, overrides: tuple[str, ...] = ()) -> dict[str, Any]:
    read = read_sources(list(sources), overrides)
    assert [str(f) for f in read.findings if f.severity == "error"] == []
    return read.root.as_dict()


def rules(*sources: Any, overrides: tuple[str, ...] = ()) -> list[tuple[str, str]]:
    return [(f.severity, f.rule) for f in read_sources(list(sources), overrides).findings]


def test_the_common_file_goes_into_both_costmaps_and_later_files_win(tmp_path: Path) -> None:
    folder = write(
        tmp_path / "p",
        costmap_common_params="robot_radius: 0.2\ninflation_layer: {inflation_radius: 0.5, cost_scaling_factor: 5.0}\n",
        local_costmap_params="local_costmap:\n  width: 4.0\n  inflation_layer: {inflation_radius: 0.3}\n",
        move_base_params="controller_frequency: 5.0\n",
    )
    assert tree(str(folder)) == {
        "global_costmap": {
            "robot_radius": 0.2,
            "inflation_layer": {"inflation_radius": 0.5, "cost_scaling_factor": 5.0},
        },
        "local_costmap": {
            "robot_radius": 0.2,
            "inflation_layer": {"inflation_radius": 0.3, "cost_scaling_factor": 5.0},
            "width": 4.0,
        },
        "controller_frequency": 5.0,
    }


def test_named_files_are_loaded_in_the_order_given(tmp_path: Path) -> None:
    folder = write(tmp_path, a="x: 1\ny: {z: 1, w: 1}\nl: [1, 2]\n", b="x: 2\ny: {z: 2}\nl: [3]\n")
    a, b = str(folder / "a.yaml"), str(folder / "b.yaml")
    assert tree(a, b) == {"x": 2, "y": {"z": 2, "w": 1}, "l": [3]}
    assert tree(b, a) == {"x": 1, "y": {"z": 1, "w": 1}, "l": [1, 2]}


def test_a_file_at_a_namespace(tmp_path: Path) -> None:
    folder = write(tmp_path, costmap_common_params="width: 3\n")
    assert tree(f"{folder / 'costmap_common_params.yaml'}@local_costmap") == {"local_costmap": {"width": 3}}
    assert tree(f"{folder / 'costmap_common_params.yaml'}@/a/b") == {"a": {"b": {"width": 3}}}


def test_keys_with_slashes_are_namespaces(tmp_path: Path) -> None:
    folder = write(tmp_path, a="GlobalPlanner/allow_unknown: true\nGlobalPlanner: {cost_factor: 1.0}\n")
    assert tree(str(folder / "a.yaml")) == {"GlobalPlanner": {"allow_unknown": True, "cost_factor": 1.0}}


def test_a_dump_of_the_parameter_server_is_entered_at_move_base(tmp_path: Path) -> None:
    folder = write(
        tmp_path, dump="amcl: {x: 1}\nmove_base: {controller_frequency: 5.0}\nnavstack: {ros_distro: indigo}\n"
    )
    assert tree(str(folder / "dump.yaml")) == {"controller_frequency": 5.0, "navstack": {"ros_distro": "indigo"}}


def test_files_without_a_role_are_reported_and_not_loaded(tmp_path: Path) -> None:
    folder = write(
        tmp_path / "p", move_base_params="a: 1\n", kinect_costmap_params="dummy.yaml", amcl="odom_alpha1: 1\n"
    )
    assert tree(str(folder)) == {"a": 1}
    notes = [f for f in read_sources([str(folder)]).findings if f.rule == "not-loaded"]
    assert [Path(f.file).name for f in notes] == ["amcl.yaml", "kinect_costmap_params.yaml"]
    assert all(f.severity == "info" for f in notes)
    # if it is named, it is read and its errors are reported
    assert ("error", "not-a-mapping") in rules(str(folder / "kinect_costmap_params.yaml"))


@pytest.mark.parametrize(
    ("name", "role"),
    [
        ("costmap_common_params.yaml", "costmap_common"),
        ("costmap_common.yaml", "costmap_common"),
        ("common_costmap_params.yaml", "costmap_common"),
        ("costmap_common_params_burger.yaml", "costmap_common"),
        ("local_costmap_params.yaml", "local_costmap"),
        ("costmap_local.yaml", "local_costmap"),
        ("global_costmap_params_withmap.yaml", "global_costmap"),
        ("dwa_local_planner_params.yaml", "local_planner"),
        ("dwa_local_planner_params_waffle_pi.yaml", "local_planner"),
        ("p3dx_dwa_local_planner_params.yaml", "local_planner"),
        ("base_local_planner.yaml", "local_planner"),
        ("planner.yaml", "move_base"),
        ("move_base_params.yaml", "move_base"),
        ("navfn_global_planner_params.yaml", "global_planner"),
        ("recovery_behaviors.yaml", "recovery"),
        ("navstack.yaml", "navstack"),
        ("astra_costmap_params.yaml", None),
        ("dummy.yaml", None),
        ("amcl.yaml", None),
        ("karto.yaml", None),
    ],
)
def test_roles_by_file_name(name: str, role: str | None) -> None:
    assert role_of(name) == role


def test_a_costmap_file_without_namespace_is_loaded_by_its_name(tmp_path: Path) -> None:
    folder = write(tmp_path / "p", costmap_local="width: 3\n", costmap_global="width: 30\n", planner="a: 1\n")
    assert tree(str(folder)) == {"local_costmap": {"width": 3}, "global_costmap": {"width": 30}, "a": 1}


def test_one_inner_folder_is_loaded_and_several_are_an_error(tmp_path: Path) -> None:
    folder = write(tmp_path / "p", costmap_common_params="width: 1\n")
    write(folder / "odom_nav_params", local_costmap_params="local_costmap: {height: 2}\n")
    assert tree(str(folder))["local_costmap"] == {"width": 1, "height": 2}
    write(folder / "map_nav_params", local_costmap_params="local_costmap: {height: 3}\n")
    (found,) = [f for f in read_sources([str(folder)]).findings if f.severity == "error"]
    assert found.rule == "ambiguous"
    assert "map_nav_params or" in found.message and "odom_nav_params" in found.message
    # both named: the inner one overrides the outer one
    assert (
        tree(str(folder / "costmap_common_params.yaml"), str(folder / "map_nav_params"))["local_costmap"]["height"] == 3
    )


def test_several_files_with_one_role_are_an_error(tmp_path: Path) -> None:
    folder = write(tmp_path / "p", costmap_common_params_a="x: 1\n", costmap_common_params_b="x: 2\n")
    assert ("error", "ambiguous") in rules(str(folder))
    folder = write(tmp_path / "q", base_local_planner_params="A: {x: 1}\n", dwa_local_planner_params="B: {x: 1}\n")
    assert tree(str(folder)) == {"A": {"x": 1}, "B": {"x": 1}}
    (folder / "dwa_local_planner_params.yaml").write_text("A: {x: 2}\n")
    assert ("error", "ambiguous") in rules(str(folder))


@pytest.mark.parametrize("text", ["", "# not written yet\n", "{}\n"])
def test_a_file_without_parameters_is_named(tmp_path: Path, text: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    assert [(f.severity, f.rule, f.file) for f in read_sources([str(path)]).findings] == [
        ("warning", "empty-file", str(path))
    ]


def test_overrides(tmp_path: Path) -> None:
    folder = write(tmp_path, a="DWA: {v: 1.0}\nl: {x: 1}\n")
    source = str(folder / "a.yaml")
    assert tree(source, overrides=("DWA/v=0.4",))["DWA"]["v"] == 0.4
    assert tree(source, overrides=("DWA.v=1e-1",))["DWA"]["v"] == 0.1
    assert tree(source, overrides=("/DWA/w=[1, {a: b}]", "DWA/v="))["DWA"] == {"v": None, "w": [1, {"a": "b"}]}
    read = read_sources([source], ["DWA/v=0.4", "DWA/v=0.5"])
    dwa = read.root.space("DWA")
    assert dwa is not None
    leaf = dwa.leaf("v")
    assert leaf is not None and leaf.at.file == "overrides[1]" and str(leaf.at) == "overrides[1]"


@pytest.mark.parametrize("text", ["nonsense", "=3", "a=[1", "a=!!python/name:os x", "///=1"])
def test_overrides_that_cannot_be_read(text: str) -> None:
    found = read_sources([{}], ["a=1", text]).findings
    assert [(f.severity, f.rule, f.file) for f in found] == [("error", "override", "overrides[1]")]


def test_value_and_namespace_of_one_name(tmp_path: Path) -> None:
    folder = write(tmp_path, a="x: 1\n", b="x: {y: 2}\n")
    a, b = str(folder / "a.yaml"), str(folder / "b.yaml")
    assert rules(a, b) == [("warning", "namespace-over-value")]
    assert tree(a, b) == {"x": {"y": 2}}
    assert rules(b, a) == [("warning", "value-over-namespace")]
    assert tree(b, a) == {"x": 1}


def test_a_python_mapping_is_a_source() -> None:
    assert tree({"a": 1, "b": {"c": [1.0, True]}}, {"a": 2}) == {"a": 2, "b": {"c": [1.0, True]}}


def test_missing_sources(tmp_path: Path) -> None:
    (found,) = read_sources(["turtlebto"]).findings
    assert (found.severity, found.rule, found.suggestion) == ("error", "no-source", "turtlebot")
    assert rules() == [("error", "no-source")]
    empty = tmp_path / "empty"
    empty.mkdir()
    assert rules(str(empty)) == [("error", "no-source")]


@pytest.mark.parametrize(
    ("path", "hint"),
    [
        ("robot/launch/movebase.launch", 'did you mean "{0}/robot/launch/move_base.launch"?'),
        ("robot/launch/x.yaml", '"{0}/robot/launch" has amcl.launch, move_base.launch; correct the path'),
        ("robot/lanch/move_base.launch", '"{0}/robot" has no lanch; correct the path'),
        ("robot/param/x.yaml", '"{0}/robot/param" has no launch file and no YAML file; correct the path'),
    ],
)
def test_a_path_that_does_not_exist_names_what_is_there(tmp_path: Path, path: str, hint: str) -> None:
    for name in ("launch/move_base.launch", "launch/amcl.launch", "param/readme.txt"):
        file = tmp_path / "robot" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("<launch/>")
    (found,) = read_sources([str(tmp_path / path)]).findings
    assert found.message.endswith(hint.format(tmp_path))


def test_the_packaged_sets_are_complete() -> None:
    assert "turtlebot" in packaged_sets()
    read = read_sources(["turtlebot"])
    assert [f for f in read.findings if f.severity != "info"] == []
    assert [Path(f).name for f in read.files] == [
        "costmap_common_params.yaml",
        "local_costmap_params.yaml",
        "global_costmap_params.yaml",
        "dwa_local_planner_params.yaml",
        "move_base_params.yaml",
        "global_planner_params.yaml",
        "navfn_global_planner_params.yaml",
        "navstack.yaml",
    ]


def test_the_packaged_turtlebot_mirrors_the_published_one(data_dir: Path) -> None:
    ours = read_sources(["turtlebot"]).root.as_dict()
    published = read_sources([str(data_dir / "params/turtlebot2/param")]).root.as_dict()
    added = {"navstack", "recovery_behaviors", "conservative_reset", "aggressive_reset"}
    assert {k: v for k, v in ours.items() if k not in added} == published
    assert added <= ours.keys()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a/" * 100_000 + "b", "/".join(["a"] * 60)])
def test_names_of_many_parts(name: str, tmp_path: Path) -> None:
    path = tmp_path / "x.yaml"
    path.write_text(f"{{{name}: 1, c: 2}}\n" if len(name) < 1000 else f"? {name}\n: 1\nc: 2\n")
    read = read_sources([str(path)])
    assert {f.rule for f in read.findings if f.severity == "error"} == {"too-deep"}
    assert read.root.as_dict()["c"] == 2
    assert "too-deep" in {f.rule for f in read_sources([str(path)], [f"{name}=1"]).findings}
    assert len(list(read.root.leaves())) == 1


def test_an_ambiguous_folder_names_the_launch_file_that_loads_it(tmp_path: Path) -> None:
    package = tmp_path / "robot"
    write(package / "config", costmap_global_static="a: 1", costmap_global_laser="a: 2")
    (package / "launch").mkdir()
    node = '<launch><node pkg="move_base" type="move_base" name="move_base">{}</node></launch>'
    load = '<rosparam file="$(find robot)/config/costmap_global_static.yaml" command="load" ns="global_costmap"/>'
    (package / "launch" / "drive.launch").write_text(node.format(load))
    (package / "launch" / "other.launch").write_text(node.format(""))
    [found] = [f for f in read_sources([str(package / "config")]).findings if f.severity == "error"]
    assert found.message.endswith(f"; or name the launch file that loads them: {package / 'launch' / 'drive.launch'}")


@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        (
            "# a mask\nimage: filter.pgm\nresolution: 0.05\norigin: [0.0, 0.0, 0.0]\n",
            2,
            (
                "describes a map or a mask and has no parameters of a robot; pass a map as the world (`navstack simulate "
                "other.yaml --params ROBOT`), a mask to its filter (`--set global_costmap/FILTER/mask=other.yaml`)"
            ),
        ),
        (
            "waypoints:\n  - {name: point1, pose: {position: {x: 1.0, y: 1.0, z: 0.0}}}\n",
            1,
            (
                "lists waypoints and has no parameters of a robot; pass their poses as goals (`--goal X,Y,YAW`, repeated), and "
                "name the robot's file"
            ),
        ),
        (
            "docks: {dock0: {type: charger, frame: map, pose: [1.0, 2.0, 0.0]}}\n",
            1,
            "lists docks and has no parameters of a robot; name the file with the parameters of the robot that docks there",
        ),
        (
            "places: {kitchen: [1, 2, 0]}\n",
            1,
            (
                "names places of a map and has no parameters of a robot; drive to them with `navstack tour other.yaml`, and "
                "name the robot's file"
            ),
        ),
        (
            "map: office\ngoals: [kitchen]\n",
            1,
            "is a scenario and has no parameters of a robot; pass it as the world (`navstack simulate other.yaml`)",
        ),
        (
            "launch:\n- node: {pkg: x}\n",
            1,
            "is a launch file in YAML and has no parameters of a robot; name the parameter files",
        ),
    ],
)
def test_a_file_that_is_no_robot_says_what_it_is(text: str, line: int, message: str, tmp_path: Path) -> None:
    path = tmp_path / "other.yaml"
    path.write_text(text, encoding="utf-8")
    for sources in ([str(path)], ["turtlebot", str(path)]):
        (found,) = [f for f in check_parameters(sources) if f.severity == "error"]
        assert (found.rule, found.file, found.line) == ("no-robot", str(path), line)
        assert found.message.startswith(f"the file {message}")
        with pytest.raises(ParameterError, match="has no parameters of a robot"):
            load_configuration(sources)


def test_parameters_of_move_base_beside_a_waypoint_list_are_read(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text("waypoints: [1, 2]\nlocal_costmap: {update_frequency: 4.0}\n", encoding="utf-8")
    assert load_configuration(["turtlebot", str(path)]).local_costmap.params.update_frequency == 4.0

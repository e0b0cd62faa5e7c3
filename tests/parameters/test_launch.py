"""Launch files: the parameters they set for move_base."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from navstack.parameters import read_sources
from navstack.parameters.launch import launch_argument

NODE = '<node pkg="move_base" type="move_base" name="move_base">{}</node>'


def launch(folder: Path, body: str, name: str = "robot.launch") -> str:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(f"<launch>{body}</launch>")
    return str(folder / name)


def tree(*sources: str) -> dict[str, Any]:
    read = read_sources(list(sources))
    assert [str(f) for f in read.findings if f.severity == "error"] == []
    return read.root.as_dict()


def errors(*sources: str) -> list[str]:
    return [f.message for f in read_sources(list(sources)).findings if f.severity == "error"]


def test_params_of_every_type(tmp_path: Path) -> None:
    body = NODE.format(
        '<param name="a" value="1"/><param name="b" value="1.5"/><param name="c" value="true"/><param name="d" value="x"/>'
        '<param name="e" type="str" value="1"/><param name="f" type="double" value="1"/><param name="g/h" type="int" value="2"/>'
        '<param name="i" type="bool" value="0"/><param name="j" type="yaml" value="[1, 2]"/><param name="~k" value="3"/>'
    )
    assert tree(launch(tmp_path, body)) == {
        "a": 1,
        "b": 1.5,
        "c": True,
        "d": "x",
        "e": "1",
        "f": 1.0,
        "g": {"h": 2},
        "i": False,
        "j": [1, 2],
        "k": 3,
    }


def test_rosparam_files_inline_text_namespaces_and_order(tmp_path: Path) -> None:
    package = tmp_path / "my_robot"
    (package / "param").mkdir(parents=True)
    (package / "param" / "common.yaml").write_text("width: 3\nlayer: {x: 1}\n")
    body = NODE.format(
        '<rosparam file="$(find my_robot)/param/common.yaml" command="load" ns="global_costmap"/>'
        '<rosparam file="$(find my_robot)/param/common.yaml" command="load" ns="local_costmap"/>'
        "<rosparam ns='local_costmap'>{layer: {y: 2}, width: 4}</rosparam>"
        '<rosparam param="footprint">[[1, 2]]</rosparam>'
        '<param name="local_costmap/width" value="5.0"/>'
    )
    assert tree(launch(package / "launch", body)) == {
        "global_costmap": {"width": 3, "layer": {"x": 1}},
        "local_costmap": {"width": 5.0, "layer": {"x": 1, "y": 2}},
        "footprint": [[1, 2]],
    }


def test_arguments_conditions_groups_and_includes(tmp_path: Path) -> None:
    launch(
        tmp_path / "pkg" / "launch",
        '<arg name="model"/><arg name="speed" default="0.5"/>'
        + NODE.format(
            '<param name="model" value="$(arg model)"/><param name="speed" value="$(arg speed)"/>'
            '<param name="x" value="1" if="$(arg model)"/>'.replace('if="$(arg model)"', 'if="true"')
            + '<param name="y" value="1" unless="1"/>'
        ),
        "inner.launch",
    )
    outer = launch(
        tmp_path / "pkg" / "launch",
        '<arg name="robot" default="burger"/><group ns="robot1">'
        '<include file="$(find pkg)/launch/inner.launch"><arg name="model" value="$(arg robot)"/></include></group>'
        '<include file="$(find other)/launch/none.launch"/>',
        "outer.launch",
    )
    assert tree(outer) == {"model": "burger", "speed": 0.5, "x": 1}
    assert tree(outer, "robot:=waffle") == {"model": "waffle", "speed": 0.5, "x": 1}
    inner = str(tmp_path / "pkg/launch/inner.launch")
    assert "model:=VALUE" in errors(inner)[0]
    assert tree(inner, "model:=a", "speed:=2")["speed"] == 2


def test_substitution_in_yaml_and_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROBOT_FRAME", "base")
    (tmp_path / "a.yaml").write_text("frame: $(arg prefix)link\n")
    body = '<arg name="prefix" default="r_"/>' + NODE.format(
        f'<rosparam file="{tmp_path}/a.yaml" subst_value="true"/><param name="b" value="$(env ROBOT_FRAME)"/>'
        '<param name="c" value="$(optenv NOT_SET_ANYWHERE fallback)"/>'
    )
    assert tree(launch(tmp_path, body)) == {"frame": "r_link", "b": "base", "c": "fallback"}


def test_locations_are_those_of_the_launch_file_and_of_the_yaml(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("x: 1\ny: 2\n")
    path = launch(tmp_path, NODE.format('\n<rosparam file="$(dirname)/a.yaml"/>\n  <param name="x" value="3"/>\n'))
    root = read_sources([path]).root
    x, y = root.leaf("x"), root.leaf("y")
    assert x is not None and y is not None
    assert (x.at.file, x.at.line, x.at.column) == (path, 3, 3)
    assert (Path(y.at.file).name, y.at.line) == ("a.yaml", 2)


def test_remappings_and_several_nodes_are_reported(tmp_path: Path) -> None:
    two = NODE.format('<remap from="scan" to="front/scan"/><param name="a" value="1"/>') + NODE.format("")
    read = read_sources([launch(tmp_path, two)])
    assert {(f.severity, f.rule) for f in read.findings} == {("info", "remap"), ("warning", "launch")}
    assert read.root.as_dict() == {"a": 1}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ("", "starts no move_base node; name the launch file"),
        (
            '<include file="$(find nowhere)/move_base.launch"/>',
            "may start it: $(find nowhere)/move_base.launch (the package nowhere is not here); put that in place, or name",
        ),
        (NODE.format('<rosparam file="$(find nowhere)/x.yaml"/>'), "not found"),
        (NODE.format('<param name="a"/>'), "value"),
        (NODE.format('<param name="a" type="int" value="x"/>'), "type int"),
        (
            NODE.format('<param name="a" value="$(eval open(1))"/>'),
            "a value of <param>: $(eval open(1)) cannot be evaluated: the function `open` is not known here; write its value",
        ),
        (NODE.format('<param name="a" value="$(env NOT_SET_ANYWHERE)"/>'), "not set"),
        (NODE.format('<param name="a" value="1" if="maybe"/>'), "neither true nor false"),
        (NODE.format("<rosparam>[1, 2]</rosparam>"), "param="),
        (NODE.format("<rosparam>a: [1</rosparam>"), "invalid YAML"),
    ],
)
def test_launch_files_that_cannot_be_used(tmp_path: Path, body: str, words: str) -> None:
    assert words in " ".join(errors(launch(tmp_path, body)))


def test_xml_that_cannot_be_read(tmp_path: Path) -> None:
    path = tmp_path / "a.launch"
    for text, words in (
        ("<launch>", "invalid XML"),
        ("", "invalid XML"),
        ("<robot/>", "<launch>"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><launch>&a;</launch>', "document type"),
        ("<launch>" + "<group>" * 100, "levels deep"),
    ):
        path.write_text(text)
        (message,) = errors(str(path))
        assert words in message


def test_cyclic_includes_end_with_an_error(tmp_path: Path) -> None:
    path = launch(tmp_path, '<include file="$(dirname)/robot.launch"/>')
    assert any("include each other" in m for m in errors(path))


def test_launch_arguments_are_distinguished_from_files() -> None:
    assert launch_argument("model:=burger") == ("model", "burger")
    assert launch_argument("x:=") == ("x", "")
    assert launch_argument("C:/params") is None
    assert launch_argument("params/file.yaml@ns") is None


def test_a_published_launch_file_and_its_folder_agree(data_dir: Path) -> None:
    robot = data_dir / "params/turtlebot2"
    by_folder = read_sources([str(robot / "param")]).root.as_dict()
    by_launch = read_sources(
        [str(robot / "_launch/turtlebot_navigation__launch__includes__move_base.launch.xml")]
    ).root.as_dict()
    # the launch file sets the frames itself
    for costmap in ("global_costmap", "local_costmap"):
        for key in ("global_frame", "robot_base_frame"):
            assert by_launch[costmap].pop(key) == by_folder[costmap].pop(key).strip("/")
    assert by_launch == by_folder


def test_dirname_of_a_launch_file_given_by_a_relative_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    launch(tmp_path / "robot" / "launch", NODE.format('<rosparam file="$(dirname)/../a.yaml"/>'))
    (tmp_path / "robot" / "a.yaml").write_text("x: 3\n")
    monkeypatch.chdir(tmp_path)
    assert tree("robot/launch/robot.launch") == {"x": 3}


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 1", 2),
        ("arg('speed') * 2", 1.0),
        ("speed > 0.4 and not slow", True),
        ("arg('model') == 'waffle'", False),
        ("model in ['burger', 'waffle']", True),
        ("'fast' if speed &gt; 1 else 'slow_' + model.upper()", "slow_BURGER"),
        ("round(sin(pi / 2), 3)", 1.0),
        ("round(2.6) + round(1234, -2)", 1203),
        ("model.replace('b', 't').split('g')[0]", "tur"),
        ("env('ROBOT_FRAME') + '_' + optenv('NOT_SET_ANYWHERE', 'x')", "base_x"),
    ],
)
def test_expressions_are_evaluated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, expression: str, value: Any
) -> None:
    monkeypatch.setenv("ROBOT_FRAME", "base")
    body = (
        '<arg name="model" default="burger"/><arg name="speed" default="0.5"/><arg name="slow" default="false"/>'
        + NODE.format(f'<param name="a" value="$(eval {expression})"/>')
    )
    assert tree(launch(tmp_path, body)) == {"a": value}


@pytest.mark.parametrize(
    "expression",
    [
        "().__class__.__bases__",
        "__import__('os').system('true')",
        "[x for x in 'a']",
        "9 ** 9 ** 9",
        "2 ** 100000",
        "'a' * 10 ** 9",
        "(" * 300 + ")" * 300,
        "lambda: 1",
        "'%1000000d' % 1",
        "1 / 0",
        "absent",
        "1 +",
        "'a' + 1",
        "1e999 // 1 % 0",
        "int('9' * 2000)",
        "[[[[[[1] * 40] * 40] * 40] * 40] * 40] * 40",
        "['a' * 1000] * 3",
        "round(10 ** 30, -10 ** 9)",
        "('a' * 50).replace('a', 'b' * 50)",
    ],
)
def test_expressions_that_are_not_evaluated(tmp_path: Path, expression: str) -> None:
    body = NODE.format(f'<param name="a" value="$(eval {expression})"/>')
    [message] = errors(launch(tmp_path, body))
    assert "cannot be evaluated" in message or "not supported" in message


def test_an_expression_finds_a_package_and_names_what_to_pass(tmp_path: Path) -> None:
    expression = "$(eval find('my_robot') + '/param/' + arg('model') + '.yaml')"
    package = tmp_path / "my_robot"
    (package / "param").mkdir(parents=True)
    (package / "param" / "burger.yaml").write_text("x: 3\n")
    body = f'<arg name="model"/><arg name="file" default="{expression}"/>'
    path = launch(package / "launch", body + NODE.format('<rosparam file="$(arg file)"/>'))
    assert tree(path, "model:=burger") == {"x": 3}
    first, *_ = errors(path)
    assert first.startswith(f"the default of the argument file: {expression} cannot be evaluated: the argument model")
    assert first.endswith("add model:=VALUE after the launch file")


def package(folder: Path, name: str = "") -> Path:
    """Make a package."""
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name>{name or folder.name}</name></package>")
    return folder


def config(folder: Path, value: int) -> None:
    (folder / "config").mkdir(parents=True, exist_ok=True)
    (folder / "config" / "costmap.yaml").write_text(f"x: {value}\n")


def test_find_takes_no_namesake_of_another_package(tmp_path: Path) -> None:
    """`folder/rest` near the launch file and `package/rest` of a folder that is no package are other files."""
    repository = tmp_path / "youbot"
    repository.mkdir()
    (repository / "README.md").write_text("")
    local = package(repository / "meta" / "youbot_local")
    config(local, 1)
    config(repository, 2)
    config(repository / "meta", 3)
    config(local / "youbot_common", 4)  # a folder of another package
    path = launch(local / "launch", NODE.format('<rosparam file="$(find youbot_common)/config/costmap.yaml"/>'))
    [message] = errors(path)
    assert message.startswith(
        "$(find youbot_common)/config/costmap.yaml was not found: the package youbot_common is not"
    )
    # by its manifest, whatever its folder is called; elsewhere in the repository
    config(package(repository / "common" / "config_of_youbot", "youbot_common"), 5)
    assert tree(path) == {"x": 5}
    # packages of another robot that is stored next to this one are not its own
    config(package(tmp_path / "other_robot" / "absent"), 7)
    body = NODE.format('<rosparam file="$(find absent)/config/costmap.yaml"/>')
    assert "absent is not here" in errors(launch(local / "launch", body, "b.launch"))[0]
    # twice: neither is taken
    config(package(repository / "common" / "copy", "youbot_common"), 6)
    [message] = errors(path)
    assert "exists twice" in message


def test_a_name_in_a_comment_of_a_manifest_names_no_package(tmp_path: Path) -> None:
    local = package(tmp_path / "local")
    config(package(tmp_path / "other"), 1)
    (tmp_path / "other" / "package.xml").write_text(
        "<package><!-- <name>common</name>\n --><name>other</name></package>"
    )
    path = launch(local / "launch", NODE.format('<rosparam file="$(find {})/config/costmap.yaml"/>').format("common"))
    [message] = errors(path)
    assert "the package common is not here" in message
    assert tree(launch(local / "launch", NODE.format('<rosparam file="$(find other)/config/costmap.yaml"/>'))) == {
        "x": 1
    }


def test_a_package_of_that_name_without_the_file_is_an_error(tmp_path: Path) -> None:
    local = package(tmp_path / "local")
    config(local, 1)
    package(tmp_path / "common")
    path = launch(local / "launch", NODE.format('<rosparam file="$(find common)/config/costmap.yaml"/>'))
    [message] = errors(path)
    assert "has no config/costmap.yaml" in message


def test_folders_without_manifest_are_packages_by_their_name_only(tmp_path: Path) -> None:
    config(tmp_path / "robot" / "nav", 1)
    config(tmp_path / "robot" / "other", 2)
    body = NODE.format('<rosparam file="$(find {})/config/costmap.yaml"/>')
    assert tree(launch(tmp_path / "robot/nav/launch", body.format("nav"))) == {"x": 1}
    assert tree(launch(tmp_path / "robot/nav/launch", body.format("other"), "b.launch")) == {"x": 2}
    assert "not here" in errors(launch(tmp_path / "robot/nav/launch", body.format("absent"), "c.launch"))[0]


def test_an_export_stands_for_its_own_package_only(tmp_path: Path) -> None:
    robot = tmp_path / "robot"
    robot.mkdir()
    (robot / "costmap.yaml").write_text("x: 1\n")
    body = NODE.format('<rosparam file="$(find {})/config/costmap.yaml"/>')
    assert tree(launch(robot / "_launch", body.format("nav"), "nav__launch__a.launch")) == {"x": 1}
    assert tree(launch(robot / "_launch", body.format("nav"), "launch__a.launch")) == {"x": 1}
    assert "not here" in errors(launch(robot / "_launch", body.format("common"), "nav__launch__b.launch"))[0]
    two = body.format("nav") + '<include file="$(find common)/launch/x.launch"/>'
    assert "not here" in errors(launch(robot / "_launch", two, "launch__b.launch"))[0]
    # a folder of the path that exists was not left out by the export
    (robot / "config").mkdir()
    assert "not here" not in errors(launch(robot / "_launch", body.format("nav"), "nav__launch__c.launch"))[0]


def test_xacro_command_lines_are_named_with_their_file(tmp_path: Path) -> None:
    nav, description = package(tmp_path / "nav"), package(tmp_path / "description")
    (description / "robot.urdf.xacro").write_text("<robot/>")
    command = "$(find xacro)/xacro --inorder '$(find {})/robot.urdf.xacro' laser:=true"
    for name, words in (("description", "the simulated sensors are taken from"), ("absent", "absent is not here")):
        body = f'<param name="robot_description" command="{command.format(name)}"/>' + NODE.format("")
        read = read_sources([launch(nav / "launch", body.replace("{}", name))])
        [found] = [f for f in read.findings if "robot_description" in f.message]
        assert found.severity == "info" and words in found.message


def test_a_folder_that_only_its_launch_file_can_load(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    for name in ("local_costmap_a", "local_costmap_b"):  # ambiguous by name
        (folder / "param").mkdir(parents=True, exist_ok=True)
        (folder / "param" / f"{name}.yaml").write_text(f"local_costmap: {{global_frame: {name}}}\n")
    launch(folder / "launch", NODE.format('<rosparam file="$(dirname)/../param/local_costmap_b.yaml"/>'))
    launch(folder / "launch", '<node pkg="amcl" type="amcl" name="amcl"/>', "amcl.launch")
    assert tree(str(folder)) == {"local_costmap": {"global_frame": "local_costmap_b"}}
    # several: the advice can be followed
    launch(
        folder / "launch", NODE.format('<rosparam file="$(dirname)/../param/local_costmap_a.yaml"/>'), "other.launch"
    )
    [message] = errors(str(folder))
    named = message.rpartition(": ")[2].split(" or ")
    assert [tree(name)["local_costmap"]["global_frame"] for name in named] == ["local_costmap_a", "local_costmap_b"]


def test_a_file_without_a_role_that_holds_what_move_base_needs_is_a_warning(tmp_path: Path) -> None:
    (tmp_path / "move_base_params.yaml").write_text("planner_frequency: 1.0\n")
    (tmp_path / "my_robot.yaml").write_text("a: 1\nfootprint: [[0.1, 0.1], [-0.1, 0.1], [0, -0.1]]\n")
    (tmp_path / "camera.yaml").write_text("a: 1\n")
    left = {Path(f.file).name: f for f in read_sources([str(tmp_path)]).findings if f.rule == "not-loaded"}
    assert {name: f.severity for name, f in left.items()} == {"my_robot.yaml": "warning", "camera.yaml": "info"}
    found = left["my_robot.yaml"]
    assert found.line == 2 and "sets footprint" in found.message
    assert "footprint" in tree(*found.message.rpartition(": ")[2].split())


def test_naming_the_folder_that_is_meant_works(tmp_path: Path) -> None:
    folder = tmp_path / "robot"
    for name in ("map_nav", "odom_nav"):
        for costmap in ("local_costmap", "global_costmap"):
            (folder / name).mkdir(parents=True, exist_ok=True)
            (folder / name / f"{costmap}_params.yaml").write_text(f"{costmap}: {{global_frame: {name}}}\n")
    (folder / "move_base_params.yaml").write_text("planner_frequency: 1.0\n")
    [message] = errors(str(folder))
    for name in message.rpartition(": ")[2].split(" or "):
        made = tree(str(folder), name)
        assert made["planner_frequency"] == 1.0 and made["local_costmap"] == {"global_frame": Path(name).name}


# --- defaults that cannot be filled in --------------------------------------------------------------------------------


def test_a_broken_default_is_an_error_only_if_move_base_needs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NOBODY", raising=False)
    argument = '<arg name="map" default="/home/$(env NOBODY)/map.yaml"/><arg name="above" default="$(arg map)/.."/>'
    other = '<node pkg="map_server" type="map_server" name="map_server" args="$(arg map)"/>'
    file = launch(tmp_path, argument + other + NODE.format(""))
    [unused] = [f for f in read_sources([file]).findings if "NOBODY" in f.message]
    assert unused.severity == "warning" and unused.message.endswith("the parameters of move_base do not")
    # directly, or through another default; one error about the default, not one about a missing value
    for use in ("$(arg map)", "$(arg above)", "$(eval arg('map') + 'x')"):
        inside = f'<param name="base_global_planner" value="{use}"/>'
        file = launch(tmp_path, argument + NODE.format(inside))
        assert errors(file) == ["the environment variable NOBODY is not set; set it or write the value"]


def test_a_robot_description_that_cannot_be_filled_in_is_a_note(tmp_path: Path) -> None:
    arguments = """<arg name="model" default=""/><arg name="arm" default="$(eval arg('model').split('_')[1])"/>"""
    description = '<param name="robot_description" command="xacro $(arg arm).xacro"/>'
    file = launch(tmp_path, arguments + description + NODE.format(""))
    assert errors(file) == []
    findings = read_sources([file]).findings
    assert "robot_description is not made: its command cannot be filled in" in [f.message for f in findings]


def test_a_skipped_group_is_not_a_missing_node(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOBODY", raising=False)
    file = launch(tmp_path, f'<group ns="$(env NOBODY)">{NODE.format("")}</group>')
    assert errors(file) == ["the environment variable NOBODY is not set; set it or write the value"]

"""The package for colcon: what is written, when nothing is, and what a launch file must become; without ROS 2."""

from __future__ import annotations

import ast
import configparser
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml

from navstack.cli.app import run
from navstack.core import InputError, OutputError
from navstack.map_io import load_map, map_path
from navstack.ros2 import advise, install

SOURCES = Path(__file__).parents[2] / "navstack" / "ros2"
LAUNCH_FILES = ("demo", "navigator", "sim")


def _written(folder: Path) -> dict[str, bytes]:
    return {str(file.relative_to(folder)): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.slow
def test_the_package(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A package of ament_python with nodes, launch files, and a configuration of RViz."""
    folder = tmp_path / "a workspace" / "src"
    assert run(["ros2", "install", str(folder)]) == 0
    package = folder / "navstack_ros2"
    printed = capfd.readouterr().out.splitlines()
    assert printed == [
        str(package),
        f"cd {folder.parent} && colcon build && source install/setup.bash",
        "ros2 launch navstack_ros2 demo.launch.py",
    ]
    manifest = ElementTree.parse(package / "package.xml").getroot()
    assert manifest.get("format") == "3" and manifest.findtext("name") == "navstack_ros2"
    assert manifest.findtext("export/build_type") == "ament_python"
    assert (package / "resource" / "navstack_ros2").read_bytes() == b""
    setup = configparser.ConfigParser()
    setup.read(package / "setup.cfg")
    assert setup["install"]["install_scripts"] == "$base/lib/navstack_ros2"
    for file in package.rglob("*.py"):
        compile(file.read_text(), str(file), "exec")
    assert sorted(file.name for file in (package / "launch").iterdir()) == sorted(
        f"{name}.launch.{kind}" for name in LAUNCH_FILES for kind in ("py", "xml")
    )
    for name in LAUNCH_FILES:
        assert ElementTree.parse(package / "launch" / f"{name}.launch.xml").getroot().tag == "launch"
    assert not [name for name, content in _written(package).items() if re.search(rb"@[A-Z]+@", content)]


@pytest.mark.slow
def test_setup_installs_every_file(tmp_path: Path) -> None:
    """`setup.py` names the folders, and its executables start navstack with the arguments that launch gives them."""
    package = install(tmp_path, ["turtlebot"], "office", force=False)
    code = "import setuptools, runpy, json\nsetuptools.setup = lambda **k: print(json.dumps(k))\nrunpy.run_path('setup.py')"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=package, capture_output=True, text=True, timeout=120, check=True
    )
    said = yaml.safe_load(done.stdout)
    installed = {file for _, files in said["data_files"] for file in files}
    for name in _written(package):
        assert name in installed or name.startswith(("navstack_ros2/", "setup.")), name
    assert said["entry_points"]["console_scripts"] == [
        "navigator = navstack_ros2.nodes:navigator",
        "sim = navstack_ros2.nodes:sim",
    ]
    code = "from navstack_ros2 import nodes; nodes.sim()"
    paths = os.pathsep.join((str(package), str(SOURCES.parents[1])))
    environment = {**os.environ, "PYTHONPATH": paths}
    command = [sys.executable, "-c", code, "--help"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
    assert "simulated robot as a node" in done.stdout


def test_topics_of_rviz_are_those_of_the_nodes(tmp_path: Path) -> None:
    """Each topic of RViz is one that the navigator or the simulated robot names in its code."""
    package = install(tmp_path, ["turtlebot"], "office", force=False)
    view = yaml.safe_load((package / "rviz" / "navstack.rviz").read_text())["Visualization Manager"]
    shown = [item["Topic"]["Value"] for item in (*view["Displays"], *view["Tools"]) if "Topic" in item]
    assert {"map", "scan", "plan", "local_plan", "global_costmap/costmap", "goal_pose"} <= set(shown)
    named: set[str] = set()
    for file in SOURCES.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                named.add(node.value.rpartition("/")[2])
    sensors = {"scan"}  # named by the parameters
    for topic in shown:
        assert topic.rpartition("/")[2] in named | sensors, topic


def test_files_of_the_user(tmp_path: Path) -> None:
    """Parameters and map are copied into the package, and the launch files name them there."""
    params, image = tmp_path / "my_robot.yaml", tmp_path / "images" / "floor.png"
    params.write_text("{}\n")
    image.parent.mkdir()
    original = map_path("office")
    content: dict[str, Any] = yaml.safe_load(original.read_text())
    image.write_bytes((original.parent / content["image"]).read_bytes())
    (tmp_path / "floor.yaml").write_text(yaml.safe_dump({**content, "image": "images/floor.png"}))
    package = install(tmp_path / "src", [str(params), "turtlebot"], str(tmp_path / "floor.yaml"), force=False)
    assert (package / "config" / "my_robot.yaml").read_text() == "{}\n"
    assert (load_map(package / "maps" / "floor.yaml").data == load_map("office").data).all()
    xml = ElementTree.parse(package / "launch" / "sim.launch.xml").getroot()
    defaults = {item.get("name"): item.get("default") for item in xml.iter("arg")}
    share = "$(find-pkg-share navstack_ros2)"
    assert defaults["map"] == f"{share}/maps/floor.yaml"
    assert defaults["params"] == f"{share}/config/my_robot.yaml --params turtlebot"
    assert "{SHARE}/maps/floor.yaml" in (package / "launch" / "sim.launch.py").read_text()


def test_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What navstack did not write stays; an error leaves the package of before."""
    foreign = tmp_path / "foreign" / "navstack_ros2"
    foreign.mkdir(parents=True)
    with pytest.raises(InputError, match="was not written by navstack"):
        install(foreign.parent, ["turtlebot"], "office", force=True)
    package = install(tmp_path, ["turtlebot"], "office", force=False)
    (package / "mine.txt").touch()
    with pytest.raises(InputError, match="replace it with --force"):
        install(tmp_path, ["turtlebot"], "office", force=False)
    before = _written(package)
    real = Path.rename

    def fails(self: Path, target: Path) -> Path:
        if self.parent.name.startswith(".navstack"):
            raise OSError(28, "No space left on device", str(target))
        return real(self, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "rename", fails)
        with pytest.raises(OutputError, match="No space left on device"):
            install(tmp_path, ["turtlebot"], "office", force=True)
    assert _written(package) == before
    install(tmp_path, ["turtlebot"], "office", force=True)
    assert "mine.txt" not in _written(package)
    assert not list(tmp_path.glob(".navstack*"))


PYTHON = """\
from launch_ros.actions import LoadComposableNodes, Node
from launch_ros.descriptions import ComposableNode
nodes = [
    Node(package='nav2_controller', executable='controller_server', remappings=[('cmd_vel', 'cmd_vel_nav')]),
    Node(package='nav2_planner', executable='planner_server'),
    Node(package='robot_state_publisher', executable='robot_state_publisher'),
    Node(package='nav2_lifecycle_manager', executable='lifecycle_manager'),
    ComposableNode(package='nav2_bt_navigator', plugin='nav2_bt_navigator::BtNavigator'),
]
"""
XML = """\
<launch>
  <group>
    <node pkg="nav2_planner" exec="planner_server"/>
  </group>
  <node pkg="nav2_amcl" exec="amcl"/>
</launch>
"""


def test_advice(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The first server becomes the navigator, the others go; what the navigator does not replace has a note."""
    file, xml = tmp_path / "navigation_launch.py", tmp_path / "navigation.launch.xml"
    file.write_text(PYTHON)
    xml.write_text(XML)
    assert run(["ros2", "install", "--launch", str(file), "--launch", str(xml)]) == 0
    lines = capfd.readouterr().out.splitlines()
    new = "Node(package='navstack_ros2', executable='navigator', name='navigator')"
    assert lines[0].startswith(
        f"{file}:4:5: Node(package='nav2_controller', executable='controller_server') -> {new}; "
    )
    assert lines[1] == (
        f"{file}:5:5: Node(package='nav2_planner', executable='planner_server') -> nothing; remove it, the navigator "
        "stands in for planner_server too"
    )
    assert lines[2].startswith(f"{file}:7:5: note: ") and "autostart false" in lines[2]
    assert lines[3].startswith(f"{file}:8:5: ComposableNode(") and f"-> {new}" in lines[3]
    assert lines[4].startswith(
        f'{xml}:3:5: pkg="nav2_planner" exec="planner_server" -> pkg="navstack_ros2" exec="navigator"'
    )
    assert lines[5].startswith(f"{xml}:5:3: note: ")
    assert len(lines) == 6


def test_wrong_arguments(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Nothing is written when an argument is wrong."""
    broken = tmp_path / "broken.launch.py"
    broken.write_text("nodes = [\nNode(")
    with pytest.raises(InputError, match=r"broken.launch.py:2"):
        advise(broken)
    out = tmp_path / "out"
    for wrong in (
        [],
        [str(out), "--launch", str(broken)],
        [str(out), "--launch", str(tmp_path / "none.launch.py")],
        [str(out), "--params", str(tmp_path / "none.yaml")],
        [str(out), "--map", str(tmp_path / "none.yaml")],
    ):
        assert run(["ros2", "install", *wrong]) == 2
        assert "Traceback" not in capfd.readouterr().err
    assert not out.exists()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["sim", "navigator"])
def test_without_rclpy(command: str) -> None:
    """This interpreter has no rclpy."""
    done = subprocess.run(
        [sys.executable, "-m", "navstack", "ros2", command], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 2
    assert "source ROS 2 first" in done.stderr and "Traceback" not in done.stderr

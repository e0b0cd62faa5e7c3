"""The packages for roslaunch: what is written, when nothing is, and what a launch file must become."""

from __future__ import annotations

import stat
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from navstack.cli.app import run
from navstack.core import InputError, OutputError
from navstack.ros1 import packages
from navstack.ros1.launch_advice import advise
from tests.conftest import data_files
from tests.ros1.conftest import PYTHON, WANTED, missing

PACKAGES = (
    "amcl",
    "costmap_2d",
    "fake_localization",
    "gmapping",
    "handsfree_msgs",
    "map_server",
    "move_base",
    "navstack_ros1",
    "tf",
)


@pytest.fixture
def with_ros() -> None:
    absent = missing()
    if absent:
        message = f"no ROS 1 ({absent} missing): install Debian's packages with tools/install_ros1.sh"
        pytest.fail(message) if WANTED else pytest.skip(message)


def _names(folder: Path) -> list[str]:
    return sorted(file.name for file in folder.iterdir())


def _ros(folder: Path, *command: str) -> str:
    environment = {
        "PATH": "/usr/bin:/bin",
        "ROS_PACKAGE_PATH": str(folder),
        "HOME": str(folder),
        "ROS_HOME": str(folder / ".ros"),
    }
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


CHECK = """
import roslib, rospkg, roslib.packages, roslaunch, sys
pack = rospkg.RosPack()
for name in ("navstack_ros1", "move_base", "map_server", "amcl", "fake_localization", "handsfree_msgs", "costmap_2d"):
    pack.get_manifest(name)
nodes = (("navstack_ros1", "sim"), ("navstack_ros1", "move_base"), ("move_base", "move_base"), ("map_server", "map_server"),
         ("navstack_ros1", "amcl"), ("amcl", "amcl"), ("fake_localization", "fake_localization"),
         ("gmapping", "slam_gmapping"))
for package, node in nodes:
    found, = roslib.packages.find_node(package, node)
    assert found.endswith("/scripts/" + node), found
roslib.load_manifest("handsfree_msgs")
from handsfree_msgs.srv import SpecialMove, SpecialTurn
assert SpecialMove._md5sum == "66f2f4fdee219611a302e48371c65074" and SpecialTurn._md5sum == "73c6e8bc92a2aaf25662afbf9779642b"
roslib.load_manifest("costmap_2d")
from costmap_2d.msg import VoxelGrid
assert VoxelGrid._md5sum == "48a040827e1322073d78ece5a497029c"
import os
launch = os.path.join(pack.get_path("navstack_ros1"), "launch")
for name in sorted(os.listdir(launch)):
    given = ["robot:=r", "start:=0,0"] if name == "robot.launch" else []
    config = roslaunch.config.load_config_default([(os.path.join(launch, name), given)], 11311)
    assert config.nodes, name
    assert not config.config_errors, config.config_errors
print("fine")
"""


@pytest.mark.usefixtures("with_ros")
def test_installed_packages(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Debian's rospkg, roslib and roslaunch find and read all of it; a second time needs --force."""
    folder = tmp_path / "a folder" / "ros"
    assert run(["ros1", "install", str(folder)]) == 0
    printed = capfd.readouterr().out
    assert "export ROS_PACKAGE_PATH=" in printed and "roslaunch navstack_ros1 demo.launch" in printed
    assert _names(folder) == list(PACKAGES)
    assert _ros(folder, PYTHON, "-c", CHECK).strip().endswith("fine")
    scripts = folder / "navstack_ros1" / "scripts"
    assert _names(scripts) == sorted(packages.NODES)
    assert all(stat.S_IMODE(file.stat().st_mode) == 0o755 for file in scripts.iterdir())
    (folder / "navstack_ros1" / "mine.txt").touch()
    assert run(["ros1", "install", str(folder)]) == 2
    assert "navstack_ros1 exists; replace it with --force" in " ".join(capfd.readouterr().err.split())
    assert (folder / "navstack_ros1" / "mine.txt").exists()
    assert run(["ros1", "install", str(folder), "--force", "--no-drop-in"]) == 0
    assert not (folder / "navstack_ros1" / "mine.txt").exists()
    assert _names(folder) == list(PACKAGES)


@pytest.mark.usefixtures("with_ros")
def test_nothing_is_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    foreign = tmp_path / "foreign"
    (foreign / "move_base").mkdir(parents=True)
    (foreign / "move_base" / "package.xml").write_text("<package/>")
    with pytest.raises(InputError, match="was not written by navstack"):
        packages.install(foreign, force=True, drop_in=True)
    assert _names(foreign) == ["move_base"]

    folder = tmp_path / "ros"
    packages.install(folder, force=False, drop_in=True)
    before = {file: file.stat().st_ino for file in folder.rglob("*")}
    real = Path.rename

    def fails(self: Path, target: Path) -> Path:
        if target == folder / "move_base" and self.parent.name.startswith(".navstack"):
            raise OSError(28, "No space left on device", str(target))
        return real(self, target)

    monkeypatch.setattr(Path, "rename", fails)
    with pytest.raises(OutputError, match="No space left on device"):
        packages.install(folder, force=True, drop_in=True)
    assert {file: file.stat().st_ino for file in folder.rglob("*")} == before


def test_scripts_and_manifests() -> None:
    text = packages.script("sim", "/home/a b/python", "/src/nav")
    assert text.splitlines()[-1] == "exec '/home/a b/python' -m navstack ros1 sim \"$@\""
    assert "PYTHONPATH=/src/nav${PYTHONPATH:+:$PYTHONPATH}" in text
    assert "PYTHONPATH" not in packages.script("sim", "/usr/bin/python3", "")
    root = ElementTree.fromstring(packages.package_xml("navstack_ros1", "d"))
    assert root.findtext("name") == "navstack_ros1" and root.get("format") == "2"


LAUNCH = """\
<launch>
  <arg name="model" default="a"/>
  <arg name="planner" value="$(arg model)_base"/>
  <include file="$(find somewhere)/launch/missing.launch"/>
  <group ns="one">
    <node pkg="move_base" type="$(arg planner)" name="nav" launch-prefix="gdb"/>
  </group>
    <node pkg="map_server" type="map_server" name="map" args="m.pgm 0.1"/>
  <node pkg="amcl" type="amcl" name="amcl"/><node pkg="gazebo_ros" type="spawn_model" name="spawn"/>
  <node pkg="rviz" type="rviz" name="rviz"/>
  <include file="inner.launch"><arg name="what" value="$(arg model)"/></include>
</launch>
"""
INNER = '<launch>\n <arg name="what" default="none"/>\n <node pkg="$(arg what)_base" type="move_base" name="inner"/>\n</launch>\n'


def test_advice(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "robot.launch"
    file.write_text(LAUNCH)
    (tmp_path / "inner.launch").write_text(INNER)
    assert run(["ros1", "install", "--launch", str(file), "model:=move"]) == 0
    lines = capfd.readouterr().out.splitlines()
    assert lines[0].startswith(f"{file}:4:3: include: note: ") and "not found" in lines[0]
    new = 'pkg="navstack_ros1" type="move_base"'
    assert lines[1] == (
        f'{file}:6:5: nav: pkg="move_base" type="move_base" -> {new}; remove its launch-prefix if it is for C++ programs '
        "(gdb, valgrind)"
    )
    assert lines[2].startswith(
        f'{file}:8:5: map: pkg="map_server" type="map_server" -> pkg="navstack_ros1" type="map_server"'
    )
    assert (
        lines[3].startswith(f'{file}:9:3: amcl: pkg="amcl" type="amcl" -> pkg="navstack_ros1" type="amcl"; ')
        and 'type="sim"' in lines[4]
    )
    assert lines[4].startswith(f"{file}:9:45: spawn: note: ")
    assert lines[5] == f'{tmp_path / "inner.launch"}:3:2: inner: pkg="move_base" type="move_base" -> {new}'
    assert lines[-1].startswith(f"navstack check {file}")
    assert len(lines) == 8


def test_wrong_arguments(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.launch"
    broken.write_text("<launch>\n<node")
    assert run(["ros1", "install", str(tmp_path / "out"), "--launch", str(broken)]) == 2
    assert "broken.launch:2:" in "".join(capfd.readouterr().err.split("\n"))
    assert not (tmp_path / "out").exists()
    assert run(["ros1", "install"]) == 2
    assert run(["ros1", "install", "--launch", str(tmp_path / "none.launch")]) == 2


def test_published_launch_files() -> None:
    """Every file with a move_base node names it, at its line."""
    files = data_files("params/*/_launch/*move_base*.launch*")
    if not files:
        pytest.skip("no launch files of robots: set NAVSTACK_DATA to their folder")
    for file in files:
        found = [item for item in advise(file, {}) if item.after == 'pkg="navstack_ros1" type="move_base"']
        wanted = [n for n, line in enumerate(file.read_text().splitlines(), 1) if '<node pkg="move_base"' in line]
        assert [item.at.line for item in found if item.at.file == str(file)] == wanted, file

"""Writes packages for roslaunch, all or none of them: navstack_ros1, those in place of the originals, and messages."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import navstack
from navstack import __version__
from navstack.core import resolved
from navstack.ros1 import ros
from navstack.ros_node import write_packages

# --- the files of the packages that `navstack ros1 install` writes ----------------------------------------------------


NODES: Final[Mapping[str, str]] = {
    "move_base": "move_base",
    "sim": "sim",
    "map_server": "map_server",
    "map_saver": "map_saver",
    "amcl": "amcl",
    "fake_localization": "fake_localization",
    "slam_gmapping": "mapping",
    "linear_move": "linear_move",
    "linear_move_server": "linear_move --service",
    "radian_turn": "radian_turn",
    "radian_turn_server": "radian_turn --service",
    "teleop": "teleop",
    "initial_pose": "initial_pose",
    "tour": "tour",
    "trajectory": "trajectory",
    "static_transform_publisher": "static_transform_publisher",
}
"""Name of a node script -> command of `navstack ros1`."""
MARKER: Final = "written by navstack ros1 install"
"""A package.xml with these words may be replaced."""

_DEPENDS: Final = (
    "rospy",
    "actionlib",
    "actionlib_msgs",
    "diagnostic_msgs",
    "dynamic_reconfigure",
    "geometry_msgs",
    "map_msgs",
    "move_base_msgs",
    "nav_msgs",
    "rosgraph_msgs",
    "sensor_msgs",
    "std_srvs",
    "tf2_msgs",
    "trajectory_msgs",
)


def package_xml(name: str, description: str, depends: tuple[str, ...] = _DEPENDS) -> str:
    """Return a package.xml of format 2."""
    lines = "".join(f"  <exec_depend>{package}</exec_depend>\n" for package in depends)
    return (
        '<?xml version="1.0"?>\n'
        f"<!-- {MARKER} {__version__} -->\n"
        '<package format="2">\n'
        f"  <name>{name}</name>\n"
        f"  <version>{__version__}</version>\n"
        f"  <description>{description}</description>\n"
        '  <maintainer email="navstack@example.org">navstack</maintainer>\n'
        "  <license>BSD-3-Clause</license>\n"
        "  <buildtool_depend>catkin</buildtool_depend>\n"
        f"{lines}"
        "</package>\n"
    )


def cmake(name: str, folders: tuple[str, ...]) -> str:
    """Return a CMakeLists.txt, for those who put the folder into a catkin workspace."""
    text = f"cmake_minimum_required(VERSION 3.0.2)\nproject({name})\nfind_package(catkin REQUIRED)\ncatkin_package()\n"
    for folder in folders:
        if folder == "scripts":
            text += "install(DIRECTORY scripts/ DESTINATION ${CATKIN_PACKAGE_BIN_DESTINATION} USE_SOURCE_PERMISSIONS)\n"
        else:
            text += f"install(DIRECTORY {folder} DESTINATION ${{CATKIN_PACKAGE_SHARE_DESTINATION}})\n"
    return text


def script(command: str, python: str, path: str) -> str:
    """Return a node script: it runs a command of `navstack ros1` with the Python that has navstack.

    `path` is a folder to put on the search path of Python, "" for an installed navstack.
    """
    search = f"PYTHONPATH={shlex.quote(path)}${{PYTHONPATH:+:$PYTHONPATH}}\nexport PYTHONPATH\n" if path else ""
    return f'#!/bin/sh\n# {MARKER}\n{search}exec {shlex.quote(python)} -m navstack ros1 {command} "$@"\n'


def data_files() -> dict[str, str]:
    """Return the launch files and the configuration of RViz, by their paths in the package."""
    root = Path(__file__).parent / "package"
    return {str(file.relative_to(root)): file.read_text(encoding="utf-8") for file in sorted(root.glob("*/*"))}


DROP_IN: Final = {
    "move_base": ("move_base",),
    "map_server": ("map_server", "map_saver"),
    "amcl": ("amcl",),
    "fake_localization": ("fake_localization",),
    "gmapping": ("slam_gmapping",),
    "tf": ("static_transform_publisher",),
}
"""Packages with the names of the original ones, and their nodes."""


def packages(*, drop_in: bool) -> dict[str, dict[str, str]]:
    """Return the files of each package by their paths; those below scripts/ are executable.

    Raises NotSupportedError without ROS.
    """
    python, path = sys.executable, _search_path()
    scripts = {f"scripts/{name}": script(command, python, path) for name, command in NODES.items()}
    description = "navstack's nodes: move_base, the simulated robot, and what tutorials rely on"
    made = {
        "navstack_ros1": {
            "package.xml": package_xml("navstack_ros1", description),
            "CMakeLists.txt": cmake("navstack_ros1", ("launch", "rviz", "scripts")),
            **data_files(),
            **scripts,
        },
        "handsfree_msgs": _messages("handsfree_msgs"),
    }
    if drop_in:
        made["costmap_2d"] = _messages("costmap_2d")
        for package, nodes in DROP_IN.items():
            made[package] = {
                "package.xml": package_xml(package, f"navstack in place of {package}", ("navstack_ros1",)),
                "CMakeLists.txt": cmake(package, ("scripts",)),
                **{f"scripts/{name}": scripts[f"scripts/{name}"] for name in nodes},
            }
    return made


def _messages(package: str) -> dict[str, str]:
    """Return the files of a package of messages or services: definitions, and their code, which roslib finds below src/."""
    names = {name: text for name, text in ros.DEFINITIONS.items() if name.startswith(f"{package}/")}
    listed = ", ".join(name.rpartition("/")[2] for name in names)
    manifest = (
        f"<package>\n  <!-- {MARKER} -->\n  <description>{listed}</description>\n"
        '  <author>navstack</author>\n  <license>BSD-3-Clause</license>\n  <export>\n    <python path="${prefix}/src"/>\n'
        "  </export>\n</package>\n"
    )
    files = {"manifest.xml": manifest, f"src/{package}/__init__.py": ""}
    for name, text in names.items():
        short, kind = name.rpartition("/")[2], "srv" if "/srv/" in name else "msg"
        files[f"{kind}/{short}.{kind}"] = text
        files[f"src/{package}/{kind}/_{short}.py"] = ros.generated_code(name)
        index = f"src/{package}/{kind}/__init__.py"
        files[index] = files.get(index, "") + f"from ._{short} import *\n"
    return files


def _search_path() -> str:
    """Return the folder of navstack if Python finds it by PYTHONPATH only; "" for an installed one."""
    root = resolved(Path(navstack.__file__)).parent.parent
    given = [resolved(Path(part)) for part in os.environ.get("PYTHONPATH", "").split(os.pathsep) if part]
    return str(root) if root in given else ""


def install(folder: Path, *, force: bool, drop_in: bool) -> list[Path]:
    """Write the packages below `folder` and return their folders; see `write_packages`. Raises NotSupportedError without ROS."""
    made = {
        name: {path: text.encode() for path, text in files.items()} for name, files in packages(drop_in=drop_in).items()
    }
    return write_packages(folder, made, MARKER, force=force)

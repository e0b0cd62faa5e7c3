"""The files of the packages that `navstack ros1 install` writes."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from navstack import __version__

NODES: Final[Mapping[str, str]] = {
    "move_base": "move_base",
    "sim": "sim",
    "map_server": "map_server",
    "map_saver": "map_saver",
    "amcl": "amcl",
    "fake_localization": "fake_localization",
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

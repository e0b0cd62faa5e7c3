"""What the nodes of a launch file must become to run navstack in place of move_base and its companions."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from navstack.core import InputError
from navstack.parameters import Element, Location, RejectedLaunchFileError, find_file, read_launch_xml, substitute

PACKAGE: Final = "navstack_ros1"
MAX_FILES: Final = 50

REPLACED: Final = {
    ("move_base", "move_base"): "move_base",
    ("pr2_move_base", "pr2_move_base_node"): "move_base",
    ("map_server", "map_server"): "map_server",
    ("map_server", "map_saver"): "map_saver",
    ("amcl", "amcl"): "amcl",
    ("fake_localization", "fake_localization"): "fake_localization",
    ("gmapping", "slam_gmapping"): "slam_gmapping",
    ("tf", "static_transform_publisher"): "static_transform_publisher",
    ("teleop_twist_keyboard", "teleop_twist_keyboard.py"): "teleop",
}
"""(pkg, type) of a node -> type of the node that takes its place."""

_LOCALIZATION: Final = (
    "navstack's simulated robot publishes map -> odom and amcl_pose itself: start it with _localization:=false, or remove "
    "this node"
)
_SIMULATOR: Final = f'this simulator can give way to pkg="{PACKAGE}" type="sim" args="MAP.yaml --clock" (or keep it)'
XACRO: Final = (
    "roslaunch needs the package xacro for it, which neither Debian nor navstack has: put it on ROS_PACKAGE_PATH, or remove "
    "this line; navigation does not read the result"
)
NOTES: Final = {
    "stage_ros": _SIMULATOR,
    "gazebo_ros": _SIMULATOR,
    "arbotix_python": _SIMULATOR,
    "robot_pose_ekf": "navstack has no such node: keep it on a real robot; the simulated robot publishes odom -> base itself",
    "robot_localization": "navstack has no such node: keep it on a real robot; the simulated robot publishes odom -> base itself",
    "costmap_2d": "navstack has no stand-alone costmap node; the costmaps of move_base are published by move_base",
    "nodelet": "navstack has no nodelets; keep what is no part of navigation",
}
"""Package of a node that is not replaced -> what to do."""


@dataclass(frozen=True, slots=True)
class Advice:
    """What becomes of a node, at its place."""

    at: Location
    node: str
    """Name of the node."""
    before: str
    """Its `pkg` and `type` as written."""
    after: str
    """The same for navstack; empty for a note."""
    note: str = ""
    needs: tuple[str, ...] = ()
    """Packages of ROS that roslaunch needs for it, and that neither Debian nor navstack has."""

    def __str__(self) -> str:
        what = f"{self.before} -> {self.after}" if self.after else f"note: {self.before}"
        return f"{self.at}: {self.node}: {what}" + (f"; {self.note}" if self.note else "")


def advise(launch: Path, arguments: Mapping[str, str]) -> list[Advice]:
    """Return what becomes of the nodes of a launch file and of the files that it includes, in their order.

    `arguments` are those of roslaunch's command line. Nodes in branches that `if` and `unless` exclude are listed too. Raises
    InputError for a file that cannot be read.
    """
    reader = _Reader()
    try:
        reader.read(launch, str(launch), arguments)
    except RejectedLaunchFileError as exc:
        raise InputError(f"{exc.at}: {exc.message}", file=exc.at.file, line=exc.at.line) from exc
    return reader.found


class _Reader:
    def __init__(self) -> None:
        self.found: list[Advice] = []
        self._read: set[Path] = set()

    def read(self, path: Path, shown: str, passed: Mapping[str, str]) -> None:
        """Read a file. Raises RejectedLaunchFileError."""
        if path in self._read or len(self._read) >= MAX_FILES:
            return
        self._read.add(path)
        self._children(read_launch_xml(path, shown), path, shown, passed, {})

    def _children(
        self, element: Element, path: Path, shown: str, passed: Mapping[str, str], arguments: dict[str, str]
    ) -> None:
        for child in element.children:
            if child.tag == "arg":
                _take(child, path, passed, arguments)
            elif child.tag == "group":
                self._children(child, path, shown, passed, dict(arguments))
            elif child.tag == "node":
                self._node(child, path, shown, arguments)
                self._children(child, path, shown, passed, dict(arguments))
            elif child.tag == "param":
                self._command(child, path, shown, arguments)
            elif child.tag == "include":
                self._include(child, path, shown, arguments)

    def _include(self, element: Element, path: Path, shown: str, arguments: dict[str, str]) -> None:
        text = _filled(element.attributes.get("file", ""), path, arguments)
        file = find_file(text, path) if text else None
        at = Location(shown, element.line, element.column)
        if file is None:
            self.found.append(
                Advice(at, "include", f'file="{text}"', "", "it was not found here, so its nodes are not listed")
            )
            return
        inner: dict[str, str] = dict(arguments) if element.attributes.get("pass_all_args") == "true" else {}
        for child in element.children:
            if child.tag == "arg":
                _take(child, path, arguments, inner)
        try:
            self.read(file, str(file), inner)
        except RejectedLaunchFileError as exc:
            self.found.append(Advice(exc.at, "include", f'file="{text}"', "", exc.message))

    def _command(self, element: Element, path: Path, shown: str, arguments: dict[str, str]) -> None:
        """List a parameter that roslaunch makes by xacro, which is no package of Debian."""
        command = _filled(element.attributes.get("command", ""), path, arguments)
        if "xacro" in command:
            at = Location(shown, element.line, element.column)
            name = element.attributes.get("name", "?")
            self.found.append(Advice(at, name, f'command="{command}"', "", XACRO, needs=("xacro",)))

    def _node(self, element: Element, path: Path, shown: str, arguments: dict[str, str]) -> None:
        package, kind = (_filled(element.attributes.get(key, ""), path, arguments) for key in ("pkg", "type"))
        name = _filled(element.attributes.get("name", "?"), path, arguments)
        at = Location(shown, element.line, element.column)
        before = f'pkg="{package}" type="{kind}"'
        replaced = REPLACED.get((package, kind))
        if replaced is not None:
            self.found.append(Advice(at, name, before, f'pkg="{PACKAGE}" type="{replaced}"', _more(replaced, element)))
        elif package in NOTES:
            self.found.append(Advice(at, name, before, "", NOTES[package]))


def _more(replaced: str, element: Element) -> str:
    """Return what else changes."""
    given = element.attributes.get("args", "")
    if replaced == "map_server" and re.search(r"\s[0-9.]+\s*$", given):
        return "args of the old form IMAGE RESOLUTION are read too"
    if replaced in ("amcl", "fake_localization"):
        return _LOCALIZATION
    if element.attributes.get("launch-prefix"):
        return "remove its launch-prefix if it is for C++ programs (gdb, valgrind)"
    return ""


def _take(element: Element, path: Path, passed: Mapping[str, str], arguments: dict[str, str]) -> None:
    """Set the argument of an `<arg>`, if it has a value."""
    name = element.attributes.get("name", "")
    for key in ("value", "default"):
        if key == "default" and name in passed:
            arguments[name] = passed[name]
            return
        if key in element.attributes:
            arguments[name] = _filled(element.attributes[key], path, {**passed, **arguments})
            return


def _filled(text: str, path: Path, arguments: Mapping[str, str]) -> str:
    """Return a text with its substitutions; as written where one has no value."""
    try:
        return substitute(text, arguments, path.parent.absolute())
    except ValueError:
        return text

"""What the nodes of a launch file of ROS 2, such as those of nav2_bringup, must become to run the navigator."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

from navstack.core import InputError
from navstack.parameters import Element, RejectedLaunchFileError, read_launch_xml
from navstack.ros2.packages import PACKAGE

SERVERS: Final = {
    "nav2_bt_navigator": "bt_navigator",
    "nav2_controller": "controller_server",
    "nav2_planner": "planner_server",
    "nav2_behaviors": "behavior_server",
    "nav2_smoother": "smoother_server",
    "nav2_waypoint_follower": "waypoint_follower",
    "nav2_route": "route_server",
    "opennav_docking": "docking_server",
}
"""Packages of Nav2 whose servers the navigator stands in for -> their nodes."""
NOTES: Final = {
    "nav2_lifecycle_manager": (
        "remove it, the navigator activates itself; or keep it with node_names navigator, and give the navigator autostart "
        "false"
    ),
    "nav2_map_server": "keep it on a real robot; navstack's simulated robot has a map server itself",
    "nav2_amcl": "keep it on a real robot; navstack's simulated robot localizes itself (or set its parameter localization false)",
    "nav2_velocity_smoother": "keep it, with the navigator's cmd_vel remapped to its input, or remove it",
    "nav2_collision_monitor": "keep it, with the navigator's cmd_vel remapped to its input, or remove it",
    "nav2_loopback_sim": f"it can give way to the node sim of {PACKAGE}",
}
"""Package of a node that the navigator does not replace -> what to do."""


class NodeAdvice(NamedTuple):
    """What becomes of a node, at its place."""

    file: str
    line: int
    column: int
    before: str
    after: str
    """Empty for a note."""
    note: str

    def __str__(self) -> str:
        what = f"{self.before} -> {self.after}" if self.after else f"note: {self.before}"
        return f"{self.file}:{self.line}:{self.column}: {what}; {self.note}"


class _Node(NamedTuple):
    line: int
    column: int
    package: str
    program: str
    """Executable, or the class of a component."""
    text: str
    is_xml: bool


def advise(launch: Path) -> list[NodeAdvice]:
    """Return what becomes of the nodes and components of a launch file, in their order; included files are not read.

    Raises InputError for a file that cannot be read.
    """
    nodes = sorted(_nodes_of_xml(launch) if launch.suffix == ".xml" else _nodes_of_python(launch))
    found: list[NodeAdvice] = []
    has_navigator: dict[bool, bool] = {}
    for node in nodes:
        name = SERVERS.get(node.package)
        if name is None:
            if node.package in NOTES:
                found.append(NodeAdvice(str(launch), node.line, node.column, node.text, "", NOTES[node.package]))
            continue
        is_component = "::" in node.program
        if has_navigator.get(is_component, False):
            note = f"remove it, the navigator stands in for {name} too"
            found.append(NodeAdvice(str(launch), node.line, node.column, node.text, "nothing", note))
            continue
        has_navigator[is_component] = True
        if node.is_xml:
            after, params = f'pkg="{PACKAGE}" exec="navigator" name="navigator"', 'args="--params nav2_params.yaml"'
        else:
            after = f"Node(package='{PACKAGE}', executable='navigator', name='navigator')"
            params = "arguments=['--params', params_file]"
        note = f"its parameters by {params} instead of those of the node, remappings stay"
        if is_component:
            note += "; a node, not a component of the container"
        found.append(NodeAdvice(str(launch), node.line, node.column, node.text, after, note))
    return found


def _nodes_of_xml(launch: Path) -> Iterator[_Node]:
    try:
        stack: list[Element] = [read_launch_xml(launch, str(launch))]
    except RejectedLaunchFileError as exc:
        raise InputError(f"{exc.at}: {exc.message}", file=exc.at.file, line=exc.at.line) from exc
    while stack:
        element = stack.pop()
        stack += element.children
        if element.tag not in ("node", "composable_node"):
            continue
        key = "exec" if element.tag == "node" else "plugin"
        package, program = element.attributes.get("pkg", ""), element.attributes.get(key, "")
        text = f'pkg="{package}" {key}="{program}"'
        yield _Node(element.line, element.column, package, program, text, True)


def _nodes_of_python(launch: Path) -> Iterator[_Node]:
    try:
        tree = ast.parse(launch.read_bytes())
    except OSError as exc:
        raise InputError(
            f"{launch} cannot be read: {exc.strerror or exc}; name a launch file", file=str(launch)
        ) from exc
    except (SyntaxError, ValueError) as exc:
        line = getattr(exc, "lineno", None) or 1
        raise InputError(f"{launch}:{line}: this is no Python: {exc.args[0]}", file=str(launch), line=line) from exc
    for call in ast.walk(tree):
        if not isinstance(call, ast.Call):
            continue
        name = call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")
        if name not in ("Node", "LifecycleNode", "ComposableNode"):
            continue
        key = "plugin" if name == "ComposableNode" else "executable"
        texts = {k.arg: k.value.value for k in call.keywords if isinstance(k.value, ast.Constant)}
        package, program = str(texts.get("package", "")), str(texts.get(key, ""))
        text = f"{name}(package='{package}', {key}='{program}')"
        yield _Node(call.lineno, call.col_offset + 1, package, program, text, False)

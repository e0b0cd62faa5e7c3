"""The behavior tree of a converted robot: what move_base has as parameters, Nav2 has in its tree. Written and read back.

The trees of nav2_bt_navigator are the model of the structure; the nodes and their ports are those of each distribution.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from navstack.parameters.nav2.declared import FOXY, GALACTIC, HUMBLE, IRON, JAZZY

MAX_XML_BYTES: Final = 1_000_000
FULL_TURN: Final = 6.28


class TreeRecovery(NamedTuple):
    """A recovery: the nodes that run one after another."""

    name: str
    nodes: tuple[tuple[str, Mapping[str, str]], ...]
    """Registered name of a node of the tree, its ports."""


@dataclass(frozen=True, slots=True)
class TreeSpec:
    """What a tree for NavigateToPose does."""

    planner_frequency: float
    """Hz; 0: plan once for each goal, and after a recovery."""
    planning_retries: int
    """Plans that are tried again, each with a cleared global costmap, before a recovery."""
    recoveries: tuple[TreeRecovery, ...]
    attempts: int
    """Recoveries before the goal fails; 0 for none."""


def clear(costmap: str, distance: float, inside: bool, distro: int) -> tuple[str, Mapping[str, str]]:
    """Return the node that clears a costmap outside or inside a square with a side of `distance` (m)."""
    if distro == FOXY or (distance <= 0.0 and not inside):
        return "ClearEntireCostmap", {"service_name": f"{costmap}/clear_entirely_{costmap}"}
    if inside:
        service = f"{costmap}/clear_around_{costmap}"
        return "ClearCostmapAroundRobot", {"service_name": service, "reset_distance": f"{distance:g}"}
    service = f"{costmap}/clear_except_{costmap}"
    return "ClearCostmapExceptRegion", {"service_name": service, "reset_distance": f"{distance:g}"}


def write_tree(spec: TreeSpec, distro: int, header: str) -> str:
    """Return the XML of a tree for a distribution."""
    root = ET.Element("root", {"BTCPP_format": "4"} if distro >= JAZZY else {})
    root.set("main_tree_to_execute", "MainTree")
    tree = ET.SubElement(root, "BehaviorTree", ID="MainTree")
    at: ET.Element = tree
    if spec.attempts and spec.recoveries:
        at = ET.SubElement(tree, "RecoveryNode", number_of_retries=str(spec.attempts), name="NavigateRecovery")
    drive = ET.SubElement(at, "PipelineSequence", name="NavigateWithReplanning")
    planning = _replanning(drive, spec, distro)
    if spec.planning_retries:
        planning = ET.SubElement(
            planning, "RecoveryNode", number_of_retries=str(spec.planning_retries), name="ComputePathToPose"
        )
    ET.SubElement(
        planning,
        "ComputePathToPose",
        {"goal": "{goal}", "path": "{path}", "planner_id": "GridBased"} | _code("compute_path", distro),
    )
    if spec.planning_retries:
        name, ports = clear("global_costmap", 0.0, False, distro)
        ET.SubElement(planning, name, {"name": "ClearGlobalCostmap-Context", **ports})
    ET.SubElement(drive, "FollowPath", {"path": "{path}", "controller_id": "FollowPath"} | _code("follow_path", distro))
    if at is not tree:
        _recoveries(at, spec)
    ET.indent(root)
    return f"<!-- {header} -->\n{ET.tostring(root, encoding='unicode')}\n"


def _code(action: str, distro: int) -> dict[str, str]:
    return {"error_code_id": f"{{{action}_error_code}}"} if distro >= IRON else {}


def _replanning(drive: ET.Element, spec: TreeSpec, distro: int) -> ET.Element:
    if spec.planner_frequency > 0.0:
        return ET.SubElement(drive, "RateController", hz=repr(spec.planner_frequency))
    if distro >= GALACTIC:
        return ET.SubElement(drive, "GoalUpdatedController")
    drive.tag = "Sequence"  # Foxy has no GoalUpdatedController: plan when the goal starts and after a recovery
    return drive


def _recoveries(at: ET.Element, spec: TreeSpec) -> None:
    branch = ET.SubElement(at, "ReactiveFallback", name="RecoveryFallback")
    ET.SubElement(branch, "GoalUpdated")
    turns = ET.SubElement(branch, "RoundRobin", name="RecoveryActions")
    for recovery in spec.recoveries:
        parent = turns
        if len(recovery.nodes) > 1:
            parent = ET.SubElement(turns, "Sequence", name=recovery.name)
        for number, (tag, ports) in enumerate(recovery.nodes):
            name = recovery.name if parent is turns else f"{recovery.name}-{number + 1}"
            ET.SubElement(parent, tag, {"name": name, **ports})


# ----------------------------------------------------------------------------------------------------------------------
# Reading


_RECOVERIES: Final = frozenset(
    {
        "ClearEntireCostmap",
        "ClearCostmapExceptRegion",
        "ClearCostmapAroundRobot",
        "Spin",
        "BackUp",
        "Wait",
        "DriveOnHeading",
    }
)


def default_tree(distro: int) -> TreeSpec:
    """Return what the default tree of a distribution does."""
    clearing = TreeRecovery(
        "clear_costmaps", tuple(clear(c, 0.0, False, distro) for c in ("local_costmap", "global_costmap"))
    )
    turn = TreeRecovery("spin", (("Spin", {"spin_dist": "1.57"}),))
    wait = TreeRecovery("wait", (("Wait", {"wait_duration": "5"}),))
    speed = "0.05" if distro <= HUMBLE else "0.15"
    back = TreeRecovery("back_up", (("BackUp", {"backup_dist": "0.30", "backup_speed": speed}),))
    return TreeSpec(1.0, 1, (clearing, turn, wait, *(() if distro <= GALACTIC else (back,))), 6)


def read_tree(path: Path) -> TreeSpec | None:
    """Return what the tree of a file does with the parameters that move_base has; None for another structure.

    The main tree must have one ComputePathToPose and one FollowPath. Raise OSError for a file that cannot be read.
    """
    content = path.read_bytes()
    if len(content) > MAX_XML_BYTES or b"<!ENTITY" in content:
        return None
    try:
        root = ET.fromstring(content)
    except ET.ParseError:
        return None
    parents = {child: parent for parent in root.iter() for child in parent}
    plans = [e for e in root.iter() if _name(e) == "ComputePathToPose"]
    follows = [e for e in root.iter() if _name(e) == "FollowPath"]
    if len(plans) != 1 or len(follows) != 1:
        return None
    hertz, retries, attempts = 0.0, 0, 0
    for above in _above(plans[0], parents):
        name = _name(above)
        shared = follows[0] in above.iter()
        if name == "RateController":
            hertz = _number(above.get("hz"), 10.0)
        elif name == "RecoveryNode" and not shared:
            retries = int(_number(above.get("number_of_retries"), 1.0))
        elif name == "RecoveryNode":
            attempts = int(_number(above.get("number_of_retries"), 1.0))
    found = [e for e in root.iter() if _name(e) == "RoundRobin"]
    groups = [[e for e in child.iter() if _name(e) in _RECOVERIES] for child in (found[0] if found else ())]
    recoveries = tuple(
        TreeRecovery(child.get("name", _name(nodes[0])), tuple((_name(e), dict(e.attrib)) for e in nodes))
        for child, nodes in zip(found[0] if found else (), groups)
        if nodes
    )
    return TreeSpec(hertz, retries, recoveries, attempts)


def _name(element: ET.Element) -> str:
    """The registered name of a node: its tag, or ID in the explicit form."""
    return element.get("ID", "") if element.tag in ("Action", "Control", "Condition", "Decorator") else element.tag


def _above(element: ET.Element, parents: Mapping[ET.Element, ET.Element]) -> Iterator[ET.Element]:
    while element in parents:
        element = parents[element]
        yield element


def _number(text: str | None, default: float) -> float:
    try:
        return float(text) if text is not None else default
    except ValueError:
        return default

"""The sections between planner and wheels: twist_mux, velocity_smoother, collision_monitor, collision_detector.

Each may be written as in ROS 1 or with the `ros__parameters` of a ROS 2 file. A section that is written is in use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from navstack.core.parameters import ParamModel
from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding
from navstack.parameters.models.collision_monitor import CollisionDetectorParams, CollisionMonitorParams
from navstack.parameters.models.twist_mux import TwistMuxParams
from navstack.parameters.models.velocity_smoother import VelocitySmootherParams
from navstack.parameters.tree import Leaf, Space, overlay
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode

ROS2_PARAMETERS: Final = "ros__parameters"
SAFETY_MODELS: Final[dict[str, type[ParamModel]]] = {
    "twist_mux": TwistMuxParams,
    "velocity_smoother": VelocitySmootherParams,
    "collision_monitor": CollisionMonitorParams,
    "collision_detector": CollisionDetectorParams,
}
"""Section -> its model."""


@dataclass(frozen=True, slots=True)
class SafetyConfiguration:
    """What stands between the sources of commands and the robot; None for what is not written."""

    twist_mux: TwistMuxParams | None = None
    velocity_smoother: VelocitySmootherParams | None = None
    collision_monitor: CollisionMonitorParams | None = None
    collision_detector: CollisionDetectorParams | None = None

    @property
    def in_use(self) -> bool:
        """True if any of them is written."""
        return any(params is not None for _, params in self.sections())

    def sections(self) -> list[tuple[str, ParamModel | None]]:
        """Return every section by name, with its parameters."""
        return [(name, getattr(self, name)) for name in SAFETY_MODELS]


def load_safety(root: Space, binder: Binder, findings: list[Finding]) -> SafetyConfiguration | None:
    """Return the sections that are written, None if one of them cannot be used."""
    made: dict[str, Any] = {}
    for name, model in SAFETY_MODELS.items():
        if name not in root.children:
            continue
        space = binder.child(root, name)
        unwrap_ros2(space, findings)
        if name == "twist_mux":
            _list_entries(space)
        made[name] = binder.bind(model, space)
    return None if any(params is None for params in made.values()) else SafetyConfiguration(**made)


def unwrap_ros2(space: Space, findings: list[Finding]) -> None:
    """Move the parameters below `ros__parameters` up, where ROS 1 has them."""
    inner = space.space(ROS2_PARAMETERS)
    if inner is not None:
        del space.children[ROS2_PARAMETERS]
        overlay(space, inner.as_node(), findings)


def _list_entries(space: Space) -> None:
    """Turn the maps by name of a ROS 2 file, `topics: {joystick: {..}}`, into the lists of ROS 1."""
    for key in ("topics", "locks"):
        named = space.space(key)
        if named is None:
            continue
        entries: list[Node] = []
        for name, child in named.children.items():
            node = child.node if isinstance(child, Leaf) else child.as_node()
            if isinstance(node, DictNode):
                items = {"name": (child.at, ScalarNode(name, child.at, True, name)), **node.items}
                node = DictNode(items, child.at)
            entries.append(node)
        space.put(key, named.at, ListNode(entries, named.at))

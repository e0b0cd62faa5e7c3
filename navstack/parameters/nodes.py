"""Sections of nodes other than move_base: safety (twist_mux, velocity_smoother, ..), localization (amcl, ..), docking_server.

Each may be written as in ROS 1 or with the `ros__parameters` of a ROS 2 file. A section that is written is in use.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from navstack.parameters.binding import Binder
from navstack.parameters.findings import Finding
from navstack.parameters.tree import Leaf, Space, overlay
from navstack.parameters.yaml_reader import DictNode, ListNode, Node, ScalarNode
from navstack.plugins import ParamModel

if TYPE_CHECKING:  # a model is imported when its section is written
    from navstack.parameters.models.amcl import AmclParams
    from navstack.parameters.models.collision_monitor import CollisionDetectorParams, CollisionMonitorParams
    from navstack.parameters.models.docking import DockingParams
    from navstack.parameters.models.ekf import FilterParams
    from navstack.parameters.models.supervision import SearchingParams
    from navstack.parameters.models.twist_mux import TwistMuxParams
    from navstack.parameters.models.velocity_smoother import VelocitySmootherParams

ROS2_PARAMETERS: Final = "ros__parameters"
SAFETY_SECTIONS: Final = ("twist_mux", "velocity_smoother", "collision_monitor", "collision_detector")
LOCALIZATION_SECTIONS: Final = ("amcl", "supervision", "ekf")
DOCKING_SECTION: Final = "docking_server"
NODE_SECTIONS: Final = (*SAFETY_SECTIONS, *LOCALIZATION_SECTIONS, DOCKING_SECTION)
"""Every section other than move_base's that belongs to a node of its own in ROS."""

_MODELS: Final = {
    "twist_mux": ("twist_mux", "TwistMuxParams"),
    "velocity_smoother": ("velocity_smoother", "VelocitySmootherParams"),
    "collision_monitor": ("collision_monitor", "CollisionMonitorParams"),
    "collision_detector": ("collision_monitor", "CollisionDetectorParams"),
    "amcl": ("amcl", "AmclParams"),
    "supervision": ("supervision", "SearchingParams"),
    "ekf": ("ekf", "EkfParams"),
    DOCKING_SECTION: ("docking", "DockingParams"),
}
"""Section -> module and name of its model."""


def node_model(section: str) -> type[ParamModel]:
    """Return the parameter model of a section, which is imported."""
    module, name = _MODELS[section]
    model: type[ParamModel] = getattr(importlib.import_module(f"navstack.parameters.models.{module}"), name)
    return model


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
        return [(name, getattr(self, name)) for name in SAFETY_SECTIONS]


def load_safety(root: Space, binder: Binder, findings: list[Finding]) -> SafetyConfiguration | None:
    """Return the sections that are written, None if one of them cannot be used."""
    made: dict[str, Any] = {}
    for name in SAFETY_SECTIONS:
        if name not in root.children:
            continue
        space = binder.child(root, name)
        unwrap_ros2(space, findings)
        if name == "twist_mux":
            _list_entries(space)
        made[name] = binder.bind(node_model(name), space)
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


# ----------------------------------------------------------------------------------------------------------------------
# The sections of localization: amcl, its supervision, and the odometry filter ekf.


def default_filter() -> FilterParams:
    """Return the parameters of a filter of wheels and a gyroscope."""
    from navstack.parameters.models.ekf import STATES, EkfParams

    config: dict[str, Any] = {
        "odom0_config": [state in ("vx", "vy", "vyaw") for state in STATES],
        "imu0_config": [state == "vyaw" for state in STATES],
    }
    return EkfParams(**config)


@dataclass(frozen=True, slots=True)
class LocalizationConfiguration:
    """The parameters of localization; None for what is not written."""

    amcl: AmclParams | None = None
    supervision: SearchingParams | None = None
    ekf: FilterParams | None = None

    def sections(self) -> list[tuple[str, ParamModel | None]]:
        """Return every section by name, with its parameters."""
        return [(name, getattr(self, name)) for name in LOCALIZATION_SECTIONS]


def load_localization(root: Space, binder: Binder, findings: list[Finding]) -> LocalizationConfiguration | None:
    """Return the sections that are written, None if one of them cannot be used."""
    made: dict[str, Any] = {}
    for name in LOCALIZATION_SECTIONS:
        if name in root.children:
            space = binder.child(root, name)
            unwrap_ros2(space, findings)
            made[name] = binder.bind(node_model(name), space)
    return None if any(params is None for params in made.values()) else LocalizationConfiguration(**made)


# ----------------------------------------------------------------------------------------------------------------------
# The section of docking.


def load_docking(root: Space, binder: Binder, findings: list[Finding]) -> tuple[DockingParams | None, bool]:
    """Return the section `docking_server`, None if it is not written; and whether it can be used."""
    if DOCKING_SECTION not in root.children:
        return None, True
    space = binder.child(root, DOCKING_SECTION)
    unwrap_ros2(space, findings)
    made: Any = binder.bind(node_model(DOCKING_SECTION), space)
    return made, made is not None

"""Convert costmap parameters from before ROS Hydro: without `plugins`, with all parameters at the costmap's own level.

Source: costmap_2d/src/costmap_2d_ros.cpp, loadOldParameters.
"""

from __future__ import annotations

from navstack.parameters.findings import Finding, Location, finding
from navstack.parameters.tree import Leaf, Space
from navstack.parameters.yaml_nodes import DictNode, ListNode, Node, ScalarNode

_VOXEL = ("origin_z", "z_resolution", "z_voxels", "mark_threshold", "unknown_threshold", "publish_voxel_map")
_STATIC = ("map_topic", "unknown_cost_value", "lethal_cost_threshold")
_OBSTACLE = ("max_obstacle_height", "raytrace_range", "obstacle_range")
_INFLATION = ("cost_scaling_factor", "inflation_radius")


def convert_pre_hydro(costmap: Space, findings: list[Finding]) -> None:
    """Add `plugins` to a costmap that has none and move the parameters into the namespaces of the layers."""
    if "plugins" in costmap.children:
        return
    static = _take_flag(costmap, "static_map")
    voxel = _take_text(costmap, "map_type") == "voxel"
    layers: list[tuple[str, str]] = []
    moved: list[str] = []
    if static:
        layers.append(("static_layer", "costmap_2d::StaticLayer"))
        _move(costmap, "static_layer", _STATIC, moved)
        _copy(costmap, "static_layer", "track_unknown_space")
    layers.append(("obstacle_layer", "costmap_2d::VoxelLayer" if voxel else "costmap_2d::ObstacleLayer"))
    if voxel:
        _move(costmap, "obstacle_layer", _VOXEL, moved)
    _move(costmap, "obstacle_layer", _OBSTACLE, moved)
    if costmap.leaf("track_unknown_space") is not None:
        _copy(costmap, "obstacle_layer", "track_unknown_space")
    sources = costmap.leaf("observation_sources")
    if sources is not None and isinstance(sources.value, str):
        _move(costmap, "obstacle_layer", tuple(sources.value.split()), moved)
    _move(costmap, "obstacle_layer", ("observation_sources",), moved)
    layers.append(("inflation_layer", "costmap_2d::InflationLayer"))
    _move(costmap, "inflation_layer", _INFLATION, moved)
    at = costmap.at
    costmap.put("plugins", at, _plugin_list(layers, at))
    listed = ", ".join(name for name, _ in layers)
    also = f", which use its {', '.join(moved)}" if moved else ""
    message = (
        f"{costmap.path} has no `plugins`, so it is converted as before ROS Hydro to the layers {listed}{also}; list the "
        "layers under `plugins`"
    )
    findings.append(finding("info", "pre-hydro", at, costmap.path, message, "plugins"))


def _take_flag(space: Space, name: str) -> bool:
    leaf = space.leaf(name)
    if leaf is None:
        return False
    leaf.used = True
    return leaf.value is True


def _take_text(space: Space, name: str) -> str:
    leaf = space.leaf(name)
    if leaf is None:
        return ""
    leaf.used = True
    return leaf.value if isinstance(leaf.value, str) else ""


def _move(costmap: Space, layer: str, names: tuple[str, ...], moved: list[str]) -> None:
    """Move parameters and namespaces into the layer's namespace, replacing those of the same name."""
    for name in names:
        child = costmap.children.pop(name, None)
        if child is None:
            continue
        moved.append(name)
        _graft(costmap.ensure(layer, child.at), name, child)


def _graft(into: Space, name: str, child: Leaf | Space) -> None:
    if isinstance(child, Leaf):
        into.put(name, child.at, child.node)
        return
    into.children.pop(name, None)
    space = into.ensure(name, child.at)
    for key, below in child.children.items():
        _graft(space, key, below)


def _copy(costmap: Space, layer: str, name: str) -> None:
    leaf = costmap.leaf(name)
    if leaf is not None:
        leaf.used = True
        costmap.ensure(layer, leaf.at).put(name, leaf.at, leaf.node)


def _plugin_list(layers: list[tuple[str, str]], at: Location) -> ListNode:
    def entry(name: str, kind: str) -> Node:
        return DictNode(
            {"name": (at, ScalarNode(name, at, text=name)), "type": (at, ScalarNode(kind, at, text=kind))}, at
        )

    return ListNode([entry(n, t) for n, t in layers], at)

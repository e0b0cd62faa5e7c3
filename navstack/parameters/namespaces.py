"""Namespaces in which the parameters of planners and layers are usually written."""

from __future__ import annotations

from typing import Any

from navstack.interfaces import Layer
from navstack.parameters.plugin_lists import short_type
from navstack.parameters.tree import Space
from navstack.plugins import PluginEntry, normalize


def planner_namespaces(entry: PluginEntry[Any], written: str = "") -> list[str]:
    """Return the possible namespaces of a planner: of its type as written, of its ROS names, its registered names."""
    names = [short_type(written)] if "/" in normalize(written) else []
    names += [short_type(alias) for alias in entry.aliases if "/" in alias]
    others = [alias for alias in entry.aliases if "/" not in alias]
    return list(dict.fromkeys([*names, entry.name, *others, *getattr(entry.cls, "NAMESPACES", ())]))


def planner_space(root: Space, entry: PluginEntry[Any], written: str) -> Space:
    """Return the first of the planner's namespaces that is written, an empty one otherwise."""
    names = planner_namespaces(entry, written)
    for name in names:
        space = root.space(name)
        if space is not None:
            return space
    return Space(root.join(names[0]), root.at, root)


def layer_names(entry: PluginEntry[Layer]) -> list[str]:
    """Return the instance names that layers of a type usually have, the plain one first."""
    base = entry.name.removesuffix("_layer")
    names = [f"{base}_layer", base, f"{base}r_layer"]
    if base == "voxel":
        names = ["obstacle_layer", "voxel_layer", *names]
    return list(dict.fromkeys(names))

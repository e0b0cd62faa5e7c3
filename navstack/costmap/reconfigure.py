"""Changes of a costmap's parameters at run time, as by dynamic_reconfigure in costmap_2d.

Source: costmap_2d/cfg/*.cfg, costmap_2d_ros.cpp (reconfigureCB). Observations are kept unless the size of the grid changes; the
master grid is rewritten immediately. Parameters that define the structure of a costmap are fixed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from navstack.core import Footprint
from navstack.core.errors import InputError
from navstack.parameters.models.costmap import CostmapParams

if TYPE_CHECKING:
    from navstack.costmap.layered_costmap import LayeredCostmap, LayerSpec

FIXED: Final = frozenset({"global_frame", "robot_base_frame", "rolling_window", "track_unknown_space", "plugins"})
"""Parameters that a running costmap cannot change."""
FOOTPRINT: Final = frozenset({"footprint", "robot_radius", "footprint_padding"})
"""Parameters without a change of which a footprint that a topic has set remains, as in ROS."""
SIZE: Final = frozenset({"width", "height", "resolution", "origin_x", "origin_y"})


def changed(old: Any, new: Any) -> frozenset[str]:
    """Return the names of the parameters in which two models of one class differ."""
    return frozenset(name for name in type(old).model_fields if getattr(old, name) != getattr(new, name))


def check_reconfigure(costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[LayerSpec]) -> None:
    """Raise InputError with the names of the parameters that a running costmap cannot change."""
    current = [(layer.name, type(layer)) for layer in costmap.layers]
    if current != [(spec.name, spec.cls) for spec in layers]:
        raise InputError(
            f"the layers of {costmap.name} cannot be changed at run time; restart with the new parameters",
            costmap=costmap.name,
            layers=[name for name, _ in current],
        )
    _refuse(costmap.name, "", changed(costmap.params, params) & FIXED)
    for layer, spec in zip(costmap.layers, layers, strict=True):
        fixed = changed(layer.params, spec.params) - layer.LIVE
        if not fixed <= layer.live_parts(spec.params):
            _refuse(costmap.name, f"{layer.name}/", fixed)


def apply_reconfigure(
    costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[LayerSpec], footprint: Footprint
) -> bool:
    """Apply changes that `check_reconfigure` accepted; return False if nothing differs. `footprint` is padded."""
    differing = changed(costmap.params, params)
    moved = bool(differing & FOOTPRINT) and footprint != costmap.footprint
    others = [
        (layer, spec.params)
        for layer, spec in zip(costmap.layers, layers, strict=True)
        if changed(layer.params, spec.params)
    ]
    costmap.params = params
    for layer, layer_params in others:
        layer.set_params(layer_params)
    if moved:
        costmap.set_footprint(footprint)
    if differing & SIZE:
        costmap.resize()
    elif others or moved:
        costmap.rewrite()
    return bool(differing or others or moved)


def _refuse(costmap: str, layer: str, names: frozenset[str]) -> None:
    if names:
        listed = ", ".join(f"{costmap}/{layer}{name}" for name in sorted(names))
        raise InputError(f"{listed} cannot be changed at run time; restart with the new parameters", parameters=listed)

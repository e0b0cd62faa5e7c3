"""Other parameters for a costmap that runs, as dynamic_reconfigure gives them to costmap_2d.

Source: costmap_2d/cfg/*.cfg, costmap_2d_ros.cpp (reconfigureCB). What sensors have seen is kept, unless the grid changes its
size; the master is written anew at once. What decides how a costmap is built cannot change while it runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from navstack.core import Footprint
from navstack.core.errors import InputError
from navstack.parameters.models.costmap import CostmapParams

if TYPE_CHECKING:
    from navstack.costmap.layered_costmap import LayeredCostmap, LayerSpec

BUILT: Final = frozenset({"global_frame", "robot_base_frame", "rolling_window", "track_unknown_space", "plugins"})
"""Parameters of a costmap that hold until it is built anew."""
SIZE: Final = frozenset({"width", "height", "resolution", "origin_x", "origin_y"})


def changed(old: Any, new: Any) -> frozenset[str]:
    """Names of the parameters in which two models of one class differ."""
    return frozenset(name for name in type(old).model_fields if getattr(old, name) != getattr(new, name))


def check_reconfigure(costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[LayerSpec]) -> None:
    """Raises InputError, naming the parameters, for changes that a running costmap cannot take."""
    have = [(layer.name, type(layer)) for layer in costmap.layers]
    if have != [(spec.name, spec.cls) for spec in layers]:
        raise InputError(
            f"the layers of {costmap.name} cannot change while it runs; build it anew",
            costmap=costmap.name,
            layers=[name for name, _ in have],
        )
    _refuse(costmap.name, "", changed(costmap.params, params) & BUILT)
    for layer, spec in zip(costmap.layers, layers, strict=True):
        fixed = changed(layer.params, spec.params) - layer.LIVE
        if not fixed <= layer.live_parts(spec.params):
            _refuse(costmap.name, f"{layer.name}/", fixed)


def apply_reconfigure(
    costmap: LayeredCostmap, params: CostmapParams, layers: Sequence[LayerSpec], footprint: Footprint
) -> bool:
    """Makes changes that `check_reconfigure` let pass; True when there were any."""
    differing = changed(costmap.params, params)
    outline = not (
        footprint.vertices.shape == costmap.footprint.vertices.shape
        and (footprint.vertices == costmap.footprint.vertices).all()
    )
    others = [
        (layer, spec.params)
        for layer, spec in zip(costmap.layers, layers, strict=True)
        if changed(layer.params, spec.params)
    ]
    costmap.params = params
    for layer, given in others:
        layer.set_params(given)
    if outline:
        costmap.set_footprint(footprint)
    if differing & SIZE:
        costmap.take_size()
    elif others or outline:
        costmap.rewrite()
    return bool(differing or others or outline)


def _refuse(costmap: str, layer: str, names: frozenset[str]) -> None:
    if names:
        listed = ", ".join(f"{costmap}/{layer}{name}" for name in sorted(names))
        raise InputError(f"{listed} cannot change while the costmap runs; build it anew", parameters=listed)

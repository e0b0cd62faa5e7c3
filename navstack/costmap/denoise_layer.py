"""Drops obstacles of a few cells: what a lidar sees in dust and rain (semantics of nav2_costmap_2d's DenoiseLayer)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, LETHAL, Bounds, Costmap, GridGeometry, Pose2D, Window
from navstack.core.parameters import ParamModel, param
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS


class DenoiseLayerParams(ParamModel):
    """`<costmap>/denoise_layer:`."""

    enabled: bool = param(True, "apply this layer")
    minimal_group_size: int = param(2, "obstacles of fewer cells are dropped", ge=1, le=1000)
    group_connectivity_type: Literal[4, 8] = param(
        8, "cells that touch by sides (4), or by corners too (8), are one obstacle"
    )


@LAYERS.register("denoise", aliases=("nav2_costmap_2d/DenoiseLayer",))
class DenoiseLayer(Layer):
    """Sets small groups of lethal cells free. List it after the obstacle layers and before the inflation layer."""

    Params: ClassVar[type[ParamModel]] = DenoiseLayerParams

    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled"})

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self._margin = 0.0
        self._last = Bounds()

    def match_size(self, geometry: GridGeometry) -> None:
        """Holds no cells."""
        self._margin = self.params.minimal_group_size * geometry.resolution

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """A cell that changed can make or break groups as far away as a group is long."""
        del robot, now
        if not self.params.enabled or self.params.minimal_group_size == 1:
            return bounds
        last, self._last = self._last, bounds
        changed = last.union(bounds)
        return changed if changed.is_empty else changed.grown(self._margin)

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Frees the window's groups that are too small, counting their cells beyond the window too."""
        size = self.params.minimal_group_size
        if not self.params.enabled or size == 1:
            return
        from scipy import ndimage

        y0, x0 = max(0, window.y0 - size), max(0, window.x0 - size)
        around = master.data[y0 : window.y1 + size, x0 : window.x1 + size]
        corners = np.ones((3, 3)) if self.params.group_connectivity_type == 8 else None
        label: Any = ndimage.label  # its stubs do not know that it returns an array and a number
        groups: NDArray[np.int32] = label(around == LETHAL, corners)[0]
        small = np.bincount(groups.ravel()) < size
        small[0] = False
        inside = (slice(window.y0 - y0, window.y1 - y0), slice(window.x0 - x0, window.x1 - x0))
        around[inside][small[groups[inside]]] = FREE

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """What it would do."""
        del ix, iy, master
        return CellExplanation(None, f"drops obstacles of fewer than {self.params.minimal_group_size} cells")

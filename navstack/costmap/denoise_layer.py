"""Removes obstacles of a few cells, such as dust and rain in a lidar scan (semantics of nav2_costmap_2d's DenoiseLayer)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, LETHAL, Bounds, Costmap, GridGeometry, Pose2D, Window
from navstack.plugins import LAYERS, CellExplanation, Layer, LayerContext, ParamModel, param


class DenoiseLayerParams(ParamModel):
    """`<costmap>/denoise_layer:`."""

    enabled: bool = param(True, "apply this layer")
    minimal_group_size: int = param(2, "obstacles of fewer cells are removed", ge=1, le=1000)
    group_connectivity_type: Literal[4, 8] = param(
        8, "cells that share a side (4), or a side or a corner (8), form one obstacle"
    )


@LAYERS.register("denoise", aliases=("nav2_costmap_2d/DenoiseLayer",))
class DenoiseLayer(Layer):
    """Clears small groups of lethal cells. List it after the obstacle layers and before the inflation layer."""

    Params: ClassVar[type[ParamModel]] = DenoiseLayerParams

    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled"})

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self._margin = 0.0
        self._last = Bounds()

    def match_size(self, geometry: GridGeometry) -> None:
        """Set the margin; the layer stores no cells."""
        self._margin = self.params.minimal_group_size * geometry.resolution

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Grow the bounds by the size of a group: a changed cell can join or split groups that far away."""
        del robot, now
        if not self.params.enabled or self.params.minimal_group_size == 1:
            return bounds
        last, self._last = self._last, bounds
        changed = last.union(bounds)
        return changed if changed.is_empty else changed.grown(self._margin)

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Clear the groups in the window that are too small; cells outside the window count too."""
        size = self.params.minimal_group_size
        if not self.params.enabled or size == 1:
            return
        from scipy import ndimage

        y0, x0 = max(0, window.y0 - size), max(0, window.x0 - size)
        around = master.data[y0 : window.y1 + size, x0 : window.x1 + size]
        corners = np.ones((3, 3)) if self.params.group_connectivity_type == 8 else None
        label: Any = ndimage.label  # the stubs lack the return type: an array and a number
        groups: NDArray[np.int32] = label(around == LETHAL, corners)[0]
        small = np.bincount(groups.ravel()) < size
        small[0] = False
        inside = (slice(window.y0 - y0, window.y1 - y0), slice(window.x0 - x0, window.x1 - x0))
        around[inside][small[groups[inside]]] = FREE

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the effect of the layer."""
        del ix, iy, master
        return CellExplanation(None, f"removes obstacles of fewer than {self.params.minimal_group_size} cells")

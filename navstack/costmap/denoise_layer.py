"""Removes obstacles of a few cells, such as dust and rain in a lidar scan (after nav2_costmap_2d's DenoiseLayer)."""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from navstack.core import FREE, INSCRIBED, LETHAL, UNKNOWN, Bounds, Costmap, GridGeometry, Pose2D, Window
from navstack.plugins import LAYERS, CellExplanation, Layer, LayerContext, ParamModel, param


class DenoiseLayerParams(ParamModel):
    """`<costmap>/denoise_layer:`."""

    enabled: bool = param(True, "apply this layer")
    minimal_group_size: int = param(2, "obstacles of fewer cells are removed", ge=1, le=1000)
    group_connectivity_type: Literal[4, 8] = param(
        8, "cells that share a side (4), or a side or a corner (8), form one obstacle"
    )


@LAYERS.register("denoise")
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


class Nav2DenoiseLayerParams(ParamModel):
    """Parameters of Nav2's denoise layer."""

    enabled: bool = param(True, "apply this layer")
    minimal_group_size: int = param(2, "obstacles of fewer cells are removed; 1 or less = none")
    group_connectivity_type: int = param(
        8, "4: cells that share a side form one obstacle; any other value: also those that share a corner"
    )


@LAYERS.register("nav2_denoise", aliases=("nav2_costmap_2d/DenoiseLayer",))
class Nav2DenoiseLayer(Layer):
    """Clears small groups of lethal and inscribed cells in the update window, by Nav2's rules.

    Cells outside the window do not count, so a group that the window cuts may be removed: `denoise` counts them. In a costmap
    that does not track unknown space, unknown cells are obstacles, too.
    """

    Params: ClassVar[type[ParamModel]] = Nav2DenoiseLayerParams
    LIVE: ClassVar[frozenset[str]] = frozenset({"enabled"})
    AS_NAV2 = True

    def match_size(self, geometry: GridGeometry) -> None:
        """Do nothing: the layer stores no cells."""

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Return the bounds unchanged."""
        del robot, now
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Set the groups in the window that are too small free."""
        size = self.params.minimal_group_size
        if not self.params.enabled or size <= 1 or window.is_empty:
            return
        from scipy import ndimage

        part = master.data[window.slices]
        obstacle = (part == LETHAL) | (part == INSCRIBED)
        if not self.context.track_unknown_space:
            obstacle |= part == UNKNOWN
        corners = None if self.params.group_connectivity_type == 4 else np.ones((3, 3))
        label: Any = ndimage.label  # the stubs lack the return type: an array and a number
        groups: NDArray[np.int32] = label(obstacle, corners)[0]
        small = np.bincount(groups.ravel()) < size
        small[0] = False
        part[small[groups]] = FREE

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the effect of the layer."""
        del ix, iy, master
        return CellExplanation(None, f"removes obstacles of fewer than {self.params.minimal_group_size} cells")

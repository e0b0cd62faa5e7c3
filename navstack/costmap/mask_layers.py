"""Masks drawn over the map: where not to go and where to go slowly.

Semantics of Nav2's costmap filters (nav2_costmap_2d/plugins/costmap_filters), with the mask given as a map_server file.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import LETHAL, UNKNOWN, Bounds, Costmap, GridGeometry, OccupancyGrid, Pose2D, Transform2D, Window
from navstack.core.errors import InputError
from navstack.core.parameters import ParamModel, param
from navstack.costmap import _kernels
from navstack.costmap.regions import EVERYWHERE
from navstack.costmap.static_layer import cell_affine, map_from_frame
from navstack.interfaces import CellExplanation, Layer, LayerContext
from navstack.plugins import LAYERS


class MaskLayerParams(ParamModel):
    """What every mask has."""

    enabled: bool = param(True, "apply this layer")
    mask: str = param("", "the mask's map YAML")


class SpeedMaskLayerParams(MaskLayerParams):
    """`<costmap>/speed_mask:`."""

    type: Literal["percent", "absolute"] = param("percent", "limits are percents of the full speed, or m/s")
    base: float = param(0.0, "limit = base + multiplier * value of the mask")
    multiplier: float = param(1.0, "limit = base + multiplier * value of the mask")


class SpeedLimit(NamedTuple):
    """A limit set by a mask; the lower of two compares as smaller when both are of one kind."""

    value: float
    """Percent of the full speed, or m/s."""
    percent: bool

    def of(self, full_speed: float) -> float:
        """The limit in m/s for a robot whose full speed (m/s) is given."""
        return full_speed * self.value / 100.0 if self.percent else min(full_speed, self.value)


class _MaskLayer(Layer):
    """A mask and the way to its cells."""

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self.mask: OccupancyGrid | None = None
        self._fresh = True
        if params.mask:
            if context.read_map is None:
                raise InputError(
                    f'the layer "{context.name}" names the mask {params.mask}, but its costmap was given nothing to read maps '
                    "with: pass read_map=navstack.map_io.load_map, or hand the mask over with set_mask",
                    layer=context.name,
                )
            self.set_mask(context.read_map(params.mask))

    def set_mask(self, mask: OccupancyGrid) -> None:
        """The mask to apply from now on."""
        self.mask = mask
        self._fresh = True

    def match_size(self, geometry: GridGeometry) -> None:
        """Masks keep their own size."""
        del geometry
        self._fresh = True

    def value_at(self, x: float, y: float) -> int | None:
        """Value of the mask (0 .. 100) at a point (m) of the costmap's frame; None where it is unknown or off the mask."""
        if self.mask is None:
            return None
        at = self._to_mask().apply(Pose2D(x, y))
        cell = self.mask.geometry.world_to_cell(at.x, at.y)
        if cell is None:
            return None
        value = int(self.mask.data[cell[1], cell[0]])
        return value if value >= 0 else None

    def _to_mask(self) -> Transform2D:
        assert self.mask is not None
        return map_from_frame(self.mask, self.context.frames, self.context.frame, None)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """A mask is not observed: nothing to forget, but it is written again."""
        del region, invert
        self._fresh = True
        return 0


@LAYERS.register("keepout_mask", aliases=("nav2_costmap_2d/KeepoutFilter",))
class KeepoutMaskLayer(_MaskLayer):
    """Where the robot must not go: 100 of the mask is lethal, 1 .. 99 costs in proportion, 0 and unknown change nothing
    that is dearer. List it before the inflation layer to keep the whole robot out, after it to keep its centre out.
    """

    Params: ClassVar[type[ParamModel]] = MaskLayerParams

    def set_mask(self, mask: OccupancyGrid) -> None:
        """The mask to apply from now on."""
        super().set_mask(mask)
        self._costs = mask_costs(mask)

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Everything, when the mask is new."""
        del robot, now
        if not (self.params.enabled and self._fresh and self.mask is not None):
            return bounds
        self._fresh = False
        return bounds.union(EVERYWHERE)

    def shift_to(self, geometry: GridGeometry) -> None:
        """What rolls into the window has to be masked too."""
        del geometry
        self._fresh = True

    def update_costs(self, master: Costmap, window: Window) -> None:
        """The larger of master and mask; unknown cells of the master are overwritten."""
        if not self.params.enabled or self.mask is None:
            return
        affine = cell_affine(self._to_mask(), master.geometry, self.mask.geometry)
        _kernels.look_up_map(master.data, self._costs, *window, affine, True)

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """The value of the mask there."""
        value = self.value_at(*master.geometry.cell_to_world(ix, iy))
        if value is None:
            return CellExplanation(None, "the mask says nothing here")
        return CellExplanation(
            round(value * LETHAL / 100.0), f"the mask says {value}", source="mask", data={"mask_value": value}
        )


@LAYERS.register("speed_mask", aliases=("nav2_costmap_2d/SpeedFilter",))
class SpeedMaskLayer(_MaskLayer):
    """Where the robot must go slowly. It writes no costs: ask the costmap for `speed_limit(x, y)`."""

    Params: ClassVar[type[ParamModel]] = SpeedMaskLayerParams

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Nothing changes."""
        del robot, now
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """No costs."""

    def limit_at(self, x: float, y: float) -> SpeedLimit | None:
        """The limit at a point (m) of the costmap's frame; None for 0, unknown, off the mask, and limits out of range."""
        value = self.value_at(x, y) if self.params.enabled else None
        if not value:
            return None
        limit = self.params.base + self.params.multiplier * value
        percent = self.params.type == "percent"
        if limit < 0.0 or (percent and limit > 100.0):
            return None
        return SpeedLimit(limit, percent)

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """Return the limit (m/s) at a point (m) of the costmap's frame; None without a limit. As in Nav2, 0 is no limit."""
        limit = self.limit_at(x, y)
        return None if limit is None or limit.value == 0.0 else limit.of(max_speed)

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """The limit there."""
        limit = self.limit_at(*master.geometry.cell_to_world(ix, iy))
        if limit is None:
            return CellExplanation(None, "no speed limit here")
        return CellExplanation(None, f"speed limit {limit.value:g} {'%' if limit.percent else 'm/s'}", source="mask")


def mask_costs(mask: OccupancyGrid) -> NDArray[np.uint8]:
    """0 .. 100 -> 0 .. 254 in proportion, rounded; the rest is unknown, which changes nothing."""
    values = np.arange(256)
    table = np.full(256, UNKNOWN, np.uint8)
    table[:101] = np.rint(values[:101] * (LETHAL / 100.0)).astype(np.uint8)
    return table[mask.data.view(np.uint8)]

"""Keepout, speed and binary masks: areas that the robot must avoid, cross slowly, or in which something is on.

Semantics of Nav2's costmap filters (nav2_costmap_2d/plugins/costmap_filters); the mask is a map_server file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import (
    LETHAL,
    UNKNOWN,
    Bounds,
    Costmap,
    GridGeometry,
    InputError,
    OccupancyGrid,
    Pose2D,
    Transform2D,
    Window,
)
from navstack.costmap.static_layer import cell_affine, map_from_frame
from navstack.costmap.windows import EVERYWHERE, look_up_map, look_up_rotated_map
from navstack.plugins import LAYERS, CellExplanation, Layer, LayerContext, ParamModel, param


class MaskLayerParams(ParamModel):
    """Parameters of every mask: `<costmap>/keepout_mask:`."""

    enabled: bool = param(True, "apply this layer")
    mask: str = param("", "map YAML of the mask")
    filter_info_topic: str = param(
        "",
        "topic of nav2_msgs/CostmapFilterInfo from which a node of ROS 2 takes the mask, its base and its multiplier",
    )


class SpeedMaskLayerParams(MaskLayerParams):
    """`<costmap>/speed_mask:`."""

    type: Literal["percent", "absolute"] = param("percent", "unit of the limits: percent of the full speed, or m/s")
    base: float = param(0.0, "limit = base + multiplier * value of the mask")
    multiplier: float = param(1.0, "limit = base + multiplier * value of the mask")


class BinaryMaskLayerParams(MaskLayerParams):
    """`<costmap>/binary_mask:`."""

    NO_EFFECT: ClassVar[Mapping[str, str]] = {
        "binary_state_topic": "the state is that of the layer; no topic is published",
    }

    base: float = param(0.0, "compared value = base + multiplier * value of the mask")
    multiplier: float = param(1.0, "compared value = base + multiplier * value of the mask")
    default_state: bool = param(False, "state outside the mask, and up to flip_threshold")
    flip_threshold: float = param(50.0, "above this value the state is the opposite of default_state")


class SpeedLimit(NamedTuple):
    """A speed limit of a mask. Two limits in the same unit compare by value."""

    value: float
    """In percent of the full speed, or in m/s."""
    percent: bool

    def of(self, full_speed: float) -> float:
        """Return the limit (m/s) for a robot with this full speed (m/s)."""
        return full_speed * self.value / 100.0 if self.percent else min(full_speed, self.value)


class MaskLayer(Layer):
    """A mask and the lookup of its values."""

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.params: Any = params
        self.mask: OccupancyGrid | None = None
        self._fresh = True
        if params.mask:
            if context.read_map is None:
                raise InputError(
                    f'the layer "{context.name}" names the mask {params.mask}, but its costmap has no read_map function; '
                    "pass read_map=navstack.map_io.load_mask, or set the mask with set_mask",
                    layer=context.name,
                )
            self.set_mask(context.read_map(params.mask))

    def set_mask(self, mask: OccupancyGrid) -> None:
        """Replace the mask."""
        self.mask = mask
        self._fresh = True

    def match_size(self, geometry: GridGeometry) -> None:
        """Write the mask again at the next update; it keeps its own size."""
        del geometry
        self._fresh = True

    def value_at(self, x: float, y: float) -> int | None:
        """Return the value (0 .. 100) at a point (m) of the costmap's frame; None if it is unknown or outside the mask."""
        value = self._raw_value(x, y)
        return value if value is not None and value >= 0 else None

    def _raw_value(self, x: float, y: float) -> int | None:
        """Return the value at a point (m), -1 if it is unknown; None outside the mask, or without one."""
        if self.mask is None:
            return None
        at = self._to_mask().apply(Pose2D(x, y))
        cell = self.mask.geometry.world_to_cell(at.x, at.y)
        return None if cell is None else int(self.mask.data[cell[1], cell[0]])

    def _to_mask(self) -> Transform2D:
        assert self.mask is not None
        return map_from_frame(self.mask, self.context.frames, self.context.frame, None)

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Write the mask again at the next update; there are no observations to clear."""
        del region, invert
        self._fresh = True
        return 0


@LAYERS.register("keepout_mask", aliases=("nav2_costmap_2d/KeepoutFilter",))
class KeepoutMaskLayer(MaskLayer):
    """Areas that the robot must avoid: 100 in the mask is lethal, 1 .. 99 are costs in proportion, 0 and unknown change nothing.

    The larger cost counts. Under a rotated mask, a cell is lethal if it overlaps any lethal cell of the mask. List the layer
    before the inflation layer to keep out the whole robot, after it to keep out its center.
    """

    Params: ClassVar[type[ParamModel]] = MaskLayerParams

    def set_mask(self, mask: OccupancyGrid) -> None:
        """Replace the mask."""
        super().set_mask(mask)
        self._costs = mask_costs(mask)

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Grow the bounds to everywhere if the mask is new."""
        del robot, now
        if not (self.params.enabled and self._fresh and self.mask is not None):
            return bounds
        self._fresh = False
        return bounds.union(EVERYWHERE)

    def shift_to(self, geometry: GridGeometry) -> None:
        """Write the mask again at the next update, in the new part of the window too."""
        del geometry
        self._fresh = True

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Write the larger cost of master and mask; overwrite unknown cells of the master."""
        if not self.params.enabled or self.mask is None:
            return
        to_mask = self._to_mask()
        affine = cell_affine(to_mask, master.geometry, self.mask.geometry)
        if to_mask.yaw == 0.0:
            look_up_map(master.data, self._costs, *window, affine, True)
        else:
            look_up_rotated_map(master.data, self._costs, *window, affine, True, -1)

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the value of the mask at the cell."""
        value = self.value_at(*master.geometry.cell_to_world(ix, iy))
        if value is None:
            return CellExplanation(None, "no mask value here")
        return CellExplanation(
            round(value * LETHAL / 100.0), f"mask value {value}", source="mask", data={"mask_value": value}
        )


@LAYERS.register("speed_mask", aliases=("nav2_costmap_2d/SpeedFilter",))
class SpeedMaskLayer(MaskLayer):
    """Areas with a speed limit. The layer writes no costs; the costmap's `speed_limit` returns the limit."""

    Params: ClassVar[type[ParamModel]] = SpeedMaskLayerParams

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Return the bounds unchanged."""
        del robot, now
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Write no costs."""

    def limit_at(self, x: float, y: float) -> SpeedLimit | None:
        """Return the limit at a point (m) of the costmap's frame; None for 0, unknown, outside the mask or out of range."""
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
        """Explain the speed limit at the cell."""
        limit = self.limit_at(*master.geometry.cell_to_world(ix, iy))
        if limit is None:
            return CellExplanation(None, "no speed limit here")
        return CellExplanation(None, f"speed limit {limit.value:g} {'%' if limit.percent else 'm/s'}", source="mask")


@LAYERS.register("binary_mask", aliases=("nav2_costmap_2d/BinaryFilter",))
class BinaryMaskLayer(MaskLayer):
    """Areas in which something is on or off, such as a light or a camera. The layer writes no costs.

    `state` follows the value of the mask under the robot: where it is unknown, the state stays; outside the mask it is
    `default_state`.
    """

    Params: ClassVar[type[ParamModel]] = BinaryMaskLayerParams

    def __init__(self, params: Any, context: LayerContext) -> None:
        super().__init__(params, context)
        self.state: bool = params.default_state
        """The state at the last update."""
        self.changes: list[tuple[float, bool]] = []
        """Times (s) of the last changes of the state, and the states, the oldest first."""

    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Follow the mask at the robot; return the bounds unchanged."""
        if self.params.enabled and self.mask is not None:
            state = self.state_at(robot.x, robot.y)
            if state != self.state:
                self.state = state
                self.changes = [*self.changes[1 - MAX_CHANGES :], (now, state)]
        return bounds

    def update_costs(self, master: Costmap, window: Window) -> None:
        """Write no costs."""

    def state_at(self, x: float, y: float) -> bool:
        """Return the state of a robot that enters a point (m) of the costmap's frame now."""
        value = self._raw_value(x, y)
        if value is None:
            return bool(self.params.default_state)
        if value < 0:
            return self.state
        above = self.params.base + self.params.multiplier * value > self.params.flip_threshold
        return above != self.params.default_state

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation:
        """Explain the state at the cell."""
        value = self.value_at(*master.geometry.cell_to_world(ix, iy))
        state = "on" if self.state_at(*master.geometry.cell_to_world(ix, iy)) else "off"
        if value is None:
            return CellExplanation(None, f"no mask value here; the state would be {state}")
        return CellExplanation(
            None, f"mask value {value}: the state is {state}", source="mask", data={"mask_value": value}
        )


MAX_CHANGES: Final = 1000
"""Changes of a binary state that are kept."""


def mask_costs(mask: OccupancyGrid) -> NDArray[np.uint8]:
    """Convert mask values 0 .. 100 to costs 0 .. 254 in proportion, rounded; other values to unknown, which changes nothing."""
    values = np.arange(256)
    table = np.full(256, UNKNOWN, np.uint8)
    table[:101] = np.rint(values[:101] * (LETHAL / 100.0)).astype(np.uint8)
    return table[mask.data.view(np.uint8)]

"""Costmap layers, and a layered costmap as seen by planners, recovery behaviors and the goal manager."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    OccupancyGrid,
    Pose2D,
    SensorData,
    Window,
)
from navstack.core.parameters import ParamModel


@dataclass(frozen=True, slots=True)
class LayerContext:
    """What a layer may know of the costmap it belongs to."""

    name: str
    """The layer's instance name, which is also its namespace: `inflation_layer`."""
    frame: str
    """The costmap's global frame."""
    frames: FrameTree
    footprint: Footprint
    """As padded by the costmap."""
    rolling_window: bool = False
    track_unknown_space: bool = False
    """The costmap's own setting, which obstacle layers take as their default."""
    static_map: OccupancyGrid | None = None
    """The map of map_server, None when the robot has none."""
    read_map: Callable[[str], OccupancyGrid] | None = None
    """Reads a map file by its path (`navstack.map_io.load_mask`), for layers that name one in their parameters."""


@dataclass(frozen=True, slots=True)
class LayerSays:
    """What a layer has to say about one cell, and on whose word."""

    cost: int | None
    """The cost the layer itself holds there; None when it says nothing."""
    text: str
    """In words."""
    source: str | None = None
    """The observation source behind it."""
    stamp: float | None = None
    """When that source saw it (s)."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


class Layer(ABC):
    """A layer of a costmap. Bounds may only grow; costs are written only inside the window."""

    Params: ClassVar[type[ParamModel]]
    LIVE: ClassVar[frozenset[str]] = frozenset()
    """The parameters that may change while the layer is at work, by `set_params`."""

    def __init__(self, params: Any, context: LayerContext) -> None:
        self.params = params
        self.context = context
        self.name = context.name

    def set_params(self, params: Any) -> None:
        """Other parameters, which differ in `LIVE` and `live_parts` only; the costmap is written anew after it."""
        self.params = params

    def live_parts(self, params: Any) -> frozenset[str]:
        """Parameters beyond `LIVE` of which only such parts differ in `params` as may change: nested ones."""
        del params
        return frozenset()

    @abstractmethod
    def match_size(self, geometry: GridGeometry) -> None:
        """The master grid has (had) this geometry from now on: allocate. Called before anything else."""

    def shift_to(self, geometry: GridGeometry) -> None:
        """The rolling window moved by whole cells to `geometry`; keep what overlaps. For layers that hold cells."""
        del geometry

    @abstractmethod
    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Takes in what was observed; returns `bounds` (m) grown to hold every cell that may change."""

    @abstractmethod
    def update_costs(self, master: Costmap, window: Window) -> None:
        """Writes this layer's costs into the window of the master grid."""

    def observe(self, data: SensorData) -> bool:
        """Offers a sensor message; True when a source of this layer takes it (by topic)."""
        del data
        return False

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Forgets what was observed in `region` (m), outside it with `invert`, everywhere when None: cells cleared."""
        del region, invert
        return 0

    def is_current(self, now: float) -> bool:
        """False when an expected sensor is silent for too long at `now` (s)."""
        del now
        return True

    def explain(self, ix: int, iy: int, master: Costmap) -> LayerSays | None:
        """What this layer says about a cell of `master`, and why; computed on request only. None: nothing to add."""
        del ix, iy, master
        return None

    @property
    def clearable(self) -> bool:
        """True for layers fed by sensors: what clear_costmap_recovery clears when no layer is named (parity 18)."""
        return False

    def set_footprint(self, footprint: Footprint) -> None:
        """The robot's outline changed."""
        del footprint


class CostmapServer(Protocol):
    """A layered costmap as recovery behaviours and the goal manager see it (`navstack.costmap.LayeredCostmap`)."""

    name: str
    frame: str
    robot_base_frame: str
    master: Costmap
    footprint: Footprint

    @property
    def layers(self) -> Sequence[Layer]:
        """In the order in which they write."""
        ...

    def observe(self, data: SensorData) -> None:
        """Hands a sensor message to every layer that listens to its topic."""
        ...

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """The robot in this costmap's frame; raises FrameError."""
        ...

    def update(self, now: float) -> Window:
        """One update around the robot's present pose; the window of cells that was rewritten."""
        ...

    def is_current(self, now: float) -> bool:
        """False when a layer's sensor is silent for too long."""
        ...

    def reset(self) -> int:
        """Resets every layer (move_base's clear_costmaps): cells cleared."""
        ...

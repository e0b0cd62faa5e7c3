"""Costmap layers, a layered costmap as seen by planners, behaviors and the goal manager, and why a cell has its cost."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Generic, NamedTuple, Protocol

from navstack.core import (
    Bounds,
    Costmap,
    Footprint,
    FrameTree,
    GridGeometry,
    NavError,
    OccupancyGrid,
    Pose2D,
    SensorData,
    Window,
    describe_cost,
    jsonable,
)
from navstack.plugins.checks import LayerTraits
from navstack.plugins.parameters import P, ParamModel

# --- why a cell has its cost ------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class CellExplanation:
    """What one layer knows about one cell."""

    cost: int | None
    """Cost of the cell in this layer; None if the layer leaves the cell unchanged."""
    text: str
    """The explanation in words."""
    source: str | None = None
    """Observation source of the cost (or "map", "mask")."""
    stamp: float | None = None
    """Time at which the source observed the cell (s)."""
    data: dict[str, Any] = field(default_factory=dict[str, Any])


@dataclass(frozen=True, slots=True)
class LayerShare:
    """Contribution of one layer to the cost of a cell."""

    layer: str
    """Instance name."""
    type: str
    """Class of the layer."""
    before: int
    """Cost in the master grid before this layer wrote."""
    after: int
    """Cost in the master grid after this layer wrote."""
    explanation: CellExplanation | None
    """The layer's own explanation; None if it has none."""


@dataclass(frozen=True, slots=True)
class CellProvenance:
    """Origin of the cost of one cell of a costmap, layer by layer."""

    costmap: str
    ix: int
    iy: int
    x: float
    """x of the cell's center (m), in the costmap's frame."""
    y: float
    """y of the cell's center (m)."""
    cost: int
    """Cost in the master grid."""
    set_by: str | None
    """Instance name of the layer that wrote this cost last; None if no layer wrote (default cost)."""
    source: str | None
    """Observation source of the cost; for an inflated cell, the source of its obstacle."""
    stamp: float | None
    """Time at which the source observed it (s)."""
    updated_at: float | None
    """Time of the costmap's last update (s)."""
    layers: tuple[LayerShare, ...]
    obstacle: CellProvenance | None = None
    """The lethal cell whose inflation set this cost."""
    stale: bool = False
    """True if the layers would now write another cost: the cell was outside the windows of the last updates."""

    @property
    def text(self) -> str:
        """The explanation in words, one line per layer."""
        by = "default cost, no layer wrote here" if self.set_by is None else f"set by {self.set_by}"
        if self.source is not None:
            by += f', from "{self.source}"' + ("" if self.stamp is None else f" at {self.stamp:.3f} s")
        lines = [
            f"{self.costmap} cell ({self.ix}, {self.iy}) at ({self.x:.3f}, {self.y:.3f}): {describe_cost(self.cost)}, {by}"
        ]
        for share in self.layers:
            text = share.explanation.text if share.explanation else "no explanation"
            lines.append(f"  {share.layer}: {share.before} -> {share.after}; {text}")
        if self.obstacle is not None:
            lines += ["  obstacle: " + self.obstacle.text.replace("\n", "\n  ")]
        if self.stale:
            lines.append("  the next update of this cell changes its cost")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return the explanation as a dictionary for JSON."""
        return {
            "costmap": self.costmap,
            "cell": [self.ix, self.iy],
            "at": [self.x, self.y],
            "cost": self.cost,
            "set_by": self.set_by,
            "source": self.source,
            "stamp": self.stamp,
            "updated_at": self.updated_at,
            "stale": self.stale,
            "layers": [_share_as_dict(share) for share in self.layers],
            "obstacle": self.obstacle.as_dict() if self.obstacle else None,
            "text": self.text,
        }


def _share_as_dict(share: LayerShare) -> dict[str, Any]:
    found = share.explanation
    return {
        "layer": share.layer,
        "type": share.type,
        "before": share.before,
        "after": share.after,
        "cost": found.cost if found else None,
        "text": found.text if found else None,
        "source": found.source if found else None,
        "stamp": found.stamp if found else None,
        "data": jsonable(found.data) if found else {},
    }


# --- layers and costmaps ----------------------------------------------------------------------------------------------


class Inflation(NamedTuple):
    """The costs that a layer writes around lethal cells: trunc(252 * exp(-cost_scaling_factor * (d - inscribed_radius)))."""

    inscribed_radius: float
    """Up to this distance the cost is 253 (m)."""
    inflation_radius: float
    """Beyond this distance the cost is 0 (m)."""
    cost_scaling_factor: float
    """Rate of the decay (1/m)."""


@dataclass(frozen=True, slots=True)
class LayerContext:
    """The costmap that a layer belongs to, as far as the layer needs it."""

    name: str
    """Instance name of the layer, which is also the namespace of its parameters: `inflation_layer`."""
    frame: str
    """The costmap's global frame."""
    frames: FrameTree
    footprint: Footprint
    """The robot's footprint, with the costmap's padding."""
    rolling_window: bool = False
    track_unknown_space: bool = False
    """The costmap's setting, the default of obstacle layers."""
    static_map: OccupancyGrid | None = None
    """The map of map_server; None without a map."""
    read_map: Callable[[str], OccupancyGrid] | None = None
    """Reads a map file by its path (`navstack.map_io.load_mask`), for layers with a map file in their parameters."""


class Layer(ABC, Generic[P]):
    """A layer of a costmap. Bounds may only grow; costs are written only inside the window."""

    Params: ClassVar[type[ParamModel]]
    LIVE: ClassVar[frozenset[str]] = frozenset()
    """Parameters that `set_params` may change at run time."""
    AS_NAV2: ClassVar[bool] = False
    """Whether the layer is one of Nav2's: a costmap with one rolls as in Nav2."""

    @classmethod
    def traits(cls, params: P) -> LayerTraits:
        """Return what a layer with these parameters does, for checks across parameters; default: fed by sensors."""
        return LayerTraits(enabled=bool(getattr(params, "enabled", True)))

    def __init__(self, params: P, context: LayerContext) -> None:
        self.params = params
        self.context = context
        self.name = context.name

    def set_params(self, params: P) -> None:
        """Replace the parameters at run time. They differ in `LIVE` and `live_parts` only; a rewrite of the costmap follows."""
        self.params = params

    def live_parts(self, params: P) -> frozenset[str]:
        """Return nested parameters, in addition to `LIVE`, whose differences in `params` may be applied at run time."""
        del params
        return frozenset()

    @abstractmethod
    def match_size(self, geometry: GridGeometry) -> None:
        """Allocate for a master grid of this geometry. Called before anything else, and after each change of the size."""

    def shift_to(self, geometry: GridGeometry) -> None:
        """Move the layer's cells to `geometry`, by whole cells, and keep the overlap (rolling window)."""
        del geometry

    @abstractmethod
    def update_bounds(self, robot: Pose2D, now: float, bounds: Bounds) -> Bounds:
        """Process the observations; return `bounds` (m) grown to contain every cell that may change."""

    @abstractmethod
    def update_costs(self, master: Costmap, window: Window) -> None:
        """Write the costs of this layer into the window of the master grid."""

    def observe(self, data: SensorData) -> bool:
        """Receive a sensor message; return True if an observation source of this layer accepts it (by topic)."""
        del data
        return False

    def reset(self, region: Bounds | None = None, *, invert: bool = False) -> int:
        """Clear the observations in `region` (m), outside it with `invert`, everywhere if None; return the cells cleared."""
        del region, invert
        return 0

    def is_current(self, now: float) -> bool:
        """Return False if an expected sensor has timed out at `now` (s)."""
        del now
        return True

    def problems(self) -> Sequence[NavError]:
        """Return why sensors that send data are not used, one error per sensor; the goal manager warns about them."""
        return ()

    def explain(self, ix: int, iy: int, master: Costmap) -> CellExplanation | None:
        """Explain this layer's cost of a cell of `master`; None without an explanation. Computed on request only."""
        del ix, iy, master
        return None

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """Return the speed limit (m/s) at a point (m) of the costmap's frame; None without a limit.

        `max_speed` (m/s) is the robot's unlimited speed, for limits in percent.
        """
        del x, y, max_speed
        return None

    @property
    def inflation(self) -> Inflation | None:
        """The costs that this layer writes around obstacles; None for a layer that does not inflate."""
        return None

    @property
    def clearable(self) -> bool:
        """True for layers with sensor data, which clear_costmap_recovery clears if no layer is named (parity 18)."""
        return False

    def set_footprint(self, footprint: Footprint) -> None:
        """Replace the robot's footprint."""
        del footprint


class CostmapServer(Protocol):
    """A layered costmap as recovery behaviors and the goal manager see it (`navstack.costmap.LayeredCostmap`)."""

    name: str
    frame: str
    robot_base_frame: str
    master: Costmap
    footprint: Footprint

    @property
    def layers(self) -> Sequence[Layer]:
        """The layers, in the order in which they write."""
        ...

    @property
    def limits_speed(self) -> bool:
        """True if a layer may limit the speed. Otherwise `speed_limit` need not be called."""
        ...

    def observe(self, data: SensorData) -> None:
        """Pass a sensor message to every layer that listens to its topic."""
        ...

    def robot_pose(self, now: float | None = None) -> Pose2D:
        """Return the robot's pose in this costmap's frame at `now` (s), or the newest. Raises FrameError."""
        ...

    def update(self, now: float) -> Window:
        """Update around the robot's pose at `now` (s); return the window of rewritten cells."""
        ...

    def is_current(self, now: float) -> bool:
        """Return False if a sensor of a layer has timed out at `now` (s)."""
        ...

    def problems(self) -> Sequence[NavError]:
        """Return why sensors that send data are not used, one error per sensor; empty without a problem."""
        ...

    def reset(self) -> int:
        """Reset every layer (move_base's clear_costmaps); return the cells cleared."""
        ...

    def explain(self, ix: int, iy: int) -> CellProvenance | None:
        """Explain which layer and observation source set the cost of a cell; None if the costmap has no explanation."""
        ...

    def speed_limit(self, x: float, y: float, max_speed: float) -> float | None:
        """Return the lowest speed limit (m/s) of all layers at a point (m) of the costmap's frame; None without a limit.

        `max_speed` (m/s) is the robot's unlimited speed, for limits in percent.
        """
        ...

"""Where the cost of a cell comes from: which layer, which source, when, and what every layer says there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from navstack.core import Costmap, Window, describe_cost
from navstack.core.errors import InputError, jsonable
from navstack.costmap.inflation_layer import InflationLayer
from navstack.interfaces import LayerSays

if TYPE_CHECKING:
    from navstack.costmap.layered_costmap import LayeredCostmap


@dataclass(frozen=True, slots=True)
class LayerShare:
    """One layer's part in a cell."""

    layer: str
    """Instance name."""
    type: str
    """Class of the layer."""
    before: int
    """Cost of the master before this layer wrote."""
    after: int
    """And after."""
    says: LayerSays | None
    """The layer's own account; None when it keeps none."""


@dataclass(frozen=True, slots=True)
class CellProvenance:
    """The account of one cell."""

    costmap: str
    ix: int
    iy: int
    x: float
    """Centre of the cell (m), in the costmap's frame."""
    y: float
    cost: int
    """Of the master as it stands."""
    set_by: str | None
    """Instance name of the layer that wrote this cost last; None: the default, no layer wrote."""
    source: str | None
    """Observation source behind it, through the inflation too."""
    stamp: float | None
    """When that source saw it (s)."""
    updated_at: float | None
    """Time of the costmap's last update (s)."""
    layers: tuple[LayerShare, ...]
    obstacle: CellProvenance | None = None
    """The obstacle whose inflation this is."""
    stale: bool = False
    """The layers would write another cost by now: the cell lay outside the windows of the last updates."""

    @property
    def text(self) -> str:
        """The account in words, a line per layer."""
        by = "the default: no layer wrote here" if self.set_by is None else f"set by {self.set_by}"
        if self.source is not None:
            by += f', from "{self.source}"' + ("" if self.stamp is None else f" at {self.stamp:.3f} s")
        lines = [
            f"{self.costmap} cell ({self.ix}, {self.iy}) at ({self.x:.3f}, {self.y:.3f}): {describe_cost(self.cost)}, {by}"
        ]
        for share in self.layers:
            told = share.says.text if share.says else "no account"
            lines.append(f"  {share.layer}: {share.before} -> {share.after}; {told}")
        if self.obstacle is not None:
            lines += ["  its obstacle: " + self.obstacle.text.replace("\n", "\n  ")]
        if self.stale:
            lines.append("  the next update that touches this cell will change it")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
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
            "layers": [
                {
                    "layer": s.layer,
                    "type": s.type,
                    "before": s.before,
                    "after": s.after,
                    "cost": s.says.cost if s.says else None,
                    "text": s.says.text if s.says else None,
                    "source": s.says.source if s.says else None,
                    "stamp": s.says.stamp if s.says else None,
                    "data": jsonable(s.says.data) if s.says else {},
                }
                for s in self.layers
            ],
            "obstacle": self.obstacle.as_dict() if self.obstacle else None,
            "text": self.text,
        }


def explain_cell(costmap: LayeredCostmap, x: float, y: float) -> CellProvenance:
    """See `LayeredCostmap.explain_cell`."""
    cell = costmap.master.geometry.world_to_cell(x, y)
    if cell is None:
        left, right, bottom, top = costmap.master.geometry.extent
        raise InputError(
            f"({x:g}, {y:g}) is off {costmap.name}, which covers x {left:.2f} .. {right:.2f}, y {bottom:.2f} .. {top:.2f} m",
            at=[x, y],
        )
    return _explain(costmap, *cell, follow=True)


def _explain(costmap: LayeredCostmap, ix: int, iy: int, *, follow: bool) -> CellProvenance:
    master = costmap.master
    nx, ny = master.geometry.nx, master.geometry.ny
    # inflation looks as far as its radius: write that much once more
    reach = 1 + max((x.radius_cells for x in costmap.layers if isinstance(x, InflationLayer)), default=0)
    window = Window(max(0, ix - reach), max(0, iy - reach), min(nx, ix + reach + 1), min(ny, iy + reach + 1))
    copy = Costmap(master.geometry, master.data.copy(), master.frame)
    copy.data[window.slices] = costmap.default_cost
    shares: list[LayerShare] = []
    set_by: LayerShare | None = None
    for layer in costmap.layers:
        before = int(copy.data[iy, ix])
        layer.update_costs(copy, window)
        after = int(copy.data[iy, ix])
        share = LayerShare(layer.name, type(layer).__name__, before, after, layer.explain(ix, iy, copy))
        shares.append(share)
        if after != before:
            set_by = share
    obstacle: CellProvenance | None = None
    says = set_by.says if set_by else None
    if follow and says is not None and "obstacle_cell" in says.data:
        obstacle = _explain(costmap, *says.data["obstacle_cell"], follow=False)
    origin = obstacle if obstacle is not None else says
    cx, cy = master.geometry.cell_to_world(ix, iy)
    cost = int(master.data[iy, ix])
    return CellProvenance(
        costmap.name,
        ix,
        iy,
        cx,
        cy,
        cost,
        set_by.layer if set_by else None,
        origin.source if origin else None,
        origin.stamp if origin else None,
        costmap.updated_at,
        tuple(shares),
        obstacle,
        cost != int(copy.data[iy, ix]),
    )

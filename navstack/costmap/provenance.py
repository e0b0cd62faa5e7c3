"""Origin of the cost of a cell: which layer and which observation source set it, and when."""

from __future__ import annotations

from typing import TYPE_CHECKING

from navstack.core import Costmap, Window
from navstack.costmap.inflation_layer import InflationLayer
from navstack.interfaces import CellProvenance, LayerShare

if TYPE_CHECKING:
    from navstack.costmap.layered_costmap import LayeredCostmap


def explain_cell(costmap: LayeredCostmap, ix: int, iy: int, *, follow: bool = True) -> CellProvenance:
    """Explain a cell by writing its surroundings again, layer by layer, into a copy of the master grid.

    With `follow`, the explanation of an inflated cell includes that of its obstacle.
    """
    master = costmap.master
    nx, ny = master.geometry.nx, master.geometry.ny
    # an inflated cost depends on cells up to the inflation radius away
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
    found = set_by.explanation if set_by else None
    obstacle: CellProvenance | None = None
    if follow and found is not None and "obstacle_cell" in found.data:
        obstacle = explain_cell(costmap, *found.data["obstacle_cell"], follow=False)
    origin = obstacle if obstacle is not None else found
    x, y = master.geometry.cell_to_world(ix, iy)
    cost = int(master.data[iy, ix])
    return CellProvenance(
        costmap.name,
        ix,
        iy,
        x,
        y,
        cost,
        set_by.layer if set_by else None,
        origin.source if origin else None,
        origin.stamp if origin else None,
        costmap.updated_at,
        tuple(shares),
        obstacle,
        stale=cost != int(copy.data[iy, ix]),
    )

"""Which layer is behind it when a planner finds the start or the goal occupied: planners see costs only, costmaps know whose."""

from __future__ import annotations

from typing import TypeVar

from navstack.core.errors import GoalOccupiedError, NavError, StartOccupiedError
from navstack.costmap.layered_costmap import LayeredCostmap

E = TypeVar("E", bound=NavError)


def with_layer(costmap: object, error: E) -> E:
    """The error with the layer that set the occupied cell's cost, in its message and its data.

    `data["layer"]` is the layer's instance name, `data["source"]` the observation source behind it (or "map"), `data["stamp"]`
    when that saw it (s); None where there is none. Errors of other kinds, and those about costs that are not this
    costmap's (any more), come back as they are.
    """
    cell, cost = error.data.get("cell"), error.data.get("cost")
    if not isinstance(error, (StartOccupiedError, GoalOccupiedError)) or not isinstance(costmap, LayeredCostmap):
        return error
    if cell is None or "layer" in error.data:
        return error
    master = costmap.master
    ix, iy = cell
    if not master.geometry.contains_cell(ix, iy) or int(master.data[iy, ix]) != cost:
        return error
    told = costmap.explain_cell(*master.geometry.cell_to_world(ix, iy))
    if told.set_by is None:
        return error
    data = {**error.data, "layer": told.set_by, "source": told.source, "stamp": told.stamp}
    seen = "" if told.source is None else f', from "{told.source}"'
    seen += "" if told.stamp is None else f" at {told.stamp:.3f} s"
    what = "goal" if isinstance(error, GoalOccupiedError) else "start"
    return type(error)(
        f"{error.message}; the cost of the {what}'s cell was set by the layer {told.set_by}{seen}", **data
    )

"""Adds the layer behind an occupied start or goal cell to the planner's error: planners see costs, costmaps their origin."""

from __future__ import annotations

from typing import TypeVar

from navstack.core.errors import GoalOccupiedError, NavError, StartOccupiedError
from navstack.interfaces import CostmapServer
from navstack.move_base import plugin_calls

E = TypeVar("E", bound=NavError)


def add_layer(costmap: CostmapServer, error: E) -> E:
    """Return the error with the layer that set the occupied cell's cost, in its message and its data.

    `data["layer"]` is the instance name of the layer, `data["source"]` its observation source (or "map"), `data["stamp"]` the
    time of the observation (s); the last two are None if unknown. Errors of other kinds, and errors about costs that are not
    in this costmap (any more), are returned unchanged.
    """
    cell, cost = error.data.get("cell"), error.data.get("cost")
    if not isinstance(error, (StartOccupiedError, GoalOccupiedError)) or cell is None or "layer" in error.data:
        return error
    master = costmap.master
    ix, iy = cell
    if not master.geometry.contains_cell(ix, iy) or int(master.data[iy, ix]) != cost:
        return error
    found = plugin_calls.call(costmap, costmap.explain, ix, iy)
    if found is None or found.set_by is None:
        return error
    data = {**error.data, "layer": found.set_by, "source": found.source, "stamp": found.stamp}
    origin = "" if found.source is None else f', from "{found.source}"'
    origin += "" if found.stamp is None else f" at {found.stamp:.3f} s"
    pose = "goal" if isinstance(error, GoalOccupiedError) else "start"
    return type(error)(
        f"{error.message}; the cost of the {pose}'s cell was set by the layer {found.set_by}{origin}", **data
    )

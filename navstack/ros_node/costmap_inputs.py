"""Messages that change a costmap: a footprint, and a part of the map."""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack.core import Footprint, InputError, NavError
from navstack.costmap import LayeredCostmap, StaticLayer


def use_footprint(costmap: LayeredCostmap, message: Any) -> None:
    """Use another footprint (geometry_msgs/Polygon), padded by `footprint_padding`. Raises InputError for no polygon."""
    points = np.array([(point.x, point.y) for point in message.points], np.float64).reshape(-1, 2)
    try:
        footprint = Footprint(points, costmap.params.footprint_padding)
    except NavError as exc:
        raise InputError(f"a footprint of {costmap.name} is ignored: {exc.message}") from exc
    costmap.set_footprint(footprint)


def use_map_update(layer: StaticLayer, message: Any) -> None:
    """Change a part of the map (map_msgs/OccupancyGridUpdate). Raises InputError for one that is not inside the map."""
    height, width = int(message.height), int(message.width)
    data = np.asarray(message.data, np.int8)
    if height * width != len(data):
        raise InputError(f"an update of the map of {width} x {height} cells has {len(data)} values; it is ignored")
    layer.update_map(int(message.x), int(message.y), data.reshape(height, width))

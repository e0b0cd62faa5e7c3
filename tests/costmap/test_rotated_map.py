"""Maps whose origin has a yaw: no obstacle and no wall is lost."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy import ndimage

from navstack.core import Footprint, FrameTree, GridGeometry, OccupancyGrid, Pose2D
from navstack.costmap import CostmapParams, LayeredCostmap
from tests.costmap.build import static


@pytest.mark.slow
@pytest.mark.parametrize("yaw", [0.1, 0.4, -0.7, math.pi / 4, 2.0, -3.0])
def test_no_obstacle_is_lost_and_walls_stay_closed(yaw: float) -> None:
    data = np.zeros((40, 50), np.int8)
    data[[0, -1], :] = data[:, [0, -1]] = 100
    data[4:36:4, 4:46:4] = 100
    grid = OccupancyGrid(data, GridGeometry(50, 40, 0.05, 1.0, -2.0), yaw)
    costmap = LayeredCostmap(
        "global_costmap",
        CostmapParams(global_frame="map"),
        [static()],
        footprint=Footprint.from_radius(0.2),
        frames=FrameTree(),
        static_map=grid,
    )
    costmap.update_at(Pose2D(1.0, -2.0), 0.0)
    master = costmap.master
    g = master.geometry
    low_x, low_y = np.meshgrid(g.origin_x + np.arange(g.nx) * 0.05, g.origin_y + np.arange(g.ny) * 0.05)
    cells = shapely.box(low_x, low_y, low_x + 0.05, low_y + 0.05)
    rows, columns = np.nonzero(data)
    squares = shapely.box(columns * 0.05, rows * 0.05, (columns + 1) * 0.05, (rows + 1) * 0.05)
    c, s = math.cos(yaw), math.sin(yaw)
    placed = shapely.transform(squares, lambda p: p @ np.array([[c, s], [-s, c]]) + (1.0, -2.0))
    area = shapely.area(shapely.intersection(cells, shapely.union_all(placed)))
    assert (master.data[area > 1e-9] == 254).all()
    assert (area[master.data == 254] > 0.0).all()
    # inside (free) and outside (unknown) stay apart, also diagonally
    parts, number = ndimage.label(master.data != 254, np.ones((3, 3)))
    for part in range(1, number + 1):
        assert len(np.unique(master.data[parts == part])) == 1
    for x, y, cost in ((0.125, 0.125, 0), (-0.1, 1.0, 255), (1.25, 2.1, 255)):
        assert master.cost_at(1.0 + x * c - y * s, -2.0 + x * s + y * c) in (cost, None)

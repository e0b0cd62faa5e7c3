"""Small fleets for the tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.fleet import Fleet, make_fleet
from navstack.parameters import load_configuration
from navstack.routes import build_graph
from navstack.scenario import Scenario


def corridor(length: float = 8.0, width: float = 3.0) -> OccupancyGrid:
    """Return a corridor along x, from (0, 0), with walls around it."""
    cells = np.zeros((round(width / 0.05), round(length / 0.05)), np.int8)
    cells[:2] = cells[-2:] = 100
    cells[:, :2] = cells[:, -2:] = 100
    return OccupancyGrid(cells, GridGeometry(cells.shape[1], cells.shape[0], 0.05))


MAP = corridor()


def scenario(
    start: tuple[float, float, float],
    *goals: tuple[float, float, float],
    overrides: tuple[str, ...] = (),
    time: float = 60.0,
    params: str = "turtlebot",
) -> Scenario:
    """Return a turtlebot in the corridor."""
    configuration = load_configuration([params], overrides=overrides)
    return Scenario(MAP, configuration, Pose2D(*start), tuple(Pose2D(*goal) for goal in goals), time_limit_s=time)


ROAD = build_graph(
    {0: (1.0, 1.2), 1: (2.5, 1.2), 2: (4.0, 1.2), 3: (5.5, 1.2), 4: (7.0, 1.2), 5: (4.0, 2.4)},
    [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5)],
    both_ways=True,
)
"""Along the corridor, with a bay beside its middle."""


def guided(starts: dict[str, int], routes: dict[str, list[int]], **values: Any) -> Fleet:
    """Return turtlebots that begin at nodes of the road and drive to others; `values`: arguments of `make_fleet`."""
    at = {name: ROAD.xy[ROAD.node(node)].tolist() for name, node in starts.items()}
    robots = {name: scenario((x, y, 0.0), params="turtlebot_rpp", time=75.0) for name, (x, y) in at.items()}
    values = {"traffic": {"rule": "reservation"}, "seed": 1, **values}
    return make_fleet(robots, routes=routes, graph=ROAD, **values)


EAST = scenario((1.0, 1.0, 0.0), (6.0, 1.0, 0.0))
WEST = scenario((7.0, 2.0, 3.14), (2.0, 2.0, 3.14))

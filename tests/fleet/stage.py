"""Small fleets for the tests."""

from __future__ import annotations

import numpy as np

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.parameters import load_configuration
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
) -> Scenario:
    """Return a turtlebot in the corridor."""
    configuration = load_configuration(["turtlebot"], overrides=overrides)
    return Scenario(MAP, configuration, Pose2D(*start), tuple(Pose2D(*goal) for goal in goals), time_limit_s=time)


EAST = scenario((1.0, 1.0, 0.0), (6.0, 1.0, 0.0))
WEST = scenario((7.0, 2.0, 3.14), (2.0, 2.0, 3.14))

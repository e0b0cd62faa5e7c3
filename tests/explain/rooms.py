"""Maps of two rooms, separated by a wall with doors at any angle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from navstack.core import GridGeometry, OccupancyGrid, Pose2D
from navstack.parameters import Configuration
from navstack.scenario import Scenario, run_scenario

RESOLUTION = 0.05
SIZE_M = 8.0


def two_rooms(
    doors: dict[float, float], *, angle: float = 0.0, thickness: float = 0.2, resolution: float = RESOLUTION
) -> OccupancyGrid:
    """A square room of 8 m, split by a wall through its center at `angle`; `doors`: position along the wall (m) -> width (m).

    A cell is occupied if its center is inside a wall.
    """
    n = round(SIZE_M / resolution)
    center = (np.arange(n) + 0.5) * resolution - SIZE_M / 2.0
    x, y = np.meshgrid(center, center)
    along = math.cos(angle) * x + math.sin(angle) * y
    across = -math.sin(angle) * x + math.cos(angle) * y
    wall = np.abs(across) <= thickness / 2.0
    for at, width in doors.items():
        wall &= ~(np.abs(along - at) < width / 2.0 - 1e-9)
    wall |= (np.abs(x) > SIZE_M / 2.0 - 0.1) | (np.abs(y) > SIZE_M / 2.0 - 0.1)
    return OccupancyGrid(np.where(wall, 100, 0).astype(np.int8), GridGeometry(n, n, resolution, -4.0, -4.0))


def bare_room() -> OccupancyGrid:
    """The room without the dividing wall."""
    grid = two_rooms({})
    data = grid.data.copy()
    data[2:-2, 2:-2] = 0
    return OccupancyGrid(data, grid.geometry)


def with_boxes(grid: OccupancyGrid, *boxes: tuple[float, float, float, float], value: int = 100) -> OccupancyGrid:
    """The map with boxes x0, y0, x1, y1 (m) set to `value`."""
    data = grid.data.copy()
    g = grid.geometry
    for x0, y0, x1, y1 in boxes:
        (a, b), (c, d) = (
            (round((x - g.origin_x) / g.resolution), round((y - g.origin_y) / g.resolution))
            for x, y in ((x0, y0), (x1, y1))
        )
        data[b:d, a:c] = value
    return OccupancyGrid(data, g, grid.origin_yaw, grid.frame)


def record_drive(folder: Path, configuration: Configuration, start: Pose2D, goal: Pose2D) -> Path:
    """Drive through an empty room of 4 by 3 m, corner at the origin, and save the record in `folder`; return it."""
    cells = np.zeros((60, 80), np.int8)
    cells[[0, -1], :] = 100
    cells[:, [0, -1]] = 100
    result = run_scenario(Scenario(OccupancyGrid(cells, GridGeometry(80, 60, 0.05)), configuration, start, (goal,)))
    assert result.goals[0].state == "SUCCEEDED" and result.recorder is not None
    result.recorder.save(folder)
    return folder

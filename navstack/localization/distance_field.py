"""Distance from every cell of a map to the nearest occupied one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import OccupancyGrid
from navstack.core.errors import InputError
from navstack.localization import _field_kernels

OCCUPIED = 100
"""A cell of an occupancy grid that is certainly occupied; amcl takes every other value but 0 for unknown."""


def squared_cells(grid: OccupancyGrid, max_distance: float) -> tuple[NDArray[np.int32], int]:
    """Return the squared distance in cells to the nearest occupied cell, (ny, nx), and the greatest one that is distinguished.

    Exact, between centres of cells; unknown cells are no obstacles. Greater distances than `max_distance` (m) have any greater
    value. Raises InputError unless `max_distance` is positive.
    """
    if not (math.isfinite(max_distance) and max_distance > 0.0):
        raise InputError(
            f"the greatest distance must be positive and finite, not {max_distance} m", argument="max_distance"
        )
    ny, nx = grid.geometry.shape
    radius = min(int(max_distance / grid.geometry.resolution), nx + ny)
    squares = np.empty((ny, nx), np.int32)
    scratch = np.empty((ny, nx + 2 * radius), np.int32)
    _field_kernels.square_distances(grid.data == OCCUPIED, radius, scratch, squares)
    return squares, radius


def distance_field(grid: OccupancyGrid, max_distance: float) -> NDArray[np.float32]:
    """Return the distance (m) from each cell to the nearest occupied one, (ny, nx); `max_distance` (m) where it is farther."""
    squares, radius = squared_cells(grid, max_distance)
    values = distances_of(radius, grid.geometry.resolution, max_distance)
    table = np.empty((squares.shape[0] + 2, squares.shape[1] + 2))
    _field_kernels.look_up(squares, values, table)
    return table[1:-1, 1:-1].astype(np.float32)


def distances_of(radius: int, resolution: float, max_distance: float) -> NDArray[np.float64]:
    """Return the distance (m) of each squared distance in cells up to `radius`², and `max_distance` as the last one."""
    return np.append(np.sqrt(np.arange(radius * radius + 1.0)) * resolution, max_distance)

"""Distance from every cell of a map to the nearest occupied one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from navstack.core import InputError, OccupancyGrid, kernel

# ----------------------------------------------------------------------------------------------------------------------
# Distance to the nearest occupied cell: the likelihood field's basis.


@kernel
def square_distances(
    occupied: NDArray[np.bool_], radius: int, columns: NDArray[np.int32], out: NDArray[np.int32]
) -> None:
    """Fill `out` (ny, nx) with the exact squared distance in cells to the nearest cell that is `occupied` (ny, nx).

    Distances above `radius` (cells) become at least (radius + 1)². `columns` is a scratch array (ny, nx + 2 * radius). First the
    distance along each column, then the least sum of squares along each row: every step runs over contiguous memory.
    """
    ny, nx = occupied.shape
    far = radius + 1
    columns[:] = far * far
    for iy in range(ny):
        for ix in range(nx):
            above = columns[iy - 1, ix + radius] + 1 if iy > 0 else far
            columns[iy, ix + radius] = 0 if occupied[iy, ix] else min(above, far)
    for iy in range(ny - 2, -1, -1):
        for ix in range(radius, nx + radius):
            columns[iy, ix] = min(columns[iy, ix], columns[iy + 1, ix] + 1)
    for iy in range(ny):
        near = False
        for ix in range(radius, nx + radius):
            near |= columns[iy, ix] < far
            columns[iy, ix] *= columns[iy, ix]
        row = columns[iy]
        best = out[iy]
        best[:] = row[radius : radius + nx]
        if not near:
            continue
        for d in range(1, radius + 1):
            square = np.int32(d * d)
            left = row[radius - d : radius - d + nx]
            right = row[radius + d : radius + d + nx]
            for ix in range(nx):
                best[ix] = min(best[ix], min(left[ix], right[ix]) + square)


@kernel
def look_up(squares: NDArray[np.int32], values: NDArray[np.float64], out: NDArray[np.float64]) -> None:
    """Fill the interior of `out` (ny + 2, nx + 2) with `values[squares]`; the last value is that of the rest."""
    ny, nx = squares.shape
    last = len(values) - 1
    out[:] = values[last]
    for iy in range(ny):
        for ix in range(nx):
            out[iy + 1, ix + 1] = values[min(squares[iy, ix], last)]


OCCUPIED = 100
"""A cell of an occupancy grid that is certainly occupied; amcl takes every other value but 0 for unknown."""


def squared_cells(grid: OccupancyGrid, max_distance: float) -> tuple[NDArray[np.int32], int]:
    """Return the squared distance in cells to the nearest occupied cell, (ny, nx), and the greatest one that is distinguished.

    Exact, between centers of cells; unknown cells are no obstacles. Greater distances than `max_distance` (m) have any greater
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
    square_distances(grid.data == OCCUPIED, radius, scratch, squares)
    return squares, radius


def distance_field(grid: OccupancyGrid, max_distance: float) -> NDArray[np.float32]:
    """Return the distance (m) from each cell to the nearest occupied one, (ny, nx); `max_distance` (m) where it is farther."""
    squares, radius = squared_cells(grid, max_distance)
    values = distances_of(radius, grid.geometry.resolution, max_distance)
    table = np.empty((squares.shape[0] + 2, squares.shape[1] + 2))
    look_up(squares, values, table)
    return table[1:-1, 1:-1].astype(np.float32)


def distances_of(radius: int, resolution: float, max_distance: float) -> NDArray[np.float64]:
    """Return the distance (m) of each squared distance in cells up to `radius`², and `max_distance` as the last one."""
    return np.append(np.sqrt(np.arange(radius * radius + 1.0)) * resolution, max_distance)

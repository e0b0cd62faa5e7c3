"""Distance to the nearest occupied cell: the likelihood field's basis."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from navstack.core.jit import kernel


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

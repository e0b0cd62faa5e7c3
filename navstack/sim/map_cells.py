"""Occupied cells as unit squares: tables of free areas, and intersection tests. Lengths are in cells.

Free squares: `squares[q, iy, ix]` = c means that the c x c cells with corner (ix, iy) that extend in quadrant q are free (q & 1:
towards smaller x, q & 2: towards smaller y); 0 is an occupied cell. Free rectangles (for rays): one per octant, square or four
times as long as wide.
"""
# pyright: reportMissingParameterType=false, reportUnknownParameterType=false
# numba infers the types of the kernels' arguments

from __future__ import annotations

import hashlib
import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from navstack.core import kernel, plain_kernel
from navstack.sim.solids import polygon_contains


@kernel
def free_squares(occupied):
    """(4, ny, nx) uint8 free squares of a map; at most 255, and within the map."""
    ny, nx = occupied.shape
    squares = np.empty((4, ny, nx), np.uint8)
    for q in range(4):
        sx = -1 if q & 1 else 1
        sy = -1 if q & 2 else 1
        for j in range(ny):
            iy = j if sy < 0 else ny - 1 - j
            for i in range(nx):
                ix = i if sx < 0 else nx - 1 - i
                if occupied[iy, ix]:
                    squares[q, iy, ix] = 0
                    continue
                # one more than the smallest of the three neighboring squares in the quadrant
                side = 0
                if i > 0 and j > 0:
                    side = min(squares[q, iy, ix + sx], squares[q, iy + sy, ix])
                    side = min(min(side, squares[q, iy + sy, ix + sx]), 254)
                squares[q, iy, ix] = side + 1
    return squares


@kernel
def free_rectangles(squares):
    """(8, ny, nx) uint8 from the free squares: the larger of two free rectangles that have the cell as their corner.

    In octant 2 q the ray is in quadrant q and advances faster in x than in y, in 2 q + 1 faster in y. Bits 0 to 6 are the
    short side in cells; bit 7 means that the other side, along the faster axis, is four times as long. Averaged over the
    directions of the octant, a ray covers short * (1 + ln(long / short)), which determines the choice.
    """
    quadrants, ny, nx = squares.shape
    leaps = np.empty((2 * quadrants, ny, nx), np.uint8)
    thin = np.empty((ny, nx), np.uint8)
    run = np.empty(nx, np.int64)
    for octant in range(2 * quadrants):
        q = octant >> 1
        along_x = octant & 1 == 0
        ax, ay = (4, 1) if along_x else (1, 4)
        sx = -1 if q & 1 else 1
        sy = -1 if q & 2 else 1
        run[:] = 0
        for j in range(ny):
            iy = j if sy < 0 else ny - 1 - j
            for i in range(nx):
                ix = i if sx < 0 else nx - 1 - i
                # number of consecutive free cells along the long side
                if squares[q, iy, ix] == 0:
                    run[ix] = 0
                elif along_x:
                    run[ix] = run[ix + sx] + 1 if i > 0 else 1
                else:
                    run[ix] += 1
                side = 0
                if run[ix] >= 4:
                    # the rectangles one long and one short step away are free, and so is the first strip
                    if i >= ax and j >= ay:
                        side = min(thin[iy, ix + ax * sx], thin[iy + ay * sy, ix])
                        side = min(min(side, thin[iy + ay * sy, ix + ax * sx]), 126)
                    side += 1
                thin[iy, ix] = side
                square = min(squares[q, iy, ix], 127)
                leaps[octant, iy, ix] = 128 + side if side * 2.386 > square else square
    return leaps


@plain_kernel
def free_around(squares, ix, iy):
    """Number of free cells in every direction from the cell, diagonals included; -1 if the cell is occupied."""
    return int(min(min(squares[0, iy, ix], squares[1, iy, ix]), min(squares[2, iy, ix], squares[3, iy, ix]))) - 1


@plain_kernel
def segment_meets_square(x0, y0, x1, y1, left, bottom):
    """True if the segment intersects the unit square with that corner (Liang and Barsky, 1984)."""
    t0, t1 = 0.0, 1.0
    d = x1 - x0
    if d == 0.0:
        if x0 < left or x0 > left + 1.0:
            return False
    else:
        a, b = (left - x0) / d, (left + 1.0 - x0) / d
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    d = y1 - y0
    if d == 0.0:
        if y0 < bottom or y0 > bottom + 1.0:
            return False
    else:
        a, b = (bottom - y0) / d, (bottom + 1.0 - y0) / d
        t0, t1 = max(t0, min(a, b)), min(t1, max(a, b))
    return t0 <= t1


@plain_kernel
def is_free_around(squares, x, y, radius):
    """True if the free square of the point's cell shows that no occupied cell meets the circle around the point."""
    _, ny, nx = squares.shape
    ix, iy = math.floor(x), math.floor(y)
    return 0 <= ix < nx and 0 <= iy < ny and free_around(squares, ix, iy) >= radius


@plain_kernel
def polygon_on_cells(squares, polygon):
    """Index iy * nx + ix of an occupied cell that the polygon (n, 2) intersects, -1 if there is none. Exact.

    A polygon intersects a square if one of its edges does, or if it contains the square's center.
    """
    _, ny, nx = squares.shape
    n = polygon.shape[0]
    x0, y0 = polygon[0, 0], polygon[0, 1]
    x1, y1 = x0, y0
    for i in range(1, n):
        x0, x1 = min(x0, polygon[i, 0]), max(x1, polygon[i, 0])
        y0, y1 = min(y0, polygon[i, 1]), max(y1, polygon[i, 1])
    # clip to the map before the conversion to integers, which a distant or huge polygon would overflow
    if x1 < 0.0 or y1 < 0.0 or x0 >= nx or y0 >= ny:
        return -1
    first_x, last_x = math.floor(max(x0, 0.0)), math.floor(min(x1, nx - 1.0))
    first_y, last_y = math.floor(max(y0, 0.0)), math.floor(min(y1, ny - 1.0))
    for iy in range(first_y, last_y + 1):
        for ix in range(first_x, last_x + 1):
            if squares[0, iy, ix] != 0:
                continue
            j = n - 1
            for i in range(n):
                if segment_meets_square(
                    polygon[j, 0], polygon[j, 1], polygon[i, 0], polygon[i, 1], float(ix), float(iy)
                ):
                    return iy * nx + ix
                j = i
            if polygon_contains(polygon, ix + 0.5, iy + 0.5):
                return iy * nx + ix
    return -1


class CellTables:
    """Tables of a map's occupied cells for the kernels."""

    def __init__(self, occupied: NDArray[np.bool_]) -> None:
        self.squares: NDArray[np.uint8] = free_squares(occupied)
        """(4, ny, nx) free squares of every cell."""

    @cached_property
    def leaps(self) -> NDArray[np.uint8]:
        """(8, ny, nx) free rectangles for rays."""
        return free_rectangles(self.squares)


_TABLES: dict[bytes, CellTables] = {}
"""Hash of the occupied cells -> tables of the most recently used maps; many runs share a map."""
_MAX_TABLES = 4


def cell_tables(occupied: NDArray[np.bool_]) -> CellTables:
    """Return the tables of a map's occupied cells (ny, nx), those of an earlier call where they are the same."""
    key = hashlib.blake2b(np.packbits(occupied).tobytes(), key=repr(occupied.shape).encode()).digest()
    tables = _TABLES.pop(key, None)
    if tables is None:
        tables = CellTables(occupied)
    _TABLES[key] = tables  # most recent last
    if len(_TABLES) > _MAX_TABLES:
        del _TABLES[next(iter(_TABLES))]
    return tables

"""Tracebacks: from the potential of a wave to a path."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D, kernel
from navstack.global_planner._search.cells import NAVFN_NEUTRAL, Cell, position_in_cells
from navstack.global_planner._search.propagation import WaveQuery
from navstack.global_planner._search.wavefront import Wavefront

# ----------------------------------------------------------------------------------------------------------------------
# From a potential to a path: gradient descent, or from cell to cell.
#
# Both descend to the root, where the potential is 0, and both always reach it: a cell with a potential has a 4-neighbor with a
# lower one (the cell it was reached from), so a step to the lowest neighbor always makes progress, and gradient descent falls
# back on such steps whenever it stops making progress.
#
# A path stays in cells that have a potential, between its points too; it touches other cells at most in a corner or along an
# edge. A diagonal step from center to center may pass the corner of a cell without potential, as in C++, but never between two
# of them (requiring both to be free makes paths through cluttered maps 0.5 % more expensive than those of C++). A gradient
# step stays within its cell and the 8 neighbors, which all have a potential. Other steps are checked.


# pyright: basic


HIGH = np.float32(1e10)


@kernel
def _slope(pot, k, before, after):
    """Difference of the potential along one axis at cell k, positive where it decreases toward `after`."""
    here = pot[k]
    lower, upper = pot[before], pot[after]
    s = np.float32(0.0)
    if lower < HIGH:
        s += lower - here
    if upper < HIGH:
        s += here - upper
    return s


@kernel
def _direction(pot, k, nx):
    """Unit vector of steepest descent at a cell with a potential; (0, 0) where the potential is flat."""
    gx = _slope(pot, k, k - 1, k + 1)
    gy = _slope(pot, k, k - nx, k + nx)
    norm = np.float32(np.hypot(gx, gy))
    if norm > 0.0:
        return gx / norm, gy / norm
    return np.float32(0.0), np.float32(0.0)


@kernel
def _interpolated(pot, k, nx, dx, dy):
    """Bilinear mean of the directions at the four cells k, right, up, up right, for the point (dx, dy) from k."""
    gx = np.float32(0.0)
    gy = np.float32(0.0)
    whole = np.float32(1.0)
    for j in range(2):
        wy = dy if j else whole - dy
        for i in range(2):
            w = wy * (dx if i else whole - dx)
            ux, uy = _direction(pot, k + j * nx + i, nx)
            gx += w * ux
            gy += w * uy
    return gx, gy


@kernel
def _lowest_neighbor(pot, k, nx):
    """The lowest of the 8 neighbors; k if none is lower. No step passes between two cells without potential."""
    best = k
    low = pot[k]
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            n = k + dy * nx + dx
            if pot[n] < low and (dx == 0 or dy == 0 or pot[k + dx] < HIGH or pot[k + dy * nx] < HIGH):
                low = pot[n]
                best = n
    return best


@kernel
def _is_surrounded(pot, k, nx):
    """True if the cell and its 8 neighbors all have a potential."""
    for dy in (-nx, 0, nx):
        for n in range(k + dy - 1, k + dy + 2):
            if not pot[n] < HIGH:
                return False
    return True


@kernel
def _crosses(pot, k, nx, ax, ay, bx, by):
    """True if the line between two points, in cells from the center of k, crosses one of its 3 x 3 cells without potential.

    Touching a corner or an edge does not count. Both points are in these nine cells.
    """
    for cy in (-1, 0, 1):
        for cx in (-1, 0, 1):
            if pot[k + cy * nx + cx] < HIGH:
                continue
            enter, leave = 0.0, 1.0
            for axis in range(2):
                a, d, c = (ax, bx - ax, cx) if axis == 0 else (ay, by - ay, cy)
                if d == 0.0:
                    if abs(a - c) >= 0.5:
                        leave = -1.0
                else:
                    t = (c - 0.5 - a) / d
                    u = (c + 0.5 - a) / d
                    enter = max(enter, min(t, u))
                    leave = min(leave, max(t, u))
            if enter < leave - 1e-6:
                return True
    return False


@kernel
def _doubled(points):
    """`points` (n, 2) in an array of twice the length."""
    larger = np.empty((2 * points.shape[0], 2), np.float32)
    for i in range(points.shape[0]):  # a slice would add a second of compile time
        larger[i, 0] = points[i, 0]
        larger[i, 1] = points[i, 1]
    return larger


@kernel
def _rounded(offset):
    """Round to the nearest integer, halves away from zero, as C's round: straight paths have steps of exactly half a cell."""
    size = np.int64(abs(np.float64(offset)) + 0.5)
    return size if offset > 0.0 else -size


@kernel
def gradient_path(pot, nx, ny, k, dx, dy, root_x, root_y, enough, near, patience):
    """Steps of half a cell down bilinearly interpolated unit gradients, from cell k (+ dx, dy) to the root.

    Returns points (>= n, 2) in cells, and n.

    Ends with the root once the potential of the nearest cell is below `enough` or the root is within `near` cells. Beside a
    cell without potential, or when two steps cancel, it moves to the lowest of the 8 neighbors instead (navfn calcPath,
    GradientPath). When `patience` points do not reach a lower cell it continues from the lowest one so far by such a step.
    n = 0 if the potential cannot be descended, which does not occur for a wavefront.
    """
    points = np.empty((1024, 2), np.float32)
    n = 0
    lowest = HIGH
    lowest_k = k
    lowest_n = 0
    down = False  # from cell to cell until one is lower than all before
    limit = nx * ny
    half = np.float32(0.5)
    whole = np.float32(1.0)
    while True:
        nearest = k + _rounded(dx) + nx * _rounded(dy)
        nearest = max(0, min(limit - 1, nearest))
        ix, iy = k % nx, k // nx
        x = np.float32(ix) + dx
        y = np.float32(iy) + dy
        if n + 3 >= points.shape[0]:
            points = _doubled(points)
        if pot[nearest] < enough or np.hypot(x - root_x, y - root_y) < near:
            inside = ix > 0 and iy > 0 and ix < nx - 1 and iy < ny - 1
            rx, ry = np.float64(root_x - ix), np.float64(root_y - iy)
            down = inside and _crosses(pot, k, nx, np.float64(dx), np.float64(dy), rx, ry)
            if not down:
                if n > 0:  # C++ omits this point
                    ax, ay = np.float64(points[n - 1, 0] - ix), np.float64(points[n - 1, 1] - iy)
                    if not inside or max(abs(ax), abs(ay)) > 1.5 or _crosses(pot, k, nx, ax, ay, rx, ry):
                        points[n, 0] = x
                        points[n, 1] = y
                        n += 1
                points[n, 0] = root_x
                points[n, 1] = root_y
                return points, n + 1
        if ix < 1 or iy < 1 or ix > nx - 2 or iy > ny - 2:
            return points, 0
        points[n, 0] = x
        points[n, 1] = y
        n += 1
        if pot[k] < lowest:
            lowest, lowest_k, lowest_n = pot[k], k, n
            down = False
        stuck = n - lowest_n > patience
        if stuck and not down:
            k, n = lowest_k, lowest_n
        canceled = n > 2 and points[n - 1, 0] == points[n - 3, 0] and points[n - 1, 1] == points[n - 3, 1]
        if not (stuck or canceled or down) and _is_surrounded(pot, k, nx):
            gx, gy = _interpolated(pot, k, nx, dx, dy)
            norm = np.float32(np.hypot(gx, gy))
            if norm > 0.0:
                dx += gx * (half / norm)
                dy += gy * (half / norm)
                if dx > whole:
                    k += 1
                    dx -= whole
                if dx < -whole:
                    k -= 1
                    dx += whole
                if dy > whole:
                    k += nx
                    dy -= whole
                if dy < -whole:
                    k -= nx
                    dy += whole
                continue
        to = _lowest_neighbor(pot, k, nx)
        if to == k:
            k, n = lowest_k, lowest_n
            to = _lowest_neighbor(pot, k, nx)
            if to == k:
                ix, iy = k % nx, k // nx
                if np.hypot(ix - root_x, iy - root_y) > 1.5:
                    return points, 0
                ax, ay = np.float64(points[n - 1, 0] - ix), np.float64(points[n - 1, 1] - iy)
                if _crosses(pot, k, nx, ax, ay, np.float64(root_x - ix), np.float64(root_y - iy)):
                    points[n, 0] = ix + np.rint(ax)
                    points[n, 1] = iy + np.rint(ay)
                    points[n + 1, 0] = ix
                    points[n + 1, 1] = iy
                    n += 2
                points[n, 0] = root_x
                points[n, 1] = root_y
                return points, n + 1
            if down:
                return points, 0
        ix, iy = k % nx, k // nx
        ax, ay = np.float64(points[n - 1, 0] - ix), np.float64(points[n - 1, 1] - iy)
        if _crosses(pot, k, nx, ax, ay, np.float64(to % nx - ix), np.float64(to // nx - iy)):
            # first to the center of the cell that contains the last point, then from cell to cell
            k += int(np.rint(ax)) + nx * int(np.rint(ay))
            down = True
        else:
            k = to
        dx = np.float32(0.0)
        dy = np.float32(0.0)


@kernel
def _cheapest_neighbor(pot, k, nx, cost, steps):
    """The lower one of the 8 neighbors with the least sum of its potential and the cost of the step; k if none is lower."""
    best = k
    least = HIGH
    here = steps[cost[k]]
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            n = k + dy * nx + dx
            if pot[n] < pot[k] and (dx == 0 or dy == 0 or pot[k + dx] < HIGH or pot[k + dy * nx] < HIGH):
                length = np.float32(1.0) if dx == 0 or dy == 0 else np.float32(1.4142135)
                p = pot[n] + np.float32(0.5) * length * (here + steps[cost[n]])
                if p < least:
                    least = p
                    best = n
    return best


@kernel
def grid_path(pot, nx, ny, k, x, y, cost, steps, cheapest):
    """From the point (x, y) in cell k from center to center until no neighbor is lower: points (>= n, 2), and n.

    To the lowest of the 8 neighbors (GridPath), or with `cheapest` to the one with the least sum of potential and step cost.
    """
    points = np.empty((1024, 2), np.float32)
    points[0, 0] = x
    points[0, 1] = y
    n = 1
    while True:
        ix, iy = k % nx, k // nx
        if ix < 1 or iy < 1 or ix > nx - 2 or iy > ny - 2:
            break
        to = _cheapest_neighbor(pot, k, nx, cost, steps) if cheapest else _lowest_neighbor(pot, k, nx)
        if to == k:
            break
        if n + 2 > points.shape[0]:
            points = _doubled(points)
        tx, ty = to % nx, to // nx
        if n == 1 and _crosses(pot, k, nx, x - ix, y - iy, np.float64(tx - ix), np.float64(ty - iy)):
            points[n, 0] = ix  # via the center of the cell
            points[n, 1] = iy
            n += 1
        points[n, 0] = tx
        points[n, 1] = ty
        n += 1
        k = to
    return points, n


_NAVFN_PATIENCE: Final = 40  # C++ oscillates for up to 20 points before it makes progress; the path must do the same
_PATIENCE: Final = 8
_EPSILON: Final = 1e-9


class Traceback(ABC):
    """Descends a potential from the goal to the start.

    `offset`: position of the path's points in their cells, 0.5 for centers and 0 for corners.
    """

    def __init__(self, offset: float) -> None:
        self._offset = offset

    @abstractmethod
    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells, centers at whole numbers, from the goal, which is in `cell`, to the start."""

    def points(
        self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell, *, keep_loops: bool
    ) -> NDArray[np.float64]:
        """(n, 2) points (m) from the start to the goal, which may be excluded."""
        g = query.grid.geometry
        cells = self.cells(wave, query, goal, cell)
        if not keep_loops:
            cells = without_loops(cells, g.nx)
        points = np.empty((len(cells), 2))
        reversed_points(cells, self._offset, g.resolution, g.origin_x, g.origin_y, points)
        return points


def navfn_path(wave: Wavefront, cell: Cell, *, root: Cell) -> NDArray[np.float32]:
    """(n, 2) points in cells from `cell` down the gradient to the root of navfn's wave (calcPath)."""
    points, n = gradient_path(
        wave.pot,
        wave.nx,
        wave.ny,
        cell[1] * wave.nx + cell[0],
        np.float32(0.0),
        np.float32(0.0),
        np.float32(root[0]),
        np.float32(root[1]),
        np.float32(NAVFN_NEUTRAL),
        np.float32(-1.0),
        _NAVFN_PATIENCE,
    )
    return points[:n]


class NavfnTraceback(Traceback):
    """navfn: down the gradient, from the corner of the goal cell to the corner of the start cell."""

    def __init__(self) -> None:
        super().__init__(offset=0.0)

    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells from `cell` to the start cell."""
        return navfn_path(wave, cell, root=query.start_cell)


class GradientTraceback(Traceback):
    """global_planner: down the gradient, from the goal to the start (GradientPath)."""

    def __init__(self, *, at_cells: bool) -> None:
        super().__init__(offset=0.0 if at_cells else 0.5)
        self._at_cells = at_cells

    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells from the goal to the start."""
        gx, gy = _position(goal, cell, query, at_cells=self._at_cells)
        sx, sy = _position(query.start, query.start_cell, query, at_cells=self._at_cells)
        first = math.floor(gx + _EPSILON), math.floor(gy + _EPSILON)
        if wave.potential_of(*first) == math.inf:  # C++ starts there in any case, and fails (parity 12)
            first = cell
            gx, gy = float(cell[0]), float(cell[1])
        points, n = gradient_path(
            wave.pot,
            wave.nx,
            wave.ny,
            first[1] * wave.nx + first[0],
            np.float32(gx - first[0]),
            np.float32(gy - first[1]),
            np.float32(sx),
            np.float32(sy),
            np.float32(-1.0),
            np.float32(0.5),
            _PATIENCE,
        )
        return points[:n]


class GridTraceback(Traceback):
    """global_planner: from cell to cell (GridPath).

    `cheapest`: to the cheapest neighbor instead of the lowest one, for A*.
    # ROS differs: C++ takes the lowest with A* too, but its A* gives cheaper grid paths than its Dijkstra.
    """

    def __init__(self, *, at_cells: bool, cheapest: bool) -> None:
        super().__init__(offset=0.0 if at_cells else 0.5)
        self._at_cells = at_cells
        self._cheapest = cheapest

    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells from the goal to the center of the start cell."""
        gx, gy = _position(goal, cell, query, at_cells=self._at_cells)
        k = cell[1] * wave.nx + cell[0]
        points, n = grid_path(wave.pot, wave.nx, wave.ny, k, gx, gy, wave.cost, wave.costs.steps, self._cheapest)
        cells = points[:n]
        if len(cells) > 1 and (cells[-1] != query.start_cell).any():  # it ended in another of the four seeds
            cells = np.vstack([cells, np.array([query.start_cell], np.float32)])
        return cells


def _position(pose: Pose2D, cell: Cell, query: WaveQuery, *, at_cells: bool) -> tuple[float, float]:
    """Position of a pose in units of cells; that of its cell with `at_cells`."""
    return (float(cell[0]), float(cell[1])) if at_cells else position_in_cells(query.grid.geometry, pose)


def without_loops(points: NDArray[np.float32], nx: int) -> NDArray[np.float32]:
    """The path (n, 2), in cells with centers at whole numbers, without returns to a cell that it left before.

    Gradient descent may oscillate in a narrow passage before it makes progress. Where the path returns to a cell, the points
    of the loop are removed and the path continues straight, within that cell. Most paths have no loop and are returned
    unchanged.
    """
    if len(points) < 3:
        return points
    kept = np.ones(len(points), np.bool_)
    return points[kept] if remove_loops(points, nx, kept) else points


@kernel
def reversed_points(cells, offset, resolution, origin_x, origin_y, out):
    """Write the positions (m) of points (n, 2) in cells to `out` (n, 2), the last one first."""
    for i in range(len(cells)):
        at = len(cells) - 1 - i
        out[i, 0] = (np.float64(cells[at, 0]) + offset) * resolution + origin_x
        out[i, 1] = (np.float64(cells[at, 1]) + offset) * resolution + origin_y


@kernel
def remove_loops(points, nx, kept):
    """Set `kept` (n,) to False in the loops of a path (n, 2), in cells; return whether there are any."""
    n = len(points)
    numbers = np.empty(n, np.int64)
    for i in range(n):
        numbers[i] = np.int64(np.rint(points[i, 0])) + np.int64(np.rint(points[i, 1])) * nx
    size = 4
    while size < 2 * n:
        size *= 2
    # a hash table with Knuth's multiplier (The Art of Computer Programming, vol. 3, 6.4)
    cells, last = np.full(size, -1, np.int64), np.empty(size, np.int64)
    place = np.empty(n, np.int64)
    for i in range(n):
        at = (numbers[i] * 2654435761 >> 16) & (size - 1)
        while cells[at] >= 0 and numbers[cells[at]] != numbers[i]:
            at = (at + 1) & (size - 1)
        cells[at], last[at], place[i] = i, i, at  # of several visits to a cell the last one is stored
    found = False
    end = begin = 0
    while begin < n:
        left = begin
        while left + 1 < n and numbers[left + 1] == numbers[begin]:
            left += 1
        visit = last[place[begin]]
        if visit != left and begin >= end:  # a return, and not within a loop that has been removed
            end = visit
            kept[begin + 1 : end] = False
            found = True
        begin = left + 1
    return found

"""Tracebacks: from the potential of a wave to a path."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Final

import numpy as np
from numpy.typing import NDArray

from navstack.core import Pose2D
from navstack.global_planner._search import _traceback_kernels as kernels
from navstack.global_planner._search.cells import Cell, position_in_cells
from navstack.global_planner._search.cost_interpreter import NAVFN_NEUTRAL
from navstack.global_planner._search.propagation import WaveQuery
from navstack.global_planner._search.wavefront import Wavefront

_NAVFN_PATIENCE: Final = 40  # C++ oscillates for up to 20 points before it makes progress; the path must do the same
_PATIENCE: Final = 8
_EPSILON: Final = 1e-9


class Traceback(ABC):
    """Descends a potential from the goal to the start.

    `offset`: position of the path's points in their cells, 0.5 for centres and 0 for corners.
    """

    def __init__(self, offset: float) -> None:
        self._offset = offset

    @abstractmethod
    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells, centres at whole numbers, from the goal, which is in `cell`, to the start."""

    def points(
        self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell, *, keep_loops: bool
    ) -> NDArray[np.float64]:
        """(n, 2) points (m) from the start to the goal, which may be excluded."""
        g = query.grid.geometry
        cells = self.cells(wave, query, goal, cell)
        if not keep_loops:
            cells = without_loops(cells, g.nx)
        return (cells[::-1].astype(np.float64) + self._offset) * g.resolution + (g.origin_x, g.origin_y)


def navfn_path(wave: Wavefront, cell: Cell, *, root: Cell) -> NDArray[np.float32]:
    """(n, 2) points in cells from `cell` down the gradient to the root of navfn's wave (calcPath)."""
    points, n = kernels.gradient_path(
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
        points, n = kernels.gradient_path(
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

    `cheapest`: to the cheapest neighbour instead of the lowest one, for A*.
    # ROS differs: C++ takes the lowest with A* too, but its A* gives cheaper grid paths than its Dijkstra.
    """

    def __init__(self, *, at_cells: bool, cheapest: bool) -> None:
        super().__init__(offset=0.0 if at_cells else 0.5)
        self._at_cells = at_cells
        self._cheapest = cheapest

    def cells(self, wave: Wavefront, query: WaveQuery, goal: Pose2D, cell: Cell) -> NDArray[np.float32]:
        """(n, 2) points in cells from the goal to the centre of the start cell."""
        gx, gy = _position(goal, cell, query, at_cells=self._at_cells)
        k = cell[1] * wave.nx + cell[0]
        points, n = kernels.grid_path(
            wave.pot, wave.nx, wave.ny, k, gx, gy, wave.cost, wave.costs.steps, self._cheapest
        )
        cells = points[:n]
        if len(cells) > 1 and (cells[-1] != query.start_cell).any():  # it ended in another of the four seeds
            cells = np.vstack([cells, np.array([query.start_cell], np.float32)])
        return cells


def _position(pose: Pose2D, cell: Cell, query: WaveQuery, *, at_cells: bool) -> tuple[float, float]:
    """Position of a pose in units of cells; that of its cell with `at_cells`."""
    return (float(cell[0]), float(cell[1])) if at_cells else position_in_cells(query.grid.geometry, pose)


def without_loops(points: NDArray[np.float32], nx: int) -> NDArray[np.float32]:
    """The path (n, 2), in cells with centres at whole numbers, without returns to a cell that it left before.

    Gradient descent may oscillate in a narrow passage before it makes progress. Where the path returns to a cell, the points
    of the loop are removed and the path continues straight, within that cell. Most paths have no loop and are returned
    unchanged.
    """
    numbers = np.rint(points).astype(np.int64) @ np.array([1, nx])
    if len(numbers) < 3:
        return points
    _, which = np.unique(numbers, return_inverse=True)
    last = np.empty(len(numbers), np.int64)
    last[which] = np.arange(len(numbers))  # of several visits to a cell the last one is stored
    last = last[which]
    entered = np.flatnonzero(np.diff(numbers, prepend=-1))
    left = np.append(entered[1:], len(numbers)) - 1
    returning = np.flatnonzero(last[entered] != left)
    if not len(returning):
        return points
    kept = np.ones(len(numbers), np.bool_)
    end = 0
    for i in entered[returning].tolist():
        if i >= end:  # not within a loop that has been removed
            end = int(last[i])
            kept[i + 1 : end] = False
    return points[kept]

"""Cells of a grid as (ix, iy), and positions in units of cells."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from navstack.core import INSCRIBED, LETHAL, UNKNOWN, Costmap, GridGeometry, Pose2D, Window

Cell = tuple[int, int]


def start_fronts(cell: Cell) -> list[Cell]:
    """The four orthogonal neighbors of a cell, in the order in which navfn queues them."""
    x, y = cell
    return [(x + 1, y), (x - 1, y), (x, y - 1), (x, y + 1)]


def cell_coordinates(geometry: GridGeometry, pose: Pose2D) -> tuple[float, float]:
    """Position of a pose in units of cells; cell i covers [i, i + 1)."""
    return (pose.x - geometry.origin_x) / geometry.resolution, (pose.y - geometry.origin_y) / geometry.resolution


def position_in_cells(geometry: GridGeometry, pose: Pose2D) -> tuple[float, float]:
    """Position of a pose in units of cells; cell centers are at whole numbers."""
    x, y = cell_coordinates(geometry, pose)
    return x - 0.5, y - 0.5


def union(a: Window, b: Window) -> Window:
    """The smallest window that contains two."""
    if a.is_empty:
        return b
    if b.is_empty:
        return a
    return Window(min(a.x0, b.x0), min(a.y0, b.y0), max(a.x1, b.x1), max(a.y1, b.y1))


# ----------------------------------------------------------------------------------------------------------------------
# Cost interpreters: which cells a path may enter and what it costs to cross them, by the byte of the cell.


NAVFN_NEUTRAL = 50
_INVSQRT2 = 0.707106781  # navfn.h
_MAX_STEP = 253  # navfn.h, COST_OBS - 1
_MIN_GAIN = 0.004
"""A quadratic potential exceeds the higher of the two neighbors it is entered over by at least 0.0046 of the cost."""


@dataclass(frozen=True, slots=True, eq=False)
class CostInterpreter:
    """Which cells a path may enter."""

    blocked: NDArray[np.bool_]
    """(256,) by the byte of the cell."""
    allow_unknown: bool


@dataclass(frozen=True, slots=True, eq=False)
class WaveCosts(CostInterpreter):
    """Costs for a wavefront."""

    steps: NDArray[np.float32]
    """(256,) potential it takes to enter a cell; finite for blocked cells too, because the start may be in one."""
    weights: NDArray[np.float32]
    """(256,) `steps` over sqrt 2, the gain below which a neighbor is not queued; inf where blocked."""
    quadratic: bool
    """Whether the potential is that of a plane wave over two neighbors."""
    largest: float
    """The largest of the steps into cells that are not blocked; 0 if all are."""


@dataclass(frozen=True, slots=True, eq=False)
class CellCosts(CostInterpreter):
    """Costs for a best-first search over cells."""

    weights: NDArray[np.float64]
    """(256,) cost of a unit of length in the cell, inf where blocked."""
    least: float
    """The least of the weights; also the weight of the start cell if that is blocked."""


def wave_costs(
    steps: NDArray[np.float32], blocked: NDArray[np.bool_], *, quadratic: bool = True, allow_unknown: bool = True
) -> WaveCosts:
    """The costs with these `steps` (256,) where the bytes `blocked` (256,) are blocked."""
    weights = (_INVSQRT2 * steps.astype(np.float64)).astype(np.float32)
    weights[blocked] = np.inf
    for array in (steps, weights, blocked):
        array.setflags(write=False)
    return WaveCosts(blocked, allow_unknown, steps, weights, quadratic, float(steps[~blocked].max(initial=0.0)))


@cache
def order_independent(costs: WaveCosts) -> WaveCosts:
    """The costs for a wave that queues every neighbor whose potential could still decrease.

    navfn queues a neighbor only if the lowered cell alone would lower it. A quadratic potential depends on two neighbors;
    the contribution of the other is missed, and how much that is depends on the order of the cells. With these costs the
    result does not depend on the order: it is the lowest potential of all.
    """
    if not costs.quadratic:
        return costs
    weights = (_MIN_GAIN * costs.steps).astype(np.float32)
    weights[costs.blocked] = np.inf
    weights.setflags(write=False)
    return replace(costs, weights=weights)


@cache
def navfn_costs(allow_unknown: bool) -> WaveCosts:
    """navfn: 50 + 0.8 * cost, at most 253; 253 and 254 blocked; unknown 253 or blocked (algorithms.md 3)."""
    bytes_ = np.arange(256)
    steps = np.minimum(NAVFN_NEUTRAL + (0.8 * bytes_).astype(np.int64), _MAX_STEP).astype(np.float32)
    return wave_costs(steps, _obstacles(allow_unknown), allow_unknown=allow_unknown)


@cache
def global_planner_costs(
    lethal_cost: int, neutral_cost: int, cost_factor: float, allow_unknown: bool, quadratic: bool
) -> WaveCosts:
    """global_planner: cost * cost_factor + neutral_cost, at most lethal_cost - 1; blocked from lethal_cost - 1 up."""
    bytes_ = np.arange(256)
    free = bytes_ < lethal_cost - 1
    free[UNKNOWN] = allow_unknown
    factor = np.float32(cost_factor)
    steps = bytes_.astype(np.float32) * factor + np.float32(neutral_cost)
    steps = np.where(steps >= lethal_cost, np.float32(max(1, lethal_cost - 1)), steps).astype(np.float32)
    return wave_costs(steps, ~free, quadratic=quadratic, allow_unknown=allow_unknown)


@cache
def cell_costs(allow_unknown: bool, neutral: float, factor: float) -> CellCosts:
    """astar, theta_star: neutral + factor * cost; 253 and 254 blocked; unknown as 252 or blocked."""
    blocked = _obstacles(allow_unknown)
    weights = neutral + factor * np.minimum(np.arange(256), INSCRIBED - 1)
    weights[blocked] = np.inf
    for array in (weights, blocked):
        array.setflags(write=False)
    return CellCosts(blocked, allow_unknown, weights, neutral)


def _obstacles(allow_unknown: bool) -> NDArray[np.bool_]:
    bytes_ = np.arange(256)
    blocked = (bytes_ == INSCRIBED) | (bytes_ == LETHAL)
    blocked[UNKNOWN] = not allow_unknown
    return blocked


# ----------------------------------------------------------------------------------------------------------------------
# The cells that a search may enter.


class SearchSpace(NamedTuple):
    """A costmap and which of its cells are blocked."""

    costmap: Costmap
    costs: CostInterpreter
    border_blocked: bool
    """Whether the outermost cells are blocked."""

    def is_blocked(self, cell: Cell) -> bool:
        """Whether paths may not enter the cell."""
        ix, iy = cell
        if self.border_blocked:
            ny, nx = self.costmap.data.shape
            if ix in (0, nx - 1) or iy in (0, ny - 1):
                return True
        return bool(self.costs.blocked[self.costmap.data[iy, ix]])

    def is_obstacle(self, cell: Cell) -> bool:
        """Whether the cell is blocked because of its cost."""
        return bool(self.costs.blocked[self.costmap.data[cell[1], cell[0]]])

    def nearest_free(self, cell: Cell) -> tuple[Cell, float] | None:
        """The free cell whose center is nearest to that of `cell`, and the distance (m); None if no cell is free."""
        ix, iy = cell
        border = 1 if self.border_blocked else 0
        nx, ny = self.costmap.geometry.nx, self.costmap.geometry.ny
        reach = 8
        while True:
            x0, x1 = max(border, ix - reach), min(nx - border, ix + reach + 1)
            y0, y1 = max(border, iy - reach), min(ny - border, iy + reach + 1)
            if x0 < x1 and y0 < y1:
                ys, xs = np.nonzero(~self.costs.blocked[self.costmap.data[y0:y1, x0:x1]])
                if len(xs):
                    squared = (xs + (x0 - ix)) ** 2 + (ys + (y0 - iy)) ** 2
                    best = int(np.argmin(squared))
                    # a cell outside the square may be nearer than a cell in its corner
                    if squared[best] <= reach * reach or reach >= max(nx, ny):
                        found = int(xs[best]) + x0, int(ys[best]) + y0
                        return found, math.sqrt(int(squared[best])) * self.costmap.geometry.resolution
            if reach >= max(nx, ny):
                return None
            reach *= 2
